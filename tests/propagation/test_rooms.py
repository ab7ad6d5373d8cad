"""Echoes in rooms: against Sionna RT's solver for points, closed forms of a sphere beside a wall, and invariants."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

import t2d_rt as t2d
from builders import ANTENNA_M, UP, ball, plate, small_room, walk
from measures import nmse_db
from t2d_rt.core.backend import select
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError
from t2d_rt.core.memory import SAMPLE_BYTES, VISIBILITY_BYTES
from t2d_rt.core.resources import resource
from t2d_rt.geometry import SubdividedMesh
from t2d_rt.pipeline.visibility import Sampled, VisibilityContext, coarse_views
from t2d_rt.propagation.images import existing
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.propagation.paths import FoundPaths, find_paths
from t2d_rt.propagation.rays import mitsuba
from t2d_rt.propagation.scene_paths import radar_paths
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.propagation.visibility import sample_times
from t2d_rt.scattering.ellipsoid import ellipsoid_echoes
from t2d_rt.scattering.mesh import _frames_at_once
from t2d_rt.scattering.paths import PathVisibility
from t2d_rt.signal import range_doppler
from t2d_rt.types import PEC, Ellipsoids, MovingMesh, OneWayPath, PathPair, Radar, Scene, Surface
from t2d_rt.types.path_fields import field_over
from validation.physics.ghosts import sphere_power


def with_shared_occlusion(distance_m: float = 2.0) -> Scene:
    """One large metal wall to the left of the radar, along its boresight."""
    y = distance_m
    return Scene(name="beside", surfaces=(plate("wall", [(-2, y, -2), (12, y, -2), (12, y, 4), (-2, y, 4)]),))


# --- one-way paths to points, against another tool ---


def of_points(mirrors: Mirrors, points: np.ndarray, frequency_hz: float) -> FoundPaths:
    return find_paths(mirrors, ANTENNA_M, UP, frequency_hz, order=2, probes_m=points)


def spherical(k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors of theta and phi of a direction."""
    theta, phi = math.acos(k[2]), math.atan2(k[1], k[0])
    across = np.array([-math.sin(phi), math.cos(phi), 0.0])
    return np.array([math.cos(theta) * math.cos(phi), math.cos(theta) * math.sin(phi), -math.sin(theta)]), across


@pytest.mark.slow
def test_a_points_paths_are_those_of_sionna() -> None:
    mi = mitsuba(select("cpu"))
    import sionna.rt as rt
    from sionna.rt.rcs import ConstantRCSSensingTarget, RCSSolver

    frequency_hz, scene = 77.87e9, "living_room"
    file = resource("scenes", scene) / f"{scene}.xml"
    theirs = rt.load_scene(str(file), merge_shapes=False)
    theirs.frequency = frequency_hz
    theirs.tx_array = theirs.rx_array = rt.PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="V")
    theirs.add(rt.Transmitter(name="tx", position=ANTENNA_M.tolist()))
    theirs.add(rt.Receiver(name="rx", position=ANTENNA_M.tolist()))
    target = ConstantRCSSensingTarget(
        name="target", sigma=1.0, length=1e-3, width=1e-3, height=1e-3, position=[3, 0, 1]
    )
    theirs.add(target)
    mirrors = Mirrors.of(load_scene(scene), select("cpu"))
    points = np.array([[3.1, -0.4, 1.3], [2.2, 0.6, 0.7]])
    one_way = of_points(mirrors, points, frequency_hz)
    wavelength = SPEED_OF_LIGHT / frequency_hz
    for point in points:
        target.position = mi.Point3f(*point.tolist())
        found = RCSSolver()(theirs, max_depth=3, refraction=False, seed=1)
        delay, amplitude = (np.array(x).ravel() for x in (found.tau, np.array(found.a[0]) + 1j * np.array(found.a[1])))
        amplitude, delay = amplitude[delay > 0], delay[delay > 0]
        ours = []
        exist = existing(one_way.edges.mirrors, one_way.paths, point[None])[:, 0]
        lit = [path for path, there in zip(one_way.paths, exist, strict=True) if there]
        for out in lit:
            for back in lit:
                if out.order + back.order > 2:
                    continue
                lengths = [np.linalg.norm(point - path.image_m) for path in (out, back)]
                # That solver's target keeps the theta and phi components of the field.
                heading = (point - out.image_m) / lengths[0], (back.image_m - point) / lengths[1]
                fields = [field_over(path, point, np.array([frequency_hz]))[0] for path in (out, back)]
                rotated = sum((a @ fields[0]) * (b @ fields[1]) for a, b in zip(*map(spherical, heading), strict=True))
                ours.append(
                    (sum(lengths) / SPEED_OF_LIGHT, wavelength / (4 * math.pi) ** 1.5 / math.prod(lengths) * rotated)
                )
        strongest = np.abs(amplitude).max()
        theirs_in_order = sorted((t, a) for t, a in zip(delay, amplitude, strict=True) if abs(a) > 1e-3 * strongest)
        ours_in_order = sorted(((t, a) for t, a in ours if abs(a) > 1e-3 * strongest), key=lambda each: each[0])
        assert len(ours_in_order) == len(theirs_in_order) > 50
        for (t, a), (other_t, _) in zip(ours_in_order, theirs_in_order, strict=True):
            assert abs(t - other_t) * SPEED_OF_LIGHT < 1e-5
            nearest = min(
                (other for u, other in theirs_in_order if abs(u - t) * SPEED_OF_LIGHT < 1e-5), key=lambda b: abs(b - a)
            )
            assert abs(20 * math.log10(abs(a) / abs(nearest))) < 0.1
            assert abs(np.angle(a / nearest, deg=True)) < 5


