"""3D people tracking's detection on point targets summed from the IF formula, and the configuration file that it is read from."""

from __future__ import annotations

import numpy as np
import pytest

from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.signal import Detection, device_points, point_cloud, sensor, sensors, steering_vectors
from t2d_rt.signal.device import _detected
from t2d_rt.types.radar import Radar

# Chirps and detection in the numbers of no device: two transmitters, two receivers in a row and one row above it.
LINES = """
sensorStop
% a comment
profileCfg 0 60 10.00 5.00 40.00 197379 0 50 1 64 2000 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 4
frameCfg 0 1 32 0 50.00 1 0
dynamicRACfarCfg -1 2 3 2 2 4 10 2 10 6.00 7.00 0.50 1 1
dynamicRangeAngleCfg -1 1.0 0.0010 1 0
dynamic2DAngleCfg -1 2.0 0.0300 1 0 1 0.30 0.85 8.00
antGeometry0 0 -1 0 -1 -2 -3 -2 -3
antGeometry1 0 0 -1 -1 0 0 -1 -1
fovCfg -1 60.0 40.0
""".splitlines()


def cube(radar: Radar, bursts: int, moving: float, still: float, noise: float) -> np.ndarray:
    """A mover that comes at 0.4 m/s from 2 m, 0.3 to the left and 0.2 up, and a still target in the same direction."""
    direction = np.array([np.sqrt(1 - 0.3**2 - 0.2**2), 0.3, 0.2])
    times = radar.chirp_starts_s(bursts * (radar.loops_per_frame or 0))
    sent = times[:, None] + radar.antenna_delays_s
    beat = np.exp(2j * np.pi * radar.beat_frequency_hz(2.0) * (radar.sample_times_s - radar.mid_time_s))
    phase = np.exp(4j * np.pi / radar.wavelength_m * (2.0 - 0.4 * sent))
    drawn = np.random.default_rng(0).standard_normal((2, *sent.shape, radar.samples))
    echoes = (moving * phase + still)[:, :, None] * steering_vectors(radar, direction)[:, None] * beat
    return echoes + noise * (drawn[0] + 1j * drawn[1])


def changed(detection: Detection, **fields: object) -> Detection:
    return Detection(**{**detection.model_dump(), **fields})


def test_configuration_tells_the_radar() -> None:
    radar = Radar.from_ti_cfg(LINES, noise_figure_db=12.0)
    assert radar.carrier_hz == pytest.approx(60.25e9)  # 5 us after the ramp's start
    assert (radar.prf_hz, radar.frame_interval_s) == pytest.approx((20e3, 0.05))
    assert (radar.chirps_per_frame, radar.samples, radar.multiplexing) == (64, 64, "tdm")
    assert radar.tx_power_dbm == pytest.approx(12 - 3)  # 197379 is 0x030303
    assert radar.noise_figure_db == 12.0
    half = radar.wavelength_m / 2
    places = 2 * (radar.virtual_offsets_m - radar.virtual_offsets_m[0])
    np.testing.assert_allclose(places[:, 1] / half, [0, 1, 0, 1, 2, 3, 2, 3], atol=1e-9)
    np.testing.assert_allclose(places[:, 2] / half, [0, 0, -1, -1, 0, 0, -1, -1], atol=1e-9)
    found = Detection.from_ti_cfg(LINES)
    assert (found.range_skip, found.training_cells, found.guard_cells) == ((2, 3), (4, 10), (2, 10))
    assert (found.thresholds, found.side_lobe, found.field_of_view_deg) == ((6.0, 7.0), 0.5, (60.0, 40.0))


