"""The surface rate that a motion asks for, against the closed form of a swing."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import builders
import t2d_rt as t2d
from builders import icosphere, slow_after
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.pipeline.targets import segments
from t2d_rt.scattering.rate import (
    LEAST_HZ,
    MOST_HZ,
    PROBE_RATE_HZ,
    ROTATION_DB,
    ROTATION_RAD,
    STEP_HZ,
    TOLERANCE_DB,
    SurfaceRate,
)
from t2d_rt.types import MovingMesh, Radar

RADAR = Radar.preset("table2")
REST, FACES = icosphere(1, 0.05)


def swinging(amplitude_m: float, frequency_hz: float) -> MovingMesh:
    """A ball on boresight, 3 m away, that swings along it."""

    def places(times_s: np.ndarray) -> np.ndarray:
        ahead = 3 + amplitude_m * np.sin(2 * np.pi * frequency_hz * times_s)
        return REST + np.stack([ahead, 0 * ahead, 1 + 0 * ahead], axis=1)[:, None]

    return MovingMesh.from_track(places, FACES, np.linspace(0, 4, 200), rest=REST)


def missed_db(ahead: Callable[[np.ndarray], np.ndarray], rate: float) -> float:
    """Energy of what a spline of a track's phases at that rate misses, far from its ends."""
    wavenumber = 2 * math.pi * RADAR.mid_frequency_hz / SPEED_OF_LIGHT
    frames, times = np.arange(0, 4 + 0.5 / rate, 1 / rate), np.linspace(1, 3, 20_001)
    missed = wavenumber * 2 * (CubicSpline(frames, ahead(frames))(times) - ahead(times))
    return 10 * math.log10(np.mean(missed**2) + 1e-30)


@pytest.mark.parametrize(("amplitude_m", "frequency_hz"), [(0.1, 4.0), (0.3, 6.0), (0.01, 12.0)])
def test_the_rate_leaves_what_is_tolerated(amplitude_m: float, frequency_hz: float) -> None:
    def ahead(times_s: np.ndarray) -> np.ndarray:
        return amplitude_m * np.sin(2 * math.pi * frequency_hz * times_s)

    rate = SurfaceRate(swinging(amplitude_m, frequency_hz), RADAR, (0.0, 4.0)).needed_hz()
    assert LEAST_HZ < rate < MOST_HZ
    assert missed_db(ahead, rate) < TOLERANCE_DB + 0.5
    assert missed_db(ahead, 0.9 * rate - STEP_HZ) > TOLERANCE_DB
    rates = SurfaceRate(swinging(amplitude_m, frequency_hz), RADAR, (0.0, 4.0))
    for given in (0.6 * rate, 1.5 * rate):
        # The ends of the record, at which splines miss more, count as well.
        assert -1 < rates.error_db(given) - missed_db(ahead, given) < 6


@pytest.mark.parametrize("frequency_hz", [0.5, 13.0, 200.0])
@pytest.mark.parametrize("amplitude_m", slow_after(1, [5e-6, 5e-4]))
def test_small_vibrations_are_resolved(amplitude_m: float, frequency_hz: float) -> None:
    rate = SurfaceRate(swinging(amplitude_m, frequency_hz), RADAR, (0.0, 4.0)).needed_hz()
    assert rate >= min(4.1 * frequency_hz, 820.0)
    assert rate <= max(LEAST_HZ, 5.5 * frequency_hz)
    # One of no account asks for nothing.
    assert SurfaceRate(swinging(5e-7, frequency_hz), RADAR, (0.0, 4.0)).needed_hz() == LEAST_HZ


def test_a_vibration_beside_a_larger_movement_is_resolved_and_noise_asks_for_no_more() -> None:
    times = np.linspace(0, 4, 4001)
    sway = 0.1 * np.sin(2 * np.pi * 2 * times)

    def rate_of(ahead: np.ndarray, kept: slice = slice(None)) -> float:
        centre = np.stack([3 + ahead, 0 * ahead, 1 + 0 * ahead], axis=1)[kept]
        return SurfaceRate(MovingMesh(REST + centre[:, None], FACES, times[kept]), RADAR, (0.0, 3.9)).needed_hz()

    alone = rate_of(sway)
    assert alone < 60
    assert 400 < rate_of(sway + 2e-5 * np.sin(2 * np.pi * 100 * times)) < 500
    # The noise of a motion file at 60 Hz ends at 30 Hz.
    noise = np.random.default_rng(3).normal(0, 3e-4, len(times))
    assert rate_of(sway + noise, slice(None, None, 17)) < 200


