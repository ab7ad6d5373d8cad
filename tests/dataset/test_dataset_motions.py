"""Motions of a data set: cut or held to one length, with room where they are placed."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import t2d_rt as t2d
from t2d_rt.core.errors import T2DWarning
from t2d_rt.dataset.recipe import Recipe
from t2d_rt.dataset.sample import (
    CLEARANCE_M,
    REACH_M,
    _starts,
    arc_radius_m,
    descriptions,
    interferer,
    moves,
    placing,
    reserved_walks,
    sample,
    sample_motion,
    scene_extent,
)
from t2d_rt.experiment.catalog import example
from t2d_rt.experiment.sources import MotionText
from t2d_rt.motion import aside, place, repeat, trim
from t2d_rt.motion.carry import carry
from t2d_rt.motion.check import check_motion
from t2d_rt.motion.vary import arc, hold
from t2d_rt.pipeline.targets import things
from t2d_rt.types import Motion


@pytest.fixture(scope="module")
def walk() -> Motion:
    return example("walk")


@pytest.fixture(scope="module")
def recipe() -> Recipe:
    return Recipe(
        name="takes", classes=["bending", "sitting"], descriptions_per_class=4, samples_per_description=1,
        gait_factors=(0.9, 1.1), radar="table2-uniform", duration_s=3.0, conditions=[{"name": "room", "scene": "living_room"}],
    )  # fmt: skip


def test_a_held_motion_comes_to_rest_smoothly(walk: Motion) -> None:
    held = hold(walk, 1.5)
    assert held.duration_s == pytest.approx(walk.duration_s + 1.5, abs=1 / walk.rate_hz)
    begin = walk.duration_s - 0.3
    same = round(begin * walk.rate_hz)
    np.testing.assert_allclose(held.joints[:same], walk.joints[:same], atol=1e-9)  # of the spline through the frames
    rest = held.joints[round((begin + 0.6) * walk.rate_hz) + 1 :]
    np.testing.assert_array_equal(rest, np.broadcast_to(rest[-1], rest.shape))
    np.testing.assert_allclose(rest[-1], walk.joints[-1], atol=1e-9)
    speed = np.diff(held.joints[:, 0], axis=0) * walk.rate_hz
    change = np.linalg.norm(np.diff(speed, axis=0), axis=1) * walk.rate_hz
    own = np.linalg.norm(np.diff(np.diff(walk.joints[:, 0], axis=0), axis=0), axis=1).max() * walk.rate_hz**2
    # The pelvis loses 1 m/s within 0.6 s: 1.875 / 0.6 at most on top of its own.
    assert change[same - 2 :].max() < own + 1.875 * np.linalg.norm(speed[same - 1]) / 0.6


def test_a_short_hold_takes_no_longer_than_it_is_asked_to(walk: Motion) -> None:
    held = hold(walk, 0.1)
    assert held.duration_s == pytest.approx(walk.duration_s + 0.1, abs=1 / walk.rate_hz)
    np.testing.assert_allclose(held.joints[-1], walk.joints[-1], atol=1e-3)


def test_aside_is_to_the_left_as_the_radar_sees_it(walk: Motion) -> None:
    placed = place(walk, distance_m=3.0, boresight=(0.0, 1.0, 0.0))
    left = aside(placed, 0.7, (0.0, 1.0, 0.0))
    np.testing.assert_allclose(
        left.joints - placed.joints, np.broadcast_to([-0.7, 0.0, 0.0], placed.joints.shape), atol=1e-12
    )


def test_the_liveliest_piece_comes_first(walk: Motion) -> None:
    at_rest = hold(walk, 4.0)
    assert _starts(at_rest, 3.0, 1.0)[0] < 1.5
    assert _starts(at_rest, 3.0, 1.0)[-1] == max(_starts(at_rest, 3.0, 1.0))


def test_pieces_hold_as_much_movement_as_was_drawn(walk: Motion) -> None:
    at_rest = hold(walk, 4.0)
    for wanted in (0.3, 0.6, 0.9):
        start_s = _starts(at_rest, 3.0, wanted)[0]
        assert moves(trim(at_rest, start_s, start_s + 3.0)).mean() == pytest.approx(wanted, abs=0.12)


def test_long_paths_are_bent_and_short_ones_are_not(walk: Motion) -> None:
    long = repeat(walk, 7.0)
    for side in (-1.0, 1.0):
        radius_m = arc_radius_m(long, side)
        assert radius_m * side > 0
        pelvis = arc(long, radius_m).joints[:, 0, :2]
        assert np.linalg.norm(pelvis - pelvis.mean(axis=0), axis=1).max() < REACH_M + 0.1
    assert arc_radius_m(trim(walk, 0.0, 1.5), 1.0) == 0.0


def test_who_travels_comes_as_often_as_he_goes_and_is_as_far_away(recipe: Recipe, walk: Motion) -> None:
    long = repeat(walk, 5.0)
    long = arc(long, arc_radius_m(long, 1.0))
    spot = repeat(walk, 5.0, travel=False)
    going, staying = ([placing(recipe, number, "free_space", each) for number in range(80)] for each in (long, spot))
    np.testing.assert_allclose([each.range_m for each in going], [each.range_m for each in staying], atol=0.02)
    assert 0.35 < np.mean([each.nearer_m > 0 for each in going]) < 0.65
    assert np.mean([each.approaching for each in going]) == pytest.approx(0.5, abs=0.1)


@pytest.mark.slow
def test_motions_are_as_long_as_the_records_and_what_was_asked_for(recipe: Recipe) -> None:
    for number, activity in enumerate(("bending", "falling")):
        found = sample_motion(recipe, activity, 0, number)
        assert found.motion.duration_s == pytest.approx(3.0, abs=1e-9)
        assert found.passed
        assert check_motion(found.motion, expected=activity).passed
        again = sample_motion.__wrapped__(recipe, activity, 0, number)
        np.testing.assert_array_equal(again.motion.joints, found.motion.joints)


@pytest.mark.slow
def test_the_source_of_a_motion_makes_the_same_motion(recipe: Recipe) -> None:
    found = sample_motion(recipe, "falling", 0, 1)
    source = MotionText(**found.source.model_dump())
    radar = recipe.radar
    np.testing.assert_array_equal(source.placed(source.made(), radar).joints, place(found.motion).joints)


def test_a_piece_that_is_kept_is_what_is_cut_and_told_of_each_time(recipe: Recipe) -> None:
    source = MotionText(text="a person walks forward", hold_s=0.5, start_s=0.3, radius_m=2.0, distance_m=3.0)
    whole = source.made()
    np.testing.assert_array_equal(source.piece().joints, source.cut(whole).joints)
    assert source.piece().origin == source.cut(whole).origin
    assert source.piece() is source.model_copy(update={"distance_m": 4.0}).piece()
    late = source.model_copy(update={"stop_s": whole.duration_s + 1.0})
    for _ in range(2):
        with pytest.warns(T2DWarning, match="before stop_s of"):
            late.piece()


def test_in_a_room_motions_keep_clear_of_walls_and_furniture(recipe: Recipe) -> None:
    low, high, boxes = scene_extent("living_room")
    assert len(boxes) > 5
    for index in range(4):
        made = sample(recipe, index)
        source = made.experiment.targets[0]
        assert isinstance(source, MotionText)
        joints = source.placed(source.made(), made.experiment.radar).joints
        if made.place.overlap_m == 0:
            inside = (joints[..., :2] > low[:2] + 0.9 * CLEARANCE_M) & (joints[..., :2] < high[:2] - 0.9 * CLEARANCE_M)
            assert inside.all()
    assert sum(sample(recipe, index).place.overlap_m == 0 for index in range(4)) >= 2


@pytest.fixture(scope="module")
def walks() -> Recipe:
    return Recipe(
        name="takes", classes=["walking"], descriptions_per_class=4, samples_per_description=1, radar="table2-uniform",
        duration_s=3.0, conditions=[{"name": "room", "scene": "living_room"}],
    )  # fmt: skip


def test_in_a_room_what_people_carry_keeps_clear_too(walks: Recipe, walk: Motion) -> None:
    """The walk alone has room at the place that is drawn; a walking frame's front would stand 9 cm in the wall there."""
    low, high, boxes = scene_extent("living_room")
    loaded = carry(walk, "walker")
    into_m = []
    for carried in ((), (loaded,)):
        found = placing(walks, 5, "living_room", walk, None, carried)
        assert found.overlap_m == 0
        start = {"distance_m": found.distance_m, "angle_deg": found.angle_deg}
        placed = aside(place(loaded, **start, radar_position_m=(0.0, 0.0, found.height_m)), found.aside_m)
        points = np.concatenate([thing.at(placed.times_s[::10]).reshape(-1, 3) for thing in things(placed)])
        into_wall_m = np.maximum(low - points, points - high)[:, :2].max()
        into_m.append(
            max(into_wall_m, *(np.minimum(points - box[0], box[1] - points).min(axis=1).max() for box in boxes))
        )
    assert into_m[0] > 0.05
    assert into_m[1] < 0.01


