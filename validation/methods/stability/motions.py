"""Motion files: frame rate and interpolation, jitter, the same motion at 20 Hz to 1 kHz."""

from __future__ import annotations

import math
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import t2d_rt as t2d
from t2d_rt.core.resources import resource
from t2d_rt.motion.interpolate import sample
from t2d_rt.scattering.ellipsoid import ellipsoid_echoes
from t2d_rt.types import PEC, Ellipsoids, Motion, Radar
from t2d_rt.types.ellipsoids import PoseTrack
from validation.bodies import WALK, recorded
from validation.methods.reference import nmse_db
from validation.methods.stability.case import Case, Theme
from validation.report import at_least, at_most, new_figure, save_chart

RATES_HZ = (10.0, 15.0, 20.0, 30.0, 40.0, 60.0)
JITTER_M, JITTER_DEG, CMU_UNIT_M = 1e-3, 0.1, 0.05644
FILE_RATES_HZ = (20.0, 60.0, 250.0, 1000.0)
CUTOFF_HZ, END_S = 6.0, 0.3
"""Splines know less at the ends of a file: so much is left out there."""


def theme() -> Theme:
    radar = Radar.preset("table2")
    rates, chart = frame_rate(radar)
    return Theme(cases=[*rates, jitter(), *file_rates(radar)], charts=[chart])


def smooth_walk() -> Motion:
    """The recorded walk less what is above 6 Hz: a file of 20 Hz can hold it, and the interpolation is what errs."""
    return t2d.smooth(recorded(WALK), CUTOFF_HZ)


def frame_rate(radar: Radar) -> tuple[list[Case], str]:
    """Joints of the walk between the frames of slower files, against the file of 120 Hz."""
    walk = smooth_walk()
    times = np.linspace(END_S, walk.duration_s - END_S, 4000)
    truth = sample(walk, times)[0]
    errors: dict[str, list[tuple[float, float]]] = {
        "straight lines": [],
        "Catmull-Rom": [],
        "t2d_rt: splines of rotations": [],
    }
    for rate in RATES_HZ:
        slow = t2d.resample(walk, rate)
        found = (_straight(slow, times), _catmull_rom(slow, times), sample(slow, times)[0])
        for each, joints in zip(errors.values(), found, strict=True):
            off = joints - truth
            speed = np.gradient(off, times, axis=0)
            each.append((4 * math.pi / radar.wavelength_m * _rms(off), _rms(speed)))
    at = RATES_HZ.index(20.0)
    names = list(errors)
    lines, _, ours = (errors[name][at] for name in names)
    cases = [
        Case(
            f"a file of 20 Hz, RMS error of {what}, all joints",
            at_least("straight lines between frames", lines[n], fails_by, unit),
            at_most("C2 splines of rotations", ours[n], limit, unit),
        )
        for n, (what, fails_by, limit, unit) in enumerate((("phase", 3, 1, "rad"), ("speed", 0.05, 0.02, "m/s")))
    ]
    figure, axes = new_figure(figsize=(9, 3.6), ncols=2)
    for n, (axis, label) in enumerate(zip(axes, ("RMS error of phase [rad]", "RMS error of speed [m/s]"), strict=True)):
        for (name, found), mark in zip(errors.items(), ("o--", "^-.", "s-"), strict=True):
            axis.loglog(RATES_HZ, [each[n] for each in found], mark, label=name)
        axis.set_xticks(RATES_HZ, [f"{rate:g}" for rate in RATES_HZ])
        axis.minorticks_off()
        axis.set(xlabel="frame rate of the file [Hz]", ylabel=label)
        axis.grid(alpha=0.3, which="both")
    axes[0].legend(fontsize=8)
    figure.suptitle("walk, all joints, against 120 Hz")
    return cases, save_chart(figure, "stability_frame_rate.png")


