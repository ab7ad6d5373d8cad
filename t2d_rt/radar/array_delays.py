"""Delays of echoes at each antenna of an array (its transmitters or its receivers), relative to the delay at the array's centre."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from t2d_rt.core.backend import Backend
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.geometry.vectors import dot
from t2d_rt.radar.windows import ApparentPositions, Delay, Window
from t2d_rt.types import Radar


def extra_length(line_of_sight: Any, step: Any, offset: Any, sqrt: Callable[[Any], Any]) -> Any:
    """Distance of points from an antenna minus that from the array's centre [m], and its change per step, without cancellation.

    `line_of_sight`: vector from the centre to the points; `step`: its change from frame to frame; `offset`: vector from the centre
    to the antenna. Three components each, NumPy or Dr.Jit.
    """
    squared = dot(line_of_sight, line_of_sight)
    more = dot(offset, offset) - 2 * dot(line_of_sight, offset)
    near, far = sqrt(squared), sqrt(squared + more)
    extra = more / (near + far)
    return extra, -(dot(line_of_sight, step) * extra / near + dot(offset, step)) / far


@dataclass(frozen=True, slots=True)
class End:
    """An array's transmitters or its receivers, and the apparent positions of echoes for them."""

    centre_m: np.ndarray
    offsets_m: np.ndarray
    """Offsets of the antennas from the array's centre [m], (antenna, 3)."""
    apparent: ApparentPositions | None
    """Apparent positions of the echoes; None where they are unknown: then all antennas have the centre's delay."""

    def extra_delays(self) -> list[Delay]:
        """Delay of the echoes at each antenna minus that at the centre, and its slope, float32."""
        if self.apparent is None:
            return [(np.zeros((1, 1), np.float32), np.zeros((1, 1), np.float32))] * len(self.offsets_m)
        line_of_sight = [
            points - np.float32(place) for points, place in zip(self.apparent.points_m, self.centre_m, strict=True)
        ]
        per_s = np.float32(1 / SPEED_OF_LIGHT)
        extras = (
            extra_length(line_of_sight, self.apparent.steps_m, offset_m, np.sqrt)
            for offset_m in self.offsets_m.astype(np.float32)
        )
        return [(extra * per_s, step * per_s) for extra, step in extras]

    def only(self, antennas: Sequence[int] | slice) -> End:
        """The same array with the chosen antennas only."""
        return replace(self, offsets_m=self.offsets_m[antennas])


def ends(window: Window, radar: Radar) -> tuple[End, End]:
    """The radar's transmitters, and its receivers, with the apparent positions of a window's echoes."""
    apparent = window.apparent or (None, None)
    return (
        End(radar.tx_position_m, radar.tx_positions_m - radar.tx_position_m, apparent[0]),
        End(radar.rx_position_m, radar.rx_positions_m - radar.rx_position_m, apparent[1]),
    )


@dataclass(frozen=True, slots=True)
class ArrayDelays:
    """Additional delays of an array's antennas, for the echoes on the device and for the groups into which they are merged."""

    end: End
    table: tuple[Any, Any] | None
    """Apparent positions [m] of the echoes and their steps [m per frame], flat float32 (echo, frame, 4) each; None where
    unknown."""
    groups: list[list[Delay]]
    """For each antenna and each level of groups, the additional delays of the groups' mean positions, to which those of their
    members are relative."""

    def __len__(self) -> int:
        return len(self.groups)

    def only(self, antennas: range) -> ArrayDelays:
        """The delays of the chosen antennas only."""
        chosen = slice(antennas.start, antennas.stop)
        return ArrayDelays(self.end.only(chosen), self.table, self.groups[chosen])


def array_delays(pair: tuple[End, End], means: list[Any], backend: Backend) -> tuple[ArrayDelays, ArrayDelays]:
    """Additional delays of transmitters and of receivers. `means`: sparse matrices that average each level's values over the groups
    of the next."""
    # Where transmitters and receivers are in one place, their apparent positions are the same and are computed once.
    same = pair[0].apparent is pair[1].apparent
    tables = [_table(end.apparent, backend) for end in pair[: 1 if same else 2]]
    return _of_end(pair[0], means, tables[0]), _of_end(pair[1], means, tables[-1])


def _of_end(end: End, means: list[Any], table: tuple[Any, Any] | None) -> ArrayDelays:
    """Additional delays of the antennas of one end for the groups of each level; their mean positions are averages over the level
    below."""
    of_levels, apparent = [], end.apparent
    for mean in means:
        apparent = None if apparent is None else apparent.mean(mean)
        of_levels.append(replace(end, apparent=apparent).extra_delays())
    return ArrayDelays(end, table, [list(of_antenna) for of_antenna in zip(*of_levels, strict=True)])


def _table(apparent: ApparentPositions | None, backend: Backend) -> tuple[Any, Any] | None:
    """Positions and steps of echoes in the layout that kernels read: four numbers at once, of which the last is unused."""
    if apparent is None:
        return None
    tables = []
    for values in (apparent.points_m, apparent.steps_m):
        packed = np.zeros((*values.shape[:0:-1], 4), np.float32)
        packed[..., :3] = values.T
        tables.append(backend.Float32(packed.ravel()))
    return tables[0], tables[1]
