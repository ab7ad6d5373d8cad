"""Antennas of a radar: arrays and their time slots, patterns, polarisation, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from t2d_rt.core.errors import InputError
from t2d_rt.radar import check_speed
from t2d_rt.types.antennas import CosinePower, Cuts, Isotropic, Tabulated, polarization_product
from t2d_rt.types.radar import Radar

TABLE2 = Radar.preset("table2")
TDM = Radar.preset("array-3x4")
DDM = TDM.replace(multiplexing="ddm")
IDEAL = TDM.replace(multiplexing="simultaneous")
TABLE = {
    "kind": "table",
    "azimuth_deg": [-60.0, 0.0, 60.0],
    "elevation_deg": [-30.0, 30.0],
    "gain_db": [[-12.0, -6.0], [0.0, -2.0], [-12.0, -6.0]],
}


def direction(azimuth_deg: float, elevation_deg: float = 0.0) -> np.ndarray:
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])


# --- arrays ---


def test_one_antenna_is_as_before() -> None:
    for multiplexing in ("simultaneous", "tdm", "ddm"):
        radar = TABLE2.replace(multiplexing=multiplexing)
        assert radar.antennas == 1
        assert np.array_equal(radar.antenna_delays_s, [0.0])
        assert radar.max_speed_mps == TABLE2.max_speed_mps
        assert radar.loop_interval_s == TABLE2.chirp_interval_s
        assert np.array_equal(radar.chirp_times_s(0.1), TABLE2.chirp_times_s(0.1))
        assert np.array_equal(radar.speed_axis_mps(64), TABLE2.speed_axis_mps(64))


def test_order_of_the_virtual_antennas() -> None:
    radar = IDEAL.replace(tx_offsets_m=((0, 0, 0), (0, 1, 2)), rx_offsets_m=((0, 0, 0), (0, 3, 0), (1, 0, 0)))
    expected = [(0, 0, 0), (0, 1.5, 0), (0.5, 0, 0), (0, 0.5, 1), (0, 2, 1), (0.5, 0.5, 1)]
    assert np.allclose(radar.virtual_offsets_m, expected)
    assert np.allclose(radar.virtual_positions_m, np.array(expected) + [0, 0, 1])
    rotated = radar.replace(boresight=(0, 1, 0))
    assert np.allclose(rotated.virtual_positions_m[4], (-2, 0, 2))  # left of y is -x


def test_transmitters_send_one_after_the_other() -> None:
    interval = TDM.chirp_interval_s
    assert (TDM.antennas, DDM.antennas, IDEAL.antennas) == (12, 4, 12)
    assert np.allclose(TDM.antenna_delays_s, np.repeat([0, 1, 2], 4) * interval)
    assert not DDM.antenna_delays_s.any()
    assert not IDEAL.antenna_delays_s.any()
    assert (TDM.loop_chirps, DDM.loop_chirps, IDEAL.loop_chirps) == (3, 1, 1)
    assert TDM.max_speed_mps == DDM.max_speed_mps == pytest.approx(IDEAL.max_speed_mps / 3)
    assert TDM.speed_axis_mps(64)[-1] == pytest.approx(TDM.max_speed_mps)
    assert DDM.speed_axis_mps(64)[-1] == pytest.approx(IDEAL.max_speed_mps)
    assert np.allclose(TDM.chirp_starts_s(4), np.arange(4) * 3 * interval)
    assert np.allclose(DDM.chirp_starts_s(4), np.arange(4) * interval)


def test_only_whole_loops_lie_within_the_record() -> None:
    sampled = TDM.sample_times_s[-1]
    duration = 5 * TDM.loop_interval_s + TDM.antenna_delays_s[-1] + sampled
    assert len(TDM.chirp_times_s(duration)) == 6
    assert len(TDM.chirp_times_s(duration * (1 - 1e-5))) == 5
    assert len(DDM.chirp_times_s(duration)) == 18
    assert len(DDM.chirp_times_s(duration * (1 - 1e-5))) == 15
    with pytest.raises(InputError, match=r"holds no whole loop; it must be at least 0.0001055 s"):
        TDM.chirp_times_s(1e-4)


def test_bursts_hold_whole_loops() -> None:
    burst = TDM.replace(chirps_per_frame=192, frame_interval_s=0.05)
    assert burst.loops_per_frame == 64
    times = burst.chirp_times_s(0.15)
    assert len(times) == 3 * 64
    assert np.allclose(times.reshape(3, 64), 0.05 * np.arange(3)[:, None] + np.arange(64) * TDM.loop_interval_s)
    separated = burst.replace(multiplexing="ddm").separated
    assert separated.loops_per_frame == 64
    assert np.allclose(separated.chirp_times_s(0.15), times)


def test_the_phase_code_repeats_after_m_chirps() -> None:
    phase = DDM.tx_phase(np.arange(7))
    assert phase.shape == (7, 3)
    assert np.allclose(phase[:, 0], 1)
    assert np.allclose(phase[1], np.exp(-2j * np.pi * np.arange(3) / 3))
    assert np.array_equal(phase[:3], phase[3:6])
    assert np.array_equal(TDM.tx_phase(np.arange(7)), np.ones((7, 3)))
    assert DDM.separated.multiplexing == "simultaneous"
    assert DDM.separated.loop_interval_s == pytest.approx(TDM.loop_interval_s)
    assert TDM.separated is TDM


def test_speed_warning_counts_the_time_slots() -> None:
    with pytest.warns(UserWarning, match=r"exceeds the unambiguous 8.03 m/s .* raise prf_hz to 31130"):
        check_speed(TDM, 10.0)
    assert TDM.replace(prf_hz=31130).max_speed_mps >= 10.0


def test_layouts() -> None:
    half = TDM.wavelength_m / 2
    row = np.sort(TDM.virtual_offsets_m[TDM.virtual_offsets_m[:, 2] == 0, 1])
    assert np.allclose(np.diff(row) * 2, half, rtol=1e-3)
    assert len(row) == 8
    assert TDM.virtual_offsets_m[:, 2].max() * 2 == pytest.approx(half, rel=1e-3)
    imaging = Radar.preset("imaging-12x16")
    lowest = imaging.virtual_offsets_m[imaging.virtual_offsets_m[:, 2] == 0, 1]
    spacing = 1.951774e-3 / 2
    places = np.unique(np.rint(lowest / spacing * 2)) / 2
    assert len(places) == 86
    assert np.allclose(np.diff(places), 1)
    heights = np.unique(np.rint(imaging.virtual_offsets_m[:, 2] / spacing))
    assert np.array_equal(heights, [0, 1, 4, 6])


# --- patterns ---


def test_defaults_give_exactly_one() -> None:
    rng = np.random.default_rng(0)
    departure, arrival = (v / np.linalg.norm(v, axis=-1, keepdims=True) for v in rng.standard_normal((2, 50, 4, 3)))
    assert np.array_equal(TABLE2.antenna_factor(departure, arrival), np.ones((50, 4)))
    assert TABLE2.antenna_factor(departure, arrival[0, 0]).shape == (50, 4)


@pytest.mark.parametrize("exponent", [0.5, 2.0, 7.3])
def test_cosine_power(exponent: float) -> None:
    pattern = CosinePower(exponent=exponent)
    for angle in (0.0, 20.0, 60.0, 89.0):
        expected = np.cos(np.radians(angle)) ** exponent
        assert pattern.gain(direction(angle)) == pytest.approx(expected, rel=1e-12)
        assert pattern.gain(direction(0, -angle)) == pytest.approx(expected, rel=1e-12)
    assert pattern.gain(direction(120)) == 0
    # Directivity 2 (n + 1): the mean of the gain over the sphere is its inverse.
    cosine = np.linspace(0, 1, 200_001)
    directions = np.stack([cosine, np.sqrt(1 - cosine**2), 0 * cosine], axis=-1)
    assert np.trapezoid(pattern.gain(directions), cosine) / 2 == pytest.approx(1 / (2 * (exponent + 1)), rel=1e-5)


def test_half_power_beamwidth() -> None:
    for width in (10.0, 60.0, 120.0):
        pattern = CosinePower(half_power_beamwidth_deg=width)
        assert pattern.gain(direction(width / 2)) == pytest.approx(0.5, rel=1e-12)
    assert CosinePower(half_power_beamwidth_deg=120).power == pytest.approx(1)


def test_table_is_bilinear_in_db() -> None:
    pattern = Tabulated(**TABLE)
    directions = np.array(
        [direction(0, -30), direction(0, 30), direction(60, 30), direction(30, 0), direction(-45, 15)]
    )
    level_db = 10 * np.log10(pattern.gain(directions))
    assert np.allclose(level_db, [0, -2, -6, (0 - 2 - 12 - 6) / 4, 0.75 * -7.5 + 0.25 * -1.5])


def test_cuts_add_up_in_db() -> None:
    pattern = Cuts(
        azimuth_deg=[-60, 0, 60], azimuth_db=[-6, 0, -12], elevation_deg=[-90, 0, 15], elevation_db=[-20, 0, -5]
    )
    found = pattern.gain(
        np.array([direction(30), direction(0, 15), direction(-30, 7.5), direction(90), direction(0, 80)])
    )
    np.testing.assert_allclose(10 * np.log10(found), [-6, -5, -3 - 2.5, -12, -5], atol=1e-9)
    with pytest.raises(InputError, match="must ascend and have a level each"):
        Cuts(azimuth_deg=[-60, 0], azimuth_db=[-6, 0, 0], elevation_deg=[-9, 9], elevation_db=[0, 0])
    with pytest.raises(InputError, match="elevation_db of a pattern of cuts is relative to its peak and so reaches 0"):
        Cuts(azimuth_deg=[-60, 0], azimuth_db=[-6, 0], elevation_deg=[-9, 9], elevation_db=[-3, -4])


@pytest.mark.parametrize(
    "name",
    [
        "iwr6843isk", "iwr6843aop", "awr1843boost", "iwr1443boost", "iwr1642boost", "awr2243-cascade", "bgt60tr13c",
        "k-mc1",
    ],
)  # fmt: skip
def test_no_product_has_more_gain_than_its_lobe_is_narrow(name: str) -> None:
    """Gain is at most directivity, the inverse of the pattern's mean over the sphere, and patches lose 0 to 5 dB."""
    radar = Radar.preset(name)
    sine = np.linspace(-1, 1, 721)[:, None]
    azimuth = np.linspace(-np.pi, np.pi, 721)
    across = np.sqrt(1 - sine**2)
    directions = np.stack(np.broadcast_arrays(across * np.cos(azimuth), across * np.sin(azimuth), sine), axis=-1)
    directivity_dbi = -10 * np.log10(radar.tx_pattern.gain(directions)[:-1, :-1].mean())
    assert directivity_dbi - 6.5 < radar.tx_gain_dbi < directivity_dbi + 0.3


