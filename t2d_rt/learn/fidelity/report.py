"""`fidelity.md` and its chart: accuracy against seconds of simulation, and what each step of fidelity gains."""

from __future__ import annotations

import os
import platform
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from t2d_rt.learn.fidelity.rungs import HIGHEST, RUNGS
from t2d_rt.learn.fidelity.study import LEARNERS, SEEDS, Findings
from t2d_rt.learn.markdown import table
from t2d_rt.learn.transfer.report import FINEST
from t2d_rt.learn.transfer.scores import gain, with_interval
from t2d_rt.plots.new_figure import NotebookFigure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TESTS = {"simulated": "mesh in a room, kept apart", "real": "real"}
STEPS = (
    ("noise, on ellipsoids from the centre", "centre", "centre-clean"),
    ("noise, on ellipsoids from the specular point", "specular", "specular-clean"),
    ("noise, on the mesh", "mesh", "mesh-clean"),
    ("specular point against centre", "specular", "centre"),
    ("mesh against ellipsoids, free space", "mesh", "specular"),
    ("mesh against ellipsoids, room", "mesh-room", "specular-room"),
    ("room against free space, ellipsoids", "specular-room", "specular"),
    ("room against free space, mesh", "mesh-room", "mesh"),
    ("everything: mesh in a room with noise against the paper's ellipsoids without", "mesh-room", "centre-clean"),
)
"""What is gained by what, the better rung first."""
FILES = "fidelity.md", "fidelity.png"
TICKS_S = 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0
NAMES_POINTS = 58.0
"""Height of the names of the rungs above a panel."""

Score = tuple[float, float, float]


def score(found: Findings, rung: str, learner: str, test: str) -> Score | None:
    """Macro-F1 and its 95 % interval over events; None without real events."""
    truth, said = _pair(found, rung, learner, test)
    return None if truth is None or said is None else with_interval(truth, said, len(found.classes))


def write_fidelity(found: Findings, folder: Path, sources: str) -> Path:
    """Writes the report and its chart; the path of the first."""
    fidelity_figure(found).savefig(folder / FILES[1], dpi=120)
    path = folder / FILES[0]
    path.write_text(fidelity_text(found, sources), "utf-8")
    return path


def fidelity_text(found: Findings, sources: str) -> str:
    """The report in Markdown."""
    counts = ", ".join(
        f"{name} {count}" for name, count in zip(found.classes, np.bincount(found.simulated), strict=True)
    )
    chance = 1.0 / len(found.classes)
    head = (
        f"{len(found.simulated)} simulated events ({counts}), each by {len(RUNGS)} rungs: the same motions, places and radars. Two "
        f"thirds of a rung's events are trained on; the test is on the other third as the highest rung has it ({HIGHEST}), and on "
        f"{'no real events' if found.real is None else f'{len(found.real)} real events, none of which is trained on'}. "
        f"{len(SEEDS)} seeds, each with its own third. Macro-F1 of {len(found.classes)} classes with its 95 % interval over "
        f"events, drawn anew within each class; guessing gives about {chance:.2f}. Sentences of the simulated test are those "
        "of the training. "
        f"{sources} {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}."
    )
    parts = ["# What fidelity is worth", head, "![Macro-F1 over seconds of simulation](fidelity.png)", _scores(found)]
    parts += ["## What each step gains", _steps(found)]
    return "\n\n".join(parts) + "\n"


def _scores(found: Findings) -> str:
    tests = [each for each in TESTS if each == "simulated" or found.real is not None]
    head = ("rung", "simulation [s]", *(f"{learner}, {TESTS[test]}" for learner in LEARNERS for test in tests))
    rows = [
        (
            rung.title,
            f"{found.seconds[rung.name]:.2g}",
            *(_told(score(found, rung.name, learner, test)) for learner in LEARNERS for test in tests),
        )
        for rung in RUNGS
    ]
    told = "Seconds are those of the processor for 5 s as one radar sees them, the median; without the motion.\n\n"
    return told + table(head, rows)


