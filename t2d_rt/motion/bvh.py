"""BVH text -> a raw skeleton in time, in the file's own units and axes.

Grammar: HIERARCHY with ROOT/JOINT/End Site blocks (OFFSET, CHANNELS), then MOTION with Frames, Frame Time and one row
of channel values per frame (Biovision; Meredith and Maddock 2001). Joint names may hold spaces, any joint may have
position channels, and rotations apply in the order in which the channels are listed.
"""

from __future__ import annotations

import re
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from t2d_rt.errors import InputError
from t2d_rt.motion.quaternions import about_axis, multiply, normalise, rotate

MAX_BYTES = 500_000_000
"""Largest text that is read (ten hours of motion); stops a small .gz from filling the memory."""

MAX_FRAME_RATE_HZ = 10_000.0

LARGEST_NUMBER = 1e9
"""No length or angle of a person comes near, in any unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RawSkeleton:
    """A BVH file as it stands: joints and end sites (named `<parent>:end`), parents before children."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: np.ndarray
    """Offsets from the parents in the file's unit, (N, 3)."""
    channels: tuple[tuple[str, ...], ...]
    """Channel names of each joint, lower case."""
    values: np.ndarray
    """Channel values, (T, C), lengths in the file's unit, angles in degrees."""
    rate_hz: float


def read_bvh(path: str | Path) -> RawSkeleton:
    """Read a .bvh or .bvh.gz file (the suffix in any case)."""
    path = Path(path)
    text = _read_text(path)
    head, motion = _split(text, path)
    names, parents, offsets, channels = _hierarchy(head, path)
    values, rate_hz = _motion(motion, sum(map(len, channels)), path)
    return RawSkeleton(
        names=tuple(names), parents=tuple(parents), offsets=np.array(offsets), channels=tuple(channels),
        values=values, rate_hz=rate_hz,
    )  # fmt: skip


def forward_kinematics(raw: RawSkeleton, offsets: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T, N, 3) in the file's unit and global orientations (T, N, 4); `offsets` (N, 3) replace the file's."""
    offsets = raw.offsets if offsets is None else offsets
    frames, count = len(raw.values), len(raw.names)
    positions = np.empty((frames, count, 3))
    rotations = np.empty((frames, count, 4))
    column = 0
    for joint, (parent, channels) in enumerate(zip(raw.parents, raw.channels, strict=True)):
        values = raw.values[:, column : column + len(channels)]
        column += len(channels)
        shift = _translation(channels, values, offsets[joint])
        turn = _rotation(channels, values)
        if parent < 0:
            positions[:, joint], rotations[:, joint] = shift, turn
        else:
            positions[:, joint] = positions[:, parent] + rotate(rotations[:, parent], shift)
            rotations[:, joint] = normalise(multiply(rotations[:, parent], turn))
    return positions, rotations


def _rotation(channels: tuple[str, ...], values: np.ndarray) -> np.ndarray:
    total = np.tile([0.0, 0.0, 0.0, 1.0], (len(values), 1))
    for channel, column in zip(channels, values.T, strict=True):
        if channel.endswith("rotation"):
            total = multiply(total, about_axis(np.eye(3)["xyz".index(channel[0])], np.radians(column)))
    return total


def _translation(channels: tuple[str, ...], values: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Shift from the parent (T, 3): the offset and, where a joint has them, its position channels."""
    moved = np.tile(offset, (len(values), 1))
    placed = ["xyz".index(channel[0]) for channel in channels if channel.endswith("position")]
    if placed:
        given = values[:, [i for i, channel in enumerate(channels) if channel.endswith("position")]]
        typical = np.median(given, axis=0)
        # By the format positions add to the offset, but many writers give the whole offset again.
        repeats_offset = np.linalg.norm(typical - offset[placed]) <= np.linalg.norm(typical)
        moved[:, placed] = given if repeats_offset else given + offset[placed]
    return moved


