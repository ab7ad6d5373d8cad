"""Files of suits, cameras, pose estimators and animation programs, written here by formulas of their own."""

from __future__ import annotations

import dataclasses
import json
import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp
from test_read_formats import skin_markers

import t2d_rt as t2d
from builders import WALK
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion import load_motion, load_motions
from t2d_rt.motion.interpolate import decompose
from t2d_rt.motion.read.gltf import _linear, _spline
from t2d_rt.motion.read.joint_sets import ORDERS, side_and_part
from t2d_rt.motion.skeletons import sided, tables
from t2d_rt.types.motion import CANONICAL_JOINTS, CANONICAL_PARENTS, Motion
from validation.motions import independent

RATE_HZ = 50.0
LIMBS = tuple(
    f"{side}_{joint}" for joint in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist") for side in ("left", "right")
)


@cache
def truth() -> Motion:
    return t2d.trim(t2d.resample(load_motion(WALK), RATE_HZ), 0.5, 2.5)


def at(name: str) -> np.ndarray:
    return truth().joints[:, truth().index(name)]


def turn(name: str) -> Rotation:
    return Rotation.from_quat(truth().rotations[:, truth().index(name)])


def check(
    motion: Motion, names: tuple[str, ...] = LIMBS, *, turned: bool = False, within_m: float = 1e-3, every: int = 1
) -> None:
    """Joints within 1 mm of the truth but for the floor's height, with what is ahead in the file; turns within 0.5 degrees.

    every: step between the truth's frames that the motion has.
    """
    assert motion.rate_hz == pytest.approx(RATE_HZ / every)
    found = motion.joints[:, [motion.index(name) for name in names]]
    expected = np.stack([at(name)[::every] for name in names], axis=1)
    assert found.shape == expected.shape
    shift = (expected - found).mean((0, 1)) * [0, 0, 1]
    assert np.linalg.norm(found + shift - expected, axis=-1).max() < within_m
    for name in names if turned else ():
        mine = Rotation.from_quat(motion.rotations[:, motion.index(name)])
        true = turn(name)[::every]
        apart = (mine * mine[0].inv()) * (true * true[0].inv()).inv()
        assert np.degrees(apart.magnitude()).max() < 0.5, name


# --- suits and Motive ---

XSENS = {
    "Pelvis": "pelvis", "L5": "spine1", "L3": "spine1", "T12": "spine2", "T8": "spine3", "Neck": "neck", "Head": "head",
    **{
        f"{side.title()}{part}": f"{side}_{joint}"
        for side in ("right", "left")
        for part, joint in {
            "Shoulder": "collar", "UpperArm": "shoulder", "ForeArm": "elbow", "Hand": "wrist", "UpperLeg": "hip",
            "LowerLeg": "knee", "Foot": "ankle", "Toe": "foot",
        }.items()
    },
}  # fmt: skip
MOTIVE = {
    "Ab": "spine1", "Chest": "spine3", "Neck": "neck", "Head": "head",
    **{
        f"{side[0].upper()}{part}": f"{side}_{joint}"
        for side in ("left", "right")
        for part, joint in {
            "Shoulder": "collar", "UArm": "shoulder", "FArm": "elbow", "Hand": "wrist", "Thigh": "hip", "Shin": "knee",
            "Foot": "ankle", "Toe": "foot",
        }.items()
    },
}  # fmt: skip


def mvnx(
    path: Path, *, rate: str = f'frameRate="{RATE_HZ:g}"', subjects: tuple[str, ...] = ("Ann",), times: bool = True
) -> Path:
    """Segments [m], z up; a T-pose stands before, which is none of the motion."""
    segments = "".join(f'<segment label="{name}" id="{k}"/>' for k, name in enumerate(XSENS, 1))
    places = np.stack([at(joint) for joint in XSENS.values()], axis=1)
    turns = np.stack([turn(joint).as_quat()[:, [3, 0, 1, 2]] for joint in XSENS.values()], axis=1)
    texts = []
    for who, name in enumerate(subjects):
        rows = ['<frame time="0" type="tpose"><orientation>1 0 0 0</orientation><position>0 0 0</position></frame>']
        for t in range(len(places)):
            clock = f'time="{1e3 * t / RATE_HZ:.0f}"' if times else ""
            place, turned = (" ".join(f"{x:.6f}" for x in v.ravel()) for v in (places[t] + [0, 2.0 * who, 0], turns[t]))
            rows.append(
                f'<frame {clock} type="normal"><orientation>{turned}</orientation><position>{place}</position></frame>'
            )
        texts.append(
            f'<subject label="{name}" {rate}><segments>{segments}</segments><frames>{"".join(rows)}</frames></subject>'
        )
    path.write_text(
        f'<?xml version="1.0"?><mvnx xmlns="http://www.xsens.com/mvn/mvnx" version="4">{"".join(texts)}</mvnx>'
    )
    return path


