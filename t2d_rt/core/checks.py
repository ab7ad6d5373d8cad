"""Checks of arguments of public functions. Each returns the value in the form that the function needs, or raises an InputError of
one sentence: what was given, what was expected, and what to do.

>>> number("distance_m", 3, 0, 100)
3.0
>>> array("centre", [1, 2, 3], (3,))
array([1., 2., 3.])
"""

from __future__ import annotations

import difflib
import math
import reprlib
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from numbers import Real
from os import PathLike, fsdecode, fsencode
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.errors import InputError

LARGEST_M = 1e6
"""Greatest coordinate of anything [m]; larger ones are in a wrong unit, or damaged."""

GREATEST = 1e100
"""Greatest number that is accepted: the fourth power of larger ones would be infinite."""

LONGEST_SHOWN = 60
"""Greatest number of characters of a value in an error message."""
LONGEST_NAME = 100
"""Greatest number of characters of a name that is compared with known ones."""

_short = reprlib.Repr()
_short.maxstring = _short.maxother = LONGEST_SHOWN
_short.maxlist = _short.maxtuple = _short.maxdict = 4


def shown(value: Any) -> str:
    """A value as an error message shows it: one line of at most LONGEST_SHOWN characters, however large the value is."""
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype} of shape {value.shape}"
    try:
        words = " ".join(_short.repr(value).split())
    except Exception:  # the repr of a user's object may raise anything
        words = f"a {type(value).__name__}"
    return words if len(words) <= LONGEST_SHOWN else words[: LONGEST_SHOWN - 3] + "..."


def number(
    name: str, value: Any, low: float = -math.inf, high: float = math.inf, *, unit: str = "", hint: str = ""
) -> float:
    """A checked number: finite, from `low` to `high` inclusive."""
    scalar = _scalar(value)
    if isinstance(scalar, (bool, np.bool_)) or not isinstance(scalar, Real):
        raise InputError(f"{name} must be a number, got {shown(value)}{_then(hint)}")
    scalar = _finite_float(scalar)
    if not (low <= scalar <= high and -GREATEST < scalar < GREATEST):
        raise InputError(f"{name} must {_range(low, high, unit)}, got {shown(value)}{_then(hint)}")
    return scalar


def positive(name: str, value: Any, high: float = math.inf, *, unit: str = "", hint: str = "") -> float:
    """A checked number: above 0, and at most `high`."""
    scalar = number(name, value, unit=unit, hint=hint)
    if not scalar > 0:
        raise InputError(f"{name} must be positive, got {shown(value)}{_then(hint)}")
    return number(name, scalar, high=high, unit=unit, hint=hint)


def integer(name: str, value: Any, low: int = 0, high: int | None = None, *, hint: str = "") -> int:
    """A checked integer from `low` to `high` inclusive; floats are refused, even 128.0."""
    scalar = _scalar(value)
    whole = isinstance(scalar, (int, np.integer)) and not isinstance(scalar, bool)
    scalar = int(scalar) if whole else 0
    if not whole or scalar < low or (high is not None and scalar > high):
        limits = f"of {low} or more" if high is None else f"in {low}..{high}"
        raise InputError(f"{name} must be an integer {limits}, got {shown(value)}{_then(hint)}")
    return scalar


def flag(name: str, value: Any) -> bool:
    """A checked bool; NumPy's are accepted."""
    if not isinstance(value, (bool, np.bool_)):
        raise InputError(f"{name} must be True or False, got {shown(value)}")
    return bool(value)


def text(name: str, value: Any, *, hint: str = "") -> str:
    """A checked str, unchanged."""
    if not isinstance(value, str):
        raise InputError(f"{name} must be a text, got {shown(value)}{_then(hint)}")
    return value


def choice(name: str, value: Any, choices: Collection[str], *, hint: str = "") -> str:
    """A checked str: one of the given words."""
    if not isinstance(value, str) or value not in choices:
        *first, last = (repr(word) for word in choices)
        expected = f"{', '.join(first)} or {last}" if first else last
        raise InputError(f"{name} must be {expected}, got {shown(value)}{_then(hint)}")
    return value


