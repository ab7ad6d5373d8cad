"""Points of an IWR6843 beside recorded ones: people who sit, squat and stand before 3D people tracking.

The recordings are those of wudaozhiying1/mmWave-human-tracking, each a .json.gz with the device's configuration (`cfg`) and its
frames. Waveform, power back-off, antennas, mounting and detection are those of the configuration, the link budget the data sheet's,
as the preset people-tracking-60 has it. The people are made from sentences and held in the posture that the recording's name tells;
they wear clothes, breathe and sway as those of data sets do. Nothing is fitted to what the recordings that judge tell. By every
other recording it is chosen how far away the person is, that the seat is low, which peaks pass, and --sway where it is given.
"""

from __future__ import annotations

import gzip
import json
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.motion import place, trim
from t2d_rt.motion.generate import motion_from_text
from t2d_rt.motion.generate.made.standing import CROUCH_S
from t2d_rt.motion.vary import hold
from t2d_rt.signal import Detection, device_points
from t2d_rt.simulate import simulate
from t2d_rt.types import Motion, Radar, Receiver
from t2d_rt.types.ti_cfg import radar_fields, read_commands
from validation.studies.common import write_whole

MEASURES = ("points a frame", "height [m]", "speed [m/s]", "active frames")
"""Of a recording: median number of points of the frames that have any, medians of the points' heights over the floor and of their
absolute speeds, part of the frames that have any."""
CHIP_DBM = 12.0 - 9.8
"""What a configuration without back-off has over what the antennas are fed with: 15 dBm EIRP by antennas of 5.2 dBi."""
SURFACE_M = 0.1
"""How far before the middle of the head the surface lies that the radar sees."""
SENTENCES = {"sit": "a person sits down on a stair", "squat": "a person squats", "stand": "a person squats"}
"""What is held at its end, at its lowest and at its beginning. The seat is low: in frames of ten points and more, in which all of
the body moves, 99 % of them lie below 1.07 m in each recording by which is chosen, where a head over a chair is at 1.2 m."""
LIMIT = 0.25


def measures(numbers: np.ndarray, height_m: np.ndarray, speed_mps: np.ndarray) -> np.ndarray:
    """`MEASURES` of one recording from the number of points of each frame and the points' heights and speeds."""
    active = numbers[numbers > 0]
    if not len(active):
        return np.array([0.0, np.nan, np.nan, 0.0])
    return np.array([np.median(active), np.median(height_m), np.median(np.abs(speed_mps)), len(active) / len(numbers)])


def quartiles(values: Sequence[np.ndarray]) -> np.ndarray:
    """Quartiles of the measures over recordings, (3, measure); recordings without a point have no height and speed."""
    columns = np.array(values).T
    return np.array(
        [np.percentile(x[~np.isnan(x)], (25, 50, 75)) if not np.isnan(x).all() else 3 * [np.nan] for x in columns]
    ).T


def recorded(path: Path) -> tuple[list[str], np.ndarray, np.ndarray, float]:
    """Lines of the configuration, points of each frame, `MEASURES` and the points' median distance along the floor [m]."""
    with gzip.open(path, "rt", encoding="utf-8") as file:
        content = json.load(file)
    frames = [np.reshape(frame["frameData"].get("pointCloud", []), (-1, 7)) for frame in content["data"]]
    points = np.concatenate(frames)
    numbers = np.array([len(frame) for frame in frames])
    lines = content["cfg"] if isinstance(content["cfg"], list) else content["cfg"].splitlines()
    # The program that recorded them has turned and lifted the points by the mounting: z is over the floor.
    return lines, numbers, measures(numbers, points[:, 2], points[:, 3]), float(np.median(points[:, 1]))


def device(lines: list[str]) -> Radar:
    """The preset with the chirps of a configuration, mounted as its sensorPosition says (height, azimuth 0, tilt downwards)."""
    height, _, tilt = read_commands(lines)["sensorPosition"][0]
    down = np.radians(tilt)
    told = {**radar_fields(lines), "position_m": (0.0, 0.0, height), "boresight": (np.cos(down), 0.0, -np.sin(down))}
    return Radar.preset("people-tracking-60", **{**told, "tx_power_dbm": told["tx_power_dbm"] - CHIP_DBM})


