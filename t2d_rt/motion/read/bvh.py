"""Read BVH text as a raw skeleton in time, in the file's own units and axes.

Grammar: HIERARCHY with ROOT/JOINT/End Site blocks (OFFSET, CHANNELS), then MOTION with Frames, Frame Time and one row
of channel values per frame (Biovision; Meredith and Maddock 2001). Joint names may hold spaces, any joint may have
position channels, and rotations apply in the order in which the channels are listed.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import gunzip, read_bytes, size
from t2d_rt.motion.interpolate import composed
from t2d_rt.motion.quaternions import conjugate, multiply, rotate
from t2d_rt.motion.read.clock import tidy
from t2d_rt.motion.read.samples import filled, plausible

MAX_BYTES = 150_000_000
"""Largest text that is read: MAX_VALUES with 15 characters each."""

MAX_HEAD_BYTES = 10_000_000
"""Largest HIERARCHY: a chain of MAX_JOINTS, each indented by one tab more than the one above."""

MAX_JOINTS = 1000
"""Joints and end sites; a body with all fingers and a face has 150."""

MAX_FRAMES = 100_000
"""Most frames, 28 minutes at 60 Hz; with all copies that the reader makes a frame takes up to 10 kB and, smoothed, 0.1 ms."""

MAX_VALUES = 10_000_000
"""Most values: those of MAX_FRAMES frames of 100 channels."""

BLOCK_BYTES = 1_000_000
"""Bytes of the MOTION's text that are split into words at a time: as Python objects, words take five times as much memory."""
BLOCK_FRAMES = 1024
"""Frames whose kinematics are computed at a time, so that the arrays stay in the processor's cache."""

CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "xyz")

MOTION = re.compile(rb"(?i)(?:\A|[\r\n])[ \t]*MOTION[ \t]*(?=[\r\n]|\Z)")
WHITESPACE = re.compile(rb"\s")
LINE = re.compile(rb"\s*([^\r\n]{0,200})")
TOKEN = re.compile(rb"[{}]|[^{}\r\n]+")
"""A brace of the HIERARCHY, or a line up to the next brace. It matches bytes, because in text U+0085 would be a line end too."""


@dataclass(frozen=True, slots=True)
class RawSkeleton:
    """A BVH file as it stands: joints and end sites (named `<parent>:end`), parents before children, of all ROOTs in turn."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: np.ndarray
    """Offsets from the parents in the file's unit, (N, 3)."""
    channels: tuple[tuple[str, ...], ...]
    """Channel names of each joint in lower case."""
    values: np.ndarray
    """Channel values (T, C), with lengths in the file's unit and angles in degrees."""
    rate_hz: float
    lost: np.ndarray
    """Mask (T,) of frames that hold no pose; their values repeat those before."""


def read_bvh(path: str | Path) -> RawSkeleton:
    """Read a .bvh or .bvh.gz file (the suffix in any case); raises an InputError if it is damaged or too large."""
    text = _read_text(path)
    names, parents, offsets, channels = _hierarchy(text, path)
    values, rate_hz = _motion(text, sum(map(len, channels)), path)
    place = [column for column, channel in enumerate(channels[0]) if channel.endswith("position")]
    values, lost = filled(values, f"{path}: MOTION", place)
    return RawSkeleton(tuple(names), tuple(parents), np.array(offsets), tuple(channels), values, rate_hz, lost)


