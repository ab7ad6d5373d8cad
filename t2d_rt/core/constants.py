"""Physical constants in SI units (CODATA 2018, exact by definition unless noted), units of variables by their names, and
decibels."""

from __future__ import annotations

import numpy as np

SPEED_OF_LIGHT = 299_792_458.0
"""Speed of light in vacuum [m/s]."""

BOLTZMANN = 1.380_649e-23
"""Boltzmann constant [J/K]."""

VACUUM_PERMITTIVITY = 8.854_187_8128e-12
"""Vacuum permittivity [F/m]."""

REFERENCE_TEMPERATURE_K = 290.0
"""Noise reference temperature [K] (IEEE)."""

STANDARD_GRAVITY = 9.806_65
"""Standard acceleration of gravity [m/s^2]."""

UNITS = {"m": "m", "s": "s", "mps": "m/s", "rad": "rad", "dbm": "dBm"}
"""Units by the ending of a variable's or an axis's name."""


def unit_of(name: str) -> str:
    """The unit at the end of a name, such as "m" for "range_m"; "" where there is none."""
    return UNITS.get(name.rpartition("_")[2], "")


def decibel(power: np.ndarray) -> np.ndarray:
    """Power [dB re 1 W]; zero power gives -300 dB, far below thermal noise in any bin."""
    return np.asarray(10 * np.log10(np.maximum(power, 1e-30)))
