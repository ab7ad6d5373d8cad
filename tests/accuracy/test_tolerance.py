"""A tolerance: what follows from it, whether it is kept, and what a run's measurement of its own error is worth."""

from __future__ import annotations

import json
import math
import warnings
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np
import pytest

import builders
import t2d_rt as t2d
from builders import ball, slow_after
from measures import nmse_db
from t2d_rt.accuracy.cost import facet_counts
from t2d_rt.accuracy.measuring import MeasuredError, plan_again
from t2d_rt.accuracy.search import LADDER, OVER_DB, planned
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.radar.direct import between, direct_sum
from t2d_rt.types import Echoes, Motion, MovingMesh, Radar, stream
from t2d_rt.types.accuracy import DEFAULT_TIERS, ELLIPSOID_TIERS, EVERY_PATH_DB
from validation.methods.laws import SHORT, modelled
from validation.methods.small_bodies import grown
from validation.methods.tolerance import piece

RADAR = Radar.preset("table2")


@pytest.fixture(scope="module")
def walk() -> Motion:
    return stride(0.1)


def stride(time_s: float) -> Motion:
    return t2d.place(t2d.trim(builders.walk(), 2.0, 2.0 + time_s), distance_m=3.0)


def balls(*places_m: tuple[float, float, float], speed_mps: float = 1.0, time_s: float = 0.3) -> list[MovingMesh]:
    return [ball(place, (-speed_mps, 0, 0), time_s, radius_m=0.15, frames=4) for place in places_m]


# --- measuring --------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_measured_error_is_that_against_a_much_finer_run() -> None:
    walk = stride(0.12)
    coarse = t2d.simulate(walk, radar=RADAR, accuracy={"sagitta_rad": 1.6}, measure_error=True)
    fine = t2d.simulate(walk, radar=RADAR, accuracy={"sagitta_rad": 0.4, "surface_rate_hz": 150})
    assert coarse.error_db is not None
    assert coarse.error_db == pytest.approx(nmse_db(coarse.cube, fine.cube), abs=2)
    assert fine.error_db is None
    assert json.loads(coarse.attributes["settings"])["error_db"] == coarse.error_db


@pytest.mark.slow
def test_a_spoilt_record_shows_in_the_measurement() -> None:
    """What is measured is the cube and not the plan: a surface rate that is far too low."""
    walk = stride(0.15)
    with pytest.warns(T2DWarning, match="rotates too fast"):
        bad = t2d.simulate(walk, radar=RADAR, accuracy={"surface_rate_hz": 12}, measure_error=True)
    good = t2d.simulate(walk, radar=RADAR, measure_error=True)
    assert bad.error_db is not None
    assert good.error_db is not None
    assert good.error_db < -12
    assert bad.error_db > max(-8, good.error_db + 8)


@pytest.mark.slow
@pytest.mark.parametrize("sagitta_rad", [0.3, 1.5])
def test_a_mesh_that_is_not_refined_has_an_error_all_the_same(sagitta_rad: float) -> None:
    """Three times its phase sagitta leaves it as it is, so a difference of nothing says nothing of its error."""
    target = ball((2.0, 0.0, 1.0), (1.0, 0.0, 0.0), 0.1, radius_m=0.1, level=4)
    run, fine = (
        t2d.simulate(target, radar=RADAR, accuracy={"sagitta_rad": s}, measure_error=True) for s in (sagitta_rad, 0.03)
    )
    assert run.error_db is not None
    assert run.error_db == pytest.approx(nmse_db(run.cube, fine.cube), abs=6)


@pytest.mark.parametrize("sagitta_rad", [0.6, 1.5])
def test_a_small_body_is_measured_against_finer_facets(sagitta_rad: float) -> None:
    """Of a sphere whose facets err by 10 dB more than the law of coarser ones tells, and of one that these err as much as."""
    target = ball((2.0, 0.0, 1.0), (1.0, 0.0, 0.0), 0.05, radius_m=0.15)
    run, fine = (
        t2d.simulate(target, radar=RADAR, accuracy={"sagitta_rad": s}, measure_error=s == sagitta_rad)
        for s in (sagitta_rad, 0.04)
    )
    assert run.error_db == pytest.approx(nmse_db(run.cube, fine.cube), abs=2)
    assert run.settings["error_scatter_db"] < 1.5


