"""What people carry: where it is, the arms that hold it, what the radar sees of it, and what is refused."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from t2d_rt.cli import main
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion import track
from t2d_rt.motion.contacts import contacts, runs
from t2d_rt.motion.kinematics import poses_of, stature_m
from t2d_rt.motion.vary import arc
from t2d_rt.pipeline.targets import things
from t2d_rt.scene.movers.solids import MATERIALS as MOULDED
from t2d_rt.scene.things import surface, wheels
from t2d_rt.types import Carried, Motion, MovingMesh, Radar
from t2d_rt.types.material import THING_NAMES

HELD = "bag", "ball", "box", "backpack", "cane", "crutches", "walker"
THINGS = *HELD, "wheelchair"
QUICK = Radar.preset("table2", samples=64, prf_hz=4_000.0)


@cache
def walk() -> Motion:
    return t2d.place(t2d.example("walk"))


@cache
def short() -> Motion:
    return t2d.trim(walk(), 0.5, 0.8)


def frame(
    motion: Motion, joints: np.ndarray | None = None, rotations: np.ndarray | None = None
) -> tuple[np.ndarray, Rotation]:
    """Origin (T, 3) and axes of the first thing, from its joint's place and orientation, at the frames unless given, by SciPy."""
    thing = motion.carries[0]
    k = motion.index(thing.joint)
    joint = Rotation.from_quat((motion.rotations if rotations is None else rotations)[:, k])
    place = (motion.joints if joints is None else joints)[:, k]
    return place + joint.apply(thing.position_m), joint * Rotation.from_quat(thing.rotation)


# --- surfaces ---


@pytest.mark.parametrize("thing", THINGS)
def test_surfaces_are_closed_and_face_outward(thing: str) -> None:
    # A mesh warns, which fails, where it is not watertight, and refuses what is inside out.
    meshes = things(t2d.carry(walk(), thing))
    assert len(meshes) == {"crutches": 2, "wheelchair": 3}.get(thing, 1)
    for mesh in meshes:
        solid = mesh.trimesh(0.3)
        assert solid.is_watertight
        assert solid.is_winding_consistent
        assert all(part.volume > 0 for part in solid.split())


def test_a_box_has_its_size() -> None:
    carried = t2d.carry(short(), {"thing": "box", "size_m": [0.2, 0.3, 0.41]}).carries[0]
    vertices, faces = surface(carried)
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.2, 0.3, 0.41], rtol=1e-12)
    corners = vertices[faces]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    assert area.sum() == pytest.approx(2 * (0.2 * 0.3 + 0.2 * 0.41 + 0.3 * 0.41), rel=1e-12)


# --- arms ---


def test_nothing_is_changed_where_nothing_is_carried() -> None:
    assert t2d.carry(walk(), []) is walk()


@pytest.mark.parametrize("thing", HELD)
def test_the_rest_of_the_body_moves_as_it_did(thing: str) -> None:
    found = t2d.carry(walk(), thing)
    moved = np.abs(found.joints - walk().joints).max(axis=(0, 2)) > 0
    arms = [name.split("_")[-1] in ("elbow", "wrist", "hand") for name in found.names]
    assert not moved[~np.array(arms)].any()
    assert moved.any() == (thing not in ("ball", "backpack"))


@pytest.mark.parametrize("thing", THINGS)
def test_bones_keep_their_lengths(thing: str) -> None:
    found = t2d.carry(walk(), thing)
    for side in ("left", "right"):
        for upper, lower in (("shoulder", "elbow"), ("elbow", "wrist")):
            first, second = (found.joints[:, found.index(f"{side}_{name}")] for name in (upper, lower))
            # 1e-3: the file's own bones change by as much
            np.testing.assert_allclose(
                np.linalg.norm(second - first, axis=1), poses_of(walk()).skeleton.bone_m(f"{side}_{lower}"), atol=1e-3
            )


