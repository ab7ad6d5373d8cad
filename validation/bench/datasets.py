"""How many samples of a data set are made a second, where the time goes, and what two workers gain over one."""

from __future__ import annotations

import functools
import json
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from t2d_rt.core.disk_cache import VARIABLE
from t2d_rt.dataset import Recipe, make_dataset
from validation.report import Section, at_least, new_figure, save_chart

PAPER_SAMPLES = 19_165
"""Samples that the Text2Doppler paper kept."""
CORES = 64
WORKERS = 2
LEAST_EFFICIENCY = 0.85
STAGES = "motion", "simulation", "products"


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """Samples of 5 s of one kind."""

    name: str
    condition: dict[str, Any]
    radar: str
    samples: int
    before: int
    """Samples of another seed that are made before, for the bodies' facets that all samples of a set share."""
    least: float
    """Samples a second on two cores."""


KINDS = (
    Kind(name="ellipsoids", condition={"method": "ellipsoid"}, radar="table2", samples=48, before=8, least=3.0),
    Kind(name="mesh", condition={}, radar="table2", samples=16, before=32, least=0.7),
    Kind(
        name="mesh in living_room",
        condition={"scene": "living_room"},
        radar="table2-uniform",
        samples=16,
        before=32,
        least=0.2,
    ),
)


@dataclass(frozen=True, slots=True)
class Bar:
    """What the chart shows of one kind."""

    name: str
    seconds: dict[str, float]
    """Of one core, by stage."""
    rate: float
    """Samples a second on two cores."""
    paper_s: dict[int, float]
    """Time for a set of the paper's size, by the number of cores."""


