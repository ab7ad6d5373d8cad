"""The report of the benchmark: what becomes of each claim of the paper about Table III at this size, and tables."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.dataset.splits import SPLITS
from t2d_rt.learn.baselines import BASELINES
from t2d_rt.learn.figures import draw_confusion
from t2d_rt.learn.models import build, card, count
from t2d_rt.learn.scores import DRAWS
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
"""The paper's least accuracy [%] on Simple by file, and the points below it within which the best network must come before it can
be said whether all are alike there: before that, the differences follow from how long each was trained."""
UNTESTED = "cannot be tested on these sets"
NOT_JUDGED = "not run, or no network that was trained enough"

Result = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim and what was found."""

    claim: str
    verdict: str
    """"held", "refuted", "undecided", or what `UNTESTED` says."""
    figures: str


class Accuracies:
    """Accuracies [%] of the cells, as they are and for samples that are drawn anew (bootstrap)."""

    def __init__(self, results: Sequence[Result]) -> None:
        self._results = [each for each in results if "told" in each]
        self._weights: dict[tuple[str, str], np.ndarray] = {}
        run = [each for each in NETWORKS if any(row["model"] == each for row in self._results)]
        least = max(self.of_seeds("simple", "file", "nearest-centroid"), default=np.inf)
        self.networks = [each for each in run if min(self.of_seeds("simple", "file", each), default=0.0) > least]
        """Networks that claims are judged by: with every seed better than the nearest centroid on Simple by file."""
        self.untrained = [each for each in run if each not in self.networks]
        """All others that were run: their training was too short to judge them, or nothing shows that it was not."""

    def cells(self, set_: str, by: str, model: str) -> list[Result]:
        """Those of a model, in the order of their seeds."""
        found = [each for each in self._results if (each["set"], each["by"], each["model"]) == (set_, by, model)]
        return sorted(found, key=lambda each: int(each["seed"]))

    def of_seeds(self, set_: str, by: str, model: str) -> list[float]:
        """Accuracy of each seed."""
        return [100.0 * each["accuracy"] for each in self.cells(set_, by, model)]

    def weights(self, cell: Result) -> np.ndarray:
        """How often each sample of a cell's test is drawn, (1 + DRAWS, N), first once each.

        All models and seeds of a set and a split have the same draws, so that differences keep what these have in common.
        """
        key = cell["set"], cell["by"]
        if key not in self._weights:
            count = 1 + max(max(each["groups"]) for each in self._results if (each["set"], each["by"]) == key)
            rng = np.random.default_rng([SETS.index(key[0]), SPLITS.index(key[1])])
            drawn = rng.multinomial(count, np.full(count, 1.0 / count), size=DRAWS)
            self._weights[key] = np.vstack([np.ones(count), drawn])
        return self._weights[key][:, cell["groups"]]

    def __call__(self, set_: str, by: str, model: str) -> np.ndarray | None:
        """The mean over seeds, (1 + DRAWS,); None where nothing was run."""
        found = []
        for cell in self.cells(set_, by, model):
            weights = self.weights(cell)
            found.append(100.0 * weights @ np.equal(cell["told"], cell["truth"]) / np.maximum(weights.sum(axis=1), 1.0))
        return np.mean(found, axis=0) if found else None

    def all(self, set_: str, by: str) -> dict[str, np.ndarray] | None:
        """Of each of `networks`; None where one is lacking."""
        found = {model: self(set_, by, model) for model in self.networks}
        known = {model: each for model, each in found.items() if each is not None}
        return known if known and len(known) == len(found) else None


def claims(results: Sequence[Result]) -> list[Claim]:
    """Verdicts on all of them, by networks that were trained."""
    found = Accuracies(results)
    of_paper = [_alike(found), _lead(found), _loss(found, "file"), _loss(found, "description"), _pairs(found)]
    if found.untrained:
        beside = f"; without {' and '.join(found.untrained)}, which nothing shows to be trained"
        of_paper = [replace(claim, figures=claim.figures + beside) for claim in of_paper]
    return [*of_paper, _leak(found, "simple"), _leak(found, "hard")]


def verdict(drawn: np.ndarray, limit: float) -> str:
    """Held where the whole 95 % interval is above the limit, refuted where it is below."""
    low, high = np.percentile(drawn[1:], [2.5, 97.5])
    return "held" if low > limit else "refuted" if high < limit else "undecided"


def _alike(found: Accuracies) -> Claim:
    title, run = "All models are alike on Simple (98.3 to 99.7 %).", found.all("simple", "file")
    if run is None:
        return Claim(title, "undecided", NOT_JUDGED)
    spread = np.ptp(list(run.values()), axis=0)
    learned = not found.untrained and max(each[0] for each in run.values()) >= PAPERS_ACCURACY - WITHIN
    return Claim(
        title, verdict(-spread, -ALIKE) if learned else UNTESTED,
        f"best minus worst network, by file: {_points(spread)}; alike means within {ALIKE:g} points",
    )  # fmt: skip


