"""Occlusion: straight lines past spheres, fading between visibility samples, and the invariants of both."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from builders import icosphere, moving, plate, slow_after, static_mesh, walk
from t2d_rt.body.template import template
from t2d_rt.core.backend import Backend, select
from t2d_rt.core.errors import T2DWarning
from t2d_rt.core.memory import SAMPLE_BYTES, VISIBILITY_BYTES
from t2d_rt.geometry import SubdividedMesh
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.propagation.occluders import Occluders, PosedOccluders
from t2d_rt.propagation.paths import find_paths
from t2d_rt.propagation.visibility import OccluderScene, Occlusion, Viewpoints, _Chunk, sample_times, viewpoints_at
from t2d_rt.types import MovingMesh, Scene
from t2d_rt.types.motion import CANONICAL_JOINTS

HERE = np.array([0.0, 0.0, 1.0])
SIGHT = viewpoints_at([HERE])
LONG_S = (0.0, 1.0)
# Rays start 2 mm towards the viewpoint and 2 mm along the normal: a shadow's edge may lie that far off.
EDGE_M = 0.005


def sphere(radius_m: float, centre_m: Sequence[float], level: int = 3) -> MovingMesh:
    return moving_sphere(radius_m, [centre_m, centre_m], LONG_S, level)


def moving_sphere(
    radius_m: float, centres_m: Sequence[Sequence[float]], times_s: Sequence[float], level: int = 3
) -> MovingMesh:
    vertices, faces = icosphere(level, radius_m)
    # Turned at random: no vertex lies in a plane of symmetry of the scene.
    rotated = Rotation.random(rng=np.random.default_rng(7)).apply(vertices)
    return moving((rotated, faces), np.array(centres_m), np.array(times_s))


def occlusion(meshes: list[MovingMesh], backend: Backend, rate_hz: float = 10.0, at: np.ndarray = HERE) -> Occlusion:
    start, stop = max(m.times_s[0] for m in meshes), min(m.times_s[-1] for m in meshes)
    return Occlusion.alone(
        Occluders(meshes), *viewpoints_at([at]), samples_s=sample_times(start, stop, rate_hz), backend=backend,
        wavelength_m=None,
    )  # fmt: skip


def the_scene(view: Occlusion, at: PosedOccluders) -> OccluderScene:
    scene = view.viewpoints.scene(at)
    assert scene is not None
    return scene


def facing(mesh: MovingMesh, time_s: float = 0.0) -> np.ndarray:
    """Which vertices lie this side of the horizon, by the area-weighted normals of their faces, (V,)."""
    place = mesh.at(np.array([time_s]))[0]
    corners = place[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = np.zeros_like(place)
    np.add.at(normal, mesh.faces.ravel(), np.repeat(across, 3, axis=0))
    return np.sum(normal * (HERE - place), axis=1) > 0


def depth_in_shadow(points: np.ndarray, centre: np.ndarray, radius_m: float) -> np.ndarray:
    """How deep the line from points (N, 3) behind a ball to the viewpoint cuts into it [m]; negative where it misses it."""
    ray = points - HERE
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    offset = centre - HERE
    return radius_m - np.linalg.norm(offset - (ray @ offset)[:, None] * ray, axis=1)


# --- one instant: straight lines -------------------------------------------------------------------------------------


def test_a_convex_body_hides_nothing_of_its_lit_side(backend: Backend) -> None:
    ball = sphere(0.3, [3, 0.2, 1.1])
    (seen,) = occlusion([ball], backend).visibility(np.array([0.0]))
    assert seen.shape == (1, len(ball.rest))
    assert seen.dtype == np.float32
    lit = facing(ball)
    assert 0.3 < lit.mean() < 0.5
    assert (seen[0, lit] == 1).all()
    # Just beyond the horizon a vertex takes over its lit neighbours' value; behind those, nothing is seen.
    edges = ball.trimesh().edges_unique
    beyond = np.zeros(len(lit), bool)
    for a, b in np.concatenate([edges, edges[:, ::-1]]):
        beyond[a] |= lit[b] and not lit[a]
    assert beyond.sum() > 20
    assert (seen[0, beyond] == 1).all()
    assert (seen[0, ~lit & ~beyond] == 0).all()


@pytest.mark.parametrize("range_m", [0.5, 2.0, 30.0, 300.0])
def test_a_sphere_behind_another_is_hidden_and_beside_it_is_seen(range_m: float, backend: Backend) -> None:
    front, behind = sphere(0.1, [range_m, 0, 1]), sphere(0.05, [range_m + 0.3, 0, 1])
    beside = sphere(0.05, [range_m + 0.3, 0.3, 1])
    first, second, third = occlusion([front, behind, beside], backend).visibility(np.array([0.0]))
    assert (first[0, facing(front)] == 1).all()
    assert not second.any()
    assert (third[0, facing(beside)] == 1).all()
    # The one behind hides nothing of what is before it, and alone is seen.
    (alone,) = occlusion([behind], backend).visibility(np.array([0.0]))
    assert (alone[0, facing(behind)] == 1).all()


def test_rays_that_run_on_to_edges_and_corners_do_not_slip_through(backend: Backend) -> None:
    """Meshes that are symmetric about the line of sight: rays along it meet the one in front between its triangles."""
    vertices, faces = icosphere(4)
    front, behind = (static_mesh(radius * vertices + [x, 0, 1], faces) for radius, x in ((0.15, 3.15), (0.04, 3.75)))
    _, seen = occlusion([front, behind], backend).visibility(np.array([0.0]))
    assert not seen.any()


@pytest.mark.parametrize("towards", ["y", "z"])
def test_half_behind_is_half_seen(towards: str, backend: Backend) -> None:
    # The small sphere's centre lies on the ray that grazes the big one: half of what would be seen is in its shadow.
    angle = math.asin(0.5 / 2)
    centre = 4 * np.array([math.cos(angle), math.sin(angle), 0])
    centre = (centre if towards == "y" else centre[[0, 2, 1]]) + HERE
    front, half = sphere(0.5, [2, 0, 1], level=5), sphere(0.2, list(centre), level=4)
    _, seen = occlusion([front, half], backend).visibility(np.array([0.0]))
    lit = facing(half)
    depth = depth_in_shadow(half.rest, front.rest.mean(axis=0), 0.5)
    sure = lit & (np.abs(depth) > EDGE_M)
    assert sure.sum() > 0.9 * lit.sum()
    assert np.array_equal(seen[0, sure] == 1, depth[sure] < 0)
    assert seen[0, lit].mean() == pytest.approx(0.5, abs=0.03)


def test_beyond_the_horizon_in_the_shadows_edge_the_neighbours_mean_counts(backend: Backend) -> None:
    front, half = sphere(0.5, [2, 0, 1], level=4), sphere(0.2, [3.87, 0.97, 1], level=4)
    _, seen = occlusion([front, half], backend).visibility(np.array([0.0]))
    lit = facing(half)
    neighbours: list[list[int]] = [[] for _ in lit]
    for a, b in half.trimesh().edges_unique:
        neighbours[a].append(b)
        neighbours[b].append(a)
    values = []
    for vertex in np.flatnonzero(~lit):
        near = [n for n in neighbours[vertex] if lit[n]]
        values.append(seen[0, near].mean() if near else 0.0)
    assert seen[0, ~lit] == pytest.approx(values, abs=1e-6)
    assert len(np.unique(np.round(values, 3))) > 2


def test_an_open_plate_is_seen_from_its_front_only(backend: Backend) -> None:
    corners = np.array([[3, -0.5, 0.5], [3, 0.5, 0.5], [3, 0.5, 1.5], [3, -0.5, 1.5]])
    front = np.array([[0, 2, 1], [0, 3, 2]])  # counter-clockwise seen from the radar
    seen = []
    for faces in (front, front[:, ::-1]):
        with pytest.warns(T2DWarning, match="not watertight"):
            plate = static_mesh(corners, faces)
        behind = sphere(0.2, [4, 0, 1])
        parts = occlusion([plate, behind], backend).visibility(np.array([0.0]))
        seen.append(parts[0])
        assert not parts[1].any()  # either way it stands in front
    assert (seen[0] == 1).all()
    assert (seen[1] == 0).all()


def test_scene_and_viewpoint_moved_together(backend: Backend) -> None:
    rotation = Rotation.from_euler("zyx", [40, 20, -70], degrees=True)
    shift = np.array([5.0, -3.0, 2.0])
    front, half = sphere(0.5, [2, 0, 1], level=4), sphere(0.2, [3.87, 0.97, 1], level=4)
    moved = [static_mesh(rotation.apply(m.rest) + shift, m.faces) for m in (front, half)]
    here = occlusion([front, half], backend).visibility(np.array([0.0]))
    there = occlusion(moved, backend, at=rotation.apply(HERE) + shift).visibility(np.array([0.0]))
    for one, two in zip(here, there, strict=True):
        assert np.array_equal(one, two)
    # The check of this test: the same meshes from elsewhere are seen otherwise.
    elsewhere = occlusion(moved, backend).visibility(np.array([0.0]))
    assert not np.array_equal(here[1], elsewhere[1])


# --- in time --------------------------------------------------------------------------------------------------------

RATE_HZ = 10.0


@pytest.fixture(scope="module")
def passing() -> list[MovingMesh]:
    """A sphere passes in front of another within a second."""
    return [moving_sphere(0.3, [[2, -0.8, 1], [2, 0.8, 1]], LONG_S), sphere(0.3, [4, 0, 1])]


def test_it_fades_by_a_smooth_step_between_sample_times(passing: list[MovingMesh], backend: Backend) -> None:
    view = occlusion(passing, backend, RATE_HZ)
    samples_s = np.linspace(0, 1, 11)
    fine = 40  # times between two keys
    times_s = np.linspace(0, 1, 10 * fine + 1)
    values = view.visibility(times_s)[1]
    assert values.min() >= 0
    assert values.max() <= 1
    at_samples = view.visibility(samples_s)[1]
    assert np.array_equal(at_samples, view.viewpoints.traced([view], samples_s)[0][:, -values.shape[1] :])
    np.testing.assert_allclose(values[::fine], at_samples, atol=1e-6)
    assert (np.ptp(at_samples, axis=0) == 1).sum() > 100  # it does come and go
    step = np.diff(values, axis=0).reshape(10, fine, -1)
    change = np.diff(at_samples, axis=0)[:, None]
    # Monotone from key to key, and never steeper than a smooth step of that height: 3/2 of its mean slope.
    assert (step * np.sign(change) >= -1e-6).all()
    assert (np.abs(step) <= 1.5 / fine * np.abs(change) + 1e-6).all()
    # Flat at the keys: u^2 (3 - 2 u) starts with 3 u^2.
    np.testing.assert_allclose(step[:, 0], (3 - 2 / fine) / fine**2 * change[:, 0], atol=1e-6)
    middle = values[fine // 2 :: fine]
    np.testing.assert_allclose(middle, (at_samples[:-1] + at_samples[1:]) / 2, atol=1e-6)


def test_samples_are_what_straight_lines_say(passing: list[MovingMesh], backend: Backend) -> None:
    times_s = np.linspace(0, 1, 11)
    hidden = occlusion(passing, backend, RATE_HZ).visibility(times_s)[1] == 0
    lit = facing(passing[1])
    for time_s, dark in zip(times_s, hidden, strict=True):
        centre = passing[0].at(np.array([time_s]))[0].mean(axis=0)
        depth = depth_in_shadow(passing[1].rest, centre, 0.3)
        # A polyhedron's outline lies up to 1.5 % within its sphere's.
        sure = lit & ((depth < -EDGE_M) | (depth > 2 * EDGE_M))
        assert np.array_equal(dark[sure], depth[sure] > 0)


def test_times_may_be_asked_for_in_any_portions(passing: list[MovingMesh], backend: Backend) -> None:
    times_s = np.random.default_rng(0).uniform(0, 1, 50)
    whole = occlusion(passing, backend, RATE_HZ).visibility(times_s)
    other = occlusion(passing, backend, RATE_HZ)
    for size in (1, 7):
        parts = [other.visibility(times_s[start : start + size]) for start in range(0, 50, size)]
        for mesh, values in enumerate(whole):
            assert np.array_equal(np.concatenate([p[mesh] for p in parts]), values)


def test_more_sample_times_than_one_scene_holds(backend: Backend, monkeypatch: pytest.MonkeyPatch) -> None:
    meshes = [moving_sphere(0.3, [[2, -0.8, 1], [2, 0.8, 1]], LONG_S, level=2), sphere(0.3, [4, 0, 1], level=2)]
    times_s = np.linspace(0, 1, 201)
    view = occlusion(meshes, backend, 200.0)
    many = view.visibility(times_s)  # more than 64 instants, four scenes
    assert len(many[0]) > 3 * 64
    monkeypatch.setattr("t2d_rt.propagation.occluders.FACES_PER_SCENE", 1)  # one instant in a scene
    alone = occlusion(meshes, backend, 200.0)
    some = np.arange(0, 201, 8)
    for whole, one in zip(many, alone.visibility(times_s[some]), strict=True):
        np.testing.assert_allclose(whole[some], one, atol=1e-6)
    # Asked for backwards, when the first instants are no longer kept.
    for whole, again in zip(many, view.visibility(times_s[some[::-1]]), strict=True):
        np.testing.assert_allclose(whole[some[::-1]], again, atol=1e-6)


def test_meshes_of_different_length_are_traced_in_their_common_time(backend: Backend) -> None:
    mover = moving_sphere(0.5, [[2, 0, 1], [2, 4, 1]], (0.5, 2.5))
    target = moving_sphere(0.2, [[4, 0, 1], [4, 0, 1]], (0.0, 1.5))
    early, late = occlusion([mover, target], backend).visibility(np.array([0.5, 1.5]))[1]
    assert not early.any()
    assert (late[facing(target)] == 1).all()


# --- a body ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def walker() -> MovingMesh:
    """One stride of the CMU walk across the line of sight, 4 m away."""
    motion = t2d.place(walk(), distance_m=4.0, angle_deg=90)
    return t2d.skin(t2d.trim(motion, 1.0, 2.2))


def blocked(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Whether a triangle lies between points (N, 3) and the viewpoint: every pair, after Moeller and Trumbore 1997."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    result = np.zeros(len(points), bool)
    for i, origin in enumerate(points):
        ray = HERE - origin
        across = np.cross(ray, c - a)
        determinant = np.sum((b - a) * across, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            offset = origin - a
            u = np.sum(offset * across, axis=1) / determinant
            normal = np.cross(offset, b - a)
            v = normal @ ray / determinant
            t = np.sum((c - a) * normal, axis=1) / determinant
            result[i] = np.any((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < 1))
    return result


def test_body_casts_its_shadow_as_straight_lines_say(walker: MovingMesh, backend: Backend) -> None:
    view = occlusion([walker], backend)
    seen = view.viewpoints.traced([view], np.array([0.4]))[0][0]
    mesh = walker.trimesh(0.4)
    offset = HERE - mesh.vertices
    cosine = np.sum(mesh.vertex_normals * offset, axis=1) / np.linalg.norm(offset, axis=1)
    sure = np.flatnonzero(cosine > 0.2)[::4]  # a grazing ray depends on where it starts
    assert len(sure) > 200
    sight = offset[sure] / np.linalg.norm(offset[sure], axis=1)[:, None]
    start = mesh.vertices[sure] + 2e-3 * (mesh.vertex_normals[sure] + sight)
    dark = blocked(start, mesh.vertices, mesh.faces)
    assert dark.mean() > 0.05
    assert np.mean((seen[sure] == 0) == dark) > 0.995


def test_faces_that_face_away_hide_nothing_more(walker: MovingMesh, backend: Backend) -> None:
    """Legs and arms of a walker cut into one another at the joints: that opens no gap, either."""
    posed = Occluders([walker]).at(np.linspace(0, 1.2, 13))
    corners = posed.vertices[:, walker.faces]
    normals = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    towards = np.sum(normals * (HERE - corners.mean(axis=2)), axis=2) > 0
    seen = [
        OccluderScene(posed.meshes, posed.vertices, SIGHT, backend, parts=parts).visible(
            SIGHT, posed.points, posed.normals
        )
        for parts in (None, towards)
    ]
    front = np.sum(posed.normals * (HERE - posed.points), axis=2) > 0
    assert 0.6 < seen[0][front].mean() < 0.99
    assert (seen[0] == seen[1])[front].mean() > 0.9995


@pytest.mark.filterwarnings("ignore:.*is not watertight")
def test_few_places_are_hidden_by_what_faces_them(walker: MovingMesh, backend: Backend) -> None:
    """And nothing of an open mesh is left out: a plate hides from both of its sides."""
    plate = static_mesh(np.array([[2.0, -1, 0], [2, 1, 0], [2, 0, 2]]), np.array([[0, 1, 2]]))
    posed = Occluders([walker, plate]).at(np.linspace(0, 1, 5))
    behind = np.array([9.0, 0.0, 1.0])
    corners = posed.vertices[:, posed.meshes.faces]
    normals = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    for places in ([HERE], [behind], [HERE, behind]):
        expected = np.any([np.sum(normals * (place - corners[:, :, 0]), axis=2) > 0 for place in places], axis=0)
        expected[:, len(walker.faces) :] = True
        assert np.array_equal(posed.facing(places), expected)
    assert 0.4 < posed.facing([HERE]).mean() < 0.6


@pytest.mark.parametrize("level", [1, 2])
def test_normals_of_a_subdivided_mesh_are_those_of_its_parts(walker: MovingMesh, level: int) -> None:
    posed = Occluders([walker, sphere(0.3, [4, 0, 1], level=2)], subdivision=level).at(np.array([0.2, 0.7]))
    for points, normals in zip(posed.points, posed.normals, strict=True):
        corners = points[posed.meshes.subdivided_faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        expected = np.zeros_like(points)
        np.add.at(expected, posed.meshes.subdivided_faces.ravel(), np.repeat(across, 3, axis=0))
        expected /= np.linalg.norm(expected, axis=1)[:, None]
        np.testing.assert_allclose(normals, expected, atol=1e-6)


@pytest.mark.parametrize("level", [1, 2])
def test_points_away_from_shadows_edges_need_no_rays(
    walker: MovingMesh, backend: Backend, level: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    meshes, times_s = Occluders([walker], subdivision=level), np.linspace(0, 1, 5)
    at = meshes.at(times_s)
    front = np.sum(at.normals * (HERE - at.points), axis=2) > 0
    every = OccluderScene(meshes, at.vertices, SIGHT, backend).visible(SIGHT, at.points, at.normals, front)
    rays: list[int] = []
    visible = OccluderScene.visible

    def counted(self: OccluderScene, *given: np.ndarray) -> np.ndarray:
        rays.append(int(given[-1].sum()))
        return visible(self, *given)

    monkeypatch.setattr(OccluderScene, "visible", counted)
    view = Occlusion.alone(meshes, *SIGHT, samples_s=np.array([0.0, 1.0]), backend=backend, wavelength_m=None)
    found = view.visible(at, front, the_scene(view, at))
    assert not found[~front].any()
    assert sum(rays) < 0.5 * front.sum()
    assert 0.05 < (front & ~every).sum() / front.sum() < 0.5
    assert (found != every).sum() < 0.0008 * front.sum()


def test_of_other_meshes_every_point_is_traced(walker: MovingMesh, backend: Backend) -> None:
    """A shadow may lie between the vertices of large faces, and that of a pole between those of small ones."""
    vertices, faces = icosphere(4, 0.5)
    pole = static_mesh(*_box((2.0, 0.0, 1.0), (0.01, 0.01, 3.0)))
    smooth = moving((vertices + [4.0, 0, 1], faces), np.zeros((2, 3)), np.array(LONG_S), curved=True)
    for others in ([pole], [smooth], [pole, smooth]):
        meshes = Occluders([walker, *others], subdivision=2)
        assert not meshes.of_bodies
        at = meshes.at(np.array([0.5]))
        front = np.sum(at.normals * (HERE - at.points), axis=2) > 0
        expected = OccluderScene(meshes, at.vertices, SIGHT, backend).visible(SIGHT, at.points, at.normals, front)
        view = Occlusion.alone(meshes, *SIGHT, samples_s=np.array([0.0, 1.0]), backend=backend, wavelength_m=None)
        assert np.mean(view.visible(at, front, the_scene(view, at)) != expected) < 1e-4
    assert Occluders([walker, walker]).of_bodies


def test_faces_that_look_inward_hide_what_is_behind_them(backend: Backend) -> None:
    """A cabin inside out within a mesh whose volume is positive, and one that its own motion turns inside out."""
    far, (corners, sides) = icosphere(2, 1.6), _box((4.0, 0.0, 1.0), (2.0, 2.0, 2.0))
    vertices = np.concatenate([far[0] + [0, 50, 0], corners])
    inward, outward = (np.concatenate([far[1], len(far[0]) + each]) for each in (sides[:, ::-1], sides))
    mirrored = MovingMesh(np.stack([corners, [8.0, 0, 2] - corners]), sides, LONG_S, "pec")
    ball = sphere(0.3, [4, 0, 1])
    cabins = static_mesh(vertices, inward), static_mesh(vertices, outward), mirrored
    for cabin in cabins:
        meshes = Occluders([ball, cabin])
        for time_s in (0.0, 1.0):
            at = meshes.at(np.array([time_s]))
            front = np.sum(at.normals * (HERE - at.points), axis=2) > 0
            view = Occlusion.alone(meshes, *SIGHT, samples_s=np.array(LONG_S), backend=backend, wavelength_m=None)
            seen = view.visible(at, front, the_scene(view, at))
            assert not seen[:, : len(ball.rest)].any()
    assert Occluders(cabins).at(np.array([0.0])).facing([HERE]).mean() < 0.7  # outward ones face this way or not
    parts = Occluders(cabins).parts.sum(axis=1)
    assert sorted(parts.tolist()) == [12, 12, 12, 320, 320]


def _box(centre_m: Sequence[float], sides_m: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    import trimesh

    box = trimesh.creation.box(sides_m)
    return box.vertices + centre_m, box.faces


@pytest.mark.parametrize("count", [1, 4, 5])
def test_a_scene_serves_its_viewpoints_however_many(
    walker: MovingMesh, backend: Backend, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    meshes, samples_s = Occluders([walker]), np.array([0.0, 1.0])
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    places = [np.array([2.0 + 4 * np.cos(a), 4 * np.sin(a), 1.0]) for a in angles]
    viewpoints = Viewpoints(meshes, samples_s, backend, wavelength_m=None)
    views = [Occlusion(viewpoints, place) for place in viewpoints_at(places)]
    at = meshes.at(np.linspace(0, 1, 3))
    facing: list[list[np.ndarray]] = []
    faces_facing = PosedOccluders.facing
    monkeypatch.setattr(PosedOccluders, "facing", lambda self, some: facing.append(some) or faces_facing(self, some))
    scene = the_scene(views[0], at)
    assert [len(some) for some in facing] == [count][: count <= 4]  # more viewpoints see about all faces
    for place, view in zip(places, views, strict=True):
        front = np.sum(at.normals * (place - at.points), axis=2) > 0
        every = OccluderScene(meshes, at.vertices, viewpoints_at([place]), backend).visible(
            viewpoints_at([place]), at.points, at.normals, front
        )
        assert np.mean(view.visible(at, front, scene) != every) < 2e-4


@pytest.mark.parametrize("together", slow_after(1, [1, 3]))
def test_viewpoints_share_a_scene(
    walker: MovingMesh, backend: Backend, together: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Occluders, "copies", 4)  # several chunks in a block of frames
    meshes, samples = Occluders([walker]), sample_times(0, 1.2, 25.0)
    places = [HERE, np.array([9.0, -40.0, 2.0]), np.array([-3.0, 6.0, -5.0])]
    viewpoints = Viewpoints(meshes, samples, backend, wavelength_m=None)
    some = [Occlusion(viewpoints, place) for place in viewpoints_at(places[:together])]
    made: list[int] = []
    scene = OccluderScene.__init__

    def counted(self: OccluderScene, *given: object, **options: object) -> None:
        made.append(1)
        scene(self, *given, **options)  # type: ignore[arg-type]

    blocks = np.linspace(0, 1.2, 60).reshape(3, 20)
    with monkeypatch.context() as patch:
        patch.setattr(OccluderScene, "__init__", counted)
        # As a run asks: block by block, and in each from one place after another.
        found = [[each.visibility(times)[0] for each in some] for times in blocks]
    assert len(made) == -(-len(samples) // 4)  # one scene for each chunk of samples, whatever the number of places
    for place, values in zip(places, zip(*found, strict=True), strict=False):
        alone = Occlusion.alone(
            Occluders([walker]), *viewpoints_at([place]), samples_s=samples, backend=backend, wavelength_m=None
        )
        expected = np.concatenate([alone.visibility(times)[0] for times in blocks])
        # The scene lies elsewhere in float32; a ray that grazes may change sides.
        assert np.mean(np.abs(np.concatenate(values) - expected) > 0.01) < 1e-3


@pytest.mark.slow
def test_viewpoints_asked_one_after_another_over_the_whole_record(
    walker: MovingMesh, backend: Backend, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As echoes in several parts ask: what one part needs is not kept for another over the record, nor traced for none."""
    monkeypatch.setattr(Occluders, "copies", 2)
    meshes, samples = Occluders([walker]), sample_times(0, 1.2, 25.0)
    places = [HERE, np.array([9.0, -40.0, 2.0]), np.array([-3.0, 6.0, -5.0])]
    viewpoints = Viewpoints(meshes, samples, backend, wavelength_m=None)
    some = [Occlusion(viewpoints, place) for place in viewpoints_at(places)]
    traced: list[int] = []
    sampled = Occlusion.sampled

    def counted(self: Occlusion, chunk: _Chunk) -> object:
        traced.append(len(chunk.at.times_s))
        return sampled(self, chunk)

    monkeypatch.setattr(Occlusion, "sampled", counted)
    blocks, held, found = np.linspace(0, 1.2, 60).reshape(20, 3), [], []
    for each in some:
        values = []
        for times in blocks:
            values.append(each.visibility(times)[0])
            held.append(sum(len(one.chunks) for one in some))
        found.append(np.concatenate(values))
    assert max(held) <= 3 * 2  # of the first block all viewpoints, then those that are in use
    assert sum(traced) <= 1.3 * len(some) * len(samples)
    for place, values in zip(places, found, strict=True):
        alone = Occlusion.alone(
            Occluders([walker]), *viewpoints_at([place]), samples_s=samples, backend=backend, wavelength_m=None
        )
        expected = np.concatenate([alone.visibility(times)[0] for times in blocks])
        assert np.mean(np.abs(values - expected) > 0.01) < 1e-3


