"""Building materials of ITU-R P.2040, from the table that Sionna RT carries."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cache
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from t2d_rt.core.backend import select
from t2d_rt.core.errors import InputError
from t2d_rt.propagation.rays import imported
from t2d_rt.types import Material
from t2d_rt.types.material import known_itu, short_name


def itu_material(name: str, frequency_hz: float) -> Material:
    """A smooth ITU material at one frequency (ITU-R P.2040-3, section 2.1.4); "itu_concrete" is "concrete". Raises InputError if
    there are no values for it."""
    if not 0 < frequency_hz < math.inf:
        raise InputError(f"frequency_hz must be positive and finite, got {frequency_hz}")
    itu = _sionna_table()
    short = known_itu(short_name(name))
    try:
        permittivity, conductivity = itu.itu_material(short, frequency_hz)
    except ValueError:
        valid = ", ".join(itu_names(frequency_hz))
        raise InputError(
            f"ITU-R P.2040 has no values for {short} at {frequency_hz / 1e9:g} GHz; use one of {valid}, "
            "or give a Material with its permittivity and conductivity"
        ) from None
    return Material(
        name=f"itu_{short}", relative_permittivity=float(permittivity), conductivity_s_per_m=float(conductivity)
    )


def check_values(materials: Iterable[str | Material], frequency_hz: float) -> None:
    """Raises one InputError for all of a scene's materials that have no values at a frequency."""
    valid = itu_names(frequency_hz)
    named = {short_name(material) for material in materials if isinstance(material, str)}
    missing = [known_itu(name) for name in sorted(named - set(valid))]
    if missing:
        # All others are mineral: brick, marble, ground.
        substitutes = {name: "wood" if name == "plywood" else "concrete" for name in missing}
        options = ",".join(f"{name}={other}" for name, other in substitutes.items())
        raise InputError(
            f"ITU-R P.2040 has no values for {' and '.join(missing)} at {frequency_hz / 1e9:g} GHz; name substitutes, as "
            f"--scene-material {options} or load_scene(..., materials={substitutes}), from {', '.join(valid)}, or give a "
            "Material with its permittivity and conductivity"
        )


def resolved(material: str | Material, frequency_hz: float) -> Material:
    """Values of a surface's material at one frequency."""
    return itu_material(material, frequency_hz) if isinstance(material, str) else material


def itu_names(frequency_hz: float) -> list[str]:
    """Names of the ITU materials whose values are known at a frequency, sorted."""
    table = _sionna_table().ITU_MATERIALS_PROPERTIES
    ghz = frequency_hz / 1e9
    return sorted(name for name, ranges in table.items() if any(low <= ghz <= high for low, high in ranges))


@cache
def _sionna_table() -> Any:
    """Sionna's module with the ITU table, read from its file: all of Sionna RT, none of which it needs, takes 1.5 s to import."""
    mi = imported()
    if mi.variant() is None:
        mi.set_variant(select().mitsuba_variant)
    package = find_spec("sionna")
    for folder in (package and package.submodule_search_locations) or ():
        spec = spec_from_file_location("_itu_of_sionna", Path(folder) / "rt" / "radio_materials" / "itu.py")
        if spec is not None and spec.loader is not None and Path(str(spec.origin)).is_file():
            table = module_from_spec(spec)
            spec.loader.exec_module(table)
            return table
    from sionna.rt.radio_materials import itu  # a Sionna with other files

    return itu
