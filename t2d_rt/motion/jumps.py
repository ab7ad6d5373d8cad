"""Jumps: steps of joints that contradict those before and after. No person makes them; lost samples, cuts and swapped bodies do.

The deviation of a step is its distance from the segment between the step before and the one after: none in even movement and where
a foot or a falling hand stops within a frame, the whole jump where a joint stands elsewhere all at once. Limits: 127 recordings
before any smoothing, walks to backflips at 16 to 120 Hz: the middle of the trunk deviates by up to 4.4 cm at 60 Hz and 9 cm at
16 Hz, a single joint by 18 and 56 cm; those with known faults (`check/limits.json`) by 25 cm to 1.1 m at 60 Hz.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from t2d_rt.geometry.vectors import inner, norms

TRUNK = ("left_hip", "right_hip", "left_shoulder", "right_shoulder")

TRUNK_LIMIT = 0.08, 25.0
"""Deviation of the trunk's middle [m] that makes a jump: the first and the second [m/s^2] over the squared rate."""

JOINT_LIMIT = 0.2, 100.0
"""The same of a single joint."""

SWAPPED_M, SWAPPED = 0.12, 0.3
"""Deviation of a pair's step [m] from which left and right may be swapped, and the part of it that stays after an exchange."""

PAIRS = (("hip", "shoulder"), ("knee", "ankle"), ("elbow", "wrist"))
"""Pairs of joints that are swapped together."""

SPREAD, LONGEST, LONGEST_S = (1, 2, 3, 6, 12, 24), 3, 0.12
"""Frames over which a jump may be spread, by filters or by interpolation, up to so many or so long."""

LARGER = 1.5
"""How much larger a jump must be over more frames to be one that is spread over them."""

NOISE = 6.0
"""Medians of a track's own deviations that a jump must exceed beyond the limit: a camera's noise is none."""

TOLD = "the motion jumps: "
MOST = 200
"""Jumps that are looked at, the largest: of files that are nothing but jumps."""

SHOWN = 3


@dataclass(frozen=True, slots=True)
class Jump:
    """A step that contradicts its neighbours."""

    what: str
    frame: int
    """Frame from which it leaves."""
    frames: int
    """Over which it is spread."""
    time_s: float
    """Time of the frame that it reaches [s]."""
    by_m: float
    joints: tuple[str, ...]
    """Joints that jump; those of both sides where left and right are swapped."""

    def __str__(self) -> str:
        if self.by_m == 0.0:
            return f"{self.what} are swapped at {self.time_s:.2f} s"
        return f"{self.what} jumps by {self.by_m:.2f} m at {self.time_s:.2f} s"


def jumps(joints: np.ndarray, names: Sequence[str], rate_hz: float) -> list[Jump]:
    """Jumps of joints (T, J, 3) [m] in the order of time, each once: of the whole body, of single joints, or left for right."""
    column = {name: place for place, name in enumerate(names)}
    middle = joints[:, [column[name] for name in TRUNK]].mean(axis=1, keepdims=True)
    jump_list: list[Jump] = []
    for frames in SPREAD:
        if frames > max(LONGEST, LONGEST_S * rate_hz) or len(joints) < 4 * frames:
            break
        if not any(
            _may_deviate(points, frames, limit[0] + limit[1] * (frames / rate_hz) ** 2)
            for points, limit in ((middle, TRUNK_LIMIT), (joints, JOINT_LIMIT))
        ):
            continue
        body_m, joint_m = deviations(middle, frames), deviations(joints, frames)
        excess = _excess(joint_m, JOINT_LIMIT, rate_hz / frames)
        whole, joint = _excess(body_m, TRUNK_LIMIT, rate_hz / frames)[:, 0] > 0, excess.argmax(axis=1)
        for start in _peaks(np.where(whole, 10.0 * body_m[:, 0], 0.0) + np.maximum(excess.max(axis=1), 0.0), frames):
            frame, size = start + frames, body_m[start, 0] if whole[start] else joint_m[start, joint[start]]
            moved = tuple(names) if whole[start] else tuple(np.array(names)[excess[start] > 0])
            what = "the whole body" if whole[start] else names[int(joint[start])]
            _add(jump_list, Jump(what, frame, frames, (frame + frames) / rate_hz, float(size), moved))
    for jump in _swaps(joints, column, rate_hz):
        _add(jump_list, jump)
    return sorted(jump_list, key=attrgetter("frame"))


