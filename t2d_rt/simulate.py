"""`simulate` and `run`, the whole pipeline on one screen: set up -> choose the accuracy -> echoes -> ADC cube -> recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from t2d_rt.accuracy import (
    Plan,
    Wanted,
    check_memory,
    chosen,
    measured_directly,
    measured_error,
    plan_again,
    warn_of_miss,
    warn_out_of_reach,
)
from t2d_rt.body.outfit import Outfit
from t2d_rt.core.backend import Device, one_blas_thread, prefetched
from t2d_rt.core.checks import array, flag, instance, integer, shown
from t2d_rt.core.cubes import Cube
from t2d_rt.core.errors import InputError
from t2d_rt.core.memory import LIMIT_GB, after_call
from t2d_rt.core.plugins import versions
from t2d_rt.core.progress import shown_progress, split_progress, stretch
from t2d_rt.experiment.catalog import noise_named, radar_named
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.setup import Setup, placed_targets, set_up, set_up_stored
from t2d_rt.pipeline.parts import PartCubes, Split, checked_split
from t2d_rt.pipeline.path_pairs import Clutter
from t2d_rt.pipeline.prepare import Prepared, blocks, plugin_finders, prepare
from t2d_rt.pipeline.targets import TargetLike
from t2d_rt.propagation.collisions import Collisions
from t2d_rt.radar.repetition import add_repeated
from t2d_rt.radar.synthesize import Progress, Synthesis
from t2d_rt.recording.recording import Recording
from t2d_rt.recording.remake import again, received
from t2d_rt.scattering.ellipsoid import PhaseFrom
from t2d_rt.scene import Mover, Room
from t2d_rt.signal.range import RangeGate
from t2d_rt.types import Accuracy, EchoArrays, Material, Radar, Receiver, Scene
from t2d_rt.types.ellipsoids import Method
from t2d_rt.types.radar_pairs import heard
from t2d_rt.types.scatterer import FrameBlock, Scatterer, pose, visibility

MOST_AGAIN = 2
"""How often, at most, a small body or mesh that misses its tolerance is simulated again."""
LATEST_S = 1.0
"""Greatest time between the first sweeps of several radars [s]."""
NEXT_SEED = 1_000_003
"""Step between the seeds of the receivers of several radars."""
FIRST_RUN = 0.8
"""Fraction of the remaining progress that a run takes which may have to be repeated."""


def simulate(
    target: TargetLike | str | Path | Sequence[TargetLike | str | Path],
    *,
    radar: Radar | str | Path | None = None,
    scene: str | Path | Scene | Room = "free_space",
    tolerance_db: float | None = None,
    accuracy: Accuracy | Mapping[str, Any] | None = None,
    reflections: int = 2,
    transmissions: int = 0,
    bounces: int = 1,
    clutter: Clutter = "specular",
    collisions: Collisions = "warn",
    method: Method = "mesh",
    seed: int = 0,
    noise: str | Path | Mapping[str, Any] | Receiver = "none",
    body: str = "adult",
    material: str | Material | Outfit | None = None,
    phase_from: PhaseFrom = "specular",
    only_paths: Sequence[str] | None = None,
    without_paths: Sequence[str] = (),
    measure_error: bool | None = None,
    split: Split | None = None,
    device: Device = "auto",
    memory_gb: float = LIMIT_GB,
    progress: Progress | bool | None = None,
) -> Recording:
    """Radar recording of a motion, a moving mesh, ellipsoids, or a list of them with movers (fans, pets) among them.

    Parameters
    ----------
    target: a `Motion`, the name of a motion file or of a bundled motion (`examples`), a `MovingMesh`, `Ellipsoids`, a mover, or a
        list of these. A motion becomes a mesh or ellipsoids, according to `method`. If its `placed` is False it is put in front of
        the radar (see `place`); if that is None, likewise but with a warning. `Recording.settings["placement"]` says what was done.
        The record is the time that all targets have in common, and begins at 0; movers last as long as the record.
    radar: a `Radar`, a preset's name (`presets`) or a .yaml file; the `table2` preset by default.
    scene: "free_space", a room by name, a Mitsuba/Sionna XML file, a `Room` or a `Scene`.
    tolerance_db: greatest error of the targets' field [dB], its energy relative to the field's own, against a converged model.
        Model, facets, rates, visibility and path tiers are chosen to keep to it (`plan` shows the choice). A small body or mesh in
        free space whose measured error exceeds it is simulated again, up to twice, each time more finely.
    accuracy: an `Accuracy`, or a mapping of its fields, that says how finely targets are modelled; with a tolerance the fields that
        it sets are kept. The default has a field error of -15 to -31 dB in free space, worst where a body hides much of itself, and
        of -11 to -20 dB in rooms.
    reflections: greatest number of reflections, counted on the paths out and back together.
    transmissions: greatest number of thin slabs that they pass through, counted likewise; 2 for a target behind a partition.
    bounces: greatest number of bounces off targets, in addition to the scene's reflections: 1 is an ordinary echo; 2 adds echoes
        between two limbs, between a body and a thing that it carries, or between two bodies; 3 adds those of corners. They are
        traced by ray tubes, on the direct path only, between meshes that do not rotate fast. Walls do not block the path from one
        target to another, and polarisation is preserved as if every fold were vertical. With 2, a walk takes some 20 times as long.
    clutter: echoes of the static scene, occluded by the targets: "specular" (up to 3 reflections), "diffuse" or "none".
    collisions: treatment of targets that go through walls or furniture, or are outside the room: "warn" of them, "stop" the record
        just before, or "ignore" them. The same holds for a radar outside the room, unless there are `transmissions`.
    method: "mesh" is physical optics of the body's surface, "ellipsoid" has one echo for each segment of the body.
    seed: seed of the diffuse points, and of noise; the same seed gives the same cube bit for bit.
    noise: what the receiver adds to the samples, after their error has been measured: "none"; "receiver", with typical values for
        the radar's band; a YAML file or a mapping of a `Receiver`'s fields, or a `Receiver`. See `Recording.snr_db` for the result.
    body: the body template that motions are skinned with.
    material: material of all targets except movers and things that are carried; by default a body is "skin" and a mesh keeps its
        own. Bodies may wear an `Outfit`: "dressed" has shoes on the feet and cloth on all but head and hands, "coat" thicker cloth.
    phase_from: point of an ellipsoid at which its phase is taken: the "specular" point, or the "centre" as in Text2Doppler.
    only_paths: names of the path pairs to the targets that have echoes, as `Recording.paths` lists them; all by default. In a name
        * stands for any characters: ["direct", "ceiling*"]. How finely a pair is modelled does not depend on the choice, so that
        recordings of parts add up to that of the whole; clutter and noise are in each of them.
    without_paths: names of path pairs that have no echoes.
    measure_error: whether `Recording.error_db` is measured, at a few random chirps; by default where a tolerance is given.
    split: the recording's `parts`, which add up to it: by "segment" of the bodies, "path" pair, "target" or number of "bounce"s.
    device: "cpu", "gpu" (a CUDA device), or "auto" for a CUDA device where there is one and the CPU elsewhere.
    memory_gb: greatest memory that the run may take [GB]; it works in blocks to stay below, and refuses in advance what needs more.
    progress: True shows a bar, or a line now and then in a log; a function is called with the fraction done, 0..1, which never
        falls.
    """
    experiment = Experiment.without_targets(
        radar, reflections=reflections, transmissions=transmissions, bounces=bounces, clutter=clutter, collisions=collisions,
        method=method, seed=seed, noise=noise, body=body, material=material, phase_from=phase_from, only_paths=only_paths,
        without_paths=without_paths,
    )  # fmt: skip
    wanted, progress = Wanted.of(accuracy, tolerance_db, measure_error), shown_progress(progress, method)
    checked_split(split)
    with one_blas_thread:  # no decorator, which would stand between a warning and the user's line
        setup = set_up(target, scene, experiment, device=device, memory_gb=memory_gb)
        return recorded(setup, wanted, device, progress, split)


def simulate_radars(
    target: TargetLike | str | Path | Sequence[TargetLike | str | Path],
    radars: Sequence[Radar | str | Path],
    *,
    interference: bool = False,
    starts_s: Sequence[float] | None = None,
    **options: Any,
) -> list[Recording]:
    """Recordings of the same targets by several radars on one clock; without interference, each is what `simulate` makes for it.

    Noise is drawn independently for each radar: the receiver of radar n, from 0, has the seed `seed` + n `NEXT_SEED`, where `seed`
    is the receiver's own or the simulation's. With a receiver of that seed, `simulate` makes the same samples for a single radar.

    target: as in `simulate`; motions that are not placed are put in front of the first radar.
    radars: at least one, each as the `radar` of `simulate`; `types.radar_pairs.bistatic` makes a radar from the transmitters of one
        and the receivers of another.
    interference: whether each radar receives the chirps of all others over the line of sight, in addition to its noise; walls and
        targets in between are ignored, and echoes of these chirps are not modelled. The starts of their chirps are drawn for each
        radar that receives them, as if clocks were not synchronised, or follow from `starts_s`.
    starts_s: with interference, the start of each radar's first sweep on a common clock [s], before which it does not interfere.
        It shifts interference only: all echoes begin at the record's first instant, so the differences should be too short for
        targets to move much.
    options: further options of `simulate`, for all radars.

    All records must begin at the same instant: a track that begins after the targets is refused, unless all tracks do.
    """
    if "radar" in options:
        raise InputError(f"radars takes the place of radar, got radar {shown(options['radar'])} as well; leave it out")
    named_radars = [radar_named(radar) for radar in instance("radars", radars, (list, tuple), "a list of radars")]
    if not named_radars or not all(isinstance(radar, Radar) for radar in named_radars):
        raise InputError(f"radars must be a list of Radars or their names, at least one, got {shown(radars)}")
    flag("interference", interference)
    targets, noise = placed_targets(target, named_radars[0]), options.pop("noise", "none")
    if interference and noise == "none":
        raise InputError("interference comes with a receiver's noise; give noise, such as 'receiver', or leave it out")
    _check_one_start(targets, named_radars)
    if starts_s is not None and not interference:
        raise InputError("starts_s tells when radars hear one another; give interference=True as well, or leave it out")
    began_s = (
        None
        if starts_s is None
        else array(
            "starts_s", starts_s, (len(named_radars),), limit=LATEST_S, unit="s", hint="give one instant for each radar"
        )
    )
    recordings = []
    for number, radar in enumerate(named_radars):
        receiver = noise_named(noise, radar)
        if isinstance(receiver, Receiver):
            seed = integer("seed", options.get("seed", 0)) if receiver.seed is None else receiver.seed
            others = [
                heard(other, radar, None if began_s is None else float(began_s[place] - began_s[number]))
                for place, other in enumerate(named_radars)
                if interference and place != number
            ]
            receiver = receiver.replace(interferers=[*receiver.interferers, *others], seed=seed + number * NEXT_SEED)
        recordings.append(simulate(targets, radar=radar, noise=receiver, **options))
    return recordings


def _check_one_start(targets: Sequence[TargetLike], radars: Sequence[Radar]) -> None:
    """Refuses radars whose records would begin at different instants, as each record's clock begins at 0."""
    known_s = [float(target.times_s[0]) for target in targets if not isinstance(target, Mover)]
    tracks_s = [known_s if radar.track is None else [*known_s, radar.track.times_s[0]] for radar in radars]
    starts_s = [max(track_s, default=0.0) for track_s in tracks_s]
    if len(set(starts_s)) > 1:
        raise InputError(
            f"records of several radars begin at one instant, got {', '.join(map('{:.6g}'.format, starts_s))} s, where tracks "
            "and targets are first known; give tracks that begin no later than the targets"
        )


