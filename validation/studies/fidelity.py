"""What fidelity of simulation is worth to a classifier: the same events in several ways, tested on the best and on real ones."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import time
import warnings
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.core.atomic_write import replacing
from t2d_rt.core.checks import array, file_path
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.core.progress import ProgressBar
from t2d_rt.learn.adapters.parrad import BINS, FOUR, RADARS, ROWS
from t2d_rt.learn.fine_tuning import Events
from t2d_rt.learn.maps import LabelledMaps
from t2d_rt.learn.pytorch import torch_threads
from t2d_rt.plots.new_figure import NotebookFigure
from t2d_rt.recording.remake import add_noise
from t2d_rt.scattering.ellipsoid import PhaseFrom
from t2d_rt.simulate import simulate
from t2d_rt.types import Receiver
from t2d_rt.types.ellipsoids import Method
from validation.studies.common import kept_cell, made_folder, read_labelled, table
from validation.studies.transfer import FINEST, extra_trees, gain, grouped_folds, with_interval
from validation.studies.twins import MERGED, RECIPE, TwinRecipe, maps_of_events, noise_seed, range_mean_levels, staged

if TYPE_CHECKING:
    from matplotlib.figure import Figure


ROOM = "empty_room"
EVENT_FILES = "[0-9]*.npz"


@dataclass(frozen=True, slots=True, kw_only=True)
class Rung:
    """One way to simulate an event."""

    name: str
    title: str
    method: Method
    phase_from: PhaseFrom = "specular"
    scene: str = "free_space"
    noise: bool = True

    @property
    def simulation(self) -> tuple[Method, PhaseFrom, str]:
        """What rungs with and without noise share."""
        return self.method, self.phase_from, self.scene


RUNGS = (
    Rung(name="centre-clean", title="ellipsoids from the centre, no noise", method="ellipsoid", phase_from="centre", noise=False),
    Rung(name="centre", title="ellipsoids from the centre", method="ellipsoid", phase_from="centre"),
    Rung(name="specular-clean", title="ellipsoids from the specular point, no noise", method="ellipsoid", noise=False),
    Rung(name="specular", title="ellipsoids from the specular point", method="ellipsoid"),
    Rung(name="mesh-clean", title="mesh, no noise", method="mesh", noise=False),
    Rung(name="mesh", title="mesh", method="mesh"),
    Rung(name="specular-room", title="ellipsoids from the specular point, room", method="ellipsoid", scene=ROOM),
    Rung(name="mesh-room", title="mesh, room", method="mesh", scene=ROOM),
)  # fmt: skip
"""Least fidelity first; the paper's ellipsoids are those from the centre. With noise, unless the title says otherwise."""
HIGHEST = RUNGS[-1].name


def make_rungs(recipe: TwinRecipe, folder: str | Path, *, progress: Callable[[float], None] | None = None) -> Path:
    """Writes the events of a recipe by all rungs, a file each; those that are there stay, so that a stopped run goes on.

    recipe: of which scene and method are left aside.
    """
    target = file_path("the folder of events", folder)
    # Without their number: more events of the same recipe join those that are there.
    plain = {name: value for name, value in asdict(recipe).items() if name not in ("per_class", "scene", "method")}
    told = json.dumps({**plain, "rungs": [asdict(each) for each in RUNGS]}, indent=1)
    made_folder(target, target / RECIPE, told, EVENT_FILES, "events")
    for index in range(recipe.count):
        path = target / f"{index:05d}.npz"
        if not path.exists():
            made = event(recipe, index)
            with replacing(path, lambda: None) as new, new.open("wb") as file:
                np.savez(file, **made)
        if progress is not None:
            progress((index + 1) / recipe.count)
    return target


def event(recipe: TwinRecipe, index: int) -> dict[str, Any]:
    """Levels (rung, radar, row, bin) [dB], label, and the CPU time of each rung's simulation [s], (rung,)."""
    found = staged(recipe, index)
    levels = np.zeros((len(RUNGS), len(RADARS), ROWS, BINS), dtype=np.float16)
    seconds = np.zeros(len(RUNGS))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", T2DWarning)
        for number, radar in enumerate(found.radars):
            for simulation in dict.fromkeys(each.simulation for each in RUNGS):
                method, phase_from, scene = simulation
                began = time.process_time()
                clean = simulate(
                    found.motion, radar=radar, scene=scene, method=method, phase_from=phase_from, reflections=1, clutter="none",
                    seed=noise_seed(recipe, index, number), progress=False,
                )  # fmt: skip
                taken_s = time.process_time() - began
                for place, rung in enumerate(RUNGS):
                    if rung.simulation == simulation:
                        began = time.process_time()
                        recording = add_noise(clean, Receiver()) if rung.noise else clean
                        levels[place, number] = range_mean_levels(np.asarray(recording.adc.values)[:, 0])[:ROWS]
                        seconds[place] += taken_s + time.process_time() - began
    return {"levels": levels, "label": found.label, "sentence": found.sentence, "seconds": seconds}


