"""The sum of echo streams as an ADC cube, within the memory that a run may take."""

from __future__ import annotations

from collections.abc import Sequence

from t2d_rt.core.backend import Device
from t2d_rt.core.cubes import Cube
from t2d_rt.core.memory import Budget
from t2d_rt.radar.repetition import add_repeated
from t2d_rt.radar.synthesize import Progress, synthesize
from t2d_rt.scattering.streams import batches
from t2d_rt.types import Accuracy, EchoStream, Radar

BESIDE_CLUTTER_DB = -50.0
"""Greatest error of the sum where there are static echoes: they are far stronger than those of a walker."""


def summed(
    streams: Sequence[EchoStream],
    static: Sequence[EchoStream],
    radar: Radar,
    accuracy: Accuracy,
    *,
    device: Device,
    memory: Budget,
    progress: Progress | None = None,
) -> Cube:
    """ADC cube of the targets' streams and the static ones, those of the same frame times together as far as memory allows."""
    error_db = min(accuracy.synthesis_error_db, BESIDE_CLUTTER_DB) if static else accuracy.synthesis_error_db
    found = batches([each for each in (*streams, *static) if each.repeats is None], radar)
    repeating = [each for each in streams if each.repeats is not None]

    def part(number: int) -> Progress | None:
        return (
            None if progress is None else lambda fraction: progress((number + fraction) / (len(found) + len(repeating)))
        )

    cube = None
    for done, batch in enumerate(found):
        cube = synthesize(
            batch, radar, tolerance_db=error_db, device=device, onto=cube, memory=memory, progress=part(done)
        )
    for done, each in enumerate(repeating, len(found)):
        cube = add_repeated(each, radar, tolerance_db=error_db, device=device, memory=memory, onto=cube)
        if progress is not None:
            progress((done + 1) / (len(found) + len(repeating)))
    assert cube is not None, "a simulation has at least one target"
    return cube
