"""Targets before a radar as streams of echoes, in any detail."""

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
from t2d_rt.echo.ellipsoid import PhaseFrom, ellipsoid_echoes
from t2d_rt.echo.legs import Ranked
from t2d_rt.echo.mesh import POINTS_PER_MESH, REFINING_BYTES, Sagitta, facets, mesh_echoes
from t2d_rt.echo.patches import SWEEP_TURNS, TURNS_PER_STEP
from t2d_rt.echo.rate import TOLERANCE_DB as SPLINES_DB
from t2d_rt.echo.rate import needed_rate_hz
from t2d_rt.errors import InputError
from t2d_rt.memory import Budget, blocks
from t2d_rt.motion import place, track
from t2d_rt.room import ChosenPairs, Clutter, Looks, Shape, clutter_streams, coarse_views
from t2d_rt.scene import Mover
from t2d_rt.trace.materials import itu_material
from t2d_rt.trace.visibility import key_times
from t2d_rt.types import EchoStream, Ellipsoids, Material, Motion, MovingMesh, Radar, Scene, resampled
from t2d_rt.types.material import checked_material

Method = Literal["mesh", "ellipsoid"]
Target = Motion | MovingMesh | Ellipsoids | Mover

WEAK_COARSER, WEAK_DB = 3.0, -14.0
"""Phase sagitta of weak pairs' facets where a tolerance is to be kept, and their error over those pairs' power."""
OCCLUDERS_COARSER = 2.0
"""Phase sagitta over the meshes' own of facets that hide what is behind them, where it is looked at finely: below -45 dB."""
MOST_HALVED = 2
"""So often edges may be halved to look from at what hides what."""
SPEED_LOOKS = 200
"""Moments at which speeds are looked at."""
SAME_PACE = 2.0
"""Shapes whose surface rates differ by more are summed apart, each at its own."""
SWIFT = 8.0
"""From one look at visibility to the next so many surface frames can be followed vertex by vertex."""
COARSEST_RAD = 1.5
"""Greatest phase sagitta of weak pairs' facets."""
FAINT_POINTS = 250
"""Diffuse points of meshes over faint pairs."""
FAINT_SELDOMER, FAINT_FRAMES = 2, 128
"""Over faint pairs ellipsoids, and what turns swiftly, are worked out at every other surface frame or so; ellipsoids for that many
at once: there are many small arrays."""
COARSE_RATE = 0.5
"""Shadows of weak pairs are looked at less often, by this factor: fields fade over a hand's breadth."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Detail:
    """How finely targets are modelled."""

    coarser: float = 1.0
    """Phase sagitta of the facets over the meshes' own."""
    splines_db: float = SPLINES_DB
    """What the splines between surface frames may add to the field's error; sets the surface rate."""
    surface_rate_hz: float | None = None
    """Of all shapes, in place of that."""
    occlusion_hz: float = 25.0
    """How often visibility is looked at."""
    occlusion_halved: int = 0
    """From where: from the meshes' vertices, their edges halved so many times."""
    swift_hz: float = 25.0 * SWIFT
    """Shapes that need more surface frames a second turn too fast to be looked at vertex by vertex."""
    occlusion: bool = True
    """Whether targets hide themselves and one another."""
    strong_db: float = -6.0
    faint_db: float = -21.0
    """Pairs of ways weaker than the strongest one by more than the first, in the mean over the targets, are modelled in less
    detail, of a body those weaker by more than the second by ellipsoids: there are many, and each is a shadow among echoes."""
    weak_coarser: float = 4.0
    """Phase sagitta of weak pairs' facets over that of the strong ones'."""
    weak_patches: float = 2.0
    """Their patches may span so many times as much of the sweep as the strong ones', and turn by twice that from frame to frame."""
    weak_hidden: bool = False
    """Whether targets hide themselves and one another over all legs of weak pairs; else over those of strong ones alone."""
    range_db: float = 60.0
    """Weaker ones, at their best points, are left out."""
    least_db: float = -math.inf
    """So are those that are weaker in the mean."""
    synthesis_db: float = -50.0
    """What the sum of echoes may add."""


