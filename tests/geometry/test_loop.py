"""Loop's surface and the curved facets on it: against subdivision itself, smooth bodies, the closed form of a sphere."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import builders
import t2d_rt as t2d
from builders import icosphere, slow_after, static_mesh
from measures import nmse_db, volume
from t2d_rt.body import skin, template
from t2d_rt.core.errors import InputError
from t2d_rt.geometry import Refinement, curved, curved_refinements
from t2d_rt.geometry.curved import control_points, surface_rows
from t2d_rt.scattering import refinement
from t2d_rt.types import MovingMesh, Radar

WAVENUMBER = 1613.8
CORNERS = np.eye(3)


def meshes() -> list[tuple[np.ndarray, np.ndarray]]:
    """Valences 5 and 6; 4 and 5; 3; and 3 to 8 next to one another, unevenly spaced."""
    box = trimesh.creation.box()
    tetrahedron = np.array([[1.0, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]])
    faces = np.array([[0, 1, 3], [0, 3, 2], [0, 2, 1], [1, 2, 3]])
    uneven = trimesh.convex.convex_hull(np.random.default_rng(2).normal(size=(40, 3)))
    return [
        icosphere(1), (np.array(box.vertices), np.array(box.faces)), (tetrahedron, faces[:, ::-1]),
        (np.array(uneven.vertices), np.array(uneven.faces)),
    ]  # fmt: skip


def refined(rest: np.ndarray, faces: np.ndarray, sagitta_rad: float | np.ndarray, range_m: float = 10.0) -> Refinement:
    (found,) = curved_refinements(
        rest, faces, wavenumber=WAVENUMBER, range_m=range_m, sagittas_rad=[sagitta_rad], max_faces=1_000_000
    )
    return found


# --- the surface ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", slow_after(1, range(4)))
def test_places_are_those_that_subdivision_tends_to(number: int) -> None:
    points, faces = meshes()[number]
    parts = np.random.default_rng(number).integers(0, 33, size=(200, 2))
    weights = np.stack([parts.min(axis=1), np.ptp(parts, axis=1), 32 - parts.max(axis=1)], axis=1) / 32
    weights[:4] = *CORNERS, [0.5, 0.5, 0]
    face = np.random.default_rng(5).integers(0, len(faces), len(weights))
    rows = surface_rows(faces, len(points), face, weights)
    fine, _ = trimesh.remesh.subdivide_loop(points, faces, 6)
    # A vertex that subdivision has made is as far from its limit as its neighbours' mean, a hundredth of the edges of 1/64.
    assert cKDTree(fine).query(rows @ points)[0].max() < 2e-4 * np.ptp(points)
    assert np.abs(rows.sum(axis=1) - 1).max() < 1e-12


def test_neighbouring_faces_meet_on_their_edge() -> None:
    points, faces = meshes()[3]
    along = np.linspace(0, 1, 9)
    found: dict[tuple[int, int], np.ndarray] = {}
    for number, face in enumerate(faces):
        for i in range(3):
            a, b = int(face[i]), int(face[(i + 1) % 3])
            weights = np.outer(1 - along, CORNERS[i]) + np.outer(along, CORNERS[(i + 1) % 3])
            here = surface_rows(faces, len(points), np.full(9, number), weights) @ points
            if (b, a) in found:
                assert found[b, a][::-1] == pytest.approx(here, abs=1e-9)
            found[a, b] = here


def test_the_surface_is_smooth_across_edges_and_at_vertices() -> None:
    """C2 across an edge: second differences along a line through both faces do not jump, as they do on a C1 surface."""
    points, faces = icosphere(3)
    valence = np.bincount(faces.ravel())
    inner = np.flatnonzero((valence[faces] == 6).all(axis=1))
    step, line = 1 / 64, np.arange(-6, 7)
    # Through the vertex at corner 0, along the edge to corner 1 and straight on: there are six edges.
    for number in inner[:20]:
        face = faces[number]
        ring = [f for f in faces if face[0] in f]
        order = {int(np.roll(f, -list(f).index(face[0]))[1]): int(np.roll(f, -list(f).index(face[0]))[2]) for f in ring}
        chain = [int(face[1])]
        for _ in range(3):
            chain.append(order[chain[-1]])
        opposite = chain[3]
        beyond = next(k for k, f in enumerate(faces) if face[0] in f and opposite in f)
        at = list(faces[beyond]).index(face[0]), list(faces[beyond]).index(opposite)
        here = list(face).index(face[0]), list(face).index(face[1])
        weights = np.zeros((len(line), 3))
        which = np.where(line >= 0, number, beyond)
        for k, n in enumerate(line):
            first, second = here if n >= 0 else at
            weights[k, first], weights[k, second] = 1 - abs(n) * step, abs(n) * step
        places = surface_rows(faces, len(points), which, weights) @ points
        bend = np.linalg.norm(np.diff(places, n=2, axis=0) / step**2, axis=1)
        assert np.abs(np.diff(bend)).max() < 0.03 * bend.mean()


def test_the_surface_runs_through_the_vertices_of_smooth_meshes() -> None:
    worst, median = [], []
    for level in (2, 3, 4):
        points, faces = icosphere(level)
        rows = surface_rows(faces, len(points), np.repeat(np.arange(len(faces)), 3), np.tile(CORNERS, (len(faces), 1)))
        found = rows @ (control_points(faces, len(points)) @ points)
        off = np.abs(np.linalg.norm(found, axis=1) - 1)
        worst.append(off.max())
        median.append(np.median(off))
    assert worst[0] < 2e-3
    assert worst[0] > 3 * worst[1] > 9 * worst[2]
    assert median[0] < 4e-4
    assert median[0] > 3 * median[1] > 9 * median[2]


def test_a_mesh_with_a_hole_is_refused() -> None:
    points, faces = icosphere(1)
    with pytest.raises(InputError, match="closed mesh, got 3 edges"):
        refined(points, faces[1:], 0.5)
    with pytest.raises(InputError, match=r"ball must be watertight to have curved facets, got 3 of 120 edges"):
        static_mesh(points, faces[1:], curved=True, name="ball")


# --- facets on it -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def adult() -> tuple[np.ndarray, np.ndarray]:
    body = template("adult")
    return body.vertices, body.faces


def test_facets_join_edge_to_edge_and_share_their_nodes(adult: tuple[np.ndarray, np.ndarray]) -> None:
    rest, faces = adult
    sagitta = np.random.default_rng(0).uniform(0.7, 3, len(rest))
    fine = refined(rest, faces, sagitta)
    edges = np.sort(fine.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, first, count = np.unique(edges, axis=0, return_index=True, return_counts=True)
    assert (count == 2).all()
    middle = fine.middles.ravel()
    by_edge = {tuple(edge): middle[k] for edge, k in zip(unique.tolist(), first.tolist(), strict=True)}
    assert all(by_edge[tuple(edge)] == middle[k] for k, edge in enumerate(edges.tolist()))
    assert len(np.unique(fine.nodes)) == fine.operator.shape[0]
    assert np.abs(fine.operator.sum(axis=1) - 1).max() < 1e-12
    assert np.abs(fine.linear.sum(axis=1) - 1).max() < 1e-12


@pytest.mark.slow
def test_all_refinements_are_samples_of_one_surface(adult: tuple[np.ndarray, np.ndarray]) -> None:
    rest, faces = adult
    for sagitta in (3.0, 0.75):
        fine = refined(rest, faces, sagitta)
        for column in fine.nodes.T:
            weights = fine.linear[np.repeat(column, 3), faces[fine.base_face].ravel()].reshape(-1, 3)
            rows = surface_rows(faces, len(rest), fine.base_face, np.asarray(weights))
            assert abs(rows - fine.operator[column]).max() < 1e-12


@pytest.mark.slow
def test_facets_move_with_the_body(adult: tuple[np.ndarray, np.ndarray]) -> None:
    rest, faces = adult
    fine = refined(rest, faces, 2.0)
    rotation, shift = Rotation.from_euler("xyz", [20, 50, -70], degrees=True), np.array([1.0, -2, 0.5])
    assert fine.at(rotation.apply(rest) + shift) == pytest.approx(rotation.apply(fine.at(rest)) + shift, abs=1e-12)
    poses = np.stack([rest, rest + shift])
    assert fine.controlled(poses)[1] == pytest.approx(fine.controlled(rest) + shift, abs=1e-12)


def test_sagittas_are_within_the_limit() -> None:
    rest, faces = icosphere(2, 0.15)
    for limit in (0.3, 1.2):
        fine = refined(rest, faces, limit)
        places = fine.at(rest)
        corners, middles = places[fine.faces], places[fine.middles]
        chord = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        # A sphere: 2 k L^2 (1/r + 1/R) / 6, whatever the direction.
        sagitta = 2 * WAVENUMBER * chord**2 * (1 / 0.15 + 1 / 10.0) / 6
        assert 0.3 * limit < np.quantile(sagitta.mean(axis=1), 0.1)
        assert np.quantile(sagitta.mean(axis=1), 0.95) < 1.1 * limit
        assert np.linalg.norm(middles, axis=2) == pytest.approx(0.15, abs=6e-4)


def test_too_many_facets_are_refused() -> None:
    rest, faces = icosphere(2, 0.15)
    with pytest.raises(InputError, match="limit is 3000; ask for a looser tolerance"):
        curved_refinements(rest, faces, wavenumber=WAVENUMBER, range_m=3.0, sagittas_rad=[0.05], max_faces=3000)


def test_longest_edges_are_as_asked_for() -> None:
    rest, faces = icosphere(2, 0.15)
    (fine,) = curved_refinements(
        rest, faces, wavenumber=WAVENUMBER, range_m=3.0, sagittas_rad=[100.0], max_faces=10**6, max_edge_m=0.013
    )
    corners = fine.at(rest)[fine.faces]
    assert 0.006 < np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max() <= 0.013


@pytest.mark.slow
def test_flat_triangles_in_their_place_enclose_as_much() -> None:
    rest, faces = icosphere(3, 0.15)
    fine = refined(rest, faces, 1.5)
    flat = fine.flattened(rest)
    finest = refined(rest, faces, 0.03)
    true = volume(finest.at(rest), finest.faces)
    corners_only = volume(fine.at(rest), fine.faces)
    assert flat.middles is None
    assert flat.operator.shape[0] == len(np.unique(fine.faces))
    assert abs(volume(flat.at(rest), flat.faces) / true - 1) < 0.06 * abs(corners_only / true - 1)


# --- their echoes -----------------------------------------------------------------------------------------------------


def curved_ball(radius_m: float, sagitta_rad: float, level: int = 4) -> MovingMesh:
    times = np.array([0.0, 0.05])
    rest, faces = icosphere(level, radius_m)
    # The middle of a face of the icosahedron looks at the radar: where five edges meet, the surface is not quite a sphere.
    rest = Rotation.align_vectors([[-2.0, -0.1, 0]], [[1.0, 1, 1]])[0].apply(rest)
    return MovingMesh(
        np.stack([rest + [2.0, 0.1, 1.0]] * 2), faces, times, "pec", sagitta_rad=sagitta_rad, curved=True, name="ball"
    )


@pytest.mark.parametrize("radius_m", [0.1, 0.25])
def test_a_curved_sphere_returns_the_closed_form(radius_m: float) -> None:
    radar = Radar.preset("table2")
    cube = t2d.simulate(curved_ball(radius_m, 1.0), radar=radar, accuracy={"occlusion": False}).cube
    range_m = np.linalg.norm(np.array([2.0, 0.1, 1.0]) - radar.tx_position_m) - radius_m
    spectrum = np.fft.fft(cube[0, 0] * np.hanning(radar.samples), 16 * radar.samples)
    power = (np.abs(spectrum).max() / np.hanning(radar.samples).sum()) ** 2
    # pi r^2 as the field of a divergent wave has it: the specular point is r before the centre.
    expected = radar.received_power_w(math.pi * radius_m**2 * (range_m / (range_m + radius_m)) ** 2, range_m)
    assert 10 * math.log10(power / expected) == pytest.approx(0, abs=0.1)


@pytest.mark.slow
def test_a_body_of_few_curved_facets_and_what_half_their_edges_gain() -> None:
    """25 000 facets for -24 dB, and 12 dB or more for half the edge."""
    motion = t2d.place(t2d.trim(builders.walk(), 1.0, 1.04), distance_m=2.5)
    settings = {"occlusion": False, "surface_rate_hz": 150.0}

    def cube(scale: float) -> np.ndarray:
        found = t2d.simulate(motion, radar=Radar.preset("table2"), accuracy={"sagitta_scale": scale, **settings})
        return np.asarray(found.cube)

    finest = cube(0.3)
    coarse, default, fine = (nmse_db(cube(scale), finest) for scale in (2.4, 1.0, 0.6))
    body = skin(motion)
    assert len(refined(body.rest, body.faces, body.sagitta_rad, 2.0).faces) <= 26_000
    assert default < -24
    assert coarse - fine > 12


def test_a_curved_mesh_is_made_again() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = t2d.simulate(curved_ball(0.1, 1.0, level=2), radar=Radar.preset("table2"))
    assert np.array_equal(found.again().cube, found.cube)


def test_flat_facets_are_kept_by_their_curved_ones_and_the_pose_at_rest() -> None:
    surface = curved_ball(0.1, 1.0, level=2)
    fine, coarse = refinement.refined(surface, WAVENUMBER, 10.0, [0.5, 2.0], 1_000_000)
    poses = surface.rest, surface.rest * [1, 1, 3]
    for each in (fine, coarse, fine):
        for rest in poses:
            kept, made = refinement.flattened(each, rest), each.flattened(rest)
            np.testing.assert_array_equal(kept.faces, made.faces)
            assert (kept.operator != made.operator).nnz == 0
            assert kept is refinement.flattened(each, rest)
    refinement.forget()
    assert refinement.flattened(fine, poses[1]) is not kept
    other = replace(fine, key=None)  # of a method that keeps none
    assert refinement.flattened(other, poses[0]) is not refinement.flattened(other, poses[0])


@pytest.mark.parametrize("shape", ["sphere", "torus", "body"])
def test_subdivisions_that_are_kept_give_the_same_rows(shape: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A torus has corners of six neighbours alone, so that nothing of it is subdivided."""
    if shape == "torus":
        mesh = trimesh.creation.torus(1.0, 0.3, 16, 12)
        points, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    elif shape == "sphere":
        points, faces = icosphere(2)
    else:
        points, faces = template("adult").vertices, template("adult").faces
    rng = np.random.default_rng(0)
    face, weights = rng.integers(len(faces), size=300), rng.dirichlet(np.ones(3), 300)
    weights[:30] = np.eye(3)[rng.integers(3, size=30)]
    first, again = (surface_rows(faces, len(points), face, weights) for _ in range(2))
    kept = curved._levels
    monkeypatch.setattr(curved, "_levels", lambda *mesh: kept(*mesh)[:1])
    anew = surface_rows(faces, len(points), face, weights)
    for rows in (again, anew):
        assert np.array_equal(rows.indptr, first.indptr)
        assert np.array_equal(rows.indices, first.indices)
        assert np.array_equal(rows.data, first.data)
    assert np.abs(first.sum(axis=1) - 1).max() < 1e-12
