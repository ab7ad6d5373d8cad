"""A quick part of the stability suite: that common methods fail where it says so, and that the package holds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from t2d_rt.types import Radar
from validation.methods.stability import bodies, distances, facets, motions, rooms, signals
from validation.methods.stability.case import Case
from validation.report import at_least, at_most

pytestmark = pytest.mark.filterwarnings("ignore::t2d_rt.core.errors.T2DWarning")  # sheets and torn meshes are meant so
QUICK: list[Callable[[Radar], Case | list[Case]]] = [
    distances.inside, facets.tangent, facets.degenerate, signals.coupling, bodies.grazing, bodies.end_on, bodies.hidden,
    rooms.random_rays,
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("case", QUICK, ids=lambda case: case.__name__)
def test_it_holds_where_another_method_fails(case: Callable[[Radar], Case | list[Case]]) -> None:
    found = case(Radar.preset("table2"))
    for each in found if isinstance(found, list) else [found]:
        assert [check.what for check in each.checks if not check.passed] == []


def test_small_differences_and_aliasing_hold(tmp_path: Path) -> None:
    cases, _ = facets.small_differences(tmp_path)
    for each in (*cases, signals.aliasing(), motions.jitter()):
        assert [check.what for check in each.checks if not check.passed] == []


def test_a_case_whose_failing_method_holds_is_missed() -> None:
    case = Case("c", at_least("f", 0.1, 1, "dB"), at_most("o", 0.1, 0.3, "dB"))
    assert [check.passed for check in case.checks] == [False, True]
    assert "so does the other" in str(case.row["verdict"])
