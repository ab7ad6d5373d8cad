"""Targets before a radar as streams of echoes, at any accuracy."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from t2d_rt.body.materials import BODY_MATERIALS, resolve_material
from t2d_rt.core.backend import Backend
from t2d_rt.core.errors import InputError
from t2d_rt.core.memory import Budget, blocks
from t2d_rt.geometry.vectors import lengths
from t2d_rt.pipeline.bounces import Bouncing, bounce_streams, direct_pair
from t2d_rt.pipeline.path_pairs import ChosenPairs, Clutter, clutter_streams
from t2d_rt.pipeline.periodic import in_periods
from t2d_rt.pipeline.targets import TargetLike
from t2d_rt.pipeline.visibility import ExactOverStrongest, Sampled, Sight, Unoccluded, Visibility, coarse_views
from t2d_rt.propagation.edges import SceneBlockage
from t2d_rt.propagation.materials import itu_material
from t2d_rt.propagation.visibility import KeptVisibility, Occlusion, sample_times
from t2d_rt.scattering.ellipsoid import PhaseFrom, ellipsoid_echoes
from t2d_rt.scattering.mesh import CLOSED_FORM, Detail, FacetMethod, mesh_echoes
from t2d_rt.scattering.patches import CYCLES_PER_STEP, SWEEP_CYCLES
from t2d_rt.scattering.paths import Ranked, View
from t2d_rt.scattering.rate import SurfaceRate
from t2d_rt.scattering.refinement import Sagitta, facets, most_facets
from t2d_rt.types import (
    Accuracy,
    EchoStream,
    Ellipsoids,
    Material,
    Motion,
    MovingMesh,
    PathPair,
    PathTier,
    Radar,
    Scene,
    resampled,
)
from t2d_rt.types.target import Geometry, Method, Target

SPLINE_ERROR_DB = Accuracy().spline_error_db
OCCLUDER_SAGITTA_SCALE = 2.0
"""Sagitta scale of facets that occlude others, where visibility is traced from every facet's vertices: below -45 dB."""
LEAST_SPEED_SAMPLES, SPEED_SAMPLES = 50, 200
"""Instants at which speeds are sampled, at least and at most."""
SPEED_RATE_HZ = 1000.0
"""In records in between: eight instants in a rotation at 7500 rpm."""
SAME_RATE = 2.0
"""Targets whose surface rates differ by more are summed apart, each at its own."""
MINOR_FRAMES = 128
"""Surface frames of ellipsoids that are worked out at once over minor paths: there are many small arrays."""
TWIN_SEED = 1_000_003
"""Between the seeds of targets that have the same shape at rest."""
BLOCKAGE_RATE = 0.5
"""Visibility of path pairs without their own occlusion is sampled less often, by this factor: fields fade over some 10 cm."""


class Next(NamedTuple):
    """What will be asked for after a run."""

    accuracy: Accuracy
    kept: KeptVisibility