@pytest.mark.parametrize("what", ["mesh", "ellipsoids"])
def test_a_vibration_has_its_amplitude_and_no_other_lines(what: str) -> None:
    amplitude_m, frequency_hz, stop_s = 5e-5, 100.0, 0.1
    times = np.linspace(0, stop_s, 201)
    ahead = 3 + amplitude_m * np.sin(2 * np.pi * frequency_hz * times)
    centre = np.stack([ahead, 0 * ahead, 1 + 0 * ahead], axis=1)[:, None]
    target: MovingMesh | t2d.Ellipsoids = MovingMesh(REST + centre, FACES, times, "pec")
    if what == "ellipsoids":
        target = t2d.Ellipsoids(np.full((1, 3), 0.05), centre, times, material="pec")
    cube = np.asarray(t2d.simulate(target, radar=RADAR, clutter="none").cube)[:, 0]
    ranges = np.fft.fft(cube * np.hanning(cube.shape[1]), axis=1)
    echo = ranges[:, np.abs(ranges).sum(axis=0).argmax()]
    phase = np.unwrap(np.angle(echo))
    at = RADAR.chirp_times_s(stop_s) + RADAR.mid_time_s
    line = np.stack([np.sin(2 * np.pi * frequency_hz * at), np.ones(len(at))], axis=1)
    found = np.linalg.lstsq(line, phase, rcond=None)[0]
    expected = 4 * np.pi * RADAR.mid_frequency_hz / SPEED_OF_LIGHT * amplitude_m
    assert abs(found[0]) == pytest.approx(expected, rel=0.02)
    # The phases of a sphere at mid-sweep, the monostatic path being 1e-4 rad from there.
    assert np.abs(phase - line @ found).max() < 0.05 * expected


@pytest.mark.parametrize(("amplitude_m", "frequency_hz"), slow_after(1, [(5e-5, 20.0), (2e-5, 30.0), (5e-6, 36.0)]))
def test_a_tremor_on_a_walking_body_is_resolved(amplitude_m: float, frequency_hz: float) -> None:
    motion = t2d.place(builders.walk(), distance_m=6)
    limbs = segments(motion)
    centres, axes = limbs.track(motion.times_s)
    span_s = float(motion.times_s[0]), float(motion.times_s[-1])

    def rate_of(tremor_m: float) -> float:
        shaken = centres + tremor_m * np.sin(2 * np.pi * frequency_hz * motion.times_s)[:, None, None] * [1, 0, 0]
        return SurfaceRate(
            t2d.Ellipsoids(limbs.semi_axes_m, shaken, motion.times_s, axes=axes), RADAR, span_s
        ).needed_hz()

    assert rate_of(0.0) < 4 * frequency_hz
    assert 4.1 * frequency_hz <= rate_of(amplitude_m) <= 5 * frequency_hz
    # Twenty times weaker it is less than what the file's own rounding and filters leave.
    assert rate_of(0.05 * amplitude_m) == rate_of(0.0)


@pytest.fixture(scope="module")
def fine_walk() -> t2d.Motion:
    """A walk given a thousand times a second."""
    return t2d.resample(t2d.place(builders.walk(), distance_m=6), 1000.0)


@pytest.mark.parametrize(
    ("part", "span_s"), slow_after(3, [("arm", None), ("arm", (1.0, 1.4)), ("body", (1.0, 1.4)), ("body", None)])
)
@pytest.mark.parametrize(("amplitude_m", "frequency_hz"), [(2e-5, 20.0), (5e-6, 25.0), (5e-6, 200.0)])
def test_a_vibration_that_a_walk_hides_is_resolved_where_it_is_given_finely(
    fine_walk: t2d.Motion, amplitude_m: float, frequency_hz: float, part: str, span_s: tuple[float, float] | None
) -> None:
    """No spectrum shows it: at 20 Hz a walk moves more by itself. An arm is two of seventeen limbs."""
    motion = fine_walk if span_s is None else t2d.trim(fine_walk, *span_s)
    limbs = segments(motion)
    centres, axes = limbs.track(motion.times_s)
    tremor = amplitude_m * np.sin(2 * np.pi * frequency_hz * motion.times_s)[:, None, None] * [1, 0, 0]
    moved = [part == "body" or "left_forearm" in name or "left_hand" in name for name in limbs.names]
    assert any(moved)
    shaken = centres + tremor * np.array(moved)[:, None]
    span_s = float(motion.times_s[0]), float(motion.times_s[-1])
    rate = SurfaceRate(t2d.Ellipsoids(limbs.semi_axes_m, shaken, motion.times_s, axes=axes), RADAR, span_s).needed_hz()
    assert 3.8 * frequency_hz <= rate <= max(200, 4.5 * frequency_hz)


def test_a_motion_given_finely_is_searched_for_vibrations(fine_walk: t2d.Motion) -> None:
    """One of 0.02 mm at 200 Hz was taken for one of 40 Hz, as which it showed in the samples of the probe."""
    motion = t2d.trim(fine_walk, 0.5, 1.7)
    span_s = float(motion.times_s[0]), float(motion.times_s[-1])
    tremor = 2e-5 * np.sin(2 * np.pi * 200 * motion.times_s)[:, None, None] * [1, 0, 0]
    limbs = segments(replace(motion, joints=motion.joints + tremor))
    assert 800 <= SurfaceRate(limbs, RADAR, span_s).needed_hz() <= 900
    for rate_hz in (120.0, 240.0):
        recorded = t2d.resample(motion, rate_hz)
        assert SurfaceRate(segments(recorded), RADAR, span_s).needed_hz() < 90  # by its own movements alone