def unknown_name(noun: str, value: Any, known: Collection[str], *, hint: str = "") -> InputError:
    """The error that no `noun` has this name. It suggests the closest known name, or else lists all.

    >>> print(unknown_name("fruit", "Aple", ["apple", "pear"]))
    unknown fruit 'Aple'; did you mean apple?
    >>> print(unknown_name("fruit", "nut", ["apple", "pear"], hint=", or grow one"))
    unknown fruit 'nut'; choose one of apple, pear, or grow one
    >>> print(unknown_name("path pair", "wall", ["direct", "floor, left"]))
    unknown path pair 'wall'; choose one of direct; floor, left
    """
    return InputError(f"unknown {noun} {shown(value)}; {names_advice(value, known, hint=hint)}")


def names_advice(value: Any, known: Collection[str], *, hint: str = "") -> str:
    """End of the message about an unknown name: the closest known name, or else all of them and the hint."""
    by_plain_name = {_plain_name(name): name for name in known}
    close = difflib.get_close_matches(_plain_name(str(value)[:LONGEST_NAME]), by_plain_name, n=1)
    apart = "; " if any("," in name for name in known) else ", "
    return f"did you mean {by_plain_name[close[0]]}?" if close else f"choose one of {apart.join(known)}{hint}"


def _plain_name(name: str) -> str:
    return name.lower().replace("_", "-").replace(" ", "-")


def file_path(name: str, value: Any) -> Path:
    """A checked path of a file."""
    if not isinstance(value, (str, PathLike)):
        raise InputError(f"{name} must be a path (a text or a pathlib.Path), got {shown(value)}")
    try:
        path = fsdecode(value)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be a path (a text or a pathlib.Path), got {shown(value)}") from None
    too_long = len(path) > 4096 or max(map(len, Path(path).parts), default=0) > 255
    try:
        fsencode(path)
    except UnicodeEncodeError:
        raise InputError(f"{name} {shown(path)} is not a valid file name; it holds half of a character") from None
    if not path or "\0" in path or too_long:
        raise InputError(f"{name} {shown(path)} is not a valid file name{': it is too long' if too_long else ''}")
    return Path(path)


def instance(name: str, value: Any, kind: type | tuple[type, ...], expected: str, *, hint: str = "") -> Any:
    """A checked object of a type, which the error message calls `expected`."""
    if not isinstance(value, kind):
        raise InputError(f"{name} must be {expected}, got {shown(value)}{_then(hint)}")
    return value


def listed(name: str, value: Any, kind: type, expected: str) -> tuple[Any, ...]:
    """The items of a list or tuple, all checked to be of a type, which the error message calls `expected`."""
    if not isinstance(value, (list, tuple)) or not all(isinstance(item, kind) for item in value):
        raise InputError(f"{name} must be {expected}, got {shown(value)}")
    return tuple(value)


def call(name: str, value: Any, expected: str) -> Any:
    """A checked function, which the error message calls `expected`."""
    if not callable(value):
        raise InputError(f"{name} must be {expected}, got {shown(value)}")
    return value


def array(
    name: str,
    value: Any,
    shape: tuple[int | str, ...] | None = None,
    *,
    limit: float = 1e30,
    unit: str = "",
    hint: str = "",
) -> np.ndarray:
    """A checked array of finite float64 numbers of magnitude up to `limit`. A word in `shape` stands for a dimension of any
    length."""
    numbers = numeric(name, value)
    if np.iscomplexobj(numbers):
        raise InputError(f"{name} must hold real numbers, got {numbers.dtype}{_then(hint)}")
    if shape is not None:
        check_shape(name, numbers, shape, hint=hint)
    numbers = np.asarray(numbers, dtype=np.float64)
    greatest = float(np.abs(numbers).max(initial=0))
    if not np.isfinite(greatest):
        wrong = int(np.count_nonzero(~np.isfinite(numbers)))
        raise InputError(f"{name} must be finite, got {wrong} NaN or infinite values{_then(hint)}")
    if greatest > limit:
        raise InputError(
            f"{name} must not exceed {_limit(limit)}{f' {unit}' if unit else ''}, got {greatest:.4g}{_then(hint)}"
        )
    return numbers