@dataclass(frozen=True)
class Model:
    """How targets become echoes, path pairs of every tier at its own accuracy."""

    radar: Radar
    modelled: Sequence[Target]
    span_s: tuple[float, float]
    scene: Scene | None
    """None in free space."""
    ranked: Sequence[Ranked]
    """Path pairs to the targets, where there is a scene."""
    blockage: SceneBlockage
    """What of the scene blocks them."""
    _: KW_ONLY
    method: Method
    material: str | Material | None
    body: str
    phase_from: PhaseFrom
    seed: int
    backend: Backend
    memory: Budget
    bounces: int = 1
    """Greatest number of them, within and between targets."""
    facet_method: FacetMethod = CLOSED_FORM
    occlusion: type[Occlusion] = Occlusion
    """How occlusion is found."""
    surface_rates: dict[int, SurfaceRate] = field(default_factory=dict)
    """What was found of the rates that targets need, by their number."""

    @property
    def targets(self) -> list[TargetLike]:
        """The targets as they were given, motions after placement."""
        return [target.source for target in self.modelled]

    @property
    def geometries(self) -> list[Geometry]:
        """The geometry of each target."""
        return [target.geometry for target in self.modelled]

    def rates_hz(self, accuracy: Accuracy) -> list[float]:
        """Surface rate of each target: what its motion needs, and no less than visibility is sampled at."""
        if accuracy.surface_rate_hz is not None:
            return [accuracy.surface_rate_hz] * len(self.geometries)
        sampled_hz = accuracy.visibility_rate_hz if accuracy.occlusion else 0.0
        return [
            max(
                self.rate(number).needed_hz(accuracy.spline_error_db),
                sampled_hz if isinstance(geometry, MovingMesh) else 0.0,
            )
            for number, geometry in enumerate(self.geometries)
        ]

    def rate(self, number: int) -> SurfaceRate:
        """What the motion of the target of that number needs."""
        if number not in self.surface_rates:
            stand_in = self.modelled[number].ellipsoids()
            self.surface_rates[number] = SurfaceRate(self.geometries[number], self.radar, self.span_s, stand_in)
        return self.surface_rates[number]

    def frame_times(self, accuracy: Accuracy) -> list[np.ndarray]:
        """Surface frames of each target [s] at its rate or more; those that need about the same rate have the same ones."""
        rates = self.rates_hz(accuracy)
        length = self.span_s[1] - self.span_s[0]
        times: dict[float, np.ndarray] = {}
        for rate in sorted(rates, reverse=True):
            if not times or rate < min(times) / SAME_RATE:
                times[rate] = np.linspace(*self.span_s, max(4, math.ceil(length * rate) + 1))
        return [times[min(each for each in times if each >= rate)] for rate in rates]

    def facets(self, geometry: MovingMesh, accuracy: Accuracy) -> MovingMesh:
        """The facets of a target in free space."""
        return facets(
            geometry, self.radar, sagitta_rad(geometry, accuracy), span_s=self.span_s, max_facets=self.max_facets
        )

    @property
    def max_facets(self) -> int:
        """Of one mesh, in the memory that may be taken."""
        return most_facets(self.memory)

    def pairs(self, accuracy: Accuracy) -> ChosenPairs | None:
        """Path pairs in use; None in free space."""
        return None if self.scene is None else ChosenPairs.of(self.ranked, accuracy)

    def fast_rotating(self, accuracy: Accuracy) -> list[bool]:
        """Which targets rotate too fast for their visibility to be sampled point by point."""
        return [
            target.may_rotate_fast and self.rate(number).rotation_hz(SPLINE_ERROR_DB) > accuracy.fastest_sampled_hz
            for number, target in enumerate(self.modelled)
        ]

    def streams(
        self,
        accuracy: Accuracy,
        instants_s: np.ndarray | None = None,
        *,
        kept: KeptVisibility | None = None,
        then: Next | None = None,
    ) -> list[EchoStream]:
        """Echoes of all targets at surface frames of their own, or at just these instants.

        At instants visibility is traced just then, over the strongest path pair from every facet's vertices, through the facets; or
        as in a run, sampled, at the times of what is `kept`. `then` is what will be asked for next: its facets
        are made along, and visibility is kept for it.
        """
        pairs, fast = self.pairs(accuracy), self.fast_rotating(accuracy)
        if instants_s is None:
            times = self.frame_times(accuracy)
            sampled, decimated = (
                sample_times(*self.span_s, rate * accuracy.visibility_rate_hz) for rate in (1.0, BLOCKAGE_RATE)
            )
        else:
            times, decimated = [instants_s] * len(self.modelled), np.unique(instants_s)
            sampled = decimated if kept is None else kept.times_s
        sight = Sight(
            geometries=self.geometries, fast_rotating=fast, radar=self.radar, samples_s=sampled, backend=self.backend,
            pairs=[None] if pairs is None else pairs.occluded, blockage=self.blockage, kept=kept if then is None else then.kept,
            occlusion=self.occlusion,
        )  # fmt: skip
        run = _Run(
            accuracy=accuracy, pairs=pairs, sight=sight, samples_s=sampled, decimated_s=decimated,
            at_instants=instants_s is not None, then=then,
            visibility=self._visibility(accuracy, sight, exact=instants_s is not None and kept is None),
        )  # fmt: skip
        found = [stream for number in range(len(self.modelled)) for stream in self._of(number, times[number], run)]
        return found + self._bounced(times, run)

    def _visibility(self, accuracy: Accuracy, sight: Sight, *, exact: bool) -> Visibility:
        """The strategy of visibility: `exact` at instants, through the facets, or sampled."""
        if not accuracy.occlusion:
            return Unoccluded(sight)
        if not exact:
            return Sampled(sight, subdivision=accuracy.visibility_subdivision)
        # Facets about as coarse as that need no refinement of their own.
        own = accuracy.sagitta_scale if accuracy.sagitta_scale > OCCLUDER_SAGITTA_SCALE / 2 else OCCLUDER_SAGITTA_SCALE
        coarse = accuracy.replace(sagitta_scale=own)
        meshes = [target.mesh for target, fast in zip(self.modelled, sight.fast_rotating, strict=True) if not fast]
        occluders = [self.facets(mesh, coarse) for mesh in meshes if mesh is not None]
        return ExactOverStrongest(sight, occluders, subdivision=accuracy.visibility_subdivision)

    def _of(self, number: int, times_s: np.ndarray, run: _Run) -> Iterator[EchoStream]:
        """Echoes of one target, tier by tier."""
        mesh, fast = self.modelled[number].mesh, run.sight.fast_rotating[number]
        if mesh is None:
            geometry, samples_s, pairs = self.geometries[number], run.sight.samples_s, run.pairs and run.pairs.pairs
            views = coarse_views(geometry, pairs, samples_s, self.blockage, fast_rotating=fast) if pairs else [View()]
            ellipsoids = self.modelled[number].ellipsoids()
            assert ellipsoids is not None  # what has no mesh has these
            yield self._ellipsoid_echoes(number, ellipsoids, times_s, views)
            return
        close = {view.paths: view for view in run.visibility.views(number)}
        for tier, pairs in [(run.accuracy.tiers[0], None)] if run.pairs is None else run.pairs.by_tier(run.accuracy):
            place = run.accuracy.tiers.index(tier)
            limbs = self.modelled[number].ellipsoids() if pairs and tier.scatterer == "ellipsoids" else None
            if pairs and limbs is not None:
                yield self._minor(number, limbs, tier, pairs, times_s, run)
            else:
                if pairs and tier.visibility == "shared":
                    views = run.visibility.with_shared_occlusion(number, pairs, run.decimated_s)
                elif pairs and tier.visibility != "occlusion":
                    views = coarse_views(mesh, pairs, run.decimated_s, self.blockage, fast_rotating=fast)
                else:
                    views = [close[pair] for pair in pairs or (None,)]
                make = partial(
                    mesh_echoes, mesh, self.radar, material=self._material(number), seed=self._seed(number), backend=self.backend,
                    detail=run.detail(mesh, place, self),
                )  # fmt: skip
                above_db = run.accuracy.tiers[place - 1].level_db if place else 0.0
                frames_s = self._decimated(times_s, tier, run) if fast and tier.decimation > 1 else times_s
                repeats = fast and run.accuracy.repeats and not run.at_instants
                found = in_periods(mesh, self.radar, frames_s, views, make, level_db=above_db) if repeats else None
                yield from [make(times_s=frames_s, views=views)] if found is None else found

    def _bounced(self, times: Sequence[np.ndarray], run: _Run) -> list[EchoStream]:
        """Echoes of all targets over several bounces, on the direct path pair alone."""
        if self.bounces == 1:
            return []
        direct = None
        if run.pairs is not None:
            warned = not run.at_instants and not any(run.pairs.switched_off)
            if (pair := direct_pair(run.pairs.pairs, self.bounces, warned=warned)) is None:
                return []
            direct = pair, self.blockage
        # The same ones in a run and where its error is measured, which samples fans point by point.
        fast = self.fast_rotating(run.accuracy.replace(fast_rotating_hz=None))
        targets = [
            Bouncing(
                name=geometry.name, mesh=None if run.accuracy.by_ellipsoids and target.ellipsoids() else target.mesh,
                fast_rotating=fast[number], material=self._material(number), times_s=times[number],
                sagitta_rad=sagitta_rad(target.mesh, run.accuracy) if target.mesh else 0.0,
            )
            for number, (target, geometry) in enumerate(zip(self.modelled, self.geometries, strict=True))
        ]  # fmt: skip
        return bounce_streams(
            targets, self.radar, span_s=self.span_s, samples_s=None if run.at_instants else run.samples_s,
            bounces=self.bounces, direct=direct, backend=self.backend, memory=self.memory,
        )  # fmt: skip

    def _minor(
        self, number: int, limbs: Ellipsoids, tier: PathTier, pairs: Sequence[PathPair], times_s: np.ndarray, run: _Run
    ) -> EchoStream:
        """Echoes of a body by its ellipsoids, over minor path pairs."""
        samples_s = run.decimated_s
        if not run.at_instants:
            samples_s = np.append(samples_s[:-1:2], samples_s[-1])
        views = coarse_views(limbs, pairs, samples_s, self.blockage, minor=True)
        echoes = self._ellipsoid_echoes(number, limbs, self._decimated(times_s, tier, run), views)
        return echoes if run.at_instants else resampled(echoes, times_s, MINOR_FRAMES)

    def _ellipsoid_echoes(
        self, number: int, ellipsoids: Ellipsoids, times_s: np.ndarray, views: Sequence[View]
    ) -> EchoStream:
        return ellipsoid_echoes(
            ellipsoids, self.radar, times_s=times_s, material=self._material(number), phase_from=self.phase_from, views=views
        )  # fmt: skip

    def _seed(self, number: int) -> int:
        """Of a target's diffuse points: two persons of one shape have points of their own."""
        rest = [None if target.mesh is None else target.mesh.rest for target in self.modelled[: number + 1]]
        return self.seed + TWIN_SEED * sum(np.array_equal(rest[-1], other) for other in rest[:-1])  # type: ignore[arg-type]

    def _material(self, number: int) -> Material:
        """What a target is made of, at mid-sweep."""
        return resolved(self.modelled[number].material, self.radar)

    def _decimated(self, times_s: np.ndarray, tier: PathTier, run: _Run) -> np.ndarray:
        """Every so many of the surface frames; all of them at instants."""
        if run.at_instants:
            return times_s
        return np.linspace(*self.span_s, max(4, math.ceil(len(times_s) / tier.decimation)))

    def clutter(self, kind: Clutter, accuracy: Accuracy) -> tuple[list[EchoStream], dict[str, object]]:
        """Echoes of the static scene, and how many there are."""
        if self.scene is None or kind == "none":
            return [], {}
        fast, occludes = self.fast_rotating(accuracy), accuracy.occludes_clutter
        occluders = [
            geometry for geometry, rotates in zip(self.geometries, fast, strict=True) if occludes and not rotates
        ]
        return clutter_streams(
            kind, self.scene, occluders, self.radar, min(self.frame_times(accuracy), key=len),
            samples_s=sample_times(*self.span_s, accuracy.visibility_rate_hz), seed=self.seed, backend=self.backend,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class _Run:
    """What the echoes of all targets have in common."""

    accuracy: Accuracy
    pairs: ChosenPairs | None
    """None in free space."""
    sight: Sight
    visibility: Visibility
    samples_s: np.ndarray
    """When visibility is sampled, and ray tubes are traced."""
    decimated_s: np.ndarray
    """When visibility is sampled over path pairs without their own occlusion."""
    at_instants: bool
    then: Next | None
    """What will be asked for next."""

    def detail(self, mesh: MovingMesh, number: int, model: Model) -> Detail:
        """How a mesh is modelled over the tier of that number."""

        def of(accuracy: Accuracy) -> Detail:
            tier, sagitta = accuracy.tiers[number], sagitta_rad(mesh, accuracy)
            found = detail(sagitta, tier, model.span_s, at_instants=self.at_instants, max_facets=model.max_facets)
            off = self.pairs.switched_off[number] if self.pairs else ()
            return replace(found, method=model.facet_method, switched_off=off)

        if self.then is None or number >= len(self.then.accuracy.tiers):
            return of(self.accuracy)
        return replace(of(self.accuracy), also_rad=(of(self.then.accuracy).sagitta_rad,))


def sagitta_rad(geometry: MovingMesh, accuracy: Accuracy) -> Sagitta:
    """Phase sagitta of a mesh's facets over dominant paths."""
    own = geometry.sagitta_rad if accuracy.sagitta_rad is None else accuracy.sagitta_rad
    return np.multiply(accuracy.sagitta_scale, own)


def detail(
    sagitta: Sagitta, tier: PathTier, span_s: tuple[float, float], *, at_instants: bool, max_facets: int
) -> Detail:
    """How a mesh is modelled over the path pairs of a tier, given its sagitta over dominant ones."""
    most = np.minimum(tier.sagitta_scale * np.asarray(sagitta), tier.greatest_sagitta_rad)
    return Detail(
        sagitta_rad=np.maximum(sagitta, most),
        # At instants frames lie far apart, and phases from one to the next mean nothing.
        cycles_per_step=math.inf if at_instants else tier.patch_phase_scale * CYCLES_PER_STEP,
        sweep_cycles=tier.patch_span_scale * SWEEP_CYCLES,
        points=tier.diffuse_points,
        max_facets=max_facets,
        span_s=span_s,
    )


def farthest_and_fastest(geometry: Geometry, radar: Radar, span_s: tuple[float, float]) -> tuple[float, float]:
    """Greatest range [m] and speed towards or from the antennas [m/s] of any point of a target."""
    start, stop = span_s
    step = min(1e-3, (stop - start) / 10)
    places = np.unique([radar.tx_position_m, radar.rx_position_m], axis=0)
    farthest, fastest = 0.0, 0.0
    count = int(np.clip(math.ceil((stop - start) * SPEED_RATE_HZ), LEAST_SPEED_SAMPLES, SPEED_SAMPLES))
    for times in blocks(np.linspace(start, stop - step, count), geometry.point_count):
        points = [geometry.points_at(t) for t in (times, times + step)]
        ranges = [np.mean([lengths(p - place) for place in places], axis=0) for p in points]
        farthest = max(farthest, float(ranges[0].max()))
        fastest = max(fastest, float(np.abs(ranges[1] - ranges[0]).max() / step))
    return farthest, fastest


def resolved(material: str | Material, radar: Radar) -> Material:
    """Values at mid-sweep: a body's material, or an ITU one by name."""
    if isinstance(material, Material) or material in BODY_MATERIALS:
        return resolve_material(material, radar.mid_frequency_hz)
    if not isinstance(material, str):
        raise InputError(f"material must be a name or a Material, got {material!r}")
    try:
        return itu_material(material, radar.mid_frequency_hz)
    except InputError as error:
        raise InputError(f"{error}; or one of {', '.join(BODY_MATERIALS)}") from None


def with_method(model: Model, method: Method) -> Model:
    """The same targets, bodies by another echo model."""
    modelled = [target.by(method) if isinstance(target.source, Motion) else target for target in model.modelled]
    return replace(model, modelled=modelled, method=method, surface_rates={})
