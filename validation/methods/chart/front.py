"""The Pareto front of points of one panel, and where a setting stands beside it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from validation.methods.chart.measure import Point

Error = Literal["nmse_db", "spectrogram_db"]
"""Which figure of a point is its error."""

GAP_DB, GAP_TIME = 1.0, 0.2
"""What the default setting may be off the front: in error, or in time."""


def error_of(point: Point, error: Error) -> float:
    """[dB]; infinite where it is not known."""
    value = getattr(point, error)
    return float(value) if value != "" else float("inf")


def front(points: Sequence[Point], error: Error = "nmse_db") -> list[Point]:
    """Points that no other one beats in both time and error, fastest first."""
    best: list[Point] = []
    for point in sorted(points, key=lambda p: (p.seconds_per_second, error_of(p, error))):
        if error_of(point, error) < (error_of(best[-1], error) if best else float("inf")):
            best.append(point)
    return best


def gap(points: Sequence[Point], default: Point, error: Error = "nmse_db") -> tuple[float, float]:
    """By how much the default errs more than what is as fast [dB], and takes longer than what is as good [fraction of that]."""
    own = error_of(default, error)
    as_fast = min(error_of(p, error) for p in points if p.seconds_per_second <= default.seconds_per_second)
    as_good = min(p.seconds_per_second for p in points if error_of(p, error) <= own)
    return own - as_fast, default.seconds_per_second / as_good - 1


def seconds_at(points: Sequence[Point], error_db: float) -> float:
    """Time at which a method, finer and finer, reaches an error: log of time over dB between the two settings around it; NaN where
    none of them does."""
    line = front(points)
    errors = np.array([p.nmse_db for p in line])
    if not (errors.min() <= error_db <= errors.max()):
        return float("nan") if errors.min() > error_db else line[0].seconds_per_second
    return float(np.exp(np.interp(-error_db, -errors, np.log([p.seconds_per_second for p in line]))))
