"""Several bounces: corner reflectors and a sphere over a plate against closed forms, a standing body, and a walk."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from t2d_rt.core.backend import select
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.setup import set_up
from t2d_rt.pipeline.bounces import Bouncing
from t2d_rt.pipeline.echo_model import Model, sagitta_rad
from t2d_rt.pipeline.prepare import scatterers_of
from t2d_rt.propagation.rays import Rays
from t2d_rt.scattering.bounces import Setting, TubeDetail, bounce_echoes
from t2d_rt.signal import spectrogram
from t2d_rt.types import PEC, Accuracy, Echoes, Motion, MovingMesh, Radar
from validation.bodies import WALK, recorded
from validation.physics import exact
from validation.physics.rcs import TIMES_S, sphere
from validation.physics.turntable import Body, db
from validation.report import Section, at_most, new_figure, save_chart

EDGE_M, RANGE_M = 0.10, 50.0
PRESETS = "ism-24", "table2"
ANGLES_DEG = np.arange(-20.0, 21.0, 5.0)
SPHERE_M, HEIGHT_M, HALF_PLATE_M = 0.1, 0.25, 0.8
STANDING, ASPECTS, BODY_RANGE_M = ("14_14_jumping_jacks.bvh", 0.0), 24, 10.0
SPAN_S, INSTANTS = (1.0, 2.0), 6
"""Of the walk, and how many instants of it tubes of several sizes are compared at."""
Triangles = tuple[np.ndarray, np.ndarray]


def run() -> Section:
    corners = {(preset, name): _corner_errors(preset, name) for preset in PRESETS for name in ("dihedral", "trihedral")}
    ball = _sphere_over_plate()
    body = _standing()
    walk = t2d.trim(recorded(WALK), *SPAN_S)
    cubes, seconds = zip(*(_timed(walk, bounces) for bounces in (1, 2)), strict=True)
    added = cubes[1] - cubes[0]
    level = float(db(np.sum(np.abs(added) ** 2) / np.sum(np.abs(cubes[0]) ** 2)))
    between, traced, size, size_power = _stability(walk)
    rows = [
        {"what": f"{name} of 10 cm plates, {preset}, within 20 degrees", "error dB": float(np.abs(error).max())}
        for (preset, name), error in corners.items()
    ]
    checks = [
        *(at_most(str(row["what"]), float(row["error dB"]), 1.0, "dB") for row in rows),
        at_most("sphere of 10 cm, 25 cm over a plate, 24 GHz, beside 4 pi a^2", abs(ball), 0.5, "dB"),
        at_most("walk, two bounces: interpolated frames beside frames at twice their rate", between, -20.0, "dB"),
        at_most("walk, two bounces: tubes between sample times beside tubes traced there", traced, -6.0, "dB"),
        at_most("walk, two bounces: tubes half as wide, difference", size, -8.0, "dB"),
        at_most("walk: time with two bounces over that with one", seconds[1] / seconds[0], 40),
    ]
    one, two = (10 * np.log10(values.mean()) for values in body)
    note = (
        f"Corners: what bounces 2, or 3, add, read from the middle of the sweep of ADC cubes at {RANGE_M:g} m, beside 4 pi A^2 / "
        f"lambda^2 of the aperture. The sphere over a plate returns over two paths, plate and sphere in either order, pi a^2 each, "
        f"in phase. Standing adult in skin, {ASPECTS} aspects at {BODY_RANGE_M:g} m, `table2`: mean {one:.2f} dBsm of one bounce, "
        f"{two:.2f} of up to two; single aspects change by {np.std(db(body[1] / body[0])):.1f} dB (standard deviation), at most "
        f"{np.abs(db(body[1] / body[0])).max():.1f}. Walk ({WALK}, 1 s, `table2`): the second bounce has {level:.1f} dB of the "
        f"power of the first. Tubes half as wide change it by {size:.1f} dB of its field and {size_power:+.1f} dB of its power: "
        "small, strongly bent surfaces, such as fingers, return a little less than they should. "
        f"Time: {seconds[0]:.1f} s with one bounce, {seconds[1]:.1f} s with two, both with the spectrogram, refinements kept."
    )
    return Section(
        title="Several bounces",
        checks=checks,
        note=note,
        table=rows,
        charts=[_corner_chart(corners), _walk_chart(cubes[0], cubes[1], added)],
    )


def _timed(walk: Motion, bounces: int) -> tuple[np.ndarray, float]:
    """ADC cube, and the time that it takes [s]; the first run, which compiles, does not count."""
    taken = []
    for _ in range(2):
        start = time.perf_counter()
        found = t2d.simulate(walk, radar="table2", bounces=bounces)
        assert found.spectrogram.size
        taken.append(time.perf_counter() - start)
    return np.asarray(found.cube), min(taken)


# --- corners ---


def dihedral() -> Triangles:
    """Two square plates with a vertical edge at the origin; the bisector is -x."""
    edge = np.array([[0, 0, -EDGE_M / 2], [0, 0, EDGE_M / 2]])
    left, right = (edge + EDGE_M / math.sqrt(2) * np.array([-1, side, 0]) for side in (1, -1))
    return np.concatenate([edge, left, right]), np.array([[0, 3, 2], [0, 1, 3], [0, 4, 5], [0, 5, 1]])


def trihedral(towards: np.ndarray) -> Triangles:
    """Three square plates along the axes, rotated so that the direction `towards` becomes -x."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 1, 1], [1, 0, 1]]) * EDGE_M
    faces = np.array([[0, 1, 4], [0, 4, 2], [0, 2, 5], [0, 5, 3], [0, 3, 6], [0, 6, 1]])
    across = np.cross([0, 0, 1.0], towards)
    across /= np.linalg.norm(across)
    return vertices @ np.stack([-towards, -across, np.cross(towards, across)]).T, faces


