"""Radars that move: the same recording as of a radar that stands still in a world that moves."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.special import jv

import t2d_rt as t2d
from builders import ball, icosphere, moving, static_mesh
from t2d_rt.accuracy.estimate import Chirps, Field, nmse_db
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.setup import set_up
from t2d_rt.types import PEC, Ellipsoids, MovingMesh, Radar, RadarTrack, Scene, Surface, antennas

TABLE2 = Radar.preset("table2")
UNTIL_S = 0.2
TIMES_S = np.linspace(0, UNTIL_S, 9)


def difference_db(one: t2d.Recording, other: t2d.Recording) -> float:
    """Energy of the difference relative to that of the first one."""
    return float(10 * np.log10(1e-30 + np.sum(abs(one.cube - other.cube) ** 2) / np.sum(abs(one.cube) ** 2)))


def plate_facing(x_m: float, times_s: np.ndarray = TIMES_S) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a plate of 0.4 m that looks along -x, at the height of the radar."""
    corners = np.array([[x_m, y, z] for y in (-0.2, 0.2) for z in (0.8, 1.2)])
    return corners, np.array([[0, 1, 2], [1, 3, 2]])


@pytest.mark.filterwarnings("ignore:.*watertight")
@pytest.mark.parametrize("preset", ["table2", "indoor-60"])
def test_radar_towards_a_plate_is_a_plate_towards_the_radar(preset: str) -> None:
    radar, (corners, faces) = Radar.preset(preset), plate_facing(2.0)
    along = np.outer(TIMES_S, [1.0, 0.0, 0.0])
    still = static_mesh(corners, faces, UNTIL_S)
    coming = MovingMesh(corners - along[:, None], faces, TIMES_S, "pec")
    riding = radar.replace(track=RadarTrack(times_s=TIMES_S, positions_m=np.array(radar.position_m) + along))
    expected = t2d.simulate(coming, radar=radar)
    assert difference_db(expected, t2d.simulate(still, radar=riding)) < -60  # -150 dB seen
    assert difference_db(expected, t2d.simulate(still, radar=radar)) > -3  # had the radar stood still


def test_a_radar_that_turns_is_a_world_that_turns_the_other_way() -> None:
    # An array with patterns, whose elements turn with it: yaw, pitch and roll at once.
    radar = Radar.preset("array-3x4", tx_pattern={"kind": "cosine", "exponent": 4}, rx_polarization_deg=30)
    angles = np.outer(TIMES_S / UNTIL_S, [20.0, -10.0, 15.0])
    track = RadarTrack.of_angles(TIMES_S, np.outer(1 + TIMES_S, [0.1, 0.2, 1.0]), angles)
    radar = radar.replace(track=track)
    vertices, faces = icosphere(3, 0.1, (2.0, 0.3, 1.1))
    frames_s = np.linspace(0, UNTIL_S, 41)
    passing = radar.passing(frames_s).points(np.repeat(vertices[None], len(frames_s), axis=0))
    carried = MovingMesh(passing, faces, frames_s, "pec", sagitta_rad=0.3)
    seen = t2d.simulate(static_mesh(vertices, faces, UNTIL_S, sagitta_rad=0.3), radar=radar)
    assert difference_db(t2d.simulate(carried, radar=radar.replace(track=None)), seen) < -60


def test_frame_of_a_radar() -> None:
    track = RadarTrack.of_angles([0, 1], [(1, 2, 3), (1, 2, 3)], [(90, 0, 0), (90, 30, 0)])
    radar = TABLE2.replace(track=track)
    assert np.allclose([*radar.position_m, *radar.boresight], (1, 2, 3, 0, 1, 0))
    # What lies ahead of the radar is ahead of it in its frame, however it is turned: 2 m along its boresight, pitched up by 30.
    ahead = np.array([1, 2, 3]) + 2 * np.array([0, math.cos(math.radians(30)), math.sin(math.radians(30))])
    own = (radar.passing(np.array([1.0])).points(ahead[None, None])[0, 0] - radar.position_m) @ radar.axes.T
    assert np.allclose(own, (2, 0, 0))
    rolled = RadarTrack.of_angles([0, 1], np.zeros((2, 3)), [(0, 0, 0), (0, 0, 90)]).axes(np.array([1.0]))
    assert np.allclose(rolled[0], [(1, 0, 0), (0, 0, 1), (0, -1, 0)])  # the left side is up


