"""The room's part of the pipeline: which pairs of legs lead to the targets, and what each of them sees."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from t2d_rt.backend import Backend, select
from t2d_rt.echo.clutter import mirror_echoes, rough_echoes
from t2d_rt.echo.legs import Look, Ranked, Share, View, anchor_vertices, ranked_pairs
from t2d_rt.errors import InputError, T2DWarning
from t2d_rt.trace.clutter import POINT_PIECES, POINT_RAYS, Shadows, rough_points, roughened, static_paths
from t2d_rt.trace.collisions import Collision, find_collisions, radar_outside
from t2d_rt.trace.mirrors import Mirrors
from t2d_rt.trace.surroundings import Passed, probes, radar_legs
from t2d_rt.trace.visibility import FacetLook, Occlusion
from t2d_rt.types import (
    Accuracy,
    EchoStream,
    Ellipsoids,
    Leg,
    LegPair,
    Motion,
    MovingMesh,
    PathTier,
    Radar,
    Scene,
)

Shape = MovingMesh | Ellipsoids
Clutter = Literal["specular", "diffuse", "none"]
"""What still surfaces return by themselves: mirrors' paths, these and the scatter of rough walls, nothing."""
_Place = tuple[tuple[str, ...], int]
"""A chain of mirrors, and from which end."""
Collisions = Literal["warn", "stop", "ignore"]
"""What becomes of a target that goes through something: a warning, the end of the record just before, nothing."""

CLUTTER_ORDER = 3
"""Reflections of static clutter: a trihedral corner takes three."""
SCATTERING_COEFFICIENT = 0.2
"""Of walls whose material has none, with "diffuse": a choice, 4 % of what is reflected."""


LEAST_S = 0.1
"""A record that ends before that is none."""


def checked_time(
    collisions: Collisions,
    scene: Scene,
    targets: Sequence[Motion | Shape],
    names: Sequence[str],
    radar: Radar,
    time_s: tuple[float, float],
    *,
    outside: bool,
    backend: Backend,
) -> tuple[float, float]:
    """First and last moment of the record [s]: all of it, or up to where a target goes through something.

    `outside`: whether the radar may stand, and a target may start, outside the room.
    """
    if collisions == "ignore":
        return time_s
    start, stop = time_s
    if not outside and (place := radar_outside(scene, radar, backend)) is not None:
        told = f"the radar is at {_place_text(place)}, outside {_reach_text(scene)}"
        told += "; move it (position_m), choose another room, or allow transmissions to look through walls"
        if collisions == "stop":
            raise InputError(told)
        warnings.warn(told, T2DWarning, stacklevel=3)
    for found in find_collisions(scene, targets, radar, start, stop, outside=outside, backend=backend):
        told = _told(found, scene, names, start)
        if collisions == "warn":
            hint = " (distance_m, angle_deg)" if isinstance(targets[found.target], Motion) else ""
            warnings.warn(
                f"{told}; place it elsewhere{hint}, choose another room, or end the record there (collisions 'stop')",
                T2DWarning,
                stacklevel=3,
            )
        elif found.time_s - start < LEAST_S:
            raise InputError(f"{told}, which leaves no record to stop at; place it elsewhere or choose another room")
        else:
            stop = min(stop, found.time_s)
    return start, stop


def _place_text(place_m: np.ndarray) -> str:
    return f"({', '.join(f'{x:.2f}' for x in place_m)}) m"


def _reach_text(scene: Scene) -> str:
    low, high = (", ".join(f"{x:.4g}" for x in corner) for corner in scene.bounds_m)
    return f"{scene.name}, which reaches from ({low}) to ({high}) m"


def _told(found: Collision, scene: Scene, names: Sequence[str], start_s: float) -> str:
    """Half a sentence."""
    name = names[found.target] + (f" (target {found.target + 1} of {len(names)})" if len(names) > 1 else "")
    where = _place_text(found.place_m)
    if found.surface is None:
        return f"{name} starts at {where}, outside {_reach_text(scene)}"
    return f"{name} goes through {found.surface} of {scene.name} at {found.time_s - start_s:.2f} s, at {where}"


