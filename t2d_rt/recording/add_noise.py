"""`add_noise`: a recording that was simulated without noise, through a receiver."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from t2d_rt.core.backend import one_blas_thread
from t2d_rt.core.checks import instance, integer
from t2d_rt.core.cubes import Cube, DiskCube
from t2d_rt.core.errors import InputError
from t2d_rt.experiment.catalog import noise_named
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.noise.receiver import receive
from t2d_rt.recording.recording import Recording
from t2d_rt.types import Receiver


@one_blas_thread
def add_noise(
    recording: Recording, noise: str | Path | Mapping[str, Any] | Receiver = "receiver", *, seed: int | None = None
) -> Recording:
    """The recording as `simulate` with this `noise` would have made it, the same bits; the one that is given stays as it is.

    noise: as that of `simulate`.
    seed: of the noise, in place of the receiver's or the experiment's own.
    """
    instance("recording", recording, Recording, "a Recording")
    made = recording.experiment
    if made is None:
        raise InputError("the recording was measured, so its receiver's noise is in it; give a simulated one")
    if made.noise != "none":
        raise InputError(
            "the recording has the noise of a receiver already; give one that was simulated with noise='none'"
        )
    receiver = noise_named(noise, recording.radar)
    if isinstance(receiver, Receiver) and seed is not None:
        receiver = receiver.replace(seed=integer("seed", seed))
    experiment = made.model_copy(update={"noise": receiver})
    cube = recording.cube if isinstance(recording.cube, DiskCube) else recording.cube.copy()
    cube, levels = received(cube, experiment)
    return Recording(
        cube, recording.radar, experiment=experiment, accuracy=recording.accuracy, inputs=recording.inputs,
        settings=recording.settings | levels, versions=recording.versions, processing=recording.processing,
        parts=recording.parts.cubes,
    )  # fmt: skip


def received(cube: Cube, experiment: Experiment) -> tuple[Cube, dict[str, Any]]:
    """A cube of echoes, which may be changed, as the experiment's receiver gives it, and settings that tell its levels."""
    if isinstance(experiment.noise, Receiver):
        return receive(cube, experiment.radar, experiment.noise, experiment.seed)
    return cube, {}
