"""Folders of results of text-to-motion models as a provider: MDM, MoMask, Kimodo, MotionGPT, or any motion files with prompts.

What is where:

- MDM: `results.npy` (positions of all samples), `results.txt` (a prompt for each).
- MoMask: `joints/K/sampleK_repeatR_lenL_ik.npy`, and the file of prompts that it was given (`prompts.txt` or `text_prompt.txt`,
  line K, "text#frames") copied beside it, for MoMask does not keep them.
- Kimodo: `NAME.npz` and `NAME.json` with "text" or "texts".
- MotionGPT: `K_out.npy` and `K_in.txt`.
- Any other motion file with `NAME.txt` beside it.
"""

from __future__ import annotations

import io
import json
import operator
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from t2d_rt.core.checks import file_path, shown
from t2d_rt.core.errors import InputError, printable
from t2d_rt.core.files import npy_header, read_bytes
from t2d_rt.motion.descriptions.slots import Description
from t2d_rt.motion.generate.unpickled import unpickled
from t2d_rt.motion.read import load_motion
from t2d_rt.motion.read.arrays import MAX_BYTES
from t2d_rt.motion.read.humanml3d import read_joints
from t2d_rt.motion.read.passes import motion_of
from t2d_rt.motion.read.reading import Reading
from t2d_rt.types.motion import Motion

MOST_TEXT_BYTES = 10_000_000
MOST_RESULTS = 100_000

MOTION_SUFFIXES = ".bvh", ".npy", ".npz", ".amc", ".c3d", ".trc"


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """One motion that a model made for a prompt."""

    file: Path
    prompt: str
    number: int | None = None
    """Which of the motions in the file; None where it holds one."""

    def load(self) -> Motion:
        """The motion; where its prompt is of one step, that is its activity throughout. Of several nobody tells the times."""
        if self.number is None:
            motion = load_motion(self.file)
        else:
            joints = _mdm(self.file)[self.number]
            motion = motion_of(read_joints(joints), Reading())
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
        """A motion for the sentence; one of several by the seed."""
        found = results(self.folder)
        same = [each for each in found if _words(each.prompt) == _words(description.sentence)]
        alike = same or [each for each in found if _kind(each.prompt) == (description.activity, description.type)]
        if not alike:
            examples = "; ".join(repr(printable(each.prompt[:60])) for each in found[:3])
            raise InputError(
                f"none of the {len(found)} motions in '{self.folder}' was made for {shown(description.sentence)} or another "
                f"{description.activity} of its kind; there are {examples}{' ...' if len(found) > 3 else ''}"
            )
        chosen = alike[int(np.random.default_rng(seed).integers(len(alike)))]
        if chosen in same:
            return chosen.load()
        return chosen.load().edited(f"for {printable(description.sentence)!r}, a description of the same kind")


def results(folder: str | Path) -> list[Result]:
    """Every motion in a folder that has a prompt, in the order of file names."""
    place = file_path("folder", folder)
    if not place.is_dir():
        raise InputError(f"'{place}' is no folder; give the one that the model wrote its results to")
    found: list[Result] = []
    for each in _listed(place):
        if len(found) == MOST_RESULTS:
            raise InputError(f"'{place}' holds more than {MOST_RESULTS} motions; give one of its folders")
        found.append(each)
    if not found:
        raise InputError(
            f"'{place}' holds no results with prompts: results.npy and results.txt (MDM), joints/ with prompts.txt (MoMask), .npz "
            "with .json (Kimodo), K_out.npy with K_in.txt (MotionGPT), or motion files with .txt files of the same name"
        )
    return found


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
    """The prompt of a motion file, from the file of words beside it; None where there is none."""
    described = path.with_suffix(".json")
    if path.suffix.lower() == ".npz" and described.is_file():
        return _kimodo_prompt(described)
    if path.stem.endswith("_out"):
        asked = path.with_name(f"{path.stem.removesuffix('_out')}_in.txt")
        return " ".join(_lines(asked, "prompt of MotionGPT")) if asked.is_file() else None
    said = path.with_suffix(".txt")
    return " ".join(_lines(said, "prompt")) if said.is_file() else None


def _kimodo_prompt(path: Path) -> str:
    try:
        found = json.loads(read_bytes(path, limit=MOST_TEXT_BYTES, noun="description of a motion"))
    except (ValueError, RecursionError):
        raise InputError(f'{path} is no JSON file; it must hold the prompt as "text"') from None
    texts = found.get("texts", [found.get("text")]) if isinstance(found, dict) else []
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
        held = unpickled(data[stream.tell() :])
        motions, lengths = held["motion"], held["lengths"]
        if isinstance(lengths, list):
            lengths = np.array([operator.index(each) for each in lengths])
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
    return "".join(each if each.isalnum() else " " for each in sentence.lower()).split()


def _kind(prompt: str) -> tuple[str, str | None] | None:
    """Class and type of what a prompt asks for; None where it asks for something else."""
    found = _read(prompt)
    return None if found is None else (found.activity, found.type)


def _read(prompt: str) -> Description | None:
    from t2d_rt.motion.descriptions.parse import parse_description

    try:
        return parse_description(prompt).description
    except InputError:
        return None
