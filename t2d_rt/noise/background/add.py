"""A background, and its sum with a spectrogram in the power domain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.core.checks import array
from t2d_rt.core.errors import InputError
from t2d_rt.noise.background.records import Grid, checked_level


@dataclass(frozen=True, slots=True, kw_only=True)
class Background:
    """A spectrogram of a scene in which nobody moves, relative to its noise floor, and the level of that."""

    power: np.ndarray
    """Relative to the noise floor, float32 (velocity, time)."""
    grid: Grid
    level_db: float
    """The noise floor of one of the recordings that it was learned from [dB re 1 W]."""
    calibrated: bool
    """Whether that level is in W at the ADC."""
    codes: np.ndarray
    """The codes that it was decoded from (step, head)."""

    def power_w(self, level_db: float | None = None) -> np.ndarray:
        """Power [W], float32 (velocity, time), of a noise floor of that level [dB re 1 W], by default of its own."""
        if level_db is None and not self.calibrated:
            raise InputError(
                "this background was learned from recordings whose samples are not in sqrt(W), so that its own level means "
                "nothing here; give level_db, the level of its noise floor [dB re 1 W]"
            )
        level = self.level_db if level_db is None else checked_level(level_db)
        return np.asarray(self.power * np.float32(10 ** (level / 10)))


def add_background(spectrogram_power: Any, background: Background, level_db: float | None = None) -> np.ndarray:
    """Power [W] (velocity, time) of a spectrogram with a background: the sum of the two powers.

    level_db: the level of the background's noise floor, its median cell [dB re 1 W]; by default that of one of the recordings that
        the background was learned from.

    Exact in the mean: echoes and background are independent and the background's phase is uniform, so that E|s + b|^2 = |s|^2 +
    E|b|^2. One realisation of a true sum has the cross term 2 Re(s b*) besides, which has the mean 0 and in a cell of M looks a
    standard deviation of sqrt(2 |s|^2 E|b|^2 / M): 2 dB where the background is 6 dB below the echo and M = 1, less where it is
    weaker. It is missing here. Nor does a person cast a shadow on the background. Receiver noise added to the ADC cube has both.
    """
    power = array("spectrogram_power", spectrogram_power, ("velocity", "time"), limit=1e60, unit="W")
    if power.min(initial=0) < 0:
        raise InputError("spectrogram_power must not be negative; give powers in W, no levels in dB")
    if power.shape != background.power.shape:
        raise InputError(
            f"spectrogram and background must have the same shape, got {power.shape} and {background.power.shape}; sample the "
            "background with the grid and the columns of the spectrogram"
        )
    return power + background.power_w(level_db)