def test_a_bag_hangs_upright_below_a_hand_that_swings_less() -> None:
    found = t2d.carry(walk(), "bag in the left hand")
    origin, axes = frame(found)
    np.testing.assert_allclose(axes.apply([0.0, 0.0, 1.0])[:, 2], 1.0, atol=1e-9)
    wrist = found.joints[:, found.index("left_wrist")]
    np.testing.assert_allclose(
        np.linalg.norm(origin - wrist, axis=1), 0.045 * 1.6, atol=1e-3
    )  # the person is 1.60 m tall

    def swing(motion: Motion) -> float:
        pelvis = motion.joints[:, 0]
        return float(np.std((motion.joints[:, motion.index("left_wrist")] - pelvis)[:, 0]))

    assert swing(found) < 0.7 * swing(walk())


def test_a_box_moves_with_the_chest_and_the_hands_with_the_box() -> None:
    found = t2d.carry(walk(), "box")
    origin, axes = frame(found)
    for side, sign in (("left", 1), ("right", -1)):
        local = axes.inv().apply(found.joints[:, found.index(f"{side}_wrist")] - origin)
        np.testing.assert_allclose(local, np.broadcast_to(local[:1], local.shape), atol=2e-3)
        assert sign * local[0, 1] == pytest.approx(0.2 + 0.02, abs=1e-3)  # at its side, half a hand's thickness away


@pytest.mark.parametrize(
    ("name", "side", "foot"), [("walk", "right", 0), ("walk", "left", 1), ("short_walk", "right", 0)]
)
def test_a_canes_tip_stands_with_the_other_foot(name: str, side: str, foot: int) -> None:
    motion = t2d.example(name)
    found = t2d.carry(motion, f"cane in the {side} hand")
    times_s = np.arange(0, motion.duration_s, 1e-3)
    (mesh,) = things(found)
    tip = mesh.at(times_s)[:, -12:].mean(axis=1)  # the last ring of its tube
    assert -0.01 < tip[:, 2].min() < 0.01
    speed = np.linalg.norm(np.gradient(tip, times_s, axis=0), axis=1)
    stands = [(first, last) for first, last in runs((tip[:, 2] < 0.01) & (speed < 0.1)) if last - first > 100]
    steps = runs(contacts(poses_of(motion))[:, foot].any(axis=1))
    assert len(stands) >= len(steps) - 1 >= 2
    for first, last in stands:
        assert np.ptp(tip[first:last], axis=0).max() < 0.004
        middle = 0.5 * (times_s[first] + times_s[last - 1]) * motion.rate_hz
        assert any(start <= middle <= stop for start, stop in steps)


def test_the_hand_stays_on_the_canes_grip() -> None:
    found = t2d.carry(walk(), "cane")
    origin, _ = frame(found)
    wrist, hand = (found.joints[:, found.index(f"right_{name}")] for name in ("wrist", "hand"))
    grip = wrist + 0.045 * 1.6 * (hand - wrist) / np.linalg.norm(hand - wrist, axis=1, keepdims=True)
    assert np.linalg.norm(grip - origin, axis=1).max() < 0.01


@pytest.mark.parametrize("name", ["walk", "short_walk"])
def test_a_walker_rolls_level_on_the_floor_and_hands_hold_it(name: str) -> None:
    found = t2d.carry(t2d.example(name), "walker")
    (mesh,) = things(found)
    places = mesh.at(np.linspace(0, found.duration_s, 300))
    assert np.abs(places[..., 2].min(axis=1)).max() < 2e-3
    origin, axes = frame(found)
    for side in ("left", "right"):
        local = axes.inv().apply(found.joints[:, found.index(f"{side}_wrist")] - origin)
        np.testing.assert_allclose(local, np.broadcast_to(local[:1], local.shape), atol=5e-3)
    pelvis = np.gradient(found.joints[:, 0], 1 / found.rate_hz, axis=0)[30:-30]
    rolls = np.gradient(origin, 1 / found.rate_hz, axis=0)[30:-30]
    assert np.ptp(rolls[:, 0]) < np.ptp(pelvis[:, 0]) or name == "short_walk"  # which starts from standing