def numeric(name: str, value: Any) -> np.ndarray:
    """Numbers of any type as an array. Masked arrays are refused, because their masked values would be taken for data."""
    within = value if isinstance(value, (list, tuple)) else [value]
    if any(isinstance(part, np.ma.MaskedArray) for part in within):
        raise InputError(f"{name} must not be a masked array: fill or cut what is masked first")
    try:
        numbers = np.asarray(value)
    except (ValueError, TypeError):
        raise InputError(f"{name} must be an array of numbers, got {shown(value)}") from None
    if not (np.issubdtype(numbers.dtype, np.number)):
        raise InputError(f"{name} must be an array of numbers, got {_kind(numbers, value)}")
    return numbers


def check_shape(name: str, value: Any, shape: tuple[int | str, ...], *, hint: str = "") -> None:
    """Refuses an array of another shape; a word in `shape` stands for a dimension of any length."""
    fits = value.ndim == len(shape) and all(
        isinstance(extent, str) or extent == length for extent, length in zip(shape, value.shape, strict=True)
    )
    if not fits:
        expected = ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "")
        raise InputError(f"{name} must have shape ({expected}), got {value.shape}{_then(hint)}")


def interval(name: str, value: Any, *, unit: str = "") -> tuple[float, float]:
    """A checked pair of numbers, the lower one first; they may be infinite."""
    pair = numeric(name, value) if isinstance(value, (list, tuple, np.ndarray)) else None
    if pair is None or pair.shape != (2,) or np.iscomplexobj(pair) or np.isnan(pair).any() or pair[0] > pair[1]:
        expected = f"two numbers, least and greatest{f', in {unit}' if unit else ''}"
        raise InputError(f"{name} must be {expected}, got {shown(value)}")
    return float(pair[0]), float(pair[1])


def options(name: str, value: Any, known: Collection[str]) -> Mapping[str, Any]:
    """A checked mapping, all of whose keys are known."""
    if not isinstance(value, Mapping):
        raise InputError(f"{name} must be a mapping of options and values, got {shown(value)}")
    for key in value:
        if key not in known:
            raise InputError(f"unknown option {shown(key)} of {name}; choose from {', '.join(known)}")
    return value


def _scalar(value: Any) -> Any:
    """The value of a zero-dimensional array, except np.ma.masked, which is no number; anything else unchanged."""
    if isinstance(value, np.ndarray) and value.ndim == 0 and not isinstance(value, np.ma.MaskedArray):
        return value[()]
    return value


def _finite_float(value: Any) -> float:
    """A number as a float; an integer too large for a float becomes infinite."""
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _kind(numbers: np.ndarray, value: Any) -> str:
    return shown(value) if numbers.ndim == 0 else f"an array of {numbers.dtype}"


def _range(low: float, high: float, unit: str) -> str:
    end = f" {unit}" if unit else ""
    if math.isinf(low) and math.isinf(high):
        return "be finite"
    if math.isinf(high):
        return f"be {_limit(low)}{end} or more and finite"
    if math.isinf(low):
        return f"be {_limit(high)}{end} or less"
    return f"lie in {_limit(low)}..{_limit(high)}{end}"


def _limit(value: float) -> str:
    return f"{value:g}" if abs(value) >= 1e6 else f"{value:.10g}"


def _then(hint: str) -> str:
    return f"; {hint}" if hint else ""


def numbered(names: Iterable[str], sign: str = " ", taken: Iterable[str] = ()) -> list[str]:
    """Makes names unique: a name that occurred before, or is in `taken`, gets a number, as in "adult 2"."""
    used, counts, distinct = set(taken), Counter[str](), list[str]()
    for name in names:
        candidate = name
        while candidate in used:
            counts[name] += 1
            candidate = f"{name}{sign}{counts[name] + 1}"
        used.add(candidate)
        distinct.append(candidate)
    return distinct
