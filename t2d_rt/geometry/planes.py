"""Planes in a triangle mesh: exact ones, and those along which a noisy scan lies, with their outlines; and what belongs to no
plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.geometry.vectors import edge_cross

SAME_PLANE_M, SAME_NORMAL = 1e-3, 1e-3
"""Tolerances in offset [m] and normal within which triangles count as being in one plane."""

NEIGHBOURS = 40
"""Number of neighbouring triangles whose common plane smooths the noise of a scan."""
SIGMAS, LEAST_AWAY_M, MOST_AWAY_M = 4.0, 0.01, 0.06
"""Greatest distance of a triangle's centre from its plane: in standard deviations of the noise, and the limits of that distance
[m]."""
ALIKE = 0.9
"""Least cosine of the angle between a plane and a triangle that lies along it."""
LEAST_PLANE_M2 = 0.3
"""Least area of a plane in a scan [m^2]; smaller ones are treated as not plane."""
BESIDE_M = 0.3
"""Distance [m] from the triangles of a plane within which others that lie along it belong to its edge."""
SEEDS, REFINED, MOST_PLANES, MISSES = 60, 6, 200, 3
CELL_M, VOXEL_M = 0.05, 0.1
"""Cell sizes of the grid for the outline of a plane, and of the cubes for what is not plane [m]."""


@dataclass(frozen=True, slots=True)
class Plane:
    """A plane along which triangles of a scan lie."""

    normal: np.ndarray
    """Unit normal (3,)."""
    offset_m: float
    """Offset of the plane [m]: normal . x of its points."""
    members: np.ndarray
    """Indices of its triangles, (M,)."""


def plane_of(triangles: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Index of the plane of each triangle (F, 3, 3) with normals (F, 3); both sides count as the same plane."""
    # The sign makes the greatest component positive; small increments break ties independently of rounding.
    axis = np.argmax(np.abs(normal) + [3e-6, 2e-6, 1e-6], axis=1)
    normal = normal * np.sign(np.take_along_axis(normal, axis[:, None], axis=1))
    offset = np.einsum("fi,fi->f", normal, triangles[:, 0])
    # shifted by a fraction of a cell, so that round numbers, which are frequent, do not lie between two cells
    cell = np.round(np.column_stack([normal / SAME_NORMAL, offset / SAME_PLANE_M]) + 0.37)
    return np.unique(cell, axis=0, return_inverse=True)[1].ravel() if len(cell) else np.zeros(0, np.int64)


def planes_of_scan(triangles: np.ndarray, rng: np.random.Generator) -> tuple[list[Plane], np.ndarray]:
    """Planes along which triangles (F, 3, 3) of a noisy scan lie, the largest first, and whether each triangle is left over (F,).

    Candidates are drawn at random by area; the one along which most area lies is refined by least squares (Fischler and Bolles
    1981).
    """
    from scipy.spatial import cKDTree

    centre, area = triangles.mean(axis=1), 0.5 * np.linalg.norm(edge_cross(triangles), axis=1)
    left = np.ones(len(triangles), bool)
    if len(triangles) < NEIGHBOURS:
        return [], left
    near = centre[cKDTree(centre).query(centre, NEIGHBOURS)[1]]
    middle = near.mean(axis=1)
    near -= middle[:, None]
    spread, axes = np.linalg.eigh(np.einsum("fki,fkj->fij", near, near) / NEIGHBOURS)
    smooth = axes[:, :, 0]
    away_m = float(np.clip(SIGMAS * np.sqrt(np.median(np.maximum(spread[:, 0], 0))), LEAST_AWAY_M, MOST_AWAY_M))
    planes: list[Plane] = []
    misses = 0
    while len(planes) < MOST_PLANES and misses < MISSES:
        free = np.flatnonzero(left)
        if area[free].sum() < LEAST_PLANE_M2:
            break
        seeds = rng.choice(free, SEEDS, p=area[free] / area[free].sum())
        aside = np.abs(centre[free] @ smooth[seeds].T - (smooth[seeds] * middle[seeds]).sum(axis=1))
        along = (aside < away_m) & (np.abs(smooth[free] @ smooth[seeds].T) > ALIKE)
        best = int(np.argmax(area[free] @ along))
        members = free[along[:, best]]
        for _ in range(REFINED):
            if len(members) < 3:
                break
            normal, offset = _least_squares(centre[members], area[members])
            aside = np.abs(centre[free] @ normal - offset)
            members = free[(aside < away_m) & (np.abs(smooth[free] @ normal) > ALIKE)]
        if len(members) < 3 or area[members].sum() < LEAST_PLANE_M2:
            misses += 1
            continue
        misses = 0
        # Triangles that noise has moved slightly farther away belong to the plane, but do not affect its fit. So do those along
        # its edges, where smoothed normals turn and would make a plane across the edge.
        free = free[np.abs(centre[free] @ normal - offset) < 1.5 * away_m]
        beside = cKDTree(centre[members]).query(centre[free])[0] < BESIDE_M
        free = free[beside | (np.abs(smooth[free] @ normal) > ALIKE)]
        left[free] = False
        planes.append(Plane(normal, offset, free))
    return planes, left


