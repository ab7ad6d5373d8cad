"""The report of a transfer study: a table with intervals, the curves, the confusion of the zero-shot network, and what holds."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.learn.markdown import table
from t2d_rt.learn.transfer.cells import EVENTS_PER_CLASS, Cell
from t2d_rt.learn.transfer.methods import METHODS
from t2d_rt.learn.transfer.scores import gain, with_interval

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AIM = 0.6
"""Of the network that knows no real event."""
FINEST = 0.08
"""Differences of macro-F1 that are smaller are not claimed with some 60 events."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """Score of a method with so many real events per class."""

    method: str
    per_class: int | None
    radars: str
    score: float
    low: float
    high: float
    repeats: int


def read_rows(folder: Path) -> tuple[list[Row], dict[str, Any], dict[str, np.ndarray]]:
    """Rows of a study's cells, what the study tells of itself, and by method and number the predictions (R, E)."""
    if not (folder / "study.json").is_file():
        raise InputError(f"{folder} holds no transfer study; run t2d-rt transfer first")
    try:
        about = json.loads((folder / "study.json").read_text(encoding="utf-8"))
        int(about["real_events"])
    except (ValueError, KeyError, TypeError, RecursionError, OverflowError):
        raise InputError(f"{folder / 'study.json'} is not what a study wrote there; run t2d-rt transfer anew") from None
    gathered: dict[tuple[str, int | None, str], list[dict[str, Any]]] = {}
    for path in sorted((folder / "cells").glob("*.json")):
        try:
            cell = json.loads(path.read_text(encoding="utf-8"))
            gathered.setdefault((cell["method"], cell["per_class"], cell["radars"]), []).append(cell)
            named = Cell(**{each.name: cell[each.name] for each in fields(Cell)}).name
            sound = named == path.stem and len(cell["truth"]) == len(cell["predicted"]) == about["real_events"]
        except (ValueError, KeyError, TypeError, RecursionError, OverflowError):
            sound = False
        if not sound:
            raise InputError(f"{path} is not what a study wrote there; remove it, and it is computed again")
    if not gathered:
        raise InputError(f"{folder} has no finished cell yet; run t2d-rt transfer first")
    rows, labels = [], {}
    for (method, per_class, radars), found in gathered.items():
        truth, predicted = np.array(found[0]["truth"]), np.array([each["predicted"] for each in found])
        score, low, high = with_interval(truth, predicted, len(about["classes"]))
        rows.append(
            Row(method=method, per_class=per_class, radars=radars, score=score, low=low, high=high, repeats=len(found))
        )
        labels[f"{method}, {radars}, {per_class}"] = np.stack([np.broadcast_to(truth, predicted.shape), predicted])
    return rows, about, labels


def report_text(folder: Path, sources: dict[str, str] | None = None) -> str:
    """The report in Markdown."""
    rows, about, labels = read_rows(folder)
    classes = about["classes"]
    chance = 1.0 / len(classes)
    lines = [
        "# Transfer from simulation to real radar", "",
        f"{about['real_events']} real events by {len(about['radars'])} radars ({', '.join(about['radars'])}), classes "
        f"{', '.join(classes)}; {about['simulated_events']} simulated events.",
        *[f"- {name}: {text}" for name, text in (sources or {}).items()], "",
        f"Macro-F1, mean of {max(row.repeats for row in rows)} repetitions of {about['folds']}-fold cross-validation; "
        f"an event is on one side with both radars' maps. In brackets the 95 % interval over events. Guessing gives about "
        f"{chance:.2f}. With so few events no difference below {FINEST:.2f} is claimed.", "",
    ]  # fmt: skip
    lines += [
        _table(rows),
        "",
        "## Zero-shot: trained on simulation alone",
        "",
        _confusion(labels.get("zero-shot, both, 0"), classes),
    ]
    lines += ["", "## What holds", "", *[f"- {each}" for each in findings(labels, len(classes))], ""]
    return "\n".join(lines)


def _table(rows: list[Row]) -> str:
    counts = sorted({row.per_class for row in rows if row.per_class}) + [None]
    found = []
    for method, radars in dict.fromkeys((row.method, row.radars) for row in rows):
        mine = {row.per_class: row for row in rows if (row.method, row.radars) == (method, radars)}
        if 0 in mine:
            found.append([f"{method} (no real event)", radars, _shown(mine[0]), *[""] * (len(counts) - 1)])
        else:
            found.append([method, radars, *(_shown(mine[each]) if each in mine else "" for each in counts)])
    head = ["method", "radars", *("all" if each is None else f"{each} per class" for each in counts)]
    return table(head, found)


