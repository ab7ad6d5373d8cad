"""Makes a scene of a mesh file (.obj, .ply, .glb): plane parts reflect, other parts block and do not reflect.

The parts of a CAD drawing are used as they are, triangle by triangle. In a scan no triangles are exactly coplanar: planes are
fitted and divided into rectangles, and the rest becomes cubes that absorb.
"""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from t2d_rt.core.checks import choice, file_path, names_advice, numbered, positive, shown
from t2d_rt.core.errors import InputError, printable, warn
from t2d_rt.core.files import read_bytes
from t2d_rt.geometry.mesh_files import MAX_MESH_BYTES, obj_labels, parsed_mesh
from t2d_rt.geometry.planes import plane_of, planes_of_scan, rectangles, voxels
from t2d_rt.geometry.vectors import edge_cross
from t2d_rt.types.material import ABSORBER, THICKNESS_M, Material, known_itu, materials_by_name
from t2d_rt.types.scene import MAX_NAME, MAX_SURFACES, NO_AREA_M2, Scene, Surface

MESHES = (".obj", ".ply", ".glb")
UNITS_M = {"m": 1.0, "km": 1e3, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "ft": 0.3048}
HEIGHT_M, ACROSS_M = (1.8, 12.0), (1.0, 100.0)
"""Least and greatest height of a room from floor to ceiling, and its least and greatest width [m]."""
LOW_M = 4.5
"""Height [m] up to which an axis is preferred as the upward one, for a file that does not specify it."""
SMALL_M2, MOST_SMALL = 0.05, 500
"""Plane parts below `SMALL_M2` [m^2] count as small; more than `MOST_SMALL` of them make a mesh a scan."""
LEVEL = 0.94
"""Least cosine of the inclination of a floor: 20 degrees."""
LEAST_LEAN_DEG = 0.02
FLAT, UPRIGHT, WALL_M = 0.9, 0.2, 1.5
"""Least vertical component of the normal of a floor or ceiling, greatest one of a wall, and least height of a wall [m]."""
NEAR_M = 0.2
"""Distance from the lowest and the highest point within which floor and ceiling are searched [m]."""
FLOOR_PART = 0.2
"""Least area of the plane taken for the floor, as a fraction of the area that the mesh covers in plan view."""
ABSORBER_M = 0.1
"""Thickness given to parts that are not plane [m]."""

Slab = tuple[str | Material, float]
Given = tuple[str | Material, float | None]
"""A material and its thickness [m]; a thickness of None is that of what it replaces."""
ROLES: Mapping[str, Slab] = {
    "floor": ("concrete", 0.2), "ceiling": ("concrete", 0.2), "wall": ("plasterboard", 0.0125), "thing": ("chipboard", 0.018),
}  # fmt: skip
WORDS: Mapping[str, Slab] = {"door": ("wood", 0.04), "window": ("glass", 0.006)} | {
    name: (name, thickness_m) for name, thickness_m in THICKNESS_M.items()
}
"""Slabs for words that occur in the names of objects and of their materials."""


@dataclass(frozen=True, slots=True)
class _Mesh:
    """All triangles of a file, and the part to which each belongs."""

    triangles: np.ndarray
    """Triangles (F, 3, 3)."""
    part: np.ndarray
    """Index of the part of each triangle, (F,)."""
    names: list[tuple[str, str]]
    """Name of each part, and of its material in the file; empty where the file has none."""


