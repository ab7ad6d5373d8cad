"""Frames that a file repeats because its source is slower: a camera's 20 Hz in a file of 60 or of 30 Hz."""

from __future__ import annotations

import numpy as np

from t2d_rt.geometry.vectors import inner

MOST_REPEATS = 8
LEAST_REPEATS = 6
REPEATED = 0.1
"""Repeats of a frame in files of a slower source: most in a row, fewest in all, their least share."""

DITHER = 0.1
"""Of the largest step nearby, below which a frame counts as repeated."""


def new_frames(joints: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Frames that a slower source has made, evenly (3, 3, 3) or by turns (2, 1, 2, 1) in the file, and the file's frames per frame
    of the source; None where no frames are repeated. joints: (T, K, 3), NaN where missing.
    """
    steps = np.nan_to_num(rms_steps(joints))
    if len(steps) < LEAST_REPEATS:
        return None
    nearby = np.lib.stride_tricks.sliding_window_view(np.pad(steps, MOST_REPEATS), 2 * MOST_REPEATS + 1).max(axis=1)
    new = np.flatnonzero(steps > DITHER * nearby) + 1
    if len(steps) - len(new) < max(LEAST_REPEATS, REPEATED * len(steps)) or len(new) < 4:
        return None
    runs = np.split(new, np.flatnonzero(np.diff(new) > MOST_REPEATS) + 1)
    ratio = _ratio(max(runs, key=len))
    if ratio is None or not all(_spread(run, ratio) < 1.0 for run in runs):
        return None
    # Somebody who stands still makes no new frames; the source's clock goes on.
    starts = [float((run - ratio * np.arange(len(run))).mean()) for run in runs]
    first = int(runs[0][0])
    kept = np.linspace(0, first, max(1, int(first / ratio)), endpoint=False).round().astype(int).tolist()
    for place, run in enumerate(runs):
        if place:
            before = runs[place - 1]
            pause = max(1, round((starts[place] - starts[place - 1]) / ratio) - len(before) + 1)
            kept += np.linspace(before[-1], run[0], pause, endpoint=False).round().astype(int).tolist()[1:]
        kept += run.tolist()
    return np.array(kept), ratio


def _ratio(new: np.ndarray) -> float | None:
    """File's frames per frame of the source, from the frames (K,) that are new; None where no even clock makes them."""
    if len(new) < 4:
        return None
    middle, reach = (new[-1] - new[0]) / (len(new) - 1), 1.0 / (len(new) - 1)
    choices = [float(round(middle)), *(middle + reach * np.linspace(-1.0, 1.0, 201))]
    best = min(choices, key=lambda ratio: _spread(new, ratio))
    return float(best) if best > 1.0 + 0.5 * REPEATED and _spread(new, best) < 1.0 else None


def _spread(new: np.ndarray, ratio: float) -> float:
    late = new - ratio * np.arange(len(new))
    return float(late.max() - late.min())


def rms_steps(joints: np.ndarray) -> np.ndarray:
    """RMS step (T - 1,) of the points (T, K, 3) that are known in both frames, NaN where none is."""
    steps = np.diff(joints, axis=0)
    square = inner(steps, steps)
    known = np.isfinite(square)
    count = known.sum(axis=1)
    mean = np.where(known, square, 0.0).sum(axis=1) / np.maximum(count, 1)
    return np.where(count > 0, np.sqrt(mean), np.nan)
