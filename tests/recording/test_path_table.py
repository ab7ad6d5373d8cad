"""Paths and truth beside a recording: tables against closed forms and geometry worked out anew."""

from __future__ import annotations

import numpy as np
import pytest
from trimesh.creation import box

import t2d_rt as t2d
from builders import ball, icosphere, moving, slow_after, static_mesh, walk
from t2d_rt.core.backend import select
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.errors import InputError
from t2d_rt.core.resources import resource
from t2d_rt.experiment.setup import set_up, set_up_again
from t2d_rt.motion.contacts import contacts
from t2d_rt.motion.kinematics import poses_of
from t2d_rt.propagation.edges import SceneBlockage
from t2d_rt.propagation.rays import mitsuba
from t2d_rt.recording.path_table import path_table
from t2d_rt.recording.truth import projected_areas, truth_table
from t2d_rt.types import OneWayPath

SPEED_MPS = np.array([-2.0, 0.5, 0.0])


def elsewhere(radar: t2d.Radar, point: np.ndarray) -> np.ndarray:
    """A point of the world as the radar has it: forward, left, up."""
    return np.asarray((point - np.asarray(radar.position_m)) @ radar.axes.T)


@pytest.fixture(scope="module")
def in_room() -> t2d.Recording:
    """A person and a fan in the empty room, before a radar that looks a little to the left."""
    radar = t2d.Radar.preset("ci4r", position_m=(0.5, 0.2, 1.2), boresight=(1.0, 0.1, 0.0))
    fan = t2d.TableFan(position_m=(2.5, 0.8, 1.0), rpm=60)
    return t2d.simulate(
        [t2d.trim(walk(), 0, 0.3), fan], radar=radar, scene="empty_room", method="ellipsoid", clutter="none"
    )


def test_the_direct_path_in_free_space_is_the_radar_equation() -> None:
    radar = t2d.Radar.preset("table2", rx_offsets_m=[[0.0, 0.3, 0.0]])
    recording = t2d.simulate(ball((4.0, 0.3, 1.2), SPEED_MPS, 0.1), radar=radar)
    paths = recording.paths
    assert dict(paths.sizes) == {"target": 1, "pair": 1, "time_s": 3, "point": 3, "xyz": 3}
    assert (paths.pair.values.tolist(), paths.meets.values.tolist()) == (["direct"], [["radar", "target", "radar"]])
    assert paths.target.values.tolist() == ["ball"]
    direct = paths.isel(target=0, pair=0)
    centre = np.array([4.0, 0.3, 1.2]) + SPEED_MPS * paths.time_s.values[:, None]
    ends = [centre - place for place in (radar.tx_position_m, radar.rx_position_m)]
    lengths = [np.linalg.norm(each, axis=1) for each in ends]
    np.testing.assert_allclose(direct.length_m, sum(lengths), rtol=1e-9)
    np.testing.assert_allclose(direct.delay_s, sum(lengths) / SPEED_OF_LIGHT, rtol=1e-9)
    speed = -0.5 * sum(each @ SPEED_MPS / length for each, length in zip(ends, lengths, strict=True))
    np.testing.assert_allclose(direct.speed_mps, speed, rtol=1e-5)
    # Reflected in the plane between both antennas, the polarisation is as it was but for a part in a thousand.
    power = radar.received_power_w(1.0, *lengths)
    np.testing.assert_allclose(direct.level_dbm, 10 * np.log10(power) + 30, atol=0.03)
    for name, each in zip(("departure", "arrival"), ends, strict=True):
        ahead, left, up = each.T
        np.testing.assert_allclose(direct[f"{name}_azimuth_rad"], np.arctan2(left, ahead), atol=1e-9)
        np.testing.assert_allclose(
            direct[f"{name}_elevation_rad"], np.arcsin(up / np.linalg.norm(each, axis=1)), atol=1e-9
        )
    assert (direct.blocked == 0).all()
    np.testing.assert_allclose(direct.points_m[:, 1], centre, atol=1e-9)


