"""The likeliest course of classes over time, where each lasts for a while: a search by Viterbi (1967) with a least duration."""

from __future__ import annotations

import numpy as np

LEAST_PROBABILITY = 1e-2
"""A class is never held for less likely than this, or than the mean of all classes: windows over a change may be certain of what is
wrong."""


def likeliest_course(probabilities: np.ndarray, least: int) -> np.ndarray:
    """Number of the class at each instant, (T,), from probabilities (T, K): that course whose product of probabilities is greatest
    among those in which a class lasts for `least` instants or more; where there are fewer, one class lasts for all of them."""
    count, classes = probabilities.shape
    scores = np.log(np.maximum(probabilities, min(LEAST_PROBABILITY, 1.0 / classes)))
    least = min(max(1, least), count)
    total = np.vstack([np.zeros(classes), np.cumsum(scores, axis=0)])
    ending = np.full(
        (count + 1, classes), -np.inf
    )  # the best score of courses that end in each class, its piece long enough
    begun = np.zeros((count + 1, classes), dtype=int)  # where that piece began
    for end in range(least, count + 1):
        start = end - least
        before = 0.0 if start == 0 else ending[start].max()
        fresh = before + total[end] - total[start]
        longer = ending[end - 1] + scores[end - 1]
        ending[end] = np.maximum(fresh, longer)
        begun[end] = np.where(longer >= fresh, begun[end - 1], start)
    found = np.zeros(count, dtype=int)
    end = count
    while end > 0:
        chosen = int(np.argmax(ending[end]))
        start = int(begun[end, chosen])
        found[start:end] = chosen
        end = start
    return found
