"""Plates near by and far away, targets at and around the radar, a bowl about its caustic."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from t2d_rt.types import Radar
from validation.methods.stability.case import Case
from validation.methods.stability.targets import SPHERE_M, ball, ball_rcs, decibel, measured_rcs, static_mesh
from validation.physics.rcs import PLATE_M, plate_rcs
from validation.report import at_least, at_most, new_figure, save_chart

PLATE_RANGES_M = (1.0, 3.0, 10.0)
NEAR_RANGES_M = (0.05, 0.1, 0.2, 0.3)
BOWL_M, BOWL_HALF_M = 1.0, 0.05
"""Radius of curvature, and half the width across."""
BOWL_RANGES_M = (0.5, 0.6, 0.75, 0.9, 1.0, 1.1, 1.3, 1.6, 2.0)


def plate(range_m: float, radar: Radar, normal_deg: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Two triangles of 10 cm, turned about the vertical from facing the radar."""
    half = PLATE_M / 2
    corners = np.array([[0, -half, -half], [0, half, -half], [0, half, half], [0, -half, half]])
    rotated = Rotation.from_euler("z", normal_deg, degrees=True).apply(corners)
    return rotated + radar.tx_position_m + [range_m, 0, 0], np.array([[0, 2, 1], [0, 3, 2]])


def near_field(radar: Radar) -> tuple[list[Case], str]:
    far = 4 * math.pi * PLATE_M**4 / radar.wavelength_m**2
    exact = [plate_rcs(range_m, radar.wavelength_m) for range_m in PLATE_RANGES_M]
    ours = [measured_rcs(static_mesh(*plate(range_m, radar)), radar, range_m) for range_m in PLATE_RANGES_M]
    cases = [
        Case(
            f"near field, plate of 10 cm at {PLATE_RANGES_M[0]:g} m",
            at_least("4 pi A^2 / lambda^2", abs(decibel(far / exact[0])), 10, "dB"),
            at_most("facets with the vertices' exact ranges", abs(decibel(ours[0] / exact[0])), 0.3, "dB"),
        ),
        Case(
            "near field, the same at 3 m",
            at_least("4 pi A^2 / lambda^2", abs(decibel(far / exact[1])), 1, "dB"),
            at_most(
                "facets with the vertices' exact ranges",
                max(abs(decibel(m / e)) for m, e in zip(ours[1:], exact[1:], strict=True)),
                0.3,
                "dB",
            ),
        ),
    ]
    ranges = np.geomspace(0.3, 30, 120)
    figure, axis = new_figure()
    axis.semilogx(
        ranges,
        [decibel(plate_rcs(r, radar.wavelength_m)) for r in ranges],
        "k-",
        label="physical optics, 0.25 mm cells",
    )
    axis.axhline(decibel(far), color="C1", linestyle="--", label="far field: 4 pi A^2 / lambda^2")
    axis.semilogx(PLATE_RANGES_M, [decibel(x) for x in ours], "o", label="t2d_rt, from ADC samples")
    axis.axvline(
        2 * 2 * PLATE_M**2 / radar.wavelength_m, color="grey", linestyle=":", label="2 D^2 / lambda, D the diagonal"
    )
    axis.set(xlabel="range [m]", ylabel="RCS [dBsm]", title="plate of 10 cm, broadside")
    axis.legend(fontsize=8, loc="lower right")
    axis.grid(alpha=0.3, which="both")
    return cases, save_chart(figure, "stability_near_field.png")


def close_by(radar: Radar) -> Case:
    errors = [
        abs(decibel(measured_rcs(static_mesh(*ball(radar, SPHERE_M, r)), radar, r) / ball_rcs(SPHERE_M, r)))
        for r in NEAR_RANGES_M
    ]
    nearest = NEAR_RANGES_M[0]
    return Case(
        "radar 5 to 30 cm from a sphere of 15 cm",
        at_least("pi a^2, the far field's", abs(decibel(math.pi * SPHERE_M**2 / ball_rcs(SPHERE_M, nearest))), 6, "dB"),
        at_most("facets, worst of four ranges", max(errors), 0.3, "dB"),
    )


def inside(radar: Radar) -> Case:
    """A radar inside a body: cosines with outward normals leave nothing lit, and the target vanishes without a word."""
    vertices, faces = ball(radar, SPHERE_M, -SPHERE_M)
    normals = np.cross(*(vertices[faces[:, i]] - vertices[faces[:, 0]] for i in (1, 2)))
    lit = np.mean(np.sum(normals * (radar.tx_position_m - vertices[faces[:, 0]]), axis=1) > 0)
    try:
        t2d.simulate(static_mesh(vertices, faces), radar=radar)
        refused = False
    except t2d.InputError as error:
        refused = "is inside" in str(error)
    return Case(
        "radar inside a body",
        at_least("lit faces only: none, and no word of it", 1 - float(lit), 1, "of cases silent"),
        at_most("refused in one sentence", float(not refused), 0, "of cases silent"),
    )


