"""`Radar`: figures against closed forms, presets, guards, YAML."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

import t2d_rt
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.radar import check_speed
from t2d_rt.types.radar import Radar, preset_fields, preset_names

TABLE2 = Radar.preset("table2")


def test_table2_figures() -> None:
    assert TABLE2.sweep_time_s == pytest.approx(37.39e-6, rel=1e-4)
    assert TABLE2.bandwidth_hz == pytest.approx(1.735e9, rel=1e-3)
    assert TABLE2.range_resolution_m == pytest.approx(0.0864, rel=1e-3)
    assert TABLE2.max_range_m == pytest.approx(22.12, rel=1e-3)
    assert TABLE2.max_speed_mps == pytest.approx(9.86, abs=0.005)
    assert TABLE2.mid_frequency_hz == pytest.approx(77e9 + 46.397e12 * 127.5 / 6847e3, rel=1e-12)
    assert TABLE2.wavelength_m * TABLE2.mid_frequency_hz == pytest.approx(SPEED_OF_LIGHT)
    assert TABLE2.mid_time_s == pytest.approx(TABLE2.sample_times_s.mean())


@pytest.mark.parametrize(
    ("name", "chirps_in_10_s", "max_speed", "max_range", "bandwidth"),
    [
        ("table2", 102_400, 9.857, 22.12, 1.7347e9),
        ("table2-uniform", 12_800, 1.232, 22.12, 1.7347e9),
        ("table2-burst", 12_800, 24.64, 22.12, 1.7347e9),
        ("table2-long", 102_400, 9.856, 44.24, 1.7347e9),
        ("text2doppler-code", 128_000, 12.14, 9.593, 4e9),
        ("ci4r", 32_000, 3.09, 49.8, 0.77e9),
        ("openradar", 54_348, 5.16, 6.246, 3.072e9),
        ("array-3x4", 83_333, 8.031, 24.98, 1.536e9),
        ("automotive-79", 199_998, 6.325, 19.19, 4e9),
        ("imaging-12x16", 41_666, 4.022, 14.99, 1.28e9),
        ("indoor-60", 66_666, 8.079, 11.99, 3.2e9),
        ("people-tracking-60", 17_472, 4.449, 8.082, 1.7804e9),
        ("ism-24", 25_000, 7.767, 153.5, 0.25e9),
        ("iwr6843isk", 66_666, 8.079, 11.99, 3.2e9),
        ("iwr6843aop", 37_411, 4.449, 8.082, 1.7804e9),
        ("awr1843boost", 83_333, 8.031, 24.98, 1.536e9),
        ("iwr1443boost", 51_966, 4.918, 10.46, 3.44e9),
        ("iwr1642boost", 80_000, 7.635, 12.49, 3.072e9),
        ("awr2243-cascade", 41_666, 4.022, 14.99, 1.28e9),
        ("bgt60tr13c", 40_000, 4.935, 12.79, 1.5e9),
        ("k-mc1", 25_000, 7.767, 153.5, 0.25e9),
    ],
)
def test_presets(name: str, chirps_in_10_s: int, max_speed: float, max_range: float, bandwidth: float) -> None:
    radar = Radar.preset(name)
    assert len(radar.chirp_times_s(10.0)) in (
        chirps_in_10_s,
        chirps_in_10_s - 1 if name == "openradar" else chirps_in_10_s,
    )
    assert radar.max_speed_mps == pytest.approx(max_speed, rel=1e-3)
    assert radar.max_range_m == pytest.approx(max_range, rel=1e-3)
    assert radar.bandwidth_hz == pytest.approx(bandwidth, rel=1e-3)


def test_every_preset_is_tested_here() -> None:
    assert len(preset_names()) == 21
    assert Radar.preset("TABLE2_Uniform") == Radar.preset("table2-uniform")


def test_burst_is_dead_95_percent_of_the_time() -> None:
    radar = Radar.preset("table2-burst")
    times = radar.chirp_times_s(0.3)
    assert len(times) == 3 * 128
    assert np.allclose(times.reshape(3, 128)[:, 0], [0, 0.1, 0.2])
    busy = radar.chirps_per_frame * radar.chirp_interval_s / radar.frame_interval_s
    assert busy == pytest.approx(0.05)
    # A burst that is not whole is left out.
    assert len(radar.chirp_times_s(0.2 + 0.004)) == 2 * 128


def test_last_sample_lies_within_the_duration() -> None:
    duration = 5 / TABLE2.prf_hz + (TABLE2.samples - 1) / TABLE2.sample_rate_hz
    assert len(TABLE2.chirp_times_s(duration)) == 6
    assert len(TABLE2.chirp_times_s(duration * (1 - 1e-5))) == 5


def test_radar_equation() -> None:
    # Skolnik's form, written out: 12 dBm, 9 dBi twice, 1 m^2 at 5 m.
    wavelength = TABLE2.wavelength_m
    expected = 10**-1.8 * 10**1.8 * wavelength**2 / ((4 * math.pi) ** 3 * 5**4)
    assert TABLE2.received_power_w(1.0, 5.0) == pytest.approx(expected, rel=1e-12)
    assert TABLE2.received_power_w(1.0, 10.0) == pytest.approx(expected / 16, rel=1e-12)
    assert TABLE2.received_power_w(1.0, 2.5, 10.0) == pytest.approx(expected, rel=1e-12)
    assert TABLE2.replace(if_gain_db=20).received_power_w(1.0, 5.0) == pytest.approx(100 * expected, rel=1e-12)
    assert TABLE2.link_amplitude**2 / 5**4 == pytest.approx(expected, rel=1e-12)
    assert TABLE2.noise_power_w == pytest.approx(1.380649e-23 * 290 * 6847e3 * 10**1.5, rel=1e-12)
    # SNR of 1 m^2 at 5 m after 256 samples: noise and echo go through the same IF gain.
    louder = TABLE2.replace(if_gain_db=30)
    assert louder.received_power_w(1.0, 5.0) / louder.noise_power_w == pytest.approx(expected / TABLE2.noise_power_w)


@pytest.mark.parametrize(
    ("function", "arguments", "sentence"),
    [
        ("beat_frequency_hz", (math.nan,), "range_m must be finite"),
        ("beat_frequency_hz", ([1.0, math.inf],), "range_m must be finite"),
        ("received_power_w", (math.nan, 5.0), "rcs_m2 must be finite"),
        ("received_power_w", (1.0, [5.0, math.nan]), "range_m must be finite"),
        ("received_power_w", (1.0, 5.0, math.nan), "rx_range_m must be finite"),
        ("received_power_w", (1.0, 0.0), "range_m must be positive, got 0.0"),
        ("received_power_w", (-1.0, 5.0), "rcs_m2 must not be negative, got -1.0"),
    ],
)
def test_radar_equation_of_what_is_no_number(function: str, arguments: tuple[object, ...], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        getattr(TABLE2, function)(*arguments)


def test_axes() -> None:
    ranges = TABLE2.range_axis_m(512)
    assert ranges[0] == 0
    assert ranges[512 - 1] == pytest.approx(TABLE2.max_range_m * 511 / 512)
    assert TABLE2.beat_frequency_hz(ranges[1]) == pytest.approx(TABLE2.sample_rate_hz / 512)
    assert TABLE2.range_axis_m(speed_mps=4.0)[0] == pytest.approx(6.71e-3, abs=1e-5)
    for count in (128, 129):
        speeds = TABLE2.speed_axis_mps(count)
        assert (np.diff(speeds) > 0).all()
        assert len(speeds) == count
        assert np.abs(speeds).max() <= TABLE2.max_speed_mps * (1 + 1e-12)
        assert np.min(np.abs(speeds)) < 1e-12
        assert np.diff(speeds)[0] == pytest.approx(TABLE2.speed_resolution_mps(count / TABLE2.prf_hz))


def test_pose() -> None:
    radar = TABLE2.replace(tx_offsets_m=(0.01, 0.02, 0.03), rx_offsets_m=(0, -0.02, 0))
    assert np.allclose(radar.tx_position_m, (0.01, 0.02, 1.03))
    assert np.allclose(radar.rx_position_m, (0, -0.02, 1))
    rotated = radar.replace(boresight=(0, 2, 0))  # looks along y: left is -x
    assert np.allclose(rotated.tx_position_m, (-0.02, 0.01, 1.03))
    for boresight in ((1, 2, 3), (0, 0, -1), (0, 0, 5)):
        axes = radar.replace(boresight=boresight).axes
        assert np.allclose(axes @ axes.T, np.eye(3))
        assert np.linalg.det(axes) == pytest.approx(1)
        assert np.allclose(axes[0], np.array(boresight) / np.linalg.norm(boresight))
    assert np.array_equal(TABLE2.tx_position_m, TABLE2.rx_position_m)
    pair = TABLE2.replace(tx_offsets_m=((0, 1, 0), (0, 2, 3)), rx_offsets_m=[(0, 0, 0), (0, -1, 0), (0, -2, 0)])
    assert np.allclose(pair.tx_positions_m, [(0, 1, 1), (0, 2, 4)])
    assert np.allclose(pair.tx_position_m, (0, 1.5, 2.5))
    assert np.allclose(pair.rx_position_m, (0, -1, 1))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"carrier_hz": -77e9}, "carrier_hz: got -77000000000.0, should be greater"),
        ({"carrier_hz": 0}, "carrier_hz: got 0"),
        ({"carrier_hz": 77}, "correct it, in SI units"),
        ({"carrier_hz": math.nan}, "carrier_hz: got nan, should be a finite number"),
        ({"carrier_hz": "fast"}, "carrier_hz: got 'fast', should be a valid number"),
        ({"slope_hz_per_s": -1e12}, "slope_hz_per_s: got -1"),
        ({"slope_hz_per_s": 0}, "slope_hz_per_s: got 0"),
        ({"sample_rate_hz": 0}, "sample_rate_hz: got 0"),
        ({"sample_rate_hz": -1}, "sample_rate_hz: got -1"),
        ({"prf_hz": 0}, "prf_hz: got 0"),
        ({"prf_hz": math.inf}, "prf_hz: got inf, should be a finite"),
        ({"prf_hz": True}, "prf_hz: got True, a number is expected"),
        ({"samples": 0}, "samples: got 0"),
        ({"samples": -5}, "samples: got -5"),
        ({"samples": 2.5}, "samples: got 2.5"),
        (
            {"prf_hz": 30e3},
            "sampling window of 37.3886 us .* longer than the chirp interval of 33.3333 us; lower prf_hz to 26746",
        ),
        ({"chirps_per_frame": 128}, "bursts need both chirps_per_frame and frame_interval_s"),
        (
            {"chirps_per_frame": 128, "frame_interval_s": 0.01},
            "burst of 128 chirps lasts 12.5 ms, longer than its frame of 10 ms",
        ),
        ({"frame_interval_s": -1, "chirps_per_frame": 2}, "frame_interval_s: got -1"),
        ({"boresight": (0, 0, 0)}, "boresight must be a direction"),
        ({"position_m": (0, 1)}, "position_m must be three numbers"),
        ({"position_m": 3}, "position_m must be three numbers"),
        ({"position_m": (0, 0, math.inf)}, "position_m: got inf"),
        ({"tx_power_dbm": math.nan}, "tx_power_dbm: got nan"),
        ({"tx_offsets_m": ((0, 1),)}, "tx_offsets_m must be three numbers x, y, z, or a list of such, got"),
        ({"rx_offsets_m": ()}, "rx_offsets_m is empty; give at least one"),
        ({"multiplexing": "fdm"}, "multiplexing: got 'fdm', should be 'simultaneous', 'tdm' or 'ddm'"),
        (
            {"multiplexing": "tdm", "tx_offsets_m": ((0, 0, 0),) * 3, "chirps_per_frame": 128, "frame_interval_s": 0.1},
            "bursts of 128 chirps do not give 3 transmitters equally many each; set chirps_per_frame to a multiple of 3",
        ),
        ({"tx_pattern": {"kind": "horn"}}, "tx_pattern: unknown kind 'horn'; choose one of isotropic"),
        ({"tx_pattern": {}}, "tx_pattern: got {}, write it as a mapping with a kind, as in {kind: cosine"),
        ({"tx_pattern": {"kind": "cosine"}}, "needs either exponent or half_power_beamwidth_deg, got None and None"),
        ({"rx_pattern": {"kind": "cosine", "exponent": -1}}, "antenna pattern key exponent: got -1"),
        ({"carier_hz": 1e9}, "unknown radar key 'carier_hz'; did you mean carrier_hz"),
        ({"zzz": 1}, "unknown radar key 'zzz'; valid keys are carrier_hz"),
        ({"carrier_hz": 0, "samples": 0}, "1 more field is wrong"),
    ],
)
def test_guards(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        TABLE2.replace(**change)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=message):
        Radar.preset("table2", **change)
    with pytest.raises(InputError, match=message):
        Radar.model_validate({**TABLE2.model_dump(), **change})


def test_other_guards() -> None:
    with pytest.raises(InputError, match=r"unknown radar preset 'tabel2'; did you mean table2\?$"):
        Radar.preset("tabel2")
    with pytest.raises(InputError, match=r"unknown radar preset '../table2'"):
        preset_fields("../table2")
    with pytest.raises(InputError, match="carrier_hz is missing; give it, or start from a preset"):
        Radar(slope_hz_per_s=1e12)
    with pytest.raises(InputError, match="must be a mapping of field names and values, got 3"):
        Radar.model_validate(3)
    with pytest.raises(InputError, match="must be a mapping"):
        Radar.model_validate({3: 4})
    with pytest.raises(InputError, match=r"duration of 1e-05 s holds no whole chirp; it must be at least 3.7"):
        TABLE2.chirp_times_s(1e-5)
    with pytest.raises(InputError, match="holds no whole burst"):
        Radar.preset("table2-burst").chirp_times_s(0.004)
    for duration in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError, match=r"duration_s must be (positive|finite)"):
            TABLE2.chirp_times_s(duration)
    with pytest.raises(ValidationError, match="frozen"):
        TABLE2.prf_hz = 5.0  # type: ignore[misc]


def test_speed_warning_names_both_speeds_and_the_fix() -> None:
    radar = Radar.preset("table2-uniform")
    with pytest.warns(
        T2DWarning, match=r"top speed 4 m/s of left_foot exceeds the unambiguous 1.23 m/s .* raise prf_hz to 4160"
    ) as caught:
        check_speed(radar, -4.0, what="left_foot")
    assert len(caught) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_speed(radar.replace(prf_hz=4160), 4.0)
    with pytest.warns(T2DWarning, match=r"shorten the sweep below 19.2 us"):
        check_speed(radar, 50.0)


def test_yaml_round_trip(tmp_path) -> None:
    for name in preset_names():
        radar = Radar.preset(name, position_m=(0.1, -2, 1 / 3))
        radar.to_yaml(tmp_path / "radar.yaml")
        assert Radar.from_yaml(tmp_path / "radar.yaml") == radar
    with pytest.raises(InputError, match=r"cannot write .*choose a writable place"):
        TABLE2.to_yaml(tmp_path / "missing" / "radar.yaml")
    with pytest.raises(InputError, match=r"cannot write .*: it is a folder; choose the name of a file"):
        TABLE2.to_yaml(tmp_path)


def test_a_yaml_file_is_never_half_written(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "radar.yaml"
    TABLE2.to_yaml(path)

    def full(self: Path, text: str, **_: object) -> int:
        with self.open("w") as file:
            file.write(text[:20])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(InputError, match=r"cannot write .*No space left on device"):
        TABLE2.replace(samples=128).to_yaml(path)
    monkeypatch.undo()
    assert Radar.from_yaml(path) == TABLE2
    assert [each.name for each in tmp_path.iterdir()] == ["radar.yaml"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"carrier_hz: [1", "radar.yaml is not valid YAML"),
        (b"\xff\xfe\x00binary\x9f", "is not valid YAML"),
        (b"", "radar.yaml must hold field names and values .* got None"),
        (b"- 1\n- 2\n", "must hold field names and values .* got \\[1, 2\\]"),
        (b"1: 2\n", "must hold field names and values"),
        (
            b"carrier_ghz: 77\n",
            "radar.yaml: unknown radar key 'carrier_ghz'; did you mean carrier_hz|radar.yaml: radar key",
        ),
        (b"!!python/object/apply:os.system ['true']", "is not valid YAML"),
        (b"prf_hz: 2001-99-99\n", "radar.yaml"),
    ],
)
def test_bad_yaml(tmp_path, text: bytes, message: str) -> None:
    path = tmp_path / "radar.yaml"
    path.write_bytes(text)
    with pytest.raises(InputError, match=message):
        Radar.from_yaml(path)


def test_yaml_names_file_and_key(tmp_path) -> None:
    path = tmp_path / "mine.yaml"
    TABLE2.to_yaml(path)
    path.write_text(path.read_text().replace("samples: 256", "samples: many"))
    with pytest.raises(InputError, match=r"mine.yaml: radar key samples: got 'many'"):
        Radar.from_yaml(path)
    with pytest.raises(InputError, match=r"cannot read radar file .*none.yaml: No such file"):
        Radar.from_yaml(tmp_path / "none.yaml")
    shipped = Path(t2d_rt.__file__).parent / "radar/presets/table2.yaml"
    path.write_text(shipped.read_text().replace("77.0e+9", "77e9"))  # YAML 1.1 reads 77e9 as text
    assert Radar.from_yaml(path) == TABLE2


anything = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.lists(st.floats(), max_size=4),
    st.binary(max_size=3),
)  # fmt: skip
plausible = st.fixed_dictionaries(
    {
        "carrier_hz": st.floats(1e9, 3e11),
        "slope_hz_per_s": st.floats(1e11, 1e14),
        "sample_rate_hz": st.floats(1e5, 1e8),
        "samples": st.integers(2, 1024),
        "prf_hz": st.floats(1, 1e5),
    },
    optional={
        "chirps_per_frame": st.integers(1, 300),
        "frame_interval_s": st.floats(1e-3, 1),
        "boresight": st.tuples(*[st.floats(-2, 2)] * 3),
        "tx_gain_dbi": st.floats(-20, 40),
    },
)


@settings(max_examples=40, deadline=None)
@given(key=st.sampled_from([*Radar.model_fields, "other"]), value=anything)
def test_any_value_gives_a_radar_or_an_input_error(key: str, value: object) -> None:
    try:
        radar = TABLE2.replace(**{key: value})
    except InputError:
        return
    assert all(
        math.isfinite(figure)
        for figure in (
            radar.bandwidth_hz, radar.max_range_m, radar.max_speed_mps, radar.link_amplitude, radar.noise_power_w,
        )
    )  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(values=plausible, duration=st.floats(1e-4, 0.05))
def test_plausible_radars(tmp_path_factory, values: dict[str, object], duration: float) -> None:
    try:
        radar = Radar(**values)
        times = radar.chirp_times_s(duration)
    except InputError:
        return
    path = tmp_path_factory.mktemp("radar") / "radar.yaml"
    radar.to_yaml(path)
    assert Radar.from_yaml(path) == radar
    assert times[0] == 0
    assert (np.diff(times) >= radar.sweep_time_s * (1 - 1e-6)).all()
    # One part in 1e9 of a chirp or frame interval is the slack for rounding.
    slack = 1e-8 * (radar.frame_interval_s or radar.chirp_interval_s)
    assert times[-1] + radar.sample_times_s[-1] <= duration + slack
