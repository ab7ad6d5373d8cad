"""The report of the benchmark: what becomes of each claim of the paper about Table III at this size, and tables."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.dataset.splits import SPLITS
from t2d_rt.learn.baselines import BASELINES
from t2d_rt.learn.figures import draw_confusion
from t2d_rt.learn.models import build, card, count
from t2d_rt.plots.new_figure import NotebookFigure
from validation.studies.benchmark import NETWORKS, SETS, Scale
from validation.studies.common import table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


ALIKE = 5.0
"""Points within which models count as alike; those of the paper differ by 1.4 on Simple."""
LOSS = 5.0
"""Points that every model is to lose on Hard."""
CONVOLUTIONAL = "vgg-7", "resnet18"
PAIRS = (("walking", "abnormal_walking"), ("falling", "dancing"))
"""Classes that the paper says are taken for one another."""
FIRST, LAST = 3, 6
"""A pair counts as separating where it is among the first so many of all pairs, and as not where it comes after the latter."""

PAPERS_ACCURACY, WITHIN = 98.3, 3.0
"""The paper's least accuracy [%] on Simple by file, and the points below it within which the best network must come: networks that
do not learn the easy set as the paper's did say nothing of its claims."""
LEAST_SEEDS = 3
"""For an interval: two values that agree by chance would make one of no width."""

UNTESTED = "cannot be tested at this size"

Result = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim and what was found."""

    claim: str
    verdict: str
    """"held", "refuted", "undecided", or what `UNTESTED` says."""
    figures: str


def interval(values: Sequence[float]) -> tuple[float, float]:
    """Mean, and half of the 95 % interval of the mean by Student's t; infinite for fewer values than LEAST_SEEDS."""
    from scipy.stats import t

    count = len(values)
    if count < LEAST_SEEDS:
        return float(np.mean(values)), float("inf")
    spread = float(np.std(values, ddof=1)) / count**0.5
    return float(np.mean(values)), float(t.ppf(0.975, count - 1)) * spread


def accuracies(results: Sequence[Result], set_: str, by: str, model: str) -> dict[int, float]:
    """Accuracy [%] by seed."""
    return {
        each["seed"]: 100.0 * each["accuracy"]
        for each in results
        if (each["set"], each["by"], each["model"]) == (set_, by, model) and "accuracy" in each
    }


def claims(results: Sequence[Result]) -> list[Claim]:
    """Verdicts on all of them; none on the paper's where no network comes near to its accuracy on the easy set."""
    of_paper = [_alike(results), _lead(results), _loss(results, "file"), _loss(results, "description"), _pairs(results)]
    if not _learned(results):
        of_paper = [replace(each, verdict=UNTESTED) for each in of_paper]
    return [*of_paper, _leak(results, "simple"), _leak(results, "hard")]


def _learned(results: Sequence[Result]) -> bool:
    """Whether the best network reaches the paper's accuracy on Simple by file, within `WITHIN` points."""
    found = [list(accuracies(results, "simple", "file", model).values()) for model in NETWORKS]
    return max((float(np.mean(each)) for each in found if each), default=0.0) >= PAPERS_ACCURACY - WITHIN


def verdict(low: float, high: float, limit: float) -> str:
    """Held where all of the interval is above the limit, refuted where all of it is below."""
    return "held" if low > limit else "refuted" if high < limit else "undecided"


def _over_seeds(results: Sequence[Result], of_seed: Callable[[int], float | None]) -> tuple[float, float, int]:
    """Mean, half interval and number of seeds of what `of_seed` gives."""
    seeds = sorted({each["seed"] for each in results})
    values = [value for value in map(of_seed, seeds) if value is not None]
    if not values:
        return float("nan"), float("inf"), 0
    return *interval(values), len(values)


def _of(results: Sequence[Result], set_: str, by: str, seed: int) -> dict[str, float] | None:
    """Accuracy [%] of each network that was run with a seed; None where one is lacking."""
    run = {each["model"] for each in results if each["model"] in NETWORKS}
    found = {model: accuracies(results, set_, by, model).get(seed) for model in NETWORKS if model in run}
    known = {model: value for model, value in found.items() if value is not None}
    return known if known and len(known) == len(found) else None


