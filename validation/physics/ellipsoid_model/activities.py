"""Spectrograms of activities by both models."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

import t2d_rt as t2d
from t2d_rt.recording.compare import envelope, mean_rcs_m2, ridge
from t2d_rt.types import Radar
from validation.bodies import RUN, WALK, recorded
from validation.physics.turntable import (
    db,
)

JACKS, STYLISED = "14_14_jumping_jacks.bvh", "131_01_walk_300frames.bvh"
ACTIVITIES = (
    ("walk", WALK, 1.0, 3.0),
    ("run", RUN, 0.0, 1.4),
    ("jumping jacks", JACKS, 0.5, 2.5),
    ("stylised walk", STYLISED, 0.2, 1.8),
)
"""Name, recording, start and end [s]; at 1.96 s a hand of the stylised walk flips over at 16 m/s, which aliases."""
NEAR_PEAK_DB, FLOOR_DB = 40.0, 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Activity:
    """Spectrograms of one stretch by three models, and how they agree with the mesh's."""

    name: str
    speeds_mps: np.ndarray
    times_s: np.ndarray
    images: dict[str, np.ndarray]
    """dB (speed, time) of "ellipsoid", "mesh" and "unhidden", the mesh without its shadows."""
    rcs_dbsm: dict[str, float]

    @property
    def _envelopes(self) -> list[np.ndarray]:
        return [np.stack(envelope(self.images[each], self.speeds_mps)) for each in ("ellipsoid", "mesh")]

    @property
    def envelope_correlation(self) -> float:
        """Of both edges, each about its own mean."""
        one, two = (each - each.mean(axis=1, keepdims=True) for each in self._envelopes)
        return float(np.sum(one * two) / math.sqrt(np.sum(one**2) * np.sum(two**2)))

    @property
    def envelope_mps(self) -> float:
        one, two = self._envelopes
        return float(np.sqrt(np.mean((one - two) ** 2)))

    @property
    def _torso(self) -> list[np.ndarray]:
        return [ridge(self.images[each], self.speeds_mps) for each in ("ellipsoid", "mesh")]

    @property
    def torso_mps(self) -> float:
        """Difference of the medians over time of the two torso lines."""
        return float(abs(np.subtract(*(np.median(line) for line in self._torso))))

    @property
    def torso_line_mps(self) -> float:
        """RMS difference of the two lines."""
        return float(np.sqrt(np.mean(np.subtract(*self._torso) ** 2)))

    def difference_db(self, one: str, two: str = "mesh") -> float:
        """RMS difference of cells within NEAR_PEAK_DB of either's peak; two speckle patterns of one mean differ by 7.9 dB."""
        first, second = self.images[one], self.images[two]
        near = (first > first.max() - NEAR_PEAK_DB) | (second > second.max() - NEAR_PEAK_DB)
        floor = max(first.max(), second.max()) - FLOOR_DB  # silence is not endlessly far away
        apart = np.maximum(first, floor) - np.maximum(second, floor)
        return float(np.sqrt(np.mean(apart[near] ** 2)))

    def row(self) -> dict[str, object]:
        return {
            "activity": self.name,
            "envelope correlation": self.envelope_correlation,
            "envelope RMS m/s": self.envelope_mps,
            "torso line RMS m/s": self.torso_line_mps,
            "cells RMS dB": self.difference_db("ellipsoid"),
            "mean RCS dBsm, ellipsoid / mesh": f"{self.rcs_dbsm['ellipsoid']:.1f} / {self.rcs_dbsm['mesh']:.1f}",
            "shadows take dB": self.rcs_dbsm["unhidden"] - self.rcs_dbsm["mesh"],
            "cells RMS dB between shadows on and off": self.difference_db("unhidden"),
        }


def activity_of(radar: Radar, name: str, recording: str, start_s: float, stop_s: float) -> Activity:
    motion = t2d.trim(recorded(recording), start_s, stop_s)
    found = {
        "ellipsoid": t2d.simulate(motion, radar=radar, method="ellipsoid"),
        "mesh": t2d.simulate(motion, radar=radar),
        "unhidden": t2d.simulate(motion, radar=radar, accuracy={"occlusion": False}),
    }
    image = found["mesh"].spectrogram
    return Activity(
        name=name,
        speeds_mps=image.velocity_mps.values,
        times_s=image.time_s.values,
        images={key: each.spectrogram.values for key, each in found.items()},
        rcs_dbsm={key: float(db(mean_rcs_m2(each))) for key, each in found.items()},
    )
