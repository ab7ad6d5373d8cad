"""A background on other axes than those it was learned on, where that is sound."""

from __future__ import annotations

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.noise.background.records import Grid

WIDEST = 2.0
"""Greatest factor by which bins, and columns, may be wider or narrower: beyond it windows blur or split what moves."""


def step_ratio(own: Grid, wanted: Grid) -> float:
    """Columns of a model for each column that is wanted; an InputError where the axes cannot be had from the model's."""
    columns = wanted.time_step_s / own.time_step_s
    bins = wanted.bin_mps / own.bin_mps
    speeds, reach = wanted.velocity_mps, own.velocity_mps
    inside = speeds[0] >= reach[0] - wanted.bin_mps and speeds[-1] <= reach[-1] + wanted.bin_mps
    if not (inside and 1 / WIDEST <= columns <= WIDEST and 1 / WIDEST <= bins <= WIDEST):
        raise InputError(
            f"the spectrogram has {wanted}, the background model {own}; bins and columns may differ by a factor of {WIDEST:g} and "
            "speeds may not exceed the model's: choose n_window and overlap alike, or train a model for this radar"
        )
    return float(columns)


def resampled(
    mean: np.ndarray, looks: np.ndarray, time: np.ndarray, doppler: np.ndarray, own: Grid, wanted: Grid, columns: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Mean [nat] and looks on the wanted axes, and the speckle's correlations at their steps; all interpolated linearly.

    That a window of another length has other looks is left out.
    """
    at = np.arange(columns) * wanted.time_step_s / own.time_step_s
    speeds = np.clip((wanted.velocity_mps - own.velocity_mps[0]) / own.bin_mps, 0, len(mean) - 1)
    both = np.stack([_between(_between(each, at, 1), speeds, 0) for each in (mean, looks)])
    steps = np.arange(time.shape[1]) * wanted.time_step_s / own.time_step_s
    ending = np.pad(time, ((0, 0), (0, 1)))  # beyond the lags that are kept there is no correlation
    lags = _between(_between(ending, np.minimum(steps, time.shape[1]), 1), speeds, 0)
    bins = np.interp(
        np.arange(len(doppler)) * wanted.bin_mps / own.bin_mps, np.arange(len(doppler)), doppler, right=0.0
    )
    return both[0], both[1], lags, bins


def _between(values: np.ndarray, at: np.ndarray, axis: int) -> np.ndarray:
    """Values between those of an axis."""
    low = np.clip(np.floor(at).astype(int), 0, values.shape[axis] - 2)
    weight = (at - low).astype(np.float32)
    weight = weight[:, None] if axis == 0 else weight
    return np.take(values, low, axis) * (1 - weight) + np.take(values, low + 1, axis) * weight
