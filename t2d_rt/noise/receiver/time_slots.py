"""When the chirps of a group of rows are sent: every row of the cube is one time slot, with "tdm" one for each transmitter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.noise.receiver.draws import group_rows
from t2d_rt.types import Radar


@dataclass(frozen=True, slots=True)
class TimeSlots:
    """The slots of a radar; a receive channel is a receiver, or with "simultaneous" each virtual antenna by itself."""

    radar: Radar

    @property
    def per_row(self) -> int:
        """Time slots of one row."""
        return self.radar.loop_chirps

    @property
    def channels(self) -> int:
        """Receive channels."""
        return self.radar.antennas // self.per_row

    @property
    def group_rows(self) -> int:
        """Rows of the cube in a group."""
        return group_rows(self.radar.antennas * self.radar.samples)

    def numbers(self, first: int, rows: int) -> np.ndarray:
        """Numbers of the slots of rows from the first on, on a grid of the PRF, (row, slot)."""
        return np.rint(self.starts_s(first, rows) * self.radar.prf_hz).astype(np.int64)

    def starts_s(self, first: int, rows: int) -> np.ndarray:
        """Their first ADC samples [s], (row, slot)."""
        radar = self.radar
        row = np.arange(first, first + rows)
        if radar.loops_per_frame is None or radar.frame_interval_s is None:
            starts = row * radar.loop_interval_s
        else:
            frame, within = np.divmod(row, radar.loops_per_frame)
            starts = frame * radar.frame_interval_s + within * radar.loop_interval_s
        return np.asarray(starts[:, None] + np.arange(self.per_row) / radar.prf_hz)

    def by_slot(self, samples: np.ndarray) -> np.ndarray:
        """Samples (row, antenna, sample) as a view (row, slot, channel, sample)."""
        return samples.reshape(len(samples), self.per_row, self.channels, samples.shape[2])
