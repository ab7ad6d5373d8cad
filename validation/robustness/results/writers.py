"""Two to four writers of one output at the same time."""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from validation.report import Check, Section
from validation.robustness.results.processes import found, picture, save, sentence, start_writer

ROUNDS = 50
OLD = 9
APART_S = 0.1
"""Starts lie within it."""


def run() -> Section:
    draw = np.random.default_rng(4)
    faults: Counter[str] = Counter()
    losers = 0
    for number in range(ROUNDS):
        overwrite = number % 2 == 1
        delays = draw.uniform(0, APART_S, 2 + number % 3).tolist()
        wrong, lost = _round(delays, overwrite)
        faults += wrong
        losers += lost
    names = ("one whole result with its picture", "a sentence for each loser, and no other", "no leftover")
    rounds = f"{ROUNDS} rounds of 2 to 4 writers"
    return Section(
        title="Writers",
        checks=[
            *(Check(what=f"{rounds}, {name}: failures", measured=faults[name], limit=0, unit="") for name in names),
            Check(what=f"{rounds}: writers that lost", measured=losers, limit=ROUNDS / 2, unit="", at_least=True),
        ],
        note=f"Writers: {ROUNDS} rounds of two, three and four that start within {APART_S} s, every second round with "
        "--overwrite over an existing result.",
    )  # fmt: skip


def _round(delays_s: list[float], overwrite: bool) -> tuple[Counter[str], int]:
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "r.zarr"
        if overwrite:
            save(path, OLD, overwrite=False)
        writers = {
            value: start_writer(path, value, overwrite=overwrite, first=time.sleep, arguments=(delay,))
            for value, delay in enumerate(delays_s, 1)
        }
        for writer in writers.values():
            writer.join()
        won = [value for value, writer in writers.items() if writer.exitcode == 0]
        lost = {value: sentence(path, value) for value in writers if value not in won}
        whole = found(path)
        told = all("exists already; choose another name" in text and text.count("\n") == 1 for text in lost.values())
        left = {entry.name for entry in path.parent.iterdir() if entry.suffix != ".err"} - {"r.zarr", "r.png"}
        faults = {
            "one whole result with its picture": int(whole not in won or whole != picture(path)),
            "a sentence for each loser, and no other": int(not told or (len(won) != len(writers) if overwrite else len(won) != 1)),
            "no leftover": int(bool(left)),
        }  # fmt: skip
        return Counter(faults), len(lost)
