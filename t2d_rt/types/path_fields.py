"""Fields over one-way paths from a path's data alone (docs/physics.md, eq. 23, 24), with the coefficients of the slabs they meet.

Reflection and transmission of slabs after ITU-R P.2040-3, eq. (37), (43) and (44), with e^{+j omega t}: coefficients of the field
for TE and TM waves at angles of incidence given by their cosine (...), complex (...). A perfect conductor has R_TE = -1, R_TM = +1
and transmits nothing.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.geometry.vectors import cross
from t2d_rt.types import Material, OneWayPath, Radar, StaticPath
from t2d_rt.types.paths import Elements

Polarized = tuple[np.ndarray, np.ndarray]
"""A coefficient of TE and of TM waves."""


def reflection(material: Material, thickness_m: float, cosine: np.ndarray, frequency_hz: float) -> Polarized:
    """Reflection coefficients R_TE and R_TM of a slab of that thickness [m] (...), complex (...)."""
    if math.isinf(material.relative_permittivity):
        one = np.ones(np.shape(cosine), complex)
        return -one, one
    (te, tm), once = _waves(material, thickness_m, cosine, frequency_hz)
    twice = once**2
    rest = 1 - twice
    return te * rest / (1 - te**2 * twice), tm * rest / (1 - tm**2 * twice)


def transmission(material: Material, thickness_m: float, cosine: np.ndarray, frequency_hz: float) -> Polarized:
    """Transmission coefficients T_TE and T_TM of such a slab from face to face, complex (...)."""
    if math.isinf(material.relative_permittivity):
        return np.zeros(np.shape(cosine), complex), np.zeros(np.shape(cosine), complex)
    singles, once = _waves(material, thickness_m, cosine, frequency_hz)
    squares, twice = [single**2 for single in singles], once**2
    te, tm = ((1 - square) * once / (1 - square * twice) for square in squares)
    return te, tm


def _waves(
    material: Material, thickness_m: float, cosine: np.ndarray, frequency_hz: float
) -> tuple[Polarized, np.ndarray]:
    """Reflection at one face alone, TE and TM, and the factor of the field from face to face."""
    cosine = np.asarray(cosine, float)
    eta = material.permittivity(frequency_hz)
    root = np.sqrt(eta - (1 - cosine**2))
    # e^{-jq}: an evanescent or lossy wave decays.
    once = np.exp(-2j * math.pi * frequency_hz / SPEED_OF_LIGHT * thickness_m * root)
    return ((cosine - root) / (cosine + root), (eta * cosine - root) / (eta * cosine + root)), once


@dataclass(frozen=True, slots=True)
class SweepNodes:
    """Frequencies, nodes of Gauss's rule over the sweep, from which the straight line nearest to a spectrum is found.

    An echo's spectrum is such a line, around the delay's phase: of two numbers those of the least mean square error, where the
    spectrum goes through no more than about one cycle over the sweep, as that of the scenes' walls does. The value at mid-sweep
    with the slope between two others errs by up to 4 dB more.
    """

    frequencies_hz: np.ndarray
    """(F,)."""
    places: np.ndarray
    """Theirs in -1..1 over the sweep."""
    fractions: np.ndarray
    """Of the sweep that each stands for."""
    half_band_hz: float

    @classmethod
    def of(cls, radar: Radar, count: int = 3) -> SweepNodes:
        """Three find the line of spectra that are cubic in the frequency exactly; what it leaves out of them takes four."""
        places, weights = np.polynomial.legendre.leggauss(count)
        half_hz = radar.bandwidth_hz / 2
        return cls(radar.mid_frequency_hz + half_hz * places, places, weights / 2, half_hz)

    def line(self, spectrum: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Value at the middle of the band and slope [1/Hz] (...) of the line nearest to a spectrum (F, ...)."""
        value = np.tensordot(self.fractions, spectrum, 1)
        rise = 3 * np.tensordot(self.fractions * self.places, spectrum, 1)
        return value, rise / self.half_band_hz

    def powers(self, spectrum: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean power over the sweep of a spectrum (F, ...), and of what that line leaves out of it, (...)."""
        value, slope = self.line(spectrum)
        rest = spectrum - value - np.multiply.outer(self.places * self.half_band_hz, slope)
        whole, left_out = (np.tensordot(self.fractions, np.abs(each) ** 2, 1) for each in (spectrum, rest))
        return whole, left_out


def field_over(path: OneWayPath, points: np.ndarray, frequencies_hz: np.ndarray) -> np.ndarray:
    """The field that an antenna of gain 1 radiates over a path to points (..., 3) m at frequencies (F,) Hz, complex (F, ..., 3).

    It is without the attenuation and phase of distance and of the path's `delay_s`, so of length 1 in the line of sight.
    """
    # The straight path from the image, folded back mirror by mirror, begins at the antenna.
    ahead = path.unfolded(points) - path.antenna_m
    ahead = ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
    wave = (path.polarization - (ahead @ path.polarization)[..., None] * ahead).astype(complex)
    wave /= np.maximum(np.linalg.norm(wave, axis=-1, keepdims=True), 1e-12)
    wave = np.repeat(wave[None], len(frequencies_hz), axis=0)
    for number in range(len(path.chain)):
        wave, ahead = _after(wave, ahead, path.elements.taken(number), frequencies_hz)
    return wave


def received(path: StaticPath, frequencies_hz: np.ndarray) -> np.ndarray:
    """What antennas of gain 1 and the radar's polarisations receive over a static path at frequencies (F,) Hz, without the
    attenuation and phase of distance: complex (F,)."""
    return field_over(path.path, path.stops_m[-1], frequencies_hz) @ path.taken


def _after(
    wave: np.ndarray, ahead: np.ndarray, element: Elements, frequencies_hz: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The field (F, ..., 3) and its direction (..., 3) after one element.

    TE is across the plane of incidence, TM = TE x direction before and after: at normal incidence R_TE = -R_TM is one and the same,
    and so is T_TE = T_TM.
    """
    normal = element.normal
    cosine = ahead @ normal
    # A slab lets the wave through without bending it: what refraction does within it is in the coefficient.
    onward = ahead if element.through else ahead - 2 * cosine[..., None] * normal
    across = _cross(ahead, normal)
    length = np.sqrt(np.einsum("...i,...i->...", across, across))[..., None]
    # At normal incidence any direction across will do.
    helper = _cross(normal, np.eye(3)[0 if abs(normal[0]) < 0.6 else 1])
    across = np.where(length > 1e-9, across / np.maximum(length, 1e-12), helper / np.linalg.norm(helper))
    te, tm = _coefficients(element, np.abs(cosine), frequencies_hz)
    before, after = _cross(across, ahead), _cross(across, onward)
    te *= np.einsum("f...i,...i->f...", wave, across)
    tm *= np.einsum("f...i,...i->f...", wave, before)
    return te[..., None] * across + tm[..., None] * after, onward


def _coefficients(element: Elements, cosine: np.ndarray, frequencies_hz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """TE and TM coefficients (F, ...) of one element at angles of incidence given by their cosine (...): of reflection, or of
    transmission without the phase of `delay_s`."""
    material = Material(
        relative_permittivity=float(element.relative_permittivity),
        conductivity_s_per_m=float(element.conductivity_s_per_m),
    )
    # What a rough surface scatters is missing from what it reflects (docs/physics.md, eq. 9), not from what it transmits.
    thickness_m, specular, delay_s = float(element.thickness_m), float(element.specular), float(element.delay_s)
    found = []
    for frequency in map(float, frequencies_hz):
        if element.through:
            te, tm = transmission(material, thickness_m, cosine, frequency)
            factor = cmath.exp(2j * math.pi * frequency * delay_s)
        else:
            te, tm = reflection(material, thickness_m, cosine, frequency)
            factor = specular
        found.append((factor * te, factor * tm))
    te, tm = np.stack(found, axis=1)
    return te, tm


def _cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Cross products of vectors (..., 3)."""
    return np.stack(cross(*([each[..., axis] for axis in range(3)] for each in (u, v))), axis=-1)
