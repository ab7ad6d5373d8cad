"""Red-green refinement on the butterfly surface: facets as small as the phase asks for, as one sparse matrix.

Every fine vertex is a vertex of a uniform butterfly level (`subdivide`), so all refinements of a mesh sample one and
the same curved surface, and fine vertices at any time are `operator @ coarse vertices`.

A facet is refined while its phase sagitta, at its centroid, exceeds the limit s. It is the mean of its edges'

    q = 2 k L^2 (|kappa| + 1/R) / 6

L an edge's length, kappa the normal curvature along it, R the range (for an equilateral facet on a sphere q is the same
on all edges); the edges with q > s are the ones split, so facets grow long where the surface is bent in one direction only.
kappa = 8 d / L^2 comes from the distance d of the edge's next midpoint from its chord: curvature is measured on the
surface that is sampled, at the scale of the edge, and needs no estimate from the coarse mesh.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from t2d_rt.errors import InputError
from t2d_rt.geometry.subdivide import (
    Csr,
    Topology,
    crease_corners,
    face_normals,
    midpoints,
    sharp_edges,
    split_in_four,
    topology,
)
from t2d_rt.geometry.vectors import edge_cross

HALO_RINGS = 4
"""Rings of faces subdivided around the red ones: the grading adds up to 3, and stencils reach 1 further."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Refinement:
    """A finer mesh that is linear in the coarse one's vertices."""

    operator: Csr
    """Fine vertices = operator @ coarse vertices, (Vf, V); rows sum to 1."""
    faces: np.ndarray
    """Fine triangles, oriented like the coarse ones, int32 (Ff, 3)."""
    base_face: np.ndarray
    """Coarse face that each fine face lies in, int32 (Ff,)."""
    linear: Csr
    """Carries a field of the coarse vertices (a visibility, say) linearly to the fine ones, (Vf, V); rows sum to 1."""


@dataclass(slots=True)
class _Level:
    """The part of a uniform butterfly level that is built, and what is split of it. `ids` count over all levels.

    While levels are built for B limits together, `split` and `red` have one row for each.
    """

    mesh: Topology
    corners: np.ndarray
    ids: np.ndarray
    crease: np.ndarray
    """Edges sharp on the surface (not those where the built part ends), (E,)."""
    parent: np.ndarray
    base: np.ndarray
    points: np.ndarray
    """Rest positions, (V, 3)."""
    scale: np.ndarray
    """Per vertex: 1/R, and 2 k / (6 s) for each limit, (V, 1 + B)."""
    middle: Csr
    """Butterfly midpoints, (E, V); rows are empty until they are asked for (`_complete`)."""
    split: np.ndarray
    """Edges to be split, (B, E) or (E,)."""
    red: np.ndarray
    """Faces to be split in four, (B, F) or (F,)."""
    middle_ids: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))
    """Id of each edge's midpoint, -1 where none is made, (E,)."""


def refine(
    rest: np.ndarray,
    faces: np.ndarray,
    *,
    wavenumber: float,
    range_m: float | np.ndarray,
    sagitta_rad: float | np.ndarray,
    crease_deg: float = 45.0,
    max_edge_m: float = np.inf,
    displace: bool = True,
    max_faces: int = 2_000_000,
) -> Refinement:
    """Refine a mesh (V, 3), (F, 3) until facets have a phase sagitta of at most `sagitta_rad`.

    `wavenumber` k = 2 pi / lambda [rad/m]; `range_m` the least range R and `sagitta_rad` the limit s, each one number or
    one per vertex (V,). `crease_deg` as in `MovingMesh`. `max_edge_m` bounds edges whatever their phase, where
    something else varies over the surface. `displace` moves vertices outward so that facets lie on the surface in the
    mean.
    """
    (refinement,) = refinements(
        rest, faces, wavenumber=wavenumber, range_m=range_m, sagittas_rad=[sagitta_rad], crease_deg=crease_deg,
        max_edge_m=max_edge_m, displace=displace, max_faces=max_faces,
    )  # fmt: skip
    return refinement


