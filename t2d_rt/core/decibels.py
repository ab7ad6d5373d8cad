"""Powers as levels."""

from __future__ import annotations

import numpy as np


def decibel(power: np.ndarray) -> np.ndarray:
    """Power [dB re 1 W]; silence reads -300 dB, far below thermal noise in any bin."""
    return np.asarray(10 * np.log10(np.maximum(power, 1e-30)))
