"""Simulated twins of a recorded set: its radar, rows and Doppler bins, two radars in one room, its activities.

The twin of PARrad: 128 chirps at the start of every 0.09 s, a range-Doppler map of Hann windows, and decibels averaged over its 64
range cells (see `adapters.parrad`, which says what of this is told by the set and what is estimated). The carrier is
77 GHz. Doppler bin, range cell, gain and places of the radars are not known: they are drawn for each twin between limits.
"""

from __future__ import annotations

import json
import warnings
from argparse import ArgumentParser, Namespace
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.atomic_write import replacing
from t2d_rt.core.checks import array, file_path, integer
from t2d_rt.core.constants import SPEED_OF_LIGHT, decibel
from t2d_rt.core.errors import InputError, T2DError, T2DWarning
from t2d_rt.core.files import read_bytes
from t2d_rt.core.progress import ProgressBar
from t2d_rt.learn.adapters.parrad import BIN_MPS, BINS, RADARS, RANGE_CELLS, ROW_S, ROWS, ZERO_BIN, notched
from t2d_rt.learn.maps import DYNAMIC_RANGE_DB, LabelledMaps, check_varied
from t2d_rt.motion import aside, place, trim
from t2d_rt.motion.generate import motion_from_text, understood
from t2d_rt.motion.vary import hold
from t2d_rt.radar.synthesize import Progress
from t2d_rt.simulate import simulate
from t2d_rt.types import Motion, Radar, Receiver
from t2d_rt.types.ellipsoids import Method
from validation.studies.common import made_folder

SENTENCES: Mapping[str, tuple[str, ...]] = {
    "walk": (
        "a person walks forward", "a person walks slowly forward", "a person walks quickly forward",
        "a person walks forward and turns around",
    ),
    "sit down": (
        "a person sits down on a chair", "a person sits down on a bed", "a person turns around and sits down on a chair",
    ),
    "stand up": (
        "a person stands up from a chair", "a person stands up from a bed", "a person stands up from a chair and turns around",
    ),
    "fall": (
        "a person stands still and collapses to the floor", "a person falls down on the floor",
        "a person walks forward, slips and falls", "a person trips and falls forward",
    ),
    "get up": ("a person gets up from the floor", "a person stands up from the floor"),
}  # fmt: skip
"""What is asked for in each class. The eight classes of the data sets have neither standing up nor getting up."""
MERGED = {label: "sit or stand" if label in ("sit down", "stand up") else label for label in SENTENCES}
"""Class of each label where sitting down and standing up are one."""
CENTRE_M = 2.5
"""Middle of the room, along the first radar's boresight."""
HALF_ROOM_M = 2.1, 1.8
"""How far from there joints may go, along and across [m]."""
NEAREST_M = 0.8
"""Of a joint to a radar, horizontally."""
PLACES, ATTEMPTS = 200, 40
SPAN_S = ROWS * ROW_S
STEP_S = 0.25
MOST_RECORDS = 1_000_000
"""Of a recipe: recordings of two seeds have no noise in common."""
RECIPE, FILES = "twins.json", "[0-9]*.npz"
"""Of a folder: what its twins follow from, and the twins."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TwinRecipe:
    """What the twins of PARrad follow from."""

    per_class: int = 60
    seed: int = 0
    scene: str = "empty_room"
    """Or "free_space"; walls answer with one reflection, static echoes are left out, as the notch takes them away."""
    method: Method = "ellipsoid"
    classes: tuple[str, ...] = tuple(SENTENCES)
    bin_mps: tuple[float, float] = (0.8 * BIN_MPS, 1.25 * BIN_MPS)
    """Between which the Doppler bin is drawn [m/s]."""
    range_cell_m: tuple[float, float] = (0.08, 0.15)
    """Between which the range cell is drawn [m]."""
    gain_db: tuple[float, float] = (5.0, 30.0)
    """Between which the gain of antennas and of their number is drawn, beyond one antenna of 9 dBi [dB]."""
    bearing_deg: tuple[float, float] = (-120.0, 120.0)
    """Between which the second radar stands, seen from the room's middle; the first stands at 180."""

    def __post_init__(self) -> None:
        integer("per_class", self.per_class, 1, 100_000)
        integer("seed", self.seed, 0)
        for name in self.classes:
            if name not in SENTENCES:
                raise InputError(f"twins have no class '{name}'; choose from {', '.join(SENTENCES)}")

    @property
    def count(self) -> int:
        """Twins in all; each is seen by two radars."""
        return self.per_class * len(self.classes)


