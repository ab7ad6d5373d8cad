"""Recorded spectrograms of walks beside simulated ones: how fast limbs are, how filled their arcs, at which fidelity.

The recordings are maps of MMRGait-1.0 (doi 10.12000/JR22227): `tfmap` (192, columns) in dB, rest at row 128, approach
at lower rows, no axes. What the maps themselves tell is taken from them: the STFT's window (their noise is not
correlated beyond one row, so a row is one Doppler bin, and the torso's row gives the window's length), its step (the
noise's correlation in time), that powers of many range cells were added (the noise's spread), and how far the torso
lies over the floor. The antennas are those of an evaluation board for 77 GHz, by its guide: 56 degrees wide in azimuth
and 28 in elevation. None of that is chosen by the measures, and no material or outfit is.
"""

from __future__ import annotations

import time
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from t2d_rt.body.materials import resolve_material
from t2d_rt.core.errors import InputError
from t2d_rt.motion import load_motion, place, trim
from t2d_rt.scene import Room
from t2d_rt.signal import spectrogram
from t2d_rt.simulate import simulate
from t2d_rt.types import Material, Motion, Radar
from t2d_rt.types.antennas import CosinePower, Isotropic, Pattern
from validation.studies.common import table, write_whole

REST = 128
"""Row of the maps where nothing moves."""
STILL = 4
"""Rows from rest in which static echoes and their filter may be."""
FLOOR = 20
"""Receding rows from which on there is noise alone."""
MEASURES = ("limbs 8 dB", "limbs 12 dB", "limbs 18 dB", "filled over the torso", "filled under it")
"""95th percentile over columns of the fastest cell so far over the floor, over the torso's median row; and the part of the cells
between the torso and the fastest 8 dB over the floor, and between rest and torso, that are 6 dB over it."""
HOP = 0.18
"""Step of the STFT over its window: with it, a Hann window's noise is correlated in time as the maps' is (0.64, 0.25)."""
GATE_M = (1.2, 6.0)
RADAR = Radar(carrier_hz=77e9, slope_hz_per_s=40e12, sample_rate_hz=2.56e6, samples=64, prf_hz=6000)
BOARD = "awr1843boost"
ROUND = CosinePower(half_power_beamwidth_deg=28.0)
MIDDLE_M = 4.2
"""Distance of the path's middle, on boresight; 2.6 s of a walk then lie within `GATE_M`."""
HALL = Room(name="hall", size_m=(12, 14, 6))


class Fidelity(NamedTuple):
    """How a walk is modelled and looked at."""

    name: str
    method: Literal["mesh", "ellipsoid"] = "mesh"
    material: str | float = "skin"
    """Of the body, or its outfit; a number is the scattering coefficient S of its skin."""
    pattern: str | Pattern = BOARD
    """Of the antennas, or the preset that has it."""
    floor: bool = False


SKIN = Fidelity("skin (S = 0.3)")
FIDELITIES = (
    Fidelity("ellipsoids, isotropic antennas", "ellipsoid", pattern=Isotropic()),
    Fidelity("ellipsoids", "ellipsoid"),
    Fidelity("ellipsoids, dressed", "ellipsoid", "dressed"),
    Fidelity("skin, isotropic antennas", pattern=Isotropic()),
    Fidelity("smooth skin", material=0.0),
    SKIN,
    Fidelity("clothed (S = 0.6)", material="clothed"),
    Fidelity("S = 0.9", material=0.9),
    Fidelity("dressed", material="dressed"),
    Fidelity("dressed, echoes by the floor too", material="dressed", floor=True),
    Fidelity("coat", material="coat"),
    Fidelity("dressed, isotropic antennas", material="dressed", pattern=Isotropic()),
    Fidelity("dressed, a round beam of 28 degrees", material="dressed", pattern=ROUND),
)


