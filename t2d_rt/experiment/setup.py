"""`Setup`: an experiment that is ready to run: targets placed, on one clock, checked against radar and room, with their path
pairs."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.body.outfit import outfit_of
from t2d_rt.core.backend import one_blas_thread, select
from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError, T2DWarning, warn
from t2d_rt.core.memory import LIMIT_GB, MemoryLimit, blocks
from t2d_rt.core.stored_arrays import Inputs, Store
from t2d_rt.experiment.catalog import target_named
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.geometry import winding
from t2d_rt.geometry.vectors import inner, unit
from t2d_rt.motion import placement
from t2d_rt.motion.jumps import jumps, told, told_before
from t2d_rt.noise.receiver import check_receiver
from t2d_rt.pipeline.echo_model import Model, farthest_and_fastest
from t2d_rt.pipeline.path_pairs import find_path_pairs, switched_on, within_reach
from t2d_rt.pipeline.targets import TargetLike, placed, shared_time, targets_of
from t2d_rt.propagation.collisions import checked_time
from t2d_rt.propagation.edges import SceneBlockage
from t2d_rt.propagation.materials import check_values
from t2d_rt.propagation.scene_paths import probes
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.radar import check_speed
from t2d_rt.scattering.paths import Ranked
from t2d_rt.scattering.refinement import REFINING_BYTES
from t2d_rt.scene import Mover, Room
from t2d_rt.types import Accuracy, Ellipsoids, Motion, MovingMesh, Radar, Scene
from t2d_rt.types.antennas import ONE_VIEW_M
from t2d_rt.types.ellipsoids import Geometry
from t2d_rt.types.receiver import Receiver

JUMP_MPS = 300.0
"""Greatest speed of a joint between two frames [m/s]; a jump of 2.5 m at 120 frames a second just reaches it."""

MOSTLY_MONOSTATIC_M = 1e-6
"""Distance of transmitters and receivers below which they count as being in one place [m]."""

BISTATIC_DEG = 120.0
"""Greatest angle between transmitter and receiver as seen from a target [deg]. At this angle the field of a sphere of 10 cm by
physical optics is up to 0.9 dB off Mie's series at 77 GHz (20 cm 0.6 dB, 3 cm 1.4 dB), at 130 to 150 degrees up to 2.5 dB, because
its shadow boundary is too sharp."""

BISTATIC_DB = -10.0
"""Level of a path pair, relative to the strongest one, from which there is a warning of such an angle [dB]: an error of 2.5 dB is
then 10 % of the strongest pair's field."""

LEAST_CUT_S = 0.05
"""Part of a motion beyond the end of the record from which there is a warning [s]; durations in whole frames differ by less."""


@dataclass(frozen=True, slots=True)
class Setup:
    """An experiment that is ready to run."""

    experiment: Experiment
    inputs: Inputs
    """Arrays to which the experiment refers, by their hash."""
    model: Model
    """How its targets become echoes."""

    def described(self, model: Model, accuracy: Accuracy) -> dict[str, Any]:
        """Settings that describe how a recording was made; `model` may be a simplified one of this setup."""
        pairs, material, experiment = model.pairs(accuracy), model.material, self.experiment
        room = {name: getattr(experiment, name) for name in ("reflections", "transmissions", "collisions")}
        return {
            "method": model.method,
            "scene": "free_space" if model.scene is None else model.scene.name,
            "seed": model.seed,
            "body": model.body,
            "accuracy": accuracy.model_dump(mode="json"),
            "material": "own" if material is None else material if isinstance(material, str) else asdict(material),
            "surface_rates_hz": [float((len(t) - 1) / (t[-1] - t[0])) for t in model.frame_times(accuracy)],
            "phase_from": model.phase_from,
            "bounces": model.bounces,
            "device": model.backend.name,
            "targets": [target.report if isinstance(target, Motion) else repr(target) for target in model.targets],
            "placement": [
                placement(target) if isinstance(target, Motion) else "own coordinates" for target in model.targets
            ],
            **({} if pairs is None else {**pairs.describe(), **room}),
        }