@dataclass(frozen=True)
class Model:
    """How targets become echoes; weak pairs of ways in less detail than strong ones."""

    radar: Radar
    targets: Sequence[Target]
    shapes: Sequence[Shape]
    span_s: tuple[float, float]
    around: Scene | None
    """None in free space."""
    ranked: Sequence[Ranked]
    """Pairs of ways to the targets, where there is a scene."""
    _: KW_ONLY
    method: Method
    material: str | Material | None
    body: str
    phase_from: PhaseFrom
    sagitta_rad: float | None
    seed: int
    backend: Backend
    memory: Budget
    needed_hz: dict[tuple[int, float], float] = field(default_factory=dict)
    """Surface rates that were asked for, by the shape's number and `Detail.splines_db`."""

    def rates_hz(self, detail: Detail) -> list[float]:
        """Surface rate of each shape."""
        if detail.surface_rate_hz is not None:
            return [detail.surface_rate_hz] * len(self.shapes)
        return [self._needed(number, detail.splines_db) for number in range(len(self.shapes))]

    def _needed(self, number: int, splines_db: float) -> float:
        key = number, splines_db
        if key not in self.needed_hz:
            self.needed_hz[key] = needed_rate_hz(self.shapes[number], self.radar, *self.span_s, splines_db)
        return self.needed_hz[key]

    def paces(self, detail: Detail) -> list[np.ndarray]:
        """Surface frames of each shape [s] at its rate or more; those that need about the same rate share them."""
        rates = self.rates_hz(detail)
        length = self.span_s[1] - self.span_s[0]
        paces: dict[float, np.ndarray] = {}
        for rate in sorted(rates, reverse=True):
            if not paces or rate < min(paces) / SAME_PACE:
                paces[rate] = np.linspace(*self.span_s, max(4, math.ceil(length * rate) + 1))
        return [paces[min(pace for pace in paces if pace >= rate)] for rate in rates]

    def facets(self, shape: MovingMesh, coarser: float) -> MovingMesh:
        """The facets that stand for a shape in free space."""
        return facets(
            shape, self.radar, self._sagitta_rad(shape, coarser), span_s=self.span_s, max_facets=self.max_facets
        )

    @property
    def max_facets(self) -> int:
        """Of one mesh, in the memory that may be taken."""
        return int(self.memory.limit_bytes / REFINING_BYTES)

    def _sagitta_rad(self, shape: MovingMesh, coarser: float) -> Sagitta:
        return np.multiply(coarser, shape.sagitta_rad if self.sagitta_rad is None else self.sagitta_rad)

    def pairs(self, detail: Detail) -> ChosenPairs | None:
        """Pairs of ways in use; None in free space."""
        if self.around is None:
            return None
        return ChosenPairs.of(
            self.ranked, strong_db=detail.strong_db, faint_db=detail.faint_db, range_db=detail.range_db,
            least_db=detail.least_db,
        )  # fmt: skip

    def ways_within(self, left_out: float, coarse: float) -> dict[str, Any]:
        """Settings of a `Detail` by which pairs of ways left out cost that share of the field's energy, those by coarse facets that
        one."""
        levels = np.sort([each.mean_db for each in self.ranked])
        if not len(levels):
            return {}
        power = 10 ** (levels / 10)
        least = int(np.searchsorted(np.cumsum(power[:-1]) / power.sum(), left_out, side="right"))
        cost = np.cumsum(power[least:-1]) / power.sum() * 10 ** (WEAK_DB / 10)
        strong = least + int(np.searchsorted(cost, coarse, side="right"))
        return {
            "least_db": float(levels[least]), "strong_db": float(levels[strong]), "faint_db": -math.inf,
            "weak_coarser": WEAK_COARSER, "weak_patches": 1.0, "weak_hidden": True,
        }  # fmt: skip

    def swift(self, detail: Detail) -> list[bool]:
        """Which shapes turn too fast to be looked at vertex by vertex; a body's limbs never do."""
        return [
            not isinstance(target, Motion) and self._needed(number, SPLINES_DB) > detail.swift_hz
            for number, target in enumerate(self.targets)
        ]

    def streams(
        self, detail: Detail, moments_s: np.ndarray | None = None, keys_s: np.ndarray | None = None
    ) -> list[EchoStream]:
        """Echoes of all targets at surface frames of their own, or at just these moments.

        At moments visibility is traced just then, over the strongest pair from every facet's vertices, through the facets; or as in
        a run, at `keys_s`.
        """
        paces = self.paces(detail) if moments_s is None else [moments_s] * len(self.shapes)
        swift, pairs = self.swift(detail), self.pairs(detail)
        keys, seldom = (
            key_times(*self.span_s, rate * detail.occlusion_hz) if moments_s is None else moments_s
            for rate in (1.0, COARSE_RATE)
        )
        if keys_s is not None:
            keys = keys_s
        occluders: list[MovingMesh] = []
        finer = 0
        if moments_s is not None and keys_s is None and detail.occlusion:
            finer = 1
            still = [s for s, turns in zip(self.shapes, swift, strict=True) if isinstance(s, MovingMesh) and not turns]
            occluders = [self.facets(s, max(OCCLUDERS_COARSER, detail.coarser)) for s in still]
        looked_at = [None] if pairs is None else pairs.pairs[: pairs.clear if detail.weak_hidden else pairs.strong]
        looks = Looks(
            self.shapes, self.radar, looked_at,
            swift=swift, occlusion=detail.occlusion, keys_s=keys, occluders=occluders, finer=finer,
            halved=detail.occlusion_halved, backend=self.backend,
        )  # fmt: skip
        each = zip(self.targets, self.shapes, paces, swift, strict=True)
        return [s for one in each for s in self._of(*one, looks, pairs, detail, (keys, seldom), moments_s is not None)]

    def _of(
        self,
        target: Target,
        shape: Shape,
        times_s: np.ndarray,
        swift: bool,
        looks: Looks,
        ways: ChosenPairs | None,
        detail: Detail,
        keys_s: tuple[np.ndarray, np.ndarray],
        at_moments: bool,
    ) -> Iterator[EchoStream]:
        """Echoes of one target, whose views over the strong pairs are those of `looks`; visibility is looked at `keys_s`, for weak
        pairs at the second ones."""
        radar, close = self.radar, looks.views(shape)
        material = shape.material if self.material is None or isinstance(target, Mover) else self.material
        common: dict[str, Any] = {"times_s": times_s, "material": resolved(material, radar)}
        weak, faint = ([], []) if ways is None else (ways.pairs[ways.strong : ways.clear], ways.pairs[ways.clear :])
        if isinstance(shape, Ellipsoids):
            others = [] if ways is None else ways.pairs[len(close) :]
            views = close + (coarse_views(shape, others, keys_s[0]) if others else [])
            yield ellipsoid_echoes(shape, radar, phase_from=self.phase_from, views=views, **common)
            return
        # At moments frames lie far apart, and phases from one to the next mean nothing.
        turns = math.inf if at_moments else TURNS_PER_STEP
        fine: dict[str, Any] = {"seed": self.seed, "backend": self.backend, "max_facets": self.max_facets, **common}
        bar = self._sagitta_rad(shape, detail.coarser)
        strong = 1 if ways is None else ways.strong
        yield mesh_echoes(shape, radar, sagitta_rad=bar, views=close[:strong], turns_per_step=turns, **fine)
        if weak:
            views = close[strong:] or looks.beside(shape, weak, keys_s[1])
            yield mesh_echoes(shape, radar, views=views, **_coarser(bar, turns, detail), **fine)
        if not faint:
            return
        seldom = times_s if at_moments else np.linspace(*self.span_s, max(4, math.ceil(len(times_s) / FAINT_SELDOMER)))
        if isinstance(target, Motion):
            limbs = segments(placed(target, radar), self.body)
            keys = keys_s[1] if at_moments else np.append(keys_s[1][:-1:2], keys_s[1][-1])
            views = coarse_views(limbs, faint, keys, faint=True)
            echoes = ellipsoid_echoes(limbs, radar, views=views, **{**common, "times_s": seldom})
            yield echoes if at_moments else resampled(echoes, times_s, FAINT_FRAMES)
        else:
            if swift:
                fine["times_s"] = seldom
            views = coarse_views(shape, faint, keys_s[1], swift=swift)
            yield mesh_echoes(shape, radar, views=views, **_coarser(bar, turns, detail, 2), **fine)

    def clutter(
        self, kind: Clutter, detail: Detail, *, shadowed: bool = True
    ) -> tuple[list[EchoStream], dict[str, object]]:
        """Echoes of what stands still, by default in the targets' shadow, and how many, for a result's settings."""
        if self.around is None or kind == "none":
            return [], {}
        steady = [s for s, turns in zip(self.shapes, self.swift(detail), strict=True) if shadowed and not turns]
        return clutter_streams(
            kind, self.around, steady, self.radar, min(self.paces(detail), key=len),
            keys_s=key_times(*self.span_s, detail.occlusion_hz), seed=self.seed, backend=self.backend,
        )  # fmt: skip


