"""What each stage of a simulation takes by itself, called one after another through the package's own functions."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from t2d_rt.accuracy import Wanted, chosen
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.setup import set_up
from t2d_rt.pipeline.echo_model import Model
from t2d_rt.pipeline.path_pairs import find_path_pairs
from t2d_rt.pipeline.prepare import scatterers_of
from t2d_rt.pipeline.targets import targets_of
from t2d_rt.radar.synthesize import synthesize
from t2d_rt.radar.windows import INTERVALS
from t2d_rt.scattering.streams import batches
from t2d_rt.signal import spectrogram
from t2d_rt.types import Accuracy, Echoes, Motion, MovingMesh, Radar
from t2d_rt.types.scatterer import Scatterer

MOTION, PATHS, SETUP, OCCLUSION, FACETS, SYNTHESIS, SPECTROGRAM, REST = (
    "motion and body", "paths in a room", "refinement, patches, points", "occlusion", "facets and points", "synthesis",
    "spectrogram", "rest",
)  # fmt: skip
STAGES = (MOTION, PATHS, SETUP, OCCLUSION, FACETS, SYNTHESIS, SPECTROGRAM, REST)
PIECE_BYTES, ECHO_BYTES = 5e8, 24
"""Echoes are held in pieces of the record of about that size, so many bytes for each at a frame."""
LEAST_FRAMES = 4
"""A piece has at least so many surface frames."""


class Stopwatch:
    """Seconds spent in each stage."""

    def __init__(self) -> None:
        self.spent = dict.fromkeys(STAGES, 0.0)

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Adds the time of a `with` block to a stage."""
        start = time.perf_counter()
        yield
        self.spent[stage] += time.perf_counter() - start


def stage_seconds(
    target: Motion | MovingMesh, radar: Radar, *, scene: str, method: str, accuracy: Mapping[str, Any]
) -> tuple[dict[str, float], Counter[str]]:
    """Each stage's seconds, and what the stages had to do: `facet_terms` (facets x path pairs x surface frames) and `echo_terms`
    (echoes x instants, an instant being one chirp at one pair of antennas), `facets` over dominant paths, and `instants`.

    A simulation makes echoes while it sums earlier ones; here each stage has all cores to itself. Occlusion is the time by which
    echoes take longer with it than without.
    """
    clock = Stopwatch()
    model, static = _set_up(clock, target, radar, scene=scene, method=method)
    settings = chosen(model, Wanted.of(accuracy, None)).accuracy.replace(
        repeats=False
    )  # each stage does the whole record
    clutter: list[Scatterer] = []
    if model.scene is not None:
        with clock(PATHS):
            clutter, _ = model.clutter(static, settings)
    with clock(SETUP):
        scatterers = scatterers_of(model, settings)
    without = _making_s(model, settings.replace(occlusion=False)) if settings.occlusion else 0.0
    done = _work(model, scatterers, settings)
    cubes = []
    for batch in batches([*scatterers, *clutter], radar):
        parts = []
        for echoes in held(clock, batch):
            with clock(SYNTHESIS):
                parts.append(synthesize(echoes, radar, tolerance_db=settings.synthesis_error_db)[:])
            done += echo_terms(echoes, radar, len(parts[-1]))
        cubes.append(np.concatenate(parts))
    if settings.occlusion:
        clock.spent[OCCLUSION] = max(0.0, clock.spent[FACETS] - without)
        clock.spent[FACETS] -= clock.spent[OCCLUSION]
    cube = sum(each[: min(map(len, cubes))] for each in cubes)
    with clock(SPECTROGRAM):
        spectrogram(cube, radar, mti="mean" if clutter else "none")
    return clock.spent, done


def _set_up(
    clock: Stopwatch, target: Motion | MovingMesh, radar: Radar, *, scene: str, method: str
) -> tuple[Model, Any]:
    """The model, and which static echoes it has; what checks and placement take is the rest."""
    experiment = Experiment.without_targets(radar, method=method)
    start = time.perf_counter()
    stage = set_up(target, scene, experiment)
    whole = time.perf_counter() - start
    model = stage.model
    with clock(MOTION):
        targets_of(model.targets, model.method, model.body, model.material, radar)
    if model.scene is not None:
        with clock(PATHS):
            find_path_pairs(
                model.scene, model.geometries, radar, model.span_s, order=experiment.reflections,
                transmissions=experiment.transmissions, backend=model.backend,
            )  # fmt: skip
    clock.spent[REST] = max(0.0, whole - clock.spent[MOTION] - clock.spent[PATHS])
    return model, experiment.clutter


def _making_s(model: Model, accuracy: Accuracy) -> float:
    """Seconds that making all echoes takes."""
    clock = Stopwatch()
    for batch in batches(scatterers_of(model, accuracy), model.radar):
        batch.frames(0, LEAST_FRAMES)  # compiles the kernels
        for _ in held(clock, batch):
            pass
    return clock.spent[FACETS]


def _work(model: Model, scatterers: list[Scatterer], accuracy: Accuracy) -> Counter[str]:
    """Facets of the one target, and how often they are summed: a closed surface has twice as many flat facets as vertices, and half
    as many curved ones as nodes."""
    pairs = model.pairs(accuracy)
    counts = [1] if pairs is None else [len(some) for _, some in pairs.by_tier(accuracy)]
    (geometry,) = model.geometries
    facets_of_vertex = 0.5 if isinstance(geometry, MovingMesh) and geometry.curved else 2
    nodes = sum(
        each.vertices * len(each.times_s) * count for each, count in zip(scatterers, counts, strict=len(scatterers) > 1)
    )
    facets = len(model.facets(geometry, accuracy).faces) if isinstance(geometry, MovingMesh) else 0
    return Counter(facet_terms=round(facets_of_vertex * nodes), facets=facets)


def held(clock: Stopwatch, source: Scatterer) -> Iterator[Echoes]:
    """The echoes of each piece of the record in turn; making them is timed as that of facets and points."""
    for first, last in pieces(len(source.times_s), source.echoes):
        with clock(FACETS):
            arrays = source.frames(first, last)
        yield Echoes(times_s=source.times_s[first:last], **arrays._asdict())


def pieces(frames: int, echoes: int) -> list[tuple[int, int]]:
    """First frame of each piece of a record and the one after its last; neighbours have one frame in common."""
    windows = max(1, round(PIECE_BYTES / (ECHO_BYTES * max(1, echoes) * INTERVALS)))
    starts = np.arange(0, max(1, frames - LEAST_FRAMES), windows * INTERVALS)
    stops = np.append(starts[1:] + 1, frames)
    return [(int(first), int(last)) for first, last in zip(starts, stops, strict=True)]


def echo_terms(echoes: Echoes, radar: Radar, chirps: int) -> Counter[str]:
    """Echoes that are not silent throughout a window of frames, times the instants in it."""
    instants = chirps * len(radar.tx_offsets_m) * len(radar.rx_offsets_m)
    live = [
        np.count_nonzero(echoes.amplitude[first : first + INTERVALS + 1].any(axis=0))
        for first in range(0, len(echoes.times_s) - 1, INTERVALS)
    ]
    return Counter(echo_terms=round(float(np.mean(live)) * instants), instants=instants)
