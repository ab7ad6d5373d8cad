"""The pipeline on one screen: motion -> body -> (visibility) -> echoes -> ADC cube; `Simulation` goes on from there."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import KW_ONLY, asdict, dataclass
from numbers import Real
from pathlib import Path
from typing import Any, Literal

import numpy as np

from t2d_rt.backend import Backend, Device, select
from t2d_rt.body import segments as fit_segments
from t2d_rt.body import skin as skin_body
from t2d_rt.body.materials import BODY_MATERIALS, resolve_material
from t2d_rt.cubes import Cube, summed
from t2d_rt.echo.ellipsoid import PhaseFrom, ellipsoid_echoes
from t2d_rt.echo.legs import View
from t2d_rt.echo.mesh import check_outside, joined, mesh_echoes
from t2d_rt.echo.rate import needed_rate_hz
from t2d_rt.errors import InputError, T2DWarning
from t2d_rt.motion import place, track
from t2d_rt.radar import check_speed
from t2d_rt.radar.synthesize import Progress, synthesize
from t2d_rt.result import Simulation, versions
from t2d_rt.room import (
    COARSE_RATE,
    ChosenPairs,
    Clutter,
    Collisions,
    checked_time,
    clutter_streams,
    coarse_views,
    coarser,
    find_ways,
    full_views,
)
from t2d_rt.scene import Mover, Room
from t2d_rt.trace.materials import itu_material
from t2d_rt.trace.scenes import load_scene
from t2d_rt.types import EchoStream, Ellipsoids, Material, Motion, MovingMesh, Radar, Scene

SAME_PACE = 2.0
"""Shapes whose surface rates differ by more are summed apart, each at its own."""
SWIFT = 8.0
"""Shapes that need more surface frames from one look at visibility to the next turn too fast to be looked at vertex by vertex."""

Method = Literal["mesh", "ellipsoid"]
Target = Motion | MovingMesh | Ellipsoids | Mover
Shape = MovingMesh | Ellipsoids


def simulate(
    target: Target | Sequence[Target],
    *,
    radar: Radar | None = None,
    scene: str | Path | Scene | Room = "free_space",
    reflections: int = 2,
    transmissions: int = 0,
    dynamic_range_db: float = 60.0,
    clutter: Clutter = "specular",
    collisions: Collisions = "warn",
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
    transmissions: greatest number of thin slabs passed on them; 2 for a target behind a partition.
    dynamic_range_db: pairs of ways weaker than the strongest one by more than that are left out.
    clutter: of the room itself, shadowed by the targets: "specular" (up to 3 reflections), "diffuse" (rough walls too) or "none".
    collisions: "warn" of targets that go through walls or furniture or start outside the room, "stop" just before, or "ignore" it.
    method: "mesh", physical optics of the skin, or "ellipsoid", one point for each segment of the body.
    seed: of the diffuse points; the same seed gives the same cube bit for bit.
    body: the template to skin.
    material: of everything but movers; by default a body's is "skin" and a mesh's its own.
    occlusion: whether targets hide themselves and one another (a room's furniture does so anyway): traced at the meshes' own
        vertices at `occlusion_rate_hz`, faded in between. Gaps under 4 mm are not seen.
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
    _check_room(reflections, transmissions, dynamic_range_db, clutter, collisions)
    backend, around = select(device), _around(scene)
    shapes = _shapes(targets, method, body, material, radar)
    span_s = _shared_time(shapes)
    if around is not None:
        moving = [_placed(t, radar) if isinstance(t, Motion) else s for t, s in zip(targets, shapes, strict=True)]
        names = [shape.name for shape in shapes]
        outside = transmissions > 0
        span_s = checked_time(collisions, around, moving, names, radar, span_s, outside=outside, backend=backend)
    needed_hz = [needed_rate_hz(shape, radar, *span_s) for shape in shapes]
    paces = _paces(span_s, needed_hz if surface_rate_hz is None else [surface_rate_hz] * len(shapes))
    for shape, times_s in zip(shapes, paces, strict=True):
        _check_shape(shape, radar, times_s)
    ways = None
    if around is not None:
        ways = find_ways(
            around, shapes, radar, span_s,
            order=reflections, transmissions=transmissions, range_db=dynamic_range_db, backend=backend,
        )  # fmt: skip
    model = _Model(
        radar, span_s, ways, material=material, body=body, phase_from=phase_from, sagitta_rad=sagitta_rad, seed=int(seed),
        occlusion=occlusion, rate_hz=occlusion_rate_hz, backend=backend,
    )  # fmt: skip
    swift = [
        rate > SWIFT * occlusion_rate_hz and not isinstance(target, Motion)
        for rate, target in zip(needed_hz, targets, strict=True)
    ]
    streams = model.streams(targets, shapes, paces, swift)
    static: dict[str, object] = {}
    if around is not None and clutter != "none":
        steady = [shape for shape, turns in zip(shapes, swift, strict=True) if occlusion and not turns]
        frames = min(paces, key=len)
        still, static = clutter_streams(
            clutter, around, steady, radar, frames, rate_hz=occlusion_rate_hz, seed=int(seed), backend=backend
        )
        streams += still
    cube = _synthesized(streams, radar, device, progress)
    settings: dict[str, Any] = {
        "method": method, "scene": "free_space" if around is None else around.name,
        "seed": int(seed), "body": body, "occlusion": occlusion,
        "material": "own" if material is None else material if isinstance(material, str) else asdict(material),
        "occlusion_rate_hz": float(occlusion_rate_hz), "surface_rate_hz": [float((len(t) - 1) / (t[-1] - t[0])) for t in paces],
        "sagitta_rad": "default" if sagitta_rad is None else float(sagitta_rad), "phase_from": phase_from, "device": backend.name,
        "targets": [_describe(each) for each in targets],
    }  # fmt: skip
    if ways is not None:
        settings |= {
            "reflections": int(reflections), "transmissions": int(transmissions), "collisions": collisions,
            "dynamic_range_db": float(dynamic_range_db), **ways.describe(), **static,
        }  # fmt: skip
    return Simulation(cube, radar, settings=settings, versions=versions())


@dataclass(frozen=True)
class _Model:
    """How targets become echoes; weak pairs of ways in less detail than strong ones."""

    radar: Radar
    span_s: tuple[float, float]
    ways: ChosenPairs | None
    """None in free space."""
    _: KW_ONLY
    material: str | Material | None
    body: str
    phase_from: PhaseFrom
    sagitta_rad: float | None
    seed: int
    occlusion: bool
    rate_hz: float
    """Of visibility."""
    backend: Backend

    def streams(
        self, targets: Sequence[Target], shapes: Sequence[Shape], paces: Sequence[np.ndarray], swift: Sequence[bool]
    ) -> list[EchoStream]:
        """Echoes of all targets at surface frames of their own, `paces` [s]; `swift` ones turn too fast to be looked at."""
        strong = [None] if self.ways is None else self.ways.pairs[: self.ways.strong]
        views = full_views(
            shapes, self.radar, strong,
            swift=swift, occlusion=self.occlusion, rate_hz=self.rate_hz, span_s=self.span_s, backend=self.backend,
        )  # fmt: skip
        return [s for each in zip(targets, shapes, paces, swift, views, strict=True) for s in self._of(*each)]

    def _of(
        self, target: Target, shape: Shape, times_s: np.ndarray, swift: bool, close: list[View]
    ) -> Iterator[EchoStream]:
        radar, ways = self.radar, self.ways
        material = shape.material if self.material is None or isinstance(target, Mover) else self.material
        common: dict[str, Any] = {"times_s": times_s, "material": _material(material, radar)}
        if isinstance(shape, Ellipsoids):
            weak = [] if ways is None else coarse_views(shape, ways.pairs[ways.strong :], self.rate_hz, self.span_s)
            yield ellipsoid_echoes(shape, radar, phase_from=self.phase_from, views=close + weak, **common)
            return
        detail: dict[str, Any] = {"seed": self.seed, "backend": self.backend, **common}
        bar = shape.sagitta_rad if self.sagitta_rad is None else self.sagitta_rad
        yield mesh_echoes(shape, radar, sagitta_rad=bar, views=close, **detail)
        if ways is None:
            return
        seldom = COARSE_RATE * self.rate_hz, self.span_s
        if weak := coarse_views(shape, ways.pairs[ways.strong : ways.clear], *seldom, swift=swift):
            yield mesh_echoes(shape, radar, views=weak, **coarser(bar), **detail)
        faint = ways.pairs[ways.clear :]
        if faint and isinstance(target, Motion):
            limbs = segments(_placed(target, radar), self.body)
            yield ellipsoid_echoes(limbs, radar, views=coarse_views(limbs, faint, *seldom), **common)
        elif faint:
            if swift:  # less often, too
                detail["times_s"] = np.linspace(*self.span_s, max(4, (len(times_s) + 1) // 2))
            views = coarse_views(shape, faint, *seldom, swift=swift)
            yield mesh_echoes(shape, radar, views=views, **coarser(bar, 2), **detail)


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
) -> list[Shape]:
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
) -> Shape:
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


def _shared_time(shapes: Sequence[Shape]) -> tuple[float, float]:
    """First and last moment that all targets share [s]."""
    start = max(float(s.times_s[0]) for s in shapes)
    stop = min(float(s.times_s[-1]) for s in shapes)
    if not stop > start:
        raise InputError(
            f"the targets share no time (last start {start:.6g} s, first end {stop:.6g} s); give overlapping times_s"
        )
    return start, stop


def _paces(span_s: tuple[float, float], rates_hz: Sequence[float]) -> list[np.ndarray]:
    """Surface frames of each shape [s] at its rate or more; those that need about the same rate share them."""
    paces: dict[float, np.ndarray] = {}
    for rate in sorted(rates_hz, reverse=True):
        if not paces or rate < min(paces) / SAME_PACE:
            paces[rate] = np.linspace(*span_s, max(4, math.ceil((span_s[1] - span_s[0]) * rate) + 1))
    return [paces[min(pace for pace in paces if pace >= rate)] for rate in rates_hz]


def _synthesized(streams: Sequence[EchoStream], radar: Radar, device: Device, progress: Progress | None) -> Cube:
    """The sum of streams, those of one pace together."""
    groups: dict[int, list[EchoStream]] = {}
    for stream in streams:
        groups.setdefault(len(stream.times_s), []).append(stream)

    def part(number: int) -> Progress | None:
        return None if progress is None else lambda share: progress((number + share) / len(groups))

    found = enumerate(groups.values())
    return summed(synthesize(joined(group), radar, device=device, progress=part(n)) for n, group in found)


def _check_shape(shape: Shape, radar: Radar, times_s: np.ndarray) -> None:
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


def _check_room(reflections: Any, transmissions: Any, dynamic_range_db: Any, clutter: Any, collisions: Any) -> None:
    if not isinstance(reflections, (int, np.integer)) or not 0 <= reflections <= 4:
        raise InputError(f"reflections must be an integer in 0..4, got {reflections!r}; 2 suits rooms")
    if not isinstance(transmissions, (int, np.integer)) or not 0 <= transmissions <= 4:
        raise InputError(f"transmissions must be an integer in 0..4, got {transmissions!r}; 2 sees behind a partition")
    if not isinstance(dynamic_range_db, (int, float)) or not 0 <= dynamic_range_db <= 200:
        raise InputError(f"dynamic_range_db must lie in 0..200 dB, got {dynamic_range_db!r}; 60 suits most uses")
    if clutter not in ("specular", "diffuse", "none"):
        raise InputError(f"clutter must be 'specular', 'diffuse' or 'none', got {clutter!r}")
    if collisions not in ("warn", "stop", "ignore"):
        raise InputError(f"collisions must be 'warn', 'stop' or 'ignore', got {collisions!r}")


def _describe(target: Target) -> str:
    return target.report if isinstance(target, Motion) else repr(target)
