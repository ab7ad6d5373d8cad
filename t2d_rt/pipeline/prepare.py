"""What a simulation prepares before its loop over the frames: the scatterers of all targets and of the scene."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.plugins import loaded, plugins
from t2d_rt.pipeline.bounces import Bouncing, bounce_scatterers, direct_pair
from t2d_rt.pipeline.echo_model import Model, resolved, sagitta_rad
from t2d_rt.pipeline.path_pairs import ChosenPairs, Clutter
from t2d_rt.pipeline.periodic import in_periods
from t2d_rt.pipeline.visibility import (
    ExactOverStrongest,
    Sampled,
    VisibilityContext,
    VisibilityModel,
    coarse_views,
)
from t2d_rt.propagation.visibility import sample_times
from t2d_rt.radar.windows import block_end
from t2d_rt.scattering.ellipsoid import ellipsoid_echoes
from t2d_rt.scattering.mesh import Detail, mesh_echoes
from t2d_rt.scattering.patches import CYCLES_PER_STEP, SWEEP_CYCLES
from t2d_rt.scattering.paths import PathVisibility
from t2d_rt.scattering.streams import Resampled, batches
from t2d_rt.types import Accuracy, ByPart, Ellipsoids, Material, MovingMesh, PathPair, PathTier
from t2d_rt.types.scatterer import FrameBlock, Scatterer

OCCLUDER_SAGITTA_SCALE = 2.0
"""Sagitta scale of the facets that serve as occluders where visibility is traced from every facet's vertices; the error is below
-45 dB."""
BESIDE_CLUTTER_DB = -50.0
"""Greatest error of the sum where there are static echoes [dB], which are far stronger than those of a walking person."""
BLOCKAGE_RATE = 0.5
"""Factor on the rate at which visibility is sampled for path pairs without occlusion by the targets: blockage changes over some 10
cm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Prepared:
    """All scatterers of a simulation, ready for its loop."""

    model: Model
    accuracy: Accuracy
    scatterers: list[Scatterer]
    """Scatterers of the targets."""
    static: list[Scatterer]
    """Scatterers of the static scene."""
    counts: dict[str, object]
    """Number of echoes of the static scene, for a recording's settings."""

    @property
    def parts(self) -> list[Scatterer]:
        """Groups of scatterers with the same surface frames, as far as memory allows, followed by the periodic ones, each by
        itself."""
        scatterers = [*self.scatterers, *self.static]
        return batches([scatterer for scatterer in scatterers if scatterer.repeats is None], self.model.radar) + [
            scatterer for scatterer in scatterers if scatterer.repeats is not None
        ]

    @property
    def synthesis_error_db(self) -> float:
        """Greatest error of the synthesis [dB]."""
        error_db = self.accuracy.synthesis_error_db
        return min(error_db, BESIDE_CLUTTER_DB) if self.static else error_db


def prepare(model: Model, accuracy: Accuracy, clutter: Clutter) -> Prepared:
    """Makes the scatterers of all targets, each at its own surface frames, and those of the static scene."""
    pairs = model.pairs(accuracy)
    if pairs is not None and not pairs.switched_on:
        raise InputError(
            "only_paths and without_paths leave path pairs alone that are too weak to be modelled; name others, or model "
            "weaker ones (accuracy.dynamic_range_db, a lower tolerance)"
        )
    static, counts = model.clutter(clutter, accuracy)
    return Prepared(
        model=model, accuracy=accuracy, scatterers=scatterers_of(model, accuracy), static=static, counts=counts
    )


def blocks(part: Scatterer) -> Iterator[FrameBlock]:
    """All surface frames of a scatterer in order, in blocks that fit a fixed amount of memory."""
    first, frames = 0, len(part.times_s)
    while first < frames:
        last = block_end(first, frames, echoes=part.echoes, vertices=part.vertices, at_once=part.at_once)
        yield FrameBlock(part.times_s, first, last)
        first = last


