"""Transfer: a network that learned from simulated events, tuned on few real ones, beside others that know none (Table IV)."""

from __future__ import annotations

import hashlib
import json
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from t2d_rt.core.atomic_write import replacing
from t2d_rt.core.checks import file_path, integer
from t2d_rt.core.errors import InputError
from t2d_rt.core.progress import ProgressBar
from t2d_rt.learn.fine_tuning import STRATEGIES, EventNet, Events, fine_tune, labels_of, pretrain, random_network
from t2d_rt.learn.maps import LabelledMaps
from t2d_rt.learn.pytorch import torch_threads
from t2d_rt.learn.scores import macro_f1
from t2d_rt.radar.synthesize import Progress
from validation.studies.common import add_real_options, kept_cell, read_cell, real_and_twins, table, write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure


RESAMPLINGS = 1000


def with_interval(
    truth: np.ndarray, predicted: np.ndarray, classes: int, *, seed: int = 0
) -> tuple[float, float, float]:
    """Mean over repetitions of macro-F1 of predictions (R, E), and its 95 % interval over events.

    Events are drawn anew with replacement, within each class, and all repetitions are scored on the same draw: the interval holds
    what another recording of as many events of the same persons would change, and what training's chance changes on average.
    """
    means = _redrawn(truth, predicted, classes, seed)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(np.mean(macro_f1(truth[None], predicted, classes))), float(low), float(high)


def gain(
    truth: np.ndarray, predicted: np.ndarray, others: np.ndarray, classes: int, *, seed: int = 0
) -> tuple[float, float, float]:
    """How much greater macro-F1 of predictions (R, E) is than that of others (Q, E), with its 95 % interval over events."""
    differences = _redrawn(truth, predicted, classes, seed) - _redrawn(truth, others, classes, seed)
    low, high = np.percentile(differences, [2.5, 97.5])
    means = [float(np.mean(macro_f1(truth[None], each, classes))) for each in (predicted, others)]
    return means[0] - means[1], float(low), float(high)


def _redrawn(truth: np.ndarray, predicted: np.ndarray, classes: int, seed: int) -> np.ndarray:
    """Macro-F1, mean over repetitions, of each draw of events, (RESAMPLINGS,)."""
    rng = np.random.default_rng(seed)
    members = [np.flatnonzero(truth == label) for label in np.unique(truth)]
    drawn = np.stack([np.concatenate([rng.choice(each, len(each)) for each in members]) for _ in range(RESAMPLINGS)])
    return np.asarray(np.mean([macro_f1(truth[drawn], each[drawn], classes) for each in predicted], axis=0))


def grouped_folds(labels: np.ndarray, folds: int, seed: int) -> np.ndarray:
    """Fold of each event, (E,): classes are spread evenly, in an order that the seed draws. An event's maps have one fold."""
    rng = np.random.default_rng(seed)
    found = np.zeros(len(labels), dtype=int)
    first = 0
    for label in np.unique(labels):
        members = rng.permutation(np.flatnonzero(labels == label))
        found[members] = (np.arange(len(members)) + first) % folds
        first += len(members)
    return found


def at_most(labels: np.ndarray, among: np.ndarray, per_class: int | None, seed: int) -> np.ndarray:
    """Of the events `among`, so many of each class, or all there are: sorted positions."""
    if per_class is None:
        return np.sort(among)
    rng = np.random.default_rng(seed)
    chosen = [rng.permutation(among[labels[among] == label])[:per_class] for label in np.unique(labels[among])]
    return np.sort(np.concatenate(chosen))


TREES = 200


def bin_features(events: Events) -> np.ndarray:
    """Mean and greatest level above the noise of each bin of each radar [dB], (E, V * 2 * speed)."""
    above = events.above_median_db
    return np.concatenate([above.mean(axis=3), above.max(axis=3)], axis=2).reshape(len(events), -1)


def extra_trees(
    train: Events, test: Events, seed: int, *, share: float | Literal["sqrt"] = "sqrt", leaf: int = 1
) -> np.ndarray:
    """Labels of the test events, (E,), by trees that were grown on the others; share: of the features that a branch is chosen from;
    leaf: least samples of one."""
    from sklearn.ensemble import ExtraTreesClassifier

    trees = ExtraTreesClassifier(TREES, max_features=share, min_samples_leaf=leaf, random_state=seed, n_jobs=1)
    return np.asarray(trees.fit(bin_features(train), train.labels).predict(bin_features(test)), dtype=np.int64)


EXTRA_TREES, ZERO_SHOT = "extra trees", "zero-shot"


@dataclass(frozen=True, slots=True)
class Method:
    """What is tuned, and whether the network knows simulation."""

    strategy: str
    knows_simulation: bool


