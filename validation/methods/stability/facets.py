"""Facets: their size, small phase differences, grazing, and triangles of no area; with `distances`, near and far field."""

from __future__ import annotations

import math
from pathlib import Path

import mpmath
import numpy as np
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from t2d_rt.scattering.phase_integral import divided_difference
from t2d_rt.types import MovingMesh, Radar
from validation.methods.stability.case import Case, Theme
from validation.methods.stability.distances import caustic, close_by, inside, near_field, plate
from validation.methods.stability.targets import SPHERE_M, ball, ball_rcs, decibel, measured_rcs, static_mesh
from validation.physics.rcs import sphere
from validation.report import FOLDER, at_least, at_most, new_figure, save_chart

RANGE_M, ORIENTATIONS = 10.0, 8
SIZES = (3, 4, 5, 6, 7)
"""Subdivisions of the icosahedron: 1 280 to 328 000 faces."""
WIDTHS_RAD = tuple(10.0**n for n in range(-10, 2))


def theme() -> Theme:
    radar = Radar.preset("table2")
    size, size_chart = facet_size(radar)
    differences, differences_chart = small_differences()
    plate, plate_chart = near_field(radar)
    bowl, bowl_chart = caustic(radar)
    cases = [size, *differences, *plate, close_by(radar), inside(radar), bowl, *tangent(radar), degenerate(radar)]
    return Theme(cases=cases, charts=[size_chart, differences_chart, plate_chart, bowl_chart])


def facet_size(radar: Radar) -> tuple[Case, str]:
    """A conducting sphere as a user's mesh of 1 280 faces gives it."""
    errors: dict[str, list[float]] = {"one point per facet": [], "closed form per facet": []}
    edges = []
    for subdivisions in SIZES:
        unit, faces = sphere(SPHERE_M, np.zeros(3), subdivisions)
        edges.append(float(np.linalg.norm(unit[faces[:, 0]] - unit[faces[:, 1]], axis=1).mean()) / radar.wavelength_m)
        for name, found in errors.items():
            orientations = ORIENTATIONS if subdivisions < SIZES[-1] else 2
            each = [
                _facet_sum(_rotated(unit, seed), faces, radar, name.startswith("closed"))
                for seed in range(orientations)
            ]
            error = decibel(np.array(each) / ball_rcs(SPHERE_M, RANGE_M))
            found.append(float(np.sqrt(np.mean(error**2))))
    unit, faces = sphere(SPHERE_M, np.zeros(3), SIZES[0])
    ours = [
        decibel(measured_rcs(static_mesh(vertices, faces), radar, RANGE_M) / ball_rcs(SPHERE_M, RANGE_M))
        for vertices in (_placed(_rotated(unit, seed), radar) for seed in range(ORIENTATIONS))
    ]
    rms = float(np.sqrt(np.mean(np.square(ours))))
    case = Case(
        f"facets of {edges[0]:.1f} wavelengths, sphere",
        at_least("one point per facet, RMS over 8 orientations", errors["one point per facet"][0], 10, "dB"),
        at_most("the same mesh, refined on its curved surface", rms, 0.3, "dB"),
    )
    figure, axis = new_figure()
    for (name, found), mark in zip(errors.items(), ("o-", "s-"), strict=True):
        axis.loglog(edges, found, mark, label=name)
    axis.plot(edges[0], rms, "k*", markersize=12, label="t2d_rt, given the coarsest mesh")
    axis.axvline(0.5, color="grey", linestyle=":", label="half a wavelength")
    axis.axhline(0.3, color="C3", linestyle=":", label="limit")
    ticks = (0.5, 1, 2, 4, 8)
    axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.minorticks_off()
    axis.set(
        xlabel="mean edge of the mesh [wavelengths]", ylabel="RMS error of RCS [dB]", xlim=(0.3, 8), ylim=(5e-3, 1e3)
    )
    axis.set_title(f"sphere of {SPHERE_M * 100:g} cm radius at {RANGE_M:g} m, up to {ORIENTATIONS} orientations")
    axis.legend(fontsize=8, loc="upper left", ncols=2)
    axis.grid(alpha=0.3, which="both")
    return case, save_chart(figure, "stability_facets.png")


