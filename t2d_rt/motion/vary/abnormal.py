"""Make abnormal gaits: change the steps, carriage and timing of a recorded walk as a disease or an injury does."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core import checks
from t2d_rt.core.checks import choice
from t2d_rt.core.errors import InputError
from t2d_rt.motion import quaternions
from t2d_rt.motion.contacts import SIDES, Limb, contacts, follow, plant, reach, runs
from t2d_rt.motion.descriptions.slots import GAIT_TYPES, GaitType, Side
from t2d_rt.motion.interpolate import low_pass, minimum_jerk
from t2d_rt.motion.kinematics import INDEX, Poses, at_frames
from t2d_rt.motion.read.detect import FLOOR_PERCENTILE
from t2d_rt.motion.skeletons import shipped

# --- what is changed in a recorded walk to make another gait of it ---


@dataclass(frozen=True, slots=True, kw_only=True)
class GaitChange:
    """What is changed in a walk; the defaults change nothing. Pairs are left and right."""

    stride: float = 1.0
    """Factor of the step length."""
    cadence: float = 1.0
    """Factor of the steps per second."""
    step_width_m: float | None = None
    """Distance of the feet across the path [m]; None keeps the walk's."""
    lift: tuple[float, float] = (1.0, 1.0)
    """Factors of the height of the ankles in swing."""
    foot_drop_rad: tuple[float, float] = (0.0, 0.0)
    """Angles by which the feet hang in swing [rad]."""
    equinus_rad: float = 0.0
    """Angle by which the heels are up all the time [rad]: walking on the toes."""
    shorter_step_m: tuple[float, float] = (0.0, 0.0)
    """Distances by which the feet land short of their places [m]."""
    hurried_stance: tuple[float, float] = (1.0, 1.0)
    """Factors of the tempo from when the foot lands until the other one does: above 1 its stance is short."""
    lean_rad: float = 0.0
    """Forward lean of the trunk [rad]."""
    trunk_roll_rad: tuple[float, float] = (0.0, 0.0)
    """Leans of the trunk over the standing foot [rad]."""
    pelvis_drop_rad: tuple[float, float] = (0.0, 0.0)
    """Drops of the pelvis on the side of the swing while the foot stands [rad] (Trendelenburg's sign)."""
    pelvis_shift_m: float = 0.0
    """Shift of the pelvis over the standing foot [m], beyond the recorded one."""
    pelvis_turn: float = 1.0
    """Factor of the pelvis's turning about the vertical."""
    crouch_m: float = 0.0
    """Distance by which the pelvis is lowered [m], so that knees stay bent."""
    knees_inward_rad: float = 0.0
    """Rotation of the knees towards each other about the line from hip to ankle [rad]."""
    circumduction_m: float = 0.0
    """Distance by which a swinging foot goes outward [m]."""
    arm_swing: tuple[float, float] = (1.0, 1.0)
    """Factors of the arms' swing."""
    elbow_bend_rad: float = 0.0
    """Further bend of the elbows [rad]."""
    arms_apart_rad: float = 0.0
    """Angle by which the arms are held away from the body [rad]."""
    step_time_spread: float = 0.0
    """Standard deviation of the logarithm of each step's tempo."""
    placed_along_m: float = 0.0
    """Standard deviation of where feet are put along the path [m]."""
    placed_across_m: float = 0.0
    """Standard deviation of where feet are put across the path [m]."""
    unsteady_rad: float = 0.0
    """Standard deviation of the trunk's slow swaying, forward and sideways [rad]."""
    hurry: float = 0.0
    """Festination: over the walk the steps shorten to exp(-hurry) of their length and come exp(hurry) times as fast."""
    freezes_s: tuple[float, ...] = ()
    """Durations of the halts at which the feet stick to the floor and the knees tremble [s]."""
    tremble_hz: float = 6.0
    """Frequency of the trembling [Hz]."""
    hand_tremor_rad: float = 0.0
    """Amplitude of the hands' tremor at rest [rad]."""


# --- straight walks along +x: their stances, their phase, their path ---


STRAIGHT_RAD = math.radians(25.0)
"""Greatest change of direction between the thirds of a walk that still counts as straight."""

LEAST_WALK_M = 1.5
"""Shortest path of a walk that is changed, somewhat more than two steps."""

LEAST_STEP_M = 0.2
"""Distance between two contacts of a foot from which they are two steps [m]."""

