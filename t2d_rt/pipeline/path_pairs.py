"""The path pairs to the targets in a room, divided into tiers by level, and the scatterers of static clutter."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from t2d_rt.core.backend import Backend, select
from t2d_rt.core.checks import unknown_name
from t2d_rt.core.errors import InputError, warn
from t2d_rt.propagation.clutter import (
    POINT_PIECES,
    POINT_RAYS,
    Shadows,
    existing_over,
    rough_points,
    roughened,
    static_courses,
    static_paths,
)
from t2d_rt.propagation.edges import SceneBlockage
from t2d_rt.propagation.images import vertices
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.propagation.paths import Along
from t2d_rt.propagation.scene_paths import RadarPaths, probes, radar_paths
from t2d_rt.scattering.clutter import mirror_echoes, rough_echoes
from t2d_rt.scattering.paths import Probed, Ranked, ranked_pairs
from t2d_rt.types import (
    Accuracy,
    PathPair,
    PathTier,
    Radar,
    Scene,
    StaticPath,
)
from t2d_rt.types.ellipsoids import Geometry
from t2d_rt.types.scatterer import Fraction, Scatterer
from t2d_rt.types.scene import ROOM_SURFACES, ROOM_TRIANGLES

Clutter = Literal["specular", "diffuse", "none"]
"""Static clutter: "specular" paths, with "diffuse" also the scattering of rough walls, or "none"."""

CLUTTER_ORDER = 3
"""Greatest number of reflections of static clutter: a trihedral corner has three."""
CEILING_M = 60.0
"""Greatest height of a ceiling above the radar [m]; of a higher one there is a warning, as the scene may be in other units."""
SLAB_M = 1.0
"""Half of the greatest thickness of a slab [m]."""
SCATTERING_COEFFICIENT = 0.2
"""Scattering coefficient, with "diffuse", of walls whose material has none; a choice: 4 % of the reflected power."""


@dataclass(frozen=True, slots=True)
class ChosenPairs:
    """The path pairs that are modelled, strongest first, divided into tiers; and those that are left out."""

    pairs: list[PathPair]
    levels_db: list[float]
    """Level of each pair averaged over the targets, relative to the strongest pair [dB]."""
    bent_db: list[float]
    """Level of the residual of each pair's spectrum after fitting a straight line over frequency, likewise relative [dB]."""
    left_out_db: list[float]
    """Greatest levels, over the points of the targets, of the pairs that are left out, likewise relative [dB]."""
    ends: list[int]
    """For each tier, the number of pairs in it and in the tiers before it."""
    occluded: list[PathPair]
    """The pairs whose occlusion by the targets is traced: those up to the last tier that asks for it."""
    switched_on: list[PathPair]
    """The pairs that have echoes."""

    @classmethod
    def of(cls, ranked: Sequence[Ranked], accuracy: Accuracy, names_on: frozenset[str] | None) -> ChosenPairs:
        """Chooses the pairs within the dynamic range at their best points whose average level is not below the least level. Pairs
        whose names are not in `names_on` (None for all) are modelled as well but have no echoes, because the accuracy of a pair
        must not depend on the others."""
        keep = [
            entry.best_db >= -accuracy.dynamic_range_db and entry.mean_db >= accuracy.least_level_db for entry in ranked
        ]
        kept = [entry for entry, stays in zip(ranked, keep, strict=True) if stays]
        least = 1  # the strongest pair is dominant, whatever its level is
        ends: list[int] = []
        for tier in accuracy.tiers:
            least = max(least, sum(entry.mean_db >= tier.level_db for entry in kept))
            ends.append(least)
        ends[-1] = len(kept)
        last = max(end for end, tier in zip(ends, accuracy.tiers, strict=True) if tier.visibility == "occlusion")
        on = [names_on is None or entry.pair.name in names_on for entry in ranked]
        switched_on = [entry.pair for entry, stays, heard in zip(ranked, keep, on, strict=True) if stays and heard]
        return cls(
            pairs=[entry.pair for entry in kept],
            levels_db=[entry.mean_db for entry in kept],
            bent_db=[entry.bent_db for entry in kept],
            left_out_db=[
                entry.best_db for entry, stays, heard in zip(ranked, keep, on, strict=True) if heard and not stays
            ],
            ends=ends,
            occluded=[entry.pair for entry in kept[:last]],
            switched_on=switched_on,
        )

    @property
    def dominant(self) -> int:
        """Number of pairs in the first tier."""
        return self.ends[0]

    def by_tier(self, accuracy: Accuracy) -> Iterator[tuple[PathTier, list[PathPair]]]:
        """The tiers that have path pairs, with these pairs, whether they are switched on or not."""
        for tier, first, last in zip(accuracy.tiers, [0, *self.ends], self.ends, strict=False):
            if last > first:
                yield tier, self.pairs[first:last]

    def bound_db(self) -> float | None:
        """Upper bound of the level of the pairs left out, as if all were in phase, relative to the strongest pair [dB]; None where
        none is left out."""
        total = sum(10 ** (level / 20) for level in self.left_out_db)
        return 20 * float(np.log10(total)) if total else None

    def describe(self) -> dict[str, object]:
        """Entries of a recording's settings about path pairs."""
        return {
            "pairs": [pair.name for pair in self.switched_on],
            "left_out": len(self.left_out_db),
            "left_out_db": self.bound_db(),
        }


