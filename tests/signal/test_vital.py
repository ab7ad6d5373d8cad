"""Vital signs from samples written down by the IF formula: rates, displacements, and what is refused."""

from __future__ import annotations

import math
import warnings
from contextlib import nullcontext

import numpy as np
import pytest

from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.signal import VitalSigns, vital, vital_signs
from t2d_rt.signal.vital import circle_centre, signs_of
from t2d_rt.types import Breathing, Heartbeat, Radar

RADAR = Radar.preset(
    "iwr6843isk", multiplexing="simultaneous", tx_offsets_m=[[0, 0, 0]], prf_hz=50.0, sample_rate_hz=4e6, samples=128
)
BREATH, BEAT = Breathing(rate_hz=0.25, depth_m=0.005, phase_rad=1.0), Heartbeat(rate_hz=1.2, depth_m=0.0002)


def cube(radar: Radar, span_s: float, noise: float = 0.3) -> np.ndarray:
    """A chest at 2 m, a second person who breathes less at 4 m, a wall at 2.03 m in the chest's range cell, and noise."""
    starts = radar.chirp_times_s(span_s)
    chest = 2.0 - BREATH.displacement_m(starts) - BEAT.displacement_m(starts)
    other = 4.0 - 0.5 * Breathing(rate_hz=0.31, depth_m=0.006).displacement_m(starts)
    fast = radar.sample_times_s
    rng = np.random.default_rng(0)
    total = noise * (
        rng.standard_normal((len(starts), 4, radar.samples)) + 1j * rng.standard_normal((len(starts), 4, radar.samples))
    )
    for range_m, amplitude in ((chest, 1.0), (other, 0.4), (np.full(len(starts), 2.03), 1.7)):
        delay = 2 * range_m[:, None] / 299_792_458.0
        phase = radar.carrier_hz * delay + radar.slope_hz_per_s * delay * fast - radar.slope_hz_per_s * delay**2 / 2
        for antenna in range(4):
            total[:, antenna] += amplitude * np.exp(2j * np.pi * phase + 1.1j * antenna)
    return total.astype(np.complex64)


@pytest.mark.parametrize("burst", [None, 2])
def test_rates_and_displacements_are_those_of_the_chest(burst: int | None) -> None:
    radar = RADAR if burst is None else RADAR.replace(prf_hz=1000.0, chirps_per_frame=burst, frame_interval_s=0.05)
    found = vital_signs(cube(radar, 30.0), radar)
    assert found.range_m == pytest.approx(2.0, abs=radar.range_resolution_m / 2)
    assert (found.breathing_hz, found.heartbeat_hz) == pytest.approx((0.25, 1.2), rel=0.005)
    assert found.breathing_m == pytest.approx(0.005, rel=0.02)
    assert found.heartbeat_m == pytest.approx(0.0002, rel=0.05)
    assert found.heartbeat_db > 20
    truth = BREATH.displacement_m(found.time_s) + BEAT.displacement_m(found.time_s)
    assert np.corrcoef(truth, found.displacement_m)[0, 1] > 0.9999  # towards the radar is positive
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", T2DWarning)  # no heart beats there, and its line is noise
        farther = vital_signs(cube(radar, 30.0), radar, range_gate_m=(3.5, 4.5))
    assert (farther.range_m, farther.breathing_hz) == pytest.approx((4.0, 0.31), rel=0.02)
    assert "15.0 breaths a minute" in str(found)


@pytest.mark.parametrize(
    ("breath_hz", "beat_hz", "told"),
    [
        (0.25, 1.25, "5 times"), (0.2, 1.2, "6 times"), (0.25, 1.0, "4 times"), (0.25, 0.75, "3 times"),
        (0.3, 1.8, "6 times"), (0.3, 2.4, None),
    ],
)  # fmt: skip
def test_a_heart_on_a_multiple_of_the_breathing_rate_is_told_by_its_harmonics(
    breath_hz: float, beat_hz: float, told: str | None
) -> None:
    found = seen(breath_hz, beat_hz, told)
    assert (found.breathing_hz, found.heartbeat_hz) == pytest.approx((breath_hz, beat_hz), rel=0.005)
    assert found.heartbeat_m == pytest.approx(
        0.0002, rel=0.05 if beat_hz > 0.75 else 0.5
    )  # 1.5 Hz are breath and heart


