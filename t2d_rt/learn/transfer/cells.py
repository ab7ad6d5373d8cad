"""The cells of a transfer study: each a method, a number of real events and a repetition; kept as JSON, to go on from."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.atomic_write import replacing
from t2d_rt.core.checks import integer
from t2d_rt.core.errors import InputError
from t2d_rt.learn.threads import torch_threads
from t2d_rt.learn.transfer.classical import extra_trees
from t2d_rt.learn.transfer.events import Events
from t2d_rt.learn.transfer.methods import METHODS, EventNet, network, predicted, pretrained, tuned_labels
from t2d_rt.learn.transfer.scores import at_most, grouped_folds

TREES, ZERO_SHOT = "extra trees", "zero-shot"
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
            yield Cell(method=TREES, per_class=None, radars=radar, repeat=repeat)
        yield Cell(method=ZERO_SHOT, per_class=0, radars="both", repeat=repeat)
        for per_class in EVENTS_PER_CLASS[:-1]:
            yield Cell(method=TREES, per_class=per_class, radars="both", repeat=repeat)
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
            with replacing(path, lambda: None) as new:
                new.write_text(text, encoding="utf-8")

    def run(self, progress: Callable[[float], None] | None = None) -> None:
        """Computes the cells that are not there yet."""
        self.prepared()
        every = list(cells(self.real.radars, self.options))
        for number, cell in enumerate(every, 1):
            path = self.folder / "cells" / f"{cell.name}.json"
            if not path.exists():
                with torch_threads(1):
                    said = self.labels(cell).tolist()
                found = {**asdict(cell), "truth": self.real.labels.tolist(), "predicted": said}
                with replacing(path, lambda: None) as new:
                    new.write_text(json.dumps(found), encoding="utf-8")
            if progress is not None:
                progress(number / len(every))

    def labels(self, cell: Cell) -> np.ndarray:
        """The label that a cell gives each real event, (E,)."""
        seed = self.options.seed + cell.repeat
        real = self.real if cell.radars == "both" else self.real.seen_by(cell.radars)
        if cell.method == ZERO_SHOT:
            import torch

            return predicted(self.known(cell.repeat), torch.from_numpy(real.inputs))
        fold = grouped_folds(real.labels, self.options.folds, seed)
        found = np.zeros(len(real), dtype=np.int64)
        for number in range(self.options.folds):
            test = np.flatnonzero(fold == number)
            chosen = at_most(real.labels, np.flatnonzero(fold != number), cell.per_class, 1000 * seed + number)
            train = real.take(chosen)
            if cell.method == TREES:
                found[test] = extra_trees(train, real.take(test), seed)
            else:
                found[test] = tuned_labels(
                    cell.method, self.known(cell.repeat), train, real.take(test), 1000 * seed + number
                )
        return found

    def known(self, repeat: int) -> EventNet:
        """The network of a repetition that learned from all simulated events; kept as safetensors."""
        if repeat not in self._known:
            from safetensors.torch import load_file, save_file

            path, seed = self.folder / f"pretrained_{repeat}.safetensors", self.options.seed + repeat
            if path.exists():
                net = network(len(self.real.classes), seed)
                try:
                    net.load_state_dict(load_file(path))
                except Exception as error:  # a damaged file may hold anything
                    reason = " ".join(str(error).split())[:200]
                    raise InputError(f"{path} holds no weights of this study ({reason}); remove it") from None
                self._known[repeat] = net.eval()
            else:
                net = pretrained(self.simulated, seed)
                with replacing(path, lambda: None) as new:
                    save_file(net.state_dict(), new)
                self._known[repeat] = net
        return self._known[repeat]


def _hash(events: Events) -> str:
    found = hashlib.sha256(np.ascontiguousarray(events.levels).tobytes())
    found.update(events.labels.tobytes())
    return found.hexdigest()[:32]
