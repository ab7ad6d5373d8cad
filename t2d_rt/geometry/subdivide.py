"""Modified butterfly subdivision as sparse matrices: the fixed curved surface through a mesh's vertices.

Interpolating, so a vertex never moves once it exists, and linear, so one matrix serves every pose. Smooth edges follow
the butterfly scheme (Dyn, Levin, Gregory 1990) with the stencils of Zorin, Schroeder and Sweldens (1996) at vertices of
valence other than 6; sharp and boundary edges follow the four-point curve rule. Stencils never reach across a sharp
edge: the point beyond it is replaced by the reflection u + v - x of the point before it, so flat parts stay flat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import checked_faces, edge_cross, norms

Csr = Any
"""scipy.sparse.csr_matrix; scipy is loaded when first used."""


_TERMS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Topology:
    """Adjacency of a triangle mesh. Half-edge 3 f + j runs from faces[f, j] to faces[f, j + 1]."""

    faces: np.ndarray
    """Indices of the vertices, int64 (F, 3)."""
    vertex_count: int
    edges: np.ndarray
    """Indices of the vertices, smaller first, int64 (E, 2)."""
    face_edges: np.ndarray
    """Edge of each half-edge, int64 (F, 3)."""
    twin: np.ndarray
    """Opposite half-edge, int64 (3 F,); -1 where the edge is sharp."""
    sharp: np.ndarray
    """Edges that no stencil crosses: those given as sharp, and those that do not join two faces of the same orientation, (E,)."""

    @property
    def valence(self) -> np.ndarray:
        """Number of edges at each vertex, (V,)."""
        return np.bincount(self.edges.ravel(), minlength=self.vertex_count)

    @property
    def sharp_valence(self) -> np.ndarray:
        """Number of sharp edges at each vertex, (V,)."""
        return np.bincount(self.edges[self.sharp].ravel(), minlength=self.vertex_count)


def sharp_edges(vertices: np.ndarray, faces: np.ndarray, crease_deg: float) -> np.ndarray:
    """Edges (S, 2) whose faces differ in direction by more than `crease_deg`, and those that do not join two faces."""
    vertices = np.asarray(vertices, dtype=np.float64)
    mesh = topology(faces, len(vertices))
    normal = face_normals(vertices, mesh.faces)
    half = np.flatnonzero(mesh.twin >= 0)
    across = np.einsum("ij,ij->i", normal[half // 3], normal[mesh.twin[half] // 3])
    sharp = mesh.sharp.copy()
    # 1e-9: coplanar faces differ by rounding, and crease_deg = 0 must not turn their edges into creases
    sharp[mesh.face_edges.ravel()[half[across < np.cos(np.radians(crease_deg)) - 1e-9]]] = True
    return mesh.edges[sharp]


def crease_corners(vertices: np.ndarray, sharp: np.ndarray, crease_deg: float) -> np.ndarray:
    """Vertices at which a sharp curve ends, branches or turns by more than `crease_deg`, bool (V,)."""
    vertices = np.asarray(vertices, dtype=np.float64)
    count = np.bincount(sharp.ravel(), minlength=len(vertices))
    along = vertices[sharp[:, 1]] - vertices[sharp[:, 0]]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    bend = np.zeros((len(vertices), 3))
    np.add.at(bend, sharp[:, 0], along)
    np.add.at(bend, sharp[:, 1], -along)
    # two unit vectors that leave a vertex at an angle pi - t have a sum of length 2 sin(t / 2)
    bent = np.linalg.norm(bend, axis=1) > 2 * np.sin(np.radians(min(crease_deg, 180.0)) / 2) + 1e-9
    return (count > 0) & ((count != 2) | bent)


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals (F, 3); zero for a face without area."""
    normal = edge_cross(vertices.take(faces, axis=0))
    return normal / np.maximum(norms(normal), 1e-300)[:, None]


