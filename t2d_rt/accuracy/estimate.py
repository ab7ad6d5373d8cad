"""The field of the targets at a few random chirps, at any accuracy and without interpolation in time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.core.cubes import Cube
from t2d_rt.pipeline.echo_model import Model
from t2d_rt.pipeline.prepare import scatterers_of
from t2d_rt.radar.direct import between, chirp_samples
from t2d_rt.scattering.streams import batches
from t2d_rt.types import Accuracy, Radar
from t2d_rt.types.scatterer import Scatterer

SAMPLES = 8
"""Number of samples of a chirp that are compared."""
CHIRPS_AT_ONCE, FIELD_BYTES = 16, 300e6
"""Greatest number of chirps that are computed at once, and greatest memory that they may take [bytes]."""
ECHO_BYTES, VERTEX_BYTES = 60, 100
"""Approximate memory of an echo and of a facet's vertex at each instant [bytes]."""


@dataclass(frozen=True, slots=True)
class Chirps:
    """Some chirps of a record, and some samples of each."""

    rows: np.ndarray
    """Rows of the cube (K,)."""
    antennas: np.ndarray
    """Antenna of each row (K,)."""
    starts_s: np.ndarray
    """Times of the chirps' first samples on the clock of the targets [s], (K,)."""
    samples: np.ndarray
    """Indices of the samples within a chirp (S,)."""

    @classmethod
    def random(cls, radar: Radar, span_s: tuple[float, float], *, seed: int, count: int) -> Chirps:
        """One random chirp in each of `count` equal parts of the record, each of a random antenna. They are ordered so that the
        first few spread over the record: every fourth part first, then the ones midway between these."""
        starts = radar.chirp_times_s(span_s[1] - span_s[0])
        count = min(count, len(starts))
        edges = np.linspace(0, len(starts), count + 1)
        rng = np.random.default_rng([seed, count])
        rows = np.unique((edges[:-1] + rng.random(count) * np.diff(edges)).astype(int))
        antennas = rng.integers(radar.antennas, size=len(rows))
        begin = span_s[0] + starts[rows] + radar.antenna_delays_s[antennas]
        order = np.concatenate([np.arange(first, len(rows), step) for first, step in ((0, 4), (2, 4), (1, 2))])
        step = max(1, radar.samples // SAMPLES)
        return cls(rows[order], antennas[order], begin[order], np.arange(step // 2, radar.samples, step))

    def __getitem__(self, chosen: slice) -> Chirps:
        return replace(self, rows=self.rows[chosen], antennas=self.antennas[chosen], starts_s=self.starts_s[chosen])

    def instants_s(self, radar: Radar) -> np.ndarray:
        """First and last instant of each chirp [s], (2 K,)."""
        return np.stack([self.starts_s, self.starts_s + radar.sample_times_s[-1]], axis=1).ravel()

    def nearest(self, samples_s: np.ndarray, radar: Radar) -> np.ndarray:
        """The sample times [s] just before and after each chirp, (M,): the only ones of `samples_s`, ascending, that interpolation
        at the chirps needs."""
        after = np.clip(np.searchsorted(samples_s, self.instants_s(radar)), 1, len(samples_s) - 1)
        return samples_s[np.unique([after - 1, after])]


class Field:
    """Samples of the targets' echoes at some chirps, modelled at a given accuracy.

    With `samples_s`, visibility is that of a run: sampled at these times [s] from the meshes' vertices. Without, it is traced at
    every chirp, from every facet's vertices over the strongest path pair.
    """

    def __init__(
        self, model: Model, accuracy: Accuracy, chirps: Chirps, *, samples_s: np.ndarray | None = None
    ) -> None:
        self._model, self._chirps = model, chirps
        self._parts = batches(scatterers_of(model, accuracy, chirps.instants_s(model.radar), samples_s), model.radar)

    def samples(self, first: int = 0, last: int | None = None) -> np.ndarray:
        """Samples of chirps `first` up to, but without, `last`, (K, S) complex128 [sqrt(W)]."""
        chirps, radar = self._chirps, self._model.radar
        last = len(chirps.rows) if last is None else min(last, len(chirps.rows))
        total = np.zeros((last - first, len(chirps.samples)), complex)
        for part in self._parts:
            of_one = 2 * (ECHO_BYTES * part.echoes + VERTEX_BYTES * part.vertices)
            most = min(CHIRPS_AT_ONCE, max(1, part.at_once // 2) if part.at_once else CHIRPS_AT_ONCE)
            at_once = int(np.clip(FIELD_BYTES / max(1, of_one), 1, most))
            for start in range(first, last, at_once):
                stop = min(start + at_once, last)
                rows, antennas = chirps.rows[start:stop], chirps.antennas[start:stop]
                ends = part.frames(2 * start, 2 * stop)
                total[start - first : stop - first] += chirp_samples(ends, radar, rows, antennas, chirps.samples)
                self._model.memory.release()
        return total


def field(model: Model, accuracy: Accuracy, chirps: Chirps) -> np.ndarray:
    """Samples (K, S) complex128 [sqrt(W)] of the targets' echoes at all chirps, with visibility traced at each chirp."""
    return Field(model, accuracy, chirps).samples()


def of_cube(model: Model, cube: Cube, static: Sequence[Scatterer], chirps: Chirps) -> np.ndarray:
    """Samples (K, S) of a run's cube at the same chirps, less the echoes of the `static` scatterers."""
    where = zip(chirps.rows, chirps.antennas, strict=True)
    samples = np.array([np.asarray(cube[int(row)])[antenna, chirps.samples] for row, antenna in where], complex)
    times_s = chirps.starts_s - model.span_s[0]
    for stream in static:
        samples -= between(stream, model.radar, times_s, chirps.rows, chirps.antennas, chirps.samples)
    return samples


def nmse_db(samples: np.ndarray, expected: np.ndarray) -> float:
    """Normalised mean square error [dB]: the energy of the difference over that of the expected samples."""
    if np.array_equal(samples, expected):
        return -math.inf
    wrong, all_of_it = (float(np.sum(np.abs(part) ** 2)) for part in (samples - expected, expected))
    return 10 * float(np.log10(max(wrong, 1e-300) / max(all_of_it, 1e-300)))