def scene_from_mesh(
    path: str | Path,
    *,
    materials: Mapping[str, str | Material] | None = None,
    units: float | str | None = None,
    up: str | None = None,
) -> Scene:
    """Makes a scene of a mesh, with z up and its floor at z = 0; `Scene.report` says what was found and assumed.

    materials: materials by the name of an object, of its material in the file, or by "floor", "ceiling", "wall" and "thing": an ITU
        name, such a name and a thickness as in "wood 0.04" [m], or a `Material`, which keeps the thickness of what it replaces. All
        others get the material that their name suggests ("door", "window", "glass" ...), or else the usual one for their role.
    units: length of the file's unit [m], or m, km, cm, mm, inch or ft; metres by default.
    up: upward axis, "y" or "z"; by default y for a .glb, else the axis along which the mesh is as high as a room.
    """
    path = file_path("mesh", path)
    slabs = {name: slab_of(material) for name, material in materials_by_name(materials).items()}
    if path.suffix.lower() not in MESHES:
        raise InputError(f"cannot read {shown(str(path))} as a room: meshes come as {', '.join(MESHES)}")
    unit_m = UNITS_M[choice("units", units, tuple(UNITS_M))] if isinstance(units, str) else 1.0
    if units is not None and not isinstance(units, str):
        unit_m = positive("units", units, hint="metres per unit")
    mesh = _read(path)
    triangles = mesh.triangles * unit_m
    area = np.linalg.norm(edge_cross(triangles), axis=1)
    usable = area > NO_AREA_M2
    double = np.count_nonzero(usable) - np.count_nonzero(usable := usable & _firsts(triangles))
    axis = _upward(triangles[usable], path, unit_m, up)
    triangles = triangles[usable] @ {"y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), "z": np.eye(3)}[axis].T
    mesh = _Mesh(triangles, mesh.part[usable], mesh.names)
    conventions = f"up {axis}, 1 unit = {unit_m:g} m" + (f"; {double} triangles were there twice" if double else "")
    scene = _scene(mesh, path, slabs, conventions)
    logging.getLogger("t2d_rt.scene").info(scene.report)
    return scene


def _firsts(triangles: np.ndarray) -> np.ndarray:
    """Which triangles (F, 3, 3) have other corners than all triangles before; drawings often contain both sides of a face."""
    corner = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)[1].reshape(-1, 3)
    is_first = np.zeros(len(triangles), bool)
    is_first[np.unique(np.sort(corner, axis=1), axis=0, return_index=True)[1]] = True
    return is_first


def _read(path: Path) -> _Mesh:
    data = read_bytes(path, limit=MAX_MESH_BYTES, noun="mesh file")
    if path.suffix.lower() == ".glb":
        return _glb(data, path)
    vertices, faces = parsed_mesh(data, path)
    if path.suffix.lower() == ".ply":
        return _Mesh(vertices[faces], np.zeros(len(faces), int), [("", "")])
    labels = obj_labels(data)
    names = list(dict.fromkeys(labels))
    number = {name: place for place, name in enumerate(names)}
    return _Mesh(vertices[faces], np.array([number[label] for label in labels]), names)


def _glb(data: bytes, path: Path) -> _Mesh:
    import trimesh

    try:
        scene = trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False)
        meshes = [
            (str(node), geometry, scene.graph.get(node)[0])
            for node in scene.graph.nodes_geometry
            if isinstance(geometry := scene.geometry[scene.graph.get(node)[1]], trimesh.Trimesh)
        ]
        parts = [trimesh.transform_points(mesh.vertices, matrix)[mesh.faces] for _, mesh, matrix in meshes]
        named = [
            (node, str(getattr(getattr(mesh.visual, "material", None), "name", "") or "")) for node, mesh, _ in meshes
        ]
    except Exception:  # the decoder may raise anything for a damaged file
        raise InputError(f"mesh {path} is not a .glb file with triangles, or damaged; export it again") from None
    if not parts or not np.isfinite(np.concatenate(parts)).all():
        raise InputError(f"mesh {path} holds no triangles, or such that are not finite; export it again")
    return _Mesh(np.concatenate(parts), np.repeat(np.arange(len(parts)), list(map(len, parts))), named)


def _upward(triangles: np.ndarray, path: Path, unit_m: float, up: str | None) -> str:
    """Finds the upward axis; refuses a mesh that is no room in these units."""
    if not len(triangles):
        raise InputError(f"mesh {path} has no triangle with an area; export it again")
    extent = np.ptp(triangles.reshape(-1, 3), axis=0)
    high = {"y": float(extent[1]), "z": float(extent[2])}
    fitting = [axis for axis in high if HEIGHT_M[0] <= high[axis] <= HEIGHT_M[1]]
    wide = [axis for axis in fitting if axis == "z" or high["z"] >= ACROSS_M[0]]  # a floor by itself is no wall along y
    axes = [choice("up", up, ("y", "z"))] if up else ["y"] if path.suffix.lower() == ".glb" else wide or ["z"]
    low = [axis for axis in axes if high[axis] <= LOW_M] or axes
    axis = min(low, key=high.__getitem__) if len(low) > 1 else low[0]
    size = " x ".join(f"{length:.3g}" for length in extent)
    if not HEIGHT_M[0] <= high[axis] <= HEIGHT_M[1] or not ACROSS_M[0] <= extent.max() <= ACROSS_M[1]:
        hints = [f"units={name!r}" for name, size_m in UNITS_M.items() if 2.0 <= high[axis] / unit_m * size_m <= LOW_M]
        hints += [f"up={other!r}" for other in fitting if other != axis]
        raise InputError(
            f"mesh {path} measures {size} m and is {high[axis]:.3g} m high along {axis}, which is no room of {HEIGHT_M[0]:g} to "
            f"{HEIGHT_M[1]:g} m; give {' or '.join(hints) or 'its units and up, or cut out the room'}"
        )
    if len(low) > 1:
        warn(
            f"{path.name} measures {size} m and may stand along y or z: up is taken as {axis}, along which it is lowest; give up "
            "if it is the other"
        )
    return axis


