"""`Model`: targets before a radar in a scene, and what an accuracy implies for each of them: rates, frames, facets, path pairs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from t2d_rt.body.materials import resolve_material
from t2d_rt.body.outfit import Outfit
from t2d_rt.core.backend import Backend
from t2d_rt.core.errors import InputError
from t2d_rt.core.memory import MemoryLimit, blocks
from t2d_rt.geometry.vectors import norms
from t2d_rt.pipeline.path_pairs import ChosenPairs, Clutter, clutter_scatterers
from t2d_rt.pipeline.targets import Target, TargetLike, passing
from t2d_rt.propagation.edges import SceneBlockage
from t2d_rt.propagation.materials import itu_material
from t2d_rt.propagation.visibility import sample_times
from t2d_rt.scattering.ellipsoid import PhaseFrom
from t2d_rt.scattering.paths import Ranked
from t2d_rt.scattering.rate import SurfaceRate
from t2d_rt.scattering.refinement import Sagitta, facets, most_facets
from t2d_rt.types import (
    Accuracy,
    ByPart,
    Ellipsoids,
    Material,
    MovingMesh,
    PathTier,
    Radar,
    Scene,
)
from t2d_rt.types.ellipsoids import Geometry, Method
from t2d_rt.types.material import BODY_NAMES
from t2d_rt.types.scatterer import Scatterer

SPLINE_ERROR_DB = Accuracy().spline_error_db
LEAST_SPEED_SAMPLES, SPEED_SAMPLES = 50, 200
"""Least and greatest number of instants at which the speeds of a target are sampled."""
SPEED_RATE_HZ = 1000.0
"""Rate at which speeds are sampled between these limits [Hz]: eight instants per rotation at 7500 rpm."""
SAME_RATE = 2.0
"""Targets whose surface rates differ by more than this factor are summed separately, each at its own rate."""
PASSING_M = 3.0
"""Distance [m] of the points that stand for the scene, to find the surface rate that the movement of the radar needs."""
TWIN_SEED = 1_000_003
"""Step between the seeds of targets that have the same geometry at rest."""


@dataclass(frozen=True)
class Model:
    """The physical model of an experiment: targets, radar, scene and path pairs, from which scatterers are made with an
    accuracy."""

    radar: Radar
    modelled: Sequence[Target]
    span_s: tuple[float, float]
    scene: Scene | None
    """The scene; None in free space."""
    ranked: Sequence[Ranked]
    """Path pairs to the targets, strongest first; empty in free space."""
    blockage: SceneBlockage
    """Blockage of these paths by the scene."""
    _: KW_ONLY
    method: Method
    material: str | Material | Outfit | None
    body: str
    phase_from: PhaseFrom
    seed: int
    backend: Backend
    memory: MemoryLimit
    bounces: int = 1
    """Greatest number of bounces, within and between targets."""
    paths_on: frozenset[str] | None = None
    """Names of the path pairs that have echoes; None for all. The others are modelled in the same way but left silent, so that
    recordings of parts add up to that of the whole."""
    surface_rates: dict[int, SurfaceRate] = field(default_factory=dict)
    """Surface rates that targets need, by the index of the target; cached when first asked for."""
    own_rates: dict[int, SurfaceRate] = field(default_factory=dict)
    """The same rates without the movement of the radar."""

    @property
    def targets(self) -> list[TargetLike]:
        """The targets as the user gave them, motions after placement."""
        return [target.source for target in self.modelled]

    @property
    def geometries(self) -> list[Geometry]:
        """The geometry of each target: its mesh or its ellipsoids."""
        return [target.geometry for target in self.modelled]

    def rates_hz(self, accuracy: Accuracy) -> list[float]:
        """Surface rate of each target [Hz]: `surface_rate_hz` if it is given, else what its motion needs, and for a mesh at least
        the rate at which visibility is sampled."""
        if accuracy.surface_rate_hz is not None:
            return [accuracy.surface_rate_hz] * len(self.geometries)
        sampled_hz = accuracy.visibility_rate_hz if accuracy.occlusion else 0.0
        # Movement of the radar across the line of sight is movement along some of the reflected paths.
        least_hz = 0.0 if self.passing_rate is None else self.passing_rate.needed_hz(accuracy.spline_error_db)
        return [
            max(
                least_hz,
                self.rate(number).needed_hz(accuracy.spline_error_db),
                sampled_hz if isinstance(geometry, MovingMesh) else 0.0,
            )
            for number, geometry in enumerate(self.geometries)
        ]

    @cached_property
    def passing_rate(self) -> SurfaceRate | None:
        """Surface rate that the scene needs because the radar moves past it, from points on all sides of the radar; None in free
        space, or where the radar stands still."""
        if self.radar.track is None or self.scene is None:
            return None
        places = self.radar.track.places_m(np.linspace(*self.span_s, 100))
        away_m = np.ptp(places, axis=0).max() + PASSING_M
        points = np.concatenate([sign * away_m * np.eye(3) for sign in (-1, 1)]) + places.mean(axis=0)
        standing = Ellipsoids(np.full((6, 3), 1e-3), np.stack([points] * 2), np.array(self.span_s))
        return SurfaceRate(passing(standing, self.radar), self.radar, self.span_s)

    def rate(self, number: int) -> SurfaceRate:
        """Surface rate that the motion of the target of that index needs."""
        if number not in self.surface_rates:
            stand_in = self.modelled[number].ellipsoids()
            self.surface_rates[number] = SurfaceRate(self.geometries[number], self.radar, self.span_s, stand_in)
        return self.surface_rates[number]

    def own_rate(self, number: int) -> SurfaceRate:
        """Surface rate of a target without the movement of the radar, by which the whole world rotates alike in the radar's frame:
        what rotates so keeps its visibility."""
        if self.radar.track is None:
            return self.rate(number)
        if number not in self.own_rates:
            self.own_rates[number] = SurfaceRate(self.modelled[number].world, self.radar, self.span_s)
        return self.own_rates[number]

    def frame_times(self, accuracy: Accuracy) -> list[np.ndarray]:
        """Surface frames of each target [s], at its rate or more; targets that need about the same rate share the frames."""
        rates = self.rates_hz(accuracy)
        length = self.span_s[1] - self.span_s[0]
        times: dict[float, np.ndarray] = {}
        for rate in sorted(rates, reverse=True):
            if not times or rate < min(times) / SAME_RATE:
                times[rate] = np.linspace(*self.span_s, max(4, math.ceil(length * rate) + 1))
        return [times[min(frame_rate for frame_rate in times if frame_rate >= rate)] for rate in rates]

    def facets(self, geometry: MovingMesh, accuracy: Accuracy) -> MovingMesh:
        """The refined mesh of a target in free space."""
        return facets(
            geometry, self.radar, sagitta_rad(geometry, accuracy), span_s=self.span_s, max_facets=self.max_facets
        )

    @property
    def max_facets(self) -> int:
        """Greatest number of facets of one mesh for which there is memory."""
        return most_facets(self.memory)

    def pairs(self, accuracy: Accuracy) -> ChosenPairs | None:
        """Path pairs that are modelled, by tier; None in free space."""
        return None if self.scene is None else ChosenPairs.of(self.ranked, accuracy, self.paths_on)

    def fast_rotating(self, accuracy: Accuracy) -> list[bool]:
        """Whether each target rotates too fast for its visibility to be sampled point by point."""
        return [
            target.may_rotate_fast and self.own_rate(number).rotation_hz(SPLINE_ERROR_DB) > accuracy.fastest_sampled_hz
            for number, target in enumerate(self.modelled)
        ]

    def seed_of(self, number: int) -> int:
        """Seed of a target's diffuse points: two persons of the same geometry get different points."""
        rest = [None if target.mesh is None else target.mesh.rest for target in self.modelled[: number + 1]]
        return self.seed + TWIN_SEED * sum(np.array_equal(rest[-1], earlier) for earlier in rest[:-1])  # type: ignore[arg-type]

    def material_of(self, number: int) -> Material | ByPart:
        """Material of a target's surface, with its values at mid-sweep."""
        return resolved(self.modelled[number].material, self.radar)

    def decimated(self, times_s: np.ndarray, tier: PathTier) -> np.ndarray:
        """Surface frames of decimated scatterers of a tier: as many fewer as its `decimation` says."""
        return np.linspace(*self.span_s, max(4, math.ceil(len(times_s) / tier.decimation)))

    def clutter(self, kind: Clutter, accuracy: Accuracy) -> tuple[list[Scatterer], dict[str, object]]:
        """Scatterers of the static scene, and counts of its echoes for a recording's settings."""
        if self.scene is None or kind == "none":
            return [], {}
        fast, occludes = self.fast_rotating(accuracy), accuracy.occludes_clutter
        occluders = [
            geometry for geometry, rotates in zip(self.geometries, fast, strict=True) if occludes and not rotates
        ]
        return clutter_scatterers(
            kind,
            self.scene,
            occluders,
            self.radar,
            min(self.frame_times(accuracy), key=len),
            samples_s=sample_times(*self.span_s, accuracy.visibility_rate_hz),
            seed=self.seed,
            backend=self.backend,
        )