def _alike(results: Sequence[Result]) -> Claim:
    def spread(seed: int) -> float | None:
        found = _of(results, "simple", "file", seed)
        return None if found is None else max(found.values()) - min(found.values())

    mean, half, count = _over_seeds(results, spread)
    found = verdict(-(mean + half), -(mean - half), -ALIKE)
    return Claim(
        "All models are alike on Simple (98.3 to 99.7 %).", found,
        f"best minus worst network, by file: {_points(mean, half, count)}; alike means within {ALIKE:g} points",
    )  # fmt: skip


def _lead(results: Sequence[Result]) -> Claim:
    def lead(seed: int) -> float | None:
        found = _of(results, "hard", "description", seed)
        if found is None or not set(CONVOLUTIONAL) <= found.keys():
            return None
        others = [value for name, value in found.items() if name not in (*CONVOLUTIONAL, "streaming")]
        return float(np.mean([found[name] for name in CONVOLUTIONAL])) - max(others) if others else None

    mean, half, count = _over_seeds(results, lead)
    return Claim(
        "On Hard convolutional networks lead.", verdict(mean - half, mean + half, 0.0),
        f"mean of VGG-7 and ResNet-18 minus the best of the others, by description: {_points(mean, half, count)}",
    )  # fmt: skip


def _loss(results: Sequence[Result], by: str) -> Claim:
    rows, verdicts = [], []
    for model in dict.fromkeys(each["model"] for each in results if each["model"] in NETWORKS):
        simple, hard = (accuracies(results, *each, model) for each in (("simple", "file"), ("hard", by)))
        both = sorted(simple.keys() & hard.keys())
        if not both:
            continue
        mean, half = interval([simple[seed] - hard[seed] for seed in both])
        verdicts.append(verdict(mean - half, mean + half, LOSS))
        rows.append(f"{model} {_points(mean, half, len(both))}")
    found = "refuted" if "refuted" in verdicts else "held" if verdicts and set(verdicts) == {"held"} else "undecided"
    return Claim(
        f"Every network loses {LOSS:g} points or more from Simple by file to Hard by {by}.", found, "; ".join(rows)
    )


def _leak(results: Sequence[Result], set_: str) -> Claim:
    """Of the networks that were run with every seed by both splits."""
    seeds = {each["seed"] for each in results}
    found = {
        model: [accuracies(results, set_, by, model) for by in ("file", "description")]
        for model in dict.fromkeys(each["model"] for each in results if each["model"] in NETWORKS)
    }
    whole = {model: pair for model, pair in found.items() if all(each.keys() == seeds for each in pair)}

    def margin(seed: int) -> float | None:
        return float(np.mean([pair[0][seed] - pair[1][seed] for pair in whole.values()])) if whole else None

    mean, half, count = _over_seeds(results, margin)
    return Claim(
        f"(Not of the paper) A split by file flatters: it beats a split by description on {set_.capitalize()}.",
        verdict(mean - half, mean + half, 0.0),
        f"mean over {', '.join(whole) or 'no network'}: {_points(mean, half, count)}",
    )


def _pairs(results: Sequence[Result]) -> Claim:
    rows = [
        each for each in results if (each["set"], each["by"]) == ("hard", "description") and each["model"] in NETWORKS
    ]
    rows = [each for each in rows if "confusion" in each]
    title = "What separates the models on Hard is walking against abnormal walking, and falling against dancing."
    if not rows or not {name for pair in PAIRS for name in pair} <= set(rows[0]["classes"]):
        return Claim(title, "undecided", "the data set lacks these classes")
    classes = rows[0]["classes"]
    ranked = confused_pairs(np.sum([each["confusion"] for each in rows], axis=0), classes)
    names = [frozenset(pair) for pair, _ in ranked]
    ranks = [names.index(frozenset(pair)) + 1 for pair in PAIRS]
    found = "held" if max(ranks) <= FIRST else "refuted" if max(ranks) > LAST else "undecided"
    if len({each["seed"] for each in rows}) < LEAST_SEEDS:
        found = "undecided"
    told = ", ".join(f"{a} and {b} {100 * part:.0f} %" for (a, b), part in ranked[:FIRST])
    return Claim(
        title, found,
        f"of {len(ranked)} pairs these are number {ranks[0]} and {ranks[1]}; most often confused, of the samples of both: {told}",
    )  # fmt: skip


