"""Lying down on and getting up from the ground or a bed."""

from __future__ import annotations

import numpy as np

from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate.made import seat
from t2d_rt.motion.generate.made.hands import Goal, InSpace, OnBone, OnChest, OnPelvis
from t2d_rt.motion.generate.made.performer import Performer, middle, stance, stand_tall
from t2d_rt.motion.generate.made.score import DEG, OTHER, SIDES, SIGN, Place, Score
from t2d_rt.motion.generate.made.standing import squat_m

# --- from the edge of a bed onto it, and back; how one lies on the back, on floor and bed alike ---


HEEL = 0.026
"""Height of the ankle over stature where the heel rests with the toes up."""


def onto_bed(score: Score, who: Performer) -> None:
    """From the edge of a bed: the trunk goes down to a side over the hand while the legs come up, the body turns along the bed."""
    body = who.anatomy
    head = "left" if who.chance(0.5) else "right"
    sign = SIGN[head]
    bed_m = score.values["z"] - score.place.floor_m - body.seat_m
    x, y = score.at("hips")
    swing_s = who.u(2.0, 2.6)
    home = score.place
    hips = home.world(x - who.u(0.14, 0.20) * body.leg_m, y - sign * 0.06)
    hand = home.world(x - 0.05, y + sign * 0.30 * who.tall / 1.72, bed_m + 0.03 * who.tall)
    score.reach(
        head, InSpace(point=hand, elbow=(0.6, 0.3, 0.5), fingers=(0.2, 1.0, 0.0), yaw_rad=home.yaw_rad), 0.0, 0.7, 0.05
    )
    score.reach(OTHER[head], OnBone(along=who.u(0.45, 0.6)), 0.1, 0.6)
    score.move(0.1, 0.7, side=sign * who.u(10, 16) * DEG, roll=sign * who.u(10, 16) * DEG, pitch=-18 * DEG)
    score.wait(0.5)
    score.home = home
    score.place = Place(x_m=hips[0], y_m=hips[1], floor_m=home.floor_m + bed_m, yaw_rad=home.yaw_rad - sign * np.pi / 2)
    score.put(0.0, swing_s * 0.85, hips=(0.0, 0.0, body.back_m + 0.005))
    score.move(0.45 * swing_s, 0.5 * swing_s, ground=score.place.floor_m)
    score.move(0.05, 0.85 * swing_s, yaw=score.place.yaw_rad)
    score.move(0.0, 0.55 * swing_s, roll=sign * who.u(24, 32) * DEG)
    score.move(0.42 * swing_s, 0.55 * swing_s, roll=0.0, side=0.0)
    score.move(0.1, swing_s, pitch=-90 * DEG)
    score.move(0.3 * swing_s, 0.7 * swing_s, flex=who.u(3, 8) * DEG, twist=0.0, look=0.0)
    score.move(0.2 * swing_s, 0.8 * swing_s, gaze=-who.u(66, 80) * DEG, tilt=0.0)
    for number, side in enumerate((OTHER[head], head)):
        after = 0.05 + 0.2 * number
        extend_leg(score, who, side, after + 0.12 * swing_s, 0.78 * swing_s, bent=who.u(0.96, 0.98))
        rise = score.values[f"{side}_z"]
        score.move(after, 0.5 * swing_s, **{f"{side}_z": rise + who.u(0.06, 0.12)})
        score.move(after + 0.45 * swing_s, 0.5 * swing_s, **{f"{side}_z": rise})
    arms_of_rest(score, who, 0.55 * swing_s, 0.6 * swing_s)
    score.wait(1.2 * swing_s)
    score.notes.append(f"the bed is {bed_m:.2f} m high, the head to the {head}")


