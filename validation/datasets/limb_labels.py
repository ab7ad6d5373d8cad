"""Powers by limb, which data sets store as labels: they add up to their maps, and a small network learns which limb makes a cell.

`python -m validation.datasets.limb_labels DIR` evaluates a folder that is there.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from t2d_rt.dataset import Dataset, Recipe, make_dataset, split
from t2d_rt.dataset.products import resized
from t2d_rt.learn.pytorch import torch_threads
from t2d_rt.plots.parts import HUES
from t2d_rt.recording.parts import GROUPS
from t2d_rt.types import Radar
from validation.report import Check, Section, at_least, at_most, new_figure, save_chart

SAMPLES, SUMMED = 240, 40
SUM_DB = -40.0
"""Greatest energy of the difference between the labels' sum and the map, relative to that of the map."""
LIMBS = tuple(GROUPS)
FAINTEST_DB = -40.0
"""Weaker cells, relative to the greatest one, are left out, as are those of which the limbs together have less than a half."""
SHOWN_DB = 50.0
SEEDS = 0, 1
EPOCHS, BATCH, RATE, DECAY = 25, 4, 3e-3, 1e-2
LEVELS = 12
"""Levels that the baseline by speed and level tells apart."""
CHANCE = 1 / len(LIMBS)
ABOVE_CHANCE, ABOVE_SPEED = 0.3, 0.1
"""By how much the mean recall of the limbs is to exceed 1 / 6, and that by speed alone."""


