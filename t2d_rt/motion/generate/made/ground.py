"""Write sitting and lying down on the floor or a bed, and getting up from it."""

from __future__ import annotations

import numpy as np

from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate.made import seat
from t2d_rt.motion.generate.made.act import DEG, OTHER, SIDES, SIGN, Act, Place, middle, stand_tall
from t2d_rt.motion.generate.made.hands import OnBone, OnChest, OnPelvis
from t2d_rt.motion.generate.made.standing import squat_m

# --- from the edge of a bed onto it, and back; lying on the back, on floor and bed alike ---


HEEL = 0.026
"""Height of the ankle, over stature, when the heel rests with the toes up."""


def onto_bed(act: Act) -> None:
    """Lie down from a bed's edge: the trunk goes down sideways over the hand, the legs come up, the body turns along the bed."""
    body = act.anatomy
    head = "left" if act.chance(0.5) else "right"
    sign = SIGN[head]
    bed_m = act.values["z"] - act.place.floor_m - body.seat_m
    x, y = act.at("hips")
    swing_s = act.u(2.0, 2.6)
    home = act.place
    hips = home.world(x - act.u(0.14, 0.20) * body.leg_m, y - sign * 0.06)
    beside = x - 0.05, y + sign * 0.30 * act.tall / 1.72, bed_m + 0.03 * act.tall
    act.reach(head, home.hold(*beside, elbow=(0.6, 0.3, 0.5), fingers=(0.2, 1.0, 0.0)), 0.0, 0.7, 0.05)
    act.reach(OTHER[head], OnBone(along=act.u(0.45, 0.6)), 0.1, 0.6)
    act.move(0.1, 0.7, side=sign * act.u(10, 16) * DEG, roll=sign * act.u(10, 16) * DEG, pitch=-18 * DEG)
    act.wait(0.5)
    act.home = home
    act.place = Place(x_m=hips[0], y_m=hips[1], floor_m=home.floor_m + bed_m, yaw_rad=home.yaw_rad - sign * np.pi / 2)
    act.put("hips", 0.0, swing_s * 0.85, (0.0, 0.0, body.back_m + 0.005))
    act.move(0.45 * swing_s, 0.5 * swing_s, ground=act.place.floor_m)
    act.move(0.05, 0.85 * swing_s, yaw=act.place.yaw_rad)
    act.move(0.0, 0.55 * swing_s, roll=sign * act.u(24, 32) * DEG)
    act.move(0.42 * swing_s, 0.55 * swing_s, roll=0.0, side=0.0)
    act.move(0.1, swing_s, pitch=-90 * DEG)
    act.move(0.3 * swing_s, 0.7 * swing_s, flex=act.u(3, 8) * DEG, twist=0.0, look=0.0)
    act.move(0.2 * swing_s, 0.8 * swing_s, gaze=-act.u(66, 80) * DEG, tilt=0.0)
    for number, side in enumerate((OTHER[head], head)):
        after = 0.05 + 0.2 * number
        extend_leg(act, side, after + 0.12 * swing_s, 0.78 * swing_s, bent=act.u(0.96, 0.98))
        rise = act.values[f"{side}_z"]
        act.limb(side, after, 0.5 * swing_s, z=rise + act.u(0.06, 0.12))
        act.limb(side, after + 0.45 * swing_s, 0.5 * swing_s, z=rise)
    arms_of_rest(act, 0.55 * swing_s, 0.6 * swing_s)
    act.wait(1.2 * swing_s)
    act.notes.append(f"the bed is {bed_m:.2f} m high, the head to the {head}")