def switched_on(ranked: Sequence[Ranked], only: Sequence[str] | None, without: Sequence[str]) -> frozenset[str] | None:
    """Names of the path pairs that have echoes: those that match `only`, without those that match `without`; None for all. In a
    name * stands for any characters. Free space counts as one pair called "direct"."""
    if only is None and not without:
        return None
    names = [entry.pair.name for entry in ranked] or ["direct"]
    on = set(names) if only is None else _matching("only_paths", only, names)
    on -= _matching("without_paths", without, names)
    if not on:
        raise InputError(
            f"only_paths and without_paths leave no path pair, and so no echo; keep one of {', '.join(names)}"
        )
    return None if on == set(names) else frozenset(on)


def _matching(option: str, patterns: Sequence[str], names: Sequence[str]) -> set[str]:
    """The names that match one of the patterns given to an option; refuses a pattern without a match."""
    matches: set[str] = set()
    for pattern in patterns:
        matching = fnmatch.filter(names, pattern.replace("[", "[[]"))
        if not matching:
            raise InputError(f"{option}: {unknown_name('path pair', pattern, names)}")
        matches.update(matching)
    return matches


def within_reach(scene: Scene, radar: Radar) -> Scene | None:
    """The part of a large scene from which echoes can come; None where there is nothing of it. Smaller scenes are kept as they are.

    The IF filter passes no path longer than twice the greatest range, and no shorter path leads farther away.
    """
    if not scene.is_large:
        return scene
    place = (radar.tx_position_m + radar.rx_position_m) / 2
    ceiling_m = _ceiling_m(scene, place)
    if ceiling_m > CEILING_M:
        warn(
            f"the ceiling of {scene.name} is {ceiling_m:.4g} m above the radar, higher than any room; give the scene in metres"
        )
    reach_m = radar.max_range_m + SLAB_M + (0.0 if radar.track is None else radar.track.reach_m)
    near = scene.near(place, reach_m)
    if near is None:
        where = ", ".join(f"{x:.4g}" for x in place)
        low, high = (", ".join(f"{x:.4g}" for x in corner) for corner in scene.bounds_m)
        warn(
            f"nothing of {scene.name}, which reaches from ({low}) to ({high}) m, is within {radar.max_range_m:.3g} m of the radar "
            f"at ({where}) m, which reaches no farther, so there is free space; move it (position_m)"
        )
        return None
    triangles = sum(len(surface.faces) for surface in near.surfaces)
    if len(near.surfaces) > ROOM_SURFACES or triangles > ROOM_TRIANGLES:
        raise InputError(
            f"scene {scene.name} has {len(near.surfaces)} surfaces and {triangles} triangles within the {radar.max_range_m:.3g} m "
            f"that the radar reaches, more than {ROOM_SURFACES} and {ROOM_TRIANGLES}; leave out what hardly reflects, or give its "
            "meshes fewer triangles"
        )
    return near