def test_points_lie_where_the_mover_is() -> None:
    radar, detection = Radar.from_ti_cfg(LINES), Detection.from_ti_cfg(LINES)
    points = device_points(cube(radar, 3, 1.0, 30.0, 0.5), radar, detection)
    assert len(np.unique(points.time_s)) == 3
    assert np.abs(points.range_m - 2.0).max() < 2 * radar.range_resolution_m
    loudest = points.snr_db.argmax()
    assert points.range_m[loudest] == pytest.approx(2.0, abs=radar.range_resolution_m / 2)
    left = np.sin(points.azimuth_rad) * np.cos(points.elevation_rad)
    assert left[loudest] == pytest.approx(0.3, abs=0.02)
    assert np.sin(points.elevation_rad[loudest]) == pytest.approx(0.2, abs=0.04)
    cell = radar.speed_axis_mps(32)
    assert np.abs(points.speed_mps - 0.4).max() <= cell[1] - cell[0]


@pytest.mark.parametrize("over", ["azimuth", "doppler"])
@pytest.mark.parametrize("factor", [1e-20, 1e-22, 1e-30, 1e20])
def test_weak_and_strong_cubes_give_the_same_points(over: str, factor: float) -> None:
    """In single precision, whose squares end at 1e-45 and 3e38."""
    radar, detection = Radar.from_ti_cfg(LINES), changed(Detection.from_ti_cfg(LINES), over=over)
    usual, clouds = cube(radar, 3, 1.0, 30.0, 0.5), []
    for samples in (usual, factor * usual):
        single = samples.astype(np.complex64)
        clouds.append((device_points(single, radar, detection), point_cloud(single, radar)))
    for expected, found in zip(*clouds, strict=True):
        assert len(expected.snr_db) > 2
        np.testing.assert_allclose(found.snr_db, expected.snr_db, atol=1e-3)
        np.testing.assert_allclose(found.xyz_m, expected.xyz_m, atol=1e-3)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_cells_without_any_power_give_no_nan() -> None:
    radar, detection = Radar.from_ti_cfg(LINES), changed(Detection.from_ti_cfg(LINES), over="doppler")
    alike = np.ones((64, 8, radar.samples), np.complex64)
    assert np.isfinite(device_points(alike, radar, detection).snr_db).all()


def test_a_part_of_a_burst_at_the_end_is_told() -> None:
    radar = Radar.from_ti_cfg(LINES)
    samples = cube(radar, 3, 1.0, 30.0, 0.5)
    for points in (device_points, point_cloud):
        with pytest.warns(T2DWarning, match="the last 12 of 76 rows are a part of a burst, which has 32, and give no"):
            cut = points(samples[:76], radar)
        assert np.array_equal(cut.snr_db, points(samples[:64], radar).snr_db)
    point_cloud(samples[:76], radar, frame_chirps=8)  # a window of 8 lies within the 12: nothing is told


def test_still_targets_and_noise_give_no_points() -> None:
    radar, detection = Radar.from_ti_cfg(LINES), Detection.from_ti_cfg(LINES)
    assert len(device_points(cube(radar, 10, 0.0, 30.0, 0.5), radar, detection).time_s) == 0


def test_a_weak_target_is_one_point_at_each_range_and_a_strong_one_many() -> None:
    radar, detection = Radar.from_ti_cfg(LINES), Detection.from_ti_cfg(LINES)
    points = device_points(cube(radar, 10, 0.17, 30.0, 0.5), radar, detection)
    cells = np.unique(np.stack([points.time_s, points.range_m]), axis=1).shape[1]
    assert 5 < len(points.time_s) == cells
    left = np.sin(points.azimuth_rad) * np.cos(points.elevation_rad)
    assert np.abs(left - 0.3).max() < 0.06
    strong = device_points(cube(radar, 10, 0.4, 30.0, 0.5), radar, detection)
    assert len(strong.time_s) > 5 * np.unique(np.stack([strong.time_s, strong.range_m]), axis=1).shape[1]


