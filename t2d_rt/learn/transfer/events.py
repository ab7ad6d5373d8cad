"""Events: what all radars of a room see of one motion, as one sample of a classifier."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.learn.maps import LabelledMaps, check_axes

SPEED_CELLS = 64
"""Speeds of a network's input; bins are joined by the mean of their levels."""
SCALE_DB = 10.0
GREATEST = 4.0
"""Levels above the median, over SCALE_DB, are clipped there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Events:
    """Events with the maps of each of V radars."""

    levels: np.ndarray
    """(E, V, speed, time) float32 [dB below each map's greatest cell]."""
    labels: np.ndarray
    """(E,) int64."""
    classes: tuple[str, ...]
    names: tuple[str, ...]
    radars: tuple[str, ...]
    velocity_mps: np.ndarray
    """(speed,), ascending, positive = approaching."""
    duration_s: float
    """Time that a map covers."""

    def __len__(self) -> int:
        return len(self.labels)

    @classmethod
    def of(cls, maps: LabelledMaps) -> Events:
        """Events of maps whose groups tell `event` and `radar`; without a radar each event has one map."""
        if "event" not in maps.groups:
            raise InputError(
                f"maps need a group 'event', got {', '.join(maps.groups) or 'none'}; an event stands on one side only"
            )
        radar = maps.groups.get("radar", np.full(len(maps), "radar"))
        radars, events = tuple(dict.fromkeys(radar.tolist())), tuple(dict.fromkeys(maps.groups["event"].tolist()))
        places = {
            (event, each): place for place, (event, each) in enumerate(zip(maps.groups["event"], radar, strict=True))
        }
        if len(places) != len(maps) or len(places) != len(events) * len(radars):
            raise InputError(
                f"each of {len(events)} events needs one map by each of {len(radars)} radars, got {len(maps)} maps"
            )
        table = np.array([[places[event, each] for each in radars] for event in events])
        labels = maps.labels[table]
        if np.any(labels != labels[:, :1]):
            raise InputError("an event has maps of two classes; give each event one class")
        return cls(
            levels=maps.levels[table], labels=labels[:, 0], classes=maps.classes, names=events, radars=radars,
            velocity_mps=maps.velocity_mps, duration_s=maps.duration_s,
        )  # fmt: skip

    def seen_by(self, radar: str) -> Events:
        """The maps of one radar alone."""
        if radar not in self.radars:
            raise InputError(f"there is no radar '{radar}'; choose from {', '.join(self.radars)}")
        place = self.radars.index(radar)
        return replace(self, levels=self.levels[:, place : place + 1], radars=(radar,))

    def take(self, indices: np.ndarray | Sequence[int]) -> Events:
        """The events at these positions, in this order."""
        chosen = np.asarray(indices)
        return replace(
            self,
            levels=self.levels[chosen],
            labels=self.labels[chosen],
            names=tuple(self.names[each] for each in chosen),
        )

    @property
    def above_median_db(self) -> np.ndarray:
        """Levels above the median of each map, which is noise: (E, V, speed, time)."""
        return np.asarray(self.levels - np.median(self.levels, axis=(2, 3), keepdims=True))

    @property
    def inputs(self) -> np.ndarray:
        """What a network is given: (E, V, SPEED_CELLS, time) float32, 0..GREATEST."""
        above = self.above_median_db
        events, views, speeds, times = above.shape
        if speeds % SPEED_CELLS:
            raise InputError(f"maps for transfer need a multiple of {SPEED_CELLS} speeds, got {speeds}; resize them")
        joined = above.reshape(events, views, SPEED_CELLS, speeds // SPEED_CELLS, times).mean(axis=3)
        return np.asarray(np.clip(joined / SCALE_DB, 0.0, GREATEST), dtype=np.float32)

    def same_axes(self, other: Events) -> None:
        """Refuses events of other classes, cells, speeds or duration."""
        if other.classes != self.classes or other.levels.shape[2:] != self.levels.shape[2:]:
            raise InputError(
                f"simulated events of {other.classes}, {other.levels.shape[2:]} cells, do not fit real ones of {self.classes}, "
                f"{self.levels.shape[2:]} cells; bring them to the same classes and size"
            )
        check_axes(self, other)
