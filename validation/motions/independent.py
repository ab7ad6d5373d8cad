"""Second ways to write and decode motion files, by rotation matrices and scipy: what the readers are compared with.

None of it shares code with `t2d_rt.motion.read`, which works with quaternions of its own.
"""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

Y_UP = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""Turns z up into y up: (x, y, z) -> (y, z, x)."""

# --- HumanML3D ---

CHAINS = [[0, 2, 5, 8, 11], [0, 1, 4, 7, 10], [0, 3, 6, 9, 12, 15], [9, 14, 17, 19, 21], [9, 13, 16, 18, 20]]
UPWARD, DOWNWARD, LEFTWARD, RIGHTWARD, FORWARD = (0, 1, 0), (0, -1, 0), (1, 0, 0), (-1, 0, 0), (0, 0, 1)
DIRECTIONS = {1: LEFTWARD, 13: LEFTWARD, 2: RIGHTWARD, 14: RIGHTWARD, 10: FORWARD, 11: FORWARD, 15: FORWARD}
DIRECTIONS |= dict.fromkeys((3, 6, 9, 12), UPWARD) | dict.fromkeys((4, 5, 7, 8, 16, 17, 18, 19, 20, 21), DOWNWARD)


def least_rotations(starts: np.ndarray, ends: np.ndarray) -> Rotation:
    """Least rotations (T) from directions to directions, (T, 3) each."""
    starts, ends = (v / np.linalg.norm(v, axis=-1, keepdims=True) for v in np.broadcast_arrays(starts, ends))
    axis = np.cross(starts, ends)
    angle = np.arctan2(np.linalg.norm(axis, axis=-1), (starts * ends).sum(-1))
    return Rotation.from_rotvec(angle[:, None] * axis / np.maximum(np.linalg.norm(axis, axis=-1, keepdims=True), 1e-12))


def humanml3d_vectors(joints: np.ndarray) -> np.ndarray:
    """HumanML3D's published recipe: joints (T, 22, 3), y up -> vectors (T - 1, 263).

    Its first steps (one skeleton for all, floor at 0, first frame at the origin and facing z) are the caller's.
    """
    joints = joints.copy()
    speed = np.linalg.norm(np.diff(joints[:, [7, 10, 8, 11]], axis=0), axis=-1) ** 2
    contacts = (speed < 0.002).astype(float)
    across = joints[:, 2] - joints[:, 1] + joints[:, 17] - joints[:, 16]
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    ahead = gaussian_filter1d(np.cross(np.array([[0.0, 1.0, 0.0]]), across), 20, axis=0, mode="nearest")
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    into = least_rotations(ahead, np.array([0.0, 0.0, 1.0]))
    six = np.zeros((len(joints), 22, 6))
    for chain in CHAINS:
        above = into
        for parent, joint in pairwise(chain):
            turned = least_rotations(np.array(DIRECTIONS[joint], dtype=float), joints[:, joint] - joints[:, parent])
            matrices = (above.inv() * turned).as_matrix()
            six[:, joint] = np.concatenate([matrices[..., 0], matrices[..., 1]], axis=-1)
            above = turned
    step = into[1:].apply(np.diff(joints[:, 0], axis=0))
    turn = np.arcsin((into[1:] * into[:-1].inv()).as_quat(canonical=True)[:, 1])
    local = joints.copy()
    local[..., [0, 2]] -= joints[:, :1, [0, 2]]
    local = np.stack([into.apply(local[:, j]) for j in range(22)], axis=1)
    moved = np.diff(joints, axis=0)
    velocity = np.stack([into[:-1].apply(moved[:, j]) for j in range(22)], axis=1)
    frames = len(joints) - 1
    return np.concatenate(
        [
            turn[:, None], step[:, [0, 2]], joints[:-1, 0, 1:2], local[:-1, 1:].reshape(frames, -1),
            six[:-1, 1:].reshape(frames, -1), velocity.reshape(frames, -1), contacts,
        ],
        axis=-1,
    )  # fmt: skip


# --- SMPL ---


def smpl_joints(
    poses: np.ndarray, moved: np.ndarray, parents: tuple[int, ...], offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Forward kinematics of axis-angle poses (T, 66 or more): joints (T, 22, 3) and matrices (T, 22, 3, 3)."""
    joints, matrices = np.zeros((len(poses), 22, 3)), np.zeros((len(poses), 22, 3, 3))
    for t, pose in enumerate(poses):
        for joint, parent in enumerate(parents[:22]):
            own = Rotation.from_rotvec(pose[3 * joint : 3 * joint + 3]).as_matrix()
            matrices[t, joint] = own if parent < 0 else matrices[t, parent] @ own
            joints[t, joint] = moved[t] if parent < 0 else joints[t, parent] + matrices[t, parent] @ offsets[joint]
    return joints, matrices