def off_bed(act: Act) -> None:
    """The person comes over a side up to sitting on the bed's edge, legs first."""
    body = act.anatomy
    home = act.home
    assert home is not None, "lying on a bed, one has come from its edge"
    up_s = act.u(1.9, 2.5)
    turn = home.yaw_rad - act.place.yaw_rad  # towards the bed's edge
    head = "left" if turn > 0 else "right"
    sign = SIGN[head]
    bed_m = act.place.floor_m - home.floor_m
    act.place = home
    x, y = act.at("hips")
    beside = x, y + sign * 0.32, bed_m + 0.03 * act.tall
    act.reach(head, home.hold(*beside, elbow=(0.6, 0.3, 0.5), fingers=(0.3, 1.0, 0.0)), 0.1, 0.5 * up_s, 0.03)
    shank = act.u(2, 10) * DEG
    for number, side in enumerate((OTHER[head], head)):
        bx, by = stance_foot_wide(act, side)
        edge = x + 0.16 * body.leg_m
        thigh, lower = (body.skeleton.bone_m(f"{side}_{joint}") for joint in ("knee", "ankle"))
        rise_m = bed_m + body.seat_m - body.ankle_m - lower * np.cos(shank)
        foot_x = edge + np.sqrt(thigh**2 - rise_m**2) - lower * np.sin(shank) + bx
        after = 0.1 + 0.18 * number
        act.put(side, after, 0.85 * up_s, (float(foot_x), by))
        height = act.values[f"{side}_z"]
        act.limb(side, after, 0.4 * up_s, z=height + 0.06)
        act.limb(side, after + 0.3 * up_s, 0.65 * up_s, z=home.floor_m)
        yaw = home.yaw_rad + SIGN[side] * act.habits.toe_out
        act.limb(side, after + 0.1 * up_s, 0.7 * up_s, loose=0.0, splay=0.0, yaw=yaw)
    act.move(0.0, 0.3 * up_s, ground=home.floor_m)
    act.put("hips", 0.2, 0.8 * up_s, (x + 0.16 * body.leg_m, 0.0, bed_m + body.seat_m))
    act.move(0.15, 0.8 * up_s, yaw=home.yaw_rad)
    act.move(0.05, 0.5 * up_s, roll=sign * act.u(24, 32) * DEG, flex=act.u(20, 28) * DEG, gaze=-15 * DEG)
    act.move(0.1, 0.95 * up_s, pitch=-12 * DEG)
    act.move(0.5 * up_s, 0.6 * up_s, roll=0.0)
    act.move(0.6 * up_s, 0.5 * up_s, gaze=act.habits.gaze)
    for side in SIDES:
        act.reach(side, OnBone(along=act.u(0.6, 0.85)), 0.75 * up_s, 0.5 * up_s, 0.04)
    act.wait(1.25 * up_s + act.u(0.2, 0.6))
    act.posture = "sitting"


def arms_of_rest(act: Act, after_s: float, duration_s: float) -> None:
    """Lying on the back: arms beside the body, or a hand on the belly."""
    for side in SIDES:
        beside = -0.028, act.u(0.085, 0.125), act.u(-0.03, 0.0)
        goal = OnPelvis(at=beside, elbow=(-0.3, 1.0, 0.0), fingers=(-0.05, 0.12, -1.0), back=(0.8, 0.6, 0.0))
        if act.chance(0.25):
            belly = 0.085, -0.01, act.u(0.07, 0.12)
            goal = OnPelvis(at=belly, elbow=(-0.5, 1.0, 0.0), fingers=(0.1, -1.0, -0.1), back=(1.0, 0.1, 0.0))
        act.reach(side, goal, after_s + act.u(0.0, 0.15), duration_s, 0.03)


def extend_leg(act: Act, side: str, after_s: float, duration_s: float, *, bent: float) -> None:
    """A leg lies ahead of the hips, `bent` times as long as it is when straight, heel on the ground."""
    body = act.anatomy
    x, y = act.at("hips")
    height = HEEL * act.tall
    aside = SIGN[side] * act.u(0.9, 1.25) * body.hips_m
    rise = act.values["z"] - act.place.floor_m - height
    level = np.sqrt((bent * body.leg_m) ** 2 - rise**2 - (aside - SIGN[side] * body.hips_m) ** 2)
    act.put(side, after_s, duration_s, (x + float(level), y + aside, height - body.sole_m))
    act.limb(side, after_s, duration_s, loose=1.0, tip=0.0, splay=act.u(4, 22) * DEG, yaw=act.place.yaw_rad)


