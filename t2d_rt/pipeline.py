"""The pipeline on one screen: motion -> body -> (visibility) -> echoes -> ADC cube; `Recording` goes on from there."""

from __future__ import annotations

import inspect
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from t2d_rt.backend import Device, select
from t2d_rt.checks import choice, flag, instance, integer, shown, text
from t2d_rt.cost import check_memory
from t2d_rt.cubes import Cube
from t2d_rt.echo.ellipsoid import PhaseFrom
from t2d_rt.echo.mesh import REFINING_BYTES, check_outside
from t2d_rt.echo.streams import batches
from t2d_rt.errors import InputError, T2DWarning
from t2d_rt.experiment import Experiment, Inputs, Store, sources_of, stored_scene
from t2d_rt.memory import LIMIT_GB, Budget, after_call
from t2d_rt.model import (
    Method,
    Model,
    Target,
    farthest_and_fastest,
    geometries_of,
    placed,
    segments,
    shared_time,
    skin,
)
from t2d_rt.motion import placement
from t2d_rt.named import radar_named, target_named
from t2d_rt.probe import converged, measured_db
from t2d_rt.progress import shown_progress
from t2d_rt.radar import check_speed
from t2d_rt.radar.synthesize import Progress, synthesize
from t2d_rt.result import Recording, versions
from t2d_rt.room import Clutter, Collisions, Geometry, checked_time, find_path_pairs
from t2d_rt.scene import Room
from t2d_rt.tolerance import Plan, check_tolerance, planned
from t2d_rt.trace.scenes import load_scene
from t2d_rt.types import Accuracy, EchoStream, Ellipsoids, Material, Motion, MovingMesh, Radar, Scene
from t2d_rt.types.material import checked_material

T = TypeVar("T")

__all__ = ["plan", "segments", "simulate", "skin"]

PREPARING = (
    "radar", "scene", "reflections", "transmissions", "clutter", "collisions", "method", "seed", "body", "material",
    "phase_from", "device", "memory_gb",
)  # fmt: skip
"""Options of `simulate` that say what there is."""
PILOT_S = 0.5, 2.0
"""Lengths of the pieces that a plan tries."""
JUMP_MPS = 300.0
"""Between two frames nobody moves faster; a jump of 2.5 m in a file of 120 frames a second does."""
BESIDE_CLUTTER_DB = -50.0
"""Error of the sum where there is clutter, at most."""


