"""A skeleton of unknown joints in time, with what follows from it: bone lengths, names, ancestors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from t2d_rt.motion.match.words import Label, label

COINCIDENT = 1e-3
"""Joints closer than this part of the skeleton's size are one point."""


@dataclass(frozen=True)
class Tree:
    """Joints with their parents (before their children) and positions in some frames."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    positions: np.ndarray
    """(T, N, 3), in any unit and axes."""

    @cached_property
    def children(self) -> list[list[int]]:
        """Children of each joint."""
        found: list[list[int]] = [[] for _ in self.names]
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                found[parent].append(joint)
        return found

    @cached_property
    def labels(self) -> list[Label]:
        """What each name says."""
        return [label(name) for name in self.names]

    @cached_property
    def bones(self) -> np.ndarray:
        """Median distance of each joint from its parent, (N,)."""
        above = np.maximum(self.parents, 0)
        return np.asarray(np.median(np.linalg.norm(self.positions - self.positions[:, above], axis=-1), axis=0))

    @cached_property
    def size(self) -> float:
        """Median over the frames of the largest distance of a joint from the middle of all."""
        middle = self.positions.mean(axis=1, keepdims=True)
        return float(np.median(np.linalg.norm(self.positions - middle, axis=-1).max(axis=1)))

    def distance(self, first: int, second: int) -> float:
        """Median distance of two joints."""
        return float(np.median(np.linalg.norm(self.positions[:, first] - self.positions[:, second], axis=-1)))

    def together(self, first: int, second: int) -> bool:
        """Are two joints one point?"""
        return self.distance(first, second) <= COINCIDENT * self.size

    def above(self, joint: int) -> Iterator[int]:
        """A joint and its ancestors, up to the root."""
        while joint >= 0:
            yield joint
            joint = self.parents[joint]

    def below(self, joint: int, depth: int, most: int) -> list[int]:
        """A joint and those below it, breadth first: `depth` generations and `most` joints at most."""
        found, generation = [joint], [joint]
        for _ in range(depth):
            generation = [child for each in generation for child in self.children[each]]
            found += generation
            if not generation or len(found) >= most:
                break
        return found[:most]

    def path(self, first: int, last: int) -> list[int]:
        """Joints from the first to the last along the bones, both included."""
        up, down = list(self.above(first)), list(self.above(last))
        shared = next(joint for joint in up if joint in set(down))
        return up[: up.index(shared) + 1] + down[: down.index(shared)][::-1]

    def middle(self, joints: Sequence[int]) -> np.ndarray:
        """Mean of some joints, (T, 3)."""
        return np.asarray(self.positions[:, list(joints)].mean(axis=1))