def stance_foot_wide(act: Act, side: str) -> tuple[float, float]:
    """Ball of a foot that stands a little wider than in quiet standing, x and y [m] from the middle of the hips."""
    reach, turn = act.anatomy.foot_m, act.habits.toe_out
    return reach * np.cos(turn), SIGN[side] * (1.25 * act.habits.half_width + reach * np.sin(turn))


# --- down to the floor, lying on floor or bed, and up again ---


def sit_down(act: Act, step: Step) -> None:
    """Sit down on the floor or on a chair."""
    if step.object == "floor":
        floor_seat(act)
    else:
        seat.sit(act, step)


def sit_on_floor(act: Act) -> None:
    """Sit down on the floor: into a squat, then hips back and down, with hands to the floor behind them."""
    body = act.anatomy
    down_s, drop_s = act.u(1.4, 1.75), act.u(1.0, 1.25)
    x, y = middle(act)
    act.move(0.0, 0.9 * down_s, pitch=act.u(17, 24) * DEG, flex=act.u(20, 29) * DEG)
    act.move(0.05, down_s, z=act.place.floor_m + squat_m(act, act.u(132, 140) * DEG), gaze=act.u(22, 38) * DEG)
    act.put("com", 0.05, down_s, (x - 0.1 * body.foot_m, y))
    for side in SIDES:
        act.limb(side, 0.0, down_s, splay=act.u(6, 14) * DEG)
    hips = x - act.u(0.53, 0.62) * body.leg_m
    _hands_behind(act, hips, 0.45 * down_s, 0.5 * down_s + drop_s)
    act.wait(0.86 * down_s)
    act.put("hips", 0.0, drop_s, (hips, y, body.seat_m))
    act.move(0.0, 0.8 * drop_s, balanced=0.0)
    act.move(0.0, drop_s, pitch=-act.u(20, 27) * DEG, flex=act.u(22, 30) * DEG)
    act.wait(drop_s)
    act.posture = "sitting on the floor"
    act.notes.append("sits on the floor")


def floor_seat(act: Act) -> None:
    """Sit down on the floor and get comfortable there, with legs ahead, crossed, or knees up."""
    sit_on_floor(act)
    how = str(act.rng.choice(["ahead", "crossed", "knees up"], p=[0.35, 0.4, 0.25]))
    legs_s = act.u(0.6, 0.75)
    hips = act.at("hips")
    for number, side in enumerate((act.handed, OTHER[act.handed])):
        after = number * act.u(0.7, 0.9) * legs_s
        if how == "knees up":
            continue
        if how == "ahead":
            extend_leg(act, side, after, legs_s, bent=act.u(0.955, 0.975))
        else:
            x, y = hips[0] + act.u(0.34, 0.40) * act.anatomy.leg_m, -SIGN[side] * act.u(0.04, 0.08)
            act.put(side, after, legs_s, (x, y, HEEL * act.tall - act.anatomy.sole_m + 0.045 * number))
            act.limb(side, after, legs_s, loose=1.0, splay=act.u(62, 74) * DEG, tip=0.0)
        act.hump(f"{side}_z", after, 0.9 * legs_s, act.u(0.06, 0.10))
    act.wait(legs_s)
    leaning = how == "ahead" and act.chance(0.45)
    up_s = act.u(0.8, 1.1)
    slump = act.habits.flex
    if leaning:
        act.move(0.0, up_s, pitch=-act.u(24, 30) * DEG, flex=slump + act.u(8, 14) * DEG)
    else:
        act.move(0.0, up_s, pitch=-act.u(14, 20) * DEG, flex=slump + act.u(20, 28) * DEG)
        along = {"ahead": act.u(0.55, 0.8), "crossed": act.u(0.75, 0.9), "knees up": 0.93}[how]
        for side in SIDES:
            act.reach(side, OnBone(along=along + act.u(-0.03, 0.03)), act.u(0.0, 0.2), up_s, 0.05)
    act.move(0.1, up_s, gaze=act.habits.gaze + act.u(0, 8) * DEG, look=act.about(0, 8) * DEG)
    act.wait(up_s + legs_s * 0.7 + act.u(0.4, 0.9))
    act.notes.append({"ahead": "legs ahead", "crossed": "cross-legged", "knees up": "knees up"}[how])