# --- a sphere beside a wall ---


def peak(scene: Scene | str, radius_m: float = 0.15) -> tuple[Radar, np.ndarray, np.ndarray, np.ndarray]:
    radar = Radar.preset("table2", position_m=(0.0, 0.0, 1.0))
    target = ball((4.0, 0.3, 1.0), (-2.0, 0.5, 0.0), 0.1, radius_m=radius_m)
    result = t2d.simulate(target, radar=radar, scene=scene, clutter="none", accuracy={"occlusion": False})
    image = range_doppler(result.adc.values[:, 0], radar, correct_coupling=True)
    return radar, image.power, image.velocity_mps, image.range_m


def test_ghosts_of_a_sphere_beside_a_wall() -> None:
    radius, wall = 0.15, 2.0
    _, power, speeds, ranges = peak(with_shared_occlusion(wall), radius)
    _, alone, *_ = peak("free_space", radius)
    image = np.array([0.0, 2 * wall, 0.0])

    def geometry(time_s: float) -> tuple[float, float, float]:
        """Distances of the centre from the radar and from its image, and the angle between both lengths."""
        centre = np.array([4.0, 0.3, 0.0]) + np.array([-2.0, 0.5, 0.0]) * time_s
        r, r_image = np.linalg.norm(centre), np.linalg.norm(centre - image)
        return float(r), float(r_image), math.acos(centre @ (centre - image) / (r * r_image))

    def mixed_path(time_s: float) -> float:
        r, r_image, beta = geometry(time_s)
        return (r + r_image) / 2 - radius * math.cos(beta / 2)

    middle, step = 0.05, 1e-4
    r, r_image, beta = geometry(middle)
    direct = sphere_power(r, r, 0.0, radius)
    for path, copies in ((mixed_path, 2), (lambda t: geometry(t)[1] - radius, 1)):
        expected_range, expected_speed = path(middle), (path(middle - step) - path(middle + step)) / (2 * step)
        row, column = np.argmin(np.abs(speeds - expected_speed)), np.argmin(np.abs(ranges - expected_range))
        near = power[row - 2 : row + 3, column - 2 : column + 3]
        at_row, at_column = np.unravel_index(np.argmax(near), near.shape) + np.array([row - 2, column - 2])
        bin_m, bin_mps = abs(ranges[1] - ranges[0]), abs(speeds[1] - speeds[0])
        assert abs(interpolated(ranges, power[at_row], at_column) - expected_range) < 0.1 * bin_m
        assert abs(interpolated(speeds, power[:, at_column], at_row) - expected_speed) < 0.5 * bin_mps
        lengths = (r, r_image, beta) if copies == 2 else (r_image, r_image, 0.0)
        expected = copies**2 * sphere_power(*lengths, radius) / direct
        # Power of a line is that of the cells it spreads over.
        found = summed(power, at_row, at_column) / summed(alone, *np.unravel_index(np.argmax(alone), alone.shape))
        assert abs(10 * math.log10(found / expected)) < 0.5


def summed(power: np.ndarray, row: int, column: int) -> float:
    return float(power[row - 3 : row + 4, column - 2 : column + 3].sum())


