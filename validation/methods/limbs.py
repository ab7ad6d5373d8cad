"""Ellipsoids against the mesh, segment by segment: where the coarse model holds within 3 dB, and where not."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import t2d_rt as t2d
from t2d_rt.body.segments import SEGMENTS
from validation.report import Section, at_most, new_figure, save_chart

ROOT = Path(__file__).resolve().parents[2]
SECONDS, DISTANCE_M = 1.5, 7.0
ANGLES_DEG = {"towards": 0.0, "aside": 90.0}
HOLDS_DB = 3.0
"""Levels that differ by less are the same for most uses."""
SUM_DB = -100.0
"""Greatest difference between the sum of the parts and the recording without parts."""


def motions() -> dict[str, t2d.Motion]:
    """A piece of each."""
    run = t2d.load_motion(ROOT / "examples/motions/iclone_002_03_run_jog.bvh.gz")
    fall = t2d.motion_from_text("a person walks, then trips and falls forward", seed=3)
    pelvis = fall.joints[:, fall.index("pelvis"), 2]
    down_s = float(fall.times_s[np.argmax(pelvis < 0.5 * pelvis[0])])
    starts = {"walk": (t2d.example("walk"), 1.0), "run": (run, 0.0), "fall": (fall, max(0.0, down_s - 0.7 * SECONDS))}
    return {
        name: t2d.trim(motion, start_s, min(start_s + SECONDS, motion.times_s[-1]))
        for name, (motion, start_s) in starts.items()
    }


def run() -> Section:
    rows, levels, worst_db = [], {}, -np.inf
    for name, motion in motions().items():
        for aspect, angle_deg in ANGLES_DEG.items():
            placed = t2d.place(motion, distance_m=DISTANCE_M, angle_deg=angle_deg)
            mesh, coarse = (t2d.simulate(placed, method=method, split="segment") for method in ("mesh", "ellipsoid"))
            worst_db = max(worst_db, _remainder_db(mesh, t2d.simulate(placed, method="mesh")))
            found = {segment: _compared(mesh, coarse, segment) for segment in SEGMENTS}
            levels[f"{name}, {aspect}"] = [found[segment][0] for segment in SEGMENTS]
            held = [segment for segment, (level, _, _) in found.items() if abs(level) <= HOLDS_DB]
            whole = _power_db(coarse.cube) - _power_db(mesh.cube)
            rows.append(
                {
                    "motion": name, "aspect": aspect, "whole dB": whole,
                    "segments within 3 dB": f"{len(held)} of {len(SEGMENTS)}",
                    "median dB": float(np.median(levels[f"{name}, {aspect}"])),
                    "greatest m/s": max(abs(speed) for _, speed, _ in found.values()),
                    "of the power": sum(share for segment, (_, _, share) in found.items() if segment in held),
                }
            )  # fmt: skip
    check = at_most("sum of the parts against the recording without", worst_db, SUM_DB, "dB")
    return Section(
        title="Ellipsoids against the mesh, limb by limb",
        checks=[check],
        note=f"{SECONDS:g} s of each motion from {DISTANCE_M:g} m, table2, free space, split by segment. Levels: energy of a "
        "segment's echoes by ellipsoids over that by the mesh. Speeds: differences of the power-weighted mean speeds. Power: the "
        "fraction of the mesh's echoes, segments added, that the segments within 3 dB return.",
        table=rows,
        charts=[_chart(levels)],
    )


def _power_db(cube: np.ndarray) -> float:
    return float(10 * np.log10(np.sum(np.abs(np.asarray(cube, np.complex128)) ** 2)))


def _remainder_db(parts: t2d.Recording, whole: t2d.Recording) -> float:
    total = np.sum([np.asarray(each, np.complex128) for each in parts.parts.cubes.values()], axis=0)
    return _power_db(total - whole.cube) - _power_db(whole.cube)


def _compared(mesh: t2d.Recording, coarse: t2d.Recording, segment: str) -> tuple[float, float, float]:
    """Level of the ellipsoid over that of the skin [dB], difference of the mean speeds [m/s], and the skin's share of the power."""
    powers = {name: 10 ** (_power_db(each) / 10) for name, each in mesh.parts.cubes.items()}
    if segment not in mesh.parts or segment not in coarse.parts:  # nothing of it faces the radar
        return np.inf, 0.0, 0.0
    level = _power_db(coarse.parts.cubes[segment]) - _power_db(mesh.parts.cubes[segment])
    return level, _speed(coarse, segment) - _speed(mesh, segment), powers[segment] / sum(powers.values())


def _speed(recording: t2d.Recording, segment: str) -> float:
    image = recording.parts[segment].spectrogram
    power = 10 ** (image.values / 10)
    return float((power * image.velocity_mps.values[:, None]).sum() / power.sum())


def _chart(levels: dict[str, list[float]]) -> str:
    figure, axis = new_figure(figsize=(8.5, 4.5))
    values = np.array(list(levels.values()))
    drawn = axis.imshow(np.clip(values, -20, 20), cmap="RdBu_r", vmin=-15, vmax=15, aspect="auto")
    for (row, column), value in np.ndenumerate(values):
        axis.text(column, row, f"{value:.0f}", ha="center", va="center", fontsize=8)
    axis.set_xticks(
        range(len(SEGMENTS)), [each.replace("_", " ") for each in SEGMENTS], rotation=60, ha="right", fontsize=8
    )
    axis.set_yticks(range(len(levels)), list(levels), fontsize=8)
    axis.set_title("Level of ellipsoids over that of the mesh [dB]", fontsize=10)
    figure.colorbar(drawn, label="dB")
    return save_chart(figure, "limbs.png")