def refinements(
    rest: np.ndarray,
    faces: np.ndarray,
    *,
    wavenumber: float,
    range_m: float | np.ndarray,
    sagittas_rad: Sequence[float | np.ndarray],
    crease_deg: float = 45.0,
    max_edge_m: float = np.inf,
    displace: bool = True,
    max_faces: int = 2_000_000,
) -> list[Refinement]:
    """What `refine` gives for each limit alone; most of the work is the surface itself, which is the same for all of them."""
    rest, faces = np.asarray(rest, dtype=np.float64), np.asarray(faces)
    scale = _scale(rest, wavenumber, range_m, sagittas_rad, max_edge_m)
    levels, steps, linear_steps = _build_levels(rest, faces, scale, crease_deg, max_edge_m, max_faces)
    operator, linear = _stack(steps, len(rest)), _stack(linear_steps, len(rest))
    alone = ([replace(each, split=each.split[i], red=each.red[i]) for each in levels] for i in range(len(sagittas_rad)))
    return [_refined(own, rest, operator, linear, displace) for own in alone]


def _refined(levels: list[_Level], rest: np.ndarray, operator: Csr, linear: Csr, displace: bool) -> Refinement:
    """The refinement for one limit, from what it marked in the levels and the matrices of all their vertices."""
    _grade(levels)
    parts = [_leaves(level, finer) for level, finer in zip(levels, _tree_masks(levels), strict=True)]
    corners_ids = np.concatenate([part.faces for part in parts])
    here = np.bincount(corners_ids.ravel(), minlength=operator.shape[0]) > 0
    used, fine = np.flatnonzero(here), (np.cumsum(here) - 1)[corners_ids]
    rows = operator[used]
    if displace:
        rows = rows + _displacement(levels, parts, rows @ rest, used, fine, operator.shape[0]) @ operator
    return Refinement(
        operator=rows, faces=fine.astype(np.int32), linear=linear[used],
        base_face=np.concatenate([part.base for part in parts]).astype(np.int32),
    )  # fmt: skip


def curvature(rest: np.ndarray, faces: np.ndarray, crease_deg: float = 45.0) -> np.ndarray:
    """Mean over its edges of each vertex's normal curvature, without sign [1/m], (V,); measured as `refine` does."""
    sharp = sharp_edges(rest, faces, crease_deg)
    mesh = topology(faces, len(rest), sharp)
    ends = rest[mesh.edges]
    offset = midpoints(mesh, crease_corners(rest, sharp, crease_deg), rest) @ rest - ends.mean(axis=1)
    bend = 8 * _depth(mesh, offset, rest, np.ones(len(mesh.faces), bool)) / ((ends[:, 1] - ends[:, 0]) ** 2).sum(axis=1)
    return np.bincount(mesh.edges.ravel(), weights=np.repeat(bend, 2), minlength=len(rest)) / mesh.valence


def _scale(
    rest: np.ndarray, wavenumber: float, range_m: object, sagittas_rad: Sequence[object], max_edge_m: float
) -> np.ndarray:
    """Columns 1/R and, for each limit, 2 k / (6 s) per vertex, (V, 1 + B)."""
    if rest.ndim != 2 or rest.shape[1] != 3 or not np.isfinite(rest).all():
        raise InputError(f"rest must hold finite positions of shape (vertex, 3), got shape {rest.shape}")
    for name, value in (
        ("wavenumber", wavenumber), ("range_m", range_m), *(("sagitta_rad", limit) for limit in sagittas_rad),
        ("max_edge_m", max_edge_m),
    ):  # fmt: skip
        array = np.asarray(value, dtype=np.float64)
        if array.shape not in ((), (len(rest),)) or not (array > 0).all():
            raise InputError(f"{name} must be positive, one number or one per vertex ({len(rest)},), got {value}")
    columns = (
        1 / np.asarray(range_m, float),
        *(2 * wavenumber / (6 * np.asarray(limit, float)) for limit in sagittas_rad),
    )
    return np.stack([np.broadcast_to(column, (len(rest),)) for column in columns], axis=1)