def test_paths_of_a_room_are_as_long_as_their_points_say(in_room: t2d.Recording) -> None:
    paths = in_room.paths_at([0.0, 0.11, 0.3])
    assert paths.pair.values.tolist() == in_room.settings["pairs"]
    assert paths.target.values.tolist() == ["adult", "fan"]
    there = paths.blocked.values < 1
    assert there.any(axis=(0, 2)).sum() > 20
    assert np.isnan(paths.delay_s.values[~there]).all()
    assert np.isneginf(paths.level_dbm.values[~there]).all()
    points = paths.points_m.values
    steps = np.nansum(np.linalg.norm(np.diff(points, axis=3), axis=-1), axis=-1)
    np.testing.assert_allclose(steps[there], paths.length_m.values[there], rtol=1e-9)
    np.testing.assert_allclose(paths.delay_s.values[there], paths.length_m.values[there] / SPEED_OF_LIGHT, rtol=1e-12)
    names = [[name for name in row if name] for row in paths.meets.values.tolist()]
    for number, (row, pair) in enumerate(zip(names, paths.pair.values.tolist(), strict=True)):
        out, back = (each.split(" > ") if each != "direct" else [] for each in (pair.split(", ") * 2)[:2])
        assert row == ["radar", *out, "target", *back[::-1], "radar"]
        assert int(paths.reflections[number]) == len(row) - 3
        here = points[:, number][there[:, number]]
        assert np.isfinite(here[:, : len(row)]).all()
        assert np.isnan(here[:, len(row) :]).all()
        for place, name in enumerate(row):
            heights = {"floor": 0.0, "ceiling": 2.6}
            if name in heights:
                np.testing.assert_allclose(here[:, place, 2], heights[name], atol=1e-9)
        # Directions are those of the polyline's first and last piece.
        for end, ahead in (
            ("departure", here[:, 1] - here[:, 0]),
            ("arrival", here[:, -1 - points.shape[3] + len(row) - 1] - here[:, len(row) - 1]),
        ):
            forward, left, up = (ahead @ in_room.radar.axes.T).T
            for word, angle in (
                ("azimuth", np.arctan2(left, forward)),
                ("elevation", np.arctan2(up, np.hypot(forward, left))),
            ):
                found = paths[f"{end}_{word}_rad"].values[:, number][there[:, number]]
                np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * angle), atol=1e-7)


def test_the_table_is_that_of_sionnas_solver() -> None:
    """Delays, directions and levels of all pairs within 60 dB of the strongest, to points in the living room."""
    mitsuba(select("cpu"))
    import sionna.rt as rt

    radar = t2d.Radar.preset("table2")
    theirs = rt.load_scene(str(resource("scenes", "living_room") / "living_room.xml"), merge_shapes=False)
    theirs.frequency = radar.mid_frequency_hz
    theirs.tx_array = rt.PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="V")
    theirs.rx_array = rt.PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="VH")
    theirs.add(rt.Transmitter(name="tx", position=radar.tx_position_m.tolist()))
    theirs.add(rt.Receiver(name="rx", position=[3.0, 0.0, 1.0]))
    compared = 0
    for point in np.random.default_rng(1).uniform((1.5, -1.0, 0.5), (3.5, 1.0, 1.8), (2, 3)):
        theirs.get("rx").position = point.tolist()
        solved = rt.PathSolver()(theirs, max_depth=2, refraction=False, seed=1)
        there = np.array(solved.valid).ravel()
        field = (np.array(solved.a[0]) + 1j * np.array(solved.a[1])).reshape(2, -1)[:, there]
        tau, arriving, around, leaving, round_m = (
            np.array(each).reshape(-1, len(there))[0][there].astype(float)
            for each in (solved.tau, solved.theta_r, solved.phi_r, solved.theta_t, solved.phi_t)
        )
        # Where a path comes from at the point, and its field there, of unit antennas: across the ray.
        down, aside = _spherical(arriving, around)
        waves = (field[0] * down + field[1] * aside) * (4 * np.pi * tau * SPEED_OF_LIGHT / radar.wavelength_m)
        from_there = np.cross(down, aside, axis=0)
        sphere = t2d.Ellipsoids([[0.05] * 3], np.tile(point, (3, 1, 1)), np.linspace(0, 0.02, 3), material="pec")
        model = set_up([sphere], "living_room", t2d.Experiment.without_targets(radar)).model
        paths = path_table(model, t2d.Accuracy(), np.zeros(1)).isel(target=0, time_s=0)
        limit = float(paths.level_dbm.max()) - 60
        for pair in paths.pair[(paths.level_dbm.values > limit) & (paths.blocked.values < 1e-6)].values.tolist():
            row = paths.sel(pair=pair)
            ends = []
            for end in ("departure", "arrival"):
                angles = float(row[f"{end}_azimuth_rad"]), float(row[f"{end}_elevation_rad"])
                apart = np.abs(np.exp(1j * round_m) - np.exp(1j * angles[0])) * np.sin(leaving) + np.abs(
                    np.pi / 2 - leaving - angles[1]
                )
                ends.append(np.flatnonzero(apart < 1e-3))
            both = [(i, j) for i in ends[0] for j in ends[1] if abs(tau[i] + tau[j] - float(row.delay_s)) < 2e-14]
            assert both, pair
            levels = []
            for i, j in both:
                # A facet whose normal bisects both rays turns the polarisation as a mirror does.
                normal = from_there[:, i] + from_there[:, j]
                normal /= np.linalg.norm(normal)
                out, back = waves[:, i], waves[:, j]
                kept = out @ back - 2 * (normal @ out) * (normal @ back)
                power = radar.received_power_w(1.0, SPEED_OF_LIGHT * tau[i], SPEED_OF_LIGHT * tau[j])
                levels.append(20 * np.log10(np.abs(kept) * int(row.copies)) + 10 * np.log10(power) + 30)
            assert np.abs(np.array(levels) - float(row.level_dbm)).min() < 0.02, pair
            compared += 1
    assert compared > 60