def bowl(range_m: float, radar: Radar, rings: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """A concave spherical cap open to the radar, its deepest point `range_m` away."""
    edge = math.asin(BOWL_HALF_M / BOWL_M)
    points, faces = [[0.0, 0.0, 0.0]], []
    spokes = 24
    for ring in range(1, rings + 1):
        angle = edge * ring / rings
        for spoke in range(spokes):
            angle_rad = 2 * math.pi * spoke / spokes
            across = BOWL_M * math.sin(angle)
            points.append([-BOWL_M * (1 - math.cos(angle)), across * math.cos(angle_rad), across * math.sin(angle_rad)])
            here, there = 1 + (ring - 1) * spokes + spoke, 1 + (ring - 1) * spokes + (spoke + 1) % spokes
            faces += (
                [[0, there, here]]
                if ring == 1
                else [[here - spokes, there, here], [here - spokes, there - spokes, there]]
            )
    return np.array(points) + radar.tx_position_m + [range_m, 0, 0], np.array(faces)


def bowl_rcs(range_m: float, wavelength_m: float, cells: int = 20_000) -> float:
    """Physical optics, 4 pi/lambda^2 |int cos (R_0/R)^2 exp(2jkR) dA|^2, by rings of the cap."""
    edge = math.asin(BOWL_HALF_M / BOWL_M)
    angle = (np.arange(cells) + 0.5) / cells * edge
    along, across = range_m - BOWL_M * (1 - np.cos(angle)), BOWL_M * np.sin(angle)
    distance = np.hypot(along, across)
    cosine = (along * np.cos(angle) + across * -np.sin(angle)) / distance
    area = 2 * math.pi * BOWL_M**2 * np.sin(angle) * edge / cells
    phase = np.exp(4j * math.pi / wavelength_m * distance)
    field = np.sum(cosine * (range_m / distance) ** 2 * phase * area)
    return 4 * math.pi / wavelength_m**2 * abs(field) ** 2


def bowl_rays_rcs(range_m: float | np.ndarray) -> float | np.ndarray:
    """Geometrical optics, eq. 8 with negative radii: infinite at the centre of curvature."""
    return math.pi * BOWL_M**2 / (1 - BOWL_M / range_m) ** 2


def caustic(radar: Radar) -> tuple[Case, str]:
    ours = [measured_rcs(static_mesh(*bowl(range_m, radar)), radar, range_m) for range_m in BOWL_RANGES_M]
    exact = [bowl_rcs(range_m, radar.wavelength_m) for range_m in BOWL_RANGES_M]
    area = 2 * math.pi * BOWL_M**2 * (1 - math.cos(math.asin(BOWL_HALF_M / BOWL_M)))
    closed = 4 * math.pi * area**2 / radar.wavelength_m**2
    middle = BOWL_RANGES_M.index(BOWL_M)
    case = Case(
        "caustic: 1 mm from a bowl's centre of curvature",
        at_least("geometrical optics", decibel(bowl_rays_rcs(BOWL_M + 1e-3) / closed), 20, "dB"),
        at_most(
            "facets at the centre, against 4 pi A^2 / lambda^2, and at eight ranges about it",
            max(abs(decibel(ours[middle] / closed)), *(abs(decibel(m / e)) for m, e in zip(ours, exact, strict=True))),
            0.3,
            "dB",
        ),
    )
    ranges = np.linspace(0.45, 2.1, 800)
    figure, axis = new_figure()
    axis.plot(
        ranges, [decibel(bowl_rcs(r, radar.wavelength_m)) for r in ranges], "k-", label="physical optics, by rings"
    )
    axis.plot(ranges, decibel(bowl_rays_rcs(ranges)), "C1--", label="geometrical optics")
    axis.plot(BOWL_RANGES_M, [decibel(x) for x in ours], "o", label="t2d_rt, from ADC samples")
    axis.axhline(decibel(closed), color="grey", linestyle=":", label="4 pi A^2 / lambda^2")
    axis.set(xlabel="range of the bowl's middle [m]", ylabel="RCS [dBsm]", ylim=(-10, 60))
    axis.set_title(f"bowl of {2 * BOWL_HALF_M * 100:g} cm across, radius of curvature {BOWL_M:g} m")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
    return case, save_chart(figure, "stability_caustic.png")
