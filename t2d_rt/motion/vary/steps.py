"""Where the feet of a changed walk go, and how legs and feet follow."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from t2d_rt.motion import quaternions
from t2d_rt.motion.contacts import follow, runs
from t2d_rt.motion.easing import minimum_jerk
from t2d_rt.motion.interpolate import low_pass
from t2d_rt.motion.kinematics import INDEX, Poses
from t2d_rt.motion.limbs import Limb, reach
from t2d_rt.motion.vary.gait_change import GaitChange
from t2d_rt.motion.vary.straight_walk import SIDES, about, path_map

TOE_CLEARANCE_M = 0.015
"""Least height of the toes over the floor in swing; healthy ones clear it by 1 to 2 cm (Winter 1992)."""


def placed_feet(
    poses: Poses, change: GaitChange, stands: np.ndarray, swing: np.ndarray, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Tracks (T, 3) of the ankles [m]."""
    joints, _ = poses.world()
    tracks = [joints[:, INDEX[f"{side}_ankle"]] for side in SIDES]
    length = float(poses.root[-1, 0])
    left, right = (track[on, 1].mean() for track, on in zip(tracks, stands.T, strict=True))
    width = 0.5 * float(left - right)
    found = {}
    for number, (side, sign) in enumerate(zip(SIDES, (1.0, -1.0), strict=True)):
        track = tracks[number].copy()
        draws = rng.standard_normal((len(runs(stands[:, number])), 2)) * change.placement_m
        shift = _while_standing(draws, stands[:, number])
        track[:, 0] = path_map(track[:, 0], change, length) - change.shorter_step_m[number] + shift[:, 0]
        wider = 0.0 if change.step_width_m is None else 0.5 * change.step_width_m - width
        track[:, 1] += sign * (wider + change.circumduction_m * swing[:, number]) + shift[:, 1]
        base = float(np.median(track[stands[:, number], 2]))
        rise = np.maximum(track[:, 2] - base, 0.0)
        # A shuffling foot rises less wherever it rises; one that is lifted high is so in mid-swing, in front of the body.
        highest = rise * swing[:, number] if change.lift[number] < 1 else rise.max() * _mid_swing(stands[:, number])
        track[:, 2] += (change.lift[number] - 1) * highest
        track[:, 2] = np.maximum(track[:, 2], np.percentile(tracks[number][:, 2], 1))
        found[side] = track
    return found


def _mid_swing(stands: np.ndarray) -> np.ndarray:
    """Bumps (T,), 1 in the middle of each whole swing and flat at its ends, where the toes still touch the floor."""
    found = np.zeros(len(stands))
    for start, stop in [run for run in runs(~stands) if run[0] > 0 and run[1] < len(stands)]:
        found[start:stop] = np.sin(np.pi * np.arange(1, stop - start + 1) / (stop - start + 1)) ** 4
    return found


def _while_standing(values: np.ndarray, stands: np.ndarray) -> np.ndarray:
    """Values (steps, K) as tracks (T, K), constant while the foot stands, with smooth steps between."""
    found = runs(stands)
    out = np.zeros((len(stands), values.shape[1]))
    if not found:
        return out
    out[: found[0][0]], out[found[-1][0] :] = values[0], values[-1]
    for number, (start, stop) in enumerate(found):
        out[start:stop] = values[number]
        if number + 1 < len(found):
            x = np.linspace(0, 1, found[number + 1][0] - stop + 2)[1:-1, None]
            out[stop : found[number + 1][0]] = values[number] + (values[number + 1] - values[number]) * minimum_jerk(x)
    return out


def pitched_feet(poses: Poses, change: GaitChange, swing: np.ndarray) -> Poses:
    """Feet pitched less where steps are shorter, hanging in swing where they drop."""
    _, rotations = poses.world()
    local = poses.local.copy()
    keep = min(change.stride, 1.0) ** 0.5
    for number, side in enumerate(SIDES):
        ankle, knee = INDEX[f"{side}_ankle"], INDEX[f"{side}_knee"]
        world = rotations[:, ankle]
        ahead = quaternions.rotate(world, np.array([1.0, 0.0, 0.0]))
        level = quaternions.multiply(quaternions.between(ahead, ahead * [1, 1, 0]), world)
        world = quaternions.blend(level, world, np.full((len(poses), 1), keep))
        hang = change.foot_drop_rad[number] * swing[:, number] + change.equinus_rad
        world = quaternions.multiply(world, about("y", hang))
        local[:, ankle] = quaternions.multiply(quaternions.conjugate(rotations[:, knee]), world)
    return replace(poses, local=quaternions.continuous(local))


def lifted_toes(poses: Poses, change: GaitChange, swing: np.ndarray) -> Poses:
    """Hanging feet are lifted in swing until their toes clear the height at which they stand."""
    if not any(change.foot_drop_rad):
        return poses
    joints, _ = poses.world()
    ankles = {}
    for number, side in enumerate(SIDES):
        ends = joints[:, [INDEX[f"{side}_{name}"] for name in ("foot", "toe")], 2]
        stands = swing[:, number] < 0.1
        level = np.median(ends[stands], axis=0) if stands.any() else ends.min(axis=0)
        lack = swing[:, number] * np.maximum((level + TOE_CLEARANCE_M - ends).max(axis=1), 0.0)
        raised = low_pass(lack[:, None], min(6.0, 0.3 * poses.rate_hz), poses.rate_hz)
        ankles[side] = joints[:, INDEX[f"{side}_ankle"]] + np.maximum(raised, 0.0) * [0.0, 0.0, 1.0]
    return follow(poses, ankles)


def pivots(planted: np.ndarray, change: GaitChange) -> np.ndarray:
    """Contacts (T, 2, 2) of the changed walk: a hanging foot and one on its toes stand on the ball alone."""
    found = planted.copy()
    for side in range(2):
        if change.equinus_rad > 0.05 or change.foot_drop_rad[side] > 0.05:
            found[:, side, 1] = planted[:, side].any(axis=1)
            found[:, side, 0] = False
    return found


def turned_knees(poses: Poses, change: GaitChange) -> Poses:
    """Knees that are turned towards each other; hips and ankles stay."""
    if change.knees_inward_rad == 0.0:
        return poses
    limbs: tuple[tuple[Limb, float], ...] = (("left_leg", 1.0), ("right_leg", -1.0))
    for limb, sign in limbs:
        joints, _ = poses.world()
        hip, knee, ankle = (joints[:, INDEX[f"{limb.split('_')[0]}_{name}"]] for name in ("hip", "knee", "ankle"))
        axis = ankle - hip
        axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
        # Seen from above a left knee goes inward clockwise; the axis points down, so that its angle is positive.
        half = 0.5 * sign * change.knees_inward_rad
        spin = np.concatenate([math.sin(half) * axis, np.full((len(axis), 1), math.cos(half))], axis=-1)
        poses, _ = reach(poses, limb, ankle, pole=quaternions.rotate(spin, knee - hip))
    return poses