def _build_levels(
    rest: np.ndarray, faces: np.ndarray, scale: np.ndarray, crease_deg: float, max_edge_m: float, max_faces: int
) -> tuple[list[_Level], list[Csr], list[Csr]]:
    """Uniform levels where they are needed, and the matrices that make each level's new vertices from all before."""
    sharp = sharp_edges(rest, faces, crease_deg)
    mesh = topology(faces, len(rest), sharp)
    everything = np.arange(len(mesh.faces))
    level = _level(
        mesh, crease_corners(rest, sharp, crease_deg), np.arange(len(rest)), mesh.sharp, everything, everything, rest,
        scale, np.ones((scale.shape[1] - 1, len(mesh.faces)), bool), max_edge_m,
    )  # fmt: skip
    levels, steps, linear_steps, count = [level], [], [], len(rest)
    while level.split.any():
        inside = _grow(level.mesh, np.any(level.red, axis=0), HALO_RINGS)
        made = np.any(level.split, axis=0) | _edges_of(level.mesh, inside)
        _complete(level, made)
        level.middle_ids = np.where(made, count + np.cumsum(made) - 1, -1)
        steps.append(_columns(level.middle[made], level.ids, count))
        linear_steps.append(_columns(_chords(level.mesh)[made], level.ids, count))
        count += int(np.count_nonzero(made))
        if not level.red.any():
            break
        needed = 4 * int(level.red.sum(axis=1).max())
        if needed > max_faces:
            raise InputError(
                f"refining needs more than {needed} faces, the limit is {max_faces}; "
                "ask for a looser tolerance or a greater sagitta_rad, or raise memory_gb (max_faces)"
            )
        level = _next_level(level, inside, max_edge_m)
        levels.append(level)
    return levels, steps, linear_steps


def _level(
    mesh: Topology, corners: np.ndarray, ids: np.ndarray, crease: np.ndarray, parent: np.ndarray, base: np.ndarray,
    points: np.ndarray, scale: np.ndarray, wanted: np.ndarray, max_edge_m: float,
) -> _Level:  # fmt: skip
    """A level with the midpoints of the faces `wanted` for any limit, (B, F), and what these ask for."""
    asked = np.any(wanted, axis=0)
    middle = midpoints(mesh, corners, points, _edges_of(mesh, asked))
    a, b = (points.take(mesh.edges[:, j], axis=0) for j in range(2))
    depth = _depth(mesh, middle @ points - (a + b) / 2, points, asked)
    length2 = ((b - a) ** 2).sum(axis=1)
    nearness, *limits = scale[mesh.edges].mean(axis=1).T
    marks = [
        _mark(mesh, limit * (8 * depth + length2 * nearness), length2, faces, max_edge_m)
        for limit, faces in zip(limits, wanted, strict=True)
    ]
    split, red = (np.stack(each) for each in zip(*marks, strict=True))
    return _Level(mesh, corners, ids, crease, parent, base, points, scale, middle, split, red)