def run(
    experiment: Experiment | Recording, accuracy: Accuracy | Mapping[str, Any] | None = None, *,
    tolerance_db: float | None = None, measure_error: bool | None = None, split: Split | None = None, device: Device = "auto",
    memory_gb: float = LIMIT_GB, progress: Progress | bool | None = None,
) -> Recording:  # fmt: skip
    """Simulates an experiment, whose file names are relative to the working directory, or repeats the simulation of a recording.
    Unless another accuracy or tolerance is given, a recording is repeated with its own accuracy: on the same machine, the samples
    are the same bit for bit."""
    experiment, inputs, accuracy, known_settings = again(experiment, accuracy, tolerance_db)
    wanted, progress = Wanted.of(accuracy, tolerance_db, measure_error), shown_progress(progress, experiment.method)
    checked_split(split)
    with one_blas_thread:
        setup = set_up_stored(experiment, inputs, device=device, memory_gb=memory_gb)
        recording = recorded(setup, wanted, device, progress, split or known_settings.get("split"))
    recording.settings |= {**known_settings, **recording.settings}
    return recording


def run_gated(
    experiment: Experiment,
    accuracy: Accuracy | None,
    range_gate_m: tuple[float, float],
    *,
    measure_error: bool | None = None,
    device: Device = "auto",
) -> Recording:
    """As `run`, but keeps only the range cells within `range_gate_m` (nearest, farthest) [m], for a spectrogram with that gate. ADC
    samples are computed only where an effect of the receiver must act on them, and are not kept, which saves time."""
    wanted = replace(Wanted.of(accuracy, None, measure_error), factored=True)
    with one_blas_thread:
        setup = set_up_stored(experiment, {}, device=device, memory_gb=LIMIT_GB)
        return recorded(setup, wanted, device, None, gate=RangeGate.of(experiment.radar, range_gate_m))