@dataclass(frozen=True, slots=True)
class ChosenPairs:
    """Path pairs in use, strongest first, in tiers, and those left out."""

    pairs: list[LegPair]
    levels_db: list[float]
    """Theirs in the mean over the targets, relative to the strongest pair's [dB]."""
    left_out_db: list[float]
    """Levels of those left out at their best points, likewise."""
    ends: list[int]
    """How many of the pairs belong to each tier or to one before it."""
    occluded: list[LegPair]
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

    def by_tier(self, accuracy: Accuracy) -> Iterator[tuple[PathTier, list[LegPair]]]:
        """Tiers that have path pairs, and these."""
        for tier, first, last in zip(accuracy.tiers, [0, *self.ends], self.ends, strict=False):
            if last > first:
                yield tier, self.pairs[first:last]

    def bound_db(self) -> float | None:
        """What those left out amount to at most, were they all in phase, beside the strongest one [dB]."""
        total = sum(10 ** (level / 20) for level in self.left_out_db)
        return 20 * float(np.log10(total)) if total else None

    def describe(self) -> dict[str, object]:
        """For a result's settings."""
        return {
            "pairs": [pair.name for pair in self.pairs],
            "left_out": len(self.left_out_db),
            "left_out_db": self.bound_db(),
        }


def find_ways(
    scene: Scene,
    shapes: Sequence[Shape],
    radar: Radar,
    span_s: tuple[float, float],
    *,
    order: int,
    transmissions: int = 0,
    backend: Backend,
) -> list[Ranked]:
    """Pairs of legs of up to `order` reflections and `transmissions` in all that lead to the targets, strongest first."""
    points = probes(shapes, *span_s)
    most = {"order": order, "transmissions": transmissions}
    out, back = radar_legs(scene, radar, points, **most, backend=backend)
    ranked = ranked_pairs(radar, out, back, points, **most)
    if not ranked:
        raise InputError(
            f"no way leads from the radar to the target in scene {scene.name} with up to {order} reflections and "
            f"{transmissions} transmissions; move the radar or the target, or allow more of them"
        )
    return ranked


def ways_to(scene: Scene, radar: Radar, point_m: np.ndarray, *, reflections: int) -> list[tuple[str, np.ndarray]]:
    """Names of the legs from the transmitters to a point, and their ways (P, 3) [m]."""
    legs, _ = radar_legs(scene, radar, point_m[None], order=reflections, backend=select("auto"))
    return [(leg.name, leg.way(point_m)) for leg in legs]


