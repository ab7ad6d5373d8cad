"""Bodies: visibility that pops, the ellipsoid formula end-on, segments that overlap or occlude one another."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal.windows import blackmanharris

import t2d_rt as t2d
from t2d_rt.core.backend import select
from t2d_rt.propagation.rays import columns, mitsuba, mitsuba_mesh, traceable
from t2d_rt.scattering.phase_integral import divided_difference
from t2d_rt.types import PEC, Ellipsoids, MovingMesh, Radar
from validation.bodies import occlusion_of
from validation.methods.stability.case import Case, Theme
from validation.methods.stability.targets import decibel
from validation.physics.rcs import SPHEROID_M, TIMES_S, sphere
from validation.report import at_least, at_most, new_figure, save_chart

PASSING_M, PASSING_MPS, PASSING_S = 0.05, 0.5, 0.4
"""Radius, speed and time of a sphere that comes out from behind an edge."""
FAST_MPS = 2.0
"""Beyond that speed its spectrum holds nothing but clicks."""
RAY_LIFT_M = 1e-4
END_ON_M = 3.0
OUTER_M, INNER_M = 0.15, 0.1
LIMB_M, BEHIND_M = 0.04, 0.6


def theme() -> Theme:
    radar = Radar.preset("table2")
    pops, chart = popping(radar)
    return Theme(cases=[pops, grazing(radar), end_on(radar), overlapping(radar), hidden(radar)], charts=[chart])


# --- popping --------------------------------------------------------------------------------------------------------


def popping(radar: Radar) -> tuple[Case, str]:
    """A sphere that comes out from behind an edge: facets switched chirp by chirp, and visibility as we fade it."""
    radar = radar.replace(prf_hz=5120.0)
    unit, faces = sphere(PASSING_M, np.zeros(3), 4)
    times = np.linspace(0, PASSING_S, 5)
    centres = radar.tx_position_m + np.column_stack(
        [np.full(5, 2.0), PASSING_MPS * (times - PASSING_S / 2), np.zeros(5)]
    )
    ball = MovingMesh(unit + centres[:, None], faces, times, PEC, name="ball")
    # A sheet that ends at y = 0, aslant so that it sends nothing back.
    sheet = radar.tx_position_m + np.array([[1.0, 0, -0.5], [1.5, -0.5, -0.5], [1.5, -0.5, 0.5], [1.0, 0, 0.5]])
    screen = MovingMesh(
        np.stack([sheet] * 5), np.array([[0, 1, 2], [0, 2, 3]]), times, PEC, crease_deg=0, name="screen"
    )
    middle = radar.samples // 2
    both, alone = (t2d.simulate(each, radar=radar).cube[:, 0, middle] for each in ([ball, screen], [screen]))
    starts = radar.chirp_starts_s(len(both)) + radar.sample_times_s[middle]
    spectra = {
        "facets switched as they pass the edge": _spectrum(_switched(ball, radar, starts)),
        "t2d_rt: traced at 25 Hz and faded": _spectrum(both - alone),
    }
    speed = radar.speed_axis_mps(len(both))
    fast = np.abs(speed) > FAST_MPS
    floors = [float(decibel(np.mean(power[fast]) / power.max())) for power in spectra.values()]
    figure, axis = new_figure()
    for (name, power), style in zip(spectra.items(), ("C1-", "C0-"), strict=True):
        axis.plot(speed, decibel(power / power.max()), style, linewidth=0.8, label=name)
    axis.set(xlabel="speed [m/s]", ylabel="power rel. to peak [dB]", ylim=(-140, 5))
    axis.set_title(f"sphere of {PASSING_M * 100:g} cm from behind an edge, {PASSING_MPS:g} m/s across")
    axis.legend(fontsize=8, loc="upper right")
    axis.grid(alpha=0.3)
    case = Case(
        f"popping visibility, floor beyond {FAST_MPS:g} m/s",
        at_least("facets switched as they pass a shadow's edge", floors[0], -60, "dB"),
        at_most("visibility at 25 Hz, faded, and amplitudes as cubics between surface frames", floors[1], -80, "dB"),
    )
    return case, save_chart(figure, "stability_popping.png")


def _switched(ball: MovingMesh, radar: Radar, times_s: np.ndarray) -> np.ndarray:
    """Mid-sweep field (chirp,) of the sphere's facets in closed form, each counted while its middle is beyond the edge's shadow."""
    k = 2 * math.pi / radar.wavelength_m
    field = np.empty(len(times_s), complex)
    for n, vertices in enumerate(ball.at(times_s) - radar.tx_position_m):
        a, b, c = (vertices[ball.faces[:, i]] for i in range(3))
        seen = (a + b + c)[:, 1] > 0
        a, b, c = a[seen], b[seen], c[seen]
        weight = np.maximum(-np.sum(np.cross(b - a, c - a) * (a + b + c), axis=1), 0)
        field[n] = np.sum(
            weight * divided_difference(*(2 * k * np.linalg.norm(corner, axis=1) for corner in (a, b, c)))
        )
    return field


def _spectrum(series: np.ndarray) -> np.ndarray:
    """Power over ascending speed."""
    return np.fft.fftshift(np.abs(np.fft.fft(series * blackmanharris(len(series)))) ** 2)[::-1]


def grazing(radar: Radar) -> Case:
    """Which lit vertices of a sphere rays say are occluded: a convex body occludes nothing that is lit."""
    ball = _ball(OUTER_M, radar.tx_position_m + [END_ON_M + OUTER_M, 0, 0])
    proxy, faces = sphere(OUTER_M, np.zeros(3), 2)
    inside = abs(float(np.sum(np.linalg.det(proxy[faces])))) / 6  # of the same volume as the sphere
    proxy = proxy * (4 / 3 * math.pi * OUTER_M**3 / inside) ** (1 / 3) + ball.rest.mean(axis=0)
    towards = radar.tx_position_m - ball.rest
    distance = np.linalg.norm(towards, axis=1)
    towards /= distance[:, None]
    lit = np.sum(ball.trimesh(0).vertex_normals * towards, axis=1) > 0
    mi = mitsuba(select("auto"))
    ray = mi.Ray3f(mi.Point3f(*columns(mi, ball.rest + RAY_LIFT_M * towards)), mi.Vector3f(*columns(mi, towards)))
    ray.maxt = mi.Float((distance - RAY_LIFT_M).astype(np.float32))
    stopped = traceable(mi, mitsuba_mesh(mi, proxy, faces)).ray_test(ray).numpy()
    samples_s = np.zeros(2)
    view = occlusion_of(ball, radar, samples_s)
    sampled = view.visibility(samples_s[:1])[0][0]
    return Case(
        "grazing rays, lit vertices of a sphere said to be occluded",
        at_least(
            f"{RAY_LIFT_M * 1e3:g} mm off the surface, through a proxy of {len(faces)} faces",
            float(np.mean(stopped[lit])),
            0.1,
            "of all",
        ),
        at_most(
            "2 mm off along ray and normal, through the mesh itself", float(np.mean(sampled[lit] < 1)), 0, "of all"
        ),
    )


# --- ellipsoids -----------------------------------------------------------------------------------------------------


def _ellipsoids(semi_axes_m: np.ndarray, centres_m: np.ndarray, axes: np.ndarray | None = None) -> Ellipsoids:
    """At rest."""
    count = len(semi_axes_m)
    orientation = None if axes is None else np.broadcast_to(axes, (count, 3, 3))
    return Ellipsoids(semi_axes_m, np.stack([centres_m, centres_m]), TIMES_S, orientation, PEC)


def _field(target: t2d.Surface | list, radar: Radar, **options: object) -> np.ndarray:
    return t2d.simulate(target, radar=radar, **options).cube[0, 0].astype(complex)


def end_on(radar: Radar) -> Case:
    """A spheroid of 8 x 22 cm whose long axis points at the radar: where is its echo?"""
    a, c = SPHEROID_M
    axes = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    centre = radar.tx_position_m + [END_ON_M + c, 0, 0]
    limb = _ellipsoids(np.array([[a, a, c]]), centre[None], axes)
    unit, faces = sphere(1.0, np.zeros(3), 5)
    vertices = (unit * [a, a, c]) @ axes.T + centre
    mesh = MovingMesh(np.stack([vertices, vertices]), faces, TIMES_S, PEC)
    at = [
        _peak_m(field, radar)
        for field in (
            _field(limb, radar, method="ellipsoid", phase_from="centre"),
            _field(limb, radar, method="ellipsoid"),
            _field(mesh, radar),
        )
    ]
    return Case(
        "ellipsoid formula end-on, where the echo is",
        at_least("range of the centre", abs(at[0] - END_ON_M) * 1e3, 200, "mm"),
        at_most("specular point, and mesh", max(abs(each - END_ON_M) for each in at[1:]) * 1e3, 2, "mm"),
    )


def _peak_m(samples: np.ndarray, radar: Radar) -> float:
    profile = np.abs(np.fft.fft(samples * blackmanharris(len(samples)), 1024 * len(samples)))
    return float(radar.range_axis_m(len(profile))[profile.argmax()])


def overlapping(radar: Radar) -> Case:
    """A sphere within a sphere, as a pelvis within a belly: the inner one must not be seen, wherever it is."""
    errors: dict[str, list[float]] = {"ellipsoid": [], "mesh": []}
    centre = radar.tx_position_m + [END_ON_M + OUTER_M, 0, 0]
    for shift in np.arange(4) * radar.wavelength_m / 8:
        centres = np.stack([centre, centre + [shift, 0, 0]])
        pair = _ellipsoids(np.array([[OUTER_M] * 3, [INNER_M] * 3]), centres)
        alone = _ellipsoids(np.array([[OUTER_M] * 3]), centres[:1])
        outer, inner = (_ball(radius, place) for radius, place in zip((OUTER_M, INNER_M), centres, strict=True))
        fields = {
            "ellipsoid": [_field(each, radar, method="ellipsoid") for each in (pair, alone)],
            "mesh": [_field(each, radar) for each in ([outer, inner], outer)],
        }
        for method, (both, one) in fields.items():
            errors[method].append(abs(float(decibel(np.sum(np.abs(both) ** 2) / np.sum(np.abs(one) ** 2)))))
    return Case(
        "overlapping segments, a sphere within a sphere",
        at_least("ellipsoids side by side: power off by up to", max(errors["ellipsoid"]), 1, "dB"),
        at_most("mesh with its occlusion, worst of four places", max(errors["mesh"]), 0.1, "dB"),
    )


def hidden(radar: Radar) -> Case:
    """A limb behind a trunk: how much of its echo is left."""
    trunk, limb = (radar.tx_position_m + [x, 0, 0] for x in (END_ON_M + OUTER_M, END_ON_M + OUTER_M + BEHIND_M))
    balls = _ball(OUTER_M, trunk), _ball(LIMB_M, limb)
    targets = [
        _ellipsoids(np.full((1, 3), radius), place[None]) for radius, place in ((OUTER_M, trunk), (LIMB_M, limb))
    ]
    both = _ellipsoids(np.array([[OUTER_M] * 3, [LIMB_M] * 3]), np.stack([trunk, limb]))
    left = []
    for pair, first, second, method in ((both, *targets, "ellipsoid"), (list(balls), *balls, "mesh")):
        rest = _field(pair, radar, method=method) - _field(first, radar, method=method)
        left.append(
            float(
                decibel(
                    max(np.sum(np.abs(rest) ** 2) / np.sum(np.abs(_field(second, radar, method=method)) ** 2), 1e-20)
                )
            )
        )
    return Case(
        "an occluded limb, power left of its echo",
        at_least("ellipsoids", left[0], -1, "dB"),
        at_most("mesh with its occlusion", left[1], -40, "dB"),
    )


def _ball(radius_m: float, centre_m: np.ndarray) -> MovingMesh:
    vertices, faces = sphere(radius_m, centre_m, 4)
    return MovingMesh(np.stack([vertices, vertices]), faces, TIMES_S, PEC)