@pytest.mark.slow
def test_path_pairs_that_a_user_leaves_out_are_part_of_the_error() -> None:
    target = balls((2.4, 0.3, 1.0))
    options = {"radar": RADAR, "scene": "empty_room", "reflections": 1, "clutter": "none"}
    few = t2d.simulate(target, accuracy={"least_level_db": -2}, measure_error=True, **options)
    assert few.error_db is not None
    assert few.error_db == pytest.approx(nmse_db(few.cube, t2d.simulate(target, **options).cube), abs=3)


@pytest.mark.slow
def test_occlusion_that_is_not_traced_over_weaker_paths_is_part_of_the_error() -> None:
    """Two spheres behind one another: walls see past the first one, and what is not traced there was once not counted."""
    targets = balls((3.0, 0.0, 1.0), (3.8, 0.1, 1.0), time_s=0.1)
    traced = tuple(tier.model_copy(update={"visibility": "occlusion", "scatterer": "facets"}) for tier in DEFAULT_TIERS)

    def run(tiers: Any) -> t2d.Recording:
        return t2d.simulate(
            targets, radar=RADAR, scene="empty_room", reflections=1, clutter="none", accuracy={"tiers": tiers, "sagitta_rad": 0.3},
            measure_error=True,
        )  # fmt: skip

    whole = run(traced)
    coarser = run((traced[0], *(tier.model_copy(update={"visibility": "blockage"}) for tier in traced[1:])))
    power = nmse_db(coarser.cube, whole.cube)
    assert coarser.error_db > whole.error_db + 1
    both = 10 * math.log10(10 ** (power / 10) + 10 ** (whole.error_db / 10))
    assert coarser.error_db == pytest.approx(both, abs=1.5)


def test_a_plan_traces_occlusion_over_all_path_pairs_of_meshes_where_it_must() -> None:
    plan = t2d.plan(
        balls((3.0, 0.0, 1.0), (3.8, 0.1, 1.0)), radar=RADAR, scene="empty_room", clutter="none", tolerance_db=-20
    )
    assert {tier.visibility for tier in plan.accuracy.tiers if tier.scatterer == "facets"} == {"occlusion"}


def test_spectra_of_walls_are_part_of_a_plan() -> None:
    """More of them over a wider sweep, none over a quarter of a gigahertz."""

    def told_db(slope_factor: float) -> list[float]:
        radar = Radar.preset("table2", slope_hz_per_s=RADAR.slope_hz_per_s * slope_factor)
        plan = t2d.plan(balls((3.0, 0.0, 1.0)), radar=radar, scene="empty_room", clutter="none", tolerance_db=-20)
        return [each.error_db for each in plan.omissions if "spectra of walls" in each.what]

    (narrow,), (wide,) = told_db(1.0), told_db(2.3)
    assert -55 < narrow < wide - 5
    assert wide < -20
    assert not told_db(0.1)


@pytest.mark.slow
def test_clutter_is_no_part_of_the_error() -> None:
    options = {"radar": RADAR, "scene": "empty_room", "reflections": 0, "measure_error": True}
    target = balls((2.4, 0.3, 1.0))
    alone, cluttered = (t2d.simulate(target, clutter=kind, **options) for kind in ("none", "specular"))
    assert np.abs(cluttered.cube).mean() > 3 * np.abs(alone.cube).mean()
    assert cluttered.error_db == pytest.approx(alone.error_db, abs=1)


@pytest.mark.parametrize(("preset", "antenna"), [("table2", 0), ("array-3x4", 10), ("automotive-79", 3)])
def test_chirps_between_frames_are_those_of_the_direct_sum(preset: str, antenna: int) -> None:
    radar = Radar.preset(preset)
    rng = np.random.default_rng(0)
    times = np.linspace(0, 0.5, 41)
    delay = 2e-8 + 1e-10 * np.sin(2 * np.pi * (2 * times[:, None] + rng.random(5)))
    places = np.broadcast_to([3.0, 0.5, 1.0] + rng.normal(size=(5, 3)), (41, 5, 3)) if radar.is_array else None
    echoes = Echoes(
        times_s=times, delay_s=delay, amplitude=rng.normal(size=(41, 5)) + 1j, departure_m=places, arrival_m=places
    )
    rows = np.array([10, 2000, 4900]) * len(radar.chirp_times_s(0.5)) // len(RADAR.chirp_times_s(0.5))
    samples = np.array([3, 130])
    starts = radar.chirp_times_s(0.5)[rows] + radar.antenna_delays_s[antenna]
    found = between(stream(echoes), radar, starts, rows, np.full(3, antenna), samples)
    expected = direct_sum(echoes, radar, rows, antenna=antenna)[:, samples]
    np.testing.assert_allclose(found, expected, rtol=1e-4)