@dataclass(frozen=True, slots=True, kw_only=True)
class RungEvents:
    """The events of a folder as maps, rung by rung."""

    maps: Mapping[str, LabelledMaps]
    seconds: Mapping[str, np.ndarray]
    """CPU time of each event's simulation by both radars [s], (E,)."""


def read_rungs(folder: str | Path, count: int | None = None) -> RungEvents:
    """The events of a folder, in the four classes that PARrad's real events are told apart in.

    count: the first so many of them; all by default.
    """
    target = file_path("the folder of events", folder)
    files = sorted(target.glob(EVENT_FILES))[:count]
    if not files:
        raise InputError(f"{target} holds no events; the study fidelity makes them")
    found = [_read_event(path) for path in files]
    labels, names = [MERGED[label] for label, _, _ in found], [path.stem for path in files]
    return RungEvents(
        maps={
            rung.name: maps_of_events([levels[place] for _, levels, _ in found], labels, names)
            for place, rung in enumerate(RUNGS)
        },
        seconds={rung.name: np.array([seconds[place] for _, _, seconds in found]) for place, rung in enumerate(RUNGS)},
    )  # fmt: skip


def _read_event(path: Path) -> tuple[str, np.ndarray, np.ndarray]:
    """Label, levels (rung, radar, row, bin) and seconds (rung,) of an event's file."""
    try:
        with np.load(path, allow_pickle=False) as file:
            label = str(file["label"])
            levels = array("its levels", file["levels"], (len(RUNGS), len(RADARS), ROWS, BINS), limit=1e6)
            seconds = array("its seconds", file["seconds"], (len(RUNGS),))
        if label not in MERGED:
            raise InputError(f"it is of class '{label}'")
    except Exception as error:  # NumPy and zipfile raise what they like of a damaged file
        raise InputError(
            f"{path} is no event of this study ({error or type(error).__name__}); remove it and make it again"
        ) from None
    return label, levels, seconds


SEEDS = 0, 1, 2
"""Of weights and order; each has a third of the simulated events to be tested on, so that all of them are tested once."""
NETWORK, TREES = "network", "extra trees"
LEARNERS = NETWORK, TREES
TRAINING_STEPS = 400
"""Of the network's training, whatever the number of events."""


@dataclass(frozen=True, slots=True)
class Cell:
    """What one file is about."""

    rung: str
    learner: str
    seed: int

    @property
    def name(self) -> str:
        """Of its file."""
        return f"{self.rung}_{self.learner}_{self.seed}".replace(" ", "-")


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Labels told by all seeds of one rung and learner."""

    simulated: np.ndarray
    """Of each simulated event by the highest rung, (1, E): each is told by the seed that was not trained on it."""
    real: np.ndarray | None
    """Of each real event, (seeds, R); None without real events."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """What the cells told."""

    classes: tuple[str, ...]
    simulated: np.ndarray
    """Classes of the simulated events, (E,)."""
    real: np.ndarray | None
    """Classes of the real events, (R,)."""
    outcomes: dict[tuple[str, str], Outcome]
    """By rung and learner."""
    seconds: dict[str, float]
    """Of simulation [CPU s] of an event by one radar, the median."""


def cells() -> list[Cell]:
    """All cells."""
    return [Cell(rung.name, learner, seed) for learner in LEARNERS for rung in RUNGS for seed in SEEDS]


def run_study(
    found: RungEvents, real: LabelledMaps | None, folder: Path, *, progress: Callable[[float], None] | None = None
) -> Findings:
    """Runs the cells that have no file yet.

    found: simulated events of all rungs.
    real: maps of real events of the same classes, to test on; None where there are none at hand.
    folder: of the cells.
    """
    folder.mkdir(parents=True, exist_ok=True)
    events = {name: Events.of(maps) for name, maps in found.maps.items()}
    tested = None if real is None else Events.of(real)
    if tested is not None:
        tested.same_axes(events[HIGHEST])
    _check_counts(events[HIGHEST])
    stamp = _stamp(events, tested)
    every, told = cells(), {}
    for number, cell in enumerate(every, 1):
        path = folder / f"{cell.name}.json"
        with torch_threads(1):
            told[cell] = kept_cell(path, partial(_said, cell, events, tested), partial(_sound, cell, tested), stamp)
        if progress is not None:
            progress(number / len(every))
    truth = events[HIGHEST].labels
    return Findings(
        classes=events[HIGHEST].classes, simulated=truth, real=None if tested is None else tested.labels,
        outcomes={
            (rung.name, learner): _outcome([told[Cell(rung.name, learner, seed)] for seed in SEEDS], len(truth), tested)
            for rung in RUNGS
            for learner in LEARNERS
        },
        seconds={name: float(np.median(each)) / len(events[name].radars) for name, each in found.seconds.items()},
    )  # fmt: skip


def _check_counts(events: Events) -> None:
    least = int(np.bincount(events.labels).min())
    if least < len(SEEDS):
        raise InputError(
            f"the study needs {len(SEEDS)} simulated events of each class or more, one has {least}; raise --per-class"
        )


def _said(cell: Cell, events: dict[str, Events], real: Events | None) -> dict[str, Any]:
    """Labels that are told after training on a rung's events of two folds."""
    highest = events[HIGHEST]
    fold = grouped_folds(highest.labels, len(SEEDS), 0)
    test = np.flatnonzero(fold == cell.seed % len(SEEDS))
    train = events[cell.rung].take(np.flatnonzero(fold != cell.seed % len(SEEDS)))
    asked = [highest.take(test), *([] if real is None else [real])]
    labels = _labels(cell, train, asked)
    return {
        "cell": cell.name, "test": test.tolist(), "simulated": labels[0].tolist(),
        "real": labels[1].tolist() if len(labels) > 1 else None,
    }  # fmt: skip


