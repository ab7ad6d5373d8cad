"""`Scene`: what stands still around the target, as triangles of slabs."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from t2d_rt.errors import InputError
from t2d_rt.types.material import Material

LARGEST_M = 100.0
"""Rooms are smaller; what exceeds it was meant in other units."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Surface:
    """Triangles of one material; each is a slab of that thickness, which reflects from both sides."""

    name: str
    vertices: np.ndarray
    """[m], float64 (V, 3)."""
    faces: np.ndarray
    """Integers (F, 3)."""
    material: str | Material
    """An ITU name, whose values follow from the frequency, or values."""
    thickness_m: float

    def __post_init__(self) -> None:
        vertices, faces = np.asarray(self.vertices, float), np.asarray(self.faces)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
            raise InputError(f"vertices of {self.name} must be finite and of shape (vertex, 3), got {vertices.shape}")
        if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces) or not np.issubdtype(faces.dtype, np.integer):
            raise InputError(f"faces of {self.name} must be integers of shape (face, 3), got {faces.shape}")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise InputError(f"faces of {self.name} must name vertices 0..{len(vertices) - 1}, got {faces.max()}")
        if not 0 < self.thickness_m <= 2:
            raise InputError(f"thickness_m of {self.name} must lie in 0..2 m, got {self.thickness_m}")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces.astype(np.int64))


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """Surfaces around a target: walls, doors, furniture."""

    name: str
    surfaces: tuple[Surface, ...]

    def __post_init__(self) -> None:
        twice = [name for name, count in Counter(surface.name for surface in self.surfaces).items() if count > 1]
        if twice:
            raise InputError(
                f"scene {self.name} has more than one object named {twice[0]!r}; give each a name of its own"
            )
        if not self.surfaces:
            raise InputError(
                f"scene {self.name} holds nothing that reflects; add walls or furniture, or take free_space"
            )
        low, high = self.bounds_m
        if (high - low).max() > LARGEST_M:
            raise InputError(
                f"scene {self.name} measures {(high - low).max():.4g} m, more than {LARGEST_M:g} m; give it in metres"
            )

    @property
    def bounds_m(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner of the box around everything [m]."""
        vertices = np.concatenate([surface.vertices for surface in self.surfaces])
        return vertices.min(axis=0), vertices.max(axis=0)