def off_bed(score: Score, who: Performer) -> None:
    """Over the side up to sitting on the bed's edge, legs first."""
    body = who.anatomy
    home = score.home
    assert home is not None, "lying on a bed, one has come from its edge"
    up_s = who.u(1.9, 2.5)
    turn = home.yaw_rad - score.place.yaw_rad  # to the side on which the bed's edge is
    head = "left" if turn > 0 else "right"
    sign = SIGN[head]
    bed_m = score.place.floor_m - home.floor_m
    hand = home.world(
        home.local(score.values["x"], score.values["y"])[0],
        home.local(score.values["x"], score.values["y"])[1] + sign * 0.32,
        bed_m + 0.03 * who.tall,
    )
    score.reach(
        head,
        InSpace(point=hand, elbow=(0.6, 0.3, 0.5), fingers=(0.3, 1.0, 0.0), yaw_rad=home.yaw_rad),
        0.1,
        0.5 * up_s,
        0.03,
    )
    x, _ = home.local(score.values["x"], score.values["y"])
    score.place = home
    shank = who.u(2, 10) * DEG
    for number, side in enumerate((OTHER[head], head)):
        bx, by = stance_foot_wide(who, side)
        edge = x + 0.16 * body.leg_m
        thigh, lower = (body.skeleton.bone_m(f"{side}_{joint}") for joint in ("knee", "ankle"))
        rise_m = bed_m + body.seat_m - body.ankle_m - lower * np.cos(shank)
        foot_x = edge + np.sqrt(thigh**2 - rise_m**2) - lower * np.sin(shank) + bx
        after = 0.1 + 0.18 * number
        score.put(after, 0.85 * up_s, **{side: (float(foot_x), by)})
        height = score.values[f"{side}_z"]
        score.move(after, 0.4 * up_s, **{f"{side}_z": height + 0.06})
        score.move(after + 0.3 * up_s, 0.65 * up_s, **{f"{side}_z": home.floor_m})
        score.move(
            after + 0.1 * up_s,
            0.7 * up_s,
            **{
                f"{side}_loose": 0.0,
                f"{side}_splay": 0.0,
                f"{side}_yaw": home.yaw_rad + SIGN[side] * who.traits["toe_out"],
            },
        )
    score.move(0.0, 0.3 * up_s, ground=home.floor_m)
    score.put(0.2, 0.8 * up_s, hips=(x + 0.16 * body.leg_m, 0.0, bed_m + body.seat_m))
    score.move(0.15, 0.8 * up_s, yaw=home.yaw_rad)
    score.move(0.05, 0.5 * up_s, roll=sign * who.u(24, 32) * DEG, flex=who.u(20, 28) * DEG, gaze=-15 * DEG)
    score.move(0.1, 0.95 * up_s, pitch=-12 * DEG)
    score.move(0.5 * up_s, 0.6 * up_s, roll=0.0)
    score.move(0.6 * up_s, 0.5 * up_s, gaze=who.traits["gaze"])
    for side in SIDES:
        score.reach(side, OnBone(along=who.u(0.6, 0.85)), 0.75 * up_s, 0.5 * up_s, 0.04)
    score.wait(1.25 * up_s + who.u(0.2, 0.6))
    score.posture = "sitting"


def arms_of_rest(score: Score, who: Performer, after_s: float, duration_s: float) -> None:
    """Lying on the back: arms beside the body, or a hand on the belly."""
    for side in SIDES:
        beside: Goal = OnPelvis(
            ahead=-0.028,
            out=who.u(0.085, 0.125),
            up=who.u(-0.03, 0.0),
            elbow=(-0.3, 1.0, 0.0),
            fingers=(-0.05, 0.12, -1.0),
            back=(0.8, 0.6, 0.0),
        )
        if who.chance(0.25):
            beside = OnPelvis(
                ahead=0.085,
                out=-0.01,
                up=who.u(0.07, 0.12),
                elbow=(-0.5, 1.0, 0.0),
                fingers=(0.1, -1.0, -0.1),
                back=(1.0, 0.1, 0.0),
            )
        score.reach(side, beside, after_s + who.u(0.0, 0.15), duration_s, 0.03)


def extend_leg(score: Score, who: Performer, side: str, after_s: float, duration_s: float, *, bent: float) -> None:
    """A leg lies ahead of the hips, `bent` times as long as it is when straight, heel on the ground."""
    body = who.anatomy
    x, y = score.at("hips")
    height = HEEL * who.tall
    aside = SIGN[side] * who.u(0.9, 1.25) * body.hips_m
    rise = score.values["z"] - score.place.floor_m - height
    level = np.sqrt((bent * body.leg_m) ** 2 - rise**2 - (aside - SIGN[side] * body.hips_m) ** 2)
    score.put(after_s, duration_s, **{side: (x + float(level), y + aside, height - body.sole_m)})
    score.move(
        after_s,
        duration_s,
        **{
            f"{side}_loose": 1.0,
            f"{side}_tip": 0.0,
            f"{side}_splay": who.u(4, 22) * DEG,
            f"{side}_yaw": score.place.yaw_rad,
        },
    )


