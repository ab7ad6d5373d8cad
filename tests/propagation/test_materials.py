"""Materials against published figures."""

from __future__ import annotations

import math

import numpy as np
import pytest

from t2d_rt.body.materials import resolve_material, skin_permittivity
from t2d_rt.core.errors import InputError
from t2d_rt.propagation.materials import _sionna_table, itu_material, itu_names
from t2d_rt.types import PEC, Material
from t2d_rt.types.material import BODY_NAMES, ITU_NAMES
from t2d_rt.types.path_fields import reflection

CARRIER_HZ = 77e9


def _reflected(material: Material) -> float:
    """|Gamma|^2 at normal incidence."""
    return abs(material.reflection(CARRIER_HZ)) ** 2


def test_skin_permittivity_at_77_ghz() -> None:
    assert skin_permittivity(CARRIER_HZ) == pytest.approx(6.565 - 8.913j, abs=6e-4)


@pytest.mark.parametrize(
    ("frequency_hz", "permittivity", "conductivity"),
    # Gabriel's own tables of dry skin (IFAC database), three decades apart
    [(100e6, 72.929, 0.49122), (1e9, 40.936, 0.89977), (10e9, 31.290, 8.0138)],
)
def test_skin_follows_gabriels_table(frequency_hz: float, permittivity: float, conductivity: float) -> None:
    skin = resolve_material("skin", frequency_hz)
    assert skin.relative_permittivity == pytest.approx(permittivity, rel=1e-3)
    assert skin.conductivity_s_per_m == pytest.approx(conductivity, rel=1e-3)


def test_skin_reflects_a_third() -> None:
    skin = resolve_material("skin", CARRIER_HZ)
    assert _reflected(skin) == pytest.approx(0.340, abs=5e-4)
    assert skin.permittivity(CARRIER_HZ) == pytest.approx(skin_permittivity(CARRIER_HZ), rel=1e-12)


def test_clothing_is_rough_skin() -> None:
    clothed, skin = resolve_material("clothed", CARRIER_HZ), resolve_material("skin", CARRIER_HZ)
    assert _reflected(clothed) == _reflected(skin)
    assert clothed.scattering_coefficient > skin.scattering_coefficient


def test_pec_and_materials_pass_through() -> None:
    own = Material(relative_permittivity=3.0)
    assert resolve_material("pec", CARRIER_HZ) is PEC
    assert resolve_material(own, CARRIER_HZ) is own
    assert PEC.reflection(CARRIER_HZ) == -1


def test_unknown_body_material_lists_the_names() -> None:
    with pytest.raises(InputError, match=r"unknown body material 'wool'; use one of pec, skin, clothed"):
        resolve_material("wool", CARRIER_HZ)
    assert [resolve_material(name, CARRIER_HZ).name for name in BODY_NAMES] == list(BODY_NAMES)


@pytest.mark.parametrize("frequency_hz", [0.0, -1.0, math.nan, math.inf])
def test_frequency_must_be_positive(frequency_hz: float) -> None:
    with pytest.raises(InputError, match="frequency_hz must"):
        skin_permittivity(frequency_hz)
    with pytest.raises(InputError, match="frequency_hz must"):
        itu_material("glass", frequency_hz)


@pytest.mark.parametrize(
    ("name", "reflected_db"),
    [("concrete", -8.1), ("glass", -7.3), ("plasterboard", -12.2), ("wood", -15.3), ("metal", 0.0)],
)
def test_itu_reflection_at_77_ghz(name: str, reflected_db: float) -> None:
    material = itu_material(name, CARRIER_HZ)
    assert 10 * math.log10(_reflected(material)) == pytest.approx(reflected_db, abs=0.05)
    through, _ = reflection(material, 2.0, np.array(1.0), CARRIER_HZ)  # of a slab that swallows what enters it
    assert abs(through) ** 2 == pytest.approx(_reflected(material), rel=1e-3)
    assert itu_material(f"itu_{name}", CARRIER_HZ) == material


@pytest.mark.parametrize("name", ["brick", "marble", "plywood", "vinyl_tile", "itu_carpet_tile"])
def test_itu_materials_without_values_at_77_ghz(name: str) -> None:
    with pytest.raises(
        InputError, match=rf"no values for {name.removeprefix('itu_')} at 77 GHz; use one of .*concrete.*metal"
    ):
        itu_material(name, CARRIER_HZ)


def test_unknown_itu_material_lists_the_names() -> None:
    with pytest.raises(InputError, match=r"unknown material 'cheese'; ITU names are asphalt_concrete, .*wood"):
        itu_material("cheese", CARRIER_HZ)


def test_itu_names_depend_on_frequency() -> None:
    assert "brick" in itu_names(28e9)
    assert "brick" not in itu_names(CARRIER_HZ)


def test_the_table_is_sionnas_and_sionna_is_not_imported_for_it() -> None:
    from sionna.rt.radio_materials import itu

    found = _sionna_table()
    assert found.ITU_MATERIALS_PROPERTIES == itu.ITU_MATERIALS_PROPERTIES
    assert sorted(found.ITU_MATERIALS_PROPERTIES) == list(ITU_NAMES)
    assert found.itu_material("concrete", CARRIER_HZ) == itu.itu_material("concrete", CARRIER_HZ)
    assert found is not itu, "all of Sionna RT takes a second to import"
