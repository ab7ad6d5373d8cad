"""`python -m validation.bench` measures everything (25 minutes on 2 cores), with `--quick` a part of it in under two."""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

from t2d_rt.core.errors import T2DWarning
from validation.bench import peers, sections
from validation.bench.charts import stage_chart, sweep_chart
from validation.bench.datasets import datasets
from validation.bench.measure import Case, apart, measure
from validation.report import Section, record, summary, write_report

FOLDER, QUICK_FOLDER = Path(__file__).parent, Path("out/bench")


def main(*, quick: bool) -> int:
    """Exit code: 0 if all limits are met."""
    begin = time.perf_counter()
    folder = QUICK_FOLDER if quick else FOLDER
    done: dict[str, Section] = {}

    def run(case: Case) -> dict[str, Any]:
        found = apart(replace(case, runs=1) if quick else case)
        print(f"     {case.name}: {found['seconds']:.2f} s, {found['peak_gb']:.2f} GB", flush=True)
        return found

    def add(name: str, section: Section) -> None:
        done[name] = section
        record(name, section, folder)
        print(f"{section.title} ({time.perf_counter() - begin:.0f} s)\n{summary(section)}", flush=True)

    add("machine", sections.machine())
    section, shown = sections.walk(run, quick=quick)
    add("walk", section)
    swept = []
    for name, sweep in sections.sweeps(quick=quick).items():
        section, found = sections.swept(sweep, run)
        swept.append((sweep, found))
        add(name, section)
    if not quick:
        section, _ = sections.experiments(run)
        add("experiments", section)
        add("short", peers.short_records())
        add("peers", peers.peers())
        section, _ = sections.streamed(run)
        add("streamed", section)
        add("datasets", datasets(folder))
        section, found = sections.presets(run)
        shown = shown + [each for each in found if each["method"] == "mesh"]
        add("presets", section)
    add("stages", replace(sections.stages(shown), charts=[stage_chart(shown, folder)]))
    add("sweeps", replace(sections.overview(swept), charts=[sweep_chart(swept, folder)]))
    order = ["machine", "walk", "stages", "sweeps", *(name for name in done if name not in ("stages", "sweeps"))]
    command = "python -m validation.bench --quick" if quick else "make bench"
    write_report(dict.fromkeys(order), folder / "bench.md", title="Benchmark", command=command)
    failed = sum(not check.passed for each in done.values() for check in each.checks)
    print(f"\n{'all limits are met' if not failed else f'limits missed: {failed}'}: {folder / 'bench.md'}")
    return int(failed > 0)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a part of it, written to out/bench")
    parser.add_argument("--case", help="measure one case, given as JSON, and print what was found as JSON")
    arguments = parser.parse_args()
    if arguments.case:
        warnings.simplefilter("ignore", T2DWarning)  # some cases alias or fold: they are here for their timing only
        print(json.dumps(measure(Case(**json.loads(arguments.case)))))
    else:
        sys.exit(main(quick=arguments.quick))
