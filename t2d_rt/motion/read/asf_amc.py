"""Read Acclaim's pairs of .asf (skeleton) and .amc (motion), as the CMU database has them.

The .asf names each bone with a direction in the world, a length, an axis (Euler angles of the frame in which its angles turn) and
the order of its angles; the .amc gives the root's place and all angles per frame. A bone's global rotation is its parent's times
C M C^-1, with C of the axis and M of the angles (the first named is applied first), and its end lies at R direction length.
Lengths are inches times the file's `length` scale: CMU's unit is 1/0.45 inch. An .amc has no frame rate; CMU's are 120 Hz,
a few 60.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes
from t2d_rt.motion.quaternions import about_axis, conjugate, multiply, rotate
from t2d_rt.motion.read.bvh import MAX_FRAMES
from t2d_rt.motion.read.samples import filled, plausible
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.motion.skeletons import tables

RATE_HZ = 120.0

MAX_BYTES = 150_000_000

ROOT = "root"

ENDS: Mapping[str, tuple[str, str]] = tables()["acclaim"]
"""For each canonical joint: the bone that ends there, and the bone that turns with it."""

COLLAR = 0.2
"""Fraction of the clavicle at which the canonical collar lies, because clavicles start in the middle of the body."""


@dataclass(frozen=True, slots=True)
class Bone:
    """A bone of a skeleton, or its root."""

    direction: np.ndarray
    length: float
    axis: np.ndarray
    """Rotation C of the bone's frame, a quaternion x, y, z, w."""
    angles: tuple[str, ...]
    """Names of the values that the .amc gives for it, such as rx, ry."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Skeleton:
    """The skeleton that an .asf file describes."""

    bones: dict[str, Bone]
    parents: dict[str, str]
    """Parents of all bones but the root, in an order in which parents precede children."""
    unit_m: float
    degrees: bool


def read_asf_amc(path: Path) -> Tracks:
    """Tracks of an .amc with the .asf beside it: of the same name, of the name up to `_` (01_02.amc, 01.asf), or the only one.

    Raises an InputError if there is no such skeleton, or if one of the files cannot be read.
    """
    skeleton_path = _skeleton_beside(path)
    skeleton = read_asf(skeleton_path)
    values, lost = _frames(path, skeleton)
    turned, ends, place = _forward(skeleton, values)
    missing = sorted(
        {
            bone
            for pair in ENDS.values()
            for bone in pair
            if bone not in turned and not bone.endswith(("head", "toes", "fingers"))
        }
    )
    if missing:
        raise InputError(
            f"{skeleton_path} lacks the bones {', '.join(missing)}; only skeletons with CMU's names are read"
        )
    points, orientations = {"pelvis": place}, {"pelvis": turned[ROOT]}
    for name, (bone, carrier) in ENDS.items():
        if bone in ends:
            points[name], orientations[name] = ends[bone], turned.get(carrier, turned[bone])
    for side in ("left", "right"):
        start = ends[skeleton.parents[f"{side[0]}clavicle"]]
        points[f"{side}_collar"] = (1 - COLLAR) * start + COLLAR * points[f"{side}_shoulder"]
        orientations[f"{side}_collar"] = turned[f"{side[0]}clavicle"]
    tracks = Tracks(form="ASF/AMC", points=points, turned=orientations, rate_hz=RATE_HZ, unit_m=skeleton.unit_m, up="y")
    return replace(tracks.without(lost), rate_assumed=True).saying(f"skeleton {skeleton_path.name}")


def _skeleton_beside(path: Path) -> Path:
    folder = path.parent
    for stem in (path.stem, path.stem.split("_")[0]):
        for suffix in (".asf", ".ASF"):
            if (folder / f"{stem}{suffix}").is_file():
                return folder / f"{stem}{suffix}"
    others = sorted(folder.glob("*.[aA][sS][fF]"))
    if len(others) == 1:
        return others[0]
    raise InputError(
        f"{path} needs its skeleton beside it: {path.stem}.asf or {path.stem.split('_')[0]}.asf, "
        f"{'none is there' if not others else f'there are {len(others)} others'}"
    )


# --- .asf ---


def read_asf(path: Path) -> Skeleton:
    """The skeleton of an .asf file; raises an InputError if it is not whole."""
    sections = _sections(_text(path, 1_000_000, "ASF file"))
    try:
        units = {line[0].lower(): line[1] for line in sections["units"]}
        scale, degrees = float(units.get("length", "1.0")), _degrees(units.get("angle", "deg"))
        bones = dict(_bone(block, degrees) for block in _blocks(sections["bonedata"]))
        if ROOT in bones:
            raise ValueError("the root has a section of its own")
        bones[ROOT] = _root(sections["root"], degrees)
        parents = _parents(sections["hierarchy"])
    except (KeyError, IndexError, ValueError):
        raise InputError(
            f"{path} is not a whole ASF skeleton: an .asf holds :units, :root, :bonedata and :hierarchy"
        ) from None
    unknown = sorted({*parents, *parents.values()} - set(bones))
    if unknown or len(bones) > 300 or not 1e-6 < scale < 1e6 or len(parents) != len(bones) - 1:
        raise InputError(f"{path} is not a whole ASF skeleton: its hierarchy and its bones differ ({shown(unknown)})")
    return Skeleton(bones=bones, parents=parents, unit_m=0.0254 / scale, degrees=degrees)


def _text(path: Path, limit: int, noun: str) -> str:
    data = read_bytes(path, limit=limit, noun=noun)
    if b"\0" in data:
        raise InputError(f"{path} is not text; it is damaged or no {noun}")
    return data.decode("latin-1")


def _sections(text: str) -> dict[str, list[list[str]]]:
    """Words of the lines under each `:keyword`; those that follow it on its own line come first."""
    sections: dict[str, list[list[str]]] = {}
    lines: list[list[str]] = []
    for line in text.splitlines():
        words = re.sub(r"[(),]", " ", line.split("#")[0]).split()
        if words and words[0].startswith(":"):
            lines = sections.setdefault(words[0][1:].lower(), [])
            words = words[1:]
        if words:
            lines.append(words)
    return sections


def _blocks(lines: list[list[str]]) -> list[list[list[str]]]:
    blocks: list[list[list[str]]] = []
    for words in lines:
        if words[0].lower() == "begin":
            blocks.append([])
        elif words[0].lower() != "end":
            blocks[-1].append(words)
    return blocks


def _degrees(word: str) -> bool:
    if word.lower()[:3] not in ("deg", "rad"):
        raise ValueError(word)
    return word.lower().startswith("deg")


def _bone(block: list[list[str]], degrees: bool) -> tuple[str, Bone]:
    entries = {words[0].lower(): words[1:] for words in block}
    direction = _numbers(entries["direction"][:3])
    angles = tuple(angle.lower() for angle in entries.get("dof", ()))
    if not all(re.fullmatch(r"[rt][xyz]|l", angle) for angle in angles):
        raise ValueError(angles)
    axis = _euler(entries["axis"][3], _numbers(entries["axis"][:3]), degrees)
    norm = float(np.linalg.norm(direction))
    length = float(_numbers(entries["length"][:1])[0])
    return entries["name"][0], Bone(direction / norm if norm > 0 else direction, length, axis, angles)


def _root(lines: list[list[str]], degrees: bool) -> Bone:
    entries = {words[0].lower(): words[1:] for words in lines}
    order = tuple(angle.lower() for angle in entries["order"])
    if not order or not all(re.fullmatch(r"[rt][xyz]", angle) for angle in order):
        raise ValueError(order)
    turn = _numbers(entries.get("orientation", ["0", "0", "0"])[:3])
    return Bone(np.zeros(3), 0.0, _euler(entries["axis"][0], turn, degrees), order)


def _numbers(words: list[str]) -> np.ndarray:
    values = np.array([float(word) for word in words])
    if np.isnan(plausible(values)).any():
        raise ValueError(words)
    return values


def _euler(order: str, angles: np.ndarray, degrees: bool) -> np.ndarray:
    """Quaternion (4,) of rotations by three angles about fixed axes, in an order such as XYZ, the first named applied first."""
    if sorted(order.lower()) != ["x", "y", "z"] or len(angles) != 3:
        raise ValueError(order)
    total = np.array([0.0, 0.0, 0.0, 1.0])
    for letter, angle in zip(order.lower(), angles, strict=True):
        total = multiply(about_axis(np.eye(3)["xyz".index(letter)], np.radians(angle) if degrees else angle), total)
    return total


def _parents(lines: list[list[str]]) -> dict[str, str]:
    parents: dict[str, str] = {}
    for words in lines:
        if words[0].lower() in ("begin", "end"):
            continue
        for child in words[1:]:
            # A child of a bone that is not yet there, or one that is named twice, would make a loop.
            if child in parents or child == ROOT or (words[0] != ROOT and words[0] not in parents):
                raise ValueError(child)
            parents[child] = words[0]
    return parents


# --- .amc ---


def _frames(path: Path, skeleton: Skeleton) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Values (T, angles) of every bone that has any, and a mask (T,) of the frames that lack some."""
    widths = {name: len(bone.angles) for name, bone in skeleton.bones.items() if bone.angles}
    rows: dict[str, list[list[str]]] = {name: [] for name in widths}
    numbers: list[int] = []
    count = 0
    degrees = skeleton.degrees
    for line in _text(path, MAX_BYTES, "AMC file").splitlines():
        words = line.split("#")[0].split()
        if not words or words[0].startswith(":"):
            degrees = {":degrees": True, ":radians": False}.get(words[0].lower() if words else "", degrees)
        elif len(words) == 1 and words[0].isdigit():
            count += 1
            numbers.append(int(words[0]))
        elif count and len(words) - 1 == widths.get(words[0]) and len(rows[words[0]]) == count - 1:
            rows[words[0]].append(words[1:])
        else:
            raise InputError(
                f"{path}: cannot read {shown(line)} in frame {count}; it does not fit the skeleton, or is damaged"
            )
        if count > MAX_FRAMES:
            raise InputError(f"{path} has more than {MAX_FRAMES} frames; cut the motion into shorter files")
    short = [name for name, row in rows.items() if len(row) != count]
    if count < 2 or short:
        raise InputError(f"{path} is cut short or no AMC file: {count} frames, {shown(short)} not in all of them")
    try:
        values = {name: np.array(row, dtype=float) for name, row in rows.items()}
    except ValueError:
        raise InputError(f"{path} must hold numbers only behind the names of bones; it is damaged") from None
    table = np.concatenate(list(values.values()), axis=1)
    # The root's columns come first.
    root_columns = [column for column, angle in enumerate(skeleton.bones[ROOT].angles) if angle.startswith("t")]
    table, lost = filled(plausible(_numbered(table, np.array(numbers))), f"{path}", root_columns)
    stops = np.cumsum([part.shape[1] for part in values.values()])
    values = dict(zip(values, np.split(table, stops[:-1], axis=1), strict=True))
    for name, value in values.items():
        turns = [column for column, angle in enumerate(skeleton.bones[name].angles) if angle.startswith("r")]
        value[:, turns] = np.radians(value[:, turns]) if degrees else value[:, turns]
    return values, lost


