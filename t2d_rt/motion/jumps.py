"""Find jumps in motions: steps of joints that contradict those before and after, caused by lost samples, cuts or swapped bodies.

The deviation of a step is its distance from the segment between the step before and the one after. It is 0 in even movement and
where a foot or a falling hand stops within a frame, and it is the whole jump where a joint is suddenly elsewhere. The limits come
from 127 recordings before any smoothing, from walks to backflips at 16 to 120 Hz: the middle of the trunk deviates by up to 4.4 cm
at 60 Hz and 9 cm at 16 Hz, a joint by up to 18 and 56 cm; with known faults (`check/limits.json`), by 25 cm to 1.1 m at 60 Hz.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from t2d_rt.geometry.vectors import inner, norms

TRUNK = ("left_hip", "right_hip", "left_shoulder", "right_shoulder")

TRUNK_LIMIT = 0.08, 25.0
"""A step is a jump if the trunk's middle deviates by more than the first [m] plus the second [m/s^2] over the squared rate."""

JOINT_LIMIT = 0.2, 100.0
"""The same limits for a single joint."""

SWAPPED_M, SWAPPED = 0.12, 0.3
"""Left and right may be swapped where a pair's step deviates by more than the first [m], and with the sides exchanged by less than
the second times as much."""

PAIRS = (("hip", "shoulder"), ("knee", "ankle"), ("elbow", "wrist"))
"""Pairs of joints that are swapped together."""

SPREAD, LONGEST, LONGEST_S = (1, 2, 3, 6, 12, 24), 3, 0.12
"""Numbers of frames over which filters or interpolation may spread a jump; none exceeds both `LONGEST` frames and `LONGEST_S`."""

LARGER = 1.5
"""Factor by which a jump must be larger over more frames than over fewer to count as spread over the larger number."""

NOISE = 6.0
"""A jump must exceed the limit by this many medians of the track's own deviations, so that the noise of a camera is no jump."""

TOLD = "the motion jumps: "
MOST = 200
"""How many jumps, the largest ones, are examined in a file that is full of them."""

SHOWN = 3


@dataclass(frozen=True, slots=True)
class Jump:
    """A step of joints that contradicts the steps before and after it."""

    what: str
    frame: int
    """Frame at which it starts."""
    frames: int
    """Number of frames over which it is spread."""
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
    """Jumps of joints (T, J, 3) [m] in order of time: of the whole body, of single joints, and swaps of left and right."""
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
    """A clause for a motion's report that names the largest jumps and counts the others."""
    largest = sorted(sorted(jump_list, key=attrgetter("by_m"), reverse=True)[:SHOWN], key=attrgetter("frame"))
    more = f" and {len(jump_list) - SHOWN} more" if len(jump_list) > SHOWN else ""
    return f"{TOLD}{', '.join(map(str, largest))}{more}"


def told_before(report: str) -> str:
    """The clause of a motion's report that tells of jumps; empty if there is none."""
    return next((clause for clause in report.split("; ") if clause.startswith(TOLD)), "")


def deviations(joints: np.ndarray, frames: int = 1) -> np.ndarray:
    """Deviations (T - 3 n, J) [m] of the steps over n frames of joints (T, J, 3) [m], defined in the docstring of this module."""
    step = joints[frames:] - joints[:-frames]
    before, here, after = step[: -2 * frames], step[frames:-frames], step[2 * frames :]
    along = after - before
    part = inner(here - before, along) / np.maximum(inner(along, along), 1e-18)
    return norms(here - before - np.clip(part, 0.0, 1.0)[..., None] * along)


def _may_deviate(joints: np.ndarray, frames: int, limit_m: float) -> bool:
    """Whether any deviation may exceed a limit: none is larger than the difference between the step and the one before, which is
    found in a third of the time and is small in sound motions."""
    step = joints[frames:] - joints[:-frames]
    change = step[frames:-frames] - step[: -2 * frames]
    return bool(inner(change, change).max() > (1.0 - 1e-9) * limit_m**2)


def _excess(deviation: np.ndarray, limit: tuple[float, float], rate_hz: float) -> np.ndarray:
    return deviation - limit[0] - limit[1] / rate_hz**2 - NOISE * np.median(deviation, axis=0)


def _peaks(size: np.ndarray, frames: int) -> list[int]:
    """Indices of positive values that no value within fewer than `frames` frames exceeds."""
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
    """Adds a jump; if it overlaps others, being the same one over more frames, it replaces them only if `LARGER` times as large."""
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
            # The step goes to the other side's place, and the next one follows that side.
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
