"""Paths through thin slabs: against Sionna RT's path solver, closed forms of a sphere behind a partition, and their cost."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from builders import ANTENNA_M, UP, ball, plate, slow_after
from t2d_rt.cli import _command
from t2d_rt.core.backend import select
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError
from t2d_rt.core.resources import resource
from t2d_rt.propagation.images import vertices
from t2d_rt.propagation.materials import itu_material
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.propagation.paths import find_paths
from t2d_rt.propagation.rays import mitsuba
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.scene import Room
from t2d_rt.types import Ellipsoids, Material, MovingMesh, Radar, Scene
from t2d_rt.types.path_fields import field_over, transmission

FREQUENCY_HZ = 77.87e9


def partition(material: str | Material = "plasterboard", thickness_m: float = 0.0125, x: float = 2.0) -> Scene:
    """One large slab across the boresight."""
    wall = plate("wall", [(x, -4, -3), (x, 4, -3), (x, 4, 5), (x, -4, 5)], material, thickness_m)
    return Scene(name="partition", surfaces=(wall,))


# --- paths of points, against another tool ---


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "place", "paths"), [("empty_room", (3.0, 4.2, 1.2), 7), ("living_room", (7.8, -4.0, 1.1), 9)]
)
def test_paths_through_walls_are_those_of_sionna(scene: str, place: tuple[float, float, float], paths: int) -> None:
    """Behind a partition, and behind a closed door: all within 60 dB of the strongest, with delays, amplitudes and phases."""
    mitsuba(select("cpu"))
    import sionna.rt as rt

    theirs = rt.load_scene(str(resource("scenes", scene) / f"{scene}.xml"), merge_shapes=False)
    theirs.frequency = FREQUENCY_HZ
    theirs.tx_array = theirs.rx_array = rt.PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="V")
    theirs.add(rt.Transmitter(name="tx", position=ANTENNA_M.tolist()))
    theirs.add(rt.Receiver(name="rx", position=list(place)))
    solved = rt.PathSolver()(theirs, max_depth=3, refraction=True, seed=1)
    fields = np.array(solved.a[0]).ravel() + 1j * np.array(solved.a[1]).ravel()
    transmitted = np.sum(
        np.array(solved.interactions).reshape(3, -1) == rt.constants.InteractionType.REFRACTION, axis=0
    )
    strongest = np.abs(fields).max()
    dominant = (np.abs(fields) > 1e-3 * strongest) & (transmitted <= 1)
    delays, fields = np.array(solved.tau).ravel()[dominant], fields[dominant]

    point, ours = np.array(place), []
    found = find_paths(
        Mirrors.of(load_scene(scene), select("cpu")), ANTENNA_M, UP, FREQUENCY_HZ, order=2, transmissions=1,
        probes_m=point[None],
    )  # fmt: skip
    for path in found.paths:
        length = float(np.linalg.norm(point - path.image_m))
        arriving = (point - path.image_m) / length
        across = UP - (UP @ arriving) * arriving
        received = field_over(path, point, np.array([FREQUENCY_HZ]))[0] @ across / np.linalg.norm(across)
        # Theirs has the slabs' phase whole, ours counts what goes with frequency to the delay.
        received *= np.exp(-2j * np.pi * FREQUENCY_HZ * path.delay_s)
        ours.append((length / SPEED_OF_LIGHT, SPEED_OF_LIGHT / FREQUENCY_HZ / (4 * math.pi * length) * received))
    ours = [each for each in ours if abs(each[1]) > 1e-3 * strongest]
    assert len(ours) == len(delays) >= paths
    for delay, field in ours:
        nearest = np.argmin(np.abs(fields - field) + 1e3 * (np.abs(delays - delay) > 1e-12))
        assert abs(delays[nearest] - delay) < 1e-12
        assert abs(20 * math.log10(abs(field / fields[nearest]))) < 0.1
        assert abs(np.angle(field / fields[nearest], deg=True)) < 5


# --- closed forms ---


def test_a_half_wave_window_lets_all_through() -> None:
    """|T| = 1 of a lossless slab of whole half-waves, and its delay is that of the path in it."""
    half_wave = SPEED_OF_LIGHT / FREQUENCY_HZ / math.sqrt(4.0) / 2
    scene = partition(Material(relative_permittivity=4.0), 3 * half_wave)
    behind = np.array([[4.0, 0.0, 1.0]])
    *_, path = find_paths(
        Mirrors.of(scene, select("cpu")), ANTENNA_M, UP, FREQUENCY_HZ, order=0, transmissions=1, probes_m=behind
    ).paths
    assert (path.name, path.order, path.transmissions) == ("wall (through)", 0, 1)
    np.testing.assert_allclose(vertices(path, behind[0]), [[0, 0, 1], [2, 0, 1], [4, 0, 1]], atol=1e-12)
    assert np.linalg.norm(field_over(path, behind, np.array([FREQUENCY_HZ]))) == pytest.approx(1, abs=1e-9)
    assert path.delay_s == pytest.approx(2 * 3 * half_wave / SPEED_OF_LIGHT)


def moving_ball(method: str) -> MovingMesh | Ellipsoids:
    """A sphere on the boresight, as a mesh or as an ellipsoid."""
    mesh = ball((3.6, 0.0, 1.0), (-1.0, 0.0, 0.0), 0.05)
    if method == "mesh":
        return mesh
    centres = np.array([3.6, 0.0, 1.0]) - mesh.times_s[:, None, None] * [1.0, 0, 0]
    return Ellipsoids(np.full((1, 3), 0.1), centres, mesh.times_s, material="pec")


@pytest.mark.parametrize(
    ("material", "thickness_m", "method"),
    slow_after(1, [("plasterboard", 0.0125, "mesh"), ("wood", 0.04, "mesh"), ("wood", 0.04, "ellipsoid")]),
)
def test_a_sphere_behind_a_partition_has_its_loss_twice(material: str, thickness_m: float, method: str) -> None:
    """Sample by sample: the cube is that of free space times T squared at the sample's frequency; so power is down by |T|^4."""
    radar, target = Radar.preset("table2"), moving_ball(method)
    common: dict[str, Any] = {
        "radar": radar, "clutter": "none", "accuracy": {"occlusion": False}, "reflections": 0, "method": method,
    }  # fmt: skip
    behind = t2d.simulate(target, scene=partition(material, thickness_m), transmissions=2, **common)
    alone = t2d.simulate(target, **common)
    assert behind.settings["pairs"] == ["wall (through)"]
    frequencies = radar.carrier_hz + radar.slope_hz_per_s * radar.sample_times_s
    substance = itu_material(material, radar.mid_frequency_hz)
    transmitted = np.array([transmission(substance, thickness_m, np.array(1.0), f)[0] for f in frequencies])
    expected = alone.adc.values[:, 0] * np.conj(transmitted) ** 2
    error = behind.adc.values[:, 0] - expected
    # Waves that run to and fro within a slab bend T over the sweep, which a slope does not follow.
    assert np.sum(np.abs(error) ** 2) < 1e-4 * np.sum(np.abs(expected) ** 2)
    # In range it stands the slab's optical thickness farther away: within a cell.
    spectra = [np.abs(np.fft.fft(each.adc.values[0, 0] * np.hanning(256), 64 * 256)) for each in (behind, alone)]
    places = [np.argmax(each) / 64 * radar.range_resolution_m for each in spectra]
    optical_m = thickness_m * math.sqrt(substance.relative_permittivity)
    assert places[0] - places[1] == pytest.approx(optical_m, abs=0.03 * radar.range_resolution_m)
    assert optical_m < radar.range_resolution_m


