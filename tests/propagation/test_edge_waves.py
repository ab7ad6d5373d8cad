"""The field beside the outlines of other meshes: Fresnel's integrals, quadrature of the disc, plain NumPy over a mirror."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import fresnel
from trimesh.creation import box, cylinder

import t2d_rt as t2d
from builders import icosphere, plate, static_mesh
from t2d_rt.core.backend import Backend, select
from t2d_rt.geometry.vectors import inner, norms, unit, vector_product
from t2d_rt.propagation.edge_waves import (
    AT_EDGE_V,
    FULL_V,
    NARROW_ZONE_M,
    NO_WAVE_V,
    SHORTEST_PIECE_M,
    TILT_RAD,
    Straight,
    _amplitudes,
    _Beam,
    _near,
    smooth_step,
    straight_parts,
)  # fmt: skip
from t2d_rt.propagation.images import vertices
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.propagation.occluders import Occluders
from t2d_rt.propagation.paths import find_paths
from t2d_rt.propagation.visibility import ExactVisibility, Occlusion, viewpoints_at
from t2d_rt.types import MovingMesh, OneWayPath, Radar, Scene

HERE, UP = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0])
WAVELENGTH_M = 299_792_458 / 77e9
(SIGHT,) = viewpoints_at([HERE])
POINT_M, HALF_M = 3.0, 1.5
"""Range of a small target, and of what stands before it."""
PER_M = np.sqrt(2 * POINT_M / (WAVELENGTH_M * HALF_M * (POINT_M - HALF_M)))
"""Fresnel's parameter over the clearance half-way."""
VERTICES, FACES = icosphere(4)


def knife_edge(v: np.ndarray | float) -> np.ndarray:
    """Field behind a half-plane that covers the ray by `v`, over that without."""
    sine, cosine = fresnel(v)
    return np.asarray((1 + 1j) / 2 * ((0.5 - cosine) - 1j * (0.5 - sine)))


def behind_disc(radius_m: float, aside_m: float) -> complex:
    """Field half-way behind a disc, over that without: Fresnel and Kirchhoff's integral over it, by quadrature."""
    steps = 500
    y, z = np.meshgrid(*2 * [((np.arange(steps) + 0.5) / steps * 2 - 1) * radius_m])
    zone = WAVELENGTH_M * HALF_M * (POINT_M - HALF_M) / POINT_M
    inside = np.exp(1j * np.pi * ((y - aside_m) ** 2 + z**2) / zone)[y**2 + z**2 < radius_m**2]
    return complex(1 + 1j / zone * inside.sum() * (2 * radius_m / steps) ** 2)


def screen(edge_m: float, half_m: float = HALF_M, until_s: float = 1.0) -> MovingMesh:
    """A target's screen that covers y up to there."""
    mesh = box(extents=[0.01, 2.0, 2.0]).subdivide()
    return static_mesh(mesh.vertices + [half_m, edge_m - 1, 1], mesh.faces, until_s)


def small(aside_m: float = 0.0) -> MovingMesh:
    return static_mesh(0.005 * VERTICES + [POINT_M + 0.005, aside_m, 1], FACES)


def one_way(
    others: list[MovingMesh], backend: Backend, target: MovingMesh | None = None, path: OneWayPath = SIGHT
) -> tuple[np.ndarray, np.ndarray]:
    """Where the vertex of a small target is that is nearest to the antenna, and the field there from both kinds of tracing."""
    target = small() if target is None else target
    nearest = np.argmin(np.linalg.norm(target.rest - path.image_m, axis=1))
    meshes = [*others, target]
    options = {"backend": backend, "wavelength_m": WAVELENGTH_M}
    view = Occlusion.alone(Occluders(meshes), path, samples_s=np.array([0.0, 1.0]), **options)
    exact = ExactVisibility(meshes, path, own=len(others), **options)
    at_facets = exact.fraction(np.zeros(1), target.rest[None], target.faces)[0]
    found = view.visibility(np.zeros(1))[-1][0]
    assert np.allclose(found[at_facets < 1][:1], at_facets[at_facets < 1][:1], atol=1e-6)
    return target.rest[nearest], np.array([found[nearest], at_facets[nearest]])


def decibel(ratio: np.ndarray | complex) -> np.ndarray:
    return np.asarray(20 * np.log10(np.abs(ratio)))


