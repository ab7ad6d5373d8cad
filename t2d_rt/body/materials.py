"""Materials of bodies at millimetre waves: skin, clothing and shoes."""

from __future__ import annotations

import math
from typing import cast

from t2d_rt.core.constants import VACUUM_PERMITTIVITY
from t2d_rt.core.errors import InputError
from t2d_rt.types import PEC, Material
from t2d_rt.types.material import BODY_NAMES, checked_frequency, checked_material

DRY_SKIN_POLES: tuple[tuple[float, float, float], ...] = ((32.0, 7.234e-12, 0.0), (1100.0, 32.481e-9, 0.2))
"""Poles (delta eps, tau [s], alpha) of dry skin; the last two of the model's four terms have no strength (Gabriel 1996, part
III)."""

DRY_SKIN_HIGH_FREQUENCY_PERMITTIVITY = 4.0
DRY_SKIN_IONIC_CONDUCTIVITY_S_PER_M = 0.0002

SCATTERING_COEFFICIENTS: dict[str, float] = {"skin": 0.3, "clothed": 0.6}
"""Scattering coefficient S of the body's surfaces: skin is nearly smooth at 4 mm wavelength, cloth is not. Clothing attenuates the
wave by less than 3 dB, so the permittivity behind it is still that of skin."""

SHOE_PERMITTIVITY, SHOE_CONDUCTIVITY_S_PER_M, SHOE_CONDUCTIVITY_POWER = 3.62, 0.0051, 0.8422
"""Relative permittivity of vinyl, a common material of soles and uppers, its conductivity at 1 GHz, and the power of the frequency
with which that grows (ITU-R P.2040-3, vinyl tile; its values end at 40 GHz)."""
SHOE_SCATTERING_COEFFICIENT = 0.1
"""Scattering coefficient S of moulded, nearly smooth surfaces, the same as for movers' plastic."""


def skin_permittivity(frequency_hz: float) -> complex:
    """Complex relative permittivity of dry skin, eps' - j eps'' (physics.md, eq. 10); 6.57 - j8.91 at 77 GHz."""
    frequency_hz = checked_frequency(frequency_hz)
    omega = 2 * math.pi * frequency_hz
    relaxation = sum(strength / (1 + (1j * omega * tau_s) ** (1 - alpha)) for strength, tau_s, alpha in DRY_SKIN_POLES)
    ionic = DRY_SKIN_IONIC_CONDUCTIVITY_S_PER_M / (1j * omega * VACUUM_PERMITTIVITY)
    return DRY_SKIN_HIGH_FREQUENCY_PERMITTIVITY + relaxation + ionic


def resolve_material(material: str | Material, frequency_hz: float) -> Material:
    """The material of a name in `BODY_NAMES` with its values at one frequency; a `Material` is returned unchanged."""
    checked_frequency(frequency_hz)
    if isinstance(checked_material(material), Material):
        return cast(Material, material)
    if material == "pec":
        return PEC
    if material not in BODY_NAMES:
        raise InputError(f"unknown body material {material!r}; use one of {', '.join(BODY_NAMES)}, or a Material")
    if material == "shoe":
        return Material(
            name="shoe",
            relative_permittivity=SHOE_PERMITTIVITY,
            conductivity_s_per_m=SHOE_CONDUCTIVITY_S_PER_M * (frequency_hz / 1e9) ** SHOE_CONDUCTIVITY_POWER,
            scattering_coefficient=SHOE_SCATTERING_COEFFICIENT,
        )
    permittivity = skin_permittivity(frequency_hz)
    return Material(
        name=material,
        relative_permittivity=permittivity.real,
        conductivity_s_per_m=-permittivity.imag * 2 * math.pi * frequency_hz * VACUUM_PERMITTIVITY,
        scattering_coefficient=SCATTERING_COEFFICIENTS[material],
    )