def stance_foot_wide(who: Performer, side: str) -> tuple[float, float]:
    """Ball of a foot that is a little wider than in quiet standing, against the middle of the hips [m]."""
    turn = who.traits["toe_out"]
    return who.anatomy.foot_m * np.cos(turn), SIGN[side] * (
        1.25 * who.traits["half_width"] + who.anatomy.foot_m * np.sin(turn)
    )


# --- down to the floor, lying on floor or bed, and up again ---


def sit_down(score: Score, who: Performer, step: Step) -> None:
    """Sit down on the floor or on a chair."""
    if step.object == "floor":
        floor_seat(score, who, step)
    else:
        seat.sit(score, who, step)


def sit_on_floor(score: Score, who: Performer, step: Step) -> None:
    """Down into a squat, hips back and down, hands to the floor behind them; then legs ahead, crossed, or knees up."""
    body = who.anatomy
    down_s, drop_s = who.u(1.4, 1.75), who.u(1.0, 1.25)
    x, y = middle(score, who)
    score.move(0.0, 0.9 * down_s, pitch=who.u(17, 24) * DEG, flex=who.u(20, 29) * DEG)
    score.move(0.05, down_s, z=score.place.floor_m + squat_m(who, who.u(132, 140) * DEG), gaze=who.u(22, 38) * DEG)
    score.put(0.05, down_s, com=(x - 0.1 * body.foot_m, y))
    for side in SIDES:
        score.move(0.0, down_s, **{f"{side}_splay": who.u(6, 14) * DEG})
    hips = x - who.u(0.53, 0.62) * body.leg_m
    _hands_behind(score, who, hips, 0.45 * down_s, 0.5 * down_s + drop_s)
    score.wait(0.86 * down_s)
    score.put(0.0, drop_s, hips=(hips, y, body.seat_m))
    score.move(0.0, 0.8 * drop_s, balanced=0.0)
    score.move(0.0, drop_s, pitch=-who.u(20, 27) * DEG, flex=who.u(22, 30) * DEG)
    score.wait(drop_s)
    score.posture = "sitting on the floor"
    score.notes.append("sits on the floor")


def floor_seat(score: Score, who: Performer, step: Step) -> None:
    """Sit down on the floor and get comfortable there."""
    sit_on_floor(score, who, step)
    how = str(who.rng.choice(["ahead", "crossed", "knees up"], p=[0.35, 0.4, 0.25]))
    legs_s = who.u(0.6, 0.75)
    hips = score.at("hips")
    for number, side in enumerate((who.handed, OTHER[who.handed])):
        after = number * who.u(0.7, 0.9) * legs_s
        if how == "knees up":
            continue
        if how == "ahead":
            extend_leg(score, who, side, after, legs_s, bent=who.u(0.955, 0.975))
        elif how == "crossed":
            ankle = (
                hips[0] + who.u(0.34, 0.40) * who.anatomy.leg_m,
                -SIGN[side] * who.u(0.04, 0.08),
                HEEL * who.tall - who.anatomy.sole_m + 0.045 * number,
            )
            score.put(after, legs_s, **{side: ankle})
            score.move(
                after, legs_s, **{f"{side}_loose": 1.0, f"{side}_splay": who.u(62, 74) * DEG, f"{side}_tip": 0.0}
            )
        score.hump(after, 0.9 * legs_s, **{f"{side}_z": who.u(0.06, 0.10)})
    score.wait(legs_s)
    leaning = how == "ahead" and who.chance(0.45)
    up_s = who.u(0.8, 1.1)
    slump = who.traits["flex"]
    if leaning:
        score.move(0.0, up_s, pitch=-who.u(24, 30) * DEG, flex=slump + who.u(8, 14) * DEG)
    else:
        score.move(0.0, up_s, pitch=-who.u(14, 20) * DEG, flex=slump + who.u(20, 28) * DEG)
        along = {"ahead": who.u(0.55, 0.8), "crossed": who.u(0.75, 0.9), "knees up": 0.93}[how]
        for side in SIDES:
            score.reach(side, OnBone(along=along + who.u(-0.03, 0.03)), who.u(0.0, 0.2), up_s, 0.05)
    score.move(0.1, up_s, gaze=who.traits["gaze"] + who.u(0, 8) * DEG, look=who.about(0, 8) * DEG)
    score.wait(up_s + legs_s * 0.7 + who.u(0.4, 0.9))
    score.notes.append({"ahead": "legs ahead", "crossed": "cross-legged", "knees up": "knees up"}[how])