def forward_kinematics(
    raw: RawSkeleton, offsets: np.ndarray | None = None, only: Collection[int] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T, N, 3) in the file's unit and global orientations (T, N, 4); `offsets` (N, 3) replace the file's.

    only: indices of the joints whose tracks are wanted; others may be left undefined, as fingers and faces take most of the time.
    """
    offsets = raw.offsets if offsets is None else offsets
    frames, count = len(raw.values), len(raw.names)
    joints = sorted(range(count) if only is None else _with_ancestors(only, raw.parents))
    parents = [joints.index(raw.parents[joint]) if raw.parents[joint] >= 0 else -1 for joint in joints]
    channels, firsts = [raw.channels[joint] for joint in joints], np.cumsum([0, *map(len, raw.channels)])[joints]
    shifts = [
        _translation(kinds, raw.values[:, first : first + len(kinds)], offsets[joint])
        for joint, kinds, first in zip(joints, channels, firsts, strict=True)
    ]
    positions = np.empty((count, frames, 3))
    rotations = np.empty((count, frames, 4))
    for start in range(0, frames, BLOCK_FRAMES):
        block = slice(start, start + BLOCK_FRAMES)
        moved = np.stack([shift[block].T for shift in shifts], axis=1)
        placed, turned = composed(moved, _rotations(channels, firsts, raw.values[block]), parents, normalised=True)
        positions[joints, block] = placed.transpose(1, 2, 0)
        rotations[joints, block] = turned.transpose(1, 2, 0)
    return positions.swapaxes(0, 1), rotations.swapaxes(0, 1)


def _with_ancestors(joints: Collection[int], parents: tuple[int, ...]) -> set[int]:
    reached: set[int] = set()
    for joint in joints:
        while joint >= 0 and joint not in reached:
            reached.add(joint)
            joint = parents[joint]
    return reached


def _rotations(channels: list[tuple[str, ...]], firsts: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Rotations (4, N, T) of joints against their parents, components first: those about the axes of their channels, in turn;
    `firsts` (N,) are the first columns of each joint in the values (T, C)."""
    rotations = np.zeros((4, len(channels), len(values)))
    rotations[3] = 1.0
    for kinds in set(channels):
        joints = np.array([joint for joint, channel in enumerate(channels) if channel == kinds])
        turned = rotations[:, joints]
        for place in (place for place, kind in enumerate(kinds) if kind.endswith("rotation")):
            half = 0.5 * np.radians(values[:, firsts[joints] + place].T)
            sine, cosine, k = np.sin(half), np.cos(half), "xyz".index(kinds[place][0])
            i, j = (k + 1) % 3, (k + 2) % 3
            # The product of quaternions, of which the second has components k and w alone.
            turned[[i, j, k, 3]] = (
                cosine * turned[i] + turned[j] * sine,
                cosine * turned[j] - turned[i] * sine,
                turned[3] * sine + cosine * turned[k],
                turned[3] * cosine - turned[k] * sine,
            )
        rotations[:, joints] = turned
    return rotations