def motive(path: Path, *, space: str = "Global", quaternions: bool = True, hip: str = "Bob:Hip") -> Path:
    """Bones with quaternions x, y, z, w, y up."""
    bones = {hip: "pelvis"} | {f"Bob:{name}": joint for name, joint in MOTIVE.items()}
    y_up = Rotation.from_matrix(independent.Y_UP)
    columns, axes, what, names = [], [], [], []
    for name, joint in bones.items():
        if quaternions:
            columns.append((y_up * turn(joint)).as_quat())
            axes, what, names = axes + [*"XYZW"], what + ["Rotation"] * 4, names + [name] * 4
        columns.append(1e3 * at(joint) @ independent.Y_UP.T)
        axes, what, names = axes + [*"XYZ"], what + ["Position"] * 3, names + [name] * 3
    table = np.concatenate(columns, axis=1)
    lines = [
        f"Format Version,1.23,Take Name,a,Capture Frame Rate,{RATE_HZ},Export Frame Rate,{RATE_HZ},Rotation Type,Quaternion,"
        f"Length Units,Millimeters,Coordinate Space,{space}",
        "",
        ",Type," + ",".join(["Bone"] * len(names)),
        ",Name," + ",".join(names),
        ",ID," + ",".join(["1"] * len(names)),
        ",," + ",".join(what),
        "Frame,Time (Seconds)," + ",".join(axes),
        *(f"{t},{t / RATE_HZ:.6f}," + ",".join(f"{x:.6f}" for x in row) for t, row in enumerate(table)),
    ]
    path.write_text("\n".join(lines))
    return path


def test_a_suit_of_xsens(tmp_path: Path) -> None:
    motion = load_motion(mvnx(tmp_path / "a.mvnx"), smooth_hz=None)
    check(motion, CANONICAL_JOINTS[:1] + LIMBS, turned=True)
    assert "MVNX, 101 frames at 50 Hz; bones named as xsens; rate by its time" in motion.report
    assert list(load_motions(mvnx(tmp_path / "c.mvnx", subjects=("Ann", "Ann")))) == ["Ann", "Ann 2"]
    two = mvnx(tmp_path / "b.mvnx", subjects=("Ann", "Ben"), rate="", times=False)
    with pytest.warns(T2DWarning, match="holds 2 subjects, Ann, Ben: Ann is taken"):
        assert "60 Hz assumed" in load_motion(two, smooth_hz=None).report
    apart = load_motion(two, subject="Ben", rate_hz=RATE_HZ, smooth_hz=None).joints - motion.joints
    assert np.allclose(apart, [0, 2, 0], atol=1e-3)


@pytest.mark.parametrize("hip", ["Bob:Hip", "Bob:Bob", "Bob"])
@pytest.mark.parametrize("quaternions", [True, False])
def test_a_skeleton_of_motive(tmp_path: Path, hip: str, quaternions: bool) -> None:
    motion = load_motion(motive(tmp_path / "a.csv", quaternions=quaternions, hip=hip), smooth_hz=None)
    check(motion, ("pelvis", *LIMBS), turned=quaternions)
    assert ("rotations from positions" in motion.report) == (not quaternions)


def test_what_is_no_skeleton_of_motive(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="export it with Coordinate Space: Global"):
        load_motion(motive(tmp_path / "a.csv", space="Local"))
    text = motive(tmp_path / "a.csv").read_text()
    (tmp_path / "b.csv").write_text(text.replace(",Bone", ",Rigid Body"))
    with pytest.raises(InputError, match="holds rigid body and no skeleton"):
        load_motion(tmp_path / "b.csv")
    (tmp_path / "c.csv").write_text(text.replace("LThigh", "Oberschenkel"))
    with pytest.raises(InputError, match="lack LThigh of the names that are nearest, motive"):
        load_motion(tmp_path / "c.csv")


