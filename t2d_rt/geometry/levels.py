"""Uniform butterfly levels of a mesh, built only where facets are too large, and which edges and faces of each level are split."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from t2d_rt.geometry.subdivide import (
    Csr,
    Topology,
    crease_corners,
    face_normals,
    midpoints,
    sharp_edges,
    split_in_four,
    too_many_faces,
    topology,
)

HALO_RINGS = 4
"""Rings of faces subdivided around the split ones: grading adds up to 3 rings, and stencils reach one further."""


@dataclass(slots=True, kw_only=True)
class ButterflyLevel:
    """The built part of a uniform butterfly level, and which of its edges and faces are split. `ids` are indices of vertices over
    all levels.

    While levels are built for B limits together, `split` and `red` have one row for each limit.
    """

    topology: Topology
    corners: np.ndarray
    """Vertices that are corners of sharp curves, (V,)."""
    ids: np.ndarray
    """Index of each vertex over all levels, (V,)."""
    crease: np.ndarray
    """Edges that are sharp on the surface (those at the margin of the built part are not), (E,)."""
    parent: np.ndarray
    """Face of the previous level of which each face is a quarter, (F,)."""
    base: np.ndarray
    """Coarse face in which each face lies, (F,)."""
    points: np.ndarray
    """Positions at rest [m], (V, 3)."""
    scale: np.ndarray
    """For each vertex 1/R, and 2 k / (6 s) for each limit, (V, 1 + B)."""
    middle: Csr = None
    """Matrix of the butterfly midpoints, (E, V); rows are empty until they are needed (`complete`)."""
    split: np.ndarray = field(default_factory=partial(np.empty, 0, bool))
    """Edges that are split, (B, E) or (E,)."""
    red: np.ndarray = field(default_factory=partial(np.empty, 0, bool))
    """Faces that are split into four, (B, F) or (F,)."""
    middle_ids: np.ndarray = field(default_factory=partial(np.empty, 0, np.int64))
    """Index of each edge's midpoint over all levels, -1 where there is none, (E,)."""


def build_levels(
    rest: np.ndarray, faces: np.ndarray, scale: np.ndarray, crease_deg: float, max_faces: int
) -> tuple[list[ButterflyLevel], list[Csr], list[Csr]]:
    """Uniform levels where they are needed, and the matrices that compute each level's new vertices from all earlier ones."""
    sharp = sharp_edges(rest, faces, crease_deg)
    mesh = topology(faces, len(rest), sharp)
    everything = np.arange(len(mesh.faces))
    level = ButterflyLevel(
        topology=mesh,
        corners=crease_corners(rest, sharp, crease_deg),
        ids=np.arange(len(rest)),
        crease=mesh.sharp,
        parent=everything,
        base=everything,
        points=rest,
        scale=scale,
    )
    _mark(level, np.ones((scale.shape[1] - 1, len(mesh.faces)), bool))
    levels, steps, linear_steps, count = [level], [], [], len(rest)
    while level.split.any():
        # Midpoints in the halo are computed although nothing there is split, because stencils of the next level reach into it.
        inside = _grow(level.topology, np.any(level.red, axis=0))
        cut_edges = np.any(level.split, axis=0) | _edges_of(level.topology, inside)
        complete(level, cut_edges)
        level.middle_ids = np.where(cut_edges, count + np.cumsum(cut_edges) - 1, -1)
        steps.append(renamed_columns(level.middle[cut_edges], level.ids, count))
        linear_steps.append(renamed_columns(chords(level.topology)[cut_edges], level.ids, count))
        count += int(np.count_nonzero(cut_edges))
        if not level.red.any():
            break
        needed = 4 * int(level.red.sum(axis=1).max())
        if needed > max_faces:
            raise too_many_faces(needed, max_faces)
        level = _next_level(level, inside)
        levels.append(level)
    return levels, steps, linear_steps


def _mark(level: ButterflyLevel, chosen: np.ndarray) -> None:
    """Computes the midpoints of the faces `chosen` for each limit, (B, F), and marks the edges and faces that are split."""
    topology, points = level.topology, level.points
    any_chosen = np.any(chosen, axis=0)
    level.middle = midpoints(topology, level.corners, points, _edges_of(topology, any_chosen))
    a, b = (points.take(topology.edges[:, j], axis=0) for j in range(2))
    depth = edge_depths(topology, level.middle @ points - (a + b) / 2, points, any_chosen)
    length2 = ((b - a) ** 2).sum(axis=1)
    # q = 2 k / 6 (8 d + L^2 / R), as in `refine` with kappa L^2 = 8 d
    nearness, *limits = level.scale[topology.edges].mean(axis=1).T
    curved = 8 * depth + length2 * nearness
    marks = [_split(topology, limit * curved, faces) for limit, faces in zip(limits, chosen, strict=True)]
    level.split, level.red = (np.stack(masks) for masks in zip(*marks, strict=True))


