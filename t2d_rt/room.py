"""The room's part of the pipeline: path pairs to the targets, and the targets' visibility over each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from t2d_rt.backend import Backend, select
from t2d_rt.errors import InputError
from t2d_rt.propagation.clutter import POINT_PIECES, POINT_RAYS, Shadows, rough_points, roughened, static_paths
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.propagation.surroundings import Blockage, probes, radar_paths
from t2d_rt.propagation.visibility import ExactVisibility, Occlusion
from t2d_rt.scattering.clutter import mirror_echoes, rough_echoes
from t2d_rt.scattering.paths import FacetVisibility, Fraction, Ranked, View, anchor_vertices, ranked_pairs
from t2d_rt.types import (
    Accuracy,
    EchoStream,
    Ellipsoids,
    MovingMesh,
    OneWayPath,
    PathPair,
    PathTier,
    Radar,
    Scene,
)

Geometry = MovingMesh | Ellipsoids
Clutter = Literal["specular", "diffuse", "none"]
"""Static clutter: specular paths, these and the scatter of rough walls, or none."""
_Place = tuple[tuple[str, ...], int]
"""A chain of mirrors, and from which end."""

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
) -> list[Ranked]:
    """Path pairs of up to `order` reflections and `transmissions` in all to the targets, strongest first."""
    points = probes(geometries, *span_s)
    most = {"order": order, "transmissions": transmissions}
    out, back = radar_paths(scene, radar, points, **most, backend=backend)
    ranked = ranked_pairs(radar, out, back, points, **most)
    if not ranked:
        raise InputError(
            f"no path leads from the radar to the target in scene {scene.name} with up to {order} reflections and "
            f"{transmissions} transmissions; move the radar or the target, or allow more of them"
        )
    return ranked


def paths_to(scene: Scene, radar: Radar, point_m: np.ndarray, *, reflections: int) -> list[tuple[str, np.ndarray]]:
    """Names of the one-way paths from the transmitters to a point, and their vertices (P, 3) [m]."""
    paths, _ = radar_paths(scene, radar, point_m[None], order=reflections, backend=select("auto"))
    return [(path.name, path.vertices(point_m)) for path in paths]


class TargetVisibility:
    """Visibility of targets from the antennas over the paths of `pairs`, None being free space, sampled at `samples_s`.

    It is sampled at the vertices of the meshes, subdivided `subdivision` times. Samples are shared: pairs have one-way paths in
    common, and transmitters and receivers that stand close together have one visibility.
    Fast-rotating targets occlude nothing, and all of their vertices have the mean visibility.
    Over the `finer` first pairs occlusion is traced from every facet's vertices, at every instant asked for, through `occluders`:
    the targets' facets.
    """

    def __init__(
        self,
        geometries: Sequence[Geometry],
        radar: Radar,
        pairs: Sequence[PathPair | None],
        *,
        fast_rotating: Sequence[bool],
        occlusion: bool,
        samples_s: np.ndarray,
        occluders: Sequence[MovingMesh] = (),
        finer: int = 0,
        subdivision: int = 0,
        backend: Backend,
    ) -> None:
        self._views_m, self._pairs, self._samples_s, self._backend = radar.views_m, pairs, samples_s, backend
        self._fast_rotating = {
            id(geometry) for geometry, rotates in zip(geometries, fast_rotating, strict=True) if rotates
        }
        self._meshes = [s for s in geometries if isinstance(s, MovingMesh) and id(s) not in self._fast_rotating]
        self._occlusion, self._occluders, self._finer, self._subdivision = occlusion, occluders, finer, subdivision
        self._occlusions: dict[tuple[_Place, bool], Occlusion] = {}
        self._exact: dict[bytes, ExactVisibility] = {}
        sampled = pairs[finer:] if occlusion else []
        self._known = {self._place(end, path) for pair in sampled for end, path in enumerate(_one_way_paths(pair))}

    def views(self, geometry: Geometry) -> list[View]:
        """Of one target, over the pairs."""
        if not isinstance(geometry, MovingMesh):
            pairs = [pair for pair in self._pairs if pair]
            return (
                coarse_views(geometry, pairs, self._samples_s, fast_rotating=id(geometry) in self._fast_rotating)
                if pairs
                else [View()]
            )
        fast_rotating = id(geometry) in self._fast_rotating
        found = []
        for number, pair in enumerate(self._pairs):
            finest = self._occlusion and number < self._finer and not fast_rotating
            solid = self._occlusion and not finest
            # One sample serves where both ends have one visibility; the scene blocks both one-way paths, though.
            ends = {
                self._place(end, path): (end, path) for end, path in enumerate(_one_way_paths(pair)) if path or solid
            }
            found.append(
                View(
                    paths=pair,
                    visibility=_product(
                        [self._fraction(*end, geometry, solid, 3 - len(ends)) for end in ends.values()]
                    ),
                    subdivision=self._subdivision if solid and not fast_rotating else 0,
                    facet_visibility=self._facet_visibility(pair) if finest else None,
                )
            )
        return found

    def with_shared_occlusion(
        self, geometry: MovingMesh, pairs: Sequence[PathPair], samples_s: np.ndarray
    ) -> list[View]:
        """Of one target, over other pairs: as `coarse_views`, but occluded along one-way paths whose occlusion is traced anyway."""
        points = Blockage.to_vertices(geometry, anchor_vertices(geometry.rest), samples_s)
        unblocked = _unblocked(points, pairs, fast_rotating=id(geometry) in self._fast_rotating)
        found = []
        for pair in pairs:
            ends = [(self._place(end, path), end, path) for end, path in enumerate((pair.out, pair.back))]
            counts = Counter(place for place, _, _ in ends if place in self._known)
            known = {place: (end, path) for place, end, path in ends if place in counts}
            fractions = [self._fraction(*end, geometry, True, counts[place]) for place, end in known.items()]
            others = [unblocked[id(path)] for place, _, path in ends if place not in counts]
            found.append(
                View(
                    paths=pair,
                    visibility=_product(fractions),
                    subdivision=0 if id(geometry) in self._fast_rotating else self._subdivision,
                    unblocked=_product(others),
                )
            )
        return found

    def _place(self, end: int, path: OneWayPath | None) -> _Place:
        """Viewpoint of the one-way path of an end."""
        return () if path is None else path.chain, 0 if len(self._views_m) == 1 else end

    def _fraction(
        self, end: int, path: OneWayPath | None, geometry: MovingMesh, solid: bool, path_count: int
    ) -> Fraction:
        """Visibility over the one-way path of an end, whose blockage `path_count` paths share; occlusion counts if `solid`."""
        key = self._place(end, path), solid
        if key not in self._occlusions:
            place = self._views_m[key[0][1]] if path is None else path.image_m
            self._occlusions[key] = Occlusion(
                self._meshes, place, samples_s=self._samples_s, backend=self._backend,
                unblocked=None if path is None else path.fraction, solid=solid, subdivision=self._subdivision if solid else 0,
            )  # fmt: skip
        occlusion = self._occlusions[key]
        if id(geometry) in self._fast_rotating:
            return occlusion.of_fast_rotating(geometry, path_count)
        index = next(index for index, mesh in enumerate(self._meshes) if mesh is geometry)
        return lambda times_s: occlusion.visibility(times_s, path_count)[index]

    def _facet_visibility(self, pair: PathPair | None) -> FacetVisibility:
        """Traced from every facet's vertices."""
        places = self._views_m if pair is None else [pair.out.image_m, pair.back.image_m]
        for place in places:
            if place.tobytes() not in self._exact:
                self._exact[place.tobytes()] = ExactVisibility(self._occluders, place, backend=self._backend)
        ends = [self._exact[key] for key in {place.tobytes(): None for place in places}]
        return lambda *where: np.asarray(np.prod([end.fraction(*where) for end in ends], axis=0))