def _hands_behind(act: Act, hips_x: float, after_s: float, duration_s: float) -> None:
    """Hands to the floor behind the hips, one a little before the other."""
    for number, side in enumerate(SIDES):
        x, y = hips_x - act.u(0.17, 0.24) * act.tall / 1.72, SIGN[side] * act.u(0.15, 0.18) * act.tall
        point = x, y, 0.03 * act.tall
        goal = act.place.hold(*point, elbow=(-1.0, 0.3, 0.0), fingers=(-0.5, 0.8, -0.1), back=(0.2, 0.0, 1.0))
        act.reach(side, goal, after_s + 0.12 * number, duration_s - 0.12 * number, 0.04)


def lie_down(act: Act, step: Step) -> None:
    """Lie down on the floor, or on a bed by way of sitting on its edge."""
    if act.posture == "standing":
        if step.object == "floor" or (step.object is None and act.chance(0.5)):
            sit_on_floor(act)
        else:
            seat.sit(act, Step(action="sit", manner=step.manner), backrest=False)
    if act.posture == "sitting":
        onto_bed(act)
        act.posture = "lying on a bed"
    elif act.posture == "sitting on the floor":
        _recline(act)
        act.posture = "lying on the floor"
    act.notes.append(act.posture.replace("lying", "lies"))
    if step.direction in ("left", "right", "forward"):
        _roll(act, step.direction)
    act.wait(act.u(0.6, 1.2))


def _recline(act: Act) -> None:
    """Lie down from sitting on the floor: the trunk goes down behind the hips, with a rounded spine that unrolls; legs extend."""
    body = act.anatomy
    down_s = act.u(1.7, 2.3)
    x, y = act.at("hips")
    _hands_behind(act, x, -0.2, 0.5)
    bends = act.chance(0.3)
    for number, side in enumerate((act.handed, OTHER[act.handed])):
        if not bends:  # one after the other, so that a heel is down meanwhile
            after = (act.u(0.0, 0.1) + 0.4 * number) * down_s
            extend_leg(act, side, after, 0.42 * down_s, bent=act.u(0.965, 0.982))
            act.hump(f"{side}_z", after, 0.4 * down_s, act.u(0.06, 0.10))
    act.put("hips", 0.1 * down_s, 0.8 * down_s, (x - 0.02, y, body.back_m))
    act.move(0.0, down_s, pitch=-90 * DEG, look=0.0)
    act.move(0.0, 0.5 * down_s, flex=act.u(34, 44) * DEG)
    act.move(0.42 * down_s, 0.62 * down_s, flex=act.u(-4, 2) * DEG)
    act.move(0.0, 0.5 * down_s, gaze=-10 * DEG)
    act.move(0.5 * down_s, 0.65 * down_s, gaze=-act.u(72, 84) * DEG)
    arms_of_rest(act, 0.45 * down_s, 0.75 * down_s)
    act.wait(1.15 * down_s)