class Looks:
    """What hides the vertices of shapes from the antennas over the legs of `pairs`, None being free space, looked at `keys_s`.

    Looks are from the meshes' vertices and those of their edges `halved` so many times. They are shared: pairs have their legs in
    common, and transmitters and receivers that stand close together see the same.
    What turns too fast to be looked at, `swift`, hides nothing and is seen as much at all of its vertices as in the mean.
    Over the `finer` first pairs bodies are looked past from every facet's vertices, at every moment asked for, through `occluders`:
    the shapes' facets.
    """

    def __init__(
        self,
        shapes: Sequence[Shape],
        radar: Radar,
        pairs: Sequence[LegPair | None],
        *,
        swift: Sequence[bool],
        occlusion: bool,
        keys_s: np.ndarray,
        occluders: Sequence[MovingMesh] = (),
        finer: int = 0,
        halved: int = 0,
        backend: Backend,
    ) -> None:
        self._views_m, self._pairs, self._keys, self._backend = radar.views_m, pairs, keys_s, backend
        self._swift = {id(shape) for shape, turns in zip(shapes, swift, strict=True) if turns}
        self._meshes = [s for s in shapes if isinstance(s, MovingMesh) and id(s) not in self._swift]
        self._occlusion, self._occluders, self._finer, self._halved = occlusion, occluders, finer, halved
        self._looks: dict[tuple[_Place, bool], Occlusion] = {}
        self._facet_looks: dict[bytes, FacetLook] = {}
        hidden = pairs[finer:] if occlusion else []
        self._known = {self._place(end, leg) for pair in hidden for end, leg in enumerate(_legs(pair))}

    def views(self, shape: Shape) -> list[View]:
        """Of one shape, over the pairs."""
        if not isinstance(shape, MovingMesh):
            pairs = [pair for pair in self._pairs if pair]
            return coarse_views(shape, pairs, self._keys, swift=id(shape) in self._swift) if pairs else [View()]
        swift = id(shape) in self._swift
        found = []
        for number, pair in enumerate(self._pairs):
            finest = self._occlusion and number < self._finer and not swift
            solid = self._occlusion and not finest
            # One look does where both ends see the same; past what stands still the field has to come twice, though.
            ends = {self._place(end, leg): (end, leg) for end, leg in enumerate(_legs(pair)) if leg or solid}
            found.append(
                View(
                    legs=pair,
                    seen=_product([self._share(*end, shape, solid, 3 - len(ends)) for end in ends.values()]),
                    halved=self._halved if solid and not swift else 0,
                    looked=self._looked(pair) if finest else None,
                )
            )
        return found

    def beside(self, shape: MovingMesh, pairs: Sequence[LegPair], keys_s: np.ndarray) -> list[View]:
        """Of one shape, over other pairs: as `coarse_views`, but hidden over legs that are looked over anyway."""
        points = Passed.to_vertices(shape, anchor_vertices(shape.rest), keys_s)
        passed = _passed(points, pairs, swift=id(shape) in self._swift)
        found = []
        for pair in pairs:
            ends = [(self._place(end, leg), end, leg) for end, leg in enumerate((pair.out, pair.back))]
            times = Counter(place for place, _, _ in ends if place in self._known)
            known = {place: (end, leg) for place, end, leg in ends if place in times}
            shares = [self._share(*end, shape, True, times[place]) for place, end in known.items()]
            others = [passed[id(leg)] for place, _, leg in ends if place not in times]
            found.append(View(legs=pair, seen=_product(shares), passed=_product(others)))
        return found

    def _place(self, end: int, leg: Leg | None) -> _Place:
        """From where an end's leg is looked over."""
        return () if leg is None else leg.chain, 0 if len(self._views_m) == 1 else end

    def _share(self, end: int, leg: Leg | None, shape: MovingMesh, solid: bool, times: int) -> Share:
        """What is seen over an end's leg, of a field that comes so many times past what stands still; hidden if `solid`."""
        key = self._place(end, leg), solid
        if key not in self._looks:
            place = self._views_m[key[0][1]] if leg is None else leg.image_m
            self._looks[key] = Occlusion(
                self._meshes, place, keys_s=self._keys, backend=self._backend, past=None if leg is None else leg.share,
                solid=solid, halved=self._halved if solid else 0,
            )  # fmt: skip
        look = self._looks[key]
        if id(shape) in self._swift:
            return look.of_swift(shape, times)
        index = next(index for index, mesh in enumerate(self._meshes) if mesh is shape)
        return lambda times_s: look.visibility(times_s, times)[index]

    def _looked(self, pair: LegPair | None) -> Look:
        """From every facet's vertices."""
        places = self._views_m if pair is None else [pair.out.image_m, pair.back.image_m]
        for place in places:
            if place.tobytes() not in self._facet_looks:
                self._facet_looks[place.tobytes()] = FacetLook(self._occluders, place, backend=self._backend)
        ends = [self._facet_looks[key] for key in {place.tobytes(): None for place in places}]
        return lambda *where: np.asarray(np.prod([end.share(*where) for end in ends], axis=0))


