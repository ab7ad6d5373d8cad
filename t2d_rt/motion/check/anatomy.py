"""Whether a body could take its postures: ranges of joints, parts that go through one another, sides that are swapped.

Angles come from positions alone: a file's rotations have a zero of its own. So which way an elbow bends cannot be told, and
how an arm or a leg is turned about its own axis neither.
"""

from __future__ import annotations

import numpy as np

from t2d_rt.geometry.vectors import unit
from t2d_rt.motion.check.tracks import Tracks, angle_deg

SIDES = "left", "right"

RANGES_DEG: dict[str, tuple[float, str]] = {
    "knee_flexion_deg": (165.0, "a knee bends to 140 by itself and to 165 under the body's weight"),
    "knee_hyperextension_deg": (20.0, "a knee extends beyond straight by 5 to 15"),
    "elbow_flexion_deg": (160.0, "an elbow bends to 150"),
    "hip_flexion_deg": (175.0, "a hip bends to 120, and the lumbar spine adds 50"),
    "hip_extension_deg": (
        105.0,
        "a hip extends by 30, the lumbar spine adds 35, and a dancer's leg is raised behind to level",
    ),
    "hip_abduction_deg": (100.0, "a leg is raised sideways by 50, a dancer's by 90"),
    "shoulder_extension_deg": (100.0, "an arm reaches backward by 60 beside the trunk"),
    "neck_deg": (95.0, "head and neck bend by 65 to 80 against the trunk"),
    "trunk_twist_deg": (95.0, "the spine turns by 45, in throws by 80 with the shoulder blades"),
    "trunk_bend_deg": (120.0, "the spine bends forward by 110"),
}
"""Greatest angles of healthy adults [degrees], with what joint centres, which files place differently, add (about 15);
Kapandji, The Physiology of the Joints, and the norms of the American Academy of Orthopaedic Surgeons (1965); dancers by Reid
(1988)."""

INVERTED = 0.15
"""Height over stature by which the head is below and the ankles are above the hips of a body upside down."""

TRUNK_RADIUS, HEAD_RADIUS, THIGH_RADIUS, SHANK_RADIUS, ARM_RADIUS, FOREARM_RADIUS, FOOT_RADIUS = (
    0.052, 0.042, 0.040, 0.024, 0.022, 0.018, 0.016,
)  # fmt: skip
"""Radii over stature of capsules within the limbs of a slim adult: those of the adult template, less a tenth."""


def joint_angles(body: Tracks) -> dict[str, np.ndarray]:
    """Angles of the joints in time [degrees], (T,), of both sides the greater; names as in `RANGES_DEG`."""
    found: dict[str, list[np.ndarray]] = {}
    trunk = body.trunk
    across = unit(body["left_hip"] - body["right_hip"])
    ahead = unit(np.cross(across, trunk))
    shoulders = unit(body["left_shoulder"] - body["right_shoulder"])
    chest = unit(np.cross(shoulders, trunk))
    for side, out in zip(SIDES, (across, -across), strict=True):
        thigh, shank = (body[f"{side}_{b}"] - body[f"{side}_{a}"] for a, b in (("hip", "knee"), ("knee", "ankle")))
        upper, fore = (
            body[f"{side}_{b}"] - body[f"{side}_{a}"] for a, b in (("shoulder", "elbow"), ("elbow", "wrist"))
        )
        bend = angle_deg(thigh, shank)
        # Knee and ankle turn about axes of about one direction, that of the hips' line; a knee that bends forward has its own the
        # other way round. Both must say so: a hip turns its leg, and some files have feet that follow no ankle.
        foot, hinge = body[f"{side}_foot"] - body[f"{side}_ankle"], unit(np.cross(thigh, shank))
        wrong = (np.sum(hinge * unit(np.cross(shank, foot)), axis=-1) > 0.5) & (np.sum(hinge * across, axis=-1) < -0.5)
        found.setdefault("knee_flexion_deg", []).append(bend)
        found.setdefault("knee_hyperextension_deg", []).append(np.where(wrong, bend, 0.0))
        found.setdefault("elbow_flexion_deg", []).append(angle_deg(upper, fore))
        forward, sideward, downward = (np.sum(unit(thigh) * axis, axis=-1) for axis in (ahead, out, -trunk))
        sagittal = np.degrees(np.arctan2(forward, downward))
        # Near the hip line the sagittal angle means nothing.
        sagittal = np.where(np.hypot(forward, downward) > 0.3, sagittal, 0.0)
        # A thigh at the chest of one who bends deeply turns over 180 degrees; behind the back it never is.
        sagittal = np.where(sagittal < -130, sagittal + 360, sagittal)
        found.setdefault("hip_flexion_deg", []).append(sagittal)
        found.setdefault("hip_extension_deg", []).append(-sagittal)
        found.setdefault("hip_abduction_deg", []).append(np.degrees(np.arcsin(np.clip(sideward, -1, 1))))
        back, aside, down = (np.sum(unit(upper) * axis, axis=-1) for axis in (-chest, shoulders, -trunk))
        behind = (
            (down > -0.5) & (back > 0.3) & (np.abs(aside) < 0.5)
        )  # an arm that is raised sideward goes farther back
        found.setdefault("shoulder_extension_deg", []).append(np.where(behind, np.degrees(np.arctan2(back, down)), 0.0))
    angles = {name: np.max(both, axis=0) for name, both in found.items()}
    angles["neck_deg"] = angle_deg(body["head"] - body["neck"], trunk)
    flat = [each - np.sum(each * trunk, axis=-1, keepdims=True) * trunk for each in (across, shoulders)]
    angles["trunk_twist_deg"] = angle_deg(*flat)
    angles["trunk_bend_deg"] = angle_deg(body["spine1"] - body["hips"], body["shoulders"] - body["spine2"])
    return angles