def throughput_chart(bars: Sequence[Bar], folder: Path) -> str:
    """Seconds of one core for a sample by stage, and the time that a set of the paper's size takes."""
    figure, axes = new_figure(figsize=(11, 1.4 + 0.8 * len(bars)), ncols=2, width_ratios=(3, 2), sharey=True)
    rows = range(len(bars))
    for number, stage in enumerate(STAGES):
        share = [100 * each.seconds[stage] / sum(each.seconds.values()) for each in bars]
        before = [
            100 * sum(each.seconds[name] for name in STAGES[:number]) / sum(each.seconds.values()) for each in bars
        ]
        axes[0].barh(rows, share, left=before, color=f"C{number}", label=stage)
        for row, each in zip(rows, bars, strict=True):
            if share[row] > 8:
                axes[0].text(
                    before[row] + share[row] / 2, row, f"{each.seconds[stage]:.2g} s", ha="center", va="center"
                )
    labels = [f"{each.name}\n{each.rate:.2g} samples/s on {WORKERS} cores" for each in bars]
    axes[0].set_yticks(rows, labels)
    axes[0].set(xlabel="Share of the time of a sample of 5 s (%)", xlim=(0, 100))
    axes[0].legend(ncols=len(STAGES), loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    height = 0.35
    for place, (count, colour) in enumerate(((WORKERS, "C7"), (CORES, "C4"))):
        hours = [each.paper_s[count] / 3600 for each in bars]
        where = [row + (place - 0.5) * height for row in rows]
        axes[1].barh(where, hours, height=height, color=colour, label=f"{count} cores")
        for y, hour in zip(where, hours, strict=True):
            told = f"{hour:.1f} h" if hour >= 1 else f"{60 * hour:.0f} min"
            axes[1].text(1.1 * hour, y, told, va="center")
    axes[1].set(xscale="log", xlabel=f"Time for {PAPER_SAMPLES} samples (h)")
    axes[1].margins(x=0.2)
    axes[1].legend(ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    axes[0].invert_yaxis()
    return save_chart(figure, "datasets.png", folder)


def recipe_of(kind: Kind, seed: int = 0) -> Recipe:
    """Eight classes under one condition."""
    return Recipe(
        name="bench", descriptions_per_class=20, samples_per_description=1, radar=kind.radar, gait_factors=(0.85, 1.2),
        gait_spread=0.025, conditions=[{"name": "only", **kind.condition}], samples_per_shard=16, seed=seed,
        products={"spectrogram": {"range_gate_m": "scene"}},
    )  # fmt: skip


def measured(kind: Kind, workers: int) -> dict[str, float]:
    """Rate of a run whose workers have begun, whose kernels are compiled and whose bodies have been met, as those of all but the
    first samples of a large set; and seconds of each stage of a sample."""
    with tempfile.TemporaryDirectory() as folder, _own_facets():
        # Of another seed: workers remember the motions that they have made.
        make_dataset(recipe_of(kind, seed=1), Path(folder) / "warm", workers=workers, threads=1, limit=kind.before)
        outcome = make_dataset(recipe_of(kind), Path(folder) / "timed", workers=workers, threads=1, limit=kind.samples)
        log = "".join(path.read_text() for path in (Path(folder) / "timed/log").glob("*.jsonl"))
    rows = [json.loads(line)["seconds"] for line in log.splitlines()]
    mean = {stage: sum(row[stage] for row in rows) / len(rows) for stage in (*STAGES, "cpu")}
    return {"rate": outcome.made / outcome.seconds, **mean}


@contextmanager
def _own_facets() -> Iterator[None]:
    """Facets are kept in a folder of the bench alone, which is empty: those of an earlier run would be read in place of made."""
    before, folder = os.environ.get(VARIABLE), Path(_facets_folder().name)
    for kept in folder.iterdir():
        kept.unlink()
    os.environ[VARIABLE] = str(folder)
    try:
        yield
    finally:
        os.environ.pop(VARIABLE)
        if before is not None:
            os.environ[VARIABLE] = before


@functools.cache
def _facets_folder() -> tempfile.TemporaryDirectory[str]:
    """One folder for all runs, since workers go on from run to run and know that one."""
    return tempfile.TemporaryDirectory()


def datasets(folder: Path, kinds: Sequence[Kind] = KINDS) -> Section:
    """Throughput, where the time goes, and what that means for a set of the paper's size; its chart goes to a folder."""
    table, checks, bars = [], [], []
    for kind in kinds:
        one, two = measured(kind, 1), measured(kind, WORKERS)
        efficiency = two["rate"] / (WORKERS * one["rate"])
        total = sum(two[stage] for stage in STAGES)
        print(f"     {kind.name}: {two['rate']:.2f} samples/s, {two['cpu']:.2f} s of one core each", flush=True)
        paper_s = {
            WORKERS: PAPER_SAMPLES / two["rate"], CORES: PAPER_SAMPLES / (one["rate"] * CORES * min(efficiency, 1.0)),
        }  # fmt: skip
        bars.append(Bar(kind.name, {stage: two[stage] for stage in STAGES}, two["rate"], paper_s))
        table.append({
            "samples of 5 s": kind.name, "samples/s, 2 cores": f"{two['rate']:.2f}",
            "s of one core each": f"{two['cpu']:.2f}",
            **{stage: f"{two[stage] / total:.0%}" for stage in STAGES},
            "2 workers over 1": f"{efficiency:.0%}",
            f"{PAPER_SAMPLES} on 2 cores": f"{paper_s[WORKERS] / 3600:.1f} h",
            f"on {CORES}": f"{paper_s[CORES] / 60:.0f} min",
        })  # fmt: skip
        checks += [
            at_least(f"{kind.name}, samples made", two["rate"], kind.least, "/s"),
            at_least(f"{kind.name}, 2 workers over 1", efficiency, LEAST_EFFICIENCY),
        ]
    note = (
        "Samples of 5 s, from the sentence to the shard: motion, filter, simulation with the receiver's noise, spectrogram. Each "
        "worker has one thread; workers have begun, kernels are compiled, and bodies of like size have been met before, as in all "
        "but the first samples of a large set. The time on 64 cores is that by the efficiency of two."
    )
    return Section(title="Data sets", note=note, checks=checks, table=table, charts=[throughput_chart(bars, folder)])
