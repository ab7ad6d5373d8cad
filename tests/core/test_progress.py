"""How progress is shown: a bar on a terminal, lines without carriage returns in a log, nothing unless it is asked for."""

from __future__ import annotations

import io
import sys
import time
from types import SimpleNamespace
from typing import Any

import pytest

import t2d_rt as t2d
from builders import ball
from t2d_rt.core import progress
from t2d_rt.core.errors import InputError
from t2d_rt.core.progress import BETWEEN_LINES_S, ProgressBar, shown_progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Time that the test sets."""
    found = SimpleNamespace(now=100.0)
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: found.now))
    return found


def written(monkeypatch: pytest.MonkeyPatch, clock: SimpleNamespace, stream: io.StringIO, step_s: float) -> str:
    """What 100 steps of a run of `step_s` each write."""
    monkeypatch.setattr(sys, "stderr", stream)
    with ProgressBar("mesh") as bar:
        for number in range(1, 101):
            clock.now += step_s
            bar(number / 100)
    return stream.getvalue()


def test_a_log_has_a_line_now_and_then(monkeypatch: pytest.MonkeyPatch, clock: SimpleNamespace) -> None:
    text = written(monkeypatch, clock, io.StringIO(), step_s=1.0)
    assert text == "mesh 30 % after 30 s\nmesh 60 % after 60 s\nmesh 90 % after 90 s\n"


def test_a_log_of_a_short_run_is_empty(monkeypatch: pytest.MonkeyPatch, clock: SimpleNamespace) -> None:
    assert written(monkeypatch, clock, io.StringIO(), step_s=0.99 * BETWEEN_LINES_S / 100) == ""


def test_a_terminal_has_a_bar_that_goes(monkeypatch: pytest.MonkeyPatch, clock: SimpleNamespace) -> None:
    monkeypatch.setattr(progress, "SHOWN_AFTER_S", 0.0)
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    bar = ProgressBar("mesh")
    bar(0.5)
    time.sleep(0.15)  # tqdm draws ten times a second
    bar(0.6)
    assert "mesh  60%" in stream.getvalue()
    bar(1.0)
    assert bar._bar is None
    assert stream.getvalue().endswith("\r")


def test_without_stderr_nothing_is_written(
    monkeypatch: pytest.MonkeyPatch, clock: SimpleNamespace, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stderr", None)
    with ProgressBar("mesh") as bar:
        clock.now += 100
        bar(0.5)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("asked", [None, False])
def test_nothing_is_shown_by_default(asked: Any) -> None:
    assert shown_progress(asked, "mesh") is None


def test_simulate_shows_a_bar_when_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    fractions: list[float] = []
    monkeypatch.setattr(ProgressBar, "__call__", lambda self, fraction: fractions.append(fraction))
    radar = t2d.Radar.preset("ci4r", prf_hz=4000)
    motion = t2d.trim(t2d.example("walk"), 0, 0.3)
    t2d.simulate(motion, radar=radar, method="ellipsoid")
    assert not fractions
    t2d.simulate(motion, radar=radar, method="ellipsoid", progress=True)
    assert fractions[-1] == 1.0


def test_what_is_neither_is_refused() -> None:
    with pytest.raises(InputError, match="progress must be True or a function of the fraction done, got 'yes'"):
        t2d.simulate("walk", progress="yes")  # type: ignore[arg-type]


def test_progress_never_falls_where_a_run_is_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    loop, told = sys.modules["t2d_rt.simulate"], list[float]()
    again = [True, False]
    monkeypatch.setattr(loop, "plan_again", lambda plan, error: plan if again.pop(0) else None)
    found = t2d.simulate(
        ball((3.0, 0.0, 1.0)), radar=t2d.Radar.preset("ci4r", prf_hz=4000), tolerance_db=-20, progress=told.append
    )
    assert found.settings["runs"] == 2
    assert told == sorted(told)
    assert told[-1] == 1.0