@pytest.mark.parametrize("scene", ["free_space", "wall"])
def test_lines_of_a_vibrating_mount(scene: str) -> None:
    # Paired echoes of sinusoidal phase modulation: line n has J_n(4 pi d / lambda) (Chen 2006).
    depth_m, rate_hz, until_s = 0.6e-3, 25.0, 0.4
    times_s = np.linspace(0, until_s, 401)
    places = np.array(TABLE2.position_m) + np.outer(depth_m * np.sin(2 * np.pi * rate_hz * times_s), [1, 0, 0])
    radar = TABLE2.replace(prf_hz=2560.0, track=RadarTrack(times_s=times_s, positions_m=places))
    target = ball((3.0, 0.0, 1.0), time_s=until_s)
    recording = t2d.simulate(target, radar=radar, scene=scene if scene == "free_space" else wall(0, 5.0), reflections=1)
    chirps = round(until_s * 2560)
    rows = recording.cube[:chirps, 0]
    # At mid-sweep, in the cells of the ball and of the wall, over whole periods: no window is needed along time.
    cells = np.fft.fft(rows * np.hanning(rows.shape[1]), axis=1)
    for place_m in (2.9,) if scene == "free_space" else (2.9, 5.0):
        near = np.flatnonzero(np.abs(radar.range_axis_m() - place_m) < 0.2)
        cell = cells[:, near[np.abs(cells[:, near]).sum(axis=0).argmax()]]
        lines = np.abs(np.fft.fft(cell)) / np.sqrt(np.mean(np.abs(cell) ** 2)) / len(cell)
        bessel = np.abs(jv(np.arange(-3, 4), 4 * np.pi * depth_m / radar.wavelength_m))
        measured = lines[np.arange(-3, 4) * round(rate_hz * until_s)]
        errors_db = np.abs(20 * np.log10(measured / bessel)).max()
        assert errors_db < 0.2, place_m  # 0.11 dB seen


# --- in rooms ---


def wall(axis: int, at_m: float, half_m: float = 40.0) -> Scene:
    """A large metal wall across an axis."""
    one, other = np.roll(np.eye(3), -axis, axis=0)[1:] * half_m
    corners = at_m * np.eye(3)[axis] + [-one - other, one - other, one + other, -one + other]
    surface = Surface(
        name="wall", vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]), material=PEC, thickness_m=0.1
    )
    return Scene(name="a wall", surfaces=(surface,))


@pytest.mark.filterwarnings("ignore:.*watertight")
@pytest.mark.parametrize("clutter", ["none", "specular"])
def test_beside_a_wall_a_plate_comes_to_the_radar(clutter: str) -> None:
    # The wall lies along the way, so that it is the same to a radar that comes and to one to which the plate comes.
    corners, faces = plate_facing(3.0)
    along = np.outer(TIMES_S, [1.0, 0.0, 0.0])
    still = static_mesh(corners, faces, UNTIL_S)
    coming = MovingMesh(corners - along[:, None], faces, TIMES_S, "pec")
    riding = TABLE2.replace(track=RadarTrack(times_s=TIMES_S, positions_m=np.array(TABLE2.position_m) + along))
    room = {"scene": wall(1, 2.0), "reflections": 2, "clutter": clutter}
    expected = t2d.simulate(coming, radar=TABLE2, **room)
    assert expected.settings["pairs"] == ["direct, wall", "direct", "wall"]
    assert difference_db(expected, t2d.simulate(still, radar=riding, **room)) < -150  # no difference seen
    assert difference_db(expected, t2d.simulate(still, radar=TABLE2, **room)) > -20  # had the radar stood still


