"""First Fresnel zones along paths, and the rays that fill them: their free fraction is that of the field (docs/physics.md, eq.
27)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

STRAIGHT = 1e-8
"""Squared change of direction of a path below which it goes straight on, as through a slab: what is less is rounding."""


def disc(count: int) -> np.ndarray:
    """Points (count, 2) spread evenly over the unit disc: a Fibonacci lattice, rotated so that upright and level edges meet its
    points one by one."""
    index = np.arange(count)
    radius, angle = np.sqrt((index + 0.5) / count), np.pi * (3 - np.sqrt(5)) * index + 0.56
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def zone(path_m: np.ndarray, wavelength_m: float, pieces: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (part, piece + 1, ..., 3) [m] that cut each straight part of paths (stop, ..., 3) into pieces, the fraction of the
    path before each, and the zone's radius there [m]: sqrt(lambda d1 d2 / (d1 + d2)), both (part, piece + 1, ...).
    """
    parts = np.diff(path_m, axis=0)[:, None]
    cuts = np.sin(np.linspace(0, np.pi / 2, pieces + 1)) ** 2  # closer where the zone opens and closes
    cuts = cuts.astype(path_m.dtype).reshape(-1, *[1] * (path_m.ndim - 1))
    lengths = np.linalg.norm(parts, axis=-1)
    done = np.cumsum(lengths, axis=0)
    total = np.maximum(done[-1:], 1e-12)
    fraction = np.minimum((done - lengths + cuts[..., 0] * lengths) / total, 1)
    return path_m[:-1, None] + cuts * parts, fraction, np.sqrt(wavelength_m * total * fraction * (1 - fraction))


def bundle(path_m: np.ndarray, wavelength_m: float, places: np.ndarray, pieces: int) -> np.ndarray:
    """Where rays that fill the first Fresnel zone along paths (stop, ..., 3) [m] are, (part, piece + 1, ..., rays, 3).

    A ray keeps its place on the zone's cross-section, one of (rays, 2) of the unit disc, at mirrors too.
    """
    parts = np.diff(path_m, axis=0)
    ahead = parts / np.maximum(np.linalg.norm(parts, axis=-1, keepdims=True), 1e-12)
    sides = [_across(ahead[0])]
    for before, after in pairwise(ahead):
        normal = (after - before)[..., None, :]
        size = np.sum(normal**2, axis=-1, keepdims=True)
        factor = np.where(size > STRAIGHT, 2 / np.maximum(size, STRAIGHT), 0)
        sides.append(sides[-1] - factor * np.sum(sides[-1] * normal, axis=-1, keepdims=True) * normal)
    middle, _, radius = zone(path_m, wavelength_m, pieces)
    return middle[..., None, :] + radius[..., None, None] * (places @ np.stack(sides))[:, None]


def _across(ahead: np.ndarray) -> np.ndarray:
    """Two unit vectors (..., 2, 3) across directions (..., 3), the first of them level."""
    steep = np.abs(ahead[..., 2:]) > 0.99
    level = np.cross(ahead, np.where(steep, *np.eye(3, dtype=ahead.dtype)[[0, 2]]))
    level /= np.linalg.norm(level, axis=-1, keepdims=True)
    return np.stack([level, np.cross(level, ahead)], axis=-2)
