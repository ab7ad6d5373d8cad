"""Diffuse points: the right amount of surface, the same points at every tessellation."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from builders import icosphere
from t2d_rt.core.errors import InputError
from t2d_rt.geometry import SurfacePoints, hash_uniform, point_spacing, surface_points

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
SQUARE_FACES = np.array([[0, 1, 2], [0, 2, 3]])


def positions(points: SurfacePoints, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    return np.einsum("qk,qkd->qd", points.barycentric, vertices[faces[points.face]])


def test_weights_add_up_to_the_area() -> None:
    vertices, faces = icosphere(4, 0.5642)
    points = surface_points(vertices, faces, seed=0, spacing_m=2**-6)
    area = trimesh.Trimesh(vertices, faces, process=False).area
    assert points.area_m2.sum() == pytest.approx(area, rel=0.01)
    assert np.allclose(points.barycentric.sum(axis=1), 1)
    assert points.barycentric.min() >= 0


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**63), angles=st.tuples(*[st.floats(0, 6.28)] * 3))
def test_tilted_plate_has_its_area(seed: int, angles: tuple[float, float, float]) -> None:
    rotation = trimesh.transformations.euler_matrix(*angles)[:3, :3]
    points = surface_points(SQUARE @ rotation.T - 0.3, SQUARE_FACES, seed=seed, spacing_m=1 / 64)
    # 4 000 cells and more; only those at the rim (250) are a matter of chance: 1 % is over three sigma
    assert points.area_m2.sum() == pytest.approx(1, rel=0.01)


def test_same_points_at_every_tessellation() -> None:
    fine = icosphere(5, 0.15)
    coarse = icosphere(3, 0.15)
    a, b = (surface_points(*mesh, seed=3, spacing_m=2**-8) for mesh in (coarse, fine))
    _, ia, ib = np.intersect1d(a.phase_rad, b.phase_rad, return_indices=True)
    assert len(ia) > 0.98 * len(b.face)
    assert len(ia) > 0.99 * len(a.face)
    apart = np.linalg.norm(positions(a, *coarse)[ia] - positions(b, *fine)[ib], axis=1)
    # the surfaces are L^2 / 8a = 0.4 mm apart, a line meets them up to 1/cos of its angle further
    assert np.median(apart) < 6e-4
    assert np.median(np.abs(a.area_m2[ia] / b.area_m2[ib] - 1)) < 0.02


def test_cutting_a_flat_face_changes_nothing() -> None:
    rotation = trimesh.transformations.euler_matrix(0.3, 0.7, 1.1)[:3, :3]
    vertices = np.concatenate([SQUARE, [[0.37, 0.61, 0]]]) @ rotation.T
    faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    a = surface_points(vertices[:4], SQUARE_FACES, seed=1, spacing_m=1 / 32)
    b = surface_points(vertices, faces, seed=1, spacing_m=1 / 32)
    assert (a.phase_rad == b.phase_rad).all()
    assert np.allclose(a.area_m2, b.area_m2)
    assert np.allclose(positions(a, vertices, SQUARE_FACES), positions(b, vertices, faces), atol=1e-12)


def test_line_through_shared_edges_hits_once() -> None:
    # every line along z pierces a fan of slivers that covers the square exactly once, edges and vertices included
    count = 400
    x = np.repeat(np.linspace(0, 1, count + 1), 2)
    vertices = np.stack([x, np.tile([0.0, 1.0], count + 1), 0 * x], axis=1)
    k = 2 * np.arange(count)
    faces = np.concatenate([np.stack([k, k + 2, k + 3], 1), np.stack([k, k + 3, k + 1], 1)])
    points = surface_points(vertices, faces, seed=0, spacing_m=1 / 128)
    assert len(points.face) == 128 * 128


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("folded", [False, True])
def test_a_line_through_an_edge_hits_a_flat_surface_once_and_a_fold_twice_or_never(seed: int, folded: bool) -> None:
    """The line of one cell passes through the edge, parallel to an axis in half of the cases; the faces are far smaller."""
    rng, cell = np.random.default_rng(seed), (3, -2)
    line = [place + hash_uniform(seed, 2, *cell, number) for number, place in enumerate(cell)]
    along, aside = rng.uniform(-1e-6, 1e-6, (2, 2)) * (rng.random(2) < 0.5)[:, None] + [[0, 1e-5], [1e-5, 0]]
    corners = np.array([line - along, line + along, line - aside, line + (-0.7 if folded else 1) * aside])
    vertices = np.column_stack([corners, [0.1, 0.1, 0.2, 0.3]])
    counts = {
        len(surface_points(vertices, np.array([first, second]), seed=seed, spacing_m=1.0).face)
        for first in ((0, 1, 2), (1, 0, 2), (2, 0, 1))
        for second in ((0, 1, 3), (1, 3, 0), (3, 1, 0))
    }
    assert counts in ([{0}, {2}] if folded else [{1}])


def test_points_are_uniform_and_phases_uncorrelated() -> None:
    vertices, faces = icosphere(4, 1.0)
    a, b = (surface_points(vertices, faces, seed=seed, spacing_m=2**-6) for seed in (0, 1))
    place = positions(a, vertices, faces)
    weight = a.area_m2 / a.area_m2.sum()
    assert np.abs(weight @ place).max() < 5e-3
    assert np.allclose(np.einsum("q,qi,qj->ij", weight, place, place), np.eye(3) / 3, atol=3e-3)
    count = min(len(a.face), len(b.face))
    noise = 4 / np.sqrt(count)
    assert abs(np.exp(1j * a.phase_rad).mean()) < noise
    assert abs(np.exp(1j * (a.phase_rad[:count] - b.phase_rad[:count])).mean()) < noise
    assert abs(np.exp(1j * np.diff(a.phase_rad)).mean()) < noise


def test_hash_is_splitmix64() -> None:
    # first output of the reference generator seeded with 0 (Vigna's splitmix64.c)
    assert hash_uniform(0) == (0xE220A8397B1DCDAF >> 11) * 2.0**-53
    draws = hash_uniform(5, np.arange(-1000, 1000)[:, None], np.arange(100))
    assert abs(draws.mean() - 0.5) < 3e-3
    assert abs(draws.var() - 1 / 12) < 1e-3


def test_spacing_is_a_power_of_two_that_gives_about_the_count() -> None:
    spacing = point_spacing(4 * np.pi, 50_000)
    assert np.log2(spacing) == round(np.log2(spacing))
    vertices, faces = icosphere(4, 1.0)
    assert 25_000 < len(surface_points(vertices, faces, seed=0, spacing_m=spacing).face) < 100_000
    assert point_spacing(4 * np.pi * 0.995, 50_000) == spacing


def test_degenerate_faces_are_skipped() -> None:
    vertices = np.concatenate([SQUARE, [[0.5, 0.5, 1.0], [0.5, 0.5, 2.0]]])
    faces = np.concatenate([SQUARE_FACES, [[4, 5, 5], [4, 4, 5]]])
    points = surface_points(vertices, faces, seed=0, spacing_m=1 / 16)
    assert np.isfinite(points.barycentric).all()
    assert points.face.max() == 1


def test_bad_input() -> None:
    with pytest.raises(InputError, match="raise spacing_m"):
        surface_points(SQUARE, SQUARE_FACES, seed=0, spacing_m=1e-5)
    with pytest.raises(InputError, match="area_m2 and count must be positive, got 0 and 5"):
        point_spacing(0, 5)