def topology(faces: np.ndarray, vertex_count: int, sharp: np.ndarray | None = None) -> Topology:
    """Edges and half-edges of triangles (F, 3); `sharp` (S, 2) names edges that are kept sharp.

    An edge is named by one number, smaller vertex x V + greater vertex, so that equal edges are found by sorting. Two half-edges of
    one edge are twins where they run in opposite directions; where they run alike, one of the faces is turned over, and the edge
    is sharp.
    """
    faces = checked_faces("faces", faces, vertex_count).astype(np.int64, copy=False)
    tail, head = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    keys = np.minimum(tail, head) * vertex_count + np.maximum(tail, head)
    unique, order, first, inverse = distinct(keys)
    one, two = order[first], order[np.minimum(first + 1, len(order) - 1)]
    joined = (np.diff(first, append=len(keys)) == 2) & (tail[one] == head[two])
    if sharp is not None and len(sharp):
        sharp_ends = np.sort(np.asarray(sharp, dtype=np.int64), axis=1)
        joined &= ~np.isin(unique, sharp_ends[:, 0] * vertex_count + sharp_ends[:, 1])
    twin = np.full(len(keys), -1)
    twin[one[joined]], twin[two[joined]] = two[joined], one[joined]
    return Topology(
        faces=faces,
        vertex_count=vertex_count,
        edges=np.stack([unique // vertex_count, unique % vertex_count], axis=1),
        face_edges=inverse.reshape(-1, 3),
        twin=twin,
        sharp=~joined,
    )


def distinct(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Distinct values of (N,) in order, (D,); the order (N,) that sorts all values, and where the equals of each distinct one begin
    in it, (D,); the index of each value among the distinct ones, (N,).

    `np.unique` sorts stably, which takes several times as long; here equal values may come in any order.
    """
    order = np.argsort(values)
    ordered = values[order]
    new = np.diff(ordered, prepend=ordered[:1] - 1) > 0
    starts, inverse = np.flatnonzero(new), np.empty_like(order)
    inverse[order] = np.cumsum(new) - 1
    return ordered[starts], order, starts, inverse


def too_many_faces(needed: int, most: int) -> InputError:
    """The error for a refinement that would have more faces than are allowed."""
    return InputError(
        f"refining needs more than {needed} faces, the limit is {most}; "
        "ask for a looser tolerance or a greater sagitta_rad, or raise memory_gb (max_faces)"
    )


def split_in_four(faces: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Children (4 F, 3) of faces (F, 3) with edge midpoints (F, 3): corners 0, 1, 2, then the middle."""
    six = np.concatenate([faces, middle], axis=1)
    return six[:, [0, 3, 5, 3, 1, 4, 5, 4, 2, 3, 4, 5]].reshape(-1, 3)


SPLITS = (
    ((0, 1, 2),),
    ((0, 3, 2), (3, 1, 2)),
    ((3, 1, 4), (0, 3, 4), (0, 4, 2)),
    ((3, 1, 4), (3, 4, 2), (0, 3, 2)),
    ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
)
"""Triangles into which a face is divided, by how many of its edges are split: none, one, two (with the diagonal from corner 0, or
from corner 2) or three. Corners are 0, 1, 2; midpoints are 3 of edge 01, 4 of 12, 5 of 20."""


def split_edges_first(split: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number of split edges of each face, (N,) from (N, 3), and the order (N, 3) of its corners, and thus of its edges, in which
    these come first: a single one at 0, two at 0 and 1."""
    count = split[:, 0].astype(np.int8) + split[:, 1] + split[:, 2]
    first = np.where(count == 1, split.argmax(axis=1), np.where(count == 2, (split.argmin(axis=1) + 1) % 3, 0))
    return count, (first[:, None] + np.arange(3)) % 3


def split_picks(case: np.ndarray, splits: Sequence[Sequence[tuple[int, ...]]]) -> list[tuple[np.ndarray, np.ndarray]]:
    """For each triangle of each case, the indices of the faces (M,) that have it, and its codes (3,); `case` (N,) are indices of
    `splits`."""
    return [(np.flatnonzero(case == kind), np.array(codes)) for kind, all_of in enumerate(splits) for codes in all_of]


def in_children(face: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For points given by face (N,) and barycentric coordinates (N, 3): the same among the children of the faces, which are 4 f ..
    4 f + 3 for face f (`split_in_four`)."""
    rows, (corner, greatest) = np.arange(len(face)), greatest_of_three(weights)
    inner = greatest < 0.5
    outer = 2 * weights
    outer[rows, corner] -= 1
    # the corners of the middle child are the middles of edges 01, 12 and 20
    return 4 * face + np.where(inner, 3, corner), np.where(inner[:, None], 1 - 2 * weights[:, [2, 0, 1]], outer)


def greatest_of_three(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index of the greatest of three weights (N, 3), the first of equal ones, and its value, (N,) each; `argmax` takes ten times as
    long on so short an axis."""
    one = np.where(weights[:, 1] > weights[:, 0], 1, 0)
    value = np.maximum(weights[:, 0], weights[:, 1])
    return np.where(weights[:, 2] > value, 2, one), np.maximum(value, weights[:, 2])


def midpoints(
    mesh: Topology, corners: np.ndarray, rest: np.ndarray | None = None, chosen: np.ndarray | None = None
) -> Csr:
    """Edge midpoints on the butterfly surface = matrix (E, V) @ vertices; each row sums to 1.

    With `rest` (V, 3) the weights are corrected for uneven spacing there (`_quadratic_precision`). Rows of edges that are
    not `chosen`, bool (E,), stay empty.
    """
    from scipy import sparse

    chosen = np.ones(len(mesh.edges), bool) if chosen is None else chosen
    smooth = _first_half_edges(mesh)[chosen & ~mesh.sharp]
    special = (mesh.valence != 6) & (mesh.sharp_valence == 0)
    ends = np.concatenate([smooth, mesh.twin[smooth]])
    start, (ring, ring_columns, ring_weights) = _ring_stencils(mesh, ends[special[mesh.faces.ravel()[ends]]])
    ringed = np.bincount(mesh.face_edges.ravel()[start], minlength=len(mesh.edges))
    rows, columns, weights = _eight_point_stencils(mesh, smooth)
    parts = [
        _curve_stencils(mesh, corners, np.flatnonzero(chosen & mesh.sharp)),
        # beside a special vertex its ring determines the midpoint; the eight points keep weight 0, so that the correction can use
        # them
        (rows, columns, np.where(ringed[rows] == 0, weights, 0.0)),
        # an edge between two special vertices takes the mean of their stencils
        (ring, ring_columns, ring_weights / ringed[ring]),
    ]
    rows, columns, weights = (np.concatenate(column_parts) for column_parts in zip(*parts, strict=True))
    matrix = sparse.csr_matrix((weights, (rows, columns)), shape=(len(mesh.edges), mesh.vertex_count))
    if rest is not None:
        _quadratic_precision(matrix, mesh, rest, smooth)
        _tame(matrix, mesh, rest, np.flatnonzero(chosen))
    matrix.eliminate_zeros()
    return matrix


def _quadratic_precision(matrix: Csr, mesh: Topology, rest: np.ndarray, half: np.ndarray) -> None:
    """Corrects the weights of smooth edges (one half-edge each), in place, so that they reproduce quadratic surfaces on uneven
    vertices.

    In the tangent frame of an edge, (x, y) from the chord's middle in units of its length, the weights w shall satisfy sum_i w_i
    (1, x, y, x^2, x y, y^2)_i = (1, 0, 0, 0, 0, 0). The smallest change that does so is added, dw = C^T (C C^T)^-1 (t - C w). On an
    evenly spaced mesh of valence 6 the butterfly satisfies this already and dw = 0.
    """
    sides = half // 3, mesh.twin[half] // 3
    beside = np.flatnonzero(np.bincount(np.concatenate(sides), minlength=1))
    face_normal = np.zeros((len(mesh.faces), 3))
    face_normal[beside] = face_normals(rest, mesh.faces[beside])
    normal = face_normal[sides[0]] + face_normal[sides[1]]
    smooth = mesh.face_edges.ravel()[half]
    size = np.diff(matrix.indptr)[smooth]
    # fewer points than conditions: the stencil beside a corner keeps its plain weights
    for count in np.unique(size[size > _TERMS]):
        alike = np.flatnonzero(size == count)
        for start in range(0, len(alike), 16_384):  # in pieces, so that the working memory is bounded
            pick = alike[start : start + 16_384]
            rows = smooth[pick]
            entry = matrix.indptr[rows, None] + np.arange(count)
            terms = _quadratic_terms(rest, mesh.edges[rows], normal[pick], matrix.indices[entry])
            defect = np.eye(_TERMS)[0] - (terms @ matrix.data[entry][..., None])[..., 0]
            # Below this a midpoint would move by less than 1 % of its offset from the chord.
            uneven = np.abs(defect).max(axis=1) > 2e-3
            matrix.data[entry[uneven]] += _least_change(terms[uneven], defect[uneven])


def _least_change(terms: np.ndarray, defect: np.ndarray) -> np.ndarray:
    """Least-squares change dw (E, N) for conditions C = `terms` (E, 6, N) with residuals `defect` (E, 6)."""
    transposed = np.ascontiguousarray(terms.transpose(0, 2, 1))
    gram = terms @ transposed
    # 1e-9: keeps stencils solvable whose points lie on one conic
    gram += 1e-9 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(_TERMS)
    change = (transposed @ np.linalg.solve(gram, defect[..., None]))[..., 0]
    # rows still sum to 1 up to rounding; a stencil that would get large weights of both signs is left as it was
    change -= change.mean(axis=1, keepdims=True)
    # the magnitudes of the butterfly's own weights sum to 1.5
    change[np.abs(change).sum(axis=1) > 1.0] = 0.0
    return change


def _tame(matrix: Csr, mesh: Topology, rest: np.ndarray, rows: np.ndarray) -> None:
    """Replaces rows, in place, by the chord's middle where a stencil (on slivers) would move the midpoint far away."""
    a, b = (rest.take(mesh.edges[rows, j], axis=0) for j in range(2))
    offset, length = norms(matrix[rows] @ rest - (a + b) / 2), norms(b - a)
    # an arc reaches this where it turns by 106 degrees
    for row in rows[offset > 0.25 * length]:  # rare
        entry = slice(matrix.indptr[row], matrix.indptr[row + 1])
        matrix.data[entry] = np.where(np.isin(matrix.indices[entry], mesh.edges[row]), 0.5, 0.0)


def _quadratic_terms(rest: np.ndarray, edges: np.ndarray, normal: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Terms (1, x, y, x^2, x y, y^2) of vertices (E, N) in the frames of edges (E, 2) with normals (E, 3): (E, 6, N)."""
    a, b = rest[edges[:, 0]], rest[edges[:, 1]]
    along = b - a
    across = np.cross(normal, along)
    length2 = np.maximum((along**2).sum(axis=1), 1e-300)[:, None]
    across *= np.sqrt(length2 / np.maximum((across**2).sum(axis=1, keepdims=True), 1e-300))
    frame = np.stack([along, across], axis=2) / length2[..., None]
    x, y = np.moveaxis((rest[vertices] - (a + b)[:, None] / 2) @ frame, 2, 0)
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


Entries = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Rows, columns, weights of a sparse matrix."""


def _first_half_edges(mesh: Topology) -> np.ndarray:
    """One half-edge of each edge, (E,)."""
    half = np.empty(len(mesh.edges), dtype=np.int64)
    half[mesh.face_edges.ravel()] = np.arange(mesh.face_edges.size)
    return half


def next_half(half: np.ndarray) -> np.ndarray:
    """The half-edge after each given one in its face."""
    return np.where(half % 3 == 2, half - 2, half + 1)


def previous_half(half: np.ndarray) -> np.ndarray:
    """The half-edge before each given one in its face."""
    return np.where(half % 3 == 0, half + 2, half - 1)


def _curve_stencils(mesh: Topology, corners: np.ndarray, rows: np.ndarray) -> Entries:
    """Stencils along sharp curves: the four-point rule (-1, 9, 9, -1)/16, a parabola (3, 6, -1)/8 beside a corner, else the
    chord."""
    # A curve passes through a vertex at which exactly two sharp edges meet, unless it is a corner.
    through = (mesh.sharp_valence == 2) & ~corners
    neighbours = np.zeros(mesh.vertex_count, dtype=np.int64)
    a, b = mesh.edges[mesh.sharp].T
    np.add.at(neighbours, a, b)
    np.add.at(neighbours, b, a)
    a, b = mesh.edges[rows].T
    has_a, has_b = through[a], through[b]
    # a curve vertex has two neighbours: the other one is their sum less the known one
    before = np.where(has_a, neighbours[a] - b, a)
    after = np.where(has_b, neighbours[b] - a, b)
    both, one = has_a & has_b, has_a ^ has_b
    outer_a = np.where(both, -1 / 16, np.where(one & has_a, -1 / 8, 0.0))
    outer_b = np.where(both, -1 / 16, np.where(one & has_b, -1 / 8, 0.0))
    inner_a = np.where(both, 9 / 16, np.where(one, np.where(has_a, 3 / 4, 3 / 8), 1 / 2))
    inner_b = np.where(both, 9 / 16, np.where(one, np.where(has_b, 3 / 4, 3 / 8), 1 / 2))
    weights = np.concatenate([inner_a, inner_b, outer_a, outer_b])
    return np.tile(rows, 4), np.concatenate([a, b, before, after]), weights


def _eight_point_stencils(mesh: Topology, half: np.ndarray) -> Entries:
    """Butterfly stencils of smooth edges: ends 1/2, opposite vertices 1/8, wings -1/16 (Dyn, Levin, Gregory 1990)."""
    tail = mesh.faces.ravel()
    rows = mesh.face_edges.ravel()[half]
    twin = mesh.twin[half]
    ends = [tail[half], tail[twin], tail[previous_half(half)], tail[previous_half(twin)]]
    wings = np.concatenate([next_half(half), previous_half(half), next_half(twin), previous_half(twin)])
    rows4 = np.tile(rows, 4)
    # Where nothing lies beyond a wing, u + v - x replaces the vertex there: weights -1/16 for u and v, +1/16 for x.
    open_ = mesh.twin[wings] >= 0
    shut = wings[~open_]
    beyond = tail[previous_half(mesh.twin[wings[open_]])]
    ghost = [tail[shut], tail[next_half(shut)], tail[previous_half(shut)]]
    columns = np.concatenate([*ends, beyond, *ghost])
    count, ghosts = len(half), len(shut)
    weights = np.repeat(
        [1 / 2, 1 / 8, -1 / 16, 1 / 16], [2 * count, 2 * count, 4 * count - ghosts + 2 * ghosts, ghosts]
    )
    return np.concatenate([rows4, rows4[open_], np.tile(rows4[~open_], 3)]), columns, weights


def _ring_stencils(mesh: Topology, start: np.ndarray) -> tuple[np.ndarray, Entries]:
    """Stencils of half-edges that start at a smooth vertex of valence K != 6: 3/4 there, s_j on its ring (Zorin et al. 1996); and
    the half-edges to which these apply, (R,)."""
    tail = mesh.faces.ravel()
    valence = mesh.valence[tail[start]]
    half, whole = start.copy(), np.ones(len(start), bool)
    columns, weights, picks = [tail[start]], [np.full(len(start), 0.75)], [np.arange(len(start))]
    for j in range(int(valence.max(initial=0))):
        pick = np.flatnonzero(valence > j)
        columns.append(tail[next_half(half[pick])])
        weights.append(_ring_weights(valence[pick], j))
        picks.append(pick)
        half[pick] = mesh.twin[previous_half(half[pick])]
        # two fans meet in one vertex: the walk returns to its start too early
        whole[pick] &= (half[pick] != start[pick]) | (valence[pick] == j + 1)
    picked = np.concatenate(picks)
    keep = whole[picked]
    rows = mesh.face_edges.ravel()[start[picked]]
    return start[whole], (rows[keep], np.concatenate(columns)[keep], np.concatenate(weights)[keep])


def _ring_weights(valence: np.ndarray, j: int) -> np.ndarray:
    """s_j: (5, -1, -1)/12 for K = 3, (3, 0, -1, 0)/8 for 4, else (1/4 + cos(2 pi j/K) + cos(4 pi j/K)/2)/K."""
    angle = 2 * np.pi * j / valence
    weights = (0.25 + np.cos(angle) + 0.5 * np.cos(2 * angle)) / valence
    weights = np.where(valence == 3, (5 if j == 0 else -1) / 12, weights)
    return np.where(valence == 4, (3, 0, -1, 0)[j % 4] / 8, weights)