@pytest.mark.slow
def test_what_lets_too_little_through_changes_nothing() -> None:
    """Metal and a concrete wall end a path, so a target before them is recorded as without transmissions, to the last bit."""
    target = ball((1.5, 0.4, 1.1), time_s=0.05)
    for scene in (partition("metal", 0.001), partition("concrete", 0.15)):
        cubes = [t2d.simulate(target, scene=scene, transmissions=most, clutter="none").adc.values for most in (0, 2)]
        assert np.array_equal(*cubes)


def test_out_and_back_may_be_swapped() -> None:
    target, cubes = ball((3.0, 0.3, 1.1), time_s=0.05), []
    sides = ([[0.0, 0.2, 0.0]], [[0.0, -0.2, 0.1]])
    for tx, rx in (sides, sides[::-1]):
        radar = Radar.preset("table2", tx_offsets_m=tx, rx_offsets_m=rx)
        cubes.append(t2d.simulate(target, radar=radar, scene=partition(), transmissions=2, clutter="none").adc.values)
    assert np.sum(np.abs(cubes[1] - cubes[0]) ** 2) < 1e-8 * np.sum(np.abs(cubes[0]) ** 2)


# --- chains ---


def test_a_closed_box_takes_two_passages() -> None:
    room = Room(name="box", size_m=(6, 4, 2.6), furniture=({"kind": "wardrobe", "x_m": 2.5, "y_m": 0},))
    mirrors = Mirrors.of(room.scene(), select("cpu"))
    behind = np.array([[4.0, 0.0, 1.0]])
    through = {"wardrobe -x (through) > wardrobe +x (through)"}
    for most, names in ((0, set()), (1, set()), (2, through)):
        found = find_paths(mirrors, ANTENNA_M, UP, FREQUENCY_HZ, order=0, transmissions=most, probes_m=behind)
        assert {path.name for path in found.paths} == names


def test_rays_pass_slabs_while_they_can_bear_it() -> None:
    """Slabs of 21 dB each can be passed once, not twice, and chains without them are as ever."""
    mirrors = Mirrors.of(load_scene("living_room"), select("cpu"))
    loss_db = np.full(len(mirrors.parts), 21.0)
    once = mirrors.chains(ANTENNA_M, 1, transmissions=2, loss_db=loss_db)
    assert max(sum(k < 0 for k in chain) for chain in once) == 1
    plain = mirrors.chains(ANTENNA_M, 1)
    assert [chain for chain in once if all(k >= 0 for k in chain)] == plain


@pytest.mark.parametrize("most", [-1, 5, 1.5, "many"])
def test_how_many_transmissions_there_may_be(most: object) -> None:
    with pytest.raises(
        InputError, match=r"transmissions must be (an integer of 0 or more|less than or equal to 4), got"
    ):
        t2d.simulate(ball((3, 0, 1), time_s=0.05), scene="empty_room", transmissions=most)  # type: ignore[arg-type]


def test_a_target_behind_a_partition_is_not_seen_without_them() -> None:
    with pytest.raises(InputError, match=r"up to 2 reflections and 0 transmissions; .* or allow more of them"):
        t2d.simulate(ball((3, 0, 1), time_s=0.05), scene=partition())


def test_the_command_line_has_them() -> None:
    parser = _command("simulate").parser
    options = parser.parse_args(["--file=walk.bvh", "--transmissions=2", "--collisions=stop"])
    assert (options.transmissions, options.collisions) == (2, "stop")
    options = parser.parse_args(["--file=walk.bvh"])
    assert (options.transmissions, options.collisions) == (0, "warn")
