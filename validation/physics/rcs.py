"""RCS read back from the ADC cube of static perfect conductors, against closed forms worked out here."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.signal.windows import blackmanharris
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from t2d_rt.types import PEC, Ellipsoids, MovingMesh, Radar
from validation.report import Section, at_most, new_figure, save_chart

RANGES_M = (1.0, 3.0, 10.0, 30.0)
SPHERE_M = 0.5642
"""Radius of 1 m^2."""
PLATE_M = 0.10
SPHEROID_M = (0.08, 0.22)
ASPECTS_DEG = (0, 15, 30, 45, 60, 75, 90)
SMALL_KA = (8.0, 9.0, 10.0, 11.0, 12.0, 14.0, 16.0)
TIMES_S = np.array([0.0, 0.01])
LIMIT_DB = 0.3
ORIENTATIONS = 10
"""Random orientations of the sphere's mesh: where its facets happen to lie changes the RCS a little."""


def run() -> Section:
    radar = Radar.preset("table2-long")
    rows = [*_spheres(radar), *_plates(radar), *_small_spheres(radar)]
    facets, ellipsoid = _spheroids(radar)
    spheres = [_rotated_sphere(radar, seed) for seed in range(ORIENTATIONS)]
    checks = [
        at_most(f"{name}, worst error", max(abs(r["error dB"]) for r in part), LIMIT_DB, "dB")
        for name, part in (
            ("sphere r = 0.5642 m at 1, 3, 10, 30 m", rows[:4]),
            ("plate 10 cm at 1, 3, 10, 30 m", rows[4:8]),
            ("small spheres against exact physical optics", rows[8:]),
            (f"sphere at 10 m, its mesh in {ORIENTATIONS} random orientations", spheres),
            ("spheroid 8 x 22 cm by facets, 7 aspects at 3 m", facets),
            ("spheroid by the ellipsoid model, 7 aspects at 3 m", ellipsoid),
        )
    ]
    return Section(
        title="RCS read back from the ADC cube",
        checks=checks,
        note="`simulate` at default settings, self-occlusion on, preset `table2-long`; RCS from the peak of the range "
        "profile (Blackman-Harris) by the radar equation at the specular point's range. Sphere: pi a^2 "
        "(R/(R+a))^2. Plate: physical optics summed over 0.25 mm cells. Small spheres at 10 m: eq. 6 at "
        "mid-sweep, from the two middle samples. Spheroid: pi R1 R2 /((1+R1/R)(1+R2/R)) at the nearest point, "
        "found by one-dimensional search.",
        table=[*rows, *spheres, *facets, *ellipsoid],
        charts=[_chart(facets, ellipsoid)],
    )


def read_rcs(samples: np.ndarray, radar: Radar, range_m: float) -> float:
    """RCS [m^2] from the peak of one chirp's range profile, samples (N,)."""
    window = blackmanharris(radar.samples)
    profile = np.fft.fft(samples * window, 64 * radar.samples) / window.sum()
    return float(np.abs(profile).max() ** 2 * range_m**4 / radar.link_amplitude**2)


def sphere(radius_m: float, centre_m: np.ndarray, subdivisions: int = 5) -> tuple[np.ndarray, np.ndarray]:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius_m)
    return np.asarray(ball.vertices) + centre_m, np.asarray(ball.faces)


def _chirp(vertices: np.ndarray, faces: np.ndarray, radar: Radar) -> np.ndarray:
    mesh = MovingMesh(np.stack([vertices, vertices]), faces, TIMES_S, PEC)
    return t2d.simulate(mesh, radar=radar).cube[0, 0]


def _row(target: str, range_m: float, measured: float, expected: float) -> dict[str, object]:
    dbsm = [10 * math.log10(x) for x in (measured, expected)]
    return {
        "target": target, "range m": range_m, "measured dBsm": round(dbsm[0], 3), "expected dBsm": round(dbsm[1], 3),
        "error dB": round(dbsm[0] - dbsm[1], 4),
    }  # fmt: skip


def _spheres(radar: Radar) -> list[dict]:
    rows = []
    for range_m in RANGES_M:
        vertices, faces = sphere(SPHERE_M, radar.tx_position_m + [range_m + SPHERE_M, 0, 0])
        expected = math.pi * SPHERE_M**2 * (range_m / (range_m + SPHERE_M)) ** 2
        rows.append(_row("sphere", range_m, read_rcs(_chirp(vertices, faces, radar), radar, range_m), expected))
    return rows


def _rotated_sphere(radar: Radar, seed: int, range_m: float = 10.0) -> dict:
    unit, faces = sphere(SPHERE_M, np.zeros(3))
    rotated = Rotation.random(rng=np.random.default_rng(seed)).apply(unit)
    samples = _chirp(rotated + radar.tx_position_m + [range_m + SPHERE_M, 0, 0], faces, radar)
    expected = math.pi * SPHERE_M**2 * (range_m / (range_m + SPHERE_M)) ** 2
    return _row(f"sphere, orientation {seed}", range_m, read_rcs(samples, radar, range_m), expected)


