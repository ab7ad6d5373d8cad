"""`Scatterer`: what returns echoes, block by block of surface frames."""

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
"""What arrives of a field, its amplitude over that with nothing in the way, (K, N) at times [s] (K,): 0 in the dark, 1 in the open
and up to some 1.4 beside an edge. Scatterers that need the same one hold the same object."""


@dataclass(frozen=True, slots=True)
class FrameBlock:
    """Some surface frames of a record that follow one another."""

    record_s: np.ndarray
    """All frames of the record [s]."""
    first: int
    last: int
    """The one after the last frame of the block."""

    @property
    def times_s(self) -> np.ndarray:
        """Frames of the block [s] (K,)."""
        return self.record_s[self.first : self.last]

    def wider(self, frames: int) -> np.ndarray:
        """Its frames and so many on either side, as far as the record goes [s]."""
        return self.record_s[max(0, self.first - frames) : self.last + frames]


@dataclass(frozen=True, slots=True, kw_only=True)
class EchoLabels:
    """Where each of N echoes comes from; the same at all times."""

    target: np.ndarray
    """Number of the target, (N,); -1 is the static scene, or ray tubes between several surfaces."""
    face: np.ndarray
    """Number of the face of the target's mesh, (N,); -1 is none."""
    ellipsoid: np.ndarray
    """Number of its ellipsoid, (N,); -1 is none."""
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
        """Labels of so many echoes; each value is one for all of them or (N,)."""
        values = {"target": target, "face": face, "ellipsoid": ellipsoid, "bounces": bounces}
        numbers = {name: np.broadcast_to(value, count).astype(np.int32) for name, value in values.items()}
        return cls(path=np.broadcast_to(np.asarray(path, object), count), **numbers)

    @classmethod
    def joined(cls, labels: Iterable[EchoLabels]) -> EchoLabels:
        """Labels of different echoes, one after the other."""
        parts = list(labels)
        return cls(**{item.name: np.concatenate([getattr(part, item.name) for part in parts]) for item in fields(cls)})


@dataclass(frozen=True, slots=True)
class EchoParts:
    """Which part of a recording each of N echoes belongs to, so that parts that are summed apart add up to the whole."""

    number: np.ndarray
    """Number of the part, (N,); -1 is none of them: the echo is grouped with the others but is silent."""
    rows: Sequence[ProductRows] = ()
    """What each part returns is added to those of one cube; without them all that is not silent is one part."""

    @property
    def count(self) -> int:
        """How many parts there are."""
        return max(1, len(self.rows))


Poses = Mapping[int, Any]
"""Targets by their numbers at the frames of a block: vertices (K, V, 3) m of meshes, centres and axes of ellipsoids."""
Visibility = Mapping[Fraction, np.ndarray]
"""Fractions at the frames of a block."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scatterer(ABC):
    """What returns the same echoes in every block: facets, ellipsoids, ray tubes, the static scene.

    `scatter` is all that the loop of a simulation asks of it. A scatterer may be asked outside of that loop, too (`frames`).
    """

    times_s: np.ndarray
    """Surface frames of the record [s], uniform (T,)."""
    echoes: int
    """Number of echoes at each frame."""
    vertices: int = 0
    """Number of vertices from which these are made at each frame."""
    at_once: int = 0
    """How many frames it may be asked for at once, where what they are made from takes much memory; 0: any number."""
    repeats: Repetition | None = None
    """How the record repeats, where it stands for a longer one."""

    reach = 0
    """Frames on either side of a block at which it must know its fractions, too."""

    @property
    def parts(self) -> tuple[Scatterer, ...]:
        """Scatterers of fewer echoes each that return the same echoes together."""
        return (self,)

    @property
    def targets(self) -> Mapping[int, MovingMesh | Ellipsoids]:
        """The targets whose poses it needs, by their numbers."""
        return {}

    @property
    def fractions(self) -> Iterable[Fraction]:
        """The fractions that it needs."""
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
    """Echoes of one's own that are made when they are asked for, so that memory does not grow with duration."""

    frames: Callable[[int, int], EchoArrays] = field()  # type: ignore[assignment]
    """`frames(start, stop)`: the arrays of `Echoes` for frames start..stop-1; the echoes are the same ones in every call."""
    echoes: int = 0
    """Number of echoes, where it is known beforehand."""

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
    """Echoes at frames start..stop - 1."""
    values = (getattr(echoes, name) for name in EchoArrays._fields)
    return EchoArrays(*(None if value is None else value[start:stop] for value in values))  # type: ignore[arg-type]


def pose(scatterers: Iterable[Scatterer], block: FrameBlock) -> Poses:
    """All targets that the scatterers need, each posed once."""
    targets = {number: target for scatterer in scatterers for number, target in scatterer.targets.items()}
    return {number: target.at(block.times_s) for number, target in targets.items()}


def visibility(scatterers: Iterable[Scatterer], block: FrameBlock) -> Visibility:
    """All fractions that the scatterers need, each found once."""
    reach: dict[Fraction, int] = {}
    for scatterer in scatterers:
        for fraction in scatterer.fractions:
            if reach.setdefault(fraction, scatterer.reach) != scatterer.reach:
                raise ValueError("scatterers of different reach need fractions of their own")
    return {fraction: fraction(block.wider(frames)) for fraction, frames in reach.items()}