def test_paths_that_run_alike_are_traced_once(backend: Backend, monkeypatch: pytest.MonkeyPatch) -> None:
    """As those over a wall and over the window in it; what the scene leaves unblocked is of each alone."""
    samples_s, (path,), (other,) = np.array(LONG_S), SIGHT, viewpoints_at([HERE + 1])
    meshes = Occluders([sphere(0.2, (2, 0, 1)), sphere(0.1, (3, 0.2, 1))])
    viewpoints = Viewpoints(meshes, samples_s, backend, wavelength_m=0.004)
    traced: list[Occlusion] = []
    visible = Occlusion.visible

    def counted(self: Occlusion, *where: Any) -> np.ndarray:
        traced.append(self)
        return visible(self, *where)

    monkeypatch.setattr(Occlusion, "visible", counted)
    window = replace(path, chain=("window",))
    wall, dimmed, aside = (
        Occlusion(viewpoints, each, unblocked=lambda points, _, fraction=fraction: np.full(points.shape[:2], fraction))
        for each, fraction in ((path, 1.0), (window, 0.5), (other, 1.0))
    )
    first, second, third = (np.concatenate(each.visibility(samples_s), axis=1) for each in (wall, dimmed, aside))
    assert traced == [wall, aside]
    np.testing.assert_allclose(second, 0.5 * first, rtol=1e-6)
    assert np.mean(first != third) > 0.1


