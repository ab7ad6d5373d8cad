"""What several test files share: a kernel backend, and how a target's field is read out of the ADC cube."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from t2d_rt.backend import Backend, select
from t2d_rt.constants import SPEED_OF_LIGHT
from t2d_rt.types import Radar

ReadField = Callable[..., np.ndarray]

LONGEST = (
    "test_tolerance",
    "test_experiment",
    "test_examples",
    "test_synthesize",
    "test_scattering_facets",
    "test_cli",
    "test_api",
    "test_chart",
)
"""Files that take longest, which start first so that no process waits for another at the end."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Puts them first."""
    place = {name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.stem, len(place)))


@pytest.fixture(scope="session")
def backend() -> Backend:
    return select("cpu")


@pytest.fixture(scope="session")
def field_in_cube() -> ReadField:
    """`field_in_cube(cube, radar, range_m, rx_range_m)`: (chirp,) complex sqrt(sigma) [m] of what stands there.

    The carrier of a point with that path is taken out (physics.md, eq. 1), a Hann window over the sweep keeps other
    ranges out, and the radar equation (eq. 2) scales: a point of 1 m^2 reads 1, whatever the radar.
    """

    def read(cube: np.ndarray, radar: Radar, range_m: float, rx_range_m: float | None = None) -> np.ndarray:
        rx_range_m = range_m if rx_range_m is None else rx_range_m
        delay, t = (range_m + rx_range_m) / SPEED_OF_LIGHT, radar.sample_times_s
        turns = radar.carrier_hz * delay + radar.slope_hz_per_s * (delay * t - delay**2 / 2)
        window = np.hanning(radar.samples + 2)[1:-1]
        field = cube[:, 0].astype(complex) @ (window / window.sum() * np.exp(-2j * np.pi * (turns % 1)))
        return field / np.sqrt(radar.received_power_w(1.0, range_m, rx_range_m))

    return read
