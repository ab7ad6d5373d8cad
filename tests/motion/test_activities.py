"""What a person does over time: told by motions that are made from sentences, kept by edits, stored, and in the truth."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import t2d_rt as t2d
from builders import walk
from t2d_rt.core.errors import InputError
from t2d_rt.motion.generate.chain import doing
from t2d_rt.motion.vary.variations import hold


@pytest.fixture(scope="module")
def sits() -> t2d.Motion:
    """Walking is of clips, sitting down and standing up are made."""
    return t2d.motion_from_text("a person walks to a chair, sits down and stands up", seed=1)


def names(motion: t2d.Motion) -> list[str]:
    return [name for name, _ in motion.activities]


def test_steps_of_a_sentence_begin_one_after_the_other(sits: t2d.Motion) -> None:
    assert [name for name in names(sits) if name != "stand"] == ["walk", "sit", "seated", "stand_up"]
    begins_s = [begin_s for _, begin_s in sits.activities]
    assert begins_s[0] == 0.0
    assert all(after - before > 0.1 for before, after in pairwise((*begins_s, sits.duration_s)))
    height_m = sits.joints[:, 0, 2]
    speed_mps = np.linalg.norm(np.gradient(sits.joints[:, 0, :2], 1 / sits.rate_hz, axis=0), axis=1)
    does = sits.activity_at(sits.times_s)
    # Who walks travels at standing height; the hips are lowest between sitting down and standing up.
    assert speed_mps[does == "walk"].mean() > 0.5
    lowest = height_m < 0.7 * height_m[does == "walk"].mean()
    assert lowest.any()
    assert not (does[lowest] == "walk").any()
    assert height_m[-1] > 0.9 * height_m[does == "walk"].mean()
    assert height_m[does == "sit"][0] > 0.9 * height_m[does == "walk"].mean()


@pytest.mark.parametrize(
    ("sentence", "action", "rests", "late_s"),
    [  # hips that are down are not at rest: people get comfortable, recline, put their hands somewhere
        ("stands up", "stand_up", "stand", 0.7), ("sits down", "sit", "seated", 4.0), ("bends down", "bend", "stand", 1.5),
        ("lies down on the floor", "lie_down", "lying", 4.0),
    ],
)  # fmt: skip
def test_an_action_lasts_from_first_movement_to_last(sentence: str, action: str, rests: str, late_s: float) -> None:
    motion = t2d.motion_from_text(f"a person {sentence}", seed=3)
    frames = np.flatnonzero(motion.activity_at(motion.times_s) == action)
    assert names(motion)[-1] == rests
    height_m = motion.joints[frames, 0, 2]
    arrived = np.flatnonzero(np.abs(height_m - height_m[-1]) > 0.1)[-1]
    assert (len(frames) - arrived) / motion.rate_hz < late_s
    speed_mps = np.linalg.norm(np.gradient(motion.joints, 1 / motion.rate_hz, axis=0), axis=-1).mean(axis=1)
    assert speed_mps[frames[:20]].max() > 0.1 < speed_mps[frames[-20:]].max()
    # Nothing is told of the seconds in which the body rests before and after it.
    assert 1.0 < len(frames) / motion.rate_hz < motion.duration_s - 0.5


@pytest.mark.slow
def test_a_fall_begins_when_its_origin_says() -> None:
    falls = t2d.motion_from_text("a person walks forward and slips", seed=1)
    (told,) = (each for each in falls.origin if each.startswith("fall by"))
    assert names(falls) == ["walk", "fall"]
    assert falls.activities[1][1] == pytest.approx(float(told.partition("event ")[2].partition(" s")[0]), abs=0.006)


def test_edits_keep_what_is_done(sits: t2d.Motion) -> None:
    begins_s = {name: begin_s for name, begin_s in sits.activities if name != "stand"}
    sit_s, rest_s, stand_s = (begins_s[name] for name in ("sit", "seated", "stand_up"))
    cut = t2d.trim(sits, sit_s - 0.1, stand_s + 0.5)
    assert names(cut)[-3:] == ["sit", "seated", "stand_up"]
    np.testing.assert_allclose(
        [begin_s for _, begin_s in cut.activities[-3:]],
        [0.1, rest_s - sit_s + 0.1, stand_s - sit_s + 0.1],
        atol=0.5 / sits.rate_hz,
    )
    assert names(t2d.trim(sits, sit_s + 0.2, rest_s - 0.1)) == ["sit"]
    assert names(t2d.trim(sits, 0.0, 1.0)) == ["walk"]
    faster = t2d.vary_gait(sits, 1.25)
    assert names(faster) == names(sits)
    assert dict(faster.activities)["sit"] == pytest.approx(sit_s / 1.25, rel=0.1)
    for same in (t2d.resample(sits, 30.0), t2d.place(sits), t2d.mirror(sits), hold(sits, 1.0), t2d.smooth(sits)):
        assert same.activities == sits.activities
    assert t2d.repeat(sits, 2 * sits.duration_s).activities == ()
    alone = replace(t2d.trim(walk(), 0, 2), activities=(("walk", 0.0),))
    assert t2d.repeat(alone, 4.0).activities == (("walk", 0.0),)


def test_a_posture_that_a_motion_begins_in_is_done_at_once() -> None:
    for frames in (0, 1, 2):
        assert doing("squat", np.zeros((frames, 22, 3)), 60.0) == (("squat", 0),)


@pytest.mark.slow
def test_truth_tells_it_and_files_keep_it(sits: t2d.Motion, tmp_path: Path) -> None:
    sit_s = dict(sits.activities)["sit"]
    piece = t2d.trim(sits, sit_s - 0.1, sit_s + 0.1)
    recording = t2d.simulate(t2d.place(piece), radar="ci4r", method="ellipsoid")
    recording.save(tmp_path / "sit.zarr")
    truth = t2d.Recording.load(tmp_path / "sit.zarr").truth_at([0.0, 0.05, 0.15])
    assert [name in ("walk", "stand") for name in truth.activity.values[0, :2]] == [True, True]
    assert truth.activity.values[0, 2] == "sit"
    assert truth.made_for.values.tolist() == ["sitting"]
    plain = t2d.simulate(t2d.trim(walk(), 0, 0.1), radar="ci4r", method="ellipsoid")
    assert plain.truth_at(0.0).activity.values.tolist() == [[""]]
    assert "activities" not in plain.experiment.model_dump(mode="json")["targets"][0]


@pytest.mark.parametrize(
    "activities",
    ["walk", [("walk", -1.0)], [("walk", 1.0), ("sit", 0.5)], [("walk",)], [(1, 0.0)], [("walk", np.nan)], None],
)
def test_what_is_no_list_of_activities_is_refused(activities: object) -> None:
    with pytest.raises(InputError, match="activities"):
        replace(walk(), activities=activities)