def test_patterns_follow_the_radar() -> None:
    radar = TABLE2.replace(tx_pattern={"kind": "cosine", "exponent": 4}, rx_pattern=TABLE, boresight=(0, 1, 0))
    ahead, right = np.array([0.0, 1.0, 0.0]), np.array([0.5, np.sqrt(0.75), 0.0])  # 30 degrees to the right
    assert radar.antenna_factor(ahead, ahead) == pytest.approx(10 ** (-1 / 20))
    expected = np.sqrt(0.75**2 * 10 ** (-0.5))
    assert radar.antenna_factor(right, right) == pytest.approx(expected)
    swapped = radar.replace(tx_pattern=radar.rx_pattern, rx_pattern=radar.tx_pattern)
    assert swapped.antenna_factor(right, ahead) == pytest.approx(radar.antenna_factor(ahead, right))


def test_pattern_guards() -> None:
    with pytest.raises(InputError, match=r"azimuth of 0 to 90 degrees is asked .* tabulated from -60 to 60; extend"):
        Tabulated(**TABLE).gain(np.stack([direction(0), direction(90)]))
    with pytest.raises(InputError, match=r"elevation of -40 to -40 degrees is asked .* from -30 to 30"):
        Tabulated(**TABLE).gain(direction(0, -40))
    with pytest.raises(InputError, match="azimuth_deg of a tabulated pattern must ascend"):
        Tabulated(**{**TABLE, "azimuth_deg": [-60, 60, 0]})
    with pytest.raises(InputError, match=r"gain_db must have 3 rows \(azimuth\) of 2 numbers .* transpose"):
        Tabulated(**{**TABLE, "gain_db": [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]})
    with pytest.raises(InputError, match="relative to the peak and so 0 or less, got 3"):
        Tabulated(**{**TABLE, "gain_db": [[0.0, 3.0]] * 3})
    with pytest.raises(InputError, match="azimuth_deg is missing; give it"):
        Tabulated(elevation_deg=[0, 1], gain_db=[[0]])
    with pytest.raises(InputError, match=r"needs either exponent or half_power_beamwidth_deg, got 2.0 and 60.0"):
        CosinePower(exponent=2, half_power_beamwidth_deg=60)
    with pytest.raises(InputError, match="an antenna pattern must be a mapping"):
        Isotropic.model_validate(3)


