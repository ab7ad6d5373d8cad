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
from validation.report import Check, Section

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
        Check(
            what="ellipsoid against converged facets, spheroids at 1, 3, 10 m, 0 to 180 degrees, amplitude",
            measured=max(float(np.abs(s.level_db).max()) for s in spheroids),
            limit=LIMIT_DB,
            unit="dB",
        ),
        Check(
            what="the same, phase",
            measured=max(float(np.abs(s.phase_deg).max()) for s in spheroids),
            limit=LIMIT_DEG,
            unit="degrees",
        ),
        Check(
            what="mean RCS of the standing body, ellipsoids against mesh, without occlusion",
            measured=abs(float(standing.rows[-2]["difference dB"])),
            limit=BODY_LIMIT_DB,
            unit="dB",
        ),
        Check(
            what="mean RCS of a segment, ellipsoid against its part of the mesh, median over 17",
            measured=float(np.median(np.abs(np.array(differences, float)))),
            limit=SEGMENT_LIMIT_DB,
            unit="dB",
        ),
        Check(
            what="torso speed of four activities, median over time, difference, worst",
            measured=max(a.torso_mps for a in activities),
            limit=TORSO_LIMIT_MPS,
            unit="m/s",
        ),
        *(
            Check(
                what=f"envelope of the {a.name}, correlation",
                measured=a.envelope_correlation,
                limit=ENVELOPE_LIMIT,
                unit="",
                at_least=True,
            )
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
