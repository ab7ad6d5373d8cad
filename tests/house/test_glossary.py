"""Every term of the public interface stands in docs/glossary.md."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

import pytest

import t2d_rt as t2d
import t2d_rt.dataset
import t2d_rt.learn
from t2d_rt.cli import COMMANDS
from t2d_rt.types.fields import Fields

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "glossary.md").read_text(encoding="utf-8")


def explained(section: str | None = None) -> set[str]:
    """Names that the first column of the tables explains, of one section or of all; of a call without its arguments."""
    parts = re.split(r"^## ", TEXT, flags=re.MULTILINE)[1:]
    if section is not None:
        parts = [part for part in parts if part.splitlines()[0] == section]
        assert parts, section
    rows = [line.split("|")[1] for part in parts for line in part.splitlines() if line.startswith("| ")]
    quoted = {name.split("(")[0] for row in rows for name in re.findall(r"`([^`]+)`", row)}
    return {name.rpartition(".")[2] for name in quoted}


def public(kind: type, base: type = object) -> list[str]:
    """Attributes of a class that `base` does not have."""
    return [name for name in dir(kind) if not name.startswith("_") and not hasattr(base, name)]


def instance_attributes(kind: Any) -> set[str]:
    """What a class's initialiser sets on self."""
    return set(re.findall(r"self\.([a-z]\w*)\b[^=\n]* = ", inspect.getsource(kind.__init__)))


def test_names_of_the_package() -> None:
    assert set(t2d.__all__) <= explained("Functions and classes of `t2d_rt`")


def test_functions_that_are_gone_are_not_explained() -> None:
    assert explained("Functions and classes of `t2d_rt`") == set(t2d.__all__)


def test_names_of_data_sets() -> None:
    assert explained("Functions and classes of `t2d_rt.dataset`") == set(t2d_rt.dataset.__all__)


def test_names_of_learning() -> None:
    assert explained("Functions and classes of `t2d_rt.learn`") == set(t2d_rt.learn.__all__)


def test_options_of_simulate() -> None:
    assert explained("Options of `simulate`") == set(inspect.signature(t2d.simulate).parameters)


@pytest.mark.parametrize("function", [t2d.run, t2d.plan])
def test_options_of_run_and_plan(function: Any) -> None:
    (text,) = re.findall(r"^`run` takes .*?\n\n", TEXT, flags=re.MULTILINE | re.DOTALL)
    assert set(inspect.signature(function).parameters) <= set(re.findall(r"`(\w+)`", text))


@pytest.mark.parametrize("kind", [t2d.Radar, t2d.Experiment, t2d.Accuracy, t2d.PathTier])
def test_fields_and_what_follows_from_them(kind: type[Fields]) -> None:
    name = kind.__name__
    known = explained(f"Fields of `{name}`")
    if kind is t2d.Radar:
        known |= explained("Values that follow from a `Radar`")
    asked = {*kind.model_fields, *public(kind, Fields)}
    assert len(asked) >= 8
    assert known == asked


def test_attributes_of_recordings() -> None:
    asked = {*public(t2d.Recording), *instance_attributes(t2d.Recording)}
    assert {"cube", "adc", "inputs", "versions"} <= asked
    assert explained("Attributes of `Recording`") == asked


def test_commands() -> None:
    known = {name.removeprefix("t2d-rt ") for name in explained("Commands")}
    assert known == set(COMMANDS)
