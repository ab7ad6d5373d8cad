"""Vital signs of simulated people at rest, seated and lying, and of recordings, by the same measure (`signal.vital_signs`).

The people are made from sentences, their last pose held; they breathe by 5 mm at 0.25 Hz, their hearts beat by 0.2 mm at 1.2 Hz.
The radar stands 2 m before the chest of who sits, 1 m high, or 2 m above who lies, with the receiver's noise. Nothing is fitted.
Recordings: a DCA1000 capture with its .cfg, and an A121 recording of Acconeer's exploration tool (.h5), whose cells the device has
made.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.motion.generate import motion_from_text
from t2d_rt.recording.read import load_recording
from t2d_rt.signal import VitalSigns, vital_signs
from t2d_rt.signal.vital import signs_of
from t2d_rt.simulate import simulate
from t2d_rt.types import Breathing, Heartbeat, Motion, Radar
from validation.studies.common import table, write_whole

BREATHING, HEARTBEAT = Breathing(rate_hz=0.25, depth_m=0.005, phase_rad=1.0), Heartbeat(rate_hz=1.2, depth_m=0.0002)
SENTENCES = {"sits": "a person sits down on a chair", "lies": "a person lies down on a bed"}
DISTANCE_M, HEIGHT_M, SPAN_S, RATE_HZ = 2.0, 1.0, 24.0, 20.0
A121_HZ = 60.5e9
RATES, DEPTHS = 0.02, 0.05
"""Limits of what rates and displacements are off by."""
BANDS_HZ = (0.2, 0.45), (0.45, 0.75), (0.75, 1.05), (1.05, 2.0), (2.0, 4.0)
"""Of the displacement's spectrum, whose powers are told over that of the first."""
HEAD = [
    "what", "range [m]", "breaths [Hz]", "breath [mm]", "record [mm]", "heart [Hz]", "beat [mm]", "line [dB]", "bands [dB]", "",
]  # fmt: skip


def at_rest(posture: str, seed: int) -> Motion:
    """Somebody's last pose, held, with the chest over the origin and, where the person sits, facing x < 0."""
    made = motion_from_text(SENTENCES[posture], seed=seed)
    joints, rotations = made.joints[-1], made.rotations[-1]
    across = joints[made.index("left_hip")] - joints[made.index("right_hip")]
    facing = Rotation.from_euler("z", 1.5 * np.pi - np.arctan2(across[1], across[0]))
    joints = facing.apply(joints - joints[made.index("spine2")] * [1, 1, 0])
    frames = round(RATE_HZ * SPAN_S) + 1
    turned = (facing * Rotation.from_quat(rotations)).as_quat()
    held = {"joints": np.repeat(joints[None], frames, 0), "rotations": np.repeat(turned[None], frames, 0)}
    return replace(
        made, **held, rate_hz=RATE_HZ, placed=True, activities=(), breathing=BREATHING, heartbeat=HEARTBEAT
    )  # fmt: skip


def watching(preset: str, motion: Motion, posture: str) -> Radar:
    """A preset with all antennas at once and 40 chirps a second, before who sits, above who lies."""
    radar = Radar.preset(preset)
    chest_m = float(motion.joints[0, motion.index("spine2"), 2])
    above = posture == "lies"
    place = {"position_m": (0.01, 0.0, chest_m + DISTANCE_M), "boresight": (0.0, 0.0, -1.0)} if above else {
        "position_m": (-DISTANCE_M, 0.0, HEIGHT_M), "boresight": (1.0, 0.0, 0.0)
    }  # fmt: skip
    chirps = {"prf_hz": 40.0, "chirps_per_frame": None, "frame_interval_s": None}
    return radar.replace(tx_offsets_m=[(0.0, 0.0, 0.0)], multiplexing="simultaneous", **chirps, **place)