def test_conditions_of_a_motion_have_one_place_whatever_is_carried(walks: Recipe) -> None:
    conditions = [
        {"name": "bare", "scene": "living_room"},
        {"name": "loaded", "scene": "living_room", "carries": "walker"},
    ]
    both = Recipe.model_validate({**walks.model_dump(), "conditions": conditions, "each_condition": True})
    bare, loaded = sample(both, 0), sample(both, 1)
    assert (bare.cell.condition.name, loaded.cell.condition.name) == ("bare", "loaded")
    assert bare.place == loaded.place


def test_in_free_space_the_first_place_that_is_drawn_is_taken(recipe: Recipe, walk: Motion) -> None:
    found = placing(recipe, 0, "free_space", walk)
    placed = aside(place(walk, distance_m=found.distance_m, angle_deg=found.angle_deg), found.aside_m)
    assert placed.joints[:, 0, 1].mean() == pytest.approx(0.0, abs=0.01)
    assert 2.5 <= found.range_m <= 5.0


@pytest.mark.parametrize(
    ("beside", "kind"), [("fan", "fan"), ("curtain", "curtain"), ("pet", "pet"), ("person", "text")]
)
def test_what_moves_beside_the_person(recipe: Recipe, beside: str, kind: str) -> None:
    first, again, other = (interferer(beside, recipe, number) for number in (0, 0, 1))  # type: ignore[arg-type]
    assert other is not None
    assert first.kind == kind
    assert first == again != other
    assert interferer("none", recipe, 0) is None


def test_dogs_and_cats_walk_beside_the_person(recipe: Recipe) -> None:
    pets = [interferer("pet", recipe, number) for number in range(12)]
    assert {pet.animal for pet in pets if isinstance(pet, t2d.Pet)} == {"dog", "cat"}


def test_sentences_of_second_persons_are_nobodys_label(recipe: Recipe, monkeypatch: pytest.MonkeyPatch) -> None:
    """Even where they are drawn with the same seed."""
    monkeypatch.setattr(sys.modules["t2d_rt.dataset.sample"], "RESERVED_SEED", 0)  # its name is also a function's
    reserved_walks.cache_clear()
    many = recipe.model_copy(update={"classes": ("walking",), "descriptions_per_class": 300})
    labels = {each.sentence for each in descriptions("walking", 300, many.seed)}
    walks = reserved_walks(many)
    assert len({each.sentence for each in walks}) == 20
    assert not labels & {each.sentence for each in walks}
    found = interferer("person", many, 3)
    assert isinstance(found, MotionText)
    assert found.text in {each.sentence for each in walks}
    reserved_walks.cache_clear()
