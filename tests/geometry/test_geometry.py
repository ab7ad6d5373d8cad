"""Subdivision and refinement: closed forms on spheres, cylinders, boxes and plates, and what linearity promises."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, Delaunay, cKDTree
from scipy.spatial.transform import Rotation

from builders import icosphere
from measures import volume
from t2d_rt.core.errors import InputError
from t2d_rt.geometry import (
    Refinement,
    SubdividedMesh,
    crease_corners,
    curvature,
    levels,
    refinements,
    sharp_edges,
    topology,
    winding,
)
from t2d_rt.geometry.subdivide import midpoints, split_in_four

WAVENUMBER = 1613.8
WAVE = {"wavenumber": WAVENUMBER, "range_m": 10.0}
FIVE = [(0.25 + np.cos(2 * np.pi * j / 5) + 0.5 * np.cos(4 * np.pi * j / 5)) / 5 for j in range(5)]
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
SQUARE_FACES = np.array([[0, 1, 2], [0, 2, 3]])


def uneven_sphere(count: int, jitter: float, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Hull of a Fibonacci lattice with jitter: valences 4 to 8, uneven spacing."""
    i = np.arange(count) + 0.5
    polar, azimuth = np.arccos(1 - 2 * i / count), np.pi * (1 + 5**0.5) * i
    points = np.stack([np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)], axis=1)
    points += np.random.default_rng(0).normal(size=points.shape) * jitter * np.sqrt(4 * np.pi / count)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    faces = ConvexHull(points).simplices.copy()
    a, b, c = (points[faces[:, k]] for k in range(3))
    inward = (np.cross(b - a, c - a) * a).sum(axis=1) < 0
    faces[inward] = faces[inward][:, ::-1]
    return points * radius, faces


def edge_counts(faces: np.ndarray) -> np.ndarray:
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def refined(rest: np.ndarray, faces: np.ndarray, sagitta_rad: float | np.ndarray, **options: object) -> Refinement:
    (found,) = refinements(rest, faces, **{**WAVE, "sagittas_rad": [sagitta_rad], **options})  # type: ignore[arg-type]
    return found


# --- subdivision ---------------------------------------------------------------------------------------------------


def twice(vertices: np.ndarray, faces: np.ndarray, corrected: bool) -> np.ndarray:
    for _ in range(2):
        mesh = topology(faces, len(vertices))
        middles = midpoints(mesh, np.zeros(len(vertices), bool), vertices if corrected else None) @ vertices
        faces = split_in_four(mesh.faces, len(vertices) + mesh.face_edges)
        vertices = np.concatenate([vertices, middles])
    return vertices


def test_regular_butterfly_weights() -> None:
    grid = np.arange(49).reshape(7, 7)
    a, b, c, d = (g.ravel() for g in (grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]))
    mesh = topology(np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]), 49)
    row = midpoints(mesh, np.zeros(49, bool))[np.flatnonzero((mesh.edges == (24, 25)).all(axis=1))]
    assert sorted(row.data) == [-1 / 16] * 4 + [1 / 8] * 2 + [1 / 2] * 2


@pytest.mark.parametrize(
    ("valence", "weights"), [(3, [5 / 12, -1 / 12, -1 / 12]), (4, [3 / 8, 0, -1 / 8, 0]), (5, FIVE)]
)
def test_special_vertex_weights(valence: int, weights: list[float]) -> None:
    # a fan: the rim is a boundary, so the centre's stencil alone decides
    ring = np.arange(valence)
    faces = np.stack([np.zeros_like(ring), 1 + ring, 1 + np.roll(ring, -1)], axis=1)
    operator = midpoints(topology(faces, 1 + valence), np.zeros(1 + valence, bool)).toarray()
    rows = operator[np.isclose(operator[:, 0], 3 / 4)]
    assert len(rows) == valence
    row = rows[rows[:, 1].argmax()]
    assert np.allclose(row[1 : 1 + valence], weights)
    assert row.sum() == pytest.approx(1)


def test_children_are_numbered_by_parent_and_keep_orientation() -> None:
    _, faces = icosphere(1)
    children = split_in_four(faces, 100 + topology(faces, faces.max() + 1).face_edges).reshape(-1, 4, 3)
    assert (children[:, [0, 1, 2], [0, 1, 2]] == faces).all()
    # Each middle follows the corner before it; the fourth child has all three in that order.
    assert (children[:, [0, 1, 2], [1, 2, 0]] == children[:, 3, [0, 1, 2]]).all()


