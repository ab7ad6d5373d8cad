"""Read motions from a folder of results of text-to-motion models, without the pickle module."""

from __future__ import annotations

import io
import json
import math
import operator
import pickletools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import file_path, shown
from t2d_rt.core.errors import InputError, printable
from t2d_rt.core.files import npy_header, read_bytes
from t2d_rt.motion.descriptions.slots import Description
from t2d_rt.motion.read import load_motion
from t2d_rt.motion.read.arrays import MAX_BYTES
from t2d_rt.motion.read.humanml3d import read_joints
from t2d_rt.motion.read.passes import Reading, motion_of
from t2d_rt.types.motion import Motion

# --- what MDM saves with `np.save` of a dictionary, read without the pickle module: nothing is called and no class is looked up ---
#
# The few operations are carried out here (`pickletools` tells them apart) on dictionaries, lists, tuples, words,
# numbers, and arrays of plain types, whose bytes are as many as their shape has. Anything else is refused: no file
# can run code or break memory.


PLAIN = re.compile(r"[biuf][1248]|[US][0-9]{1,5}")
"""Types of arrays that are read: numbers and words."""
OBJECT = "O8"
"""The type of an array that holds Python's own values, as the dictionary lies in one."""
LONGEST_NUMBER = 64
"""Most bytes of an integer."""
_NAMES = {
    (f"numpy.{core}.multiarray", name): called
    for core in ("core", "_core")
    for name, called in (("_reconstruct", "array"), ("scalar", "scalar"))
} | {("numpy", "dtype"): "dtype", ("numpy", "ndarray"): "ndarray"}
_GIVEN = (
    "BININT BININT1 BININT2 LONG1 BINFLOAT BINUNICODE SHORT_BINUNICODE BINUNICODE8 BINBYTES SHORT_BINBYTES BINBYTES8"
)
"""Operations whose argument is a value."""
_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False, "EMPTY_TUPLE": ()}
_EMPTY: Mapping[str, type] = {"EMPTY_DICT": dict, "EMPTY_LIST": list}


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
    """The stack and the memory that a pickle's operations work on."""

    def __init__(self) -> None:
        self.stack: list[Any] = []
        self.marks: list[int] = []
        """Lengths of the stack at which groups begin."""
        self.memory: dict[int, Any] = {}

    def run(self, data: bytes) -> Any:
        """The value that the pickle stands for; raises a ValueError for operations that are not known here."""
        for code, argument, _ in pickletools.genops(data):
            if code.name == "STOP":
                return _inner(self.stack.pop())
            if code.name in _GIVEN.split():
                if isinstance(argument, int) and argument.bit_length() > 8 * LONGEST_NUMBER:
                    raise ValueError("a number of many digits")
                self.stack.append(argument)
            elif code.name in _CONSTANTS:
                self.stack.append(_CONSTANTS[code.name])
            elif code.name in _EMPTY:
                self.stack.append(_EMPTY[code.name]())
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
            _of(stack[-1], list).extend(_inner(value) for value in values)
        elif name in ("SETITEM", "SETITEMS"):
            pairs = self._pop(2) if name == "SETITEM" else self._marked()
            words = [_of(word, str) for word in pairs[::2]]
            _of(stack[-1], dict).update(zip(words, map(_inner, pairs[1::2]), strict=True))
        elif name in ("GLOBAL", "STACK_GLOBAL"):
            pair = tuple(argument.split(" ")) if name == "GLOBAL" else tuple(self._pop(2))
            stack.append(_Name(_NAMES[pair]))
        elif name == "REDUCE":
            called, arguments = self._pop(2)
            stack.append(_result_of(_of(called, _Name).called, _of(arguments, tuple)))
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
        values = self.stack[place:]
        del self.stack[place:]
        return values


def _of(value: Any, kind: type) -> Any:
    if type(value) is not kind:
        raise ValueError(f"{type(value).__name__} in the place of {kind.__name__}")
    return value


def _inner(value: Any) -> Any:
    """The array or value itself."""
    if isinstance(value, (_Name, _Type)):
        raise ValueError("a name in the place of a value")
    return value.value if isinstance(value, _Array) else value


def _result_of(name: str, arguments: tuple[Any, ...]) -> Any:
    """What NumPy's functions would make of their arguments."""
    if name == "dtype":
        return _Type(_of(arguments[0], str))
    if name == "scalar":
        kind, data = arguments
        return _array(_of(kind, _Type).plain(), (), _of(data, bytes), fortran=False)[()].item()
    if name == "array" and isinstance(arguments[0], _Name) and arguments[0].called == "ndarray":
        return _Array()
    raise ValueError(f"a call of {name}")


def _set(value: Any, state: tuple[Any, ...]) -> None:
    """Sets the state of a type or an array that was just begun."""
    if isinstance(value, _Type):
        order = state[1]
        if value.order or order not in ("<", ">", "|", "=") or any(part is not None for part in state[2:5]):
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
    """An array from bytes, which must be as many as its shape has."""
    if not all(type(size) is int and size >= 0 for size in _of(sizes, tuple)) or len(sizes) > 8:
        raise ValueError("a shape that is none")
    if kind.itemsize * math.prod(sizes) != len(data) or not kind.itemsize:
        raise ValueError(f"{len(data)} bytes for shape {sizes}")
    return np.frombuffer(data, kind).reshape(sizes, order="F" if fortran else "C").copy()