@pytest.mark.parametrize("preset", slow_after(1, ["automotive-79", "array-3x4"]))
def test_chirps_are_of_any_antenna(preset: str) -> None:
    target = ball((3.0, 0.8, 1.2), (1.0, 0.5, 0.0), 0.1, radius_m=0.15, sagitta_rad=0.15)
    found = t2d.simulate(target, radar=Radar.preset(preset), measure_error=True)
    assert len(found.cube[0]) > 1
    assert found.error_db < -27  # -28.3 against facets of a twentieth of the sagitta


@pytest.mark.parametrize("chirps", slow_after(2, [5, 11, 8]))
def test_few_chirps_are_all_compared(chirps: int) -> None:
    radar = Radar.preset("table2", prf_hz=chirps / 0.3)
    target = ball((3.0, 0.0, 1.0), (0.001, 0.0, 0.0), 0.3, radius_m=0.15)
    found = t2d.simulate(target, radar=radar, measure_error=True)
    assert len(found.cube) in (chirps, chirps + 1)
    assert found.settings["error_chirps"] in (8, len(found.cube))
    assert found.error_db < -20


# --- planning ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_measured_error_changes_no_sample() -> None:
    """Of a record with so many samples of visibility that they are asked for in blocks."""
    target = t2d.place(t2d.trim(builders.walk(), 0.2, 0.7), distance_m=8.0)
    accuracy = {"sagitta_scale": 16.0, "visibility_rate_hz": 175.0}
    cubes = [
        np.asarray(t2d.simulate(target, radar=RADAR, accuracy=accuracy, measure_error=each).cube)
        for each in (False, True)
    ]
    np.testing.assert_array_equal(cubes[0], cubes[1])


@pytest.mark.slow
def test_bodies_by_ellipsoids_behind_a_mesh_are_measured(walk: Motion) -> None:
    door = t2d.Door(position_m=(1.6, 0.4, 0.0), opens_at_s=0.05)
    found = t2d.simulate(
        [walk, door], radar=RADAR, method="ellipsoid", measure_error=True, accuracy={"sagitta_scale": 4.0}
    )
    assert found.error_db is not None
    assert math.isfinite(found.error_db)


@pytest.mark.slow
def test_a_child_whose_run_misses_its_tolerance_is_simulated_more_finely() -> None:
    """Facets and shadows' edges err by more than the laws say: the plan's own accuracy comes to -21.9 dB."""
    child = grown(piece(SHORT, 0.8, 1.3, 90.0), 0.95)
    with pytest.warns(T2DWarning, match="not in reach"):  # by the laws, which the run itself does not go by
        plan = t2d.plan(child, radar=RADAR, tolerance_db=-25)
    found = t2d.simulate(child, radar=RADAR, tolerance_db=-25, clutter="none")
    assert found.error_db < -25
    assert found.accuracy.visibility_rate_hz > plan.accuracy.visibility_rate_hz
    np.testing.assert_array_equal(t2d.run(found).cube, found.cube)


def test_a_run_that_misses_its_tolerance_is_made_again_where_the_error_is_measured_directly() -> None:
    child = grown(stride(0.1), 0.95)
    own = t2d.Accuracy(sagitta_scale=0.5, visibility_rate_hz=50, visibility_subdivision=2)
    plan = replace(t2d.plan(child, radar=RADAR, tolerance_db=-10), accuracy=own)
    assert plan_again(plan, MeasuredError(-10.5, 1.2, 24)) is None
    for error_db, facets_db, finer, oftener in ((-10.5, -25, 1, 2), (-10.5, -10.6, 2, 1), (-8, -11, 2, 2)):
        again = plan_again(plan, MeasuredError(error_db, 1.2, 24, facets_db=facets_db))
        assert again.accuracy.sagitta_scale == own.sagitta_scale / finer
        assert again.accuracy.visibility_rate_hz == own.visibility_rate_hz * oftener
    fixed = replace(t2d.plan(child, radar=RADAR, tolerance_db=-10, accuracy=own), accuracy=own)
    assert plan_again(fixed, MeasuredError(-8.0, 1.2, 24, facets_db=-11.0)) is None