# --- animations ---


def glb(path: Path, *, scale: float = 1.0, how: str = "LINEAR", whole: bool = False, every: int = 1) -> Path:
    """Canonical joints as nodes below an armature that is turned and scaled, every bone's frame turned at random at rest."""
    joints = truth().joints
    rest = Rotation.random(len(CANONICAL_JOINTS), rng=3)
    turned = [turn(name) * rest[k] for k, name in enumerate(CANONICAL_JOINTS)]
    armature = Rotation.from_euler("x", 90, degrees=True)
    # The scene is y up: the armature's own axes are those of the truth but for two turns, one of which is its own.
    scene = Rotation.from_matrix(independent.Y_UP)
    inside = armature.inv() * scene
    frames = np.arange(0, len(joints), every)
    blob, views, accessors = b"", [], []

    def stored(values: np.ndarray, kind: str, component: int = 5126) -> int:
        nonlocal blob
        data = values.astype("<i2" if component == 5122 else "<f4").tobytes()
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)})
        accessors.append({"bufferView": len(views) - 1, "componentType": component, "count": len(values), "type": kind})
        accessors[-1] |= {"normalized": True} if component == 5122 else {}
        blob += data + b"\0" * (-len(data) % 4)
        return len(accessors) - 1

    nodes: list[dict[str, Any]] = [
        {"name": "Armature", "scale": [scale] * 3, "rotation": armature.as_quat().tolist(), "children": []}
    ]
    clock = stored((frames / RATE_HZ)[:, None], "SCALAR")
    samplers, channels = [], []
    for k, (name, parent) in enumerate(zip(CANONICAL_JOINTS, CANONICAL_PARENTS, strict=True)):
        if parent < 0:
            local, shift = inside * turned[k], inside.apply(joints[:, k]) / scale
        else:
            local = turned[parent].inv() * turned[k]
            shift = turned[parent].inv().apply(joints[:, k] - joints[:, parent]) / scale
        nodes[parent + 1]["children"].append(k + 1)
        at_rest = {"translation": shift[0].tolist(), "rotation": local[0].as_quat().tolist()}
        nodes.append({"name": f"rig:{name}", "children": [], **at_rest})
        for what, values, kind in (("rotation", local.as_quat(), "VEC4"), ("translation", shift, "VEC3")):
            values = values[frames]
            if how == "CUBICSPLINE":
                slope = np.gradient(values, frames / RATE_HZ, axis=0)
                values = np.stack([slope, values, slope], axis=1).reshape(-1, values.shape[1])
            small = whole and what == "rotation"
            output = stored(np.round(values * 32767) if small else values, kind, 5122 if small else 5126)
            samplers.append({"input": clock, "output": output, "interpolation": how})
            channels.append({"sampler": len(samplers) - 1, "target": {"node": k + 1, "path": what}})
    tree = {
        "asset": {"version": "2.0"}, "nodes": nodes, "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(blob)}], "skins": [{"joints": list(range(1, len(nodes)))}],
        "animations": [{"name": "walk", "samplers": samplers, "channels": channels}],
    }  # fmt: skip
    return packed(path, tree, blob)


def packed(path: Path, tree: dict[str, Any], blob: bytes) -> Path:
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(blob), 0x004E4942) + blob
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


@pytest.mark.parametrize("options", [{}, {"scale": 0.01}, {"whole": True}])
def test_an_animated_glb(tmp_path: Path, options: dict[str, Any]) -> None:
    motion = load_motion(glb(tmp_path / "a.glb", **options), smooth_hz=None)
    check(motion, ("pelvis", *LIMBS), turned=True)
    assert "GLB, 101 frames at 50 Hz" in motion.report


def test_keys_of_a_glb_are_met_and_interpolated(tmp_path: Path) -> None:
    """Every second key alone: between them rotations go along great circles, as scipy has it; splines come nearer to the truth."""
    times = np.arange(101) / RATE_HZ
    keys, local = times[::2], turn("left_knee")
    between = Slerp(keys, local[::2])(times)
    assert (Rotation.from_quat(_linear(keys, local.as_quat()[::2], times)) * between.inv()).magnitude().max() < 1e-6
    place = at("left_ankle")
    slope = np.gradient(place[::2], keys, axis=0)
    spline = _spline(keys, np.stack([slope, place[::2], slope], axis=1).reshape(-1, 3), times)
    assert np.abs(spline - place).max() < 0.5 * np.abs(_linear(keys, place[::2], times) - place).max()
    motion = load_motion(glb(tmp_path / "a.glb", every=2, how="CUBICSPLINE"), smooth_hz=None)
    check(motion, ("pelvis", *LIMBS), turned=True, every=2)


