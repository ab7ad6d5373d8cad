"""Closed forms and series that targets are held against; none of it uses the package."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import h2vp, hankel2, j1, jv, jvp, spherical_jn, spherical_yn


def mie(ka: float) -> float:
    """sigma / (pi a^2) of a perfectly conducting sphere: |sum_n (-1)^n (2n+1)(a_n - b_n)|^2 / (ka)^2 (docs/physics.md, eq. 6)."""
    n = np.arange(1, math.ceil(ka + 4 * ka ** (1 / 3) + 10))
    j, y = spherical_jn(n, ka), spherical_yn(n, ka)
    # Riccati-Bessel functions psi = x j and xi = x (j - i y), and their derivatives.
    psi, xi = ka * j, ka * (j - 1j * y)
    psi_prime = j + ka * spherical_jn(n, ka, derivative=True)
    xi_prime = (j - 1j * y) + ka * (spherical_jn(n, ka, derivative=True) - 1j * spherical_yn(n, ka, derivative=True))
    terms = (-1.0) ** n * (2 * n + 1) * (psi_prime / xi_prime - psi / xi)
    return float(abs(terms.sum()) ** 2 / ka**2)


def sphere_optics(ka: np.ndarray | float) -> np.ndarray:
    """sigma / (pi a^2) of the sphere by physical optics, exactly (eq. 6)."""
    ka = np.asarray(ka, float)
    return np.asarray(1 - np.sin(2 * ka) / ka + (np.sin(ka) / ka) ** 2)


def plate_rcs(width_m: float, height_m: float, angle_rad: np.ndarray, wavelength_m: float) -> np.ndarray:
    """Physical optics of a plate far away [m^2], `angle_rad` off its normal in the plane of its width: 4 pi A^2/lambda^2 at 0."""
    u = 2 * math.pi / wavelength_m * width_m * np.sin(angle_rad)
    lobes = np.cos(angle_rad) * np.sinc(u / math.pi)
    return np.asarray(4 * math.pi * (width_m * height_m / wavelength_m) ** 2 * lobes**2)


def cylinder_rcs(radius_m: float, length_m: float, angle_rad: np.ndarray, wavelength_m: float) -> np.ndarray:
    """Physical optics of a closed cylinder far away, `angle_rad` off broadside [m^2]: side and the end that is lit."""
    k = 2 * math.pi / wavelength_m
    across, along = 2 * k * np.cos(angle_rad), k * length_m * np.sin(angle_rad)
    side = radius_m * length_m * np.cos(angle_rad) * np.sinc(along / math.pi) * np.conj(_half_ring(across * radius_m))
    u = across * radius_m
    disc = np.where(u < 1e-9, 1.0, 2 * j1(u) / np.where(u < 1e-9, 1.0, u))
    end = math.pi * radius_m**2 * np.sin(angle_rad) * disc * np.exp(-1j * along)
    return np.asarray(4 * math.pi / wavelength_m**2 * np.abs(side + end) ** 2)


def _half_ring(x: np.ndarray) -> np.ndarray:
    """Integral of cos(phi) exp(j x cos(phi)) over -pi/2..pi/2."""
    node, weight = np.polynomial.legendre.leggauss(2000)
    cos = np.cos(node * math.pi / 2)
    return np.asarray(math.pi / 2 * (np.exp(1j * np.multiply.outer(x, cos)) @ (weight * cos)))


def cylinder_width(ka: float, *, along: bool) -> float:
    """Exact back-scattering width over its limit pi a of an endless conductor, the field along or across its axis.

    Bowman, Senior, Uslenghi, "Electromagnetic and Acoustic Scattering by Simple Shapes", section 2.2. A piece of length L,
    broadside and long, has sigma = (2 L^2/lambda) times the width.
    """
    n = np.arange(math.ceil(ka + 4 * ka ** (1 / 3) + 10))
    weight = np.where(n == 0, 1.0, 2.0) * (-1.0) ** n
    ratio = jv(n, ka) / hankel2(n, ka) if along else jvp(n, ka) / h2vp(n, ka)
    return float(4 * abs(np.sum(weight * ratio)) ** 2 / (math.pi * ka))


def cylinder_width_optics(ka: np.ndarray) -> np.ndarray:
    """The same by physical optics: |half ring|^2 ka / pi, the same for both polarisations."""
    return np.asarray(ka / math.pi * np.abs(_half_ring(2 * np.asarray(ka, float))) ** 2)


def spheroid_tip_rcs(radius_m: float, half_length_m: float, wavelength_m: float) -> float:
    """Physical optics of a spheroid seen along its long axis, far away [m^2]: that of a sphere's (eq. 6) with k c for k a.

    Of the area pi a^2 (1 - z^2/c^2) that is cut off at height z, exp(2jkz) is integrated as over a sphere.
    """
    kc = 2 * math.pi / wavelength_m * half_length_m
    return float(math.pi * radius_m**4 / half_length_m**2 * sphere_optics(kc))


def summed_optics(points: np.ndarray, areas: np.ndarray, radar_m: np.ndarray, wavelength_m: float) -> float:
    """sigma / R^4 [1/m^2] by physical optics of cells at points (N, 3) m of vector areas (N, 3) m^2, as fine as need be."""
    sight = radar_m - points
    distance = np.linalg.norm(sight, axis=1)
    facing = np.maximum(np.einsum("ni,ni->n", areas, sight) / distance, 0) / distance**2
    cycles = 2 * distance / wavelength_m
    return float(4 * math.pi / wavelength_m**2 * abs(np.sum(facing * np.exp(2j * math.pi * (cycles % 1)))) ** 2)


def dihedral_rcs(
    edge_m: float, angle_rad: np.ndarray | float, wavelength_m: float, height_m: float | None = None
) -> np.ndarray:
    """Two bounces of a right-angled corner of two plates, `angle_rad` off its bisector in the plane across the fold: 4 pi A^2 /
    lambda^2, A the aperture that rays leave by the way they came (Knott et al., Radar Cross Section, 2nd ed., section 6.5)."""
    aperture = 2 * edge_m * (edge_m if height_m is None else height_m) * np.sin(math.pi / 4 - np.abs(angle_rad))
    return np.asarray(4 * math.pi * aperture**2 / wavelength_m**2)


def trihedral_area(edge_m: float, towards: np.ndarray, *, triangular: bool = False, count: int = 300) -> float:
    """Aperture [m^2] that rays leave by the way they came after three bounces of a corner of three plates along the positive axes,
    seen in the direction `towards` (3,): count^2 rays to each plate, by coordinates alone (eq. 4 pi A^2 / lambda^2 as above)."""
    grid = (np.arange(count) + 0.5) / count * edge_m
    total = 0.0
    for first in range(3):
        point, direction = np.zeros((count**2, 3)), np.tile(-np.asarray(towards, float), (count**2, 1))
        point[:, (first + 1) % 3], point[:, (first + 2) % 3] = (each.ravel() for each in np.meshgrid(grid, grid))
        met, rows = np.zeros((count**2, 3), bool), np.arange(count**2)
        met[:, first] = True
        direction[:, first] *= -1
        good = point.sum(axis=1) <= edge_m if triangular else np.ones(count**2, bool)
        for _ in range(2):
            distance = np.where(met, np.inf, -point / np.minimum(direction, -1e-12))
            plate = distance.argmin(axis=1)
            point = point + distance[rows, plate][:, None] * direction
            others = np.arange(3) != plate[:, None]
            good &= (point.sum(axis=1) if triangular else np.where(others, point, 0).max(axis=1)) <= edge_m
            direction[rows, plate] *= -1
            met[rows, plate] = True
        total += good.mean() * edge_m**2 * towards[first]
    return float(total)
