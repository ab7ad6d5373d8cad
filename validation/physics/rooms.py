"""Rooms: a point's paths against Sionna RT's solver, and what a room does to a walk's spectrogram."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import t2d_rt as t2d
from t2d_rt.core.backend import select
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.resources import resource
from t2d_rt.propagation.images import existing, vertices
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.propagation.paths import FoundPaths, find_paths
from t2d_rt.propagation.rays import mitsuba
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.types import OneWayPath, Radar
from t2d_rt.types.path_fields import field_over
from validation.report import Section, at_most, new_figure, save_chart

SCENES, POSITIONS, SEED = ("empty_room", "living_room"), 20, 1
LOW_M, HIGH_M = (1.0, -1.2, 0.3), (5.0, 1.0, 2.0)
FREQUENCY_HZ, RANGE_DB, SHORTEST_M = 77.87e9, 60.0, 0.01
"""Paths that far below the strongest one count; that solver drops those with shorter segments."""
WALK_S = 3.0
ANTENNA_M, UP = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0])


@dataclass
class Compared:
    """Both sides' paths of all positions."""

    paths: int = 0
    missing: int = 0
    extra: int = 0
    worst: dict[str, float] = field(default_factory=lambda: {"mm": 0.0, "dB": 0.0, "degrees": 0.0})


def run() -> Section:
    checks, rows = [], []
    for scene in SCENES:
        found = _compared(scene)
        rows.append({"scene": scene, "paths": found.paths, **{f"worst [{unit}]": x for unit, x in found.worst.items()}})
        for what, measured, limit, unit in (
            ("paths that we miss", found.missing, 0, ""), ("paths of ours alone", found.extra, 0, ""),
            ("range", found.worst["mm"], 0.01, "mm"), ("amplitude", found.worst["dB"], 0.1, "dB"),
            ("phase", found.worst["degrees"], 5, "degrees"),
        ):  # fmt: skip
            checks.append(at_most(f"{scene}: {what}", measured, limit, unit))
    seconds, chart = _walk_chart()
    return Section(
        title="Rooms",
        checks=checks,
        note=f"Paths from an antenna to a reflector of 1 m^2 and back, over up to two reflections, within {RANGE_DB:g} dB of the "
        f"strongest, at {POSITIONS} random positions, {FREQUENCY_HZ / 1e9:g} GHz, beside those of `sionna.rt.rcs.RCSSolver`. "
        f"That solver drops paths with a segment under {SHORTEST_M * 100:g} cm, which are left out of ours here. The chart: "
        f"{WALK_S:g} s of a walk (CMU 12_01), mesh, `table2`; the living room took {seconds:.0f} s.",
        table=rows,
        charts=[chart],
    )


def _compared(scene: str) -> Compared:
    mi = mitsuba(select("auto"))
    import sionna.rt as rt
    from sionna.rt.rcs import ConstantRCSSensingTarget, RCSSolver

    theirs = rt.load_scene(str(resource("scenes", scene) / f"{scene}.xml"), merge_shapes=False)
    theirs.frequency = FREQUENCY_HZ
    theirs.tx_array = theirs.rx_array = rt.PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="V")
    theirs.add(rt.Transmitter(name="tx", position=ANTENNA_M.tolist()))
    theirs.add(rt.Receiver(name="rx", position=ANTENNA_M.tolist()))
    target = ConstantRCSSensingTarget(name="target", length=1e-3, width=1e-3, height=1e-3, position=[3, 0, 1])
    theirs.add(target)
    points = np.random.default_rng(SEED).uniform(LOW_M, HIGH_M, (POSITIONS, 3))
    mirrors = Mirrors.of(load_scene(scene), select("auto"))
    paths = find_paths(mirrors, ANTENNA_M, UP, FREQUENCY_HZ, order=2, probes_m=points)
    compared = Compared()
    for point in points:
        target.position = mi.Point3f(*point.tolist())
        found = RCSSolver()(theirs, max_depth=3, refraction=False, seed=SEED)
        delay, amplitude = np.array(found.tau).ravel(), (np.array(found.a[0]) + 1j * np.array(found.a[1])).ravel()
        _compare(_paths(paths, point), list(zip(delay[delay > 0], amplitude[delay > 0], strict=True)), compared)
    return compared


