"""Inputs that nobody means to give: each ends well or with one sentence, soon, in little memory, and never wrong in silence."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from validation.report import Section, at_most

PROBLEMS = {
    "tracebacks": ("traceback", "generator"),
    "crashes": ("crash",),
    "hangs, or longer than 10 s": ("hang",),
    "more than 2 GB": ("memory",),
    "wrong in silence, or an error that is no plain sentence": ("wrong",),
}
"""What may go wrong, by the names that outcomes have for it."""
COUNT = 2000


def run() -> Section:
    """In a fresh process: inputs are forked from it, which needs one that has computed nothing yet."""
    count = int(os.environ.get("FUZZ_COUNT", COUNT))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "outcomes.json"
        subprocess.run(
            [sys.executable, "-m", "validation.robustness.fuzz", "--count", str(count), "--results", str(file)],
            check=False,
        )
        outcomes = json.loads(file.read_text(encoding="utf-8"))
    return section(outcomes)


def section(outcomes: Sequence[Mapping[str, Any]]) -> Section:
    """The figures of all outcomes."""
    ends = [outcome["problem"] for outcome in outcomes]
    checks = [
        at_most(f"inputs of {len(ends)}: {what}", sum(end in names for end in ends), 0)
        for what, names in PROBLEMS.items()
    ]
    kinds = list(dict.fromkeys(outcome["name"].partition(":")[0] for outcome in outcomes))
    return Section(
        title="Fuzzing",
        checks=checks,
        note="Motion files, radar and config files, scenes with their meshes, saved recordings, words on the command line, calls "
        "of the public functions, data sets, results and trained models of others, answers of endpoints and "
        "programs in the place of MoMask, each valid but for a few changes drawn at random; and main processes that are killed. "
        "`python -m validation.robustness.fuzz --only bvh:137` makes an input again. Each runs in a process of its own and has to "
        "end well (finite numbers, what was saved is what loads, nothing outside a folder is opened or written, no process is "
        "left) or with one sentence, within 10 s of the processor and 2 GB. Inputs that failed once are tried first. `refused` "
        "counts sentences, `worst` is the longest time of the processor and the most memory of one input.",
        table=[_row(kind, [o for o in outcomes if o["name"].startswith(f"{kind}:")]) for kind in sorted(kinds)],
    )


def _row(kind: str, outcomes: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    failed = [outcome for outcome in outcomes if outcome["problem"]]
    refused = [outcome for outcome in outcomes if outcome["what"] and not outcome["problem"]]
    return {
        "kind": kind.replace("_", " "),
        "inputs": len(outcomes),
        "done": len(outcomes) - len(refused) - len(failed),
        "refused": len(refused),
        "failed": len(failed),
        "worst [s]": max(outcome["seconds"] for outcome in outcomes),
        "worst [MB]": max(outcome["megabytes"] for outcome in outcomes),
        "failed inputs": ", ".join(outcome["name"] for outcome in failed[:8]) or "none",
    }