def by_images(
    radar: Radar, antenna: int, point_m: np.ndarray, radius_m: float, axis: int, at_m: float, *, clutter: bool
) -> np.ndarray:
    """Samples of one antenna before a metal wall and a point of the RCS of a sphere, by images; all is at one height, so that the
    wall turns the sign of the vertical field at each reflection and changes nothing else."""
    tx_m, rx_m = np.array(radar.tx_offsets_m), np.array(radar.rx_offsets_m)
    out, back = divmod(antenna, len(rx_m))
    fast_s = radar.sample_times_s
    when = (radar.chirp_times_s(UNTIL_S) + radar.antenna_delays_s[antenna])[:, None] + fast_s
    axes, middle = radar.track.axes(when.ravel()), radar.track.places_m(when.ravel())
    axes = np.broadcast_to(radar.axes, (when.size, 3, 3)) if axes is None else axes

    def mirrored(places: np.ndarray, times: int) -> np.ndarray:
        return places if not times else np.where(np.arange(3) == axis, 2 * at_m - places, places)

    def element(offset_m: np.ndarray) -> np.ndarray:
        return middle + np.einsum("i,kij->kj", offset_m, axes)

    def gain(pattern: antennas.Pattern, towards: np.ndarray) -> np.ndarray:
        ahead = np.einsum("kij,kj->ki", axes, towards)
        return np.sqrt(pattern.gain(ahead / np.linalg.norm(ahead, axis=1, keepdims=True)))

    ends = element(tx_m[out]), element(rx_m[back]), element(tx_m.mean(axis=0)), element(rx_m.mean(axis=0))
    tx, rx, tx_centre, rx_centre = ends
    found = []
    for over in [(0, 0), (0, 1), (1, 0), (1, 1)]:
        there, here = (mirrored(point_m, times) for times in over)
        path = np.linalg.norm(tx - there, axis=1) + np.linalg.norm(rx - here, axis=1)
        ranges = np.linalg.norm(tx_centre - there, axis=1) * np.linalg.norm(rx_centre - here, axis=1)
        gains = gain(radar.tx_pattern, there - tx_centre) * gain(radar.rx_pattern, here - rx_centre)
        found.append((path, -((-1) ** sum(over)) * np.sqrt(np.pi) * radius_m / ranges * gains))
    if clutter:
        path, between = np.linalg.norm(mirrored(tx, 1) - rx, axis=1), mirrored(rx_centre, 1) - tx_centre
        gains = gain(radar.tx_pattern, between) * gain(radar.rx_pattern, mirrored(tx_centre, 1) - rx_centre)
        found.append((path, -np.sqrt(4 * np.pi) / np.linalg.norm(between, axis=1) * gains))
    frequency = radar.carrier_hz + radar.slope_hz_per_s * fast_s
    total = np.zeros(when.shape, complex)
    for path, amplitude in found:
        delay_s = path.reshape(when.shape) / SPEED_OF_LIGHT
        cycles = frequency * delay_s - 0.5 * radar.slope_hz_per_s * delay_s**2
        total += amplitude.reshape(when.shape) * np.exp(2j * np.pi * cycles)
    return radar.link_amplitude * total


