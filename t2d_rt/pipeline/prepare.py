"""What a simulation finds once, before its loop over the frames: the scatterers of all targets and of the scene."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from t2d_rt.pipeline.bounces import Bouncing, bounce_scatterers, direct_pair
from t2d_rt.pipeline.echo_model import Model, detail, sagitta_rad
from t2d_rt.pipeline.path_pairs import ChosenPairs, Clutter
from t2d_rt.pipeline.periodic import in_periods
from t2d_rt.pipeline.visibility import (
    ExactOverStrongest,
    Sampled,
    Sight,
    Unoccluded,
    VisibilityModel,
    coarse_views,
)
from t2d_rt.propagation.visibility import sample_times
from t2d_rt.radar.windows import block_end
from t2d_rt.scattering.ellipsoid import ellipsoid_echoes
from t2d_rt.scattering.mesh import Detail, mesh_echoes
from t2d_rt.scattering.paths import View
from t2d_rt.scattering.streams import Resampled, batches
from t2d_rt.types import Accuracy, Ellipsoids, MovingMesh, PathPair, PathTier
from t2d_rt.types.scatterer import FrameBlock, Scatterer

OCCLUDER_SAGITTA_SCALE = 2.0
"""Sagitta scale of facets that occlude others, where visibility is traced from every facet's vertices: below -45 dB."""
BESIDE_CLUTTER_DB = -50.0
"""Greatest error of the sum where there are static echoes: they are far stronger than those of a walker."""
BLOCKAGE_RATE = 0.5
"""Visibility of path pairs without their own occlusion is sampled less often, by this factor: fields fade over some 10 cm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Prepared:
    """All that returns echoes in a simulation."""

    model: Model
    accuracy: Accuracy
    scatterers: list[Scatterer]
    """Those of the targets."""
    static: list[Scatterer]
    """Those of the static scene."""
    counts: dict[str, object]
    """How many echoes the static scene has, for a recording's settings."""

    @property
    def parts(self) -> list[Scatterer]:
        """Those of the same surface frames together, as far as memory allows, and then what repeats, each by itself."""
        every = [*self.scatterers, *self.static]
        return batches([each for each in every if each.repeats is None], self.model.radar) + [
            each for each in every if each.repeats is not None
        ]

    @property
    def synthesis_error_db(self) -> float:
        """Greatest error of the sum."""
        error_db = self.accuracy.synthesis_error_db
        return min(error_db, BESIDE_CLUTTER_DB) if self.static else error_db


def prepare(model: Model, accuracy: Accuracy, clutter: Clutter) -> Prepared:
    """Finds the scatterers of all targets at surface frames of their own, and those of the static scene."""
    static, counts = model.clutter(clutter, accuracy)
    return Prepared(
        model=model, accuracy=accuracy, scatterers=scatterers_of(model, accuracy), static=static, counts=counts
    )


def blocks(part: Scatterer) -> Iterator[FrameBlock]:
    """All surface frames in order, as many at a time as fit a fixed amount of memory."""
    first, frames = 0, len(part.times_s)
    while first < frames:
        last = block_end(first, frames, echoes=part.echoes, vertices=part.vertices, at_once=part.at_once)
        yield FrameBlock(part.times_s, first, last)
        first = last


