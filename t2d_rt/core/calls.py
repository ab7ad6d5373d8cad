"""Errors of one sentence for public functions and classes that are called with wrong arguments, with the name that was probably
meant."""

from __future__ import annotations

import functools
import inspect
import sys
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from t2d_rt.core.errors import InputError

T = TypeVar("T")


class CallError(InputError, TypeError):
    """Raised where a function is called with arguments that it does not have, or without some that it needs."""

    option: str = ""
    """Name of an unknown argument."""
    known: Sequence[str] = ()
    """Names of the arguments that are optional."""


def public(value: T) -> T:
    """Makes wrong calls of a function, or of a class and its methods, raise a CallError. A class is changed in place; a function is
    replaced in its module by a wrapper, as pickle expects."""
    if isinstance(value, type):
        for name, member in list(vars(value).items()):
            if name == "__init__" or not name.startswith("_"):
                kind = type(member)
                if kind in (staticmethod, classmethod):
                    setattr(value, name, kind(_checked(member.__func__)))
                elif inspect.isfunction(member):
                    setattr(value, name, _checked(member))
        return value
    if not inspect.isfunction(value):
        return value
    checked_function: Any = _checked(value)
    setattr(sys.modules[value.__module__], value.__name__, checked_function)
    return checked_function  # type: ignore[no-any-return]


def _checked(function: Callable[..., Any]) -> Callable[..., Any]:
    if hasattr(function, "checked"):
        return function

    @functools.wraps(function)
    def call(*values: Any, **options: Any) -> Any:
        try:
            return function(*values, **options)
        except CallError as error:
            # The unknown option was passed on to another function, but may have been meant for this one.
            own_options = _optional(function)
            if error.option not in options or error.option in own_options:
                raise
            both = list(dict.fromkeys([*own_options, *error.known]))
            raise _unknown(_name(function, values), error.option, both, both) from None
        except TypeError:
            call_error = _error(function, values, options)
            if call_error is None:
                raise
            raise call_error from None

    call.checked = True  # type: ignore[attr-defined]
    return call


def _name(function: Callable[..., Any], values: tuple[Any, ...]) -> str:
    return type(values[0]).__name__ if function.__name__ == "__init__" else function.__qualname__


def _optional(function: Callable[..., Any]) -> list[str]:
    parameters = inspect.signature(function).parameters.values()
    optional_kinds = inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY
    return [
        parameter.name
        for parameter in parameters
        if parameter.kind in optional_kinds and parameter.default is not parameter.empty
    ]


def _unknown(name: str, option: str, names: Sequence[str], known: Sequence[str]) -> CallError:
    from t2d_rt.core.checks import names_advice, shown  # loads NumPy, for which `import t2d_rt` shall not wait

    error = CallError(f"{name} has no option {shown(option)}; {names_advice(option, names)}")
    error.option, error.known = option, known
    return error


def _error(function: Callable[..., Any], values: tuple[Any, ...], options: dict[str, Any]) -> CallError | None:
    """The error about the arguments of a call; None where they fit."""
    signature, name = inspect.signature(function), _name(function, values)
    try:
        signature.bind(*values, **options)
    except TypeError as error:
        several = inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD
        parameters = list(signature.parameters.values())
        names = [
            parameter.name
            for parameter in parameters
            if parameter.kind not in several and parameter.name not in ("self", "cls")
        ]
        unknown = [option for option in options if option not in names]
        if unknown and names and parameters[-1].kind is not several[1]:
            return _unknown(name, unknown[0], names, _optional(function))
        more = ["options by name"] if any(parameter.kind is several[1] for parameter in parameters) else []
        return CallError(f"{name}: {error}; it takes {', '.join(names + more) or 'nothing'}")
    return None