def _read_text(path: Path) -> str:
    suffixes = "".join(path.suffixes[-2:]).lower()
    if not (path.suffix.lower() == ".bvh" or suffixes.endswith(".bvh.gz")):
        raise InputError(f"cannot read {path.name}: motions come as .bvh or .bvh.gz; convert the file to BVH first")
    if "\0" in str(path):
        raise InputError(f"cannot read {str(path)!r}: this is not a valid file name")
    if path.is_dir():
        raise InputError(f"{path} is a directory; give the path of one BVH file")
    try:
        data = path.read_bytes()
        if path.suffix.lower() == ".gz":
            data = _gunzip(data, path)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}; check the path and its permissions") from None
    if not data.strip():
        raise InputError(f"{path} is empty; expected BVH text that starts with HIERARCHY")
    # Latin-1 never fails and the format is ASCII but for joint names, which are only compared.
    return data.removeprefix(b"\xef\xbb\xbf").decode("latin-1")


def _gunzip(data: bytes, path: Path) -> bytes:
    unpacker = zlib.decompressobj(wbits=31)
    try:
        text = unpacker.decompress(data, MAX_BYTES)
    except zlib.error:
        raise InputError(f"{path} is not a valid gzip file; unpack it by hand or fetch it again") from None
    if not unpacker.eof:
        raise InputError(f"{path} is cut short or unpacks to more than {MAX_BYTES // 10**6} MB; fetch or trim it again")
    return text


def _split(text: str, path: Path) -> tuple[list[str], list[str]]:
    """Lines of the two sections, without blank ones; braces stand on lines of their own."""
    if "\0" in text or not text.lstrip()[:9].upper() == "HIERARCHY":
        raise InputError(f"{path} is not a BVH file: it must be text that starts with HIERARCHY")
    parts = re.split(r"(?im)^[ \t]*MOTION[ \t]*\r?$", text, maxsplit=1)
    if len(parts) < 2:
        raise InputError(f"{path} has no MOTION section; it is cut short or holds a skeleton only")
    head = re.sub(r"([{}])", r"\n\1\n", parts[0])
    lines = [[line.strip() for line in part.splitlines() if line.strip()] for part in (head, parts[1])]
    return lines[0][1:], lines[1]


def _numbers(words: list[str], what: str, path: Path) -> np.ndarray:
    try:
        numbers = np.array(words, dtype=float)
    except ValueError:
        raise InputError(f"{path}: {what} must hold numbers only; the file is damaged") from None
    if not (np.abs(numbers) < LARGEST_NUMBER).all():
        raise InputError(f"{path}: {what} holds NaN, infinite or absurd values; repair or re-export the file")
    return numbers


def _hierarchy(lines: list[str], path: Path) -> tuple[list[str], list[int], list[np.ndarray], list[tuple[str, ...]]]:
    names: list[str] = []
    parents: list[int] = []
    offsets: list[np.ndarray] = []
    channels: list[tuple[str, ...]] = []
    stack: list[int] = []
    for line in lines:
        keyword, _, rest = line.replace("\t", " ").partition(" ")
        keyword, rest = keyword.upper(), rest.strip()
        if keyword in ("ROOT", "JOINT", "END"):
            if (keyword == "ROOT") != (not names) or (names and not stack):
                raise InputError(f"{path}: expected one ROOT that holds every joint, found {line[:60]!r} out of place")
            name = f"{names[stack[-1]]}:end" if keyword == "END" else rest
            if not name or name in names:
                raise InputError(
                    f"{path}: joint name {name!r} is empty or occurs twice; every joint needs its own name"
                )
            parents.append(stack[-1] if stack else -1)
            names.append(name)
            offsets.append(np.full(3, np.nan))
            channels.append(())
        elif keyword == "{" and names and len(names) - 1 not in stack:
            stack.append(len(names) - 1)
        elif keyword == "}" and stack:
            stack.pop()
        elif keyword == "OFFSET" and stack and stack[-1] == len(names) - 1:
            offsets[-1] = _offset(rest, names[-1], path)
        elif keyword == "CHANNELS" and stack and stack[-1] == len(names) - 1:
            channels[-1] = _channels(rest, names[-1], path)
        else:
            raise InputError(f"{path}: cannot understand {line[:60]!r} in the HIERARCHY; the file is damaged")
    if stack or not names:
        raise InputError(f"{path}: the HIERARCHY is cut short (missing braces or no ROOT)")
    for name, offset in zip(names, offsets, strict=True):
        if np.isnan(offset).any():
            raise InputError(f"{path}: joint {name!r} has no OFFSET; the file is damaged")
    return names, parents, offsets, channels


