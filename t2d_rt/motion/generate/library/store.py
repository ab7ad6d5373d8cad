"""The clips that ship: rotations and root of a skeleton as small integers, and an index of the segments in them.

Each clip is an array of bytes in one .npz file and is decoded when it is first used. Per frame it holds 23 local quaternions and
the root, as second differences in time of integers (`QUATERNION_STEPS` a unit, `ROOT_STEPS` a metre), low and high bytes apart.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes
from t2d_rt.motion import quaternions
from t2d_rt.motion.contacts import grown
from t2d_rt.motion.generate.chain import Piece
from t2d_rt.motion.kinematics import NAMES, Poses, Skeleton
from t2d_rt.types.motion import OPTIONAL_JOINTS

FOLDER = Path(__file__).resolve().parent / "data"

RATE_HZ = 60.0
"""Frame rate of all clips."""

QUATERNION_STEPS, ROOT_STEPS = 30_000, 20_000

KEPT = [number for number, name in enumerate(NAMES) if name not in OPTIONAL_JOINTS]
"""Joints whose rotations are stored; ends turn with their parents."""

MOST_BYTES = 50_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """Frames of a clip that show one action."""

    name: str
    clip: str
    start: int
    """First frame in the clip."""
    stop: int
    """Frame after the last."""
    activity: str
    """One of the classes of the paper."""
    action: str
    kind: str = ""
    """Kind of the action: steady, start, stop or turn of a walk; up, forward, hop or jacks of a jump."""
    manner: str = ""
    direction: str = ""
    """Direction of a description that it shows, if a user says one."""
    speed_mps: float = 0.0
    """Mean horizontal speed of the pelvis."""
    turn_deg: float = 0.0
    """Change of heading, left positive."""
    travel_deg: float = 0.0
    """Direction of travel from the heading, left positive; 180 is backward."""
    cadence_hz: float = 0.0
    """Steps per second of a walk or run."""
    stride_m: float = 0.0
    """Distance of two steps of a walk or run."""
    distance_m: float = 0.0
    """Level distance from the pelvis's first place to its last."""
    rise_m: float = 0.0
    """Height by which the pelvis rises above standing in a jump."""
    count: int = 0
    """Number of jumps."""

    @property
    def duration_s(self) -> float:
        """Time from the first to the last frame [s]."""
        return (self.stop - 1 - self.start) / RATE_HZ


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """The origin of a clip."""

    file: str
    licence: str
    sha256: str
    """Hash of the recorded file's content, unpacked."""
    subject: str
    """The recorded person, as far as known: clips of one subject join best."""


@dataclass(frozen=True, slots=True)
class Store:
    """The clips that ship, or those of another index of the same form."""

    segments: tuple[Segment, ...]
    sources: Mapping[str, Source]
    path: Path
    """The .npz file of clips."""
    own: Mapping[str, Path] = field(default_factory=dict)
    """Motion files of the user by the name of their clip."""

    def piece(self, segment: Segment) -> Piece:
        """A segment's poses and contacts; raises an InputError if the segment lies outside its clip."""
        if segment.clip in self.own:
            from t2d_rt.motion.generate.library.users import recorded

            poses, planted = recorded(self.own[segment.clip])
        else:
            poses, planted = clip(self.path, segment.clip)
        source = self.sources[segment.clip]
        note = f"clip {segment.name} of {source.file}, {segment.start / RATE_HZ:.2f} to {(segment.stop - 1) / RATE_HZ:.2f} s"
        if not 0 <= segment.start < segment.stop - 1 < len(poses):
            raise InputError(
                f"{segment.name} lies outside its clip; add it to the library again, or install t2d-rt again"
            )
        return Piece(poses=poses, planted=planted, notes=(note,)).part(segment.start, segment.stop)


@lru_cache(maxsize=1)
def shipped() -> Store:
    """The clips in the package."""
    return read_store(FOLDER / "index.json", FOLDER / "clips.npz")


def read_store(index: Path, clips: Path) -> Store:
    """An index and the clips that it names, which are read when they are used; raises an InputError if the index is damaged."""
    try:
        values = json.loads(read_bytes(index, limit=MOST_BYTES, noun="clip index"))
        segments = tuple(Segment(**_typed(Segment, entry)) for entry in values["segments"])
        sources = {str(name): Source(**_typed(Source, entry)) for name, entry in values["sources"].items()}
        unsourced = sorted({segment.clip for segment in segments} - sources.keys())
        if unsourced:
            raise ValueError(f"no source for clip {unsourced[0]}")
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"the clip index {index} is damaged ({_words(error)}); install t2d-rt again") from None
    return Store(segments=segments, sources=sources, path=clips)


