"""Readers of the formats beside BVH, each against an independent decode; bad input in one sentence."""

from __future__ import annotations

import importlib.util
import json
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from builders import JOINT_CENTRES, MOTIONS, WALK, joint_centres, write_c3d
from t2d_rt.core.errors import InputError, T2DWarning, install
from t2d_rt.motion import flavours, load_motion
from t2d_rt.motion.interpolate import decompose
from t2d_rt.motion.read import amass, humanml3d, joint_sets, joints_npz
from t2d_rt.motion.read.bvh import forward_kinematics, read_bvh
from t2d_rt.motion.skeletons import restored_offsets
from t2d_rt.types.motion import CANONICAL_JOINTS, CANONICAL_PARENTS, Motion
from validation.motions import independent

RNG_SEED = 20
MM = 1e-3


@cache
def walk_20hz() -> Motion:
    return t2d.trim(t2d.resample(load_motion(WALK), 20.0), 0.5, 3.5)


def y_up(points: np.ndarray) -> np.ndarray:
    return points @ independent.Y_UP.T


def z_up(points: np.ndarray) -> np.ndarray:
    return points @ independent.Y_UP


def about_vertical(points: np.ndarray, onto: np.ndarray) -> np.ndarray:
    """Points (T, J, 3), z up, turned about z and shifted onto others as well as it goes."""
    p, q = points - points.mean((0, 1)), onto - onto.mean((0, 1))
    angle = np.arctan2((p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0]).sum(), (p[..., :2] * q[..., :2]).sum())
    return Rotation.from_euler("z", angle).apply(p.reshape(-1, 3)).reshape(p.shape) + onto.mean((0, 1))


def error_m(motion: Motion, joints: np.ndarray, names: tuple[str, ...] = CANONICAL_JOINTS) -> float:
    """Greatest distance of a motion's joints from expected ones (T, J, 3), but for where the floor is."""
    found = motion.joints[:, [motion.index(name) for name in names]]
    shift = (joints - found).mean((0, 1)) * [0, 0, 1]
    return float(np.linalg.norm(found + shift - joints, axis=-1).max())


def save(path: Path, **arrays: object) -> Path:
    np.savez(path, **arrays)  # type: ignore[arg-type]
    return path


def smooth_noise(shape: tuple[int, ...], width: float, scale: float) -> np.ndarray:
    return scale * gaussian_filter1d(np.random.default_rng(RNG_SEED).normal(0, 1, shape), width, axis=0)


# --- HumanML3D ------------------------------------------------------------------------------------------------------


def test_humanml3d_vectors_give_back_the_joints(tmp_path: Path) -> None:
    joints = walk_20hz().joints[:, :22]
    vectors = independent.humanml3d_vectors(y_up(joints))
    decoded = z_up(humanml3d.decode(vectors)[0])
    assert np.abs(about_vertical(decoded, joints[:-1]) - joints[:-1]).max() < 1e-9
    np.save(tmp_path / "a.npy", vectors.astype(np.float32))
    motion = load_motion(tmp_path / "a.npy")
    assert np.linalg.norm(about_vertical(motion.joints, joints[:-1]) - joints[:-1], axis=-1).max() < 0.1 * MM
    assert motion.rate_hz == 20.0
    assert "HumanML3D vectors, 60 frames at 20 Hz; 20 Hz assumed" in motion.report
    assert (
        "its joint steps agree with the positions within 0.0 mm; its 6D rotations within 0.0 degrees" in motion.report
    )
    np.save(tmp_path / "b.npy", vectors[None])
    np.testing.assert_allclose(load_motion(tmp_path / "b.npy").joints, motion.joints, atol=1e-5)


def test_humanml3d_vectors_hold_steps() -> None:
    decoded, _, steps = humanml3d.decode(independent.humanml3d_vectors(y_up(walk_20hz().joints[:, :22])))
    np.testing.assert_allclose(steps[:-1], np.diff(decoded, axis=0), atol=1e-9)


@pytest.mark.parametrize("form", ["(T, 22, 3)", "(1, T, 22, 3)", "(T, 66)", "(22, 3, T)", "npz", "(T, 24, 3)", "z up"])
def test_humanml3d_joints(tmp_path: Path, form: str) -> None:
    expected = walk_20hz().joints[:, :22]
    joints = expected if form == "z up" else y_up(expected)
    hands = [walk_20hz().index(f"{side}_hand") for side in ("left", "right")]
    stored: np.ndarray = {
        "(1, T, 22, 3)": joints[None],
        "(T, 66)": joints.reshape(-1, 66),
        "(22, 3, T)": np.moveaxis(joints, 0, 2),
        "(T, 24, 3)": np.concatenate([joints, y_up(walk_20hz().joints[:, hands])], axis=1),
    }.get(form, joints)
    path = tmp_path / ("a.npz" if form == "npz" else "a.npy")
    np.savez(path, joints=stored) if form == "npz" else np.save(path, stored)
    motion = load_motion(path)
    assert error_m(motion, expected) < 1e-9
    assert ("order of SMPL" if "24" in form else "HumanML3D joints") in motion.report
    assert f"up {'z' if form == 'z up' else 'y'};" in motion.report