@pytest.mark.parametrize("covered_m", [-0.1, -0.05, -0.03, -0.01, 0.0, 0.01, 0.03, 0.06])
def test_a_screen_is_a_knife_edge_on_its_lit_and_its_dark_side(covered_m: float, backend: Backend) -> None:
    _, found = one_way([screen(covered_m)], backend)
    np.testing.assert_allclose(decibel(found), decibel(knife_edge(covered_m * PER_M)), atol=0.35)


@pytest.mark.parametrize("v", [-1.2, -0.4, 0.0, 0.4])
def test_a_screen_far_away_is_the_same_knife_edge(v: float, backend: Backend) -> None:
    """The zone between screen and target is as wide at 20 km as at 20 m, and the way there does not count."""
    far_m, behind_m = 20e3, 1.5
    covered_m = v / np.sqrt(2 * far_m / (WAVELENGTH_M * (far_m - behind_m) * behind_m))
    target = static_mesh(0.005 * VERTICES + [far_m + 0.005, 0, 1], FACES)
    _, found = one_way([screen(covered_m, half_m=far_m - behind_m)], backend, target)
    np.testing.assert_allclose(decibel(found), decibel(knife_edge(v)), atol=0.3)


@pytest.mark.parametrize("aside_m", [0.0, 0.02, 0.06, 0.1])
@pytest.mark.parametrize("radius_m", [0.015, 0.03, 0.05])
def test_a_ball_smaller_than_the_zone_is_a_disc_with_light_in_its_middle(
    radius_m: float, aside_m: float, backend: Backend
) -> None:
    """The zone's radius is 54 mm. In the middle of the shadow the field is that without the ball."""
    ball = static_mesh(radius_m * VERTICES + [HALF_M, 0, 1], FACES)
    _, found = one_way([ball], backend, small(2 * aside_m))
    np.testing.assert_allclose(decibel(found), decibel(behind_disc(radius_m, aside_m)), atol=0.6)


def test_the_waves_of_both_sides_of_a_rod_interfere(backend: Backend) -> None:
    rod = cylinder(0.03, 1.2, sections=64)
    for aside_m in (0.0, 0.02, 0.05):
        _, found = one_way([static_mesh(rod.vertices + [HALF_M, 0, 1], rod.faces)], backend, small(2 * aside_m))
        expected = sum(knife_edge((0.03 + side * aside_m) * PER_M) for side in (1, -1))
        np.testing.assert_allclose(decibel(found), decibel(expected), atol=0.5)


def test_two_screens_count_both_and_what_only_one_mesh_has_counts_once(backend: Backend) -> None:
    left = screen(-0.02)
    right = static_mesh(left.rest * [1, -1, 1], left.faces[:, ::-1])
    _, found = one_way([left, right], backend)
    np.testing.assert_allclose(decibel(found), 2 * decibel(knife_edge(-0.02 * PER_M)), atol=0.5)
    # A plate across a ball is no outline inside of the ball's, where a mesh is both.
    ball = static_mesh(0.2 * VERTICES + [HALF_M, -0.2, 1], FACES)
    across = box(extents=[0.3, 0.1, 0.1])
    across.apply_translation([HALF_M, -0.1, 1])
    both = static_mesh(
        np.concatenate([ball.rest, across.vertices]), np.concatenate([ball.faces, across.faces + len(ball.rest)])
    )
    target = small(2 * -0.1)
    assert one_way([ball], backend, target)[1].max() < 0.2
    np.testing.assert_allclose(one_way([both], backend, target)[1], one_way([ball], backend, target)[1], atol=1e-6)


@pytest.mark.parametrize("part", [0, 1])
@pytest.mark.parametrize("clear_m", [-0.01, 0.0, 0.01])
def test_a_ghost_past_a_rim_is_what_the_unfolded_path_passes(clear_m: float, part: int, backend: Backend) -> None:
    """A screen beside either straight part of the path over a wall, its edge upright within a centimetre of the path."""
    wall = plate("wall", [(-2, 2, -1), (12, 2, -1), (12, 2, 4), (-2, 2, 4)])
    mirrors = Mirrors.of(Scene(name="wall", surfaces=(wall,)), select("cpu"))
    target = static_mesh(0.005 * VERTICES + [4.0, 0.3, 1.0], FACES)
    found = find_paths(mirrors, HERE, UP, 77e9, order=1, probes_m=np.array([[4.0, 0.3, 1.0]]))
    (path,) = [each for each in found.paths if each.chain == ("wall",)]
    nearest, _ = one_way([], backend, target, path)
    lines = vertices(path, nearest)
    ahead = lines[part + 1] - lines[part]
    middle, ahead = lines[part] + 0.5 * ahead, ahead / np.linalg.norm(ahead)
    aside = np.cross(UP, ahead)
    frame = np.stack([ahead, aside, UP])
    mesh = box(extents=[0.002, 0.6, 0.6]).subdivide()
    upright = static_mesh((mesh.vertices - [0, 0.3 + clear_m, 0]) @ frame + middle, mesh.faces)
    _, found_there = one_way([upright], backend, target, path)
    before, after = (np.sum(np.linalg.norm(np.diff([*stops], axis=0), axis=1)) for stops in (
        [*lines[: part + 1], middle], [middle, *lines[part + 1 :]])
    )  # fmt: skip
    v = -clear_m * np.sqrt(2 * (before + after) / (WAVELENGTH_M * before * after))
    np.testing.assert_allclose(decibel(found_there), decibel(knife_edge(v)), atol=0.3)