def scatterers_of(
    model: Model, accuracy: Accuracy, instants_s: np.ndarray | None = None, samples_s: np.ndarray | None = None
) -> list[Scatterer]:
    """The scatterers of all targets, at their own surface frames or at the instants `instants_s` only.

    At instants visibility is traced exactly then, over the strongest path pair from every facet's vertices with facets as
    occluders; or, where `samples_s` are given, it is sampled at these times as in a run.
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
    sight = VisibilityContext(
        geometries=model.geometries,
        fast_rotating=fast,
        radar=model.radar,
        samples_s=sampled,
        backend=model.backend,
        pairs=[None] if pairs is None else pairs.occluded,
        blockage=model.blockage,
    )
    preparation = Preparation(
        model=model,
        accuracy=accuracy,
        pairs=pairs,
        sight=sight,
        samples_s=sampled,
        decimated_s=decimated,
        at_instants=instants_s is not None,
        visibility=_visibility(model, accuracy, sight, exact=instants_s is not None and samples_s is None),
    )
    added = plugin_finders()
    scatterers: list[Scatterer] = []
    for number, times_s in enumerate(times):
        scatterers += [scatterer for find in SCATTERERS for scatterer in find(preparation, number, times_s)]
        scatterers += [
            scatterer for name, find in added.items() for scatterer in _added(name, find, preparation, number, times_s)
        ]
    return scatterers + several_bounces(preparation, times)


def _visibility(model: Model, accuracy: Accuracy, sight: VisibilityContext, *, exact: bool) -> VisibilityModel:
    """How visibility is computed: traced from facets at instants (`exact`), sampled, or without occlusion."""
    if not accuracy.occlusion:
        return Sampled(sight, solid=False)
    if not exact:
        return Sampled(sight, subdivision=accuracy.visibility_subdivision)
    # Facets that are nearly as coarse serve as they are.
    scale = accuracy.sagitta_scale if accuracy.sagitta_scale > OCCLUDER_SAGITTA_SCALE / 2 else OCCLUDER_SAGITTA_SCALE
    coarse = accuracy.replace(sagitta_scale=scale)
    meshes = [target.mesh for target, fast in zip(model.modelled, sight.fast_rotating, strict=True) if not fast]
    occluders = [model.facets(mesh, coarse) for mesh in meshes if mesh is not None]
    return ExactOverStrongest(sight, occluders, subdivision=accuracy.visibility_subdivision)


@dataclass(frozen=True, slots=True, kw_only=True)
class Preparation:
    """What the scatterers of all targets need to be made."""

    model: Model
    accuracy: Accuracy
    pairs: ChosenPairs | None
    """Chosen path pairs; None in free space."""
    sight: VisibilityContext
    visibility: VisibilityModel
    samples_s: np.ndarray
    """Times at which visibility is sampled and ray tubes are traced [s]."""
    decimated_s: np.ndarray
    """Times at which visibility is sampled over path pairs without occlusion by the targets [s]."""
    at_instants: bool

    def tiers(self) -> list[tuple[PathTier, list[PathPair] | None]]:
        """Tiers in use, each with its path pairs; None in place of these in free space."""
        return [(self.accuracy.tiers[0], None)] if self.pairs is None else list(self.pairs.by_tier(self.accuracy))

    def detail(self, mesh: MovingMesh, number: int) -> Detail:
        """How finely a mesh is modelled over the tier of that index."""
        tier, sagitta = self.accuracy.tiers[number], sagitta_rad(mesh, self.accuracy)
        most = np.minimum(tier.sagitta_scale * np.asarray(sagitta), tier.greatest_sagitta_rad)
        return Detail(
            sagitta_rad=np.maximum(sagitta, most),
            # At single instants, changes of phase from one frame to the next have no meaning.
            cycles_per_step=math.inf if self.at_instants else tier.patch_phase_scale * CYCLES_PER_STEP,
            sweep_cycles=tier.patch_span_scale * SWEEP_CYCLES,
            points=tier.diffuse_points,
            max_facets=self.model.max_facets,
            span_s=self.model.span_s,
        )


def own_ellipsoids(preparation: Preparation, number: int, times_s: np.ndarray) -> Iterator[Scatterer]:
    """Scatterers of a target that consists of ellipsoids, over all path pairs."""
    model, sight = preparation.model, preparation.sight
    ellipsoids, fast = model.modelled[number].geometry, sight.fast_rotating[number]
    if not isinstance(ellipsoids, Ellipsoids):
        return
    views = [PathVisibility()]
    if preparation.pairs is not None:
        pairs = preparation.pairs.pairs
        views = coarse_views(ellipsoids, pairs, sight.samples_s, model.blockage, fast_rotating=fast)
    yield _ellipsoids(preparation, number, ellipsoids, model.material_of(number), times_s, views)


def facets(preparation: Preparation, number: int, times_s: np.ndarray) -> Iterator[Scatterer]:
    """Scatterers of the facets of a target's mesh, one tier of path pairs after the other."""
    model, fast = preparation.model, preparation.sight.fast_rotating[number]
    target = model.modelled[number]
    if target.mesh is None:
        return
    close = {view.paths: view for view in preparation.visibility.views(number)}
    for tier, pairs in preparation.tiers():
        if pairs and tier.scatterer == "ellipsoids" and target.ellipsoids() is not None:
            continue
        if pairs and tier.visibility != "occlusion":
            views = coarse_views(target.mesh, pairs, preparation.decimated_s, model.blockage, fast_rotating=fast)
        else:
            views = [close[pair] for pair in pairs or (None,)]
        yield from _facets(preparation, number, target.mesh, tier, times_s, views)


def _facets(
    preparation: Preparation,
    number: int,
    mesh: MovingMesh,
    tier: PathTier,
    times_s: np.ndarray,
    views: Sequence[PathVisibility],
) -> list[Scatterer]:
    """Scatterers of the facets of a mesh over the path pairs of one tier."""
    model, accuracy = preparation.model, preparation.accuracy
    fast, place = preparation.sight.fast_rotating[number], accuracy.tiers.index(tier)
    make = partial(
        mesh_echoes,
        mesh,
        model.radar,
        material=model.material_of(number),
        seed=model.seed_of(number),
        backend=model.backend,
        detail=preparation.detail(mesh, place),
        target=number,
    )
    if fast and not preparation.at_instants:
        if tier.decimation > 1:
            times_s = model.decimated(times_s, tier)
        if accuracy.repeats:
            above_db = accuracy.tiers[place - 1].level_db if place else 0.0
            periodic = in_periods(mesh, model.radar, times_s, views, make, level_db=above_db)
            if periodic is not None:
                return periodic
    return [make(times_s=times_s, views=views)]


