"""Paths as data: `PathSet` (all paths of one antenna), `OneWayPath` (one of these), `PathPair` (out and back) and `StaticPath`
(from transmitter to receiver without a target)."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from t2d_rt.types.radar_track import Rigid

Passing = Callable[[np.ndarray], Rigid]
"""Function that gives, at times [s] (K,), the rigid motion from the scene's coordinates to the frame in which a moving radar stands
still (`Radar.passing`)."""
PathKey = tuple[tuple[str, ...], bytes]
"""Identity of a one-way path: the names of its chain, and the bytes of the antenna's image in it."""


def passed(passing: Passing, times_s: np.ndarray | None) -> Rigid:
    """The rigid motions of the scene relative to a moving radar at times [s] (K,); raises a ValueError where these are None."""
    if times_s is None:
        raise ValueError("paths to a radar that moves are known at given times alone")
    return passing(times_s)


def points_in_scene(passing: Passing | None, points: np.ndarray, times_s: np.ndarray | None) -> np.ndarray:
    """Points (K, ..., 3) m, given in the frame in which the radar stands still at times (K,), in the coordinates of the scene;
    unchanged if the radar does not move."""
    return points if passing is None else passed(passing, times_s).back.points(points)


class _Compared:
    """Base of dataclasses that are equal where all their fields are; arrays are compared element by element."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return False
        pairs = ((getattr(self, field.name), getattr(other, field.name)) for field in fields(self))  # type: ignore[arg-type]
        return all(np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b for a, b in pairs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Elements(_Compared):
    """The mirrors and slabs that paths meet, from the antenna on: arrays (n,) for one path, (P, L) for P paths of up to L
    elements."""

    mirror: np.ndarray
    """Indices of the mirrors in the scene."""
    through: np.ndarray
    """Whether the path passes through the slab (True) or is reflected (False), bool."""
    normal: np.ndarray
    """Unit normals of the planes, (..., 3)."""
    offset_m: np.ndarray
    """Offsets of the planes [m]: normal . x for points x of the plane."""
    relative_permittivity: np.ndarray
    """Real part of the relative permittivity; inf for a perfect conductor."""
    conductivity_s_per_m: np.ndarray
    thickness_m: np.ndarray
    specular: np.ndarray
    """Fraction of the reflected field that a rough surface does not scatter, 0..1 (docs/physics.md, eq. 9)."""
    delay_s: np.ndarray
    """Delay [s] of the wave that goes straight through the slab from face to face, which adds to the delay of the path's length;
    0 for a reflection."""

    @classmethod
    def none(cls) -> Elements:
        """No elements, as on the line of sight."""
        shapes: dict[str, Any] = {"normal": (0, 3)}
        kinds: dict[str, Any] = {"mirror": np.int64, "through": bool}
        names = [field.name for field in fields(cls)]
        return cls(**{name: np.zeros(shapes.get(name, 0), kinds.get(name, np.float64)) for name in names})

    @classmethod
    def stacked(cls, paths: Sequence[Elements]) -> Elements:
        """The elements of P paths, which must have the same number n of elements each, as arrays (P, n)."""
        return cls(**{field.name: np.array([getattr(path, field.name) for path in paths]) for field in fields(cls)})

    def taken(self, index: Any) -> Elements:
        """The elements at an index of the arrays' leading axes."""
        return Elements(**{field.name: getattr(self, field.name)[index] for field in fields(self)})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OneWayPath(_Compared):
    """A path over a chain of plane reflectors and through slabs, described as a straight path from the antenna's image.

    From the antenna, a target at x appears at `mirror_matrix @ x + shift_m`, as far from the antenna as x is from the image. If the
    radar moves, positions are given in the frame in which it stands still, together with the times at which they hold; the mirrors,
    the matrix and the shift are those of the scene.
    """

    chain: tuple[str, ...]
    """Names of the reflectors, and of slabs "(through)", from the antenna on; () is the line of sight."""
    antenna_m: np.ndarray
    """Position of the antenna [m], (3,)."""
    polarization: np.ndarray
    """Unit vector of the antenna's linear polarisation, (3,)."""
    elements: Elements
    """The mirrors and slabs of the chain, arrays (n,)."""
    image_m: np.ndarray
    """Image of the antenna in the mirrors of the chain [m], (3,)."""
    mirror_matrix: np.ndarray
    """(3, 3), orthogonal; its determinant is -1 for an odd number of mirrors."""
    shift_m: np.ndarray
    """Translation of the mirror image [m], (3,)."""
    passing: Passing | None = None
    """Motion of the scene relative to a radar that moves; the image is then at `place_m`. None if the radar stands still."""

    @classmethod
    def line_of_sight(
        cls, antenna_m: np.ndarray, polarization: np.ndarray, passing: Passing | None = None
    ) -> OneWayPath:
        """The direct path, over no mirrors and slabs."""
        return cls(
            chain=(),
            antenna_m=antenna_m,
            polarization=polarization,
            elements=Elements.none(),
            image_m=antenna_m,
            mirror_matrix=np.eye(3),
            shift_m=np.zeros(3),
            passing=passing,
        )

    @property
    def key(self) -> PathKey:
        """Identity of the path: equal for one-way paths over the same chain to the same antenna position."""
        return self.chain, self.image_m.tobytes()

    @property
    def course(self) -> Hashable:
        """Geometry of the path: equal for paths from the same antenna over the same planes, whatever surfaces lie in these."""
        numbers = self.antenna_m, self.elements.normal, self.elements.offset_m, self.elements.through
        return tuple(np.concatenate([values.ravel() for values in numbers]).tolist())

    @property
    def planes(self) -> list[tuple[np.ndarray, float]]:
        """Unit normal (3,) and offset [m] of each plane on the path, from the antenna on."""
        return list(zip(self.elements.normal, self.elements.offset_m.tolist(), strict=True))

    @property
    def transmissions(self) -> int:
        """Number of slabs on the path."""
        return int(np.count_nonzero(self.elements.through))

    @property
    def delay_s(self) -> float:
        """Delay that the slabs on the path add [s]."""
        return float(sum(self.elements.delay_s.tolist()))

    @property
    def order(self) -> int:
        """Number of reflections on the path; 0 for the line of sight."""
        return len(self.chain) - self.transmissions

    @property
    def name(self) -> str:
        """Name of the path from the antenna on: "direct", "floor", "door (through) > floor"."""
        return " > ".join(self.chain) or "direct"

    def unfolded(self, points: np.ndarray, times_s: np.ndarray | None = None) -> np.ndarray:
        """Apparent positions of points (..., 3) m as seen from the antenna [m]; for a radar that moves, of points (K, ..., 3) at
        times (K,)."""
        if self.passing is None:
            return points @ self.mirror_matrix.T + self.shift_m
        passing = passed(self.passing, times_s)
        return passing.points(passing.back.points(points) @ self.mirror_matrix.T + self.shift_m)

    def place_m(self, times_s: np.ndarray | None = None) -> np.ndarray:
        """Position of the antenna's image [m], (3,); (K, 3) at times (K,) for a radar that moves, if the path has mirrors."""
        if self.passing is None or not self.order:
            return self.image_m
        return passed(self.passing, times_s).points(self.in_scene(times_s).image_m)

    def seen_at(self, times_s: np.ndarray) -> list[OneWayPath]:
        """The path with its mirrors in the frame in which a moving radar stands still, one for each of the times (K,) [s]; a single
        path where it does not change."""
        if self.passing is None:
            return [self]
        if not self.chain:
            return [replace(self, passing=None)]
        passing, elements, paths = passed(self.passing, times_s), self.elements, []
        for rotation, shift_m, image_m in zip(
            *passing, np.broadcast_to(self.place_m(times_s), (len(times_s), 3)), strict=True
        ):
            normal, matrix = elements.normal @ rotation.T, rotation @ self.mirror_matrix @ rotation.T
            there = replace(elements, normal=normal, offset_m=elements.offset_m + normal @ shift_m)
            shift_m = shift_m + rotation @ self.shift_m - matrix @ shift_m
            paths.append(
                replace(self, elements=there, image_m=image_m, mirror_matrix=matrix, shift_m=shift_m, passing=None)
            )
        return paths

    def in_scene(self, times_s: np.ndarray | None, axes: int = 2) -> OneWayPath:
        """The same path in the coordinates of the scene at times (K,). Positions get the shape (K, 1, ..., 1, 3) with `axes` axes,
        so that they broadcast with points (K, ..., 3)."""
        if self.passing is None:
            return self
        back = passed(self.passing, times_s).back
        shape = (len(back.shift_m), *[1] * (axes - 2), 3)
        antenna_m = back.points(np.broadcast_to(self.antenna_m, shape))
        return replace(
            self,
            antenna_m=antenna_m,
            polarization=back.directions(np.broadcast_to(self.polarization, shape)),
            image_m=(antenna_m - self.shift_m) @ self.mirror_matrix,
            passing=None,
        )

    def __hash__(self) -> int:
        return hash(self.key)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathSet(_Compared):
    """The P one-way paths between an antenna and its targets, of up to L elements each, as padded arrays.

    These functions evaluate it: `path_fields.field_over`, and in `propagation` `images.vertices`, `images.existing` and
    `SceneBlockage.fraction`.
    """

    antenna_m: np.ndarray
    """Position of the antenna [m], (3,)."""
    polarization: np.ndarray
    """Unit vector of the antenna's linear polarisation, (3,)."""
    chains: tuple[tuple[str, ...], ...]
    """Names of the mirrors and slabs of each path, as in `OneWayPath.chain`."""
    mask: np.ndarray
    """Which elements exist, bool (P, L); those of a path come first, from the antenna on."""
    elements: Elements
    """The elements, arrays (P, L); padding where the mask is False."""
    image_m: np.ndarray
    """Images of the antenna [m], (P, 3)."""
    mirror_matrix: np.ndarray
    """Mirror matrices (P, 3, 3), as `OneWayPath.mirror_matrix`."""
    shift_m: np.ndarray
    """Translations of the mirror images [m], (P, 3)."""
    passing: Passing | None = None
    """Motion of the scene relative to a radar that moves; None if it stands still."""

    def __len__(self) -> int:
        return len(self.chains)

    def __getitem__(self, number: int) -> OneWayPath:
        chain = self.chains[number]
        return OneWayPath(
            chain=chain,
            antenna_m=self.antenna_m,
            polarization=self.polarization,
            elements=self.elements.taken((number, slice(len(chain)))),
            image_m=self.image_m[number],
            mirror_matrix=self.mirror_matrix[number],
            shift_m=self.shift_m[number],
            passing=self.passing,
        )

    def __iter__(self) -> Iterator[OneWayPath]:
        return (self[number] for number in range(len(self)))

    def taken(self, numbers: np.ndarray) -> PathSet:
        """Some of the paths, chosen by indices or a mask, with no more padding than these need."""
        numbers = np.arange(len(self))[numbers]
        longest = int(self.mask[numbers].sum(axis=1).max(initial=0))
        return replace(
            self,
            chains=tuple(self.chains[number] for number in numbers.tolist()),
            mask=self.mask[numbers, :longest],
            elements=self.elements.taken((numbers, slice(longest))),
            image_m=self.image_m[numbers],
            mirror_matrix=self.mirror_matrix[numbers],
            shift_m=self.shift_m[numbers],
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PathPair:
    """The round trip: out over one one-way path and back over another."""

    out: OneWayPath
    back: OneWayPath
    copies: int = 1
    """Number of path pairs that this one stands for: 2 if it also stands for the same paths in the other order."""

    @property
    def order(self) -> int:
        """Number of reflections on both one-way paths."""
        return self.out.order + self.back.order

    @property
    def transmissions(self) -> int:
        """Number of slabs on both one-way paths."""
        return self.out.transmissions + self.back.transmissions

    @property
    def delay_s(self) -> float:
        """Delay that the slabs on both one-way paths add [s]."""
        return self.out.delay_s + self.back.delay_s

    @property
    def name(self) -> str:
        """Name of the pair: "direct", "floor" for the same path out and back, "direct, floor" for different ones."""
        return self.out.name if self.out.chain == self.back.chain else f"{self.out.name}, {self.back.name}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StaticPath(_Compared):
    """A path from the transmitters' centre over mirrors to the receivers', without a target. For a radar that moves, positions and
    vectors are given at T times, (T, 3) each."""

    path: OneWayPath
    """The path from the transmitters to `stops_m[-1]`."""
    stops_m: np.ndarray
    """Vertices of the path in the scene [m]: transmitters, reflections, receivers, (order + 2, 3)."""
    departure_m: np.ndarray
    """Apparent position of the receivers as seen from the transmitters [m], (3,)."""
    taken: np.ndarray
    """Unit vector of the receivers' polarisation transverse to the path, in the scene, (3,): the field is projected on it."""
    arrival_m: np.ndarray
    """Apparent position of the transmitters as seen from the receivers [m], (3,)."""
    at: Callable[[np.ndarray], StaticPath] | None = None
    """Function that gives the path at times [s] (T,), for a radar that moves; else None."""
    fraction: np.ndarray | None = None
    """Fraction of its field at sample times, (S,), for a path that exists only at some of them; None: it always exists."""

    @property
    def name(self) -> str:
        """Name of the path: "wall+y > floor"."""
        return self.path.name
