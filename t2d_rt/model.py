"""Targets before a radar as streams of echoes, at any accuracy."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any, Literal

import numpy as np

from t2d_rt.backend import Backend
from t2d_rt.body import segments as fit_segments
from t2d_rt.body import skin as skin_body
from t2d_rt.body.materials import BODY_MATERIALS, resolve_material
from t2d_rt.errors import InputError
from t2d_rt.memory import Budget, blocks
from t2d_rt.motion import place, track
from t2d_rt.propagation.materials import itu_material
from t2d_rt.propagation.visibility import sample_times
from t2d_rt.room import ChosenPairs, Clutter, Geometry, TargetVisibility, clutter_streams, coarse_views
from t2d_rt.scattering.ellipsoid import PhaseFrom, ellipsoid_echoes
from t2d_rt.scattering.mesh import Detail, mesh_echoes
from t2d_rt.scattering.patches import CYCLES_PER_STEP, SWEEP_CYCLES
from t2d_rt.scattering.paths import Ranked
from t2d_rt.scattering.rate import needed_rate_hz
from t2d_rt.scattering.refinement import REFINING_BYTES, Sagitta, facets
from t2d_rt.scene import Mover
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
from t2d_rt.types.accuracy import EVERY_PATH_DB
from t2d_rt.types.material import checked_material
from t2d_rt.types.mesh import Made

Method = Literal["mesh", "ellipsoid"]
Target = Motion | MovingMesh | Ellipsoids | Mover

SPLINE_ERROR_DB = Accuracy().spline_error_db
LEAST_LEVEL_DB = EVERY_PATH_DB + 1
"""Lowest level of dominant path pairs, so that there can be a tier below."""
SECONDARY = {"sagitta_scale": 3.0, "greatest_sagitta_rad": 1.5, "patch_phase_scale": 2.0}
SECONDARY_DB = -14.0
"""How path pairs of less weight are modelled where a tolerance is to be kept, and their error over those pairs' power."""
OCCLUDER_SAGITTA_SCALE = 2.0
"""Sagitta scale of facets that occlude others, where visibility is traced from every facet's vertices: below -45 dB."""
MOST_SUBDIVISION = 2
"""Greatest subdivision from which visibility is sampled by a plan."""
SPEED_SAMPLES = 200
"""Instants at which speeds are sampled."""
SAME_RATE = 2.0
"""Targets whose surface rates differ by more are summed apart, each at its own."""
MINOR_FRAMES = 128
"""Surface frames of ellipsoids that are worked out at once over minor paths: there are many small arrays."""
BLOCKAGE_RATE = 0.5
"""Visibility of path pairs without their own occlusion is sampled less often, by this factor: fields fade over some 10 cm."""