def _numbered(table: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Rows (T, C) at their frames' numbers, NaN for skipped ones; unchanged if the numbers do not ascend or skip too many."""
    place = numbers - numbers[0]
    if not (np.diff(numbers) > 0).all() or place[-1] >= min(2 * len(table), MAX_FRAMES):
        return table
    spaced = np.full((place[-1] + 1, table.shape[1]), np.nan)
    spaced[place] = table
    return spaced


def _forward(
    skeleton: Skeleton, values: dict[str, np.ndarray]
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], np.ndarray]:
    """Global rotations (T, 4) and ends (T, 3) of all bones, and the root's track (T, 3), in the file's unit."""
    root = skeleton.bones[ROOT]
    frames = len(values[ROOT])
    place = np.zeros((frames, 3))
    for column, angle in enumerate(root.angles):
        if angle.startswith("t"):
            place[:, "xyz".index(angle[1])] = values[ROOT][:, column]
    turned = {ROOT: _turned(root, values.get(ROOT), frames)}
    ends = {ROOT: place}
    for name, parent in skeleton.parents.items():
        bone = skeleton.bones[name]
        turned[name] = multiply(turned[parent], _turned(bone, values.get(name), frames))
        ends[name] = ends[parent] + rotate(turned[name], bone.length * bone.direction)
    return turned, ends, place


def _turned(bone: Bone, values: np.ndarray | None, frames: int) -> np.ndarray:
    """Rotations C M C^-1 (T, 4) of a bone against its parent."""
    moved = np.tile([0.0, 0.0, 0.0, 1.0], (frames, 1))
    for column, angle in enumerate(bone.angles):
        if angle.startswith("r") and values is not None:
            moved = multiply(about_axis(np.eye(3)["xyz".index(angle[1])], values[:, column]), moved)
    return multiply(multiply(bone.axis, moved), conjugate(bone.axis))