# --- DeepMimic ---

HUMANOID = [
    ("chest", "root", (0, 0.236151, 0), 4), ("neck", "chest", (0, 0.223894, 0), 4), ("right_hip", "root", (0, 0, 0.084887), 4),
    ("right_knee", "right_hip", (0, -0.421546, 0), 1), ("right_ankle", "right_knee", (0, -0.40987, 0), 4),
    ("right_shoulder", "chest", (-0.02405, 0.2435, 0.18311), 4), ("right_elbow", "right_shoulder", (0, -0.274788, 0), 1),
    ("right_wrist", "right_elbow", (0, -0.258947, 0), 0), ("left_hip", "root", (0, 0, -0.084887), 4),
    ("left_knee", "left_hip", (0, -0.421546, 0), 1), ("left_ankle", "left_knee", (0, -0.40987, 0), 4),
    ("left_shoulder", "chest", (-0.02405, 0.2435, -0.18311), 4), ("left_elbow", "left_shoulder", (0, -0.274788, 0), 1),
    ("left_wrist", "left_elbow", (0, -0.258947, 0), 0),
]  # fmt: skip
"""Joints of DeepMimic's data/characters/humanoid3d.txt in its order: name, parent, offset [m], numbers per frame."""


def deepmimic_joints(path: Path) -> dict[str, np.ndarray]:
    """Positions (T, 3) by joint, y up."""
    frames = json.loads(path.read_text())["Frames"]
    found: dict[str, list[np.ndarray]] = {name: [] for name in ("root", *(row[0] for row in HUMANOID))}
    for frame in frames:
        values = list(frame[1:])
        place, (w, x, y, z) = np.array(values[:3]), values[3:7]
        values = values[7:]
        at, turned = {"root": place}, {"root": Rotation.from_quat([x, y, z, w]).as_matrix()}
        for name, parent, offset, count in HUMANOID:
            own, values = values[:count], values[count:]
            local = np.eye(3)
            if count == 4:
                local = Rotation.from_quat([*own[1:], own[0]]).as_matrix()
            elif count == 1:
                local = Rotation.from_euler("z", own[0]).as_matrix()
            at[name] = at[parent] + turned[parent] @ np.array(offset, dtype=float)
            turned[name] = turned[parent] @ local
        for name, point in at.items():
            found[name].append(point)
    return {name: np.array(track) for name, track in found.items()}


# --- ASF/AMC ---

CMU_BONES = {
    "lhipjoint": ("LHipJoint", None, ""), "lfemur": ("LeftUpLeg", (0, 0, 20), "rx ry rz"), "ltibia": ("LeftLeg", (0, 0, 20), "rx"),
    "lfoot": ("LeftFoot", (-90, 0, 20), "rx rz"), "ltoes": ("LeftToeBase", (-90, 0, 20), "rx"),
    "rhipjoint": ("RHipJoint", None, ""), "rfemur": ("RightUpLeg", (0, 0, -20), "rx ry rz"),
    "rtibia": ("RightLeg", (0, 0, -20), "rx"), "rfoot": ("RightFoot", (-90, 0, -20), "rx rz"),
    "rtoes": ("RightToeBase", (-90, 0, -20), "rx"),
    "lowerback": ("LowerBack", (0, 0, 0), "rx ry rz"), "upperback": ("Spine", (0, 0, 0), "rx ry rz"),
    "thorax": ("Spine1", (0, 0, 0), "rx ry rz"), "lowerneck": ("Neck", (0, 0, 0), "rx ry rz"),
    "upperneck": ("Neck1", (0, 0, 0), "rx ry rz"), "head": ("Head", (0, 0, 0), "rx ry rz"),
    "lclavicle": ("LeftShoulder", (0, 0, 0), "ry rz"), "lhumerus": ("LeftArm", (180, -30, -90), "rx ry rz"),
    "lradius": ("LeftForeArm", (180, -30, -90), "rx"), "lwrist": ("LeftHand", (0, 90, 90), "ry"),
    "lhand": ("LeftFingerBase", (0, 90, 90), "rx rz"), "lfingers": ("LeftHandIndex1", (0, 90, 90), "rx"),
    "rclavicle": ("RightShoulder", (0, 0, 0), "ry rz"), "rhumerus": ("RightArm", (180, 30, 90), "rx ry rz"),
    "rradius": ("RightForeArm", (180, 30, 90), "rx"), "rwrist": ("RightHand", (0, -90, -90), "ry"),
    "rhand": ("RightFingerBase", (0, -90, -90), "rx rz"), "rfingers": ("RightHandIndex1", (0, -90, -90), "rx"),
}  # fmt: skip
"""Bones of CMU's skeletons: the joint of the BVH files that turns with each, its axis [deg] and its angles."""