@pytest.mark.parametrize(
    ("breath_hz", "beat_hz"), [(0.35, 1.04), (0.3, 0.92), (0.25, 1.265), (0.2, 1.18), (0.25, 1.51)]
)
def test_a_heart_beside_a_multiple_of_the_breathing_rate_is_told_apart(breath_hz: float, beat_hz: float) -> None:
    found = seen(breath_hz, beat_hz, None)  # a third to two thirds of a line from a harmonic of the breath
    assert found.heartbeat_hz == pytest.approx(beat_hz, rel=0.003)
    assert found.heartbeat_m == pytest.approx(0.0002, rel=0.1)


def test_a_heart_that_does_not_move_the_chest_is_missed_aloud() -> None:
    assert seen(0.3, 1.8, "no line of a heart", depth_m=0.0).heartbeat_db < vital.HEARTS_DB
    seen(0.25, 3.05, "3.05 Hz, is faster than 3 Hz")


def test_the_cell_whose_echo_keeps_to_its_circle_is_taken() -> None:
    """At 60 GHz, in one cell the chest alone, in the next, three times as strong, with a shoulder that moves a third as far."""
    time_s, wavelength_m = np.arange(1200) / 40.0, 299_792_458.0 / 60e9
    moved = BREATH.displacement_m(time_s) + BEAT.displacement_m(time_s)
    noise = np.random.default_rng(0).standard_normal((2, 1200, 2)) * 0.01
    echoes = [np.exp(-4j * np.pi * factor * moved / wavelength_m) for factor in (1.0, 0.35)]
    cells = np.column_stack([echoes[0], 2.5 * echoes[0] + 1.5j * echoes[1]]) + noise[0] + 1j * noise[1]
    found = signs_of(cells[:, None], np.array([1.8, 1.9]), time_s, wavelength_m)
    with pytest.warns(T2DWarning, match="no line of a heart"):
        alone = signs_of(cells[:, None, 1:], np.array([1.9]), time_s, wavelength_m)
    assert abs(alone.heartbeat_hz / 1.2 - 1) > 0.1
    assert (found.heartbeat_hz, found.breathing_m) == pytest.approx((1.2, 0.005), rel=0.01)
    assert found.range_m == 1.9


def noise(seed: int, power: float) -> np.ndarray:
    """Of one range cell of four antennas over 30 s, (1200, 4)."""
    drawn = np.random.default_rng(seed).standard_normal((2, 1200, 4))
    return math.sqrt(power / 2) * (drawn[0] + 1j * drawn[1])


def test_noise_that_varies_more_than_the_chest_is_no_person() -> None:
    """As flicker noise and leakage do next to the radar."""
    time_s, wavelength_m = np.arange(1200) / 40.0, 299_792_458.0 / 60e9
    moved = BREATH.displacement_m(time_s) + BEAT.displacement_m(time_s)
    chest = np.exp(-4j * np.pi * moved / wavelength_m)[:, None] + noise(0, 1e-3)
    cells = np.stack([40 + noise(1, 2.0), noise(2, 0.2), chest], axis=2)
    found = signs_of(cells, np.array([0.0, 0.1, 1.9]), time_s, wavelength_m)
    assert cells.var(axis=0).sum(axis=0).argmax() == 0
    assert (found.range_m, found.breathing_hz, found.heartbeat_hz) == pytest.approx((1.9, 0.25, 1.2), rel=0.005)
    with pytest.warns(T2DWarning) as told:
        signs_of(cells[:, :, :2], np.array([0.0, 0.1]), time_s, wavelength_m)
    assert any("m does not keep to a circle: the variance of its radius is 0.2" in str(each.message) for each in told)


def test_a_person_in_the_cells_of_the_leakage_is_doubtful() -> None:
    starts, radar = RADAR.chirp_times_s(30.0), RADAR
    moved = BREATH.displacement_m(starts) + BEAT.displacement_m(starts)
    samples = np.exp(-4j * np.pi * moved / radar.wavelength_m)[:, None, None] * np.ones((4, radar.samples))
    with pytest.warns(
        T2DWarning, match=r"at 0\.00 m, where the radar's leakage .* \(below 0\.\d+ m\).* give range_gate_m"
    ):
        vital_signs(samples.astype(np.complex64), radar)