def test_a_tolerance_is_kept_and_asks_for_no_more_than_it_needs(walk: Motion) -> None:
    loose, tight = (t2d.simulate(walk, radar=RADAR, tolerance_db=db) for db in (-12.0, -26.0))
    assert loose.error_db is not None
    assert tight.error_db is not None
    assert tight.error_db < -25 < -21 < loose.error_db < -11
    assert loose.settings["accuracy"]["sagitta_scale"] > 1.3 > 1.1 > tight.settings["accuracy"]["sagitta_scale"]
    assert loose.settings["accuracy"]["occlusion"] is False, "a walk towards the radar hides nothing that counts"
    assert loose.settings["tolerance_db"] == -12.0


def test_a_loose_tolerance_is_looser_in_all_that_costs(walk: Motion) -> None:
    loose, fine = (t2d.plan(walk, radar=RADAR, tolerance_db=db).accuracy for db in (-10.0, -25.0))
    assert loose.spline_error_db > -24 > -32 >= fine.spline_error_db
    assert [each.tiers[0].patch_phase_scale for each in (loose, fine)] == [4.0, 1.0]
    assert loose.sagitta_scale > 1.5 > fine.sagitta_scale
    beside = t2d.plan([walk, *balls((4, 1, 1), time_s=0.2)], radar=RADAR, tolerance_db=-10.0).accuracy
    assert beside.spline_error_db <= -32, "the laws of loose splines and patches are those of bodies"
    assert beside.tiers[0].patch_phase_scale == 1.0


def test_the_edges_of_a_deep_shadow_ask_for_no_finer_visibility_at_a_loose_tolerance() -> None:
    across = t2d.trim(t2d.place(builders.walk(), distance_m=3.0, angle_deg=80.0), 1.0, 1.3)
    accuracy = t2d.plan(across, radar=RADAR, tolerance_db=-10.0).accuracy
    assert accuracy.occlusion
    assert accuracy.visibility_subdivision == 0


def test_ellipsoids_where_they_suffice(walk: Motion) -> None:
    assert t2d.simulate(walk, radar=RADAR, tolerance_db=5.0, measure_error=False).settings["method"] == "ellipsoid"


@pytest.mark.slow
def test_a_plan_by_ellipsoids_makes_the_same_recording(walk: Motion) -> None:
    """Its accuracy says so, in free space too, and the experiment stays that which was asked for."""
    plan = t2d.plan(walk, radar=RADAR, tolerance_db=5.0)
    planned = t2d.simulate(walk, radar=RADAR, accuracy=plan.accuracy)
    asked = t2d.simulate(walk, radar=RADAR, tolerance_db=5.0)
    default = t2d.simulate(walk, radar=RADAR, accuracy={"sagitta_scale": 16.0})
    assert planned.settings["method"] == asked.settings["method"] == "ellipsoid"
    np.testing.assert_array_equal(np.asarray(planned.cube), np.asarray(asked.cube))
    assert planned.experiment == asked.experiment == default.experiment
    np.testing.assert_array_equal(np.asarray(asked.again().cube), np.asarray(asked.cube))
    assert t2d.run(asked, accuracy=default.accuracy).settings["method"] == "mesh"


@pytest.mark.slow
def test_ellipsoids_of_an_accuracy_stand_for_bodies_alone(walk: Motion) -> None:
    """Meshes of the user keep their facets, beside a body and without one."""
    ball_alone = balls((2, 0, 1))
    by_ellipsoids = {"tiers": ELLIPSOID_TIERS}
    found = t2d.simulate(ball_alone, radar=RADAR, accuracy=by_ellipsoids)
    assert found.settings["method"] == "mesh"
    np.testing.assert_array_equal(np.asarray(found.cube), np.asarray(t2d.simulate(ball_alone, radar=RADAR).cube))
    beside = t2d.simulate([walk, *ball_alone], radar=RADAR, accuracy=by_ellipsoids)
    body = t2d.simulate(walk, radar=RADAR, method="ellipsoid")
    chirps = len(beside.cube)
    assert beside.settings["method"] == "ellipsoid"
    alone = np.asarray(beside.cube) - np.asarray(body.cube)[:chirps]
    assert nmse_db(alone, np.asarray(found.cube)[:chirps]) < -30