@pytest.mark.filterwarnings("ignore:.*not watertight", "ignore:triangles of mesh are not all oriented alike")
@pytest.mark.parametrize(
    "kind", ["long edges", "a soup of triangles", "a double sheet", "doubled faces", "faces without area"]
)
def test_meshes_of_all_kinds_have_one_outline(kind: str, backend: Backend) -> None:
    covered_m = 0.01
    if kind == "long edges":
        mesh = box(extents=[0.01, 2.0, 2.0])
        others = static_mesh(mesh.vertices + [HALF_M, covered_m - 1, 1], mesh.faces)
    elif kind == "a soup of triangles":
        whole = screen(covered_m)
        others = static_mesh(whole.rest[whole.faces].reshape(-1, 3), np.arange(3 * len(whole.faces)).reshape(-1, 3))
    elif kind == "doubled faces":
        whole = screen(covered_m)
        others = static_mesh(
            whole.rest, np.concatenate([whole.faces, whole.faces[:, [1, 2, 0]], whole.faces[:1, [0, 0, 1]]])
        )
    elif kind == "faces without area":  # halves of faces, and a sliver between them and the face that is not cut
        whole = screen(covered_m)
        upward = whole.faces[:, 0] < whole.faces[:, 1]
        first, second, third = whole.faces[upward].T
        middle = len(whole.rest) + np.arange(len(first))
        parts = ((first, middle, third), (middle, second, third), (first, second, middle))
        others = static_mesh(
            np.concatenate([whole.rest, (whole.rest[first] + whole.rest[second]) / 2]),
            np.concatenate([whole.faces[~upward], *(np.stack(part, axis=1) for part in parts)]),
        )
    else:
        corners = np.array([[HALF_M, y, z] for y in (covered_m - 2, covered_m) for z in (0.0, 2.0)])
        front = np.array([[0, 1, 2], [1, 3, 2]])
        others = static_mesh(np.concatenate([corners, corners]), np.concatenate([front, front[:, ::-1] + 4]))
    _, found = one_way([others], backend)
    np.testing.assert_allclose(decibel(found), decibel(knife_edge(covered_m * PER_M)), atol=0.3)


@pytest.mark.filterwarnings("ignore:.*not watertight")
def test_a_target_of_which_nothing_faces_the_antenna_has_no_field(backend: Backend) -> None:
    sheet = static_mesh(np.array([[3.0, -0.1, 0.9], [3, 0.1, 0.9], [3, 0, 1.1]]), np.array([[0, 1, 2]]))
    meshes = Occluders([screen(0.0), sheet])
    view = Occlusion.alone(meshes, SIGHT, samples_s=np.zeros(2) + [0, 1], backend=backend, wavelength_m=WAVELENGTH_M)
    turned = static_mesh(sheet.rest, sheet.faces[:, ::-1])
    other = Occlusion.alone(
        Occluders([screen(0.0), turned]), SIGHT, samples_s=np.array([0.0, 1.0]), backend=backend,
        wavelength_m=WAVELENGTH_M,
    )  # fmt: skip
    dark, lit = (each.visibility(np.zeros(1))[1] for each in (view, other))
    assert sorted([bool(dark.any()), bool(lit.any())]) == [False, True]


