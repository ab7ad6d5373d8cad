"""Recordings of a minute: what they are made of, and that the program that scores them runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from t2d_rt.motion.descriptions.parse import parse_description

pytest.importorskip("torch", reason="PyTorch is not installed (extra [learn])")

from validation.datasets.continuous import OPTIONS, kept_windows, run, sentence


def test_a_minute_is_of_things_that_are_all_understood() -> None:
    for seed in range(10):
        words = sentence(np.random.default_rng(seed))
        steps = parse_description(words).description.steps
        assert {"walk", "sit", "stand_up", "bend", "jump"} <= {each.action for each in steps}
        assert steps[-1].duration_s == 40


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of hands that alias, and of two networks that hardly learned
def test_minutes_are_made_trained_on_and_told(tmp_path: Path) -> None:
    with np.load(kept_windows(0, tmp_path, 0)) as known:
        assert len(known["levels"]) == len(known["labels"]) > 60
    short = OPTIONS.model_copy(update={"epochs": 1})
    section = run(tmp_path, trainings=4, recordings=1, members=1, options=short, workers=2)
    f1, false_falls = section.checks
    assert (f1.limit, false_falls.limit) == (0.7, 1.0)
    assert 0 <= f1.measured <= 1
    assert "walking" in section.note
