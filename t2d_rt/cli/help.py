"""Help texts of options, from the docstrings of what they set."""

from __future__ import annotations

import re
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
    return {name: one_line(text[0].upper() + text[1:]) for _, name, text in ENTRY.findall(function.__doc__ or "")}


def field_help(model: type[BaseModel]) -> dict[str, str]:
    """What a model's docstrings say about each of its fields, on one line."""
    return {name: one_line(field.description or "") for name, field in model.model_fields.items()}


def one_line(text: str) -> str:
    """A text as the parser wants it: line breaks become spaces, and percent signs are doubled, as they would be placeholders."""
    return " ".join(text.split()).replace("%", "%%")
