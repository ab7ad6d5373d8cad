"""Find samples that a file lacks or repeats, bridge short gaps and cut long ones away, in the same way for all formats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from t2d_rt.core.errors import InputError, warn
from t2d_rt.geometry.vectors import inner, norms
from t2d_rt.motion import quaternions
from t2d_rt.motion.contacts import runs
from t2d_rt.motion.interpolate import compose, decompose
from t2d_rt.motion.jumps import Jump, jumps, told
from t2d_rt.motion.read.joint_sets import NEEDED
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.motion.skeletons import PARENT_OF, parents_of

# --- frames that a file repeats because its source is slower: a camera's 20 Hz in a file of 60 or of 30 Hz ---


MOST_REPEATS = 8
LEAST_REPEATS = 6
REPEATED = 0.1
"""Repeated frames in files of a slower source: the most in a row, the fewest in all, and their least part of all frames."""


def new_frames(joints: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Indices of the frames that a slower source has made, repeated evenly (3, 3, 3) or by turns (2, 1, 2, 1) in the file, and the
    file's frames per frame of the source; None if no frames are repeated. joints: (T, K, 3), NaN where missing.
    """
    steps = np.nan_to_num(rms_steps(joints))
    if len(steps) < LEAST_REPEATS:
        return None
    nearby = np.lib.stride_tricks.sliding_window_view(np.pad(steps, MOST_REPEATS), 2 * MOST_REPEATS + 1).max(axis=1)
    new = np.flatnonzero(steps > 0.1 * nearby) + 1
    if len(steps) - len(new) < max(LEAST_REPEATS, REPEATED * len(steps)) or len(new) < 4:
        return None
    stretches = np.split(new, np.flatnonzero(np.diff(new) > MOST_REPEATS) + 1)
    ratio = _ratio(max(stretches, key=len))
    if ratio is None or not all(_spread(run, ratio) < 1.0 for run in stretches):
        return None
    # While somebody stands still there are no new frames, but the source's clock goes on.
    starts = [float((run - ratio * np.arange(len(run))).mean()) for run in stretches]
    first = int(stretches[0][0])
    frames = np.linspace(0, first, max(1, int(first / ratio)), endpoint=False).round().astype(int).tolist()
    for place, run in enumerate(stretches):
        if place:
            before = stretches[place - 1]
            pause = max(1, round((starts[place] - starts[place - 1]) / ratio) - len(before) + 1)
            frames += np.linspace(before[-1], run[0], pause, endpoint=False).round().astype(int).tolist()[1:]
        frames += run.tolist()
    return np.array(frames), ratio


def _ratio(new: np.ndarray) -> float | None:
    """The file's frames per frame of the source, from the frames (K,) that are new; None if no even clock makes them."""
    if len(new) < 4:
        return None
    middle, reach = (new[-1] - new[0]) / (len(new) - 1), 1.0 / (len(new) - 1)
    choices = [float(round(middle)), *(middle + reach * np.linspace(-1.0, 1.0, 201))]
    best = min(choices, key=partial(_spread, new))
    return float(best) if best > 1.0 + 0.5 * REPEATED and _spread(new, best) < 1.0 else None


def _spread(new: np.ndarray, ratio: float) -> float:
    late = new - ratio * np.arange(len(new))
    return float(late.max() - late.min())


def rms_steps(joints: np.ndarray) -> np.ndarray:
    """RMS step (T - 1,) of the points (T, K, 3) that are known in both frames, NaN where none is."""
    steps = np.diff(joints, axis=0)
    square = inner(steps, steps)
    both_seen = np.isfinite(square)
    count = both_seen.sum(axis=1)
    mean = np.where(both_seen, square, 0.0).sum(axis=1) / np.maximum(count, 1)
    return np.where(count > 0, np.sqrt(mean), np.nan)


# --- samples that a file lacks ---
#
# A sample is missing where it is no number; where a point stands at one and the same place that is no place of the
# body (0, 0, 0 or -1, -1, -1 and the like, as trackers write for "not seen"); where a row of a file with rotations
# holds nothing but zeros; where a track stands still to the last digit and then makes up for it in one step (a
# tracker that holds its last sample); and where joints leap away and back. Frames held throughout, as of a camera in
# a faster file, are dropped.


