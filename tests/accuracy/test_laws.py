"""The fitted laws by which an accuracy is chosen, and how errors and their margins combine."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import builders
import t2d_rt as t2d
from t2d_rt.accuracy import cost
from t2d_rt.accuracy.budget import SURELY, ErrorBudget, Omission, Total
from t2d_rt.accuracy.error_laws import COARSER, FacetLaw, Laws
from t2d_rt.accuracy.estimate import Chirps, Field, field, nmse_db
from t2d_rt.accuracy.measuring import _mean
from t2d_rt.accuracy.occlusion import LEAST_DB, Occluded
from t2d_rt.propagation.visibility import sample_times
from t2d_rt.types import Accuracy, Radar
from validation.methods.models import modelled

LAWS = Laws.fitted()
RADAR = Radar.preset("table2")


@pytest.mark.parametrize("law", [LAWS.bodies, LAWS.smooth], ids=["bodies", "smooth"])
def test_coarser_facets_never_err_less(law: FacetLaw) -> None:
    sagittas = np.geomspace(0.005, 10, 60)
    for table in (law.error_db, law.difference_db):
        assert (np.diff([table(each) for each in sagittas]) >= 0).all()
    # What facets differ by from coarser ones is about the error of these.
    for sagitta in (0.15, 0.3, 0.6):
        apart_db = law.difference_db(sagitta) - law.error_db(COARSER * sagitta)
        assert abs(apart_db) < 2 * math.hypot(law.scatter_db, law.difference_scatter_db)


def test_smaller_bodies_err_more_down_to_their_own_mesh() -> None:
    sagittas, adult = np.geomspace(0.05, 10, 40), LAWS.bodies
    assert adult.at_size(460, body=True) is adult
    child, baby = (adult.at_size(size, body=True) for size in (300, 180))
    for smaller, taller in ((child, adult), (baby, child)):
        fine = sagittas[sagittas < 0.8]
        assert all(smaller.error_db(each) > taller.error_db(each) + 1 for each in fine)
        assert (np.diff([smaller.error_db(each) for each in sagittas]) >= 0).all()
    # Nothing is coarser than the mesh itself: there is no difference between what is.
    assert baby.error_db(5) == baby.error_db(10) < -20
    assert baby.difference_db(5) < baby.error_db(5) - 20
    assert abs(baby.difference_db(0.05) - baby.error_db(COARSER * 0.05)) < 1
    assert adult.at_size(180, body=False).error_db(5) > -5


@pytest.mark.slow
def test_the_law_of_facets_holds_for_a_child() -> None:
    walk = t2d.trim(t2d.place(builders.walk(), distance_m=3.0), 2.0, 2.3)
    child = replace(walk, joints=walk.joints * (0.5, 0.5, 0.5) + (1.5, 0, 0))
    model = modelled(child)
    budget = ErrorBudget(model, Accuracy())
    chirps = Chirps.random(model.radar, model.span_s, seed=5, count=8)
    free = Accuracy(occlusion=False)
    found, fine = (field(model, free.replace(sagitta_scale=scale), chirps) for scale in (1.0, 0.35))
    sagitta, law = budget.facets(free.tiers[0], 1.0)
    assert nmse_db(found, fine) == pytest.approx(law.error_db(sagitta), abs=5)
    assert nmse_db(found, fine) > LAWS.bodies.error_db(sagitta) + 2


def test_each_kind_of_work_has_its_time() -> None:
    assert set(LAWS.seconds) == set(cost.KINDS)
    assert all(each >= 0 for each in LAWS.seconds.values())


def test_below_the_fitted_facets_the_amplitude_of_the_error_goes_with_the_sagitta() -> None:
    least = float(LAWS.bodies.sagitta_rad[0])
    assert LAWS.bodies.error_db(least / 10) == pytest.approx(LAWS.bodies.error_db(least) - 20)


def test_margins_of_one_law_add_up_and_those_of_others_in_quadrature() -> None:
    one, other = (Omission("facets", -20.0, 2.0, law=law) for law in ("facets", "shadows"))
    assert Total.of([one, one]).margin == pytest.approx(2 * one.margin)
    assert Total.of([one, other]).margin == pytest.approx(math.sqrt(2) * one.margin)
    assert Total.of([one]).surely == pytest.approx(10 ** ((-20 + SURELY * 2) / 10))
    assert Total.of([one, Omission("occlusion", -3.0, taken=False)]) == Total.of([one])


def test_the_mean_of_two_figures_is_that_of_least_variance() -> None:
    rng = np.random.default_rng(5)
    covariance = np.array([[4.0, 1.2], [1.2, 1.0]])
    figures = rng.multivariate_normal([-20, -20], covariance, 200_000)
    correlation = 1.2 / 2
    means = np.array([_mean((a, 2.0), (b, 1.0), correlation)[0] for a, b in figures[:2000]])
    assert means.mean() == pytest.approx(-20, abs=0.1)
    _, scatter_db = _mean((0.0, 2.0), (0.0, 1.0), correlation)
    assert means.std() == pytest.approx(scatter_db, rel=0.1)
    weights = np.linspace(0, 1, 101)
    least = min(np.std(w * figures[:, 0] + (1 - w) * figures[:, 1]) for w in weights)
    assert scatter_db == pytest.approx(least, rel=0.02)
    assert _mean((-20.0, 2.0), (-300.0, math.inf)) == (-20.0, 2.0)


def test_the_first_random_chirps_cover_the_whole_record() -> None:
    chirps = Chirps.random(RADAR, (0.0, 2.0), seed=3, count=16)
    edges = np.linspace(0, len(RADAR.chirp_times_s(2.0)), 17)
    part = (np.searchsorted(edges, chirps.rows, side="right") - 1).tolist()
    assert part[:4] == list(range(0, 16, 4)), "a quarter of them"
    assert part[4:8] == list(range(2, 16, 4)), "half of them, with these"
    assert part[8:] == list(range(1, 16, 2))


@pytest.mark.slow
@pytest.mark.parametrize("sampled", [True, False])
def test_chirps_asked_for_in_parts_have_the_same_samples(sampled: bool) -> None:
    model = t2d.plan(t2d.trim(t2d.example("walk"), 0.3, 0.6), radar=RADAR).budget.model
    chirps = Chirps.random(RADAR, model.span_s, seed=3, count=9)
    accuracy = t2d.Accuracy(sagitta_scale=8.0)
    samples_s = chirps.nearest(sample_times(*model.span_s, 25.0), RADAR) if sampled else None
    whole = Field(model, accuracy, chirps, samples_s=samples_s)
    parts = np.concatenate([whole.samples(first, last) for first, last in ((0, 5), (5, 7), (7, 20))])
    order = np.argsort(chirps.rows)
    ascending = Chirps(chirps.rows[order], chirps.antennas[order], chirps.starts_s[order], chirps.samples)
    expected = Field(model, accuracy, ascending, samples_s=samples_s).samples()
    np.testing.assert_allclose(parts[order], expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def test_samples_of_visibility_beside_chirps_are_all_that_these_need() -> None:
    chirps = Chirps.random(RADAR, (0.0, 2.0), seed=3, count=12)
    samples = sample_times(0.0, 2.0, 50.0)
    near = chirps.nearest(samples, RADAR)
    assert len(near) <= 2 * len(chirps.rows) + 2 < len(samples)
    values = np.cos(7 * samples)
    for instant in chirps.instants_s(RADAR):
        assert np.interp(instant, near, np.cos(7 * near)) == pytest.approx(np.interp(instant, samples, values))


def test_a_plan_without_a_tolerance_can_be_printed() -> None:
    plan = t2d.plan(t2d.trim(t2d.example("walk"), 0.0, 0.3))
    assert "tolerance -20 dB" in str(plan)
    assert "no tolerance, expected error" in str(type(plan)(plan.budget, None, plan.accuracy))


def test_margins_of_one_law_add_up_over_totals_too() -> None:
    one, other = (Omission("facets", -20.0, 2.0, law=law) for law in ("facets", "shadows"))
    assert Total.of([one]) + Total.of([one, other]) == Total.of([one, one, other])


def test_what_occlusion_takes_of_some_path_pairs_is_theirs() -> None:
    """Nothing of the first pair's power, half of the second's; the third was not judged and loses as much as what it is among."""
    occluded = Occluded(np.array([1.0, 0.1, 0.01]), removed=np.array([0.0, 0.05]), remaining=np.array([1.0, 0.05]))
    level = {"all": None, "second": [0, 1, 0], "third too": [0, 1, 1], "half": [0, 0.5, 0.5], "first": [1, 0, 0]}
    found = {name: occluded.level_db(None if some is None else np.array(some)) for name, some in level.items()}
    expected = 10 * math.log10(0.05 / 1.05)
    assert found["all"] == pytest.approx(expected)
    assert found["second"] == pytest.approx(expected)
    assert found["third too"] == pytest.approx(10 * math.log10(0.055 / 1.05))
    assert found["half"] == pytest.approx(found["third too"] + 10 * math.log10(0.5))
    assert found["first"] == LEAST_DB
    assert Occluded(np.ones(1), np.zeros(0), np.zeros(0)).level_db() == -math.inf
