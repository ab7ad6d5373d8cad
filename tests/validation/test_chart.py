"""The chart of speed against accuracy, in small."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from t2d_rt.scattering.phase_integral import NUMPY_OPS, divided_differences
from t2d_rt.types import PEC, Radar
from validation.bodies import WALK
from validation.methods.chart import point, stretch
from validation.methods.chart.front import front, gap, seconds_at
from validation.methods.chart.measure import SAMPLES, Case, Point, simulated
from validation.methods.chart.methods import METHODS, with_visibility
from validation.methods.chart.variants import one_point, one_point_each
from validation.methods.kept import kept_samples
from validation.methods.reference import Converged, nmse_db


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    return Case(
        "free_space", "walk", stretch(WALK, 1.9, 0.06), Radar.preset("table2", prf_hz=5120), count=4, fine_scale=1.0,
        reference_rad=0.22, cache=tmp_path_factory.mktemp("cache"),
    )  # fmt: skip


def test_one_point_is_the_closed_form_without_phase_differences() -> None:
    phase = np.array([-2.0, 0.3, 1.7])
    closed = divided_differences(phase, phase, phase, ops=NUMPY_OPS, terms=10)
    for ours, theirs in zip(one_point(phase, phase, phase, ops=NUMPY_OPS, terms=10), closed, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-12)


@pytest.mark.slow
def test_finer_facets_and_the_closed_form_err_less(case: Case) -> None:
    coarse, default = (case.error_db(simulated(case, scale=scale).cube) for scale in (6.0, 1.0))
    alone = case.error_db(one_point_each(case, None).cube)
    assert default < coarse - 5 < alone - 5
    assert default < -18


@pytest.mark.slow
def test_methods_in_order_of_their_error(case: Case) -> None:
    ellipsoids, closed = (point(case, METHODS[i], METHODS[i].few[-1]) for i in (1, 3))
    one_each = METHODS[2].run(case, METHODS[2].few[-1])
    assert ellipsoids.seconds_per_second < closed.seconds_per_second
    assert closed.nmse_db < min(case.error_db(one_each.cube), ellipsoids.nmse_db) - 10
    assert int(one_each.settings["facets"]) > 50_000


@pytest.mark.slow
def test_methods_of_visibility_agree_where_little_is_occluded(case: Case) -> None:
    default = simulated(case).cube
    for how in ("capsules", "none"):
        cube = with_visibility(case, how).cube
        assert not np.array_equal(cube, default)
        assert nmse_db(cube, default) < -20


def test_a_kept_reference_is_read_again(case: Case, tmp_path: Path) -> None:
    made = []

    def compute(*given: Any) -> np.ndarray:
        made.append(given[-1].sagitta_rad)
        return np.full((2, 3), made[-1] + 0j)

    for sagitta_rad in (0.5, 0.5, 0.4):
        found = kept_samples(
            case.surface, case.radar, case.chirps, SAMPLES, Converged(material=PEC, sagitta_rad=sagitta_rad),
            folder=tmp_path, compute=compute,
        )  # fmt: skip
        np.testing.assert_array_equal(found, np.full((2, 3), sagitta_rad))
    assert made == [0.5, 0.4]


def test_front_and_gaps() -> None:
    def at(seconds: float, error: float) -> Point:
        return Point(scene="", motion="", method="", knob="", seconds_per_second=seconds, nmse_db=error)

    points = [at(1, -10), at(2, -9), at(4, -20), at(3, -20)]
    assert front(points) == [points[0], points[3]]
    assert gap(points, points[3]) == (0, 0)
    assert gap(points, points[1]) == (1, 1)
    assert seconds_at(points, -15) == pytest.approx(3**0.5)
    assert math.isnan(seconds_at(points, -30))