METHODS = {
    **{name: Method(name, True) for name in STRATEGIES},
    "from scratch": Method("full fine-tuning", False),
    "frozen random encoder": Method("linear probing", False),
}
"""Table IV, and the two that tell what simulation is worth."""
EVENTS_PER_CLASS: tuple[int | None, ...] = (5, 10, 20, None)
"""Of the real events of the training folds; None takes all. A class that has fewer gives all it has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyOptions:
    """How much is repeated."""

    repeats: int = 3
    """Of the cross-validation, each with its own folds, choice of events and pre-trained network."""
    folds: int = 5
    seed: int = 0

    def __post_init__(self) -> None:
        integer("repeats", self.repeats, 1, 1000)
        integer("folds", self.folds, 2, 1000)
        integer("seed", self.seed, 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One repetition of a method over all folds: every real event is predicted once."""

    method: str
    per_class: int | None
    radars: str
    """"both", or the name of the one that is used."""
    repeat: int

    @property
    def name(self) -> str:
        """Of its file."""
        text = f"{self.method}_{self.radars}_{'all' if self.per_class is None else self.per_class}_{self.repeat}"
        return text.replace(" ", "-")


def cells(radars: tuple[str, ...], options: StudyOptions) -> Iterator[Cell]:
    """All cells of a study, quick ones first: trees by each radar alone too, networks by all radars together."""
    for repeat in range(options.repeats):
        for radar in ("both", *radars) if len(radars) > 1 else ("both",):
            yield Cell(method=EXTRA_TREES, per_class=None, radars=radar, repeat=repeat)
        yield Cell(method=ZERO_SHOT, per_class=0, radars="both", repeat=repeat)
        for per_class in EVENTS_PER_CLASS[:-1]:
            yield Cell(method=EXTRA_TREES, per_class=per_class, radars="both", repeat=repeat)
        for method in METHODS:
            for per_class in EVENTS_PER_CLASS:
                yield Cell(method=method, per_class=per_class, radars="both", repeat=repeat)


class Study:
    """Real and simulated events, and the folder that the cells are kept in."""

    def __init__(self, real: Events, simulated: Events, folder: Path, options: StudyOptions) -> None:
        real.same_axes(simulated)
        least = int(np.bincount(real.labels, minlength=len(real.classes)).min())
        if least < options.folds:
            raise InputError(
                f"{options.folds} folds need as many real events of each class, one has {least}; take fewer folds"
            )
        self.real, self.simulated, self.folder, self.options = real, simulated, folder, options
        self._known: dict[int, EventNet] = {}

    @property
    def about(self) -> dict[str, Any]:
        """What each cell follows from, beside versions; a study of more repetitions goes on from one of fewer."""
        return {
            "folds": self.options.folds,
            "seed": self.options.seed, "classes": list(self.real.classes), "radars": list(self.real.radars),
            "real": _hash(self.real), "simulated": _hash(self.simulated), "real_events": len(self.real),
            "simulated_events": len(self.simulated),
        }  # fmt: skip

    def prepared(self) -> None:
        """Makes the folder, or refuses one of another study."""
        (self.folder / "cells").mkdir(parents=True, exist_ok=True)
        path, text = self.folder / "study.json", json.dumps(self.about, indent=1)
        if path.exists() and path.read_text(encoding="utf-8") != text:
            raise InputError(f"{self.folder} holds another study: other data or options; give another folder")
        if not path.exists():
            write_whole(path, text)

    def run(self, progress: Callable[[float], None] | None = None) -> None:
        """Computes the cells that are not there yet."""
        self.prepared()
        every = list(cells(self.real.radars, self.options))
        for number, cell in enumerate(every, 1):
            path = self.folder / "cells" / f"{cell.name}.json"
            with torch_threads(1):
                kept_cell(path, partial(self.found, cell), partial(_sound, path, len(self.real)))
            if progress is not None:
                progress(number / len(every))

    def found(self, cell: Cell) -> dict[str, Any]:
        """What the file of a cell tells."""
        told = {"truth": self.real.labels.tolist(), "predicted": self.labels(cell).tolist()}
        return {**asdict(cell), **told}

    def labels(self, cell: Cell) -> np.ndarray:
        """The label that a cell gives each real event, (E,)."""
        seed = self.options.seed + cell.repeat
        real = self.real if cell.radars == "both" else self.real.seen_by(cell.radars)
        if cell.method == ZERO_SHOT:
            return labels_of(self.known(cell.repeat), real)
        fold = grouped_folds(real.labels, self.options.folds, seed)
        found = np.zeros(len(real), dtype=np.int64)
        for number in range(self.options.folds):
            test = np.flatnonzero(fold == number)
            chosen = at_most(real.labels, np.flatnonzero(fold != number), cell.per_class, 1000 * seed + number)
            train = real.take(chosen)
            if cell.method == EXTRA_TREES:
                found[test] = extra_trees(train, real.take(test), seed)
            else:
                method = METHODS[cell.method]
                start = self.known(cell.repeat) if method.knows_simulation else None
                tuned = fine_tune(method.strategy, start, train, seed=1000 * seed + number)
                found[test] = labels_of(tuned, real.take(test))
        return found

    def known(self, repeat: int) -> EventNet:
        """The network of a repetition that learned from all simulated events; kept as safetensors."""
        if repeat not in self._known:
            from safetensors.torch import load_file, save_file

            path, seed = self.folder / f"pretrained_{repeat}.safetensors", self.options.seed + repeat
            if path.exists():
                net = random_network(len(self.real.classes), seed)
                try:
                    net.load_state_dict(load_file(path))
                except Exception as error:  # a damaged file may hold anything
                    reason = " ".join(str(error).split())[:200]
                    raise InputError(f"{path} holds no weights of this study ({reason}); remove it") from None
                self._known[repeat] = net.eval()
            else:
                net = pretrain(self.simulated, seed=seed)
                with replacing(path, lambda: None) as new:
                    save_file(net.state_dict(), new)
                self._known[repeat] = net
        return self._known[repeat]


