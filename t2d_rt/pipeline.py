"""The pipeline on one screen: motion -> body -> (visibility) -> echoes -> ADC cube; `Simulation` goes on from there."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import asdict
from numbers import Real
from pathlib import Path
from typing import Any, Literal

import numpy as np

from t2d_rt.backend import Device, select
from t2d_rt.body import segments as fit_segments
from t2d_rt.body import skin as skin_body
from t2d_rt.body.materials import BODY_MATERIALS, resolve_material
from t2d_rt.echo.ellipsoid import PhaseFrom, ellipsoid_echoes
from t2d_rt.echo.mesh import check_outside, joined, mesh_echoes
from t2d_rt.echo.rate import needed_rate_hz
from t2d_rt.errors import InputError, T2DWarning
from t2d_rt.motion import place, track
from t2d_rt.radar import check_speed
from t2d_rt.radar.synthesize import Progress, synthesize
from t2d_rt.result import Simulation, versions
from t2d_rt.room import COARSE_RATE, Clutter, clutter_streams, coarse_views, coarser, find_ways, full_views
from t2d_rt.scene import Mover, Room
from t2d_rt.trace.materials import itu_material
from t2d_rt.trace.scenes import load_scene
from t2d_rt.types import EchoStream, Ellipsoids, Material, Motion, MovingMesh, Radar, Scene

Method = Literal["mesh", "ellipsoid"]
Target = Motion | MovingMesh | Ellipsoids | Mover


def simulate(
    target: Target | Sequence[Target],
    *,
    radar: Radar | None = None,
    scene: str | Path | Scene | Room = "free_space",
    reflections: int = 2,
    dynamic_range_db: float = 60.0,
    clutter: Clutter = "specular",
    method: Method = "mesh",
    seed: int = 0,
    body: str = "adult",
    material: str | Material | None = None,
    occlusion: bool = True,
    occlusion_rate_hz: float = 25.0,
    surface_rate_hz: float | None = None,
    sagitta_rad: float | None = None,
    phase_from: PhaseFrom = "specular",
    device: Device = "auto",
    progress: Progress | None = None,
) -> Simulation:
    """Radar recording of a motion, a moving mesh, ellipsoids, or a list of them with movers (fans, pets) among them.

    Parameters
    ----------
    target: a `Motion` is skinned ("mesh") or given segments ("ellipsoid"), and placed before the radar where it has not been.
        The record is the time that all targets share, movers going on for as long; its own clock starts at 0.
    radar: the `table2` preset by default.
    scene: "free_space", a room by name, a Mitsuba/Sionna XML file, a `Room` or a `Scene`.
    reflections: greatest number of them on the ways out and back together.
    dynamic_range_db: pairs of ways weaker than the strongest one by more than that are left out.
    clutter: of the room itself, shadowed by the targets: "specular" (up to 3 reflections), "diffuse" (rough walls too) or "none".
    method: "mesh", physical optics of the skin, or "ellipsoid", one point for each segment of the body.
    seed: of the diffuse points; the same seed gives the same cube bit for bit.
    body: the template to skin.
    material: of everything but movers; by default a body's is "skin" and a mesh's its own.
    occlusion: whether what stands in front hides what is behind: traced at the meshes' own vertices at `occlusion_rate_hz`, faded
        in between. A wall needs vertices where a shadow may end; gaps under 4 mm are not seen.
    occlusion_rate_hz: how often visibility is traced; 25 suits walking.
    surface_rate_hz: rate at which shape is evaluated; carrier phases in between follow splines. By default what the motion asks
        for.
    sagitta_rad: greatest phase sagitta of a facet; by default the mesh's own (a body's 0.3 at a radius of 0.1 m, 0.07 for others).
    phase_from: of the ellipsoid model: its "specular" point, or its "centre" as in the Text2Doppler paper.
    device: "auto" takes a CUDA device where there is one.
    progress: called with the share done, 0..1.
    """
    radar = Radar.preset("table2") if radar is None else radar
    targets = [target] if isinstance(target, Target) else target
    _check(targets, radar, method, phase_from, surface_rate_hz, occlusion_rate_hz, sagitta_rad, seed)
    _check_room(reflections, dynamic_range_db, clutter)
    backend = select(device)
    around = _around(scene)
    shapes = _shapes(targets, method, body, material, radar)
    times_s = _frames(shapes, radar, surface_rate_hz)
    substances = [
        _material(shape.material if material is None or isinstance(target, Mover) else material, radar)
        for shape, target in zip(shapes, targets, strict=True)
    ]
    for shape in shapes:
        _check_shape(shape, radar, times_s)
    ways = None
    if around is not None:
        ways = find_ways(around, shapes, radar, times_s, order=reflections, range_db=dynamic_range_db, backend=backend)
    common: dict[str, Any] = {"rate_hz": occlusion_rate_hz, "times_s": times_s}
    strong = [None] if ways is None else ways.pairs[: ways.strong]
    views = full_views(shapes, radar, strong, occlusion=occlusion, backend=backend, **common)
    detail: dict[str, Any] = {"times_s": times_s, "seed": int(seed), "backend": backend}
    streams: list[EchoStream] = []
    for shape, substance, target, close in zip(shapes, substances, targets, views, strict=True):
        if isinstance(shape, Ellipsoids):
            weak = [] if ways is None else coarse_views(shape, ways.pairs[ways.strong :], **common)
            streams.append(
                ellipsoid_echoes(
                    shape, radar, times_s=times_s, material=substance, phase_from=phase_from, views=close + weak
                )
            )
            continue
        bar = shape.sagitta_rad if sagitta_rad is None else sagitta_rad
        streams.append(mesh_echoes(shape, radar, material=substance, sagitta_rad=bar, views=close, **detail))
        if ways is None:
            continue
        seldom = {**common, "rate_hz": COARSE_RATE * occlusion_rate_hz}
        clear = ways.clear if isinstance(target, Motion) else len(ways.pairs)
        if weak := coarse_views(shape, ways.pairs[ways.strong : clear], **seldom):
            streams.append(mesh_echoes(shape, radar, material=substance, views=weak, **coarser(bar), **detail))
        if isinstance(target, Motion) and (faint := ways.pairs[clear:]):
            limbs = segments(_placed(target, radar), body)
            streams.append(
                ellipsoid_echoes(
                    limbs, radar, times_s=times_s, material=substance, views=coarse_views(limbs, faint, **seldom)
                )
            )
    static: dict[str, object] = {}
    if around is not None and clutter != "none":
        still, static = clutter_streams(
            clutter, around, shapes, radar, times_s,
            occlusion=occlusion, rate_hz=occlusion_rate_hz, seed=int(seed), backend=backend,
        )  # fmt: skip
        streams += still
    cube = synthesize(joined(streams), radar, device=device, progress=progress)
    settings: dict[str, Any] = {
        "method": method, "scene": "free_space" if around is None else around.name,
        "seed": int(seed), "body": body, "occlusion": occlusion,
        "material": "own" if material is None else material if isinstance(material, str) else asdict(material),
        "occlusion_rate_hz": float(occlusion_rate_hz), "surface_rate_hz": (len(times_s) - 1) / float(times_s[-1] - times_s[0]),
        "sagitta_rad": "default" if sagitta_rad is None else float(sagitta_rad), "phase_from": phase_from, "device": backend.name,
        "targets": [_describe(each) for each in targets],
    }  # fmt: skip
    if ways is not None:
        settings |= {
            "reflections": int(reflections),
            "dynamic_range_db": float(dynamic_range_db),
            **ways.describe(),
            **static,
        }
    return Simulation(cube, radar, settings=settings, versions=versions())


def skin(motion: Motion, body: str = "adult", *, material: str | Material = "skin") -> MovingMesh:
    """The motion's skinned body: `vertices` (T, V, 3) m, `faces` (F, 3), `times_s` (T,)."""
    return skin_body(motion, body, material=material, track=track(motion))


