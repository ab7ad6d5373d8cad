"""Facets: their size, small phase differences, near and far field, caustics, grazing, and triangles of no area."""

from __future__ import annotations

import math

import mpmath
import numpy as np
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from t2d_rt.scattering.phase_integral import divided_difference
from t2d_rt.types import MovingMesh, Radar
from validation.methods.stability.case import Case, Theme
from validation.methods.stability.targets import ball, ball_rcs, decibel, measured_rcs, still
from validation.physics.rcs import PLATE_M, plate_rcs, sphere
from validation.report import new_figure, save_chart

SPHERE_M, RANGE_M, TURNS = 0.15, 10.0, 8
SIZES = (3, 4, 5, 6, 7)
"""Subdivisions of the icosahedron: 1 280 to 328 000 faces."""
WIDTHS_RAD = tuple(10.0**n for n in range(-10, 2))
PLATE_RANGES_M = (1.0, 3.0, 10.0)
NEAR_RANGES_M = (0.05, 0.1, 0.2, 0.3)
BOWL_M, BOWL_HALF_M = 1.0, 0.05
"""Radius of curvature, and half the width across."""
BOWL_RANGES_M = (0.5, 0.6, 0.75, 0.9, 1.0, 1.1, 1.3, 1.6, 2.0)


def theme() -> Theme:
    radar = Radar.preset("table2")
    size, size_chart = facet_size(radar)
    differences, differences_chart = small_differences()
    plate, plate_chart = near_field(radar)
    bowl, bowl_chart = caustic(radar)
    cases = [size, *differences, *plate, close_by(radar), inside(radar), bowl, *tangent(radar), degenerate(radar)]
    return Theme(cases=cases, charts=[size_chart, differences_chart, plate_chart, bowl_chart])


# --- size against wavelength ----------------------------------------------------------------------------------------


def facet_size(radar: Radar) -> tuple[Case, str]:
    """A conducting sphere as a user's mesh of 1 280 faces gives it."""
    errors: dict[str, list[float]] = {"one point per facet": [], "closed form per facet": []}
    edges = []
    for subdivisions in SIZES:
        unit, faces = sphere(SPHERE_M, np.zeros(3), subdivisions)
        edges.append(float(np.linalg.norm(unit[faces[:, 0]] - unit[faces[:, 1]], axis=1).mean()) / radar.wavelength_m)
        for name, found in errors.items():
            turns = TURNS if subdivisions < SIZES[-1] else 2
            each = [_facet_sum(_turned(unit, seed), faces, radar, name.startswith("closed")) for seed in range(turns)]
            error = decibel(np.array(each) / ball_rcs(SPHERE_M, RANGE_M))
            found.append(float(np.sqrt(np.mean(error**2))))
    unit, faces = sphere(SPHERE_M, np.zeros(3), SIZES[0])
    ours = [
        decibel(measured_rcs(still(_placed(_turned(unit, seed), radar), faces), radar, RANGE_M) / ball_rcs(SPHERE_M, RANGE_M))
        for seed in range(TURNS)
    ]  # fmt: skip
    rms = float(np.sqrt(np.mean(np.square(ours))))
    case = Case(
        name=f"facets of {edges[0]:.1f} wavelengths, sphere",
        failing="one point per facet, RMS over 8 orientations",
        failing_error=errors["one point per facet"][0],
        fails_by=10,
        ours="the same mesh, refined on its curved surface",
        error=rms,
        bar=0.3,
        unit="dB",
    )
    figure, axis = new_figure()
    for (name, found), mark in zip(errors.items(), ("o-", "s-"), strict=True):
        axis.loglog(edges, found, mark, label=name)
    axis.plot(edges[0], rms, "k*", markersize=12, label="t2d_rt, given the coarsest mesh")
    axis.axvline(0.5, color="grey", linestyle=":", label="half a wavelength")
    axis.axhline(0.3, color="C3", linestyle=":", label="bar")
    ticks = (0.5, 1, 2, 4, 8)
    axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.minorticks_off()
    axis.set(
        xlabel="mean edge of the mesh [wavelengths]", ylabel="RMS error of RCS [dB]", xlim=(0.3, 8), ylim=(5e-3, 1e3)
    )
    axis.set_title(f"sphere of {SPHERE_M * 100:g} cm radius at {RANGE_M:g} m, up to {TURNS} orientations")
    axis.legend(fontsize=8, loc="upper left", ncols=2)
    axis.grid(alpha=0.3, which="both")
    return case, save_chart(figure, "stability_facets.png")