def test_nothing_changes_without_an_outline_near_the_path(backend: Backend) -> None:
    ball, far = (static_mesh(0.2 * VERTICES + [3, y, 1], FACES) for y in (0.0, 1.5))
    behind = static_mesh(0.05 * VERTICES + [3.4, 0, 1], FACES)  # deep in the ball's shadow
    samples_s = np.array([0.0, 1.0])
    held = static_mesh(0.03 * VERTICES + [3.07, 0.2, 1], FACES)  # at the ball's outline, where waves ripple finely
    for meshes, same in (([ball], 1), ([ball, far], 2), ([ball, screen(0.0, half_m=6.0)], 1), ([ball, held], 2)):
        hard, soft = (
            Occlusion.alone(Occluders(meshes), SIGHT, samples_s=samples_s, backend=backend, wavelength_m=each)
            for each in (None, WAVELENGTH_M)
        )
        for one, two in list(zip(hard.visibility(samples_s), soft.visibility(samples_s), strict=True))[:same]:
            assert np.array_equal(one, two)
    options = {"samples_s": samples_s, "backend": backend, "wavelength_m": WAVELENGTH_M}
    assert not Occlusion.alone(Occluders([ball, behind]), SIGHT, **options).visibility(samples_s)[1].any()


def corners_of(least_m: np.ndarray, most_m: np.ndarray) -> np.ndarray:
    """Corners of a box (8, 3)."""
    return np.array([np.where(corner, most_m, least_m) for corner in np.ndindex(2, 2, 2)])


@pytest.mark.parametrize("seed", range(100))
def test_boxes_told_apart_hold_no_points_near_one_another(seed: int) -> None:
    """Against all pairs of points, in boxes of all sizes, flat ones and lines too: with the antenna far, inside, at faces, edges
    and corners, and with one box inside of the other."""
    rng = np.random.default_rng(seed)
    antenna_m = rng.normal(size=3) * 10 ** rng.uniform(-2, 3)

    def some_box() -> np.ndarray:
        size_m = 10 ** rng.uniform(-3, 1, 3) * (rng.random(3) < 0.8)
        size_m[rng.integers(3)] += 0.001
        aside_m = (rng.normal(size=3) * 10 ** rng.uniform(-2, 1), rng.choice([-0.5, 0.0, 0.5], 3) * size_m)
        middle_m = antenna_m + aside_m[rng.integers(2)]
        return corners_of(middle_m - size_m / 2, middle_m + size_m / 2)

    mine, others = some_box(), some_box()
    if rng.random() < 0.2:
        ends_m = others[0] + rng.random((2, 3)) * (others[-1] - others[0])
        mine = corners_of(ends_m.min(axis=0), ends_m.max(axis=0))
    part = Straight(antenna_m, np.eye(3), np.zeros(3), None, None)
    (near,) = _near(part, mine[None], others[None], WAVELENGTH_M)
    points, hindering = (np.concatenate([box, box[0] + rng.random((150, 3)) * (box[-1] - box[0])]) - antenna_m
        for box in (mine, others))  # fmt: skip
    points, hindering = points[norms(points) > 1e-6], hindering[norms(hindering) > SHORTEST_PIECE_M]
    apart_rad = norms(unit(points)[:, None] - unit(hindering))
    between = np.maximum(1 / norms(hindering) - 1 / norms(points)[:, None], 0)
    assert near or not (apart_rad < NO_WAVE_V * np.sqrt(WAVELENGTH_M / 2 * between)).any()


def test_boxes_beside_one_another_are_told_apart() -> None:
    part = straight_parts(SIGHT)[0]
    ball, beside, behind, beyond = (
        corners_of(HERE + middle - 0.1, HERE + middle + 0.1)
        for middle in np.array([[3, 0, 0], [1.5, 1, 0], [-1.5, 0, 0], [6, 0, 0]])
    )
    assert _near(part, np.stack(3 * [ball]), np.stack([beside, behind, beyond]), WAVELENGTH_M).tolist() == 3 * [False]
    assert _near(part, beyond[None], ball[None], WAVELENGTH_M).all()
    around_the_antenna = corners_of(HERE - 0.1, HERE + 0.1)[None]
    assert not _near(part, around_the_antenna, ball[None], WAVELENGTH_M).any()
    assert _near(part, ball[None], around_the_antenna, WAVELENGTH_M).all()


def test_a_wide_plate_reaches_farther_between_its_corners_than_these() -> None:
    """Its directions lie 0.2 beyond those of the corners, where the plate hides the target over the middle of an edge."""
    plate_m = corners_of(HERE + [3.0, -10, -10], HERE + [3.01, 10, 10])
    aside = HERE + 30 * np.array([np.cos(np.radians(71)), np.sin(np.radians(71)), 0])
    assert _near(
        straight_parts(SIGHT)[0], corners_of(aside - 0.1, aside + 0.1)[None], plate_m[None], WAVELENGTH_M
    ).all()