def _mark(
    mesh: Topology, sagitta: np.ndarray, length2: np.ndarray, wanted: np.ndarray, max_edge_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Edges to be split (E,) and faces to be quartered (F,) for what is `wanted`; `sagitta` in units of the limit."""
    facet = sagitta[mesh.face_edges].mean(axis=1)
    split = _edges_of(mesh, wanted & (facet > 1)) & (sagitta > 1) | _edges_of(mesh, wanted) & (length2 > max_edge_m**2)
    far = _edges_of(mesh, wanted) & (length2 > 4 * max_edge_m**2)
    red = (wanted & ((facet > 4) | _any(far[mesh.face_edges]))) | _all(split[mesh.face_edges])
    return split, red


def _complete(level: _Level, needed: np.ndarray) -> None:
    """Adds what is missing of the midpoints of the `needed` edges, bool (E,): most of those in the halo stay unused."""
    missing = needed & (np.diff(level.middle.indptr) == 0)
    if missing.any():
        level.middle = level.middle + midpoints(level.mesh, level.corners, level.points, missing)


def _depth(mesh: Topology, offset: np.ndarray, points: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Depth (E,) of offsets (E, 3) along the normals of the faces beside each edge: drift within the surface is no curvature.

    Only edges of `wanted` faces are evaluated, the others' depth is 0.
    """
    edges = _edges_of(mesh, wanted)
    faces = _any(edges[mesh.face_edges])
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


def _next_level(level: _Level, inside: np.ndarray, max_edge_m: float) -> _Level:
    """The children of the faces `inside`."""
    mesh = level.mesh
    here = np.flatnonzero(inside)
    kept = np.flatnonzero(np.bincount(mesh.faces[here].ravel()))
    cut = np.flatnonzero(_edges_of(mesh, inside))
    vertex = np.full(mesh.vertex_count, -1)
    vertex[kept] = np.arange(len(kept))
    middle = np.full(len(mesh.edges), -1)
    middle[cut] = len(kept) + np.arange(len(cut))
    creased = cut[level.crease[cut]]
    ends, mid = vertex[mesh.edges[creased]], middle[creased]
    sharp = np.concatenate([np.stack([ends[:, 0], mid], axis=1), np.stack([mid, ends[:, 1]], axis=1)])
    count = len(kept) + len(cut)
    child = topology(split_in_four(vertex[mesh.faces[here]], middle[mesh.face_edges[here]]), count, sharp)
    keys = child.edges[:, 0] * count + child.edges[:, 1]
    low, high = sharp.min(axis=1), sharp.max(axis=1)
    return _level(
        child,
        np.concatenate([level.corners[kept], np.zeros(len(cut), bool)]),
        np.concatenate([level.ids[kept], level.middle_ids[cut]]),
        np.isin(keys, low * count + high),
        np.repeat(here, 4),
        np.repeat(level.base[here], 4),
        np.concatenate([level.points[kept], level.middle[cut] @ level.points]),
        np.concatenate([level.scale[kept], level.scale[mesh.edges[cut]].mean(axis=1)]),
        np.repeat(level.red[:, here], 4, axis=1),
        max_edge_m,
    )


def _grow(mesh: Topology, chosen: np.ndarray, rings: int) -> np.ndarray:
    """Faces within `rings` rings of the chosen ones, neighbours by a vertex, (F,)."""
    for _ in range(rings):
        if chosen.all():
            break
        touched = np.zeros(mesh.vertex_count, bool)
        touched[mesh.faces[chosen]] = True
        chosen = _any(touched[mesh.faces])
    return chosen


def _any(three: np.ndarray) -> np.ndarray:
    """Whether any of each three is true, (N,) of (N, 3); numpy's own `any` takes ten times as long on so short an axis."""
    return three[:, 0] | three[:, 1] | three[:, 2]


def _all(three: np.ndarray) -> np.ndarray:
    """Whether all of each three are true, (N,) of (N, 3)."""
    return three[:, 0] & three[:, 1] & three[:, 2]


def _chords(mesh: Topology) -> Csr:
    """Mean of each edge's ends, (E, V)."""
    from scipy import sparse

    count = len(mesh.edges)
    return sparse.csr_matrix(
        (np.full(2 * count, 0.5), mesh.edges.ravel(), np.arange(count + 1) * 2), shape=(count, mesh.vertex_count)
    )


def _columns(matrix: Csr, ids: np.ndarray, count: int) -> Csr:
    """The matrix with its columns renamed to ids over all levels."""
    from scipy import sparse

    return sparse.csr_matrix((matrix.data, ids[matrix.indices], matrix.indptr), shape=(matrix.shape[0], count))


def _stack(steps: list[Csr], vertex_count: int) -> Csr:
    """All vertices of all levels from the coarse ones: each step's rows act on the vertices made before it."""
    from scipy import sparse

    operator = sparse.identity(vertex_count, format="csr")
    for step in steps:
        operator = sparse.vstack([operator, step @ operator], format="csr")
    return operator


def _grade(levels: list[_Level]) -> None:
    """Neighbours differ by at most one level: who touches a split edge of level k has a red parent in level k - 1."""
    for k in range(len(levels) - 1, -1, -1):
        level = levels[k]
        level.split[level.mesh.face_edges[level.red]] = True
        sides = level.split[level.mesh.face_edges]
        level.red |= _all(sides)
        if k:
            levels[k - 1].red[level.parent[_any(sides)]] = True


def _tree_masks(levels: list[_Level]) -> Iterator[np.ndarray]:
    """Faces of each level that exist in the refined mesh, red or leaf."""
    yield np.ones(len(levels[0].mesh.faces), bool)
    for coarse, fine in pairwise(levels):
        yield coarse.red[fine.parent]


@dataclass(frozen=True, slots=True)
class _Leaves:
    """Final faces from one level."""

    faces: np.ndarray
    """Vertex ids, (N, 3)."""
    base: np.ndarray
    edges: np.ndarray
    """Edges of the level's face that each lies in, (N, 3)."""
    weights: np.ndarray
    """Share of those edges' offsets in the mean depth below the surface, (N, 3)."""


_GREEN: dict[int, tuple[tuple[int, int, int], ...]] = {
    0: ((0, 1, 2),),
    1: ((0, 3, 2), (3, 1, 2)),
    2: ((3, 1, 4), (0, 3, 4), (0, 4, 2)),
    3: ((3, 1, 4), (3, 4, 2), (0, 3, 2)),
}
"""Triangles by code: corners 0, 1, 2, midpoints 3 of edge 01, 4 of 12. Case 2: diagonal from 0; case 3: from 2."""


def _leaves(level: _Level, tree: np.ndarray) -> _Leaves:
    """Faces that stay, closed towards finer neighbours: one split edge makes two faces, two make three."""
    chosen = np.flatnonzero(tree & ~level.red)
    sides = level.split[level.mesh.face_edges[chosen]]
    case = sides.sum(axis=1)
    # turn each face so that its split edges come first: one split edge at 0, two at 0 and 1
    turn = np.where(case == 1, sides.argmax(axis=1), np.where(case == 2, (sides.argmin(axis=1) + 1) % 3, 0))
    order = (turn[:, None] + np.arange(3)) % 3
    faces = np.take_along_axis(level.mesh.faces[chosen], order, axis=1)
    edges = np.take_along_axis(level.mesh.face_edges[chosen], order, axis=1)
    a, b, c = (level.points[faces[:, j]] for j in range(3))
    from_2 = np.linalg.norm((a + b) / 2 - c, axis=1) < np.linalg.norm((b + c) / 2 - a, axis=1)
    case = np.where((case == 2) & from_2, 3, case)
    middles = level.middle_ids[edges] if len(level.middle_ids) else np.full_like(edges, -1)
    six = np.concatenate([level.ids[faces], middles], axis=1)
    picks = [(np.flatnonzero(case == kind), np.array(codes)) for kind, triples in _GREEN.items() for codes in triples]
    which = np.concatenate([pick for pick, _ in picks])
    return _Leaves(
        np.concatenate([six[pick][:, codes] for pick, codes in picks]),
        level.base[chosen][which],
        edges[which],
        np.concatenate([np.repeat(_depth_weights(codes)[None], len(pick), axis=0) for pick, codes in picks]),
    )


def _depth_weights(codes: np.ndarray) -> np.ndarray:
    """Mean depth of a triangle in a parent face, as fractions of the parent edges' midpoint offsets o01, o12, o20, (3,).

    On a quadratic surface the offset of a chord with barycentric difference d is -sum_{i<j} d_i d_j o_ij, and a
    triangle lies below the surface by a third of the sum of its own three offsets (the mean of l_i l_j is 1/12).
    """
    barycentric = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0], [0, 0.5, 0.5]])[codes]
    d = np.roll(barycentric, -1, axis=0) - barycentric
    return -(d * np.roll(d, -1, axis=1)).sum(axis=0) / 3


