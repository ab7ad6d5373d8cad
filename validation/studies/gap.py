"""Domain gap between simulated and real maps, before any training: distributions of what a radar engineer reads from a map, and
how well a classifier tells the two apart."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.dataset.products import edges
from t2d_rt.learn.maps import LabelledMaps, check_axes
from t2d_rt.signal.envelope import NOTCH_MPS, envelope
from validation.studies.common import add_real_options, real_and_twins, table, write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure


MEASURES = {
    "extent [m/s]": "95 % of the time the fastest parts are slower than that, either sign",
    "torso speed [m/s]": "95 % of the time the speed that halves the power is less than that",
    "cadence [Hz]": "strongest modulation of the extent from 0.6 to 4 Hz",
    "modulation": "part of the extent's variance within 0.25 Hz of the cadence",
    "peak [dB]": "greatest level above the median, which is noise",
    "occupied": "fraction of cells that are 6 dB above the median",
    "active [s]": "time with a cell so far above",
    "both signs": "power of the lesser side of zero over that of the greater",
}
"""What is measured of each map."""
MARGIN_DB = 6.0
CADENCE_HZ = 0.6, 4.0
WIDTH_HZ = 0.25
FOLDS, TREES = 5, 200
RESAMPLINGS = 1000
FEWEST = 10
"""Maps of a class on each side, to compare them."""
FAR = 0.5
"""Kolmogorov-Smirnov distance from which a difference is told in words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """A measure of one class, simulated and real."""

    measure: str
    simulated: tuple[float, float, float]
    """Quartiles."""
    real: tuple[float, float, float]
    distance: float
    """Kolmogorov-Smirnov: greatest difference of the distribution functions, 0..1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClassGap:
    """The gap of one class, or of all together."""

    name: str
    counts: tuple[int, int]
    """Simulated and real maps."""
    differences: tuple[Difference, ...]
    told_apart: tuple[float, float, float]
    """Balanced accuracy of the two-sample classifier and its 95 % interval over events; chance is 0.5."""

    @property
    def lacking(self) -> str:
        """What the simulation has too much or too little of, in words."""
        far = sorted((each for each in self.differences if each.distance >= FAR), key=lambda each: -each.distance)
        words = [
            f"{'too little' if each.simulated[1] < each.real[1] else 'too much'} {each.measure.split(' [')[0]} "
            f"({each.simulated[1]:.2g} against {each.real[1]:.2g})"
            for each in far
        ]
        return "; ".join(words) or f"no measure is {FAR:g} or more apart"


@dataclass(frozen=True, slots=True, kw_only=True)
class DomainGap:
    """The gap of each class and of all together."""

    classes: tuple[ClassGap, ...]

    def __str__(self) -> str:
        lines = [
            "# Domain gap: simulation against real recordings",
            "",
            table(["measure", "what it is"], [*MEASURES.items()]),
        ]
        for each in self.classes:
            low, middle, high = each.told_apart[1], each.told_apart[0], each.told_apart[2]
            lines += [
                "", f"## {each.name}", "", f"{each.counts[0]} simulated and {each.counts[1]} real maps. A classifier tells them "
                f"apart with a balanced accuracy of {middle:.2f} [{low:.2f}, {high:.2f}]; chance is 0.50.", "",
            ]  # fmt: skip
            rows = []
            for found in each.differences:
                quartiles = [" / ".join(f"{value:.3g}" for value in side) for side in (found.simulated, found.real)]
                rows.append((found.measure, *quartiles, f"{found.distance:.2f}"))
            head = "measure", "simulated: quartiles", "real: quartiles", "distance"
            lines += [table(head, rows), "", f"The simulation has: {each.lacking}."]
        return "\n".join([*lines, ""])


def domain_gap(simulated: LabelledMaps, real: LabelledMaps, *, seed: int = 0) -> DomainGap:
    """Compares maps of the same classes and axes, class by class and all together."""
    if simulated.classes != real.classes or simulated.size != real.size:
        raise InputError(
            f"simulated maps of {simulated.classes}, {simulated.size} cells, and real ones of {real.classes}, {real.size} cells, "
            "cannot be compared; bring them to the same classes and size"
        )
    check_axes(simulated, real)
    found = []
    values = [
        np.array([_measured(each, maps.velocity_mps, maps.duration_s) for each in maps.levels])
        for maps in (simulated, real)
    ]
    events = [_events(maps) for maps in (simulated, real)]
    for name in ("all classes", *real.classes):
        chosen = [
            np.flatnonzero(maps.labels == real.classes.index(name)) if name != "all classes" else np.arange(len(maps))
            for maps in (simulated, real)
        ]
        if min(len(each) for each in chosen) < FEWEST:
            raise InputError(
                f"class '{name}' has {len(chosen[0])} simulated and {len(chosen[1])} real maps; {FEWEST} of each are needed"
            )
        sides = [value[places] for value, places in zip(values, chosen, strict=True)]
        found.append(
            ClassGap(
                name=name,
                counts=(len(sides[0]), len(sides[1])),
                differences=tuple(
                    _difference(measure, sides[0][:, n], sides[1][:, n]) for n, measure in enumerate(MEASURES)
                ),
                told_apart=_told_apart(
                    sides, [each[places] for each, places in zip(events, chosen, strict=True)], seed
                ),
            )
        )
    return DomainGap(classes=tuple(found))


def _events(maps: LabelledMaps) -> np.ndarray:
    return maps.groups["event"] if "event" in maps.groups else np.array(maps.names)


def _measured(levels_db: np.ndarray, velocity_mps: np.ndarray, duration_s: float) -> list[float]:
    """The measures of a map (speed, time) [dB], in the order of `MEASURES`."""
    found = envelope(levels_db, velocity_mps)
    outer = np.maximum(found.upper_mps, -found.lower_mps)
    above = levels_db - np.median(levels_db)
    moving = np.abs(velocity_mps) >= NOTCH_MPS
    occupied = (above >= MARGIN_DB) & moving[:, None]
    power = np.where(occupied, 10.0 ** (above / 10.0), 0.0)
    sides = sorted(float(power[each].sum()) for each in (velocity_mps > 0, velocity_mps < 0))
    hz = np.fft.rfftfreq(4 * len(outer), duration_s / len(outer))
    spectrum = np.abs(np.fft.rfft((outer - outer.mean()) * np.hanning(len(outer)), 4 * len(outer))) ** 2
    steps = (hz >= CADENCE_HZ[0]) & (hz <= CADENCE_HZ[1])
    cadence_hz = float(hz[steps][np.argmax(spectrum[steps])])
    near = np.abs(hz - cadence_hz) <= WIDTH_HZ
    return [
        float(np.percentile(outer, 95)), float(np.percentile(np.abs(found.torso_mps), 95)), cadence_hz,
        float(spectrum[near].sum() / max(spectrum.sum(), 1e-12)), float(above.max()), float(occupied.mean()),
        float(occupied.any(axis=0).mean() * duration_s), sides[0] / max(sides[1], 1e-12),
    ]  # fmt: skip


def _difference(measure: str, simulated: np.ndarray, real: np.ndarray) -> Difference:
    from scipy.stats import ks_2samp

    first, second = (tuple(float(each) for each in np.percentile(side, [25, 50, 75])) for side in (simulated, real))
    return Difference(
        measure=measure, simulated=first, real=second, distance=float(ks_2samp(simulated, real).statistic)  # type: ignore[arg-type]
    )  # fmt: skip


def _told_apart(sides: list[np.ndarray], events: list[np.ndarray], seed: int) -> tuple[float, float, float]:
    """Balanced accuracy of extra trees on the measures, by folds of whole events, with its 95 % interval over events."""
    from sklearn.ensemble import ExtraTreesClassifier

    rng = np.random.default_rng(seed)
    values = np.concatenate(sides)
    truth = np.concatenate([np.full(len(side), number) for number, side in enumerate(sides)])
    group = np.unique(
        np.concatenate([np.char.add(f"{n} ", each) for n, each in enumerate(events)]), return_inverse=True
    )[1]
    origin = np.array([truth[group == each][0] for each in range(group.max() + 1)])
    fold = np.empty(len(origin), dtype=int)
    for side in (0, 1):
        members = rng.permutation(np.flatnonzero(origin == side))
        fold[members] = np.arange(len(members)) % FOLDS
    right = np.zeros(len(truth))
    for number in range(FOLDS):
        test = fold[group] == number
        if not test.any():
            continue
        trees = ExtraTreesClassifier(TREES, random_state=seed, class_weight="balanced", n_jobs=1)
        right[test] = trees.fit(values[~test], truth[~test]).predict(values[test]) == truth[test]
    by_event = np.bincount(group, right) / np.bincount(group)
    both = [np.flatnonzero(origin == side) for side in (0, 1)]
    drawn = [
        float(np.mean([by_event[rng.choice(each, len(each))].mean() for each in both])) for _ in range(RESAMPLINGS)
    ]
    low, high = np.percentile(drawn, [2.5, 97.5])
    return float(np.mean([by_event[each].mean() for each in both])), float(low), float(high)


def plot_gap(simulated: LabelledMaps, real: LabelledMaps, *, examples: int = 4) -> Figure:
    """Maps of each class, real above simulated, with the same axes and colours: dB above each map's median."""
    from t2d_rt.plots.canvas import blank_figure

    columns = 2 * examples
    lowest, highest = edges(real.velocity_mps)
    figure = blank_figure(1.5 * columns, 1.5 * len(real.classes))
    axes = figure.subplots(len(real.classes), columns, sharex=True, sharey=True, squeeze=False)
    for row, name in enumerate(real.classes):
        for side, maps in enumerate((real, simulated)):
            places = np.flatnonzero(maps.labels == row)
            chosen = places[np.linspace(0, len(places) - 1, examples).astype(int)]
            for column, place in enumerate(chosen):
                ax = axes[row, side * examples + column]
                levels = maps.levels[place]
                ax.imshow(
                    levels - np.median(levels), origin="lower", aspect="auto", vmin=0.0, vmax=20.0,
                    extent=(0.0, maps.duration_s, lowest, highest),
                )  # fmt: skip
                ax.set_title(f"{'simulated' if side else 'real'}: {name}", fontsize=7)
                ax.tick_params(labelsize=6)
    figure.supxlabel("time [s]", fontsize=8)
    figure.supylabel("speed [m/s]", fontsize=8)
    return figure


def add_options(parser: ArgumentParser) -> None:
    add_real_options(parser)
    parser.add_argument(
        "-o", "--output", required=True, help="text to write (.md); a picture of maps is written beside it (.png)"
    )


def run(options: Namespace) -> str:
    target = Path(options.output).with_suffix(".md")
    real, simulated, told = real_and_twins(options)
    write_whole(target, f"{domain_gap(simulated, real.maps)}\nReal: {real}\n\nSimulated: {told}\n")
    plot_gap(simulated, real.maps).savefig(target.with_suffix(".png"))
    return f"wrote {target} and {target.with_suffix('.png')}"