def scatterers_of(
    model: Model, accuracy: Accuracy, instants_s: np.ndarray | None = None, samples_s: np.ndarray | None = None
) -> list[Scatterer]:
    """The scatterers of all targets, at surface frames of their own or at just these instants.

    At instants visibility is traced just then, over the strongest path pair from every facet's vertices, through the facets; or,
    where `samples_s` are given, it is sampled at these times as in a run.
    """
    pairs, fast = model.pairs(accuracy), model.fast_rotating(accuracy)
    if instants_s is None:
        times = model.frame_times(accuracy)
        sampled, decimated = (
            sample_times(*model.span_s, rate * accuracy.visibility_rate_hz) for rate in (1.0, BLOCKAGE_RATE)
        )
    else:
        times, decimated = [instants_s] * len(model.modelled), np.unique(instants_s)
        sampled = decimated if samples_s is None else samples_s
    sight = Sight(
        geometries=model.geometries, fast_rotating=fast, radar=model.radar, samples_s=sampled, backend=model.backend,
        pairs=[None] if pairs is None else pairs.occluded, blockage=model.blockage,
    )  # fmt: skip
    preparation = _Preparation(
        model=model, accuracy=accuracy, pairs=pairs, sight=sight, samples_s=sampled, decimated_s=decimated,
        at_instants=instants_s is not None,
        visibility=_visibility(model, accuracy, sight, exact=instants_s is not None and samples_s is None),
    )  # fmt: skip
    found = [each for number in range(len(model.modelled)) for each in preparation.of_target(number, times[number])]
    return found + preparation.bounced(times)