def _corner_errors(preset: str, name: str) -> np.ndarray:
    """Of what two or three bounces add [dB], over the angles."""
    radar, found = Radar.preset(preset, sample_rate_hz=30e6), []  # whose range axis goes beyond 50 m
    for angle in np.radians(ANGLES_DEG):
        spin = Rotation.from_rotvec([0, 0, angle])
        if name == "dihedral":
            vertices, faces = dihedral()
            vertices, bounces = spin.apply(vertices), 2
            expected = float(exact.dihedral_rcs(EDGE_M, float(angle), radar.wavelength_m))
        else:
            towards, bounces = spin.apply(np.ones(3) / math.sqrt(3)), 3
            vertices, faces = trihedral(towards)
            expected = 4 * math.pi * exact.trihedral_area(EDGE_M, towards) ** 2 / radar.wavelength_m**2
        place = radar.tx_position_m + [RANGE_M, 0, 0]
        mesh = MovingMesh(np.stack([vertices + place] * 2), faces, TIMES_S, PEC)
        more, less = (
            np.asarray(t2d.simulate(mesh, radar=radar, bounces=each).cube[0, 0]) for each in (bounces, bounces - 1)
        )
        middle = (more - less)[radar.samples // 2 - 1 : radar.samples // 2 + 1]
        power = float(np.mean(np.abs(middle) ** 2)) * RANGE_M**4 / radar.link_amplitude**2
        found.append(float(db(power / expected)))
    return np.array(found)


def _sphere_over_plate() -> float:
    """Two bounces beside 4 pi a^2 [dB]."""
    radar = Radar.preset("ism-24")
    place = RANGE_M * np.array([math.cos(0.8), 0, -math.sin(0.8)]) + radar.tx_position_m
    vertices, faces = sphere(SPHERE_M, place + [0, 0, HEIGHT_M], subdivisions=3)
    plate = HALF_PLATE_M * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]) + place
    shapes = (vertices, faces), (plate, np.array([[0, 1, 2], [0, 2, 3]]))
    meshes = [MovingMesh(np.stack([v, v]), f, TIMES_S, PEC) for v, f in shapes]
    found = _echoes(meshes, radar, TIMES_S[[0, -1]], np.linspace(TIMES_S[0], TIMES_S[-1], 4))
    power = np.abs(_field(found, radar)[0]) ** 2 * RANGE_M**4 / radar.link_amplitude**2
    return float(db(power / (4 * math.pi * SPHERE_M**2)))


# --- bodies ---


def _still(vertices: np.ndarray, times_s: np.ndarray) -> np.ndarray:
    return np.repeat(vertices[None], len(times_s), axis=0)


def _standing() -> np.ndarray:
    """RCS [m^2] of a standing adult with one bounce and with up to two, (2, aspects)."""
    radar = Radar.preset("table2")
    body = Body.at(recorded(STANDING[0]), STANDING[1])
    turning = body.mesh(np.radians(np.arange(ASPECTS) * 360 / ASPECTS), BODY_RANGE_M, "skin")
    found = []
    for pose in turning.vertices:
        static = MovingMesh.from_track(
            partial(_still, pose), body.faces, TIMES_S, "skin",
            rest=turning.rest, sagitta_rad=body.sagitta_rad, curved=True,
        )  # fmt: skip
        for bounces in (1, 2):
            cube = t2d.simulate(static, radar=radar, bounces=bounces).cube[0, 0]
            found.append(float(np.mean(np.abs(cube) ** 2)) * BODY_RANGE_M**4 / radar.link_amplitude**2)
    return np.array(found).reshape(-1, 2).T


