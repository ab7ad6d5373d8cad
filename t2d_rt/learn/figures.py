"""Figures of a training (learning curves, confusion, reliability), and of a prediction with its spectrogram."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.learn.prediction import Prediction
from t2d_rt.learn.scores import Scores
from t2d_rt.plots.new_figure import NotebookFigure
from t2d_rt.recording.recording import Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH_OF_LETTER = 0.0105
"""Width of a letter in the names above a prediction, as a fraction of the axis; names that do not fit are left out."""


def curves_figure(history: Sequence[dict[str, float]], *, title: str) -> Figure:
    """Loss and accuracy of training and validation over the epochs."""
    figure = NotebookFigure(figsize=(9, 3.6), layout="constrained")
    axes = figure.subplots(1, 2)
    epochs = np.arange(1, len(history) + 1)
    best = int(np.argmin([row["val_loss"] for row in history])) + 1
    for ax, quantity, label in ((axes[0], "loss", "cross entropy [nat]"), (axes[1], "accuracy", "accuracy [%]")):
        scale = 100.0 if quantity == "accuracy" else 1.0
        for side, name in (("train", "training"), ("val", "validation")):
            ax.plot(
                epochs,
                [scale * row[f"{side}_{quantity}"] for row in history],
                marker="." if len(epochs) < 30 else "",
                label=name,
            )
        ax.axvline(best, color="0.6", linestyle=":", label="weights that are kept")
        ax.set(xlabel="epoch", ylabel=label)
        ax.grid(alpha=0.3)
    axes[1].set_ylim(0, 100)
    axes[0].legend()
    figure.suptitle(title)
    return figure


def confusion_figure(scores: Scores, classes: Sequence[str], *, title: str) -> Figure:
    """Confusion matrix in percent of each class, with the numbers of samples."""
    size = 2.6 + 0.62 * len(classes)
    figure = NotebookFigure(figsize=(size + 0.8, size), layout="constrained")
    draw_confusion(figure.subplots(), scores.confusion, classes)
    figure.suptitle(title)
    return figure


def draw_confusion(ax: Axes, confusion: np.ndarray, classes: Sequence[str]) -> Any:
    """Draws a confusion matrix: rows are true classes, columns predicted ones; returns what `imshow` drew."""
    part = 100.0 * confusion / np.maximum(confusion.sum(axis=1, keepdims=True), 1)
    image = ax.imshow(part, vmin=0, vmax=100, cmap="Blues")
    for row in range(len(classes)):
        for column in range(len(classes)):
            if confusion[row, column]:
                colour = "white" if part[row, column] > 55 else "black"
                ax.text(column, row, f"{part[row, column]:.0f}", ha="center", va="center", color=colour, fontsize=9)
    ax.set_xticks(range(len(classes)), classes, rotation=45, ha="right")
    ax.set_yticks(range(len(classes)), classes)
    ax.set(xlabel="taken for [% of the class]", ylabel="class")
    return image


def reliability_figure(scores: Scores, *, title: str) -> Figure:
    """Accuracy as a function of confidence; a calibrated classifier is on the diagonal."""
    figure = NotebookFigure(figsize=(4.8, 4.6), layout="constrained")
    ax = figure.subplots()
    occupied_bins = scores.reliability[scores.reliability[:, 2] > 0]
    ax.plot([0, 100], [0, 100], color="0.6", linestyle=":", label="calibrated")
    ax.bar(100 * occupied_bins[:, 0], 100 * occupied_bins[:, 1], width=6, color="C0", alpha=0.6, label="found")
    for confidence, right, count in occupied_bins:
        ax.text(100 * confidence, min(100 * right + 1.5, 96), f"{count:.0f}", ha="center", fontsize=8)
    ax.set(
        xlim=(0, 104),
        ylim=(0, 104),
        xlabel="confidence [%]",
        ylabel="accuracy [%]",
        title=f"calibration error {100 * scores.calibration_error:.0f} points; numbers are samples",
    )
    ax.title.set_fontsize(9)
    ax.legend(loc="upper left")
    figure.suptitle(title)
    return figure


def prediction_figure(recording: Recording, prediction: Prediction, *, title: str) -> Figure:
    """The spectrogram, with static echoes treated as for the network, and below it the probability of each class over time. Names
    are those of the likeliest course of activities, where one lasts long enough for its name."""
    figure = NotebookFigure(figsize=(10, 6.4), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    recording.processed(mti=prediction.mti).plot(title, ax=upper)
    upper.set_xlabel("")
    middles = prediction.middles_s
    if len(middles) == 1:
        middles = np.array([prediction.starts_s[0], prediction.starts_s[0] + prediction.duration_s])
    levels = np.broadcast_to(100 * prediction.probabilities, (len(middles), len(prediction.classes)))
    lower.stackplot(
        middles, levels.T, labels=prediction.classes, colors=[f"C{number}" for number in range(len(prediction.classes))]
    )
    first, last = lower.get_xlim()
    for begin, end, number in prediction.pieces():
        lower.axvline(begin, color="black", linewidth=1)
        name = prediction.classes[number]
        if end - begin > WIDTH_OF_LETTER * len(name) * (last - first):
            lower.text(0.5 * (begin + end), 104, name, ha="center", va="bottom", fontsize=8, color=f"C{number}")
    lower.set(xlabel="time [s]", ylabel="probability [%]", ylim=(0, 100))
    lower.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=8)
    return figure
