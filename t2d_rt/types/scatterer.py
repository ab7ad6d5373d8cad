"""`Scatterer`: part of a target or of the scene that returns echoes, computed for one block of surface frames at a time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any

import numpy as np
from typing_extensions import override

from t2d_rt.core.checks import array, call, check_shape, instance, integer
from t2d_rt.core.factored_cubes import ProductRows
from t2d_rt.types.echoes import EchoArrays, Echoes, Repetition
from t2d_rt.types.ellipsoids import Ellipsoids
from t2d_rt.types.mesh import MovingMesh

Fraction = Callable[[np.ndarray], np.ndarray]
"""Function that gives a fraction: the amplitude of the field that arrives, relative to that with nothing in the way, (K, N) at
times [s] (K,). 0 is dark, 1 unobstructed, and up to some 1.4 occur beside an edge. Scatterers that need the same fraction hold the
same object, so that it is computed once."""


@dataclass(frozen=True, slots=True)
class FrameBlock:
    """Consecutive surface frames of a record, for which echoes are computed at once."""

    record_s: np.ndarray
    """Times of all frames of the record [s], (T,)."""
    first: int
    last: int
    """Index of the frame after the last one of the block."""

    @property
    def times_s(self) -> np.ndarray:
        """Times of the frames of the block [s], (K,)."""
        return self.record_s[self.first : self.last]

    def wider(self, frames: int) -> np.ndarray:
        """Times [s] of the block's frames and of `frames` more on either side, as far as the record goes."""
        return self.record_s[max(0, self.first - frames) : self.last + frames]


@dataclass(frozen=True, slots=True, kw_only=True)
class EchoLabels:
    """Where each of N echoes comes from; constant in time."""

    target: np.ndarray
    """Index of the target, (N,); -1 for the static scene, and for ray tubes between several surfaces."""
    face: np.ndarray
    """Index of the face of the target's mesh, (N,); -1 for none."""
    ellipsoid: np.ndarray
    """Index of the ellipsoid, (N,); -1 for none."""
    path: np.ndarray
    """Name of the path pair, (N,)."""
    bounces: np.ndarray
    """Number of bounces off targets, (N,)."""

    @classmethod
    def of(
        cls,
        count: int,
        *,
        target: Any = -1,
        face: Any = -1,
        ellipsoid: Any = -1,
        path: Any = "direct",
        bounces: Any = 1,
    ) -> EchoLabels:
        """Labels of `count` echoes; each value is one for all of them, or (N,)."""
        values = {"target": target, "face": face, "ellipsoid": ellipsoid, "bounces": bounces}
        numbers = {name: np.broadcast_to(value, count).astype(np.int32) for name, value in values.items()}
        return cls(path=np.broadcast_to(np.asarray(path, object), count), **numbers)

    @classmethod
    def joined(cls, labels: Iterable[EchoLabels]) -> EchoLabels:
        """Labels of all echoes, one group after the other."""
        parts = list(labels)
        return cls(**{item.name: np.concatenate([getattr(part, item.name) for part in parts]) for item in fields(cls)})


@dataclass(frozen=True, slots=True)
class EchoParts:
    """Which part of a recording each of N echoes belongs to, so that parts that are summed separately add up to the whole."""

    number: np.ndarray
    """Index of the part, (N,); -1 for an echo that is left out of the sum, though it is grouped with the others."""
    rows: Sequence[ProductRows] = ()
    """Rows of the cube of each part, to which its echoes are added. Without them, all echoes that are not left out form one
    part."""

    @property
    def count(self) -> int:
        """Number of parts."""
        return max(1, len(self.rows))


