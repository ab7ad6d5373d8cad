"""`python -m validation.robustness.fuzz --only bvh:137` replays an input; `--count 60` tries that many of all kinds."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

from validation.robustness.fuzz.process import KINDS, MEGABYTES, SECONDS, Outcome, Settings, outcomes

FRACTIONS = {
    "bvh": 0.12, "radar_yaml": 0.06, "scene_xml": 0.09, "recording_zarr": 0.09, "command_line": 0.09, "api_calls": 0.075,
    "api_values": 0.075, "shards": 0.12, "result_files": 0.12, "endpoint": 0.04, "momask": 0.02, "trained": 0.03,
    "dead_parents": 0.01,
}  # fmt: skip
"""Parts of the inputs that are of each kind."""
KEPT = Path("out") / "fuzz"
REGRESSIONS = Path(__file__).with_name("regressions.txt")


def numbered(count: int, start: int = 0) -> list[str]:
    """Names of that many inputs, the kinds mixed."""
    each = {kind: max(1, round(count * fraction)) for kind, fraction in FRACTIONS.items()}
    ordered = sorted((number / each[kind], kind, number) for kind in KINDS for number in range(each[kind]))
    return [f"{kind}:{start + number}" for _, kind, number in ordered]


def regressions() -> list[str]:
    """Inputs that failed once."""
    lines = REGRESSIONS.read_text(encoding="utf-8").splitlines() if REGRESSIONS.exists() else []
    return [line.split()[0] for line in lines if line.strip() and not line.startswith("#")]


def defects(found: list[Outcome]) -> dict[tuple[str, str, str], list[Outcome]]:
    """Failed inputs by what is wrong."""
    groups: dict[tuple[str, str, str], list[Outcome]] = {}
    for outcome in found:
        if outcome.problem:
            groups.setdefault(outcome.defect, []).append(outcome)
    return dict(sorted(groups.items(), key=lambda item: -len(item[1])))


def main() -> int:
    """Exit code: 0 if every input ended well."""
    parser = argparse.ArgumentParser(prog="python -m validation.robustness.fuzz", description=__doc__)
    parser.add_argument("--only", nargs="+", help="names of inputs, or kinds", default=[])
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--start", type=int, default=0, help="number of the first input of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--megabytes", type=float, default=MEGABYTES)
    parser.add_argument("--keep", type=Path, default=KEPT, help="folder for the files of failed inputs")
    parser.add_argument("--no-regressions", action="store_true")
    parser.add_argument("--results", type=Path, help="a JSON file for all outcomes")
    options = parser.parse_args()
    names = [*([] if options.no_regressions else regressions()), *numbered(options.count, options.start)]
    if options.only:
        kinds = [word for word in options.only if word in KINDS]
        names = [word for word in options.only if ":" in word] + [n for n in names if n.partition(":")[0] in kinds]
    found = []
    settings = Settings(
        seed=options.seed, jobs=options.jobs, seconds=options.seconds, megabytes=options.megabytes, keep=options.keep
    )
    for outcome in outcomes(list(dict.fromkeys(names)), settings):
        found.append(outcome)
        if outcome.problem or len(names) <= 20:
            print(
                f"{outcome.name} {outcome.problem or ('refused' if outcome.what else 'done')} {outcome.seconds:.1f} s "
                f"{outcome.megabytes:.0f} MB {outcome.where}\n    {outcome.told[:200]}\n    {outcome.what[:300]}",
                flush=True,
            )
    if options.results:
        options.results.write_text(json.dumps([asdict(outcome) for outcome in found]), encoding="utf-8")
    failed = [outcome for outcome in found if outcome.problem]
    print(
        f"{len(found)} inputs, {len(failed)} failed, {len(defects(found))} defects; failed ones are kept in {options.keep}"
    )
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
