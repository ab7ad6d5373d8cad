"""Slab coefficients against closed forms and against Sionna RT's."""

import numpy as np
import pytest

from t2d_rt.core.backend import select
from t2d_rt.propagation.materials import itu_material
from t2d_rt.propagation.rays import mitsuba
from t2d_rt.types import PEC, Material
from t2d_rt.types.path_fields import reflection, transmission

CARRIER_HZ = 77e9


def slab(material: Material, thickness_m: float, cosine: np.ndarray, frequency_hz: float) -> tuple[np.ndarray, ...]:
    """R_TE, R_TM, T_TE, T_TM."""
    given = material, thickness_m, cosine, frequency_hz
    return *reflection(*given), *transmission(*given)


def test_a_perfect_conductor_mirrors() -> None:
    r_te, r_tm, t_te, t_tm = slab(PEC, 0.01, np.array([1.0, 0.3]), CARRIER_HZ)
    assert (r_te == -1).all()
    assert (r_tm == 1).all()
    assert (t_te == 0).all()
    assert (t_tm == 0).all()


def test_power_is_kept_without_loss() -> None:
    glass = Material(relative_permittivity=6.3)
    r_te, r_tm, t_te, t_tm = slab(glass, 0.006, np.linspace(0.05, 1, 40), CARRIER_HZ)
    np.testing.assert_allclose(np.abs(r_te) ** 2 + np.abs(t_te) ** 2, 1, rtol=1e-12)
    np.testing.assert_allclose(np.abs(r_tm) ** 2 + np.abs(t_tm) ** 2, 1, rtol=1e-12)


def test_nothing_is_reflected_at_brewsters_angle() -> None:
    brewster = np.arctan(np.sqrt(3.0))
    _, r_tm, _, t_tm = slab(Material(relative_permittivity=3.0), 0.01, np.cos(brewster), CARRIER_HZ)
    assert abs(r_tm) < 1e-12
    assert abs(abs(t_tm) - 1) < 1e-12


@pytest.mark.parametrize(("name", "thickness_m"), [("plasterboard", 0.0125), ("glass", 0.006), ("wood", 0.04)])
def test_slabs_agree_with_sionna(name: str, thickness_m: float) -> None:
    mi = mitsuba(select("cpu"))
    from sionna.rt.utils import itu_coefficients_single_layer_slab

    cosine = np.linspace(0.02, 1, 50)
    material = itu_material(name, CARRIER_HZ)
    eta = material.permittivity(CARRIER_HZ)
    theirs = itu_coefficients_single_layer_slab(
        mi.Float(cosine), mi.Complex2f(eta.real, eta.imag), mi.Float(thickness_m), mi.Float(299792458 / CARRIER_HZ)
    )
    for ours, other in zip(slab(material, thickness_m, cosine, CARRIER_HZ), theirs, strict=True):
        found = other.real.numpy() + 1j * other.imag.numpy()
        np.testing.assert_allclose(found, ours, atol=2e-4)  # theirs is float32, and some hundred radians thick