def set_up(
    target: Any, scene: Any, experiment: Experiment, *, device: str = "auto", memory_gb: float = LIMIT_GB
) -> Setup:
    """Sets up one target or several in a scene, which replace those of the experiment, and checks them all."""
    memory, radar = MemoryLimit.of(memory_gb), experiment.radar
    whole = _scene_of(scene, radar)  # checked before the targets, as reading a motion takes longer
    targets = placed_targets(target, radar)
    if experiment.material is not None:
        outfit_of(experiment.material)  # refuses anything that is neither a material nor an outfit
    scene = None if whole is None else within_reach(whole, radar)
    if isinstance(experiment.noise, Receiver):
        check_receiver(radar, experiment.noise)
    backend = select(device)
    modelled = targets_of(targets, experiment.method, experiment.body, experiment.material, radar)
    geometries = [modelled_target.geometry for modelled_target in modelled]
    span_s = shared_time(geometries)
    sources = [modelled_target.source for modelled_target in modelled]
    _tell_of_cuts(sources, geometries, span_s[1])
    if experiment.method == "ellipsoid" and any(isinstance(source, Motion) and source.carries for source in sources):
        warn("by ellipsoids a body and what it carries do not hide each other; take method='mesh' where that matters")
    if radar.track is not None:
        _tell_of_track(sources, span_s)
    if scene is not None:
        span_s = checked_time(
            experiment.collisions,
            scene,
            [modelled_target.tested for modelled_target in modelled],
            [geometry.name for geometry in geometries],
            radar,
            span_s,
            outside=experiment.transmissions > 0,
            backend=backend,
        )
    for geometry in geometries:
        if isinstance(geometry, MovingMesh):
            size = len(geometry.faces)
            memory.check(REFINING_BYTES * size, f"{geometry.name} of {size} faces", "give it in fewer triangles")
        _check_geometry(geometry, radar, span_s)
    ranked: list[Ranked] = []
    blockage = SceneBlockage({})
    if scene is not None:
        ranked, blockage = find_path_pairs(
            scene,
            geometries,
            radar,
            span_s,
            order=experiment.reflections,
            transmissions=experiment.transmissions,
            backend=backend,
        )
    paths_on = switched_on(ranked, experiment.only_paths, experiment.without_paths)
    _tell_of_bistatic(
        [entry for entry in ranked if paths_on is None or entry.pair.name in paths_on], geometries, radar, span_s
    )
    model = Model(
        radar,
        modelled,
        span_s,
        scene,
        ranked,
        blockage,
        method=experiment.method,
        material=experiment.material,
        body=experiment.body,
        phase_from=experiment.phase_from,
        seed=experiment.seed,
        backend=backend,
        memory=memory,
        bounces=experiment.bounces,
        paths_on=paths_on,
    )
    store = Store({})
    return Setup(experiment.stored_with(targets, whole, store), store.inputs, model)


def placed_targets(target: Any, radar: Radar) -> list[TargetLike]:
    """The checked targets as a list, with motions placed before the radar."""
    target = target_named(target)
    targets = [target] if isinstance(target, TargetLike) else target
    if not isinstance(targets, Sequence) or not targets or not all(isinstance(item, TargetLike) for item in targets):
        raise InputError(
            f"target must be a Motion, a MovingMesh, Ellipsoids, a mover or a list of them, got {shown(targets)}; "
            "load_motion reads a file"
        )
    return [_placed(item, radar) if isinstance(item, Motion) else item for item in targets]


def set_up_stored(
    experiment: Experiment, inputs: Inputs, *, device: str = "auto", memory_gb: float = LIMIT_GB
) -> Setup:
    """Sets up an experiment with the targets and the scene that it names; their arrays are in `inputs`."""
    targets, scene = experiment.targets_from(inputs), experiment.scene_from(inputs)
    return set_up(targets, scene, experiment, device=device, memory_gb=memory_gb)


def set_up_again(
    experiment: Experiment | None, inputs: Inputs, *, device: str = "auto", memory_gb: float = LIMIT_GB
) -> Setup:
    """Sets up the experiment of a recording again, to compute anything but its samples; warnings were given the first time."""
    if experiment is None:
        raise InputError("the recording was measured: it has no experiment, from which paths and truth are worked out")
    experiment = repeatable(experiment)
    with warnings.catch_warnings(), one_blas_thread:
        warnings.simplefilter("ignore", T2DWarning)
        return set_up_stored(experiment, inputs, device=device, memory_gb=memory_gb)


def repeatable(experiment: Experiment | None) -> Experiment:
    """The experiment of a recording; refuses a measured recording, and one with a target that was not stored."""
    if experiment is None:
        raise InputError(
            "the recording was measured and has no experiment, so it cannot be simulated again; give an Experiment"
        )
    if experiment.lost is not None:
        raise InputError(
            f"the recording cannot be made again: {experiment.lost} was computed by a function, which is not stored"
        )
    return experiment


def _placed(motion: Motion, radar: Radar) -> Motion:
    """The motion placed before the radar; warns if its coordinates may already have been those of the world."""
    placed_motion = placed(motion, radar)
    _check_steps(placed_motion)
    if motion.placed is None:
        warn(
            f"the motion was {placement(placed_motion)}, as it does not say whether its coordinates are those of the world; give "
            "motion_from_joints placed=True to keep them, or placed=False to have it placed"
        )
    return placed_motion