def coarse_views(
    geometry: Geometry,
    pairs: Sequence[PathPair],
    samples_s: np.ndarray,
    *,
    fast_rotating: bool = False,
    minor: bool = False,
) -> list[View]:
    """Views of one target over pairs, with blockage by the scene sampled at a few of its points at `samples_s`, without occlusion.

    All points of a `fast_rotating` one have the mean visibility. Over `minor` pairs ellipsoids have the visibility of their
    centres.
    """
    if isinstance(geometry, Ellipsoids):
        blockage = (Blockage.to_centres if minor else Blockage.to_ellipsoids)(geometry, samples_s)
    else:
        blockage = Blockage.to_vertices(geometry, anchor_vertices(geometry.rest), samples_s)
    fractions = _unblocked(blockage, pairs, fast_rotating=fast_rotating)
    field = "visibility" if isinstance(geometry, Ellipsoids) else "unblocked"
    found = [_product([fractions[id(path)] for path in _one_way_paths(pair)]) for pair in pairs]
    return [View(paths=pair, **{field: each}) for pair, each in zip(pairs, found, strict=True)]  # type: ignore[arg-type]


def _unblocked(blockage: Blockage, pairs: Sequence[PathPair], *, fast_rotating: bool) -> dict[int, Fraction]:
    """Fraction of the field that the scene does not block, by one-way path."""
    # By path and not by chain: antennas that stand apart have paths of their own over the same mirrors.
    paths = {id(path): path for pair in pairs for path in (pair.out, pair.back)}
    return {number: _remembered(blockage.over(path, in_the_mean=fast_rotating)) for number, path in paths.items()}


def _one_way_paths(pair: PathPair | None) -> tuple[OneWayPath | None, OneWayPath | None]:
    return (None, None) if pair is None else (pair.out, pair.back)


def _product(fractions: Sequence[Fraction]) -> Fraction | None:
    """Product of the visibility over each one-way path; None where there is none."""
    if len(fractions) < 2:
        return fractions[0] if fractions else None
    return lambda times_s: np.asarray(np.prod([fraction(times_s) for fraction in fractions], axis=0))


def _remembered(fraction: Fraction) -> Fraction:
    """The same, which keeps its last answer: pairs that have a one-way path in common ask for the same times."""
    last: list[np.ndarray] = []

    def asked(times_s: np.ndarray) -> np.ndarray:
        if not last or not np.array_equal(last[0], times_s):
            last[:] = [times_s, fraction(times_s)]
        return last[1]

    return asked


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
    mirrors = Mirrors.of(scene, backend)
    streams = []

    def unoccluded(paths_m: Sequence[np.ndarray], **fineness: int) -> Fraction | None:
        if not geometries:
            return None
        return Shadows(
            geometries, paths_m, radar.wavelength_m, samples_s=samples_s, backend=backend, **fineness
        ).fractions

    paths = static_paths(mirrors, radar, order=CLUTTER_ORDER)
    if paths:
        streams.append(
            mirror_echoes(paths, radar, times_s=times_s, fractions=unoccluded([path.stops_m for path in paths]))
        )
    points, rcs = rough_points(mirrors, radar) if kind == "diffuse" else (np.zeros((0, 3)), np.zeros(0))
    if len(points):
        paths_m = [np.array([radar.tx_position_m, point, radar.rx_position_m]) for point in points]
        passing = unoccluded(paths_m, rays=POINT_RAYS, pieces=POINT_PIECES)
        streams.append(rough_echoes(points, rcs, radar, times_s=times_s, seed=seed, fractions=passing))
    return streams, {"clutter": kind, "clutter_paths": len(paths), "clutter_points": len(points)}
