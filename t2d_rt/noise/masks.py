"""Occlusion masks: random time windows in which a spectrogram shows the background only, as when something blocks the path.

Text2Doppler replaces random windows by background noise; its code fills them with zeros, which is an option here. What a mask
leaves out: a real blockage attenuates by degrees, over the Fresnel zone's width, and leaves multipath.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict, Field

from t2d_rt.core.checks import array, choice, integer, positive
from t2d_rt.core.errors import InputError
from t2d_rt.types.fields import Fields, Number

Fill = Literal["background", "zeros"]


class OcclusionMask(Fields):
    """Number and duration of occluded windows.

    >>> OcclusionMask(windows=2).windows
    2.0
    """

    model_config = ConfigDict(use_attribute_docstrings=True)
    noun = "occlusion mask"

    windows: Number = Field(default=1.0, ge=0, le=1e4)
    """Mean number of windows in a recording; their number is Poisson distributed."""
    shortest_s: Number = Field(default=0.2, gt=0, le=1e6)
    """Duration of the shortest window [s]; durations are uniformly distributed."""
    longest_s: Number = Field(default=1.0, gt=0, le=1e6)
    """Duration of the longest window [s]."""

    def model_post_init(self, _: Any) -> None:
        """Refuses a shortest window that is longer than the longest."""
        if self.longest_s < self.shortest_s:
            raise InputError(f"longest_s must be shortest_s ({self.shortest_s:g} s) or more, got {self.longest_s:g}")

    def draw(self, duration_s: float, *, seed: int) -> np.ndarray:
        """Random windows (window, start and stop) [s] within a duration, ordered by their starts; they may overlap.

        The start of a window is uniformly distributed from one window length before the recording to its end, so that every instant
        is equally likely to be occluded; parts outside are cut off.
        """
        duration_s = positive("duration_s", duration_s, 1e6, unit="s")
        rng = np.random.default_rng(integer("seed", seed))
        count = int(rng.poisson(self.windows))
        lengths = rng.uniform(self.shortest_s, self.longest_s, count)
        starts = rng.uniform(-lengths, duration_s)
        windows = np.clip(np.stack([starts, starts + lengths], axis=1), 0, duration_s)
        return np.asarray(windows[np.argsort(windows[:, 0], kind="stable")])


@dataclass(frozen=True, slots=True, kw_only=True)
class Occluded:
    """A spectrogram with occluded windows."""

    power: np.ndarray
    """Power [W], (velocity, time)."""
    windows_s: np.ndarray
    """Start and stop of each window from the start of the recording [s], (window, 2)."""
    columns: np.ndarray
    """Which columns were replaced, bool (time,)."""


def occlude(
    spectrogram_power: Any,
    time_s: Any,
    mask: OcclusionMask,
    *,
    seed: int,
    fill: Fill = "background",
    background_power: Any = None,
) -> Occluded:
    """Replaces the columns whose centres lie in random windows by those of a background, or by zeros.

    spectrogram_power: power [W], (velocity, time).
    time_s: centres of the columns [s]; the recording lasts from 0 to half a step after the last one.
    background_power: power [W] in the same shape, for the fill "background": that which was added to the spectrogram, so that its
        level and its moving parts continue through the window.

    Raises InputError for negative powers, for times that do not ascend, and where the fill "background" has no `background_power`
    or the fill "zeros" has one.
    """
    power = _power("spectrogram_power", spectrogram_power, ("velocity", "time"))
    times = array("time_s", time_s, (power.shape[1],), unit="s")
    choice("fill", fill, ("background", "zeros"))
    if (fill == "background") != (background_power is not None):
        raise InputError(
            'occlusion by "background" needs background_power, and by "zeros" takes none; give the power of the background that '
            "was added to the spectrogram"
        )
    if len(times) < 2 or np.diff(times).min() <= 0:
        raise InputError("time_s must hold two instants or more, ascending")
    windows = mask.draw(float(times[-1] + (times[-1] - times[-2]) / 2), seed=seed)
    columns = covered(times, windows)
    filled = np.zeros_like(power)
    if fill == "background":
        filled = _power("background_power", background_power, power.shape)
    return Occluded(power=np.where(columns, filled, power), windows_s=windows, columns=columns)


def covered(times_s: np.ndarray, windows_s: np.ndarray) -> np.ndarray:
    """Which of the times (T,) lie in a window of `OcclusionMask.draw`, bool (T,)."""
    return np.asarray(((times_s[:, None] >= windows_s[:, 0]) & (times_s[:, None] < windows_s[:, 1])).any(axis=1))


def _power(name: str, values: Any, shape: tuple[int | str, ...]) -> np.ndarray:
    """Checked powers [W] of a shape; refuses negative ones."""
    powers = array(name, values, shape, limit=1e60, unit="W")
    if powers.size and powers.min() < 0:
        raise InputError(f"{name} must be 0 W or more, got {powers.min():g}; give powers, not decibels or amplitudes")
    return powers