@dataclass(frozen=True)
class Model:
    """How targets become echoes, path pairs of every tier at its own accuracy."""

    radar: Radar
    targets: Sequence[Target]
    geometries: Sequence[Geometry]
    span_s: tuple[float, float]
    scene: Scene | None
    """None in free space."""
    ranked: Sequence[Ranked]
    """Path pairs to the targets, where there is a scene."""
    _: KW_ONLY
    method: Method
    material: str | Material | None
    body: str
    phase_from: PhaseFrom
    seed: int
    backend: Backend
    memory: Budget
    needed_hz: dict[tuple[int, float], float] = field(default_factory=dict)
    """Surface rates that were asked for, by the target's number and `Accuracy.spline_error_db`."""

    def rates_hz(self, accuracy: Accuracy) -> list[float]:
        """Surface rate of each target."""
        if accuracy.surface_rate_hz is not None:
            return [accuracy.surface_rate_hz] * len(self.geometries)
        return [self._needed(number, accuracy.spline_error_db) for number in range(len(self.geometries))]

    def _needed(self, number: int, error_db: float) -> float:
        key = number, error_db
        if key not in self.needed_hz:
            self.needed_hz[key] = needed_rate_hz(self.geometries[number], self.radar, *self.span_s, error_db)
        return self.needed_hz[key]

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
        return int(self.memory.limit_bytes / REFINING_BYTES)

    def pairs(self, accuracy: Accuracy) -> ChosenPairs | None:
        """Path pairs in use; None in free space."""
        return None if self.scene is None else ChosenPairs.of(self.ranked, accuracy)

    def paths_within(self, left_out: float, coarse: float) -> dict[str, Any]:
        """Settings of an `Accuracy` by which path pairs left out cost that fraction of the field's energy, those by coarse facets
        that one."""
        levels = np.sort([each.mean_db for each in self.ranked])
        if not len(levels):
            return {}
        power = 10 ** (levels / 10)
        least = int(np.searchsorted(np.cumsum(power[:-1]) / power.sum(), left_out, side="right"))
        cost = np.cumsum(power[least:-1]) / power.sum() * 10 ** (SECONDARY_DB / 10)
        dominant = least + int(np.searchsorted(cost, coarse, side="right"))
        tiers = (
            PathTier(level_db=max(float(levels[dominant]), LEAST_LEVEL_DB)),
            PathTier(level_db=EVERY_PATH_DB, **SECONDARY),
        )
        return {"least_level_db": max(float(levels[least]), EVERY_PATH_DB), "tiers": tiers}

    def fast_rotating(self, accuracy: Accuracy) -> list[bool]:
        """Which targets rotate too fast for their visibility to be sampled point by point; a body's limbs never do."""
        return [
            not isinstance(target, Motion) and self._needed(number, SPLINE_ERROR_DB) > accuracy.fastest_sampled_hz
            for number, target in enumerate(self.targets)
        ]

    def streams(
        self, accuracy: Accuracy, instants_s: np.ndarray | None = None, samples_s: np.ndarray | None = None
    ) -> list[EchoStream]:
        """Echoes of all targets at surface frames of their own, or at just these instants.

        At instants visibility is traced just then, over the strongest path pair from every facet's vertices, through the facets; or
        as in a run, sampled at `samples_s`.
        """
        times = self.frame_times(accuracy) if instants_s is None else [instants_s] * len(self.geometries)
        fast, pairs = self.fast_rotating(accuracy), self.pairs(accuracy)
        sampled, decimated = (
            sample_times(*self.span_s, rate * accuracy.visibility_rate_hz) if instants_s is None else instants_s
            for rate in (1.0, BLOCKAGE_RATE)
        )
        if samples_s is not None:
            sampled = samples_s
        occluders: list[MovingMesh] = []
        exact = instants_s is not None and samples_s is None and accuracy.occlusion
        if exact:
            coarse = accuracy.replace(sagitta_scale=max(OCCLUDER_SAGITTA_SCALE, accuracy.sagitta_scale))
            solid = [
                s for s, rotates in zip(self.geometries, fast, strict=True) if isinstance(s, MovingMesh) and not rotates
            ]
            occluders = [self.facets(geometry, coarse) for geometry in solid]
        visibility = TargetVisibility(
            self.geometries, self.radar, [None] if pairs is None else pairs.occluded,
            fast_rotating=fast, occlusion=accuracy.occlusion, samples_s=sampled, occluders=occluders, finer=int(exact),
            subdivision=accuracy.visibility_subdivision, backend=self.backend,
        )  # fmt: skip
        each = zip(self.targets, self.geometries, times, fast, strict=True)
        return [
            s
            for one in each
            for s in self._of(*one, visibility, pairs, accuracy, (sampled, decimated), instants_s is not None)
        ]

    def _of(
        self,
        target: Target,
        geometry: Geometry,
        times_s: np.ndarray,
        fast: bool,
        visibility: TargetVisibility,
        chosen: ChosenPairs | None,
        accuracy: Accuracy,
        samples_s: tuple[np.ndarray, np.ndarray],
        at_instants: bool,
    ) -> Iterator[EchoStream]:
        """Echoes of one target, tier by tier; visibility is sampled at `samples_s`, without a tier's own occlusion at the second
        ones."""
        close = visibility.views(geometry)
        material = geometry.material if self.material is None or isinstance(target, Mover) else self.material
        common: dict[str, Any] = {"times_s": times_s, "material": resolved(material, self.radar)}
        if isinstance(geometry, Ellipsoids):
            others = [] if chosen is None else chosen.pairs[len(close) :]
            views = close + (coarse_views(geometry, others, samples_s[0]) if others else [])
            yield ellipsoid_echoes(geometry, self.radar, phase_from=self.phase_from, views=views, **common)
            return
        fine: dict[str, Any] = {"seed": self.seed, "backend": self.backend, **common}
        own = sagitta_rad(geometry, accuracy)
        for tier, pairs in [(accuracy.tiers[0], None)] if chosen is None else chosen.by_tier(accuracy):
            if pairs is not None and tier.scatterer == "ellipsoids" and isinstance(target, Motion):
                yield self._minor(target, tier, pairs, common, samples_s[1], at_instants)
                continue
            if pairs is None or tier.visibility == "occlusion":
                count = 1 if pairs is None else len(pairs)
                views, close = close[:count], close[count:]
            elif tier.visibility == "shared":
                views = visibility.with_shared_occlusion(geometry, pairs, samples_s[1])
            else:
                views = coarse_views(geometry, pairs, samples_s[1], fast_rotating=fast)
            frames = {}
            if fast and tier.decimation > 1:
                frames = {"times_s": self._decimated(times_s, tier, at_instants)}
            yield mesh_echoes(
                geometry,
                self.radar,
                views=views,
                detail=detail(own, tier, at_instants=at_instants, max_facets=self.max_facets),
                **{**fine, **frames},
            )

    def _minor(
        self,
        target: Motion,
        tier: PathTier,
        pairs: Sequence[PathPair],
        common: dict[str, Any],
        samples_s: np.ndarray,
        at_instants: bool,
    ) -> EchoStream:
        """Echoes of a body by its ellipsoids, over minor path pairs."""
        limbs = segments(placed(target, self.radar), self.body)
        samples = samples_s if at_instants else np.append(samples_s[:-1:2], samples_s[-1])
        views = coarse_views(limbs, pairs, samples, minor=True)
        times_s = common["times_s"]
        frames = {**common, "times_s": self._decimated(times_s, tier, at_instants)}
        echoes = ellipsoid_echoes(limbs, self.radar, views=views, **frames)
        return echoes if at_instants else resampled(echoes, times_s, MINOR_FRAMES)

    def _decimated(self, times_s: np.ndarray, tier: PathTier, at_instants: bool) -> np.ndarray:
        """Every so many of the surface frames; all of them at instants."""
        if at_instants:
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


