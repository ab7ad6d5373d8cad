"""Physical constants in SI units (CODATA 2018, exact by definition unless noted), the units of names, and powers in decibels."""

from __future__ import annotations

import numpy as np

SPEED_OF_LIGHT = 299_792_458.0
"""m/s"""

BOLTZMANN = 1.380_649e-23
"""J/K"""

VACUUM_PERMITTIVITY = 8.854_187_8128e-12
"""F/m"""

REFERENCE_TEMPERATURE_K = 290.0
"""Noise reference temperature (IEEE)."""

STANDARD_GRAVITY = 9.806_65
"""m/s^2"""

UNITS = {"m": "m", "s": "s", "mps": "m/s", "rad": "rad", "dbm": "dBm"}
"""Units by the end of the name of an axis or of a variable."""


def unit_of(name: str) -> str:
    """The unit that a name ends with, as that of "range_m"; "" where it ends with none."""
    return UNITS.get(name.rpartition("_")[2], "")


def decibel(power: np.ndarray) -> np.ndarray:
    """Power [dB re 1 W]; silence reads -300 dB, far below thermal noise in any bin."""
    return np.asarray(10 * np.log10(np.maximum(power, 1e-30)))