def _tell_of_cuts(targets: Sequence[TargetLike], geometries: Sequence[Geometry], stop_s: float) -> None:
    """Warns of a motion that is longer than the record, which ends with the first target that ends."""
    # Movers last for the time that the others have in common, and the user chooses the length of a mesh.
    ends_s = [
        np.inf if isinstance(t, Mover) else float(g.times_s[-1]) for t, g in zip(targets, geometries, strict=True)
    ]
    motions = [place for place, target in enumerate(targets) if isinstance(target, Motion)]
    longest = max(motions, key=ends_s.__getitem__, default=None)
    if longest is None or ends_s[longest] <= stop_s + LEAST_CUT_S:
        return
    names = [
        f"target {number} ({t.origin[0].partition(',')[0] if isinstance(t, Motion) and t.origin else g.name})"
        for number, (t, g) in enumerate(zip(targets, geometries, strict=True), start=1)
    ]
    warn(
        f"the record ends with {names[ends_s.index(min(ends_s))]} at {stop_s:.4g} s, and of the {ends_s[longest]:.4g} s of "
        f"{names[longest]} the last {ends_s[longest] - stop_s:.4g} s are left out; give both for the same time (start_s, stop_s), "
        "or simulate them apart"
    )


def _tell_of_track(sources: Sequence[Any], span_s: tuple[float, float]) -> None:
    """Warns of a record that is shortened by the radar's track although all targets are known for longer."""
    start_s, stop_s = span_s
    begin_s = max(float(source.times_s[0]) for source in sources if not isinstance(source, Mover))
    ends_s = [float(source.times_s[-1]) for source in sources if not isinstance(source, Mover)]
    if start_s > begin_s:
        warn(
            f"the record begins with the radar's track at {start_s:.6g} s, and the targets at {begin_s:.6g} s, of which the first "
            f"{start_s - begin_s:.4g} s are left out; give a track that begins no later than they do"
        )
    if min(ends_s) > stop_s + LEAST_CUT_S:
        warn(
            f"the record ends with the radar's track at {stop_s:.4g} s, and the targets go on to {min(ends_s):.4g} s; give a "
            "longer track, or targets for the same time"
        )


def _check_steps(motion: Motion) -> None:
    """Warns of jumps of which the reader has not warned, and refuses jumps that make a spline meaningless."""
    speeds = np.linalg.norm(np.diff(motion.joints, axis=0), axis=-1) * motion.rate_hz
    frame, joint = np.unravel_index(int(speeds.argmax()), speeds.shape)
    if speeds[frame, joint] > JUMP_MPS:
        raise InputError(
            f"the motion jumps: {motion.names[joint]} moves by {speeds[frame, joint] / motion.rate_hz:.3g} m from frame {frame} to "
            f"{frame + 1} ({frame / motion.rate_hz:.4g} s), at {speeds[frame, joint]:.3g} m/s; cut or repair the motion there"
        )
    found_jumps = jumps(motion.joints, motion.names, motion.rate_hz)
    if found_jumps and not told_before(motion.report):
        warn(f"{told(found_jumps)}; a radar sees that as fast movement: cut or repair the motion there")


def _scene_of(scene: Any, radar: Radar) -> Scene | None:
    """The scene with material values at the radar's frequency; None in free space."""
    if isinstance(scene, Room):
        scene = scene.scene()
    if isinstance(scene, Scene):
        check_values((surface.material for surface in scene.surfaces), radar.mid_frequency_hz)
        return scene
    if not isinstance(scene, (str, Path)):
        raise InputError(f"scene must be a name, a path, a Room or a Scene, got {shown(scene)}")
    return None if scene == "free_space" else load_scene(scene, frequency_hz=radar.mid_frequency_hz)


def _check_geometry(geometry: Geometry, radar: Radar, span_s: tuple[float, float]) -> None:
    name = geometry.name
    if isinstance(geometry, MovingMesh):
        check_outside(geometry, radar, np.array(span_s))
    else:
        _check_outside_ellipsoids(geometry, radar, np.linspace(*span_s, 200))
    _check_bistatic(geometry, radar, span_s)
    farthest_m, fastest_mps = farthest_and_fastest(geometry, radar, span_s)
    check_speed(radar, fastest_mps, what=name)
    if farthest_m > radar.max_range_m:
        warn(
            f"{name} is up to {farthest_m:.3g} m away, beyond the unambiguous {radar.max_range_m:.3g} m, from where the IF filter "
            "lets no echo through; place it nearer (distance_m) or take a radar with less bandwidth or more samples"
        )