@dataclass(frozen=True, slots=True)
class Recorded:
    """A recorded map and what it tells of its making."""

    name: str
    angle_deg: float
    level_db: np.ndarray
    """(row from rest, column), approach alone, over the floor."""
    looks: float
    """Number of independent powers that were added."""

    @property
    def torso(self) -> float:
        """Median row of the strongest moving cell."""
        return float(np.median(torso_rows(self.level_db)))

    @property
    def top_db(self) -> float:
        """Its median level over the floor."""
        return float(np.median(self.level_db[STILL - 1 :].max(0)))


def torso_rows(level_db: np.ndarray) -> np.ndarray:
    """Row from rest of each column's strongest moving cell."""
    return np.asarray(level_db[STILL - 1 :].argmax(0) + STILL)


def measures(level_db: np.ndarray) -> np.ndarray:
    """`MEASURES` of approaching rows (row from rest, column), in dB over the floor."""
    rows = np.arange(1, len(level_db) + 1)[:, None]
    torso = torso_rows(level_db)

    def fastest(over_db: float) -> np.ndarray:
        return np.where(level_db >= over_db, rows, 0).max(0)

    limbs = [np.percentile(fastest(over), 95) / np.median(torso) for over in (8, 12, 18)]
    filled = level_db >= 6
    over, under = (rows > torso) & (rows < fastest(8)), (rows < torso) & (rows >= STILL)
    return np.array([*limbs, filled[over].mean(), filled[under].mean()])


def read_map(told: str) -> Recorded:
    """A map by FILE:ANGLE, the angle in degrees between the walk and the line of sight."""
    from scipy.io import loadmat

    file, _, angle = told.rpartition(":")
    try:
        level = np.asarray(loadmat(file)["tfmap"], dtype=float)
        degrees = float(angle)
    except (OSError, ValueError, KeyError, NotImplementedError) as error:
        raise InputError(
            f"{told} is not FILE.mat:ANGLE with a map `tfmap` ({error}); give one of MMRGait-1.0"
        ) from None
    if level.ndim != 2 or len(level) <= REST + 2 * FLOOR:
        raise InputError(
            f"`tfmap` of {file} has the shape {level.shape}; rows to {REST + 2 * FLOOR} at least are expected"
        )
    noise = level[REST + FLOOR :]
    power = 10 ** (noise / 10)
    return Recorded(
        name=Path(file).stem, angle_deg=degrees, level_db=(level[:REST] - np.median(noise))[::-1],
        looks=float((power.mean() / power.std()) ** 2),
    )  # fmt: skip