def _displacement(
    levels: list[_Level], parts: list[_Leaves], points: np.ndarray, used: np.ndarray, fine: np.ndarray, total: int
) -> Csr:
    """Outward move of the used vertices from the vertices of all levels, (Vf, W); `points` (Vf, 3) at rest.

    A vertex moves by the area-weighted mean depth of the facets around it, so that sum_f A_f (mean move of f's
    vertices) = sum_f A_f depth_f: the volume behind the facets is right to O(h^4). Vertices on creases and boundaries
    stay.
    """
    from scipy import sparse

    crease = np.zeros(total, bool)
    for level in levels:
        crease[level.ids[level.mesh.edges[level.crease]]] = True
        if len(level.middle_ids):
            made = level.middle_ids[level.crease]
            crease[made[made >= 0]] = True
    area = np.linalg.norm(edge_cross(points[fine]), axis=1)
    area_of_vertex = np.bincount(fine.ravel(), weights=np.repeat(area, 3), minlength=len(used))
    weight = np.where(crease[used], 0.0, 1 / np.maximum(area_of_vertex, 1e-300))
    move = sparse.csr_matrix((len(used), total))
    stops = np.cumsum([len(part.faces) for part in parts])
    for level, part, stop in zip(levels, parts, stops, strict=True):
        mine = slice(stop - len(part.faces), stop)
        count = len(part.faces)
        depth = sparse.csr_matrix(
            (part.weights.ravel(), part.edges.ravel(), np.arange(count + 1) * 3), shape=(count, len(level.mesh.edges))
        )
        corners = fine[mine].ravel()
        mean = sparse.csr_matrix(
            (weight[corners] * np.repeat(area[mine], 3), (corners, np.repeat(np.arange(count), 3))),
            shape=(len(used), count),
        )
        edges = np.zeros(len(level.mesh.edges), bool)
        edges[part.edges] = True
        _complete(level, edges)
        move = move + _columns(mean @ depth @ (level.middle - _chords(level.mesh)), level.ids, total)
    # sums follow the order of storage, and what one limit gives must not depend on others by as much as a bit
    move.sort_indices()
    return move