def _ceiling_m(scene: Scene, place_m: np.ndarray) -> float:
    """Height [m] of the first surface vertically above a place; 0 where there is none."""
    corners = np.concatenate([surface.vertices[surface.faces] for surface in scene.surfaces]) - place_m
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners.transpose(1, 2, 0)
    # Barycentric coordinates of the place within each triangle, in plan view.
    weights = np.stack([bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx])
    total = weights.sum(axis=0)
    over = ((weights >= 0).all(axis=0) | (weights <= 0).all(axis=0)) & (total != 0)
    heights = (weights * [az, bz, cz]).sum(axis=0)[over] / total[over]
    return float(min(heights[heights > 0], default=0.0))


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
    """Path pairs to the targets with up to `order` reflections and `transmissions` transmissions in all, strongest first, and their
    blockage by the scene."""
    points, probed_s = probes(geometries, *span_s)
    most = {"order": order, "transmissions": transmissions}
    along = Along.of(radar, span_s, probed_s)
    paths = radar_paths(scene, radar, points, **most, backend=backend, along=along)
    ranked = ranked_pairs(radar, probed(paths, points, probed_s), **most)
    if not ranked:
        raise InputError(
            f"no path leads from the radar to the target in scene {scene.name} with up to {order} reflections and "
            f"{transmissions} transmissions; move the radar or the target, or allow more of them"
        )
    return ranked, paths.blockage


def probed(found: RadarPaths, probes_m: np.ndarray, probed_s: np.ndarray | None = None) -> Probed:
    """The paths of a radar with the points at the targets to which they were searched, and the times of these points, which a
    moving radar needs."""
    return Probed(
        probes_m=probes_m,
        probed_s=probed_s,
        out=found.out.paths,
        back=found.back.paths,
        one_antenna=found.one_antenna,
        fraction=(found.out.fraction, found.back.fraction),
    )


def paths_to(scene: Scene, radar: Radar, point_m: np.ndarray, *, reflections: int) -> list[tuple[str, np.ndarray]]:
    """Names of the one-way paths from the transmitters (where a track begins) to a point, and the vertices of each path (P, 3)
    [m]."""
    point_m = np.asarray(point_m, float)
    paths = radar_paths(scene, radar.replace(track=None), point_m[None], order=reflections, backend=select("auto"))
    return [(path.name, vertices(path, point_m)) for path in paths.out.paths]


def clutter_scatterers(
    kind: Clutter,
    scene: Scene,
    geometries: Sequence[Geometry],
    radar: Radar,
    times_s: np.ndarray,
    *,
    samples_s: np.ndarray,
    seed: int,
    backend: Backend,
) -> tuple[list[Scatterer], dict[str, object]]:
    """Scatterers of the static scene, occluded by the targets, and counts of its echoes for a recording's settings."""
    if kind == "diffuse":
        if radar.track is not None:
            raise InputError(
                "clutter 'diffuse' is that of a radar that stands still, got one with a track: its points stand for what is seen "
                "of the walls from one place; take 'specular' or 'none'"
            )
        scene = roughened(scene, SCATTERING_COEFFICIENT, radar.mid_frequency_hz)
    scatterers: list[Scatterer] = []
    shadows = partial(Shadows, geometries, wavelength_m=radar.wavelength_m, samples_s=samples_s, backend=backend)
    paths: Sequence[StaticPath] = static_paths(scene, radar, order=CLUTTER_ORDER, backend=backend, samples_s=samples_s)
    if paths:
        courses = [path.stops_m for path in paths] if radar.track is None else partial(static_courses, radar, paths)
        fractions: Fraction | None = shadows(courses).fractions if geometries else None
        if radar.track is not None:
            fractions = existing_over(paths, samples_s, fractions)
        scatterers.append(mirror_echoes(paths, radar, times_s=times_s, fractions=fractions))
    points = np.zeros((0, 3))
    if kind == "diffuse":
        points, rcs = rough_points(Mirrors.of(scene, backend, radar.tx_position_m), radar)
    if len(points):
        paths_m = [np.array([radar.tx_position_m, point, radar.rx_position_m]) for point in points]
        passing = shadows(paths_m, rays=POINT_RAYS, pieces=POINT_PIECES).fractions if geometries else None
        scatterers.append(rough_echoes(points, rcs, radar, times_s=times_s, seed=seed, fractions=passing))
    return scatterers, {"clutter": kind, "clutter_paths": len(paths), "clutter_points": len(points)}