def _offset(rest: str, name: str, path: Path) -> np.ndarray:
    offset = _numbers(rest.split(), f"the OFFSET of {name!r}", path)
    if offset.shape != (3,):
        raise InputError(f"{path}: the OFFSET of {name!r} must be 3 numbers, got {len(offset)}")
    return offset


def _channels(rest: str, name: str, path: Path) -> tuple[str, ...]:
    count, *kinds = rest.lower().split() or [""]
    known = [f"{axis}{kind}" for kind in ("position", "rotation") for axis in "xyz"]
    if count != str(len(kinds)) or any(kind not in known for kind in kinds) or len(set(kinds)) != len(kinds):
        raise InputError(
            f"{path}: CHANNELS of {name!r} must be a count and that many of {', '.join(known)}; got {rest!r}"
        )
    return tuple(kinds)


def _motion(lines: list[str], channel_count: int, path: Path) -> tuple[np.ndarray, float]:
    header = [line.partition(":") for line in lines[:2]]
    labels = [" ".join(label.lower().split()) for label, _, _ in header]
    if labels != ["frames", "frame time"]:
        raise InputError(
            f"{path}: MOTION must begin with 'Frames:' and 'Frame Time:'; the file is cut short or damaged"
        )
    frames = _numbers(header[0][2].split(), "Frames", path)
    step_s = _numbers(header[1][2].split(), "Frame Time", path)
    if frames.size != 1 or frames[0] != round(frames[0]) or frames[0] < 2:
        raise InputError(f"{path}: a motion needs at least 2 frames, got 'Frames: {header[0][2].strip()}'")
    if step_s.size != 1 or not 1.0 / MAX_FRAME_RATE_HZ <= step_s[0] <= 1.0:
        raise InputError(f"{path}: Frame Time must lie between 0.0001 and 1 s, got {header[1][2].strip()!r}")
    rows = [line.split() for line in lines[2:]]
    if any(len(row) != channel_count for row in rows):
        rows = _reflow(rows, int(frames[0]), channel_count, path)
    if len(rows) != frames[0]:
        raise InputError(
            f"{path}: 'Frames: {int(frames[0])}' but {len(rows)} rows of values; cut short, or correct the number"
        )
    values = _numbers([word for row in rows for word in row], "MOTION", path).reshape(len(rows), channel_count)
    return values, _tidy_rate(1.0 / float(step_s[0]))


def _reflow(rows: list[list[str]], frames: int, channel_count: int, path: Path) -> list[list[str]]:
    """Rows broken over several lines, put together again; anything else is damage."""
    words = [word for row in rows for word in row]
    if channel_count == 0 or len(words) != frames * channel_count:
        raise InputError(
            f"{path}: expected {frames} frames of {channel_count} channels = {frames * channel_count} values, "
            f"got {len(words)}; the file is cut short or damaged"
        )
    return [words[start : start + channel_count] for start in range(0, len(words), channel_count)]


def _tidy_rate(rate_hz: float) -> float:
    """Files round 1/120 s to .0083333: a rate within 0.02 % of a whole number is that number."""
    return float(round(rate_hz)) if abs(rate_hz - round(rate_hz)) < 2e-4 * rate_hz else rate_hz
