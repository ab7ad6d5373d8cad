"""Sides of a data set for training, validation and test: by file, by description, or by clip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from t2d_rt.core.checks import choice, integer
from t2d_rt.core.errors import InputError
from t2d_rt.dataset.splits import NAMES, split

SPLITS = "file", "description", "clip"
"""By file, samples of one description stand on all sides, as in the code of Text2Doppler; by description no sentence and no motion
is on two; by clip no recording is either, and samples that would join two sides are left out."""
FRACTIONS = 0.5, 0.25, 0.25
"""Of train, val and test: four descriptions of a class can be divided so."""


def sides_of(
    records: Sequence[Mapping[str, Any]], by: str, *, fractions: Sequence[float] = FRACTIONS, seed: int = 0
) -> dict[str, np.ndarray]:
    """Positions of the samples of train, val and test, of each class alike."""
    choice("split", by, SPLITS)
    if by != "file":
        apart = ("description", "seed") if by == "description" else ("description", "clip", "seed")
        found = split(records, fractions, apart=apart, leave_out=by == "clip", seed=seed)
        place = {int(record["index"]): number for number, record in enumerate(records)}
        return {name: np.array([place[each] for each in indices]) for name, indices in found.sides.items()}
    rng = np.random.default_rng(integer("seed", seed))
    classes = np.array([str(each["class"]) for each in records])
    sides: dict[str, list[int]] = {name: [] for name in NAMES}
    for name in sorted(set(classes)):
        members = rng.permutation(np.flatnonzero(classes == name))
        cuts = np.rint(np.cumsum(fractions)[:-1] * len(members)).astype(int)
        for side, part in zip(NAMES, np.split(members, cuts), strict=True):
            sides[side] += part.tolist()
    return {name: np.sort(np.array(each, dtype=np.int64)) for name, each in sides.items()}


def check_sides(parts: Mapping[str, np.ndarray]) -> None:
    """Refuses a split that leaves a side empty."""
    empty = [name for name, places in parts.items() if len(places) == 0]
    if empty:
        counts = ", ".join(f"{name} {len(places)}" for name, places in parts.items())
        raise InputError(f"the split leaves {empty[0]} empty ({counts} samples); make more samples, or split otherwise")