def test_paths_over_the_same_planes_in_another_order_run_otherwise() -> None:
    walls = [
        plate("left", [(-2, 2, -1), (12, 2, -1), (12, 2, 4), (-2, 2, 4)]),
        plate("front", [(6, -5, -1), (6, 5, -1), (6, 5, 4), (6, -5, 4)]),
    ]
    mirrors = Mirrors.of(Scene(name="corner", surfaces=tuple(walls)), select("cpu"))
    probes_m = np.array([[x, y, 1.0] for x in (1.0, 3.0, 5.0) for y in (-4.0, 0.0, 1.5)])
    paths = find_paths(mirrors, HERE, np.array([0.0, 0.0, 1.0]), 77e9, order=2, probes_m=probes_m).paths
    by_chain = {path.chain: path.course for path in paths}
    assert {("left", "front"), ("front", "left"), ("left",), ("front",), ()} <= by_chain.keys()
    assert len(set(by_chain.values())) == len(by_chain)
    (path,) = (path for path in paths if path.chain == ("left",))
    through = replace(path.elements, through=np.array([True]))
    elsewhere = replace(path, antenna_m=path.antenna_m + [0, 0, 1e-9])
    assert len({path.course, replace(path, elements=through).course, elsewhere.course}) == 3


def test_many_viewpoints_are_traced_at_fewer_instants_at_once(walker: MovingMesh, backend: Backend) -> None:
    samples = sample_times(0, 1.2, 25.0)
    meshes = Occluders([walker], subdivision=1)
    few, many = (Viewpoints(meshes, samples, backend, wavelength_m=None) for _ in range(2))
    held = [
        Occlusion(few, *SIGHT),
        *(Occlusion(many, each) for each in viewpoints_at([HERE + [0, 0, k] for k in range(400)])),
    ]
    assert len(held) == 401  # what nothing holds is not traced for
    assert few.at_once == meshes.copies
    assert 1 <= many.at_once <= max(1, VISIBILITY_BYTES / (SAMPLE_BYTES * 400 * meshes.point_count)) < meshes.copies