def _roll(act: Act, towards: str) -> None:
    """The person rolls from the back onto a side, or over the side onto the belly."""
    body = act.anatomy
    side = towards if towards in SIDES else act.side(0.5)
    sign = SIGN[side]
    roll_s = act.u(1.3, 1.8)
    prone = towards == "forward"
    above = OnChest(at=(0.15, 0.15, 0.9), elbow=(-0.8, 0.2, 0.2))
    aside = OnChest(at=(0.45, 0.15, 0.35), elbow=(-0.5, 0.1, 0.8))
    act.reach(side, above if prone else aside, -0.2, 0.7)
    act.reach(OTHER[side], OnChest(at=(0.55, -0.45, -0.2), elbow=(0.0, 0.9, -0.4)), 0.1, 0.8 * roll_s)
    hips_m = body.hips_m + 0.036 * act.tall
    act.move(0.0, 0.8 * roll_s, z=act.place.floor_m + hips_m + (0.03 * act.tall if prone else 0.0))
    act.move(0.1, roll_s, spin=sign * act.u(76, 86) * DEG)
    # Shoulders are wider than hips: the spine bends to the side so that the trunk lies on both.
    need = 0.035 * act.tall + body.shoulders_m - hips_m
    bow_rad = max(0.0, float(np.arcsin(np.clip(1.6 * need / body.trunk_m, 0, 0.5))))
    act.move(0.2, roll_s, side=-sign * bow_rad, tilt=sign * act.u(4, 12) * DEG)
    x, y = act.at("hips")
    for leg in SIDES:
        top = leg != side
        # Nobody rolls onto the belly over a bent knee.
        bend = act.u(0.991, 0.996) if prone else act.u(0.78, 0.88) if top else act.u(0.88, 0.95)
        angle = act.u(0.0, 0.04) if prone else act.u(0.25, 0.4)
        ahead, forward = bend * body.leg_m * float(np.cos(angle)), sign * bend * body.leg_m * float(np.sin(angle))
        height = HEEL * act.tall + (0.05 * act.tall if top else 0.0)
        act.put(leg, 0.15, roll_s, (x + ahead, y + forward, height))
        act.limb(leg, 0.15, 0.6 * roll_s, loose=1.0, tip=0.0, yaw=act.place.yaw_rad)
    act.wait(roll_s + 0.2)
    act.notes.append(f"on the {side} side" if not prone else "on the belly")
    if prone:
        _over(act, sign)


def _over(act: Act, sign: float) -> None:
    """The person goes on over the side onto the belly, with hands beside the head."""
    body = act.anatomy
    over_s = act.u(1.0, 1.4)
    x, y = act.at("hips")
    act.move(0.0, over_s, spin=sign * 180 * DEG, side=0.0, tilt=0.0)
    act.move(0.4 * over_s, 0.8 * over_s, z=act.place.floor_m + body.back_m + 0.02)
    act.move(0.2, over_s, look=SIGN[act.side(0.5)] * act.u(45, 60) * DEG)
    act.put("hips", 0.0, over_s, (x, y + sign * 0.16))
    for side in SIDES:
        ankle = x + 0.996 * body.leg_m, y + sign * 0.16 - SIGN[side] * body.hips_m, 0.062 * act.tall
        act.put(side, 0.0, 0.8 * over_s, ankle)
        hand = 0.13, act.u(0.25, 0.4), act.u(0.45, 0.6)
        goal = OnChest(at=hand, elbow=(0.0, 1.0, -0.3), fingers=(0.1, -0.4, 0.9), back=(-1.0, 0.0, 0.0))
        act.reach(side, goal, 0.1, over_s)
    act.wait(over_s + 0.2)


def rise(act: Act, step: Step) -> None:
    """Stand up from a chair, the floor or a bed."""
    if act.posture in ("lying on the floor", "lying on a bed"):
        _unroll(act)
    if act.posture == "lying on a bed":
        off_bed(act)
    if act.posture == "lying on the floor":
        _sit_up(act)
    if act.posture == "sitting on the floor":
        _up_from_floor(act)
    elif act.posture == "sitting":
        seat.stand_up(act, step)
    act.posture = "standing"


def _unroll(act: Act) -> None:
    """The person rolls back from side or belly onto the back."""
    if abs(act.values["spin"]) < 10 * DEG:
        return
    roll_s = act.u(1.2, 1.7) * (1.5 if abs(act.values["spin"]) > 120 * DEG else 1.0)
    act.move(0.0, roll_s, spin=0.0, side=0.0, tilt=0.0, look=0.0)
    act.hump("z", 0.0, roll_s, 0.05)
    act.move(0.3 * roll_s, 0.7 * roll_s, z=act.place.floor_m + act.anatomy.back_m)
    for side in SIDES:
        extend_leg(act, side, 0.1, roll_s, bent=0.97)
    arms_of_rest(act, 0.2 * roll_s, roll_s)
    act.wait(roll_s + 0.3)