def segments(motion: Motion, body: str = "adult", *, material: str | Material = "skin") -> Ellipsoids:
    """One ellipsoid for each segment of the same body."""
    return fit_segments(motion, body, material=material, track=track(motion))


def _around(scene: Any) -> Scene | None:
    """What stands around the targets; None in free space."""
    if isinstance(scene, Room):
        return scene.scene()
    if isinstance(scene, Scene):
        return scene
    if not isinstance(scene, (str, Path)):
        raise InputError(f"scene must be a name, a path, a Room or a Scene, got {scene!r:.60}")
    return None if scene == "free_space" else load_scene(scene)


def _shapes(
    targets: Sequence[Target], method: Method, body: str, material: str | Material | None, radar: Radar
) -> list[MovingMesh | Ellipsoids]:
    """The targets' shapes; those of movers over the time that the others share."""
    lasting = {n: _shape(t, method, body, material, radar) for n, t in enumerate(targets) if not isinstance(t, Mover)}
    if not lasting:
        raise InputError(
            f"movers alone have no end, got {targets!r:.60}; give one of them as its mesh, mover.mesh(0, 5) for 5 s"
        )
    time_s = _shared_time(list(lasting.values()))
    return [t.mesh(*time_s) if isinstance(t, Mover) else lasting[n] for n, t in enumerate(targets)]