@pytest.mark.filterwarnings("ignore:.*is not watertight")
def test_a_viewpoint_that_nothing_faces(backend: Backend) -> None:
    corners = np.array([[3.0, 0, 1], [3, 1, 1], [3, 0, 2]])
    for face, visible in (([0, 1, 2], 0), ([0, 2, 1], 1)):  # its normal is along +x, away from here, and the other way
        plate = static_mesh(corners, np.array([face]))
        (seen,) = occlusion([plate], backend).visibility(np.array([0.0, 0.5]))
        assert np.all(seen == visible)


def test_the_far_thigh_and_arm_go_behind_the_body(walker: MovingMesh, backend: Backend) -> None:
    times_s = np.linspace(0, 1.2, 25)
    (seen,) = occlusion([walker], backend, 20.0).visibility(times_s)
    lit = np.array([facing(walker, time) for time in times_s])

    def fractions(joint: str) -> np.ndarray:
        """Visible fraction of a limb's lit side over time, (time,)."""
        limb = template("adult").weights[:, CANONICAL_JOINTS.index(joint)] > 0.9
        return np.array([s[limb][f[limb]].mean() for s, f in zip(seen, lit, strict=True)])

    # It walks at 90 degrees with its right side towards the radar.
    assert fractions("left_knee").min() < 0.2
    assert fractions("left_knee").max() == 1
    assert fractions("left_elbow").min() == 0
    assert fractions("left_elbow").max() > 0.9
    assert fractions("right_knee").min() > 0.9
    assert fractions("right_elbow").min() > 0.9