PHASE_CUTOFF_HZ = 3.0
"""Cut-off frequency that smooths weight and swing, which change within a double support of 0.1 to 0.2 s."""


def along_x(poses: Poses) -> Poses:
    """The poses turned about the vertical so that the pelvis goes along +x from the origin; raises an InputError if they are no
    straight walk."""
    track = poses.root[:, :2]
    net = track[-1] - track[0]
    thirds = np.diff(track[np.linspace(0, len(track) - 1, 4).astype(int)], axis=0)
    headings = np.arctan2(thirds[:, 1], thirds[:, 0])
    bend = np.abs(np.angle(np.exp(1j * np.diff(headings)))).max()
    if not (np.linalg.norm(net) >= LEAST_WALK_M and bend < STRAIGHT_RAD):
        raise InputError(
            f"a gait is changed on a straight walk of {LEAST_WALK_M:g} m or more, got {np.linalg.norm(net):.2f} m with a bend of "
            f"{math.degrees(bend):.0f} degrees; choose another clip"
        )
    turn = quaternions.about_axis(np.array([0.0, 0.0, 1.0]), np.array(-math.atan2(net[1], net[0])))
    local = poses.local.copy()
    local[:, 0] = quaternions.multiply(turn, local[:, 0])
    root = quaternions.rotate(turn, poses.root - poses.root[0] * [1, 1, 0])
    return replace(poses, root=root, local=local)


def on_floor(poses: Poses) -> Poses:
    """The poses moved so that the floor is at z = 0, by the rule of the readers: a low percentile of the lowest foot joint."""
    joints, _ = poses.world()
    feet = [INDEX[f"{side}_{joint}"] for side in SIDES for joint in ("ankle", "foot", "toe")]
    level = float(np.percentile(joints[:, feet, 2].min(axis=1), FLOOR_PERCENTILE))
    return replace(poses, root=poses.root - [0.0, 0.0, level])


def stances(poses: Poses, planted: np.ndarray) -> np.ndarray:
    """Whether each foot stands, bool (T, 2): contacts without the gaps in which the foot went nowhere."""
    joints, _ = poses.world()
    stands = np.asarray(planted.any(axis=2))
    for number, side in enumerate(SIDES):
        ankle = joints[:, INDEX[f"{side}_ankle"], :2]
        for start, stop in runs(~stands[:, number]):
            inner = start > 0 and stop < len(stands)
            if inner and np.linalg.norm(ankle[stop] - ankle[start - 1]) < LEAST_STEP_M:
                stands[start:stop, number] = True
    return stands


