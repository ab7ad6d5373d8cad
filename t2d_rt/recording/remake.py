"""Repeats recordings: what `run` simulates for a recording, and `add_noise`, which passes a recording without noise through a
receiver."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from t2d_rt.core.backend import one_blas_thread
from t2d_rt.core.checks import instance, integer
from t2d_rt.core.cubes import Cube, DiskCube, GatedRows
from t2d_rt.core.errors import InputError, warn
from t2d_rt.core.factored_cubes import ProductRows
from t2d_rt.core.stored_arrays import Inputs
from t2d_rt.experiment.catalog import noise_named
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.setup import repeatable
from t2d_rt.noise.receiver import receive
from t2d_rt.noise.receiver.gated import receive_gated
from t2d_rt.pipeline.prepare import plugin_finders
from t2d_rt.recording.recording import Recording, whole
from t2d_rt.signal.range import RangeGate
from t2d_rt.types import Accuracy, Receiver

KNOWN = "error_db", "error_scatter_db", "error_chirps", "tolerance_db"
"""Settings of a recording that also hold for an identical repetition."""


def again(
    experiment: Experiment | Recording, accuracy: Accuracy | Mapping[str, Any] | None, tolerance_db: float | None
) -> tuple[Experiment, Inputs, Accuracy | Mapping[str, Any] | None, dict[str, Any]]:
    """What `run` simulates: the experiment, its arrays, its accuracy, and settings of the recording that are known in advance."""
    instance("experiment", experiment, (Experiment, Recording), "an Experiment or a Recording")
    if isinstance(experiment, Experiment):
        return experiment, {}, accuracy, {}
    whole(experiment.settings)
    recording, original = experiment, repeatable(experiment.experiment)
    split = {"split": recording.settings["split"]} if "split" in recording.settings else {}
    then, now = recording.settings.get("scatterers", []), sorted(plugin_finders())
    if then != now:
        had, have = (", ".join(names) or "none" for names in (then, now))
        warn(
            f"the recording was made with these scatterers of other packages: {had}; there are now: {have}, so its samples differ; "
            "install or uninstall these packages"
        )
    if accuracy is not None or tolerance_db is not None:
        return original, recording.inputs, accuracy, split
    measured: dict[str, Any] = {name: recording.settings[name] for name in KNOWN if name in recording.settings}
    return original, recording.inputs, recording.accuracy, measured | split


@one_blas_thread
def add_noise(
    recording: Recording, noise: str | Path | Mapping[str, Any] | Receiver = "receiver", *, seed: int | None = None
) -> Recording:
    """Passes a recording without noise through a receiver. The result has the same bits as one of `simulate` with this `noise`;
    the given recording is not changed.

    noise: as in `simulate`.
    seed: seed of the noise, in place of the receiver's or the experiment's own.
    """
    instance("recording", recording, Recording, "a Recording")
    whole(recording.settings)
    original = recording.experiment
    if original is None:
        raise InputError("the recording was measured, so its receiver's noise is in it; give a simulated one")
    if original.noise != "none":
        raise InputError(
            "the recording has the noise of a receiver already; give one that was simulated with noise='none'"
        )
    receiver = noise_named(noise, recording.radar)
    if isinstance(receiver, Receiver) and seed is not None:
        receiver = receiver.replace(seed=integer("seed", seed))
    experiment = original.model_copy(update={"noise": receiver})
    cube = recording.cube if isinstance(recording.cube, DiskCube) else recording.cube.copy()
    cube, levels = received(cube, experiment)
    return recording._with(cube=cube, experiment=experiment, settings=recording.settings | levels)


def received(cube: Cube, experiment: Experiment, gate: RangeGate | None = None) -> tuple[Cube, dict[str, Any]]:
    """Passes the echoes of a cube, which may be changed in place, through the experiment's receiver; also returns the levels for
    the settings. With a gate, the result has only its range cells, and the cube must store products."""
    receiver = experiment.noise if isinstance(experiment.noise, Receiver) else None
    if gate is not None:
        assert isinstance(cube, DiskCube), "gated cells are made of products"
        assert isinstance(cube.rows, ProductRows), "gated cells are made of products"
        cells, levels = receive_gated(cube.rows, experiment.radar, receiver, experiment.seed, gate.matrix, gate.bins)
        return DiskCube(GatedRows(cells, gate.bins, gate.window, experiment.radar.samples)), levels
    return (cube, {}) if receiver is None else receive(cube, experiment.radar, receiver, experiment.seed)
