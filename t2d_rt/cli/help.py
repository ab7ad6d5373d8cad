"""Help texts of options, from the docstrings of what they set."""

from __future__ import annotations

import ast
import inspect
import re
import sys
import textwrap
from collections.abc import Callable
from typing import Any

from pydantic import BaseModel

ENTRY = re.compile(r"^( *)(\w+): (.*(?:\n\1 +\S.*)*)", flags=re.MULTILINE)
"""A parameter's entry in a docstring: "name: text", with all further lines that are indented more than the name."""


def parameter_help(function: Callable[..., Any]) -> dict[str, str]:
    """What a function's docstring says about each of its parameters, as a sentence on one line.

    >>> def sail(knots):
    ...     '''Sail.
    ...
    ...     knots: how fast,
    ...         over ground.
    ...     '''
    >>> parameter_help(sail)
    {'knots': 'How fast, over ground.'}
    """
    return {name: one_line(text[0].upper() + text[1:]) for _, name, text in ENTRY.findall(_docstring(function))}


def _docstring(function: Callable[..., Any]) -> str:
    """A function's docstring; `python -OO` drops it, the source still has it."""
    if function.__doc__ is not None or not sys.flags.optimize:
        return function.__doc__ or ""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    return (ast.get_docstring(tree) or "") if isinstance(tree, ast.FunctionDef) else ""


def field_help(model: type[BaseModel]) -> dict[str, str]:
    """What a model's docstrings say about each of its fields, on one line."""
    return {name: one_line(field.description or "") for name, field in model.model_fields.items()}


def one_line(text: str) -> str:
    """A text as the parser wants it: line breaks become spaces, and percent signs are doubled, as they would be placeholders."""
    return " ".join(text.split()).replace("%", "%%")