def recipe() -> Recipe:
    """Three seconds of each class, three quarters by ellipsoids and the rest by the mesh."""
    return Recipe(
        name="limbs", descriptions_per_class=10, samples_per_description=4, attempts=2, duration_s=3.0,
        radar=Radar.preset("table2", samples=64, prf_hz=6400.0),
        conditions=[{"name": "ellipsoids", "method": "ellipsoid", "weight": 3}, {"name": "mesh", "method": "mesh"}],
        products={"spectrogram": {"size": [64, 64], "speed_mps": 5.0}, "parts": {"size": [32, 32]}}, samples_per_shard=20,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Cells:
    """Maps and the limb that is strongest in each coarse cell."""

    levels: np.ndarray
    """1 at the greatest cell and 0 so far below as `SHOWN_DB` says, float32 (sample, speed, time)."""
    limb: np.ndarray
    """Number of the limb, (sample, speed, time); -1 where none is told."""

    @classmethod
    def of(cls, data: Dataset) -> Cells:
        """Those of a data set with parts by segment."""
        levels = np.stack([data.values(place, "spectrogram") for place in range(len(data))])
        parts = np.stack([data.values(place, "parts") for place in range(len(data))])
        whole, limbs = parts.sum(axis=1), parts[:, : len(LIMBS)]
        told = (whole > 10.0 ** (FAINTEST_DB / 10.0)) & (limbs.sum(axis=1) > 0.5 * whole)
        return cls(np.clip(1 + levels / SHOWN_DB, 0, 1), np.where(told, limbs.argmax(axis=1), -1))

    def take(self, places: np.ndarray) -> Cells:
        """Some of the samples."""
        return Cells(self.levels[places], self.limb[places])

    @property
    def coarse(self) -> np.ndarray:
        """Levels in the cells of the labels, by averages of power, 0..1."""
        power = 10.0 ** (SHOWN_DB / 10.0 * (self.levels.astype(np.float64) - 1))
        size = self.limb.shape[1:]
        return np.clip(1 + 10.0 / SHOWN_DB * np.log10([resized(each, size) for each in power]), 0, 1)

    def steps(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Number of the row and of the level's step of each coarse cell, (sample, speed, time)."""
        row = np.broadcast_to(np.arange(self.limb.shape[1])[:, None], self.limb.shape)
        return row, np.minimum((self.coarse * count).astype(int), count - 1)

    @property
    def weights(self) -> np.ndarray:
        """One over how often each limb comes, (limb,), so that all count alike."""
        return 1.0 / np.maximum(1, np.bincount(self.limb[self.limb >= 0], minlength=len(LIMBS)))


def by_table(train: Cells, test: Cells, *, levels: int) -> np.ndarray:
    """The limb that is likeliest at the speed of a cell, and at its level in so many steps, all limbs counted alike."""

    counted = np.full((train.limb.shape[1], levels, len(LIMBS)), 1e-6)
    told = train.limb >= 0
    rows, columns = train.steps(levels)
    np.add.at(counted, (rows[told], columns[told], train.limb[told]), 1.0)
    return np.asarray((counted * train.weights).argmax(axis=-1)[test.steps(levels)])


def _block(before: int, after: int) -> nn.Sequential:
    layers = [nn.Conv2d(before, after, 3, padding=1), nn.BatchNorm2d(after), nn.ReLU()]
    return nn.Sequential(*layers, nn.Conv2d(after, after, 3, padding=1), nn.BatchNorm2d(after), nn.ReLU())


class UNet(nn.Module):  # type: ignore[misc]
    """From levels and speeds (N, 2, 64, 64) to scores of the limbs in the coarse cells (N, 6, 32, 32), over four scales."""

    def __init__(self) -> None:
        super().__init__()
        self.fine, self.coarse, self.deep, self.deepest = _block(2, 8), _block(8, 16), _block(16, 32), _block(32, 32)
        self.up, self.out = _block(64, 32), _block(48, 16)
        self.halved, self.doubled = nn.MaxPool2d(2), nn.Upsample(scale_factor=2, mode="bilinear", align_corners=False)
        self.scores = nn.Conv2d(16, len(LIMBS), 1)

    def forward(self, maps: torch.Tensor) -> torch.Tensor:
        """Scores, of which the greatest is the limb that is said to be strongest."""
        coarse = self.coarse(self.halved(self.fine(maps)))
        deep = self.deep(self.halved(coarse))
        up = self.up(torch.cat([deep, self.doubled(self.deepest(self.halved(deep)))], dim=1))
        found: torch.Tensor = self.scores(self.out(torch.cat([coarse, self.doubled(up)], dim=1)))
        return found


def inputs(cells: Cells) -> torch.Tensor:
    """Levels and the speed of each row, -1..1."""
    rows = np.linspace(-1, 1, cells.levels.shape[1], dtype=np.float32)[:, None]
    return torch.from_numpy(
        np.stack([cells.levels, np.broadcast_to(rows, cells.levels.shape)], axis=1).astype(np.float32)
    )


def trained(train: Cells, seed: int) -> UNet:
    """The network after `EPOCHS` of maps that are shifted in time by chance, its ends joined."""
    torch.manual_seed(seed)
    rng, model = np.random.default_rng(seed), UNet()
    maps, limbs = inputs(train), torch.from_numpy(train.limb)
    weights = torch.from_numpy((train.weights / train.weights.mean()).astype(np.float32))
    loss = torch.nn.CrossEntropyLoss(weight=weights, ignore_index=-1)
    optimiser = torch.optim.AdamW(model.parameters(), lr=RATE, weight_decay=DECAY)
    steps = -(-len(maps) // BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, total_steps=EPOCHS * steps)
    for _ in range(EPOCHS):
        for some in np.array_split(rng.permutation(len(maps)), steps):
            shift = int(rng.integers(limbs.shape[-1]))
            coarse, fine = torch.roll(limbs[some], shift, -1), torch.roll(maps[some], 2 * shift, -1)
            optimiser.zero_grad()
            loss(model(fine), coarse).backward()
            optimiser.step()
            schedule.step()
    return model.eval()


def confusion(limb: np.ndarray, said: np.ndarray) -> np.ndarray:
    """How many cells of each limb (row) are taken for each."""
    told, found = limb >= 0, np.zeros((len(LIMBS),) * 2, np.int64)
    np.add.at(found, (limb[told], said[told]), 1)
    return found


def recalls(found: np.ndarray) -> np.ndarray:
    """The fraction of each limb's cells that is right."""
    return np.asarray(np.diag(found) / np.maximum(found.sum(axis=1), 1))


def overlaps(found: np.ndarray) -> np.ndarray:
    """Intersection over union of each limb."""
    right = np.diag(found)
    return np.asarray(right / np.maximum(found.sum(axis=0) + found.sum(axis=1) - right, 1))


def sums_db(data: Dataset) -> dict[str, float]:
    """The worst of the first samples by method: energy of the labels' sum less the map, relative to that of the map [dB]."""
    worst: dict[str, float] = {}
    for place, record in enumerate(data.records[:SUMMED]):
        total = data.values(place, "parts").sum(axis=0, dtype=np.float64)
        power = resized(
            10.0 ** (data.values(place, "spectrogram").astype(np.float64) / 10.0), (total.shape[0], total.shape[1])
        )
        found = float(10 * np.log10(np.sum((total - power) ** 2) / np.sum(power**2)))
        worst[record["condition"]] = max(worst.get(record["condition"], -np.inf), found)
    return worst


METHODS = "network", "the network on the mesh", "speed and level", "speed", "most frequent limb"


def _confusions(data: Dataset, cells: Cells, seed: int) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Confusions of one split by method, the places of the test and what the network says there."""
    sides = split(data.records, (0.7, 0.3), apart=("description", "seed"), seed=seed).sides
    mesh = np.array([each["condition"] == "mesh" for each in data.records])
    learnt, asked = (data.positions(sides[name]) for name in ("train", "test"))
    train, test = cells.take(learnt[~mesh[learnt]]), cells.take(asked)
    model = trained(train, seed)
    with torch.no_grad():
        said = model(inputs(test)).argmax(dim=1).numpy()
    coarse = ~mesh[asked]
    frequent = np.full_like(test.limb, train.weights.argmin())
    found = {
        "network": confusion(test.limb[coarse], said[coarse]),
        "the network on the mesh": confusion(test.limb[~coarse], said[~coarse]),
    }
    for name, guess in (
        ("speed and level", by_table(train, test, levels=LEVELS)), ("speed", by_table(train, test, levels=1)),
        ("most frequent limb", frequent),
    ):  # fmt: skip
        found[name] = confusion(test.limb[coarse], guess[coarse])
    return found, asked, said


def evaluated(data: Dataset) -> Section:
    """The section for a data set."""
    cells = Cells.of(data)
    with torch_threads(1):
        told = [_confusions(data, cells, seed) for seed in SEEDS]
    mean = {name: [recalls(found[name]).mean() for found, *_ in told] for name in METHODS}
    rows = []
    for name in METHODS:
        recall, overlap = (np.array([of(found[name]) for found, *_ in told]) for of in (recalls, overlaps))
        row: dict[str, Any] = {"by": name, "mean recall": f"{recall.mean():.2f}", "mean IoU": f"{overlap.mean():.2f}"}
        rows.append(
            row
            | {limb: f"{r:.2f} / {i:.2f}" for limb, r, i in zip(LIMBS, recall.mean(0), overlap.mean(0), strict=True)}
        )
    return Section(
        title="Limbs as labels of spectrograms",
        checks=_checks(sums_db(data), mean),
        note=f"{len(data)} samples of 3 s, eight classes of ten descriptions, every sample another person and view; maps of 64 x "
        "64 cells, labels of 32 x 32. The limb with the greatest power in a cell is to be told from the map alone, in cells "
        f"within {-FAINTEST_DB:g} dB of the greatest of which limbs have a half or more. A U-Net is trained on the ellipsoids of "
        f"70 % of the descriptions and tested on those of the others, by {len(SEEDS)} splits of their own seeds; by the mesh on "
        f"the mesh samples of these. Mean recall by chance: {CHANCE:.3f}. Tables count all limbs alike, as the "
        f"network does. Mean recalls of the seeds: {', '.join(f'{each:.3f}' for each in mean['network'])} by the network, "
        f"{', '.join(f'{each:.3f}' for each in mean['speed'])} by speed. Cells by limb: {_counts(cells)}. Columns of limbs: "
        "recall / IoU. Figure: map, labels and network in the test of the first seed.",
        table=rows, charts=[_chart(data, cells, *told[0][1:])],
    )  # fmt: skip


def _checks(sums: dict[str, float], mean: dict[str, list[float]]) -> list[Check]:
    """The sums of the labels and the recall of the network against their limits."""
    least, lead = min(mean["network"]), float(np.min(np.subtract(mean["network"], mean["speed"])))
    what = f"sum of the labels of {SUMMED} samples against the map, worst by "
    found = [at_most(what + name, db, SUM_DB, "dB") for name, db in sorted(sums.items())]
    asked = (
        ("mean recall of the limbs by the network, least of the seeds", float(least), CHANCE + ABOVE_CHANCE),
        ("the same less that by speed alone, least of the seeds", lead, ABOVE_SPEED),
    )
    return found + [at_least(each, is_, limit) for each, is_, limit in asked]


def _counts(cells: Cells) -> str:
    counts = np.bincount(cells.limb[cells.limb >= 0], minlength=len(LIMBS))
    return ", ".join(f"{limb} {count / counts.sum():.0%}" for limb, count in zip(LIMBS, counts, strict=True))


def _chart(data: Dataset, cells: Cells, places: np.ndarray, said: np.ndarray) -> str:
    """Map, labels and what the network says of a few samples of the test."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    wanted = ("walking", "running", "falling", "jumping")
    chosen = [next((k for k, p in enumerate(places) if data.records[p]["class"] == each), 0) for each in wanted]
    figure, axes = new_figure(nrows=3, ncols=len(chosen), figsize=(11, 7), sharex=True, sharey=True)
    colours = ListedColormap(HUES[: len(LIMBS)])
    for column, place in enumerate(chosen):
        record = data.records[places[place]]
        edges = record["products"]["spectrogram"]
        limb = cells.limb[places[place]]
        shown = {
            "origin": "lower",
            "aspect": "auto",
            "extent": (*edges["time_s"], *edges["velocity_mps"]),
            "interpolation": "none",
        }
        axes[0, column].imshow(cells.levels[places[place]], vmin=0, vmax=1, **shown)
        for row, values in ((1, limb), (2, said[place])):
            hidden = np.ma.masked_where(limb < 0, values)
            axes[row, column].imshow(hidden, cmap=colours, vmin=-0.5, vmax=len(LIMBS) - 0.5, **shown)
        axes[0, column].set_title(f"{record['class']}, {record['condition']}", fontsize=9)
    for row, name in enumerate(("map", "labels", "network")):
        axes[row, 0].set_ylabel(f"{name}\nSpeed [m/s]", fontsize=9)
    figure.supxlabel("Time [s]", fontsize=9)
    handles = [Patch(color=colours(number), label=limb) for number, limb in enumerate(LIMBS)]
    figure.legend(handles=handles, loc="outside right upper", fontsize=8)
    return save_chart(figure, "limb_labels.png")


def run() -> Section:
    """The section, of a set that is made for it."""
    with tempfile.TemporaryDirectory() as folder:
        make_dataset(recipe(), Path(folder) / "limbs", limit=SAMPLES)
        return evaluated(Dataset(Path(folder) / "limbs"))


if __name__ == "__main__":
    section = evaluated(Dataset(sys.argv[1]))
    print(*section.checks, section.note, *section.table, sep="\n")
