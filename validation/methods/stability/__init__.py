"""Stability where methods fail: in each case a common method shown failing, and the package shown holding or warning."""

from __future__ import annotations

from validation.methods.stability import bodies, facets, motions, rooms, signals
from validation.report import Section

THEMES = (facets, signals, motions, bodies, rooms)


def run() -> Section:
    found = [module.theme() for module in THEMES]
    cases = [case for theme in found for case in theme.cases]
    return Section(
        title="Stability where methods fail",
        checks=[check for case in cases for check in case.checks],
        note="Each case shows a common method failing, by at least the first of its two limits, and `t2d_rt` at "
        "its default settings "
        "holding the second, or saying what is wrong.",
        table=[case.row for case in cases],
        charts=[chart for theme in found for chart in theme.charts],
    )
