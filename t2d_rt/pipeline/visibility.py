"""Visibility of targets over path pairs: sampled and interpolated in time, or traced exactly at single instants."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np

from t2d_rt.core.backend import Backend
from t2d_rt.propagation.edges import SceneBlockage
from t2d_rt.propagation.mean_visibility import MeanVisibility
from t2d_rt.propagation.occluders import Occluders
from t2d_rt.propagation.scene_paths import unblocked
from t2d_rt.propagation.visibility import ExactVisibility, Occlusion, Viewpoints, viewpoints_at
from t2d_rt.scattering.paths import FacetVisibility, PathVisibility, anchor_vertices
from t2d_rt.types import Ellipsoids, MovingMesh, OneWayPath, PathPair, Radar
from t2d_rt.types.ellipsoids import Geometry
from t2d_rt.types.scatterer import Fraction

_Place = tuple[tuple[str, ...], int]
"""Viewpoint: the chain of mirrors, and the end of the path pair, 0 for the transmitters."""


class VisibilityModel(Protocol):
    """A way to compute the visibility of targets, which are named by their index."""

    def views(self, number: int) -> list[PathVisibility]:
        """The path pairs to a mesh whose occlusion is traced, with its visibility over each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VisibilityContext:
    """Targets before a radar, and the times at which their visibility is sampled."""

    geometries: Sequence[Geometry]
    fast_rotating: Sequence[bool]
    """Whether each target rotates fast. Such targets occlude nothing, and all of their vertices share an averaged visibility."""
    radar: Radar
    pairs: Sequence[PathPair | None]
    """Path pairs whose occlusion is traced; None stands for free space."""
    samples_s: np.ndarray
    backend: Backend
    blockage: SceneBlockage
    """Blockage of the paths by the scene."""


class Sampled:
    """Visibility sampled at the vertices of meshes, which are subdivided `subdivision` times, and interpolated from sample to
    sample.

    One-way paths that several pairs share are traced once; transmitters and receivers that are close together share one visibility.
    Unless targets are `solid` they occlude nothing, and only the scene blocks paths.
    """

    def __init__(self, sight: VisibilityContext, *, solid: bool = True, subdivision: int = 0) -> None:
        self._sight, self._solid, self._subdivision = sight, solid, subdivision
        traced = [
            number
            for number, (geometry, rotates) in enumerate(zip(sight.geometries, sight.fast_rotating, strict=True))
            if isinstance(geometry, MovingMesh) and not rotates
        ]
        self.index = {number: index for index, number in enumerate(traced)}
        """Position of each mesh among those that are traced, by the index of the target."""
        self._meshes = Occluders([sight.geometries[number] for number in traced], subdivision=subdivision)  # type: ignore[misc]
        self._viewpoints = Viewpoints(
            self._meshes, sight.samples_s, sight.backend, wavelength_m=sight.radar.wavelength_m
        )
        self._occlusions: dict[_Place, Occlusion] = {}
        self._mean: dict[int, MeanVisibility] = {}

    def views(self, number: int) -> list[PathVisibility]:
        """The path pairs to a mesh whose occlusion is traced, with its visibility over each."""
        return [self.view(number, pair) for pair in self._sight.pairs]

    def _place(self, end: int, path: OneWayPath | None) -> _Place:
        """Viewpoint of the one-way path at an end."""
        return () if path is None else path.chain, 0 if len(self._sight.radar.views_m) == 1 else end

    def view(self, number: int, pair: PathPair | None) -> PathVisibility:
        """One path pair to a mesh (None in free space), with its visibility."""
        # Where out and back have the same viewpoint it is traced once, but it counts for both paths.
        ends = {self._place(end, path): (end, path) for end, path in _ends(pair) if path or self._solid}
        fractions = tuple(self._fraction(number, *end, 3 - len(ends)) for end in ends.values())
        if self._sight.fast_rotating[number]:
            return PathVisibility(paths=pair, visibility=fractions)
        return PathVisibility(
            paths=pair, visibility=fractions, subdivision=self._subdivision, points=self._meshes.point_count
        )

    def _fraction(self, number: int, end: int, path: OneWayPath | None, path_count: int) -> Fraction:
        """Fraction over the one-way path at an end; it counts for `path_count` paths, 2 where out and back are the same."""
        key, sight = self._place(end, path), self._sight
        viewpoint = viewpoints_at(sight.radar.views_m)[key[1]] if path is None else path
        blockage = None if path is None else partial(sight.blockage.fraction, path)
        if sight.fast_rotating[number]:
            if number not in self._mean:
                mesh = sight.geometries[number]
                assert isinstance(mesh, MovingMesh)  # no ellipsoid rotates that fast, as they move with limbs
                self._mean[number] = MeanVisibility(
                    mesh, self._meshes, sight.samples_s, solid=self._solid, backend=sight.backend
                )
            return self._mean[number].over(key, viewpoint, blockage, path_count)
        if key not in self._occlusions:
            self._occlusions[key] = Occlusion(self._viewpoints, viewpoint, unblocked=blockage, solid=self._solid)
        return _Occluded(self._occlusions[key], path_count, self.index[number])


