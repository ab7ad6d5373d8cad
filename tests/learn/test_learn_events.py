"""Events over time: their scores, and what a simulated recording tells of them."""

from __future__ import annotations

import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from command_line import Command
from learn_maps import ridges
from t2d_rt.core.errors import T2DWarning
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.sources import MotionText
from t2d_rt.learn import TrainOptions, train_model
from t2d_rt.learn.prediction import events_of, labels_of_windows
from t2d_rt.learn.scores import Event, event_scores
from t2d_rt.recording import truth
from t2d_rt.recording.recording import Recording
from t2d_rt.simulate import run as simulate
from t2d_rt.types import Radar

torch = pytest.importorskip("torch", reason="PyTorch is not installed (extra [learn])")


def test_events_are_found_by_their_overlap() -> None:
    true = [Event(0, 10, 0), Event(10, 14, 1), Event(14, 30, 0)]
    told = [
        Event(1, 9, 0),  # 0.8 of both
        Event(9, 12, 1),  # 2 of 5 s
        Event(12, 20, 0),  # 6 of 18 s
        Event(20, 28, 0),  # a half of the third, exactly
        Event(28, 30, 1),  # where there is none
    ]
    found = event_scores([(true, told)], 2, 30.0)
    assert found.found.tolist() == [2, 0]
    assert (found.true.tolist(), found.told.tolist()) == ([2, 1], [3, 2])
    assert found.f1 == pytest.approx(2 * 2 / (3 + 5))
    assert sorted(found.delays_s) == [1.0, 6.0]
    assert found.false_alarms_per_hour.tolist() == [0.0, 120.0]
    looser = event_scores([(true, told), ([], [])], 2, 30.0, overlap=0.4)
    assert looser.found.tolist() == [2, 1]
    # Of two told events one alone finds the true one; what is told of another recording finds nothing here.
    twice = event_scores([(true[:1], [Event(0, 5, 0), Event(5, 10, 0)]), ([], [Event(0, 10, 0)])], 1, 10.0)
    assert (twice.found.tolist(), twice.false_alarms.tolist()) == ([1], [1])


class Doing(Recording):
    """A recording whose persons do what it is told."""

    def __init__(self) -> None: ...

    @property
    def activities(self) -> list[truth.Doing]:
        told = [
            ("a", "walk", 0.0, 4.0), ("a", "turn", 4.0, 5.0), ("a", "sit", 5.0, 6.0), ("a", "seated", 6.0, 7.0),
            ("a", "stand", 7.0, 9.0), ("a", "stand_up", 9.0, 10.0), ("b", "fall", 0.0, 10.0),
        ]  # fmt: skip
        return [truth.Doing(*each) for each in told]


def test_actions_are_events_of_the_classes_that_they_belong_to() -> None:
    found = events_of(Doing(), ("walking", "sitting", "falling"))
    assert found == [Event(0, 5, 0), Event(5, 7, 1), Event(9, 10, 1), Event(0, 10, 2)]
    assert events_of(Doing(), ("stand",)) == [Event(7, 9, 0)]
    labels = labels_of_windows(found[:3], np.array([0.0, 4.0, 6.5, 7.0]), 2.0, 2)
    assert labels.tolist() == [0, 0, 1, -1]  # the second has a second of each


def test_one_command_evaluates_real_maps_and_a_recording_over_time(tmp_path: Path, run: Command) -> None:
    """A model of two of the three labels of a file, whose card tells which is which; and a sentence's own activities."""
    known = ridges(24)
    two = known.relabelled(("bending", "walking"), {"slow": "bending", "fast": "walking"})
    train_model("streaming", two, two, TrainOptions(epochs=1, batch=4), output=tmp_path / "model")
    levels, labels = known.levels, np.array(known.classes)[known.labels]
    np.savez(tmp_path / "real.npz", levels=levels, labels=labels, velocity_mps=known.velocity_mps, duration_s=5.0)
    refused = run("evaluate", str(tmp_path / "real.npz"), "--model", str(tmp_path / "model"))
    assert "say on its card which label is which class" in refused.err
    (tmp_path / "real.npz.card.yaml").write_text("classes: {slow: bending, fast: walking}\n")
    done = run("evaluate", str(tmp_path / "real.npz"), "--model", str(tmp_path / "model"))
    assert "streaming on 16 maps by the adapter npz: accuracy" in done.out
    words = "a person walks in a circle for 4 s, bends down and walks in a circle for 3 s"
    whole = Experiment(
        targets=(MotionText(text=words, distance_m=4.0),), method="ellipsoid", noise="receiver",
        radar=Radar.preset("table2", samples=32, prf_hz=5120.0),
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", T2DWarning)  # fast hands alias, and the model was trained on ridges
        recording = simulate(whole, progress=False)
        does = recording.activities
        recording.save(tmp_path / "minute.zarr")
        done = run(
            "evaluate", str(tmp_path / "minute.zarr"), "--model", str(tmp_path / "model"), "-o", str(tmp_path / "out")
        )
    assert [each.activity for each in does if each.activity != "stand"] == ["walk", "bend", "walk"]
    assert all(one.end_s == other.begin_s for one, other in pairwise(does))
    assert done.code == 0, done.err
    assert "events: F1" in done.out
    assert "of 3 found" in done.out
    assert "streaming on windows: accuracy" in done.out
    assert (tmp_path / "out" / "confusion.png").exists()
