"""`Scene`: the static surroundings of the targets, as triangles of slabs."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.core.checks import array, listed, positive, shown
from t2d_rt.core.errors import InputError, html_table
from t2d_rt.geometry.vectors import checked_faces, edge_cross
from t2d_rt.types.material import Material
from t2d_rt.types.splines import set_fields

LARGEST_M = 3_000.0
"""Greatest extent of a scene [m]; larger ones are taken for a mistake of units, as even town quarters are smaller."""
MAX_SURFACES = 20_000
MAX_TRIANGLES = 500_000
MAX_VERTICES = 500_000
ROOM_M, ROOM_SURFACES, ROOM_TRIANGLES, ROOM_PLANES = 100.0, 2_000, 100_000, 10_000
"""Limits up to which rays are traced in the whole scene, ten times those of a furnished room: edges and mirrors take time and
memory with each plane."""
NO_AREA_M2 = 1e-12
"""A triangle of less than half this area is a line or a point; it reflects nothing and is ignored where there are other
triangles."""
MAX_NAME = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Surface:
    """Triangles of one material. Each is a slab of that thickness, which reflects from both sides."""

    name: str
    vertices: np.ndarray
    """Vertices [m], float64 (V, 3)."""
    faces: np.ndarray
    """Indices of the vertices of each triangle, (F, 3)."""
    material: str | Material
    """An ITU name, whose values depend on the frequency, or a `Material` with values of its own."""
    thickness_m: float

    def __post_init__(self) -> None:
        _check_name(self.name, "surface")
        # copies, so that later changes of the user's arrays have no effect
        vertices = array(f"vertices of {self.name}", self.vertices, ("vertex", 3), limit=np.inf).copy()
        faces = checked_faces(f"faces of {self.name}", self.faces, len(vertices)).astype(np.int64)
        if len(faces) > MAX_TRIANGLES or len(vertices) > MAX_VERTICES:
            raise InputError(
                f"{self.name} has {len(faces)} triangles and {len(vertices)} vertices, more than {MAX_TRIANGLES} and "
                f"{MAX_VERTICES}; give it fewer vertices"
            )
        if not (_twice_area(vertices, faces) > NO_AREA_M2).any():
            raise InputError(
                f"{self.name} has no area: each of its triangles is a line or a point; check its vertices and scale"
            )
        if not isinstance(self.material, str | Material):
            raise InputError(f"material of {self.name} must be an ITU name or a Material, got {shown(self.material)}")
        positive(f"thickness_m of {self.name}", self.thickness_m, 2, unit="m")
        set_fields(self, vertices=vertices, faces=faces)


def _check_name(name: object, noun: str) -> None:
    """Refuses a name that could not stand in sentences, results and file names."""
    if not isinstance(name, str) or not 0 < len(name) <= MAX_NAME or not name.isprintable():
        raise InputError(
            f"the name of a {noun} must be a text of 1..{MAX_NAME} printable characters, got {shown(name)}; give another"
        )


def _twice_area(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Twice the area of each triangle [m^2]."""
    with np.errstate(over="ignore", invalid="ignore"):  # a scene so large that this overflows is refused later
        return np.asarray(np.linalg.norm(edge_cross(vertices[faces]), axis=1))


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """The static surroundings of the targets: walls, doors, furniture."""

    name: str
    surfaces: tuple[Surface, ...]
    report: str = ""
    """What the reader of meshes found and assumed, for people."""

    def __post_init__(self) -> None:
        _check_name(self.name, "scene")
        surfaces = listed(f"surfaces of scene {self.name}", self.surfaces, Surface, "Surface objects")
        set_fields(self, surfaces=surfaces)
        twice = [name for name, count in Counter(surface.name for surface in self.surfaces).items() if count > 1]
        if twice:
            raise InputError(
                f"scene {self.name} has more than one object named {twice[0]!r}; give each a name of its own"
            )
        if not self.surfaces:
            raise InputError(
                f"scene {self.name} holds nothing that reflects; add walls or furniture, or take free_space"
            )
        if len(self.surfaces) > MAX_SURFACES or self._triangles > MAX_TRIANGLES:
            raise InputError(
                f"scene {self.name} has {len(self.surfaces)} surfaces and {self._triangles} triangles, more than {MAX_SURFACES} "
                f"and {MAX_TRIANGLES}; cut out what lies around the radar"
            )
        low, high = self.bounds_m
        if not (high - low).max() <= LARGEST_M:
            raise InputError(
                f"scene {self.name} measures {(high - low).max():.4g} m, more than {LARGEST_M:g} m; give it in metres, or cut out "
                "what lies around the radar"
            )

    def __repr__(self) -> str:
        return f"Scene({self.name!r}, {len(self.surfaces)} surfaces, {self._triangles} triangles, {self._extent})"

    def _repr_html_(self) -> str:
        low, high = (", ".join(f"{x:.4g}" for x in corner) for corner in self.bounds_m)
        names = (
            surface.material if isinstance(surface.material, str) else surface.material.name
            for surface in self.surfaces
        )
        materials, listed = Counter(names), ", ".join(surface.name for surface in self.surfaces)
        rows = [
            ("size", self._extent),
            ("corners", f"({low}) to ({high}) m"),
            ("surfaces", f"{len(self.surfaces)} of {self._triangles} triangles: {listed}"),
            ("materials", ", ".join(f"{name} ({count})" for name, count in materials.items())),
        ]
        return html_table(f"Scene {self.name}", rows)

    @property
    def _triangles(self) -> int:
        return sum(len(surface.faces) for surface in self.surfaces)

    @property
    def _extent(self) -> str:
        low, high = self.bounds_m
        return " x ".join(f"{length:.3g}" for length in high - low) + " m"

    @property
    def content(self) -> tuple[object, ...]:
        """All geometry and materials, hashable: equal for scenes that differ in name only."""
        return tuple(
            (surface.name, surface.vertices.tobytes(), surface.faces.tobytes(), surface.material, surface.thickness_m)
            for surface in self.surfaces
        )

    @property
    def is_large(self) -> bool:
        """Whether it exceeds the limits up to which rays are traced in the whole scene; beyond, only what is near the radar is
        used."""
        low, high = self.bounds_m
        many = len(self.surfaces) > ROOM_SURFACES or self._triangles > ROOM_TRIANGLES
        return many or bool((high - low).max() > ROOM_M)

    def near(self, place_m: np.ndarray, reach_m: float) -> Scene | None:
        """The triangles whose bounding boxes come within `reach_m` of a place (3,) m; None where there are none."""
        near_surfaces = []
        for surface in self.surfaces:
            corners = surface.vertices[surface.faces]
            outside = np.maximum(corners.min(axis=1) - place_m, place_m - corners.max(axis=1)).clip(0)
            is_near = np.linalg.norm(outside, axis=1) <= reach_m
            if (_twice_area(surface.vertices, surface.faces[is_near]) > NO_AREA_M2).any():
                used, faces = np.unique(surface.faces[is_near], return_inverse=True)
                near_surfaces.append(replace(surface, vertices=surface.vertices[used], faces=faces.reshape(-1, 3)))
        return Scene(name=self.name, surfaces=tuple(near_surfaces)) if near_surfaces else None

    @property
    def bounds_m(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner of the bounding box [m], (3,) each."""
        vertices = np.concatenate([surface.vertices for surface in self.surfaces])
        return vertices.min(axis=0), vertices.max(axis=0)