LONGEST_GAP_S = 0.25
"""Gaps up to this length are bridged, by cubic splines through the other samples: a wrist that swings by 20 cm in a walk, at 1 Hz,
is then up to 4 mm off in a file of 20 Hz and 2 mm in one of 60 Hz, and twice that beside the record's ends."""

SHORTEST_S = 0.5
"""Pieces between longer gaps that are shorter than this hold no step [s]."""

HELD = 1.5
"""Step out of a hold, over those around it, above which a tracker held its sample and nobody stood still; a single frame has 2."""

RARE = 0.1
"""Greatest part of the time for which a joint that can be filled may be lost in long gaps; beyond it, it is filled throughout. Only
the time counts in which all needed joints are seen."""

# --- what is missing, as readers see it ---


LARGEST = 1e9
"""Limit that no length or angle of a person comes near, in any unit."""


def plausible(values: np.ndarray) -> np.ndarray:
    """Values (...) with NaN for those that are too large for a person."""
    return np.where(np.abs(values) < LARGEST, values, np.nan)


def seen(positions: np.ndarray) -> np.ndarray:
    """Positions (T, K, 3) with NaN for points that were not seen: no numbers, or the same number three times, off the body.

    A body that is centred on one of its points keeps that point at 0, 0, 0.
    """
    x, y, z = np.moveaxis(np.isfinite(positions), -1, 0)
    visible = np.where((x & y & z)[..., None], positions, np.nan)
    same = (visible[..., 0] == visible[..., 1]) & (visible[..., 1] == visible[..., 2])
    if not same.any():
        return visible
    true = np.where(same[..., None], np.nan, visible)
    middle, extent = _frame_of(true)
    for point in np.flatnonzero(same.any(axis=0)):
        stands, there = np.flatnonzero(same[:, point]), np.flatnonzero(np.isfinite(true[:, point, 0]))
        if not len(there):
            if visible.shape[1] == 1:
                continue
            # This point is the centre of the body, or was never seen.
            reach = norms(visible[:, point] - middle)
            if visible[:, point].any() or not np.nanmax(reach, initial=0.0) < extent:
                visible[:, point] = np.nan
            continue
        place = np.searchsorted(there, stands)
        nearest = [there[np.clip(place - 1, 0, len(there) - 1)], there[np.clip(place, 0, len(there) - 1)]]
        away = np.min([norms(visible[stands, point] - true[near, point]) for near in nearest], axis=0)
        steps = rms_steps(true[:, point : point + 1])
        fast = float(np.nanpercentile(steps, 90)) if np.isfinite(steps).any() else 0.0
        # A walk may begin at 0, 0, 0.
        visible[stands[away > 0.05 * extent + 3.0 * fast], point] = np.nan
    alone = np.isfinite(visible[..., 0]).sum(axis=1) == 1  # the centre of a body that was not seen
    if visible.shape[1] > 2:
        visible[alone & same.any(axis=1)] = np.nan
    return visible


def _frame_of(points: np.ndarray) -> tuple[np.ndarray, float]:
    """The body's middle (T, 3), NaN where nothing is seen, and how far its points reach from there."""
    there = np.isfinite(points[..., :1])
    count = np.maximum(there.sum(axis=1), 1)
    middle = np.where(there, points, 0.0).sum(axis=1) / count
    middle[~there.any(axis=(1, 2))] = np.nan
    away = norms(points - middle[:, None])
    reach = np.where(np.isfinite(away), away, 0.0).max(axis=1)
    return middle, float(np.median(reach[reach > 0])) if (reach > 0).any() else 0.0