class ExactOverStrongest:
    """Traces occlusion over the strongest pair from every facet's vertices at every instant asked for, with the targets' facets as
    `occluders`. Over all other pairs, and for fast-rotating targets, visibility is that of `Sampled`."""

    def __init__(self, sight: VisibilityContext, occluders: Sequence[MovingMesh], *, subdivision: int = 0) -> None:
        strongest, others = (replace(sight, pairs=pairs) for pairs in (sight.pairs[:1], sight.pairs[1:]))
        self._sight, self._occluders = sight, occluders
        self._strongest = Sampled(strongest, solid=False)
        self._others = Sampled(others, subdivision=subdivision)

    def views(self, number: int) -> list[PathVisibility]:
        """The path pairs to a mesh whose occlusion is traced, with its visibility over each."""
        if self._sight.fast_rotating[number]:
            return [self._others.view(number, pair) for pair in self._sight.pairs]
        strongest = [
            replace(view, facet_visibility=self._facet_visibility(number, view.paths))
            for view in self._strongest.views(number)
        ]
        return strongest + self._others.views(number)

    def _facet_visibility(self, number: int, pair: PathPair | None) -> FacetVisibility:
        """Function that traces the visibility of a mesh from every facet's vertices over a path pair."""
        mesh_index = self._others.index[number]
        ends = viewpoints_at(self._sight.radar.views_m) if pair is None else [pair.out, pair.back]
        return _TracedFromFacets(
            tuple(
                ExactVisibility(
                    self._occluders,
                    end,
                    backend=self._sight.backend,
                    own=mesh_index,
                    wavelength_m=self._sight.radar.wavelength_m,
                )
                for end in {end.key: end for end in ends}.values()
            )
        )


@dataclass(frozen=True, slots=True)
class _TracedFromFacets:
    """Visibility at the vertices of facets over both one-way paths of a pair: the product of both."""

    ends: tuple[ExactVisibility, ...]

    def __call__(self, *where: np.ndarray) -> np.ndarray:
        # With a single viewpoint for out and back the visibility counts twice.
        return np.asarray(np.prod([end.fraction(*where) for end in self.ends], axis=0) ** (3 - len(self.ends)))


@dataclass(frozen=True, slots=True)
class _Occluded:
    """The fraction of one mesh over a one-way path, as a function of times."""

    occlusion: Occlusion
    path_count: int
    mesh: int

    def __call__(self, times_s: np.ndarray) -> np.ndarray:
        return self.occlusion.visibility(times_s, self.path_count)[self.mesh]


def coarse_views(
    geometry: Geometry,
    pairs: Sequence[PathPair],
    samples_s: np.ndarray,
    scene: SceneBlockage,
    *,
    fast_rotating: bool = False,
    minor: bool = False,
) -> list[PathVisibility]:
    """Path pairs to one target with blockage by the scene only, sampled at a few of its points at `samples_s`; occlusion is not
    traced.

    All points of a `fast_rotating` target share the averaged visibility. Over `minor` pairs ellipsoids have the visibility of their
    centres.
    """
    paths = {path.key: path for pair in pairs for path in (pair.out, pair.back)}
    of_paths = unblocked(
        geometry,
        anchor_vertices(geometry.rest) if isinstance(geometry, MovingMesh) else np.zeros(0, int),
        list(paths.values()),
        scene,
        samples_s,
        minor=minor,
        in_the_mean=fast_rotating,
    )
    fractions = dict(zip(paths, of_paths, strict=True))
    field = "visibility" if isinstance(geometry, Ellipsoids) else "unblocked"
    of_pairs = [tuple(fractions[path.key] for path in (pair.out, pair.back)) for pair in pairs]
    return [PathVisibility(paths=pair, **{field: of_pair}) for pair, of_pair in zip(pairs, of_pairs, strict=True)]  # type: ignore[arg-type]


def _ends(pair: PathPair | None) -> Iterator[tuple[int, OneWayPath | None]]:
    """The ends of a pair, transmitters first: index and one-way path, None in free space."""
    return enumerate((None, None) if pair is None else (pair.out, pair.back))
