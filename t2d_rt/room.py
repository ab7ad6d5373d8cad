"""The room's part of the pipeline: path pairs to the targets, and the targets' visibility over each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from t2d_rt.backend import Backend, select
from t2d_rt.errors import InputError
from t2d_rt.propagation.clutter import POINT_PIECES, POINT_RAYS, Shadows, rough_points, roughened, static_paths
from t2d_rt.propagation.edges import SceneBlockage
from t2d_rt.propagation.images import vertices
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.propagation.surroundings import RadarPaths, probes, radar_paths
from t2d_rt.scattering.clutter import mirror_echoes, rough_echoes
from t2d_rt.scattering.paths import Fraction, Probed, Ranked, ranked_pairs
from t2d_rt.types import (
    Accuracy,
    EchoStream,
    PathPair,
    PathTier,
    Radar,
    Scene,
)
from t2d_rt.types.target import Geometry

Clutter = Literal["specular", "diffuse", "none"]
"""Static clutter: specular paths, these and the scatter of rough walls, or none."""

CLUTTER_ORDER = 3
"""Reflections of static clutter: a trihedral corner takes three."""
SCATTERING_COEFFICIENT = 0.2
"""Of walls whose material has none, with "diffuse": a choice, 4 % of what is reflected."""


@dataclass(frozen=True, slots=True)
class ChosenPairs:
    """Path pairs in use, strongest first, in tiers, and those left out."""

    pairs: list[PathPair]
    levels_db: list[float]
    """Theirs in the mean over the targets, relative to the strongest pair's [dB]."""
    bent_db: list[float]
    """Levels of what a line over frequency leaves out of their spectra, likewise."""
    left_out_db: list[float]
    """Levels of those left out at their best points, likewise."""
    ends: list[int]
    """How many of the pairs belong to each tier or to one before it."""
    occluded: list[PathPair]
    """Those of tiers whose occlusion by the targets is traced along all of their paths."""

    @classmethod
    def of(cls, ranked: Sequence[Ranked], accuracy: Accuracy) -> ChosenPairs:
        """Those within the dynamic range at their best points and not below the least level in the mean."""
        keep = [
            each.best_db >= -accuracy.dynamic_range_db and each.mean_db >= accuracy.least_level_db for each in ranked
        ]
        kept = [each for each, good in zip(ranked, keep, strict=True) if good]
        least = 1  # the strongest one is dominant whatever its level
        ends: list[int] = []
        for tier in accuracy.tiers:
            least = max(least, sum(each.mean_db >= tier.level_db for each in kept))
            ends.append(least)
        ends[-1] = len(kept)
        pairs = [each.pair for each in kept]
        last = max(end for end, tier in zip(ends, accuracy.tiers, strict=True) if tier.visibility == "occlusion")
        return cls(
            pairs=pairs,
            levels_db=[each.mean_db for each in kept],
            bent_db=[each.bent_db for each in kept],
            left_out_db=[each.best_db for each, good in zip(ranked, keep, strict=True) if not good],
            ends=ends,
            occluded=pairs[:last],
        )

    @property
    def dominant(self) -> int:
        """How many are in the first tier."""
        return self.ends[0]

    def by_tier(self, accuracy: Accuracy) -> Iterator[tuple[PathTier, list[PathPair]]]:
        """Tiers that have path pairs, and these."""
        for tier, first, last in zip(accuracy.tiers, [0, *self.ends], self.ends, strict=False):
            if last > first:
                yield tier, self.pairs[first:last]

    def bound_db(self) -> float | None:
        """What those left out amount to at most, were they all in phase, relative to the strongest one [dB]."""
        total = sum(10 ** (level / 20) for level in self.left_out_db)
        return 20 * float(np.log10(total)) if total else None

    def describe(self) -> dict[str, object]:
        """For a result's settings."""
        return {
            "pairs": [pair.name for pair in self.pairs],
            "left_out": len(self.left_out_db),
            "left_out_db": self.bound_db(),
        }


def find_path_pairs(
    scene: Scene,
    geometries: Sequence[Geometry],
    radar: Radar,
    span_s: tuple[float, float],
    *,
    order: int,
    transmissions: int = 0,
    backend: Backend,
) -> tuple[list[Ranked], SceneBlockage]:
    """Path pairs of up to `order` reflections and `transmissions` in all to the targets, strongest first, and what blocks them."""
    points = probes(geometries, *span_s)
    most = {"order": order, "transmissions": transmissions}
    found = radar_paths(scene, radar, points, **most, backend=backend)
    ranked = ranked_pairs(radar, probed(found, points), **most)
    if not ranked:
        raise InputError(
            f"no path leads from the radar to the target in scene {scene.name} with up to {order} reflections and "
            f"{transmissions} transmissions; move the radar or the target, or allow more of them"
        )
    return ranked, found.blockage


def probed(found: RadarPaths, probes_m: np.ndarray) -> Probed:
    """Paths of a radar to the points that they were searched to."""
    return Probed(
        probes_m=probes_m, out=found.out.paths, back=found.back.paths, one_antenna=found.one_antenna,
        reached=(found.out.reached, found.back.reached),
    )  # fmt: skip


def paths_to(scene: Scene, radar: Radar, point_m: np.ndarray, *, reflections: int) -> list[tuple[str, np.ndarray]]:
    """Names of the one-way paths from the transmitters to a point, and their vertices (P, 3) [m]."""
    point_m = np.asarray(point_m, float)
    found = radar_paths(scene, radar, point_m[None], order=reflections, backend=select("auto"))
    return [(path.name, vertices(path, point_m)) for path in found.out.paths]


def clutter_streams(
    kind: Clutter,
    scene: Scene,
    geometries: Sequence[Geometry],
    radar: Radar,
    times_s: np.ndarray,
    *,
    samples_s: np.ndarray,
    seed: int,
    backend: Backend,
) -> tuple[list[EchoStream], dict[str, object]]:
    """Echoes of the static scene, occluded by targets, and how many, for a result's settings."""
    if kind == "diffuse":
        scene = roughened(scene, SCATTERING_COEFFICIENT, radar.mid_frequency_hz)
    streams = []

    def unoccluded(paths_m: Sequence[np.ndarray], **fineness: int) -> Fraction | None:
        if not geometries:
            return None
        return Shadows(
            geometries, paths_m, radar.wavelength_m, samples_s=samples_s, backend=backend, **fineness
        ).fractions

    paths = static_paths(scene, radar, order=CLUTTER_ORDER, backend=backend)
    if paths:
        streams.append(
            mirror_echoes(paths, radar, times_s=times_s, fractions=unoccluded([path.stops_m for path in paths]))
        )
    points = np.zeros((0, 3))
    if kind == "diffuse":
        points, rcs = rough_points(Mirrors.of(scene, backend), radar)
    if len(points):
        paths_m = [np.array([radar.tx_position_m, point, radar.rx_position_m]) for point in points]
        passing = unoccluded(paths_m, rays=POINT_RAYS, pieces=POINT_PIECES)
        streams.append(rough_echoes(points, rcs, radar, times_s=times_s, seed=seed, fractions=passing))
    return streams, {"clutter": kind, "clutter_paths": len(paths), "clutter_points": len(points)}
