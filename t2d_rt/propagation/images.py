"""Where one-way paths run, by images of the antenna: their vertices, and to which points they exist (docs/physics.md, eq. 24)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from t2d_rt.core.memory import blocks
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.types import OneWayPath, PathSet
from t2d_rt.types.paths import points_in_scene


def vertices(path: OneWayPath, points: np.ndarray) -> np.ndarray:
    """Antenna, intersections with the planes of the chain, and target [m] of the paths to points (..., 3) [m]: (n + 2, ..., 3)."""
    return np.stack(unfolded_vertices(path, points)[1])


def instants_of(seen_paths: Sequence[OneWayPath]) -> list[slice]:
    """Which of the times each path of `OneWayPath.seen_at` stands for."""
    return [slice(None)] if len(seen_paths) == 1 else [slice(number, number + 1) for number in range(len(seen_paths))]


def apparent_m(seen_paths: Sequence[OneWayPath]) -> np.ndarray:
    """Last image of the antenna, from which the last straight part comes [m], (3,), or (K, 1, 3) at several times."""
    places = [images(path)[-1] for path in seen_paths]
    return places[0] if len(places) == 1 else np.array(places)[:, None]


def images(path: OneWayPath) -> list[np.ndarray]:
    """The antenna, and its image after each element of the chain: from these the straight parts come [m], (3,) each."""
    origins_m = [path.antenna_m]
    for through, plane in zip(path.elements.through, path.planes, strict=True):
        origins_m.append(origins_m[-1] if through else reflected(origins_m[-1], *plane))
    return origins_m


def unfolded_vertices(path: OneWayPath, points: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """For which points (..., 3) [m] every plane is met between its neighbours, bool (...), and `vertices`, an array (..., 3) each.

    A straight line from the last image to the point meets the last plane, one from there to the image before the plane before.
    """
    places, stops = images(path), [points]
    valid = np.ones(points.shape[:-1], bool)
    for image, (normal, offset_m) in zip(places[:0:-1], path.planes[::-1], strict=True):
        here = stops[-1]
        before, after = image @ normal - offset_m, here @ normal - offset_m
        # The image lies on one side of the mirror, the point on the other.
        valid &= before * after < 0
        fraction = after / np.where(after == before, 1, after - before)
        stops.append(here + fraction[..., None] * (image - here))
    stops.append(np.broadcast_to(places[0], points.shape))
    return valid, stops[::-1]


def reflected(points: np.ndarray, normal: np.ndarray, offset_m: float) -> np.ndarray:
    """Mirror images of points (..., 3) [m] at a plane (eq. 24)."""
    return points - 2 * (points @ normal - offset_m)[..., None] * normal


def existing(mirrors: Mirrors, paths: PathSet, points: np.ndarray, times_s: np.ndarray | None = None) -> np.ndarray:
    """Whether each of the paths to points (Q, 3) [m] exists, inside the outlines of these mirrors and not blocked: bool (P, Q); for
    a radar that moves, each point at its time (Q,) [s]."""
    exists = np.zeros((len(paths), len(points)), bool)
    points = points_in_scene(paths.passing, points, times_s)
    for numbers in blocks(np.arange(len(paths)), len(points) * (paths.mask.shape[1] + 2)):
        _put_existing(exists, mirrors, paths, numbers, points, times_s)
    return exists


def _put_existing(
    exists: np.ndarray,
    mirrors: Mirrors,
    paths: PathSet,
    numbers: np.ndarray,
    points: np.ndarray,
    times_s: np.ndarray | None,
) -> None:
    """Sets the rows of the paths of these numbers in `exists` (P, Q).

    Rays of all of these paths are traced at once, one straight part after another: a kernel's start costs as much as some
    thousand rays.
    """
    parts: list[list[tuple[int, np.ndarray, np.ndarray, np.ndarray]]] = [[] for _ in range(paths.mask.shape[1] + 1)]
    for number in numbers.tolist():
        path = paths[number].in_scene(times_s)
        valid, stops = unfolded_vertices(path, points)
        stops = [stop[valid] for stop in stops]
        inside = np.ones(len(stops[0]), bool)
        for mirror, stop in zip(path.elements.mirror.tolist(), stops[1:-1], strict=True):
            inside &= mirrors.parts[mirror].holds(stop)
        exists[number, np.flatnonzero(valid)[inside]] = True
        for part, (start, stop) in zip(parts, pairwise(stops), strict=False):
            part.append((number, np.flatnonzero(valid)[inside], start[inside], stop[inside]))
    for part in filter(None, parts):
        row = np.concatenate([np.full(len(columns), number) for number, columns, _, _ in part])
        column, start, stop = (np.concatenate([entry[k] for entry in part]) for k in (1, 2, 3))
        waiting = exists[row, column]
        exists[row[waiting], column[waiting]] = mirrors.free(start[waiting], stop[waiting])