def test_the_ends_of_the_azimuths_are_no_neighbours() -> None:
    """Power that rises up to one end and, less, to the other: both are peaks, where none of them is skipped."""
    detection = changed(Detection.from_ti_cfg(LINES), angle_skip=(0, 0), side_lobe=0.0)
    heat = np.ones((60, 60))
    heat[30] = 20 + np.concatenate([np.linspace(9, 0, 30), np.linspace(0, 10, 30)])
    _, azimuths, _ = _detected(heat, changed(detection, thresholds=(5.0, 1e9)))
    assert azimuths.tolist() == [0, 59]


def test_thresholds_view_and_number_bound_the_points() -> None:
    radar, detection = Radar.from_ti_cfg(LINES), Detection.from_ti_cfg(LINES)
    adc = cube(radar, 1, 1.0, 0.0, 0.5)
    every = device_points(adc, radar, detection)
    assert len(every.time_s) > 4
    few = device_points(adc, radar, changed(detection, most_points=3))
    assert len(few.time_s) == 3
    assert few.snr_db.min() >= np.median(every.snr_db)
    loud = 10 ** (every.snr_db.max() / 10)
    beyond = changed(detection, thresholds=(loud * 1.01, 7.0))
    assert len(device_points(adc, radar, beyond).time_s) == 0
    near = device_points(adc, radar, changed(detection, range_skip=(40, 3))).range_m
    assert not ((near > 1.5) & (near < 2.5)).any()


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("profileCfg 0", "profile 0", "one line profileCfg"),
        ("0 0 0 0 0 4", "0 0 0 0 0 5", "one transmitter after the other"),
        ("antGeometry1 0 0 -1", "antGeometry1 0 0 -2", "no such array"),
        ("fovCfg -1 60.0", "fovCfg -1 sixty", "a command and its numbers"),
        ("1 64 2000", "1 nan 2000", "a command and its numbers"),
        ("1 64 2000", "1 64 0", "sample rate of profileCfg must be more than 0"),
        ("0 1 32 0 50.00", "0 1 32.5 0 50.00", "loops of frameCfg must be a whole number"),
        ("1 1 0 0 0 0 0 4", "1 1 0 1.0 0 0 0 4", "alike in profile"),
        ("sensorStop", "bpmCfg -1 1 0 1", "bpmCfg must be off"),
    ],
)
def test_configurations_that_tell_no_radar_are_refused(old: str, new: str, told: str) -> None:
    lines = "\n".join(LINES).replace(old, new).splitlines()
    with pytest.raises(InputError, match=told):
        Radar.from_ti_cfg(lines)


def test_a_configuration_is_a_file_or_its_lines() -> None:
    with pytest.raises(InputError, match="file or its lines, got None"):
        Radar.from_ti_cfg(None)  # type: ignore[arg-type]


DEMO = Detection(
    over="doppler", range_skip=(0, 0), training_cells=(8, 1), guard_cells=(4, 0), thresholds=(31.6, 1.0),
    field_of_view_deg=(89, 89),
)  # fmt: skip


def movers(
    radar: Radar, lefts: tuple[float, ...], speeds: tuple[float, ...], noise: float = 0.02, range_m: float = 2.0
) -> np.ndarray:
    """Targets at a range, 0.2 up, of direction cosines to the left and speeds toward the radar, in one burst."""
    total = 0.0
    for left, speed in zip(lefts, speeds, strict=True):
        sent = radar.chirp_starts_s(radar.loops_per_frame or 0)[:, None] + radar.antenna_delays_s
        beat = np.exp(2j * np.pi * radar.beat_frequency_hz(range_m) * (radar.sample_times_s - radar.mid_time_s))
        direction = np.array([np.sqrt(1 - left**2 - 0.2**2), left, 0.2])
        phase = np.exp(4j * np.pi / radar.wavelength_m * (range_m - speed * sent))
        total = total + (phase * steering_vectors(radar, direction))[:, :, None] * beat
    drawn = np.random.default_rng(0).standard_normal((2, *total.shape))
    return total + noise * (drawn[0] + 1j * drawn[1])