CMU_HIERARCHY = """root lhipjoint rhipjoint lowerback
lhipjoint lfemur
lfemur ltibia
ltibia lfoot
lfoot ltoes
rhipjoint rfemur
rfemur rtibia
rtibia rfoot
rfoot rtoes
lowerback upperback
upperback thorax
thorax lowerneck lclavicle rclavicle
lowerneck upperneck
upperneck head
lclavicle lhumerus
lhumerus lradius
lradius lwrist
lwrist lhand
lhand lfingers
rclavicle rhumerus
rhumerus rradius
rradius rwrist
rwrist rhand
rhand rfingers"""


def acclaim(
    ends: dict[str, np.ndarray], local: dict[str, np.ndarray], root: np.ndarray, angle: str = "deg"
) -> tuple[str, str]:
    """Text of an .asf and an .amc of CMU's bones.

    ends: from each bone's start to its end, without any rotation, in CMU's unit.
    local: rotations (T, 3, 3) of each bone in its parent's frame, and of `root`, in axes of the world at rest.
    root: places (T, 3) in CMU's unit.
    """
    scale = 1.0 if angle == "deg" else np.pi / 180
    lines = [":version 1.10", ":name VICON", ":units", "  mass 1.0", "  length 0.45", f"  angle {angle}", ":root"]
    lines += ["  order TX TY TZ RX RY RZ", "  axis XYZ", "  position 0 0 0", "  orientation 0 0 0", ":bonedata"]
    for number, (name, (_, axis, angles)) in enumerate(CMU_BONES.items(), 1):
        length = float(np.linalg.norm(ends[name]))
        direction = ends[name] / max(length, 1e-12)
        lines += ["  begin", f"    id {number}", f"    name {name}"]
        lines += [f"    direction {' '.join(f'{x:.9f}' for x in direction)}", f"    length {length:.9f}"]
        lines += [f"    axis {' '.join(f'{scale * x:.12f}' for x in axis or (0, 0, 0))}  XYZ"]
        lines += [f"    dof {angles}", "    limits (-160.0 20.0)"] if angles else []
        lines += ["           (-70.0 70.0)"] * max(len(angles.split()) - 1, 0) + ["  end"]
    asf = "\n".join([*lines, ":hierarchy", "  begin", *CMU_HIERARCHY.splitlines(), "  end", ""])
    euler = {"root": Rotation.from_matrix(local["root"]).as_euler("xyz", degrees=True)}
    for name, (_, axis, angles) in CMU_BONES.items():
        if angles:
            frame = Rotation.from_euler("xyz", axis, degrees=True)
            own = (frame.inv() * Rotation.from_matrix(local[name]) * frame).as_euler("xyz", degrees=True)
            euler[name] = own[:, ["xyz".index(each[1]) for each in angles.split()]]
    rows = [":FULLY-SPECIFIED", ":DEGREES" if angle == "deg" else ":RADIANS"]
    for t in range(len(root)):
        rows.append(str(t + 1))
        for name, values in euler.items():
            numbers = [*(root[t] if name == "root" else ()), *(scale * values[t])]
            rows.append(f"{name} {' '.join(f'{x:.9f}' for x in numbers)}")
    return asf, "\n".join([*rows, ""])


# --- tables of markers ---


def trc(tracks: dict[str, np.ndarray], rate_hz: float, unit: str = "mm") -> str:
    """Text of a .trc of tracks (T, 3) in some unit; NaN leaves cells empty."""
    frames = len(next(iter(tracks.values())))
    lines = ["PathFileType\t4\t(X/Y/Z)\tmade.trc"]
    lines += ["DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames"]
    lines += [f"{rate_hz}\t{rate_hz}\t{frames}\t{len(tracks)}\t{unit}\t{rate_hz}\t1\t{frames}"]
    lines += ["Frame#\tTime\t" + "\t\t\t".join(tracks) + "\t\t"]
    lines += ["\t\t" + "\t".join(f"{axis}{i}" for i in range(1, len(tracks) + 1) for axis in "XYZ"), ""]
    for t in range(frames):
        cells = [f"{x:.6f}" if np.isfinite(x) else "" for track in tracks.values() for x in track[t]]
        lines.append("\t".join([str(t + 1), f"{t / rate_hz:.5f}", *cells]))
    return "\n".join([*lines, ""])