def _sit_up(act: Act) -> None:
    """The trunk rolls up, head first, arms push; knees bend, feet go flat: most frequent in young adults (VanSant 1988)."""
    body = act.anatomy
    up_s = act.u(1.1, 1.5)
    x, y = act.at("hips")
    _hands_behind(act, x, 0.15 * up_s, 0.7 * up_s)
    act.move(-0.1, 0.5 * up_s, gaze=-25 * DEG)
    act.move(0.05, 0.6 * up_s, flex=act.u(36, 46) * DEG)
    act.move(0.15 * up_s, 0.85 * up_s, pitch=-act.u(20, 26) * DEG)
    act.move(0.5 * up_s, 0.6 * up_s, gaze=15 * DEG)
    act.put("hips", 0.2 * up_s, 0.7 * up_s, (x, y, body.seat_m))
    _feet_flat(act, 0.1 * up_s, up_s)
    act.wait(1.1 * up_s)
    act.posture = "sitting on the floor"


def _feet_flat(act: Act, after_s: float, duration_s: float) -> None:
    """Both feet flat on the floor ahead of the hips, knees bent."""
    x, y = act.at("hips")
    for side, after in zip(SIDES, (after_s, after_s + 0.15), strict=True):
        bx, by = stance_foot_wide(act, side)
        act.put(side, after, duration_s, (x + 0.53 * act.anatomy.leg_m + bx, y + by, 0.0))
        act.hump(f"{side}_z", after, duration_s, 0.05)
        yaw = act.place.yaw_rad + SIGN[side] * act.habits.toe_out
        act.limb(side, after, duration_s, loose=0.0, tip=0.0, splay=8 * DEG, yaw=yaw, pivot=1.0)


def _up_from_floor(act: Act) -> None:
    """Stand up from the floor: hands push behind, the trunk swings forward over the feet into a squat, and then the body rises."""
    body = act.anatomy
    x, _ = act.at("hips")
    if act.values["left_loose"] > 0.5 or act.at("left")[0] - x > 0.7 * body.leg_m:  # legs lie ahead, or crossed
        _hands_behind(act, x, 0.0, 0.8)
        act.move(0.0, 0.8, pitch=-22 * DEG, flex=30 * DEG, gaze=15 * DEG)
        _feet_flat(act, 0.0, act.u(0.8, 1.0))
        act.wait(1.0)
    else:
        _hands_behind(act, x, 0.0, 0.6)
        act.wait(0.5)
    over_s, up_s = act.u(0.8, 1.0), act.u(1.1, 1.4)
    cx, cy = middle(act)
    act.move(0.25 * over_s, over_s, pitch=act.u(8, 15) * DEG, flex=act.u(18, 25) * DEG, gaze=act.u(15, 30) * DEG)
    act.wait(0.25 * over_s)
    act.put("com", -0.2, 0.15, (cx + 0.6 * body.foot_m, cy))
    tip = act.u(12, 22) * DEG
    act.move(0.12 * over_s, 0.8 * over_s, balanced=1.0)
    height = squat_m(act, act.u(118, 130) * DEG) + 0.5 * float(np.sin(tip)) * body.foot_m
    act.move(0.0, over_s, z=act.place.floor_m + height)
    for side in SIDES:
        forward = OnChest(at=(act.u(0.6, 0.8), act.u(0.0, 0.1), -act.u(0.1, 0.3)), elbow=(-0.3, 0.6, -0.7))
        goal = OnBone(along=act.u(0.75, 0.9)) if act.chance(0.3) else forward
        act.reach(side, goal, 0.05 * over_s, 0.85 * over_s, 0.06)
        act.limb(side, 0.3 * over_s, 0.7 * over_s, tip=tip * act.u(0.9, 1.1))
    act.wait(0.85 * over_s)
    stand_tall(act, 0.0, up_s)
    for side in SIDES:
        act.limb(side, 0.1, up_s, splay=0.0)
        act.limb(side, 0.05, 0.55 * up_s, tip=0.0)
    act.wait(up_s + act.u(0.3, 0.5))
    act.posture = "standing"