@pytest.mark.slow
@pytest.mark.parametrize(
    ("heading_deg", "at_least_db", "at_most_db"), [(180.0, -50, -35), (135.0, -20, -12), (90.0, -12, -5)]
)
def test_occlusion_by_what_rotates_fast_is_part_of_the_error(
    heading_deg: float, at_least_db: float, at_most_db: float
) -> None:
    """A fan's guard and blades hide one another where it is seen from the side; only its mean visibility is modelled."""
    fan = t2d.TableFan(position_m=(3, 0, 1), rpm=900, heading_deg=heading_deg).mesh(0, 0.1)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        plan = t2d.plan(fan, radar=RADAR, tolerance_db=-20.0)
        (cost,) = (each.error_db for each in plan.omissions if "rotate fast" in each.what)
        found = t2d.simulate(fan, radar=RADAR, accuracy=plan.accuracy, measure_error=True)
    assert at_least_db < cost < at_most_db
    assert plan.accuracy.sagitta_scale <= 1, "coarser facets of nearly flat blades err by more than the law says"
    assert found.error_db is not None
    assert any("fast_rotating_hz" in str(each.message) for each in caught) == (cost > -19)
    if cost > -19:
        assert found.error_db == pytest.approx(cost, abs=4)


@pytest.mark.filterwarnings("ignore:top speed")
def test_occlusion_by_what_rotates_fast_is_no_omission_where_it_is_sampled() -> None:
    fan = t2d.TableFan(position_m=(3, 0, 1), rpm=900, heading_deg=90.0).mesh(0, 0.1)
    sampled = {"fast_rotating_hz": 100_000.0, "visibility_rate_hz": 400.0}
    traced = t2d.plan(fan, radar=RADAR, tolerance_db=-6.0, accuracy=sampled)
    assert not any("rotate fast" in each.what for each in traced.omissions)


def test_visibility_of_what_stands_behind_is_sampled() -> None:
    """Of two balls in line one hides the other; side by side they do not."""
    behind, beside = balls((2, 0, 1), (3, 0, 1)), balls((2, 0, 1), (3, 0.8, 1))
    plans = [t2d.plan(each, radar=RADAR, tolerance_db=-20.0, measure_error=False) for each in (behind, beside)]
    assert [each.accuracy.occlusion for each in plans] == [True, False]


def test_visibility_of_what_only_a_wall_sees_behind_another_is_sampled() -> None:
    """Side by side before the radar, one behind the other before its image in the left wall, which is 11 dB weaker."""
    beside, options = (
        balls((2.4, 0.55, 1), (3, -0.6, 1)),
        {"radar": RADAR, "tolerance_db": -20.0, "measure_error": False},
    )
    plans = [t2d.plan(beside, scene="empty_room", reflections=n, **options) for n in (0, 1)]
    assert [each.accuracy.occlusion for each in plans] == [False, True]


def test_the_plan_says_what_is_modelled_left_out_and_predicted(walk: Motion) -> None:
    plan = t2d.plan(walk, radar=RADAR, tolerance_db=-15.0)
    told = str(plan)
    for part in (
        "facets",
        "surface frames",
        "occlusion",
        "left out",
        "predicted",
        "ellipsoids",
        "chirps a second",
    ):
        assert part in told
    assert plan.error_db <= -15


def test_a_plan_tries_nothing(walk: Motion, monkeypatch: pytest.MonkeyPatch) -> None:
    """No facet is made and nothing is summed before it is known what a run takes."""

    def forbidden(*_: object, **__: object) -> None:
        raise AssertionError("a plan must not do that")

    monkeypatch.setattr("t2d_rt.scattering.refinement.refinements", forbidden)
    monkeypatch.setattr(import_module("t2d_rt.simulate"), "Synthesis", forbidden)
    assert t2d.plan(walk, radar=RADAR, tolerance_db=-15.0).accuracy.sagitta_scale > 1


@pytest.mark.slow
def test_a_plan_predicts_more_work_for_longer_and_finer_records(walk: Motion) -> None:
    longer = t2d.place(t2d.trim(builders.walk(), 1.0, 3.0), distance_m=3.0)
    seconds, memory = zip(
        *(
            (each.budget.seconds(each.accuracy), each.memory_bytes)
            for each in (
                t2d.plan(motion, radar=RADAR, tolerance_db=tolerance, measure_error=False)
                for motion, tolerance in ((walk, -12.0), (walk, -26.0), (longer, -26.0))
            )
        ),
        strict=True,
    )
    assert seconds[2] > 1.2 * seconds[1] > 1.2 * 1.2 * seconds[0] > 0
    assert memory[1] > 1.2 * memory[0] > 0