@pytest.mark.parametrize("name", ["walk", "short_walk", "run"])
def test_wheels_roll_and_hands_push_their_rims(name: str) -> None:
    given = t2d.example(name)
    found = t2d.carry(given, "wheelchair")
    times_s = np.arange(0.3, found.duration_s - 0.3, 3e-3)
    joints = track(found)(times_s)[0]
    velocity = np.gradient(joints, times_s, axis=0)
    chair = velocity[:, 0]
    ahead = chair / np.linalg.norm(chair, axis=1, keepdims=True)
    for side, wheel in zip(("left", "right"), things(found)[1:], strict=True):
        places = wheel.at(times_s)
        size = np.linalg.norm(np.gradient(places, times_s, axis=0), axis=-1)
        axle = 0.5 * (places.max(axis=1) + places.min(axis=1))
        forward = np.linalg.norm(np.gradient(axle, times_s, axis=0), axis=1)
        assert np.abs(places[..., 2].min(axis=1)).max() < 3e-3
        lowest = np.take_along_axis(size, places[..., 2].argmin(axis=1)[:, None], axis=1)
        assert (lowest < 0.15 * forward[:, None]).all()  # vertices lie 10 degrees apart
        np.testing.assert_allclose(size.max(axis=1), 2 * forward, rtol=0.02)  # at its top, of a wheel that rolls
        # The grip stays on the circle of the rim; in a push it goes round as fast as the rim does.
        wrist, elbow = (joints[:, found.index(f"{side}_{joint}")] for joint in ("wrist", "elbow"))
        down = np.sin(np.pi / 6) * ahead - np.cos(np.pi / 6) * np.array([0.0, 0.0, 1.0])
        stature = stature_m(dict(zip(given.names, np.moveaxis(given.joints, 1, 0), strict=True)))
        grip = wrist + 0.045 * stature * down - axle
        along, up = (grip * ahead).sum(axis=1), grip[:, 2]
        assert np.abs(np.hypot(along, up) - 0.26).max() < 0.012
        rate = np.gradient(np.unwrap(np.arctan2(along, up)), times_s)
        pushes = np.abs(rate * 0.305 / forward - 1) < 0.1
        assert 0.2 < pushes.mean() < 0.6
        # Hands and elbows move without jumps: within limits that follow from the push, in speed and its change.
        bound = 2.0 * np.linalg.norm(chair, axis=1)
        for joint in (wrist, elbow):
            speed = np.gradient(joint, times_s, axis=0)
            assert ((speed * ahead).sum(axis=1) < 1.05 * bound).all()
            assert ((speed * ahead).sum(axis=1) > -0.75 * bound).all()
            change = np.linalg.norm(np.gradient(speed, times_s, axis=0), axis=1)
            assert change.max() < 10 * (bound.max() / 2) ** 2 / 0.305  # of the order of v^2 / r


def test_a_spoke_is_as_the_next_one() -> None:
    (_, _, (left, _)), (_, _, (right, _)) = wheels(t2d.carry(walk(), "wheelchair").carries[0])
    for vertices in (left, right):
        turned = Rotation.from_rotvec([0.0, np.pi / 6, 0.0]).apply(vertices)
        here, there = (
            each[np.linalg.norm(each[:, [0, 2]], axis=1) > 0.0255] for each in (vertices, turned)
        )  # all but the hub
        assert KDTree(here).query(there)[0].max() < 1e-9
    np.testing.assert_allclose(sorted(left[:, 1]), sorted(-right[:, 1]), atol=1e-9)


@pytest.mark.parametrize("name", ["walk", "short_walk", "run"])
def test_who_sits_in_a_wheelchair_has_the_feet_on_its_footrest(name: str) -> None:
    found = t2d.carry(t2d.example(name), "wheelchair")
    origin, axes = frame(found)
    _, seat_m, rest_m, low_m = found.carries[0].size_m
    hips = 0.5 * (found.joints[:, found.index("left_hip")] + found.joints[:, found.index("right_hip")])
    assert 0.05 < (hips[:, 2] - seat_m).min() <= (hips[:, 2] - seat_m).max() < 0.12  # joints over a seat
    for side in ("left", "right"):
        ball, ankle = (
            axes.inv().apply(found.joints[:, found.index(f"{side}_{end}")] - origin) for end in ("foot", "ankle")
        )
        assert np.ptp(ball, axis=0).max() < 0.01
        assert 0.02 < ball[0, 2] - low_m < 0.035  # as high as the ball's joint is over a sole
        assert ankle[0, 0] - 0.01 < rest_m < ball[0, 0] + 0.01
        assert ankle[0, 2] > ball[0, 2]
    assert low_m > 0.04


