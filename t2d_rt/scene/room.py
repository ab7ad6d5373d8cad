"""`Room`: a rectangular room from its size, materials, doors, windows and furniture."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.resources import listing, resource
from t2d_rt.geometry.mesh_files import read_mesh
from t2d_rt.geometry.scan import scene_from_mesh
from t2d_rt.scene.movers.solids import about_z
from t2d_rt.types import Scene, Surface
from t2d_rt.types.fields import Coordinate, Fields, Number
from t2d_rt.types.material import THICKNESS_M, Material

Side = Literal["+x", "-x", "+y", "-y"]
SIDES: tuple[Side, ...] = ("+x", "-x", "+y", "-y")
Length = Annotated[Number, Field(gt=0, le=50)]
_FREE_M = 1e-6
MAX_OPENINGS, MAX_PIECES = 50, 200


class Slab(Fields):
    """A material and its thickness."""

    noun: ClassVar[str] = "slab"

    material: str
    """An ITU name: "concrete", "plasterboard", "wood", "glass", "metal", ..."""
    thickness_m: Annotated[Number, Field(gt=0, le=2)]


class Opening(Fields):
    """A door or window: a rectangle that is cut from a wall and filled with a slab or left open."""

    noun: ClassVar[str] = "opening"

    name: str
    wall: Side
    """The wall that has the opening, by its direction from the middle of the room."""
    along_m: Coordinate = 0.0
    """Offset of its middle from the middle of the wall [m]: along +y in the walls "+x" and "-x", else along +x."""
    width_m: Length
    height_m: Length
    sill_m: Annotated[Number, Field(ge=0, le=50)] = 0.0
    """Height of its lower edge over the floor [m]."""
    slab: Slab | None = None
    """The slab that fills it; None leaves it open."""


class Piece(Fields):
    """A piece of furniture at its place."""

    noun: ClassVar[str] = "piece of furniture"

    kind: str
    """One of `furniture_kinds()`."""
    name: str | None = None
    """Name of the piece in messages and results; the kind by default."""
    x_m: Coordinate
    y_m: Coordinate
    z_m: Coordinate = 0.0
    """Height of the floor under it [m]; `x_m` and `y_m` are the position of its middle."""
    heading_deg: Number = 0.0
    """Direction that it faces: 0 is +x, 90 is +y."""


class Room(Fields):
    """A rectangular room over the floor z = 0, furnished.

    >>> room = Room(size_m=(4, 3, 2.5), furniture=({"kind": "cupboard", "x_m": 1, "y_m": 1},))
    >>> [surface.name for surface in room.scene().surfaces][-1]
    'cupboard'
    """

    noun: ClassVar[str] = "room"

    name: str = "room"
    """Name of the room in messages and results."""
    size_m: tuple[Length, Length, Length]
    """Lengths along x, y and z [m]."""
    corner_m: tuple[Coordinate, Coordinate] | None = None
    """x and y of the corner with the least coordinates [m]; by default x = -0.5, so that a radar at x = 0 is 0.5 m inside, and y =
    -width/2."""
    walls: Slab = Slab(material="plasterboard", thickness_m=0.0125)
    floor: Slab = Slab(material="concrete", thickness_m=0.2)
    ceiling: Slab = Slab(material="concrete", thickness_m=0.2)
    openings: tuple[Opening, ...] = ()
    furniture: tuple[Piece, ...] = ()

    @classmethod
    def from_mesh(
        cls,
        path: str | Path,
        *,
        materials: Mapping[str, str | Material] | None = None,
        units: float | str | None = None,
        up: str | None = None,
    ) -> Scene:
        """The scene of a mesh (.obj, .ply, .glb), a scan or a drawing of a room, as `load_scene` reads it; options as there."""
        return scene_from_mesh(path, materials=materials, units=units, up=up)

    @model_validator(mode="after")
    def _check_numbers(self) -> Self:
        if len(self.openings) > MAX_OPENINGS or len(self.furniture) > MAX_PIECES:
            raise InputError(
                f"room {shown(self.name)} has {len(self.openings)} openings and {len(self.furniture)} pieces of furniture, more "
                f"than {MAX_OPENINGS} and {MAX_PIECES}; leave some out"
            )
        return self

    def scene(self) -> Scene:
        """The surfaces of the room as a scene: floor, ceiling, walls with their openings, furniture."""
        low, high = self._box()
        corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
        surfaces = [
            _plates("floor", [[(*corner, low[2]) for corner in corners]], self.floor),
            _plates("ceiling", [[(*corner, high[2]) for corner in corners[::-1]]], self.ceiling),
        ]
        for side in SIDES:
            surfaces += self._wall(side, low, high)
        for piece in self.furniture:
            surfaces += self._placed(piece, low, high)
        return Scene(name=self.name, surfaces=tuple(surfaces))

    def _box(self) -> tuple[np.ndarray, np.ndarray]:
        corner = (-0.5, -self.size_m[1] / 2) if self.corner_m is None else self.corner_m
        low = np.array([*corner, 0.0])
        return low, low + self.size_m

    def _wall(self, side: Side, low: np.ndarray, high: np.ndarray) -> list[Surface]:
        """A wall divided into rectangles around its openings, and the slabs that fill these. Cuts along the edges of openings run
        over the whole wall, so that rectangles always share whole edges."""
        axis = "xy".index(side[1])
        place = (high if side[0] == "+" else low)[axis]
        along = 1 - axis
        middle = (low[along] + high[along]) / 2
        holes = [opening for opening in self.openings if opening.wall == side]
        spans = [
            (middle + o.along_m - o.width_m / 2, middle + o.along_m + o.width_m / 2, o.sill_m, o.sill_m + o.height_m)
            for o in holes
        ]
        self._check_openings(side, holes, spans, low[along], high[along], high[2])

        cuts = sorted({low[along], high[along], *(edge for span in spans for edge in span[:2])})
        levels = sorted({0.0, high[2], *(edge for span in spans for edge in span[2:])})
        # The wall is cut along all edges of its openings; rectangles within an opening are left out.
        plates = [
            _upright(axis, place, (s0, s1, z0, z1))
            for s0, s1 in pairwise(cuts)
            for z0, z1 in pairwise(levels)
            if not any(
                a <= s0 + _FREE_M and s1 <= b + _FREE_M and c <= z0 + _FREE_M and z1 <= d + _FREE_M
                for a, b, c, d in spans
            )
        ]
        # Counter-clockwise as seen from inside.
        flipped = side in ("+x", "-y")
        surfaces = [_plates(f"wall{side}", plates, self.walls, flipped)]
        for opening, span in zip(holes, spans, strict=True):
            if opening.slab is not None:
                surfaces.append(_plates(opening.name, [_upright(axis, place, span)], opening.slab, flipped))
        return surfaces

    def _check_openings(
        self, side: Side, holes: list[Opening], spans: Sequence[tuple[float, ...]], low: float, high: float, top: float
    ) -> None:
        """Refuses openings that overlap, or that reach beyond their wall, which extends from `low` to `high` and up to `top`."""
        for number, (opening, (a, b, c, d)) in enumerate(zip(holes, spans, strict=True)):
            if a < low - _FREE_M or b > high + _FREE_M or c < 0 or d > top + _FREE_M:
                raise InputError(
                    f"{opening.name} reaches from {a:.4g} to {b:.4g} m and up to {d:.4g} m in wall {side}, which is {low:.4g} to "
                    f"{high:.4g} m and {top:.4g} m high; make it smaller or move it"
                )
            for other, (e, f, g, h) in zip(holes[:number], spans[:number], strict=True):
                if a < f and e < b and c < h and g < d:
                    raise InputError(f"{opening.name} and {other.name} overlap in wall {side}; move one of them")

    def _placed(self, piece: Piece, low: np.ndarray, high: np.ndarray) -> list[Surface]:
        """The surfaces of a piece of furniture at its place, one for each material."""
        name = piece.name or piece.kind
        rotation, parts = about_z(math.radians(piece.heading_deg)), furniture(piece.kind)
        surfaces = []
        for material, (vertices, faces) in parts.items():
            there = vertices @ rotation.T + [piece.x_m, piece.y_m, piece.z_m]
            if (there < low - _FREE_M).any() or (there > high + _FREE_M).any():
                raise InputError(
                    f"{name} at ({piece.x_m:g}, {piece.y_m:g}) m sticks out of room {self.name}, which reaches from "
                    f"({low[0]:g}, {low[1]:g}) to ({high[0]:g}, {high[1]:g}) m and {high[2]:g} m high; move it inside"
                )
            part = name if len(parts) == 1 else f"{name} {material}"
            surfaces.append(
                Surface(name=part, vertices=there, faces=faces, material=material, thickness_m=THICKNESS_M[material])
            )
        return surfaces


def furniture_kinds() -> list[str]:
    """Names of the furniture that is shipped, sorted."""
    return sorted({name.split(".")[0] for name in listing("meshes/furniture", ".ply")})


def furniture(kind: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Vertices (V, 3) m and faces (F, 3) of each material of a piece, which stands on z = 0 and faces +x."""
    if kind not in furniture_kinds():
        raise InputError(f"unknown furniture {shown(kind)}; choose one of {', '.join(furniture_kinds())}")
    parts = {}
    for name in listing("meshes/furniture", ".ply"):
        if name.split(".")[0] == kind:
            vertices, faces = read_mesh(resource("meshes/furniture", name))
            parts[name.split(".")[1]] = vertices.round(9), faces
    return parts


def _upright(axis: int, place: float, span: tuple[float, ...]) -> list[tuple[float, float, float]]:
    """Corners of a rectangle in the plane where x (axis 0) or y (axis 1) is `place`; `span`: from and to along the other axis, then
    along z."""
    first, last, low, high = span
    corners = [(first, low), (last, low), (last, high), (first, high)]
    return [(place, along, z) if axis == 0 else (along, place, z) for along, z in corners]


def _plates(name: str, plates: list[list[tuple[float, float, float]]], slab: Slab, flipped: bool = False) -> Surface:
    """A surface of rectangles, given by four corners each and divided into two triangles; `flipped` reverses their orientation."""
    vertices = np.array(plates, float).reshape(-1, 3)
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(len(plates))])
    return Surface(
        name=name,
        vertices=vertices,
        faces=faces[:, ::-1] if flipped else faces,
        material=slab.material,
        thickness_m=slab.thickness_m,
    )
