"""The room's part of the pipeline: which pairs of legs lead to the targets, and what each of them sees."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from t2d_rt.backend import Backend, select
from t2d_rt.echo.clutter import mirror_echoes, rough_echoes
from t2d_rt.echo.legs import Look, Ranked, Share, View, anchor_vertices, ranked_pairs
from t2d_rt.errors import InputError, T2DWarning
from t2d_rt.trace.clutter import POINT_PIECES, POINT_RAYS, Shadows, rough_points, roughened, static_paths
from t2d_rt.trace.collisions import Collision, find_collisions
from t2d_rt.trace.mirrors import Mirrors
from t2d_rt.trace.surroundings import Passed, probes, radar_legs
from t2d_rt.trace.visibility import FacetLook, Occlusion
from t2d_rt.types import EchoStream, Ellipsoids, Leg, LegPair, Motion, MovingMesh, Radar, Scene

Shape = MovingMesh | Ellipsoids
Clutter = Literal["specular", "diffuse", "none"]
"""What still surfaces return by themselves: mirrors' paths, these and the scatter of rough walls, nothing."""
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

    `outside`: whether a target may start outside the room.
    """
    if collisions == "ignore":
        return time_s
    start, stop = time_s
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


def _told(found: Collision, scene: Scene, names: Sequence[str], start_s: float) -> str:
    """Half a sentence."""
    name = names[found.target] + (f" (target {found.target + 1} of {len(names)})" if len(names) > 1 else "")
    where = f"({', '.join(f'{x:.2f}' for x in found.place_m)}) m"
    if found.surface is None:
        low, high = (", ".join(f"{x:.4g}" for x in corner) for corner in scene.bounds_m)
        return f"{name} starts at {where}, outside {scene.name}, which reaches from ({low}) to ({high}) m"
    return f"{name} goes through {found.surface} of {scene.name} at {found.time_s - start_s:.2f} s, at {where}"


@dataclass(frozen=True, slots=True)
class ChosenPairs:
    """Pairs of legs in use, strongest first, and those left out."""

    pairs: list[LegPair]
    levels_db: list[float]
    """Theirs in the mean over the targets, beside the strongest pair's [dB]."""
    left_out_db: list[float]
    """Levels of those left out at their best points, likewise."""
    strong: int
    """How many of the pairs are strong."""
    clear: int
    """How many are not faint."""

    @classmethod
    def of(
        cls, ranked: Sequence[Ranked], *, strong_db: float, faint_db: float, range_db: float, least_db: float
    ) -> ChosenPairs:
        """Those within `range_db` of the strongest one at their best points and not below `least_db` in the mean, where strong and
        faint ones are told apart, too."""
        keep = [each.best_db >= -range_db and each.mean_db >= least_db for each in ranked]
        kept = [each for each, good in zip(ranked, keep, strict=True) if good]
        strong = max(1, sum(each.mean_db >= strong_db for each in kept))
        return cls(
            pairs=[each.pair for each in kept],
            levels_db=[each.mean_db for each in kept],
            left_out_db=[each.best_db for each, good in zip(ranked, keep, strict=True) if not good],
            strong=strong,
            clear=max(strong, sum(each.mean_db >= faint_db for each in kept)),
        )

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


def full_views(
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
) -> list[list[View]]:
    """For each shape its views over the pairs, None being free space: what hides each vertex from either leg, looked at `keys_s`.

    Looks are from the meshes' vertices and those of their edges `halved` so many times.
    What turns too fast to be looked at, `swift`, hides nothing and is seen as much at all of its vertices as in the mean. Looks are
    shared: pairs have their legs in common, and transmitters and receivers that stand close together see the same.
    Over the `finer` first pairs bodies are looked past from every facet's vertices, at every moment asked for, through `occluders`:
    the shapes' facets.
    """
    meshes = [s for s, turns in zip(shapes, swift, strict=True) if isinstance(s, MovingMesh) and not turns]
    one = len(radar.views_m) == 1
    looks: dict[tuple[object, ...], Occlusion] = {}

    def looks_of(pair: LegPair | None, solid: bool) -> list[Occlusion]:
        """From both ends. One look does where both see the same; past what stands still the field has to come twice, though."""
        ends: dict[tuple[object, ...], tuple[np.ndarray, Leg | None]] = {}
        for end, leg in enumerate((None, None) if pair is None else (pair.out, pair.back)):
            place = radar.views_m[0 if one else end] if leg is None else leg.image_m
            ends[() if leg is None else leg.chain, 0 if one else end] = place, leg
        found = []
        for key, (place, leg) in ends.items():
            times = 2 if len(ends) == 1 else 1
            if (*key, times, solid) not in looks:
                past = None if leg is None else _power(leg.share, times)
                looks[*key, times, solid] = Occlusion(
                    meshes, place, keys_s=keys_s, backend=backend, past=past, solid=solid, halved=halved if solid else 0
                )
            found.append(looks[*key, times, solid])
        return found

    def seen(pair: LegPair | None, solid: bool, shape: MovingMesh) -> Share | None:
        if pair is None and not solid:
            return None
        index = next((index for index, mesh in enumerate(meshes) if mesh is shape), None)
        shares = [look.of_swift(shape) if index is None else _of_mesh(look, index) for look in looks_of(pair, solid)]
        return lambda times: np.asarray(np.prod([share(times) for share in shares], axis=0))

    facet_looks: dict[bytes, FacetLook] = {}

    def looked(pair: LegPair | None) -> Look:
        places = radar.views_m if pair is None else [pair.out.image_m, pair.back.image_m]
        for place in places:
            if place.tobytes() not in facet_looks:
                facet_looks[place.tobytes()] = FacetLook(occluders, place, backend=backend)
        ends = [facet_looks[key] for key in {place.tobytes(): None for place in places}]
        return lambda *where: np.asarray(np.prod([end.share(*where) for end in ends], axis=0))

    found = []
    for shape, turns in zip(shapes, swift, strict=True):
        if isinstance(shape, MovingMesh):
            finest = 0 if turns or not occlusion else finer
            found.append(
                [
                    View(
                        legs=pair,
                        seen=seen(pair, occlusion and number >= finest, shape),
                        halved=halved if occlusion and number >= finest and not turns else 0,
                        looked=looked(pair) if number < finest else None,
                    )
                    for number, pair in enumerate(pairs)
                ]
            )
        elif list(pairs) == [None]:
            found.append([View()])
        else:
            found.append(coarse_views(shape, [pair for pair in pairs if pair], keys_s, swift=turns))
    return found


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
    # By leg and not by chain: antennas that stand apart have legs of their own over the same mirrors.
    legs = {id(leg): leg for pair in pairs for leg in (pair.out, pair.back)}
    shares = {number: _remembered(passed.over(leg, in_the_mean=swift)) for number, leg in legs.items()}

    def both(pair: LegPair) -> Share:
        ways = shares[id(pair.out)], shares[id(pair.back)]
        return lambda times: np.asarray(ways[0](times) * ways[1](times))

    if isinstance(shape, Ellipsoids):
        return [View(legs=pair, seen=both(pair)) for pair in pairs]
    return [View(legs=pair, passed=both(pair)) for pair in pairs]


def _power(share: Share, times: int) -> Share:
    return share if times == 1 else lambda points: np.asarray(share(points) ** times)


def _of_mesh(look: Occlusion, index: int) -> Share:
    return lambda times: look.visibility(times)[index]


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
