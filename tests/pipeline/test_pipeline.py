"""`simulate` as a whole: reproducible, additive, placed once, silent where nothing moves, and clear about what it refuses."""

from __future__ import annotations

import math
import warnings
from collections import OrderedDict
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import builders
import t2d_rt as t2d
from builders import icosphere, static_mesh
from measures import nmse_db
from t2d_rt.core.backend import Backend, limited_threads
from t2d_rt.core.errors import BackendError, InputError, T2DWarning
from t2d_rt.geometry import refinements
from t2d_rt.scattering.mesh import Detail, mesh_echoes
from t2d_rt.scattering.paths import PathVisibility
from t2d_rt.types import PEC, Ellipsoids, Material, Motion, MovingMesh, Radar

RADAR = Radar.preset("ci4r", prf_hz=8000)
COARSE: dict[str, Any] = {"radar": RADAR, "accuracy": {"sagitta_rad": 2.0}}
TIMES_S = np.array([0.0, 0.1, 0.2])
ROUGH = Material(name="rough", relative_permittivity=math.inf, scattering_coefficient=0.5)


@pytest.fixture(scope="module")
def walk() -> Motion:
    """0.3 s of a step, not placed yet."""
    return t2d.trim(builders.walk(), 2.3, 2.6)


@pytest.fixture(scope="module")
def recorded(walk: Motion) -> t2d.Recording:
    return t2d.simulate(walk, **COARSE)


def ball(x_m: float, *, y_m: float = 0.0, speed_mps: float = 0.0, material: str | Material = "pec") -> MovingMesh:
    """A sphere ahead that comes nearer."""
    return builders.ball((x_m, y_m, 1.0), (-speed_mps, 0, 0), TIMES_S[-1], level=2, frames=3, material=material)


# --- what comes out -------------------------------------------------------------------------------------------------


def test_recording_holds_its_configuration(recorded: t2d.Recording, walk: Motion) -> None:
    assert recorded.cube.dtype == np.complex64
    assert recorded.cube.shape == (len(RADAR.chirp_times_s(walk.duration_s)), 1, RADAR.samples)
    assert np.isfinite(recorded.cube).all()
    assert recorded.radar == RADAR
    assert recorded.settings["accuracy"]["sagitta_rad"] == 2.0
    assert recorded.settings["targets"] == [t2d.place(walk, radar_position_m=RADAR.position_m).report]
    assert recorded.versions["drjit"] == "1.5.0"


def test_same_seed_same_bits_another_seed_another_speckle(recorded: t2d.Recording, walk: Motion) -> None:
    assert t2d.simulate(walk, **COARSE).cube.tobytes() == recorded.cube.tobytes()
    other = t2d.simulate(walk, **COARSE, seed=1)
    # The coherent part is the same, and at S = 0.3 the larger one.
    assert -30 < nmse_db(other.cube, recorded.cube) < 0


def test_another_seed_changes_only_the_diffuse_points(backend: Backend) -> None:
    def echoes(seed: int, material: Material) -> tuple[np.ndarray, np.ndarray]:
        stream = mesh_echoes(
            ball(2.0), RADAR, times_s=TIMES_S, material=material, detail=Detail(sagitta_rad=0.5), seed=seed,
            views=[PathVisibility()], backend=backend,
        )  # fmt: skip
        return stream.frames(0, len(TIMES_S))[:2]

    assert all(np.array_equal(*pair) for pair in zip(echoes(0, PEC), echoes(1, PEC), strict=True))
    (delay, amplitude), (other_delay, other_amplitude) = echoes(0, ROUGH), echoes(1, ROUGH)
    assert np.array_equal(delay, other_delay)
    assert not np.array_equal(amplitude, other_amplitude)


def test_smooth_targets_have_no_seed() -> None:
    cubes = [t2d.simulate(ball(2.0, speed_mps=1.0), radar=RADAR, seed=seed).cube for seed in (0, 1)]
    assert cubes[0].tobytes() == cubes[1].tobytes()