def simulate(
    target: Target | str | Path | Sequence[Target | str | Path],
    *,
    radar: Radar | str | Path | None = None,
    scene: str | Path | Scene | Room = "free_space",
    tolerance_db: float | None = None,
    accuracy: Accuracy | Mapping[str, Any] | None = None,
    reflections: int = 2,
    transmissions: int = 0,
    clutter: Clutter = "specular",
    collisions: Collisions = "warn",
    method: Method = "mesh",
    seed: int = 0,
    body: str = "adult",
    material: str | Material | None = None,
    phase_from: PhaseFrom = "specular",
    measure_error: bool | None = None,
    device: Device = "auto",
    memory_gb: float = LIMIT_GB,
    progress: Progress | bool | None = None,
) -> Recording:
    """Radar recording of a motion, a moving mesh, ellipsoids, or a list of them with movers (fans, pets) among them.

    Parameters
    ----------
    target: a `Motion` is skinned ("mesh") or given segments ("ellipsoid"), and placed before the radar (see `place`) where its
        `placed` is False; where that is None, with a warning. The settings' "placement" tells what was done. A motion may also be
        given as its file, or as the name of a bundled one (`examples`).
        The record is the time that all targets share, movers going on for as long; its own clock starts at 0.
    radar: a `Radar`, a preset's name (`presets`) or a .yaml file; the `table2` preset by default.
    scene: "free_space", a room by name, a Mitsuba/Sionna XML file, a `Room` or a `Scene`.
    tolerance_db: error to keep to [dB], the energy of the field's difference from a converged model of the targets over the field's
        energy: model, facets, rates, visibility and path tiers follow from it (`plan` tells how).
    accuracy: an `Accuracy`, or a mapping of its fields, that says how finely targets are modelled; with a tolerance the fields that
        it sets stay. The default comes to about -22 dB for a walk in free space, to -6 to -12 dB in rooms.
    reflections: greatest number of reflections on the paths out and back together.
    transmissions: greatest number of thin slabs passed on them; 2 for a target behind a partition.
    clutter: of the room itself, shadowed by the targets: "specular" (up to 3 reflections), "diffuse" (rough walls too) or "none".
    collisions: "warn" of targets that go through walls or furniture, or are outside the room, "stop" just before, or "ignore" it;
        a radar outside is told, too, unless `transmissions` let it look in.
    method: "mesh", physical optics of the skin, or "ellipsoid", one point for each segment of the body.
    seed: of the diffuse points; the same seed gives the same cube bit for bit.
    body: the template to skin.
    material: of everything but movers; by default a body's is "skin" and a mesh's its own.
    phase_from: of the ellipsoid model: its "specular" point, or its "centre" as in the Text2Doppler paper.
    measure_error: whether a few random chirps are made again at far finer settings, and the error that this shows is kept in
        `Recording.error_db`; by default where a tolerance is given.
    device: "auto" takes a CUDA device where there is one.
    memory_gb: what the run may take [GB]: work is done in blocks to stay below it, and what needs more is refused beforehand.
        It does not change the result.
    progress: True shows a bar, on a terminal or in a notebook, or a line now and then in a log; a function is called with the
        share done, 0..1.
    """
    given = checked_accuracy(accuracy)
    if measure_error is not None:
        flag("measure_error", measure_error)
    progress = shown_progress(progress, method)
    if tolerance_db is not None:
        check_tolerance(tolerance_db)
    model = _prepared(
        target, radar, scene, reflections, transmissions, clutter, collisions, method, seed, body, material,
        phase_from, device, memory_gb,
    )  # fmt: skip
    chosen = None if tolerance_db is None else planned(model, tolerance_db, given)
    accuracy = given if chosen is None else chosen.accuracy
    if chosen is not None:
        model = chosen.model
    still, static = model.clutter(clutter, accuracy)
    measure = chosen is not None if measure_error is None else measure_error
    streams = [*model.streams(accuracy), *still]
    check_memory(model, streams, measured=measure)
    cube = _synthesized(streams, model.radar, _sum_db(accuracy, still), device, model.memory, progress)
    del streams
    settings = _settings(model, accuracy)
    if model.scene is not None:
        settings |= {
            "reflections": int(reflections), "transmissions": int(transmissions), "collisions": collisions, **static,
        }  # fmt: skip
    if chosen is not None:
        settings["tolerance_db"] = float(chosen.tolerance_db)
    if measure:
        error_db, hidden = (-20.0, True) if chosen is None else (chosen.error_db, chosen.hidden)
        settings["error_db"] = measured = measured_db(model, accuracy, cube, still, error_db=error_db, hidden=hidden)
        if chosen is not None and measured > chosen.tolerance_db + 1:
            warnings.warn(
                f"the measured error of {measured:.1f} dB misses the tolerance of {chosen.tolerance_db:g} dB; plan tells what "
                "costs most",
                T2DWarning,
                stacklevel=2,
            )
    after_call()
    store = Store({})
    experiment = Experiment(
        targets=sources_of(model.targets, store), radar=model.radar, scene=stored_scene(model.scene, store),
        reflections=reflections, transmissions=transmissions, clutter=clutter, collisions=collisions, method=model.method,
        body=body, material=material, phase_from=phase_from, seed=model.seed,
    )  # fmt: skip
    return Recording(
        cube,
        model.radar,
        experiment=experiment,
        accuracy=accuracy,
        inputs=store.inputs,
        settings=settings,
        versions=versions(),
    )