def _scene(mesh: _Mesh, path: Path, materials: Mapping[str, Given], conventions: str) -> Scene:
    triangles = mesh.triangles
    normal = edge_cross(triangles)
    twice = np.linalg.norm(normal, axis=1)
    normal /= twice[:, None]
    exact = np.unique(np.stack([mesh.part, plane_of(triangles, normal)]), axis=1, return_inverse=True)[1].ravel()
    sizes = 0.5 * np.bincount(exact, twice)
    rough = sizes[exact] < SMALL_M2
    rough &= np.unique(exact[rough]).size > MOST_SMALL
    where = np.flatnonzero(rough)
    planes, left = planes_of_scan(triangles[where], np.random.default_rng(0))
    flats = [(float(0.5 * twice[where[plane.members]].sum()), plane.normal, plane.offset_m) for plane in planes]
    firsts = np.unique(exact, return_index=True)[1]
    flats += [
        (float(area), normal[k], float(normal[k] @ triangles[k, 0]))
        for area, k in zip(sizes, firsts, strict=True)
        if area >= SMALL_M2
    ]
    level, lean = _levelling(flats)
    triangles = triangles @ level.T
    quads = [
        rectangles(
            triangles[where[plane.members]], replace(plane, normal=level @ plane.normal), np.array([0.0, 0.0, 1.0])
        )
        for plane in planes
    ]
    flat_triangles = [triangles[~rough], *(_halves(quad) for quad in quads)]
    points = (np.concatenate(flat_triangles) if sum(map(len, flat_triangles)) else triangles).reshape(-1, 3)
    first, last = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    low, high = first[2], last[2]
    grounds = [
        offset / float((level @ normal)[2])
        for area, normal, offset in flats
        if area > FLOOR_PART * (last[0] - first[0]) * (last[1] - first[1]) and abs((level @ normal)[2]) > FLAT
    ]
    floors = [ground for ground in grounds if abs(ground - low) < NEAR_M]
    low = min(floors, default=low)
    naming = _Naming(mesh.names, materials, (low, high))
    surfaces: dict[tuple[str, Slab], list[np.ndarray]] = {}
    order = np.argsort(exact, kind="stable")
    for members in np.split(order, np.flatnonzero(np.diff(exact[order])) + 1):
        if rough[members[0]]:
            continue
        key = naming.of(int(mesh.part[members[0]]), triangles[members], normal[members[0]] @ level.T)
        surfaces.setdefault(key, []).append(triangles[members])
    for plane, sides in zip(planes, quads, strict=True):
        part = int(np.bincount(mesh.part[where[plane.members]], twice[where[plane.members]]).argmax())
        surfaces.setdefault(naming.of(part, _halves(sides), plane.normal @ level.T), []).append(_halves(sides))
    naming.check_all_used(path)
    reflecting = sum(
        0.5 * np.linalg.norm(edge_cross(piece), axis=1).sum() for group in surfaces.values() for piece in group
    )
    shift = np.array([0.0, 0.0, low])
    count, rest = sum(map(len, surfaces.values())), triangles[where[left]]
    if len(rest):
        surfaces["not plane", (ABSORBER, ABSORBER_M)] = [_halves(voxels(rest - shift)) + shift]
    names = numbered(name for name, _ in surfaces)  # an object of several materials becomes several surfaces
    scene_surfaces = [
        _surface(name, np.concatenate(group) - shift, slab)
        for name, ((_, slab), group) in zip(names, surfaces.items(), strict=True)
    ]
    absorbing = 0.5 * float(twice[where[left]].sum())
    clauses = [
        conventions,
        *([f"turned level by {lean:.2f} degrees"] if lean else []),
        *(
            [f"{'floor' if floors else 'no floor, lowest place'} at {low:.3f} m put at 0"]
            if abs(low) > 1e-6 or not floors
            else []
        ),
        f"x {first[0]:.2f} to {last[0]:.2f} m, y {first[1]:.2f} to {last[1]:.2f} m, {high - low:.2f} m high",
        f"{count} plane parts of {reflecting:.1f} m^2 reflect",
        f"{absorbing:.1f} m^2 that is not plane blocks and does not reflect",
        *naming.assumed(),
    ]
    return Scene(name=path.stem, surfaces=tuple(scene_surfaces), report="; ".join(clauses))


