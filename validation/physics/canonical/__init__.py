"""Canonical targets against exact results: where physical optics holds, and what a single bounce leaves out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.types import Radar
from validation.physics import exact
from validation.physics.canonical.curved import (
    axial_sphere,
    cylinder_pattern,
    read_cylinder,
    read_sphere,
    sphere_ratio,
    spheroid_tip,
)
from validation.physics.canonical.flat import (
    dihedral_pattern,
    near_plate_pattern,
    plate_pattern,
    room_corner,
    trihedral_pattern,
)
from validation.physics.canonical.pattern import BODY_KA, FACET_KA, KA, LIMIT_DB, ORIENTATIONS, Pattern, worst_db
from validation.physics.canonical.report import corner_chart, ka_chart, note, pattern_chart, width_chart
from validation.physics.turntable import db
from validation.report import Check, Section, at_most

MIE_TRUTH = ((1.028, 3.65495), (2.0, 1.00814), (5.0, 1.16884), (10.0, 0.92923), (50.0, 0.99592))
"""sigma / (pi a^2) at ka; docs/physics.md, eq. 6."""
LARGE_KA = 10.0
"""From here on the facets are held to the exact sums of physical optics."""
CYLINDER_RANGES_M = (3.0, 10.0, 30.0)
SYMMETRIC_KA = (100.0, 190.4)
"""Spheres whose facets' lattice, seen along its axis of symmetry, returns lobes that add up."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Read:
    """Rows of the table: what was read from ADC cubes."""

    spheres: list[dict[str, object]]
    cylinders: list[dict[str, object]]
    room: list[dict[str, object]]


def run() -> Section:
    radar = Radar.preset("table2")
    mie = np.array([exact.mie(ka) for ka in KA])
    optics_error = db(exact.sphere_optics(KA) / mie)
    facets = np.array([sphere_ratio(radar, ka) for ka in FACET_KA])
    facet_error = db(facets / exact.sphere_optics(FACET_KA)[:, None])
    valid = {limit: _valid_from(KA, optics_error, limit) for limit in (1.0, LIMIT_DB)}
    widths = {along: np.array([exact.cylinder_width(ka, along=along) for ka in KA]) for along in (True, False)}
    width_error = {along: db(exact.cylinder_width_optics(KA) / width) for along, width in widths.items()}
    axial = [axial_sphere(radar, ka) for ka in SYMMETRIC_KA]
    plates = [plate_pattern(radar), near_plate_pattern(radar), cylinder_pattern(radar)]
    dihedral = dihedral_pattern(radar)
    corners = [dihedral, *(trihedral_pattern(radar, triangular=each) for each in (False, True))]
    spheres = [read_sphere(ka) for ka in (30, 100, 300, 900)]
    cylinders = [read_cylinder(range_m) for range_m in CYLINDER_RANGES_M]
    room = [room_corner(radar, walls) for walls in (2, 3)]
    read = Read(spheres=spheres, cylinders=cylinders, room=room)
    return Section(
        title="Canonical targets against exact results",
        checks=_checks(radar, valid, facet_error, [*plates, dihedral], read),
        note=note(
            valid, {along: _valid_from(KA, error, LIMIT_DB) for along, error in width_error.items()}, corners, plates[1]
        ),
        table=[*spheres, *axial, *cylinders, *(p.row() for p in corners), *room],
        charts=[
            ka_chart(mie, optics_error, facets, facet_error),
            width_chart(width_error),
            pattern_chart(*plates),
            corner_chart(corners),
        ],
    )


def _checks(
    radar: Radar, valid: dict[float, float], facet_error: np.ndarray, patterns: list[Pattern], read: Read
) -> list[Check]:
    return [
        at_most(
            "Mie series against tabled values, ka 1.028 to 50, worst",
            max(abs(exact.mie(ka) / value - 1) for ka, value in MIE_TRUTH),
            1e-5,
        ),
        at_most("physical optics within 1 dB of Mie from ka", valid[1.0], 10),
        at_most("physical optics within 0.3 dB of Mie from ka", valid[LIMIT_DB], BODY_KA[0]),
        at_most(
            f"spheres of facets against exact physical optics, ka >= {LARGE_KA:g}, {ORIENTATIONS} sides, worst",
            float(np.abs(facet_error[FACET_KA >= LARGE_KA]).max()),
            LIMIT_DB,
            "dB",
        ),
        at_most("spheres read from the ADC cube against Mie, ka 30 to 900", worst_db(read.spheres), LIMIT_DB, "dB"),
        at_most("cylinder read from the ADC cube, broadside at 3, 10, 30 m", worst_db(read.cylinders), LIMIT_DB, "dB"),
        *(at_most(f"{p.name}, {p.span} to -{p.shown_db:g} dB", p.worst_db, LIMIT_DB, "dB") for p in patterns),
        at_most("spheroid 8 x 22 cm end on, far away, against its exact sum", spheroid_tip(radar), LIMIT_DB, "dB"),
        at_most("corners of two and of three metal walls of a room, image theory", worst_db(read.room), 0.01, "dB"),
    ]


def _valid_from(ka: np.ndarray, error_db: np.ndarray, limit_db: float) -> float:
    """The ka beyond which the error stays within a limit."""
    outside = np.flatnonzero(np.abs(error_db) > limit_db)
    return float(ka[outside[-1] + 1]) if len(outside) else float(ka[0])