def test_patterns_in_yaml(tmp_path) -> None:
    radar = TDM.replace(tx_pattern=CosinePower(half_power_beamwidth_deg=60), rx_pattern=TABLE, tx_polarization_deg=45)
    radar.to_yaml(tmp_path / "radar.yaml")
    assert Radar.from_yaml(tmp_path / "radar.yaml") == radar
    assert radar.replace(prf_hz=1000) != radar
    assert isinstance(radar.replace(prf_hz=1000).rx_pattern, Tabulated)


# --- polarisation ---


def test_malus() -> None:
    ahead = direction(0)
    for tx, rx in ((0, 90), (30, 75), (-20, 100), (0, 180)):
        radar = TABLE2.replace(tx_polarization_deg=tx, rx_polarization_deg=rx)
        assert radar.antenna_factor(ahead, ahead) == pytest.approx(np.cos(np.radians(tx - rx)), abs=1e-12)


def test_off_boresight_polarisations_are_made_transverse() -> None:
    # Vertical and 45 degrees, seen 60 degrees to the left: the horizontal part shortens to cos 60.
    ray = direction(60)
    found = polarization_product(ray, ray, 0.0, np.pi / 4)
    assert found == pytest.approx(1 / np.hypot(1, 0.5))
    # Horizontal and vertical stay perpendicular in both main planes, but not between them.
    assert polarization_product(direction(60), direction(60), 0.0, np.pi / 2) == pytest.approx(0, abs=1e-12)
    y, z = direction(40, 30)[1:]
    expected = -y * z / np.sqrt((1 - y**2) * (1 - z**2))
    assert polarization_product(direction(40, 30), direction(40, 30), 0.0, np.pi / 2) == pytest.approx(expected)
    # Two antennas apart: the ray is the bisector.
    assert polarization_product(direction(80), direction(40), 0.0, np.pi / 4) == pytest.approx(1 / np.hypot(1, 0.5))
    # Nothing goes along a polarisation's own axis.
    assert polarization_product(direction(0, 90), direction(0, 90), 0.0, 1.0) == pytest.approx(0, abs=1e-9)


def test_antennas_close_together_have_one_view() -> None:
    def views(apart_m: float) -> list[np.ndarray]:
        return Radar.preset("table2", tx_offsets_m=[[0, -apart_m / 2, 0]], rx_offsets_m=[[0, apart_m / 2, 0]]).views_m

    np.testing.assert_allclose(views(0.008), [[0, 0, 1]])
    np.testing.assert_allclose(views(0.2), [[0, -0.1, 1], [0, 0.1, 1]])