def farthest_and_fastest(shape: Shape, radar: Radar, span_s: tuple[float, float]) -> tuple[float, float]:
    """Greatest range [m] and speed towards or from the antennas [m/s] of any point of a shape."""
    start, stop = span_s
    step = min(1e-3, (stop - start) / 10)
    places = (radar.tx_position_m, radar.rx_position_m)
    farthest, fastest = 0.0, 0.0
    count = len(shape.rest if isinstance(shape, MovingMesh) else shape.semi_axes_m)
    for times in blocks(np.linspace(start, stop - step, SPEED_LOOKS), count):
        points = [shape.at(t) if isinstance(shape, MovingMesh) else shape.at(t)[0] for t in (times, times + step)]
        ranges = [np.mean([np.linalg.norm(p - place, axis=2) for place in places], axis=0) for p in points]
        farthest = max(farthest, float(ranges[0].max()))
        fastest = max(fastest, float(np.abs(ranges[1] - ranges[0]).max() / step))
    return farthest, fastest


def _coarser(sagitta_rad: Sagitta, turns: float, detail: Detail, times: int = 1) -> dict[str, Any]:
    """Options of `mesh_echoes` for weak pairs; for faint ones `times` as coarse again."""
    most = np.minimum(times * detail.weak_coarser * np.asarray(sagitta_rad), times * COARSEST_RAD)
    # Another number of diffuse points is another realisation, so weak pairs have all of them.
    points = POINTS_PER_MESH if times == 1 else FAINT_POINTS
    wider = times * detail.weak_patches
    return {
        "sagitta_rad": np.maximum(sagitta_rad, most), "turns_per_step": max(turns, 2 * wider * TURNS_PER_STEP),
        "sweep_turns": wider * SWEEP_TURNS, "points": points,
    }  # fmt: skip