@pytest.mark.parametrize("depth_m", [0.0003, 0.04])
def test_a_breath_that_no_chest_has_is_told(depth_m: float) -> None:
    time_s, wavelength_m = np.arange(1200) / 40.0, 0.01
    moved = Breathing(rate_hz=0.25, depth_m=depth_m).displacement_m(time_s) + BEAT.displacement_m(time_s)
    cells = np.exp(-4j * np.pi * moved / wavelength_m)[:, None, None] + 1e-3 * noise(0, 1.0)[:, :, None]
    with pytest.warns(T2DWarning, match="mm, where chests move by 4 to 12 mm"):
        signs_of(cells, np.array([2.0]), time_s, wavelength_m)


def seen(breath_hz: float, beat_hz: float, told: str | None, depth_m: float = 0.0002) -> VitalSigns:
    """Signs of 30 s of one range cell of four antennas at 77 GHz, and the warning that they come with, if any."""
    time_s, wavelength_m = np.arange(1200) / 40.0, 299_792_458.0 / 77e9
    moved = Breathing(rate_hz=breath_hz, depth_m=0.005, phase_rad=1.0).displacement_m(time_s)
    moved = moved + Heartbeat(rate_hz=beat_hz, depth_m=depth_m).displacement_m(time_s)
    noise = np.random.default_rng(0).standard_normal((2, 1200, 4)) * 0.003
    cells = np.exp(-4j * np.pi * moved / wavelength_m)[:, None] + noise[0] + 1j * noise[1]
    with nullcontext() if told is None else pytest.warns(T2DWarning, match=told):
        return signs_of(cells[:, :, None], np.array([2.0]), time_s, wavelength_m)


def test_short_and_still_records_are_refused() -> None:
    with pytest.raises(InputError, match="record longer"):
        vital_signs(cube(RADAR, 5.0), RADAR)
    slow = RADAR.replace(chirps_per_frame=2, frame_interval_s=0.2, prf_hz=1000.0)
    with pytest.raises(InputError, match=r"6\.07 profiles a second or more, .* got 5;"):
        vital_signs(cube(slow, 30.0), slow)
    with pytest.raises(InputError, match="all chirps are alike"):
        vital_signs(np.ones((800, 4, RADAR.samples), np.complex64), RADAR)


def test_harmonics_beyond_half_the_rate_of_the_profiles_are_left_out() -> None:
    times_s = np.arange(0, 30, 1 / 8)  # the second harmonic of the beat is at half of it
    out_m = BREATH.displacement_m(times_s) + 1e-4 * np.sin(2 * np.pi * 2.0 * times_s)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(times_s))
    profile = 0.5 + np.exp(4j * np.pi * out_m / 0.005) + noise
    found = signs_of(profile[:, None, None], np.array([2.0]), times_s, 0.005)
    assert (found.heartbeat_hz, found.heartbeat_m) == pytest.approx((2.0, 2e-4), rel=0.03)


def test_pratts_circle_keeps_its_size_on_a_short_arc() -> None:
    angle = np.linspace(0.0, 1.0, 400)
    rng = np.random.default_rng(1)
    points = 3 - 2j + 5 * np.exp(1j * angle) + 0.02 * (rng.standard_normal(400) + 1j * rng.standard_normal(400))
    assert abs(circle_centre(points) - (3 - 2j)) < 0.05
    assert circle_centre(np.linspace(1, 2, 50) * (1 + 1j)) == 0  # a straight line has none


def test_a_beat_has_its_depth_and_is_shorter_than_half_its_time() -> None:
    times_s = np.linspace(0, 1 / 1.2, 4001)
    out_m = BEAT.displacement_m(times_s)
    assert (out_m.min(), out_m.max()) == pytest.approx((0.0, 2e-4), abs=1e-12)
    assert np.mean(out_m > 1e-4) == pytest.approx(0.3, abs=0.02)
    assert BEAT.from_time(0.37).displacement_m(times_s) == pytest.approx(BEAT.displacement_m(times_s + 0.37), abs=1e-12)
    with pytest.raises(InputError, match="depth_m"):
        Heartbeat(rate_hz=1.2, depth_m=0.2)
