"""Render an act as poses: trunk, legs by inverse kinematics, balance over the feet, arms to their goals, and small movements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from t2d_rt.geometry.vectors import unit, vector_product
from t2d_rt.motion import quaternions
from t2d_rt.motion.generate.made.act import CHANNELS, DEG, INDEX, SIDES, SIGN, Act, progress
from t2d_rt.motion.generate.made.hands import Anatomy, Figure, Goal, Hand, Hang
from t2d_rt.motion.interpolate import decompose, wander
from t2d_rt.motion.kinematics import LOWER_BACK, NAMES, PARENTS, Poses, axes_along

# --- what keeps a body from moving like a machine: sway, and noise of the muscles that grows with the movement ---


SWAY_HZ = 0.08, 1.2
"""Band of quiet standing's sway; most of its power lies below 0.5 Hz (Winter 1995)."""

MOTOR_HZ = 2.5, 12.0
"""Band of the irregularities of a movement, corrections and physiological tremor among them."""

SWAY = {
    "com_x": 0.0035, "com_y": 0.0025, "pitch": 0.5 * DEG, "roll": 0.3 * DEG, "yaw": 0.5 * DEG, "flex": 0.7 * DEG, "side": 0.4 * DEG,
    "twist": 0.8 * DEG, "gaze": 1.6 * DEG, "look": 1.8 * DEG, "tilt": 0.7 * DEG, "left_shrug": 0.5 * DEG, "right_shrug": 0.5 * DEG,
}  # fmt: skip
"""Standard deviation at rest [m, rad]; the centre of mass sways by 3 to 5 mm forward and back, 2 to 3 mm sideways (Winter 1995)."""

MOTOR = {
    "com_x": 0.0015, "com_y": 0.001, "pitch": 0.32 * DEG, "roll": 0.22 * DEG, "yaw": 0.25 * DEG, "flex": 0.4 * DEG,
    "side": 0.3 * DEG, "twist": 0.35 * DEG, "gaze": 0.6 * DEG, "look": 0.5 * DEG, "tilt": 0.35 * DEG,
    "left_shrug": 0.3 * DEG, "right_shrug": 0.3 * DEG,
}  # fmt: skip
"""Standard deviation in full movement [m, rad], over `MOTOR_HZ`."""

SWAY_SLOPE, MOTOR_SLOPE = 1.2, 1.83
"""Exponents b of the displacement spectra, whose power falls with frequency as f^-2b. With the exponent of motor noise, spectra of
joint speeds between 3 and 12 Hz and jerk are those of recorded bends."""

HAND_SWAY_M, HAND_MOTOR_M = 0.006, 0.0032


def activity(values: np.ndarray, rate_hz: float) -> np.ndarray:
    """How much the body moves (T,), 0 at rest and about 1 in a brisk movement, by the speeds of trunk, hips and feet."""
    from scipy.ndimage import gaussian_filter1d

    scale = {
        "z": 0.5, "x": 0.5, "y": 0.5, "com_x": 0.3, "com_y": 0.3, "yaw": 1.5, "pitch": 1.2, "flex": 1.0, "side": 1.0, "spin": 1.5,
        "twist": 1.0, "left_x": 1.2, "right_x": 1.2, "left_z": 0.8, "right_z": 0.8,
    }  # fmt: skip
    rate = np.gradient(values, axis=0) * rate_hz
    power = sum((rate[:, INDEX[name]] / full) ** 2 for name, full in scale.items())
    return np.tanh(gaussian_filter1d(np.sqrt(power), 0.06 * rate_hz, mode="nearest"))