def test_a_glb_without_a_motion(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no animation"):
        load_motion(packed(tmp_path / "a.glb", {"asset": {"version": "2.0"}, "nodes": [{}]}, b""))
    glb(tmp_path / "b.glb")
    data = (tmp_path / "b.glb").read_bytes()
    (tmp_path / "b.glb").write_bytes(data[:-20_000])
    with pytest.raises(InputError, match="cannot be read; the file is cut short or damaged"):
        load_motion(tmp_path / "b.glb")


@pytest.mark.parametrize(
    "damage", [("children", 7), ("children", [99]), ("children", [None]), ("scale", "x"), ("rotation", [1])]
)
def test_a_glb_of_damaged_nodes(tmp_path: Path, damage: tuple[str, Any]) -> None:
    data = glb(tmp_path / "a.glb").read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    tree = json.loads(data[20 : 20 + length])
    tree["nodes"][0][damage[0]] = damage[1]
    with pytest.raises(InputError, match="damaged"):
        load_motion(packed(tmp_path / "a.glb", tree, data[28 + length :]))


# --- cameras and pose estimators ---

PARTS = {
    "hip": "hip", "knee": "knee", "ankle": "ankle", "foot": "foot", "shoulder": "shoulder", "elbow": "elbow", "wrist": "wrist",
    "bigtoe": "foot", "smalltoe": "foot", "heel": "ankle", "footindex": "foot",
}  # fmt: skip
CENTRAL = {
    "spinebase": "pelvis", "midhip": "pelvis", "spinemid": "spine2", "neck": "neck", "head": "head", "spineshoulder": "neck",
    "nose": "head",
}  # fmt: skip


def ordered(order: str) -> np.ndarray:
    """The truth's joints (T, K, 3) in an order of names; what it has none for lies at the head or the hand."""
    found = []
    for name in ORDERS[order]:
        side, part = side_and_part(name)
        joint = f"{side}_{PARTS[part]}" if part in PARTS else CENTRAL.get(part)
        arm = any(word in part for word in ("hand", "thumb", "pinky", "index"))
        found.append(at(joint or (f"{side}_wrist" if arm else "head")) + (0 if joint else 0.03))
    return np.stack(found, axis=1)


KINECT = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""From who walks along x, z up, to a camera that is walked to: x to its left, y up, z away from it. Right-handed."""
CAMERA = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
"""Likewise for a picture's axes: x right, y down, z away."""


def back(motion: Motion) -> Motion:
    """A motion turned about the vertical, and shifted over the floor, onto the truth as well as its limbs go."""
    mine, true = (each.joints[:, [each.index(name) for name in LIMBS]] for each in (motion, truth()))
    p, q = ((each - each.mean((0, 1)))[..., :2].reshape(-1, 2) for each in (mine, true))
    angle = np.arctan2((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum(), (p * q).sum())
    turned = Rotation.from_euler("z", angle)
    joints = turned.apply((motion.joints - mine.mean((0, 1))).reshape(-1, 3)).reshape(motion.joints.shape)
    return dataclasses.replace(motion, joints=joints + true.mean((0, 1)))


def ntu(path: Path, people: dict[str, np.ndarray], tracked: Callable[[int], bool] = lambda t: True) -> Path:
    """A .skeleton of bodies (T, 25, 3) [m] in the camera's axes; a hand is inferred throughout."""
    frames = len(next(iter(people.values())))
    lines = [str(frames)]
    for t in range(frames):
        there = {name: joints for name, joints in people.items() if name == next(iter(people)) or tracked(t)}
        lines.append(str(len(there)))
        for name, joints in there.items():
            lines += [f"{name} 0 1 1 1 1 0 -0.03 0.05 2", "25"]
            lines += [
                f"{x:.6f} {y:.6f} {z:.6f} 250.1 190.2 990.1 500.2 0.1 0.2 0.3 0.9 {1 if k == 21 else 2}"
                for k, (x, y, z) in enumerate(joints[t])
            ]
    path.write_text("\n".join(lines))
    return path


def test_bodies_of_ntu(tmp_path: Path) -> None:
    joints = ordered("Kinect v2") @ KINECT.T
    path = ntu(tmp_path / "S001C001P001R001A001.skeleton", {"72057594037931101": joints})
    motion = load_motion(path, rate_hz=RATE_HZ, smooth_hz=None)
    check(back(motion))
    assert "4.0% of the points have a confidence under 0.5" in motion.report
    assert "30 Hz assumed" in load_motion(path, smooth_hz=None).report
    two = ntu(tmp_path / "two.skeleton", {"7": joints, "8": joints + [1.5, 0, 0]}, tracked=lambda t: t % 40 < 38)
    with pytest.warns(T2DWarning, match="holds 2 subjects, 1, 2"):
        load_motion(two, smooth_hz=None)
    other = load_motion(two, subject="2", rate_hz=RATE_HZ, smooth_hz=None)
    check(back(other), within_m=2e-3)
    assert "bridged" in other.report
    path.write_text(path.read_text()[:50_000])
    with pytest.raises(InputError, match=r"is not an NTU RGB\+D skeleton file, or cut short"):
        load_motion(path)


def test_columns_of_mars(tmp_path: Path) -> None:
    """(T, 57): x of 19 joints, then y, then z; z up, the camera walked to along y."""
    axes = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    joints = ordered("MARS") @ axes.T
    columns = joints.swapaxes(1, 2).reshape(len(joints), 57)
    np.save(tmp_path / "a.npy", columns)
    motion = load_motion(tmp_path / "a.npy", rate_hz=RATE_HZ, smooth_hz=None)
    check(back(motion))
    assert "joints in the order of MARS" in motion.report
    assert "columns of all x, all y, all z" in motion.report
    with pytest.warns(T2DWarning, match="10 frames a second hold movements up to 5 Hz only"):
        assert "10 Hz assumed" in load_motion(tmp_path / "a.npy").report
    np.save(tmp_path / "b.npy", joints.reshape(len(joints), 57))
    assert "columns of" not in load_motion(tmp_path / "b.npy", rate_hz=RATE_HZ).report
    np.save(tmp_path / "c.npy", columns * np.repeat([-1.0, 1.0, 1.0], 19))
    with pytest.raises(
        InputError, match="knees and feet point backward: left and right are swapped, or the axes are left-handed"
    ):
        load_motion(tmp_path / "c.npy", rate_hz=RATE_HZ)


def openpose(joints: np.ndarray, sure: np.ndarray) -> list[list[float]]:
    return np.concatenate([joints, sure[..., None]], axis=-1).reshape(len(joints), -1).tolist()


def test_body_25_of_openpose(tmp_path: Path) -> None:
    joints = ordered("OpenPose BODY_25") @ CAMERA.T
    sure = np.full(joints.shape[:2], 0.8)
    sure[30:33, 4] = 0.0
    lost = np.where(sure[..., None] == 0, 0.0, joints)
    there, beside = openpose(lost, sure), openpose(joints + [1.5, 0, 0], sure)
    # Listed by turns: whoever is first is not always the same person.
    people = [[a, b][:: 1 if t % 7 else -1] for t, (a, b) in enumerate(zip(there, beside, strict=True))]
    frames = [{"people": [{"person_id": [-1], "pose_keypoints_3d": each} for each in those]} for those in people]
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"fps": RATE_HZ, "frames": frames}))
    found = [back(load_motion(path, subject=who, smooth_hz=None)) for who in ("1", "2")]
    limbs = tuple(name for name in LIMBS if name != "right_wrist")
    for motion in found:
        check(motion, limbs)
        check(motion, within_m=0.02)
    assert "have no confidence and count as not seen" in found[0].report
    path.write_text(json.dumps([{"people": [{"pose_keypoints_2d": there[0]}]}] * 9))
    with pytest.raises(InputError, match="points lie in the picture"):
        load_motion(path)
    np.save(tmp_path / "a.npy", np.concatenate([joints, sure[..., None]], axis=-1))
    check(back(load_motion(tmp_path / "a.npy", rate_hz=RATE_HZ, smooth_hz=None)), limbs)
    np.save(tmp_path / "b.npy", np.concatenate([joints, 50 * sure[..., None]], axis=-1))
    with pytest.raises(InputError, match="the fourth number of each point must be a confidence from 0 to 1"):
        load_motion(tmp_path / "b.npy")


