"""The Pareto front of points of one panel, and where a setting stands beside it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from validation.chart.measure import Point

GAP_DB, GAP_TIME = 1.0, 0.2
"""What the default setting may be off the front: in error, or in time."""


def front(points: Sequence[Point]) -> list[Point]:
    """Points that no other one beats in both time and error, fastest first."""
    best: list[Point] = []
    for point in sorted(points, key=lambda p: (p.seconds_per_second, p.nmse_db)):
        if not best or point.nmse_db < best[-1].nmse_db:
            best.append(point)
    return best


def gap(points: Sequence[Point], default: Point) -> tuple[float, float]:
    """By how much the default errs more than what is as fast [dB], and takes longer than what is as good [share of that]."""
    as_fast = min(p.nmse_db for p in points if p.seconds_per_second <= default.seconds_per_second)
    as_good = min(p.seconds_per_second for p in points if p.nmse_db <= default.nmse_db)
    return default.nmse_db - as_fast, default.seconds_per_second / as_good - 1


def seconds_at(points: Sequence[Point], error_db: float) -> float:
    """Time at which a method, finer and finer, reaches an error: log of time over dB between the two settings around it; NaN where
    none of them does."""
    line = front(points)
    errors = np.array([p.nmse_db for p in line])
    if not (errors.min() <= error_db <= errors.max()):
        return float("nan") if errors.min() > error_db else line[0].seconds_per_second
    return float(np.exp(np.interp(-error_db, -errors, np.log([p.seconds_per_second for p in line]))))