def test_a_rate_given_replaces_the_assumed_one(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", y_up(walk_20hz().joints[:, :22]))
    motion = load_motion(tmp_path / "a.npy", rate_hz=25.0)
    assert motion.rate_hz == 25.0
    assert "assumed" not in motion.report
    assert load_motion(MOTIONS / "momask_22j_120frames.bvh", rate_hz=30.0).rate_hz == 30.0


def test_normalised_vectors_are_refused(tmp_path: Path) -> None:
    vectors = independent.humanml3d_vectors(y_up(walk_20hz().joints[:, :22]))
    np.save(tmp_path / "a.npy", (vectors - vectors.mean(0)) / (vectors.std(0) + 1e-6))
    with pytest.raises(InputError, match=r"probably normalised; multiply them by Std\.npy"):
        load_motion(tmp_path / "a.npy")


# --- AMASS ----------------------------------------------------------------------------------------------------------


def amass_poses(width: int = 156, frames: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Smooth poses of someone upright in the z-up world, and the root's way."""
    poses = smooth_noise((frames, width), 6.0, 0.7)
    upright = Rotation.from_euler("x", 90, degrees=True)
    poses[:, :3] = (Rotation.from_rotvec(poses[:, :3]) * upright).as_rotvec()
    return poses, np.cumsum(smooth_noise((frames, 3), 6.0, 0.02), axis=0)


@pytest.mark.parametrize(("width", "form"), [(156, "SMPL-H"), (165, "SMPL-X"), (72, "SMPL"), (66, "AMASS")])
def test_amass_against_matrices(tmp_path: Path, width: int, form: str) -> None:
    poses, moved = amass_poses(width)
    path = save(tmp_path / "a.npz", poses=poses, trans=moved, betas=np.zeros(16), mocap_framerate=60.0, gender="male")
    motion = load_motion(path, smooth_hz=None)
    offsets = np.array([amass.OFFSETS.get(name, (0, 0, 0)) for name in CANONICAL_JOINTS]) * amass.STATURE_M
    joints, matrices = independent.smpl_joints(poses, moved, CANONICAL_PARENTS, offsets)
    assert error_m(motion, joints) < 1e-9
    assert form in motion.report
    assert "SMPL's mean body, 1.70 m tall (assumed), betas not used" in motion.report
    # The rotations are the file's own, from its world to ours (both z up).
    mine = Rotation.from_quat(motion.rotations[:, :22].reshape(-1, 4)).as_matrix().reshape(-1, 22, 3, 3)
    constant = np.swapaxes(matrices, -1, -2) @ mine
    assert np.abs(constant - constant[:1]).max() < 1e-9


def test_amass_bones_are_those_of_smpl(tmp_path: Path) -> None:
    """Of the mean body of 1.70 m: joints lie deeper than what anthropometry measures between landmarks."""
    poses, moved = amass_poses(frames=15)
    motion = load_motion(save(tmp_path / "a.npz", poses=poses, trans=moved, mocap_framerate=60.0), smooth_hz=None)
    lengths = {
        ("shoulder", "elbow"): 0.262, ("elbow", "wrist"): 0.257, ("hip", "knee"): 0.388, ("knee", "ankle"): 0.409,
    }  # fmt: skip
    for side in ("left", "right"):
        for (upper, lower), length_m in lengths.items():
            bone = motion.joints[:, motion.index(f"{side}_{lower}")] - motion.joints[:, motion.index(f"{side}_{upper}")]
            assert np.linalg.norm(bone, axis=-1) == pytest.approx(length_m, abs=0.002)
    hips = motion.joints[:, motion.index("left_hip")] - motion.joints[:, motion.index("right_hip")]
    assert np.linalg.norm(hips, axis=-1) == pytest.approx(0.14, abs=0.005)


def swinging_arms(turn: Rotation, moved: np.ndarray, about: int = 1) -> dict[str, object]:
    """Somebody who swings the arms, on the spot; `turn` takes SMPL's rest pose into the file's axes."""
    poses = np.zeros((len(moved), 156))
    swing = 0.6 * np.sin(2 * np.pi * np.arange(len(moved)) / 30)
    poses[:, :3], poses[:, 16 * 3 + about], poses[:, 17 * 3 + about] = turn.as_rotvec(), swing, swing
    return {"poses": poses, "trans": moved, "mocap_framerate": 30.0}


def test_amass_with_y_up_is_detected(tmp_path: Path) -> None:
    upright, still = Rotation.from_euler("x", 90, degrees=True), np.zeros((60, 3))
    z_up_file = load_motion(save(tmp_path / "z.npz", **swinging_arms(upright, still + [0, 0, 0.95])))
    y_up_file = load_motion(save(tmp_path / "y.npz", **swinging_arms(Rotation.identity(), still + [0, 0.95, 0])))
    assert "up z" in z_up_file.report
    assert "up y" in y_up_file.report
    joints = z_up_file.joints[:, :22]
    assert error_m(y_up_file, joints[..., [1, 0, 2]] * [-1, 1, 1]) < 1e-9
    # One who lies along y on the floor, z up, and moves the arms, is no one who stands with y up.
    lying = load_motion(save(tmp_path / "l.npz", **swinging_arms(Rotation.identity(), still + [0.3, 2.0, 0.12], 2)))
    assert "up z" in lying.report


def test_a_still_body_along_another_axis_is_a_doubt(tmp_path: Path) -> None:
    poses, moved = np.zeros((60, 156)), np.tile([0.0, 0.938, 0.0], (60, 1))
    poses[:, 3:66] = smooth_noise((60, 63), 10.0, 0.002)
    path = save(tmp_path / "a.npz", poses=poses, trans=moved, mocap_framerate=60.0)
    with pytest.warns(
        T2DWarning, match=r"upright along y throughout .* give up='y' \(--motion.up y\) if the person stands"
    ):
        load_motion(path)


def test_amass_finds_the_stature_at_which_feet_stay() -> None:
    """Somebody of 1.9 m rolls over planted feet as an inverted pendulum."""
    frames, rate_hz = 240, 60.0
    turned = np.zeros((frames, 22, 3))
    swing = 0.35 * np.sin(2 * np.pi * 0.9 * np.arange(frames) / rate_hz)
    turned[:, 0] = [np.pi / 2, 0, 0]
    turned[:, 1, 0], turned[:, 2, 0] = swing, -swing
    about = amass._forward(amass._orientations(turned))
    planted = np.where(np.gradient(swing) < 0, 1, 0)
    step = [np.diff(about[f"{side}_foot"], axis=0) for side in ("left", "right")]
    # The root moves so that the foot that goes backward about it stands.
    back = np.where((step[0][:, 1] > 0)[:, None], step[0], step[1])
    assert planted.any()
    moved = np.concatenate([np.zeros((1, 3)), -1.9 * np.cumsum(back * [1, 1, 0], axis=0)]) + [0, 0, 1.0]
    stature, how = amass._stature(about, moved, rate_hz)
    assert how == "at which planted feet slide least"
    assert stature == pytest.approx(1.9, rel=0.01)


def test_hands_on_wrists_are_left_out(tmp_path: Path) -> None:
    """SMPL's 24 joints are often 22 and the wrists again."""
    motion = walk_20hz()
    joints = np.concatenate([motion.joints[:, :22], motion.joints[:, [20, 21]]], axis=1)
    np.save(tmp_path / "a.npy", y_up(joints))
    read = load_motion(tmp_path / "a.npy", rate_hz=20.0)
    assert read.names == CANONICAL_JOINTS
    assert "left out left_hand, right_hand" in read.report
    assert error_m(read, motion.joints[:, :22]) < 20 * MM


# --- Kimodo, DeepMimic ----------------------------------------------------------------------------------------------


def kimodo_file(path: Path, **changes: object) -> Path:
    motion = walk_20hz()
    joints, matrices = np.zeros((len(motion.joints), 30, 3)), np.tile(np.eye(3), (len(motion.joints), 30, 1, 1))
    for name, place in joints_npz.PLACES.items():
        column = motion.index(name)
        joints[:, place] = y_up(motion.joints[:, column])
        turned = Rotation.from_quat(motion.rotations[:, column]).as_matrix()
        matrices[:, place] = independent.Y_UP @ turned @ independent.Y_UP.T
    return save(path, **{"posed_joints": joints, "global_rot_mats": matrices, **changes})


def test_kimodo_joints_and_rotations(tmp_path: Path) -> None:
    motion, expected = load_motion(kimodo_file(tmp_path / "a.npz"), smooth_hz=None), walk_20hz()
    names = tuple(joints_npz.PLACES)
    assert error_m(motion, expected.joints[:, [expected.index(name) for name in names]], names) < 1e-9
    for name in names:
        # A constant turn of the joint's own axes is left open.
        mine, theirs = (Rotation.from_quat(each.rotations[:, each.index(name)]) for each in (motion, expected))
        constant = (theirs.inv() * mine).as_matrix()
        assert np.abs(constant - constant[:1]).max() < 1e-9
    assert "Kimodo, 61 frames at 30 Hz; 1 unit = 1 m" in motion.report


def deepmimic_file(path: Path, frames: int = 40, **changes: object) -> Path:
    angles = smooth_noise((frames, 44), 5.0, 1.2)
    rows = np.zeros((frames, 44))
    rows[:, 0], rows[:, 1:4] = 1 / 30, np.cumsum(0.1 * angles[:, 1:4], axis=0) + [0, 0.9, 0]
    column = 4
    for count in (4, *(row[3] for row in independent.HUMANOID)):
        if count == 4:
            turn = Rotation.from_rotvec(0.5 * angles[:, column : column + 3]).as_quat()
            rows[:, column : column + 4] = turn[:, [3, 0, 1, 2]]
        elif count == 1:
            rows[:, column] = angles[:, column]
        column += count
    path.write_text(json.dumps({"Loop": "none", "Frames": rows.tolist()} | changes))
    return path


@pytest.mark.parametrize("name", ["a.json", "a.txt"])
def test_deepmimic_against_matrices(tmp_path: Path, name: str) -> None:
    path = deepmimic_file(tmp_path / name)
    motion = load_motion(path, smooth_hz=None)
    expected = independent.deepmimic_joints(path)
    names = tuple(joint for joint in expected if joint in motion.names)
    assert len(names) == 13
    assert error_m(motion, np.stack([z_up(expected[joint]) for joint in names], axis=1), names) < 1e-9
    assert motion.rate_hz == 30.0
    offsets, _ = decompose(motion.joints, motion.rotations, motion.parents)
    assert offsets[:, 1:].std(axis=0).max() < 0.05  # rigid but for the spine's joints between root and chest


def test_uneven_deepmimic_frames_are_interpolated(tmp_path: Path) -> None:
    path = deepmimic_file(tmp_path / "a.txt")
    whole = json.loads(path.read_text())["Frames"]
    short = [[2 / 30 if i == 9 else row[0], *row[1:]] for i, row in enumerate(whole) if i != 10]
    path.write_text(json.dumps({"Frames": short}))
    motion = load_motion(path, smooth_hz=None)
    assert "1 frame(s) lost by its durations" in motion.report
    path.write_text(json.dumps({"Frames": whole}))
    full = load_motion(path, smooth_hz=None)
    assert len(motion.joints) == len(full.joints)
    assert np.linalg.norm(motion.joints - full.joints, axis=-1).max() < 0.02


# --- ASF/AMC --------------------------------------------------------------------------------------------------------


@cache
def cmu_pair(angle: str = "deg") -> tuple[str, str, dict[str, np.ndarray]]:
    """The shipped CMU walk as .asf and .amc, and the ends of its bones (T, 3) by canonical name, y up [m]."""
    raw = read_bvh(WALK)
    kind = flavours()["cmu-a"]
    offsets, _ = restored_offsets(raw, raw.names, kind)
    positions, rotations = forward_kinematics(raw, offsets)
    frames = slice(100, 160)
    index = {name: i for i, name in enumerate(raw.names)}
    turned = {name: Rotation.from_quat(rotations[frames, i]).as_matrix() for name, i in index.items()}
    parent_of: dict[str, str] = {}
    for line in independent.CMU_HIERARCHY.splitlines():
        above, *children = line.split()
        parent_of |= dict.fromkeys(children, above)
    joint = {bone: name for bone, (name, _, _) in independent.CMU_BONES.items()} | {"root": "Hips"}
    local = {
        bone: np.swapaxes(turned[joint[parent_of[bone]]], -1, -2) @ turned[joint[bone]]
        for bone in independent.CMU_BONES
    } | {"root": turned["Hips"]}
    children = {
        bone: [c for c, parent in enumerate(raw.parents) if raw.names[parent] == joint[bone]] for bone in parent_of
    }
    end = {bone: max(each, key=lambda c: float(np.linalg.norm(offsets[c]))) for bone, each in children.items()}
    asf, amc = independent.acclaim({bone: offsets[c] for bone, c in end.items()}, local, positions[frames, 0], angle)
    unit = 0.0254 / 0.45
    ends = {bone: unit * positions[frames, c] for bone, c in end.items()}
    return asf, amc, ends


@pytest.mark.parametrize("angle", ["deg", "rad"])
def test_asf_amc_against_the_bvh_of_the_same_walk(tmp_path: Path, angle: str) -> None:
    asf, amc, ends = cmu_pair(angle)
    (tmp_path / "12.asf").write_text(asf)
    (tmp_path / "12_01.amc").write_text(amc)
    motion = load_motion(tmp_path / "12_01.amc", smooth_hz=None)
    names = {
        "left_hip": "lhipjoint", "left_knee": "lfemur", "left_ankle": "ltibia", "left_foot": "lfoot", "left_elbow": "lhumerus",
        "right_wrist": "rwrist", "right_shoulder": "rclavicle", "head": "upperneck", "spine1": "lowerback",
    }  # fmt: skip
    expected = np.stack([z_up(ends[bone]) for bone in names.values()], axis=1)
    assert error_m(motion, expected, tuple(names)) < 1 * MM
    assert motion.rate_hz == 120.0
    assert "skeleton 12.asf" in motion.report
    assert "120 Hz assumed" in motion.report
    assert "1 unit = 0.05644 m" in motion.report
    offsets, _ = decompose(motion.joints, motion.rotations, motion.parents)
    limbs = [motion.index(f"{s}_{j}") for s in ("left", "right") for j in ("knee", "ankle", "foot", "elbow")]
    assert offsets[:, limbs].std(axis=0).max() < 1e-9


def test_an_amc_finds_the_only_asf(tmp_path: Path) -> None:
    asf, amc, _ = cmu_pair()
    (tmp_path / "walk.amc").write_text(amc)
    with pytest.raises(InputError, match=r"needs its skeleton beside it: walk\.asf or walk\.asf, none is there"):
        load_motion(tmp_path / "walk.amc")
    (tmp_path / "somebody.asf").write_text(asf)
    assert "skeleton somebody.asf" in load_motion(tmp_path / "walk.amc").report
    with pytest.raises(InputError, match=r"give the \.amc, whose skeleton it is"):
        load_motion(tmp_path / "somebody.asf")


# --- C3D and TRC ----------------------------------------------------------------------------------------------------

LIMBS = tuple(f"{side}_{joint}" for side in ("left", "right") for joint in JOINT_CENTRES)


@pytest.mark.parametrize("form", ["trc", "c3d"])
def test_joint_centres_by_name(tmp_path: Path, form: str) -> None:
    expected = walk_20hz()
    tracks = joint_centres(expected)
    path = tmp_path / f"a.{form}"
    if form == "trc":
        path.write_text(independent.trc({name: 1e3 * y_up(track) for name, track in tracks.items()}, 20.0))
    else:
        write_c3d(path, tracks, 20.0)
    motion = load_motion(path, smooth_hz=None)
    assert error_m(motion, expected.joints[:, [expected.index(name) for name in LIMBS]], LIMBS) < 0.01 * MM
    assert f"{form.upper()}, 61 frames at 20 Hz; joint centres Neck, Head, LHip" in motion.report
    assert "filled pelvis, spine1, spine2, spine3, left_collar, right_collar" in motion.report
    # Filled ones lie within a few centimetres of those of another skeleton.
    for name, limit in (("pelvis", 0.11), ("spine3", 0.06), ("left_collar", 0.08), ("head", 0.06)):
        gap = np.linalg.norm(motion.joints[:, motion.index(name)] - expected.joints[:, expected.index(name)], axis=-1)
        assert gap.mean() < limit, name


def skin_markers(motion: Motion) -> dict[str, np.ndarray]:
    """Plug-in Gait's markers on a body of known joints, out of their definition: half a width outward of the joints."""
    at = {name: motion.joints[:, i] for i, name in enumerate(motion.names)}
    tall = float(np.median(np.linalg.norm(at["left_knee"] - at["left_ankle"], axis=-1))) / 0.246
    left = at["left_hip"] - at["right_hip"]
    half = 0.5 * np.median(np.linalg.norm(left, axis=-1))
    left = left / np.linalg.norm(left, axis=-1, keepdims=True)
    up = at["spine1"] - 0.5 * (at["left_hip"] + at["right_hip"])
    ahead = np.cross(left, up)
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    up = np.cross(ahead, left)
    # Harrington's equations the other way round: pelvis width from the distance of the hips, depth 0.6 of it.
    width = (half - 0.0043 * tall) / 0.33
    depth = 0.6 * width
    middle = 0.5 * (at["left_hip"] + at["right_hip"])
    front = middle + (0.24 * depth + 0.0058 * tall) * ahead + (0.30 * width + 0.0064 * tall) * up
    found = {}
    for side, s, sign in (("left", "L", 1.0), ("right", "R", -1.0)):
        found[f"{s}ASI"] = front + sign * 0.5 * width * left
        found[f"{s}PSI"] = front - depth * ahead + sign * 0.2 * width * left
        found[f"{s}KNE"] = at[f"{side}_knee"] + sign * 0.033 * tall * left
        found[f"{s}ANK"] = at[f"{side}_ankle"] + sign * 0.024 * tall * left
        found[f"{s}SHO"] = at[f"{side}_shoulder"] + [0, 0, 0.03 * tall]
        found[f"{s}ELB"] = at[f"{side}_elbow"] + sign * 0.023 * tall * left
        for place, shift in (("WRA", 0.03), ("WRB", -0.03)):
            found[f"{s}{place}"] = at[f"{side}_wrist"] + shift * ahead
        found[f"{s}TOE"] = at[f"{side}_foot"] + [0, 0, 0.01]
    for label, x, y in (("LFHD", 1, 1), ("RFHD", 1, -1), ("LBHD", -1, 1), ("RBHD", -1, -1)):
        found[label] = at["head"] + [0.0, 0.0, 0.08] + 0.08 * (x * ahead + y * left)
    return found


@pytest.mark.parametrize("form", ["trc", "c3d"])
def test_markers_on_the_skin(tmp_path: Path, form: str) -> None:
    expected = walk_20hz()
    tracks = {f"Anna:{label}": track for label, track in skin_markers(expected).items()}
    tracks["Anna:LKNE"] = tracks["Anna:LKNE"].copy()
    tracks["Anna:LKNE"][20:23] = np.nan
    path = tmp_path / f"a.{form}"
    if form == "trc":
        path.write_text(independent.trc({name: y_up(track) for name, track in tracks.items()}, 20.0, "m"))
    else:
        write_c3d(path, tracks, 20.0)
    motion = load_motion(path, smooth_hz=None)
    assert "joints from the markers LASI, RASI, LPSI, RPSI, LKNE" in motion.report
    assert "9 missing joint position(s) bridged, up to 0.15 s (left_knee, left_ankle, left_foot)" in motion.report
    kept = np.r_[0:19, 24:61]
    limits = {"hip": 0.012, "knee": 0.02, "ankle": 0.02, "shoulder": 0.02, "elbow": 0.025, "wrist": 0.005}
    for name in (f"{side}_{joint}" for side in ("left", "right") for joint in limits):
        gap = motion.joints[:, motion.index(name)] - expected.joints[:, expected.index(name)]
        gap[:, 2] -= np.median(gap[:, 2])  # where the floor is
        assert np.linalg.norm(gap[kept], axis=-1).mean() < limits[name.partition("_")[2]], name


def test_unknown_markers_are_refused(tmp_path: Path) -> None:
    tracks = {f"M{i:03d}": walk_20hz().joints[:, i] for i in range(20)}
    (tmp_path / "a.trc").write_text(independent.trc(tracks, 20.0, "m"))
    with pytest.raises(InputError, match=r"markers .* give no joints: they lack LASI, RASI, LPSI, RPSI, LKNE"):
        load_motion(tmp_path / "a.trc")
    markers = skin_markers(walk_20hz())
    del markers["LELB"]
    (tmp_path / "a.trc").write_text(independent.trc(markers, 20.0, "m"))
    with pytest.raises(InputError, match="they lack LELB;"):
        load_motion(tmp_path / "a.trc")


def test_a_marker_never_seen_is_refused(tmp_path: Path) -> None:
    tracks = {name: track.copy() for name, track in joint_centres(walk_20hz()).items()}
    tracks["LKnee"][:] = np.nan
    (tmp_path / "a.trc").write_text(independent.trc(tracks, 20.0, "m"))
    with pytest.raises(InputError, match=r"LKnee.* never seen"):
        load_motion(tmp_path / "a.trc")


def test_frames_without_all_markers_are_cut_at_the_ends(tmp_path: Path) -> None:
    tracks = {name: track.copy() for name, track in joint_centres(walk_20hz()).items()}
    tracks["LKnee"][:7], tracks["Head"][-4:] = np.nan, np.nan
    (tmp_path / "a.trc").write_text(independent.trc(tracks, 20.0, "m"))
    motion = load_motion(tmp_path / "a.trc")
    assert len(motion.joints) == 50
    assert "first 7 and last 4 frame(s) without all joints cut" in motion.report


# --- named joints and known orders ----------------------------------------------------------------------------------


def in_order(order: str) -> np.ndarray:
    """The walk's joints (T, K, 3) in a known order, those that it has; others at the head."""
    motion = walk_20hz()
    joints = np.repeat(motion.joints[:, motion.index("head"), None], len(joint_sets.ORDERS[order]), axis=1)
    for joint, names in joint_sets.canonical_sources(joint_sets.ORDERS[order]).items():
        for name in names:
            joints[:, joint_sets.ORDERS[order].index(name)] = motion.joints[:, motion.index(joint)]
    return joints


@pytest.mark.parametrize("order", joint_sets.ORDERS)
@pytest.mark.parametrize("named", [True, False])
def test_orders_of_cameras_and_estimators(tmp_path: Path, order: str, named: bool) -> None:
    expected, joints = walk_20hz(), in_order(order)
    path = tmp_path / "a.npz"
    more = {"names": np.array(joint_sets.ORDERS[order]), "fps": 20} if named else {"fps": 20}
    motion = load_motion(save(path, joints=joints, up="z", **more), smooth_hz=None)
    found = ("HumanML3D joints" if order == "HumanML3D" else f"order of {order}") if not named else "named joints"
    assert found in motion.report
    assert motion.rate_hz == 20.0
    names = joint_sets.NEEDED
    assert error_m(motion, expected.joints[:, [expected.index(name) for name in names]], names) < 1e-6
    for name in CANONICAL_JOINTS:
        gap = motion.joints[:, motion.index(name)] - expected.joints[:, expected.index(name)]
        assert np.linalg.norm(gap, axis=-1).mean() < 0.15, name


def test_names_are_understood_in_any_spelling() -> None:
    for spelling in ("left_hip", "LeftHip", "HipLeft", "HIP_LEFT", "LHip", "l_hip", "Left Hip", "hip.L"):
        assert joint_sets.canonical_sources([spelling]) == {"left_hip": (spelling,)}
    # A foot is the ankle where there is no ankle, the ball of the foot where there is.
    assert joint_sets.canonical_sources(["RFoot"])["right_ankle"] == ("RFoot",)
    assert joint_sets.canonical_sources(["RFoot", "RAnkle"])["right_foot"] == ("RFoot",)


def test_held_frames_are_found(tmp_path: Path) -> None:
    joints = y_up(walk_20hz().joints[:, :22])
    np.save(tmp_path / "a.npy", np.repeat(joints, 3, axis=0)[1:])
    motion = load_motion(tmp_path / "a.npy", rate_hz=60.0)
    assert motion.rate_hz == 20.0
    assert len(motion.joints) == len(joints)
    assert "each frame stood 3 times at 60 Hz" in motion.report


# --- bad input ------------------------------------------------------------------------------------------------------


def npy(value: object) -> Callable[[Path], None]:
    return lambda path: np.save(path, value, allow_pickle=True)  # type: ignore[arg-type]


def npz(**values: object) -> Callable[[Path], None]:
    return lambda path: np.savez(path, **values)  # type: ignore[arg-type]


def plain(text: str | bytes) -> Callable[[Path], None]:
    return lambda path: path.write_bytes(text.encode() if isinstance(text, str) else text) and None


def broken(joints: np.ndarray, value: float) -> np.ndarray:
    joints = joints.copy()
    joints[3, 4, 1] = value
    return joints


GOOD = np.zeros((10, 22, 3)) + np.random.default_rng(0).normal(0, 1, (10, 22, 3))
NPY_HEADER = b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (100000000000, 22, 3), }"

BAD: dict[str, tuple[str, Callable[[Path], None], str]] = {
    "pickled npy": ("a.npy", npy(np.array([{"motion": 1}], dtype=object)), "holds Python objects"),
    "pickled npz": ("a.npz", npz(joints=np.array([None, "x"], dtype=object)), "joints holds Python objects"),
    "no person": ("a.npy", npy(GOOD), "make no person in any known order"),
    "shape": ("a.npy", npy(np.zeros((10, 7))), "expected \\(T, 22, 3\\)"),
    "four dimensions": ("a.npy", npy(np.zeros((2, 10, 22, 3))), "must have 2 or 3 dimensions"),
    "no frames": ("a.npy", npy(np.zeros((0, 22, 3))), "some frames"),
    "one frame": ("a.npy", lambda path: np.save(path, walk_20hz().joints[:1, :22]), "at least 2 frames, got 1"),
    "nan": ("a.npy", npy(GOOD * np.nan), "make no person"),
    "huge": ("a.npy", npy(GOOD + 1e30), "make no person"),
    "text": ("a.npy", npy(np.array(["a", "b"])), "must hold real numbers"),
    "complex": ("a.npy", npy(GOOD + 1j), "must hold real numbers"),
    "promises": ("a.npy", plain(NPY_HEADER.ljust(127) + b"\n" + b"\0" * 64), "is cut short"),
    "header": ("a.npy", plain(b"\x93NUMPY\x01\x00v\x00{'descr': " + b"(" * 90), "its header cannot be read"),
    "not numpy": ("a.npz", plain("hello"), "neither a .npy nor a .npz"),
    "empty": ("a.npy", plain(b""), "is empty"),
    "zip": ("a.npz", plain(b"PK\x03\x04" + b"x" * 100), "not a valid .npz"),
    "other arrays": ("a.npz", npz(a=np.zeros(3), b=np.zeros(4)), "but no joints"),
    "names count": ("a.npz", npz(joints=GOOD, names=np.array(["a", "b"])), "names 2 joints but holds 22"),
    "names": ("a.npz", npz(joints=GOOD[:, :2], names=np.array(["a", "b"])), "the joints' names lack left_hip"),
    "names twice": ("a.npz", npz(joints=GOOD[:, :2], names=np.array(["a", "a"])), "'a' more than once"),
    "up": ("a.npz", npz(joints=walk_20hz, names=np.array(["a"])), "holds Python objects"),
    "amass rate": ("a.npz", npz(poses=np.zeros((5, 156)), trans=np.zeros((5, 3))), "has no mocap_framerate"),
    "amass shape": ("a.npz", npz(poses=np.zeros((5, 60)), trans=np.zeros((5, 3))), "poses must be axis-angle vectors, 66 or 72 or"),
    "amass trans": ("a.npz", npz(poses=np.zeros((5, 156)), trans=np.zeros((4, 3))), "trans must have shape \\(5, 3\\)"),
    "amass nan": ("a.npz", npz(poses=np.full((5, 156), np.nan), trans=np.zeros((5, 3)), fps=30.0), "absurd values in every frame"),
    "kimodo shape": ("a.npz", npz(posed_joints=np.zeros((5, 24, 3))), "posed_joints must have shape"),
    "kimodo matrices": (
        "a.npz", lambda path: kimodo_file(path, global_rot_mats=np.zeros((61, 30, 3, 3))) and None, "no rotation matrices",
    ),
    "json": ("a.json", plain("{"), "not valid JSON"),
    "deep json": ("a.json", plain("[" * 100_000), "not valid JSON"),
    "json list": ("a.json", plain("[1, 2]"), "frame 0 holds no points x, y, z"),
    "json width": ("a.json", plain('{"Frames": [[1, 2], [3, 4]]}'), "must hold 44 finite numbers; these hold \\[2\\]"),
    "json nan": ("a.txt", plain('{"Frames": [[' + "NaN, " * 43 + "1]]}"), "absurd values in every frame"),
    "json rotations": ("a.txt", plain('{"Frames": [[0.1' + ", 3" * 43 + "]]}"), "must be unit quaternions"),
    "json text": ("a.txt", plain("a person walks#120\n"), "not valid JSON"),
    "trc": ("a.trc", plain("hello\n" * 10), "not a TRC file"),
    "trc header": ("a.trc", plain("PathFileType\nDataRate\nx\n" + "\n" * 10), "DataRate and Units"),
    "c3d": ("a.c3d", plain(b"\x02\x51" + b"\0" * 2000), "not a C3D file"),
    "c3d damaged": ("a.c3d", plain(b"\x02\x50" + b"\x07" * 2000), "cannot be read as C3D|expected 2 to"),
    "suffix": ("a.fbx", plain("x"), "motions come as .bvh or .bvh.gz or .glb, or as .amc"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_files(tmp_path: Path, case: str) -> None:
    name, write, match = BAD[case]
    if case.startswith("c3d damaged"):
        pytest.importorskip("ezc3d")
    write(tmp_path / name)
    with pytest.raises(InputError, match=match) as caught:
        load_motion(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 700
    assert name in str(caught.value)


ROOT_BONE = "begin\nname root\ndirection 0 1 0\nlength 1\naxis 0 0 0 XYZ\nend"
ASF_BAD = {
    "no bones": (":bonedata", ":bones", "not a whole ASF skeleton"),
    "axis": ("XYZ", "XYX", "not a whole ASF skeleton"),
    "number": ("length 0.45", "length x", "not a whole ASF skeleton"),
    "no number": ("length 0.45", "length nan", "not a whole ASF skeleton"),
    "loop": ("lfemur ltibia", "ltibia lfemur", "not a whole ASF skeleton"),
    "unknown": ("lfemur ltibia", "lfemur tail", "not a whole ASF skeleton"),
    "names": ("lfemur", "thigh", "not a whole ASF skeleton"),
    "a bone called root": (":hierarchy", f"{ROOT_BONE}\n:hierarchy", "not a whole ASF skeleton"),
}
AMC_BAD = {
    "cut in a frame": (lambda text: text[: len(text) // 2], "does not fit the skeleton|cut short"),
    "too few angles": (lambda text: text.replace("\nltibia ", "\nltibia 1 ", 1), "cannot read .* in frame 1"),
    "unknown bone": (lambda text: text.replace("\nltibia ", "\ntail ", 1), "cannot read 'tail"),
    "word": (lambda text: text.replace("\nltibia ", "\nltibia x", 1), "must hold numbers only"),
    "nan": (lambda text: re.sub("\nltibia .*", "\nltibia nan", text), "NaN, infinite"),
    "empty": (lambda _: "", "cut short or no AMC"),
    "binary": (lambda _: "\0\1", "is not text"),
}


@pytest.mark.parametrize("case", [*ASF_BAD, *AMC_BAD])
def test_bad_acclaim_files(tmp_path: Path, case: str) -> None:
    asf, amc, _ = cmu_pair()
    if case in ASF_BAD:
        old, new, match = ASF_BAD[case]
        asf = asf.replace(old, new, -1 if case == "axis" else 1)
    else:
        change, match = AMC_BAD[case]
        amc = change(amc)
    (tmp_path / "a.asf").write_text(asf)
    (tmp_path / "a.amc").write_text(amc)
    with pytest.raises(InputError, match=match) as caught:
        load_motion(tmp_path / "a.amc")
    assert len(str(caught.value)) < 600


def test_skipped_frames_of_an_amc_are_missing(tmp_path: Path) -> None:
    asf, amc, _ = cmu_pair()
    (tmp_path / "a.asf").write_text(asf)
    (tmp_path / "a.amc").write_text(amc)
    expected = load_motion(tmp_path / "a.amc", smooth_hz=None)
    head, *frames = re.split(r"\n(?=\d+\n)", amc)
    (tmp_path / "a.amc").write_text("\n".join([head, *frames[:20], *frames[30:]]))
    motion = load_motion(tmp_path / "a.amc", smooth_hz=None)
    assert "10 missing frame(s) bridged" in motion.report
    np.testing.assert_allclose(motion.joints, expected.joints, atol=0.01)


def test_low_rates_of_skeletons_are_warned_of(tmp_path: Path) -> None:
    t2d.save_motion(walk_20hz(), tmp_path / "a.bvh")
    text = (tmp_path / "a.bvh").read_text()
    (tmp_path / "a.bvh").write_text(re.sub("Frame Time:.*", "Frame Time: 0.5", text))
    with (
        pytest.warns(T2DWarning, match="2 frames a second hold movements up to 1 Hz only"),
        pytest.warns(T2DWarning, match="the rate of 2 Hz is too low"),
    ):
        load_motion(tmp_path / "a.bvh")


@pytest.mark.parametrize("form", ["named", "kimodo"])
def test_a_rate_of_0_is_refused(tmp_path: Path, form: str) -> None:
    motion = walk_20hz()
    if form == "named":
        np.savez(tmp_path / "a.npz", joints=motion.joints, names=np.array(motion.names), fps=0.0)
    else:
        kimodo_file(tmp_path / "a.npz", fps=0.0)
    with pytest.raises(InputError, match=r"rate_hz must lie in .* got 0\.0"):
        load_motion(tmp_path / "a.npz")


def test_a_missing_package_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.c3d"
    path.write_bytes(b"\x02\x50" + b"\0" * 2000)
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(InputError, match=f"needs the package ezc3d; {re.escape(install('c3d'))}"):
        load_motion(path)


def good_files(folder: Path) -> list[Path]:
    """A small good file of each format that is decoded here."""
    asf, amc, _ = cmu_pair()
    (folder / "a.asf").write_text(asf)
    (folder / "a.amc").write_text(amc.split("\n13\n")[0] + "\n")
    deepmimic_file(folder / "a.json", frames=8)
    tracks = {name: track[:15] for name, track in joint_centres(walk_20hz()).items()}
    (folder / "a.trc").write_text(independent.trc(tracks, 20.0, "m"))
    np.save(folder / "a.npy", y_up(walk_20hz().joints[:15, :22]))
    poses, moved = amass_poses(frames=15)
    save(folder / "a.npz", poses=poses, trans=moved, mocap_framerate=60.0)
    return [folder / f"a.{suffix}" for suffix in ("amc", "json", "trc", "npy", "npz")]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::t2d_rt.core.errors.T2DWarning")
def test_damaged_files_are_read_or_refused(tmp_path: Path) -> None:
    """Bytes cut, changed, removed and put in, in the head and anywhere: no other error than an InputError of one line."""
    rng = np.random.default_rng(RNG_SEED)
    for path in good_files(tmp_path):
        load_motion(path)
        good = path.read_bytes()
        sentences = []
        for kind in 8 * ["cut", "change", "remove", "insert"]:
            data = bytearray(good)
            at = int(rng.integers(min(len(good), 400) if rng.random() < 0.5 else len(good)))
            if kind == "cut":
                del data[at:]
            elif kind == "change":
                data[at] = int(rng.integers(256))
            elif kind == "remove":
                del data[at : at + int(rng.integers(1, 9))]
            else:
                data[at:at] = rng.choice(np.frombuffer(b'0123456789.-einf \n\t{}[]":,', np.uint8), 4).tobytes()
            path.write_bytes(bytes(data))
            try:
                load_motion(path)
            except InputError as error:
                sentences.append(str(error))
        assert len(sentences) > 5, path
        assert not any("\n" in sentence or len(sentence) > 900 for sentence in sentences)