def test_sphere_radius_after_two_levels() -> None:
    errors = [np.abs(np.linalg.norm(twice(*icosphere(level), corrected=True), axis=1) - 1).max() for level in (2, 3)]
    assert errors[0] < 1.5e-3
    assert errors[1] < 1.2e-4
    plain = np.abs(np.linalg.norm(twice(*icosphere(3), corrected=False), axis=1) - 1).max()
    assert errors[1] < plain / 5


def test_open_curve_is_a_four_point_curve_and_stops_at_corners() -> None:
    angles = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    disc = np.concatenate([np.zeros((1, 3)), np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)])
    fan = np.stack([np.zeros(32, int), 1 + np.arange(32), 1 + np.roll(np.arange(32), -1)], axis=1)
    rim = sharp_edges(disc, fan, 45.0)
    mesh = topology(fan, len(disc), rim)
    middles = midpoints(mesh, crease_corners(disc, rim, 45.0)) @ disc
    assert np.abs(np.linalg.norm(middles[mesh.sharp], axis=1) - 1).max() < 1e-4  # 3/128 h^4 = 3.5e-5 at h = 0.196
    assert crease_corners(SQUARE, sharp_edges(SQUARE, SQUARE_FACES, 45.0), 45.0).all()


def test_creases_of_a_box_and_none_of_a_sphere() -> None:
    box = trimesh.creation.box((0.3, 0.2, 0.5))
    assert len(sharp_edges(box.vertices, box.faces, 45.0)) == 12
    assert len(sharp_edges(box.vertices, box.faces, 0.0)) == 12  # coplanar triangles are no crease
    assert len(sharp_edges(box.vertices, box.faces, 95.0)) == 0
    assert len(sharp_edges(*icosphere(2), 45.0)) == 0


def test_edge_of_three_faces_is_sharp() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]], dtype=float)
    faces = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    assert [0, 1] in sharp_edges(vertices, faces, 180.0).tolist()
    fine = midpoints(topology(faces, 5), np.zeros(5, bool)) @ vertices
    assert np.abs(fine[:, 1] * fine[:, 2]).max() == 0  # each leaf stays in its plane


# --- refinement ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sagitta_rad", [0.4, 0.1])
def test_refined_sphere_is_a_sphere(sagitta_rad: float) -> None:
    rest, faces = icosphere(3, 0.15)
    result = refined(rest, faces, sagitta_rad, displace=False)
    radius = np.linalg.norm(result.operator @ rest, axis=1)
    assert np.abs(radius - 0.15).max() < 2e-5
    assert radius.std() < 3e-6
    assert (edge_counts(result.faces) == 2).all()


def test_facets_keep_to_the_limit() -> None:
    rest, faces = icosphere(3, 0.15)
    fine = refined(rest, faces, 0.4, displace=False)
    corners = (fine.operator @ rest)[fine.faces]
    sagitta = 2 * WAVENUMBER * (0.15 - np.linalg.norm(corners.mean(axis=1), axis=1))
    assert 0.1 < sagitta.mean() < sagitta.max() < 0.45  # the 1/R term leaves it just under 0.4; 10 % for the surface
    assert len(fine.faces) < 60_000


@pytest.mark.parametrize("axes", [(0.15, 0.15, 0.15), (0.08, 0.11, 0.22)])
@pytest.mark.parametrize("graded", [False, True])
def test_displaced_facets_lie_on_the_surface_in_the_mean(axes: tuple[float, float, float], graded: bool) -> None:
    ball, faces = icosphere(4)
    rest = ball * axes
    limit = 0.1 * 10 ** (ball[:, 2] + 1) if graded else 0.4
    true = 4 / 3 * np.pi * np.prod(axes)
    errors = []
    for displace in (False, True):
        result = refined(rest, faces, limit, displace=displace)
        errors.append(volume(result.operator @ rest, result.faces) / true - 1)
    assert errors[0] < -5e-4
    assert abs(errors[1]) < 0.02 * abs(errors[0])


def test_displacement_converges_with_the_fourth_power() -> None:
    def error(level: int) -> float:
        rest, faces = icosphere(level)
        result = refined(rest, faces, 1e9)  # nothing is split: displacement alone
        assert len(result.faces) == len(faces)
        return abs(volume(result.operator @ rest, faces) / (4 / 3 * np.pi) - 1)

    assert error(3) < error(2) / 10


