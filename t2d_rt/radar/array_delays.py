"""Ways from the antennas of an array's end, its transmitters or its receivers: by how much longer they are than from its centre."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from t2d_rt.backend import Backend
from t2d_rt.constants import SPEED_OF_LIGHT
from t2d_rt.geometry.vectors import dot
from t2d_rt.radar.windows import Delay, Sights, Window
from t2d_rt.types import Radar


def longer(sight: Any, step: Any, offset: Any, sqrt: Callable[[Any], Any]) -> Any:
    """By how much farther points are from an antenna than from its array's centre, and how that changes, without cancellation.

    `sight` is where the points stand as seen from the centre, `step` how that changes, `offset` where the antenna is: three
    numbers each, NumPy or Dr.Jit.
    """
    squared = dot(sight, sight)
    more = dot(offset, offset) - 2 * dot(sight, offset)
    near, far = sqrt(squared), sqrt(squared + more)
    way = more / (near + far)
    return way, -(dot(sight, step) * way / near + dot(offset, step)) / far


@dataclass(frozen=True, slots=True)
class End:
    """An array's transmitters or receivers, and where echoes seem to stand for them."""

    centre_m: np.ndarray
    offsets_m: np.ndarray
    """(antenna, 3)."""
    sights: Sights | None
    """None where nobody knows: then no way is longer."""

    def extra_delays(self) -> list[Delay]:
        """By how much each antenna's delays are longer than the centre's, float32."""
        if self.sights is None:
            return [(np.zeros((1, 1), np.float32), np.zeros((1, 1), np.float32))] * len(self.offsets_m)
        sight = [points - np.float32(place) for points, place in zip(self.sights.points_m, self.centre_m, strict=True)]
        per_s = np.float32(1 / SPEED_OF_LIGHT)
        ways = (longer(sight, self.sights.steps_m, each, np.sqrt) for each in self.offsets_m.astype(np.float32))
        return [(way * per_s, step * per_s) for way, step in ways]

    def some(self, antennas: Sequence[int] | slice) -> End:
        """Those antennas only."""
        return replace(self, offsets_m=self.offsets_m[antennas])


def ends(window: Window, radar: Radar) -> tuple[End, End]:
    """Transmitters and receivers."""
    sights = window.sights or (None, None)
    return (
        End(radar.tx_position_m, radar.tx_positions_m - radar.tx_position_m, sights[0]),
        End(radar.rx_position_m, radar.rx_positions_m - radar.rx_position_m, sights[1]),
    )


@dataclass(frozen=True, slots=True)
class Ways:
    """An end's, for echoes on the device and for the groups that they are merged to."""

    end: End
    table: tuple[Any, Any] | None
    """The echoes' points [m] and steps [m per frame]: flat float32 (echo, frame, 4)."""
    groups: list[list[Delay]]
    """Of each antenna and level: that of its groups' mean points, from which their members' are counted."""

    def __len__(self) -> int:
        return len(self.groups)

    def some(self, antennas: range) -> Ways:
        """Those antennas only."""
        chosen = slice(antennas.start, antennas.stop)
        return Ways(self.end.some(chosen), self.table, self.groups[chosen])


def ways(pair: tuple[End, End], means: list[Any], backend: Backend) -> tuple[Ways, Ways]:
    """Of both ends; `means`: sparse, from each level's values to the means of the groups of the next."""
    # Where transmitters and receivers stand in one place, echoes do so for both.
    shared = pair[0].sights is pair[1].sights
    tables = [_table(end.sights, backend) for end in pair[: 1 if shared else 2]]
    return _ways(pair[0], means, tables[0]), _ways(pair[1], means, tables[-1])


def _ways(end: End, means: list[Any], table: tuple[Any, Any] | None) -> Ways:
    of_levels, sights = [], end.sights
    for mean in means:
        sights = None if sights is None else sights.mean(mean)
        of_levels.append(replace(end, sights=sights).extra_delays())
    return Ways(end, table, [list(each) for each in zip(*of_levels, strict=True)])


def _table(sights: Sights | None, backend: Backend) -> tuple[Any, Any] | None:
    if sights is None:
        return None
    tables = []
    for values in (sights.points_m, sights.steps_m):
        packed = np.zeros((*values.shape[:0:-1], 4), np.float32)
        packed[..., :3] = values.T
        tables.append(backend.Float32(packed.ravel()))
    return tables[0], tables[1]
