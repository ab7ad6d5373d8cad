"""The learned background beside held-out recordings, uniform codes and Gaussian noise: simulated rooms, and measured maps."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from t2d_rt.core.constants import decibel
from t2d_rt.dataset.background_records import empty_room_record
from t2d_rt.noise.background import BackgroundModel, BackgroundRecord, Grid, load_background
from t2d_rt.noise.background.evaluate import Distances, distances, evaluation, gaussian_noise
from t2d_rt.noise.background.training import learn_background
from validation.report import Check, Section, at_least, at_most, new_figure, save_chart

HELD_OUT = range(36, 48)
"""Seeds of rooms that the default model has not seen: it is learned from 0 to 35."""
DURATION_S = 5.0
LEAST_PERPLEXITY = 25.0
"""Of the code books [%]."""
SEED = 100
MEASURED = "T2D_PARRAD"
"""Environment variable that names a file of measured micro-Doppler maps: those of imec's PARrad set 1, as arrays wr14 and wr68."""
ROW_S = 0.09
MAPS = "wr14", "wr68"
"""Maps of two 77 GHz radars in one room."""
BIN_MPS = 0.0625
"""A Doppler bin; the set does not tell it, and nothing here depends on it."""
FAR = np.r_[5:35, 95:123]
"""Doppler bins far from zero: noise."""
MOVING = np.r_[40:60, 69:89]
"""Bins in which persons show."""
QUIET, SMOOTHED, SHORTEST, SPLIT = 30.0, 5, 40, 2600
"""A row is empty where the mean of the moving bins, over 5 rows, is less than 30 units above its median (a person is above 100);
stretches have 40 rows or more; those from row 2600 on are held out, of both radars."""
ONE_LOOK_DB = 10 / math.log(10) * math.pi / math.sqrt(6)
"""Standard deviation of the level of an exponentially distributed power: 5.57 dB."""
COLUMNS = "recorded", "prior", "uniform codes", "Gaussian noise"
LIMITS_DB = (-3.0, 20.0)
ROOMS_SHOWN, STRETCHES_SHOWN = (1, 4, 5), (1, 2)


def run() -> Section:
    rooms = _rooms()
    checks, rows = _judged("rooms", load_background(), rooms)
    charts = [_chart("background_rooms.png", load_background(), rooms, ROOMS_SHOWN)]
    note = ""
    source = os.environ.get(MEASURED)
    if source:
        trained, held_out, cells = measured(Path(source))
        model = learn_background(trained, codes=16, heads=4)
        more, measured_rows = _judged("measured", model, held_out)
        checks += more
        rows += measured_rows
        charts.append(_chart("background_measured.png", model, held_out, STRETCHES_SHOWN))
        note = (
            f" Measured: stretches of imec's PARrad set 1 in which nobody moves (not shipped), {len(trained)} to train on, "
            f"{len(held_out)} later ones held out. Their units are sums of levels over range cells: the noise spreads as that of "
            f"{cells:.0f} independent looks would, and its skewness is theirs, too; the maps are divided by that number."
        )
    return Section(
        title="Background",
        checks=checks,
        note="Distances from held-out recordings, 0 is best; of the classifier's accuracy 0.5, which two halves of the recordings "
        "reach by chance. Profile: root mean square difference of the mean levels of the Doppler bins. Profiles: "
        "Wasserstein-1 distance of the mean levels of a bin in patches of 32 columns, mean over the bins; a set whose patches all "
        "show the mean has a good profile and poor profiles. Levels: Wasserstein-1 distance of the "
        "levels of cells, mean over Doppler bands. Autocorrelation: root mean square difference of that of the levels in time. "
        "Classifier: logistic regression on mean, spread and correlation of 32 Doppler bands in patches of 32 columns, tried on "
        f"records that it has not seen. Rooms: {len(HELD_OUT)} rooms of other seeds than those that the default model is learned "
        "from; Gaussian noise has the mean power of the recordings." + note,
        table=rows,
        charts=charts,
    )  # fmt: skip


def _rooms() -> list[BackgroundRecord]:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:  # the kernels' memory goes with the process
        return list(pool.map(partial(empty_room_record, duration_s=DURATION_S), HELD_OUT))