def _shape(
    target: Motion | MovingMesh | Ellipsoids, method: Method, body: str, material: str | Material | None, radar: Radar
) -> MovingMesh | Ellipsoids:
    if not isinstance(target, Motion):
        if isinstance(target, MovingMesh) and method == "ellipsoid":
            raise InputError(
                f"method 'ellipsoid' needs a Motion or Ellipsoids, got the mesh {target.name}; use method 'mesh'"
            )
        return target
    make = skin if method == "mesh" else segments
    return make(_placed(target, radar), body, material="skin" if material is None else material)


def _placed(motion: Motion, radar: Radar) -> Motion:
    """A motion as it is where somebody placed it, else before the radar."""
    return motion if motion.placed else place(motion, radar_position_m=radar.position_m, boresight=radar.boresight)


def _shared_time(shapes: Sequence[MovingMesh | Ellipsoids]) -> tuple[float, float]:
    """First and last moment that all targets share [s]."""
    start = max(float(s.times_s[0]) for s in shapes)
    stop = min(float(s.times_s[-1]) for s in shapes)
    if not stop > start:
        raise InputError(
            f"the targets share no time (last start {start:.6g} s, first end {stop:.6g} s); give overlapping times_s"
        )
    return start, stop


def _frames(shapes: Sequence[MovingMesh | Ellipsoids], radar: Radar, rate_hz: float | None) -> np.ndarray:
    """Surface frames over the time that all targets share [s]."""
    start, stop = _shared_time(shapes)
    if rate_hz is None:
        rate_hz = max(needed_rate_hz(shape, radar, start, stop) for shape in shapes)
    return np.linspace(start, stop, max(4, int(np.ceil((stop - start) * rate_hz)) + 1))


def _check_shape(shape: MovingMesh | Ellipsoids, radar: Radar, times_s: np.ndarray) -> None:
    step = min(1e-3, (times_s[-1] - times_s[0]) / 10)
    times = np.linspace(times_s[0], times_s[-1] - step, min(len(times_s), 200))
    if isinstance(shape, MovingMesh):
        check_outside(shape, radar, times_s)
    else:
        _check_outside_ellipsoids(shape, radar, times)
    points = [shape.at(t) if isinstance(shape, MovingMesh) else shape.at(t)[0] for t in (times, times + step)]
    places = (radar.tx_position_m, radar.rx_position_m)
    ranges = [np.mean([np.linalg.norm(p - place, axis=2) for place in places], axis=0) for p in points]
    name = shape.name
    check_speed(radar, float(np.abs(ranges[1] - ranges[0]).max() / step), what=name)
    farthest_m = float(ranges[0].max())
    if farthest_m > radar.max_range_m:
        warnings.warn(
            f"{name} is up to {farthest_m:.3g} m away, beyond the unambiguous {radar.max_range_m:.3g} m, and folds to a wrong "
            "range; place it nearer (distance_m) or take a radar with less bandwidth or more samples",
            T2DWarning,
            stacklevel=3,
        )