def interpolated(axis: np.ndarray, power: np.ndarray, peak_at: int) -> float:
    """Peak of a Hann-weighted line: parabola through the logs of three cells."""
    a, b, c = np.log(power[peak_at - 1 : peak_at + 2])
    return float(axis[peak_at] + 0.5 * (a - c) / (a - 2 * b + c) * (axis[1] - axis[0]))


def test_transmitter_and_receiver_may_be_swapped() -> None:
    target = ball((3.0, 0.2, 1.1), (-1.0, 0.3, 0.2), 0.05)
    sides = ([[0.0, 0.1, 0.0]], [[0.0, -0.1, 0.0]])
    cubes = []
    for tx, rx in (sides, sides[::-1]):
        radar = Radar.preset("table2", tx_offsets_m=tx, rx_offsets_m=rx)
        cubes.append(
            t2d.simulate(
                target, radar=radar, scene=small_room(), clutter="none", accuracy={"occlusion": False}
            ).adc.values
        )
    assert nmse_db(cubes[1], cubes[0]) < -80


@pytest.mark.slow
def test_scene_radar_and_target_may_be_moved_together() -> None:
    angle, shift = 0.7, np.array([3.0, -5.0, 0.4])
    rotation = np.array([[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]])
    room = small_room()
    moved = Scene(
        name="moved",
        surfaces=tuple(
            Surface(
                name=s.name, vertices=s.vertices @ rotation.T + shift, faces=s.faces, material=s.material,
                thickness_m=s.thickness_m,
            )
            for s in room.surfaces
        ),
    )  # fmt: skip
    target = ball((3.0, 0.2, 1.1), (-1.0, 0.3, 0.2), 0.05, sagitta_rad=0.07)
    # Patches are cut in the pose at rest, which a body brings with it.
    there = MovingMesh.from_track(
        lambda t: target.at(t) @ rotation.T + shift, target.faces, target.times_s, material="pec", rest=target.rest
    )
    place = rotation @ [0, 0, 1] + shift
    one = t2d.simulate(target, radar=Radar.preset("table2"), scene=room, clutter="none", accuracy={"occlusion": False})
    radar = Radar.preset("table2", position_m=tuple(place), boresight=tuple(rotation @ [1, 0, 0]))
    other = t2d.simulate(there, radar=radar, scene=moved, clutter="none", accuracy={"occlusion": False})
    assert nmse_db(other.adc.values, one.adc.values) < -60


def test_a_static_target_stays_at_zero_doppler() -> None:
    static = ball((3.0, 0.2, 1.1), (0.0, 0.0, 0.0), 0.1)
    result = t2d.simulate(static, radar=Radar.preset("table2"), scene=small_room())
    cube = result.adc.values[:, 0]
    moving = cube - cube.mean(axis=0)
    assert np.sum(np.abs(moving) ** 2) < 1e-8 * np.sum(np.abs(cube) ** 2)


@pytest.mark.slow
def test_a_body_sees_the_same_room_in_both_models() -> None:
    motion = t2d.trim(walk(), 0, 0.15)
    found = [
        t2d.simulate(motion, scene=small_room(), clutter="none", method=method, accuracy={"dynamic_range_db": 20.0})
        for method in ("mesh", "ellipsoid")
    ]
    assert found[0].settings["pairs"] == found[1].settings["pairs"]
    levels = [10 * math.log10(np.mean(np.abs(each.adc.values) ** 2)) for each in found]
    assert abs(levels[0] - levels[1]) < 6