def filled(rows: np.ndarray, what: str, root: slice | Sequence[int] = ()) -> tuple[np.ndarray, np.ndarray]:
    """Rows (T, C) of a file with rotations, in which lost rows repeat the last whole one, and a mask (T,) of the lost ones.

    root: columns of the root's position. Raises an InputError if all rows are lost.
    """
    lost = ~np.isfinite(rows).all(axis=1)
    blank = (rows == 0.0).all(axis=1)
    lead = int((~blank).argmax())  # a pose of rest that files may begin with
    lost[lead:] |= blank[lead:] & ~blank.all()
    place = np.where(lost[:, None], np.nan, rows[:, root]) if root else rows[:, :0]
    if place.shape[1] == 3:
        lost |= np.isnan(seen(place[:, None])[:, 0, 0])
    if lost.all():
        raise InputError(f"{what} holds NaN, infinite or absurd values in every frame; repair or re-export the file")
    last = np.maximum.accumulate(np.where(lost, 0, np.arange(len(rows))))
    last[: int((~lost).argmax())] = int((~lost).argmax())
    return rows[last], lost


# --- how samples are mended ---


def whole(samples: Tracks) -> Tracks:
    """Samples at the rate at which they were taken, without gaps."""
    return _bridged(_cut(_held(_at_own_rate(samples))), "missing")


def without_leaps(samples: Tracks) -> Tracks:
    """Samples in metres without joints that leap away and back; a warning of the jumps that remain."""
    jump_list = jumps(samples.joints, tuple(samples.points), samples.rate_hz)
    leaps = _leaps(samples, jump_list)
    if leaps:
        points = {name: track.copy() for name, track in samples.points.items()}
        for first, last in leaps:
            for name in points if samples.turned else {*first.joints, *last.joints}:
                points[name][first.frame + 1 : last.frame + 1] = np.nan
        samples = _bridged(replace(samples, points=points), "leaping")
        jump_list = jumps(samples.joints, tuple(samples.points), samples.rate_hz)
    if not jump_list:
        return samples
    warn(f"{told(jump_list)}; a radar sees that as fast movement: cut or repair the motion there")
    return samples.saying(told(jump_list))


def _at_own_rate(samples: Tracks) -> Tracks:
    """Samples without frames that a slower source repeats."""
    source_frames = new_frames(samples.joints)
    if source_frames is None:
        return samples
    frames, ratio = source_frames
    rate_hz = samples.rate_hz / ratio
    rate_hz = float(round(rate_hz)) if abs(rate_hz - round(rate_hz)) < 0.01 * rate_hz else rate_hz
    often = f"{ratio:.0f} times" if abs(ratio - round(ratio)) < 1e-6 else f"{ratio:.3g} times on average"
    clause = f"each frame stood {often} at {samples.rate_hz:g} Hz"
    return replace(samples.at(frames), rate_hz=rate_hz).saying(clause)


# --- samples held while a tracker saw nothing ---


def _held(samples: Tracks) -> Tracks:
    """Samples with NaN where the body or a point is held to the last digit and then makes up for it in one step.

    With rotations, only the body and its root are examined: single joints stand still at their limits (knees of CMU's files).
    """
    joints, points = samples.joints, dict(samples.points)
    extent, most = _frame_of(joints)[1], LONGEST_GAP_S * samples.rate_hz
    of_body = _holds(joints, extent)
    body_held = _flags(of_body, len(joints), np.inf)
    for name in ("pelvis",) if samples.turned else tuple(points):
        holds = [hold for hold in _holds(points[name][:, None], extent) if not body_held[slice(*hold)].all()]
        _warn_of_long(name, [hold for hold in holds if _length(hold) > most], samples.rate_hz)
        held = _flags(holds, len(joints), most)
        if not samples.turned:
            points[name] = np.where(held[:, None], np.nan, points[name])
        elif held.any():
            moved = spline(points[name], held) - points[name]
            points = {name: track + moved for name, track in points.items()}
            samples = samples.saying(f"the root's position, held in {int(held.sum())} frame(s), bridged")
    return replace(samples, points=points).without(_flags(of_body, len(joints), most))


def _flags(holds: Sequence[tuple[int, int]], frames: int, most: float) -> np.ndarray:
    """Mask (T,) of the frames of holds that are no longer than `most` frames."""
    flags = np.zeros(frames, dtype=bool)
    for start, stop in holds:
        flags[start:stop] = stop - start <= most
    return flags


