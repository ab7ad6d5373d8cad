"""Where the ellipsoid model and the mesh agree, where not, and why: spheroids, segments, the standing body, activities."""

from __future__ import annotations

import numpy as np

from t2d_rt.types import Radar
from validation.bodies import recorded
from validation.physics.ellipsoid_model.activities import ACTIVITIES, JACKS, Activity, activity_of
from validation.physics.ellipsoid_model.report import activity_chart, body_chart, note, segment_chart, spheroid_chart
from validation.physics.ellipsoid_model.spheroids import (
    LIMIT_DB,
    LIMIT_DEG,
    RANGES_M,
    SPHEROIDS_M,
    Spheroid,
    spheroid_errors,
)
from validation.physics.ellipsoid_model.standing import Standing, standing_body
from validation.physics.turntable import (
    Body,
)
from validation.report import Check, Section, at_least, at_most

BODY_LIMIT_DB, SEGMENT_LIMIT_DB = 3.0, 3.0
TORSO_LIMIT_MPS, ENVELOPE_LIMIT = 0.15, 0.7
"""The torso's is the width of two Doppler bins; the correlation that of one half of the variance in common."""


def run() -> Section:
    radar = Radar.preset("table2")
    spheroids = [spheroid_errors(radar, shape, range_m) for shape in SPHEROIDS_M for range_m in RANGES_M]
    body = Body.at(recorded(JACKS), 0.0)
    standing = standing_body(radar, body)
    activities = [activity_of(radar, *each) for each in ACTIVITIES]
    return Section(
        title="The ellipsoid model against the mesh",
        checks=_checks(spheroids, standing, activities),
        note=note(spheroids, standing, activities),
        table=[
            *(_uniform(row, "spheroid") for row in (s.row() for s in spheroids)),
            *(_uniform(row, "standing") for row in standing.rows),
            *(_uniform(a.row(), "activity") for a in activities),
        ],
        charts=[
            spheroid_chart(spheroids),
            segment_chart(standing),
            body_chart(standing),
            *(activity_chart(a) for a in activities),
        ],
    )


def _checks(spheroids: list[Spheroid], standing: Standing, activities: list[Activity]) -> list[Check]:
    differences = [row["difference dB"] for row in standing.rows[:-2]]
    return [
        at_most(
            "ellipsoid against converged facets, spheroids at 1, 3, 10 m, 0 to 180 degrees, amplitude",
            max(float(np.abs(s.level_db).max()) for s in spheroids),
            LIMIT_DB,
            "dB",
        ),
        at_most("the same, phase", max(float(np.abs(s.phase_deg).max()) for s in spheroids), LIMIT_DEG, "degrees"),
        at_most(
            "mean RCS of the standing body, ellipsoids against mesh, without occlusion",
            abs(float(standing.rows[-2]["difference dB"])),
            BODY_LIMIT_DB,
            "dB",
        ),
        at_most(
            "mean RCS of a segment, ellipsoid against its part of the mesh, median over 17",
            float(np.median(np.abs(np.array(differences, float)))),
            SEGMENT_LIMIT_DB,
            "dB",
        ),
        at_most(
            "torso speed of four activities, median over time, difference, worst",
            max(a.torso_mps for a in activities),
            TORSO_LIMIT_MPS,
            "m/s",
        ),
        *(
            at_least(f"envelope of the {a.name}, correlation", a.envelope_correlation, ENVELOPE_LIMIT)
            for a in activities
        ),
    ]


def _uniform(row: dict[str, object], kind: str) -> dict[str, object]:
    """All rows of the section in one table: what was measured, in words."""
    name, *figures = row.items()
    values = "; ".join(f"{key} {_short(value)}" for key, value in figures)
    return {"": kind, "what": name[1], "measured": values}


def _short(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
