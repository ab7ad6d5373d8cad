"""The likeliest course of classes over time, where each activity lasts for a while and is judged by windows that see little else.

A segmental Viterbi search (hidden semi-Markov models, Yu, Artificial Intelligence 174, 2010): what an instant counts for depends on
where its activity begins and ends.
"""

from __future__ import annotations

import math

import numpy as np

LEAST_PROBABILITY = 1e-2
"""A class is never held for less likely than this, or than the mean of all classes: windows over a change may be certain of what is
wrong."""
SHARPNESS = 16
"""A window that would have to move by a part x of its duration to see an activity alone counts by (1 - x) to this power."""
LONGEST = 4
"""An activity of the search lasts at most so many windows, or twice the least duration if that is more; longer ones are several of
one class."""
LEAST_WEIGHT = 1e-12
"""Added to the weight of the nearest window, so that one counts where windows are far apart."""


def likeliest_course(
    probabilities: np.ndarray, middles_s: np.ndarray, duration_s: float, edges_s: np.ndarray, least: int
) -> np.ndarray:
    """Number of the class at each instant, (T,): of all courses of activities of `least` instants or more, the one whose product of
    probabilities over all instants is greatest. Where there are fewer instants, one activity lasts for all of them.

    An instant has the weighted geometric mean of the probabilities of the windows about its activity. A window that lies within it
    counts in full; one that would have to move by a part x of its duration to lie within, or to be about the middle of an activity
    that is shorter, counts by (1 - x)^16. So windows over a change hardly count where others show an activity alone; one stray
    window among many that overlap makes no activity, unless it is the first or the last of all; and each instant counts once,
    whatever the course. Activities of one class may follow one another, as
    a slow and a fast walk: each is judged for itself, and the course tells the class of both.

    probabilities: of each class in each window, (W, K).
    middles_s: of the windows [s], (W,), ascending.
    duration_s: of a window.
    edges_s: where instants of equal length begin and end [s], (T + 1,).
    """
    count, classes = len(edges_s) - 1, probabilities.shape[1]
    scores = np.log(np.maximum(probabilities, min(LEAST_PROBABILITY, 1.0 / classes)))
    least = min(max(1, least), count)
    per_window = duration_s * count / float(edges_s[-1] - edges_s[0])
    longest = max(2 * least, math.ceil(LONGEST * per_window))
    best = np.full(count + 1, -np.inf)  # of the courses that end at each edge
    best[0] = 0.0
    last = np.zeros((count + 1, 2), dtype=int)  # the last activity of the best: where it begins, and its class
    for end in range(least, count + 1):
        starts = np.arange(max(0, end - longest), end - least + 1)
        means = _means(scores, middles_s, duration_s, edges_s[starts], edges_s[end])
        every = best[starts, None] + (end - starts)[:, None] * means
        row, chosen = np.unravel_index(int(np.argmax(every)), every.shape)
        best[end] = every[row, chosen]
        last[end] = starts[row], chosen
    found = np.zeros(count, dtype=int)
    end = count
    while end > 0:
        start, chosen = last[end]
        found[start:end] = chosen
        end = start
    return found


def _means(
    scores: np.ndarray, middles_s: np.ndarray, duration_s: float, starts_s: np.ndarray, end_s: float
) -> np.ndarray:
    """Weighted mean of the windows' scores (W, K) over activities from each start to the end [s], (S, K)."""
    first, after = np.searchsorted(middles_s, [starts_s[0] - duration_s, end_s + duration_s])
    some = slice(max(first - 1, 0), after + 1)
    middles_s, scores = middles_s[some], scores[some]
    centres_s, spare_s = 0.5 * (starts_s + end_s), np.maximum(0.5 * (end_s - starts_s - duration_s), 0.0)
    moved = np.maximum(np.abs(middles_s - centres_s[:, None]) - spare_s[:, None], 0.0) / duration_s
    weights = np.maximum(1.0 - moved, 0.0) ** SHARPNESS
    weights[np.arange(len(weights)), moved.argmin(axis=1)] += (
        LEAST_WEIGHT  # where there is none, the nearest one counts
    )
    return np.asarray(weights @ scores / weights.sum(axis=1)[:, None])


def nearest(places: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Number of the nearest of ascending places (N,) for each that is wanted, of the shape of those; the earlier of two as near."""
    if len(places) == 1:
        return np.zeros(np.shape(wanted), dtype=int)
    after = np.clip(np.searchsorted(places, wanted), 1, len(places) - 1)
    return np.asarray(after - (wanted - places[after - 1] <= places[after] - wanted))