def _check_outside_ellipsoids(shape: Ellipsoids, radar: Radar, times_s: np.ndarray) -> None:
    centres, axes = shape.at(times_s)
    for antenna in (radar.tx_position_m, radar.rx_position_m):
        local = np.einsum("knji,knj->kni", axes, antenna - centres) / shape.semi_axes_m
        inside = np.sum(local**2, axis=2) < 1 + 1e-6
        if inside.any():
            frame, index = np.argwhere(inside)[0]
            where = ", ".join(f"{x:.3g}" for x in antenna)
            raise InputError(
                f"the radar at ({where}) m is inside {shape.names[index]} at {times_s[frame]:.3g} s; place the target farther "
                "away (distance_m) or move the radar"
            )


def _material(material: str | Material, radar: Radar) -> Material:
    """Values at mid-sweep: a body's material, or an ITU one by name."""
    if isinstance(material, Material) or material in BODY_MATERIALS:
        return resolve_material(material, radar.mid_frequency_hz)
    if not isinstance(material, str):
        raise InputError(f"material must be a name or a Material, got {material!r}")
    try:
        return itu_material(material, radar.mid_frequency_hz)
    except InputError as error:
        raise InputError(f"{error}; or one of {', '.join(BODY_MATERIALS)}") from None


def _check(
    targets: Any, radar: Any, method: str, phase_from: str, surface_rate_hz: float | None, occlusion_rate_hz: float,
    sagitta_rad: float | None, seed: int,
) -> None:  # fmt: skip
    if not isinstance(targets, Sequence) or not targets or not all(isinstance(each, Target) for each in targets):
        raise InputError(
            f"target must be a Motion, a MovingMesh, Ellipsoids, a mover or a list of them, got {targets!r:.60}; "
            "load_motion reads a file"
        )
    if not isinstance(radar, Radar):
        raise InputError(f"radar must be a Radar, got {radar!r:.60}; Radar.preset(name) makes one of a preset's name")
    numbers = {"surface_rate_hz": surface_rate_hz, "occlusion_rate_hz": occlusion_rate_hz, "sagitta_rad": sagitta_rad}
    for name, value in numbers.items():
        if not isinstance(value, (Real, type(None))):
            raise InputError(f"{name} must be a number, got {value!r}")
    if method not in ("mesh", "ellipsoid"):
        raise InputError(f"method must be 'mesh' or 'ellipsoid', got '{method}'")
    if surface_rate_hz is not None and not 10 <= surface_rate_hz <= 10_000:
        raise InputError(
            f"surface_rate_hz must lie in 10..10000 Hz, got {surface_rate_hz}; leave it out to let the motion decide"
        )
    if not 1 <= occlusion_rate_hz <= 1_000:
        raise InputError(f"occlusion_rate_hz must lie in 1..1000 Hz, got {occlusion_rate_hz}; 25 suits walking")
    if sagitta_rad is not None and not 0.01 <= sagitta_rad <= 2:
        raise InputError(
            f"sagitta_rad must lie in 0.01..2 rad, got {sagitta_rad}; 0.25 gives -22 dB, 0.07 gives 0.3 dB of RCS"
        )
    if phase_from not in ("specular", "centre"):
        raise InputError(f"phase_from must be 'specular' or 'centre', got {phase_from!r}")
    if not isinstance(seed, (int, np.integer)) or seed < 0:
        raise InputError(f"seed must be an integer of 0 or more, got {seed!r}")


def _check_room(reflections: Any, dynamic_range_db: Any, clutter: Any) -> None:
    if not isinstance(reflections, (int, np.integer)) or not 0 <= reflections <= 4:
        raise InputError(f"reflections must be an integer in 0..4, got {reflections!r}; 2 suits rooms")
    if not isinstance(dynamic_range_db, (int, float)) or not 0 <= dynamic_range_db <= 200:
        raise InputError(f"dynamic_range_db must lie in 0..200 dB, got {dynamic_range_db!r}; 60 suits most uses")
    if clutter not in ("specular", "diffuse", "none"):
        raise InputError(f"clutter must be 'specular', 'diffuse' or 'none', got {clutter!r}")


def _describe(target: Target) -> str:
    return target.report if isinstance(target, Motion) else repr(target)