def sagitta_rad(geometry: MovingMesh, accuracy: Accuracy) -> Sagitta:
    """Phase sagitta [rad] of a mesh's facets over dominant paths."""
    sagitta = geometry.sagitta_rad if accuracy.sagitta_rad is None else accuracy.sagitta_rad
    return np.multiply(accuracy.sagitta_scale, sagitta)


def farthest_and_fastest(geometry: Geometry, radar: Radar, span_s: tuple[float, float]) -> tuple[float, float]:
    """Greatest range [m] of any point of a target, and its greatest speed towards or away from the antennas [m/s]."""
    start, stop = span_s
    step = min(1e-3, (stop - start) / 10)
    places = np.unique([radar.tx_position_m, radar.rx_position_m], axis=0)
    farthest, fastest = 0.0, 0.0
    count = int(np.clip(math.ceil((stop - start) * SPEED_RATE_HZ), LEAST_SPEED_SAMPLES, SPEED_SAMPLES))
    for times in blocks(np.linspace(start, stop - step, count), geometry.point_count):
        points = [geometry.points_at(t) for t in (times, times + step)]
        ranges = [np.mean([norms(p - place) for place in places], axis=0) for p in points]
        farthest = max(farthest, float(ranges[0].max()))
        fastest = max(fastest, float(np.abs(ranges[1] - ranges[0]).max() / step))
    return farthest, fastest


def resolved(material: str | Material | ByPart, radar: Radar) -> Material | ByPart:
    """Material with its values at mid-sweep; part by part where a surface has several materials."""
    if isinstance(material, ByPart):
        return material.resolved(partial(values, radar=radar))
    return values(material, radar)


def values(material: str | Material, radar: Radar) -> Material:
    """Material with its values at mid-sweep, from the name of a body's or an ITU material."""
    if isinstance(material, Material) or material in BODY_NAMES:
        return resolve_material(material, radar.mid_frequency_hz)
    if not isinstance(material, str):
        raise InputError(f"material must be a name or a Material, got {material!r}")
    try:
        return itu_material(material, radar.mid_frequency_hz)
    except InputError as error:
        raise InputError(f"{error}; or one of {', '.join(BODY_NAMES)}") from None


def with_method(model: Model, method: Method) -> Model:
    """The model in which bodies scatter by `method`."""
    modelled = [target.by(method) for target in model.modelled]
    return replace(model, modelled=modelled, method=method, surface_rates={}, own_rates={})