def _lead(found: Accuracies) -> Claim:
    title, run = "On Hard convolutional networks lead.", found.all("hard", "description")
    others = [] if run is None else [each for name, each in run.items() if name not in (*CONVOLUTIONAL, "streaming")]
    if run is None or not others or not set(CONVOLUTIONAL) <= run.keys():
        return Claim(title, "undecided", NOT_JUDGED)
    lead = np.mean([run[name] for name in CONVOLUTIONAL], axis=0) - np.max(others, axis=0)
    return Claim(
        title, verdict(lead, 0.0), f"mean of VGG-7 and ResNet-18 minus the best of the others, by description: {_points(lead)}"
    )  # fmt: skip


def _loss(found: Accuracies, by: str) -> Claim:
    title = f"Every network loses {LOSS:g} points or more from Simple by file to Hard by {by}."
    simple, hard = found.all("simple", "file"), found.all("hard", by)
    if simple is None or hard is None:
        return Claim(title, "undecided", NOT_JUDGED)
    lost = {model: simple[model] - hard[model] for model in simple}
    verdicts = {verdict(each, LOSS) for each in lost.values()}
    told = "; ".join(f"{model} {_points(each)}" for model, each in lost.items())
    return Claim(title, "refuted" if "refuted" in verdicts else "held" if verdicts == {"held"} else "undecided", told)


def _leak(found: Accuracies, set_: str) -> Claim:
    """Of the networks that were run by both splits."""
    title = f"(Not of the paper) A split by file flatters: it beats a split by description on {set_.capitalize()}."
    pairs = {model: (found(set_, "file", model), found(set_, "description", model)) for model in found.networks}
    whole = {model: a - b for model, (a, b) in pairs.items() if a is not None and b is not None}
    if not whole:
        return Claim(title, "undecided", NOT_JUDGED)
    margin = np.mean(list(whole.values()), axis=0)
    return Claim(title, verdict(margin, 0.0), f"mean over {', '.join(whole)}: {_points(margin)}")


def _pairs(found: Accuracies) -> Claim:
    title = "What separates the models on Hard is walking against abnormal walking, and falling against dancing."
    rows = [each for model in found.networks for each in found.cells("hard", "description", model)]
    if not rows or not {name for pair in PAIRS for name in pair} <= set(rows[0]["classes"]):
        return Claim(title, "undecided", f"{NOT_JUDGED}, or the data set lacks these classes")
    classes = rows[0]["classes"]
    confusions = np.sum([confusions_of(each, found.weights(each)) for each in rows], axis=0)
    ranked = [confused_pairs(each, classes) for each in confusions]
    ranks = np.array([[[set(a) for a, _ in each].index(set(pair)) + 1 for pair in PAIRS] for each in ranked])
    inside, outside = (np.mean(each) for each in (ranks[1:].max(axis=1) <= FIRST, ranks[1:].max(axis=1) > LAST))
    told = ", ".join(f"{a} and {b} {100 * part:.0f} %" for (a, b), part in ranked[0][:FIRST])
    return Claim(
        title, "held" if inside >= 0.95 else "refuted" if outside >= 0.95 else "undecided",
        f"of {len(ranked[0])} pairs these are number {ranks[0, 0]} and {ranks[0, 1]}; most often confused, of the samples of both: "
        + told,
    )  # fmt: skip


def confusions_of(cell: Result, weights: np.ndarray) -> np.ndarray:
    """Confusion (1 + DRAWS, classes, classes) of samples that are drawn so often."""
    count = len(cell["classes"])
    where = np.zeros((len(cell["told"]), count * count))
    where[np.arange(len(where)), np.multiply(cell["truth"], count) + cell["told"]] = 1.0
    return (weights @ where).reshape(-1, count, count)


def confused_pairs(confusion: np.ndarray, classes: Sequence[str]) -> list[tuple[tuple[str, str], float]]:
    """Pairs of classes by the fraction of their samples that are taken for the other."""
    count = confusion.sum(axis=1)
    found = [
        ((classes[a], classes[b]), float((confusion[a, b] + confusion[b, a]) / max(count[a] + count[b], 1)))
        for a in range(len(classes))
        for b in range(a)
    ]
    return sorted(found, key=lambda each: -each[1])