def _shown(row: Row) -> str:
    return f"{row.score:.2f} [{row.low:.2f}, {row.high:.2f}]"


def _confusion(pair: np.ndarray | None, classes: list[str]) -> str:
    if pair is None:
        return "Not computed yet."
    found = []
    for number, name in enumerate(classes):
        said = pair[1][pair[0] == number]
        found.append([name, *(f"{np.mean(said == each):.2f}" for each in range(len(classes)))])
    head = ["is", *(f"said {each}" for each in classes)]
    return f"Fractions of each class's events, over all repetitions:\n\n{table(head, found)}"


def findings(labels: dict[str, np.ndarray], classes: int) -> list[str]:
    """What the predictions say of the questions of the study, a sentence each; labels as `read_rows` gives them."""
    found = []
    if (zero := labels.get("zero-shot, both, 0")) is not None:
        score, low, high = with_interval(zero[0][0], zero[1], classes)
        above = "above" if low > 1.0 / classes else "not surely above"
        found.append(
            f"Zero-shot: {score:.2f} [{low:.2f}, {high:.2f}], {above} chance ({1 / classes:.2f}); the aim of {AIM:.2f} is "
            f"{'met' if score >= AIM else 'missed'}."
        )
    for count in EVENTS_PER_CLASS:
        told = [
            f"{name} {_gained(labels, name, 'from scratch', count, classes)}"
            for name, method in METHODS.items()
            if method.knows_simulation
            and {f"{each}, both, {count}" for each in (name, "from scratch")} <= labels.keys()
        ]
        if told:
            found.append(
                f"{'All' if count is None else count} real events per class, against from scratch: {'; '.join(told)}."
            )
    if {"full fine-tuning, both, None", "extra trees, both, None"} <= labels.keys():
        said = _gained(labels, "full fine-tuning", "extra trees", None, classes)
        found.append(f"All real events, full fine-tuning against extra trees on the same events: {said}.")
    return found


def _gained(labels: dict[str, np.ndarray], name: str, other: str, count: int | None, classes: int) -> str:
    """The gain of one method over another, and what may be claimed of it."""
    mine, its = labels[f"{name}, both, {count}"], labels[f"{other}, both, {count}"]
    found, low, high = gain(mine[0][0], mine[1], its[1], classes)
    sure = abs(found) >= FINEST and (low > 0 or high < 0)
    said = ("better" if found > 0 else "worse") if sure else "undecided"
    return f"{found:+.2f} [{low:+.2f}, {high:+.2f}], {said}"


def plot_curves(folder: Path) -> Figure:
    """Macro-F1 over the number of real events per class, a curve for each method, intervals as bands of lines."""
    from t2d_rt.plots.canvas import blank_figure

    rows, about, _ = read_rows(folder)
    fig = blank_figure(7.5, 4.5)
    ax = fig.add_subplot()
    counts = sorted({row.per_class for row in rows if row.per_class}) + [None]
    methods = [name for name in dict.fromkeys(row.method for row in rows) if name != "zero-shot"]
    for number, method in enumerate(methods):
        mine = [
            row for each in counts for row in rows if (row.method, row.per_class, row.radars) == (method, each, "both")
        ]
        if not mine:
            continue
        places = np.array([counts.index(row.per_class) for row in mine]) + 0.08 * (number - len(methods) / 2)
        score = np.array([row.score for row in mine])
        spread = np.abs(np.array([[row.low for row in mine], [row.high for row in mine]]) - score)
        ax.errorbar(places, score, yerr=spread, marker="o", markersize=4, linewidth=1.2, elinewidth=0.7, label=method)
    for row in rows:
        if row.method == "zero-shot":
            ax.axhline(row.score, color="black", linestyle="--", linewidth=1, label="zero-shot")
    ax.axhline(1.0 / len(about["classes"]), color="0.6", linestyle=":", linewidth=1, label="chance")
    ax.set_xticks(range(len(counts)), ["all" if each is None else str(each) for each in counts])
    ax.set_xlabel("real events per class")
    ax.set_ylabel("macro-F1, 95 % interval over events")
    ax.set_ylim(0, 1)
    ax.legend(fontsize=7, ncols=2, loc="lower right")
    return fig