def test_an_ellipsoid_that_turns_about_its_centre_moves_its_specular_point() -> None:
    times = np.linspace(0, 2, 481)
    angle = 0.9 * np.sin(2 * np.pi * 2 * times)
    cos, sin, none = np.cos(angle), np.sin(angle), np.zeros(len(times))
    axes = np.stack([[cos, none, -sin], [none, none + 1, none], [sin, none, cos]], axis=1).transpose(2, 0, 1)[:, None]
    limb = t2d.Ellipsoids([[0.04, 0.04, 0.14]], np.tile([3.0, 0.0, 1.0], (len(times), 1, 1)), times, axes=axes)
    rate = SurfaceRate(limb, RADAR, (0.0, 2.0)).needed_hz()
    exact = CubicSpline(times, np.sqrt((0.04 * cos) ** 2 + (0.14 * sin) ** 2))
    frames, finer = np.linspace(0, 2, math.ceil(2 * rate) + 1), np.linspace(0.2, 1.8, 5001)
    wavenumber = 2 * math.pi * RADAR.mid_frequency_hz / SPEED_OF_LIGHT
    missed = wavenumber * 2 * (CubicSpline(frames, exact(frames))(finer) - exact(finer))
    assert LEAST_HZ < rate < 200
    assert 10 * math.log10(np.mean(missed**2)) < TOLERANCE_DB + 0.5


def test_static_and_short_records() -> None:
    assert SurfaceRate(swinging(0.0, 1.0), RADAR, (0.0, 4.0)).needed_hz() == LEAST_HZ
    # A part of a swing, about its middle.
    whole, short = (SurfaceRate(swinging(0.1, 4.0), RADAR, (0.2, stop)).needed_hz() for stop in (4.0, 0.22))
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
    rates = SurfaceRate(ball, RADAR, (0.0, 1.0))
    assert rates.needed_hz() == pytest.approx(expected, rel=0.05)  # one edge of each of 80 faces
    # Amplitudes of facets err by that much, as fans do, whatever the delays need.
    assert rates.error_db(rates.needed_hz()) == pytest.approx(ROTATION_DB, abs=1)


def test_a_recorded_body_is_not_searched_for_vibrations() -> None:
    """Its ellipsoids were probed four times as often as the motion asks for, which took longer than all their echoes."""
    motion = t2d.place(t2d.trim(builders.walk(), 2.0, 2.8))
    limbs, probed = segments(motion), 0

    def counting(times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        nonlocal probed
        probed += len(times_s)
        return limbs.track(times_s)

    body = t2d.Ellipsoids.from_track(counting, limbs.semi_axes_m, limbs.times_s, made=limbs.made)
    rate = SurfaceRate(body, RADAR, (float(motion.times_s[0]), float(motion.times_s[-1]))).needed_hz()
    assert rate < PROBE_RATE_HZ / 2
    assert probed < 1.1 * PROBE_RATE_HZ * 0.8


def test_a_jerk_between_the_short_records_counts() -> None:
    # The ball stands but for a tenth of a second. Twelve records of 46 ms lie 0.36 s apart, from 1.48 to 1.80 s there is none.
    times = np.linspace(0, 4, 4001)
    ahead = 3 + 0.02 * np.exp(-(((times - 1.64) / 0.03) ** 2)) * np.sin(2 * np.pi * 20 * times)
    centre = np.stack([ahead, 0 * ahead, 1 + 0 * ahead], axis=1)
    ball = MovingMesh(REST + centre[:, None], FACES, times)
    wavenumber = 2 * math.pi * RADAR.mid_frequency_hz / SPEED_OF_LIGHT

    def missed_by_db(rate: float) -> float:
        frames = np.linspace(0, 4, math.ceil(4 * rate) + 1)
        exact = CubicSpline(times, 2 * ahead)
        return 10 * math.log10(np.mean((wavenumber * (CubicSpline(frames, exact(frames))(times) - 2 * ahead)) ** 2))

    rate = SurfaceRate(ball, RADAR, (0.0, 4.0)).needed_hz()
    assert missed_by_db(rate) < TOLERANCE_DB + 0.5
    assert rate < 5.5 * 25  # the burst's own band


def test_a_stand_in_tells_of_a_body_too_large_to_be_probed_in_full() -> None:
    motion = t2d.trim(t2d.load_motion(Path(__file__).parents[2] / "validation/motions/131_01.bvh.gz"), 1.0, 2.2)
    body, limbs = t2d.skin(motion), t2d.segments(motion)
    span_s = float(motion.times_s[0]), float(motion.times_s[-1])
    # A foot jerks at 21.8 m/s once in this recording; the spline of the whole asks for 225.
    assert 170 < SurfaceRate(body, RADAR, span_s, limbs).needed_hz() < 260
    # Ellipsoids that stand still tell of no jerk, and what the short records of a large body miss stays missed.
    still = t2d.Ellipsoids(limbs.semi_axes_m, limbs.points_at(motion.times_s[:1]).repeat(2, axis=0), np.array(span_s))
    assert SurfaceRate(body, RADAR, span_s, still).needed_hz() < 100
