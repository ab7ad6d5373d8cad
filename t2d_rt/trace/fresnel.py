"""First Fresnel zones along ways, and the rays that fill them: their free share is that of the field (docs/physics.md, eq. 27)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

STRAIGHT = 1e-8
"""Squared turns of a way below which it goes straight on, as through a slab: what is less is rounding."""


def disc(count: int) -> np.ndarray:
    """Points (count, 2) spread evenly over the unit disc: a Fibonacci lattice, turned so that upright and level edges meet its
    points one by one."""
    index = np.arange(count)
    radius, turn = np.sqrt((index + 0.5) / count), np.pi * (3 - np.sqrt(5)) * index + 0.56
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])


def zone(way_m: np.ndarray, wavelength_m: float, pieces: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (part, piece + 1, ..., 3) [m] that cut each straight part of ways (stop, ..., 3) into pieces, the share of the way
    before each, and the zone's radius there [m]: sqrt(lambda d1 d2 / (d1 + d2)), both (part, piece + 1, ...).
    """
    parts = np.diff(way_m, axis=0)[:, None]
    cuts = np.sin(np.linspace(0, np.pi / 2, pieces + 1)) ** 2  # closer where the zone opens and closes
    cuts = cuts.astype(way_m.dtype).reshape(-1, *[1] * (way_m.ndim - 1))
    lengths = np.linalg.norm(parts, axis=-1)
    done = np.cumsum(lengths, axis=0)
    total = np.maximum(done[-1:], 1e-12)
    share = np.minimum((done - lengths + cuts[..., 0] * lengths) / total, 1)
    return way_m[:-1, None] + cuts * parts, share, np.sqrt(wavelength_m * total * share * (1 - share))


def bundle(way_m: np.ndarray, wavelength_m: float, places: np.ndarray, pieces: int) -> np.ndarray:
    """Where rays that fill the first Fresnel zone along ways (stop, ..., 3) [m] are, (part, piece + 1, ..., rays, 3).

    A ray keeps its place on the zone's cross-section, one of (rays, 2) of the unit disc, at mirrors too.
    """
    parts = np.diff(way_m, axis=0)
    ahead = parts / np.maximum(np.linalg.norm(parts, axis=-1, keepdims=True), 1e-12)
    sides = [_across(ahead[0])]
    for before, after in pairwise(ahead):
        normal = (after - before)[..., None, :]
        size = np.sum(normal**2, axis=-1, keepdims=True)
        turn = np.where(size > STRAIGHT, 2 / np.maximum(size, STRAIGHT), 0)
        sides.append(sides[-1] - turn * np.sum(sides[-1] * normal, axis=-1, keepdims=True) * normal)
    middle, _, radius = zone(way_m, wavelength_m, pieces)
    return middle[..., None, :] + radius[..., None, None] * (places @ np.stack(sides))[:, None]


def _across(ahead: np.ndarray) -> np.ndarray:
    """Two unit vectors (..., 2, 3) across directions (..., 3), the first of them level."""
    steep = np.abs(ahead[..., 2:]) > 0.99
    level = np.cross(ahead, np.where(steep, *np.eye(3, dtype=ahead.dtype)[[0, 2]]))
    level /= np.linalg.norm(level, axis=-1, keepdims=True)
    return np.stack([level, np.cross(level, ahead)], axis=-2)