def _least_squares(points: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, float]:
    """Normal and offset of the least-squares plane through points (N, 3) with weights (N,)."""
    middle = np.average(points, axis=0, weights=weights)
    apart = points - middle
    normal = np.linalg.eigh(np.einsum("n,ni,nj->ij", weights, apart, apart))[1][:, 0]
    return normal, float(normal @ middle)


def _samples(triangles: np.ndarray, step_m: float) -> np.ndarray:
    """Points on triangles (F, 3, 3), at most `step_m` apart."""
    longest = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    parts = np.exp2(np.ceil(np.log2(np.maximum(longest / step_m, 1)))).astype(int)
    points = []
    for count in np.unique(parts).tolist():
        u, v = (grid.ravel() for grid in np.meshgrid(*[(np.arange(count) + 1 / 3) / count] * 2, indexing="ij"))
        inside = u + v < 1
        weights = np.column_stack([u, v, 1 - u - v])[inside]
        points.append(np.einsum("ck,fki->fci", weights, triangles[parts == count]).reshape(-1, 3))
    return np.concatenate(points)


def rectangles(triangles: np.ndarray, plane: Plane, upward: np.ndarray) -> np.ndarray:
    """Rectangles (R, 4, 3) that cover triangles (F, 3, 3) in their plane to within `CELL_M`, with edges along `upward` if
    possible."""
    from scipy.ndimage import binary_closing

    first = upward - (upward @ plane.normal) * plane.normal
    if np.linalg.norm(first) < 0.3:
        first = np.eye(3)[0] - plane.normal[0] * plane.normal
    first /= np.linalg.norm(first)
    axes = np.stack([np.cross(first, plane.normal), first])
    points = _samples(triangles, CELL_M / 2) @ axes.T
    low = points.min(axis=0)
    cells = np.floor((points - low) / CELL_M).astype(int)
    grid = np.zeros(cells.max(axis=0) + 5, bool)
    grid[cells[:, 0] + 2, cells[:, 1] + 2] = True
    grid = binary_closing(grid, np.ones((3, 3), bool), iterations=2)[2:-2, 2:-2]
    bounds: list[tuple[int, int, int, int]] = []
    running: dict[tuple[int, int], int] = {}
    for column in range(len(grid) + 1):
        line = grid[column] if column < len(grid) else np.zeros(grid.shape[1], bool)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(np.int8), [0]])))
        runs = set(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
        for run in [open_run for open_run in running if open_run not in runs]:
            bounds.append((running.pop(run), column, *run))
        running |= {run: column for run in runs if run not in running}
    spans = low[[0, 0, 1, 1]] + CELL_M * np.array(bounds, float)
    corners = np.stack([spans[:, [0, 2]], spans[:, [1, 2]], spans[:, [1, 3]], spans[:, [0, 3]]], axis=1)
    return corners @ axes + plane.offset_m * plane.normal


def voxels(triangles: np.ndarray) -> np.ndarray:
    """Outer faces of the cubes of `VOXEL_M` that triangles (F, 3, 3) touch, as quadrangles (Q, 4, 3)."""
    cells = np.unique(np.floor(_samples(triangles, VOXEL_M / 2) / VOXEL_M).astype(np.int64), axis=0)
    low = cells.min(axis=0) - 1
    grid = np.zeros(cells.max(axis=0) - low + 2, bool)
    grid[tuple((cells - low).T)] = True
    sides = []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for step in (0, 1):
            shown = np.argwhere(grid & ~np.roll(grid, 1 - 2 * step, axis=axis))
            corners = np.repeat(shown[:, None].astype(float), 4, axis=1)
            corners[:, :, axis] += step
            corners[:, :, others] += np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
            sides.append(corners)
    return VOXEL_M * (np.concatenate(sides) + low)