def test_a_cupboard_hides_what_is_behind() -> None:
    y = (-0.5, 0.5)
    front = plate("cupboard", [(1.5, y[0], 0), (1.5, y[1], 0), (1.5, y[1], 2), (1.5, y[0], 2)])
    far = plate("far", [(20, -1, 0), (20, 1, 0), (20, 1, 2), (20, -1, 2)])
    target = ball((3.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.05)
    with pytest.raises(InputError, match="no path leads from the radar"):
        t2d.simulate(target, scene=Scene(name="hidden", surfaces=(front, far)))


def test_nothing_clicks_where_a_body_crosses_the_line_to_an_image() -> None:
    """Between the radar and its image in the wall behind lies a shadow, in which the search for a reflection fails."""
    end = plate("end", [(6, -2, 0), (6, 2, 0), (6, 2, 2.6), (6, -2, 2.6)], "plasterboard")
    motion = t2d.trim(walk(), 1.5, 2.3)
    radar = Radar.preset("table2")
    alone, there = (
        t2d.simulate(motion, radar=radar, method="ellipsoid", scene=scene, clutter="none").spectrogram
        for scene in ("free_space", Scene(name="end", surfaces=(end,)))
    )
    assert np.isfinite(there.values).all()
    fast = np.abs(there.velocity_mps.values) > 6
    beyond = [10 * math.log10(np.max(np.mean(10 ** (s.values[fast] / 10), axis=0))) for s in (alone, there)]
    assert beyond[1] < beyond[0] + 3


@pytest.mark.slow
def test_nothing_rings_where_paths_come_and_go() -> None:
    """A delay that leaps, even of an echo that is dark there, turns its group's others: lines at multiples of the surface rate."""
    walker = t2d.place(walk())
    image = t2d.simulate(t2d.trim(walker, 1.7, 2.0), scene="living_room", accuracy={"sagitta_rad": 1.0}).spectrogram
    fast = np.abs(image.velocity_mps.values) > 6
    assert image.values[fast].max() < image.values.max() - 55


@pytest.mark.slow
def test_echoes_are_finite_wherever_a_body_stands_between_antennas_and_images() -> None:
    times = np.linspace(0, 1, 50)
    centres = np.random.default_rng(5).uniform((0.5, -0.8, 0.3), (5.5, 0.8, 2.2), (50, 40, 3))
    axes = np.tile(np.eye(3), (50, 40, 1, 1))
    limbs = Ellipsoids(np.tile([0.05, 0.06, 0.25], (40, 1)), centres, times, axes=axes)
    found = radar_paths(load_scene("corridor"), Radar.preset("table2"), centres[0], order=2, backend=select("cpu"))
    out = list(found.out.paths)
    views = [PathVisibility(paths=PathPair(out=first, back=second)) for first in out[:8] for second in out[:8]]
    echoes = ellipsoid_echoes(limbs, Radar.preset("table2"), times_s=times, material=PEC, views=views).gather()
    assert np.isfinite(echoes.amplitude).all()
    assert np.isfinite(echoes.delay_s).all()


def over(*chain: str, image_m: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> OneWayPath:
    """A one-way path of which nothing but its chain and its image is asked for."""
    return replace(OneWayPath.line_of_sight(np.zeros(3), UP), chain=chain, image_m=np.array(image_m))


class Passing:
    """A scene that lets a fraction of the field over each path through, the same to all points or a function of them."""

    def __init__(self, *known: tuple[OneWayPath, float | Callable[[np.ndarray], np.ndarray]]) -> None:
        self._known = {path.key: passing for path, passing in known}

    def fraction(self, path: OneWayPath, points: np.ndarray, times_s: np.ndarray | None = None) -> np.ndarray:
        passing = self._known[path.key]
        return (
            passing(points).astype(np.float32) if callable(passing) else np.full(points.shape[:-1], passing, np.float32)
        )

    def fractions(
        self, paths: Sequence[OneWayPath], points: np.ndarray, times_s: np.ndarray | None = None
    ) -> np.ndarray:
        return np.array([self.fraction(path, points) for path in paths])


def test_antennas_apart_have_visibility_of_their_own() -> None:
    target = ball((3.0, 0.2, 1.1), (0.0, 0.0, 0.0), 0.1)
    one, half = over("wall"), over("wall", image_m=(0.0, 0.1, 0.0))
    times = np.linspace(0, 0.1, 5)
    pairs = [PathPair(out=one, back=half), PathPair(out=one, back=one)]
    views = coarse_views(target, pairs, sample_times(0.0, 0.1, 25.0), Passing((one, 0.5), (half, 0.25)))
    found = [[float(each(times).max()) for each in view.unblocked] for view in views]
    assert found == [[0.5, 0.25], [0.5, 0.5]]


def test_frames_at_once_fit_the_visibility_of_all_meshes() -> None:
    target, screen = (ball(where, time_s=0.1, radius_m=0.2) for where in ((3.0, 0.0, 1.0), (1.5, 0.2, 1.0)))
    one, other = over(image_m=(0.0, 0.0, 1.0)), over("wall", image_m=(0.0, 6.0, 1.0))
    sight = VisibilityContext(
        geometries=[target, screen], radar=Radar.preset("table2"), pairs=[PathPair(out=one, back=each) for each in (one, other)],
        fast_rotating=[False, False], samples_s=sample_times(0.0, 0.1, 25.0), backend=select("cpu"),
        blockage=Passing((one, 1.0), (other, 1.0)),
    )  # fmt: skip
    views = Sampled(sight, subdivision=1).views(0)
    points = sum(len(SubdividedMesh.of(each.faces, len(each.rest), 1).operator.indptr) - 1 for each in (target, screen))
    assert [view.points for view in views] == [points, points]
    assert _frames_at_once(views) == VISIBILITY_BYTES // (SAMPLE_BYTES * 2 * points)
    many = replace(views[1], points=int(VISIBILITY_BYTES))
    assert _frames_at_once([*views, many]) == 1
    assert _frames_at_once([PathVisibility()]) > 1_000_000  # free space has but one viewpoint


@pytest.mark.slow
def test_a_fan_in_step_with_the_sample_times_keeps_its_faces() -> None:
    """At 540 rpm and ten samples over 1 s it would seem to be static."""
    fan = t2d.TableFan(position_m=(3.0, 0.0, 1.0), rpm=540, heading_deg=90).mesh(0.0, 1.0)
    far = Scene(name="far", surfaces=(plate("far", [(30, -1, 0), (30, 1, 0), (30, 1, 2), (30, -1, 2)]),))
    alone, there = (
        t2d.simulate(
            fan, radar=Radar.preset("table2", prf_hz=11_000), scene=scene, reflections=0, clutter="none",
            accuracy={"occlusion": False, "sagitta_rad": 0.5},
        ).adc.values
        for scene in ("free_space", far)
    )  # fmt: skip
    assert nmse_db(there, alone) < -40


def test_fast_rotating_targets_have_their_mean_visibility() -> None:
    target = ball((3.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.1)
    path = over()
    scene = Passing((path, lambda points: points[..., 1] > 0))
    apart, alike = (
        coarse_views(
            target, [PathPair(out=path, back=path)], sample_times(0.0, 0.1, 25.0), scene, fast_rotating=fast_rotating
        )[0].unblocked[0]
        for fast_rotating in (False, True)
    )
    times = np.linspace(0, 0.1, 3)
    assert set(np.unique(apart(times))) == {0.0, 1.0}
    np.testing.assert_allclose(alike(times), np.mean(apart(times)))


@pytest.mark.slow
def test_a_room_of_ones_own() -> None:
    room = t2d.Room(name="cell", size_m=(5, 4, 2.5))
    target = ball((3.0, 0.2, 1.1), (-1.0, 0.3, 0.2), 0.05)
    made, same = (
        t2d.simulate(target, scene=scene, accuracy={"dynamic_range_db": 20.0}) for scene in (room, room.scene())
    )
    assert made.settings["scene"] == "cell"
    assert "direct, wall-x" in made.settings["pairs"]
    assert np.array_equal(made.adc.values, same.adc.values)
    with pytest.raises(InputError, match="scene must be a name, a path, a Room or a Scene, got 3"):
        t2d.simulate(target, scene=3)  # type: ignore[arg-type]


# --- scenes ---


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("moon", "unknown scene 'moon'; choose one of free_space, bedroom, corridor"),
        ("missing.xml", "there is no scene file missing.xml"),
    ],
)
def test_unknown_scenes_are_refused(source: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_scene(source)


def test_a_radar_in_the_furniture_is_refused() -> None:
    radar = Radar.preset("table2", position_m=(0.45, 2.3, 1.0))
    with pytest.raises(InputError, match="is inside cupboard of scene living_room"):
        t2d.simulate(ball((3, 0, 1), (0, 0, 0)), radar=radar, scene="living_room")


def test_a_material_without_values_is_named() -> None:
    brick = Scene(name="brick", surfaces=(plate("wall", [(0, 2, 0), (5, 2, 0), (5, 2, 3), (0, 2, 3)], "brick"),))
    with pytest.raises(
        InputError, match=r"no values for brick at 77\.864 GHz; name substitutes, as --scene-material brick=concrete"
    ):
        t2d.simulate(ball((3, 0, 1), (0, 0, 0)), scene=brick)


@pytest.mark.slow
def test_subdivided_visibility_with_every_tier() -> None:
    """Dominant and secondary path pairs trace their occlusion at it."""
    target = [t2d.trim(walk(), 0, 0.06), t2d.TableFan(position_m=(2, -1, 1), rpm=900)]
    options = {"scene": small_room(), "clutter": "none", "collisions": "ignore"}
    cubes = [
        t2d.simulate(target, **options, accuracy={"sagitta_rad": 2.0, "visibility_subdivision": n}).cube for n in (0, 1)
    ]
    assert -70 < nmse_db(*cubes) < -20, "shadows' edges differ a little"
