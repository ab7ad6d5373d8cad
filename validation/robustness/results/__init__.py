"""Results on disk: killed runs, several writers of one output, and large cubes."""

from __future__ import annotations

from validation.report import Section
from validation.robustness.results import cubes, kills, writers


def run() -> Section:
    found = [kills.run(), writers.run(), cubes.run()]
    return Section(
        title="Results on disk",
        checks=[check for part in found for check in part.checks],
        note=" ".join(part.note for part in found),
        table=cubes.rows(found[-1]),
    )