def test_the_demo_finds_range_speed_and_direction_of_a_mover() -> None:
    radar = Radar.from_ti_cfg(LINES)
    points = device_points(movers(radar, (0.3,), (0.4,)), radar, DEMO)
    loudest = points.snr_db.argmax()
    assert points.range_m[loudest] == pytest.approx(2.0, abs=radar.range_resolution_m / 2)
    step = np.diff(radar.speed_axis_mps(32))[0]
    assert points.speed_mps[loudest] == pytest.approx(0.4, abs=step / 2)
    left = np.sin(points.azimuth_rad) * np.cos(points.elevation_rad)
    assert left[loudest] == pytest.approx(0.3, abs=1 / 32)  # one cell of 64
    assert np.sin(points.elevation_rad[loudest]) == pytest.approx(0.2, abs=0.02)
    assert len(points.snr_db) > 1  # neighbouring cells are sent
    one = device_points(movers(radar, (0.3,), (0.4,)), radar, changed(DEMO, group=(True, True)))
    assert len(one.snr_db) == 1
    assert one.speed_mps[0] == points.speed_mps[loudest]


def test_the_ends_of_the_range_axis_are_no_neighbours() -> None:
    radar = Radar.from_ti_cfg(LINES)
    ends = radar.range_axis_m(64)[[0, -1]]
    adc = np.sum([movers(radar, (0.3,), (0.4,), range_m=each) for each in ends], axis=0)
    found = device_points(adc, radar, changed(DEMO, group=(True, True), second_peak=1.0))
    np.testing.assert_allclose(np.sort(found.range_m), ends)


def test_the_demo_sends_a_second_azimuth_of_a_cell_where_it_is_strong_enough() -> None:
    radar = Radar.from_ti_cfg(LINES)
    adc = movers(radar, (0.6, -0.5), (0.4, 0.4))
    both = device_points(adc, radar, changed(DEMO, group=(True, True)))
    left = np.sin(both.azimuth_rad) * np.cos(both.elevation_rad)
    np.testing.assert_allclose(np.sort(left), [-0.5, 0.6], atol=0.1)  # beams of four antennas
    assert len(device_points(adc, radar, changed(DEMO, group=(True, True), second_peak=1.0)).snr_db) == 1


def test_the_demo_sends_receding_points_first_and_no_more_than_it_can() -> None:
    radar = Radar.from_ti_cfg(LINES)
    adc = movers(radar, (0.3, 0.3), (1.0, -1.0))
    every = device_points(adc, radar, changed(DEMO, second_peak=1.0))
    signs = np.sign(every.speed_mps)
    assert (np.diff(signs[signs != 0]) >= 0).all()
    assert set(signs) >= {-1, 1}
    few = device_points(adc, radar, changed(DEMO, second_peak=1.0, most_points=3))
    np.testing.assert_array_equal(few.speed_mps, every.speed_mps[:3])


def test_sensors_have_the_cells_that_their_recordings_tell() -> None:
    for name, cell_mps, bin_m in (("mars", 0.356, 0.02929), ("radhar", 0.615, 0.0409)):
        radar, detection = sensor(name)
        assert np.diff(radar.speed_axis_mps(16))[0] == pytest.approx(cell_mps, rel=2e-3)
        assert radar.range_axis_m(256)[1] == pytest.approx(bin_m, rel=2e-3)
        assert detection.over == "doppler"
    assert sensors() == ["mars", "radhar"]
    assert sensor("mars", position_m=(0, 0, 1))[0].position_m == (0, 0, 1)
    with pytest.raises(InputError, match="sensor"):
        sensor("marz")


def test_one_antenna_has_no_azimuth() -> None:
    radar = Radar.preset("table2", chirps_per_frame=64, frame_interval_s=0.1)
    with pytest.raises(InputError, match="takes two antennas or more, got a radar of one"):
        device_points(np.zeros((64, 1, radar.samples), complex), radar)