@dataclass(frozen=True, slots=True, kw_only=True)
class Twin:
    """One simulated event as both radars see it."""

    label: str
    levels_db: np.ndarray
    """(radar, row, bin): mean over ranges [dB re 1 W]."""
    told: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Staged:
    """One event before it is simulated."""

    label: str
    sentence: str
    motion: Motion
    """In its place in the room."""
    radars: tuple[Radar, Radar]


def staged(recipe: TwinRecipe, index: int) -> Staged:
    """Motion and radars of an index; the same for all scenes and methods."""
    label = recipe.classes[index % len(recipe.classes)]
    failure: T2DError | None = None
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng((recipe.seed, index, attempt))
        sentence = str(rng.choice(SENTENCES[label]))
        try:
            motion = _spanned(_made(label, sentence, rng), label)
        except T2DError as error:  # of falls, some do not come to one
            failure = error
            continue
        radars = _radars(recipe, rng)
        placed = _placed(motion, radars, rng)
        if placed is not None:
            return Staged(label=label, sentence=sentence, motion=placed, radars=radars)
    raise failure or InputError(
        f"twin {index} ({label}) finds no place in the room in {ATTEMPTS} attempts; take another seed"
    )


def noise_seed(recipe: TwinRecipe, index: int, radar: int) -> int:
    """Of the recording of one radar."""
    return MOST_RECORDS * recipe.seed + 2 * index + radar


def twin(recipe: TwinRecipe, index: int) -> Twin:
    """The event of an index: a pure function of both."""
    found = staged(recipe, index)
    levels = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", T2DWarning)
        for number, radar in enumerate(found.radars):
            recording = simulate(
                found.motion, radar=radar, scene=recipe.scene, method=recipe.method, noise=Receiver(), reflections=1,
                clutter="none", seed=noise_seed(recipe, index, number), progress=False,
            )  # fmt: skip
            levels.append(range_mean_levels(np.asarray(recording.adc.values)[:, 0]))
    first, second = found.radars
    told = {
        "sentence": found.sentence, "slope_hz_per_s": first.slope_hz_per_s, "prf_hz": first.prf_hz,
        "gain_db": first.rx_gain_dbi - 9.0,
        "second_m": list(second.position_m),
    }  # fmt: skip
    return Twin(label=found.label, levels_db=np.stack(levels), told=told)