def test_edges_inside_of_a_mesh_alone_leave_points_behind_it_dark(backend: Backend) -> None:
    inside = box(extents=3 * [0.05])
    faces = np.concatenate([FACES, inside.faces + len(VERTICES)])
    ball = static_mesh(np.concatenate([0.5 * VERTICES, inside.vertices]) + [HALF_M, 0, 1], faces)
    _, found = one_way([ball], backend)
    assert not found.any()


def amplitude(part: Straight, ends_m: np.ndarray, apparent_m: np.ndarray, hidden: np.ndarray) -> np.ndarray:
    """Amplitude of the field at apparent points (N, 3), hidden or not (N,), beside an outline of pieces (2, M, 3): every point by
    every piece, in double precision."""
    (a, b), ahead = ends_m - part.origin_m, apparent_m - part.origin_m
    distance, length = norms((a + b) / 2), norms(ahead)
    ahead, a, b = unit(ahead / length[:, None] + TILT_RAD), unit(a), unit(b)
    w, s, (first, last) = (a + b) / 2 - ahead[:, None], b - a, part.between(apparent_m) * length
    counts = (distance > first[:, None]) & (distance < np.minimum(last, length)[:, None])
    across = -inner(ahead[:, None], vector_product(w, s))
    angle = np.arctan2(across, inner(w, w) - inner(s, s) / 4)
    length = length[:, None]
    left, scaled = length - distance, length * distance
    w_squared = across / angle
    v = np.sqrt(4 / WAVELENGTH_M * scaled * w_squared / (np.sqrt(left**2 + scaled * w_squared) + left))
    zone_m = np.sqrt(WAVELENGTH_M * np.maximum(left, 0) * length / distance)
    fade = smooth_step(np.clip((NO_WAVE_V - v) / (NO_WAVE_V - FULL_V), 0, 1))
    fade *= counts * smooth_step(np.clip(zone_m / NARROW_ZONE_M - 1, 0, 1))
    slope = inner(w, s) * scaled / (WAVELENGTH_M * np.maximum(left, SHORTEST_PIECE_M))
    wave = angle * fade * np.sinc(slope) * np.exp(1j * np.pi / 2 * v**2) / (2 * np.pi)
    dark = np.where((counts & (v < AT_EDGE_V)).any(axis=1), (counts * angle * (v < 1)).sum(axis=1) > 0, hidden)
    return np.asarray(np.abs(1 - dark + wave.sum(axis=1)))


def around(half_rad: float, distance_m: float, pieces: int = 999) -> np.ndarray:
    """Pieces (2, M, 3) of a wavy outline seen so far off the x axis from its own origin."""
    turn = np.linspace(0, 2 * np.pi, pieces + 1)
    off, distance_m = half_rad * (1 + 0.1 * np.sin(7 * turn)), distance_m * (1 + 0.1 * np.sin(3 * turn))
    places = distance_m * [np.cos(off), np.sin(off) * np.cos(turn), np.sin(off) * np.sin(turn)]
    return np.stack([places.T[:-1], places.T[1:]])


def summed(
    part: Straight, outlines: list[np.ndarray], points: np.ndarray, hidden: np.ndarray, backend: Backend
) -> np.ndarray:
    """What the kernel makes of outlines (2, M, 3) and points (K, N, 3) at as many instants, hidden or not (K, N)."""
    instant = np.arange(len(outlines)).repeat(points.shape[1])
    when = np.repeat(np.arange(len(outlines)), [outline.shape[1] for outline in outlines])
    beam = _Beam(part, 0, points.reshape(-1, 3), when, np.concatenate(outlines, axis=1))
    facing = beam.facing(instant, np.ones(len(instant), bool), np.ones(len(when), bool), WAVELENGTH_M)
    return _amplitudes([facing], hidden.ravel(), WAVELENGTH_M, backend).reshape(hidden.shape)