def person(posture: str, seed: int, duration_s: float, sway: float) -> Motion:
    """Somebody who holds a posture for a time; `sway` times as restless as the people of data sets."""
    motion = motion_from_text(SENTENCES[posture], seed=seed, duration_s=CROUCH_S if posture == "squat" else None)
    pelvis = motion.joints[:, motion.index("pelvis"), 2]
    instants = {"sit": motion.duration_s, "squat": motion.times_s[int(pelvis.argmin())], "stand": 0.1}
    end = max(float(instants[posture]), 0.1)
    held = trim(hold(trim(motion, end - 0.1, end), duration_s + 1.0, sway_seed=seed), 1.0, duration_s + 1.0)
    middle = held.joints.mean(axis=0)
    return held.edited(f"swaying {sway:g} times as far", joints=middle + sway * (held.joints - middle))


def twin(motion: Motion, seed: int, radar: Radar, detection: Detection, distance_m: float, frames: int) -> np.ndarray:
    """`MEASURES` of one simulated recording."""
    motion = place(motion, distance_m=distance_m, radar_position_m=radar.position_m, boresight=radar.boresight)
    nearer_m = motion.joints[:, motion.index("head"), 0].mean() - distance_m
    motion = motion.edited("the head at the distance", joints=motion.joints - np.array([nearer_m, 0.0, 0.0]))
    recording = simulate(motion, radar=radar, seed=seed, noise=Receiver(), material="clothed", measure_error=False)
    cube = recording.cube[: frames * (radar.loops_per_frame or 1)]
    cloud = device_points(cube, radar, detection)
    numbers = np.bincount((cloud.time_s // (radar.frame_interval_s or 1.0)).astype(int), minlength=frames)
    height_m = radar.position_m[2] + (cloud.xyz_m @ radar.axes)[:, 2]
    return measures(numbers, height_m, cloud.speed_mps)


def add_options(parser: ArgumentParser) -> None:
    parser.add_argument("--recordings", required=True, help="folder of the recordings (POSTURE_*.json.gz)")
    parser.add_argument("--twins", type=int, default=10, help="simulated recordings of each posture")
    parser.add_argument("--sway", type=float, default=1.0, help="how many times as far people sway as in data sets")
    parser.add_argument("-o", "--output", required=True, help="text to write (.md)")


def run(options: Namespace) -> str:
    rows = [
        "| posture | measure | recorded, choosing half | recorded, judging half | simulated | off by |",
        "|---|---|---|---|---|---|",
    ]
    for posture in ("sit", "squat", "stand"):
        paths = sorted(Path(options.recordings).glob(f"{posture}_*.json.gz"))
        if len(paths) < 2:
            raise InputError(f"{options.recordings} must hold two or more files {posture}_*.json.gz, got {len(paths)}")
        real = [recorded(path) for path in paths]
        lines, numbers = real[0][:2]
        distance_m = float(np.median([each[3] for each in real[::2]])) + SURFACE_M
        radar, detection = device(lines), Detection.from_ti_cfg(lines)
        duration_s = len(numbers) * (radar.frame_interval_s or 0.0) + 0.1
        twins = [
            twin(person(posture, seed, duration_s, options.sway), seed, radar, detection, distance_m, len(numbers))
            for seed in range(options.twins)
        ]
        found = [quartiles(each) for each in ([x[2] for x in real[::2]], [x[2] for x in real[1::2]], twins)]
        for i, name in enumerate(MEASURES):
            off = found[2][1, i] / found[1][1, i] - 1
            verdict = "within" if abs(off) <= LIMIT else "**outside**"
            low, middle, high = found[2][:, i]
            rows.append(
                f"| {posture}, {distance_m:.2f} m | {name} | {found[0][1, i]:.3g} | {found[1][1, i]:.3g} | {middle:.3g} "
                f"({low:.3g} to {high:.3g}) | {100 * off:+.0f} %, {verdict} |"
            )
        print("\n".join(rows[-len(MEASURES) :]), flush=True)
    target = Path(options.output).with_suffix(".md")
    write_whole(target, "\n".join(rows) + f"\n\n{' '.join((__doc__ or '').split())}\n")
    return f"wrote {target}"
