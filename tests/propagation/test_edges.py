"""How fields fade at edges: against the knife edge, invariants of mirrors side by side, and a walk behind a cupboard."""

from __future__ import annotations

import math

import numpy as np
import pytest
from trimesh.creation import box

import t2d_rt as t2d
from builders import ANTENNA_M, UP, plate, slow_after, walk
from t2d_rt.core.backend import select
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError
from t2d_rt.propagation.edges import MANY, RIM, Edges, bundle
from t2d_rt.propagation.images import existing
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.propagation.paths import FoundPaths, find_paths
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.types import Ellipsoids, Radar, Scene, Surface
from validation.physics.edges import knife_edge_db

FREQUENCY_HZ = 77.87e9
WAVELENGTH_M = SPEED_OF_LIGHT / FREQUENCY_HZ


def block(name: str, low_m: tuple[float, float, float], high_m: tuple[float, float, float]) -> Surface:
    solid = box(bounds=np.array([low_m, high_m]))
    return Surface(
        name=name, vertices=np.asarray(solid.vertices), faces=np.asarray(solid.faces), material="metal", thickness_m=0.01,
    )  # fmt: skip


def paths_to(points: np.ndarray, *surfaces: Surface, order: int = 1) -> FoundPaths:
    mirrors = Mirrors.of(Scene(name="test", surfaces=surfaces), select("cpu"))
    return find_paths(mirrors, ANTENNA_M, UP, FREQUENCY_HZ, order=order, probes_m=points)


def fractions_by_name(found: FoundPaths, points: np.ndarray) -> dict[str, np.ndarray]:
    return {path.name: found.edges.fraction(path, points) for path in found.paths}


def fractions_to(points: np.ndarray, *surfaces: Surface, order: int = 1) -> dict[str, np.ndarray]:
    """Fractions of the field over each path to points among which it is searched for."""
    return fractions_by_name(paths_to(points, *surfaces, order=order), points)


def check_knife_edge(fraction: np.ndarray, v: np.ndarray) -> None:
    level = 20 * np.log10(np.maximum(fraction, 1e-6))
    lit = v <= 0
    assert np.abs(level - knife_edge_db(v))[lit].max() < 2
    assert level[np.argmin(np.abs(v))] == pytest.approx(-6, abs=1)  # one ray of twenty
    assert (level[v > 1.4] < -20).all()
    assert (fraction[v < -1.4] == 1).all()
    assert (np.diff(fraction[np.argsort(v)]) <= 1e-6).all()


@pytest.mark.parametrize("beyond", [0.2, 0.5, 1.5, 3.0])
def test_behind_a_screen_the_field_is_that_of_a_knife_edge(beyond: float) -> None:
    """The narrower, the closer the target stands."""
    before = 1.5
    screen = plate("screen", [(before, -3, -2), (before, 0, -2), (before, 0, 4), (before, -3, 4)])
    v = np.linspace(-2.5, 2.5, 101)
    height = -v * math.sqrt(WAVELENGTH_M / 2 * before * beyond / (before + beyond))
    points = np.array([before + beyond, 0, 1]) + np.outer(height * (before + beyond) / before, [0, 1, 0])
    check_knife_edge(fractions_to(points, screen)["direct"], v)


def test_at_a_mirrors_edge_as_well() -> None:
    wall, end = 1.0, 1.5
    mirror = plate("mirror", [(-2, wall, -2), (end, wall, -2), (end, wall, 4), (-2, wall, 4)])
    x = np.linspace(2.6, 3.4, 101)
    points = np.column_stack([x, np.zeros_like(x), np.ones_like(x)])
    # In the picture with the mirror's image the edge stands across a straight path, aslant by the angle of incidence.
    length = np.hypot(x, 2 * wall)
    aside = (x / 2 - end) * 2 * wall / length
    v = aside * np.sqrt(2 / WAVELENGTH_M * 4 / length)
    check_knife_edge(fractions_to(points, mirror)["mirror"], v)


def test_mirrors_side_by_side_divide_the_field() -> None:
    wall = plate("wall", [(-2, 1, -2), (1.5, 1, -2), (1.5, 1, 4), (-2, 1, 4)])
    window = plate("window", [(1.5, 1, -2), (9, 1, -2), (9, 1, 4), (1.5, 1, 4)])
    rng = np.random.default_rng(1)
    points = rng.uniform((2, -1, 0.5), (4, 0.5, 1.5), (2000, 3))
    both = [each for name, each in fractions_to(points, wall, window).items() if name != "direct"]
    assert len(both) == 2
    assert ((both[0] > 0.1) & (both[1] > 0.1)).sum() > 50
    assert np.abs(sum(both) - 1).max() < 1e-6