def phase(stands: np.ndarray, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Weight (T,), 1 if the left foot bears it alone and -1 if the right does, and swing (T, 2), 1 in mid-swing; both smooth."""
    values = np.column_stack([stands[:, 0].astype(float) - stands[:, 1], ~stands])
    smooth = low_pass(values, PHASE_CUTOFF_HZ, rate_hz)
    return np.clip(smooth[:, 0], -1, 1), np.clip(smooth[:, 1:], 0, 1)


def path_map(x: np.ndarray, change: GaitChange, length_m: float) -> np.ndarray:
    """Map of places along the path [m]: its slope is the factor of the step length there."""
    if change.hurry == 0.0:
        return change.stride * x
    rate = change.hurry / length_m
    return change.stride * (1 - np.exp(-rate * x)) / rate


def slow_noise(count: int, rate_hz: float, rng: np.random.Generator) -> np.ndarray:
    """Noise (T,) of mean 0 and variance 1 between 0.2 and 1.2 Hz: ten sines of random phase."""
    tones, phases = rng.uniform(0.2, 1.2, 10), rng.uniform(0, 2 * np.pi, 10)
    return evened(np.sin(2 * np.pi * np.arange(count)[:, None] / rate_hz * tones + phases).sum(axis=1))


def evened(draws: np.ndarray) -> np.ndarray:
    """Draws (N, ...) shifted and scaled to a mean of 0 and a deviation of 1, where there are three or more: a walk of a dozen steps
    is to show the spread that its patient has, not that of a dozen draws."""
    if len(draws) < 3:
        return draws
    return np.asarray((draws - draws.mean(axis=0)) / np.maximum(draws.std(axis=0), 1e-9))


def about(axis: str, angle_rad: np.ndarray) -> np.ndarray:
    """Rotations (T, 4) about x, y or z by angles (T,)."""
    return quaternions.about_axis(np.eye(3)["xyz".index(axis)], angle_rad)


# --- how pelvis, trunk and arms are carried in a changed walk ---


SPINE = "lower_back", "spine1", "spine2", "spine3"


def pelvis_track(poses: Poses, change: GaitChange, weight: np.ndarray) -> np.ndarray:
    """Track (T, 3) of the pelvis [m] along the shorter path, shifted over the standing foot and lowered."""
    root = poses.root.copy()
    root[:, 0] = path_map(root[:, 0], change, float(root[-1, 0]))
    root[:, 1] += change.pelvis_shift_m * weight
    # The rise and fall of an inverted pendulum is proportional to the square of its step.
    mean = root[:, 2].mean()
    root[:, 2] = mean + (root[:, 2] - mean) * min(change.stride, 1.2) ** 2 - change.crouch_m
    return root


def held_body(poses: Poses, change: GaitChange, weight: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Local rotations (T, J, 4) with pelvis, trunk and arms held as the change has it."""
    local = poses.local.copy()
    left, right = np.maximum(weight, 0), np.maximum(-weight, 0)
    sway = change.unsteady_rad * np.column_stack([slow_noise(len(poses), poses.rate_hz, rng) for _ in range(2)])
    drop = change.pelvis_drop_rad[0] * left - change.pelvis_drop_rad[1] * right
    # Rotation about +x lowers the right side; the trunk leans over the left foot by one about -x.
    roll = -(change.trunk_roll_rad[0] * left - change.trunk_roll_rad[1] * right) - drop + sway[:, 1]
    lean = change.lean_rad + sway[:, 0]
    local[:, 0] = _damped_heading(local[:, 0], change.pelvis_turn)
    local[:, 0] = quaternions.multiply(about("x", drop), local[:, 0])
    for name in SPINE:
        local[:, INDEX[name]] = _product(about("x", roll / 4), about("y", lean / 4), local[:, INDEX[name]])
    for name in ("neck", "head"):  # the eyes stay on the path
        local[:, INDEX[name]] = _product(about("x", -roll / 3), about("y", -0.35 * lean), local[:, INDEX[name]])
    for number, (side, sign) in enumerate((("left", 1.0), ("right", -1.0))):
        shoulder, elbow = INDEX[f"{side}_shoulder"], INDEX[f"{side}_elbow"]
        for joint in (shoulder, elbow):
            local[:, joint] = _scaled(local[:, joint], change.arm_swing[number])
        apart = about("x", np.full(len(poses), sign * change.arms_apart_rad))
        local[:, shoulder] = quaternions.multiply(apart, local[:, shoulder])
        bend = about("z", np.full(len(poses), -sign * change.elbow_bend_rad))
        local[:, elbow] = quaternions.multiply(local[:, elbow], bend)
    return quaternions.continuous(local)


def _damped_heading(rotation: np.ndarray, factor: float) -> np.ndarray:
    """Orientations (T, 4) whose turning about the vertical is scaled."""
    ahead = quaternions.rotate(rotation, np.array([1.0, 0.0, 0.0]))
    heading = np.arctan2(ahead[:, 1], ahead[:, 0])
    return quaternions.multiply(about("z", (factor - 1) * heading), rotation)


def _scaled(rotation: np.ndarray, factor: float) -> np.ndarray:
    """Rotations (T, 4) whose departures from their mean are scaled."""
    values, vectors = np.linalg.eigh(np.einsum("ti,tj->ij", rotation, rotation))
    mean = np.broadcast_to(vectors[:, int(values.argmax())], rotation.shape)
    return quaternions.blend(mean, rotation, np.full((len(rotation), 1), factor))


def _product(*rotations: np.ndarray) -> np.ndarray:
    first, *others = rotations
    for other in others:
        first = quaternions.multiply(first, other)
    return first


# --- where the feet of a changed walk go, and how legs and feet follow ---


TOE_CLEARANCE_M = 0.015
"""Least height of the toes over the floor in swing; healthy ones clear it by 1 to 2 cm (Winter 1992)."""


def placed_feet(
    poses: Poses, change: GaitChange, stands: np.ndarray, swing: np.ndarray, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Tracks (T, 3) [m] of the ankles of the changed walk, by side."""
    joints, _ = poses.world()
    tracks = [joints[:, INDEX[f"{side}_ankle"]] for side in SIDES]
    length = float(poses.root[-1, 0])
    left, right = (track[on, 1].mean() for track, on in zip(tracks, stands.T, strict=True))
    width = 0.5 * float(left - right)
    placed = {}
    for number, (side, sign) in enumerate(zip(SIDES, (1.0, -1.0), strict=True)):
        track = tracks[number].copy()
        draws = evened(rng.standard_normal((len(runs(stands[:, number])), 2)))
        draws = draws * (change.placed_along_m, change.placed_across_m)
        shift = _while_standing(draws, stands[:, number])
        track[:, 0] = path_map(track[:, 0], change, length) - change.shorter_step_m[number] + shift[:, 0]
        wider = 0.0 if change.step_width_m is None else 0.5 * change.step_width_m - width
        track[:, 1] += sign * (wider + change.circumduction_m * swing[:, number]) + shift[:, 1]
        base = float(np.median(track[stands[:, number], 2]))
        rise = np.maximum(track[:, 2] - base, 0.0)
        # A shuffling foot rises less throughout its swing; a foot that is lifted high is highest in mid-swing.
        highest = rise * swing[:, number] if change.lift[number] < 1 else rise.max() * _mid_swing(stands[:, number])
        track[:, 2] += (change.lift[number] - 1) * highest
        track[:, 2] = np.maximum(track[:, 2], np.percentile(tracks[number][:, 2], 1))
        placed[side] = track
    return placed


def _mid_swing(stands: np.ndarray) -> np.ndarray:
    """Bumps (T,), 1 in the middle of each whole swing and flat at its ends, where the toes still touch the floor."""
    bumps = np.zeros(len(stands))
    for start, stop in [run for run in runs(~stands) if run[0] > 0 and run[1] < len(stands)]:
        bumps[start:stop] = np.sin(np.pi * np.arange(1, stop - start + 1) / (stop - start + 1)) ** 4
    return bumps


def _while_standing(values: np.ndarray, stands: np.ndarray) -> np.ndarray:
    """Values (steps, K) as tracks (T, K), constant while the foot stands, with smooth steps between."""
    steps = runs(stands)
    tracks = np.zeros((len(stands), values.shape[1]))
    if not steps:
        return tracks
    tracks[: steps[0][0]], tracks[steps[-1][0] :] = values[0], values[-1]
    for number, (start, stop) in enumerate(steps):
        tracks[start:stop] = values[number]
        if number + 1 < len(steps):
            after = steps[number + 1][0]
            x = np.linspace(0, 1, after - stop + 2)[1:-1, None]
            tracks[stop:after] = values[number] + (values[number + 1] - values[number]) * minimum_jerk(x)
    return tracks


def pitched_feet(poses: Poses, change: GaitChange, swing: np.ndarray) -> Poses:
    """Poses whose feet are pitched less if steps are shorter, and hang in swing if they drop."""
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
    """Poses in which hanging feet are lifted in swing until their toes clear the height at which they stand."""
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
    changed = planted.copy()
    for side in range(2):
        if change.equinus_rad > 0.05 or change.foot_drop_rad[side] > 0.05:
            changed[:, side, 1] = planted[:, side].any(axis=1)
            changed[:, side, 0] = False
    return changed


def turned_knees(poses: Poses, change: GaitChange) -> Poses:
    """Poses whose knees are turned towards each other; hips and ankles stay."""
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


# --- when each step of a changed walk comes: tempo, halts and trembling ---


def new_times(
    poses: Poses, change: GaitChange, stands: np.ndarray, weight: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Fractional frames (K,) of the walk that the new frames show."""
    rate = poses.rate_hz
    x = np.clip(poses.root[:, 0] / max(float(poses.root[-1, 0]), 1e-9), 0, 1)
    steps = sorted((start, side) for side in range(2) for start, _ in runs(stands[:, side]))
    number = np.searchsorted([start for start, _ in steps], np.arange(len(poses)), side="right")
    tempo = np.exp(change.step_time_spread * evened(rng.standard_normal(len(steps) + 1)))[number]
    tempo *= np.array([1.0, *(change.hurried_stance[side] for _, side in steps)])[number]
    tempo = change.cadence * tempo / _mean_tempo(tempo)
    slowness = 1.0 / (tempo * np.exp(change.hurry * x))
    slowness = low_pass(slowness[:, None], min(4.0, 0.4 * rate), rate)[:, 0]
    for centre, duration_s in zip(_halts(poses, weight, rng, len(change.freezes_s)), change.freezes_s, strict=True):
        bell = np.exp(-0.5 * ((np.arange(len(poses)) - centre) / (0.06 * rate)) ** 2)
        slowness += duration_s * rate * bell / bell.sum()
    shown = np.concatenate([[0.0], np.cumsum(0.5 * (slowness[1:] + slowness[:-1]))])
    return np.interp(np.arange(int(shown[-1]) + 1), shown, np.arange(len(poses)))


def _halts(poses: Poses, weight: np.ndarray, rng: np.random.Generator, count: int) -> np.ndarray:
    """Frames (count,) at which both feet bear the weight and rest as nearly as they ever do, not at the ends of the walk."""
    joints, _ = poses.world()
    feet = joints[:, [INDEX[f"{side}_{joint}"] for side in SIDES for joint in ("ankle", "toe")]]
    fastest = np.linalg.norm(np.gradient(feet, axis=0), axis=-1).max(axis=1) * poses.rate_hz + np.abs(weight)
    inner = np.arange(len(poses))[len(poses) // 7 : -(len(poses) // 10)]
    slowest = [at for at in inner[1:-1] if fastest[at] <= fastest[max(0, at - 10) : at + 11].min()]
    calm = sorted(slowest, key=fastest.__getitem__)[: max(count, len(slowest) // 2)]
    return rng.choice(np.array(calm), size=count, replace=len(calm) < count) if count else np.zeros(0, dtype=int)


def _mean_tempo(tempo: np.ndarray) -> float:
    """Tempo of the whole walk: the harmonic mean, because times add up."""
    return float(len(tempo) / np.sum(1.0 / tempo))


def trembling(poses: Poses, change: GaitChange, frames: np.ndarray, rng: np.random.Generator) -> Poses:
    """Poses whose knees tremble where the walk halts, and whose hands shake at rest."""
    if not change.freezes_s and change.hand_tremor_rad == 0.0:
        return poses
    times = np.arange(len(poses)) / poses.rate_hz
    local = poses.local.copy()
    if change.hand_tremor_rad:
        for side in SIDES:
            amplitude_rad = (
                change.hand_tremor_rad * rng.uniform(0.3, 1.0) * (1 + 0.3 * slow_noise(len(poses), poses.rate_hz, rng))
            )
            phase_rad = 2 * np.pi * rng.uniform(4.0, 6.0) * times + rng.uniform(0, 2 * np.pi)
            shake = about("x", amplitude_rad * np.sin(phase_rad))
            joint = INDEX[f"{side}_elbow"]
            local[:, joint] = quaternions.multiply(local[:, joint], shake)
    poses = replace(poses, local=local)
    if not change.freezes_s:
        return poses
    halted = low_pass((np.gradient(frames) < 0.25).astype(float)[:, None], 2.0, poses.rate_hz)[:, 0]
    joints, _ = poses.world()
    ankles = {side: joints[:, INDEX[f"{side}_ankle"]] for side in SIDES}
    wave = 2 * np.pi * change.tremble_hz * times + 0.6 * slow_noise(len(poses), poses.rate_hz, rng)
    shake = np.column_stack([0.006 * np.sin(wave), 0.004 * np.sin(0.5 * wave), -0.008 * (1 + np.sin(wave + 0.7)) / 2])
    root = poses.root + np.clip(halted, 0, 1)[:, None] * shake
    return follow(replace(poses, root=root), ankles)


# --- parametric changes of a recorded straight walk: where feet go, how the trunk is held, when each step comes ---
#
# The recorded walk gives what a formula does not: weight shift, roll of the feet, the person's own variation. A map of
# the path changes places, so that a planted foot stays planted; the legs then follow their feet by inverse kinematics,
# and time is warped last.


def changed_walk(walk: Poses, change: GaitChange, rng: np.random.Generator) -> Poses:
    """A straight walk with its gait changed, which starts at the origin and goes along +x.

    Raises an InputError for a walk that is not straight or shorter than 1.5 m.
    """
    poses = along_x(walk)
    planted = contacts(poses)
    stands = stances(poses, planted)
    weight, swing = phase(stands, poses.rate_hz)
    ankles = placed_feet(poses, change, stands, swing, rng)
    times = new_times(poses, change, stands, weight, rng)  # of the recorded walk, before its path is shortened
    poses = replace(poses, root=pelvis_track(poses, change, weight), local=held_body(poses, change, weight, rng))
    poses = follow(poses, ankles)
    poses = turned_knees(lifted_toes(pitched_feet(poses, change, swing), change, swing), change)
    poses = plant(poses, pivots(planted, change))
    poses = at_frames(poses, times)
    return on_floor(trembling(poses, change, times, rng))


# --- abnormal gaits: the changes that make each type, by severity; abnormal.yaml has them with their clinical sources ---


SPREAD = 0.06
"""Standard deviation of the logarithm of each drawn value about its range: no two patients are alike."""

TEMPO_SPREAD = 0.04
"""The same for stride and cadence, whose ranges are those of groups of patients."""

SQUARED = frozenset({"freezes_s"})
"""Values that follow the square of the severity, because mild halts are rare. No source tells the power."""

TYPES = shipped(Path(__file__).with_suffix(".yaml"))
"""The ranges of each type of gait: names of fields of `GaitChange`, and the values at severity 0 (mild) and 1 (severe)."""


def gait_change(type: GaitType, severity: float, rng: np.random.Generator, *, side: Side | None = None) -> GaitChange:
    """A patient's change of gait: each value lies at `severity`, 0 (mild) to 1 (severe), of its range, with a random spread.

    side: side of the leg that is spared, of the foot that drops, or of the arm that swings least, in gaits of one side; None
        draws it. Raises an InputError for an unknown type or side, or another severity.
    """
    choice("type", type, GAIT_TYPES)
    if side is not None:
        choice("side", side, SIDES)
    checks.number("severity", severity, 0.0, 1.0)
    drawn = {name: _drawn(name, low, high, severity, rng) for name, (low, high) in TYPES[type].items()}
    any_side = int(rng.integers(2))
    both = bool(type == "steppage" and rng.random() < 0.4)  # a foot drops on one side more often than on both
    if side is None:
        return _change(drawn, any_side, both, rng)
    return _change(drawn, SIDES.index(side), False, rng)


def abnormal_walk(
    walk: Poses, type: GaitType, *, severity: float, rng: np.random.Generator, side: Side | None = None
) -> Poses:
    """A recorded straight walk as a patient with that gait would walk it, from the origin along +x; `side` as in `gait_change`."""
    return changed_walk(walk, gait_change(type, severity, rng, side=side), rng)


def _drawn(name: str, mild: float, severe: float, severity: float, rng: np.random.Generator) -> float:
    """A patient's value between its ends; those of angles are in degrees, the value in radians."""
    if "_rad" in name:
        mild, severe = math.pi / 180 * mild, math.pi / 180 * severe
    if name in SQUARED:
        severity **= 2
    spread = TEMPO_SPREAD if name in ("stride", "cadence") else SPREAD
    # A hurried stance is a factor near 1: if the whole factor were scattered, patients would differ by more than their severity.
    neutral = 1.0 if name.startswith("hurried_stance") else 0.0
    factor = float(np.exp(spread * np.clip(rng.standard_normal(), -2, 2)))
    return neutral + (mild + severity * (severe - mild) - neutral) * factor


def _change(drawn: dict[str, float], side: int, both: bool, rng: np.random.Generator) -> GaitChange:
    """The change whose values were drawn; those of one side go to `side`, and the other side keeps what changes nothing."""
    neutral, fields = GaitChange(), dict[str, Any]()
    for name, value in drawn.items():
        field, _, whose = name.partition(" of ")
        if field == "freezes_s":
            continue
        affected, other = value, getattr(neutral, field)[0] if whose else value
        if field == "arm_swing":  # Parkinson's disease begins on one side
            affected, other = min(value, 1.0), min(1.5 * value, 1.0)
        if both or whose == "both":
            other = affected
        affected_side = side if whose != "other" else 1 - side
        fields[field] = ((affected, other) if affected_side == 0 else (other, affected)) if whose else value
    if "freezes_s" in drawn:
        fraction = float(rng.uniform(0.3, 0.7))  # of one halt, or of the first of two
        fields["freezes_s"] = tuple(
            drawn["freezes_s"] * portion for portion in ((1.0,), (fraction, 1 - fraction))[rng.integers(2)]
        )
        fields["tremble_hz"] = float(rng.uniform(4.0, 7.0))
    return GaitChange(**fields)