def test_targets_add_up() -> None:
    near, far = ball(2.0, speed_mps=1.0), ball(3.0, y_m=0.5, speed_mps=-2.0)
    egg = Ellipsoids(np.array([[0.1, 0.1, 0.2]]), np.tile([2.5, -0.5, 1.0], (3, 1, 1)), TIMES_S)
    targets = [near, far, egg]
    alone = sum(t2d.simulate(target, radar=RADAR, accuracy={"occlusion": False}).cube for target in targets)
    together = t2d.simulate(targets, radar=RADAR, accuracy={"occlusion": False})
    assert nmse_db(together.cube, alone) < -60  # each is within -60 dB of the exact sum
    assert len(together.settings["targets"]) == 3


def test_what_stands_in_front_hides_what_is_behind() -> None:
    # Aside and large: right behind its middle the waves of a ball's outline meet in phase (Poisson's spot), and past one of 10 cm
    # the field is 21 dB down, out and back.
    front = builders.ball((2.0, 0.1, 1.0), radius_m=0.4, level=2, frames=3)
    behind = ball(4.0)

    def peak_db(targets: list[MovingMesh], range_m: float) -> float:
        profile = np.abs(t2d.simulate(targets, radar=RADAR).range_profile[0, 0])
        return float(20 * np.log10(profile.sel(range_m=slice(range_m - 0.3, range_m + 0.3)).max()))

    assert peak_db([front, behind], 3.9) < peak_db([front, ball(4.0, y_m=1.0)], 3.9) - 30
    assert peak_db([front, behind], 1.6) == pytest.approx(peak_db([front], 1.6), abs=0.01)


def test_a_placed_motion_stays_where_it_is(walk: Motion) -> None:
    def range_m(motion: Motion) -> float:
        result = t2d.simulate(motion, radar=RADAR, method="ellipsoid")
        return float(np.abs(result.range_profile[0, 0]).idxmax())

    placed = t2d.place(walk, distance_m=4.0, angle_deg=30)
    assert range_m(placed) == pytest.approx(3.9, abs=0.25)  # the chest is before the pelvis
    assert range_m(replace(walk, joints=walk.joints + [6.0, 0, 0] - walk.joints[0, 0] * [1, 1, 0], placed=True)) > 5.6
    first = t2d.simulate(walk, radar=RADAR, method="ellipsoid")
    again = t2d.simulate(t2d.place(walk), radar=RADAR, method="ellipsoid")
    assert first.cube.tobytes() == again.cube.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["mesh", "ellipsoid"])
def test_static_body_stays_at_zero_doppler(walk: Motion, method: Any) -> None:
    placed = t2d.place(walk)
    joints, rotations = (np.repeat(each[:1], 12, axis=0) for each in (placed.joints, placed.rotations))
    static = replace(placed, joints=joints, rotations=rotations, rate_hz=30.0)
    cube = t2d.simulate(static, method=method, **COARSE).cube[:, 0].astype(complex)
    window = np.blackman(len(cube))[:, None]
    power = np.sum(np.abs(np.fft.fft(cube * window, axis=0)) ** 2, axis=1)
    outside = power[3:-2].sum()  # beyond the main lobe of the window
    assert 10 * np.log10(outside / power.sum()) < -80


def test_skin_and_segments_of_the_face() -> None:
    motion = t2d.trim(builders.walk(), 0, 0.2)
    body, parts = t2d.skin(motion), t2d.segments(motion)
    assert isinstance(body, MovingMesh)
    assert isinstance(parts, Ellipsoids)
    assert body.duration_s == parts.duration_s == pytest.approx(motion.duration_s)
    assert body.trimesh(0.1).is_watertight


# --- what is said ---------------------------------------------------------------------------------------------------