Poses = Mapping[int, Any]
"""Poses of the targets at the frames of a block by the targets' indices: vertices (K, V, 3) m of meshes, centres and axes of
ellipsoids."""
Visibility = Mapping[Fraction, np.ndarray]
"""Values (K, N) of each fraction at the frames of a block."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scatterer(ABC):
    """What returns the same set of echoes in every block: facets, ellipsoids, ray tubes, the static scene.

    The loop of a simulation calls `scatter`. `frames` computes echoes outside of that loop.
    """

    times_s: np.ndarray
    """Times of the surface frames of the record [s], uniform, (T,)."""
    echoes: int
    """Number of echoes in each frame."""
    vertices: int = 0
    """Number of vertices in each frame from which the echoes are computed."""
    at_once: int = 0
    """Greatest number of frames that may be computed at once, where this takes much memory; 0: any number."""
    repeats: Repetition | None = None
    """For a periodic target, how this record of a few periods stands for a longer one; else None."""

    reach = 0
    """Number of frames on either side of a block at which its fractions must also be known."""

    @property
    def parts(self) -> tuple[Scatterer, ...]:
        """Scatterers with fewer echoes each that together return the same echoes."""
        return (self,)

    @property
    def targets(self) -> Mapping[int, MovingMesh | Ellipsoids]:
        """The targets whose poses it needs, by their indices."""
        return {}

    @property
    def fractions(self) -> Iterable[Fraction]:
        """The fractions that it needs at the frames of a block."""
        return ()

    @property
    def labels(self) -> EchoLabels:
        """Where its echoes come from."""
        return EchoLabels.of(self.echoes)

    @abstractmethod
    def scatter(self, block: FrameBlock, poses: Poses, seen: Visibility) -> EchoArrays:
        """Echoes of the scatterer at the frames of a block."""

    def frames(self, first: int, last: int) -> EchoArrays:
        """Echoes of this scatterer alone at frames first..last - 1."""
        block = FrameBlock(self.times_s, first, last)
        return self.scatter(block, pose(self.parts, block), visibility(self.parts, block))

    def gather(self) -> Echoes:
        """Echoes at all frames at once, for short records."""
        return Echoes(times_s=self.times_s, **self.frames(0, len(self.times_s))._asdict())


@dataclass(frozen=True, kw_only=True, eq=False)
class EchoStream(Scatterer):
    """A user's own echoes, computed block by block when they are needed, so that memory does not grow with duration."""

    frames: Callable[[int, int], EchoArrays] = field()  # type: ignore[assignment]
    """`frames(start, stop)` gives the arrays of `Echoes` for frames start..stop-1; every call has the same echoes in the same
    order."""
    echoes: int = 0
    """Number of echoes, where it is known in advance."""

    def __post_init__(self) -> None:
        call("frames", self.frames, "a function from the first frame and the one after the last to their EchoArrays")
        check_shape("times_s of echoes", array("times_s of echoes", self.times_s), ("time",))
        integer("vertices", self.vertices)

    @override
    def scatter(self, block: FrameBlock, poses: Poses, seen: Visibility) -> EchoArrays:
        return EchoArrays(*self.frames(block.first, block.last))


def stream(echoes: Echoes | Scatterer) -> Scatterer:
    """`echoes` as a scatterer."""
    instance("echoes", echoes, (Echoes, Scatterer), "Echoes or an EchoStream")
    if isinstance(echoes, Scatterer):
        return echoes
    return EchoStream(times_s=echoes.times_s, frames=partial(_frames_of, echoes), echoes=echoes.delay_s.shape[1])


def _frames_of(echoes: Echoes, start: int, stop: int) -> EchoArrays:
    """The arrays of echoes at frames start..stop - 1."""
    values = (getattr(echoes, name) for name in EchoArrays._fields)
    return EchoArrays(*(None if value is None else value[start:stop] for value in values))  # type: ignore[arg-type]


def pose(scatterers: Iterable[Scatterer], block: FrameBlock) -> Poses:
    """Poses, in a block, of all targets that the scatterers need; each target is posed once."""
    targets = {number: target for scatterer in scatterers for number, target in scatterer.targets.items()}
    return {number: target.at(block.times_s) for number, target in targets.items()}


def visibility(scatterers: Iterable[Scatterer], block: FrameBlock) -> Visibility:
    """Values, in a block, of all fractions that the scatterers need; each is computed once."""
    reach: dict[Fraction, int] = {}
    for scatterer in scatterers:
        for fraction in scatterer.fractions:
            if reach.setdefault(fraction, scatterer.reach) != scatterer.reach:
                raise ValueError("scatterers of different reach need fractions of their own")
    return {fraction: fraction(block.wider(frames)) for fraction, frames in reach.items()}