def limbs(preparation: Preparation, number: int, times_s: np.ndarray) -> Iterator[Scatterer]:
    """Scatterers of the ellipsoids that replace a body's facets over minor path pairs."""
    target, model = preparation.model.modelled[number], preparation.model
    if target.mesh is None:
        return
    for tier, pairs in preparation.tiers():
        ellipsoids = target.ellipsoids() if pairs and tier.scatterer == "ellipsoids" else None
        if not pairs or ellipsoids is None:
            continue
        samples_s, frames_s = preparation.decimated_s, times_s
        if not preparation.at_instants:
            samples_s, frames_s = np.append(samples_s[:-1:2], samples_s[-1]), model.decimated(times_s, tier)
        views = coarse_views(ellipsoids, pairs, samples_s, model.blockage, minor=True)
        # An outfit assigns materials to faces of the mesh, but here to segments.
        echoes = _ellipsoids(
            preparation, number, ellipsoids, resolved(ellipsoids.material, model.radar), frames_s, views
        )
        yield echoes if preparation.at_instants else Resampled.of(echoes, times_s)


def _ellipsoids(
    preparation: Preparation,
    number: int,
    ellipsoids: Ellipsoids,
    material: Material | ByPart,
    times_s: np.ndarray,
    views: Sequence[PathVisibility],
) -> Scatterer:
    model = preparation.model
    return ellipsoid_echoes(
        ellipsoids,
        model.radar,
        times_s=times_s,
        material=material,
        phase_from=model.phase_from,
        views=views,
        target=number,
        at_instants=preparation.at_instants,
    )


Finder = Callable[[Preparation, int, np.ndarray], Iterable[Scatterer]]
"""Function that makes the scatterers of one kind for the target of an index, at its surface frames [s] (T,)."""

SCATTERERS: tuple[Finder, ...] = (own_ellipsoids, facets, limbs)
"""The kinds of scatterers of this package."""


def plugin_finders() -> dict[str, Finder]:
    """Kinds of scatterers that other packages register, by name (docs/extend.md)."""
    names = [finder.__name__ for finder in SCATTERERS]
    return {name: loaded(entry) for name, entry in plugins("scatterers", names).items()}


def _added(name: str, find: Finder, preparation: Preparation, number: int, times_s: np.ndarray) -> list[Scatterer]:
    """The scatterers that another package makes for a target, checked."""
    try:
        scatterers = list(find(preparation, number, times_s))
    except Exception as error:  # it may raise anything, as it is other people's code
        raise InputError(
            f"the scatterers {name} of another package failed ({type(error).__name__}: {error}); repair or uninstall that package"
        ) from error
    wrong = [
        scatterer
        for scatterer in scatterers
        if not isinstance(scatterer, Scatterer)
        or scatterer.echoes < 1
        or not np.array_equal(scatterer.times_s, times_s)
        or len(scatterer.labels.target) != scatterer.echoes
    ]
    if wrong:
        raise InputError(
            f"the scatterers {name} of another package gave {shown(wrong[0])}, which must be a Scatterer of 1 echo or more at the "
            "frames that it was asked for, with as many labels; repair or uninstall that package"
        )
    return scatterers


def several_bounces(preparation: Preparation, times: Sequence[np.ndarray]) -> list[Scatterer]:
    """Scatterers of several bounces between all targets, on the direct path pair alone; `times` are the surface frames of each
    target [s]."""
    model, accuracy = preparation.model, preparation.accuracy
    if model.bounces == 1:
        return []
    direct = None
    if preparation.pairs is not None:
        pairs = preparation.pairs.pairs
        if (pair := direct_pair(pairs, model.bounces, warned=not preparation.at_instants)) is None:
            return []
        direct = pair, model.blockage
    # The same targets take part in a run and in the measurement of its error, where fans are sampled point by point.
    fast = model.fast_rotating(accuracy.replace(fast_rotating_hz=None))
    targets = [
        Bouncing(
            name=geometry.name,
            mesh=None if accuracy.by_ellipsoids and target.ellipsoids() else target.mesh,
            fast_rotating=fast[number],
            material=model.material_of(number),
            times_s=times[number],
            sagitta_rad=sagitta_rad(target.mesh, accuracy) if target.mesh else 0.0,
        )
        for number, (target, geometry) in enumerate(zip(model.modelled, model.geometries, strict=True))
    ]
    return bounce_scatterers(
        targets,
        model.radar,
        span_s=model.span_s,
        samples_s=None if preparation.at_instants else preparation.samples_s,
        bounces=model.bounces,
        direct=direct,
        backend=model.backend,
        memory=model.memory,
    )
