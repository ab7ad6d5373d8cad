"""The methods on the chart, each over its knob."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import t2d_rt as t2d
from t2d_rt.recording.recording import Recording
from validation.methods.chart.measure import MEMORY_GB, Case, simulated
from validation.methods.chart.variants import occluded_by_ellipsoids, one_point_each

FINEST_VISIBILITY = {"visibility_rate_hz": 200.0, "visibility_subdivision": 3}
"""Of an `Accuracy`, in place of the default's."""
UNREFINED = 100.0
"""A factor on the body's phase sagitta at which no face is refined."""


@dataclass(frozen=True, slots=True)
class Method:
    """One line of the chart."""

    name: str
    unit: str
    """Of the knob."""
    run: Callable[[Case, Any], Recording]
    values: tuple[Any, ...]
    few: tuple[Any, ...] = ()
    """Values for other motions in free space and the walk in rooms."""
    brief: tuple[Any, ...] = ()
    """Values where other motions are in rooms."""
    rooms_only: bool = False


def by_tolerance(case: Case, tolerance_db: float) -> Recording:
    """Settings that follow from a tolerance; the time to find them is in it, that to measure the error is not."""
    return t2d.simulate(
        case.motion, tolerance_db=tolerance_db, measure_error=False, **{"memory_gb": MEMORY_GB, **case.settings()}
    )


def with_visibility(case: Case, how: str) -> Recording:
    """The default setting with visibility found in another way."""
    if how == "none":
        return simulated(case, accuracy={"occlusion": False})
    if how == "capsules":
        return occluded_by_ellipsoids(case)
    assert how == "finest"
    return simulated(case, accuracy=FINEST_VISIBILITY)


def _ellipsoids(phase_from: str) -> Callable[[Case, float], Recording]:
    return lambda case, rate: simulated(
        case, method="ellipsoid", phase_from=phase_from, accuracy={"surface_rate_hz": rate}
    )


DEFAULT = "facets in closed form", "1"
"""Method and setting, in words, of what `simulate` does when nothing is asked for."""
SUMMED = "facets with one point each, summed chirp by chirp"
"""A method that makes no record (`slow.point_sums`)."""
METHODS = (
    Method("ellipsoids from the centre", "Hz", _ellipsoids("centre"), (25.0, 60.0, 200.0), (60.0,)),
    Method("ellipsoids from the specular point", "Hz", _ellipsoids("specular"), (25.0, 60.0, 200.0), (60.0,), (60.0,)),
    Method("facets with one point each", "m edge", one_point_each, (0.016, 0.008, 0.004, 0.003, 0.0025, 0.002), (0.008,)),
    Method(
        "facets in closed form", "x sagitta", lambda case, scale: simulated(case, scale=scale),
        (UNREFINED, 16.0, 8.0, 4.0, 2.0, 1.0, 0.5, 0.25), (UNREFINED, 4.0, 1.0, 0.5), (4.0, 1.0),
    ),
    Method(
        "surface rate", "Hz", lambda case, rate: simulated(case, accuracy={"surface_rate_hz": rate}),
        (25.0, 40.0, 100.0, 200.0, 400.0), (30.0,),
    ),
    Method("visibility", "", with_visibility, ("none", "capsules", "finest"), ("none", "capsules")),
    Method(
        "wall order", "reflections", lambda case, order: simulated(case, reflections=order), (0, 1, 2, 3), (0, 1, 3),
        (0, 1), rooms_only=True,
    ),
    Method("by tolerance", "dB", by_tolerance, (-10.0, -15.0, -20.0, -25.0, -30.0), (-12.0, -18.0), (-12.0,)),
)  # fmt: skip