@pytest.mark.parametrize(
    ("preset", "velocity_mps", "turns_deg", "at_most_db"),
    [
        ("table2", (1.0, 0.0, 0.0), 0.0, -90.0),  # -101 dB seen, with clutter -102
        ("table2", (0.7, 0.6, 0.0), 0.0, -88.0),  # -99 dB, with and without clutter
        # -57 dB: apparent places in single precision and splines
        ("array-3x4", (0.6, 0.5, 0.0), 25.0, -50.0),
    ],
)
def test_walls_pass_a_radar_that_moves(
    preset: str, velocity_mps: tuple[float, float, float], turns_deg: float, at_most_db: float
) -> None:
    times_s = np.linspace(0, UNTIL_S, 81)
    places = np.array([0, 0, 1.0]) + np.outer(times_s, velocity_mps)
    track = RadarTrack.of_angles(times_s, places, np.outer(15 + turns_deg * times_s / UNTIL_S, [1, 0, 0]))
    more = {"tx_pattern": {"kind": "cosine", "exponent": 2}} if turns_deg else {}
    radar, point_m = Radar.preset(preset, track=track, **more), np.array([2.5, 1.7, 1.0])
    target = Ellipsoids([[0.05] * 3], np.broadcast_to(point_m, (2, 1, 3)), [0, UNTIL_S], material="pec")
    for clutter in ("none", "specular"):
        options = {"method": "ellipsoid", "phase_from": "centre", "clutter": clutter}
        seen = t2d.simulate(target, radar=radar, scene=wall(0, 5.0), reflections=2, **options)
        antenna = radar.antennas - 1
        expected = by_images(radar, antenna, point_m, 0.05, 0, 5.0, clutter=clutter != "none")
        found = seen.cube[:, antenna]
        assert 10 * np.log10(np.sum(abs(found - expected) ** 2) / np.sum(abs(expected) ** 2)) < at_most_db
        speeds = seen.paths.speed_mps.values[0], -np.gradient(seen.paths.length_m.values[0], 0.04, axis=1) / 2
        assert np.allclose(speeds[0][:, 1:-1], speeds[1][:, 1:-1], atol=3e-3)


@pytest.mark.usefixtures("coarse_bodies")
@pytest.mark.filterwarnings("ignore:top speed")
def test_a_track_of_one_place_is_that_place() -> None:
    walk = t2d.trim(t2d.example("walk"), 2.0, 2.06)
    resting = Radar.preset("table2-uniform")
    track = RadarTrack(times_s=[0, 0.03, 0.06], positions_m=[resting.position_m] * 3)
    one, other = (
        t2d.simulate(walk, radar=radar, scene="living_room", reflections=1, accuracy={"sagitta_scale": 4.0})
        for radar in (resting, resting.replace(track=track))
    )
    assert one.settings["pairs"] == other.settings["pairs"]
    assert difference_db(one, other) < -185  # -196 dB seen


@pytest.mark.filterwarnings("ignore:top speed")
def test_echoes_at_an_instant_are_those_of_a_radar_that_stands_there() -> None:
    walk = t2d.place(t2d.trim(t2d.example("walk"), 2.0, 2.3), distance_m=3.0)
    times_s = np.linspace(0, 0.3, 13)
    angles, places = np.outer(times_s, [60.0, 30.0, 0.0]), np.array([0, 0, 1.0]) + np.outer(times_s, [1.6, 1.2, 0.3])
    track, at_s = RadarTrack.of_angles(times_s, places, angles), np.array([0.2])
    place, axes = track.places_m(at_s)[0], track.axes(at_s)
    accuracy = t2d.Accuracy(tiers=[{"level_db": -200.0}], dynamic_range_db=80.0, least_level_db=-80.0)

    def seen(radar: Radar) -> tuple[np.ndarray, complex]:
        experiment = Experiment(
            targets=[{"kind": "file", "file": "walk"}], radar=radar, reflections=1, method="ellipsoid"
        )
        model = set_up(walk, "living_room", experiment).model
        chirp = Chirps(np.array([0]), np.array([0]), at_s, np.array([0]))
        (static,), _ = model.clutter("specular", accuracy.replace(clutter_occlusion=False))
        echoes = static.static(at_s) if callable(static.static) else static.static
        there = 1.0 if static.unblocked is None else static.unblocked(at_s)[0]
        cycles = radar.mid_frequency_hz * np.ravel(echoes.delay_s)
        walls = np.sum(there * np.ravel(echoes.amplitude) * np.exp(2j * np.pi * (cycles % 1)))
        return Field(model, accuracy, chirp).samples(), complex(walls)

    resting = Radar.preset("table2-uniform", position_m=tuple(place), boresight=tuple(axes[0, 0]))
    moving = resting.replace(position_m=places[0], boresight=(1, 0, 0)).replace(track=track)
    (expected, walls), (found, walls_found) = seen(resting), seen(moving)
    assert nmse_db(found, expected) < -76  # -88 dB seen
    assert abs(walls_found - walls) < 0.03 * abs(walls)  # 0.008 seen, of paths that fade in or out