def test_a_seat_is_as_high_as_is_asked() -> None:
    given = t2d.carry(walk(), {"thing": "wheelchair", "size_m": [0.7, 0.48]}).carries[0]
    np.testing.assert_allclose(given.size_m[:2], [0.7, 0.48], atol=2e-3)


def test_a_wheelchair_does_not_slide() -> None:
    for name in ("walk", "short_walk", "run"):
        found = t2d.carry(t2d.example(name), "wheelchair")
        origin, axes = frame(found)
        velocity = axes.inv().apply(np.gradient(origin, 1 / found.rate_hz, axis=0))
        assert np.abs(velocity[:, 1]).max() < 0.01 * velocity[:, 0].max()


@pytest.mark.parametrize("length_m", [0.75, 1.0, 1.4])
def test_a_cane_of_a_given_length_does_not_go_through_the_floor(length_m: float) -> None:
    (mesh,) = things(t2d.carry(walk(), {"thing": "cane", "size_m": [0.02, length_m]}))
    lowest = mesh.at(np.linspace(0, walk().duration_s, 300))[..., 2].min(axis=1)
    assert -0.02 < lowest.min() < 0.03


def test_two_crutches_are_of_one_length() -> None:
    left, right = t2d.carry(walk(), "crutches").carries
    assert left.size_m == right.size_m
    assert left.joint == "left_wrist"


def test_a_mirror_exchanges_the_hands() -> None:
    given = t2d.carry(walk(), ["bag in the left hand", "cane in the right hand"])
    here, there = things(given), things(t2d.mirror(given))
    assert [each.joint for each in t2d.mirror(given).carries] == ["right_wrist", "left_wrist"]
    for one, other in zip(here, there, strict=True):
        shown, seen = (each.at(np.array([1.0]))[0] for each in (one, other))
        np.testing.assert_allclose(seen.mean(axis=0), shown.mean(axis=0) * [1, -1, 1], atol=1e-9)


# --- what the radar sees ---


@cache
def moment() -> Motion:
    return t2d.trim(walk(), 0.5, 0.6)


@pytest.mark.usefixtures("coarse_bodies")
def test_a_ball_in_a_hand_is_a_ball_on_the_hands_track() -> None:
    held = t2d.carry(moment(), {"thing": "ball", "size_m": [0.1], "material": "pec"})
    vertices, faces = surface(held.carries[0])

    def on_the_hands_track(times_s: np.ndarray) -> np.ndarray:
        origin, axes = frame(held, *track(held)(times_s))
        return origin[:, None] + np.einsum("tij,vj->tvi", axes.as_matrix(), vertices)

    mover = MovingMesh.from_track(on_the_hands_track, faces, held.times_s, "pec", rest=vertices, name="mover")
    options: dict[str, Any] = {"radar": QUICK, "measure_error": False}
    one = t2d.simulate(held, split="target", **options)
    other = t2d.simulate([moment(), mover], **options)
    apart = np.linalg.norm(one.cube[:] - other.cube[:]) / np.linalg.norm(one.parts["ball"].cube[:])
    assert apart < 1e-3  # -60 dB; on one machine it is 0


def power(motion: Motion, name: str, **changes: Any) -> float:
    options: dict[str, Any] = {"radar": QUICK, "measure_error": False, "split": "target", **changes}
    return float(np.linalg.norm(t2d.simulate(motion, **options).parts[name].cube[:]) ** 2)


@pytest.mark.usefixtures("coarse_bodies")
def test_the_body_hides_what_it_carries_and_the_reverse() -> None:
    given = t2d.carry(moment(), {"thing": "backpack", "material": "pec"})
    behind = t2d.place(given, distance_m=2.5, angle_deg=180)
    assert power(given, "backpack") < 0.03 * power(behind, "backpack")
    boxed = t2d.carry(moment(), {"thing": "box", "size_m": [0.1, 0.6, 0.7], "material": "pec"})
    bare = t2d.simulate(boxed.edited("empty", carries=()), radar=QUICK, measure_error=False)
    assert power(boxed, "person") < 0.5 * float(np.linalg.norm(bare.cube[:]) ** 2)