@pytest.mark.slow
def test_a_plan_serves_other_recordings(walk: Motion) -> None:
    plan = t2d.plan(walk, radar=RADAR, tolerance_db=-15.0)
    other = t2d.place(t2d.trim(builders.walk(), 3.0, 3.2), distance_m=3.0)
    assert t2d.simulate(other, radar=RADAR, accuracy=plan.accuracy).accuracy == plan.accuracy


@pytest.mark.slow
def test_facets_are_counted_before_they_are_made(walk: Motion) -> None:
    model = modelled(walk)
    (counted,) = facet_counts(model, t2d.Accuracy())
    for scale in (0.5, 1.0, 4.0, 100.0):
        (mesh,) = (model.facets(g, t2d.Accuracy(sagitta_scale=scale)) for g in model.geometries)
        assert counted.at(scale) == pytest.approx(len(mesh.faces), rel=0.15)


def test_in_a_room_a_tolerance_climbs_a_ladder_of_accuracies(walk: Motion) -> None:
    """Tighter ones model more path pairs, which cost more; none expects more than a plan may, and what is asked for stays."""
    model = t2d.plan(walk, radar=RADAR, scene="empty_room", reflections=1, clutter="none", tolerance_db=0).model
    plans = [planned(model, tolerance_db, t2d.Accuracy()) for tolerance_db in (-10.0, -15.0, -18.0, -21.0)]
    left = [each.accuracy.least_level_db for each in plans]
    cost = [each.budget.seconds(each.accuracy) for each in plans]
    assert left == sorted(left, reverse=True)
    assert len(set(left)) > 2
    assert cost == sorted(cost)
    assert all(each.error_db <= each.tolerance_db + OVER_DB for each in plans)
    with_all = planned(model, -10.0, t2d.Accuracy(tiers=DEFAULT_TIERS, visibility_rate_hz=33.0)).accuracy
    assert (with_all.least_level_db, with_all.visibility_rate_hz, with_all.occlusion) == (EVERY_PATH_DB, 33.0, True)
    assert len(with_all.tiers) == len(DEFAULT_TIERS)


def test_a_tolerance_out_of_reach_in_a_room_takes_no_rung_that_gains_nothing(walk: Motion) -> None:
    model = t2d.plan(walk, radar=RADAR, scene="empty_room", reflections=1, clutter="none", tolerance_db=0).model
    asked = t2d.Accuracy(occlusion=False)
    found = planned(model, -40.0, asked)
    finest = replace(found, accuracy=LADDER[-1].replace(occlusion=False))
    assert found.error_db <= finest.error_db + OVER_DB
    assert found.accuracy.sagitta_scale > 2 * LADDER[-1].sagitta_scale


def test_what_a_user_gives_stays(walk: Motion) -> None:
    given = {"visibility_rate_hz": 7.0, "surface_rate_hz": 90.0, "sagitta_rad": 1.3}
    settings = t2d.simulate(walk, radar=RADAR, tolerance_db=-15.0, measure_error=False, accuracy=given).settings
    assert settings["accuracy"]["visibility_rate_hz"] == 7.0
    assert settings["surface_rates_hz"][0] == pytest.approx(90, rel=0.05)
    assert (settings["accuracy"]["sagitta_rad"], settings["accuracy"]["sagitta_scale"]) == (1.3, 1.0)


def test_a_tolerance_out_of_reach_is_told(walk: Motion) -> None:
    with pytest.warns(T2DWarning, match="not in reach"):
        t2d.simulate(walk, radar=RADAR, tolerance_db=-25.0, accuracy={"sagitta_rad": 4.0}, measure_error=False)


@pytest.mark.parametrize("wrong", [-60, 20, "-20", math.nan])
def test_a_tolerance_that_makes_no_sense_is_refused(walk: Motion, wrong: object) -> None:
    with pytest.raises(InputError, match=r"tolerance_db must (lie in|be a number)"):
        t2d.simulate(walk, tolerance_db=wrong)  # type: ignore[arg-type]


