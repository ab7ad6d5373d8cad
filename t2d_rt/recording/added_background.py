"""The background that a recording's spectrogram carries: what its settings say of it, and its power."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import integer
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.noise.background import Background, Grid, add_background, load_background
from t2d_rt.noise.background.model import step_ratio
from t2d_rt.noise.background.records import checked_level
from t2d_rt.signal.doppler import checked_windows
from t2d_rt.signal.maps import Spectrogram
from t2d_rt.types import Radar

BAND = 0.05
"""By how much the carrier may differ from that of the recordings that a model was learned from."""


def background_settings(
    model: str | Path,
    *,
    seed: int = 0,
    level_db: float | None = None,
    noisy: bool = False,
    carrier_hz: float | None = None,
) -> dict[str, Any]:
    """What a recording keeps of its background: the model and its digest, seed and level.

    noisy: whether the recording has a receiver's noise, beside which a background of its own level is warned of.
    carrier_hz: that of the recording, where it is known: a model of another band is warned of.
    """
    if noisy and level_db is None:
        warnings.warn(
            "the recording has the receiver's noise, and the background has a noise floor of its own; simulate with "
            "noise='none', or give background_level_db",
            T2DWarning,
            stacklevel=3,
        )
    learned = load_background(model)
    if level_db is None and not learned.calibrated:
        raise InputError(
            f"{model} was learned from recordings whose samples are not in sqrt(W); give background_level_db, the level of its "
            "noise floor [dB re 1 W]"
        )
    if carrier_hz is not None and abs(carrier_hz / learned.carrier_hz - 1) > BAND:
        what = "level and clutter" if level_db is None else "clutter"
        warnings.warn(
            f"{model} was learned at {learned.carrier_hz / 1e9:.4g} GHz and the recording is of {carrier_hz / 1e9:.4g} GHz: "
            f"{what} of the background are those of the other band; take a model that was learned from such a radar",
            T2DWarning,
            stacklevel=3,
        )
    level = None if level_db is None else checked_level(level_db)
    return {"model": str(model), "digest": learned.digest, "seed": integer("seed", seed), "level_db": level}


def background_power(image: Spectrogram, settings: Mapping[str, Any]) -> np.ndarray:
    """Power [W] of a spectrogram with the background of a recording's settings."""
    return add_background(image.power, background(image.velocity_mps, image.time_s, settings), settings["level_db"])


def background(velocity_mps: np.ndarray, time_s: np.ndarray, settings: Mapping[str, Any]) -> Background:
    """The background of a recording's settings by itself, on the axes of a spectrogram."""
    learned = load_background(settings["model"])
    if learned.digest != settings["digest"]:
        raise InputError(
            f"{settings['model']} is no longer the background model that the recording was made with; put that back, or give the "
            "recording a background anew"
        )
    grid = Grid.of_columns(velocity_mps, time_s)
    return learned.columns(len(time_s), seed=settings["seed"], grid=grid)


def check_axes(model: str | Path, radar: Radar, processing: Mapping[str, Any]) -> None:
    """Refuses a radar and options of the spectrogram whose axes the model cannot serve, before anything is simulated."""
    radar = radar.separated
    plenty = radar.loops_per_frame or 1 << 20
    given = [processing.get(name) for name in ("n_window", "overlap", "n_fft")]
    n_window, overlap, n_fft = checked_windows(radar, plenty, *given)
    step = n_window - overlap
    bursts = radar.loops_per_frame is not None
    if bursts and n_window + step <= plenty:
        raise InputError(
            "columns of bursts are not evenly spaced in time: set n_window to the whole burst for a background"
        )
    step_s = radar.frame_interval_s if bursts and radar.frame_interval_s is not None else step * radar.loop_interval_s
    step_ratio(load_background(model).grid, Grid.of(radar.speed_axis_mps(n_fft), step_s))