def range_mean_levels(chirps: np.ndarray) -> np.ndarray:
    """Rows of an ADC cube (chirp, sample): of each burst of 128 the mean over ranges of the range-Doppler map [dB], (row, bin).

    Approaching is positive, as everywhere in this package: an approaching target has a negative Doppler frequency at IF.
    """
    bursts = chirps[: len(chirps) // BINS * BINS].reshape(-1, BINS, RANGE_CELLS)
    window = np.hanning(BINS + 2)[1:-1, None] * np.hanning(RANGE_CELLS + 2)[1:-1]
    spectrum = np.fft.fft2(bursts * window, axes=(1, 2))
    levels = decibel(np.abs(spectrum) ** 2).mean(axis=2)
    # Bin k of the transform is the Doppler frequency k; its speed has the other sign, so k becomes -k.
    return np.asarray(np.roll(levels[:, ::-1], 1 + ZERO_BIN, axis=1), dtype=np.float32)


def _made(label: str, sentence: str, rng: np.random.Generator) -> Motion:
    duration_s = round(float(rng.uniform(2.0, 4.5)), 2) if label == "walk" and "turns" not in sentence else None
    return motion_from_text(understood(sentence)[0], seed=int(rng.integers(2**31)), duration_s=duration_s)


def _spanned(motion: Motion, label: str) -> Motion:
    """Held or cut to the span of a map: sitting ends the map, standing up begins it, of others the liveliest piece."""
    lacking_s = SPAN_S - motion.duration_s
    if lacking_s > 0:
        return trim(hold(motion, lacking_s + 2.0 / motion.rate_hz), 0.0, SPAN_S)
    if label == "sit down":
        return trim(motion, -lacking_s, motion.duration_s)
    if label == "stand up":
        return trim(motion, 0.0, SPAN_S)
    speeds = np.diff(motion.joints, axis=0) * motion.rate_hz
    total = np.concatenate([[0.0], np.cumsum((speeds**2).sum(axis=(1, 2)))])
    starts_s = np.arange(0.0, 1e-9 - lacking_s, STEP_S)
    first = np.round(starts_s * motion.rate_hz).astype(int)
    last = np.minimum(first + round(SPAN_S * motion.rate_hz), len(total) - 1)
    start_s = float(starts_s[int(np.argmax(total[last] - total[first]))])
    return trim(motion, start_s, min(start_s + SPAN_S, motion.duration_s))


def _radars(recipe: TwinRecipe, rng: np.random.Generator) -> tuple[Radar, Radar]:
    """Two radars on the walls, which face the middle of the room."""
    bin_mps, gain_db = float(rng.uniform(*recipe.bin_mps)), float(rng.uniform(*recipe.gain_db))
    height_m, angle = float(rng.uniform(0.9, 2.0)), np.radians(rng.uniform(*recipe.bearing_deg))
    range_cell_m = float(rng.uniform(*recipe.range_cell_m))
    sweep_hz = SPEED_OF_LIGHT / (2.0 * range_cell_m)
    wavelength_m = SPEED_OF_LIGHT / (77e9 + sweep_hz / 2.0)  # at mid-sweep
    first = Radar(
        carrier_hz=77e9, slope_hz_per_s=round(sweep_hz / (RANGE_CELLS / 2e6), -6), sample_rate_hz=2e6, samples=RANGE_CELLS,
        prf_hz=round(2.0 * bin_mps * BINS / wavelength_m, 3), chirps_per_frame=BINS, frame_interval_s=ROW_S,
        rx_gain_dbi=round(9.0 + gain_db, 3), position_m=(0.0, 0.0, round(height_m, 3)), boresight=(1.0, 0.0, 0.0),
    )  # fmt: skip
    cos, sin = float(np.cos(angle)), float(np.sin(angle))
    position = (round(CENTRE_M + 2.3 * cos, 3), round(2.3 * sin, 3), round(height_m, 3))
    return first, first.model_copy(update={"position_m": position, "boresight": (-cos, -sin, 0.0)})


def _placed(motion: Motion, radars: tuple[Radar, Radar], rng: np.random.Generator) -> Motion | None:
    """The motion somewhere in the room; None where none of the places drawn has room for it."""
    first = radars[0]
    for _ in range(PLACES):
        moved = place(
            motion, distance_m=float(rng.uniform(0.8, 4.4)), angle_deg=float(rng.uniform(-180.0, 180.0)),
            radar_position_m=first.position_m, boresight=first.boresight,
        )  # fmt: skip
        moved = aside(moved, float(rng.uniform(-1.5, 1.5)), first.boresight)
        track = moved.joints[:: max(1, round(motion.rate_hz / 10.0)), :, :2]
        inside = np.all(np.abs(track - [CENTRE_M, 0.0]) <= HALF_ROOM_M)
        if inside and all(np.linalg.norm(track - each.position_m[:2], axis=-1).min() >= NEAREST_M for each in radars):
            return moved
    return None


def make_twins(recipe: TwinRecipe, folder: str | Path, *, progress: Progress | None = None) -> Path:
    """Writes the twins of a recipe, a file each; those of the same recipe that are there stay, so that a stopped run goes on."""
    target = file_path("the folder of twins", folder)
    made_folder(target, target / RECIPE, json.dumps(asdict(recipe), indent=1), FILES, "twins")
    for index in range(recipe.count):
        path = target / f"{index:05d}.npz"
        if not path.exists():
            made = twin(recipe, index)
            with replacing(path, lambda: None) as new, new.open("wb") as file:
                np.savez(
                    file, levels=made.levels_db.astype(np.float16), label=made.label, told=json.dumps(dict(made.told))
                )
        if progress is not None:
            progress((index + 1) / recipe.count)
    return target


def _read_twin(path: Path) -> tuple[str, np.ndarray]:
    """Label and levels (radar, row, bin) of a twin's file."""
    try:
        with np.load(path, allow_pickle=False) as file:
            label, levels = (
                str(file["label"]),
                array("its levels", file["levels"], (len(RADARS), "row", BINS), limit=1e6),
            )
        if label not in SENTENCES or levels.shape[1] < ROWS:
            raise InputError(f"it has {levels.shape[1]} rows of '{label}'")
    except Exception as error:  # NumPy and zipfile raise what they like of a damaged file
        raise InputError(f"{path} is no twin ({error or type(error).__name__}); remove it and make it again") from None
    return label, levels


def _check_complete(target: Path, count: int) -> None:
    """Warns where twins of the recipe are not there yet."""
    known = target / RECIPE
    stored = read_bytes(known, limit=1_000_000, noun="recipe of twins")
    try:
        told = json.loads(stored)
        wanted = int(told["per_class"]) * len(told["classes"])
    except (ValueError, KeyError, TypeError, RecursionError, OverflowError) as error:
        raise InputError(f"{known} is no recipe of twins ({error}); make the twins with the study twins") from None
    if count < wanted:
        warnings.warn(
            f"{target} holds {count} of {wanted} twins; make the others with the study twins",
            T2DWarning,
            stacklevel=3,
        )


def read_twins(folder: str | Path, merged: Mapping[str, str] | None = None) -> LabelledMaps:
    """The twins of a folder as maps of the radar's own bins and rows, an event's two maps one after another.

    merged: class of each label, as `adapters.parrad.FOUR` has it; by default each label is a class.
    """
    target = file_path("the folder of twins", folder)
    files = sorted(target.glob(FILES))
    if not files:
        raise InputError(f"{target} holds no twins; make them with the study twins")
    _check_complete(target, len(files))
    found = [_read_twin(path) for path in files]
    labels = [label if merged is None else merged[label] for label, _ in found]
    order = [name if merged is None else merged[name] for name in SENTENCES]
    return maps_of_events([levels for _, levels in found], labels, [path.stem for path in files], order)


def maps_of_events(
    levels_db: Sequence[np.ndarray], labels: Sequence[str], names: Sequence[str], order: Sequence[str] = tuple(MERGED.values())
) -> LabelledMaps:  # fmt: skip
    """Events of levels (radar, row, bin) [dB] as maps of the radar's own bins and rows, an event's two maps one after another.

    order: classes, of which those that no event has are left out.
    """
    classes = tuple(dict.fromkeys(name for name in order if name in labels))
    levels = []
    for name, stored in zip(names, levels_db, strict=True):
        for each in notched(stored)[:, :ROWS]:
            levels.append(np.maximum(each.T - each.max(), -DYNAMIC_RANGE_DB))
            check_varied(levels[-1], f"event {name}")
    events = np.repeat(np.array(names), len(RADARS))
    return LabelledMaps(
        levels=np.stack(levels), labels=np.repeat([classes.index(each) for each in labels], len(RADARS)), classes=classes,
        groups={"event": events, "radar": np.array(RADARS * len(names))},
        velocity_mps=(np.arange(BINS) - ZERO_BIN) * BIN_MPS, duration_s=ROWS * ROW_S,
        names=tuple(f"{event} {radar}" for event, radar in zip(events, RADARS * len(names), strict=True)),
    )  # fmt: skip


def add_options(parser: ArgumentParser) -> None:
    parser.add_argument("-o", "--output", required=True, help="folder of the twins; what was stopped there goes on")
    parser.add_argument("--per-class", type=int, default=60, help="events of each class (default 60)")
    parser.add_argument(
        "--scene", default="empty_room", help="a room without furniture, empty_room by default, or free_space"
    )
    parser.add_argument("--method", choices=["ellipsoid", "mesh"], default="ellipsoid")
    parser.add_argument("--seed", type=int, default=0)


def run(options: Namespace) -> str:
    recipe = TwinRecipe(per_class=options.per_class, scene=options.scene, seed=options.seed, method=options.method)
    with ProgressBar("twins") as progress:
        folder = make_twins(recipe, options.output, progress=progress)
    return f"{folder}: {recipe.count} events by two radars"
