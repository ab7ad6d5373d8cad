"""Echoes in parts: sums of the parts apart add up to the whole, in the same groups."""

from __future__ import annotations

import numpy as np
import pytest

import t2d_rt as t2d
from builders import slow_after
from measures import nmse_db
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.cubes import DiskCube
from t2d_rt.core.factored_cubes import ProductRows
from t2d_rt.core.memory import MemoryLimit
from t2d_rt.radar.synthesize import Synthesis
from t2d_rt.types import EchoArrays
from t2d_rt.types.scatterer import EchoParts


@pytest.mark.parametrize(("preset", "count"), slow_after(2, [("table2", 30), ("table2", 3000), ("array-3x4", 400)]))
def test_parts_are_what_their_echoes_return_and_add_up_to_the_whole(preset: str, count: int) -> None:
    """Echo by echo and in groups, whatever the parts: these are drawn at random, and some echoes belong to none."""
    radar, rng = t2d.Radar.preset(preset), np.random.default_rng(3)
    times_s = np.linspace(0.0, 0.2, 41)
    range_m = rng.uniform(3, 5, count) + rng.uniform(-2, 2, count) * times_s[:, None]
    direction = rng.normal(size=(count, 3)) + [4.0, 0.0, 0.0]
    places = range_m[..., None] * direction / np.linalg.norm(direction, axis=1)[:, None] + radar.tx_position_m
    amplitude = np.repeat(rng.normal(size=(2, count)).T.copy().view(complex).T.astype(np.complex64), 41, axis=0)
    echoes = EchoArrays(2 * range_m / SPEED_OF_LIGHT, amplitude, None, places if radar.is_array else None, None)

    def summed(parts: EchoParts) -> np.ndarray:
        with Synthesis(
            times_s, radar, tolerance_db=-50, device="cpu", memory=MemoryLimit.of(), parts=parts
        ) as synthesis:
            synthesis.add(0, echoes)
        return np.asarray(synthesis.cube)

    number = rng.integers(-1, 3, count)
    rows = [ProductRows((len(radar.chirp_times_s(0.2)), radar.antennas, radar.samples)) for _ in range(3)]
    cubes = [DiskCube(each) for each in rows]
    found = summed(EchoParts(number, rows))
    whole = summed(EchoParts(np.minimum(number, 0)))
    assert nmse_db(found, whole) < -120
    assert nmse_db(np.sum([np.asarray(each, complex) for each in cubes], axis=0), whole) < -120
    for part, cube in enumerate(cubes):
        assert nmse_db(np.asarray(cube), summed(EchoParts(np.where(number == part, 0, -1)))) < -110
    with pytest.raises(ValueError, match=f"{count - 1} echoes have parts and {count} came"):
        summed(EchoParts(number[1:]))