def run(
    experiment: Experiment | Recording,
    *,
    tolerance_db: float | None = None,
    accuracy: Accuracy | Mapping[str, Any] | None = None,
    measure_error: bool | None = None,
    device: Device = "auto",
    memory_gb: float = LIMIT_GB,
    progress: Progress | None = None,
) -> Recording:
    """The recording of an experiment; or that of a recording again, at its own accuracy: the same samples, bit for bit, on the same
    machine.

    Parameters
    ----------
    experiment: files that it names are looked for in the working directory.
    tolerance_db, accuracy, measure_error, device, memory_gb, progress: as in `simulate`.
    """
    instance("experiment", experiment, (Experiment, Recording), "an Experiment or a Recording")
    inputs: Inputs = {}
    diagnostics: dict[str, Any] = {}
    if isinstance(experiment, Recording):
        again = experiment
        if again.experiment is None:
            raise InputError(
                "a measured recording cannot be simulated again; give an Experiment or a simulated recording"
            )
        if tolerance_db is None and accuracy is None:
            accuracy = again.accuracy
            diagnostics = {n: again.settings[n] for n in ("error_db", "tolerance_db") if n in again.settings}
        experiment, inputs = again.experiment, again.inputs
        if experiment.lost is not None:
            raise InputError(
                f"the recording cannot be made again: {experiment.lost} was computed by a function, which is not stored"
            )
    with warnings.catch_warnings():
        if inputs:  # these warned when the recording was first made
            warnings.simplefilter("ignore", T2DWarning)
        targets, scene = experiment.targets_from(inputs), experiment.scene_from(inputs)
    made = simulate(
        targets, radar=experiment.radar, scene=scene, reflections=experiment.reflections,
        transmissions=experiment.transmissions, clutter=experiment.clutter, collisions=experiment.collisions,
        method=experiment.method, body=experiment.body, material=experiment.material, phase_from=experiment.phase_from,
        seed=experiment.seed, tolerance_db=tolerance_db, accuracy=accuracy, measure_error=measure_error, device=device,
        memory_gb=memory_gb, progress=progress,
    )  # fmt: skip
    made.settings |= diagnostics
    return made


def plan(
    target: Target | str | Path | Sequence[Target | str | Path], *, tolerance_db: float = -20.0, **options: Any
) -> Plan:
    """What `simulate` would model with these `options` of its own to keep to a tolerance, what it would leave out and what that
    costs."""
    known = {name: each.default for name, each in inspect.signature(simulate).parameters.items() if name != "target"}
    unknown = [name for name in options if name not in known]
    if unknown:
        raise InputError(f"unknown option {unknown[0]!r} of plan; choose from {', '.join(known)}")
    given = known | options
    wanted = checked_accuracy(given["accuracy"])
    check_tolerance(tolerance_db)
    model, preparing = _timed(lambda: _prepared(target, **{name: given[name] for name in PREPARING}))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", T2DWarning)
        planned(model, tolerance_db, wanted)  # compiles kernels
    chosen, planning = _timed(lambda: planned(model, tolerance_db, wanted))
    # Rates of the whole record, before pieces are tried.
    chosen.model.frame_times(chosen.accuracy), chosen.model.fast_rotating(chosen.accuracy)
    still, _ = chosen.model.clutter(given["clutter"], chosen.accuracy)
    streams = [*chosen.model.streams(chosen.accuracy), *still]
    memory = check_memory(chosen.model, streams, measured=given["measure_error"] is not False)
    del streams, still
    tried = [_tried(chosen, length, given["clutter"], given["device"]) for length in (PILOT_S[1], *PILOT_S)]
    (short, first), (long, second) = tried[1:]
    per_second = max(0.0, second - first) / (long - short) if long > short else 0.0
    length = model.span_s[1] - model.span_s[0]
    running = second + per_second * (length - long)
    for _ in range(2):  # the first one compiles
        _, measuring = _timed(lambda: converged(chosen.model, chosen.accuracy, chosen.error_db, hidden=chosen.hidden))
    seconds = {"preparing": preparing, "planning": planning, "running": running, "measuring": measuring}
    after_call()
    return replace(chosen, seconds=seconds, memory_bytes=memory)