def test_uneven_sphere_stays_smooth() -> None:
    rest, faces = uneven_sphere(642, 0.15, 0.15)
    result = refined(rest, faces, 0.2, displace=False)
    fine = result.operator @ rest
    assert np.abs(np.linalg.norm(fine, axis=1) - 0.15).max() < 5e-5
    mesh = trimesh.Trimesh(fine, result.faces, process=False)
    assert np.degrees(mesh.face_adjacency_angles.max()) < 6.0


def test_box_stays_a_box() -> None:
    box = trimesh.creation.box((0.3, 0.2, 0.5))
    result = refined(box.vertices, box.faces, 0.1, range_m=1.0)
    fine = trimesh.Trimesh(result.operator @ box.vertices, result.faces, process=False)
    assert len(fine.faces) > 10_000
    assert fine.is_watertight
    assert fine.volume == pytest.approx(0.03, rel=1e-12)
    assert fine.area == pytest.approx(box.area, rel=1e-12)


@pytest.mark.parametrize(("side", "sagitta_rad"), [(0.1, 0.1), (2.0, 0.4)])
def test_plate_stays_a_plate_and_is_cut_for_the_near_field(side: float, sagitta_rad: float) -> None:
    rest = SQUARE * side
    result = refined(rest, SQUARE_FACES, sagitta_rad, range_m=1.0)
    fine = result.operator @ rest
    corners = fine[result.faces]
    a, b, c = (corners[:, k] for k in range(3))
    assert (fine[:, 2] == 0).all()
    assert fine.min() >= 0
    assert fine.max() <= side
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(side**2, rel=1e-12)
    length2 = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2).mean(axis=1)
    assert (2 * WAVENUMBER * length2 / 6 <= sagitta_rad * (1 + 1e-9)).all()