def _split(mesh: Topology, sagitta: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges to be split (E,) and faces to be quartered (F,) among the `chosen` faces; `sagitta` in units of the limit."""
    # Halving the edges of a face divides its sagitta by 4: above 4 a face needs another level, whatever its edges do.
    facet = sagitta[mesh.face_edges].mean(axis=1)
    split = _edges_of(mesh, chosen & (facet > 1)) & (sagitta > 1)
    red = (chosen & (facet > 4)) | all_of_three(split[mesh.face_edges])
    return split, red


def complete(level: ButterflyLevel, needed: np.ndarray) -> None:
    """Computes the missing midpoints of the `needed` edges, bool (E,); most of those in the halo are never needed."""
    missing = needed & (np.diff(level.middle.indptr) == 0)
    if missing.any():
        level.middle = level.middle + midpoints(level.topology, level.corners, level.points, missing)


def edge_depths(mesh: Topology, offset: np.ndarray, points: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Depth (E,) of offsets (E, 3) of midpoints along the normals of the faces beside each edge; drift within the surface is no
    curvature.

    Only edges of `chosen` faces are evaluated, the depth of others is 0.
    """
    edges = _edges_of(mesh, chosen)
    faces = any_of_three(edges[mesh.face_edges])
    normal = face_normals(points, mesh.faces[faces])
    depth = np.zeros(len(mesh.edges))
    for edge in mesh.face_edges[faces].T:
        np.maximum.at(depth, edge, np.abs(np.einsum("ij,ij->i", offset[edge], normal)))
    return np.where(edges, depth, 0)


def _edges_of(mesh: Topology, chosen: np.ndarray) -> np.ndarray:
    """Edges of the chosen faces, (E,)."""
    edges = np.zeros(len(mesh.edges), bool)
    edges[mesh.face_edges[chosen]] = True
    return edges


def _next_level(level: ButterflyLevel, inside: np.ndarray) -> ButterflyLevel:
    """The next level, with the children of the faces `inside`."""
    mesh = level.topology
    here = np.flatnonzero(inside)
    old_vertices = np.flatnonzero(np.bincount(mesh.faces[here].ravel()))
    cut = np.flatnonzero(_edges_of(mesh, inside))
    vertex = np.full(mesh.vertex_count, -1)
    vertex[old_vertices] = np.arange(len(old_vertices))
    middle = np.full(len(mesh.edges), -1)
    middle[cut] = len(old_vertices) + np.arange(len(cut))
    creased = cut[level.crease[cut]]
    ends, mid = vertex[mesh.edges[creased]], middle[creased]
    sharp = np.concatenate([np.stack([ends[:, 0], mid], axis=1), np.stack([mid, ends[:, 1]], axis=1)])
    count = len(old_vertices) + len(cut)
    child = topology(split_in_four(vertex[mesh.faces[here]], middle[mesh.face_edges[here]]), count, sharp)
    edges = child.edges[:, 0] * count + child.edges[:, 1]
    low, high = sharp.min(axis=1), sharp.max(axis=1)
    children = ButterflyLevel(
        topology=child,
        corners=np.concatenate([level.corners[old_vertices], np.zeros(len(cut), bool)]),
        ids=np.concatenate([level.ids[old_vertices], level.middle_ids[cut]]),
        crease=np.isin(edges, low * count + high),
        parent=np.repeat(here, 4),
        base=np.repeat(level.base[here], 4),
        points=np.concatenate([level.points[old_vertices], level.middle[cut] @ level.points]),
        scale=np.concatenate([level.scale[old_vertices], level.scale[mesh.edges[cut]].mean(axis=1)]),
    )
    _mark(children, np.repeat(level.red[:, here], 4, axis=1))
    return children


def _grow(mesh: Topology, chosen: np.ndarray) -> np.ndarray:
    """Faces within `HALO_RINGS` rings of the chosen ones, bool (F,); faces that share a vertex are neighbours."""
    for _ in range(HALO_RINGS):
        if chosen.all():
            break
        touched = np.zeros(mesh.vertex_count, bool)
        touched[mesh.faces[chosen]] = True
        chosen = any_of_three(touched[mesh.faces])
    return chosen


def any_of_three(three: np.ndarray) -> np.ndarray:
    """Whether any of each three values is true, (N,) from (N, 3); numpy's own `any` takes ten times as long on so short an axis."""
    return three[:, 0] | three[:, 1] | three[:, 2]


def all_of_three(three: np.ndarray) -> np.ndarray:
    """Whether all of each three values are true, (N,) from (N, 3)."""
    return three[:, 0] & three[:, 1] & three[:, 2]


def chords(mesh: Topology) -> Csr:
    """Matrix (E, V) for the mean of each edge's ends."""
    from scipy import sparse

    count = len(mesh.edges)
    return sparse.csr_matrix(
        (np.full(2 * count, 0.5), mesh.edges.ravel(), np.arange(count + 1) * 2), shape=(count, mesh.vertex_count)
    )


def renamed_columns(matrix: Csr, ids: np.ndarray, count: int) -> Csr:
    """The matrix with its columns moved to the vertices' indices over all levels."""
    from scipy import sparse

    return sparse.csr_matrix((matrix.data, ids[matrix.indices], matrix.indptr), shape=(matrix.shape[0], count))
