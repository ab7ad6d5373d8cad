"""Maps of a data set show what moves, not the receiver's offset."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from t2d_rt.dataset.products import Products, RangeDopplerProduct, SpectrogramProduct
from t2d_rt.dataset.recipe import Recipe
from t2d_rt.dataset.stored import axis
from t2d_rt.dataset.view import view
from t2d_rt.result import Recording
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