def walked(file: str, angle_deg: float) -> Motion:
    """At most 2.6 s of a walk, whose middle lies on boresight."""
    motion = load_motion(file)
    motion = place(trim(motion, 0.2, min(motion.duration_s, 2.8)), distance_m=5.0, angle_deg=angle_deg)
    middle = motion.joints[len(motion.joints) // 2, 0]
    return motion.edited("middle on boresight", joints=motion.joints + [MIDDLE_M - middle[0], -middle[1], 0.0])


def simulated(motion: Motion, fidelity: Fidelity) -> tuple[np.ndarray, float]:
    """Cube of a walk and the processor time that it took [s]."""
    given = fidelity.pattern
    pattern = Radar.preset(given).tx_pattern if isinstance(given, str) else given
    radar = RADAR.replace(tx_pattern=pattern, rx_pattern=pattern)
    material: str | Material | float = fidelity.material
    if isinstance(material, float):
        material = replace(resolve_material("skin", radar.carrier_hz), scattering_coefficient=material)
    start = time.process_time()
    about: dict[str, Any] = {"scene": HALL, "only_paths": ["direct", "*floor*"]} if fidelity.floor else {}
    made = simulate(motion, radar=radar, method=fidelity.method, material=material, clutter="none", **about)
    return np.asarray(made.adc[:]), time.process_time() - start


def levels(cube: np.ndarray, window: int) -> np.ndarray:
    """Approaching rows of a cube's spectrogram with `window` chirps a column, power (row from rest, column)."""
    made = spectrogram(
        cube, RADAR, range_gate_m=GATE_M, mti="none", n_window=window, overlap=window - max(1, round(HOP * window))
    )
    return np.asarray(made.power[made.velocity_mps > 1e-9])


def in_noise(cube: np.ndarray, window: int, top_db: float, seed: int) -> np.ndarray:
    """`levels` in dB over the floor, of the cube with receiver noise that lies `top_db` under the torso."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(*cube.shape, 2)).view(complex)[..., 0] / np.sqrt(2)
    floor = float(np.median(levels(noise, window)))
    torso = float(np.median(levels(cube, window)[STILL - 1 :].max(0)))
    scale = torso / floor * 10 ** (-top_db / 10)
    return np.asarray(10 * np.log10(levels(cube + np.sqrt(scale) * noise, window) / (scale * floor)))


def window_of(cube: np.ndarray, row: float) -> int:
    """Number of chirps that puts the torso's median row where the recording has it."""
    count = 256
    for _ in range(3):
        count = round(count * row / float(np.median(torso_rows(levels(cube, count)))))
    return count


def compared(
    map_: Recorded, windows: dict[str, int], walks: Sequence[str], fidelities: Sequence[Fidelity]
) -> Iterator[tuple[Fidelity, np.ndarray, float]]:
    """Of each fidelity its measures over the walks (walk, measure) and seconds a walk.

    The window is found at the first map, walk by walk with the skin, and stays for the others: the radar is the same.
    """
    motions = {walk: walked(walk, map_.angle_deg) for walk in walks}
    for walk, motion in motions.items():
        if walk not in windows:
            windows[walk] = window_of(simulated(motion, SKIN)[0], map_.torso)
    for fidelity in fidelities:
        found, seconds = [], []
        for number, (walk, motion) in enumerate(motions.items()):
            cube, took = simulated(motion, fidelity)
            found.append(measures(in_noise(cube, windows[walk], map_.top_db, number)))
            seconds.append(took)
        yield fidelity, np.array(found), float(np.median(seconds))


def add_options(parser: ArgumentParser) -> None:
    """Options of the study."""
    parser.add_argument("maps", metavar="FILE:ANGLE", help="maps, separated by commas; the first one finds the window")
    parser.add_argument("walks", nargs="+", help="files of recorded walks that are simulated")
    parser.add_argument(
        "--only", action="append", choices=[each.name for each in FIDELITIES], help="a row, again for others"
    )
    parser.add_argument("-o", "--output", required=True, type=Path, help="folder of the table")


def run(options: Namespace) -> str:
    """Writes walks.md; a line about it."""
    windows: dict[str, int] = {}
    texts = []
    fidelities = [each for each in FIDELITIES if options.only is None or each.name in options.only]
    for map_ in map(read_map, options.maps.split(",")):
        rows: list[list[Any]] = [["**recorded**", *(f"**{x:.2f}**" for x in measures(map_.level_db)), ""]]
        for fidelity, found, seconds in compared(map_, windows, options.walks, fidelities):
            cells = [f"{x:.2f} +- {s:.2f}" for x, s in zip(found.mean(0), found.std(0, ddof=1), strict=True)]
            rows.append([fidelity.name, *cells, f"{seconds:.1f}"])
        texts.append(
            f"{map_.name}, {map_.angle_deg:g} degrees: torso in row {map_.torso:.0f}, {map_.top_db:.1f} dB over the floor, "
            f"{map_.looks:.0f} looks; windows of {min(windows.values())} to {max(windows.values())} chirps\n\n"
            + table(["", *MEASURES, "CPU s a walk"], rows)
        )
    options.output.mkdir(parents=True, exist_ok=True)
    write_whole(options.output / "walks.md", "\n\n".join(texts) + "\n")
    return f"walks.md of {len(options.walks)} walks is in {options.output}"
