"""What a point of the chart is: seconds of computing per second of radar data, and how far from the reference."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import t2d_rt as t2d
from t2d_rt.body.materials import resolve_material
from t2d_rt.pipeline.echo_model import sagitta_rad
from t2d_rt.propagation import clutter, mirrors
from t2d_rt.recording.compare import envelope
from t2d_rt.recording.recording import Recording
from t2d_rt.scattering import points, refinement
from t2d_rt.scattering.refinement import facets
from t2d_rt.types import Motion, MovingMesh, Radar
from validation.bodies import random_chirps
from validation.methods.kept import CACHE, kept_samples
from validation.methods.reference import Converged, nmse_db

SAMPLES = np.array([20, 128, 236])
REFERENCE_RAD, ROOM_REFERENCE_RAD, MINOR_RAD = 0.08, 0.12, 0.3
"""Facets of the reference, in rooms, and there over path pairs weaker than the strongest by 12 dB."""
FLAT = 1e6
"""A phase sagitta [rad] that asks for no refinement."""
MEMORY_GB = 6.0
"""That a simulation may take: the finest settings take more than the default limit."""
LONG_S = 3.0
"""A run that takes longer than that is not repeated once kernels are warm."""
NEAR_PEAK_DB = 40.0
FINE: dict[str, Any] = {"surface_rate_hz": 100.0, "visibility_rate_hz": 100.0}
ROOM_FINE_DB = -24.0
"""The stand-in for the reference over the whole record in rooms is what that tolerance asks for."""


@dataclass(frozen=True)
class Case:
    """A stretch of a recording before the radar."""

    scene: str
    name: str
    motion: Motion
    radar: Radar
    count: int = 16
    """Chirps at which the field is compared."""
    fine_scale: float = 0.4
    """Phase sagitta of the stand-in's facets in free space, relative to the default."""
    reference_rad: float | None = None
    """Phase sagitta of the reference's facets; None: `REFERENCE_RAD`, in rooms `ROOM_REFERENCE_RAD`."""
    cache: Path = CACHE
    """Folder in which the reference is kept."""

    @cached_property
    def surface(self) -> MovingMesh:
        """The skinned body."""
        return t2d.skin(self.motion)

    @cached_property
    def chirps(self) -> np.ndarray:
        """Their numbers."""
        return random_chirps(self.surface, self.radar, self.count)

    @cached_property
    def truth(self) -> np.ndarray:
        """Samples (chirps, SAMPLES) of the converged float64 reference, kept on disk."""
        free = self.scene == "free_space"
        return kept_samples(
            self.surface, self.radar, self.chirps, SAMPLES,
            Converged(
                material=resolve_material("skin", self.radar.mid_frequency_hz), scene=None if free else self.scene,
                sagitta_rad=self.reference_rad or (REFERENCE_RAD if free else ROOM_REFERENCE_RAD), minor_sagitta_rad=MINOR_RAD,
            ),
            folder=self.cache,
        )  # fmt: skip

    @cached_property
    def fine(self) -> Recording:
        """The stand-in for the reference over the whole record: the mesh at far finer settings."""
        if self.scene == "free_space":
            return simulated(self, scale=self.fine_scale, accuracy=FINE)
        return t2d.simulate(self.motion, tolerance_db=ROOM_FINE_DB, measure_error=False, **self.settings())

    def settings(self) -> dict[str, Any]:
        """What all methods have in common; static clutter is no part of the reference."""
        return {"radar": self.radar, "scene": self.scene, "clutter": "none", "collisions": "ignore"}

    def error_db(self, cube: np.ndarray) -> float:
        """Field NMSE [dB] of a cube (chirp, antenna, sample)."""
        return nmse_db(cube[:, 0][np.ix_(self.chirps, SAMPLES)], self.truth)


def simulated(
    case: Case, *, scale: float = 1.0, accuracy: Mapping[str, Any] | None = None, **options: Any
) -> Recording:
    """`simulate` with the body's phase sagitta scaled: 1 is the default setting."""
    return t2d.simulate(
        case.motion,
        accuracy={"sagitta_scale": scale} | dict(accuracy or {}),
        **{"memory_gb": MEMORY_GB, **case.settings(), **options},
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One setting of one method."""

    scene: str
    motion: str
    method: str
    knob: str
    facets: int | str = ""
    """Of the finest mesh."""
    seconds_per_second: float
    nmse_db: float
    spectrogram_db: float | str = ""
    """RMS difference from the stand-in's spectrogram within 40 dB of its peak."""
    envelope_r: float | str = ""
    """Correlation of the upper envelopes."""
    power_db: float | str = ""
    """Mean power beside the stand-in's."""

    @property
    def row(self) -> dict[str, Any]:
        """For the report."""
        return asdict(self)


def best_seconds(action: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds of the best of two runs, or of one long one, after one that compiles the kernels; and what came of it."""
    found = action()
    taken: list[float] = []
    while len(taken) < 2 and sum(taken) < LONG_S:
        start = time.perf_counter()
        found = action()
        taken.append(time.perf_counter() - start)
    return min(taken), found


def measured(case: Case, method: str, knob: str, action: Callable[[], Recording]) -> Point:
    """A point of a method that makes the whole record; its seconds are those up to the spectrogram."""

    def run() -> Recording:
        for keeps in (
            refinement,
            points,
            mirrors,
            clutter,
        ):  # a recording of another range or person finds nothing kept
            keeps.forget()
        found = action()
        _ = found.spectrogram
        return found

    seconds, found = best_seconds(run)
    return Point(
        scene=case.scene, motion=case.name, method=method, knob=knob, facets=_facets(case, found),
        seconds_per_second=seconds / case.surface.duration_s,
        nmse_db=case.error_db(found.cube),
        **compared(found, case.fine),
    )  # fmt: skip


def _facets(case: Case, found: Recording) -> int | str:
    """How many facets a recording has over dominant paths: as its settings say, else as follows from its accuracy."""
    if "facets" in found.settings:
        return int(found.settings["facets"])
    if found.accuracy is None or found.settings["method"] == "ellipsoid":
        return ""
    surface = case.surface
    span_s = float(surface.times_s[0]), float(surface.times_s[-1])
    return len(facets(surface, case.radar, sagitta_rad(surface, found.accuracy), span_s=span_s).faces)


def compared(found: Recording, fine: Recording) -> dict[str, float | str]:
    """Figures of a whole record beside the stand-in's."""
    one, two = found.spectrogram.values, fine.spectrogram.values
    speeds = fine.spectrogram.velocity_mps.values
    near = two > two.max() - NEAR_PEAK_DB
    floor = two.max() - NEAR_PEAK_DB - 20  # silence is not infinitely different
    upper = [envelope(image, speeds)[0] for image in (one, two)]
    return {
        "spectrogram_db": float(np.sqrt(np.mean((np.maximum(one, floor) - two)[near] ** 2))),
        "envelope_r": float(np.corrcoef(*upper)[0, 1]) if np.ptp(upper[0]) and np.ptp(upper[1]) else "",
        "power_db": 10 * float(np.log10(_power(found.cube) / _power(fine.cube))),
    }


def _power(cube: Any) -> float:
    return float(np.mean(np.abs(cube[:]) ** 2, dtype=np.float64))