def _warn_of_long(name: str, holds: Sequence[tuple[int, int]], rate_hz: float) -> None:
    if holds:
        start, stop = max(holds, key=_length)
        warn(
            f"{name} stands still to the last digit for {(stop - start) / rate_hz:.2f} s from {start / rate_hz:.2f} s on and then "
            f"leaps, as a tracker does that has lost it; {LONGEST_GAP_S} s are bridged at most: cut or repair the motion there"
        )


def _holds(points: np.ndarray, extent: float) -> list[tuple[int, int]]:
    """Runs of frames, from start to before stop, in which points (T, K, D) are held before they leap."""
    steps, holds = rms_steps(points), []
    # Equal up to rounding.
    for first, out in runs(steps <= 1e-9 * extent):  # frames first ... out are equal
        if first == 0 or out == len(steps) or steps[out] <= 0.003 * extent:
            continue
        ends = points[max(0, first - 3) : first + 1], points[out + 1 : out + 5]
        paces = [float(rms_steps(end[[0, -1]])[0]) / (len(end) - 1) for end in ends if len(end) > 1]
        if steps[out] > HELD * max(paces, default=0.0):
            holds.append((first + 1, out + 1))
    return holds


# --- gaps ---


def _cut(samples: Tracks) -> Tracks:
    """The longest piece without gaps that are too long to be bridged, with a warning if there were any.

    Raises an InputError if that piece is too short.
    """
    missing = {name: np.isnan(track).any(axis=1) for name, track in samples.points.items()}
    if not any(flags.any() for flags in missing.values()):
        return samples
    lost = {name: _unbridged(flags, LONGEST_GAP_S * samples.rate_hz) for name, flags in missing.items()}
    there = ~np.any([lost[name] for name in lost if name in NEEDED], axis=0)
    rare = [name for name, flags in lost.items() if name not in NEEDED and (flags & there).sum() > RARE * there.sum()]
    if rare and not samples.turned:
        lost = {name: flags for name, flags in lost.items() if name not in rare}
        samples = replace(samples, points={name: samples.points[name] for name in lost})
        samples = samples.saying(f"{', '.join(rare)} seen too seldom")
    pieces = runs(~np.any(list(lost.values()), axis=0))
    start, stop = max(pieces, key=_length, default=(0, 0))
    total, rate_hz = len(samples), samples.rate_hz
    if stop - start < max(2, min(SHORTEST_S * rate_hz, 0.5 * total)):
        counts = {name: int(missing[name].sum()) for name in lost}
        worst = max(counts, key=counts.__getitem__)
        raise InputError(
            f"{samples.form}: {worst} is not seen in {counts[worst]} of {total} frames; gaps of {LONGEST_GAP_S} s are "
            f"bridged at most, and between them no {SHORTEST_S} s are left; fill the gaps, or take another record"
        )
    if len(pieces) > 1:
        gaps = {name: max(runs(flags), key=_length) for name, flags in lost.items() if flags.any()}
        first, last = max(gaps.values(), key=_length)
        name = next(name for name, gap in gaps.items() if _length(gap) == last - first)
        warn(
            f"{name} is missing for {(last - first) / rate_hz:.2f} s from {first / rate_hz:.2f} s on, gaps of {LONGEST_GAP_S} s "
            f"are bridged at most: only the longest whole piece is kept, from {start / rate_hz:.2f} to "
            f"{(stop - 1) / rate_hz:.2f} s; fill the gap in the file to keep all"
        )
    if stop - start == total:
        return samples
    clause = f"first {start} and last {total - stop} frame(s) without all joints cut"
    return samples.piece(start, stop).saying(clause)


def _length(run: tuple[int, int]) -> int:
    """Number of frames from a start to before a stop."""
    return run[1] - run[0]


def _unbridged(missing: np.ndarray, most: float) -> np.ndarray:
    """Mask (T,) of the missing frames that cannot be bridged: those in gaps longer than `most` frames, and at the ends."""
    unbridged = np.zeros(len(missing), dtype=bool)
    for start, stop in runs(missing):
        unbridged[start:stop] = stop - start > most or start == 0 or stop == len(missing)
    return unbridged