def _hash(events: Events) -> str:
    found = hashlib.sha256(np.ascontiguousarray(events.levels).tobytes())
    found.update(events.labels.tobytes())
    return found.hexdigest()[:32]


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
        raise InputError(f"{folder} holds no transfer study; run the study first")
    try:
        about = json.loads((folder / "study.json").read_text(encoding="utf-8"))
        int(about["real_events"])
    except (ValueError, KeyError, TypeError, RecursionError, OverflowError):
        raise InputError(f"{folder / 'study.json'} is not what a study wrote there; run the study anew") from None
    gathered: dict[tuple[str, int | None, str], list[dict[str, Any]]] = {}
    for path in sorted((folder / "cells").glob("*.json")):
        cell = read_cell(path, partial(_sound, path, about["real_events"]))
        gathered.setdefault((cell["method"], cell["per_class"], cell["radars"]), []).append(cell)
    if not gathered:
        raise InputError(f"{folder} has no finished cell yet; run the study first")
    rows, labels = [], {}
    for (method, per_class, radars), found in gathered.items():
        truth, predicted = np.array(found[0]["truth"]), np.array([each["predicted"] for each in found])
        score, low, high = with_interval(truth, predicted, len(about["classes"]))
        rows.append(
            Row(method=method, per_class=per_class, radars=radars, score=score, low=low, high=high, repeats=len(found))
        )
        labels[f"{method}, {radars}, {per_class}"] = np.stack([np.broadcast_to(truth, predicted.shape), predicted])
    return rows, about, labels


def _sound(path: Path, events: int, told: dict[str, Any]) -> bool:
    named = Cell(**{each.name: told[each.name] for each in fields(Cell)}).name
    return named == path.stem and len(told["truth"]) == len(told["predicted"]) == events


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


def run_transfer(
    real: LabelledMaps, simulated: LabelledMaps, folder: str | Path, *, options: StudyOptions | None = None,
    sources: dict[str, str] | None = None, progress: Progress | None = None,
) -> str:  # fmt: skip
    """The study of Table IV, with its report, `report.md` and `curves.png`; a stopped run goes on in the same folder.

    real: maps of both radars of every event, as `read_real` gives them.
    simulated: maps of the same classes and axes, as `read_twins` gives them.
    sources: what the report says of the data.
    """
    target = file_path("the folder of a transfer study", folder)
    study = Study(Events.of(real), Events.of(simulated), target, options or StudyOptions())
    study.run(progress)
    text = report_text(target, sources)
    write_whole(target / "report.md", text)
    with replacing(target / "curves.png", lambda: None) as new:
        plot_curves(target).savefig(new, format="png", dpi=120)
    return text


def add_options(parser: ArgumentParser) -> None:
    add_real_options(parser)
    parser.add_argument(
        "-o", "--output", required=True, help="folder of report.md, curves.png and the cells; a stopped run goes on"
    )
    parser.add_argument("--repeats", type=int, default=3, help="repetitions of the cross-validation (default 3)")
    parser.add_argument("--folds", type=int, default=5, help="folds of whole events (default 5)")
    parser.add_argument("--seed", type=int, default=0)


def run(options: Namespace) -> str:
    real, simulated, recipe = real_and_twins(options)
    settings = StudyOptions(repeats=options.repeats, folds=options.folds, seed=options.seed)
    with ProgressBar("transfer") as progress:
        run_transfer(
            real.maps, simulated, options.output, options=settings, sources={"real": str(real), "simulated": recipe},
            progress=progress,
        )  # fmt: skip
    return f"wrote {Path(options.output) / 'report.md'} and {Path(options.output) / 'curves.png'}"
