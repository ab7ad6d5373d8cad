"""The room's part of the pipeline: which pairs of legs lead to the targets, and what each of them sees."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from t2d_rt.backend import Backend
from t2d_rt.echo.legs import ranked_pairs
from t2d_rt.errors import InputError
from t2d_rt.trace.surroundings import probes, radar_legs, share_seen
from t2d_rt.trace.visibility import Occlusion
from t2d_rt.types import Ellipsoids, Leg, LegPair, MovingMesh, Radar, Scene

Shape = MovingMesh | Ellipsoids
Seen = Callable[[np.ndarray], np.ndarray]
"""What is seen of a mesh's vertices or of ellipsoids, 0..1 (K, N), at times [s] (K,)."""
Over = list[tuple[LegPair | None, Seen | None]]

STRONG_DB = -10.0
"""Pairs within that of the strongest one keep the facets asked for; the others, of which there are many, get coarser ones."""
COARSER, COARSEST_RAD = 3.0, 1.0
"""By how much these facets' phase sagitta is larger, and its limit."""


@dataclass(frozen=True, slots=True)
class Ways:
    """Pairs of legs in use, strongest first, and those left out."""

    pairs: list[LegPair]
    left_out: list[tuple[LegPair, float]]
    """Each with its level beside the strongest pair's [dB]."""
    strong: int
    """How many of the pairs are strong."""

    def left_out_db(self) -> float | None:
        """What those left out amount to at most, were they all in phase, beside the strongest one [dB]."""
        total = sum(10 ** (level / 20) for _, level in self.left_out)
        return 20 * float(np.log10(total)) if total else None

    def describe(self) -> dict[str, object]:
        """For a result's settings."""
        return {
            "pairs": [pair.name for pair in self.pairs],
            "left_out": len(self.left_out),
            "left_out_db": self.left_out_db(),
        }


def find_ways(
    scene: Scene,
    shapes: Sequence[Shape],
    radar: Radar,
    times_s: np.ndarray,
    *,
    order: int,
    range_db: float,
    backend: Backend,
) -> Ways:
    """Pairs of legs of up to `order` reflections in all that lead to the targets within `range_db` of the strongest one."""
    points = probes(shapes, float(times_s[0]), float(times_s[-1]))
    out, back = radar_legs(scene, radar, points, order=order, backend=backend)
    ranked = ranked_pairs(radar, out, back, points, order=order)
    if not ranked:
        raise InputError(
            f"no way leads from the radar to the target in scene {scene.name} with up to {order} reflections; move the radar "
            "or the target, or allow more (order)"
        )
    return Ways(
        pairs=[pair for pair, level in ranked if level >= -range_db],
        left_out=[(pair, level) for pair, level in ranked if level < -range_db],
        strong=sum(level >= STRONG_DB for _, level in ranked),
    )


def coarser(sagitta_rad: float | np.ndarray) -> float | np.ndarray:
    """Phase sagitta of the facets of weak pairs."""
    return np.maximum(sagitta_rad, np.minimum(COARSER * np.asarray(sagitta_rad), COARSEST_RAD))


def seen_over(
    shapes: Sequence[Shape],
    radar: Radar,
    pairs: Iterable[LegPair | None],
    *,
    occlusion: bool,
    rate_hz: float,
    times_s: np.ndarray,
    backend: Backend,
) -> list[Over]:
    """For each shape the pairs, None being free space, with what is seen over both legs.

    Looks are shared: pairs have their legs in common, and transmitters and receivers that stand close together see the same.
    """
    meshes = [shape for shape in shapes if isinstance(shape, MovingMesh)]
    start, stop = float(times_s[0]), float(times_s[-1])
    one = len(radar.views_m) == 1
    looks: dict[tuple[object, ...], Occlusion] = {}

    def look(leg: Leg | None, end: int) -> Occlusion:
        key = (() if leg is None else leg.chain, 0 if one else end)
        if key not in looks:
            place = radar.views_m[end if not one else 0] if leg is None else leg.image_m
            past = None if leg is None else leg.clear
            looks[key] = Occlusion(meshes, place, rate_hz=rate_hz, backend=backend, past=past, solid=occlusion)
        return looks[key]

    def both(pair: LegPair | None, index: int) -> Seen | None:
        if pair is None and not occlusion:
            return None
        legs = (None, None) if pair is None else (pair.out, pair.back)
        views = list({id(found): found for found in (look(leg, end) for end, leg in enumerate(legs))}.values())

        def seen(times_s: np.ndarray) -> np.ndarray:
            return np.asarray(np.prod([view.visibility(times_s)[index] for view in views], axis=0))

        return seen

    def of(shape: Shape, pair: LegPair | None) -> Seen | None:
        if isinstance(shape, MovingMesh):
            return both(pair, next(index for index, mesh in enumerate(meshes) if mesh is shape))
        return None if pair is None else share_seen(shape, [pair.out, pair.back], start, stop, rate_hz)

    chosen = list(pairs)
    return [[(pair, of(shape, pair)) for pair in chosen] for shape in shapes]