def sagitta_rad(geometry: MovingMesh, accuracy: Accuracy) -> Sagitta:
    """Phase sagitta of a mesh's facets over dominant paths."""
    own = geometry.sagitta_rad if accuracy.sagitta_rad is None else accuracy.sagitta_rad
    return np.multiply(accuracy.sagitta_scale, own)


def detail(sagitta: Sagitta, tier: PathTier, *, at_instants: bool, max_facets: int) -> Detail:
    """How a mesh is modelled over the path pairs of a tier, given its sagitta over dominant ones."""
    most = np.minimum(tier.sagitta_scale * np.asarray(sagitta), tier.greatest_sagitta_rad)
    return Detail(
        sagitta_rad=np.maximum(sagitta, most),
        # At instants frames lie far apart, and phases from one to the next mean nothing.
        cycles_per_step=math.inf if at_instants else tier.patch_phase_scale * CYCLES_PER_STEP,
        sweep_cycles=tier.patch_span_scale * SWEEP_CYCLES,
        points=tier.diffuse_points,
        max_facets=max_facets,
    )


def farthest_and_fastest(geometry: Geometry, radar: Radar, span_s: tuple[float, float]) -> tuple[float, float]:
    """Greatest range [m] and speed towards or from the antennas [m/s] of any point of a target."""
    start, stop = span_s
    step = min(1e-3, (stop - start) / 10)
    places = (radar.tx_position_m, radar.rx_position_m)
    farthest, fastest = 0.0, 0.0
    count = len(geometry.rest if isinstance(geometry, MovingMesh) else geometry.semi_axes_m)
    for times in blocks(np.linspace(start, stop - step, SPEED_SAMPLES), count):
        points = [
            geometry.at(t) if isinstance(geometry, MovingMesh) else geometry.at(t)[0] for t in (times, times + step)
        ]
        ranges = [np.mean([np.linalg.norm(p - place, axis=2) for place in places], axis=0) for p in points]
        farthest = max(farthest, float(ranges[0].max()))
        fastest = max(fastest, float(np.abs(ranges[1] - ranges[0]).max() / step))
    return farthest, fastest


