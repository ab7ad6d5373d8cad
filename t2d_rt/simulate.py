"""The pipeline on one screen: set up -> choose the accuracy -> echoes -> ADC cube -> recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from t2d_rt.accuracy import Wanted, check_memory, chosen, measured_db
from t2d_rt.backend import Device
from t2d_rt.experiment import Experiment
from t2d_rt.memory import LIMIT_GB, after_call
from t2d_rt.progress import shown_progress
from t2d_rt.propagation.collisions import Collisions
from t2d_rt.radar.synthesize import Progress
from t2d_rt.result import Recording, again, versions
from t2d_rt.room import Clutter
from t2d_rt.scattering.ellipsoid import PhaseFrom
from t2d_rt.scene import Room
from t2d_rt.stage import Stage, set_up
from t2d_rt.summation import summed
from t2d_rt.targets import TargetLike
from t2d_rt.types import Accuracy, Material, Radar, Scene
from t2d_rt.types.target import Method


def simulate(
    target: TargetLike | str | Path | Sequence[TargetLike | str | Path],
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
    physics = {
        "reflections": reflections, "transmissions": transmissions, "clutter": clutter, "collisions": collisions,
        "method": method, "seed": seed, "body": body, "material": material, "phase_from": phase_from,
    }  # fmt: skip
    wanted, progress = Wanted.of(accuracy, tolerance_db, measure_error), shown_progress(progress, method)
    stage = set_up(target, radar, scene, physics, device=device, memory_gb=memory_gb)
    return _recorded(stage, wanted, device, progress)


def run(
    experiment: Experiment | Recording, accuracy: Accuracy | Mapping[str, Any] | None = None, *,
    tolerance_db: float | None = None, measure_error: bool | None = None, device: Device = "auto", memory_gb: float = LIMIT_GB,
    progress: Progress | bool | None = None,
) -> Recording:  # fmt: skip
    """The recording of an experiment, whose files are looked for in the working directory; or that of a recording again, at its own
    accuracy unless another one is given: the same samples, bit for bit, on the same machine. Options as in `simulate`."""
    experiment, inputs, accuracy, known = again(experiment, accuracy, tolerance_db)
    wanted, progress = Wanted.of(accuracy, tolerance_db, measure_error), shown_progress(progress, experiment.method)
    targets, scene = experiment.targets_from(inputs), experiment.scene_from(inputs)
    stage = set_up(targets, experiment.radar, scene, experiment.physics, device=device, memory_gb=memory_gb)
    recording = _recorded(stage, wanted, device, progress)
    recording.settings |= known
    return recording


def _recorded(stage: Stage, wanted: Wanted, device: Device, progress: Progress | None) -> Recording:
    plan = chosen(stage.model, wanted)
    model, accuracy = plan.model, plan.accuracy
    static, counts = model.clutter(stage.experiment.clutter, accuracy)
    streams = model.streams(accuracy)
    needed_bytes = check_memory(model, [*streams, *static], measured=wanted.measured)
    cube = summed(streams, static, model.radar, accuracy, device=device, memory=model.memory, progress=progress)
    del streams
    settings = (
        stage.described(model, accuracy) | counts | plan.described() | {"predicted_memory_gb": needed_bytes / 1e9}
    )
    if wanted.measured:
        settings["error_db"] = measured_db(plan, cube, static)
    after_call()
    return Recording(
        cube, model.radar, experiment=stage.experiment.model_copy(update={"method": model.method}), accuracy=accuracy,
        inputs=stage.inputs, settings=settings, versions=versions(),
    )  # fmt: skip