def _hands_behind(
    score: Score, who: Performer, hips_x: float, after_s: float, duration_s: float, sides: tuple[str, ...] = SIDES
) -> None:
    """Hands to the floor behind the hips, one a little before the other."""
    for number, side in enumerate(sides):
        point = score.place.world(
            hips_x - who.u(0.17, 0.24) * who.tall / 1.72, SIGN[side] * who.u(0.15, 0.18) * who.tall, 0.03 * who.tall
        )
        goal = InSpace(
            point=point,
            elbow=(-1.0, 0.3, 0.0),
            fingers=(-0.5, 0.8, -0.1),
            back=(0.2, 0.0, 1.0),
            yaw_rad=score.place.yaw_rad,
        )
        score.reach(side, goal, after_s + 0.12 * number, duration_s - 0.12 * number, 0.04)


def lie_down(score: Score, who: Performer, step: Step) -> None:
    """Lie down on the floor, or on a bed by way of sitting on its edge."""
    if score.posture == "standing":
        if step.object == "floor" or (step.object is None and who.chance(0.5)):
            sit_on_floor(score, who, step)
        else:
            seat.sit(score, who, Step(action="sit", manner=step.manner), backrest=False)
    if score.posture == "sitting":
        onto_bed(score, who)
        score.posture = "lying on a bed"
    elif score.posture == "sitting on the floor":
        _recline(score, who)
        score.posture = "lying on the floor"
    score.notes.append(score.posture.replace("lying", "lies"))
    if step.direction in ("left", "right", "forward"):
        _roll(score, who, step.direction)
    score.wait(who.u(0.6, 1.2))


def _recline(score: Score, who: Performer) -> None:
    """From sitting on the floor the trunk goes down behind the hips, the spine rounded so that it unrolls; legs go out."""
    body = who.anatomy
    down_s = who.u(1.7, 2.3)
    x, y = score.at("hips")
    _hands_behind(score, who, x, -0.2, 0.5)
    bends = who.chance(0.3)
    for number, side in enumerate((who.handed, OTHER[who.handed])):
        if not bends:  # one after the other, so that a heel is down meanwhile
            after = (who.u(0.0, 0.1) + 0.4 * number) * down_s
            extend_leg(score, who, side, after, 0.42 * down_s, bent=who.u(0.965, 0.982))
            score.hump(after, 0.4 * down_s, **{f"{side}_z": who.u(0.06, 0.10)})
    score.put(0.1 * down_s, 0.8 * down_s, hips=(x - 0.02, y, body.back_m))
    score.move(0.0, down_s, pitch=-90 * DEG, look=0.0)
    score.move(0.0, 0.5 * down_s, flex=who.u(34, 44) * DEG)
    score.move(0.42 * down_s, 0.62 * down_s, flex=who.u(-4, 2) * DEG)
    score.move(0.0, 0.5 * down_s, gaze=-10 * DEG)
    score.move(0.5 * down_s, 0.65 * down_s, gaze=-who.u(72, 84) * DEG)
    arms_of_rest(score, who, 0.45 * down_s, 0.75 * down_s)
    score.wait(1.15 * down_s)