def unpickled(data: bytes) -> Any:
    """Dictionaries, lists, tuples, words, numbers and plain arrays of a pickle; raises a ValueError or the like for others."""
    return _Machine().run(data)


# --- folders of results as a provider: MDM, MoMask, Kimodo, MotionGPT, or any motion files with prompts ---
#
# The files of each model are:
#
# - MDM: `results.npy` (positions of all samples), `results.txt` (a prompt for each).
# - MoMask: `joints/K/sampleK_repeatR_lenL_ik.npy`, and the file of prompts that it was given (`prompts.txt` or
#   `text_prompt.txt`, line K, "text#frames") copied beside it, for MoMask does not keep them.
# - Kimodo: `NAME.npz` and `NAME.json` with "text" or "texts".
# - MotionGPT: `K_out.npy` and `K_in.txt`. Any other motion file: `NAME.txt` beside it.


MOST_TEXT_BYTES = 10_000_000
MOST_RESULTS = 100_000

MOTION_SUFFIXES = ".bvh", ".npy", ".npz", ".amc", ".c3d", ".trc"


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """One motion that a model made for a prompt."""

    file: Path
    prompt: str
    number: int | None = None
    """Number of the motion in the file; None if the file holds one."""

    def load(self) -> Motion:
        """The motion; if its prompt has one step, that is its activity throughout. The times of several steps are not known."""
        if self.number is None:
            motion = load_motion(self.file)
        else:
            joints = _mdm(self.file)[self.number]
            motion = motion_of(read_joints(joints), Reading()).motion
        note = f"made for {printable(self.prompt)!r}" + ("" if self.number is None else f", number {self.number}")
        read = _read(self.prompt)
        does = ((read.action, 0.0),) if read is not None and len(read.steps) == 1 else ()
        return replace(motion, origin=(*motion.origin, f"{printable(self.file.name)}: {note}"), activities=does)


@dataclass(frozen=True, slots=True, kw_only=True)
class Files:
    """A folder of results; for a description it returns one that was made for the same sentence, or else for one of its kind."""

    folder: Path

    def __post_init__(self) -> None:
        object.__setattr__(self, "folder", file_path("folder", self.folder))

    def __call__(self, description: Description, *, seed: int) -> Motion:
        """A motion for the sentence, drawn by the seed if there are several; raises an InputError if there is none."""
        motions = results(self.folder)
        same = [result for result in motions if _words(result.prompt) == _words(description.sentence)]
        alike = same or [
            result for result in motions if _kind(result.prompt) == (description.activity, description.type)
        ]
        if not alike:
            examples = "; ".join(repr(printable(result.prompt[:60])) for result in motions[:3])
            raise InputError(
                f"none of the {len(motions)} motions in '{self.folder}' was made for {shown(description.sentence)} or another "
                f"{description.activity} of its kind; there are {examples}{' ...' if len(motions) > 3 else ''}"
            )
        chosen = alike[int(np.random.default_rng(seed).integers(len(alike)))]
        if chosen in same:
            return chosen.load()
        return chosen.load().edited(f"for {printable(description.sentence)!r}, a description of the same kind")


def results(folder: str | Path) -> list[Result]:
    """Every motion in a folder that has a prompt, in the order of file names; raises an InputError if there is none."""
    place = file_path("folder", folder)
    if not place.is_dir():
        raise InputError(f"'{place}' is no folder; give the one that the model wrote its results to")
    motions: list[Result] = []
    for result in _listed(place):
        if len(motions) == MOST_RESULTS:
            raise InputError(f"'{place}' holds more than {MOST_RESULTS} motions; give one of its folders")
        motions.append(result)
    if not motions:
        raise InputError(
            f"'{place}' holds no results with prompts: results.npy and results.txt (MDM), joints/ with prompts.txt (MoMask), .npz "
            "with .json (Kimodo), K_out.npy with K_in.txt (MotionGPT), or motion files with .txt files of the same name"
        )
    return motions


def _listed(place: Path) -> Iterator[Result]:
    if (place / "results.npy").is_file():
        prompts = _lines(place / "results.txt", "prompts of MDM")
        count = len(_mdm(place / "results.npy"))
        if count != len(prompts):
            raise InputError(
                f"'{place}': results.npy has {count} motions and results.txt {len(prompts)} prompts; run MDM again"
            )
        for number, prompt in enumerate(prompts):
            yield Result(file=place / "results.npy", prompt=prompt, number=number)
        return
    if (place / "joints").is_dir():
        yield from _momask(place)
        return
    for path in sorted(place.iterdir()):
        if path.suffix.lower() in MOTION_SUFFIXES and (beside := _prompt_beside(path)) is not None:
            yield Result(file=path, prompt=beside)