@pytest.mark.slow
def test_every_kind_of_target_takes_a_tolerance(walk: Motion) -> None:
    """Ellipsoids by name and as targets, a fan beside them, an array, and a sum that stops at a wall."""
    by_name = t2d.simulate(walk, radar=RADAR, tolerance_db=3.0, method="ellipsoid")
    assert by_name.error_db == pytest.approx(1, abs=3)
    limbs = t2d.segments(walk)
    itself = t2d.simulate(limbs, radar=RADAR, tolerance_db=-20.0, scene="empty_room", reflections=1, clutter="none")
    assert itself.error_db is not None
    assert itself.error_db < -20
    fan, near = (
        t2d.TableFan(position_m=(3.5, -1, 1), rpm=120),
        ball((2, 0, 1), (-1, 0, 0), 0.1, radius_m=0.15, frames=4),
    )
    for radar in (Radar.preset("array-3x4"), Radar.preset("automotive-79")):
        several = t2d.simulate([near, fan], radar=radar, tolerance_db=-12.0)
        assert several.error_db is not None
        assert several.error_db < -11


@pytest.mark.slow
def test_a_tolerance_leaves_the_shadow_on_the_wall(walk: Motion) -> None:
    """Also where what hides what does not count for the walker's own echoes."""
    options = {"radar": RADAR, "scene": "empty_room", "reflections": 0, "measure_error": False}

    def wall(**more: Any) -> np.ndarray:
        alone, cluttered = (t2d.simulate(walk, clutter=kind, **options, **more).cube for kind in ("none", "specular"))
        return np.asarray(cluttered - alone)

    shadowed = wall()
    assert nmse_db(wall(accuracy={"occlusion": False}), shadowed) > -35
    assert nmse_db(wall(tolerance_db=-12.0), shadowed) < -45


def test_unknown_options_of_a_plan_are_refused(walk: Motion) -> None:
    with pytest.raises(InputError, match="unknown option 'faces'"):
        t2d.plan(walk, faces=3)


def test_defaults_are_those_of_before() -> None:
    """Defaults of `Accuracy` are those of `simulate` without a tolerance."""
    found = t2d.Accuracy()
    assert (found.sagitta_scale, found.visibility_rate_hz, found.dynamic_range_db) == (1.0, 25.0, 60.0)
    assert (found.visibility_subdivision, found.fastest_sampled_hz) == (0, 200.0)
    assert [tier.level_db for tier in found.tiers[:2]] == [-6.0, -25.0]
    assert [tier.patch_span_scale for tier in found.tiers] == [1.0, 2.0, 4.0]


@pytest.mark.slow
def test_without_a_tolerance_the_defaults_are_those_that_the_help_names() -> None:
    """Visibility at 25 Hz, pairs of paths down to -60 dB, facets as the mesh asks for."""
    target = [*balls((2.0, 0.1, 1.0), speed_mps=-0.5), *balls((3.0, -0.4, 1.1))]
    room: dict[str, Any] = {"radar": RADAR, "scene": "empty_room", "reflections": 1, "clutter": "none"}
    plain = t2d.simulate(target, **room)
    named, rarer, fewer = (
        t2d.simulate(target, **room, accuracy=more).cube
        for more in (
            {"visibility_rate_hz": 25.0, "dynamic_range_db": 60.0},
            {"visibility_rate_hz": 12.5},
            {"dynamic_range_db": 20.0},
        )
    )
    assert np.array_equal(plain.cube, named)
    assert not np.array_equal(plain.cube, rarer)
    assert not np.array_equal(plain.cube, fewer)


@pytest.mark.slow
def test_shadows_are_traced_at_all_chirps_whose_energy_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """A second batch of chirps, asked for because the first did not tell well enough."""
    measuring = import_module("t2d_rt.accuracy.measuring")
    combined, counts = measuring._combined, list[tuple[int, int]]()

    def counted(*given: Any) -> MeasuredError:
        counts.append((len(given[-2]), len(given[-1])))
        return combined(*given)

    monkeypatch.setattr(measuring, "_combined", counted)
    across = t2d.trim(t2d.place(t2d.example("walk"), distance_m=3.0, angle_deg=80), 1, 1.4)
    radar = Radar.preset("table2", samples=64, prf_hz=6000.0)
    t2d.simulate(across, radar=radar, tolerance_db=-18, device="cpu")
    assert counts[-1] == (8, 8)
    assert all(shadows in (0, chirps) for chirps, shadows in counts)
