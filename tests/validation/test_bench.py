"""The benchmark's own arithmetic and its report; the measuring itself is `make bench`."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import t2d_rt as t2d
from t2d_rt.core.resources import resource
from validation.bench.charts import stage_chart, sweep_chart
from validation.bench.measure import Case
from validation.bench.sections import Found, Sweep, overview, power_law, sweeps, swept, walk
from validation.bench.stages import (
    ECHO_BYTES,
    FACETS,
    PATHS,
    PIECE_BYTES,
    SPECTROGRAM,
    STAGES,
    SYNTHESIS,
    pieces,
    stage_seconds,
)
from validation.report import record, write_report


def made_up(case: Case) -> dict[str, object]:
    """Figures as if time went with a fixed part and the duration, synthesis with the duration alone."""
    seconds = 1 + 2 * case.duration_s
    return {
        "name": case.name, "method": case.method, "duration_s": case.duration_s, "prf_hz": 1e3, "antennas": 1,
        "pairs": 1, "facets": 10, "echoes": 5, "facet_terms": 100, "echo_terms": 50, "seconds": seconds, "peak_gb": 1.0,
        "yardstick_s": 2.0,
        "stages": {**dict.fromkeys(STAGES, 0.1), SYNTHESIS: 2 * case.duration_s},
    }  # fmt: skip


@pytest.fixture
def durations() -> tuple[Sweep, Found]:
    sweep = sweeps(quick=False)["durations"]
    return sweep, swept(sweep, made_up)[1]


def test_power_law_of_points_on_one_in_any_order() -> None:
    x = np.array([60.0, 1, 20, 5, 2])
    law = power_law(x, 0.3 * x**1.2)
    assert (law.power, law.factor, law.start) == pytest.approx((1.2, 0.3, 5))


def test_power_law_takes_the_upper_half_only() -> None:
    x = np.array([1.0, 2, 4, 8, 16, 32])
    assert power_law(x, np.where(x < 4, 100, x)).power == pytest.approx(1)


def test_a_sweep_is_judged_by_its_exponent(durations: tuple[Sweep, Found]) -> None:
    section, _ = swept(durations[0], made_up)
    assert 0.9 < section.checks[0].measured < 1
    assert section.checks[0].passed
    row = overview([durations]).table[0]
    assert row["of synthesis"] == pytest.approx(1)
    assert (row["from"], row["fitted from"], row["to"]) == (1, 10, 60)


def test_slow_cases_miss_their_limits() -> None:
    section, _ = walk(lambda case: {**made_up(case), "seconds": 21.0}, quick=False)
    missed = {check.what for check in section.checks if not check.passed}
    assert missed == {
        "ellipsoid, table2-uniform", "ellipsoid, table2", "mesh, table2-uniform", "mesh, table2",
        "mesh, table2-uniform, living_room", "mesh, array-3x4",
    }  # fmt: skip


def test_antennas_are_those_asked_for() -> None:
    counts = [
        len(c.changes["tx_offsets_m"]) * len(c.changes["rx_offsets_m"]) for c in sweeps(quick=False)["antennas"].cases
    ]
    assert counts == [1, 3, 12, 48, 192]


@pytest.mark.slow
def test_report_has_tables_and_charts(durations: tuple[Sweep, Found], tmp_path: Path) -> None:
    section, found = swept(durations[0], made_up)
    record("durations", section, tmp_path)
    charts = stage_chart(found, tmp_path), sweep_chart([durations], tmp_path)
    write_report(["durations"], tmp_path / "bench.md", title="Benchmark", command="make bench")
    text = (tmp_path / "bench.md").read_text(encoding="utf-8")
    assert "# Benchmark" in text
    assert "| duration [s] | seconds |" in text
    assert "| 60 | 121 | 120 |" in text
    assert all((tmp_path / chart).stat().st_size > 1000 for chart in charts)


@pytest.mark.parametrize(("frames", "echoes"), [(4, 10), (5, 0), (300, 200_000), (293, 200_000), (5000, 50_000)])
def test_pieces_cover_a_record(frames: int, echoes: int) -> None:
    found = pieces(frames, echoes)
    assert (found[0][0], found[-1][1]) == (0, frames)
    assert all(first == stop - 1 for (_, stop), (first, _) in pairwise(found))
    assert min(stop - first for first, stop in found) >= 4
    assert max(stop - first for first, stop in found) * echoes * ECHO_BYTES < 2 * PIECE_BYTES


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["free_space", "empty_room"])
def test_stages_are_told_apart(scene: str) -> None:
    walk = t2d.place(t2d.load_motion(resource("motions", "12_01_walk.bvh")), distance_m=3.0)
    radar = t2d.Radar.preset("table2", prf_hz=5120.0)
    target = t2d.trim(walk, 0.5, 0.7)
    spent, done = stage_seconds(
        target, radar, scene=scene, method="mesh", accuracy={"sagitta_rad": 2.0, "dynamic_range_db": 10}
    )
    assert set(spent) == set(STAGES)
    assert (spent[PATHS] > 0) == (scene != "free_space")
    assert min(spent[FACETS], spent[SYNTHESIS], spent[SPECTROGRAM]) > 0
    assert done["instants"] >= len(radar.chirp_times_s(target.duration_s))
    assert done["facets"] > 6_402
    assert done["echo_terms"] > done["instants"]
    assert done["facet_terms"] > 10 * done["facets"]
