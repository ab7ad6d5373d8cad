"""A subdivided mesh at whose vertices visibility is sampled: edges are split at their midpoints, and no vertex moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.geometry.refine import Csr, Refinement
from t2d_rt.geometry.subdivide import split_in_four, topology


@dataclass(frozen=True, slots=True)
class SubdividedMesh:
    """A mesh at subdivision level `level`; the first vertices are its own."""

    faces: np.ndarray
    """(4^n F, 3), those of each face together."""
    operator: Csr
    """Sparse (V', V): the vertices, and any field of them, from those of the mesh."""
    level: int

    @classmethod
    def of(cls, faces: np.ndarray, vertex_count: int, level: int) -> SubdividedMesh:
        """Of triangles (F, 3) of so many vertices."""
        from scipy import sparse

        operator = sparse.eye_array(vertex_count, format="csr", dtype=np.float32)
        for _ in range(level):
            mesh = topology(faces, operator.shape[0])
            count = len(mesh.edges)
            ends = np.repeat(np.arange(count), 2), mesh.edges.ravel()
            half = sparse.csr_array((np.full(2 * count, 0.5, np.float32), ends), shape=(count, operator.shape[0]))
            faces = split_in_four(mesh.faces, operator.shape[0] + mesh.face_edges)
            operator = sparse.vstack([operator, half @ operator], format="csr")
        return cls(np.asarray(faces), operator, level)

    def to(self, fine: Refinement, faces: np.ndarray) -> Csr:
        """Sparse float32 (Vf, V'): a field of these vertices, carried linearly to those of a refinement of the mesh of `faces`."""
        from scipy import sparse

        rows = np.arange(fine.linear.shape[0])
        face = np.zeros(len(rows), np.int64)
        face[fine.nodes.ravel()] = np.repeat(fine.base_face, fine.nodes.shape[1])
        corners = faces[face]
        weights = np.asarray(fine.linear[np.repeat(rows, 3), corners.ravel()]).reshape(-1, 3)
        for _ in range(self.level):
            corner = weights.argmax(axis=1)
            inner = weights.max(axis=1) < 0.5
            face = 4 * face + np.where(inner, 3, corner)
            # A child's vertices: a corner and the two middles beside it, or the middles of edges 01, 12 and 20.
            outer = 2 * weights
            outer[rows, corner] -= 1
            weights = np.where(inner[:, None], 1 - 2 * weights[:, [2, 0, 1]], outer)
        entries = weights.astype(np.float32).ravel(), (np.repeat(rows, 3), self.faces[face].ravel())
        return sparse.csr_array(entries, shape=(len(rows), self.operator.shape[0]))