def simulated(options: Namespace) -> Iterator[tuple[str, VitalSigns]]:
    for posture in SENTENCES:
        for preset in options.radars.split(","):
            for method in ("ellipsoid", "mesh"):
                for seed in range(options.first, options.first + options.people):
                    motion = at_rest(posture, seed)
                    radar = watching(preset, motion, posture)
                    found = simulate(
                        motion, radar=radar, method=method, seed=seed, noise="receiver", measure_error=False
                    )
                    yield f"{posture}, {preset}, {method}, person {seed}", vital_signs(found.cube, radar)


def recorded(options: Namespace) -> Iterator[tuple[str, VitalSigns]]:
    if options.capture:
        capture = load_recording(options.capture, options.cfg, lanes=2)
        yield "recorded, IWR6843", vital_signs(capture.cube, capture.radar)
    if options.a121:
        import h5py

        with h5py.File(options.a121) as file:
            frames = file["sessions/session_0/group_0/entry_0/result/frame"][:]
        cells = (frames["real"] + 1j * frames["imag"]).mean(axis=1)[:, None]
        # Start, step and rate stand in the file's configuration: points 119, 143, ... of 2.5023 mm, 20 frames a second.
        range_m = 2.50227400101721e-3 * (119 + 24 * np.arange(cells.shape[2]))
        yield "recorded, A121", signs_of(cells, range_m, np.arange(len(cells)) / 20.0, SPEED_OF_LIGHT / A121_HZ)


def bands_db(signs: VitalSigns) -> str:
    """Powers of the displacement in `BANDS_HZ` over that in the first [dB]."""
    moved = signs.displacement_m - np.polynomial.Polynomial.fit(signs.time_s, signs.displacement_m, 2)(signs.time_s)
    power = np.abs(np.fft.rfft(moved * np.hanning(len(moved)))) ** 2
    axis = np.fft.rfftfreq(len(moved), float(np.diff(signs.time_s).mean()))
    levels = [power[(axis >= low) & (axis < high)].sum() for low, high in BANDS_HZ]
    return ", ".join(f"{10 * np.log10(level / levels[0]):.0f}" for level in levels[1:])


def within(signs: VitalSigns) -> bool:
    """Whether rates and displacements are those that were simulated."""
    rates = (signs.breathing_hz / BREATHING.rate_hz, signs.heartbeat_hz / HEARTBEAT.rate_hz)
    return max(abs(each - 1) for each in rates) <= RATES and abs(signs.breathing_m / BREATHING.depth_m - 1) <= DEPTHS


def add_options(parser: ArgumentParser) -> None:
    parser.add_argument("--people", type=int, default=5, help="people of each posture")
    parser.add_argument("--first", type=int, default=1, help="number of the first of them")
    parser.add_argument("--radars", default="table2,people-tracking-60,iwr6843isk", help="presets, with commas between")
    parser.add_argument("--capture", help="raw capture of a DCA1000 over 2 lanes (.bin)")
    parser.add_argument("--cfg", help="its configuration (.cfg)")
    parser.add_argument("--a121", help="recording of an A121 (.h5)")
    parser.add_argument("-o", "--output", required=True, help="text to write (.md)")


def run(options: Namespace) -> str:
    rows = []
    for made, found in ((False, recorded(options)), (True, simulated(options))):
        for name, signs in found:
            verdict = "" if not made else "within" if within(signs) else "**outside**"
            rows.append([
                name, f"{signs.range_m:.2f}", f"{signs.breathing_hz:.3f}", f"{1e3 * signs.breathing_m:.2f}",
                f"{1e3 * signs.excursion_m:.2f}", f"{signs.heartbeat_hz:.3f}", f"{1e3 * signs.heartbeat_m:.3f}",
                f"{signs.heartbeat_db:.0f}", bands_db(signs), verdict,
            ])  # fmt: skip
            print(*rows[-1], flush=True)
    target = Path(options.output).with_suffix(".md")
    write_whole(target, f"{table(HEAD, rows)}\n\n{' '.join((__doc__ or '').split())}\n")
    return f"wrote {target}"