def test_the_kernel_agrees_with_the_sum_in_double_precision(backend: Backend) -> None:
    """At points up to 0.9 rad off the mean direction, behind joints of pieces and beside them; a plane cuts off some pieces."""
    rng = np.random.default_rng(7)
    plane = unit(np.array([1.0, 0.5, 0.0])), 1.0
    part = Straight(HERE, np.eye(3), np.zeros(3), plane, None)
    outlines = [HERE + around(*shape) for shape in ((0.1, 1.5), (0.5, 1.3), (0.8, 1.6))]
    points = []
    for ends_m in outlines:
        towards = unit(ends_m[0, ::3].repeat(3, axis=0) - HERE)
        towards = unit(towards + rng.normal(0, 0.03, towards.shape) * (np.arange(len(towards)) % 3 > 0)[:, None])
        points.append(HERE + rng.uniform(2.4, 4, (len(towards), 1)) * towards)
    points_m = np.stack(points)
    hidden = rng.random(points_m.shape[:2]) < 0.5
    expected = np.stack([amplitude(part, *row) for row in zip(outlines, points_m, hidden, strict=True)])
    found = summed(part, outlines, points_m, hidden, backend)
    assert np.mean(np.abs(expected - 1 + hidden) > 0.01) > 0.5
    beside = np.arange(found.shape[1]) % 3 > 0
    np.testing.assert_allclose(found[:, beside], expected[:, beside], atol=1e-5)
    # Where joints hide points, rounding moves the bound between two pieces, and what both turn about a ray stays.
    np.testing.assert_allclose(found[:, ~beside], expected[:, ~beside], atol=5e-3)


def test_instants_together_are_as_each_alone(backend: Backend) -> None:
    """A ball that goes behind a screen's edge, and a rod that stands before both."""
    times_s = np.linspace(0.0, 1.0, 5)
    aside_m = np.linspace(-0.05, 0.05, 5)[:, None, None] * [0.0, 1.0, 0.0]
    ball = MovingMesh(small().rest + aside_m, FACES, times_s)
    rod = cylinder(0.01, 1.2, sections=16)
    others = [screen(0.0), static_mesh(rod.vertices + [1.0, 0.01, 1], rod.faces)]
    view = Occlusion.alone(
        Occluders([*others, ball]), SIGHT, samples_s=times_s, backend=backend, wavelength_m=WAVELENGTH_M
    )
    together, *alone = (view.viewpoints.traced([view], at_s)[0] for at_s in (times_s, *np.split(times_s, len(times_s))))
    np.testing.assert_allclose(together, np.concatenate(alone), atol=1e-5)
    assert np.ptp(together, axis=0).max() > 0.5


def test_exact_visibility_of_many_faces_is_traced_a_few_instants_at_a_time(
    backend: Backend, monkeypatch: pytest.MonkeyPatch
) -> None:
    times_s = np.linspace(0.0, 1.0, 5)
    aside_m = np.linspace(-0.05, 0.05, 5)[:, None, None] * [0.0, 1.0, 0.0]
    meshes = [screen(0.0), MovingMesh(small().rest + aside_m, FACES, times_s)]
    exact = ExactVisibility(meshes, SIGHT, own=1, backend=backend, wavelength_m=WAVELENGTH_M)
    together = exact.fraction(times_s, meshes[1].at(times_s), FACES)
    counts: list[int] = []
    at = Occluders.at

    def counted(self: Occluders, at_s: np.ndarray) -> object:
        counts.append(len(at_s))
        return at(self, at_s)

    monkeypatch.setattr(Occluders, "at", counted)
    monkeypatch.setattr(ExactVisibility, "FACES_AT_ONCE", 2 * sum(len(mesh.faces) for mesh in meshes))
    np.testing.assert_allclose(exact.fraction(times_s, meshes[1].at(times_s), FACES), together, atol=1e-5)
    assert counts == [2, 2, 1]


@pytest.mark.parametrize("covered_m", [pytest.param(-0.05, marks=pytest.mark.slow), 0.02])
def test_an_echo_passes_the_edge_out_and_back(covered_m: float) -> None:
    """Of a sphere of 10 cm radius half-way behind a screen's edge, beside its echo alone."""
    radar = Radar.preset("table2", position_m=(0.0, 0.0, 1.0))
    vertices, faces = icosphere(3, 0.1, (POINT_M + 0.1, 0, 1))
    sphere = static_mesh(vertices, faces, 0.02, name="sphere", sagitta_rad=0.3)
    power = []
    for others in ([], [screen(covered_m, until_s=0.02)]):
        found = t2d.simulate([sphere, *others], radar=radar, split="target")
        power.append(float(np.mean(np.abs(found.parts["sphere"].adc.values) ** 2)))
    expected = 2 * decibel(knife_edge(covered_m * PER_M))
    assert 10 * np.log10(power[1] / power[0]) == pytest.approx(float(expected), abs=0.6)