def _stability(walk: Motion) -> tuple[float, float, float, float]:
    """Differences of the walk's second bounce from itself, relative to it [dB]: interpolated and at twice the surface rate; between
    sample times and traced there; with tubes half as wide, of the field and of the power."""
    radar, accuracy = Radar.preset("table2"), Accuracy()
    model: Model = set_up(walk, "free_space", Experiment.without_targets(radar, bounces=2)).model
    (rate_hz,) = model.rates_hz(accuracy)
    fine = scatterers_of(model, accuracy.replace(surface_rate_hz=2 * rate_hz))[-1].gather()
    true = _field(fine, radar)
    delay, amplitude = (
        CubicSpline(fine.times_s[::2], values[::2])(fine.times_s)
        for values in (fine.delay_s, fine.amplitude.astype(complex))
    )
    between = _summed(delay, amplitude, radar)[1:-1:2]
    steps_s = 1 / accuracy.visibility_rate_hz
    instants = model.span_s[0] + steps_s * (0.5 + np.arange(INSTANTS) * 3)
    bouncing = Bouncing(
        name="walk", mesh=model.modelled[0].mesh, fast_rotating=False, material=model.material_of(0),
        sagitta_rad=sagitta_rad(model.modelled[0].mesh, accuracy), times_s=fine.times_s,  # type: ignore[arg-type]
    )  # fmt: skip
    reflector = bouncing.reflector(radar, model.span_s, model.max_facets)
    setting = Setting(radar=radar, scene=_tracer, backend=select("auto"))
    samples_s = model.span_s[0] + steps_s * np.arange(math.ceil((model.span_s[1] - model.span_s[0]) / steps_s))
    faded, traced, narrow = (
        _field(
            bounce_echoes([reflector], setting, times_s=instants, samples_s=samples, detail=detail).frames(0, INSTANTS), radar
        )
        for samples, detail in (
            (samples_s, TubeDetail(bounces=2)),
            (instants, TubeDetail(bounces=2)),
            (instants, TubeDetail(bounces=2, spacing=1.0)),
        )
    )  # fmt: skip
    return (
        _nmse_db(between, true[1:-1:2]),
        _nmse_db(faded, traced),
        _nmse_db(traced, narrow),
        float(db(np.sum(np.abs(narrow) ** 2) / np.sum(np.abs(traced) ** 2))),
    )


def _tracer(vertices: np.ndarray, faces: np.ndarray) -> Rays:
    return Rays(vertices, faces, select("auto"))


def _echoes(meshes: Sequence[MovingMesh], radar: Radar, samples_s: np.ndarray, times_s: np.ndarray) -> Echoes:
    """Two bounces of conductors."""
    span_s = float(times_s[0]), float(times_s[-1])
    reflectors = [
        Bouncing(
            name=mesh.name, mesh=mesh, fast_rotating=False, material=PEC, sagitta_rad=mesh.sagitta_rad, times_s=times_s
        ).reflector(radar, span_s, 1_000_000)
        for mesh in meshes
    ]
    setting = Setting(radar=radar, scene=_tracer, backend=select("auto"))
    return bounce_echoes(
        reflectors, setting, times_s=times_s, samples_s=samples_s, detail=TubeDetail(bounces=2)
    ).gather()


def _field(found: object, radar: Radar) -> np.ndarray:
    """At mid-sweep (frame,) [sqrt(W)]."""
    return _summed(found.delay_s, found.amplitude, radar)  # type: ignore[attr-defined]


def _summed(delay_s: np.ndarray, amplitude: np.ndarray, radar: Radar) -> np.ndarray:
    return np.asarray(np.sum(amplitude * np.exp(2j * np.pi * (radar.mid_frequency_hz * delay_s % 1)), axis=1))


def _nmse_db(found: np.ndarray, expected: np.ndarray) -> float:
    return float(db(np.sum(np.abs(found - expected) ** 2) / np.sum(np.abs(expected) ** 2)))


# --- pictures ---


def _corner_chart(corners: dict[tuple[str, str], np.ndarray]) -> str:
    figure, axis = new_figure()
    for (preset, name), error in corners.items():
        axis.plot(ANGLES_DEG, error, "o-", markersize=4, label=f"{name}, {preset}")
    axis.set(
        xlabel="off the axis [deg]",
        ylabel="beside the closed form [dB]",
        ylim=(-1.5, 1.5),
        title="two and three bounces of 10 cm plates",
    )
    axis.axhspan(-1, 1, color="C2", alpha=0.12)
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
    return save_chart(figure, "bounces_corners.png")


def _walk_chart(*cubes: np.ndarray) -> str:
    radar = Radar.preset("table2")
    figure, axes = new_figure(ncols=3, figsize=(11, 3.8), sharey=True)
    images = [spectrogram(cube, radar, mti="none") for cube in cubes]
    levels = [10 * np.log10(np.maximum(image.power, 1e-30)) for image in images]
    top = float(levels[0].max())
    for axis, image, level, title in zip(
        axes, images, levels, ("one bounce", "up to two", "the second alone"), strict=True
    ):
        drawn = axis.pcolormesh(image.time_s, image.velocity_mps, level, vmin=top - 70, vmax=top, rasterized=True)
        axis.set(title=title, xlabel="time [s]")
    axes[0].set_ylabel("speed towards the radar [m/s]")
    figure.colorbar(drawn, ax=axes, label="dB")
    return save_chart(figure, "bounces_walk.png")