def _rms(vectors: np.ndarray) -> float:
    """Of the lengths of (..., 3)."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))


def _straight(motion: Motion, times_s: np.ndarray) -> np.ndarray:
    place = times_s * motion.rate_hz
    before = np.minimum(place.astype(int), len(motion.joints) - 2)
    u = (place - before)[:, None, None]
    return motion.joints[before] * (1 - u) + motion.joints[before + 1] * u


def _catmull_rom(motion: Motion, times_s: np.ndarray) -> np.ndarray:
    place = times_s * motion.rate_hz
    i = np.clip(place.astype(int), 1, len(motion.joints) - 3)
    u = (place - i)[:, None, None]
    a, b, c, d = (motion.joints[i + k] for k in (-1, 0, 1, 2))
    return b + u / 2 * (c - a + u * (2 * a - 5 * b + 4 * c - d + u * (3 * (b - c) + d - a)))


def jitter() -> Case:
    """The recorded walk with 1 mm of noise on its root and 0.1 degrees on its joints, as marker systems have."""
    with TemporaryDirectory() as folder:
        noisy = Path(folder) / "noisy.bvh"
        noisy.write_text(_with_noise(resource("motions", WALK).read_text(encoding="utf-8")), encoding="utf-8")
        files = {"clean": t2d.load_motion(resource("motions", WALK))}
        files |= {
            name: t2d.load_motion(noisy, smooth_hz=cutoff) for name, cutoff in (("as it is", None), ("ours", "auto"))
        }
    speeds = {name: np.diff(file.joints, axis=0) * file.rate_hz for name, file in files.items()}
    error = {name: _rms(speeds[name] - speeds["clean"]) for name in ("as it is", "ours")}
    return Case(
        "jitter of 1 mm and 0.1 degrees at 120 Hz, RMS speed of joints that is not there",
        at_least("the file as it is", error["as it is"], 0.2, "m/s"),
        at_most(
            "load_motion as it is called: noise is noticed and smoothed"
            if "smoothed at" in files["ours"].report
            else "not noticed",
            error["ours"],
            0.1,
            "m/s",
        ),
    )


def _with_noise(text: str, seed: int = 0) -> str:
    """A BVH file with noise on all channels; the first three are the root's place in units of 5.6 cm."""
    head, frames = text.split("Frame Time:")
    step, *rows = frames.strip().splitlines()
    values = np.array([row.split() for row in rows], float)
    noise = np.random.default_rng(seed).normal(0, JITTER_DEG, values.shape)
    noise[:, :3] *= JITTER_M / CMU_UNIT_M / JITTER_DEG
    lines = "\n".join(" ".join(f"{x:.6f}" for x in row) for row in values + noise)
    return f"{head}Frame Time: {step}\n{lines}\n"


def file_rates(radar: Radar) -> list[Case]:
    """The same walk from files of 20 Hz to 1 kHz, by the ellipsoid model, against the one of 120 Hz."""
    radar = radar.replace(samples=32)  # a narrow sweep: phases are what counts here
    walk = smooth_walk()
    truth = _cube(walk, radar)
    inner = slice(round(END_S * radar.prf_hz), -round(END_S * radar.prf_hz))
    errors = {}
    for rate in FILE_RATES_HZ:
        cube = _cube(t2d.resample(walk, rate), radar)
        last = min(len(cube), len(truth))
        errors[rate] = nmse_db(cube[:last][inner], truth[:last][inner])
    slow, *others = FILE_RATES_HZ
    return [
        Case(
            f"the same walk from a file of {name} Hz, field NMSE",
            at_least(f"the pose of the last frame of {rate:g} Hz", _held(walk, radar, rate), fails_by, "dB"),
            at_most("splines", max(errors[each] for each in rates), limit, "dB"),
        )
        for name, rate, rates, fails_by, limit in (
            (f"{slow:g}", slow, [slow], -3, -12),
            (f"{others[0]:g} to {others[-1]:g}", walk.rate_hz, others, -3, -30),
        )
    ]


def _cube(motion: Motion, radar: Radar) -> np.ndarray:
    return np.asarray(t2d.simulate(motion, radar=radar, method="ellipsoid").cube[:, 0])


def _held(motion: Motion, radar: Radar, rate_hz: float) -> float:
    """NMSE [dB] where each chirp sees the pose of the last frame."""
    body = t2d.segments(motion)
    times = radar.chirp_starts_s(4000)

    def series(track: PoseTrack) -> np.ndarray:
        static = Ellipsoids.from_track(track, body.semi_axes_m, body.times_s, PEC)
        echoes = ellipsoid_echoes(static, radar, times_s=times, material=PEC).gather()
        cycles = radar.mid_frequency_hz * echoes.delay_s
        return np.sum(echoes.amplitude * np.exp(2j * math.pi * (cycles % 1)), axis=1)

    held = series(lambda t: body.at(np.floor(t * rate_hz + 1e-9) / rate_hz))
    return nmse_db(held, series(body.at))
