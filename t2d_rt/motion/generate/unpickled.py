"""What MDM saves with `np.save` of a dictionary, read without the pickle module: nothing is called and no class is looked up.

The few operations are carried out here (`pickletools` tells them apart) on dictionaries, lists, tuples, words, numbers, and arrays
of plain types, whose bytes are as many as their shape has. Anything else is refused: no file can run code or break memory.
"""

from __future__ import annotations

import math
import pickletools
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

PLAIN = re.compile(r"[biuf][1248]|[US][0-9]{1,5}")
"""Types of arrays: numbers and words."""
OBJECT = "O8"
"""The type of an array that holds Python's own values, as the dictionary lies in one."""
LONGEST_NUMBER = 64
"""Bytes of a whole number."""
_MULTIARRAY = ("numpy.core.multiarray", "numpy._core.multiarray")
_NAMES = {
    **{(module, "_reconstruct"): "array" for module in _MULTIARRAY},
    **{(module, "scalar"): "scalar" for module in _MULTIARRAY},
    ("numpy", "dtype"): "dtype", ("numpy", "ndarray"): "ndarray",
}  # fmt: skip
_CONSTANTS = {
    "BININT", "BININT1", "BININT2", "LONG1", "BINFLOAT", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8", "BINBYTES",
    "SHORT_BINBYTES", "BINBYTES8",
}  # fmt: skip
_FIXED: Mapping[str, Callable[[], Any]] = {
    "NONE": lambda: None, "NEWTRUE": lambda: True, "NEWFALSE": lambda: False, "EMPTY_DICT": dict, "EMPTY_LIST": list,
    "EMPTY_TUPLE": tuple,
}  # fmt: skip


@dataclass(slots=True)
class _Name:
    """A name that a pickle would look up."""

    called: str


@dataclass(slots=True)
class _Type:
    """The type of an array."""

    code: str
    order: str = ""

    def plain(self) -> np.dtype[Any]:
        if not PLAIN.fullmatch(self.code):
            raise ValueError(f"an array of type {self.code}")
        return np.dtype(self.code).newbyteorder(">" if self.order == ">" else "<")


@dataclass(slots=True)
class _Array:
    """An array, or one of Python's own values, which has no dimensions."""

    value: Any = None


class _Machine:
    """The stack and the memory of a pickle."""

    def __init__(self) -> None:
        self.stack: list[Any] = []
        self.marks: list[int] = []
        """Lengths of the stack at which groups begin."""
        self.memory: dict[int, Any] = {}

    def run(self, data: bytes) -> Any:
        """What the pickle stands for."""
        for code, argument, _ in pickletools.genops(data):
            if code.name == "STOP":
                return _inner(self.stack.pop())
            if code.name in _CONSTANTS:
                if isinstance(argument, int) and argument.bit_length() > 8 * LONGEST_NUMBER:
                    raise ValueError("a number of many digits")
                self.stack.append(argument)
            elif code.name in _FIXED:
                self.stack.append(_FIXED[code.name]())
            else:
                self._step(code.name, argument)
        raise ValueError("it has no end")

    def _step(self, name: str, argument: Any) -> None:
        stack = self.stack
        if name in ("PROTO", "FRAME"):
            return
        if name == "MARK":
            self.marks.append(len(stack))
        elif name == "MEMOIZE":
            self.memory[len(self.memory)] = stack[-1]
        elif name in ("BINPUT", "LONG_BINPUT"):
            self.memory[argument] = stack[-1]
        elif name in ("BINGET", "LONG_BINGET"):
            stack.append(self.memory[argument])
        elif name in ("TUPLE1", "TUPLE2", "TUPLE3"):
            stack.append(tuple(self._pop(int(name[-1]))))
        elif name == "TUPLE":
            stack.append(tuple(self._marked()))
        elif name in ("APPEND", "APPENDS"):
            values = self._pop(1) if name == "APPEND" else self._marked()
            _of(stack[-1], list).extend(_inner(each) for each in values)
        elif name in ("SETITEM", "SETITEMS"):
            pairs = self._pop(2) if name == "SETITEM" else self._marked()
            words = [_of(each, str) for each in pairs[::2]]
            _of(stack[-1], dict).update(zip(words, map(_inner, pairs[1::2]), strict=True))
        elif name in ("GLOBAL", "STACK_GLOBAL"):
            pair = tuple(argument.split(" ")) if name == "GLOBAL" else tuple(self._pop(2))
            stack.append(_Name(_NAMES[pair]))
        elif name == "REDUCE":
            called, given = self._pop(2)
            stack.append(_made(_of(called, _Name).called, _of(given, tuple)))
        elif name == "BUILD":
            (state,) = self._pop(1)
            _set(stack[-1], _of(state, tuple))
        else:
            raise ValueError(f"operation {name}")

    def _pop(self, count: int) -> list[Any]:
        if len(self.stack) - count < (self.marks[-1] if self.marks else 0):
            raise ValueError("a value is missing")
        return self._cut(len(self.stack) - count)

    def _marked(self) -> list[Any]:
        return self._cut(self.marks.pop())

    def _cut(self, place: int) -> list[Any]:
        found = self.stack[place:]
        del self.stack[place:]
        return found


def _of(value: Any, kind: type) -> Any:
    if type(value) is not kind:
        raise ValueError(f"{type(value).__name__} in the place of {kind.__name__}")
    return value


def _inner(value: Any) -> Any:
    """The array or value itself."""
    if isinstance(value, (_Name, _Type)):
        raise ValueError("a name in the place of a value")
    return value.value if isinstance(value, _Array) else value


def _made(name: str, given: tuple[Any, ...]) -> Any:
    """What NumPy's functions would make of their arguments."""
    if name == "dtype":
        return _Type(_of(given[0], str))
    if name == "scalar":
        kind, data = given
        return _array(_of(kind, _Type).plain(), (), _of(data, bytes), fortran=False)[()].item()
    if name == "array" and isinstance(given[0], _Name) and given[0].called == "ndarray":
        return _Array()
    raise ValueError(f"a call of {name}")


def _set(value: Any, state: tuple[Any, ...]) -> None:
    """What is told of a type or an array that was just begun."""
    if isinstance(value, _Type):
        order = state[1]
        if value.order or order not in ("<", ">", "|", "=") or any(each is not None for each in state[2:5]):
            raise ValueError("a type with parts")
        value.order = order
        return
    _, sizes, kind, fortran, data = state
    if _of(value, _Array).value is not None:
        raise ValueError("an array that is set twice")
    if _of(kind, _Type).code == OBJECT:
        if sizes != ():
            raise ValueError("an array of objects")
        (value.value,) = _of(data, list)
    else:
        value.value = _array(kind.plain(), sizes, _of(data, bytes), fortran=bool(fortran))


def _array(kind: np.dtype[Any], sizes: Any, data: bytes, *, fortran: bool) -> np.ndarray:
    """An array of bytes that are as many as its shape has."""
    if not all(type(each) is int and each >= 0 for each in _of(sizes, tuple)) or len(sizes) > 8:
        raise ValueError("a shape that is none")
    if kind.itemsize * math.prod(sizes) != len(data) or not kind.itemsize:
        raise ValueError(f"{len(data)} bytes for shape {sizes}")
    return np.frombuffer(data, kind).reshape(sizes, order="F" if fortran else "C").copy()


def unpickled(data: bytes) -> Any:
    """What a pickle holds of dictionaries, lists, tuples, words, numbers and plain arrays; ValueError or the like where more."""
    return _Machine().run(data)