def _labels(cell: Cell, train: Events, asked: list[Events]) -> list[np.ndarray]:
    if cell.learner == TREES:
        return [extra_trees(train, each, cell.seed) for each in asked]
    from t2d_rt.learn.fine_tuning import BATCH, PRETRAINING, labels_of, random_network, trained_on

    epochs = -(-TRAINING_STEPS // -(-len(train) // BATCH))
    net = random_network(len(train.classes), cell.seed)
    trained_on(net, train, replace(PRETRAINING, epochs=epochs), cell.seed)
    return [labels_of(net, each) for each in asked]


def _stamp(events: dict[str, Events], real: Events | None) -> str:
    """What every cell follows from beside its name: files of other data are refused."""
    digest = hashlib.sha256()
    for each in (*events.values(), *([] if real is None else [real])):
        digest.update(each.levels.tobytes() + each.labels.tobytes() + json.dumps(each.classes).encode())
    return digest.hexdigest()[:16]


def _sound(cell: Cell, real: Events | None, told: dict[str, Any]) -> bool:
    same = told["cell"] == cell.name and (told["real"] is None) == (real is None)
    return same and len(told["test"]) == len(told["simulated"])


def _outcome(told: list[dict[str, Any]], count: int, real: Events | None) -> Outcome:
    simulated = np.full((1, count), -1)
    for each in told:
        simulated[0, each["test"]] = each["simulated"]
    return Outcome(simulated=simulated, real=None if real is None else np.array([each["real"] for each in told]))


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
REPORTS = "fidelity.md", "fidelity.png"
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
    fidelity_figure(found).savefig(folder / REPORTS[1], dpi=120)
    path = folder / REPORTS[0]
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


def add_options(parser: ArgumentParser) -> None:
    parser.add_argument(
        "-o", "--output", required=True, help="folder of fidelity.md, its events and its cells; a stopped run goes on"
    )
    parser.add_argument("--real", help="file of real events (PARrad) to test on, beside simulated ones")
    parser.add_argument(
        "--per-class", type=int, default=12, help="simulated events of each of five activities (default 12)"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the events (default 0)")


def run(options: Namespace) -> str:
    real = None if options.real is None else read_labelled(options.real, FOUR)
    recipe = TwinRecipe(per_class=options.per_class, seed=options.seed)
    folder = Path(options.output)
    # More events than before, or none that are real: cells of their own, and those of before stay.
    cells_folder = folder / f"cells-{recipe.count}{'' if real is None else '-real'}"
    with ProgressBar("events") as progress:
        events = make_rungs(recipe, folder / "events", progress=progress)
    with ProgressBar("training") as progress:
        found = run_study(
            read_rungs(events, recipe.count), None if real is None else real.maps, cells_folder, progress=progress
        )
    told = "No real events were at hand." if real is None else f"Real: {real}"
    return f"wrote {write_fidelity(found, folder, told)}"