def _roll(score: Score, who: Performer, towards: str) -> None:
    """From the back onto a side, or over the side onto the belly."""
    body = who.anatomy
    side = towards if towards in SIDES else who.side(0.5)
    sign = SIGN[side]
    roll_s = who.u(1.3, 1.8)
    prone = towards == "forward"
    score.reach(
        side,
        OnChest(
            ahead=0.45 if not prone else 0.15,
            out=0.15,
            up=0.35 if not prone else 0.9,
            elbow=(-0.8, 0.2, 0.2) if prone else (-0.5, 0.1, 0.8),
        ),
        -0.2,
        0.7,
    )
    score.reach(OTHER[side], OnChest(ahead=0.55, out=-0.45, up=-0.2, elbow=(0.0, 0.9, -0.4)), 0.1, 0.8 * roll_s)
    aside = body.hips_m + 0.036 * who.tall
    score.move(0.0, 0.8 * roll_s, z=score.place.floor_m + aside + (0.03 * who.tall if prone else 0.0))
    score.move(0.1, roll_s, spin=sign * who.u(76, 86) * DEG)
    need = 0.035 * who.tall + body.shoulders_m - aside
    score.move(
        0.2,
        roll_s,
        side=-sign * max(0.0, float(np.arcsin(np.clip(1.6 * need / body.trunk_m, 0, 0.5)))),
        tilt=sign * who.u(4, 12) * DEG,
    )
    x, y = score.at("hips")
    for each in SIDES:
        top = each != side
        # Over a bent knee one does not roll onto the belly.
        bend = who.u(0.991, 0.996) if prone else who.u(0.78, 0.88) if top else who.u(0.88, 0.95)
        angle = who.u(0.0, 0.04) if prone else who.u(0.25, 0.4)
        ahead, forward = bend * body.leg_m * float(np.cos(angle)), sign * bend * body.leg_m * float(np.sin(angle))
        height = HEEL * who.tall + (0.05 * who.tall if top else 0.0)
        score.put(0.15, roll_s, **{each: (x + ahead, y + forward, height)})
        score.move(0.15, 0.6 * roll_s, **{f"{each}_loose": 1.0, f"{each}_tip": 0.0, f"{each}_yaw": score.place.yaw_rad})
    score.wait(roll_s + 0.2)
    score.notes.append(f"on the {side} side" if not prone else "on the belly")
    if prone:
        over_s = who.u(1.0, 1.4)
        score.move(0.0, over_s, spin=sign * 180 * DEG, side=0.0, tilt=0.0)
        score.move(0.4 * over_s, 0.8 * over_s, z=score.place.floor_m + body.back_m + 0.02)
        score.move(0.2, over_s, look=SIGN[who.side(0.5)] * who.u(45, 60) * DEG)
        score.put(0.0, over_s, hips=(x, y + sign * 0.16))
        for each in SIDES:
            ankle = x + 0.996 * body.leg_m, y + sign * 0.16 - SIGN[each] * body.hips_m, 0.062 * who.tall
            score.put(0.0, 0.8 * over_s, **{each: ankle})
            goal = OnChest(
                ahead=0.13,
                out=who.u(0.25, 0.4),
                up=who.u(0.45, 0.6),
                elbow=(0.0, 1.0, -0.3),
                fingers=(0.1, -0.4, 0.9),
                back=(-1.0, 0.0, 0.0),
            )
            score.reach(each, goal, 0.1, over_s)
        score.wait(over_s + 0.2)


def rise(score: Score, who: Performer, step: Step) -> None:
    """Stand up from wherever one is: chair, floor or bed."""
    if score.posture in ("lying on the floor", "lying on a bed"):
        _unroll(score, who)
    if score.posture == "lying on a bed":
        off_bed(score, who)
    if score.posture == "lying on the floor":
        _sit_up(score, who)
    if score.posture == "sitting on the floor":
        _up_from_floor(score, who)
    elif score.posture == "sitting":
        seat.stand_up(score, who, step)
    score.posture = "standing"


def _unroll(score: Score, who: Performer) -> None:
    """Back from side or belly onto the back."""
    if abs(score.values["spin"]) < 10 * DEG:
        return
    roll_s = who.u(1.2, 1.7) * (1.5 if abs(score.values["spin"]) > 120 * DEG else 1.0)
    score.move(0.0, roll_s, spin=0.0, side=0.0, tilt=0.0, look=0.0)
    score.hump(0.0, roll_s, z=0.05)
    score.move(0.3 * roll_s, 0.7 * roll_s, z=score.place.floor_m + who.anatomy.back_m)
    for side in SIDES:
        extend_leg(score, who, side, 0.1, roll_s, bent=0.97)
    arms_of_rest(score, who, 0.2 * roll_s, roll_s)
    score.wait(roll_s + 0.3)


def _sit_up(score: Score, who: Performer) -> None:
    """The trunk rolls up, head first, arms push; knees bend, feet go flat: most frequent in young adults (VanSant 1988)."""
    body = who.anatomy
    up_s = who.u(1.1, 1.5)
    x, y = score.at("hips")
    _hands_behind(score, who, x, 0.15 * up_s, 0.7 * up_s)
    score.move(-0.1, 0.5 * up_s, gaze=-25 * DEG)
    score.move(0.05, 0.6 * up_s, flex=who.u(36, 46) * DEG)
    score.move(0.15 * up_s, 0.85 * up_s, pitch=-who.u(20, 26) * DEG)
    score.move(0.5 * up_s, 0.6 * up_s, gaze=15 * DEG)
    score.put(0.2 * up_s, 0.7 * up_s, hips=(x, y, body.seat_m))
    _feet_flat(score, who, 0.1 * up_s, up_s)
    score.wait(1.1 * up_s)
    score.posture = "sitting on the floor"