def measured(path: Path) -> tuple[list[BackgroundRecord], list[BackgroundRecord], float]:
    """Empty stretches to train on and held out, and how many independent looks a cell of the maps sums the levels of."""
    trained: list[BackgroundRecord] = []
    held_out: list[BackgroundRecord] = []
    looks = []
    with np.load(path, allow_pickle=False) as file:
        maps = {name: file[name].astype(np.float64) for name in MAPS}
    for name, units in maps.items():
        cells = (units[:, FAR].std(axis=0).mean() / ONE_LOOK_DB) ** 2
        looks.append(cells)
        speeds = BIN_MPS * (np.arange(units.shape[1]) - units.shape[1] // 2)
        for start, stop in stretches(units):
            power = 10 ** (units[start:stop].T / cells / 10)
            record = BackgroundRecord.of(
                f"{name}_{start}", power, Grid.of(speeds, ROW_S), carrier_hz=77e9, calibrated=False
            )
            (held_out if start >= SPLIT else trained).append(record)
    return trained, held_out, float(np.mean(looks))


def stretches(units: np.ndarray) -> list[tuple[int, int]]:
    """First row, and the one after the last, of each stretch of a map (row, bin) in which nobody moves."""
    excess = (units[:, MOVING] - np.median(units[:, MOVING], axis=0)).mean(axis=1)
    loud = np.convolve(excess, np.ones(SMOOTHED) / SMOOTHED, "same") > QUIET
    near = np.convolve(loud, np.ones(SMOOTHED), "same") > 0
    edges = np.flatnonzero(np.diff(np.r_[True, near, True].astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= SHORTEST]


def _judged(what: str, model: BackgroundModel, held_out: Sequence[BackgroundRecord]) -> tuple[list[Check], list[dict]]:
    found = evaluation(model, held_out, seed=SEED)
    (prior, used), others = found["prior"], [found[name][0] for name in ("uniform codes", "Gaussian noise")]
    checks = []
    for name, unit in (
        ("profile_db", "dB"),
        ("profiles_db", "dB"),
        ("levels_db", "dB"),
        ("autocorrelation", ""),
        ("classifier", ""),
    ):
        limit = min(_distance(name, each) for each in others)
        told = (
            "accuracy of the classifier from 0.5" if name == "classifier" else f"distance, {name.removesuffix('_db')}"
        )
        checks.append(at_most(f"{what}: {told}, below both others", _distance(name, prior), limit, unit))
    assert used is not None
    codes = model.architecture.codes
    checks.append(
        at_least(f"{what}: perplexity, of the code books' size", 100 * used / codes, LEAST_PERPLEXITY, "%")
    )  # fmt: skip
    halves = [each.relative_db for each in held_out]
    rows = (
        [_row(what, "recorded, half and half", distances(halves[::2], halves[1::2]), None)] if len(halves) > 7 else []
    )
    return checks, rows + [_row(what, name, *each) for name, each in found.items()]


def _distance(name: str, found: Distances) -> float:
    value = float(getattr(found, name))
    return abs(value - 0.5) if name == "classifier" else value


def _row(what: str, name: str, found: Distances, used: float | None) -> dict:
    return {
        "": what, "set": name, "profile [dB]": found.profile_db, "profiles [dB]": found.profiles_db, "levels [dB]": found.levels_db,
        "autocorrelation": found.autocorrelation, "classifier": found.classifier,
        "perplexity": "" if used is None else round(used, 1),
    }  # fmt: skip


def _chart(name: str, model: BackgroundModel, held_out: Sequence[BackgroundRecord], shown: Sequence[int]) -> str:
    figure, axes = new_figure(
        figsize=(13, 2.4 * len(shown) + 0.6),
        nrows=len(shown),
        ncols=len(COLUMNS),
        sharex=True,
        sharey=True,
        squeeze=False,
    )
    for row, index in zip(axes, shown, strict=True):
        level = held_out[index].relative_db
        prior, uniform = (
            decibel(model.columns(level.shape[1], seed=SEED + index, codes=each).power.astype(np.float64))
            for each in ("prior", "uniform")
        )
        noise = gaussian_noise([each.relative_db for each in held_out], np.random.default_rng(index))[index]
        speeds, step_s = model.grid.velocity_mps, model.grid.time_step_s
        for ax, title, image in zip(row, COLUMNS, (level, prior, uniform, noise), strict=True):
            drawn = ax.imshow(
                image, origin="lower", aspect="auto", vmin=LIMITS_DB[0], vmax=LIMITS_DB[1], interpolation="nearest",
                extent=(0, step_s * image.shape[1], speeds[0], speeds[-1]),
            )  # fmt: skip
            ax.set_title(f"{held_out[index].name}" if title == "recorded" else title, fontsize=9)
        row[0].set_ylabel("Speed [m/s]")
    for ax in axes[-1]:
        ax.set_xlabel("Time [s]")
    figure.colorbar(drawn, ax=axes, label="Power rel. to noise floor [dB]")
    return save_chart(figure, name)
