"""The fuzzer: a short run over all kinds of input, and that it notices every kind of failure; the limits of the soak."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from validation.robustness.fuzz.__main__ import regressions
from validation.robustness.soak import section

KINDS = {
    "bvh", "radar_yaml", "scene_xml", "recording_zarr", "command_line", "api_calls", "api_values", "shards", "result_files",
    "endpoint", "momask", "trained", "dead_parents",
}  # fmt: skip
KNOWN = {
    5: ("well", ""), 12: ("refused", ""), 29: ("traceback", "traceback"), 18: ("crash", "crash"), 10: ("hang", "hang"),
    9: ("busy", "hang"), 11: ("memory", "memory"), 2: ("too large a number", "memory"), 19: ("exit", "traceback"),
    8: ("two lines", "wrong"), 3: ("escape", "wrong"), 22: ("raw warning", "wrong"), 13: ("NaN", "wrong"), 6: ("opened", "wrong"),
    0: ("left behind", "wrong"),
}  # fmt: skip
"""Numbers of the inputs of validation/robustness/fuzz/known_ends.py, what each does, and what the fuzzer has to call that."""


def fuzzed(place: Path, *arguments: str) -> list[dict[str, Any]]:
    """The outcomes of a run in a fresh process: this one has computed, and its threads would be missing in forked ones."""
    results = place / "outcomes.json"
    command = [
        sys.executable, "-m", "validation.robustness.fuzz", "--results", str(results), "--keep", str(place / "kept"),
        *arguments,
    ]  # fmt: skip
    run = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)
    assert results.exists(), run.stderr[-2000:]
    found: list[dict[str, Any]] = json.loads(results.read_text())
    return found


@pytest.mark.slow
def test_odd_inputs_of_all_kinds_end_well(tmp_path: Path) -> None:
    """One of each kind and the last of each that failed once; validation tries them all and thousands more."""
    known = {name.partition(":")[0]: name for name in regressions()}.values()
    outcomes = fuzzed(tmp_path, "--no-regressions", "--count", "2", "--start", "5003", "--only", *known, *KINDS)
    failed = [f"{o['name']} {o['problem']}: {o['told'][:150]} {o['what'][:200]}" for o in outcomes if o["problem"]]
    assert not failed, "\n".join(failed)
    assert {o["name"].partition(":")[0] for o in outcomes} == KINDS
    assert sum(not o["what"] for o in outcomes) > 2, "hardly any input was accepted"
    assert sum(bool(o["what"]) for o in outcomes) > 2, "hardly any input was refused"


@pytest.mark.slow
def test_every_kind_of_failure_is_noticed(tmp_path: Path) -> None:
    outcomes = fuzzed(
        tmp_path, "--seconds", "1", "--megabytes", "300", "--only", *(f"known_ends:{number}" for number in KNOWN)
    )
    found = {int(o["name"].partition(":")[2]): (o["told"], o["problem"]) for o in outcomes}
    assert found == KNOWN
    for number, (_, problem) in KNOWN.items():  # what failed can be looked at
        assert (tmp_path / "kept" / f"known_ends-{number}" / "told.txt").exists() == bool(problem)


@pytest.mark.parametrize(("growth_mb", "passes"), [(0.0, True), (0.1, True), (0.9, False)])
def test_growing_memory_misses_the_limit(growth_mb: float, passes: bool, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    resident = 1000 + 4 * rng.standard_normal(300) + growth_mb * np.arange(300) - 400 * np.exp(-np.arange(300) / 20)
    found = section(resident.tolist(), ["ball", "room"] * 150, tmp_path)
    assert [check.passed for check in found.checks] == [passes] * 3
    assert (tmp_path / found.charts[0]).exists()