@lru_cache(maxsize=64)
def clip(path: Path, name: str) -> tuple[Poses, np.ndarray]:
    """Poses of a clip and its contacts (T, 2, 2); raises an InputError if it cannot be read."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
            packed, skeleton = data[name], data[f"{name}.skeleton"]
        poses, planted = unpacked(packed, skeleton)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError) as error:
        raise InputError(f"clip {name} of {path} cannot be read ({_words(error)}); install t2d-rt again") from None
    return locked(poses, grown(poses, planted))


def locked(poses: Poses, planted: np.ndarray) -> tuple[Poses, np.ndarray]:
    """The same arrays, made read-only because all motions of a clip share them."""
    for array in (poses.root, poses.local, poses.skeleton.offsets, planted):
        array.setflags(write=False)
    return poses, planted


def packed(poses: Poses, planted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A clip as bytes and its skeleton as float32, the inverse of `unpacked` but for rounding; raises a ValueError for leaps."""
    count = len(poses)
    rotations = np.round(quaternions.continuous(poses.local[:, KEPT]) * QUATERNION_STEPS).reshape(count, -1)
    flags = planted.reshape(count, 4) @ np.array([1, 2, 4, 8])
    values = np.concatenate([rotations, np.round(poses.root * ROOT_STEPS), flags[:, None]], axis=1).astype(np.int64)
    second = np.diff(np.diff(values, axis=0, prepend=0), axis=0, prepend=0)
    if np.abs(second).max() > 32_767:
        raise ValueError("a clip begins farther than 3.2 m from its origin, or jumps")
    data = np.ascontiguousarray(second.T).astype("<i2").view(np.uint8).reshape(second.shape[1], count, 2)
    return np.ascontiguousarray(data.transpose(2, 0, 1)), poses.skeleton.offsets.astype(np.float32)


def unpacked(data: np.ndarray, skeleton: np.ndarray) -> tuple[Poses, np.ndarray]:
    """Poses and contacts from bytes that `packed` made; raises a ValueError for others."""
    columns = 4 * len(KEPT) + 4
    if data.dtype != np.uint8 or data.ndim != 3 or data.shape[:2] != (2, columns) or data.shape[2] < 2:
        raise ValueError(f"bytes of shape (2, {columns}, time) were expected, got {data.dtype} {data.shape}")
    if skeleton.shape != (len(NAMES), 3) or not np.isfinite(skeleton).all() or np.abs(skeleton).max() > 3:
        raise ValueError("its skeleton is none")
    second = np.ascontiguousarray(data.transpose(1, 2, 0)).view("<i2")[..., 0].T
    values = np.cumsum(np.cumsum(second, axis=0, dtype=np.int64), axis=0).astype(float)
    count = len(values)
    local = np.zeros((count, len(NAMES), 4))
    local[..., 3] = 1.0
    local[:, KEPT] = values[:, : 4 * len(KEPT)].reshape(count, -1, 4)
    sizes = np.linalg.norm(local[:, KEPT], axis=-1) / QUATERNION_STEPS
    if not (np.abs(sizes - 1) < 0.01).all():
        raise ValueError("its rotations are none")
    flags = values[:, -1].astype(int)
    planted = np.stack([(flags >> bit) & 1 for bit in range(4)], axis=1).astype(bool).reshape(count, 2, 2)
    offsets, root = skeleton.astype(float), values[:, -4:-1] / ROOT_STEPS
    local = quaternions.normalise(local)
    return Poses(skeleton=Skeleton(offsets=offsets), root=root, local=local, rate_hz=RATE_HZ), planted


def _typed(kind: type, values: Any) -> dict[str, Any]:
    """Fields of a segment or a source, each checked to be of its type."""
    kinds = {"str": str, "int": int, "float": (int, float)}
    field_types = {field.name: kinds[str(field.type)] for field in fields(kind)}
    for name, value in values.items():
        if name not in field_types or not isinstance(value, field_types[name]) or isinstance(value, bool):  # type: ignore[arg-type]
            raise ValueError(f"{name} has a wrong value")
    return dict(values)


def _words(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