def _rotated(vertices: np.ndarray, seed: int) -> np.ndarray:
    return Rotation.random(rng=np.random.default_rng(seed)).apply(vertices)


def _placed(vertices: np.ndarray, radar: Radar) -> np.ndarray:
    return vertices + radar.tx_position_m + [RANGE_M + SPHERE_M, 0, 0]


def _facet_sum(vertices: np.ndarray, faces: np.ndarray, radar: Radar, closed: bool) -> float:
    """RCS [m^2] by eq. 3 over the facets as they are: their phase integrals, or their areas at the phases of their middles."""
    a, b, c = (_placed(vertices, radar)[faces[:, i]] - radar.tx_position_m for i in range(3))
    middle = (a + b + c) / 3
    range_m = np.linalg.norm(middle, axis=1)
    weight = np.maximum(-np.sum(np.cross(b - a, c - a) * middle, axis=1), 0) / range_m**3  # 2 A (n.r) / R^2
    k = 2 * math.pi / radar.wavelength_m
    carrier = np.exp(2j * k * range_m)
    if closed:
        phases = [2 * k * (np.linalg.norm(corner, axis=1) - range_m) for corner in (a, b, c)]
        field = np.sum(weight * carrier * divided_difference(*phases))
    else:
        field = np.sum(weight * carrier) / 2
    return float(4 * math.pi / radar.wavelength_m**2 * abs(field) ** 2 * RANGE_M**4)


def small_differences(folder: Path = FOLDER) -> tuple[list[Case], str]:
    """exp[jp0, jp1, jp2] by its plain formula and by ours, on the same rounded phases, against 60 digits."""
    rng = np.random.default_rng(0)
    patterns = rng.uniform(-1, 1, (20, 3))
    worst: dict[tuple[str, type], list[float]] = {}
    for dtype in (np.float32, np.float64):
        for width in WIDTHS_RAD:
            phases = (0.7 + width * patterns).astype(dtype)
            # Rounded to one number they are a point, which only the plain formula cannot do: that is the tangent case.
            phases = phases[[len(set(row)) == 3 for row in phases.tolist()]]
            exact = _exact(phases)
            for name, method in (("plain", _plain), ("ours", divided_difference)):
                error = np.abs(method(*phases.T) - exact) / np.abs(exact)
                worst.setdefault((name, dtype), []).append(float(np.max(error, initial=0)))
    cases = [
        Case(
            f"small phase differences, {dtype.__name__}",
            at_least("plain divided difference", max(worst["plain", dtype]), 1, "of the value"),
            at_most("series where they are small", max(worst["ours", dtype]), limit, "of the value"),
        )
        for dtype, limit in ((np.float32, 1e-5), (np.float64, 1e-12))
    ]
    figure, axis = new_figure()
    for (name, dtype), errors in worst.items():
        known = np.array(errors) > 0
        style = f"C{int(dtype is np.float64)}{'o--' if name == 'plain' else 's-'}"
        axis.loglog(np.array(WIDTHS_RAD)[known], np.array(errors)[known], style, label=f"{name}, {dtype.__name__}")
    axis.axhline(1, color="grey", linestyle=":")
    axis.set(xlabel="phase differences within a facet [rad]", ylabel="worst relative error", ylim=(1e-17, 1e9))
    axis.set_title("phase integral of a facet against 60 digits")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
    return cases, save_chart(figure, "stability_differences.png", folder)


def _plain(p0: np.ndarray, p1: np.ndarray, p2: np.ndarray) -> np.ndarray:
    """The textbook's form of eq. 4."""
    z = [1j * p for p in (p0, p1, p2)]
    return np.sum([np.exp(z[i]) / ((z[i] - z[i - 1]) * (z[i] - z[i - 2])) for i in range(3)], axis=0)


def _exact(phases: np.ndarray) -> np.ndarray:
    with mpmath.workdps(60):
        rows = [[mpmath.mpc(0, x) for x in row] for row in phases.tolist()]
        return np.array(
            [complex(sum(mpmath.exp(z[i]) / ((z[i] - z[i - 1]) * (z[i] - z[i - 2])) for i in range(3))) for z in rows]
        )