def _tried(chosen: Plan, length_s: float, clutter: Clutter, device: Device) -> tuple[float, float]:
    """What a piece in the middle of the record is long, and takes with its spectrogram [s]."""
    start, stop = chosen.model.span_s
    length_s = min(length_s, stop - start)
    middle = (start + stop - length_s) / 2
    model, accuracy = replace(chosen.model, span_s=(middle, middle + length_s)), chosen.accuracy

    def run() -> None:
        still, _ = model.clutter(clutter, accuracy)
        streams = [*model.streams(accuracy), *still]
        cube = _synthesized(streams, model.radar, _sum_db(accuracy, still), device, model.memory, None)
        Recording(cube, model.radar).spectrogram  # noqa: B018

    return length_s, _timed(run)[1]


def _sum_db(accuracy: Accuracy, still: Sequence[EchoStream]) -> float:
    """Error of the sum: static echoes are far stronger than those of a walker."""
    return min(accuracy.synthesis_error_db, BESIDE_CLUTTER_DB) if still else accuracy.synthesis_error_db


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    """What it gives, and how long it takes [s]."""
    begin = time.perf_counter()
    return work(), time.perf_counter() - begin


def _prepared(
    target: Any, radar: Any, scene: str | Path | Scene | Room, reflections: int,
    transmissions: int, clutter: Clutter, collisions: Collisions, method: Method, seed: int, body: str,
    material: str | Material | None, phase_from: PhaseFrom, device: Device, memory_gb: float,
) -> Model:  # fmt: skip
    """The targets in their places, and the path pairs to them."""
    memory = Budget.of(memory_gb)
    target, radar = target_named(target), radar_named(radar)
    radar = Radar.preset("table2") if radar is None else radar
    targets = [target] if isinstance(target, Target) else target
    _check(targets, radar, method, phase_from, seed)
    _check_room(reflections, transmissions, clutter, collisions)
    text("body", body)
    if material is not None:
        checked_material(material)
    targets = [_placed(each, radar) if isinstance(each, Motion) else each for each in targets]
    backend, around = select(device), _around(scene)
    shapes = geometries_of(targets, method, body, material, radar)
    span_s = shared_time(shapes)
    if around is not None:
        moving = [placed(t, radar) if isinstance(t, Motion) else s for t, s in zip(targets, shapes, strict=True)]
        names = [shape.name for shape in shapes]
        outside = transmissions > 0
        span_s = checked_time(collisions, around, moving, names, radar, span_s, outside=outside, backend=backend)
    for shape in shapes:
        if isinstance(shape, MovingMesh):
            size = len(shape.faces)
            memory.check(REFINING_BYTES * size, f"{shape.name} of {size} faces", "give it in fewer triangles")
        _check_shape(shape, radar, span_s)
    ranked = []
    if around is not None:
        ranked = find_path_pairs(
            around, shapes, radar, span_s, order=reflections, transmissions=transmissions, backend=backend
        )
    return Model(
        radar, targets, shapes, span_s, around, ranked, method=method, material=material, body=body,
        phase_from=phase_from, seed=int(seed), backend=backend, memory=memory,
    )  # fmt: skip


def _placed(motion: Motion, radar: Radar) -> Motion:
    """The motion before the radar; a warning where that moves what may have stood in its place already."""
    found = placed(motion, radar)
    _check_steps(found)
    if motion.placed is None:
        warnings.warn(
            f"the motion was {placement(found)}, as it does not say whose its coordinates are; give motion_from_joints placed=True "
            "to keep them as those of the world, or placed=False to have it placed",
            T2DWarning,
            stacklevel=4,
        )
    return found


def _check_steps(motion: Motion) -> None:
    """Refuses a motion that jumps: between two frames nobody moves as fast, and a spline through the jump means nothing."""
    speeds = np.linalg.norm(np.diff(motion.joints, axis=0), axis=-1) * motion.rate_hz
    frame, joint = np.unravel_index(int(speeds.argmax()), speeds.shape)
    if speeds[frame, joint] > JUMP_MPS:
        raise InputError(
            f"the motion jumps: {motion.names[joint]} moves by {speeds[frame, joint] / motion.rate_hz:.3g} m from frame {frame} to "
            f"{frame + 1} ({frame / motion.rate_hz:.4g} s), at {speeds[frame, joint]:.3g} m/s; cut or repair the motion there"
        )