def _translation(channels: tuple[str, ...], values: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Shift from the parent (T, 3): the offset and, where a joint has them, its position channels."""
    moved = np.broadcast_to(offset, (len(values), 3))
    placed = ["xyz".index(channel[0]) for channel in channels if channel.endswith("position")]
    if placed:
        moved = moved.copy()
        positions = values[:, [i for i, channel in enumerate(channels) if channel.endswith("position")]]
        # By the format positions add to the offset, but many writers give the whole offset again. The frame that comes nearest to
        # 0 or to the offset tells them apart, even if somebody walks far: shifts start near 0, whole offsets near the offset.
        from_offset, from_zero = (np.linalg.norm(positions - start, axis=-1).min() for start in (offset[placed], 0.0))
        repeats_offset = from_offset <= from_zero
        moved[:, placed] = positions if repeats_offset else positions + offset[placed]
    return moved


def _read_text(path: str | Path) -> bytes:
    name = str(path).lower()
    if not name.endswith((".bvh", ".bvh.gz")):
        raise InputError(
            f"cannot read {shown(str(path))}: motions come as .bvh or .bvh.gz; convert the file to BVH first"
        )
    data = read_bytes(path, limit=MAX_BYTES, noun="BVH file")
    if name.endswith(".gz"):
        data = gunzip(data, path, limit=MAX_BYTES)
    if not data or data.isspace():
        raise InputError(f"{path} is empty; expected BVH text that starts with HIERARCHY")
    data = data.removeprefix(b"\xef\xbb\xbf")
    if b"\0" in data or LINE.match(data)[1][:9].upper() != b"HIERARCHY":  # type: ignore[index]
        raise InputError(f"{path} is not a BVH file: it must be text that starts with HIERARCHY")
    return data


def _numbers(words: list[bytes], what: str, path: str | Path, *, lacking: bool = False) -> np.ndarray:
    """The numbers that words stand for; absurd ones become NaN where some may be `lacking`, and else raise an InputError."""
    try:
        numbers = np.array(words, dtype=float)
    except ValueError:
        raise InputError(f"{path}: {what} must hold numbers only; the file is damaged") from None
    if lacking:
        return plausible(numbers)
    if np.isnan(plausible(numbers)).any():
        raise InputError(f"{path}: {what} holds NaN, infinite or absurd values; repair or re-export the file")
    return numbers


# --- HIERARCHY ---


def _tokens(text: bytes, path: str | Path) -> Iterator[bytes]:
    """Braces and lines of the HIERARCHY, without its first line and blank ones."""
    motion = MOTION.search(text, 0, MAX_HEAD_BYTES)
    if motion is None:
        limit = f" within its first {size(MAX_HEAD_BYTES)}" if len(text) > MAX_HEAD_BYTES else ""
        raise InputError(f"{path} has no MOTION section{limit}; it is cut short or holds a skeleton only")
    tokens = (match[0].strip() for match in TOKEN.finditer(text, 0, motion.start()))
    first = True
    for token in tokens:
        if token and not first:
            yield token
        first = first and not token


def _hierarchy(text: bytes, path: str | Path) -> tuple[list[str], list[int], list[np.ndarray], list[tuple[str, ...]]]:
    names: list[str] = []
    parents: list[int] = []
    offsets: dict[int, np.ndarray] = {}
    channels: dict[int, tuple[str, ...]] = {}
    stack: list[int] = []
    opens = False  # a joint is named and its brace is yet to come
    body_names: set[str] = set()
    for token in _tokens(text, path):
        word, _, rest = token.replace(b"\t", b" ").partition(b" ")
        keyword, last = word.upper(), len(names) - 1
        if keyword in (b"ROOT", b"JOINT", b"END"):
            if opens or (keyword == b"ROOT") != (not stack):
                raise InputError(f"{path}: expected a ROOT that holds every joint, found {_shown(token)} out of place")
            if keyword == b"ROOT":
                body_names = set()  # names differ within one body; another may have the same
            name = f"{names[stack[-1]]}:end" if keyword == b"END" else _text(rest)
            if not name or name in body_names:
                raise InputError(
                    f"{path}: joint name {shown(name)} is empty or occurs twice; every joint needs its own name"
                )
            if len(names) == MAX_JOINTS:
                raise InputError(
                    f"{path}: a skeleton may have {MAX_JOINTS} joints and ends, this one has more; remove some"
                )
            parents.append(stack[-1] if stack else -1)
            names.append(name)
            body_names.add(name)
            opens = True
        elif keyword == b"{" and opens:
            stack.append(last)
            opens = False
        elif keyword == b"}" and stack and not opens:
            stack.pop()
        elif keyword == b"OFFSET" and stack and stack[-1] == last and last not in offsets:
            offsets[last] = _offset(rest, names[-1], path)
        elif keyword == b"CHANNELS" and stack and stack[-1] == last and last not in channels:
            channels[last] = _channels(rest, names[-1], path)
        else:
            raise InputError(f"{path}: cannot understand {_shown(token)} in the HIERARCHY; the file is damaged")
    if stack or not names:
        raise InputError(f"{path}: the HIERARCHY is cut short (missing braces or no ROOT)")
    for joint, name in enumerate(names):
        if joint not in offsets:
            raise InputError(f"{path}: joint {shown(name)} has no OFFSET; the file is damaged")
    return names, parents, [offsets[j] for j in range(len(names))], [channels.get(j, ()) for j in range(len(names))]


def _text(words: bytes) -> str:
    """A joint's name: UTF-8, or else Latin-1, which never fails."""
    try:
        return words.decode("utf-8").strip()
    except UnicodeDecodeError:
        return words.decode("latin-1").strip()


def _shown(token: bytes) -> str:
    return shown(_text(token[:100]))


def _offset(rest: bytes, name: str, path: str | Path) -> np.ndarray:
    offset = _numbers(rest.split(maxsplit=4), f"the OFFSET of {shown(name)}", path)
    if offset.shape != (3,):
        raise InputError(f"{path}: the OFFSET of {shown(name)} must be 3 numbers, got {_shown(rest)}")
    return offset


def _channels(rest: bytes, name: str, path: str | Path) -> tuple[str, ...]:
    count, *kinds = _text(rest[:1000]).lower().split() or [""]
    if count != str(len(kinds)) or any(kind not in CHANNELS for kind in kinds) or len(set(kinds)) != len(kinds):
        raise InputError(
            f"{path}: CHANNELS of {shown(name)} must be a count and that many of {', '.join(CHANNELS)}; "
            f"got {_shown(rest)}"
        )
    return tuple(kinds)


# --- MOTION ---


def _motion(text: bytes, channel_count: int, path: str | Path) -> tuple[np.ndarray, float]:
    start = MOTION.search(text, 0, MAX_HEAD_BYTES).end()  # type: ignore[union-attr]
    header: list[bytes] = []
    for expected_label in (b"frames", b"frame time"):
        line = LINE.match(text, start)
        assert line is not None  # the pattern matches an empty text too
        label, _, value = line[1].partition(b":")
        if b" ".join(label.lower().split()) != expected_label:
            raise InputError(
                f"{path}: MOTION must begin with 'Frames:' and 'Frame Time:'; the file is cut short or damaged"
            )
        header.append(value)
        start = line.end()
    frames = _numbers(header[0].split(), "Frames", path)
    step_s = _numbers(header[1].split(), "Frame Time", path)
    if frames.size != 1 or frames[0] != round(frames[0]) or frames[0] < 2:
        raise InputError(f"{path}: a motion needs at least 2 frames, got {shown('Frames: ' + _text(header[0]))}")
    if step_s.size != 1 or not 1e-4 <= step_s[0] <= 1.0:
        raise InputError(f"{path}: Frame Time must lie between 0.0001 and 1 s, got {_shown(header[1])}")
    values = _values(text, start, int(frames[0]), channel_count, path)
    return values, tidy(1.0 / float(step_s[0]), 2e-4)


def _values(text: bytes, start: int, frames: int, channel_count: int, path: str | Path) -> np.ndarray:
    """Values (frames, channels) of the text from `start` on, however its lines are broken."""
    expected = frames * channel_count
    if frames > MAX_FRAMES or expected > MAX_VALUES:
        raise InputError(
            f"{path}: {frames} frames of {channel_count} channels are too many, {MAX_FRAMES} frames and {MAX_VALUES} values "
            "are read at most; cut the motion into shorter files"
        )
    # A value takes two characters or more: a small file that promises many values gets no memory for them.
    values = np.empty(expected if 2 * expected <= len(text) else 0)
    count, more = 0, ""
    for words, whole in _blocks(text, start, path):
        block = _numbers(words, "MOTION", path, lacking=True)
        values[count : count + len(block)] = block[: max(0, len(values) - count)]
        count += len(block)
        if count > expected:
            more = "" if whole else " or more"
            break
    if channel_count == 0 or count != expected:
        if channel_count and count % channel_count == 0 and count < expected:
            raise InputError(
                f"{path}: 'Frames: {frames}' but {count // channel_count} rows of values; cut short, or correct the number"
            )
        raise InputError(
            f"{path}: expected {frames} frames of {channel_count} channels = {expected} values, "
            f"got {count}{more}; the file is cut short or damaged"
        )
    return values.reshape(frames, channel_count)


def _blocks(text: bytes, start: int, path: str | Path) -> Iterator[tuple[list[bytes], bool]]:
    """Words from `start` on, those of about BLOCK_BYTES at a time, and whether these are the last."""
    while start < len(text):
        gap = WHITESPACE.search(text, start + BLOCK_BYTES)
        end = gap.start() if gap else len(text)
        if end > start + 2 * BLOCK_BYTES:
            raise InputError(f"{path}: MOTION must hold numbers only; the file is damaged")
        yield text[start:end].split(), end == len(text)
        start = end


POSED = ("xposition", "yposition", "zposition", "zrotation", "yrotation", "xrotation")


def of_poses(
    names: tuple[str, ...], parents: tuple[int, ...], positions: np.ndarray, rotations: np.ndarray, rate_hz: float
) -> RawSkeleton:
    """The skeleton of global positions (T, N, 3) and orientations (T, N, 4), parents before children: `forward_kinematics` gives
    them back."""
    values = np.zeros((len(positions), len(names), len(POSED)))
    offsets = np.zeros((len(names), 3))
    for joint, parent in enumerate(parents):
        shift, turn = positions[:, joint], rotations[:, joint]
        if parent >= 0:
            back = conjugate(rotations[:, parent])
            shift, turn = rotate(back, shift - positions[:, parent]), multiply(back, turn)
        along, left, up = (rotate(turn, axis).T for axis in np.eye(3))  # where x, y and z are turned to
        yaw = np.arctan2(along[1], along[0])
        pitch = np.arctan2(-along[2], np.hypot(along[0], along[1]))
        roll = np.arctan2(np.sin(yaw) * up[0] - np.cos(yaw) * up[1], np.cos(yaw) * left[1] - np.sin(yaw) * left[0])
        values[:, joint, :3], values[:, joint, 3:] = shift, np.degrees(np.stack([yaw, pitch, roll], axis=-1))
        offsets[joint] = shift[0]
    lost = np.zeros(len(values), dtype=bool)
    flat = values.reshape(len(values), -1)
    return RawSkeleton(names, parents, offsets, (POSED,) * len(names), flat, rate_hz, lost)