def _spherical(theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors of theta and phi (3, N)."""
    down = np.array([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), -np.sin(theta)])
    return down, np.array([-np.sin(phi), np.cos(phi), 0 * phi])


def test_blockage_of_a_one_way_path_is_worked_out_once(in_room: t2d.Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    model = set_up_again(in_room.experiment, in_room.inputs).model
    asked: list[object] = []
    fraction = SceneBlockage.fraction

    def counted(blockage: SceneBlockage, path: OneWayPath, *of: np.ndarray) -> np.ndarray:
        asked.append(path.key)
        return fraction(blockage, path, *of)

    monkeypatch.setattr(SceneBlockage, "fraction", counted)
    path_table(model, t2d.Accuracy(), np.zeros(1))
    assert len(asked) == len(set(asked)) > 5


def test_areas_that_two_antennas_see_are_areas() -> None:
    """Right triangles of 1 and 4 m^2 that face two antennas, one of them aslant, and a third that shows its back."""
    small = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.0]])
    corners = np.stack([small, 2 * small, small[::-1]])
    ahead, aslant = np.array([1e6, 0.0, 0.0]), np.array([0.5e6, np.sqrt(0.75) * 1e6, 0.0])
    for places, seen in (([ahead], 1.0), ([ahead, ahead], 1.0), ([ahead, aslant], np.sqrt(0.5))):
        np.testing.assert_allclose(projected_areas(corners, places), [2 * seen, 8 * seen, 0.0], rtol=1e-5)


def test_speeds_are_those_at_which_paths_get_shorter(in_room: t2d.Recording) -> None:
    paths = in_room.paths_at(np.array([0.1, 0.15, 0.2]))
    closer = -0.5 * np.diff(paths.length_m.values[..., [0, 2]], axis=-1)[..., 0] / 0.1
    person, fan = paths.speed_mps.values[..., 1]
    assert np.nanmax(np.abs(person - closer[0])) < 0.02 < np.nanmax(person)
    assert np.nanmax(np.abs(fan)) < 1e-3


def test_truth_of_a_person_and_a_fan(in_room: t2d.Recording) -> None:
    truth = in_room.truth
    assert truth.target.values.tolist() == ["adult", "fan"]
    assert truth.person.values.tolist() == ["adult"]
    assert truth.made_for.values.tolist() == [""]
    assert truth.time_s.values == pytest.approx(np.arange(16) / 50)
    motion = in_room.experiment.targets_from(in_room.inputs)[0]  # type: ignore[union-attr]
    assert isinstance(motion, t2d.Motion)
    frame = round(0.2 * motion.rate_hz)
    at = in_room.truth_at(frame / motion.rate_hz).isel(time_s=0)
    for name in ("pelvis", "left_wrist", "right_ankle"):
        expected = elsewhere(in_room.radar, motion.joints[frame, motion.index(name)])
        np.testing.assert_allclose(at.joints_m.sel(person="adult", joint=name), expected, atol=1e-6)
    fan = elsewhere(in_room.radar, np.array([2.5, 0.8, 1.0]))
    assert float(at.range_m.sel(target="fan")) == pytest.approx(np.linalg.norm(fan), abs=0.1)
    assert float(at.azimuth_rad.sel(target="fan")) == pytest.approx(np.arctan2(fan[1], fan[0]), abs=0.05)
    limbs = t2d.segments(motion).at(np.array([frame / motion.rate_hz]))[0][0]
    assert truth.segment.values.tolist() == list(t2d.segments(motion).names)
    own = elsewhere(in_room.radar, limbs)
    np.testing.assert_allclose(at.segment_range_m[0], np.linalg.norm(own, axis=1), atol=1e-6)
    np.testing.assert_allclose(at.segment_azimuth_rad[0], np.arctan2(own[:, 1], own[:, 0]), atol=1e-9)
    later = in_room.truth_at([0.1, 0.101])
    closer = -np.diff(later.segment_range_m.values[0], axis=0)[0] / 1e-3
    np.testing.assert_allclose(closer, later.segment_speed_mps.values[0].mean(axis=0), atol=1e-3)
    stands = contacts(poses_of(motion))
    assert stands.any()
    assert not stands.all()
    frames = np.rint(truth.time_s.values * motion.rate_hz).astype(int)
    assert np.array_equal(truth.contact.values[0], stands[frames])


def test_a_segment_is_visible_as_far_as_nothing_stands_before_it(in_room: t2d.Recording) -> None:
    """A plate hides the legs: its edge is the height at which segments begin to be seen."""
    motion = t2d.place(t2d.trim(walk(), 0, 0.1), distance_m=3.0)
    shade = box(bounds=[[1.5, -1.0, 0.0], [1.51, 1.0, 0.92]])
    screen = static_mesh(np.array(shade.vertices), np.array(shade.faces), 0.1, name="screen")
    free, hidden = (
        truth_table(
            set_up(targets, "free_space", t2d.Experiment.without_targets("ci4r")).model, t2d.Accuracy(), np.array([0.05])
        ).isel(time_s=0, person=0)
        for targets in ([motion], [motion, screen])
    )  # fmt: skip
    # Seen from 1 m, the edge stands at 0.84 m where the person walks.
    names = [f"{side}_{limb}" for side in ("left", "right") for limb in ("shank", "foot")]
    assert (hidden.segment_visible.sel(segment=names) < 0.01).all()
    above = ["head", "neck", "chest"]
    np.testing.assert_allclose(
        hidden.segment_visible.sel(segment=above), free.segment_visible.sel(segment=above), atol=1e-6
    )
    assert (free.segment_visible.sel(segment=above) > 0.9).all()
    assert (free.segment_visible > 0.3).all()


@pytest.mark.filterwarnings("ignore:top speed")
def test_what_is_seen_in_a_record_that_begins_late_is_of_the_instant_asked_for() -> None:
    """A shade rises before a person; a ball far away that begins at 0.05 s makes the record begin then."""
    motion, times_s = t2d.place(t2d.trim(walk(), 0, 0.1), distance_m=3.0), np.array([0.0, 0.05, 0.1])
    shade, shot = box(bounds=[[1.5, -1.0, -2.0], [1.51, 1.0, 0.0]]), icosphere(1, 0.1)
    screen = moving((np.array(shade.vertices), np.array(shade.faces)), np.outer(times_s, [0, 0, 15.0]), times_s)
    seen = []
    for first_s, asked_s in ((0.0, [0.03, 0.08]), (0.05, [0.03])):
        some_s = times_s[times_s >= first_s]
        far = moving(shot, np.tile([30.0, 20.0, 1.0], (len(some_s), 1)), some_s)
        model = set_up([motion, screen, far], "free_space", t2d.Experiment.without_targets("ci4r")).model
        seen.append(truth_table(model, t2d.Accuracy(), np.array(asked_s)).segment_visible[0].values)
    np.testing.assert_allclose(seen[1][0], seen[0][1], atol=1e-6)
    assert np.ptp(seen[0], axis=0).max() > 0.9


def test_meshes_without_joints_are_no_persons() -> None:
    recording = t2d.simulate([ball((3.0, 0.0, 1.0)), ball((4.0, 0.5, 1.0))], radar="ci4r")
    truth, paths = recording.truth, recording.paths
    assert (truth.sizes["person"], truth.joints_m.size) == (0, 0)
    assert truth.target.values.tolist() == paths.target.values.tolist() == ["ball", "ball 2"]
    assert float(truth.range_m.sel(target="ball 2")[0]) == pytest.approx(np.hypot(4, 0.5))


def test_a_skin_of_the_user_is_a_person() -> None:
    motion = t2d.place(t2d.trim(walk(), 0, 0.1), distance_m=3.0)
    truth = t2d.simulate(t2d.segments(motion), radar="ci4r").truth_at(0.0)
    assert truth.person.values.tolist() == ["ellipsoids"]
    np.testing.assert_allclose(truth.joints_m[0, 0, 0], motion.joints[0, 0] - [0.0, 0.0, 1.0], atol=1e-6)


def test_what_has_no_experiment_has_no_paths() -> None:
    radar = t2d.Radar.preset("ci4r")
    measured = t2d.Recording(np.ones((4, 1, radar.samples), np.complex64), radar)
    with pytest.raises(InputError, match="the recording was measured: it has no experiment"):
        _ = measured.paths
    with pytest.raises(InputError, match="the recording was measured: it has no experiment"):
        _ = measured.truth
    shaped, faces = icosphere(1, 0.1)
    own = t2d.MovingMesh.from_track(
        lambda t: np.repeat((shaped + [3.0, 0, 1])[None], len(t), 0), faces, np.linspace(0, 0.1, 3)
    )
    with pytest.raises(InputError, match="computed by a function, which is not stored"):
        _ = t2d.simulate(own, radar="ci4r").truth


@pytest.mark.parametrize("times_s", slow_after(2, [[0.0, 0.4], -0.1, [], [[0.1]], "now", [np.nan]]))
def test_times_outside_the_record_are_refused(in_room: t2d.Recording, times_s: object) -> None:
    for table in (in_room.paths_at, in_room.truth_at):
        with pytest.raises(InputError, match="times_s"):
            table(times_s)
