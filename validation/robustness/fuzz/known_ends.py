"""Inputs with known ends, by which the tests see that the runner tells each from the others; no part of a fuzzing run."""

from __future__ import annotations

import ctypes
import time
import warnings
from pathlib import Path

import numpy as np

import t2d_rt as t2d
from validation.robustness.fuzz.case import Attempt, check_finite, leaving_nothing, no_raw_warnings, pick, untouched

ENDS = (
    "well", "refused", "traceback", "crash", "hang", "memory", "two lines", "escape", "raw warning", "NaN", "opened", "left behind",
    "exit", "too large a number", "busy",
)  # fmt: skip


class Unchecked(t2d.T2DError):
    """An error whose sentence is as it was given."""

    def __str__(self) -> str:
        return self.sentence

    def __init__(self, sentence: str) -> None:
        super().__init__(sentence)
        self.sentence = sentence


def attempt(rng: np.random.Generator, folder: Path) -> Attempt:
    """One of the ends."""
    how = pick(rng, ENDS)
    return Attempt(how, lambda: _ended(how, folder))


def _ended(how: str, folder: Path) -> None:
    if how == "refused":
        raise t2d.InputError("no such file; check the path")
    if how == "traceback":
        raise TypeError("unexpected")
    if how == "crash":
        ctypes.string_at(0)
    elif how == "hang":
        time.sleep(60)
    elif how == "busy":
        while True:
            pass
    elif how == "memory":
        held = [np.ones(2**22) for _ in range(20)]
        time.sleep(len(held))
    elif how == "two lines":
        raise Unchecked("a name of\ntwo lines")
    elif how == "escape":
        raise Unchecked("a name with \x1b[31m in it")
    elif how == "raw warning":
        with no_raw_warnings():
            warnings.warn("divide by zero", RuntimeWarning, stacklevel=1)
    elif how == "NaN":
        check_finite(np.array([1.0, np.nan]), "the result")
    elif how == "opened":
        (folder / "trap").mkdir()
        (folder / "trap" / "canary").write_text("x")
        with untouched(folder / "trap"):
            (folder / "trap" / "canary").read_text()
    elif how == "left behind":
        leaving_nothing(lambda: _refused_late(folder), folder)()
    elif how == "exit":
        raise SystemExit(3)
    elif how == "too large a number":
        np.empty(2**50)


def _refused_late(folder: Path) -> None:
    (folder / "half.partial").write_text("x")
    raise t2d.InputError("no space; free some")
