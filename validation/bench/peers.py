"""Short records in a process of their own, and the usual way to sum echoes beside ours."""

from __future__ import annotations

import subprocess
import sys

import numpy as np

import t2d_rt as t2d
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.setup import set_up
from t2d_rt.geometry.vectors import norms
from t2d_rt.pipeline.echo_model import Model
from t2d_rt.types import Accuracy, MovingMesh
from validation.bench.measure import Case, targets_of_case, timed
from validation.report import Section, at_least, at_most

SHORT_S = 2.0
SHORT_LIMITS_S = {"mesh": 1.5, "ellipsoid": 0.6}
PEER_LIMITS = {"mesh": 40.0, "ellipsoid": 150.0}
SECONDS, TIMED_CHIRPS = 10.0, {"mesh": 4, "ellipsoid": 2_000}
"""Length of the record, and how many of its chirps are summed the usual way, whose time is proportional to their number."""
COLD = """
import time
start = time.perf_counter()
import t2d_rt as t2d
motion = t2d.trim(t2d.example("walk"), 1.0, {stop})
t2d.simulate(motion, radar="table2", method="{method}").spectrogram
print(time.perf_counter() - start)
"""


def short_records() -> Section:
    """A short record from the import to its spectrogram, in processes that find all kernels and facets on disk."""
    checks, table = [], []
    for method, limit in SHORT_LIMITS_S.items():
        code = COLD.format(stop=1 + SHORT_S, method=method)
        taken = [float(subprocess.check_output([sys.executable, "-W", "ignore", "-c", code])) for _ in range(4)][1:]
        checks.append(at_most(f"{SHORT_S:g} s of a walk, {method}, cold process", min(taken), limit, "s"))
        table.append({"method": method, "seconds": min(taken), "longest of three": max(taken)})
    note = "From `import t2d_rt` to the spectrogram, table2; compiled modules, kernels and facets lie on disk. Best of three."
    return Section(title="Short records", checks=checks, note=note, table=table)


def peers() -> Section:
    """Text2Doppler's way: one exponential for each segment or facet, chirp and sample, in NumPy."""
    checks, table = [], []
    radar = t2d.Radar.preset("table2")
    for method, limit in PEER_LIMITS.items():
        points, usual, ours = _seconds(method, radar)
        checks.append(at_least(f"{method}: faster than the usual way", usual / ours, limit, "times"))
        table.append(
            {"method": method, "points": points, "usual way [s]": usual, "ours [s]": ours, "ratio": usual / ours}
        )
    note = (
        f"A walk of {SECONDS:g} s, table2, to the ADC cube. The usual way is the sum alone, one thread of NumPy in complex64: "
        "positions of the segments' centres, or of the centroids of the facets that our mesh has, are there already. "
        f"It is timed on {TIMED_CHIRPS['ellipsoid']} chirps of segments and {TIMED_CHIRPS['mesh']} of facets. "
        "At the same number of facets one point for each errs far more (report, speed against accuracy)."
    )
    return Section(title="Beside the usual way", checks=checks, note=note, table=table)


def _seconds(method: str, radar: t2d.Radar) -> tuple[int, float, float]:
    """Number of points, and the seconds that a record takes the usual way and ours."""
    (motion,) = targets_of_case(Case(name=method, method=method, duration_s=SECONDS))
    stage = set_up(motion, "free_space", Experiment.without_targets(radar, method=method))
    times = radar.chirp_times_s(SECONDS)
    some = times[:: len(times) // TIMED_CHIRPS[method]][: TIMED_CHIRPS[method]]
    points = _points(stage.model, some)
    usual = len(times) / len(some) * timed(lambda: _summed(points, radar))

    def run() -> None:
        _ = t2d.simulate(motion, radar=radar, method=method).cube  # type: ignore[arg-type]

    run()  # compiles the kernels
    return points.shape[1], usual, min(timed(run) for _ in range(3))


def _points(model: Model, times_s: np.ndarray) -> np.ndarray:
    """Segments' centres or facets' centroids (chirp, point, 3) m."""
    (geometry,) = model.geometries
    if isinstance(geometry, MovingMesh):
        facets = model.facets(geometry, Accuracy())
        return np.asarray(facets.at(times_s)[:, facets.faces].mean(axis=2))
    return geometry.at(times_s)[0]


def _summed(points: np.ndarray, radar: t2d.Radar) -> np.ndarray:
    """ADC samples (chirp, sample) of points of one amplitude."""
    t = radar.sample_times_s
    out = np.empty((len(points), radar.samples), np.complex64)
    for chirp, each in enumerate(points):
        tau = 2 * norms(each - radar.tx_position_m) / SPEED_OF_LIGHT
        cycles = radar.carrier_hz * tau[:, None] + radar.slope_hz_per_s * (tau[:, None] * t - 0.5 * tau[:, None] ** 2)
        out[chirp] = np.exp(2j * np.pi * (cycles % 1.0).astype(np.float32)).astype(np.complex64).sum(axis=0)
    return out