def recorded(
    setup: Setup, wanted: Wanted, device: Device, progress: Progress | None, split: Split | None = None,
    gate: RangeGate | None = None,
) -> Recording:  # fmt: skip
    """The recording of an experiment that is set up; with a gate, only its range cells."""
    if wanted.measured and setup.model.paths_on is not None:
        raise InputError(
            "the error of a recording is that of all paths; give measure_error=False beside only_paths and without_paths"
        )
    plan = chosen(setup.model, wanted)
    if wanted.tolerance_db is not None and not (wanted.measured and measured_directly(plan)):
        warn_out_of_reach(plan)
    plan, cube, parts, settings = planned_run(setup, plan, wanted, device, progress, split)
    cube, levels = received(cube, setup.experiment, gate)
    settings |= levels
    after_call()
    return Recording(
        cube, plan.model.radar, experiment=setup.experiment, accuracy=plan.accuracy, inputs=setup.inputs, settings=settings,
        versions=versions(), processing={} if gate is None else gate.processing, parts=parts.cubes,
    )  # fmt: skip


def planned_run(
    setup: Setup, plan: Plan, wanted: Wanted, device: Device, progress: Progress | None, split: Split | None
) -> tuple[Plan, Cube, PartCubes, dict[str, Any]]:  # fmt: skip
    """Simulates by a plan, and by finer plans, up to `MOST_AGAIN` times, where the measured error calls for one; warns where the
    last one misses its tolerance. Returns the plan that was used last, its cube, the cubes of its parts, and entries of the
    recording's settings."""
    runs = 0
    while True:
        runs += 1
        model, accuracy = plan.model, plan.accuracy
        prepared = prepare(model, accuracy, setup.experiment.clutter)
        parts = PartCubes(split, model, factored=wanted.factored)
        needed_bytes = check_memory(prepared, measured=wanted.measured, parts=parts.most(accuracy))
        repeatable = runs <= MOST_AGAIN and wanted.measured and measured_directly(plan)
        cube = summed(prepared, device, stretch(progress, 0, FIRST_RUN) if repeatable else progress, parts)
        settings = setup.described(model, accuracy) | prepared.counts | plan.described(needed_bytes)
        settings |= {} if split is None else {"split": split}
        settings |= {"runs": runs} if runs > 1 else {}
        settings |= {"scatterers": sorted(added)} if (added := plugin_finders()) else {}
        static = prepared.static
        del prepared  # its facets, before others are made
        if not wanted.measured:
            return plan, cube, parts, settings
        error = measured_error(plan, cube, static)
        finer = plan_again(plan, error) if repeatable else None
        if finer is None:
            warn_of_miss(plan, error)
            if progress is not None:
                progress(1.0)
            return plan, cube, parts, settings | error.described()
        del cube, parts, static  # before others are made
        plan, progress = finer, stretch(progress, FIRST_RUN, 1)


