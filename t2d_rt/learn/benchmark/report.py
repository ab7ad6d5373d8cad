"""`report.md` and its pictures."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.learn.baselines import BASELINES
from t2d_rt.learn.benchmark.claims import accuracies, claims, interval
from t2d_rt.learn.benchmark.scales import NETWORKS, SETS, Scale
from t2d_rt.learn.charts import draw_confusion
from t2d_rt.learn.markdown import table
from t2d_rt.learn.models import build, card, count
from t2d_rt.learn.train import SPLITS
from t2d_rt.plots.new_figure import NotebookFigure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Result = dict[str, Any]


def write_report(scale: Scale, results: Sequence[Result], total: int, folder: Path) -> Path:
    """Writes report.md, accuracy.png and confusion.png; the path of the first."""
    models = [each for each in scale.models if any(row["model"] == each for row in results)]
    accuracy_figure(results, models).savefig(folder / "accuracy.png")
    figure = _confusion_figure(results)
    if figure is not None:
        figure.savefig(folder / "confusion.png")
    parts = [
        f"# Table III at the scale {scale.name}", _head(scale, results, total), "## Claims, one by one", _claims(results),
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
        "networks may be undertrained. The paper trained on thousands of samples: a verdict is of this size; one that refutes "
        "a claim here does not refute it there. With fewer than three seeds there is no interval, and nothing is decided."
    )


def _claims(results: Sequence[Result]) -> str:
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