def test_cylinder_keeps_straight_generators_and_flat_caps() -> None:
    mesh = trimesh.creation.cylinder(radius=0.1, height=0.5, sections=32)
    result = refined(mesh.vertices, mesh.faces, 0.1, range_m=5.0, displace=False)
    fine = result.operator @ mesh.vertices
    side = np.abs(fine[:, 2]) < 0.2499
    caps = np.linalg.norm(fine[:, :2], axis=1) < 0.09
    assert np.abs(np.linalg.norm(fine[side, :2], axis=1) - 0.1).max() < 1e-5
    assert np.abs(np.abs(fine[caps & ~side, 2]) - 0.25).max() < 1e-12
    assert not (caps & side).any()
    assert (edge_counts(result.faces) == 2).all()
    assert len(result.faces) < 20_000  # facets grow long along the generators


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_grading_is_watertight_linear_and_balanced(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rest, faces = icosphere(2, 0.15)
    limit = 10 ** rng.uniform(-0.7, 2.5, len(rest))
    result = refined(rest, faces, limit)
    assert (edge_counts(result.faces) == 2).all()
    used = np.unique(result.faces)
    assert len(used) == result.operator.shape[0]
    assert len(used) - 1.5 * len(result.faces) + len(result.faces) == 2
    assert np.abs(result.operator.sum(axis=1) - 1).max() < 1e-12
    assert np.abs(result.linear.sum(axis=1) - 1).max() < 1e-12
    assert result.linear.data.min() > 0
    corners = (result.operator @ rest)[result.faces]
    length = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert (length.max(axis=1) < 4 * length.min(axis=1)).all()  # green halves of nearly equilateral faces at worst


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_rigid_motion_commutes(seed: int) -> None:
    rotation = Rotation.random(random_state=seed)
    shift = np.random.default_rng(seed).uniform(-3, 3, 3)
    rest, faces = icosphere(2, 0.15)
    rest = rest * (0.5, 1.0, 1.7)
    result = refined(rest, faces, 0.5)
    moved = rotation.apply(rest) + shift
    assert np.abs(result.operator @ moved - (rotation.apply(result.operator @ rest) + shift)).max() < 1e-12
    again = refined(moved, faces, 0.5)
    assert (again.faces == result.faces).all()
    assert np.abs(again.operator @ moved - result.operator @ moved).max() < 1e-9


@pytest.mark.slow
def test_all_refinements_sample_one_surface() -> None:
    rest, faces = icosphere(2, 0.15)
    rest = rest * (0.5, 1.0, 1.7)
    coarse, fine = (refined(rest, faces, s, displace=False).operator @ rest for s in (0.8, 0.05))
    rows = {tuple(row) for row in np.round(fine, 9)}
    assert all(tuple(row) in rows for row in np.round(coarse, 9))


@pytest.mark.slow
def test_building_only_what_is_needed_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    rest, faces = uneven_sphere(642, 0.15, 0.15)
    limit = np.full(len(rest), 300.0)
    limit[[7, 400]] = 0.003
    some = refined(rest, faces, limit)
    monkeypatch.setattr(levels, "HALO_RINGS", 60)
    everything = refined(rest, faces, limit)
    assert some.operator.shape == everything.operator.shape
    distance, _ = cKDTree(everything.operator @ rest).query(some.operator @ rest)
    assert distance.max() < 1e-12


@pytest.mark.slow
def test_refined_together_is_refined_alone() -> None:
    """Limits of which now one, now the other is finer, on a smooth mesh and one with edges."""
    box = trimesh.creation.box((0.2, 0.15, 0.1)).subdivide()
    for rest, faces in (uneven_sphere(642, 0.15, 0.15), (np.array(box.vertices), np.array(box.faces))):
        here = rest[:, 0] > 0.03
        limits = [np.where(here, 0.02, 5.0), np.where(here, 5.0, 0.1), 1.0]
        together = refinements(rest, faces, wavenumber=WAVENUMBER, range_m=1.0, sagittas_rad=limits)
        for limit, one in zip(limits, together, strict=True):
            alone = refined(rest, faces, limit, range_m=1.0)
            assert len(one.faces) > 1.5 * len(faces)
            assert np.array_equal(one.faces, alone.faces)
            assert np.array_equal(one.base_face, alone.base_face)
            # Bit for bit: diffuse points must not stir with the facets' size.
            assert np.array_equal(one.operator @ rest, alone.operator @ rest)
            assert np.array_equal(one.linear @ rest, alone.linear @ rest)


def test_linear_fields_and_base_faces_follow_the_coarse_faces() -> None:
    rest, faces = icosphere(1, 0.15)
    result = refined(rest, faces, 1.0)
    flat = result.linear @ rest
    normal = np.cross(rest[faces[:, 1]] - rest[faces[:, 0]], rest[faces[:, 2]] - rest[faces[:, 0]])[result.base_face]
    height = ((flat[result.faces] - rest[faces[result.base_face, 0]][:, None]) * normal[:, None]).sum(axis=2)
    assert np.abs(height).max() < 1e-15
    assert (np.diff(result.linear.indptr) <= 3).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"max_faces": 1000}, "more than .* faces, the limit is 1000; ask for a looser"),
        ({"faces": np.zeros((0, 3), int)}, r"faces must have shape \(face, 3\)"),
        ({"faces": np.array([[0, 1, 9]])}, "faces must name vertices 0..3, got 0..9"),
        ({"rest": np.zeros((0, 3))}, "faces must name vertices, but there are none; give at least three"),
    ],
)
def test_bad_input(change: dict[str, object], message: str) -> None:
    given_ = {"rest": SQUARE, "faces": SQUARE_FACES, "wavenumber": WAVENUMBER, "range_m": 1.0, "sagittas_rad": [0.1]}
    with pytest.raises(InputError, match=message):
        refinements(**{**given_, **change})  # type: ignore[arg-type]


# --- curvature ------------------------------------------------------------------------------------------------------


def tube(per_ring: int, steps: int, aspect: float, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """An open cylinder about z of steps rings; `aspect` is the height of a cell over its width."""
    angle = np.arange(per_ring) * 2 * np.pi / per_ring
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1)
    height = aspect * 2 * radius * np.sin(np.pi / per_ring)
    vertices = (ring + np.arange(steps)[:, None, None] * [0, 0, height]).reshape(-1, 3)
    low = np.add.outer(np.arange(steps - 1) * per_ring, np.arange(per_ring)).ravel()
    right = np.add.outer(np.arange(steps - 1) * per_ring, (np.arange(per_ring) + 1) % per_ring).ravel()
    up = [np.stack([low, right, right + per_ring], axis=1), np.stack([low, right + per_ring, low + per_ring], axis=1)]
    return vertices, np.concatenate(up)


@pytest.mark.parametrize("radius", [0.02, 0.3, 5.0])
def test_curvature_of_a_sphere(radius: float) -> None:
    vertices, faces = icosphere(3, radius)
    assert curvature(vertices, faces) * radius == pytest.approx(1, abs=0.02)
    uneven = curvature(*uneven_sphere(1000, 0.2, radius))
    assert np.median(uneven) * radius == pytest.approx(1, abs=0.02)
    assert np.quantile(np.abs(uneven * radius - 1), 0.9) < 0.2


