"""Where the rays of tubes are on the surfaces that they meet, one after another, at one instant (physics.md, eq. 31)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from t2d_rt.geometry.vectors import norms, unit, vector_product
from t2d_rt.scattering.reflectors import Lattice, PosedReflectors, Reflectors, dot

LIFT_WAVELENGTHS = 0.1
"""Distance from a curved facet at which rays start [wavelengths], which is more than it bulges; the point that they meet is then
found with the ray from the surface itself."""
FLAT_LIFT_M = 2e-5
"""Distance from a flat facet at which rays start [m]; what is missed at the rim of another surface is no more than that."""
LEAST_COSINE = 0.8
"""Least cosine of the angle between the true normals at a footprint's corners and the normal of the plane through them; if it is
less, the corners lie on different surfaces."""
GRAZING = 0.03
"""Least cosine of incidence: at more grazing incidence a tube's section is taken as this fraction of its footprint (eq. 31)."""


class Traced(NamedTuple):
    """The surfaces that rays meet first."""

    face: np.ndarray
    """Face that each ray meets (N,), -1 where it meets none."""
    weights: np.ndarray
    """Barycentric coordinates of the point in that face, (N, 3)."""


class RayTracer(Protocol):
    """Finds the first surface along rays, and whether two points see each other."""

    def first_hits(self, origins: np.ndarray, directions: np.ndarray) -> Any:
        """The faces that rays with origins (N, 3) [m] and directions (N, 3) meet first, and where on them."""

    def free(self, origins: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Whether nothing lies between origins (N, 3) and ends (3,) or (N, 3) [m], bool (N,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Instant:
    """Targets in one pose before the antennas."""

    reflectors: Reflectors
    posed: PosedReflectors
    rays: RayTracer
    transmitter_m: np.ndarray
    receiver_m: np.ndarray
    wavelength_m: float

    def lift_m(self, faces: np.ndarray) -> np.ndarray:
        """Distance [m] from facets (N,) at which rays start, (N,)."""
        return np.where(self.reflectors.curved[faces], LIFT_WAVELENGTHS * self.wavelength_m, FLAT_LIFT_M)

    def lifted(self, front: Front, paths: np.ndarray, towards: np.ndarray) -> np.ndarray:
        """Points (N, 3) [m] where rays start that leave a surface: off it, and off another one that meets it there."""
        lift_m = self.lift_m(front.faces[paths, -1])[:, None]
        return np.asarray(front.place[paths] + lift_m * (1.5 * front.normal[paths] + towards))

    def visible(self, place_m: np.ndarray, front: Front, asked: np.ndarray) -> np.ndarray:
        """Which of the points `asked`, bool (N,), of a front are visible from a place (3,) [m], bool (N,)."""
        towards = unit(place_m - front.place)
        visible = asked & (dot(towards, front.normal) > 0)
        paths = np.flatnonzero(visible)
        visible[paths] = self.rays.free(self.lifted(front, paths, towards[paths]), place_m)
        return visible


@dataclass(frozen=True, slots=True)
class Front:
    """Where rays are on a surface, and the tubes between them."""

    faces: np.ndarray
    """Facets that the N paths have met at B bounces, (N, B)."""
    coordinates: np.ndarray
    """Where the paths met these facets (`PosedReflectors.coordinates`), (N, B, 3)."""
    sense: np.ndarray
    """Signs of the parts between bounces, as in `Tubes.sense`, (N, B - 1)."""
    length_m: np.ndarray
    """Lengths of the paths so far [m], (N,)."""
    place: np.ndarray
    """Points on the last surface [m], (N, 3)."""
    normal: np.ndarray
    """Unit normals at these points, (N, 3)."""
    incoming: np.ndarray
    """Unit directions in which rays arrive, (N, 3)."""
    triangles: np.ndarray
    """Paths at the corners of the M tubes, (M, 3)."""
    weight: np.ndarray
    """Fraction of each tube that got here, times sqrt(2 A_1)/R_t of its start (eq. 31), (M,)."""
    reflection: np.ndarray
    """Product of the conjugated reflection coefficients and of the focal phases so far, complex (M,)."""
    lead: np.ndarray
    """Corner whose path alone is traced on, while the others keep to the plane that touches the surface where it meets one; -1: all
    three are traced, (M,)."""
    number: np.ndarray
    """Number of the lattice's part that each tube began with, (M,)."""

    def only(self, tubes: np.ndarray) -> Front:
        """The tubes that are chosen, bool (M,), and their paths."""
        used, triangles = np.unique(self.triangles[tubes], return_inverse=True)
        of_tubes = ("weight", "reflection", "lead", "number")
        of_paths = [name for name in Front.__slots__ if name not in ("triangles", *of_tubes)]
        paths = {name: getattr(self, name)[used] for name in of_paths}
        return Front(
            **paths, triangles=triangles.reshape(-1, 3), **{name: getattr(self, name)[tubes] for name in of_tubes}
        )


def launched(instant: Instant, lattice: Lattice) -> Front:
    """The front on the first surface: tubes of those parts of the lattice of which any corner is lit."""
    posed = instant.posed
    place, normal = posed.places(lattice.face, lattice.weights), posed.normals_at(lattice.face, lattice.weights)
    range_m = norms(place - instant.transmitter_m)
    incoming = (place - instant.transmitter_m) / range_m[:, None]
    lit = dot(incoming, normal) < 0
    number = np.flatnonzero(lit[lattice.parts].any(axis=1))
    triangles = lattice.parts[number]
    power = seen_area(place[triangles], incoming[triangles].mean(axis=1))
    front = Front(
        lattice.face[:, None],
        np.zeros((len(place), 1, 3)),
        np.zeros((len(place), 0)),
        range_m,
        place,
        normal,
        incoming,
        triangles,
        np.sqrt(np.abs(power)) / range_m[triangles].mean(axis=1),
        instant.reflectors.reflection[lattice.face[triangles[:, 0]]],
        np.full(len(triangles), -1),
        number,
    ).only(np.ones(len(triangles), bool))
    return replace(front, coordinates=posed.coordinates(front.faces[:, 0], front.place)[:, None])


def outgoing(instant: Instant, front: Front) -> tuple[np.ndarray, np.ndarray, Traced]:
    """Numbers of the paths that go on, (P,), their directions (P, 3), and what they meet."""
    paths = np.flatnonzero(dot(front.incoming, front.normal) < 0)
    normal, incoming = front.normal[paths], front.incoming[paths]
    direction = incoming - 2 * dot(incoming, normal)[:, None] * normal
    return paths, direction, instant.rays.first_hits(instant.lifted(front, paths, -direction), direction)


@dataclass(frozen=True, slots=True)
class _Met:
    """Where the rays of a front meet a surface again."""

    direction: np.ndarray
    """Direction in which each ray left, 0 where it did not, (N, 3)."""
    face: np.ndarray
    """Facet that each ray meets, -1 where it meets none, (N,)."""
    place: np.ndarray
    """Points where the rays meet a facet [m], (N, 3)."""
    normal: np.ndarray
    """Unit normals at these points, (N, 3)."""
    valid: np.ndarray
    """Which rays meet a facet from its front, bool (N,)."""
    seen: np.ndarray
    """Which of these start where the transmitter sees the surface, bool (N,)."""

    @classmethod
    def of(cls, instant: Instant, front: Front) -> _Met:
        posed = instant.posed
        paths, directions, hits = outgoing(instant, front)
        direction, face = np.zeros_like(front.place), np.full(len(front.place), -1)
        direction[paths], face[paths] = directions, hits.face
        place, normal = front.place.copy(), front.normal.copy()
        met, at = np.flatnonzero(face >= 0), face[face >= 0]
        # Rays were lifted off the surface; this is where the ray from the surface itself arrives.
        weights = posed.on_surface(at, hits.weights[hits.face >= 0], front.place[met], direction[met])
        place[met], normal[met] = posed.places(at, weights), posed.normals_at(at, weights)
        ahead = dot(place - front.place, direction) > -instant.lift_m(front.faces[:, -1])
        valid = (face >= 0) & (dot(direction, normal) < 0) & ahead
        # Where rays have arrived on later surfaces, nothing was in their way.
        seen = instant.visible(instant.transmitter_m, front, valid) if front.faces.shape[1] == 1 else valid
        return cls(direction, face, place, normal, valid, seen)


def reflected(instant: Instant, front: Front) -> Front:
    """The front on the surfaces that tubes meet next.

    A tube whose corners meet one surface goes on as it is. Otherwise each corner that meets a surface stands for a third of the
    tube, which goes on to the plane that touches the surface there.
    """
    met = _Met.of(instant, front)
    valid = met.valid[front.triangles]
    across = vector_product(*two_edges(met.place[front.triangles]))
    agree = np.abs(np.einsum("mi,mci->mc", unit(across), met.normal[front.triangles])).min(axis=1) > LEAST_COSINE
    whole = valid.all(axis=1) & agree & (front.lead < 0)
    triangles = front.triangles[whole]
    faces, coordinates = np.maximum(met.face, 0), np.zeros_like(met.place)
    coordinates[met.valid] = instant.posed.coordinates(met.face[met.valid], met.place[met.valid])
    intact = Front(
        np.concatenate([front.faces, faces[:, None]], axis=1),
        np.concatenate([front.coordinates, coordinates[:, None]], axis=1),
        np.concatenate([front.sense, np.ones((len(faces), 1))], axis=1),
        front.length_m + norms(met.place - front.place),
        met.place,
        met.normal,
        met.direction,
        triangles,
        front.weight[whole] * met.seen[triangles].mean(axis=1),
        front.reflection[whole]
        * instant.reflectors.reflection[faces[triangles[:, 0]]]
        * focal_phase(front.place[triangles], met.place[triangles], met.direction[triangles].mean(axis=1)),
        front.lead[whole],
        front.number[whole],
    )
    led = (
        valid
        & met.seen[front.triangles]
        & ~whole[:, None]
        & ((front.lead[:, None] < 0) | (front.lead[:, None] == range(3)))
    )
    return _joined(
        [intact, *(_led(instant, front, met, np.flatnonzero(led[:, corner]), corner) for corner in range(3))]
    )


def _led(instant: Instant, front: Front, met: _Met, tubes: np.ndarray, corner: int) -> Front:
    """The thirds of some tubes, by number, that one corner stands for, on the plane that touches the surface which it meets."""
    triangles = front.triangles[tubes]
    base = triangles[:, corner]
    start, direction = front.place[triangles], met.direction[triangles]
    normal = met.normal[base][:, None]
    sinking = -dot(direction, normal)
    along = -dot(met.place[base][:, None] - start, normal) / np.maximum(sinking, GRAZING)
    usable = (sinking > GRAZING).all(axis=1)
    tubes, base, triangles, start, direction = (column[usable] for column in (tubes, base, triangles, start, direction))
    place = start + along[usable][..., None] * direction
    count = len(base)
    face = np.repeat(met.face[base], 3)
    paths, place = triangles.ravel(), place.reshape(-1, 3)
    return Front(
        np.concatenate([front.faces[paths], face[:, None]], axis=1),
        np.concatenate([front.coordinates[paths], instant.posed.coordinates(face, place)[:, None]], axis=1),
        np.concatenate([front.sense[paths], np.sign(along[usable]).reshape(-1, 1)], axis=1),
        front.length_m[paths] + along[usable].ravel(),
        place,
        np.repeat(met.normal[base], 3, axis=0),
        met.direction[paths],
        np.arange(3 * count).reshape(-1, 3),
        front.weight[tubes] / np.where(front.lead[tubes] < 0, 3, 1),
        front.reflection[tubes]
        * instant.reflectors.reflection[met.face[base]]
        * focal_phase(start, place.reshape(-1, 3, 3), direction.mean(axis=1)),
        np.full(count, corner),
        front.number[tubes],
    )


def focal_phase(start: np.ndarray, end: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(-j) to the power of the number of focal lines that tubes pass from triangles (M, 3, 3) to others along (M, 3), complex (M,).

    A section of the tube is mapped to a later one by 1 + s C, whose determinant changes its sign at each focal line (eq. 31).
    """
    (p, q), (u, v) = two_edges(start), two_edges(end)
    before = dot(vector_product(p, q), direction)
    determinant = dot(vector_product(u, v), direction) / before
    trace = (dot(vector_product(u, q), direction) + dot(vector_product(p, v), direction)) / before
    return np.where(determinant < 0, -1j, np.where(trace < 0, -1, 1))


def _joined(fronts: list[Front]) -> Front:
    """Several fronts as one, without tubes of weight 0."""
    fronts = [front.only(front.weight != 0) for front in fronts]
    first = np.cumsum([0, *(len(front.place) for front in fronts)])
    columns = {name: np.concatenate([getattr(front, name) for front in fronts]) for name in Front.__slots__}
    columns["triangles"] = np.concatenate(
        [front.triangles + start for front, start in zip(fronts, first[:-1], strict=True)]
    )
    return Front(**columns)


def two_edges(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The two edges from the first corner of triangles (M, 3, 3), (M, 3) each."""
    return triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]


def seen_area(triangles: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Twice the area of triangles (M, 3, 3) as seen along directions (M, 3), with its sign, (M,)."""
    return dot(vector_product(*two_edges(triangles)), direction)
