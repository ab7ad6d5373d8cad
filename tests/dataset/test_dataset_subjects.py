"""Subjects of a recipe: the same person over many samples, and no person on two sides of a split."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from t2d_rt.body import template
from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Recipe, split
from t2d_rt.dataset.recipe import recipe_names
from t2d_rt.dataset.sample import _angle_deg, cell_of, description_of, sample
from t2d_rt.dataset.splits import check_split
from t2d_rt.dataset.subjects import KINDS, subject, subject_of


def tiny(**changes: Any) -> Recipe:
    return Recipe(
        **{
            "name": "tiny", "classes": ["bending", "sitting"], "descriptions_per_class": 6, "samples_per_description": 3,
            "attempts": 1, "subjects": 12, "gait_factors": [0.85, 1.2], "radar": "table2", "duration_s": 2.0,
            "conditions": [{"name": "ellipsoids", "method": "ellipsoid"}], **changes,
        }
    )  # fmt: skip


def test_a_subject_is_one_person_in_all_samples() -> None:
    recipe, seen = tiny(), defaultdict(list)
    for index in range(12, 24):
        found = sample(recipe, index)
        who, source = subject(recipe, found.subject), found.cut.source
        assert (source.body, source.stature_m, source.gait_factor) == (who.body, who.stature_m, who.gait_factor)
        assert found.experiment.body == who.body
        breathing = found.cut.motion.breathing
        seen[found.subject].append((breathing.rate_hz, breathing.depth_m, found.cut.motion, found.description.subject))
    often = [each for each in seen.values() if len(each) > 1]
    assert len(often) >= 3
    assert any(len({who for *_, who in each}) > 1 for each in often)  # called a man here and a person there
    for each in often:
        assert len({(rate_hz, depth_m) for rate_hz, depth_m, *_ in each}) == 1
        ends = [motion.joints[:, [motion.index("left_knee"), motion.index("left_hip")]] for *_, motion, _ in each]
        assert np.ptp([np.median(np.linalg.norm(np.diff(bone, axis=1), axis=-1)) for bone in ends]) < 1e-3
    assert len({number % len(KINDS) for number in seen}) < len(seen)  # two women are among them
    assert len({each[0][0] for each in seen.values()}) == len(seen)


def test_descriptions_get_subjects_whom_they_mean() -> None:
    recipe = tiny()
    for meant, bodies in (("child", {"child"}), ("woman", {"woman"}), ("person", {"adult", "woman", "man"})):
        found = {subject_of(recipe, meant, number, None).body.partition("@")[0] for number in range(40)}  # type: ignore[arg-type, union-attr]
        assert found == bodies
    assert subject_of(tiny(subjects=None), "child", 0, None) is None


def test_bodies_differ_and_are_ones_that_people_have() -> None:
    recipe = tiny(subjects=240)
    found = [subject(recipe, number) for number in range(240)]
    assert len({(each.body, each.stature_m) for each in found}) == 240
    for each in found:
        kind = KINDS[each.number % len(KINDS)]
        body = template(each.body)
        bmi = body.bmi * each.stature_m / body.stature_m
        low, high = template(kind).bmi_limits
        assert 0.85 * low < bmi < 1.15 * high
        assert abs(each.stature_m / {"child": 1.26}.get(kind, 1.7) - 1) < 0.2


def test_shipped_recipes_have_a_hundred_subjects_or_more() -> None:
    for name in recipe_names():
        assert (Recipe.read(name).subjects or 0) >= 100
    assert tiny(subjects=None).hash != tiny().hash
    with pytest.raises(InputError, match="leave bodies out"):
        tiny(bodies=["man"])


def test_splits_by_subject() -> None:
    records = [
        {"index": n, "class": "ab"[n % 2], "sentence": "s", "seed": n, "sources": [], "subject": n // 2 % 20}
        for n in range(400)
    ]
    made = split(records, (0.7, 0.3), apart=("subject",), seed=1)
    train, test = ({records[index]["subject"] for index in made.sides[name]} for name in ("train", "test"))
    assert not train & test
    assert len(train | test) == 20
    assert abs(len(made.sides["train"]) - 280) <= 40
    with pytest.raises(InputError, match="leaks: subject '3' is in train and in test"):
        check_split(records, {"train": [6], "test": [7]}, apart=("subject",))
    with pytest.raises(InputError, match="give the recipe subjects"):
        split([each | {"subject": None} for each in records], apart=("subject",))


def test_a_person_seed_is_one_person_whatever_is_done() -> None:
    first, second = (
        t2d.motion_from_text(text, seed=seed, person_seed=7, body="man@30", stature_m=1.8)
        for text, seed in (("a man bends down", 1), ("a person sits down on a chair", 2))
    )
    assert first.breathing == second.breathing
    other = t2d.motion_from_text("a man bends down", seed=1, person_seed=8, body="man@30", stature_m=1.8)
    assert other.breathing != first.breathing


SIDES = [
    {"name": "train", "weight": 2, "conditions": ["near"], "angles_deg": [[-30, 30], [60, 90]]},
    {"name": "test", "weight": 1, "conditions": ["room"], "angles_deg": [[30, 60]]},
]


def test_sides_of_a_recipe_share_no_description_subject_condition_or_view() -> None:
    conditions = [
        {"name": "near", "method": "ellipsoid"},
        {"name": "room", "scene": "empty_room", "method": "ellipsoid"},
    ]
    values: dict[str, Any] = {"subjects": 36, "samples_per_description": 4, "conditions": conditions}
    recipe = tiny(**values, sides=SIDES)
    seen: dict[str, set[Any]] = {"train": set(), "test": set()}
    for index in range(recipe.samples):
        cell = cell_of(recipe, index)
        side = recipe.side_at(cell.description)
        who = subject_of(recipe, description_of(recipe, cell).subject, cell.number, side)
        seen[side.name] |= {
            ("subject", who.number),
            ("sentence", description_of(recipe, cell).sentence),
            cell.condition.name,
        }
    assert not seen["train"] & seen["test"]
    assert {"near"} < seen["train"]
    rng = np.random.default_rng(0)
    angles = np.array([_angle_deg(rng, recipe.sides[0].angles_deg) for _ in range(3000)])
    assert ((abs(angles) <= 30) | ((angles >= 60) & (angles <= 90))).all()
    assert abs(np.mean(angles > 30) - 1 / 3) < 0.03  # 30 of 90 degrees
    assert recipe.hash != tiny(**values).hash
    for changes, told in (
        ({"sides": SIDES[:1]}, "needs train and test, each side once, got train"),
        ({"subjects": None}, "sides needs subjects to hold apart"),
        ({"conditions": conditions[:1]}, "unknown condition of side test 'room'"),
        ({"descriptions_per_class": 2}, "add up to 3, more than descriptions of a class"),
        ({"sides": [{**SIDES[0], "angles_deg": [[30, 10]]}, SIDES[1]]}, "angles_deg of side train must rise"),
    ):
        with pytest.raises(InputError, match=told):
            tiny(**(values | {"sides": SIDES} | changes))