@pytest.mark.filterwarnings("ignore:.*is not watertight")
def test_subdivision_places_a_shadows_edge_more_closely(backend: Backend) -> None:
    # A strip, half as far away as a floor of 10 cm squares, shades twice its own width of that.
    side = np.linspace(-0.5, 0.5, 11)
    places = np.stack([np.full((11, 11), 4.0), *np.meshgrid(side, side + 1.0, indexing="ij")], axis=-1).reshape(-1, 3)
    corner = (np.arange(10)[:, None] * 11 + np.arange(10)).ravel()
    faces = np.concatenate([corner[:, None] + np.array(three) for three in ((0, 1, 12), (0, 12, 11))])
    floor = static_mesh(places, faces, name="floor")
    low, high = -0.087, 0.061
    strip = np.array([(2.0, low, 0.0), (2.0, high, 0.0), (2.0, high, 2.0), (2.0, low, 2.0)])
    shade = static_mesh(strip, [[0, 2, 1], [0, 3, 2]], name="strip")
    samples_s = sample_times(*LONG_S, 2.0)
    across = np.linspace(-0.4, 0.4, 2001)
    lit = (across < 2 * low) | (across > 2 * high)
    errors = []
    for subdivision in range(3):
        occluded = Occlusion.alone(
            Occluders([floor, shade], subdivision=subdivision), *SIGHT, samples_s=samples_s, backend=backend,
            wavelength_m=None,
        )  # fmt: skip
        seen = occluded.visibility(np.array([0.5]))[0][0]
        stands = SubdividedMesh.of(faces, len(places), subdivision).operator @ places
        row = np.abs(stands[:, 2] - 1.0) < 1e-6
        order = np.argsort(stands[row, 1])
        errors.append(np.mean(np.abs(np.interp(across, stands[row, 1][order], seen[row][order]) - lit)))
    # Each of two edges becomes a ramp as wide as a square, whose error is a quarter to a half of its width.
    for subdivision, error in enumerate(errors):
        assert 0.9 < error / (0.1 / 2**subdivision / 2 / 0.8) < 2.1