@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.0])
def test_curvature_of_a_cylinder_is_the_mean_over_its_directions(aspect: float) -> None:
    # Euler: cos^2/a. Of six edges two run along the axis, two around it, two at tan = aspect.
    vertices, faces = tube(64, 9, aspect, 0.1)
    inner = curvature(vertices, faces).reshape(9, 64)[3:-3]
    assert inner * 0.1 == pytest.approx((1 + 1 / (1 + aspect**2)) / 3, abs=0.01)


def test_a_plane_and_the_faces_of_a_box_have_no_curvature() -> None:
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(np.linspace(0, 1, 13), np.linspace(0, 1, 13)), axis=-1).reshape(-1, 2)
    within = ((grid > 0) & (grid < 1)).all(axis=1)
    grid += within[:, None] * rng.uniform(-0.02, 0.02, grid.shape)
    plane = np.column_stack([grid, np.zeros(len(grid))])
    inner = ((grid > 0.3) & (grid < 0.7)).all(axis=1)
    rotation = Rotation.from_euler("xyz", [30, 40, 50], degrees=True)
    assert curvature(rotation.apply(plane), Delaunay(grid).simplices)[inner] == pytest.approx(0, abs=1e-4)  # 1/m

    box = trimesh.creation.box((1, 2, 3))
    assert not curvature(np.array(box.vertices), np.array(box.faces)).any()
    finer = box.subdivide().subdivide()
    assert curvature(np.array(finer.vertices), np.array(finer.faces)) == pytest.approx(0, abs=1e-5)
    # Without creases the edges are round.
    assert curvature(np.array(box.vertices), np.array(box.faces), 180.0).min() > 0.1


def test_curvature_does_not_depend_on_place_and_scales_with_size() -> None:
    vertices, faces = uneven_sphere(300, 0.2, 1.0)
    stretched = vertices * [1, 2, 3]
    rotation = Rotation.from_euler("xyz", [30, 40, 50], degrees=True)
    reference = curvature(stretched, faces)
    assert curvature(rotation.apply(stretched) + [4, 5, 6], faces) == pytest.approx(reference, rel=1e-6)
    assert curvature(0.01 * stretched, faces) == pytest.approx(100 * reference, rel=1e-6)
    # Of this ellipsoid's ends the long one is bent most: 3/1 and 3/4 about its two directions, against 1/4 and 1/9.
    ends = [int(np.argmax(stretched[:, axis])) for axis in (2, 0)]
    assert reference[ends[0]] > 5 * reference[ends[1]]


@pytest.mark.parametrize("times", [1, 2])
def test_subdivided_edges_move_nothing_and_hold_finer_fields(times: int) -> None:
    vertices, faces = uneven_sphere(60, 0.1, 0.3)
    fine = refined(vertices, faces, 0.5, range_m=3)
    subdivided = SubdividedMesh.of(faces, len(vertices), times)
    carried = subdivided.to(fine, faces)
    assert len(subdivided.faces) == 4**times * len(faces)
    # What is linear over the mesh's faces stays so; children lie in their parents' planes, turned as they are.
    places = subdivided.operator @ vertices
    np.testing.assert_allclose(carried @ places, fine.linear @ vertices, atol=1e-6)
    area = np.cross(*(places[subdivided.faces[:, k]] - places[subdivided.faces[:, 0]] for k in (1, 2)))
    whole = np.cross(*(vertices[faces[:, k]] - vertices[faces[:, 0]] for k in (1, 2)))
    np.testing.assert_allclose(area, np.repeat(whole, 4**times, axis=0) / 4**times, atol=1e-6)
    # A field of the new vertices alone comes through: at a vertex of both it is that vertex's own.
    field = np.random.default_rng(0).random(len(places))
    away, same = cKDTree(places).query(fine.linear @ vertices)
    np.testing.assert_allclose((carried @ field)[away < 1e-7], field[same[away < 1e-7]], atol=1e-6)
    assert (away < 1e-7).sum() > len(vertices)


def test_winding_is_1_inside_and_0_outside() -> None:
    """Of a closed mesh wherever the point is, also of several points at once; turned inside out it is -1."""
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.5)
    points = np.array([[0, 0, 0], [0.3, 0.2, -0.1], [0.6, 0, 0], [3, 2, 1]])
    corners = ball.triangles - points[:, None, None]
    np.testing.assert_allclose(winding(corners), [1, 1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(winding(corners[0, :, ::-1]), -1, atol=1e-9)