def test_a_recording_of_it_is_made_again_bit_for_bit(tmp_path: Path) -> None:
    with pytest.warns(T2DWarning, match="by ellipsoids a body and what it carries do not hide each other"):
        found = t2d.simulate(t2d.carry(short(), ["bag", "cane"]), radar=QUICK, method="ellipsoid", measure_error=False)
    found.save(tmp_path / "r.zarr")
    with pytest.warns(T2DWarning, match="do not hide each other"):
        again = t2d.run(t2d.load_recording(tmp_path / "r.zarr"))
    np.testing.assert_array_equal(again.cube[:], found.cube[:])
    truth = found.truth_at(np.array([0.1, 0.2]))
    assert truth.target.values.tolist() == ["adult", "bag", "cane"]
    assert truth.person.values.tolist() == ["adult"]
    (bag, _), radar = things(t2d.carry(short(), ["bag", "cane"])), np.array(QUICK.position_m)
    range_m = np.linalg.norm(bag.at(np.array([0.1]))[0].mean(axis=0) - radar)
    assert float(truth.range_m.sel(target="bag")[0]) == pytest.approx(range_m, abs=2e-3)  # antennas lie some mm apart


# --- files, the command line, what is refused ---


def test_an_experiment_names_them(tmp_path: Path) -> None:
    file = tmp_path / "walk.yaml"
    file.write_text(
        "targets: [{kind: file, file: walk, stop_s: 0.3, carries: [bag, {thing: cane, hand: left}]}]\nradar: ci4r\n"
    )
    found = t2d.Experiment.from_yaml(file)
    (motion,) = found.targets_from({})
    assert [each.thing for each in motion.carries] == ["bag", "cane"]
    assert t2d.Experiment(targets=[{"kind": "file", "file": "walk", "carries": "box"}], radar="ci4r").targets[
        0
    ].carries == ("box",)
    assert t2d.Experiment(targets=[{"kind": "file", "file": "walk", "carries": "crutches"}], radar="ci4r")
    with pytest.raises(InputError, match="unknown thing 'hat'"):
        t2d.Experiment(targets=[{"kind": "file", "file": "walk", "carries": ["hat"]}], radar="ci4r")
    plain = t2d.Experiment(targets=[{"kind": "file", "file": "walk"}], radar="ci4r")
    assert "carries" not in plain.model_dump(mode="json")["targets"][0]  # the hash of older versions