def skin(motion: Motion, body: str = "adult", *, material: str | Material = "skin") -> MovingMesh:
    """The motion's skinned body: `vertices` (T, V, 3) m, `faces` (F, 3), `times_s` (T,)."""
    checked_material(material)
    return skin_body(motion, body, material=material, track=track(motion))


def segments(motion: Motion, body: str = "adult", *, material: str | Material = "skin") -> Ellipsoids:
    """One ellipsoid for each segment of the same body."""
    checked_material(material)
    return fit_segments(motion, body, material=material, track=track(motion))


def placed(motion: Motion, radar: Radar) -> Motion:
    """A motion as it is where somebody placed it, else before the radar."""
    return motion if motion.placed else place(motion, radar_position_m=radar.position_m, boresight=radar.boresight)


def shapes_of(
    targets: Sequence[Target], method: Method, body: str, material: str | Material | None, radar: Radar
) -> list[Shape]:
    """The targets' shapes; those of movers over the time that the others share."""
    lasting = {n: _shape(t, method, body, material, radar) for n, t in enumerate(targets) if not isinstance(t, Mover)}
    if not lasting:
        raise InputError(
            f"movers alone have no end, got {targets!r:.60}; give one of them as its mesh, mover.mesh(0, 5) for 5 s"
        )
    time_s = shared_time(list(lasting.values()))
    return [t.mesh(*time_s) if isinstance(t, Mover) else lasting[n] for n, t in enumerate(targets)]


def _shape(
    target: Motion | MovingMesh | Ellipsoids, method: Method, body: str, material: str | Material | None, radar: Radar
) -> Shape:
    if not isinstance(target, Motion):
        if isinstance(target, MovingMesh) and method == "ellipsoid":
            raise InputError(
                f"method 'ellipsoid' needs a Motion or Ellipsoids, got the mesh {target.name}; use method 'mesh'"
            )
        return target
    make = skin if method == "mesh" else segments
    return make(placed(target, radar), body, material="skin" if material is None else material)


def shared_time(shapes: Sequence[Shape]) -> tuple[float, float]:
    """First and last moment that all targets share [s]."""
    start = max(float(s.times_s[0]) for s in shapes)
    stop = min(float(s.times_s[-1]) for s in shapes)
    if not stop > start:
        raise InputError(
            f"the targets share no time (last start {start:.6g} s, first end {stop:.6g} s); give overlapping times_s"
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
    shapes = shapes_of(model.targets, method, model.body, model.material, model.radar)
    return replace(model, shapes=shapes, method=method, needed_hz={})