def confused_pairs(confusion: np.ndarray, classes: Sequence[str]) -> list[tuple[tuple[str, str], float]]:
    """Pairs of classes by the fraction of their samples that are taken for the other."""
    count = confusion.sum(axis=1)
    found = [
        ((classes[a], classes[b]), float((confusion[a, b] + confusion[b, a]) / max(count[a] + count[b], 1)))
        for a in range(len(classes))
        for b in range(a)
    ]
    return sorted(found, key=lambda each: -each[1])


def _points(mean: float, half: float, count: int) -> str:
    if count == 0:
        return "not run"
    return (
        f"{mean:.1f} points ({count} of {LEAST_SEEDS} seeds)"
        if count < LEAST_SEEDS
        else f"{mean:.1f} +- {half:.1f} points ({count} seeds)"
    )


def write_report(scale: Scale, results: Sequence[Result], total: int, folder: Path) -> Path:
    """Writes report.md, accuracy.png and confusion.png; the path of the first."""
    models = [each for each in scale.models if any(row["model"] == each for row in results)]
    accuracy_figure(results, models).savefig(folder / "accuracy.png")
    figure = _confusion_figure(results)
    if figure is not None:
        figure.savefig(folder / "confusion.png")
    parts = [
        f"# Table III at the scale {scale.name}", _head(scale, results, total), "## Claims, one by one", _claims_table(results),
        "## Accuracy", _accuracy(results, models), "![Accuracy by set and split](accuracy.png)", "## As printed and as found",
        _printed(results, models), "## Size and speed", _sizes(models), _speeds(results, models),
    ]  # fmt: skip
    if figure is not None:
        parts += ["## Confusion on Hard by description, all networks", "![Confusion](confusion.png)"]
    parts += ["## What was refused", _refused(results)]
    path = folder / "report.md"
    path.write_text("\n\n".join(part for part in parts if part) + "\n", "utf-8")
    return path


def _head(scale: Scale, results: Sequence[Result], total: int) -> str:
    import torch

    seconds = sum(each.get("seconds", 0.0) for each in results)
    sizes = {
        each["set"]: sum(each["samples"].values()) for each in results if "samples" in each and each["by"] == "file"
    }
    seeds = ", ".join(str(each) for each in sorted({row["seed"] for row in results}))
    samples = ", ".join(f"{name} {number}" for name, number in sizes.items())
    lengths = [each["epochs"] for each in results if "epochs" in each]
    capped = sum(each == scale.epochs for each in lengths)
    return (
        f"{len(results)} of {total} cells are done, {seconds / 60:.1f} minutes of one processor. Maps of {scale.size} x "
        f"{scale.size} cells, at most {scale.epochs} epochs, batches of {scale.batch}, Adam 1e-3; seeds {seeds}, each with its own "
        f"split, weights and order. Samples: {samples}; half of them to train on, a quarter to choose the epoch by, a quarter to "
        f"test on. Intervals are 95 % of the mean over seeds by Student's t. {platform.machine()}, {os.cpu_count()} cores, Python "
        f"{platform.python_version()}, torch {torch.__version__}.\n\n"
        f"**What this size can tell.** {capped} of {len(lengths)} trainings reached the limit of epochs, without an early stop: "
        "networks may be undertrained. The paper trained on thousands of samples: its claims have a verdict where the best "
        f"network comes within {WITHIN:g} points of its {PAPERS_ACCURACY:g} % on Simple by file, and cannot be tested otherwise. "
        "With fewer than three seeds there is no interval, and nothing is decided."
    )


def _claims_table(results: Sequence[Result]) -> str:
    return table(
        ("claim", "verdict", "figures"), [(each.claim, each.verdict, each.figures) for each in claims(results)]
    )


def _accuracy(results: Sequence[Result], models: Sequence[str]) -> str:
    columns = [(name, by) for name in SETS for by in SPLITS]
    head = ("model", *(f"{name}, by {by}" for name, by in columns))
    rows = [(model, *(percent([*accuracies(results, *each, model).values()]) for each in columns)) for model in models]
    return "Test accuracy [%]; by file as the authors split, by description and by clip without leaks.\n\n" + table(
        head, rows
    )


def percent(values: Sequence[float]) -> str:
    """Mean and half interval [%]."""
    if not values:
        return "-"
    mean, half = interval(values)
    return f"{mean:.1f}" if not np.isfinite(half) else f"{mean:.1f} +- {half:.1f}"


