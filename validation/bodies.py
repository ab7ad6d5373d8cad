"""The recorded bodies that several sections use."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

import t2d_rt as t2d
from t2d_rt.core.backend import select
from t2d_rt.core.resources import resource
from t2d_rt.motion import quaternions
from t2d_rt.propagation.occluders import Occluders
from t2d_rt.propagation.visibility import Occlusion, viewpoints_at
from t2d_rt.types import Motion, MovingMesh, Radar

WALK, RUN = "12_01_walk.bvh", "iclone_002_03_run_jog.bvh.gz"
UP = np.array([0.0, 0.0, 1.0])


def recorded(name: str, angle_deg: float = 0.0) -> Motion:
    """A bundled motion, placed before the radar."""
    return t2d.place(t2d.load_motion(resource("motions", name)), angle_deg=angle_deg)


def walking(start_s: float, stop_s: float, name: str = WALK, angle_deg: float = 0.0) -> MovingMesh:
    """The skinned body over a part of a bundled motion."""
    return t2d.skin(t2d.trim(recorded(name, angle_deg), start_s, stop_s))


def occlusion_of(body: MovingMesh, radar: Radar, samples_s: np.ndarray) -> Occlusion:
    """How a body hides itself from the radar, traced at sample times."""
    return Occlusion.alone(
        Occluders([body]), *viewpoints_at([radar.tx_position_m]), samples_s=samples_s, backend=select("auto"), wavelength_m=None
    )  # fmt: skip


def random_chirps(surface: MovingMesh, radar: Radar, count: int, seed: int = 0) -> np.ndarray:
    """Chirps of a record, drawn anywhere in it, ascending."""
    total = len(radar.chirp_times_s(surface.duration_s))
    return np.sort(np.random.default_rng(seed).choice(total, count, replace=False))


# --- a fall ---

FALL_RATE_HZ, REST_S = 120.0, 0.3
LEAN_RAD, LAND_RAD, LYING_RAD, LANDING_S = math.radians(3), math.radians(62), math.radians(86), 0.25
"""Where a fall begins, where the floor begins to stop it, where it ends, and how long the floor takes."""
BEND_RAD = math.radians(35)
"""How far the knees give way, the hips half as far."""
FLOOR_GAP_M, SMOOTH_S = 0.005, 0.04
"""How far above the floor the skin is brought, before soles are fitted to it, and over what time such shifts are smoothed."""


def falling(distance_m: float = 3.0, angle_deg: float = 0.0) -> Motion:
    """Someone who stands `distance_m` before the radar topples over backwards and lies still.

    The standing pose is that of the bundled walk, legs straight. At `angle_deg` 0 it faces the radar and ends up on its back, feet
    towards the radar. The angle theta about the heels is a rod's, theta'' = (3 g / 2 L) sin(theta), on the solution that leaves the
    upright by itself (theta' = sqrt(3 g / 2 L) theta at first); from `LAND_RAD` on it comes to rest along the quintic that joins on
    with its first two derivatives. Knees and hips bend on the way and are straight again at its end; smooth shifts up and down keep
    the skin's lowest point on the floor.
    """
    walk = recorded(WALK, angle_deg)
    facing = -np.array([math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg)), 0.0])
    across = np.cross(facing, UP)
    joints, rotations = _standing(walk, facing)
    theta = _toppling(float(np.ptp(joints[:, 2])))
    joints, rotations = (np.repeat(each[None], len(theta), axis=0) for each in (joints, rotations))
    bend = BEND_RAD * (4 * theta / LYING_RAD * (1 - theta / LYING_RAD)) ** 2
    for side in ("left", "right"):
        for joint, angle in (("hip", bend / 2), ("knee", -bend), ("ankle", bend / 2)):
            _rotate(walk, joints, rotations, f"{side}_{joint}", quaternions.about_axis(across, angle))
    heels = (joints[:, walk.index("left_ankle")] + joints[:, walk.index("right_ankle")]) / 2
    joints -= heels[:, None] - heels[0, 2] * UP
    topple = quaternions.about_axis(across, theta)[:, None]
    joints, rotations = quaternions.rotate(topple, joints), quaternions.multiply(topple, rotations)
    joints[..., 0] += distance_m
    fall = replace(walk, joints=joints, rotations=rotations, rate_hz=FALL_RATE_HZ, report="a fall")
    return _on_the_floor(
        _on_the_floor(fall)
    )  # skinning fits soles to how high the ankles stand: the first rise moves them a little


def _on_the_floor(motion: Motion) -> Motion:
    """Raised and lowered, smoothly, so that the lowest vertex of the skin keeps close above the floor."""
    low = t2d.skin(motion).vertices[..., 2].min(axis=1)
    rise = -gaussian_filter1d(low, SMOOTH_S * motion.rate_hz, mode="nearest")
    rise += FLOOR_GAP_M - (low + rise).min()
    return replace(motion, joints=motion.joints + rise[:, None, None] * UP)


def _standing(walk: Motion, facing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Joints (J, 3) and rotations (J, 4) of the frame of a walk in which the feet are nearest to each other, with straight legs and
    both feet flat."""
    ankles = [walk.joints[:, walk.index(name)] for name in ("left_ankle", "right_ankle")]
    frame = int(np.argmin(np.linalg.norm(ankles[0] - ankles[1], axis=1)))
    joints, rotations = walk.joints[None, frame].copy(), walk.rotations[None, frame].copy()
    slopes = []
    for side in ("left", "right"):
        foot = joints[0, walk.index(f"{side}_foot")] - joints[0, walk.index(f"{side}_ankle")]
        slopes.append((joints[0, walk.index(f"{side}_ankle"), 2], math.atan2(-foot[2], foot @ facing)))
    slope = min(slopes)[1]  # that of the foot on the floor
    flat = math.cos(slope) * facing - math.sin(slope) * UP
    for side in ("left", "right"):
        for joint, end, direction in (("hip", "knee", -UP), ("knee", "ankle", -UP), ("ankle", "foot", flat)):
            bone = joints[0, walk.index(f"{side}_{end}")] - joints[0, walk.index(f"{side}_{joint}")]
            _rotate(walk, joints, rotations, f"{side}_{joint}", quaternions.between(bone, direction)[None])
    return joints[0], rotations[0]


def _toppling(length_m: float) -> np.ndarray:
    """Angle of a falling rod about its foot [rad], (T,), up to some time at rest."""
    from scipy.integrate import solve_ivp
    from scipy.interpolate import BPoly

    rate = math.sqrt(1.5 * 9.81 / length_m)

    def landed(_: float, state: np.ndarray) -> float:
        return float(state[0]) - LAND_RAD

    landed.terminal = True  # type: ignore[attr-defined]
    free = solve_ivp(
        lambda _, y: (y[1], rate**2 * math.sin(y[0])), (0, 9), (LEAN_RAD, rate * LEAN_RAD), events=landed,
        dense_output=True, rtol=1e-9,
    )  # fmt: skip
    down_s = float(free.t[-1])
    speed = float(free.y[1, -1])
    landing = BPoly.from_derivatives(
        [down_s, down_s + LANDING_S], [[LAND_RAD, speed, rate**2 * math.sin(LAND_RAD)], [LYING_RAD, 0, 0]]
    )
    times = np.arange(0, down_s + LANDING_S + REST_S, 1 / FALL_RATE_HZ)
    return np.where(
        times < down_s, free.sol(np.minimum(times, down_s))[0], landing(np.clip(times, down_s, down_s + LANDING_S))
    )


def _rotate(motion: Motion, joints: np.ndarray, rotations: np.ndarray, name: str, by: np.ndarray) -> None:
    """Turns what hangs on a joint about it, in place: joints (T, J, 3) and rotations (T, J, 4) by quaternions (T, 4)."""
    root = motion.index(name)
    hangs = np.zeros(len(motion.names), bool)
    for k in range(len(hangs)):  # parents come before their children, but for the ends, which come last
        hangs[k] = k == root or (motion.parents[k] >= 0 and hangs[motion.parents[k]])
    centre = joints[:, root, None].copy()
    joints[:, hangs] = centre + quaternions.rotate(by[:, None], joints[:, hangs] - centre)
    rotations[:, hangs] = quaternions.multiply(by[:, None], rotations[:, hangs])
