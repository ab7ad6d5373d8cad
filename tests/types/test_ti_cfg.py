"""Configuration files of TI's radars, against the formulas of TI's programming guide (SWRA553), computed here anew.

The eight files are written from knowledge of public demos' profiles (out-of-box, people counting, vital signs, raw capture), for
devices and SDK versions that differ; none is a copy of a file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.types.radar import Radar
from t2d_rt.types.radar_track import RadarTrack
from t2d_rt.types.ti_cfg import BOARDS, OF_BOARD

HEAD = "sensorStop\nflushCfg\ndfeDataOutputMode 1\n"
TX12 = "chirpCfg 0 0 0 0 0 0 0 1\nchirpCfg 1 1 0 0 0 0 0 2\n"
TX13 = "chirpCfg 0 0 0 0 0 0 0 1\nchirpCfg 1 1 0 0 0 0 0 4\n"
TX132 = f"{TX13}chirpCfg 2 2 0 0 0 0 0 2\n"
FILES: dict[str, tuple[str, tuple[float, float, float, float, int, int, float, int, int], str | None]] = {
    # (start GHz, ADC start us, slope MHz/us, rate ksps, samples, chirps of a loop, chirp us, loops, antennas), board
    "xwr1443_sdk1": (
        f"% Platform:xWR14xx\n{HEAD}channelCfg 15 7 0\nadcCfg 2 1\nadcbufCfg 0 1 0 1\n"
        "profileCfg 0 77 7 6 60 0 0 60 1 256 5000 0 0 30\n"
        f"{TX132}frameCfg 0 2 16 0 100 1 0\nguiMonitor 1 1 0 0 0 1\nsensorStart\n",
        (77, 6, 60, 5000, 256, 3, 67, 16, 12), None,
    ),
    "xwr1443_two_of_three": (
        f"{HEAD}channelCfg 15 5 0\nadcCfg 2 1\nadcbufCfg 0 1 0 1\nprofileCfg 0 77 39 7 57.14 0 0 70 1 240 4884 0 0 30\n{TX13}"
        "frameCfg 0 1 32 0 100 1 0\nsensorStart",
        (77, 7, 70, 4884, 240, 2, 96.14, 32, 8), "iwr1443boost",
    ),
    "xwr1642_sdk2": (
        f"{HEAD}channelCfg 15 3 0\nadcCfg 2 1\nadcbufCfg -1 0 1 1 1\nprofileCfg 0 77 30 7 62 0 0 60 1 128 2500 0 0 30\n{TX12}"
        "frameCfg 0 1 128 0 50 1 0\nlvdsStreamCfg -1 0 0 0\nsensorStart",
        (77, 7, 60, 2500, 128, 2, 92, 128, 8), "unknown",
    ),
    "xwr1642_one": (
        f"{HEAD}channelCfg 1 1 0\nadcCfg 2 1\nprofileCfg 0 77 7 7 212.8 0 0  18.32 1 1024 5000 0 0 40\nchirpCfg 0 0 0 0 0 0 0 1\n"
        "frameCfg 0 0 1 0 500 1 0\nsetProfileCfg disable ADC disable\nsensorStart",
        (77, 7, 18.32, 5000, 1024, 1, 219.8, 1, 1), None,
    ),
    "xwr1843_sdk3": (
        f"% Created for SDK ver:03.05\n% Platform:xWR18xx\n{HEAD}channelCfg 15 7 0\nadcCfg 2 1\nadcbufCfg -1 0 1 1 1\n"
        f"profileCfg 0 77 267 7 57.14 0 0 70 1 256 5209 0 0 30\n{TX132}frameCfg 0 2 16 0 100 1 0\nsensorStart\n",
        (77, 7, 70, 5209, 256, 3, 324.14, 16, 12), None,
    ),
    "xwr6843_isk": (
        f"% Platform:xWR68xx\n{HEAD}channelCfg 15 7 0\nadcCfg 2 1\nprofileCfg 0 60 359 7 57.14 0 0 70 1 256 5209 0 0 158\n{TX132}"
        "frameCfg 0 2 16 0 100 1 0\nbpmCfg -1 0 0 0\nsensorStart\n",
        (60, 7, 70, 5209, 256, 3, 416.14, 16, 12), None,
    ),
    "xwr6843_vital": (
        f"% Platform:xWR68xx\n{HEAD}channelCfg 15 1 0\nadcCfg 2 1\nprofileCfg 0 60 7 6 63 0 0 62 1 250 4500 0 0 40\n"
        "chirpCfg 0 0 0 0 0 0 0 1\nframeCfg 0 0 2 0 50 1 0\nsensorStart\n",
        (60, 6, 62, 4500, 250, 1, 70, 2, 4), None,
    ),
    "xwr6843aop_variations": (
        f"% Platform:xWR68xx_AOP\n{HEAD}channelCfg 15 5 0\nadcCfg 2 1\nprofileCfg 2 60 20 5 40 0 0 50 1 128 4000 0 0 40\n"
        "chirpCfg 4 4 2 250e6 0 3 1 1\nchirpCfg 5 5 2 250e6 0 3 1 4\nframeCfg 4 5 24 0 40 1 0\nsensorStart\n",
        (60.25, 6, 50, 4000, 128, 2, 63, 24, 8), None,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
@pytest.mark.filterwarnings("ignore:the .cfg file tells neither antGeometry nor the board")
def test_carrier_bandwidth_resolutions_and_antennas_are_those_of_tis_formulas(name: str, tmp_path: Path) -> None:
    text, (start, adc_us, slope, rate, samples, senders, chirp_us, loops, antennas), board = FILES[name]
    (tmp_path / "profile.cfg").write_text(text)
    radar = Radar.from_ti_cfg(tmp_path / "profile.cfg", board=None if board == "unknown" else board)
    bandwidth = slope * 1e12 * samples / (rate * 1e3)
    centre = start * 1e9 + slope * 1e12 * (adc_us * 1e-6 + samples / 2 / (rate * 1e3))
    wavelength = SPEED_OF_LIGHT / centre
    assert radar.bandwidth_hz == pytest.approx(bandwidth, rel=1e-9)
    # TI's centre is that of the sampled time, half a sample later than the mean of the samples' times.
    assert radar.mid_frequency_hz == pytest.approx(centre - slope * 1e12 / 2 / (rate * 1e3), rel=1e-9)
    assert radar.range_resolution_m == pytest.approx(SPEED_OF_LIGHT / (2 * bandwidth), rel=1e-9)
    assert radar.max_range_m == pytest.approx(rate * 1e3 * SPEED_OF_LIGHT / (2 * slope * 1e12), rel=1e-9)
    assert radar.max_speed_mps == pytest.approx(wavelength / (4 * senders * chirp_us * 1e-6), rel=1e-3)
    doppler_s = (radar.loops_per_frame or 0) * radar.loop_interval_s
    assert radar.speed_resolution_mps(doppler_s) == pytest.approx(
        wavelength / (2 * loops * senders * chirp_us * 1e-6), rel=1e-3
    )
    assert radar.antennas == antennas


def test_masks_choose_the_boards_antennas_in_the_order_of_the_chirps() -> None:
    board, radar = Radar.preset("awr1843boost"), Radar.from_ti_cfg(FILES["xwr1843_sdk3"][0].splitlines())
    found, expected = (np.subtract(each.tx_offsets_m, each.tx_offsets_m[0]) for each in (radar, board))
    np.testing.assert_allclose(found, expected[[0, 2, 1]], atol=1e-12)
    assert (radar.tx_pattern, radar.tx_gain_dbi) == (board.tx_pattern, board.tx_gain_dbi)
    # Eight in a row, lambda/2 apart, and four one step higher: the virtual array of the board's guide.
    places = 2 * radar.virtual_offsets_m / 0.0019467
    row = places[:8]
    np.testing.assert_allclose(np.diff(row[:, 1]), 1, atol=1e-3)
    np.testing.assert_allclose(places[8:, 2] - row[0, 2], 1, atol=1e-3)
    half = FILES["xwr1843_sdk3"][0].replace("channelCfg 15", "channelCfg 10")
    assert len(Radar.from_ti_cfg(half.splitlines()).rx_offsets_m) == 2


def test_the_platform_of_a_board_with_two_transmitters_is_known() -> None:
    """Eight antennas in one row, lambda/2 apart, of a file without antGeometry."""
    radar = Radar.from_ti_cfg(["% Platform:xWR16xx", *FILES["xwr1642_sdk2"][0].splitlines()])
    board = Radar.preset("iwr1642boost")
    assert (radar.tx_offsets_m, radar.rx_offsets_m) == (board.tx_offsets_m, board.rx_offsets_m)
    np.testing.assert_allclose(np.diff(2 * radar.virtual_offsets_m[:, 1] / 0.0019467), 1, atol=1e-3)


@pytest.mark.parametrize(
    "name", ["xwr1443_two_of_three", "xwr1843_sdk3", "xwr6843_isk", "xwr6843_vital", "xwr6843aop_variations"]
)
def test_what_is_written_is_read_back(name: str, tmp_path: Path) -> None:
    text, _, board = FILES[name]
    radar = Radar.from_ti_cfg(text.splitlines(), board=board, tx_power_dbm=9.0)
    radar.to_ti_cfg(tmp_path / "a.cfg")
    again = Radar.from_ti_cfg(tmp_path / "a.cfg")
    for field in ("carrier_hz", "slope_hz_per_s", "sample_rate_hz", "prf_hz", "frame_interval_s", "tx_power_dbm"):
        assert getattr(again, field) == pytest.approx(getattr(radar, field), rel=1e-9)
    for field in ("samples", "chirps_per_frame", "multiplexing"):
        assert getattr(again, field) == getattr(radar, field)
    scale = 2 * radar.virtual_offsets_m.std() / (2 * again.virtual_offsets_m.std() or 1.0)
    np.testing.assert_allclose(again.virtual_offsets_m * scale, radar.virtual_offsets_m, atol=1e-5)


@pytest.mark.parametrize("name", sorted({*BOARDS.values()}))
def test_a_board_keeps_its_power_gains_and_lobes(name: str) -> None:
    board = Radar.preset(name)
    chirps = 8 * len(board.tx_offsets_m)
    radar = board.replace(chirps_per_frame=chirps, frame_interval_s=2 * chirps / board.prf_hz)
    again = Radar.from_ti_cfg(radar.to_ti_cfg(board=name))
    for field in ("tx_power_dbm", *OF_BOARD):
        assert getattr(again, field) == getattr(board, field)
    np.testing.assert_allclose(np.ptp(again.tx_offsets_m, axis=0), np.ptp(board.tx_offsets_m, axis=0), rtol=0.03)


def test_a_board_may_be_any_preset() -> None:
    radar = Radar.preset("k-mc1", chirps_per_frame=8, frame_interval_s=0.1)
    again = Radar.from_ti_cfg(radar.to_ti_cfg(board="k-mc1"), board="k-mc1")
    assert (again.tx_power_dbm, again.tx_pattern) == (radar.tx_power_dbm, radar.tx_pattern)
    with pytest.raises(InputError, match="uses transmitter 3 and receiver 4, the board has 1 and 1"):
        Radar.from_ti_cfg(ISK.splitlines(), board="k-mc1")


ISK = FILES["xwr6843_isk"][0]


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("frameCfg 0 2 16 0 100 1 0", "advFrameCfg 4 0 0 1 0", "advFrameCfg cannot be represented"),
        ("chirpCfg 2 2 0 0 0 0 0 2", "chirpCfg 2 2 0 0 0 0 0 7", "one transmitter after the other"),
        ("chirpCfg 2 2 0 0", "chirpCfg 2 2 0 1e6", "alike in profile"),
        ("chirpCfg 2 2 0 0 0 0 0 2\n", "", "chirpCfg defines"),
        ("channelCfg 15 7", "channelCfg 15 5", "channelCfg has"),
        ("channelCfg 15 7", "channelCfg 0 7", "a receiver on"),
        ("7 57.14", "7 50.14", "samples of profileCfg end"),
        ("profileCfg 0", "profileCfg 1", "one line profileCfg"),
        ("bpmCfg -1 0 0 0", "bpmCfg -1 1 0 1", "bpmCfg must be off"),
        ("7 57.14 0", "7 57.14 1.5", "number 6 of profileCfg must be a whole number"),
        ("7 57.14", "-3 57.14", "ADC start and idle time of profileCfg must be 0 us or more, got -3"),
        ("chirpCfg 2 2 0 0 0 0 0 2", "chirpCfg 2 2 0 0 0 0 0 2.5", "number 8 of chirpCfg must be a whole number"),
        ("chirpCfg 2 2", "chirpCfg 2 1e12", "number 2 of chirpCfg must be a whole number from 0 to 511"),
        ("frameCfg 0 2", "frameCfg 0.5 2", "number 1 of frameCfg must be a whole number"),
        ("channelCfg 15 7", "channelCfg -1 7", "number 1 of channelCfg must be a whole number"),
    ],
)  # fmt: skip
def test_what_no_radar_here_has_is_an_error(old: str, new: str, told: str) -> None:
    assert old in ISK
    with pytest.raises(InputError, match=told):
        Radar.from_ti_cfg(ISK.replace(old, new).splitlines())


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("5209 0 0 158", "5209 0 0 158\nadcCfg 2 0", "real samples"),
        ("57.14 0 0 70", "57.14 197120 0 70", "back-offs of"),
        ("% Platform:xWR68xx\n", "", "neither antGeometry nor the board"),
        ("channelCfg 15 7 0", "channelCfg 15 7 1", "in cascade"),
    ],
)
def test_what_is_not_held_is_told(old: str, new: str, told: str) -> None:
    with pytest.warns(T2DWarning, match=told):
        Radar.from_ti_cfg(ISK.replace(old, new).splitlines())


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"position_m": (0, 0, 2)}, "place, boresight and track"),
        ({"boresight": (1, 0, -0.2)}, "place, boresight and track"),
        ({"track": RadarTrack(times_s=(0, 1), positions_m=((0, 0, 1), (1, 0, 1)))}, "place, boresight and track"),
        ({"slope_hz_per_s": 3e14}, "slope of 300 MHz/us"),
    ],
)
def test_what_a_file_does_not_keep_is_told(changes: dict[str, Any], told: str) -> None:
    with pytest.warns(T2DWarning, match=told):
        Radar.preset("iwr6843isk", chirps_per_frame=96, frame_interval_s=0.05, **changes).to_ti_cfg()


def test_some_radars_have_no_such_file() -> None:
    for radar, told in (
        (Radar.preset("table2"), "continuous chirps"),
        (Radar.preset("table2-burst", tx_offsets_m=[[0, 0, 0], [0, 1, 0]]), "send at once"),
        (Radar.preset("table2-burst", prf_hz=26_500), "beside its samples"),
        (Radar.preset("awr2243-cascade", chirps_per_frame=24, frame_interval_s=0.1), "of one chip"),
    ):
        with pytest.raises(InputError, match=told):
            radar.to_ti_cfg()


def test_a_bandwidth_may_be_given_in_place_of_the_slope() -> None:
    table2 = Radar.preset("table2")
    assert Radar.preset("table2", bandwidth_hz=1.5e9).bandwidth_hz == pytest.approx(1.5e9)
    ramp = {"ramp_bandwidth_hz": 46.397e12 * 60e-6, "ramp_time_s": 60e-6}
    assert table2.replace(**ramp).slope_hz_per_s == pytest.approx(46.397e12)
    assert table2.replace(bandwidth_hz=table2.bandwidth_hz, slope_hz_per_s=46.397e12).bandwidth_hz == pytest.approx(
        table2.bandwidth_hz
    )
    for changes, told in (
        ({"bandwidth_hz": 1e9, "slope_hz_per_s": 46.397e12}, "contradict each other"),
        ({"bandwidth_hz": 1e9, **ramp}, "contradict each other"),
        ({"ramp_time_s": 60e-6}, "together"),
        ({**ramp, "ramp_time_s": 30e-6}, "shorter than the sampling window"),
        ({"bandwidth_hz": -1e9}, "bandwidth_hz"),
    ):
        with pytest.raises(InputError, match=told):
            table2.replace(**changes)