def _plates(radar: Radar) -> list[dict]:
    half, rows = PLATE_M / 2, []
    corners = np.array([[0, -half, -half], [0, half, -half], [0, half, half], [0, -half, half]])
    faces = np.array([[0, 2, 1], [0, 3, 2]])
    for range_m in RANGES_M:
        samples = _chirp(corners + radar.tx_position_m + [range_m, 0, 0], faces, radar)
        rows.append(_row("plate", range_m, read_rcs(samples, radar, range_m), plate_rcs(range_m, radar.wavelength_m)))
    return rows


def plate_rcs(range_m: float, wavelength_m: float, cells: int = 400) -> float:
    """Physical optics of the plate, broadside: 4 pi/lambda^2 |sum cos(theta) (R/r)^2 exp(2jkr) dA|^2."""
    y = (np.arange(cells) + 0.5) / cells * PLATE_M - PLATE_M / 2
    r = np.sqrt(range_m**2 + y[:, None] ** 2 + y**2)
    field = np.sum(range_m / r * (range_m / r) ** 2 * np.exp(4j * math.pi / wavelength_m * r)) * (PLATE_M / cells) ** 2
    return 4 * math.pi / wavelength_m**2 * abs(field) ** 2


def _small_spheres(radar: Radar, range_m: float = 10.0) -> list[dict]:
    """Where the shadow line's return is not yet negligible: eq. 6 of docs/physics.md."""
    rows = []
    for ka in SMALL_KA:
        radius = ka * radar.wavelength_m / (2 * math.pi)
        vertices, faces = sphere(radius, radar.tx_position_m + [range_m + radius, 0, 0], subdivisions=4)
        middle = _chirp(vertices, faces, radar)[radar.samples // 2 - 1 : radar.samples // 2 + 1]
        measured = float(np.mean(np.abs(middle) ** 2)) * range_m**4 / radar.link_amplitude**2
        exact = math.pi * radius**2 * (1 - math.sin(2 * ka) / ka + (math.sin(ka) / ka) ** 2)
        rows.append(_row(f"sphere ka = {ka:g}", range_m, measured, exact * (range_m / (range_m + radius)) ** 2))
    return rows


def _spheroids(radar: Radar, range_m: float = 3.0) -> tuple[list[dict], list[dict]]:
    a, c = SPHEROID_M
    facets, ellipsoid = [], []
    for aspect in ASPECTS_DEG:
        psi = math.radians(aspect)
        distance, expected = _nearest_point(psi, range_m)
        centre = radar.tx_position_m + [distance, 0, 0]
        axes = np.array([[math.sin(psi), 0, -math.cos(psi)], [0, 1, 0], [math.cos(psi), 0, math.sin(psi)]]).T
        unit, faces = sphere(1.0, np.zeros(3))
        samples = _chirp((unit * [a, a, c]) @ axes.T + centre, faces, radar)
        facets.append(_row(f"facets, {aspect} deg", range_m, read_rcs(samples, radar, range_m), expected))
        shape = Ellipsoids(np.array([[a, a, c]]), np.tile(centre, (2, 1, 1)), TIMES_S, axes[None], PEC)
        samples = t2d.simulate(shape, radar=radar, method="ellipsoid").cube[0, 0]
        ellipsoid.append(_row(f"ellipsoid, {aspect} deg", range_m, read_rcs(samples, radar, range_m), expected))
    return facets, ellipsoid


def _nearest_point(psi: float, range_m: float) -> tuple[float, float]:
    """Distance of the centre that puts the nearest point at `range_m`, and the RCS by geometrical optics.

    The long axis makes the angle psi with the line of sight; the nearest point lies in the plane of the two, at (c cos t,
    a sin t) from the centre, along and across the axis.
    """
    a, c = SPHEROID_M

    def nearest(distance: float) -> tuple[float, float]:
        radar = -distance * np.array([math.cos(psi), math.sin(psi)])

        def away(t: float) -> float:
            return math.hypot(c * math.cos(t) - radar[0], a * math.sin(t) - radar[1])

        found = minimize_scalar(away, bounds=(math.pi / 2, 2 * math.pi), method="bounded", options={"xatol": 1e-10})
        return found.fun, found.x

    distance = brentq(lambda d: nearest(d)[0] - range_m, range_m, range_m + 2 * c, xtol=1e-12)
    t = nearest(distance)[1]
    steep = math.sqrt((c * math.sin(t)) ** 2 + (a * math.cos(t)) ** 2)
    r1, r2 = steep**3 / (a * c), a * steep / c
    return distance, math.pi * r1 * r2 / ((1 + r1 / range_m) * (1 + r2 / range_m))


def _chart(facets: list[dict], ellipsoid: list[dict]) -> str:
    figure, axis = new_figure()
    axis.plot(ASPECTS_DEG, [row["expected dBsm"] for row in facets], "k-", label="nearest-point geometrical optics")
    axis.plot(ASPECTS_DEG, [row["measured dBsm"] for row in facets], "o", label="facets, from the ADC cube")
    axis.plot(ASPECTS_DEG, [row["measured dBsm"] for row in ellipsoid], "x", label="ellipsoid model, from the ADC cube")
    axis.set(
        xlabel="angle between long axis and line of sight [deg]", ylabel="RCS [dBsm]", title="spheroid 8 x 22 cm, 3 m"
    )
    axis.legend()
    axis.grid(alpha=0.3)
    return save_chart(figure, "rcs_spheroid.png")
