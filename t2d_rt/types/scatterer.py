"""`Scatterer`: what returns echoes, block by block of surface frames."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.types.echoes import EchoArrays, Echoes, EchoStream, Repetition
from t2d_rt.types.ellipsoids import Ellipsoids
from t2d_rt.types.mesh import MovingMesh

Fraction = Callable[[np.ndarray], np.ndarray]
"""Fraction of a field that arrives, 0..1 (K, N) at times [s] (K,); scatterers that need the same one hold the same object."""


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
        """Its frames [s] (K,)."""
        return self.record_s[self.first : self.last]

    def wider(self, frames: int) -> np.ndarray:
        """Its frames and so many on either side, as far as the record goes [s]."""
        return self.record_s[max(0, self.first - frames) : self.last + frames]


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
    """How many it returns at each frame."""
    vertices: int = 0
    """How many vertices these are made from at each frame."""
    at_once: int = 0
    """How many frames it may be asked for at once, where what they are made from takes much memory; 0: any number."""
    repeats: Repetition | None = None
    """Where its record stands for a longer one."""

    reach = 0
    """Frames on either side of a block at which it must know its fractions, too."""

    @property
    def parts(self) -> tuple[Scatterer, ...]:
        """The same echoes from several scatterers of fewer each, where there are many."""
        return (self,)

    @property
    def targets(self) -> Mapping[int, MovingMesh | Ellipsoids]:
        """The targets whose poses it needs, by their numbers."""
        return {}

    @property
    def fractions(self) -> Iterable[Fraction]:
        """The fractions that it needs."""
        return ()

    @abstractmethod
    def scatter(self, block: FrameBlock, poses: Poses, seen: Visibility) -> EchoArrays:
        """Its echoes at the frames of a block."""

    def frames(self, first: int, last: int) -> EchoArrays:
        """Its echoes at frames first..last - 1, by itself."""
        block = FrameBlock(self.times_s, first, last)
        return self.scatter(block, pose(self.parts, block), visibility(self.parts, block))

    def gather(self) -> Echoes:
        """Its echoes at all frames at once; for short records."""
        return Echoes(times_s=self.times_s, **self.frames(0, len(self.times_s))._asdict())

    def stream(self) -> EchoStream:
        """The same as a stream, for `synthesize`."""
        return EchoStream(
            times_s=self.times_s, frames=self.frames, vertices=self.vertices, echoes=self.echoes, at_once=self.at_once
        )


def pose(scatterers: Iterable[Scatterer], block: FrameBlock) -> Poses:
    """All targets that the scatterers need, each posed once."""
    targets = {number: target for each in scatterers for number, target in each.targets.items()}
    return {number: target.at(block.times_s) for number, target in targets.items()}


def visibility(scatterers: Iterable[Scatterer], block: FrameBlock) -> Visibility:
    """All fractions that the scatterers need, each found once."""
    reach = {fraction: each.reach for each in scatterers for fraction in each.fractions}
    return {fraction: fraction(block.wider(frames)) for fraction, frames in reach.items()}