def told(jump_list: Sequence[Jump]) -> str:
    """The jumps in a few words, the largest by name."""
    largest = sorted(sorted(jump_list, key=attrgetter("by_m"), reverse=True)[:SHOWN], key=attrgetter("frame"))
    more = f" and {len(jump_list) - SHOWN} more" if len(jump_list) > SHOWN else ""
    return f"{TOLD}{', '.join(map(str, largest))}{more}"


def told_before(report: str) -> str:
    """The clause of a motion's report that tells of jumps; empty without."""
    return next((clause for clause in report.split("; ") if clause.startswith(TOLD)), "")


def deviations(joints: np.ndarray, frames: int = 1) -> np.ndarray:
    """Distances (T - 3 n, J) [m] of the steps over n frames from the segments between those before and after, joints (T, J, 3)."""
    step = joints[frames:] - joints[:-frames]
    before, here, after = step[: -2 * frames], step[frames:-frames], step[2 * frames :]
    along = after - before
    part = inner(here - before, along) / np.maximum(inner(along, along), 1e-18)
    return norms(here - before - np.clip(part, 0.0, 1.0)[..., None] * along)


def _may_deviate(joints: np.ndarray, frames: int, limit_m: float) -> bool:
    """Whether any deviation may exceed a limit: none is larger than what the step differs from the one before, which is found in a
    third of the time and is small in sound motions."""
    step = joints[frames:] - joints[:-frames]
    change = step[frames:-frames] - step[: -2 * frames]
    return bool(inner(change, change).max() > (1.0 - 1e-9) * limit_m**2)


def _excess(deviation: np.ndarray, limit: tuple[float, float], rate_hz: float) -> np.ndarray:
    return deviation - limit[0] - limit[1] / rate_hz**2 - NOISE * np.median(deviation, axis=0)


def _peaks(size: np.ndarray, frames: int) -> list[int]:
    """Places of the largest of neighbours that are above nothing."""
    places = np.flatnonzero(size > 0)
    if len(places) > MOST:
        places = np.sort(places[np.argsort(-size[places])[:MOST]])
    return [
        int(place)
        for place in places
        if size[place] == size[max(0, place - frames + 1) : place + frames].max()
        and (place == 0 or size[place - 1] != size[place])
    ]


def _add(jump_list: list[Jump], jump: Jump) -> None:
    """Adds a jump; of those that overlap, being the same seen over fewer or more frames, the larger stays."""
    overlapping = [
        other
        for other in jump_list
        if other.frame - jump.frames <= jump.frame <= other.frame + other.frames + jump.frames - 1
        and not (jump.frames == other.frames == 1 and jump.frame != other.frame)
    ]
    if all(jump.by_m > LARGER * other.by_m for other in overlapping):
        jump_list[:] = [other for other in jump_list if other not in overlapping]
        jump_list.append(jump)


def _swaps(joints: np.ndarray, column: dict[str, int], rate_hz: float) -> list[Jump]:
    """Steps in which left and right of two pairs of joints exchange their places."""
    if len(joints) < 4:
        return []
    swaps = []
    for pair in PAIRS:
        if not all(f"left_{joint}" in column for joint in pair):
            continue
        exchanged = np.ones(len(joints) - 3, dtype=bool)
        for joint in pair:
            both = joints[:, [column[f"left_{joint}"], column[f"right_{joint}"]]].reshape(len(joints), 1, 6)
            other = np.roll(both, 3, axis=-1)
            if not _may_deviate(both, 1, SWAPPED_M):
                exchanged[:] = False
                break
            # The step to the other side's place, and from there on along it.
            same = deviations(both)[:, 0]
            before, here, after = both[1:-2] - both[:-3], other[2:-1] - both[1:-2], other[3:] - other[2:-1]
            crossed = np.linalg.norm(here - 0.5 * (before + after), axis=-1)[:, 0]
            exchanged &= (same > SWAPPED_M) & (crossed < SWAPPED * same)
        names = tuple(f"{side}_{joint}" for joint in pair for side in ("left", "right"))
        swaps += [
            Jump(f"left and right {pair[0]} and {pair[1]}", int(at) + 1, 1, (at + 2) / rate_hz, 0.0, names)
            for at in np.flatnonzero(exchanged)[:MOST]
        ]
    return swaps