def skin(motion: Motion, body: str = "adult", *, material: str | Material = "skin") -> MovingMesh:
    """The motion's skinned body: `vertices` (T, V, 3) m, `faces` (F, 3), `times_s` (T,)."""
    checked_material(material)
    made = Made("skin", {"motion": motion, "body": body, "material": material})
    return skin_body(motion, body, material=material, track=track(motion), made=made)


def segments(motion: Motion, body: str = "adult", *, material: str | Material = "skin") -> Ellipsoids:
    """One ellipsoid for each segment of the same body."""
    checked_material(material)
    made = Made("segments", {"motion": motion, "body": body, "material": material})
    return fit_segments(motion, body, material=material, track=track(motion), made=made)


def placed(motion: Motion, radar: Radar) -> Motion:
    """A motion as it is where somebody placed it, else before the radar."""
    return motion if motion.placed else place(motion, radar_position_m=radar.position_m, boresight=radar.boresight)


def geometries_of(
    targets: Sequence[Target], method: Method, body: str, material: str | Material | None, radar: Radar
) -> list[Geometry]:
    """The targets' geometries; those of movers over the time that all others have in common."""
    lasting = {
        n: _geometry(t, method, body, material, radar) for n, t in enumerate(targets) if not isinstance(t, Mover)
    }
    if not lasting:
        raise InputError(
            f"movers alone have no end, got {targets!r:.60}; give one of them as its mesh, mover.mesh(0, 5) for 5 s"
        )
    time_s = shared_time(list(lasting.values()))
    return [t.mesh(*time_s) if isinstance(t, Mover) else lasting[n] for n, t in enumerate(targets)]


def _geometry(
    target: Motion | MovingMesh | Ellipsoids, method: Method, body: str, material: str | Material | None, radar: Radar
) -> Geometry:
    if not isinstance(target, Motion):
        if isinstance(target, MovingMesh) and method == "ellipsoid":
            raise InputError(
                f"method 'ellipsoid' needs a Motion or Ellipsoids, got the mesh {target.name}; use method 'mesh'"
            )
        return target
    make = skin if method == "mesh" else segments
    return make(placed(target, radar), body, material="skin" if material is None else material)


def shared_time(geometries: Sequence[Geometry]) -> tuple[float, float]:
    """First and last instant that all targets have in common [s]."""
    start = max(float(s.times_s[0]) for s in geometries)
    stop = min(float(s.times_s[-1]) for s in geometries)
    if not stop > start:
        raise InputError(
            f"the targets have no time in common (last start {start:.6g} s, first end {stop:.6g} s); give overlapping times_s"
        )
    return start, stop


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
    """The same targets by another echo model."""
    geometries = geometries_of(model.targets, method, model.body, model.material, model.radar)
    return replace(model, geometries=geometries, method=method, needed_hz={})