def _visibility(model: Model, accuracy: Accuracy, sight: Sight, *, exact: bool) -> VisibilityModel:
    """How visibility is found: `exact` at instants, through the facets, or sampled."""
    if not accuracy.occlusion:
        return Unoccluded(sight)
    if not exact:
        return Sampled(sight, subdivision=accuracy.visibility_subdivision)
    # Facets about as coarse as that need no refinement of their own.
    own = accuracy.sagitta_scale if accuracy.sagitta_scale > OCCLUDER_SAGITTA_SCALE / 2 else OCCLUDER_SAGITTA_SCALE
    coarse = accuracy.replace(sagitta_scale=own)
    meshes = [target.mesh for target, fast in zip(model.modelled, sight.fast_rotating, strict=True) if not fast]
    occluders = [model.facets(mesh, coarse) for mesh in meshes if mesh is not None]
    return ExactOverStrongest(sight, occluders, subdivision=accuracy.visibility_subdivision)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Preparation:
    """What the scatterers of all targets have in common."""

    model: Model
    accuracy: Accuracy
    pairs: ChosenPairs | None
    """None in free space."""
    sight: Sight
    visibility: VisibilityModel
    samples_s: np.ndarray
    """When visibility is sampled, and ray tubes are traced."""
    decimated_s: np.ndarray
    """When visibility is sampled over path pairs without their own occlusion."""
    at_instants: bool

    def of_target(self, number: int, times_s: np.ndarray) -> Iterator[Scatterer]:
        """Those of one target, tier by tier."""
        target, fast = self.model.modelled[number], self.sight.fast_rotating[number]
        if target.mesh is None:
            pairs = self.pairs and self.pairs.pairs
            views = self._coarse_views(target.geometry, pairs, self.sight.samples_s, fast) if pairs else [View()]
            ellipsoids = target.ellipsoids()
            assert ellipsoids is not None  # what has no mesh has these
            yield self._ellipsoids(number, ellipsoids, times_s, views)
            return
        close = {view.paths: view for view in self.visibility.views(number)}
        tiers = [(self.accuracy.tiers[0], None)] if self.pairs is None else self.pairs.by_tier(self.accuracy)
        for tier, pairs in tiers:
            limbs = target.ellipsoids() if pairs and tier.scatterer == "ellipsoids" else None
            if pairs and limbs is not None:
                yield self._minor(number, limbs, tier, pairs, times_s)
                continue
            if pairs and tier.visibility == "shared":
                views = self.visibility.with_shared_occlusion(number, pairs, self.decimated_s)
            elif pairs and tier.visibility != "occlusion":
                views = self._coarse_views(target.mesh, pairs, self.decimated_s, fast)
            else:
                views = [close[pair] for pair in pairs or (None,)]
            yield from self._mesh(number, target.mesh, tier, times_s, views)

    def _mesh(
        self, number: int, mesh: MovingMesh, tier: PathTier, times_s: np.ndarray, views: Sequence[View]
    ) -> list[Scatterer]:
        """The facets of a mesh over the path pairs of a tier."""
        model, fast, place = self.model, self.sight.fast_rotating[number], self.accuracy.tiers.index(tier)
        make = partial(
            mesh_echoes, mesh, model.radar, material=model.material_of(number), seed=model.seed_of(number), backend=model.backend,
            detail=self._detail(mesh, place), target=number,
        )  # fmt: skip
        if fast and tier.decimation > 1 and not self.at_instants:
            times_s = model.decimated(times_s, tier)
        if fast and self.accuracy.repeats and not self.at_instants:
            above_db = self.accuracy.tiers[place - 1].level_db if place else 0.0
            if (found := in_periods(mesh, model.radar, times_s, views, make, level_db=above_db)) is not None:
                return found
        return [make(times_s=times_s, views=views)]

    def _detail(self, mesh: MovingMesh, number: int) -> Detail:
        """How a mesh is modelled over the tier of that number."""
        tier, model = self.accuracy.tiers[number], self.model
        found = detail(
            sagitta_rad(mesh, self.accuracy), tier, model.span_s, at_instants=self.at_instants, max_facets=model.max_facets
        )  # fmt: skip
        return replace(found, switched_off=self.pairs.switched_off[number] if self.pairs else ())

    def _minor(
        self, number: int, limbs: Ellipsoids, tier: PathTier, pairs: Sequence[PathPair], times_s: np.ndarray
    ) -> Scatterer:
        """A body's ellipsoids, over minor path pairs."""
        if self.at_instants:
            views = coarse_views(limbs, pairs, self.decimated_s, self.model.blockage, minor=True)
            return self._ellipsoids(number, limbs, times_s, views)
        samples_s = np.append(self.decimated_s[:-1:2], self.decimated_s[-1])
        views = coarse_views(limbs, pairs, samples_s, self.model.blockage, minor=True)
        own = self._ellipsoids(number, limbs, self.model.decimated(times_s, tier), views)
        return Resampled.of(own, times_s)

    def _ellipsoids(self, number: int, ellipsoids: Ellipsoids, times_s: np.ndarray, views: Sequence[View]) -> Scatterer:
        model = self.model
        return ellipsoid_echoes(
            ellipsoids, model.radar, times_s=times_s, material=model.material_of(number), phase_from=model.phase_from, views=views,
            target=number,
        )  # fmt: skip

    def _coarse_views(
        self, geometry: MovingMesh | Ellipsoids, pairs: Sequence[PathPair], samples_s: np.ndarray, fast: bool
    ) -> list[View]:
        return coarse_views(geometry, pairs, samples_s, self.model.blockage, fast_rotating=fast)

    def bounced(self, times: Sequence[np.ndarray]) -> list[Scatterer]:
        """Those of several bounces of all targets, on the direct path pair alone."""
        model, accuracy = self.model, self.accuracy
        if model.bounces == 1:
            return []
        direct = None
        if self.pairs is not None:
            warned = not self.at_instants and not any(self.pairs.switched_off)
            if (pair := direct_pair(self.pairs.pairs, model.bounces, warned=warned)) is None:
                return []
            direct = pair, model.blockage
        # The same ones in a run and where its error is measured, which samples fans point by point.
        fast = model.fast_rotating(accuracy.replace(fast_rotating_hz=None))
        targets = [
            Bouncing(
                name=geometry.name, mesh=None if accuracy.by_ellipsoids and target.ellipsoids() else target.mesh,
                fast_rotating=fast[number], material=model.material_of(number), times_s=times[number],
                sagitta_rad=sagitta_rad(target.mesh, accuracy) if target.mesh else 0.0,
            )
            for number, (target, geometry) in enumerate(zip(model.modelled, model.geometries, strict=True))
        ]  # fmt: skip
        return bounce_scatterers(
            targets, model.radar, span_s=model.span_s, samples_s=None if self.at_instants else self.samples_s,
            bounces=model.bounces, direct=direct, backend=model.backend, memory=model.memory,
        )  # fmt: skip
