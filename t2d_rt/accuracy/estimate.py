"""The targets' field at a few random chirps, at any accuracy and without interpolation in time: what a run is measured against."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from t2d_rt.cubes import Cube
from t2d_rt.model import Model, with_method
from t2d_rt.propagation.visibility import sample_times
from t2d_rt.radar.direct import between, chirp_samples
from t2d_rt.scattering.streams import batches
from t2d_rt.types import Accuracy, EchoStream, Motion, Radar
from t2d_rt.types.accuracy import MOST_RANGE_DB

CHIRPS, SAMPLES = 48, 8
"""So many chirps are compared, at so many samples of the sweep."""
CHIRPS_AT_ONCE, FIELD_BYTES = 16, 300e6
"""Chirps are worked on so many at once, or as many as take that much memory."""
ECHO_BYTES, VERTEX_BYTES = 60, 100
"""What an echo and a facet's vertex take at each moment, about."""
FINER = 0.5
"""Phase sagitta of the facets that a run is measured against, over its own: they err by a sixth of its power."""
SUBDIVISION = 1
"""Least subdivision from which visibility is sampled there, over all path pairs but the strongest: there are many."""
PATHS_BELOW_DB = 12.0
"""What path pairs cost that are left out there, or in a coarser tier, lies that far below the error."""


@dataclass(frozen=True, slots=True)
class Chirps:
    """Some chirps of a record and some samples of each."""

    rows: np.ndarray
    """Of the cube, ascending (K,)."""
    antennas: np.ndarray
    """Of the cube, one for each (K,)."""
    starts_s: np.ndarray
    """When they begin, on the targets' clock (K,)."""
    samples: np.ndarray
    """(S,)."""

    @classmethod
    def random(cls, radar: Radar, span_s: tuple[float, float], *, seed: int, count: int = CHIRPS) -> Chirps:
        """One anywhere in each of `count` equal parts of the record, each of any antenna."""
        starts = radar.chirp_times_s(span_s[1] - span_s[0])
        count = min(count, len(starts))
        edges = np.linspace(0, len(starts), count + 1)
        rng = np.random.default_rng([seed, count])
        rows = np.unique((edges[:-1] + rng.random(count) * np.diff(edges)).astype(int))
        antennas = rng.integers(radar.antennas, size=len(rows))
        begin = span_s[0] + starts[rows] + radar.antenna_delays_s[antennas]
        step = max(1, radar.samples // SAMPLES)
        return cls(rows, antennas, begin, np.arange(step // 2, radar.samples, step))

    def moments_s(self, radar: Radar) -> np.ndarray:
        """First and last moment of each chirp [s] (2 K,)."""
        return np.stack([self.starts_s, self.starts_s + radar.sample_times_s[-1]], axis=1).ravel()


def field(model: Model, accuracy: Accuracy, chirps: Chirps, *, visibility_rate_hz: float | None = None) -> np.ndarray:
    """Samples (K, S) complex128 [sqrt(W)] of the targets alone.

    Visibility is traced just then, over the strongest path pair from every facet's vertices; or as in a run
    at that rate.
    """
    radar, keys = model.radar, None
    if visibility_rate_hz is not None:
        every = sample_times(*model.span_s, visibility_rate_hz)
        after = np.clip(np.searchsorted(every, chirps.starts_s, side="right"), 1, len(every) - 1)
        keys = every[np.unique([after - 1, after])]
    total = np.zeros((len(chirps.rows), len(chirps.samples)), complex)
    for part in batches(model.streams(accuracy, chirps.moments_s(radar), keys), radar):
        of_one = 2 * (ECHO_BYTES * part.echoes + VERTEX_BYTES * part.vertices)
        at_once = int(np.clip(FIELD_BYTES / max(1, of_one), 1, CHIRPS_AT_ONCE))
        for first in range(0, len(total), at_once):
            some = slice(first, first + at_once)
            rows, antennas = chirps.rows[some], chirps.antennas[some]
            ends = part.frames(2 * first, 2 * (first + len(rows)))
            total[some] += chirp_samples(ends, radar, rows, antennas, chirps.samples)
            model.memory.release()
    return total


def measured_db(
    model: Model,
    accuracy: Accuracy,
    cube: Cube,
    still: Sequence[EchoStream],
    *,
    error_db: float = -20.0,
    hidden: bool = True,
) -> float:
    """Field NMSE [dB] of a run's targets, by random chirps made again at far finer settings.

    `still` are the echoes of what stands still in the cube, `error_db` is about what is expected; `hidden`: whether occlusion
    matters.
    """
    chirps, expected = converged(model, accuracy, error_db, hidden=hidden)
    where = zip(chirps.rows, chirps.antennas, strict=True)
    found = np.array([np.asarray(cube[int(row)])[antenna, chirps.samples] for row, antenna in where], complex)
    times_s = chirps.starts_s - model.span_s[0]
    for stream in still:
        found -= between(stream, model.radar, times_s, chirps.rows, chirps.antennas, chirps.samples)
    return nmse_db(found, expected)


def converged(model: Model, accuracy: Accuracy, error_db: float, *, hidden: bool) -> tuple[Chirps, np.ndarray]:
    """Random chirps, not those by which settings were chosen, and their samples far finer."""
    chirps = Chirps.random(model.radar, model.span_s, seed=model.seed + 1)
    bodies = any(isinstance(target, Motion) for target in model.targets)
    full = with_method(model, "mesh") if bodies and model.method == "ellipsoid" else model
    return chirps, field(full, finer(full, accuracy, error_db, hidden=hidden), chirps)


def finer(model: Model, accuracy: Accuracy, error_db: float, *, hidden: bool = True) -> Accuracy:
    """What a run of that accuracy, whose error may be `error_db`, is measured against."""
    share = 10 ** ((error_db - PATHS_BELOW_DB) / 10)
    return accuracy.replace(
        sagitta_scale=FINER * min(1.0, accuracy.sagitta_scale),
        occlusion=hidden,
        visibility_subdivision=max(SUBDIVISION, accuracy.visibility_subdivision),
        dynamic_range_db=MOST_RANGE_DB,
        **model.paths_within(share, share),
    )


def nmse_db(found: np.ndarray, expected: np.ndarray) -> float:
    """Energy of the difference over that of what was expected [dB]."""
    if np.array_equal(found, expected):
        return -math.inf
    wrong, all_of_it = (float(np.sum(np.abs(each) ** 2)) for each in (found - expected, expected))
    return 10 * float(np.log10(max(wrong, 1e-300) / max(all_of_it, 1e-300)))