def _feet_flat(score: Score, who: Performer, after_s: float, duration_s: float) -> None:
    """Both feet flat on the floor ahead of the hips, knees bent."""
    x, y = score.at("hips")
    for number, side in enumerate(SIDES):
        bx, by = stance_foot_wide(who, side)
        score.put(after_s + 0.15 * number, duration_s, **{side: (x + 0.53 * who.anatomy.leg_m + bx, y + by, 0.0)})
        score.hump(after_s + 0.15 * number, duration_s, **{f"{side}_z": 0.05})
        toe_out = score.place.yaw_rad + SIGN[side] * who.traits["toe_out"]
        score.move(
            after_s + 0.15 * number,
            duration_s,
            **{
                f"{side}_loose": 0.0,
                f"{side}_tip": 0.0,
                f"{side}_splay": 8 * DEG,
                f"{side}_yaw": toe_out,
                f"{side}_pivot": 1.0,
            },
        )


def _up_from_floor(score: Score, who: Performer) -> None:
    """From sitting on the floor: hands push behind, the trunk swings forward over the feet into a squat, then up."""
    body = who.anatomy
    x, _ = score.at("hips")
    if score.values["left_loose"] > 0.5 or score.at("left")[0] - x > 0.7 * body.leg_m:
        _hands_behind(score, who, x, 0.0, 0.8)
        score.move(0.0, 0.8, pitch=-22 * DEG, flex=30 * DEG, gaze=15 * DEG)
        _feet_flat(score, who, 0.0, who.u(0.8, 1.0))
        score.wait(1.0)
    else:
        _hands_behind(score, who, x, 0.0, 0.6)
        score.wait(0.5)
    over_s, up_s = who.u(0.8, 1.0), who.u(1.1, 1.4)
    cx, cy = middle(score, who)
    score.move(0.25 * over_s, over_s, pitch=who.u(8, 15) * DEG, flex=who.u(18, 25) * DEG, gaze=who.u(15, 30) * DEG)
    score.wait(0.25 * over_s)
    score.put(-0.2, 0.15, com=(cx + 0.6 * body.foot_m, cy))
    tip = who.u(12, 22) * DEG
    score.move(0.12 * over_s, 0.8 * over_s, balanced=1.0)
    height = squat_m(who, who.u(118, 130) * DEG) + 0.5 * float(np.sin(tip)) * body.foot_m
    score.move(0.0, over_s, z=score.place.floor_m + height)
    for side in SIDES:
        forward = OnChest(ahead=who.u(0.6, 0.8), out=who.u(0.0, 0.1), up=-who.u(0.1, 0.3), elbow=(-0.3, 0.6, -0.7))
        goal = OnBone(along=who.u(0.75, 0.9)) if who.chance(0.3) else forward
        score.reach(side, goal, 0.05 * over_s, 0.85 * over_s, 0.06)
        score.move(0.3 * over_s, 0.7 * over_s, **{f"{side}_tip": tip * who.u(0.9, 1.1)})
    score.wait(0.85 * over_s)
    stand_tall(score, who, 0.0, up_s)
    for side in SIDES:
        score.move(0.1, up_s, **{f"{side}_splay": 0.0})
        score.move(0.05, 0.55 * up_s, **{f"{side}_tip": 0.0})
    score.wait(up_s + who.u(0.3, 0.5))
    score.posture = "standing"


def floor_seated(who: Performer, step: Step) -> Score:
    """A score that begins with sitting on the floor."""
    score = stance(who)
    floor_seat(score, who, Step(action="sit", object="floor", manner=step.manner))
    return seat.begun(score, who, step)


def lying(who: Performer, step: Step, *, bed: bool) -> Score:
    """A score that begins with lying on the back."""
    score = stance(who)
    lie_down(score, who, Step(action="lie_down", object=None if bed else "floor", manner=step.manner))
    return seat.begun(score, who, step)
