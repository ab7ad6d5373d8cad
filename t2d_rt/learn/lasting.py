"""The likeliest course of classes over time, where each activity lasts for a while and is judged by windows that see nothing else.

A segmental Viterbi search (hidden semi-Markov models, Yu, Artificial Intelligence 174, 2010): what an instant counts for depends on
where its activity begins and ends.
"""

from __future__ import annotations

import math

import numpy as np

LEAST_PROBABILITY = 1e-2
"""A class is never held for less likely than this, or than the mean of all classes: windows over a change may be certain of what is
wrong."""
APART = 1e-3
"""Of an instant: what rounding may take away from a length."""


def likeliest_course(
    probabilities: np.ndarray, middles_s: np.ndarray, duration_s: float, edges_s: np.ndarray, least: int
) -> np.ndarray:
    """Number of the class at each instant, (T,): of all courses of activities of `least` instants or more, the one whose product of
    probabilities over all instants is greatest. Where there are fewer instants, one activity lasts for all of them.

    An instant has the probabilities of the nearest of those windows that lie within its activity; in an activity that is shorter
    than a window, those of the window about its middle. So no window over a change counts where another shows an activity alone,
    and each instant counts once, whatever the course. Activities of one class may follow one another, as a slow and a fast walk:
    each is judged for itself, and the course tells the class of both.

    probabilities: of each class in each window, (W, K).
    middles_s: of the windows [s], (W,), ascending.
    duration_s: of a window.
    edges_s: where instants of equal length begin and end [s], (T + 1,).
    """
    count, classes = len(edges_s) - 1, probabilities.shape[1]
    scores = np.log(np.maximum(probabilities, min(LEAST_PROBABILITY, 1.0 / classes)))
    least = min(max(1, least), count)
    per_window = duration_s * count / float(edges_s[-1] - edges_s[0])
    # Instants from which on an activity holds a window.
    whole = max(least, math.ceil(per_window - APART))
    # Instants nearer to an end than any middle of a window within.
    half = min(math.ceil(0.5 * per_window - 0.5 - APART), whole // 2)
    own = scores[nearest(middles_s, 0.5 * (edges_s[1:] + edges_s[:-1]))]
    total = np.vstack([np.zeros(classes), np.cumsum(own, axis=0)])
    early = half * scores[nearest(middles_s, edges_s + 0.5 * duration_s)]  # of activities that begin at each edge
    late = half * scores[nearest(middles_s, edges_s - 0.5 * duration_s)]  # of those that end there
    best = np.full(count + 1, -np.inf)  # of the courses that end at each edge
    best[0] = 0.0
    last = np.zeros((count + 1, 2), dtype=int)  # the last activity of the best: where it begins, and its class
    # The best beginning that is a window or more ago, for each class, and where it is.
    begun, since = np.full(classes, -np.inf), np.zeros(classes, dtype=int)
    for end in range(least, count + 1):
        if (start := end - whole) >= 0:
            fresh = best[start] + early[start] - total[start + half]
            since = np.where(fresh > begun, start, since)
            begun = np.maximum(begun, fresh)
        starts = np.arange(max(0, end - whole + 1), end - least + 1)
        windows = nearest(middles_s, 0.5 * (edges_s[starts] + edges_s[end]))
        short = best[starts, None] + (end - starts)[:, None] * scores[windows]
        every = np.vstack([begun + total[max(end - half, 0)] + late[end], short])
        row, chosen = np.unravel_index(int(np.argmax(every)), every.shape)
        best[end] = every[row, chosen]
        last[end] = since[chosen] if row == 0 else starts[row - 1], chosen
    found = np.zeros(count, dtype=int)
    end = count
    while end > 0:
        start, chosen = last[end]
        found[start:end] = chosen
        end = start
    return found


def nearest(places: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Number of the nearest of ascending places (N,) for each that is wanted, of the shape of those; the earlier of two as near."""
    if len(places) == 1:
        return np.zeros(np.shape(wanted), dtype=int)
    after = np.clip(np.searchsorted(places, wanted), 1, len(places) - 1)
    return np.asarray(after - (wanted - places[after - 1] <= places[after] - wanted))