@pytest.mark.filterwarnings("ignore:top speed")
def test_a_mirror_is_seen_while_the_radar_is_before_it() -> None:
    corners = np.array([[x, 2.0, z] for x in (-0.4, 0.4) for z in (0.5, 1.5)])
    panel = Surface(
        name="panel", vertices=corners, faces=np.array([[0, 1, 2], [1, 3, 2]]), material=PEC, thickness_m=0.1
    )
    places = [(-1.0, 0.0, 1.0), (1.0, 0.0, 1.0)]
    radar = Radar.preset("table2-uniform", track=RadarTrack(times_s=[0, 1], positions_m=places))
    target = ball((3.0, -1.0, 1.0), time_s=1.0, level=1)
    room = {"radar": radar, "scene": Scene(name="panel", surfaces=(panel,)), "reflections": 1}
    echo = t2d.simulate(target, **room).cube[:, 0] - t2d.simulate(target, clutter="none", **room).cube[:, 0]
    power = np.mean(abs(echo) ** 2, axis=1)
    at_m = np.interp(radar.chirp_times_s(1.0), [0, 1], [-1, 1])
    lit = np.sqrt(power / power[np.abs(at_m) < 0.2].mean())
    assert np.allclose(lit[np.abs(at_m) < 0.3], 1, atol=0.01)
    assert lit[np.abs(at_m) > 0.5].max() < 1e-3


def test_what_a_ball_hides_of_a_wall_follows_the_track() -> None:
    """As balls do that come to the radar, one of which passes between it and the wall."""
    along = np.outer(TIMES_S, [4.0, 0.0, 0.0])
    shapes = icosphere(2, 0.15, (4.0, 0.2, 1.0)), icosphere(2, 0.25, (0.4, 0.9, 1.0))
    riding = TABLE2.replace(track=RadarTrack(times_s=TIMES_S, positions_m=np.array(TABLE2.position_m) + along))

    def found(radar: Radar, carried_m: np.ndarray, occlusion: bool = True) -> t2d.Recording:
        balls = [moving(shape, carried_m, TIMES_S, sagitta_rad=0.6) for shape in shapes]
        accuracy = {"tiers": [{"level_db": -200.0}], "occlusion": occlusion}
        return t2d.simulate(balls, radar=radar, scene=wall(1, 2.0), reflections=1, accuracy=accuracy)

    expected = found(TABLE2, -along)
    assert difference_db(expected, found(riding, 0 * along)) < -150  # no difference seen
    assert difference_db(expected, found(TABLE2, -along, occlusion=False)) > -6  # -2.7 dB seen