@pytest.mark.parametrize("form", ["named", "task", "array"])
def test_world_landmarks_of_mediapipe(tmp_path: Path, form: str) -> None:
    """About the hips, y down: the pose is right, the way is lost, which a warning says."""
    joints = ordered("MediaPipe 33") @ CAMERA.T
    hips = joints[:, [23, 24]].mean(axis=1, keepdims=True)
    about = joints - hips
    points = [
        [dict(zip(("x", "y", "z", "visibility"), (*p, 0.9), strict=True)) for p in pose] for pose in about.tolist()
    ]
    frames = {
        "named": {"fps": RATE_HZ, "frames": [{"pose_world_landmarks": each} for each in points]},
        "task": [
            {"timestamp_ms": 20 * t, "landmarks": [each], "worldLandmarks": [each]} for t, each in enumerate(points)
        ],
    }
    path = tmp_path / ("a.npy" if form == "array" else "a.json")
    if form == "array":
        np.save(path, np.concatenate([about, np.full((*about.shape[:2], 2), 0.9)], axis=-1))
    else:
        path.write_text(json.dumps(frames[form]))
    with pytest.warns(T2DWarning, match="hips"):
        motion = load_motion(path, rate_hz=RATE_HZ if form == "array" else None, smooth_hz=None)
    assert motion.rate_hz == pytest.approx(RATE_HZ)
    carried = motion.joints + (0.5 * (at("left_hip") + at("right_hip")))[:, None] @ heading(motion).as_matrix()
    check(back(dataclasses.replace(motion, joints=carried)))


