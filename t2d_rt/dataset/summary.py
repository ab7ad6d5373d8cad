"""What a data set's folder holds: balance of classes, lengths, SNR, Doppler extents, verdicts of the filter, time left of a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.dataset.envelope import envelope
from t2d_rt.dataset.lock import in_use
from t2d_rt.dataset.shards import SHARDS
from t2d_rt.dataset.splits import KINDS, grouped, source_clips
from t2d_rt.dataset.stored import Dataset, axis

MEASURED = 64
"""Samples of a class whose Doppler extent is measured: the first ones; they tell what all of them are like."""
SHARDS_TIMED = 6
"""Shards, the latest, whose times tell how fast a run is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClassSummary:
    """What there is of one class; arrays hold a value for each sample."""

    name: str
    samples: int
    descriptions: int
    passed: int
    """Motions that the filter takes for one of the class."""
    reason: str | None
    """The one for which most of the others do not pass."""
    made_s: np.ndarray
    """Lengths of the motions before they were cut or held [s]."""
    snr_db: np.ndarray
    """Of those whose noise is known."""
    lower_mps: np.ndarray
    """Least speed in each of the first `MEASURED` spectrograms [m/s]; none where there are no spectrograms."""
    upper_mps: np.ndarray
    """Greatest ones."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """What a folder holds."""

    name: str
    samples: int
    wanted: int
    """Samples of the whole recipe."""
    failures: tuple[str, ...]
    """Reasons of the samples that failed."""
    classes: tuple[ClassSummary, ...]
    conditions: dict[str, int]
    errors_db: np.ndarray
    """Field errors, where they were measured [dB]."""
    clips: int
    """Source clips that motions were made of."""
    groups: tuple[int, ...]
    """Samples of each group that has a description, clip or seed in common, the largest first."""
    seconds_left: float | None
    """Of the run that goes on, to the end of its recipe; None where none does, or it has only begun."""

    def __str__(self) -> str:
        lines = [f"{self.name}: {self.samples} of {self.wanted} samples, {len(self.failures)} failed"]
        lines += [f"  failed {count} times: {why}" for why, count in Counter(self.failures).most_common(3)]
        if self.seconds_left is not None:
            lines.append(f"a run goes on; at its rate the whole recipe is done in {_time(self.seconds_left)}")
        head = (
            "class",
            "samples",
            "descriptions",
            "pass",
            "made [s]",
            "SNR [dB]",
            "receding [m/s]",
            "approaching [m/s]",
        )
        lines += _table([head, *(_row(each) for each in self.classes)])
        lines.append("three figures: of 5 %, 50 % and 95 % of the samples")
        lines += [
            f"{each.name}: most that do not pass: {each.reason}" for each in self.classes if each.reason is not None
        ]
        if len(self.conditions) > 1:
            lines.append("conditions: " + ", ".join(f"{name} {count}" for name, count in self.conditions.items()))
        if len(self.errors_db):
            lines.append(f"field error of {len(self.errors_db)} samples: {_spread(self.errors_db)} dB")
        lines.append(
            f"{self.clips} source clips; by description, clip and seed the samples make {len(self.groups)} groups, the largest of "
            f"{self.groups[0]}"
        )
        return "\n".join(lines)


def summarise(dataset: Dataset | str | Path) -> Summary:
    """The summary of a data set, finished or not."""
    source = dataset if isinstance(dataset, Dataset) else Dataset(dataset)
    records = source.records
    return Summary(
        name=source.recipe.name, samples=len(source), wanted=source.recipe.samples,
        failures=tuple(str(each["failure"]) for each in source.failed),
        classes=tuple(_class(source, number) for number in range(len(source.classes))),
        conditions=dict(Counter(str(each["condition"]) for each in records)),
        errors_db=_known(records, "error_db"),
        clips=len(frozenset[str]().union(*(source_clips(each) for each in records))),
        groups=tuple(sorted(map(len, grouped(records, KINDS)), reverse=True)),
        seconds_left=_seconds_left(source),
    )  # fmt: skip


def _class(dataset: Dataset, number: int) -> ClassSummary:
    positions = np.flatnonzero(dataset.labels == number)
    records = [dataset.records[place] for place in positions]
    reasons = Counter(each["reasons"][0] for each in records if each["reasons"])
    extents = (
        np.array([extent(dataset, int(place)) for place in positions[:MEASURED]])
        if "spectrogram" in dataset.products
        else np.zeros((0, 2))
    ).reshape(-1, 2)
    return ClassSummary(
        name=dataset.classes[number], samples=len(records), descriptions=len({each["sentence"] for each in records}),
        passed=sum(bool(each["passed"]) for each in records),
        reason=reasons.most_common(1)[0][0] if reasons else None,
        made_s=_known(records, "made_s"), snr_db=_known(records, "snr_db"),
        lower_mps=extents[:, 0], upper_mps=extents[:, 1],
    )  # fmt: skip


def extent(dataset: Dataset, position: int) -> tuple[float, float]:
    """Least and greatest speed in a sample's spectrogram [m/s]."""
    levels = dataset.values(position, "spectrogram")
    edges = dataset.records[position]["products"]["spectrogram"]["velocity_mps"]
    return envelope(levels, axis(edges, len(levels))).extent_mps


def _known(records: Sequence[dict[str, Any]], name: str) -> np.ndarray:
    return np.array([each[name] for each in records if each[name] is not None], dtype=np.float64)


def _seconds_left(dataset: Dataset) -> float | None:
    """From the times at which the latest shards took their places."""
    done = sorted((path.stat().st_mtime, path) for path in (dataset.path / SHARDS).glob("*.jsonl"))[-SHARDS_TIMED:]
    if len(done) < 2 or not in_use(dataset.path):
        return None
    # The time between two shards is that of the later one's samples; the median, for a run may have been stopped between.
    each_s = [(last - first) / max(1, path.read_bytes().count(b"\n")) for (first, _), (last, path) in pairwise(done)]
    missing = dataset.recipe.samples - len(dataset) - len(dataset.failed)
    return float(np.median(each_s)) * missing


def _row(found: ClassSummary) -> tuple[str, ...]:
    passed = f"{found.passed / found.samples:.0%}" if found.samples else "-"
    figures = (_spread(each) for each in (found.made_s, found.snr_db, found.lower_mps, found.upper_mps))
    return found.name, f"{found.samples}", f"{found.descriptions}", passed, *figures


def _spread(values: np.ndarray) -> str:
    if not len(values):
        return "-"
    return " ".join(f"{each:.1f}" for each in np.percentile(values, (5, 50, 95)))


def _table(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            [row[0].ljust(widths[0]), *(each.rjust(width) for each, width in zip(row[1:], widths[1:], strict=True))]
        )
        for row in rows
    ]


def _time(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