def _check_bistatic(geometry: Geometry, radar: Radar, span_s: tuple[float, float]) -> None:
    """Refuses a target between the antennas, where physical optics without diffraction does not hold."""
    antennas = radar.tx_position_m, radar.rx_position_m
    apart_m = np.linalg.norm(antennas[0] - antennas[1])
    if apart_m < MOSTLY_MONOSTATIC_M:
        return
    times_s = np.linspace(*span_s, 50)
    # Between antennas of separate boards a target may pass from one of these instants to the next.
    if apart_m > ONE_VIEW_M:
        own_s = geometry.times_s
        times_s = np.union1d(np.linspace(*span_s, 200), own_s[(own_s >= span_s[0]) & (own_s <= span_s[1])])
    for times in blocks(times_s, geometry.point_count):
        points = geometry.points_at(times)
        paths = [(antenna - points) / np.linalg.norm(antenna - points, axis=-1, keepdims=True) for antenna in antennas]
        angle_deg = np.degrees(np.arccos(np.clip(np.sum(paths[0] * paths[1], axis=-1), -1, 1))).max(axis=1)
        if angle_deg.max() > BISTATIC_DEG:
            raise InputError(
                f"at {times[angle_deg.argmax()]:.3g} s {geometry.name} lies between transmitter and receiver, which it sees "
                f"{angle_deg.max():.0f} degrees apart; echoes are modelled up to {BISTATIC_DEG:g} degrees: place the target "
                "farther away (distance_m), or the antennas nearer together"
            )


def _tell_of_bistatic(
    ranked: Sequence[Ranked], geometries: Sequence[Geometry], radar: Radar, span_s: tuple[float, float]
) -> None:
    """Warns where separated antennas see a target from almost opposite sides over a strong reflected path pair.

    A radar in one place has such pairs, too: out on the direct path and back by a wall behind the target. These are ghosts beside
    its direct echo, which is not affected.
    """
    if np.linalg.norm(radar.tx_position_m - radar.rx_position_m) <= ONE_VIEW_M:
        return
    weighty = [entry for entry in ranked if entry.mean_db >= BISTATIC_DB and entry.pair.order]
    points, when = probes(geometries, *span_s) if weighty else (np.zeros((0, 3)), np.zeros(0))
    for entry in weighty:
        out, back = (unit(path.place_m(when) - points) for path in (entry.pair.out, entry.pair.back))
        angle_deg = np.degrees(np.arccos(np.clip(inner(out, back), -1, 1)))
        if angle_deg.max() > BISTATIC_DEG:
            warn(
                f"over the path pair {entry.pair.name!r}, {entry.mean_db:.0f} dB from the strongest, a target sees transmitter and "
                f"receiver {angle_deg.max():.0f} degrees apart at {when[angle_deg.argmax()]:.3g} s; beyond {BISTATIC_DEG:g} "
                "degrees echoes may be 2.5 dB off: move the antennas, or leave the pair out (without_paths)"
            )


def _check_outside_ellipsoids(geometry: Ellipsoids, radar: Radar, times_s: np.ndarray) -> None:
    centres, axes = geometry.at(times_s)
    for antenna in (radar.tx_position_m, radar.rx_position_m):
        local = np.einsum("knji,knj->kni", axes, antenna - centres) / geometry.semi_axes_m
        inside = np.sum(local**2, axis=2) < 1 + 1e-6
        if inside.any():
            frame, index = np.argwhere(inside)[0]
            raise _radar_within(radar, antenna, times_s[frame], f"is inside {geometry.names[index]}")


def _radar_within(radar: Radar, antenna_m: np.ndarray, time_s: float, relation: str) -> InputError:
    """The error for a radar inside a target, with the position (3,) of its antenna at that time."""
    place_m, mend = antenna_m, "move the radar"
    if radar.track is not None:
        place_m = radar.passing(np.array([time_s])).back.points(antenna_m[None])[0].round(6) + 0.0
        mend = "give the radar another track"
    where = ", ".join(f"{x:.3g}" for x in place_m)
    return InputError(
        f"the radar at ({where}) m {relation} at {time_s:.3g} s; place the target farther away (distance_m) or {mend}"
    )


def check_outside(surface: MovingMesh, radar: Radar, times_s: np.ndarray) -> None:
    """Refuses a radar inside a closed mesh, or touching a mesh, at any of a few instants of the record."""
    for times in blocks(np.linspace(times_s[0], times_s[-1], 25), len(surface.rest)):
        vertices = surface.at(times)
        for antenna in (radar.tx_position_m, radar.rx_position_m):
            within = np.all((vertices.min(axis=1) < antenna) & (antenna < vertices.max(axis=1)), axis=1)
            inside = np.zeros(len(times), bool)
            inside[within] = np.abs(winding(vertices[within][:, surface.faces] - antenna)) > 0.5
            touches = np.linalg.norm(vertices - antenna, axis=2).min(axis=1) < 1e-3
            if inside.any() or touches.any():
                instant = times[np.argmax(inside if inside.any() else touches)]
                raise _radar_within(
                    radar, antenna, instant, f"{'is inside' if inside.any() else 'touches'} {surface.name}"
                )
