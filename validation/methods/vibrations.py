"""Vibrations of a sphere, of an ellipsoid and of a walking body: their amplitude, lines that are not there, and the rate chosen.

`python -m validation.methods.vibrations` prints a table. The sphere's phase is known in closed form; the body is held against
itself at four times the surface rate, its vibration as the difference from the same body without.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

import t2d_rt as t2d
from t2d_rt.types import Ellipsoids, MovingMesh, Radar
from validation.bodies import walking
from validation.physics.rcs import sphere

RADAR = Radar.preset("table2")
AMPLITUDES_M = 5e-6, 5e-5, 5e-4, 5e-3
FREQUENCIES_HZ = 0.5, 5.0, 20.0, 40.0, 100.0, 200.0
FASTEST_MPS = 8.0
PLACE_M, RADIUS_M, PHASE_RAD = np.array((2.5, 0.0, 1.0)), 0.05, 0.3
FINE_HZ = 1200.0


def ball(amplitude_m: float, frequency_hz: float, what: str, stop_s: float) -> MovingMesh | Ellipsoids:
    """A ball of metal that vibrates towards the radar: a mesh at frames, a function of time or an ellipsoid."""
    rest, faces = sphere(RADIUS_M, np.zeros(3), subdivisions=2)

    def places(times_s: np.ndarray) -> np.ndarray:
        ahead = amplitude_m * np.sin(2 * np.pi * frequency_hz * times_s + PHASE_RAD)
        return (PLACE_M + ahead[:, None] * (1, 0, 0))[:, None]

    if what == "function":
        return MovingMesh.from_track(lambda t: rest + places(t), faces, np.array((0, stop_s)), "pec", rest=rest)
    times = np.linspace(0, stop_s, int(stop_s * max(20 * frequency_hz, 50)) + 1)
    if what == "mesh":
        return MovingMesh(rest + places(times), faces, times, "pec")
    return Ellipsoids(np.full((1, 3), RADIUS_M), places(times), times, material="pec")


def alone(amplitude_m: float, frequency_hz: float, what: str) -> dict[str, Any]:
    """The amplitude's relative error, the strongest line [dBc] that should not be there, and the rate [Hz]."""
    stop_s = min(2.0, max(0.25, 3 / frequency_hz) if frequency_hz >= 5 else 2 / frequency_hz)
    found = t2d.simulate(ball(amplitude_m, frequency_hz, what, stop_s), radar=RADAR, clutter="none")
    cube = np.asarray(found.cube[:, 0])
    ranges = np.fft.fft(cube * np.hanning(cube.shape[1]), axis=1)
    echo = ranges[:, np.abs(ranges).sum(axis=0).argmax()]
    times = RADAR.chirp_times_s(stop_s)[: len(cube)] + RADAR.mid_time_s
    angle = 2 * np.pi * frequency_hz * times + PHASE_RAD
    per_m = 4 * np.pi / RADAR.wavelength_m
    lines = np.stack([np.sin(angle), np.cos(angle), np.ones_like(times), times], axis=1)
    phase = np.linalg.lstsq(lines, np.unwrap(np.angle(echo)), rcond=None)[0]
    expected = np.exp(1j * np.sign(phase[0]) * per_m * amplitude_m * np.sin(angle))
    rest = echo / np.mean(echo / expected) - expected
    window = np.hanning(len(rest))
    return {
        "amplitude": float(np.hypot(*phase[:2])) / (per_m * amplitude_m) - 1,
        "line": 20 * np.log10(np.abs(np.fft.fft(rest * window)).max() / window.sum()),
        "rate": found.settings["surface_rates_hz"][0],
    }


def on_a_body(amplitude_m: float, frequency_hz: float, body: MovingMesh, quiet: np.ndarray) -> dict[str, Any]:
    """The vibration's gain, the field's NMSE [dB] and the rate [Hz] of a body that vibrates as it walks."""

    def track(times_s: np.ndarray) -> np.ndarray:
        ahead = amplitude_m * np.sin(2 * np.pi * frequency_hz * times_s)
        return body.track(times_s) + ahead[:, None, None] * (1, 0, 0)

    shaken = like(body, track)
    found, rate = field(shaken)
    fine, _ = field(shaken, surface_rate_hz=max(FINE_HZ, 4 * rate))
    moved, wanted = (found - quiet).ravel(), (fine - quiet).ravel()
    return {
        "amplitude": float(np.vdot(wanted, moved).real / np.vdot(wanted, wanted).real) - 1,
        "nmse": 10 * np.log10(np.sum(np.abs(found - fine) ** 2) / np.sum(np.abs(fine) ** 2)),
        "rate": rate,
    }


def like(body: MovingMesh, track: Callable[[np.ndarray], np.ndarray]) -> MovingMesh:
    """A body with another track."""
    return MovingMesh.from_track(
        track, body.faces, body.times_s, "skin", rest=body.rest, curved=True, sagitta_rad=body.sagitta_rad
    )


def field(target: MovingMesh, **accuracy: float) -> tuple[np.ndarray, float]:
    """Samples by coarse facets without occlusion, in which only time errs, and the surface rate [Hz]."""
    how = {"occlusion": False, "sagitta_scale": 2.0, **accuracy}
    found = t2d.simulate(target, radar=RADAR, clutter="none", accuracy=how)
    return np.asarray(found.cube[:, 0]), found.settings["surface_rates_hz"][0]


def main() -> None:
    cases = [
        each for each in itertools.product(AMPLITUDES_M, FREQUENCIES_HZ) if 2 * np.pi * each[0] * each[1] < FASTEST_MPS
    ]
    for what, (amplitude_m, frequency_hz) in itertools.product(("mesh", "function", "ellipsoid"), cases):
        found = alone(amplitude_m, frequency_hz, what)
        print(f"{what:10s} {1e3 * amplitude_m:6.3f} mm {frequency_hz:6.1f} Hz  amplitude {100 * found['amplitude']:+6.2f} %  "
              f"line {found['line']:6.1f} dBc  {found['rate']:5.0f} Hz")  # fmt: skip
    body = walking(1.0, 1.5)
    quiet, _ = field(like(body, body.track), surface_rate_hz=FINE_HZ)
    for amplitude_m, frequency_hz in cases:
        found = on_a_body(amplitude_m, frequency_hz, body, quiet)
        print(f"on a walk  {1e3 * amplitude_m:6.3f} mm {frequency_hz:6.1f} Hz  amplitude {100 * found['amplitude']:+6.2f} %  "
              f"NMSE {found['nmse']:6.1f} dB  {found['rate']:5.0f} Hz")  # fmt: skip


if __name__ == "__main__":
    main()
