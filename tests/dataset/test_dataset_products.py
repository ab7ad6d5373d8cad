"""Maps of a data set show what moves, not the receiver's offset."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from t2d_rt.core.errors import T2DWarning
from t2d_rt.dataset.products import (
    Products,
    RangeDopplerProduct,
    SpectrogramProduct,
    averaging,
    axis,
    record_length_s,
    resized,
)
from t2d_rt.dataset.recipe import Recipe
from t2d_rt.dataset.worker import view
from t2d_rt.recording.maps import background, background_settings
from t2d_rt.recording.recording import Recording
from t2d_rt.types import Radar

RADAR = Radar.preset("table2")
SPEED_MPS = 2.0


def offset_and_target() -> Recording:
    """A target that approaches, 20 dB below a constant in all samples."""
    chirps = np.arange(1024)[:, None, None]
    samples = np.arange(RADAR.samples)[None, None, :]
    doppler = -2 * SPEED_MPS / RADAR.wavelength_m / RADAR.prf_hz
    tone = 0.1 * np.exp(2j * np.pi * (doppler * chirps + 20 / RADAR.samples * samples))
    return Recording((1.0 + tone).astype(np.complex64), RADAR)


@pytest.mark.parametrize(("kind", "rows"), [(SpectrogramProduct, 0), (RangeDopplerProduct, 1)])
@pytest.mark.parametrize(("mti", "speed_mps"), [("mean", SPEED_MPS), ("none", 0.0)])
def test_the_greatest_cell_is_the_target_unless_the_mean_is_kept(
    kind: Any, rows: int, mti: Any, speed_mps: float
) -> None:
    product = kind(mti=mti, size=(128, 64))
    seen: Any = offset_and_target()
    if kind is SpectrogramProduct:
        recipe = Recipe.read("small-hard").model_copy(update={"products": Products(spectrogram=product)})
        seen = view(seen, recipe, 0)
    levels, told = product.made(seen)
    speeds = axis(told["velocity_mps"], levels.shape[rows])
    best = np.unravel_index(levels.argmax(), levels.shape)
    assert speeds[best[rows]] == pytest.approx(speed_mps, abs=speeds[1] - speeds[0])
    assert kind().mti == "mean"


def test_a_record_of_bursts_lasts_to_the_end_of_the_last() -> None:
    radar = Radar.preset("table2-burst")
    burst = radar.loops_per_frame
    assert burst is not None
    recording = Recording(np.zeros((3 * burst, 1, radar.samples), np.complex64), radar)
    lasts_s = 2 * radar.frame_interval_s + burst * radar.loop_interval_s
    assert record_length_s(recording) == pytest.approx(lasts_s)


def test_an_occluded_window_shows_the_background_alone() -> None:
    """However far the person stands above it."""
    rng = np.random.default_rng(0)
    strong = rng.standard_normal((2048, 1, RADAR.samples)) + 0j
    recording = Recording(strong.astype(np.complex64), RADAR)
    masks = {"windows": 40, "shortest_s": 0.05, "longest_s": 0.1}
    asked = {"background": "default", "background_level_db": -140.0, "masks": masks}
    recipe = Recipe.model_validate(Recipe.read("small-hard").model_dump() | asked)
    seen = view(recording, recipe, 0)
    assert seen is not None
    told = seen.details["background"]
    image = recording.processed(mti="mean").spectrogram
    alone = background(image.velocity_mps.values, image.time_s.values, told).power_w(-140.0)
    hidden = np.any(
        [(image.time_s.values >= a) & (image.time_s.values < b) for a, b in seen.details["masks_s"]], axis=0
    )
    assert hidden.any()
    np.testing.assert_allclose(seen.power[:, hidden], alone[:, hidden], rtol=1e-6)


def test_a_background_beside_receiver_noise_is_warned_of() -> None:
    with pytest.warns(T2DWarning, match="noise floor of its own"):
        background_settings("default", noisy=True)
    background_settings("default", noisy=True, level_db=-160.0)


def test_cells_are_means_over_what_they_cover() -> None:
    """Thirds by hand, the power of the whole, and a part of the speeds. Mutation: weights of what overlaps at all."""
    thirds = averaging(np.linspace(0, 1, 4), np.linspace(0, 1, 3))
    np.testing.assert_allclose(thirds, [[2 / 3, 1 / 3, 0], [0, 1 / 3, 2 / 3]])
    np.testing.assert_array_equal(averaging(np.array([0.0, 1.0, 2.0]), np.array([2.0, 3.0])), [[0, 1]])  # the nearest
    power = np.random.default_rng(0).random((7, 10))
    assert resized(power, (3, 4)).mean() == pytest.approx(power.mean())
    np.testing.assert_allclose(
        resized(power, (2, 10), (1 / 7, 5 / 7)), [power[1:3].mean(axis=0), power[3:5].mean(axis=0)]
    )