def test_where_walls_meet_no_field_is_lost() -> None:
    """Images in a right angle are exact: what stands at the floor, at a wall or in the corner is seen in full over each."""
    floor = plate("floor", [(-3, -5, 0), (9, -5, 0), (9, 2, 0), (-3, 2, 0)])
    wall = plate("wall", [(-3, 2, 0), (9, 2, 0), (9, 2, 5), (-3, 2, 5)])
    aside, up = np.meshgrid([-1.0, 0.0, 1.9, 1.99], [0.002, 0.02, 0.1, 0.5])
    points = np.column_stack([np.full(aside.size, 3.5), aside.ravel(), up.ravel()])
    found = fractions_to(points, floor, wall)
    assert sorted(found) == ["direct", "floor", "wall"]
    for name, fraction in found.items():
        assert (fraction == 1).all(), name


def test_what_stands_beside_furniture_is_not_in_its_shadow() -> None:
    sofa = block("sofa", (2.0, 0.05, 0.0), (4.0, 1.0, 0.7))
    points = np.array([[3.0, 0.0, z] for z in (0.05, 0.3, 0.68, 0.9)])
    assert (fractions_to(points, sofa, order=0)["direct"] == 1).all()
    behind = np.array([[3.0, 1.2, 0.3]])
    lit = np.array([[5.0, -1.0, 0.3]])
    assert fractions_by_name(paths_to(np.concatenate([behind, lit]), sofa, order=0), behind)["direct"] == 0


@pytest.mark.slow
def test_cells_of_points_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform((0.8, -2, 0.01), (5.5, 1.5, 1.9), (1000, 3))
    mirrors = Mirrors.of(load_scene("living_room"), select("cpu"))
    found = find_paths(mirrors, ANTENNA_M, UP, FREQUENCY_HZ, order=1, probes_m=points)
    fractions = np.array(list(fractions_by_name(found, points).values()))
    cells = Edges._cells

    def none_known(*given: object) -> tuple[np.ndarray, ...]:
        known, near, rims = cells(*given)  # type: ignore[arg-type]
        return np.full_like(known, np.nan), np.ones_like(near), np.ones_like(rims)

    monkeypatch.setattr(Edges, "_cells", none_known)
    traced = np.array(list(fractions_by_name(found, points).values()))
    assert ((fractions > 0) & (fractions < 1)).mean() > 0.03
    # Where planes meet, rays that both leave the room and meet an edge may count either way.
    assert (np.abs(fractions - traced) > 1e-6).mean() < 1e-3
    # Soft edges take as much as they give.
    exists = existing(found.edges.mirrors, found.paths, points)
    assert fractions.sum() == pytest.approx(exists.sum(), rel=0.02)


@pytest.mark.slow
def test_a_walk_behind_a_cupboard() -> None:
    """Hidden it is gone, and it neither comes nor goes with a click."""
    cupboard = block("cupboard", (1.5, 0.6, 0), (1.9, 1.4, 2.2))
    motion = t2d.place(walk(), distance_m=3, angle_deg=-90)
    radar = Radar.preset("table2", prf_hz=6400.0)
    alone, there = (
        t2d.simulate(motion, radar=radar, scene=scene, method="ellipsoid", clutter="none").spectrogram
        for scene in ("free_space", Scene(name="cupboard", surfaces=(cupboard,)))
    )
    power = [10 ** (each.values / 10) for each in (alone, there)]
    loss_db = 10 * np.log10(power[0].sum(axis=0) / power[1].sum(axis=0))
    time_s = alone.time_s.values
    hidden = (time_s > 1.4) & (time_s < 2.4)
    assert (loss_db[hidden] > 20).all()
    assert np.abs(loss_db[time_s > 3.6]).max() < 0.5
    fast = np.abs(alone.velocity_mps.values) > 4.5
    beyond = [each[fast].mean() for each in power]
    assert 10 * math.log10(beyond[1] / beyond[0]) < 3