@pytest.mark.parametrize("path", ["wall", "direct, wall"])
def test_what_a_ball_hides_of_a_path_over_a_wall_follows_the_track(path: str) -> None:
    """A ball stands a metre beside the line of sight to another one, in the way to the wall: its shadow comes over the path while
    the radar goes by. The reference is both balls coming to a radar at rest; alone, each hides nothing of the other."""
    along = np.outer(TIMES_S, [1.0, 0.0, 0.0])
    shapes = icosphere(2, 0.1, (3.0, 0.0, 1.0)), icosphere(2, 0.15, (1.0, 1.0, 1.0))
    riding = TABLE2.replace(track=RadarTrack(times_s=TIMES_S, positions_m=np.array(TABLE2.position_m) + along))

    def found(radar: Radar, carried_m: np.ndarray, which: slice = slice(None)) -> t2d.Recording:
        balls = [moving(shape, carried_m, TIMES_S, sagitta_rad=0.6) for shape in shapes[which]]
        room = {"scene": wall(1, 2.0), "reflections": 2, "clutter": "none", "only_paths": [path]}
        return t2d.simulate(balls, radar=radar, **room, accuracy={"tiers": [{"level_db": -200.0}]})

    expected, seen = found(TABLE2, -along), found(riding, 0 * along)
    assert difference_db(expected, seen) < -100
    alone = [found(riding, 0 * along, which).cube for which in (slice(1), slice(1, 2))]
    hidden = np.sum(abs(sum(alone) - seen.cube) ** 2) / np.sum(abs(alone[0]) ** 2)
    assert 0.1 < hidden < 1  # of the farther ball's echo, which is hidden in the second half of the record


def test_of_a_radar_that_moves_in_a_room_the_rest_is_refused() -> None:
    times_s, target = np.array([0.0, 0.2]), ball((2.0, 0.0, 1.0))
    radar = TABLE2.replace(track=RadarTrack(times_s=times_s, positions_m=[(0, 0, 1), (0.2, 0, 1)]))
    with pytest.raises(InputError, match=r"clutter 'diffuse' is that of a radar that stands still, .* one place;"):
        t2d.simulate(target, radar=radar, scene="empty_room", clutter="diffuse")
    through = TABLE2.replace(track=RadarTrack(times_s=times_s, positions_m=[(0, 0, 1), (0, 4, 1)]))
    with pytest.raises(InputError, match=r"the radar goes through wall\+y of empty_room at 0\.1"):
        t2d.simulate(target, radar=through, scene="empty_room", transmissions=2, collisions="stop")


def test_an_antenna_goes_through_a_wall_however_little() -> None:
    """To 4 cm behind the wall at -0.5 m; and by 0.1 mm between two instants, which rays that begin off surfaces would miss."""
    for places, when in (([(-0.4, 0, 1), (-0.54, 0, 1)], "0.07"), ([(-0.49995, 0, 1), (-0.50005, 0, 1)], "0.05")):
        track = RadarTrack(times_s=[0, 0.1], positions_m=places)
        with pytest.raises(InputError, match=rf"the radar goes through wall-x of empty_room at {when} s, at \(-0\.50"):
            through(track)


def test_only_poses_within_the_record_are_outside() -> None:
    times_s = np.linspace(-5, 10, 151)
    places = np.stack([-0.06 * times_s, 0 * times_s, 1 + 0 * times_s], axis=1)
    assert len(through(RadarTrack(times_s=times_s, positions_m=places)).cube)
    beyond = RadarTrack(times_s=times_s, positions_m=places - [0.6, 0, 0])
    with pytest.raises(
        InputError, match=r"at \(-0\.60, 0\.00, 1\.00\) m at 0\.00 s of the record, .* give another track"
    ):
        through(beyond)


def test_a_radar_within_a_target_is_told_where_it_is_then() -> None:
    radar = TABLE2.replace(track=RadarTrack(times_s=[0, 0.1], positions_m=[(0, 0, 1), (1, 0, 1)]))
    for method, name in (("mesh", "ball"), ("ellipsoid", "egg")):
        target = ball((1.0, 0.0, 1.0), time_s=0.1, level=1) if name == "ball" else egg()
        with pytest.raises(InputError, match=rf"radar at \(0\.\d+, 0, 1\) m is inside {name} at 0\.0.* another track"):
            t2d.simulate(target, radar=radar, method=method)