def _printed(results: Sequence[Result], models: Sequence[str]) -> str:
    rows = []
    for model in models:
        about = None if model in BASELINES else card(model).printed
        found = [percent([*accuracies(results, *each, model).values()]) for each in (
            ("simple", "file"), ("hard", "file"), ("hard", "description"))]  # fmt: skip
        rows.append((model, *(("-", "-") if about is None else (f"{about.simple:.2f}", f"{about.hard:.2f}")), *found))
    return table(
        ("model", "Simple, printed", "Hard, printed", "Simple by file", "Hard by file", "Hard by description"), rows
    )


def _sizes(models: Sequence[str]) -> str:
    """Parameters and operations beside the printed ones."""
    rows, notes = [], []
    for model in (each for each in models if each in NETWORKS):
        about = card(model)
        channels, *size = about.counted_at
        found = count(build(model, 8, (size[0], size[1]), channels), about.counted_at)
        printed = about.printed
        told = ("-", "-") if printed is None else (f"{printed.mparams:.3f}", f"{printed.gflops:.3f}")
        counted_at = " x ".join(map(str, about.counted_at))
        rows.append(
            (
                about.title,
                f"{found.parameters / 1e6:.3f}",
                told[0],
                f"{found.gflops:.4f}",
                told[1],
                counted_at,
                about.source,
            )
        )
        if about.note:
            notes.append(f"{about.title}: {about.note}")
    head = ("model", "parameters [M]", "printed", "operations [G]", "printed", "counted at", "source")
    return table(head, rows) + "\n\nOperations are multiplications with their additions. " + " ".join(notes)


def _speeds(results: Sequence[Result], models: Sequence[str]) -> str:
    rows = []
    for model in (each for each in models if each in NETWORKS):
        of_model = [each for each in results if each["model"] == model and "latency_ms" in each]
        if of_model:
            medians = [
                np.median([each[key] for each in of_model])
                for key in ("seconds_per_epoch", "latency_ms", "maps_per_s", "epochs")
            ]
            rows.append((model, f"{medians[0]:.2f}", f"{medians[1]:.2f}", f"{medians[2]:.0f}", f"{medians[3]:.0f}"))
    head = ("model", "seconds per epoch", "latency of one map [ms]", "maps a second", "epochs")
    return "Medians over the cells, on one thread; seconds per epoch are those of the processor.\n\n" + table(
        head, rows
    )


def _refused(results: Sequence[Result]) -> str:
    found = {(each["set"], each["by"]): each["refused"] for each in results if "refused" in each}
    return "\n".join(f"- {name} by {by}: {told}." for (name, by), told in found.items()) or "Nothing."


def accuracy_figure(results: Sequence[Result], models: Sequence[str]) -> Figure:
    """Mean accuracy of each model on each set by each split, with intervals and the printed values."""
    figure = NotebookFigure(figsize=(11, 4.6), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    for ax, name in zip(axes, SETS, strict=True):
        for number, by in enumerate(SPLITS):
            found = [[*accuracies(results, name, by, model).values()] for model in models]
            places = np.arange(len(models)) + 0.27 * (number - 1)
            pairs = [interval(each) if each else (0.0, 0.0) for each in found]
            halves = [half if half > 0 and np.isfinite(half) else np.nan for _, half in pairs]
            ax.bar(
                places, [mean for mean, _ in pairs], 0.25, yerr=halves, capsize=2, color=f"C{number}", label=f"by {by}"
            )
        for place, model in enumerate(models):
            about = None if model in BASELINES else card(model).printed
            if about is not None:
                value = about.simple if name == "simple" else about.hard
                ax.plot(place, value, "k_", markersize=14, label="printed" if place == 0 else None)
        ax.set_xticks(range(len(models)), models, rotation=40, ha="right")
        ax.set(title=name.capitalize(), ylim=(0, 112))
        ax.grid(axis="y", alpha=0.3)
    axes[0].set_ylabel("test accuracy [%]")
    axes[1].legend(fontsize=8, loc="upper right", ncols=4)
    return figure


def _confusion_figure(results: Sequence[Result]) -> Figure | None:
    rows = [
        each for each in results if (each["set"], each["by"]) == ("hard", "description") and each["model"] in NETWORKS
    ]
    rows = [each for each in rows if "confusion" in each]
    if not rows:
        return None
    figure = NotebookFigure(figsize=(7.6, 6.8), layout="constrained")
    draw_confusion(figure.subplots(), np.sum([each["confusion"] for each in rows], axis=0), rows[0]["classes"])
    return figure