def _levelling(flats: list[tuple[float, np.ndarray, float]]) -> tuple[np.ndarray, float]:
    """Rotation (3, 3) that makes the floor level, that is the lowest of the large planes, and its angle [deg]; the identity for a
    negligible angle."""
    level = [flat for flat in flats if abs(flat[1][2]) > LEVEL]
    if not level:
        return np.eye(3), 0.0
    most = max(area for area, *_ in level)
    _, normal, _ = min((flat for flat in level if flat[0] > most / 2), key=lambda flat: flat[2] / flat[1][2])
    normal = normal * np.sign(normal[2])
    axis = np.cross(normal, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(axis))
    lean = float(np.degrees(np.arcsin(min(sine, 1.0))))
    if lean < LEAST_LEAN_DEG:
        return np.eye(3), 0.0
    k = axis / sine
    across = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3) + sine * across + (1 - normal[2]) * across @ across, lean


def _halves(quads: np.ndarray) -> np.ndarray:
    """Two triangles (2 Q, 3, 3) for each quadrangle (Q, 4, 3)."""
    return quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)


def _surface(name: str, triangles: np.ndarray, slab: Slab) -> Surface:
    vertices, faces = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    return Surface(name=name, vertices=vertices, faces=faces.reshape(-1, 3), material=slab[0], thickness_m=slab[1])


@dataclass(slots=True)
class _Naming:
    """Finds names and slabs of plane parts."""

    names: list[tuple[str, str]]
    materials: Mapping[str, Given]
    span_m: tuple[float, float]
    used: set[str] = field(default_factory=set)
    guessed: dict[str, dict[str, None]] = field(default_factory=dict)
    """What was assumed, and for which surfaces."""

    def of(self, part: int, triangles: np.ndarray, normal: np.ndarray) -> tuple[str, Slab]:
        """Name and slab of a plane part with triangles (F, 3, 3), which belongs to part `part` of the file."""
        object_name, made_of = self.names[part]
        role = self._role(triangles, normal)
        name = printable(object_name or made_of or role)[: MAX_NAME - len(f" {MAX_SURFACES}")]
        words = re.findall(r"[a-z]+", f"{made_of} {object_name}".lower().replace("_board", "board"))
        usual = next((WORDS[word] for word in words if word in WORDS), ROLES[role])
        for key in (object_name, made_of, role):
            match = next((label for label in self.materials if label.casefold() == key.casefold() and key), None)
            if match is not None:
                self.used.add(match)
                material, thickness_m = self.materials[match]
                if thickness_m is None:
                    self.guessed.setdefault(f"{usual[1]:g} m", {})[name] = None
                return name, (material, thickness_m or usual[1])
        self.guessed.setdefault(str(usual[0]), {})[name] = None
        return name, usual

    def _role(self, triangles: np.ndarray, normal: np.ndarray) -> str:
        heights = triangles[..., 2]
        if abs(normal[2]) > FLAT:
            near = [abs(heights.mean() - level) < NEAR_M for level in self.span_m]
            return "floor" if near[0] else "ceiling" if near[1] else "thing"
        return "wall" if abs(normal[2]) < UPRIGHT and np.ptp(heights) > WALL_M else "thing"

    def check_all_used(self, path: Path) -> None:
        """Refuses a substitute for a material or object that the mesh does not have."""
        there = sorted({name for pair in self.names for name in pair if name} | set(ROLES))
        for name in self.materials:
            if name not in self.used and name.casefold() not in {present.casefold() for present in there}:
                raise InputError(f"mesh {path} has nothing called {shown(name)}; {names_advice(name, there)}")

    def assumed(self) -> list[str]:
        """Sentences about materials and thicknesses that had to be assumed."""
        return [
            f"assumed {what} of {', '.join(list(names)[:6])}{' ...' if len(names) > 6 else ''}"
            for what, names in self.guessed.items()
        ]


def slab_of(material: str | Material) -> Given:
    """Material and thickness [m] from "wood", "wood 0.04" or a Material, which has no thickness."""
    if not isinstance(material, str):
        return material, None
    name, _, thickness = material.removeprefix("itu_").partition(" ")
    usual_m = THICKNESS_M.get(known_itu(name), THICKNESS_M["concrete"])
    try:
        return name, float(thickness) if thickness.strip() else usual_m
    except ValueError:
        raise InputError(
            f"a material must be a name, or a name and a thickness in metres as 'wood 0.04', got {shown(material)}"
        ) from None