def test_the_command_line_names_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    quick = ["--radar", "ci4r", "--stop-s", "0.1", "--method", "ellipsoid"]
    assert (
        main(["simulate", "walk", "-o", "w.zarr", "--carries", "bag", "--carries", "cane in the left hand", *quick])
        == 0
    )
    assert [each.split(":")[0] for each in t2d.load_recording("w.zarr").settings["targets"][1:]] == [
        "MovingMesh(bag",
        "MovingMesh(cane",
    ]


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ("hat", "unknown thing 'hat'"), ("bag in the third hand", 'written as "bag" or "bag in the left hand"'),
        (["bag", "bag", "bag"], "the hands are full"), (["box", "bag"], "the hands are full"),
        (["bag in the left hand", "cane in the left hand"], "the left hand is full"),
        (5, 'things must be a text such as "bag"'), ({"thing": "box", "hand": "left"}, "hand of a box must be left out"),
        ({"thing": "box", "size_m": [1, 2]}, "size_m of a box is length, width and height"),
        ({"thing": "box", "color": 1}, "unknown field 'color' of a thing"), (["wheelchair", "bag"], "the hands are full"),
        ("crutches in the left hand", "hand of crutches must be left out"),
        ({"thing": "crutches", "hand": "left"}, "hand of crutches must be left out"),
        ({"thing": "wheelchair", "size_m": [0.62, 1.5]}, "size_m of a wheelchair is width, .* 0.5 to 0.8, 0.4 to 0.6 m"),
        ({"thing": "wheelchair", "size_m": [0.1, 0.5]}, "size_m of a wheelchair"),
        ({"thing": "cane", "size_m": [0.02, 3.0]}, "size_m of a cane"),
        ({"thing": "cane", "size_m": [0.02, 0.3]}, "a cane of 0.3 m stays .* m over the floor"),
        ({}, "a thing is a text as"), (["backpack", "backpack"], "a back has room for one backpack"),
        ({"thing": "ball", "size_m": [0.7]}, "size_m of a ball is radius, 0.02 to 0.3 m"),
        ({"thing": [1]}, r"unknown thing \[1\]"), ({"thing": "bag", "size_m": [0.3, 0.1, 0.9]}, "m below the floor at"),
        ({"thing": "box", "size_m": [0.3, 1.5, 0.3]}, "the arms do not reach the box"),
    ],
)  # fmt: skip
def test_wrong_things_are_refused(wrong: Any, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        t2d.carry(short(), wrong)


@pytest.mark.parametrize(
    ("sentence", "told"),
    [
        ("a person jumps", "got jump"),
        ("a person falls forward", "got fall"),
        ("a person turns around", "got turn|at 0"),
    ],
)
def test_a_wheelchair_goes_the_way_of_walks_alone(sentence: str, told: str) -> None:
    with pytest.raises(InputError, match=f"a wheelchair goes the way of a forward walk or run, .*({told})"):
        t2d.carry(t2d.motion_from_text(sentence, seed=1), "wheelchair")
    walks = t2d.carry(t2d.motion_from_text("a person walks forward", seed=1), "wheelchair")
    assert walks.activities == ()


def test_things_of_no_motion_are_refused() -> None:
    plain: dict[str, Any] = {"joint": "pelvis", "position_m": (0, 0, 0), "rotation": (0, 0, 0, 1), "material": "metal"}
    with pytest.raises(InputError, match="unknown thing 'sofa'"):
        Carried(thing="sofa", size_m=(1, 1, 1), **plain)
    with pytest.raises(InputError, match="size_m of a bag must be 3 positive dimensions"):
        Carried(thing="bag", size_m=(1,), **plain)
    for given in (5, None):
        with pytest.raises(InputError, match="carries must be a text such as"):
            t2d.Experiment(targets=[{"kind": "file", "file": "walk", "carries": given}], radar="ci4r")
    with pytest.raises(InputError, match="a thing is a text as"):
        t2d.Experiment(targets=[{"kind": "file", "file": "walk", "carries": [5]}], radar="ci4r")


def test_runners_and_who_bends_or_falls_carry_less() -> None:
    for thing in ("cane", "walker"):
        with pytest.raises(InputError, match=f"a {thing} is for a walk, and the motion goes at"):
            t2d.carry(t2d.example("run"), thing)
    with pytest.raises(InputError, match="thigh would go through the box at"):
        t2d.carry(t2d.motion_from_text("a person sits down on a chair", seed=1), "box")
    with pytest.raises(
        InputError, match=r"m below the floor|that fits would have the dimensions|the arms do not reach"
    ):
        t2d.carry(t2d.motion_from_text("a person falls backward while walking", seed=3), "cane")


def test_wrong_carriers_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="motion must be a Motion, got TableFan"):
        t2d.carry(t2d.mover("fan:2,1,1.2"), "bag")  # type: ignore[arg-type]
    given = t2d.carry(short(), "bag")
    with pytest.raises(InputError, match="carries a bag already"):
        t2d.carry(given, "box")
    with pytest.raises(InputError, match="bend the path first"):
        arc(given, 3.0)
    with pytest.raises(InputError, match="things stand on a floor at z = 0"):
        t2d.carry(short().edited("raised", joints=short().joints + [0, 0, 1.0]), "bag")
    with pytest.warns(T2DWarning, match="the bag is not among them"):
        t2d.save_motion(given, tmp_path / "w.bvh")
    with pytest.warns(T2DWarning, match="the bag and the cane are not among them; carry them again"):
        t2d.save_motion(t2d.carry(short(), ["bag", "cane"]), tmp_path / "both.bvh")


def test_things_are_of_materials_that_are_known() -> None:
    assert tuple(MOULDED) == THING_NAMES
    for material in (*THING_NAMES, "itu_wood", "skin"):
        t2d.carry(short(), {"thing": "bag", "material": material})
    for material in ("gold", "dressed"):
        with pytest.raises(InputError, match=f"unknown material of a bag '{material}'"):
            t2d.carry(short(), {"thing": "bag", "material": material})
