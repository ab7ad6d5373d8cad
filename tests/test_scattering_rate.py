"""The surface rate that a motion asks for, against the closed form of a swing."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import t2d_rt as t2d
from builders import icosphere
from t2d_rt.constants import SPEED_OF_LIGHT
from t2d_rt.scattering.rate import LEAST_HZ, MOST_HZ, ROTATION_RAD, STEP_HZ, TOLERANCE_DB, needed_rate_hz
from t2d_rt.types import MovingMesh, Radar

RADAR = Radar.preset("table2")
REST, FACES = icosphere(1, 0.05)


def swinging(amplitude_m: float, frequency_hz: float) -> MovingMesh:
    """A ball on boresight, 3 m away, that swings along it."""

    def places(times_s: np.ndarray) -> np.ndarray:
        ahead = 3 + amplitude_m * np.sin(2 * np.pi * frequency_hz * times_s)
        return REST + np.stack([ahead, 0 * ahead, 1 + 0 * ahead], axis=1)[:, None]

    return MovingMesh.from_track(places, FACES, np.linspace(0, 4, 200), rest=REST)


@pytest.mark.parametrize(("amplitude_m", "frequency_hz"), [(0.1, 4.0), (0.3, 6.0), (0.01, 12.0)])
def test_the_rate_leaves_what_is_tolerated(amplitude_m: float, frequency_hz: float) -> None:
    rate = needed_rate_hz(swinging(amplitude_m, frequency_hz), RADAR, (0.0, 4.0))
    assert LEAST_HZ < rate < MOST_HZ
    wavenumber = 2 * math.pi * RADAR.mid_frequency_hz / SPEED_OF_LIGHT
    # Out and back together are twice the swing; half of a sine's square is its mean.
    fourth = 2 * amplitude_m * (2 * math.pi * frequency_hz) ** 4
    expected = (0.406 / 2 * (wavenumber * fourth / 384) ** 2 / 10 ** (TOLERANCE_DB / 10)) ** (1 / 8)
    assert rate == pytest.approx(expected, abs=1.2 * STEP_HZ)
    # The spline itself, far from the ends of its record.
    frames, times = np.arange(0, 4 + 0.5 / rate, 1 / rate), np.linspace(1, 3, 20_001)
    path = [2 * amplitude_m * np.sin(2 * math.pi * frequency_hz * t) for t in (frames, times)]
    error = np.mean((wavenumber * (CubicSpline(frames, path[0])(times) - path[1])) ** 2)
    # At six frames a cycle, as of 12 Hz here, the orders that the fourth derivative leaves out add 1.3 dB.
    assert TOLERANCE_DB - 4 < 10 * np.log10(error) < TOLERANCE_DB + 2


def test_static_and_short_records() -> None:
    assert needed_rate_hz(swinging(0.0, 1.0), RADAR, (0.0, 4.0)) == LEAST_HZ
    # A part of a swing, about its middle.
    whole, short = (needed_rate_hz(swinging(0.1, 4.0), RADAR, (0.2, stop)) for stop in (4.0, 0.22))
    assert short == pytest.approx(whole, rel=0.3)


@pytest.mark.parametrize("rotation_hz", [15.0, 100.0])
def test_what_rotates_fast_has_a_high_surface_rate(rotation_hz: float) -> None:
    def turning(times_s: np.ndarray) -> np.ndarray:
        angle = 2 * np.pi * rotation_hz * times_s
        rotation = np.moveaxis(np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), 2, 0)
        flat = np.einsum("kij,vj->kvi", rotation, REST[:, :2])
        return np.concatenate([flat, np.tile(REST[:, 2:], (len(times_s), 1, 1))], axis=2) + [3, 0, 1]

    ball = MovingMesh.from_track(turning, FACES, np.array([0.0, 1.0]), rest=REST)
    # Edges in all directions: two thirds of their mean square lie across the axis.
    expected = 2 * np.pi * rotation_hz * math.sqrt(2 / 3) / ROTATION_RAD
    assert needed_rate_hz(ball, RADAR, (0.0, 1.0)) == pytest.approx(expected, rel=0.05)  # one edge of each of 80 faces


def test_a_jerk_between_the_short_records_counts() -> None:
    # The ball stands but for a tenth of a second. Twelve records of 46 ms lie 0.36 s apart, from 1.48 to 1.80 s there is none.
    times = np.linspace(0, 4, 4001)
    ahead = 3 + 0.02 * np.exp(-(((times - 1.64) / 0.03) ** 2)) * np.sin(2 * np.pi * 20 * times)
    centre = np.stack([ahead, 0 * ahead, 1 + 0 * ahead], axis=1)
    wavenumber = 2 * math.pi * RADAR.mid_frequency_hz / SPEED_OF_LIGHT
    fourth = np.diff(2 * ahead, n=4) / (times[1] - times[0]) ** 4
    expected = (0.406 * np.mean((wavenumber * fourth / 384) ** 2) / 10 ** (TOLERANCE_DB / 10)) ** (1 / 8)
    ball = MovingMesh(REST + centre[:, None], FACES, times)
    assert needed_rate_hz(ball, RADAR, (0.0, 4.0)) == pytest.approx(expected, rel=0.15)


def test_a_stand_in_tells_of_a_body_too_large_to_be_probed_in_full() -> None:
    motion = t2d.trim(t2d.load_motion(Path(__file__).parents[1] / "validation/motions/131_01.bvh.gz"), 1.0, 2.2)
    body, limbs = t2d.skin(motion), t2d.segments(motion)
    span_s = float(motion.times_s[0]), float(motion.times_s[-1])
    # A foot jerks at 21.8 m/s once in this recording; short records that lie end to end ask for 185 to 190 Hz.
    assert 170 < needed_rate_hz(body, RADAR, span_s, stand_in=limbs) < 220
    # Ellipsoids that stand still tell of no jerk, and what the short records of a large body miss stays missed.
    still = t2d.Ellipsoids(limbs.semi_axes_m, limbs.points_at(motion.times_s[:1]).repeat(2, axis=0), np.array(span_s))
    assert needed_rate_hz(body, RADAR, span_s, stand_in=still) < 100
