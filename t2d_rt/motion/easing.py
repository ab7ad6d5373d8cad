"""The smooth step that motions are eased and joined by."""

from __future__ import annotations

import numpy as np


def minimum_jerk(fraction: np.ndarray) -> np.ndarray:
    """From 0 to 1 over fractions (...) from 0 to 1, without speed or acceleration at either end: 10 x^3 - 15 x^4 + 6 x^5.

    Flash and Hogan 1985, equation 2. Fractions below 0 and above 1 stay at the ends.
    """
    x = np.clip(fraction, 0.0, 1.0)
    return np.asarray(x**3 * (10.0 + x * (6.0 * x - 15.0)))