def _paths(found: FoundPaths, point: np.ndarray) -> list[tuple[float, complex]]:
    """Delay [s] and amplitude of each path to a point of 1 m^2 that keeps the theta and phi components of the field."""
    exist = existing(found.edges.mirrors, found.paths, point[None])[:, 0]
    lit = [
        path for path, there in zip(found.paths, exist, strict=True) if there and _shortest(path, point) > SHORTEST_M
    ]
    echoes = []
    for out in lit:
        for back in lit:
            if out.order + back.order > 2:
                continue
            lengths = [float(np.linalg.norm(point - path.image_m)) for path in (out, back)]
            headings = (point - out.image_m) / lengths[0], (back.image_m - point) / lengths[1]
            fields = [field_over(path, point, np.array([FREQUENCY_HZ]))[0] for path in (out, back)]
            kept = sum((a @ fields[0]) * (b @ fields[1]) for a, b in zip(*map(_spherical, headings), strict=True))
            wavelength = SPEED_OF_LIGHT / FREQUENCY_HZ
            echoes.append(
                (sum(lengths) / SPEED_OF_LIGHT, wavelength / (4 * math.pi) ** 1.5 / math.prod(lengths) * kept)
            )
    return echoes


def _shortest(path: OneWayPath, point: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(vertices(path, point), axis=0), axis=1).min())


def _spherical(heading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors of theta and phi."""
    theta, phi = math.acos(heading[2]), math.atan2(heading[1], heading[0])
    down = np.array([math.cos(theta) * math.cos(phi), math.cos(theta) * math.sin(phi), -math.sin(theta)])
    return down, np.array([-math.sin(phi), math.cos(phi), 0.0])


def _compare(ours: list[tuple[float, complex]], theirs: list[tuple[Any, Any]], compared: Compared) -> None:
    floor = max(abs(a) for _, a in theirs) * 10 ** (-RANGE_DB / 20)
    free = [(float(t), complex(a)) for t, a in theirs if abs(a) > floor]
    compared.paths += len(free)
    for delay, amplitude in sorted(((t, a) for t, a in ours if abs(a) > floor), key=lambda path: -abs(path[1])):
        near = [(t, a) for t, a in free if abs(t - delay) * SPEED_OF_LIGHT < 1e-4]
        if not near:
            compared.extra += 1
            continue
        time_s, _ = nearest = min(near, key=lambda path: abs(path[1] - amplitude))
        free.remove(nearest)
        # Of a path and its reverse, whichever that solver has better.
        other = min((a for t, a in theirs if abs(t - delay) * SPEED_OF_LIGHT < 1e-4), key=lambda a: abs(a - amplitude))
        for unit, value in (
            ("mm", abs(time_s - delay) * SPEED_OF_LIGHT / 2 * 1e3),
            ("dB", abs(20 * math.log10(abs(other / amplitude)))),
            ("degrees", abs(float(np.angle(other / amplitude, deg=True)))),
        ):
            compared.worst[unit] = max(compared.worst[unit], value)
    compared.missing += len(free)


def _walk_chart() -> tuple[float, str]:
    """Seconds in the living room, and a chart of the walk with and without it."""
    motion = t2d.trim(t2d.load_motion(resource("motions", "12_01_walk.bvh")), 0, WALK_S)
    figure, axes = new_figure(figsize=(9, 3.6), ncols=2, sharey=True)
    seconds = 0.0
    peak = None
    for ax, scene in zip(axes, ("free_space", "living_room"), strict=True):
        start = time.perf_counter()
        image = t2d.simulate(motion, radar=Radar.preset("table2"), scene=scene).spectrogram
        seconds = time.perf_counter() - start
        peak = float(image.values.max()) if peak is None else peak
        drawn = ax.pcolormesh(
            image.time_s, image.velocity_mps, image.values - peak, vmin=-60, vmax=0, rasterized=True, shading="nearest"
        )
        ax.set(xlabel="Time [s]", title=scene, ylim=(-2.5, 4.5))
    axes[0].set_ylabel("Radial velocity [m/s], approaching > 0")
    figure.colorbar(drawn, ax=axes, label="Power rel. to free space's peak [dB]")
    return seconds, save_chart(figure, "rooms_walk.png")