def egg() -> Ellipsoids:
    """One that rests."""
    return Ellipsoids(np.array([[0.1, 0.1, 0.2]]), np.tile([1.0, 0, 1], (3, 1, 1)), [0, 0.05, 0.1], names=["egg"])


def through(track: RadarTrack) -> t2d.Recording:
    """A short record in the empty room, which ends or is refused where something goes through a wall."""
    radar = TABLE2.replace(track=track)
    room = {"scene": "empty_room", "reflections": 0, "clutter": "none", "collisions": "stop"}
    return t2d.simulate(ball((2.0, 0.0, 1.0), time_s=0.1, level=1), radar=radar, **room)


def test_truth_is_told_from_where_the_radar_is() -> None:
    radar = TABLE2.replace(track=RadarTrack(times_s=[0, 0.3], positions_m=[(0, 0, 1), (0.3, 0, 1)]))
    walk = t2d.example("walk")
    still = t2d.simulate(walk, radar=TABLE2, method="ellipsoid")
    with pytest.warns(T2DWarning, match="ends with the radar's track at 0.3 s"):
        moved = t2d.simulate(walk, radar=radar, method="ellipsoid")
    times_s = np.array([0.1, 0.2])
    own, other = (each.truth_at(times_s, visible=False) for each in (moved, still))
    assert np.allclose(own.speed_mps - other.speed_mps, 1, atol=0.02)
    assert np.allclose(own.joints_m.sel(xyz="forward"), other.joints_m.sel(xyz="forward") - times_s[:, None], atol=1e-6)


def test_tracks_are_kept_and_read(tmp_path: Path) -> None:
    rows = ["t,x,y,z,yaw,pitch,roll", "0,0,0,1,0,0,0", "0.5,0.5,0,1,10,5,0"]
    (tmp_path / "track.csv").write_text("\n".join(rows))
    np.savez(
        tmp_path / "track.npz", **dict(zip(rows[0].split(","), np.loadtxt(rows[1:], delimiter=",").T, strict=True))
    )
    values = TABLE2.model_dump(mode="json", exclude={"position_m", "boresight"})
    assert "track" not in values  # radars that stand still are written as before
    (tmp_path / "radar.yaml").write_text(str({**values, "track": "track.csv"}).replace("None", "null"))
    radar = Radar.from_yaml(tmp_path / "radar.yaml")
    expected = RadarTrack.of_angles([0, 0.5], [(0, 0, 1), (0.5, 0, 1)], [(0, 0, 0), (10, 5, 0)])
    assert radar.track == RadarTrack.read(tmp_path / "track.npz") == expected
    radar.to_yaml(tmp_path / "again.yaml")
    assert Radar.from_yaml(tmp_path / "again.yaml") == radar
    recording = t2d.simulate(ball((3.0, 0.0, 1.0)), radar=radar)
    recording.save(tmp_path / "found.zarr")
    again = t2d.run(t2d.Recording.load(tmp_path / "found.zarr"))
    assert np.array_equal(again.cube, recording.cube)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("t,x,y\n0,1,2\n1,1,2", "needs t, x, y, z"),
        ("t,x,y,z\n0,1,2,3\n1,1,2", "as many numbers"),
        ("t,x,y,z\n0,1,2,3\n0,1,2,3", "increasing"),
        ("t,x,y,z\n0,1,2,nan\n1,1,2,3", "finite"),
        ("", "needs t, x, y, z"),
        ("t,x,y,z,vx\n0,1,2,3,4\n1,1,2,3,4", "no others, got t, x, y, z, vx"),
        ("t,x,y,z\n0,1,2,3", "radar track key times_s"),
        ("t,t,x,y,z\n0,0,1,2,3\n1,1,1,2,3", "each column once"),
    ],
)
def test_tracks_that_are_none(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "track.csv").write_text(text)
    with pytest.raises(InputError, match=told):
        RadarTrack.read(tmp_path / "track.csv")


