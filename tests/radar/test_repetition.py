"""Targets that repeat: a few periods are computed, and the whole record is read from them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from builders import slow_after
from t2d_rt.accuracy import nmse_db
from t2d_rt.core.errors import InputError
from t2d_rt.radar.repetition import _at, _oversampled, repetition
from t2d_rt.types import MovingMesh, Radar

QUICK = Radar.preset("table2", samples=16, prf_hz=4_000.0)
FAN = t2d.TableFan(position_m=(2.5, 0.4, 1.0), rpm=1200, radius_m=0.12)


def cube(targets: list[Any], radar: Radar, *, repeats: bool, **options: Any) -> np.ndarray:
    accuracy = {"repeats": repeats, "sagitta_scale": 16.0, **options.pop("accuracy", {})}
    return np.asarray(t2d.simulate(targets, radar=radar, accuracy=accuracy, **options).cube)


def panel(stop_s: float) -> MovingMesh:
    """A plate that passes between the radar and the fan."""
    corners = np.array([[1.2, y, z] for y in (-0.5, 0.5) for z in (0.4, 1.6)])
    times_s = np.linspace(0, stop_s, 30)
    along = np.array([0.0, 1.0, 0.0]) * (2 * times_s / stop_s - 1)[:, None, None]
    return MovingMesh(corners + along, np.array([[0, 2, 1], [1, 2, 3]]), times_s, "metal", name="panel")


def test_between_equal_steps_a_band_limited_function_is_interpolated() -> None:
    rng = np.random.default_rng(0)
    harmonics, count = np.arange(-40, 41), 101
    weights = rng.normal(size=(len(harmonics), 2, 3)) + 1j * rng.normal(size=(len(harmonics), 2, 3))

    def exact(cycles: np.ndarray) -> np.ndarray:
        return np.einsum("km,mas->kas", np.exp(2j * np.pi * np.outer(cycles, harmonics)), weights)

    dense = _oversampled(exact(np.arange(count) / count).astype(np.complex64))
    cycles, gain = rng.random(300), rng.random(300)
    for antenna in range(2):
        found = _at(dense[antenna], cycles * dense.shape[1], gain)
        assert nmse_db(found, exact(cycles)[:, antenna] * gain[:, None]) < -90


@pytest.mark.parametrize("prf_hz", [500.0, 1_280.0, 10_240.0])
@pytest.mark.parametrize("rpm", [121.0, 900.0, 3_333.3])
def test_chirps_of_the_table_begin_at_equal_steps_of_the_period(prf_hz: float, rpm: float) -> None:
    radar = Radar.preset("table2", prf_hz=prf_hz)
    period_s, speed_mps = 60 / rpm, 2 * math.pi * rpm / 60 * 0.18
    found = repetition(radar, period_s, speed_mps, 800.0, (0.0, 60.0))
    cycles = np.sort((np.arange(found.rows) * found.step_s / period_s) % 1)
    np.testing.assert_allclose(np.diff(cycles), 1 / found.rows, atol=1e-9)
    assert found.rows / period_s > 4 * speed_mps / radar.wavelength_m  # Doppler of both signs
    assert found.radar.prf_hz * radar.sweep_time_s <= 1 + 1e-9
    assert repetition(radar, period_s, speed_mps, 800.0, (0.0, 2 * found.periods * period_s)) is None


@pytest.mark.parametrize(
    "changes",
    slow_after(
        1,
        [
            {},
            {"chirps_per_frame": 64, "frame_interval_s": 0.031},
            {"tx_offsets_m": ((0.0, 0.0, 0.0), (0.0, 0.05, 0.0)), "rx_offsets_m": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.03)),
             "multiplexing": "tdm", "prf_hz": 8_000.0},
        ],
    ),
    ids=["continuous", "bursts", "tdm"],
)  # fmt: skip
def test_a_fan_read_from_a_few_rotations_is_the_fan(changes: dict[str, Any]) -> None:
    radar = QUICK.replace(**changes)
    fine = {"surface_rate_hz": 2_500.0}  # both have surface frames at other angles
    read, whole = (cube([FAN.mesh(3.0, 3.25)], radar, repeats=repeats, accuracy=fine) for repeats in (True, False))
    assert np.any(read != whole)
    assert nmse_db(read, whole) < -45


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:panel is not watertight")
def test_what_passes_before_a_fan_occludes_it() -> None:
    targets = [FAN.mesh(0, 0.5), panel(0.5)]
    read, whole = (cube(targets, QUICK, repeats=repeats) for repeats in (True, False))
    alone = cube([panel(0.5)], QUICK, repeats=True)
    assert np.any(read != whole)
    assert nmse_db(read - alone, whole - alone) < -30
    for each in (read, whole):
        power = np.mean(np.abs(each - alone) ** 2, axis=(1, 2))
        assert power[950:1050].mean() < 1e-9 * power.mean()  # the panel is in the middle of the way


@pytest.mark.slow
def test_a_fan_in_a_room_is_the_fan_over_every_path() -> None:
    accuracy = {"tiers": [{"level_db": -200.0}], "least_level_db": -15.0}
    read, whole = (
        cube([FAN.mesh(0, 0.35)], QUICK, repeats=repeats, scene="empty_room", accuracy=accuracy, clutter="none")
        for repeats in (True, False)
    )
    assert np.any(read != whole)
    assert nmse_db(read, whole) < -35


def test_a_period_that_is_none_is_refused() -> None:
    turning = FAN.mesh(0, 1.0)
    with pytest.raises(
        InputError, match=r"must be in the same place after each period_s, 0.04 s, but is 0\.\d+ m away"
    ):
        MovingMesh.from_track(turning.track, turning.faces, turning.times_s, period_s=0.04)
    assert t2d.TableFan(position_m=(2, 0, 1), swing_deg=60).mesh(0, 1).period_s is None
    assert turning.period_s == pytest.approx(0.05)


def test_a_period_that_drifts_or_ends_is_refused() -> None:
    turning = FAN.mesh(0, 8)
    with pytest.raises(InputError, match="must be in the same place after each period_s"):
        MovingMesh.from_track(turning.track, turning.faces, turning.times_s, period_s=0.05 * (1 + 1e-6))
    for stop in (lambda times_s: np.minimum(times_s, 7.21), lambda times_s: np.maximum(times_s, 2.11)):
        with pytest.raises(InputError, match="must be in the same place after each period_s"):
            MovingMesh.from_track(
                lambda times_s, stop=stop: turning.track(stop(times_s)), turning.faces, turning.times_s, period_s=0.05
            )


def test_a_door_that_opens_late_has_no_period() -> None:
    assert t2d.Door(position_m=(2, 0, 0), opens_at_s=3).mesh(0, 8).period_s is None


def test_the_same_seed_gives_the_same_bits() -> None:
    first, second = (cube([FAN.mesh(0, 0.3)], QUICK, repeats=True) for _ in range(2))
    assert np.array_equal(first, second)