def heading(motion: Motion) -> Rotation:
    """The turn about the vertical from the file's x to the truth's, by the poses alone."""
    mine, true = (each.joints[:, [each.index(name) for name in LIMBS]] for each in (motion, truth()))
    p, q = ((each - each.mean(1, keepdims=True))[..., :2].reshape(-1, 2) for each in (mine, true))
    return Rotation.from_euler("z", np.arctan2((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum(), (p * q).sum()))


def test_landmarks_in_a_picture_are_refused(tmp_path: Path) -> None:
    joints = ordered("MediaPipe 33") @ CAMERA.T
    flat = (joints - joints.min((0, 1))) / np.ptp(joints, axis=(0, 1)).max()
    (tmp_path / "a.json").write_text(json.dumps([{"pose_landmarks": pose} for pose in flat.tolist()]))
    with pytest.raises(InputError, match="landmarks in the picture, x and y from 0 to 1"):
        load_motion(tmp_path / "a.json")


def test_a_table_of_named_columns(tmp_path: Path) -> None:
    joints = ordered("Kinect v2")
    header = ["time_s", *(f"{name}_{axis}" for axis in "XYZ" for name in ORDERS["Kinect v2"])]
    table = np.column_stack([np.arange(len(joints)) / RATE_HZ, joints.swapaxes(1, 2).reshape(len(joints), -1)])
    np.savetxt(tmp_path / "a.csv", table, delimiter=";", header=";".join(header), comments="")
    check(load_motion(tmp_path / "a.csv", smooth_hz=None))
    np.savetxt(tmp_path / "b.csv", table, delimiter=",", header=",".join(f"c{k}" for k in range(76)), comments="")
    with pytest.raises(InputError, match="none of which are NAME_X, NAME_Y and NAME_Z"):
        load_motion(tmp_path / "b.csv")


def test_parameters_of_smplx(tmp_path: Path) -> None:
    """As AMASS holds the same motion; hands are left out, and a camera's axes (y down) are found."""
    names = CANONICAL_JOINTS
    local = decompose(truth().joints[:, :22], truth().rotations[:, :22], CANONICAL_PARENTS)[1]
    poses = Rotation.from_quat(local.reshape(-1, 4)).as_rotvec().reshape(-1, 22, 3)
    moved = at("pelvis")
    np.savez(tmp_path / "a.npz", poses=poses.reshape(-1, 66), trans=moved, mocap_framerate=RATE_HZ)
    expected = load_motion(tmp_path / "a.npz", smooth_hz=None)
    hands = np.zeros((len(poses), 45))
    parts = {"body_pose": poses[:, 1:].reshape(-1, 63), "left_hand_pose": hands, "betas": np.zeros(10), "fps": RATE_HZ}
    np.savez(tmp_path / "b.npz", global_orient=poses[:, 0], transl=moved, **parts)
    motion = load_motion(tmp_path / "b.npz", smooth_hz=None)
    assert "parameters of smplx" in motion.report
    assert np.abs(motion.joints - expected.joints).max() < 1e-9
    assert motion.names == expected.names
    assert len(names) == 22
    np.savez(tmp_path / "c.npz", global_orient=poses[:, 0], **parts)
    with pytest.raises(InputError, match="lacks trans or transl"):
        load_motion(tmp_path / "c.npz")
    matrices = Rotation.from_rotvec(poses.reshape(-1, 3)).as_matrix().reshape(-1, 22, 3, 3)
    apart = {"global_orient": poses[:, 0], "body_pose": poses[:, 1:], "transl": moved}
    for name, wrong in (
        ("global_orient", matrices[:, 0]), ("global_orient", matrices[:, 0].reshape(-1, 9)), ("body_pose", matrices[:, 1:]),
        ("body_pose", matrices[:, 1:].reshape(-1, 189)), ("poses", matrices.reshape(-1, 198)),
    ):  # fmt: skip
        np.savez(tmp_path / "d.npz", **apart | {name: wrong})
        with pytest.raises(InputError, match=f"{name} must be axis-angle vectors, .* convert rotation matrices"):
            load_motion(tmp_path / "d.npz")
    np.savez(tmp_path / "e.npz", **apart | {"global_orient": poses[1:, 0]})
    with pytest.raises(InputError, match="global_orient has 100 frames and body_pose 101"):
        load_motion(tmp_path / "e.npz")


def test_a_body_that_stays_in_a_t_pose_is_told(tmp_path: Path) -> None:
    """Rotations that are all zero, as rotations and as positions, in all frames or in some."""
    walking = np.stack([0.03 * np.arange(60.0), np.zeros(60), np.zeros(60)], axis=1)
    body = {"global_orient": np.tile([np.pi / 2, 0, 0], (60, 1)), "body_pose": np.zeros((60, 63)), "transl": walking}
    np.savez(tmp_path / "a.npz", **body, betas=np.zeros(10))
    with pytest.warns(T2DWarning, match="stays in one pose with its arms held out to the sides, a T-pose"):
        motion = load_motion(tmp_path / "a.npz", smooth_hz=None)
    assert "; a T-pose in all frames; " in motion.report
    np.save(tmp_path / "b.npy", motion.joints[:, :22])
    with pytest.warns(T2DWarning, match="stays in one pose with its arms held out to the sides, a T-pose"):
        load_motion(tmp_path / "b.npy", smooth_hz=None)
    knee = CANONICAL_JOINTS.index("left_knee")
    body["body_pose"][:, 3 * knee - 3] = 0.3 + 0.1 * np.sin(0.3 * np.arange(60.0))
    np.savez(tmp_path / "c.npz", **body)
    assert "no T-pose" in load_motion(tmp_path / "c.npz", smooth_hz=None).report  # one knee moves: no warning
    body["body_pose"][20:27] = 0
    np.savez(tmp_path / "d.npz", **body)
    with pytest.warns(T2DWarning, match="in 7 of 60 frames, first in frame 20, all rotations of the body are zero"):
        load_motion(tmp_path / "d.npz", smooth_hz=None)
    np.savez(tmp_path / "e.npz", poses=np.zeros((60, 156)), mocap_framerate=60.0)
    with pytest.raises(InputError, match="lacks trans or transl"):
        load_motion(tmp_path / "e.npz")


def test_a_rate_that_is_given_is_used_throughout(tmp_path: Path) -> None:
    """AMASS' stature, by the speed of planted feet, too: as with the rate in the file, where it has none or a wrong one."""
    local = decompose(truth().joints[:, :22], truth().rotations[:, :22], CANONICAL_PARENTS)[1]
    arrays = {"poses": Rotation.from_quat(local.reshape(-1, 4)).as_rotvec().reshape(-1, 66), "trans": at("pelvis")}
    found = []
    for rate in ({"fps": RATE_HZ}, {}, {"fps": 8 * RATE_HZ}, {"fps": 1e308}):
        np.savez(tmp_path / "a.npz", **arrays, **rate)
        found.append(load_motion(tmp_path / "a.npz", smooth_hz=None, rate_hz=RATE_HZ if found else None))
    assert "at which planted feet slide least" in found[0].report
    assert [each.report for each in found[1:]] == [found[0].report] * 3
    with pytest.raises(InputError, match="flavour 'mixamo' names the joints of"):
        load_motion(tmp_path / "a.npz", rate_hz=RATE_HZ, flavour="mixamo")


POINTS = [[0.1 * k, 0.2, 0.3] for k in range(33)]


@pytest.mark.parametrize(
    ("tree", "match"),
    [
        ([[[]]] * 9, r"every person must have the same points .* got \[\]"),
        ([{"worldLandmarks": [[]]}] * 9, r"every person must have the same points .* got \[\]"),
        ([[[[]]]] * 9, r"every person must have the same points .* got \[\(1, 0\)\]"),
        ([{"timestamp": 0, "landmarks": POINTS}, POINTS], "lie 3.0 lengths of a leg apart"),
        ({"fps": 10**400, "frames": [POINTS] * 9}, "fps must be one number, got inf"),
        ({"fps": 25, "frames": [[[10**400, 0, 0], *POINTS[1:]]] * 9}, "lie 3.0 lengths of a leg apart"),
    ],
)
def test_points_of_damaged_json(tmp_path: Path, tree: object, match: str) -> None:
    (tmp_path / "a.json").write_text(json.dumps(tree))
    with pytest.raises(InputError, match=match):
        load_motion(tmp_path / "a.json")


def test_what_is_wrong_within_a_file_is_told(tmp_path: Path) -> None:
    """By the sentence for it, not by one that the file is cut short or of another kind."""
    (tmp_path / "a.skeleton").write_text("1\n0\n")
    mvnx(tmp_path / "b.mvnx").write_text(mvnx(tmp_path / "b.mvnx").read_text().replace("<position>", "<position>1 "))
    data = glb(tmp_path / "c.glb").read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    tree = json.loads(data[20 : 20 + length])
    tree["accessors"][0]["sparse"] = {}
    packed(tmp_path / "c.glb", tree, data[28 + length :])
    for name, match in (
        ("a.skeleton", "has 1 frames; expected 2 to"), ("b.mvnx", "b.mvnx: a frame must hold 3 and 4 numbers for each of 23"),
        ("c.glb", "its animation is sparse"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=match) as caught:
            load_motion(tmp_path / name)
        assert "not a" not in str(caught.value)


# --- markers of other sets ---


@pytest.mark.parametrize("kind", ["qualisys animation, motive baseline", "ior", "opencap", "opensim rajagopal", "bts"])
def test_markers_by_a_table_of_names(tmp_path: Path, kind: str) -> None:
    """Markers put half a joint's width outward and inward: joints lie between them, or inward of the outer one alone."""
    known = skin_markers(truth())
    left = at("left_hip") - at("right_hip")
    left = left / np.linalg.norm(left, axis=-1, keepdims=True)
    for s, side in (("L", "left"), ("R", "right")):
        for outer, inner, joint in (("KNE", "KNM", "knee"), ("ANK", "ANM", "ankle"), ("ELB", "ELM", "elbow")):
            known[f"{s}{inner}"] = 2 * at(f"{side}_{joint}") - known[f"{s}{outer}"]
    known["SACR"] = 0.5 * (known["LPSI"] + known["RPSI"])
    table = sided(tables()["marker_sets"][kind])
    hips = () if "SACR" in table else ("LASI", "RASI", "LPSI", "RPSI")
    kept = {label: known[label] for label in hips if label not in table}
    tracks = kept | {table[label].lower(): known[label] for label in table if label in known}
    tracks = {name: track @ independent.Y_UP.T for name, track in tracks.items()}
    (tmp_path / "a.trc").write_text(independent.trc(tracks, RATE_HZ, "m"))
    motion = load_motion(tmp_path / "a.trc", smooth_hz=None)
    inner = kind != "bts"
    for joint in ("knee", "ankle", "elbow"):
        for side in ("left", "right"):
            gap = motion.joints[:, motion.index(f"{side}_{joint}")] - at(f"{side}_{joint}")
            gap[:, 2] -= np.median(gap[:, 2])
            assert np.linalg.norm(gap, axis=-1).mean() < (1e-3 if inner else 0.03), (side, joint)
