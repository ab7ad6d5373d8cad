"""A scene's plane parts, the chains of them that rays from a place can take, and what blocks a ray."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import accumulate
from typing import Any

import numpy as np

from t2d_rt.core.backend import Backend, aligned, one_thread_at_a_time
from t2d_rt.core.errors import InputError
from t2d_rt.core.memory import LastUsed, blocks
from t2d_rt.geometry import winding
from t2d_rt.geometry.planes import plane_of
from t2d_rt.geometry.vectors import edge_cross
from t2d_rt.propagation.rays import columns, mitsuba, mitsuba_mesh, rays, traceable
from t2d_rt.types import Scene
from t2d_rt.types.material import absorbs
from t2d_rt.types.scene import ROOM_PLANES

Chain = tuple[int, ...]
"""What a ray meets: k is a reflection by mirror k, ~k (that is -1 - k) a passage through it."""
RAYS = 1 << 20
"""Number of rays that search for chains: one for each 1.2e-5 sr, 1 cm^2 at 3 m."""
OUTLINE_M = 1e-7
"""Distance [m] outside an outline at which a reflection still counts as inside: none may fall between two triangles."""
ONE_PLANE_M = 1e-5
"""Mirrors of different surfaces that lie this near [m] to one plane, and reach farther into one another, overlap there."""
FAR_M = 100.0
"""Distance [m] from the origin of the coordinates up to which float32 is right to a tenth of `SKIN_M`."""
SKIN_M = 1e-4
"""Distance [m] from a mirror at which rays start and end."""
MOST_LOSS_DB = 40.0
"""Loss [dB] at normal incidence beyond which slabs together stop a ray."""
CLOSED = 0.9
"""Winding number beyond which triangles are closed around a place: 1 within a shell, less in a valley or an open box."""
LEAST_FLOOR_M2, LEAST_HEIGHT_M = 2.0, 1.8
"""Least floor [m^2] and height [m] of a room."""

_last_chains = LastUsed[list[Chain]](16)
"""Chains by all that their search follows from."""


@dataclass(frozen=True, slots=True)
class Mirror:
    """A plane part of a surface: its triangles of one plane."""

    name: str
    surface: int
    normal: np.ndarray
    """Unit normal (3,); both sides reflect."""
    offset_m: float
    """Offset of its plane [m]: normal . x of its points."""
    triangles: np.ndarray
    """Corners of its triangles [m], (F, 3, 3)."""
    edges: tuple[np.ndarray, np.ndarray]
    """Inward direction of each triangle's three edges, (3 F, 3), and how far along that the edge lies [m], (3 F,)."""
    covers: tuple[Mirror, ...] = ()
    """Other mirrors of its plane that count instead where they overlap it."""

    @classmethod
    def of(cls, name: str, surface: int, normal: np.ndarray, triangles: np.ndarray) -> Mirror:
        """A mirror of triangles (F, 3, 3) [m] in one plane."""
        normals = edge_cross(triangles)
        inward = np.cross(normals[:, None], np.roll(triangles, -1, axis=1) - triangles)
        inward /= np.linalg.norm(inward, axis=2, keepdims=True)
        offset = np.einsum("fei,fei->fe", inward, triangles)
        edges = inward.reshape(-1, 3), offset.ravel() - OUTLINE_M
        return cls(name, surface, normal, float(np.mean(triangles @ normal)), triangles, edges)

    def holds(self, points: np.ndarray) -> np.ndarray:
        """Which of points (..., 3) [m] of its plane lie inside its outline, bool (...)."""
        inward, offset = self.edges
        inside = [np.zeros(0, bool)]
        for block in blocks(points.reshape(-1, 3), len(inward)):
            within = inward @ block.T >= offset[:, None]  # sums over rows of points, not within each
            inside.append(within.reshape(len(inward) // 3, 3, len(block)).all(axis=1).any(axis=0))
        held = np.concatenate(inside).reshape(points.shape[:-1])
        for cover in self.covers:
            held &= ~cover.holds(points)
        return held

    def overlaps(self, other: Mirror) -> bool:
        """Whether both lie in one plane and have a part of it in common."""
        aside = (other.triangles.reshape(-1, 3) @ self.normal) - self.offset_m
        if np.abs(aside).max() > ONE_PLANE_M:
            return False
        inward, along = other.edges[0].reshape(-1, 3, 3), other.edges[1].reshape(-1, 3)
        for block in blocks(np.arange(len(self.triangles)), 3 * len(other.triangles)):
            mine = self.edges[0].reshape(-1, 3, 3)[block], self.edges[1].reshape(-1, 3)[block]
            # Triangles are apart where all corners of the one lie outside an edge of the other.
            apart = _outside(*mine, other.triangles) | _outside(inward, along, self.triangles[block]).T
            if not apart.all():
                return True
        return False


def _outside(inward: np.ndarray, along: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Whether triangles (G, 3, 3) lie outside any of the three edges of others, given as `Mirror.edges` (F, 3, 3) and (F, 3):
    bool (F, G)."""
    beyond = np.einsum("fei,gci->fgec", inward, triangles) - along[:, None, :, None]
    return np.asarray((beyond < ONE_PLANE_M).all(axis=3).any(axis=2))


@dataclass(frozen=True, slots=True)
class Mirrors:
    """All mirrors of a scene, in a form that rays can be traced in."""

    scene: Scene
    parts: list[Mirror]
    of_face: np.ndarray
    """Number of the mirror of each triangle."""
    backend: Backend
    traced: Any = field(repr=False)
    """Mitsuba's scene of all triangles, in float32 from `origin_m`."""
    origin_m: np.ndarray | None = None
    """Origin (3,) [m] near the radar, where this is far from that of the coordinates; None: the coordinates' own."""

    @classmethod
    def of(cls, scene: Scene, backend: Backend, place_m: np.ndarray | None = None) -> Mirrors:
        """Plane parts of all surfaces; rays will be traced near a place (3,) [m]. Raises InputError if there are too many."""
        origin_m = None if place_m is None or np.abs(place_m).max() < FAR_M else np.round(place_m)
        parts: list[Mirror] = []
        named: Counter[str] = Counter()
        corners, of_face = [], []
        for number, surface in enumerate(scene.surfaces):
            triangles = surface.vertices[surface.faces]
            normal = edge_cross(triangles)
            area = np.linalg.norm(normal, axis=1)
            proper = _once(triangles) & (area > 1e-12)
            triangles, normal = triangles[proper], normal[proper] / area[proper, None]
            plane = plane_of(triangles, normal)
            if len(parts) + plane.max(initial=-1) >= ROOM_PLANES:
                raise InputError(
                    f"scene {scene.name} has more than {ROOM_PLANES} plane parts where its rays are traced; give what is round or "
                    "rough, as a scan is, fewer triangles"
                )
            for index in range(plane.max(initial=-1) + 1):
                of_plane = np.flatnonzero(plane == index)
                name = surface.name if plane.max() == 0 else f"{surface.name} {_side(normal[of_plane[0]])}"
                name = f"{name} {named[name] + 1}" if named[name] and plane.max() else name
                # "wall +x 2" counts for "wall +x" and "wall" as well: no name is given twice, whatever surfaces are called.
                named.update(accumulate(name.split(" "), "{} {}".format))
                parts.append(Mirror.of(name, number, normal[of_plane[0]], triangles[of_plane]))
            corners.append(triangles)
            of_face.append(plane + len(parts) - (plane.max(initial=-1) + 1))
        mi = mitsuba(backend)
        mirrors = cls(scene, parts, np.concatenate(of_face), backend, None, origin_m)
        body = mitsuba_mesh(mi, mirrors.local(np.concatenate(corners).reshape(-1, 3)))
        return replace(mirrors, traced=traceable(mi, body))

    def local(self, points_m: np.ndarray) -> np.ndarray:
        """Points (..., 3) [m] relative to `origin_m`: 1 km away float32, in which rays are traced, has steps of 0.06 mm."""
        return points_m if self.origin_m is None else points_m - self.origin_m

    def world(self, points_m: np.ndarray) -> np.ndarray:
        """Points (..., 3) [m] in the coordinates of the scene, from `local` ones."""
        return points_m if self.origin_m is None else points_m + self.origin_m

    def chains(
        self, place_m: np.ndarray, order: int, *, transmissions: int = 0, loss_db: np.ndarray | None = None
    ) -> list[Chain]:
        """Chains that rays from a place (3,) [m] can take, () first, shorter ones before longer ones: up to `order` reflections,
        and passages through up to `transmissions` mirrors, each of which takes its `loss_db` (M,) from a ray.

        Those of the last scenes and places are kept: the search takes longer than all else about the paths of a simple room.
        """
        loss_db = np.zeros(len(self.parts)) if loss_db is None else np.asarray(loss_db, float)
        place_m = np.asarray(place_m, float)
        key = self.scene.content, place_m.tobytes(), order, transmissions, loss_db.tobytes(), self.backend.name
        return list(_last_chains.get(key, partial(self._searched, place_m, order, transmissions, loss_db)))

    def _searched(self, place_m: np.ndarray, order: int, transmissions: int, loss_db: np.ndarray) -> list[Chain]:
        """The chains of `chains`, by rays in all directions."""
        mi = mitsuba(self.backend)
        direction = sphere(RAYS)
        origin = np.broadcast_to(self.local(place_m), direction.shape)
        first = _Rays(
            origin=mi.Point3f(*columns(mi, origin)),
            direction=mi.Vector3f(*columns(mi, direction)),
            inside=mi.Bool(True),
            bearable_db=mi.Float(MOST_LOSS_DB),
            path=np.zeros(RAYS, np.int64),
            chains=[()],
            reflections=order,
            passages=transmissions,
        )
        waiting = [first]
        chains: list[Chain] = []
        while waiting:
            beams = waiting.pop()
            chains += beams.chains
            if beams.reflections or beams.passages:
                waiting += self._onward(beams, loss_db)
        return sorted(chains, key=len)

    def parted(self, chains: Sequence[Chain]) -> tuple[Mirrors, list[Chain]]:
        """These mirrors, changed so that no place of a plane lies in two of those that the chains meet, which would reflect twice:
        the first one has it; and the chains, with those added that meet an overlapping mirror in place of another."""
        # k and ~k name the same mirror; the greater of the two is its number.
        met = sorted({max(k, ~k) for chain in chains for k in chain})
        parts = list(self.parts)
        overlapping: dict[int, list[int]] = {}
        corner = np.array([self.parts[number].triangles[0, 0] for number in met]).reshape(-1, 3)
        for place, number in enumerate(met):
            mirror = self.parts[number]
            near = np.flatnonzero(np.abs(corner[:place] @ mirror.normal - mirror.offset_m) < 2 * ONE_PLANE_M)
            before = [met[k] for k in near.tolist() if mirror.overlaps(self.parts[met[k]])]
            parts[number] = replace(parts[number], covers=tuple(self.parts[k] for k in before))
            for k in before:
                overlapping.setdefault(number, []).append(k)
                overlapping.setdefault(k, []).append(number)
        # A ray that met the one of two overlapping mirrors might as well have met the other: chains over both are tried.
        tried = dict.fromkeys(chains)
        waiting = list(chains) if overlapping else []
        while waiting:
            chain = waiting.pop()
            for place, k in enumerate(chain):
                for other in overlapping.get(max(k, ~k), ()):
                    swapped = (*chain[:place], other if k >= 0 else ~other, *chain[place + 1 :])
                    if swapped not in tried:
                        tried[swapped] = None
                        waiting.append(swapped)
        return replace(self, parts=parts), sorted(tried, key=len)

    def _onward(self, beams: _Rays, loss_db: np.ndarray) -> list[_Rays]:
        """Rays after the next mirror: those that it reflects and those that it lets through."""
        import drjit as dr

        mi = mitsuba(self.backend)
        normals = mi.Float(aligned(np.array([mirror.normal for mirror in self.parts]), np.float32))
        of_face = mi.UInt32(aligned(self.of_face, np.uint32))
        hit = self.traced.ray_intersect_preliminary(mi.Ray3f(beams.origin, beams.direction), active=beams.inside)
        inside = beams.inside & hit.is_valid()
        mirror = dr.gather(mi.UInt32, of_face, hit.prim_index, inside)
        inside &= ~dr.gather(mi.Bool, mi.Bool(self._ends()), mirror, inside)
        normal = dr.gather(mi.Vector3f, normals, mirror, inside)
        cosine = dr.dot(beams.direction, normal)
        place, off = (beams.origin + dr.select(inside, hit.t, 0) * beams.direction, SKIN_M * dr.sign(cosine) * normal)
        dr.eval(place, off, mirror, inside)
        met, onward = mirror.numpy(), []
        if beams.reflections:
            ahead = beams.direction - 2 * cosine * normal
            dr.eval(ahead)
            on = replace(beams, origin=place - off, direction=ahead, inside=inside, reflections=beams.reflections - 1)
            onward.append(on.over(met, through=False))
        if beams.passages:
            bearable = beams.bearable_db - dr.gather(mi.Float, mi.Float(aligned(loss_db, np.float32)), mirror, inside)
            passing = inside & (bearable >= 0)
            dr.eval(bearable, passing)
            on = replace(beams, origin=place + off, inside=passing, bearable_db=bearable, passages=beams.passages - 1)
            onward.append(on.over(met, through=True))
        return [beam for beam in onward if beam.chains]

    def _ends(self) -> list[bool]:
        """Whether each mirror absorbs what meets it."""
        return [absorbs(self.scene.surfaces[mirror.surface].material) for mirror in self.parts]

    def first(
        self, origin_m: np.ndarray, direction: np.ndarray, length_m: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Distance [m] along rays (..., 3) to the first mirror, infinite if none is within their length, and its number, (...)."""
        return self.first_of_local(self.local(origin_m), direction, length_m)

    @one_thread_at_a_time
    def first_of_local(
        self, origin_m: np.ndarray, direction: np.ndarray, length_m: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """What `first` finds, from places that are `local`."""
        length_m = None if length_m is None else np.maximum(length_m, 0)
        hit = self.traced.ray_intersect_preliminary(rays(mitsuba(self.backend), origin_m, direction, length_m))
        distance = hit.t.numpy().reshape(origin_m.shape[:-1])
        number = hit.prim_index.numpy().reshape(distance.shape)
        return distance, self.of_face[np.where(np.isfinite(distance), number, 0)]

    def slab_at(self, place_m: np.ndarray) -> str | None:
        """Name of a surface that holds a place (3,) [m] within its thickness, None if none does."""
        for mirror in self.parts:
            surface = self.scene.surfaces[mirror.surface]
            away = float(place_m @ mirror.normal - mirror.offset_m)
            foot = place_m - away * mirror.normal
            if abs(away) < surface.thickness_m / 2 and mirror.holds(foot[None])[0]:
                return surface.name
        return None

    def shells_enclosing(self, place_m: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
        """Yields closed pieces of surfaces around a place, whichever side they face: surface name and triangles (F, 3, 3) [m]."""
        parts: dict[int, list[np.ndarray]] = {}
        for mirror in self.parts:
            parts.setdefault(mirror.surface, []).append(mirror.triangles)
        for number, of_surface in parts.items():
            surface, triangles = self.scene.surfaces[number], np.concatenate(of_surface)
            low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
            if ((low < place_m) & (place_m < high)).all():
                piece = _piece_of(triangles)
                for index in range(piece.max() + 1):
                    if abs(winding(triangles[piece == index] - place_m)) > CLOSED:
                        yield surface.name, triangles[piece == index]

    def free(self, start_m: np.ndarray, stop_m: np.ndarray) -> np.ndarray:
        """Whether segments between points (..., 3) and points (..., 3) [m] are free, bool (...), but for what they end on."""
        start, stop = np.broadcast_arrays(self.local(start_m), self.local(stop_m))
        if not start.size:  # Dr.Jit aborts the process over rays that are none
            return np.ones(start.shape[:-1], bool)
        offset = (stop - start).reshape(-1, 3)
        length = np.linalg.norm(offset, axis=1)
        direction = offset / np.maximum(length, 1e-12)[:, None]
        begin, length = start.reshape(-1, 3) + SKIN_M * direction, np.maximum(length - 2 * SKIN_M, 0)
        met = self.traced.ray_test(rays(mitsuba(self.backend), begin, direction, length))
        return ~met.numpy().reshape(start.shape[:-1])


@dataclass(frozen=True, slots=True)
class _Rays:
    """Rays in flight, and the chains of mirrors that they have met."""

    origin: Any
    direction: Any
    inside: Any
    """Which of them have met a mirror each time, Bool (R,)."""
    bearable_db: Any
    """Loss that they may have in further slabs [dB], Float (R,)."""
    path: np.ndarray
    """Number of the chain that each ray has taken, (R,)."""
    chains: list[Chain]
    reflections: int
    """Number of reflections that may follow."""
    passages: int

    def over(self, mirror: np.ndarray, *, through: bool) -> _Rays:
        """The rays with a mirror (R,) more at the end of each chain."""
        going = self.inside.numpy()
        # A chain as one number, that of its beginning and that of its last mirror, is found sooner than a row of them.
        most = int(mirror.max(initial=0)) + 1
        code = self.path[going] * most + mirror[going]
        present = np.bincount(code) > 0  # sooner than to sort them
        path = np.zeros(len(going), np.int64)
        path[going] = (np.cumsum(present) - 1)[code]
        ended = (divmod(code, most) for code in np.flatnonzero(present).tolist())
        return replace(self, path=path, chains=[(*self.chains[begun], ~k if through else k) for begun, k in ended])


def has_room(size_m: np.ndarray) -> bool:
    """Whether a box of that size (3,) [m] is as large as a room; what is smaller and closed is furniture."""
    return bool(size_m[0] * size_m[1] >= LEAST_FLOOR_M2 and size_m[2] >= LEAST_HEIGHT_M)


def _piece_of(triangles: np.ndarray) -> np.ndarray:
    """Number of the connected piece of each triangle (F, 3, 3): those that share a corner hang together."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    corner = np.unique(triangles.reshape(-1, 3).round(6), axis=0, return_inverse=True)[1].reshape(-1, 3)
    ends = corner[:, :2].ravel(), corner[:, 1:].ravel()
    joined = csr_array((np.ones(len(ends[0])), ends), shape=(corner.max() + 1,) * 2)
    return np.asarray(connected_components(joined, directed=False)[1][corner[:, 0]])


def _once(triangles: np.ndarray) -> np.ndarray:
    """Which triangles (F, 3, 3) are the first ones with their corners, bool (F,): a second one would be a second side."""
    corners = np.round(triangles, 6)
    order = np.lexsort(corners.transpose(2, 0, 1)[::-1], axis=1)
    sorted_corners = np.take_along_axis(corners, order[..., None], axis=1).reshape(len(corners), 9)
    first = np.zeros(len(corners), bool)
    first[np.unique(sorted_corners, axis=0, return_index=True)[1]] = True
    return first


def _side(normal: np.ndarray) -> str:
    """Name of the axis that a normal points along most, such as "+x"."""
    axis = int(np.argmax(np.abs(normal)))
    return ("-" if normal[axis] < 0 else "+") + "xyz"[axis]


def sphere(count: int) -> np.ndarray:
    """Directions (count, 3), evenly spread: a Fibonacci lattice."""
    index = np.arange(count)
    height = 1 - (2 * index + 1) / count
    angle = np.pi * (3 - np.sqrt(5)) * index
    radius = np.sqrt(1 - height**2)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])


def forget() -> None:
    """Drops the searches for chains that are kept."""
    _last_chains.forget()