def tangent(radar: Radar) -> list[Case]:
    """A plate seen exactly from its edge: two corners stand at the same range, and the cosine is zero."""
    vertices, faces = plate(3.0, radar, 90.0)
    vertices[:, 1] = radar.tx_position_m[1]  # to the last bit
    ranges = np.linalg.norm(vertices - radar.tx_position_m, axis=1)
    with np.errstate(all="ignore"):
        plain = _plain(*(4 * math.pi / radar.wavelength_m * ranges[faces[:, i]] for i in range(3)))
    samples = t2d.simulate(static_mesh(vertices, faces), radar=radar).cube[0, 0]
    ends = (t2d.simulate(static_mesh(*plate(3.0, radar, 90 + 1e-4 * side)), radar=radar).cube[0, 0] for side in (-1, 1))
    broadside = t2d.simulate(static_mesh(*plate(3.0, radar)), radar=radar).cube[0, 0]
    jump = max(float(np.abs(samples - each).max() / np.abs(broadside).max()) for each in ends)
    return [
        Case(
            "exactly tangent: a plate seen from its edge",
            at_least(
                "plain divided difference, fraction of facets that are NaN",
                float(np.mean(~np.isfinite(plain))),
                1,
                "of all",
            ),
            at_most("fraction of samples that are NaN", float(np.mean(~np.isfinite(samples))), 0, "of all"),
        ),
        Case(
            "through grazing, from -0.0001 to 0.0001 degrees",
            at_least("a lit triangle counts by its area, jump of the field", _area_jump(radar), 1e-3, "of broadside"),
            at_most("jump of the field", jump, 1e-6, "of broadside"),
        ),
    ]


def _area_jump(radar: Radar) -> float:
    """Jump, relative to broadside, of a sum that takes lit triangles' areas without the cosine."""

    def field(rotated_deg: float) -> float:
        vertices, faces = plate(3.0, radar, rotated_deg)
        a, b, c = (vertices[faces[:, i]] - radar.tx_position_m for i in range(3))
        phases = (4 * math.pi / radar.wavelength_m * np.linalg.norm(corner, axis=1) for corner in (a, b, c))
        doubled = np.cross(b - a, c - a)
        lit = np.sum(doubled * a, axis=1) < 0
        return float(abs(np.sum(lit * np.linalg.norm(doubled, axis=1) * divided_difference(*phases))))

    return abs(field(90 - 1e-4) - field(90 + 1e-4)) / field(0)


def degenerate(radar: Radar, range_m: float = 3.0) -> Case:
    """A sphere with edges collapsed to points, triangles pulled to slivers and faces that name a corner twice."""
    vertices, faces = ball(radar, SPHERE_M, range_m, 3)
    rng = np.random.default_rng(0)
    for face in rng.choice(len(faces), 30, replace=False):
        vertices[faces[face, 1]] = vertices[faces[face, 0]]
    for face in rng.choice(len(faces), 10, replace=False):
        vertices[faces[face, 1]] = (vertices[faces[face, 0]] + vertices[faces[face, 2]]) / 2
    faces = np.concatenate([faces, faces[:40, [0, 0, 1]]])
    a, b, c = (vertices[faces[:, i]] - radar.tx_position_m for i in range(3))
    doubled = np.cross(b - a, c - a)
    with np.errstate(invalid="ignore"):
        normal = doubled / np.linalg.norm(doubled, axis=1, keepdims=True)
    naive = np.sum(np.maximum(np.sum(normal * -a, axis=1), 0))
    mesh: MovingMesh = static_mesh(vertices, faces)
    samples = t2d.simulate(mesh, radar=radar).cube[0, 0]
    error = abs(decibel(measured_rcs(mesh, radar, range_m) / ball_rcs(SPHERE_M, range_m)))
    return Case(
        "triangles of no area",
        at_least("normals by division, fraction of sums that are NaN", float(np.isnan(naive)), 1, "of all"),
        at_most(
            "the same mesh with slivers, collapsed edges and double corners, of the whole sphere",
            float(error) if np.isfinite(samples).all() else math.nan,
            1,
            "dB",
        ),
    )
