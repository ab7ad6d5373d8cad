"""Physical constants, SI units (CODATA 2018, exact by definition unless noted)."""

from __future__ import annotations

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