def _points(drawn: np.ndarray) -> str:
    low, high = np.percentile(drawn[1:], [2.5, 97.5])
    return f"{drawn[0]:.1f} [{low:.1f}, {high:.1f}] points"


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
        parts += ["## Confusion on Hard by description, judged networks", "![Confusion](confusion.png)"]
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
    schedule = (
        f"All trainings run {scale.epochs} epochs, whose rate rises and falls along a cosine."
        if scale.schedule == "cosine"
        else f"{capped} of {len(lengths)} trainings reached the limit of epochs, without an early stop, and may be undertrained."
    )
    return (
        f"{len(results)} of {total} cells are done, {seconds / 60:.1f} minutes of one processor. Maps of {scale.size} x "
        f"{scale.size} cells, at most {scale.epochs} epochs, batches of {scale.batch}, Adam 1e-3; seeds {seeds}, each with its own "
        f"split, weights and order. Samples: {samples}; half of them to train on, a quarter to choose the epoch by, a quarter to "
        f"test on. Intervals are 95 % of the mean over seeds, for tests of which samples (by file) or descriptions are drawn anew, "
        "the same for all models (bootstrap); they do not hold the chance of a training, which the seeds tell. "
        f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, torch {torch.__version__}.\n\n"
        f"**What these sets can tell.** {schedule} Claims are judged by networks that beat the nearest centroid on Simple by "
        "file with every seed. Whether all are alike there cannot be tested unless all do and the best comes "
        f"within {WITHIN:g} points of the paper's {PAPERS_ACCURACY:g} %."
    )


def _claims_table(results: Sequence[Result]) -> str:
    return table(
        ("claim", "verdict", "figures"), [(each.claim, each.verdict, each.figures) for each in claims(results)]
    )


def _accuracy(results: Sequence[Result], models: Sequence[str]) -> str:
    found = Accuracies(results)
    columns = [
        (name, by) for name in SETS for by in SPLITS if any((row["set"], row["by"]) == (name, by) for row in results)
    ]
    head = ("model", *(f"{name}, by {by}" for name, by in columns))
    rows = [(model, *(percent(found, *each, model) for each in columns)) for model in models]
    return (
        "Test accuracy [%], its 95 % interval, and that of each seed; by file as the authors split, by description and by clip "
        "without leaks.\n\n" + table(head, rows)
    )


def percent(found: Accuracies, set_: str, by: str, model: str) -> str:
    """Mean over seeds, its interval, and that of each seed [%]."""
    drawn = found(set_, by, model)
    if drawn is None:
        return "-"
    low, high = np.percentile(drawn[1:], [2.5, 97.5])
    return f"{drawn[0]:.1f} [{low:.1f}, {high:.1f}] ({', '.join(f'{each:.1f}' for each in found.of_seeds(set_, by, model))})"


def _printed(results: Sequence[Result], models: Sequence[str]) -> str:
    found, rows = Accuracies(results), []
    for model in models:
        about = None if model in BASELINES else card(model).printed
        means = [
            found.of_seeds(*each, model) for each in (("simple", "file"), ("hard", "file"), ("hard", "description"))
        ]
        rows.append(
            (
                model,
                *(("-", "-") if about is None else (f"{about.simple:.2f}", f"{about.hard:.2f}")),
                *(f"{np.mean(each):.1f}" if each else "-" for each in means),
            )
        )
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
    return "Medians over the cells, on one thread, in time of the processor.\n\n" + table(head, rows)


def _refused(results: Sequence[Result]) -> str:
    found = {(each["set"], each["by"]): each["refused"] for each in results if "refused" in each}
    return "\n".join(f"- {name} by {by}: {told}." for (name, by), told in found.items()) or "Nothing."


def accuracy_figure(results: Sequence[Result], models: Sequence[str]) -> Figure:
    """Mean accuracy of each model on each set by each split, with intervals and the printed values."""
    found = Accuracies(results)
    figure = NotebookFigure(figsize=(11, 4.6), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    for ax, name in zip(axes, SETS, strict=True):
        for number, by in enumerate(SPLITS):
            drawn = [found(name, by, model) for model in models]
            if all(each is None for each in drawn):
                continue
            places = np.arange(len(models)) + 0.27 * (number - 1)
            low, mean, high = np.array(
                [[np.nan] * 3 if each is None else [*np.percentile(each[1:], [2.5, 97.5]), each[0]] for each in drawn]
            ).T[[0, 2, 1]]
            ax.bar(places, mean, 0.25, yerr=[mean - low, high - mean], capsize=2, color=f"C{number}", label=f"by {by}")
        for place, model in enumerate(models):
            about = None if model in BASELINES else card(model).printed
            if about is not None:
                value = about.simple if name == "simple" else about.hard
                ax.plot(place, value, "k_", markersize=14, label="printed" if place == 0 else None)
        ax.set_xticks(range(len(models)), models, rotation=40, ha="right")
        ax.set(title=name.capitalize(), ylim=(0, 112))
        ax.grid(axis="y", alpha=0.3)
    axes[0].set_ylabel("test accuracy [%]")
    if axes[1].get_legend_handles_labels()[0]:
        axes[1].legend(fontsize=8, loc="upper right", ncols=4)
    return figure


def _confusion_figure(results: Sequence[Result]) -> Figure | None:
    found = Accuracies(results)
    rows = [each for model in found.networks for each in found.cells("hard", "description", model)]
    if not rows:
        return None
    figure = NotebookFigure(figsize=(7.6, 6.8), layout="constrained")
    draw_confusion(figure.subplots(), np.sum([each["confusion"] for each in rows], axis=0), rows[0]["classes"])
    return figure