def _settings(model: Model, accuracy: Accuracy) -> dict[str, Any]:
    """What a result was made with."""
    pairs, material = model.pairs(accuracy), model.material
    return {
        "method": model.method, "scene": "free_space" if model.scene is None else model.scene.name,
        "seed": model.seed, "body": model.body, "accuracy": accuracy.model_dump(mode="json"),
        "material": "own" if material is None else material if isinstance(material, str) else asdict(material),
        "surface_rates_hz": [float((len(t) - 1) / (t[-1] - t[0])) for t in model.frame_times(accuracy)],
        "phase_from": model.phase_from, "device": model.backend.name,
        "targets": [each.report if isinstance(each, Motion) else repr(each) for each in model.targets],
        "placement": [placement(each) if isinstance(each, Motion) else "own coordinates" for each in model.targets],
        **({} if pairs is None else pairs.describe()),
    }  # fmt: skip


def _around(scene: Any) -> Scene | None:
    """What stands around the targets; None in free space."""
    if isinstance(scene, Room):
        return scene.scene()
    if isinstance(scene, Scene):
        return scene
    if not isinstance(scene, (str, Path)):
        raise InputError(f"scene must be a name, a path, a Room or a Scene, got {shown(scene)}")
    return None if scene == "free_space" else load_scene(scene)


def _synthesized(
    streams: Sequence[EchoStream],
    radar: Radar,
    tolerance_db: float,
    device: Device,
    memory: Budget,
    progress: Progress | None,
) -> Cube:
    """The sum of streams, those of one pace together as far as memory allows."""
    found = batches(streams, radar)

    def part(number: int) -> Progress | None:
        return None if progress is None else lambda share: progress((number + share) / len(found))

    cube = None
    for done, batch in enumerate(found):
        cube = synthesize(
            batch, radar, tolerance_db=tolerance_db, device=device, onto=cube, memory=memory, progress=part(done)
        )  # fmt: skip
    assert cube is not None, "a simulation has at least one target"
    return cube


def _check_shape(shape: Geometry, radar: Radar, span_s: tuple[float, float]) -> None:
    name = shape.name
    if isinstance(shape, MovingMesh):
        check_outside(shape, radar, np.array(span_s))
    else:
        _check_outside_ellipsoids(shape, radar, np.linspace(*span_s, 200))
    farthest_m, fastest_mps = farthest_and_fastest(shape, radar, span_s)
    check_speed(radar, fastest_mps, what=name)
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


def _check(targets: Any, radar: Any, method: str, phase_from: str, seed: int) -> None:
    if not isinstance(targets, Sequence) or not targets or not all(isinstance(each, Target) for each in targets):
        raise InputError(
            f"target must be a Motion, a MovingMesh, Ellipsoids, a mover or a list of them, got {shown(targets)}; "
            "load_motion reads a file"
        )
    if not isinstance(radar, Radar):
        raise InputError(f"radar must be a Radar, got {shown(radar)}; Radar.preset(name) makes one of a preset's name")
    choice("method", method, ("mesh", "ellipsoid"))
    choice("phase_from", phase_from, ("specular", "centre"))
    integer("seed", seed)


def checked_accuracy(accuracy: Accuracy | Mapping[str, Any] | None) -> Accuracy:
    """An `Accuracy`, or one of the fields given; the default one for None."""
    if accuracy is None:
        return Accuracy()
    if isinstance(accuracy, Accuracy):
        return accuracy
    if not isinstance(accuracy, Mapping):
        raise InputError(
            f"accuracy must be an Accuracy or a mapping of its fields, got {shown(accuracy)}; {{'sagitta_rad': 0.2}} is one"
        )
    return Accuracy.model_validate(accuracy)


def _check_room(reflections: Any, transmissions: Any, clutter: Any, collisions: Any) -> None:
    integer("reflections", reflections, 0, 4, hint="2 suits rooms")
    integer("transmissions", transmissions, 0, 4, hint="2 sees behind a partition")
    choice("clutter", clutter, ("specular", "diffuse", "none"))
    choice("collisions", collisions, ("warn", "stop", "ignore"))