def shaken(values: np.ndarray, times_s: np.ndarray, moving: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Channels (T, C) with sway and with noise of movement; feet, hips' height and seat stay as they are."""
    channels = values.copy()
    slow = wander(rng, times_s, len(SWAY), SWAY_HZ, SWAY_SLOPE)
    fast = wander(rng, times_s, len(MOTOR), MOTOR_HZ, MOTOR_SLOPE)
    for number, (name, size) in enumerate(SWAY.items()):
        channels[:, INDEX[name]] += size * slow[:, number]
    for number, (name, size) in enumerate(MOTOR.items()):
        channels[:, INDEX[name]] += size * moving * fast[:, number]
    return channels


def hand_noise(times_s: np.ndarray, moving: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Shifts (T, 3) [m] of a hand that rests on nothing."""
    slow = wander(rng, times_s, 3, (0.15, 1.2), SWAY_SLOPE)
    fast = wander(rng, times_s, 3, MOTOR_HZ, MOTOR_SLOPE)
    return HAND_SWAY_M * slow + HAND_MOTOR_M * moving[:, None] * fast


# --- from an act to poses: trunk, legs by inverse kinematics, balance over the feet, arms to their goals ---


X, Y, Z = np.eye(3)

Sides = Mapping[str, np.ndarray]
"""Arrays of the left and of the right side."""

SPINE = (LOWER_BACK, "spine1", "spine2", "spine3")
FLEX_PARTS = 0.30, 0.28, 0.24, 0.18
TWIST_PARTS = 0.10, 0.20, 0.35, 0.35
"""How the spine's joints share a bend and a twist: the lumbar spine bends, the thoracic one turns (White and Panjabi 1990)."""

NECK_LIMIT = 58 * DEG
FOLD = 0.2
"""Least distance between a limb's ends, over the length of its bones."""
REACH = 0.9985
"""Greatest distance from hip to ankle, over the length of the leg's bones."""
ARM_RADIUS = 0.021
"""Half the thickness of wrist and elbow, over stature."""
RELAXED_RAD = 35 * DEG
"""Plantar flexion of a loose foot."""
ARM_SOFT, LEG_SOFT = 0.02, 0.002
STEADY_S = 0.09
SOFT_M = 0.007
BALANCE_STEPS = 3
"""Steps of the search for the hips: while the centre of mass sways by 3 to 5 mm, 2 leave errors up to 18 mm, 3 at most 3 mm."""


@dataclass(frozen=True, slots=True)
class Renderer:
    """Renders one table of channels for any places of the hips."""

    anatomy: Anatomy
    values: Mapping[str, np.ndarray]
    """Channels (T,) by name."""
    arms: Mapping[str, Arm]
    """The movement of each arm, by side."""
    rate_hz: float
    """Frame rate of the poses if they follow one another in time, else 0."""

    @classmethod
    def of(cls, anatomy: Anatomy, table: np.ndarray, arms: Mapping[str, Arm], rate_hz: float) -> Renderer:
        """The renderer of a table of channels (T, C)."""
        return cls(anatomy, {name: table[:, number] for number, name in enumerate(CHANNELS)}, arms, rate_hz)

    def hips(self) -> np.ndarray:
        """Hips (T, 3) [m] as the channels place them."""
        return np.stack([self.values["x"], self.values["y"], self.values["z"]], axis=1)

    def posed(self, hips: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (T, 28, 3) and orientations (T, 28, 4) of all joints for places of the hips (T, 3)."""
        figure = _body(self.anatomy, self.values, hips)
        for side in SIDES:
            _arm(figure, side, self.arms[side], self.values["ground"], self.rate_hz)
        return tuple(np.stack([by_joint[name] for name in NAMES], axis=1) for by_joint in (figure.points, figure.turns))  # type: ignore[return-value]

    def centre_of_mass(self, hips: np.ndarray) -> np.ndarray:
        """Centre of mass (T, 3) [m] for places of the hips (T, 3)."""
        return np.einsum("tjk,j->tk", self.posed(hips)[0], self.anatomy.mass_weights)

    def balanced(self) -> np.ndarray:
        """Hips (T, 3) [m] that hold the centre of mass at its target over the floor, as far as the channel `balanced` says."""
        hips, weight = self.hips(), np.clip(self.values["balanced"], 0.0, 1.0)[:, None]
        if not weight.any():
            return hips
        target = np.stack([self.values["com_x"], self.values["com_y"]], axis=1)
        balanced = hips.copy()
        balanced[:, :2] = target
        for _ in range(BALANCE_STEPS):
            balanced[:, :2] += np.clip(1.3 * (target - self.centre_of_mass(balanced)[:, :2]), -0.2, 0.2)
        if self.rate_hz > 0:  # where nobody could balance, as on a folded leg, results of the search scatter
            from scipy.ndimage import gaussian_filter1d

            balanced[:, :2] = gaussian_filter1d(balanced[:, :2], 0.04 * self.rate_hz, axis=0, mode="nearest")
        balanced[:, :2] = weight * balanced[:, :2] + (1 - weight) * hips[:, :2]
        return balanced


@dataclass(frozen=True, slots=True)
class Arm:
    """Goals of one arm, and how far it has gone from each to the next."""

    goals: Sequence[Goal]
    done: Sequence[np.ndarray]
    """Parts (T,) of the paths to the second goal, to the third, ..., that are done."""
    aside_m: Sequence[float]
    """Greatest distances by which these paths bend outward."""
    shake: np.ndarray
    """Shifts (T, 3) or (3,) [m] of the hand while it does not rest on something."""


def render(act: Act, *, rng: np.random.Generator, rate_hz: float) -> tuple[Poses, np.ndarray]:
    """Poses at `rate_hz` from time 0 to the act's end, and the channels (T, C) that they were made of."""
    times = np.arange(int(np.ceil(act.end_s * rate_hz)) + 1) / rate_hz
    smooth = act.sampled(times)
    moving = activity(smooth, rate_hz)
    table = shaken(smooth, times, moving, rng)
    arms = {
        side: Arm(
            goals=[act.starts[side], *(grasp.goal for grasp in act.grasps[side])],
            done=[progress(times, grasp.start_s, grasp.duration_s) for grasp in act.grasps[side]],
            aside_m=[grasp.aside_m for grasp in act.grasps[side]],
            shake=hand_noise(times, moving, rng),
        )
        for side in SIDES
    }
    renderer = Renderer.of(act.anatomy, table, arms, rate_hz)
    joints, turns = renderer.posed(renderer.balanced())
    _, local = decompose(joints, turns, PARENTS)
    local = quaternions.continuous(quaternions.normalise(local))
    return Poses(skeleton=act.anatomy.skeleton, root=joints[:, 0], local=local, rate_hz=rate_hz), table


def still(anatomy: Anatomy, table: np.ndarray) -> tuple[Figure, np.ndarray]:
    """The body without its arms in each pose of a table of channels (N, C), balanced with hanging arms as far as the channels say,
    and its centre of mass (N, 3) [m].
    """
    hanging = Arm([Hang()], [], [], np.zeros(3))
    renderer = Renderer.of(anatomy, table, dict.fromkeys(SIDES, hanging), 0.0)
    hips = renderer.balanced()
    return _body(anatomy, renderer.values, hips), renderer.centre_of_mass(hips)


def _body(anatomy: Anatomy, values: Mapping[str, np.ndarray], hips: np.ndarray) -> Figure:
    """The body with trunk, head, legs and shoulders posed, for hips (T, 3) [m]."""
    turns = {"heading": quaternions.about_axis(Z, values["yaw"])}
    upright = _chain(turns["heading"], (Y, values["pitch"]), (X, -values["roll"]), (Z, values["spin"]))
    turns["hips"] = above = upright
    turns["pelvis"] = _chain(upright, (Y, np.full(len(hips), anatomy.tilt_rad)))
    for name, bend, turn in zip(SPINE, FLEX_PARTS, TWIST_PARTS, strict=True):
        above = _chain(above, (Z, turn * values["twist"]), (Y, bend * values["flex"]), (X, -bend * values["side"]))
        turns[name] = above
    nod = NECK_LIMIT * np.tanh((values["gaze"] - values["pitch"] - values["flex"]) / NECK_LIMIT)
    turns["neck"] = _chain(turns["spine3"], (Z, 0.4 * values["look"]), (Y, 0.45 * nod), (X, -0.4 * values["tilt"]))
    turns["head"] = _chain(turns["neck"], (Z, 0.6 * values["look"]), (Y, 0.55 * nod), (X, -0.6 * values["tilt"]))
    turns["head_top"] = turns["head"]
    ankles = {side: _foot(anatomy, values, side, turns) for side in SIDES}
    tied = {side: 1 - values[f"{side}_loose"] for side in SIDES}
    hips = _within_reach(anatomy, turns["pelvis"], hips, ankles, tied)
    figure = Figure(anatomy, {"pelvis": hips - quaternions.rotate(turns["pelvis"], anatomy.middle)}, turns)
    for name in (*SPINE, "neck", "head", "head_top"):
        figure.hang(name)
    for side in SIDES:
        _leg(figure, values, side, ankles[side])
        lift = quaternions.about_axis(X, SIGN[side] * values[f"{side}_shrug"])
        turns[f"{side}_collar"] = quaternions.multiply(turns["spine3"], lift)
        figure.hang(f"{side}_collar")
        figure.hang(f"{side}_shoulder")
    return figure


def _foot(anatomy: Anatomy, values: Mapping[str, np.ndarray], side: str, turns: dict[str, np.ndarray]) -> np.ndarray:
    """Ankle (T, 3) [m] of a foot that turns about its ball or its heel; it sets the turns of foot and toes."""
    tip, pivot = values[f"{side}_tip"], values[f"{side}_pivot"][:, None]
    level = quaternions.about_axis(Z, values[f"{side}_yaw"])
    turns[f"{side}_ankle"] = _chain(level, (Y, tip))
    # Toes stay flat when the heel rises, and rise with the foot.
    raised = tip - 0.5 * (tip + np.sqrt(tip**2 + (4 * DEG) ** 2)) + 2 * DEG
    turns[f"{side}_foot"] = turns[f"{side}_toe"] = _chain(level, (Y, raised))
    ball = anatomy.offset(f"{side}_foot")
    heel = ball * [-1 / 3, 1.0, 1.0]
    at = np.stack([values[f"{side}_x"], values[f"{side}_y"], values[f"{side}_z"] + anatomy.sole_m], axis=1)
    stiff = 1 - values[f"{side}_loose"][:, None]
    return at - stiff * quaternions.rotate(turns[f"{side}_ankle"], pivot * ball + (1 - pivot) * heel)


def _within_reach(anatomy: Anatomy, pelvis: np.ndarray, hips: np.ndarray, ankles: Sides, tied: Sides) -> np.ndarray:
    """Hips (T, 3) lowered smoothly where a leg would not reach its foot; a loose foot (tied 0) follows the leg instead."""
    lowered = hips.copy()
    for side in SIDES:
        offset = quaternions.rotate(pelvis, anatomy.offset(f"{side}_hip") - anatomy.middle)
        longest = REACH * sum(anatomy.skeleton.bone_m(f"{side}_{joint}") for joint in ("knee", "ankle"))
        level = lowered[:, :2] + offset[:, :2] - ankles[side][:, :2]
        height = np.sqrt(np.maximum(longest**2 - (level**2).sum(-1), (0.12 * longest) ** 2))
        highest = ankles[side][:, 2] + height - offset[:, 2]
        lowered[:, 2] -= tied[side] * SOFT_M * np.logaddexp(0.0, (lowered[:, 2] - highest) / SOFT_M)
    return lowered


def _leg(figure: Figure, values: Mapping[str, np.ndarray], side: str, ankle: np.ndarray) -> None:
    """Sets hip and knee for a given ankle; the knee points where the foot and the pelvis do."""
    points, turns = figure.points, figure.turns
    hip = points["pelvis"] + quaternions.rotate(turns["pelvis"], figure.anatomy.offset(f"{side}_hip"))
    outward = 0.7 * (values[f"{side}_yaw"] - values["yaw"]) + SIGN[side] * values[f"{side}_splay"]
    backward = values["pitch"] - np.logaddexp(0.0, values["pitch"] / 0.15) * 0.15
    frame = _chain(turns["heading"], (Y, backward), (X, -values["roll"]), (Z, values["spin"]))
    upright = np.maximum(quaternions.rotate(frame, Z)[:, 2:], 0.0)
    pole = quaternions.rotate(_chain(frame, (Z, outward)), X) + 0.6 * upright**2 * Z
    knee, end, side_on = _two_bones(hip, ankle, pole, figure.anatomy.bones_m(side, "knee", "ankle"), LEG_SOFT)
    hinge = vector_product(side_on, ankle - hip)
    turns[f"{side}_hip"] = axes_along("z", hip - knee, "y", hinge)
    turns[f"{side}_knee"] = axes_along("z", knee - end, "y", hinge)
    points[f"{side}_hip"], points[f"{side}_knee"], points[f"{side}_ankle"] = hip, knee, end
    loose = values[f"{side}_loose"][:, None]
    if loose.any():
        relaxed = _chain(turns[f"{side}_knee"], (Y, np.full(len(hip), RELAXED_RAD)))
        for part in ("ankle", "foot", "toe"):
            turns[f"{side}_{part}"] = quaternions.blend(turns[f"{side}_{part}"], relaxed, loose)
    figure.hang(f"{side}_foot")
    figure.hang(f"{side}_toe")


def _arm(figure: Figure, side: str, arm: Arm, ground: np.ndarray, rate_hz: float) -> None:
    """Poses the arm on its way from goal to goal, which leads round the shoulder and not straight through the body."""
    points, turns, tall, sign = figure.points, figure.turns, figure.anatomy.stature_m, SIGN[side]
    hands = [goal.place(figure, side) for goal in arm.goals]
    shoulder = points[f"{side}_shoulder"]
    wrist, elbow, held = hands[0].wrist, unit(hands[0].elbow), np.full(len(shoulder), float(arm.goals[0].held))
    outward = quaternions.rotate(turns["spine3"], sign * Y)
    for goal, hand, done, aside_m in zip(arm.goals[1:], hands[1:], arm.done, arm.aside_m, strict=True):
        part = done[:, None]
        swept = shoulder + _swept(wrist - shoulder, hand.wrist - shoulder, part)
        wrist = swept + 4 * aside_m * part * (1 - part) * outward
        elbow = _swept(elbow, unit(hand.elbow), part)
        held += done * (float(goal.held) - held)
    wrist = wrist + (1 - held)[:, None] * arm.shake
    lowest = ground + ARM_RADIUS * tall
    wrist[:, 2] += SOFT_M * np.logaddexp(0.0, (lowest - wrist[:, 2]) / SOFT_M)
    bones_m = figure.anatomy.bones_m(side, "elbow", "wrist")
    pole = _steady(elbow, wrist - shoulder, rate_hz)
    middle, end, side_on = _two_bones(shoulder, wrist, pole, bones_m, ARM_SOFT)
    for _ in range(2):  # an elbow that would sink into the ground is turned up about the line from shoulder to wrist
        sunk = 5 * SOFT_M * np.logaddexp(0.0, (lowest - middle[:, 2]) / (5 * SOFT_M))
        side_on = side_on + (sunk / (0.08 * tall))[:, None] * Z
        middle, end, side_on = _two_bones(shoulder, wrist, side_on, bones_m, ARM_SOFT)
    hinge = -sign * vector_product(side_on, wrist - shoulder)
    turns[f"{side}_shoulder"] = axes_along("y", sign * (middle - shoulder), "z", hinge)
    turns[f"{side}_elbow"] = loose = axes_along("y", sign * (end - middle), "z", hinge)
    points[f"{side}_elbow"], points[f"{side}_wrist"] = middle, end
    turned = _hand(hands[0], loose, sign)
    for hand, done in zip(hands[1:], arm.done, strict=True):
        turned = _turned(turned, _hand(hand, loose, sign), done)
    turns[f"{side}_wrist"] = turns[f"{side}_hand"] = _above(turned, sign, end, ground, figure.anatomy)
    figure.hang(f"{side}_hand")


def _steady(pole: np.ndarray, span: np.ndarray, rate_hz: float) -> np.ndarray:
    """Direction (T, 3) in which the elbow bends, smoothed in time: where the arm lies along its pole, neighbours tell it."""
    if rate_hz == 0:
        return pole
    from scipy.ndimage import gaussian_filter1d

    axis = unit(span)
    aside = pole - (pole * axis).sum(-1, keepdims=True) * axis
    return gaussian_filter1d(aside, STEADY_S * rate_hz, axis=0, mode="nearest")


def _turned(first: np.ndarray, second: np.ndarray, done: np.ndarray) -> np.ndarray:
    """Orientations (T, 4) from the first to the second, by the way round that is shorter in the middle of the movement."""
    first, second = quaternions.continuous(first), quaternions.continuous(second)
    agree = float(((first * second).sum(-1) * (done * (1 - done) + 1e-9)).sum())
    return quaternions.normalise((1 - done)[:, None] * first + done[:, None] * (second if agree >= 0 else -second))


def _above(hand: np.ndarray, sign: float, wrist: np.ndarray, ground: np.ndarray, anatomy: Anatomy) -> np.ndarray:
    """Orientations (T, 4) of the hand, turned up at the wrist where its end would sink into the ground."""
    fingers = quaternions.rotate(hand, sign * Y)
    least = (ground + 0.006 * anatomy.stature_m - wrist[:, 2]) / anatomy.hand_m
    height = np.minimum(fingers[:, 2] + 0.05 * np.logaddexp(0.0, (least - fingers[:, 2]) / 0.05), 1.0)
    level = unit(fingers * [1.0, 1.0, 0.0]) * np.sqrt(1 - height**2)[:, None]
    raised = level + height[:, None] * Z
    return quaternions.multiply(quaternions.between(fingers, raised), hand)


def _hand(hand: Hand, loose: np.ndarray, sign: float) -> np.ndarray:
    """Orientations (T, 4) of the hand, those of the forearm if the goal gives none."""
    if hand.fingers is None or hand.back is None:
        return loose
    return axes_along("y", sign * hand.fingers, "z", hand.back)


def _swept(start: np.ndarray, end: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Vectors (T, 3) between two others: the direction turns at an even rate, and the length changes evenly."""
    a, b = unit(start), unit(end)
    angle = np.arccos(np.clip((a * b).sum(-1, keepdims=True), -0.9999, 0.99999))
    span = (np.sin((1 - part) * angle) * a + np.sin(part * angle) * b) / np.sin(angle)
    first, last = (np.linalg.norm(vector, axis=-1, keepdims=True) for vector in (start, end))
    return ((1 - part) * first + part * last) * unit(span)


def _two_bones(
    start: np.ndarray, target: np.ndarray, pole: np.ndarray, bones_m: tuple[float, float], soft: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middle and end (T, 3) of a limb that reaches for a target, by the law of cosines, and the direction across it of its bend.

    soft: part of the limb's length over which its stretch ends smoothly, because an elbow leaves a straight arm infinitely fast.
    """
    first, second = bones_m
    span = target - start
    distance = np.linalg.norm(span, axis=-1, keepdims=True)
    scale = soft * (first + second)
    longest = first + second - 0.5 * scale
    length = distance - scale * np.logaddexp(0.0, (distance - longest) / scale)
    shortest = FOLD * (first + second)
    length = shortest + 0.1 * shortest * np.logaddexp(0.0, (length - shortest) / (0.1 * shortest))
    axis = span / np.maximum(distance, 1e-9)
    aside = unit(pole - (pole * axis).sum(-1, keepdims=True) * axis)
    along = (length**2 + first**2 - second**2) / (2 * length)
    height = np.sqrt(np.maximum(first**2 - along**2, 0.0))
    return start + along * axis + height * aside, start + length * axis, aside


def _chain(first: np.ndarray, *steps: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Orientations (T, 4) turned about their own axes, one after the other."""
    for axis, angle in steps:
        first = quaternions.multiply(first, quaternions.about_axis(axis, angle))
    return first