def _turned(vertices: np.ndarray, seed: int) -> np.ndarray:
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
    turn = np.exp(2j * k * range_m)
    if closed:
        phases = [2 * k * (np.linalg.norm(corner, axis=1) - range_m) for corner in (a, b, c)]
        field = np.sum(weight * turn * divided_difference(*phases))
    else:
        field = np.sum(weight * turn) / 2
    return float(4 * math.pi / radar.wavelength_m**2 * abs(field) ** 2 * RANGE_M**4)


# --- small phase differences ----------------------------------------------------------------------------------------


def small_differences() -> tuple[list[Case], str]:
    """exp[jp0, jp1, jp2] by its plain formula and by ours, on the same rounded phases, against 60 digits."""
    rng = np.random.default_rng(0)
    shapes = rng.uniform(-1, 1, (20, 3))
    worst: dict[tuple[str, type], list[float]] = {}
    for dtype in (np.float32, np.float64):
        for width in WIDTHS_RAD:
            phases = (0.7 + width * shapes).astype(dtype)
            # Rounded to one number they are a point, which only the plain formula cannot do: that is the tangent case.
            phases = phases[[len(set(row)) == 3 for row in phases.tolist()]]
            exact = _exact(phases)
            for name, method in (("plain", _plain), ("ours", divided_difference)):
                error = np.abs(method(*phases.T) - exact) / np.abs(exact)
                worst.setdefault((name, dtype), []).append(float(np.max(error, initial=0)))
    cases = [
        Case(
            name=f"small phase differences, {dtype.__name__}",
            failing="plain divided difference",
            failing_error=max(worst["plain", dtype]),
            fails_by=1,
            ours="series where they are small",
            error=max(worst["ours", dtype]),
            bar=bar,
            unit="of the value",
        )
        for dtype, bar in ((np.float32, 1e-5), (np.float64, 1e-12))
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
    return cases, save_chart(figure, "stability_differences.png")


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


# --- near and far ---------------------------------------------------------------------------------------------------


def plate(range_m: float, radar: Radar, normal_deg: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Two triangles of 10 cm, turned about the vertical from facing the radar."""
    half = PLATE_M / 2
    corners = np.array([[0, -half, -half], [0, half, -half], [0, half, half], [0, -half, half]])
    turned = Rotation.from_euler("z", normal_deg, degrees=True).apply(corners)
    return turned + radar.tx_position_m + [range_m, 0, 0], np.array([[0, 2, 1], [0, 3, 2]])


def near_field(radar: Radar) -> tuple[list[Case], str]:
    far = 4 * math.pi * PLATE_M**4 / radar.wavelength_m**2
    exact = [plate_rcs(range_m, radar.wavelength_m) for range_m in PLATE_RANGES_M]
    ours = [measured_rcs(still(*plate(range_m, radar)), radar, range_m) for range_m in PLATE_RANGES_M]
    cases = [
        Case(
            name=f"near field, plate of 10 cm at {PLATE_RANGES_M[0]:g} m",
            failing="4 pi A^2 / lambda^2",
            failing_error=abs(decibel(far / exact[0])),
            fails_by=10,
            ours="facets with the vertices' exact ranges",
            error=abs(decibel(ours[0] / exact[0])),
            bar=0.3,
            unit="dB",
        ),
        Case(
            name="near field, the same at 3 m",
            failing="4 pi A^2 / lambda^2",
            failing_error=abs(decibel(far / exact[1])),
            fails_by=1,
            ours="facets with the vertices' exact ranges",
            error=max(abs(decibel(m / e)) for m, e in zip(ours[1:], exact[1:], strict=True)),
            bar=0.3,
            unit="dB",
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
        abs(decibel(measured_rcs(still(*ball(radar, SPHERE_M, r)), radar, r) / ball_rcs(SPHERE_M, r)))
        for r in NEAR_RANGES_M
    ]
    nearest = NEAR_RANGES_M[0]
    return Case(
        name="radar 5 to 30 cm from a sphere of 15 cm",
        failing="pi a^2, the far field's",
        failing_error=abs(decibel(math.pi * SPHERE_M**2 / ball_rcs(SPHERE_M, nearest))),
        fails_by=6,
        ours="facets, worst of four ranges",
        error=max(errors),
        bar=0.3,
        unit="dB",
    )


def inside(radar: Radar) -> Case:
    """A radar inside a body: cosines with outward normals leave nothing lit, and the target vanishes without a word."""
    vertices, faces = ball(radar, SPHERE_M, -SPHERE_M)
    normals = np.cross(*(vertices[faces[:, i]] - vertices[faces[:, 0]] for i in (1, 2)))
    lit = np.mean(np.sum(normals * (radar.tx_position_m - vertices[faces[:, 0]]), axis=1) > 0)
    try:
        t2d.simulate(still(vertices, faces), radar=radar)
        refused = False
    except t2d.InputError as error:
        refused = "is inside" in str(error)
    return Case(
        name="radar inside a body",
        failing="lit faces only: none, and no word of it",
        failing_error=1 - float(lit),
        fails_by=1,
        ours="refused in one sentence",
        error=float(not refused),
        bar=0,
        unit="of cases silent",
    )


# --- caustics -------------------------------------------------------------------------------------------------------


def bowl(range_m: float, radar: Radar, rings: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """A concave spherical cap open to the radar, its deepest point `range_m` away."""
    edge = math.asin(BOWL_HALF_M / BOWL_M)
    points, faces = [[0.0, 0.0, 0.0]], []
    spokes = 24
    for ring in range(1, rings + 1):
        angle = edge * ring / rings
        for spoke in range(spokes):
            turn = 2 * math.pi * spoke / spokes
            across = BOWL_M * math.sin(angle)
            points.append([-BOWL_M * (1 - math.cos(angle)), across * math.cos(turn), across * math.sin(turn)])
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
    ours = [measured_rcs(still(*bowl(range_m, radar)), radar, range_m) for range_m in BOWL_RANGES_M]
    exact = [bowl_rcs(range_m, radar.wavelength_m) for range_m in BOWL_RANGES_M]
    area = 2 * math.pi * BOWL_M**2 * (1 - math.cos(math.asin(BOWL_HALF_M / BOWL_M)))
    closed = 4 * math.pi * area**2 / radar.wavelength_m**2
    middle = BOWL_RANGES_M.index(BOWL_M)
    case = Case(
        name="caustic: 1 mm from a bowl's centre of curvature",
        failing="geometrical optics",
        failing_error=decibel(bowl_rays_rcs(BOWL_M + 1e-3) / closed),
        fails_by=20,
        ours="facets at the centre, against 4 pi A^2 / lambda^2, and at eight ranges about it",
        error=max(
            abs(decibel(ours[middle] / closed)), *(abs(decibel(m / e)) for m, e in zip(ours, exact, strict=True))
        ),
        bar=0.3,
        unit="dB",
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


# --- grazing, tangent, degenerate -----------------------------------------------------------------------------------


def tangent(radar: Radar) -> list[Case]:
    """A plate seen exactly from its edge: two corners stand at the same range, and the cosine is zero."""
    vertices, faces = plate(3.0, radar, 90.0)
    vertices[:, 1] = radar.tx_position_m[1]  # to the last bit
    ranges = np.linalg.norm(vertices - radar.tx_position_m, axis=1)
    with np.errstate(all="ignore"):
        plain = _plain(*(4 * math.pi / radar.wavelength_m * ranges[faces[:, i]] for i in range(3)))
    samples = t2d.simulate(still(vertices, faces), radar=radar).cube[0, 0]
    ends = (t2d.simulate(still(*plate(3.0, radar, 90 + 1e-4 * side)), radar=radar).cube[0, 0] for side in (-1, 1))
    broadside = t2d.simulate(still(*plate(3.0, radar)), radar=radar).cube[0, 0]
    jump = max(float(np.abs(samples - each).max() / np.abs(broadside).max()) for each in ends)
    return [
        Case(
            name="exactly tangent: a plate seen from its edge",
            failing="plain divided difference, share of facets that are NaN",
            failing_error=float(np.mean(~np.isfinite(plain))),
            fails_by=1,
            ours="share of samples that are NaN",
            error=float(np.mean(~np.isfinite(samples))),
            bar=0,
            unit="of all",
        ),
        Case(
            name="through grazing, from -0.0001 to 0.0001 degrees",
            failing="a lit triangle counts by its area, jump of the field",
            failing_error=_area_jump(radar),
            fails_by=1e-3,
            ours="jump of the field",
            error=jump,
            bar=1e-6,
            unit="of broadside",
        ),
    ]


def _area_jump(radar: Radar) -> float:
    """Jump, relative to broadside, of a sum that takes lit triangles' areas without the cosine."""

    def field(turned_deg: float) -> float:
        vertices, faces = plate(3.0, radar, turned_deg)
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
    mesh: MovingMesh = still(vertices, faces)
    samples = t2d.simulate(mesh, radar=radar).cube[0, 0]
    error = abs(decibel(measured_rcs(mesh, radar, range_m) / ball_rcs(SPHERE_M, range_m)))
    return Case(
        name="triangles of no area",
        failing="normals by division, share of sums that are NaN",
        failing_error=float(np.isnan(naive)),
        fails_by=1,
        failing_unit="of all",
        ours="the same mesh with slivers, collapsed edges and double corners, of the whole sphere",
        error=float(error) if np.isfinite(samples).all() else math.nan,
        bar=1,
        unit="dB",
    )