def _steps(found: Findings) -> str:
    rows = []
    for title, better, worse in STEPS:
        for learner in LEARNERS:
            cells = [_gained(found, better, worse, learner, test) for test in TESTS]
            rows.append((title, learner, *cells))
    note = (
        "A step gains or loses where all of the 95 % interval of the difference over events is on one side of zero, and the "
        f"difference is {FINEST:.2f} or more.\n\n"
    )
    return note + table(("step", "learner", *TESTS.values()), rows)


def _gained(found: Findings, better: str, worse: str, learner: str, test: str) -> str:
    truth, mine = _pair(found, better, learner, test)
    _, its = _pair(found, worse, learner, test)
    if truth is None or mine is None or its is None:
        return "-"
    middle, low, high = gain(truth, mine, its, len(found.classes))
    sure = abs(middle) >= FINEST and (low > 0 or high < 0)
    said = ("gains" if middle > 0 else "loses") if sure else "undecided"
    return f"{said}: {middle:+.2f} [{low:+.2f}, {high:+.2f}]"


def _pair(found: Findings, rung: str, learner: str, test: str) -> tuple[np.ndarray | None, np.ndarray | None]:
    outcome = found.outcomes[rung, learner]
    return (found.simulated, outcome.simulated) if test == "simulated" else (found.real, outcome.real)


def _told(value: Score | None) -> str:
    return "-" if value is None else f"{value[0]:.2f} [{value[1]:.2f}, {value[2]:.2f}]"


def fidelity_figure(found: Findings) -> Figure:
    """Macro-F1 over the seconds of simulation of each rung, a panel for each learner; hollow marks have no noise.

    Names stand above the panels and the legend below them, where no mark and no interval can be.
    """
    figure = NotebookFigure(figsize=(11, 5.8), layout="constrained")
    axes = figure.subplots(1, len(LEARNERS), sharey=True)
    for ax, learner in zip(axes, LEARNERS, strict=True):
        for colour, (test, title) in enumerate(TESTS.items()):
            for number, rung in enumerate(RUNGS):
                value = score(found, rung.name, learner, test)
                if value is None:
                    continue
                ax.errorbar(
                    found.seconds[rung.name] * (1.0 + 0.06 * (colour - 0.5) + 0.03 * (number % 2)), value[0],
                    yerr=[[value[0] - value[1]], [value[2] - value[0]]], color=f"C{colour}", marker="os^"[_body(rung.name)],
                    fillstyle="full" if rung.noise else "none", capsize=2, linestyle="none",
                    label=f"tested on {title}" if rung.name == HIGHEST else None,
                )  # fmt: skip
        ax.axhline(1.0 / len(found.classes), color="0.6", linestyle=":", label="guessing")
        for rung in RUNGS:
            if rung.noise:
                ax.text(
                    found.seconds[rung.name], 1.02, rung.name, transform=ax.get_xaxis_transform(), rotation=90,
                    fontsize=7, ha="center", va="bottom",
                )  # fmt: skip
        ax.set_xscale("log")
        ax.set_xticks(TICKS_S, [f"{each:g}" for each in TICKS_S])
        ax.minorticks_off()
        times_s = [*found.seconds.values()]
        ax.set_title(learner, pad=NAMES_POINTS)
        ax.set(xlabel="simulation of 5 s, one radar [CPU s]", ylim=(0, 1))
        ax.set_xlim(0.7 * min(times_s), 1.4 * max(times_s))
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("macro-F1, four classes")
    figure.legend(*axes[0].get_legend_handles_labels(), fontsize=8, ncols=3, loc="outside lower center")
    figure.suptitle("Trained on simulation alone; hollow: without noise")
    return figure


def _body(rung: str) -> int:
    return ("centre", "specular", "mesh").index(rung.split("-")[0])