def test_a_bundle_goes_straight_on_through_a_slab() -> None:
    """In single precision the change of direction there is rounding, which must not turn the cross-section over."""
    start = np.tile([0.0, 0.0, 1.0], (200, 1))
    end = np.random.default_rng(0).uniform((3, -1, 0), (5, 1, 2), (200, 3))
    path = np.stack([start, start + 2 / end[:, :1] * (end - start), end]).astype(np.float32)
    rays = bundle(path, 0.004, np.array([(0.9, 0.0), (0.0, 0.9)], np.float32), 2)
    at_slab, beyond = rays[1, 0] - path[1, :, None], rays[1, 1] - path[1:].mean(axis=0)[:, None]
    lengths = np.linalg.norm(at_slab, axis=-1) * np.linalg.norm(beyond, axis=-1)
    np.testing.assert_allclose(rays[0, -1], rays[1, 0], atol=1e-6)
    assert (np.einsum("pri,pri->pr", at_slab, beyond) / lengths).min() > 0.999


def test_a_surface_of_triangles_given_twice_is_one() -> None:
    corners = [(2, -1, 0), (2, 1, 0), (2, 1, 2), (2, -1, 2)]
    single = plate("wall", corners)
    double = plate("wall", corners, faces=[[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]])
    one, two = (Mirrors.of(Scene(name="s", surfaces=(each,)), select("cpu")).parts[0] for each in (single, double))
    np.testing.assert_array_equal(one.triangles, two.triangles)


def test_mirrors_of_one_surface_have_names_of_their_own() -> None:
    names = [mirror.name for mirror in Mirrors.of(load_scene("hospital_room"), select("cpu")).parts]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize(
    ("first", "second"),
    slow_after(
        2,
        [((-2, 2), (1, 12)), ((-2, 12), (1, 2)), ((-2, 12), (-2, 12)), ((1, 2), (-2, 12)), ((-2, 1.5), (1.5, 12))],
    ),
)
def test_walls_that_overlap_reflect_once(first: tuple[float, float], second: tuple[float, float]) -> None:
    """Twice the same, in part, a panel on a wall, and side by side: the fractions of one plane add up to one everywhere."""
    pieces = [
        plate(name, [(x0, 2, -2), (x1, 2, -2), (x1, 2, 4), (x0, 2, 4)])
        for name, (x0, x1) in (("one", first), ("two", second))
    ]
    x = np.linspace(1.2, 6, 200)
    points = np.column_stack([x, 0 * x, 0 * x + 1])
    found = paths_to(points, *pieces)
    over_walls = [path.order == 1 for path in found.paths]
    fractions = sum(found.edges.fraction(path, points) for path in found.paths if path.order == 1)
    np.testing.assert_allclose(fractions, 1, atol=1e-6)
    assert existing(found.edges.mirrors, found.paths, points)[over_walls].sum(axis=0).max() <= (
        2 if first[1] == second[0] else 1
    )


def test_a_target_just_inside_a_shadow_is_attenuated_not_lost() -> None:
    """A small ball that stands in the shadow of a knife edge all the time: by the fraction of the zone that is free, out and back,
    near the knife edge's own loss; far inside no path leads to it."""
    before = beyond = 1.5
    screen = plate("screen", [(before, -3, -2), (before, 0, -2), (before, 0, 4), (before, -3, 4)])
    scene = Scene(name="screen", surfaces=(screen,))
    radar = Radar.preset("table2", position_m=(0, 0, 1))
    step = math.sqrt(radar.wavelength_m / 2 * beyond / before * (before + beyond))

    def level_db(v: float, scene: Scene | str) -> float:
        place, times_s = [before + beyond, -v * step, 1.0], np.linspace(0, 0.02, 4)
        ball = Ellipsoids([[0.004] * 3], np.tile(place, (4, 1, 1)), times_s, material="pec")
        cube = t2d.simulate(ball, radar=radar, scene=scene, reflections=0, clutter="none", collisions="ignore").cube
        return 10 * math.log10(float(np.mean(np.abs(np.asarray(cube)) ** 2)))

    for v, aside_db in ((0.1, 1.5), (0.4, 2.0), (0.8, 6.0)):
        loss_db = (level_db(v, scene) - level_db(v, "free_space")) / 2
        x = v / math.sqrt(2) / RIM
        free = (math.acos(x) - x * math.sqrt(1 - x**2)) / math.pi
        assert 10 ** (loss_db / 20) == pytest.approx(free, abs=1.01 / len(MANY))
        assert loss_db == pytest.approx(knife_edge_db(np.array(v)), abs=aside_db)
    with pytest.raises(InputError, match="no path leads"):
        level_db(1.5, scene)