def _bridged(samples: Tracks, kind: str) -> Tracks:
    """Samples whose gaps, all of them within the record, are bridged; bones of files with rotations keep their lengths."""
    missing = {name: np.isnan(track).any(axis=1) for name, track in samples.points.items()}
    names = [name for name, flags in missing.items() if flags.any()]
    if not names:
        return samples
    longest = max(stop - start for name in names for start, stop in runs(missing[name])) / samples.rate_hz
    if samples.turned:
        lost = np.any(list(missing.values()), axis=0)
        clause = f"{int(lost.sum())} {kind} frame(s) bridged, up to {longest:.2f} s"
        return _bridged_pose(samples, lost).saying(clause)
    count = sum(int(missing[name].sum()) for name in names)
    which = f"{', '.join(names[:3])}{f' and {len(names) - 3} more' if len(names) > 3 else ''}"
    points = {name: spline(track, missing[name]) for name, track in samples.points.items()}
    clause = f"{count} {kind} joint position(s) bridged, up to {longest:.2f} s ({which})"
    return replace(samples, points=points).saying(clause)


def _bridged_pose(samples: Tracks, lost: np.ndarray) -> Tracks:
    """Samples whose lost frames (T,) come from splines of offsets and rotations in the parents' frames."""
    there, names = samples.at(~lost), [name for name in PARENT_OF if name in samples.points]
    parents = parents_of(names)
    placed, rotations = (np.stack([tracks[name] for name in names], axis=1) for tracks in (there.points, there.turned))
    offsets, local = decompose(placed, rotations, parents)
    values = np.zeros((len(lost), len(names), 7))
    values[~lost] = np.concatenate([quaternions.continuous(local), offsets], axis=-1)
    values = spline(values.reshape(len(lost), -1), lost).reshape(values.shape)[lost]
    joints, rotations = compose(values[..., 4:], quaternions.normalise(values[..., :4]), parents)
    points, turned = ({name: tracks[name].copy() for name in names} for tracks in (samples.points, samples.turned))
    for place, name in enumerate(names):
        points[name][lost], turned[name][lost] = joints[:, place], rotations[:, place]
    return replace(samples, points=points, turned=turned)


def spline(track: np.ndarray, lost: np.ndarray) -> np.ndarray:
    """A track (T, D) with its lost frames on a cubic spline through all others."""
    if not lost.any():
        return track
    from scipy.interpolate import make_interp_spline

    there = np.flatnonzero(~lost & np.isfinite(track).all(axis=1))
    bridged = track.copy()
    bridged[lost] = make_interp_spline(there, track[there], k=min(3, len(there) - 1))(np.flatnonzero(lost))
    return bridged


# --- joints that leap away and back ---


def _leaps(samples: Tracks, jump_list: Sequence[Jump]) -> list[tuple[Jump, Jump]]:
    """Pairs of jumps of which the second reverses the first within the length of a gap that is bridged."""
    pairs, after = [], -1
    steps = [jump for jump in jump_list if jump.frames == 1]
    for first in steps:
        near = [step for step in steps if 0 < step.frame - first.frame <= LONGEST_GAP_S * samples.rate_hz]
        last = next((step for step in near if _returns(samples, first, step)), None)
        if first.frame > after and last is not None:
            pairs.append((first, last))
            after = last.frame
    return pairs


def _returns(samples: Tracks, first: Jump, last: Jump) -> bool:
    """Whether the joints go on, after both jumps, about where their speed before and after leads them."""
    start, stop = first.frame, last.frame + 1
    if start < 1 or stop + 1 >= len(samples.points["left_hip"]):
        return False
    tracks = np.stack([samples.points[name] for name in first.joints], axis=1)
    led = 0.5 * (tracks[start] - tracks[start - 1] + tracks[stop + 1] - tracks[stop]) * (stop - start)
    missed = norms(tracks[stop] - tracks[start] - led)
    return bool((missed < 0.5 * norms(tracks[start + 1] - tracks[start])).mean() > 0.8)