def mirrored(body: Tracks) -> bool:
    """Whether left and right are swapped: the feet point to where the back is."""
    feet = sum(np.sum((body[f"{side}_foot"] - body[f"{side}_ankle"]) * body.facing, axis=-1) for side in SIDES)
    upright = body.trunk[:, 2] > 0.5
    return bool(upright.any() and np.median(np.asarray(feet)[upright]) < 0)


def upside_down_fraction(body: Tracks) -> float:
    """Fraction of the time with the head well below the hips and both ankles well above them; lying bodies are level."""
    head, hips = body["head"][:, 2], body["hips"][:, 2]
    ankles = np.minimum(body["left_ankle"][:, 2], body["right_ankle"][:, 2])
    apart = INVERTED * body.stature_m
    return float(((head < hips - apart) & (ankles > hips + apart)).mean())


def self_penetration_m(body: Tracks) -> np.ndarray:
    """How deep limbs go into the trunk, the head or one another [m], (T,): capsules along the bones."""
    parts, pairs = _capsules(body)
    depth = np.zeros(len(body.joints))
    for one, other in pairs:
        (a, b, r), (c, d, s) = parts[one], parts[other]
        depth = np.maximum(depth, (r + s) * body.stature_m - _distance(a, b, c, d))
    return depth


Capsule = tuple[np.ndarray, np.ndarray, float]


def _capsules(body: Tracks) -> tuple[dict[str, Capsule], list[tuple[str, str]]]:
    """Ends (T, 3) and radii over stature by name, and the pairs that are apart in any posture that a body can take."""

    def along(a: np.ndarray, b: np.ndarray, start: float, stop: float) -> tuple[np.ndarray, np.ndarray]:
        return a + start * (b - a), a + stop * (b - a)

    parts: dict[str, Capsule] = {
        "trunk": (*along(body["hips"], body["shoulders"], 0.1, 0.85), TRUNK_RADIUS),
        "head": (body["head"], body["head"] + 0.3 * (body["head"] - body["neck"]), HEAD_RADIUS),
    }
    pairs: list[tuple[str, str]] = []
    for side in SIDES:
        hip, knee, ankle, foot = (body[f"{side}_{name}"] for name in ("hip", "knee", "ankle", "foot"))
        shoulder, elbow, wrist = (body[f"{side}_{name}"] for name in ("shoulder", "elbow", "wrist"))
        # Near the hip and the shoulder flesh is shared; there the capsules begin later.
        parts[f"{side}_thigh"] = (*along(hip, knee, 0.45, 0.95), THIGH_RADIUS)
        parts[f"{side}_shank"] = (*along(knee, ankle, 0.1, 1.0), SHANK_RADIUS)
        parts[f"{side}_foot"] = (ankle, foot, FOOT_RADIUS)
        parts[f"{side}_arm"] = (*along(shoulder, elbow, 0.6, 1.0), ARM_RADIUS)
        parts[f"{side}_forearm"] = (*along(elbow, wrist, 0.15, 1.15), FOREARM_RADIUS)
        pairs += [(f"{side}_{part}", "trunk") for part in ("arm", "forearm", "shank")]
        pairs += [(f"{side}_forearm", "head"), (f"{side}_shank", "head"), (f"{side}_thigh", "head")]
        pairs += [(f"{side}_forearm", f"{other}_{part}") for other in SIDES for part in ("thigh", "shank")]
    pairs += [(f"left_{part}", f"right_{other}") for part in ("thigh", "shank") for other in ("thigh", "shank")]
    pairs += [(f"{a}_foot", f"{b}_shank") for a, b in (SIDES, SIDES[::-1])]
    return parts, [*pairs, ("left_foot", "right_foot"), ("left_forearm", "right_forearm")]


def _distance(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Distance of the segments a-b and c-d, ends (T, 3): (T,) (Ericson, Real-Time Collision Detection, 5.1.9)."""
    one, other, between = b - a, d - c, a - c
    dot = np.einsum
    aa, ee, bb = (dot("ti,ti->t", x, y) for x, y in ((one, one), (other, other), (one, other)))
    cc, ff = (dot("ti,ti->t", x, between) for x in (one, other))
    aa, ee = np.maximum(aa, 1e-12), np.maximum(ee, 1e-12)
    parallel = aa * ee - bb * bb
    s = np.where(parallel > 1e-12, np.clip((bb * ff - cc * ee) / np.maximum(parallel, 1e-12), 0, 1), 0.0)
    t = np.clip((bb * s + ff) / ee, 0, 1)
    s = np.clip((bb * t - cc) / aa, 0, 1)
    return np.linalg.norm(between + s[:, None] * one - t[:, None] * other, axis=-1)