def _momask(place: Path) -> Iterator[Result]:
    texts = [place / name for name in ("prompts.txt", "text_prompt.txt") if (place / name).is_file()]
    if not texts:
        raise InputError(
            f"'{place}' has MoMask's joints but not their prompts; copy the file that --text_path named there as prompts.txt"
        )
    prompts = [line.rpartition("#")[0] or line for line in _lines(texts[0], "prompts of MoMask")]
    for path in sorted((place / "joints").glob("*/sample*_repeat*_len*.npy")):
        if not path.stem.endswith("_ik") and path.with_name(f"{path.stem}_ik.npy").is_file():
            continue  # the same motion, its feet not yet planted
        number = path.parent.name
        if not number.isdecimal() or int(number) >= len(prompts):
            raise InputError(f"{path} has no prompt: {texts[0].name} has {len(prompts)} lines, numbered from 0")
        yield Result(file=path, prompt=prompts[int(number)])


def _prompt_beside(path: Path) -> str | None:
    """The prompt of a motion file, from the text file beside it; None if there is none."""
    json_file = path.with_suffix(".json")
    if path.suffix.lower() == ".npz" and json_file.is_file():
        return _kimodo_prompt(json_file)
    if path.stem.endswith("_out"):
        input_file = path.with_name(f"{path.stem.removesuffix('_out')}_in.txt")
        return " ".join(_lines(input_file, "prompt of MotionGPT")) if input_file.is_file() else None
    words_file = path.with_suffix(".txt")
    return " ".join(_lines(words_file, "prompt")) if words_file.is_file() else None


def _kimodo_prompt(path: Path) -> str:
    try:
        content = json.loads(read_bytes(path, limit=MOST_TEXT_BYTES, noun="description of a motion"))
    except (ValueError, RecursionError):
        raise InputError(f'{path} is no JSON file; it must hold the prompt as "text"') from None
    texts = content.get("texts", [content.get("text")]) if isinstance(content, dict) else []
    if not isinstance(texts, list) or not texts or not all(isinstance(text, str) and text.strip() for text in texts):
        raise InputError(f'{path} has no "text" or "texts" of words; it must hold the motion\'s prompt')
    return " ".join(text.strip() for text in texts)


def _lines(path: Path, noun: str) -> list[str]:
    if not path.is_file():
        raise InputError(f"{path} is missing; it must hold the {noun}")
    try:
        text = read_bytes(path, limit=MOST_TEXT_BYTES, noun="text file").decode("utf-8")
    except UnicodeDecodeError:
        raise InputError(f"{path} is no text in UTF-8; it must hold the {noun}") from None
    return [line.strip() for line in text.splitlines() if line.strip()]


def _mdm(path: Path) -> list[np.ndarray]:
    """Joints (T, 22, 3) of each motion of MDM's results.npy, cut to its length."""
    data = read_bytes(path, limit=MAX_BYTES, noun="array file")
    stream = io.BytesIO(data)
    try:
        npy_header(stream)
        saved = unpickled(data[stream.tell() :])
        motions, lengths = saved["motion"], saved["lengths"]
        if isinstance(lengths, list):
            lengths = np.array([operator.index(length) for length in lengths])
        if not isinstance(motions, np.ndarray) or not isinstance(lengths, np.ndarray):
            raise TypeError("motion and lengths must be arrays")
    except Exception:  # whatever a damaged file or one with other objects makes numpy raise
        raise InputError(
            f"{path} is not MDM's results.npy: it is damaged, or holds other things than arrays and words in a dictionary; "
            "write it with np.save(path, {'motion': ..., 'lengths': ...}) of plain arrays"
        ) from None
    whole = np.issubdtype(lengths.dtype, np.integer) and lengths.ndim == 1 and len(lengths) == len(motions)
    if motions.ndim != 4 or motions.shape[1:3] != (22, 3) or not np.issubdtype(motions.dtype, np.floating) or not whole:
        raise InputError(
            f"{path}: motions must have shape (samples, 22, 3, frames) and a length each, got {motions.shape} and {lengths.shape}"
        )
    if not ((lengths >= 2) & (lengths <= motions.shape[3])).all():
        raise InputError(
            f"{path}: MDM's lengths must lie between 2 and {motions.shape[3]} frames, got {shown(lengths)}"
        )
    if not np.isfinite(motions).all():
        raise InputError(f"{path}: MDM's motions hold NaN or infinite values; run MDM again")
    return [motion.transpose(2, 0, 1)[:length].astype(float) for motion, length in zip(motions, lengths, strict=True)]


def _words(sentence: str) -> list[str]:
    return "".join(character if character.isalnum() else " " for character in sentence.lower()).split()


def _kind(prompt: str) -> tuple[str, str | None] | None:
    """Class and type of what a prompt asks for; None if it is not understood."""
    description = _read(prompt)
    return None if description is None else (description.activity, description.type)


def _read(prompt: str) -> Description | None:
    from t2d_rt.motion.descriptions.parse import parse_description

    try:
        return parse_description(prompt).description
    except InputError:
        return None
