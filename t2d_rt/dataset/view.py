"""The spectrogram of a sample: that of the recording, with a learned background and occluded windows where the recipe asks."""

from __future__ import annotations

from typing import Any

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.dataset.products import View
from t2d_rt.dataset.recipe import Recipe
from t2d_rt.dataset.seeds import integer_seed
from t2d_rt.noise.masks import occlude
from t2d_rt.recording.added_background import background, background_settings
from t2d_rt.recording.recording import Recording


def view(recording: Recording, recipe: Recipe, index: int) -> View | None:
    """The spectrogram of a sample by its index; None where the recipe keeps none."""
    kept = recipe.products.spectrogram
    if kept is None:
        return None
    recording = recording.processed(mti=kept.mti)
    image = recording.spectrogram
    velocity, time_s = image.velocity_mps.values, image.time_s.values
    power = _power(image.values)
    added: np.ndarray | None = None
    details: dict[str, Any] = {}
    if recipe.background is not None:
        seed = integer_seed(recipe.seeds(index, "background"))
        settings = background_settings(
            recipe.background,
            seed=seed,
            level_db=recipe.background_level_db,
            noisy=recording.noise_dbm is not None,
            carrier_hz=recording.radar.carrier_hz,
        )
        added = background(velocity, time_s, settings).power_w(settings["level_db"]).astype(np.float64)
        power = power + added
        details["background"] = settings
    if recipe.masks is not None:
        occluded = occlude(
            power, time_s, recipe.masks, seed=integer_seed(recipe.seeds(index, "masks")),
            fill="zeros" if added is None else "background", background_power=added,
        )  # fmt: skip
        if added is None and occluded.columns.all():
            raise InputError(
                "occluded windows cover the whole record and there is no background to show; give the recipe a background, or "
                "fewer or shorter windows"
            )
        power = occluded.power
        details["masks_s"] = np.round(occluded.windows_s, 6).tolist()
    return View(power, velocity, time_s, details)


def _power(level_db: np.ndarray) -> np.ndarray:
    return np.asarray(10.0 ** (level_db.astype(np.float64) / 10.0))