def summed(prepared: Prepared, device: Device, progress: Progress | None, into: PartCubes | None = None) -> Cube:
    """The ADC cube of all echoes. With `into`, the echoes of each part of a split are also summed to a cube of their own."""
    into = into or PartCubes(None, prepared.model)
    cube, radar, parts = into.whole, prepared.model.radar, prepared.parts
    always = {"tolerance_db": prepared.synthesis_error_db, "device": device, "memory": prepared.model.memory}
    for part, part_progress in zip(parts, split_progress(progress, len(parts)), strict=True):
        options: dict[str, Any] = always | {"onto": cube, "progress": part_progress, "parts": into.of(part)}
        if part.repeats is not None:
            cube = add_repeated(part, radar, **options)
            continue
        with Synthesis(part.times_s, radar, **options) as synthesis:
            for block, echoes in prefetched(blocks_of_echoes(part)):
                synthesis.add(block.first, echoes)
        cube = synthesis.cube
    assert cube is not None, "a simulation has at least one target"
    return cube


def blocks_of_echoes(part: Scatterer) -> Iterator[tuple[FrameBlock, EchoArrays]]:
    """The echoes of scatterers that are summed together, one block of surface frames after the other."""
    for block in blocks(part):
        yield block, echoes_in(part, block)


def echoes_in(part: Scatterer, block: FrameBlock) -> EchoArrays:
    """The echoes of scatterers in one block of frames. Poses and visibility are computed here and dropped afterwards."""
    poses = pose(part.parts, block)
    seen = visibility(part.parts, block)
    return part.scatter(block, poses, seen)
