"""Fields over one-way paths, computed from a path's data alone (docs/physics.md, eq. 23, 24), and the coefficients of the slabs on
them.

Reflection and transmission of slabs after ITU-R P.2040-3, eq. (37), (43) and (44), with e^{+j omega t}: coefficients of the field
for TE and TM waves at angles of incidence given by their cosine (...), complex (...). A perfect conductor has R_TE = -1, R_TM = +1
and transmits nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.geometry.vectors import cross, dot
from t2d_rt.types import Material, OneWayPath, Radar, StaticPath
from t2d_rt.types.material import loss
from t2d_rt.types.paths import Elements, passed, points_in_scene

Polarized = tuple[np.ndarray, np.ndarray]
"""Coefficients of the TE and of the TM wave."""


def reflection(material: Material, thickness_m: float, cosine: np.ndarray, frequency_hz: float) -> Polarized:
    """Reflection coefficients R_TE and R_TM of a slab of that thickness [m] (...), complex (...)."""
    return _reflection(np.asarray(material.permittivity(frequency_hz)), thickness_m, cosine, frequency_hz)


def transmission(material: Material, thickness_m: float, cosine: np.ndarray, frequency_hz: float) -> Polarized:
    """Transmission coefficients T_TE and T_TM of such a slab from face to face, complex (...)."""
    return _transmission(np.asarray(material.permittivity(frequency_hz)), thickness_m, cosine, frequency_hz)


def _reflection(eta: np.ndarray, thickness_m: Any, cosine: np.ndarray, frequency_hz: Any) -> Polarized:
    """The same as `reflection`, for slabs of complex relative permittivities (...)."""
    perfect = np.isinf(eta.real)
    (te, tm), once = _waves(np.where(perfect, 1, eta), thickness_m, cosine, frequency_hz)
    twice = once**2
    rest = 1 - twice
    te, tm = (single * rest / (1 - single**2 * twice) for single in (te, tm))
    return np.where(perfect, -1, te), np.where(perfect, 1, tm)


def _transmission(eta: np.ndarray, thickness_m: Any, cosine: np.ndarray, frequency_hz: Any) -> Polarized:
    """The same as `transmission`, for slabs of complex relative permittivities (...)."""
    perfect = np.isinf(eta.real)
    singles, once = _waves(np.where(perfect, 1, eta), thickness_m, cosine, frequency_hz)
    squares, twice = [single**2 for single in singles], once**2
    te, tm = (np.where(perfect, 0, (1 - square) * once / (1 - square * twice)) for square in squares)
    return te, tm


def _waves(eta: np.ndarray, thickness_m: Any, cosine: np.ndarray, frequency_hz: Any) -> tuple[Polarized, np.ndarray]:
    """Reflection coefficients (...) of a single face for TE and TM, and the propagation factor (...) of the field from face to
    face."""
    cosine = np.asarray(cosine, float)
    root = np.sqrt(eta - (1 - cosine**2))
    # e^{-jq}: an evanescent or lossy wave decays.
    once = np.exp(-2j * math.pi / SPEED_OF_LIGHT * frequency_hz * thickness_m * root)
    return ((cosine - root) / (cosine + root), (eta * cosine - root) / (eta * cosine + root)), once


@dataclass(frozen=True, slots=True)
class SweepNodes:
    """Frequencies over the sweep, the nodes of a Gauss quadrature, at which spectra are evaluated to fit a straight line to them.

    The spectrum of an echo is modelled as such a line, apart from the phase of the delay: the one of least mean square error. This
    holds where the spectrum goes through no more than about one cycle over the sweep, as that of walls does. The value at mid-sweep
    with a slope between two other frequencies would have up to 4 dB more error.
    """

    frequencies_hz: np.ndarray
    """Frequencies [Hz], (F,)."""
    places: np.ndarray
    """Positions of the frequencies within the sweep, -1..1, (F,)."""
    fractions: np.ndarray
    """Weights of the quadrature: the fraction of the sweep that each frequency stands for, (F,)."""
    half_band_hz: float

    @classmethod
    def of(cls, radar: Radar, count: int = 3) -> SweepNodes:
        """`count` nodes over the sampled bandwidth of a radar. Three give the line exactly for spectra that are cubic in the
        frequency; the power of the residual takes four."""
        places, weights = np.polynomial.legendre.leggauss(count)
        half_hz = radar.bandwidth_hz / 2
        return cls(radar.mid_frequency_hz + half_hz * places, places, weights / 2, half_hz)

    def line(self, spectrum: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Value at mid-band and slope [1/Hz], (...) each, of the line fitted to a spectrum (F, ...)."""
        value = np.tensordot(self.fractions, spectrum, 1)
        rise = 3 * np.tensordot(self.fractions * self.places, spectrum, 1)
        return value, rise / self.half_band_hz

    def powers(self, spectrum: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean power over the sweep of a spectrum (F, ...), and that of its residual from the fitted line, (...) each."""
        value, slope = self.line(spectrum)
        rest = spectrum - value - np.multiply.outer(self.places * self.half_band_hz, slope)
        whole, left_out = (np.tensordot(self.fractions, np.abs(part) ** 2, 1) for part in (spectrum, rest))
        return whole, left_out


class PathFields(NamedTuple):
    """Fields that an antenna of gain 1 radiates over P one-way paths to points (...); vector components come first."""

    departure: np.ndarray
    """Unit vectors of the rays where they leave the antenna, in the frame in which the radar stands still, (3, P, ...)."""
    arrival: np.ndarray
    """Unit vectors of the rays where they arrive at the points, in the scene, (3, P, ...)."""
    field: np.ndarray
    """Field vectors in the scene at F frequencies, complex (3, F, P, ...), without the attenuation and phase of the distance and of
    the path's `delay_s`; so they have length 1 in the line of sight."""


def fields_over(
    paths: Sequence[OneWayPath], points: np.ndarray, frequencies_hz: np.ndarray, times_s: np.ndarray | None = None
) -> PathFields:
    """Fields over P paths to points (..., 3) m at frequencies (F,) Hz; paths with the same number of elements are computed at
    once. For a radar that moves the points are (K, ..., 3) at times (K,) s, and all paths must have the same `passing`."""
    passing, shape = paths[0].passing if paths else None, points.shape
    flat = points_in_scene(passing, points, times_s).reshape(-1, 3)
    departure, arrival = np.empty((2, 3, len(paths), len(flat)))
    field = np.empty((3, len(frequencies_hz), len(paths), len(flat)), complex)
    lengths = np.array([len(path.chain) for path in paths])
    for length in np.unique(lengths).tolist():
        rows = np.flatnonzero(lengths == length)
        group = [paths[row] for row in rows.tolist()]
        there = [path.in_scene(times_s, len(shape)) for path in group]
        antenna, polarization = (
            np.stack([_of_points(getattr(path, name), shape).T for path in there], axis=1).reshape(3, len(group), -1)
            for name in ("antenna_m", "polarization")
        )
        # The straight path from the image begins at the antenna once it is folded back at one mirror after the other.
        ahead = np.stack([path.unfolded(flat).T for path in there], axis=1) - antenna
        ahead /= np.sqrt(dot(ahead, ahead))
        departure[:, rows] = ahead
        wave = polarization - dot(polarization, ahead) * ahead
        wave = (wave / np.maximum(np.sqrt(dot(wave, wave)), 1e-12))[:, None]
        elements = Elements.stacked([path.elements for path in group])
        for number in range(length):
            wave, ahead = _after(wave, ahead, elements.taken((slice(None), number)), frequencies_hz)
        arrival[:, rows], field[:, :, rows] = ahead, wave
    if passing is not None:
        ahead = departure.reshape(3, len(paths), len(points), -1).transpose(2, 1, 3, 0)
        departure = passed(passing, times_s).directions(ahead).transpose(3, 1, 0, 2).reshape(arrival.shape)
    return PathFields(*(values.reshape(*values.shape[:-1], *shape[:-1]) for values in (departure, arrival, field)))


def _of_points(vectors: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """A vector (3,) as it is, or vectors that belong to points of that shape (..., 3) as (Q, 3)."""
    return vectors if vectors.ndim == 1 else np.broadcast_to(vectors, shape).reshape(-1, 3)


def field_over(
    path: OneWayPath, points: np.ndarray, frequencies_hz: np.ndarray, times_s: np.ndarray | None = None
) -> np.ndarray:
    """The field vector over one path to points (..., 3) m at frequencies (F,) Hz, complex (F, ..., 3)."""
    return np.moveaxis(fields_over([path], points, frequencies_hz, times_s).field[:, :, 0], 0, -1)


def received(path: StaticPath, frequencies_hz: np.ndarray) -> np.ndarray:
    """Field that antennas of gain 1 with the radar's polarisations receive over a static path at frequencies (F,) Hz, without the
    attenuation and phase of the distance: complex (F,), or (F, T) for a radar that moves."""
    field = field_over(path.path, path.stops_m[-1], frequencies_hz)
    return field @ path.taken if path.taken.ndim == 1 else np.einsum("fti,ti->ft", field, path.taken)


def _after(
    wave: np.ndarray, ahead: np.ndarray, element: Elements, frequencies_hz: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The fields (3, F, P, Q) and ray directions (3, P, Q) after one element (P,) of each path.

    TE is perpendicular to the plane of incidence, TM = TE x direction before and after the element: at normal incidence R_TE =
    -R_TM describe the same reflection, and T_TE = T_TM.
    """
    normal = element.normal.T[..., None]
    cosine = dot(ahead, normal)
    # A slab does not bend the ray: refraction within it is part of the coefficient.
    onward = ahead - np.where(element.through, 0, 2)[:, None] * cosine * normal
    across = np.stack(cross(ahead, normal))
    length = np.sqrt(dot(across, across))
    # At normal incidence TE may be any direction across the ray.
    helper = np.stack(cross(normal, np.where(np.abs(normal[0]) < 0.6, *np.eye(3)[:2, :, None, None])))
    helper /= np.sqrt(dot(helper, helper))
    across = np.where(length > 1e-9, across / np.maximum(length, 1e-12), helper)
    te, tm = _coefficients(element, np.abs(cosine), frequencies_hz)
    before, after = (np.stack(cross(across, direction))[:, None] for direction in (ahead, onward))
    across = across[:, None]
    te *= dot(wave, across)
    tm *= dot(wave, before)
    return te * across + tm * after, onward


def _coefficients(element: Elements, cosine: np.ndarray, frequencies_hz: np.ndarray) -> Polarized:
    """TE and TM coefficients (F, P, Q) of one element (P,) of each path at angles of incidence given by their cosine (P, Q): of
    reflection, or of transmission without the phase that `delay_s` accounts for."""
    frequency_hz = frequencies_hz[:, None, None]
    te, tm = np.empty((2, len(frequencies_hz), *cosine.shape), complex)
    # The diffuse scattering of a rough surface is taken from its reflection (docs/physics.md, eq. 9), not from its transmission.
    passing = np.exp(2j * math.pi * frequencies_hz[:, None] * element.delay_s)
    for coefficients_of, members, factor in (
        (_reflection, ~element.through, np.broadcast_to(element.specular, passing.shape)),
        (_transmission, element.through, passing),
    ):
        if members.any():
            lost = loss(element.conductivity_s_per_m[members], frequencies_hz[:, None])
            eta = (element.relative_permittivity[members] - 1j * lost)[..., None]
            coefficients = coefficients_of(eta, element.thickness_m[members, None], cosine[members], frequency_hz)
            te[:, members], tm[:, members] = (factor[:, members, None] * coefficient for coefficient in coefficients)
    return te, tm
