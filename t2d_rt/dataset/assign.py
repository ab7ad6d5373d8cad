"""Which side of a split each group of samples is put on: as proportional as groups allow, in every class.

Sides get what makes the sum over sides s and classes c of f_s n_c log(placed_sc) greatest, f_s the fraction asked for and n_c the
samples of the class; all classes together count as one more. Where groups can be divided freely, its greatest value is at
placed_sc = f_s n_c (Gibbs' inequality); where they cannot, it says which of two divisions is the more proportional one, and it
grows with the samples that are kept.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

TRIES = 16
"""Orders of the groups, or first guesses at the sides of clips, of which the best outcome is taken."""
SWEEPS = 30
"""Rounds over all clips at most; five are usual."""
TOGETHER = 100
"""Samples in each round whose clips are moved together."""
SOFT = 1e-12
"""Samples that an empty side counts as: its logarithm is finite, and any other division is better."""


def objective(placed: np.ndarray, fractions: np.ndarray, totals: np.ndarray) -> float:
    """How good `placed` (sides, classes) is, of `totals` (classes,) samples; see above."""
    return float(fractions @ np.log(placed + SOFT) @ totals)


def with_total(counts: np.ndarray) -> np.ndarray:
    """Counts (..., K) and their sum, (..., K + 1)."""
    return np.concatenate([counts, counts.sum(axis=-1, keepdims=True)], axis=-1)


def assigned(options: np.ndarray, fractions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Side of each group (G,), which puts `options` (G, S, K) samples of each class there, depending on the side."""
    options = with_total(options)
    best: tuple[float, np.ndarray] | None = None
    totals = options.max(axis=1).sum(axis=0)
    sizes = options[:, :, -1].max(axis=1)
    for _ in range(TRIES):
        order = rng.permutation(len(options))
        order = order[np.argsort(-sizes[order], kind="stable")]  # large ones while there is room for them
        placed, sides = np.zeros(options.shape[1:]), np.zeros(len(options), dtype=np.int64)
        for group in order:
            gains = np.log(placed + options[group] + SOFT) - np.log(placed + SOFT)
            side = int(np.argmax(fractions * (gains @ totals)))
            sides[group] = side
            placed[side] += options[group, side]
        value = objective(placed, fractions, totals)
        if best is None or value > best[0]:
            best = value, sides
    assert best is not None, "there is at least one order"
    return best[1]


def clip_sides(
    labels: np.ndarray,
    clips: Sequence[frozenset[str]],
    groups: Sequence[Sequence[int]],
    fractions: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """Sides that each sample is bound to, (N, S): those that its clips are on, and that of its group.

    labels: number of each sample's class, (N,). groups: positions of samples that are to be on one side.
    Clips, alone or those of a sample together, go where they are worth most, until none moves; then groups do, likewise.
    """
    names = sorted(frozenset[str]().union(*clips))
    number = {name: place for place, name in enumerate(names)}
    of_samples = [tuple(sorted(number[each] for each in clip)) for clip in clips]
    patterns = sorted(set(of_samples))
    place = {pattern: row for row, pattern in enumerate(patterns)}
    rows = np.array([place[each] for each in of_samples])
    sums = np.zeros((len(patterns), labels.max() + 1))
    np.add.at(sums, (rows, labels), 1)
    holds = np.zeros((len(patterns), len(names)), dtype=np.int64)
    for row, pattern in enumerate(patterns):
        holds[row, list(pattern)] = 1
    unit = np.eye(len(fractions), dtype=bool)
    bound = (holds @ unit[_climbed(holds, with_total(sums), fractions, rng)].astype(np.int64) > 0)[rows]
    fits = np.stack(
        [~bound[:, np.arange(len(fractions)) != side].any(axis=1) for side in range(len(fractions))], axis=1
    )
    classes = np.eye(labels.max() + 1)[labels]
    options = np.stack([fits[group].astype(np.float64).T @ classes[group] for group in map(list, groups)])
    for group, side in zip(groups, assigned(options, fractions, rng), strict=True):
        bound[list(group), side] = True
    return bound


def _climbed(holds: np.ndarray, sums: np.ndarray, fractions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Side of each clip, (C,)."""
    unit = np.eye(len(fractions), dtype=np.int64)
    totals = sums.sum(axis=0)
    best: tuple[float, np.ndarray] | None = None
    for _ in range(TRIES):
        sides = np.asarray(rng.choice(len(fractions), size=holds.shape[1], p=fractions / fractions.sum()))
        value = objective(_placed(holds @ unit[sides] > 0, sums), fractions, totals)
        for _ in range(SWEEPS):
            before = value
            for clips in _moves(holds, rng):
                on = holds @ unit[sides] - holds[:, clips] @ unit[sides[clips]]
                weight = holds[:, clips].sum(axis=1, keepdims=True)
                values = [objective(_placed(on + weight * each > 0, sums), fractions, totals) for each in unit]
                side = int(np.argmax(values))
                if values[side] > value + 1e-9:
                    sides[clips], value = side, values[side]
            if value == before:
                break
        if best is None or value > best[0]:
            best = value, sides.copy()
    assert best is not None, "there is at least one guess"
    return best[1]


def _moves(holds: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    """Clips that go to another side together: each alone, and all those of some samples, which then can be kept."""
    alone = [np.array([clip]) for clip in rng.permutation(holds.shape[1])]
    rows = rng.permutation(len(holds))[:TOGETHER]
    return alone + [np.flatnonzero(holds[row]) for row in rows if holds[row].sum() > 1]


def _placed(on: np.ndarray, sums: np.ndarray) -> np.ndarray:
    """Samples of each class on each side, (S, K), of patterns on one side only."""
    only = on & (on.sum(axis=1, keepdims=True) == 1)
    return np.asarray(only.T.astype(np.float64) @ sums)