@pytest.mark.parametrize(
    "text",
    [
        "\ufeffT;X;Y;Z\n0;0,5;2;3\n1;1;2;3\n;;;\n",
        '"t","x","y","z",\n0,.5,2,3,\n1,1,2,3,\n',
        "t\tx\ty\tz\n0\t0,5\t2\t3\n1\t1\t2\t3\n",
        "z\ty\tx\tt\n3\t2\t.5\t0\n3\t2\t1\t1\n",
    ],
)
def test_tracks_of_spreadsheets(tmp_path: Path, text: str) -> None:
    (tmp_path / "track.csv").write_text(text, encoding="utf-8")
    assert RadarTrack.read(tmp_path / "track.csv") == RadarTrack(times_s=[0, 1], positions_m=[(0.5, 2, 3), (1, 2, 3)])


def test_arrays_that_are_no_track(tmp_path: Path) -> None:
    path, columns = tmp_path / "track.npz", dict.fromkeys("txyz", np.arange(50.0))
    np.savez(path, **columns)
    whole = path.read_bytes()
    assert len(RadarTrack.read(path).times_s) == 50
    broken = bytearray(whole)
    broken[200] ^= 1  # a value of t, so that its checksum is wrong
    for data in (whole[: len(whole) // 2], broken, b"PK", b""):
        path.write_bytes(data)
        with pytest.raises(InputError, match="cut short, damaged"):
            RadarTrack.read(path)
    with path.open("wb") as file:
        np.save(file, np.zeros((5, 4)))
    with pytest.raises(InputError, match=r"no \.npz file"):
        RadarTrack.read(path)
    np.savez(path, **{**columns, "x": columns["x"] + 1j})
    with pytest.raises(InputError, match="real numbers"):
        RadarTrack.read(path)


@pytest.mark.parametrize("angles", [[(0, 0), (1, 0)], "north", (0, 0, 0), [(0, 0, 0)], [], None, [(0, 0, 0), (0, 0)]])
def test_angles_that_are_none(angles: object) -> None:
    with pytest.raises(InputError):
        RadarTrack.of_angles([0, 1], [(0, 0, 1), (1, 0, 1)], angles)


def test_a_track_that_begins_late_is_told() -> None:
    target = ball((3.0, 0.0, 1.0))
    begin_s, end_s = target.times_s[0], target.times_s[-1]
    late = TABLE2.replace(track=RadarTrack(times_s=[begin_s + 0.02, end_s], positions_m=[(0, 0, 1), (0.1, 0, 1)]))
    with pytest.warns(T2DWarning, match=r"begins with the radar's track at 0\.02 s, and the targets at 0 s"):
        t2d.simulate(target, radar=late)
    with pytest.raises(InputError, match=r"begin at one instant, got 0, 0\.02 s"):
        t2d.simulate_radars(target, [TABLE2, late])
    with pytest.warns(T2DWarning, match="begins with"):
        first, second = t2d.simulate_radars(target, [late, late])
    assert np.array_equal(first.cube, second.cube)


def test_what_is_not_modelled_is_refused() -> None:
    radar = TABLE2.replace(track=RadarTrack(times_s=[0, 1], positions_m=[(0, 0, 1), (0.1, 0, 1)]))
    with pytest.raises(InputError, match="position_m of a radar that moves is where its track begins"):
        radar.replace(position_m=(1, 0, 1))
    assert Radar.preset("people-tracking-60", track=radar.track).position_m == (0, 0, 1)
    assert radar.replace(track=None, position_m=(1, 0, 1)).track is None
    late = moving(icosphere(2, 0.1), np.full((3, 3), 2.0), np.array([2.0, 2.5, 3.0]), sagitta_rad=0.3)
    with pytest.raises(InputError, match="no time in common"):
        t2d.simulate(late, radar=radar)
