"""Scatterers joined into one, or into batches that are summed one after another, and scatterers at other frame times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from typing_extensions import override

from t2d_rt.core.backend import in_threads
from t2d_rt.scattering.antennas import concatenated
from t2d_rt.types import EchoArrays, Radar
from t2d_rt.types.scatterer import EchoLabels, FrameBlock, Poses, Scatterer, Visibility

MOST_ECHOES = 150_000
"""Greatest number of echoes that are summed together, which in a window of frames take some 1 GB; more are summed in parts."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Joined(Scatterer):
    """Several scatterers with the same frame times, as one."""

    scatterers: tuple[Scatterer, ...]

    @property
    @override
    def parts(self) -> tuple[Scatterer, ...]:
        return tuple(part for scatterer in self.scatterers for part in scatterer.parts)

    @property
    @override
    def labels(self) -> EchoLabels:
        return EchoLabels.joined(part.labels for part in self.parts)

    @override
    def scatter(self, block: FrameBlock, poses: Poses, seen: Visibility) -> EchoArrays:
        echoes: list[EchoArrays | None] = [None] * len(self.scatterers)

        def scatter(number: int) -> None:
            echoes[number] = self.scatterers[number].scatter(block, poses, seen)

        in_threads(scatter, range(len(self.scatterers)))
        return concatenated([arrays for arrays in echoes if arrays is not None])


def joined(scatterers: Sequence[Scatterer]) -> Scatterer:
    """Scatterers as one; all must have the same frame times."""
    if len(scatterers) == 1:
        return scatterers[0]
    return Joined(
        times_s=scatterers[0].times_s,
        scatterers=tuple(scatterers),
        echoes=sum(scatterer.echoes for scatterer in scatterers),
        vertices=max(scatterer.vertices for scatterer in scatterers),
        at_once=min((scatterer.at_once for scatterer in scatterers if scatterer.at_once), default=0),
    )


def batches(scatterers: Sequence[Scatterer], radar: Radar) -> list[Scatterer]:
    """Joins scatterers, or their parts, of the same frame times in order into batches of at most `most_echoes` echoes each."""
    by_frames: dict[int, list[list[Scatterer]]] = {}
    for scatterer in scatterers:
        lots = by_frames.setdefault(len(scatterer.times_s), [])
        for part in scatterer.parts:
            if not lots or sum(member.echoes for member in lots[-1]) + part.echoes > most_echoes(radar):
                lots.append([])
            lots[-1].append(part)
    return [joined(batch) for lots in by_frames.values() for batch in lots]


def most_echoes(radar: Radar) -> int:
    """Greatest number of echoes that are summed together; it is half for an array, whose echoes hold their places, too."""
    return MOST_ECHOES // 2 if radar.is_array else MOST_ECHOES


@dataclass(frozen=True, kw_only=True, eq=False)
class Resampled(Scatterer):
    """A scatterer at other frame times of the same record, by cubics through four frames of its own."""

    source: Scatterer

    @property
    @override
    def labels(self) -> EchoLabels:
        return self.source.labels

    @classmethod
    def of(cls, source: Scatterer, times_s: np.ndarray) -> Resampled:
        """`source` at uniform times (T,) [s] over the same record."""
        return cls(times_s=times_s, source=source, echoes=source.echoes, vertices=source.vertices)

    @override
    def scatter(self, block: FrameBlock, poses: Poses, seen: Visibility) -> EchoArrays:
        count = len(self.source.times_s)
        places = np.linspace(0, count - 1, len(self.times_s))[block.first : block.last]
        begins = np.clip(places.astype(int) - 1, 0, count - 4)
        u = (places - begins)[:, None]
        weights = np.concatenate(
            [
                -(u - 1) * (u - 2) * (u - 3) / 6,
                u * (u - 2) * (u - 3) / 2,
                -u * (u - 1) * (u - 3) / 2,
                u * (u - 1) * (u - 2) / 6,
            ],
            axis=1,
        )
        first, last = int(begins[0]), int(begins[-1]) + 4
        matrix = np.zeros((len(places), last - first))
        matrix[np.arange(len(places))[:, None], (begins - first)[:, None] + np.arange(4)] = weights

        def between(held: np.ndarray) -> np.ndarray:
            flat = matrix.astype(held.dtype) @ held.reshape(len(held), -1)
            return np.asarray(flat.reshape(len(flat), *held.shape[1:]))

        held = self.source.frames(first, last)
        return EchoArrays(*(None if values is None else between(values) for values in held))  # type: ignore[arg-type]
