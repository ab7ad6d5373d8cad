"""Paths as data: `PathSet` of one antenna, `OneWayPath`, one of these, `PathPair` of two, and `StaticPath` between antennas."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from t2d_rt.types.radar_track import Rigid

Passing = Callable[[np.ndarray], Rigid]
"""How the scene stands at times [s] (K,) to a radar that moves, in the frame in which that keeps its place (`Radar.passing`)."""
PathKey = tuple[tuple[str, ...], bytes]
"""A chain of mirrors, and the image of the antenna in them."""


def passed(passing: Passing, times_s: np.ndarray | None) -> Rigid:
    """How the scene stands at the times (K,) that whoever asks of a radar that moves must tell."""
    if times_s is None:
        raise ValueError("paths to a radar that moves are known at given times alone")
    return passing(times_s)


def points_in_scene(passing: Passing | None, points: np.ndarray, times_s: np.ndarray | None) -> np.ndarray:
    """Points (K, ..., 3) m as a radar sees them at times (K,), in the coordinates of the scene; the same where it stands still."""
    return points if passing is None else passed(passing, times_s).back.points(points)


class _Compared:
    """A dataclass whose values are equal where all of their fields are, arrays element by element."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return False
        pairs = ((getattr(self, field.name), getattr(other, field.name)) for field in fields(self))  # type: ignore[arg-type]
        return all(np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b for a, b in pairs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Elements(_Compared):
    """Mirrors and slabs that paths meet, from the antenna on: arrays (n,) for one path, (P, L) for P paths of up to L elements."""

    mirror: np.ndarray
    """Numbers of the mirrors in the scene."""
    through: np.ndarray
    """Whether the path passes through, bool; otherwise it is reflected."""
    normal: np.ndarray
    """Unit normals of the planes, (..., 3)."""
    offset_m: np.ndarray
    """normal . x of the planes' points."""
    relative_permittivity: np.ndarray
    """Real part; inf for a perfect conductor."""
    conductivity_s_per_m: np.ndarray
    thickness_m: np.ndarray
    specular: np.ndarray
    """Fraction of the reflected field that a rough surface does not scatter, 0..1 (docs/physics.md, eq. 9)."""
    delay_s: np.ndarray
    """Delay of the transmitted wave, straight on from face to face; 0 for a reflection."""

    @classmethod
    def none(cls) -> Elements:
        """The elements of the line of sight, none."""
        shapes: dict[str, Any] = {"normal": (0, 3)}
        kinds: dict[str, Any] = {"mirror": np.int64, "through": bool}
        names = [field.name for field in fields(cls)]
        return cls(**{name: np.zeros(shapes.get(name, 0), kinds.get(name, np.float64)) for name in names})

    @classmethod
    def stacked(cls, paths: Sequence[Elements]) -> Elements:
        """Elements of P paths of as many elements each, (P, n)."""
        return cls(**{field.name: np.array([getattr(path, field.name) for path in paths]) for field in fields(cls)})

    def taken(self, index: Any) -> Elements:
        """Elements at an index of the arrays' leading axes."""
        return Elements(**{field.name: getattr(self, field.name)[index] for field in fields(self)})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OneWayPath(_Compared):
    """The path over a chain of plane reflectors and through slabs, as if it came straight from the antenna's image.

    From the antenna, a target at x appears at `mirror_matrix @ x + shift_m`, as far from the antenna as x is from the image. Of a
    radar that moves all places are given as it sees them, in the frame in which it stands still, and with the times at which it
    does; the mirrors, the matrix and the shift are those of the scene.
    """

    chain: tuple[str, ...]
    """Names of the reflectors, and of slabs "(through)", from the antenna on; () is the line of sight."""
    antenna_m: np.ndarray
    """(3,)."""
    polarization: np.ndarray
    """Unit vector of the antenna's linear polarisation, (3,)."""
    elements: Elements
    """What the chain consists of, arrays (n,)."""
    image_m: np.ndarray
    """(3,)."""
    mirror_matrix: np.ndarray
    """(3, 3), orthogonal; its determinant is -1 for an odd number of mirrors."""
    shift_m: np.ndarray
    """(3,)."""
    passing: Passing | None = None
    """How the world passes a radar that moves; its image then stands in `place_m`."""

    @classmethod
    def line_of_sight(
        cls, antenna_m: np.ndarray, polarization: np.ndarray, passing: Passing | None = None
    ) -> OneWayPath:
        """The path over no mirrors."""
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
        """The same for one-way paths over the same chain to the same antenna; antennas apart have paths of their own."""
        return self.chain, self.image_m.tobytes()

    @property
    def planes(self) -> list[tuple[np.ndarray, float]]:
        """Unit normal (3,) and offset [m] of each plane that is met, from the antenna on."""
        return list(zip(self.elements.normal, self.elements.offset_m.tolist(), strict=True))

    @property
    def transmissions(self) -> int:
        """Number of slabs on the path."""
        return int(np.count_nonzero(self.elements.through))

    @property
    def delay_s(self) -> float:
        """Delay that these add [s]."""
        return float(sum(self.elements.delay_s.tolist()))

    @property
    def order(self) -> int:
        """Number of reflections on the path; 0 for the line of sight."""
        return len(self.chain) - self.transmissions

    @property
    def name(self) -> str:
        """Name for people, from the antenna on: "direct", "floor", "door (through) > floor"."""
        return " > ".join(self.chain) or "direct"

    def unfolded(self, points: np.ndarray, times_s: np.ndarray | None = None) -> np.ndarray:
        """Apparent positions of points (..., 3) as seen from the antenna [m]; (K, ..., 3) at times (K,) for one that moves."""
        if self.passing is None:
            return points @ self.mirror_matrix.T + self.shift_m
        passing = passed(self.passing, times_s)
        return passing.points(passing.back.points(points) @ self.mirror_matrix.T + self.shift_m)

    def place_m(self, times_s: np.ndarray | None = None) -> np.ndarray:
        """The image (3,) m; (K, 3) at times (K,) for an antenna that moves and is seen in mirrors."""
        if self.passing is None or not self.order:
            return self.image_m
        return passed(self.passing, times_s).points(self.in_scene(times_s).image_m)

    def seen_at(self, times_s: np.ndarray) -> list[OneWayPath]:
        """The path and its mirrors as a radar that moves sees them at each of times (K,) [s]; once, where they are the same."""
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
        """The same path in the coordinates of the scene at times (K,). Places have shape (K, 1, ..., 1, 3), of `axes` axes, to
        stand beside points (K, ..., 3)."""
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
    """The P one-way paths between an antenna and its targets, of up to L elements, as padded arrays.

    Functions evaluate it: `path_fields.field_over`, and in `propagation` `images.vertices`, `images.existing` and
    `SceneBlockage.fraction`.
    """

    antenna_m: np.ndarray
    """(3,)."""
    polarization: np.ndarray
    """Unit vector of the antenna's linear polarisation, (3,)."""
    chains: tuple[tuple[str, ...], ...]
    """Names of what each path meets, as `OneWayPath.chain`."""
    mask: np.ndarray
    """Which elements there are, bool (P, L); those of a path come first, from the antenna on."""
    elements: Elements
    """Arrays (P, L); where there is no element they mean nothing."""
    image_m: np.ndarray
    """(P, 3)."""
    mirror_matrix: np.ndarray
    """(P, 3, 3)."""
    shift_m: np.ndarray
    """(P, 3)."""
    passing: Passing | None = None
    """How the world passes a radar that moves."""

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
        """Some of the paths, by their numbers or a mask, padded no more than these need."""
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
    """2 where back and out may be swapped and both are meant."""

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
        """Delay that these add [s]."""
        return self.out.delay_s + self.back.delay_s

    @property
    def name(self) -> str:
        """Name for people: "direct", "floor" for the same path out and back, "direct, floor"."""
        return self.out.name if self.out.chain == self.back.chain else f"{self.out.name}, {self.back.name}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StaticPath(_Compared):
    """A path from the transmitters' centre over mirrors to the receivers'; of a radar that moves at T times, (T, 3) each."""

    path: OneWayPath
    """The path from the transmitters to `stops_m[-1]`."""
    stops_m: np.ndarray
    """Transmitters, reflections, receivers in the scene, (order + 2, 3)."""
    departure_m: np.ndarray
    """Apparent position of the receivers as seen from the transmitters, (3,)."""
    taken: np.ndarray
    """Unit vector of the receivers' polarisation across the path where it arrives in the scene, (3,)."""
    arrival_m: np.ndarray
    """Apparent position of the transmitters as seen from the receivers, (3,)."""
    at: Callable[[np.ndarray], StaticPath] | None = None
    """The path at times [s] (T,), for a radar that moves."""
    fraction: np.ndarray | None = None
    """Fraction of its field at sample times, as the path exists or does not, (S,); None: it always exists."""

    @property
    def name(self) -> str:
        """Name for people: "wall+y > floor"."""
        return self.path.name
