"""The slow validation: `python -m validation` runs all sections, `python -m validation rcs bounces` some of them, and
`python -m validation study NAME` a study of `validation/studies`."""

from __future__ import annotations

import sys
import time
import warnings
from importlib import import_module

from t2d_rt.core.errors import T2DWarning
from validation.report import record, summary, write_report

SECTIONS = {
    "chart": "methods", "tolerance": "methods", "laws": "methods", "rcs": "physics", "canonical": "physics",
    "bounces": "physics", "multilevel": "methods",
    "accuracy": "methods", "accuracy_rooms": "methods", "limbs": "methods", "arrays": "physics",
    "rooms": "physics", "edges": "physics", "ghosts": "physics", "movers": "physics", "ellipsoid_model": "physics",
    "human_rcs": "physics", "background": "physics", "blockage": "physics", "stability": "methods",
    "results": "robustness", "memory": "robustness",
    "corruptions": "robustness", "fuzz": "robustness", "soak": "robustness",
    "nearest_centroid": "datasets", "limb_labels": "datasets", "lost_worker": "datasets", "hidden_labels": "datasets",
}  # fmt: skip
"""Sections in the order of the report, each with the package that it lies in."""


def main(names: list[str]) -> int:
    """Exit code: 0 if all limits are met."""
    if names[:1] == ["study"]:
        from validation.studies import main as study

        return study(names[1:])
    unknown = [name for name in names if name not in SECTIONS]
    if unknown:
        print(f"unknown section {unknown[0]}; choose from {', '.join(SECTIONS)}", file=sys.stderr)
        return 2
    warnings.simplefilter("ignore", T2DWarning)  # a plate is not watertight, a burst aliases: meant so here
    failed = 0
    for name in names or SECTIONS:
        start = time.perf_counter()
        section = import_module(f"validation.{SECTIONS[name]}.{name}").run()
        record(name, section)
        write_report(SECTIONS)
        print(f"\n{section.title} ({time.perf_counter() - start:.0f} s)\n{summary(section)}", flush=True)
        failed += sum(not check.passed for check in section.checks)
    print(f"\n{'all limits are met' if not failed else f'limits missed: {failed}'}: validation/report/report.md")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
