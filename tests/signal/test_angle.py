"""Antenna arrays on point targets summed in float64 from the IF formula (docs/physics.md, eq. 1), antenna by antenna."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np
import pytest
from scipy import stats

from measures import check_picture
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError
from t2d_rt.plots import plot_point_cloud, plot_range_angle
from t2d_rt.signal import (
    PointCloud,
    array_spectrum,
    cfar,
    cfar_factor,
    point_cloud,
    range_angle,
    range_doppler,
    separate_ddm,
    spectrogram,
    steering_vectors,
    unit_vectors,
)
from t2d_rt.types.radar import Radar

TDM = Radar.preset("array-3x4")
DDM = TDM.replace(multiplexing="ddm")
IMAGING = Radar.preset("imaging-12x16")
BIN_M = TDM.range_resolution_m

Target = tuple[float, float, float, float]
"""Range [m], azimuth and elevation [deg], speed towards the radar [m/s]."""


def echoes(radar: Radar, chirps: int, targets: Sequence[Target], power_w: float = 1.0) -> np.ndarray:
    """ADC cube complex128 of points of one power: every sample of every pair at its own time and place."""
    fast = radar.sample_times_s
    pairs = np.zeros((chirps, len(radar.tx_offsets_m), len(radar.rx_offsets_m), radar.samples), complex)
    for m, transmitter in enumerate(radar.tx_positions_m):
        slot_s = m / radar.prf_hz if radar.multiplexing == "tdm" else 0.0
        time = radar.chirp_starts_s(chirps)[:, None] + slot_s + fast
        for n, receiver in enumerate(radar.rx_positions_m):
            for range_m, azimuth_deg, elevation_deg, speed_mps in targets:
                ray = unit_vectors(math.radians(azimuth_deg), math.radians(elevation_deg)) @ radar.axes
                place = radar.position_m + (range_m - speed_mps * time)[..., None] * ray
                path = np.linalg.norm(place - transmitter, axis=-1) + np.linalg.norm(place - receiver, axis=-1)
                delay = path / SPEED_OF_LIGHT
                cycles = radar.carrier_hz * delay + radar.slope_hz_per_s * (delay * fast - delay**2 / 2)
                pairs[:, m, n] += math.sqrt(power_w) * np.exp(2j * np.pi * cycles)
    if radar.multiplexing == "ddm":
        return np.einsum("kmns,km->kns", pairs, radar.tx_phase(np.arange(chirps)))
    return pairs.reshape(chirps, -1, radar.samples)


def noise(shape: tuple[int, ...], seed: int, power_w: float = 1.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return math.sqrt(power_w / 2) * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))


def strongest(points: PointCloud) -> tuple[float, ...]:
    """Range, azimuth and elevation [deg], speed of the point with the highest SNR."""
    top = int(np.argmax(points.snr_db))
    angles = np.degrees([points.azimuth_rad[top], points.elevation_rad[top]])
    return float(points.range_m[top]), float(angles[0]), float(angles[1]), float(points.speed_mps[top])


# --- the direction of one target ---


@pytest.mark.parametrize("elevation", [10.0, -10.0])
@pytest.mark.parametrize("azimuth", [30.0, -30.0, 0.0])
@pytest.mark.parametrize("speed", [0.0, 1.5, -5.0])
def test_direction_of_a_point(azimuth: float, elevation: float, speed: float) -> None:
    radar = TDM.replace(position_m=(1, 2, 3), boresight=(0.5, 1, 0.2))
    cube = echoes(radar, 64, [(5.0, azimuth, elevation, speed)])
    points = point_cloud(cube, radar, frame_chirps=64, mti="none")
    found = strongest(points)
    middle = 5.0 - speed * 32 * radar.loop_interval_s
    coupling = radar.mid_frequency_hz * speed / radar.slope_hz_per_s
    assert found[0] + coupling == pytest.approx(middle, abs=0.1 * BIN_M)
    # Half a Doppler bin is not compensated of a mover.
    assert found[1:3] == pytest.approx((azimuth, elevation), abs=0.1 if speed else 0.01)
    assert found[3] == pytest.approx(speed, abs=0.05 * radar.speed_resolution_mps(64 * radar.loop_interval_s))
    assert points.time_s == pytest.approx(32 * radar.loop_interval_s)
    ray = unit_vectors(math.radians(azimuth), math.radians(elevation))
    assert np.allclose(points.xyz_m[np.argmax(points.snr_db)], (middle - coupling) * ray, atol=0.02)


@pytest.mark.parametrize(("speed", "least_deg"), [(1.5, 1.0), (5.0, 4.0)])
def test_tdm_phase_of_a_mover(speed: float, least_deg: float) -> None:
    cube = echoes(TDM, 64, [(5.0, 30.0, 10.0, speed)])
    plain = strongest(point_cloud(cube, TDM, frame_chirps=64, compensate_tdm=False))
    compensated = strongest(point_cloud(cube, TDM, frame_chirps=64))
    assert abs(plain[1] - 30.0) > least_deg
    assert compensated[1:3] == pytest.approx((30.0, 10.0), abs=0.1)
    # The phase itself: what transmitter m has more than the ideal radar, row by row.
    ideal = TDM.replace(multiplexing="simultaneous", prf_hz=TDM.prf_hz / 3)
    at_once = array_spectrum(echoes(ideal, 64, [(5.0, 30.0, 10.0, speed)]), ideal).spectrum
    row, _, column = np.unravel_index(np.abs(at_once).argmax(), at_once.shape)
    doppler_hz = -2 * speed / TDM.wavelength_m
    for compensate, expected in ((False, 2 * np.pi * doppler_hz * TDM.antenna_delays_s), (True, np.zeros(12))):
        taken = array_spectrum(cube, TDM, compensate_tdm=compensate).spectrum
        extra = np.angle(taken[row, :, column] / at_once[row, :, column] * np.exp(-1j * expected))
        assert np.abs(extra).max() < 0.05  # half a Doppler bin is 0.03 rad at the last transmitter


def test_one_antenna_has_no_angles() -> None:
    radar = Radar.preset("table2")
    points = point_cloud(echoes(radar, 64, [(5.0, 20.0, 5.0, 2.0)]), radar, frame_chirps=64)
    assert not points.azimuth_rad.any()
    assert not points.elevation_rad.any()
    assert strongest(points)[3] == pytest.approx(2.0, abs=0.05)
    row = TDM.replace(tx_offsets_m=TDM.tx_offsets_m[::2])
    points = point_cloud(echoes(row, 64, [(5.0, 20.0, 0.0, 2.0)]), row, frame_chirps=64)
    assert strongest(points)[1:3] == pytest.approx((20.0, 0.0), abs=0.1)


def test_direction_is_the_beam_s_maximum() -> None:
    # Two targets in one cell make a lopsided lobe: its top, not where its flanks are even.
    row = TDM.replace(tx_offsets_m=TDM.tx_offsets_m[::2])
    cube = echoes(row, 16, [(40 * BIN_M, 12.0, 0.0, 0.0), (40 * BIN_M + 6e-4, -9.0, 0.0, 0.0)])
    axis = np.radians(np.arange(-40, 40, 0.02))
    power = range_angle(cube, row, azimuth_rad=axis, range_gate_m=(40 * BIN_M - 0.01, 40 * BIN_M + 0.01)).power[0]
    points = point_cloud(cube, row, frame_chirps=16, mti="none")
    assert strongest(points)[1] == pytest.approx(np.degrees(axis[power.argmax()]), abs=0.05)


# --- maps ---


def test_speeds_of_a_tdm_cube_count_loops() -> None:
    wall, mover = (5.0, 30.0, 10.0, 0.0), (5.0, 30.0, 10.0, 6.0)
    cube = echoes(TDM, 192, [wall, mover])
    for image in (
        spectrogram(cube, TDM, n_window=64, overlap=32, mti="mean"),
        spectrogram(cube, TDM, n_window=64, overlap=32, mti="highpass", cutoff_mps=1.0),
    ):
        assert image.velocity_mps[image.power.argmax(axis=0)] == pytest.approx(6.0, abs=0.15)
        assert image.time_s == pytest.approx((np.arange(5) * 32 + 32) * TDM.loop_interval_s)
    doppler = range_doppler(echoes(TDM, 64, [mover]), TDM)
    row = np.unravel_index(doppler.power.argmax(), doppler.power.shape)[0]
    assert doppler.velocity_mps[row] == pytest.approx(6.0, abs=0.15)
    # Beyond the limit of PRF / 3 a target folds.
    folded = range_doppler(echoes(TDM, 64, [(5.0, 30.0, 10.0, 10.0)]), TDM)
    row = np.unravel_index(folded.power.argmax(), folded.power.shape)[0]
    assert folded.velocity_mps[row] == pytest.approx(10.0 - 2 * TDM.max_speed_mps, abs=0.15)


@pytest.mark.parametrize(("azimuth", "speed"), [(0.0, 0.0), (30.0, 1.5), (-50.0, 1.5)])
def test_range_angle_reads_the_power(azimuth: float, speed: float) -> None:
    coupling = TDM.mid_frequency_hz * speed / TDM.slope_hz_per_s
    range_m = 40 * BIN_M + coupling + speed * 32 * TDM.loop_interval_s  # on a bin in the middle of the record
    cube = echoes(TDM, 64, [(range_m, azimuth, 0.0, speed)], power_w=3e-9)
    for far_field in (False, True):
        result = range_angle(cube.astype(np.complex64), TDM, far_field=far_field)
        assert result.power.shape == (256, len(result.azimuth_rad))
        row, column = np.unravel_index(result.power.argmax(), result.power.shape)
        assert row == 40
        assert 10 * np.log10(result.power.max() / 3e-9) == pytest.approx(0, abs=0.05)
        assert np.degrees(result.azimuth_rad[column]) == pytest.approx(azimuth, abs=0.6)


def test_two_targets_in_one_range_bin() -> None:
    cube = echoes(TDM, 64, [(5.0, 25.0, 0.0, 1.0), (5.0, -15.0, 0.0, -1.0), (5.0, -40.0, 0.0, -1.0)])
    column = round(5.0 / BIN_M)
    axis = np.radians(np.arange(-80, 80.5, 0.5))
    power = range_angle(cube, TDM, azimuth_rad=axis).power[column]
    tops = (
        np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] > power[2:]) & (power[1:-1] > 0.5 * power.max())) + 1
    )
    assert np.degrees(axis[tops]) == pytest.approx([-40, -15, 25], abs=2.0)  # neighbours' sidelobes pull
    towards = range_angle(cube, TDM, azimuth_rad=axis, speed_gate_mps=(0.5, 1.5), range_gate_m=(4.9, 5.1))
    assert np.degrees(axis[towards.power.max(axis=0).argmax()]) == pytest.approx(25, abs=0.5)
    assert towards.range_m.min() >= 4.9
    assert towards.range_m.max() <= 5.1
    points = point_cloud(cube, TDM, frame_chirps=64, mti="none")
    # One point for each range and speed: the mover alone is where it is.
    mover = np.argmin(np.abs(points.speed_mps - 1.0) + np.abs(points.range_m - 5.0))
    assert np.degrees(points.azimuth_rad[mover]) == pytest.approx(25, abs=0.5)


def test_elevation_of_the_map() -> None:
    cube = echoes(TDM, 32, [(40 * BIN_M, 10.0, 30.0, 0.0)])
    gate_m = 39.5 * BIN_M, 40.5 * BIN_M
    levels = [
        range_angle(cube, TDM, elevation_rad=math.radians(e), range_gate_m=gate_m).power.max() for e in (-30, 0, 30)
    ]
    assert levels[2] == pytest.approx(1.0, rel=0.01)
    assert levels[0] < levels[1] < levels[2]


def test_static_echoes_are_removed() -> None:
    cube = echoes(TDM, 64, [(4.0, 0.0, 0.0, 0.0), (6.0, 20.0, 0.0, 2.0)])
    kept, removed = (range_angle(cube, TDM, mti=mti, range_gate_m=(0.0, 6.5)) for mti in ("none", "mean"))
    wall, mover = (round(r / BIN_M) for r in (4.0, 6.0))
    assert removed.power[wall].max() < 1e-3 * kept.power[wall].max()
    assert removed.power[mover].max() == pytest.approx(kept.power[mover].max(), rel=0.02)
    assert strongest(point_cloud(cube, TDM, frame_chirps=64))[0] == pytest.approx(6.0, abs=0.1)


def test_steering_vectors() -> None:
    directions = unit_vectors(np.radians([-40.0, 10.0]), np.radians(20.0))
    far = steering_vectors(TDM, directions)
    assert far.shape == (2, 12)
    assert np.allclose(np.abs(far), 1)
    expected = np.exp(-4j * np.pi / TDM.wavelength_m * directions @ TDM.virtual_offsets_m.T)
    assert np.allclose(far, expected)
    assert np.allclose(steering_vectors(TDM, directions, np.full(2, 1e5)), far, atol=1e-4)
    # Left of boresight is nearer to the left antennas: less delay, less phase.
    left = steering_vectors(TDM, unit_vectors(0.05, 0.0))
    assert np.angle(left[-1]) < 0 < np.angle(left[0])


@pytest.mark.parametrize(("near_m", "loss_db"), [(3.0, 0.15), (1.0, 1.1)])
def test_imaging_array_near_by(near_m: float, loss_db: float) -> None:
    """Within the Fraunhofer distance 2 D^2 / lambda of 5.5 m plane waves lose power, beams in focus do not."""
    range_m = round(near_m / IMAGING.range_resolution_m) * IMAGING.range_resolution_m
    cube = echoes(IMAGING, 8, [(range_m, 20.0, 0.0, 0.0)]).astype(np.complex64)
    options = {"range_gate_m": (range_m - 0.05, range_m + 0.05), "doppler_window": "boxcar"}
    focused, far = range_angle(cube, IMAGING, **options), range_angle(cube, IMAGING, **options, far_field=True)
    assert 10 * np.log10(focused.power.max()) == pytest.approx(0, abs=0.05)
    assert 10 * np.log10(far.power.max()) < -loss_db
    top = focused.azimuth_rad[focused.power[0].argmax()]
    assert np.degrees(top) == pytest.approx(20, abs=0.2)
    width = np.ptp(focused.azimuth_rad[focused.power[0] > 0.5 * focused.power.max()])
    assert np.degrees(width) < 1.6  # 0.886 lambda / (2 L cos 20), L = 85 lambda / 4
    points = point_cloud(cube, IMAGING, frame_chirps=8, mti="none", doppler_window="boxcar")
    assert strongest(points)[1:3] == pytest.approx((20.0, 0.0), abs=0.05)


# --- Doppler division ---


def test_ddm_equals_simultaneous() -> None:
    ideal = DDM.separated
    targets = [(5.0, 30.0, 10.0, 1.5), (7.0, -20.0, 0.0, -6.0), (6.0, 0.0, 0.0, 0.0)]
    cube, expected = echoes(DDM, 3 * 64, targets), echoes(ideal, 64, targets)
    assert cube.shape == (192, 4, 256)
    taken = separate_ddm(cube, DDM)
    assert taken.shape == expected.shape == (64, 12, 256)
    # Away from the record's ends, where the bands leak into one another, and in the windowed spectra.
    middle = slice(16, 48)
    assert np.mean(np.abs(taken - expected)[middle] ** 2) < 1e-3 * np.mean(np.abs(expected[middle]) ** 2)
    spectrum, ideal_spectrum = array_spectrum(cube, DDM).spectrum, array_spectrum(expected, ideal).spectrum
    difference = np.abs(spectrum - ideal_spectrum).max(axis=(1, 2)) / np.abs(ideal_spectrum).max()
    assert difference.max() < 0.02  # at the edges of the bands, where the one at -6 m/s leaks over
    assert difference[8:-8].max() < 1e-3
    single = echoes(DDM, 192, targets[:1])
    assert strongest(point_cloud(single, DDM, frame_chirps=64))[1:] == pytest.approx((30.0, 10.0, 1.5), abs=0.1)
    doppler = range_doppler(single, DDM)
    assert np.abs(doppler.velocity_mps).max() <= DDM.max_speed_mps * (1 + 1e-9)
    image = spectrogram(single, DDM, n_window=32, overlap=16)
    assert image.velocity_mps[image.power.argmax(axis=0)] == pytest.approx(1.5, abs=0.4)


def test_ddm_in_bursts() -> None:
    burst = DDM.replace(chirps_per_frame=96, frame_interval_s=0.02)
    targets = [(5.0, 30.0, 0.0, 1.5)]
    cube = echoes(burst, 192, targets)
    taken, ideal = separate_ddm(cube, burst), burst.separated
    assert np.array_equal(taken[32:], separate_ddm(cube[96:], burst))
    points = point_cloud(cube, burst)
    assert np.unique(points.time_s) == pytest.approx([0.00192, 0.02192])
    image = spectrogram(cube, burst)
    assert image.time_s == pytest.approx([0.00192, 0.02192])
    assert ideal.loops_per_frame == 32


# --- detection ---


def test_threshold_in_closed_form() -> None:
    for rate in (1e-2, 1e-4, 1e-8):
        assert cfar_factor(rate, 16) == pytest.approx(16 * (rate ** (-1 / 16) - 1), rel=1e-9)
        # OS-CFAR of one look (Rohling 1983), its factor against the mean: the 12th of 16 cells.
        factor = cfar_factor(rate, 16, method="os") / -math.log(0.25)
        closed = math.prod((16 - i) / (16 - i + factor) for i in range(12))
        assert closed == pytest.approx(rate, rel=1e-3)
    # Many cells, one look: the exponential law itself.
    assert cfar_factor(1e-4, 1000) == pytest.approx(-math.log(1e-4), rel=5e-3)
    # Looks: the ratio of two gamma variables has an F distribution.
    for looks in (2, 12, 192, 3000):
        assert cfar_factor(1e-4, 16, looks=looks) == pytest.approx(stats.f.isf(1e-4, 2 * looks, 32 * looks), rel=1e-6)
    # Cells that are all one: as many as one.
    assert cfar_factor(1e-2, np.ones((16, 16))) == pytest.approx(cfar_factor(1e-2, 1), rel=1e-6)


@pytest.mark.parametrize("window", ["boxcar", "hann"])
@pytest.mark.parametrize("method", ["ca", "os"])
def test_false_alarm_rate(method: str, window: str) -> None:
    rate, alarms, cells = 1e-3, 0, 0
    for seed in range(6):
        spectrum = array_spectrum(
            noise((64, 12, 256), seed).astype(np.complex64), TDM, range_window=window, doppler_window=window
        ).spectrum
        power = np.mean(np.abs(spectrum) ** 2, axis=1)
        level, found, factor = cfar(power, rate, looks=12, method=method, windows=(window, window))
        assert np.array_equal(found, power > factor * level)
        alarms, cells = alarms + int(found.sum()), cells + found.size
        assert level.mean() == pytest.approx(power.mean(), rel=0.03)
    assert 1 / 1.5 < alarms / (rate * cells) < 1.5


def test_false_alarms_of_one_antenna_and_of_a_cross() -> None:
    power = noise((512, 512), 1).real ** 2 + noise((512, 512), 1).imag ** 2
    shape = {"guard_cells": (1, 1), "training_cells": (6, 6), "windows": ("boxcar", "boxcar")}
    for method in ("ca", "os"):
        _, found, _ = cfar(power, 1e-3, method=method, **shape)
        assert 1 / 1.5 < found.mean() / 1e-3 < 1.5


def test_snr_and_detection_in_noise() -> None:
    # 30 dB below the noise of a sample: 42 dB from the FFTs (64 chirps of 256 samples), less the windows' 3.5 dB.
    range_m = 40 * BIN_M
    cube = echoes(TDM, 256, [(range_m, 30.0, 10.0, 2.0)], power_w=1e-2) + noise((256, 12, 256), 3)
    points = point_cloud(cube.astype(np.complex64), TDM, frame_chirps=64, false_alarm_rate=1e-6)
    assert np.unique(points.time_s) == pytest.approx((np.arange(4) * 64 + 32) * TDM.loop_interval_s)
    assert len(points.snr_db) < 8
    for time in np.unique(points.time_s):
        frame = points.time_s == time
        top = np.flatnonzero(frame)[points.snr_db[frame].argmax()]
        expected = -20 + 10 * np.log10(64 * 256) - 3.52
        assert points.snr_db[top] == pytest.approx(expected, abs=3.0)
        assert np.degrees(points.azimuth_rad[top]) == pytest.approx(30, abs=2)
        assert np.degrees(points.elevation_rad[top]) == pytest.approx(10, abs=5)
        assert points.speed_mps[top] == pytest.approx(2.0, abs=0.05)


def test_antennas_help_to_detect() -> None:
    # Peak cell at 6 times the noise: above the threshold of 12 antennas (2.5 at 1e-4), not of one (11.4).
    assert cfar_factor(1e-4, 24, looks=12) < 3
    assert cfar_factor(1e-4, 24) > 11
    power_w = 6 * 2.25 / (64 * 256)
    targets = [(40 * BIN_M, 0.0, 0.0, 4 * TDM.speed_resolution_mps(64 * TDM.loop_interval_s))]
    cube = echoes(TDM, 256, targets, power_w=power_w) + noise((256, 12, 256), 5)
    points = point_cloud(cube, TDM, frame_chirps=64)
    near = (np.abs(points.range_m - 40 * BIN_M) < BIN_M) & (np.abs(points.speed_mps - targets[0][3]) < 0.4)
    assert near.sum() == 4
    assert points.snr_db[near].max() < 10 * np.log10(11)


def test_leakage_about_zero_range_is_left_out_and_masks_nothing() -> None:
    """What stands at IFs about zero and changes from chirp to chirp, beside a target at 1 m and one at 3 m."""
    targets = [(1.0, 20.0, 0.0, 1.5), (3.0, -20.0, 0.0, -1.0)]
    leak = noise((256, 12, 1), 6, power_w=30.0) * np.ones(TDM.samples)
    cube = echoes(TDM, 256, targets, power_w=0.05) + noise((256, 12, 256), 7) + leak
    kept, all_of = (point_cloud(cube, TDM, frame_chirps=64, **options) for options in ({}, {"nearest_m": 0}))
    assert kept.nearest_m == 0.3
    assert (all_of.range_m < 0.3).mean() > 0.8
    assert kept.range_m.min() > 0.3
    for distance, _, _, speed in targets:
        near, before = (
            (np.abs(each.range_m - distance) < BIN_M) & (np.abs(each.speed_mps - speed) < 0.3)
            for each in (kept, all_of)
        )
        assert near.sum() == 4
        assert before.sum() == (0 if distance == 1 else 4)  # the leakage among the training cells hides it
    with pytest.raises(
        InputError, match=r"nearest_m must leave some of this radar's 25 m of range, got 25 m; lower it"
    ):
        point_cloud(cube, TDM, frame_chirps=64, nearest_m=25)


def test_neither_silence_nor_rounding_errors_are_detected() -> None:
    silent = point_cloud(np.zeros((64, 12, 256), np.complex64), TDM, frame_chirps=32)
    assert silent.snr_db.shape == (0,)
    assert silent.xyz_m.shape == (0, 3)
    assert repr(silent) == "PointCloud(no points)"
    cube = echoes(TDM, 64, [(5.0, 30.0, 10.0, 1.5)]).astype(np.complex64)
    points = point_cloud(cube, TDM, frame_chirps=64, dynamic_range_db=40, range_window="blackmanharris")
    assert points.snr_db == pytest.approx([40])
    assert strongest(points) == pytest.approx((5.0, 30.0, 10.0, 1.5), abs=0.01)
    assert repr(points) == "PointCloud(1 points, 4.99 to 4.99 m, 1.50 to 1.50 m/s, 0.00 to 0.00 s)"
    map_of = range_angle(cube, TDM, range_gate_m=(4, 6))
    assert re.fullmatch(
        r"RangeAngle\(\d+ ranges x \d+ azimuths, 4\.\d\d to 5\.\d\d m, -\d.* to \d.* deg\)", repr(map_of)
    )


# --- figures and guards ---


def test_figures(tmp_path) -> None:
    cube = echoes(TDM, 64, [(5.0, 30.0, 10.0, 1.5), (3.0, -10.0, 0.0, -1.0)])
    result = range_angle(cube, TDM, range_gate_m=(0, 8))
    points = point_cloud(cube, TDM, frame_chirps=64)
    figures = {
        "range_angle": plot_range_angle(result.range_m, result.azimuth_rad, 10 * np.log10(result.power), title="Two"),
        "points": plot_point_cloud(points.xyz_m, points.speed_mps, title="Two"),
    }
    for name, figure in figures.items():
        figure.savefig(tmp_path / f"{name}.png")
        check_picture(tmp_path / f"{name}.png", colours=100)
    axes = figures["range_angle"].axes[0]
    assert axes.get_xlim()[0] > axes.get_xlim()[1]  # left on the left
    above, side, bar = figures["points"].axes
    assert above.get_xlim()[0] > above.get_xlim()[1]
    assert side.get_ylabel() == "Up [m]"
    assert "[m/s]" in bar.get_ylabel()
    with pytest.raises(InputError, match=r"xyz_m must have shape \(4, 3\), one row for each speed, got \(3, 3\)"):
        plot_point_cloud(np.zeros((3, 3)), np.zeros(4))
    with pytest.raises(InputError, match="nothing to plot: the point cloud is empty"):
        plot_point_cloud(np.zeros((0, 3)), np.zeros(0))


def test_guards() -> None:
    cube = np.ones((64, 12, 256), np.complex64)
    with pytest.raises(InputError, match="the radar has 12 antennas, not 4; chirps of 3 transmitters in turn"):
        array_spectrum(cube[:, :4], TDM)
    with pytest.raises(InputError, match=r"must have shape \(chirp, antenna, 256\)"):
        point_cloud(cube[:, 0], TDM)
    with pytest.raises(InputError, match="only a cube with multiplexing='ddm' is separated, this radar's is 'tdm'"):
        separate_ddm(cube, TDM)
    with pytest.raises(
        InputError, match="need whole loops of 3 chirps and whole bursts, got 64 chirps; give the first 63"
    ):
        separate_ddm(cube[:, :4], DDM)
    with pytest.raises(InputError, match="mti of an array's spectrum must be 'none' or 'mean', got 'canceller'"):
        range_angle(cube, TDM, mti="canceller")
    with pytest.raises(InputError, match=r"speed gate 20..30 m/s holds no Doppler bin"):
        range_angle(cube, TDM, speed_gate_mps=(20, 30))
    with pytest.raises(InputError, match="range-Doppler map needs evenly spaced chirps, got 64 in bursts of 32"):
        array_spectrum(cube, TDM.replace(chirps_per_frame=96, frame_interval_s=0.1))
    for frame in (4, 65):
        with pytest.raises(InputError, match=r"frame_chirps must lie in 8..64 .* got"):
            point_cloud(cube, TDM, frame_chirps=frame)
    with pytest.raises(InputError, match="points take a cube of 8 chirps or more, got 3 rows"):
        point_cloud(cube[:3], TDM)
    for rate in (0.0, 0.9, np.nan):
        with pytest.raises(InputError, match=r"false_alarm_rate must lie in 1e-12..0.5"):
            point_cloud(cube, TDM, false_alarm_rate=rate)
    with pytest.raises(InputError, match=r"dynamic_range_db must lie in 0.001..300 dB, got 0"):
        point_cloud(cube, TDM, dynamic_range_db=0)
    with pytest.raises(InputError, match="method of the CFAR must be 'ca' or 'os', got 'go'"):
        point_cloud(cube, TDM, method="go")
    with pytest.raises(
        InputError, match="4 guard and 200 training cells on either side do not fit into 249 cells of range"
    ):
        point_cloud(cube, TDM, training_cells=(0, 200))
    with pytest.raises(InputError, match=r"a CFAR needs training cells, got \(0, 0\)"):
        point_cloud(cube, TDM, training_cells=(0, 0))