def coarse_views(
    shape: Shape, pairs: Sequence[LegPair], keys_s: np.ndarray, *, swift: bool = False, faint: bool = False
) -> list[View]:
    """Views of one shape over pairs, each with what stands still in the way of a few of its points, looked at `keys_s`; it does not
    hide itself.

    A `swift` one turns too fast to be looked at: all of its points are seen as much as in the mean. Over `faint` pairs ellipsoids
    are seen as much as their centres.
    """
    if isinstance(shape, Ellipsoids):
        passed = (Passed.to_centres if faint else Passed.to_ellipsoids)(shape, keys_s)
    else:
        passed = Passed.to_vertices(shape, anchor_vertices(shape.rest), keys_s)
    shares = _passed(passed, pairs, swift=swift)
    field = "seen" if isinstance(shape, Ellipsoids) else "passed"
    return [View(legs=pair, **{field: _product([shares[id(leg)] for leg in _legs(pair)])}) for pair in pairs]  # type: ignore[arg-type]


def _passed(passed: Passed, pairs: Sequence[LegPair], *, swift: bool) -> dict[int, Share]:
    """What comes past what stands still, by leg."""
    # By leg and not by chain: antennas that stand apart have legs of their own over the same mirrors.
    legs = {id(leg): leg for pair in pairs for leg in (pair.out, pair.back)}
    return {number: _remembered(passed.over(leg, in_the_mean=swift)) for number, leg in legs.items()}


def _legs(pair: LegPair | None) -> tuple[Leg | None, Leg | None]:
    return (None, None) if pair is None else (pair.out, pair.back)


def _product(shares: Sequence[Share]) -> Share | None:
    """Of what is seen over each leg; None where there is none."""
    if len(shares) < 2:
        return shares[0] if shares else None
    return lambda times_s: np.asarray(np.prod([share(times_s) for share in shares], axis=0))


def _remembered(share: Share) -> Share:
    """The same, which knows its last answer: pairs that have a leg in common ask for the same times."""
    last: list[np.ndarray] = []

    def asked(times_s: np.ndarray) -> np.ndarray:
        if not last or not np.array_equal(last[0], times_s):
            last[:] = [times_s, share(times_s)]
        return last[1]

    return asked


def clutter_streams(
    kind: Clutter,
    scene: Scene,
    shapes: Sequence[Shape],
    radar: Radar,
    times_s: np.ndarray,
    *,
    keys_s: np.ndarray,
    seed: int,
    backend: Backend,
) -> tuple[list[EchoStream], dict[str, object]]:
    """Echoes of what stands still, in the shadow of shapes, and how many, for a result's settings."""
    if kind == "diffuse":
        scene = roughened(scene, SCATTERING_COEFFICIENT, radar.mid_frequency_hz)
    mirrors = Mirrors.of(scene, backend)
    streams = []

    def shares(ways_m: Sequence[np.ndarray], **fineness: int) -> Share | None:
        if not shapes:
            return None
        return Shadows(shapes, ways_m, radar.wavelength_m, keys_s=keys_s, backend=backend, **fineness).shares

    paths = static_paths(mirrors, radar, order=CLUTTER_ORDER)
    if paths:
        streams.append(mirror_echoes(paths, radar, times_s=times_s, shares=shares([path.stops_m for path in paths])))
    points, rcs = rough_points(mirrors, radar) if kind == "diffuse" else (np.zeros((0, 3)), np.zeros(0))
    if len(points):
        ways = [np.array([radar.tx_position_m, point, radar.rx_position_m]) for point in points]
        passed = shares(ways, rays=POINT_RAYS, pieces=POINT_PIECES)
        streams.append(rough_echoes(points, rcs, radar, times_s=times_s, seed=seed, shares=passed))
    return streams, {"clutter": kind, "clutter_paths": len(paths), "clutter_points": len(points)}