def test_warns_of_speeds_and_ranges_that_fold() -> None:
    slow = RADAR.replace(prf_hz=1000)
    with pytest.warns(
        T2DWarning, match=r"top speed 2 m/s of ball exceeds the unambiguous 0.966 m/s .* raise prf_hz to 2070"
    ):
        t2d.simulate(ball(3.0, speed_mps=2.0), radar=slow)
    with pytest.warns(T2DWarning, match=r"ball is up to 60.1 m away, beyond the unambiguous 49.8 m"):
        t2d.simulate(ball(60.0), radar=RADAR)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        t2d.simulate(ball(3.0, speed_mps=2.0), radar=RADAR)


def test_progress_reaches_one() -> None:
    fractions: list[float] = []
    t2d.simulate(ball(2.0), radar=RADAR, progress=fractions.append)
    assert fractions[-1] == 1
    assert fractions == sorted(fractions)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"scene": "moon"}, "unknown scene 'moon'; choose one of free_space, bedroom"),
        ({"method": "magic"}, "method must be 'mesh' or 'ellipsoid', got 'magic'"),
        ({"method": "ellipsoid"}, "method 'ellipsoid' needs a Motion or Ellipsoids, got the mesh ball"),
        ({"seed": -1}, "seed must be an integer of 0 or more, got -1"),
        ({"seed": 0.5}, "seed must be an integer of 0 or more, got 0.5"),
        ({"seed": 2.0}, "seed must be an integer of 0 or more, got 2.0"),
        ({"bounces": "2"}, "bounces must be an integer of 0 or more, got '2'"),
        (
            {"accuracy": {"surface_rate_hz": 5}},
            "accuracy key surface_rate_hz: got 5, should be greater than or equal to 10",
        ),
        ({"accuracy": {"surface_rate_hz": math.nan}}, "surface_rate_hz: got nan, should be a finite number"),
        ({"accuracy": {"visibility_rate_hz": 0}}, "visibility_rate_hz: got 0, should be greater than or equal to 1"),
        ({"accuracy": {"sagitta_rad": 0.0}}, "sagitta_rad: got 0.0, should be greater than or equal to 0.01"),
        ({"material": "cheese"}, "unknown material 'cheese'"),
        ({"device": "tpu"}, "device must be auto, cpu or gpu, got 'tpu'"),
    ],
)
def test_options_that_cannot_be_used(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        t2d.simulate(ball(2.0), **{"radar": RADAR, **options})


def test_radar_inside_a_target() -> None:
    with pytest.raises(
        InputError, match=r"radar at \(0, 0, 1\) m is inside ball at 0 s; place the target farther away"
    ):
        t2d.simulate(ball(0.0), radar=RADAR)
    with pytest.raises(InputError, match=r"is inside ball at 0\.0583 s"):
        t2d.simulate(ball(0.15, speed_mps=1.0), radar=RADAR)
    with pytest.raises(InputError, match=r"radar at \(2, 0, 1\) m is inside ball"):
        t2d.simulate(ball(2.0), radar=RADAR.replace(rx_offsets_m=(2.0, 0, 0)))
    egg = Ellipsoids(np.array([[0.1, 0.1, 0.2]]), np.tile([0.05, 0, 1.15], (3, 1, 1)), TIMES_S, names=["egg"])
    with pytest.raises(InputError, match=r"radar at \(0, 0, 1\) m is inside egg at 0 s"):
        t2d.simulate(egg, radar=RADAR)


def test_targets_without_common_time() -> None:
    early = ball(2.0)
    late = MovingMesh(early.vertices, early.faces, early.times_s + 5)
    with pytest.raises(InputError, match="the targets have no time in common"):
        t2d.simulate([ball(2.0), late], radar=RADAR)


def test_a_motion_that_goes_on_after_the_record_is_told(walk: Motion) -> None:
    short = t2d.trim(walk, 0.0, 0.1)
    egg = Ellipsoids(np.array([[0.1, 0.1, 0.2]]), np.tile([2.0, 0, 1], (3, 1, 1)), TIMES_S, names=["egg"])
    for targets, ends, cut in (
        (
            [walk, short],
            r"target 2 \(12_01_walk.bvh\) at 0.1 s",
            r"0.3 s of target 1 \(12_01_walk.bvh\) the last 0.2 s",
        ),
        (
            [short, walk],
            r"target 1 \(12_01_walk.bvh\) at 0.1 s",
            r"0.3 s of target 2 \(12_01_walk.bvh\) the last 0.2 s",
        ),
        (
            [egg, walk],
            r"target 1 \(the body of ellipsoids\) at 0.2 s",
            r"0.3 s of target 2 \(12_01_walk.bvh\) the last 0.1 s",
        ),
    ):
        with pytest.warns(T2DWarning, match=f"the record ends with {ends}, and of the {cut} are left out") as told:
            t2d.simulate(targets, radar=RADAR, method="ellipsoid", accuracy={"occlusion": False})
        assert told[0].filename == __file__  # the user's line
    t2d.simulate(
        [egg, short, t2d.trim(walk, 0.0, 0.13)], radar=RADAR, method="ellipsoid", accuracy={"occlusion": False}
    )


def test_no_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("t2d_rt.core.backend._has_cuda", lambda: False)
    with pytest.raises(BackendError, match="no CUDA device was found; use device cpu"):
        t2d.simulate(ball(2.0), radar=RADAR, device="gpu")


@pytest.mark.parametrize(
    ("target", "options", "sentence"),
    [
        (None, {}, "target must be a Motion"),
        ([], {}, "target must be a Motion"),
        (3, {}, "load_motion reads a file"),
        (ball(2.0), {"radar": 2}, "radar must be a Radar, got 2"),
        (ball(2.0), {"accuracy": {"surface_rate_hz": "fast"}}, "surface_rate_hz: got 'fast', should be a valid number"),
        (ball(2.0), {"material": 3}, "material must be a name, a Material or an Outfit, got 3"),
        (ball(2.0), {"material": "skinn"}, "unknown material .skinn.; did you mean skin"),
        (ball(2.0), {"phase_from": "foo"}, "phase_from must be 'specular' or 'centre'"),
    ],
)
def test_wrong_kinds_are_named(target: Any, options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        t2d.simulate(target, **{"radar": RADAR, **options})


def test_targets_between_the_antennas_are_refused() -> None:
    egg = Ellipsoids(np.array([[0.1, 0.1, 0.2]]), np.tile([3.0, 0, 1.0], (3, 1, 1)), TIMES_S)
    with pytest.raises(InputError, match="lies between transmitter and receiver, which it sees 180 degrees apart"):
        t2d.simulate(egg, radar=RADAR.replace(rx_offsets_m=(6.0, 0, 0)), method="ellipsoid")
    apart = RADAR.replace(tx_offsets_m=(0, 2.0, 0), rx_offsets_m=(0, -2.0, 0))  # 106 and 126 degrees at 1.5 and 1 m
    with pytest.raises(
        InputError, match=r"ball lies between transmitter and receiver, which it sees 1[23]\d degrees apart"
    ):
        t2d.simulate(ball(1.0), radar=apart)
    t2d.simulate(ball(1.5), radar=apart)
    # A dash through the middle, 20 ms long and out of sight before and after.
    times_s = np.linspace(0, 4, 801)
    aside = np.where(np.abs(times_s - 2.041) < 0.01, 0.0, 8.0)
    dash = Ellipsoids(
        np.array([[0.1, 0.1, 0.2]]), np.stack([3 + aside, aside, 1 + 0 * aside], axis=-1)[:, None], times_s
    )
    with pytest.raises(InputError, match=r"at 2\.04 s .* lies between transmitter and receiver"):
        t2d.simulate(dash, radar=RADAR.replace(rx_offsets_m=(6.0, 0, 0)), method="ellipsoid")


def test_a_path_pair_that_sees_a_target_from_opposite_sides_is_told_of_antennas_apart() -> None:
    """Over both walls beside the target: of a radar in one place they are not told, nor where they are left out."""
    room = t2d.Room(size_m=(8.0, 6.0, 2.5), walls={"material": "metal", "thickness_m": 0.002})
    egg = Ellipsoids(np.array([[0.1, 0.1, 0.2]]), np.tile([2.0, 0, 1.0], (3, 1, 1)), TIMES_S)
    options: dict[str, Any] = {"scene": room, "method": "ellipsoid", "measure_error": False}
    apart = RADAR.replace(tx_offsets_m=(0, 2.0, 0), rx_offsets_m=(0, -2.0, 0))
    with pytest.warns(
        T2DWarning, match=r"over the path pair '.*wall.*', -\d+ dB from the .* 1[23]\d degrees apart"
    ) as told:
        t2d.simulate(egg, radar=apart, **options)
    names = [str(each.message).split("'")[1] for each in told]
    t2d.simulate(egg, radar=apart, without_paths=names, **options)
    t2d.simulate(egg, radar=RADAR, **options)


def test_a_facet_that_rotates_too_fast_is_reported() -> None:
    times_s = np.linspace(0, 0.2, 41)
    angle, y, z = 20 * times_s, np.array([-0.2, 0.2, 0.2, -0.2]), np.array([-0.2, -0.2, 0.2, 0.2])
    vertices = np.stack([np.outer(np.sin(angle), y), np.outer(np.cos(angle), y), np.tile(z, (41, 1))], axis=2)
    faces = np.array([[0, 2, 1], [0, 3, 2]])
    with pytest.warns(T2DWarning, match="not watertight"):
        plate = MovingMesh(vertices + [40, 0, 1], faces, times_s, "pec", crease_deg=0, sagitta_rad=2)
    with pytest.warns(T2DWarning, match="rotates too fast for its facets"):
        t2d.simulate(plate, radar=RADAR, accuracy={"occlusion": False, "surface_rate_hz": 50})


@pytest.mark.slow
def test_a_body_is_refined_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def counted(*args: Any, **options: Any) -> Any:
        calls.append(options["range_m"])
        return refinements(*args, **options)

    monkeypatch.setattr("t2d_rt.scattering.refinement.refinements", counted)
    monkeypatch.setattr("t2d_rt.scattering.refinement._by_key", OrderedDict())
    rest, faces = icosphere(2, 0.1)

    def at(range_m: float) -> np.ndarray:
        vertices = rest + [range_m, 0, 1]
        # Tracks may give float32.
        mesh = MovingMesh.from_track(
            lambda times: np.repeat(vertices[None], len(times), axis=0).astype(np.float32), faces, [0.0, 0.1], "pec",
            rest=rest,
        )  # fmt: skip
        return np.asarray(t2d.simulate(mesh).cube)

    first, again, far = at(2.3), at(2.3), at(9.0)
    np.testing.assert_array_equal(first, again)
    assert calls == pytest.approx([1.25**3, 1.25**9])
    assert np.abs(far).max() < np.abs(first).max() / 10


@pytest.mark.slow
def test_a_float32_track_is_a_track() -> None:
    vertices, faces = icosphere(1, 0.1, (2, 0, 1))
    vertices = vertices.astype(np.float32)
    mesh = MovingMesh.from_track(lambda times: np.repeat(vertices[None], len(times), axis=0), faces, [0.0, 0.1], "pec")
    assert mesh.rest.dtype == np.float64
    doubles = static_mesh(vertices.astype(np.float64), faces, 0.1)
    # The vertices are the same numbers; only what is worked out from them is rounded to float32.
    assert nmse_db(t2d.simulate(mesh).cube, t2d.simulate(doubles).cube) < -100


@pytest.mark.slow
def test_rooms_are_the_same_bits_on_any_number_of_threads(walk: Motion) -> None:
    """Facets of two tiers and ellipsoids, made side by side in threads, and blockage of paths in chunks."""

    def run() -> np.ndarray:
        piece = t2d.trim(walk, 0.0, 0.05)
        recording = t2d.simulate(piece, radar=RADAR, scene="empty_room", collisions="ignore", device="cpu")
        return np.asarray(recording.adc)

    with limited_threads(1):
        alone = run()
    assert np.array_equal(run(), alone)
