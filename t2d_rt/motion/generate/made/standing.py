"""Bending, squatting and stretching with both feet on the floor."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate.made.hands import Goal, InSpace, OnBone, OnChest, OnPelvis
from t2d_rt.motion.generate.made.performer import Performer, middle, stand_tall
from t2d_rt.motion.generate.made.render import still
from t2d_rt.motion.generate.made.score import DEG, INDEX, OTHER, SIDES, SIGN, Score

# --- bending and squatting with both feet on the floor ---


MORE_KNEES = np.array([0, 14, 28, 42, 56]) * DEG
"""What the knees may bend by beside what they should, so that hands come down to the floor."""

MOST_KNEES = 112 * DEG

STOOP, SCOOP = 105 * DEG, 84 * DEG
"""Greatest lean with the knees nearly straight, and with them bent."""


def bend(score: Score, who: Performer, step: Step) -> None:
    """Bend as the words say: to a thing on the floor, to knee or foot, to a side, backward, or one's knees."""
    if step.direction in ("left", "right") and step.object is None:
        _repeat(score, who, step, _bend_aside)
    elif step.direction == "back":
        _repeat(score, who, step, bend_back)
    elif step.body_part == "knee":
        _repeat(score, who, step, _bend_knees)
    else:
        _repeat(score, who, step, bend_down)


def _repeat(score: Score, who: Performer, step: Step, once: Callable[[Score, Performer, Step], None]) -> None:
    for number in range(step.count or 1):
        if number:
            score.wait(who.u(0.0, 0.3))
        once(score, who, step)


def bend_down(score: Score, who: Performer, step: Step) -> None:
    """Forward and down until the hand is where it should be; lumbar spine first, hips after (Esola 1996), 2 to 4 s in all."""
    side = step.side or who.side()
    touch = step.body_part == "foot" or step.object == "floor" or step.direction == "down"
    if step.body_part in ("arm", "hand") and step.object is None:
        _bend_arms_out(score, who, step)
        return
    picks = step.object == "ball" or (step.body_part is None and not touch and who.chance(0.5))
    down_s, up_s, rest_s = who.u(0.95, 1.3), who.u(0.98, 1.3), who.u(0.1, 0.35)
    stoops = step.body_part in ("waist", "foot", "leg") or who.chance(0.22)
    knees = who.u(8, 24) * DEG if stoops else who.u(45, 100) * DEG
    both = (touch and who.chance(0.5)) or (not picks and who.chance(0.5))
    goals = _low_goals(score, who, step, side, both=both, picks=picks)
    free = OTHER[side]
    shape = _leaned(
        score, who, goals, knees, fraction=who.u(0.40, 0.50),
        twist=0.0 if both else -SIGN[side] * who.u(2, 9) * DEG, most_rad=STOOP if stoops else SCOOP,
    )  # fmt: skip
    score.move(0.0, 0.8 * down_s, flex=0.55 * shape["flex"], gaze=who.about(45, 8) * DEG)
    score.move(0.18 * down_s, 0.85 * down_s, **{**shape, "z": score.values["z"]})
    score.move(0.08 * down_s, 0.92 * down_s, z=shape["z"])
    forward = who.u(0.0, 0.25) * who.anatomy.foot_m
    x, y = middle(score, who)
    score.put(0.1 * down_s, 0.9 * down_s, com=(x + forward, y))
    for each, goal in goals.items():
        score.reach(each, goal, who.u(0.05, 0.15) * down_s, down_s * who.u(0.88, 0.96), 0.02)
    if not both:
        rest = OnBone(along=who.u(0.72, 0.9)) if who.chance(0.55) else who.hang()
        score.reach(free, rest, 0.15 * down_s, 0.8 * down_s, 0.05)
    score.wait(1.03 * down_s + rest_s)
    if picks:
        for each in goals:
            near = OnChest(
                ahead=who.u(0.42, 0.55), out=who.u(-0.28, -0.12), up=who.u(-0.55, -0.4), elbow=(-0.5, 0.5, -0.8)
            )
            score.reach(each, near, 0.1 * up_s, up_s * who.u(0.9, 1.0))
        score.reach(free, who.hang(), 0.15 * up_s, 0.8 * up_s, 0.05) if not both else None
    stand_tall(score, who, 0.0, up_s, arms=not picks)
    score.wait(up_s)
    if picks and who.chance(0.5):
        score.wait(0.3)
        for each in SIDES:
            score.reach(each, who.hang(), 0.0, who.u(0.6, 0.9))
        score.wait(0.6)
    score.wait(who.u(0.15, 0.35))


def _bend_arms_out(score: Score, who: Performer, step: Step) -> None:
    """Forward from the hips with one or both arms held out, ahead or to the sides."""
    down_s, up_s = who.u(0.9, 1.2), who.u(0.9, 1.2)
    lean = who.u(50, 80)
    score.move(0.0, 0.9 * down_s, flex=0.4 * lean * DEG, gaze=who.u(30, 50) * DEG)
    score.move(0.15, 0.95 * down_s, pitch=0.6 * lean * DEG, z=score.place.floor_m + squat_m(who, who.u(8, 30) * DEG))
    aside = who.chance(0.4)
    for side in (step.side,) if step.side else SIDES:
        ahead, out = (who.u(0.1, 0.3), who.u(0.82, 0.9)) if aside else (who.u(0.8, 0.9), who.u(0.05, 0.2))
        score.reach(
            side, OnChest(ahead=ahead, out=out, up=who.u(0.0, 0.35), elbow=(-0.5, 0.3, -0.8)), who.u(0.0, 0.1), down_s
        )
    score.wait(1.05 * down_s + who.u(0.1, 0.5))
    stand_tall(score, who, 0.0, up_s)
    score.wait(up_s + who.u(0.15, 0.35))


def _low_goals(score: Score, who: Performer, step: Step, side: str, *, both: bool, picks: bool) -> dict[str, Goal]:
    """Where the hands go: a thing ahead of the feet, floor, feet, shins or knees."""
    sides = SIDES if both else (side,)
    found: dict[str, Goal] = {}
    ahead, aside = who.u(0.12, 0.42), who.u(-0.06, 0.20)
    if step.direction in ("left", "right"):
        aside += (0.28 if step.direction == "left" else -0.28) * SIGN[side]
    for each in sides:
        if step.body_part == "foot":
            x, y = score.at(each)
            point, fingers = (x - who.u(0.0, 0.05), y + SIGN[each] * 0.015, 0.055 * who.tall + 0.02), (0.4, 0.0, -0.9)
        elif (step.body_part == "waist" and not picks) or not (
            picks or step.object == "floor" or step.direction == "down" or who.chance(0.5)
        ):
            along = who.u(0.15, 0.75)
            found[each] = OnBone(upper="knee", lower="ankle", along=along, lift=0.05)
            continue
        else:
            x = who.anatomy.foot_m + ahead
            y = SIGN[each] * (aside if not both else who.u(0.07, 0.10) if picks else 0.12)
            # The hand's end comes to the floor, or beside the thing that lies there.
            point, fingers = (x, y, 0.95 * who.anatomy.hand_m + (0.03 if picks else 0.012)), (0.35, -0.1, -0.95)
        found[each] = InSpace(
            point=score.place.world(*point), elbow=(-0.4, 0.8, 0.3), fingers=fingers, back=(0.5, 0.8, 0.3),
            yaw_rad=score.place.yaw_rad, held=not picks,
        )  # fmt: skip
    return found


def _leaned(
    score: Score, who: Performer, goals: dict[str, Goal], knees_rad: float, *, fraction: float, twist: float, most_rad: float
) -> dict[str, float]:  # fmt: skip
    """The smallest lean up to `most_rad` with which the hands reach their goals with the elbows a little bent, knees bent by an
    angle, or by a greater one where that is not enough.

    fraction: the spine's part of it, the hips do the rest.
    """
    body = who.anatomy
    leans, knees = (
        each.ravel()
        for each in np.meshgrid(
            np.linspace(15 * DEG, most_rad, 16), np.minimum(knees_rad + MORE_KNEES, MOST_KNEES), copy=False
        )
    )
    heights = score.place.floor_m + np.array([squat_m(who, each) for each in knees])
    values = {**score.values, "twist": twist}
    table = np.tile([values[name] for name in INDEX], (len(leans), 1))
    spine = np.minimum(fraction * leans, 55 * DEG)
    table[:, INDEX["z"]], table[:, INDEX["flex"]], table[:, INDEX["pitch"]] = heights, spine, leans - spine
    figure, _ = still(body, table)
    short = np.zeros(len(leans))
    for side, goal in goals.items():
        span = goal.place(figure, side).wrist - figure.points[f"{side}_shoulder"]
        short = np.maximum(short, np.linalg.norm(span, axis=-1) - 0.955 * body.arm_m)
    best = int(np.argmax(short <= 0)) if (short <= 0).any() else int(np.argmin(short))
    pitch = float(leans[best] - spine[best])
    return {"z": float(heights[best]), "flex": float(spine[best]), "pitch": pitch, "twist": twist}


def squat_m(who: Performer, knees_rad: float) -> float:
    """Height of the hips over feet that stand flat, with the knees bent by an angle and the hips somewhat behind the ankles."""
    thigh, shank = (who.anatomy.skeleton.bone_m(f"left_{joint}") for joint in ("knee", "ankle"))
    length2 = thigh**2 + shank**2 + 2 * thigh * shank * np.cos(knees_rad)
    behind = 0.16 * who.anatomy.leg_m * np.sin(min(knees_rad, np.pi / 2))
    return float(min(who.anatomy.ankle_m + np.sqrt(length2 - behind**2), who.anatomy.standing_m))


def _bend_aside(score: Score, who: Performer, step: Step) -> None:
    """To a side: the hand slides down the thigh, hips go the other way; the other arm hangs, rests on the hip or goes overhead."""
    lean = step.direction or "left"
    sign = SIGN[lean]
    down_s, up_s = who.u(0.8, 1.15), who.u(0.8, 1.15)
    x, y = middle(score, who)
    score.move(0.0, down_s, side=sign * who.u(38, 50) * DEG, twist=sign * who.about(0, 4) * DEG)
    score.move(0.05, down_s, roll=sign * who.u(8, 14) * DEG, tilt=sign * who.u(4, 14) * DEG)
    score.move(0.05, down_s, flex=who.traits["flex"] + who.about(2, 3) * DEG)
    score.put(0.05, down_s, com=(x, y + sign * 0.02))
    score.reach(lean, OnBone(along=who.u(0.72, 0.9), lift=0.0, out=0.062 + 0.012), 0.05, down_s * 0.95, 0.03)
    how = who.rng.choice(["hang", "hip", "over"])
    if how == "hip":
        score.reach(OTHER[lean], OnPelvis(), 0.0, 0.9 * down_s, 0.05)
    elif how == "over":
        raise_arm(score, who, OTHER[lean], 0.0, down_s)
    score.wait(down_s + who.u(0.2, 0.6))
    stand_tall(score, who, 0.0, up_s)
    if how == "over":
        score.grasps[OTHER[lean]].pop()
        lower_arm(score, who, OTHER[lean], 0.0, up_s)
    score.wait(up_s + who.u(0.1, 0.3))


def bend_back(score: Score, who: Performer, step: Step) -> None:
    """Backward: hips forward, hands on the hips, knees give a little; the spine extends by 30 to 40 degrees (Kapandji)."""
    down_s, up_s = who.u(0.9, 1.3), who.u(0.9, 1.2)
    score.move(0.0, down_s, flex=-who.u(30, 40) * DEG, pitch=-who.u(14, 20) * DEG)
    score.move(0.15, down_s, gaze=-who.u(25, 45) * DEG)
    score.move(0.0, down_s, z=score.values["z"] - who.u(0.008, 0.02) * who.tall)
    hands = who.chance(0.75)
    for side in SIDES:
        if hands:
            score.reach(
                side,
                OnPelvis(ahead=-0.045, out=0.055, up=0.045, fingers=(-0.2, -0.5, -0.8), back=(-0.9, 0.4, 0.0)),
                0.0,
                0.75 * down_s,
                0.07,
            )
    score.wait(down_s + who.u(0.2, 0.7))
    stand_tall(score, who, 0.0, up_s)
    score.wait(up_s + who.u(0.1, 0.3))


def _bend_knees(score: Score, who: Performer, step: Step) -> None:
    """Both knees: a shallow squat."""
    _down_and_up(score, who, knees=who.u(74, 96) * DEG, lean=who.u(20, 32), hold_s=who.u(0.1, 0.4))


def squat(score: Score, who: Performer, step: Step) -> None:
    """Down and up in 2 to 3 s, shanks and trunk leaning about alike so that the weight stays over the feet (Schoenfeld 2010)."""
    for number in range(step.count or 1):
        deep = who.chance(0.3)
        knees = who.u(112, 130) if deep else who.u(78, 110)
        arms = str(who.rng.choice(["ahead", "knees", "clasped", "hang"], p=[0.4, 0.25, 0.25, 0.1]))
        if step.body_part in ("arm", "hand"):
            arms = "ahead"
        elif step.object == "ball":
            arms = "low"
        _down_and_up(
            score, who, knees=knees * DEG, lean=who.u(30, 42) + (6 if deep or arms == "low" else 0), hold_s=who.u(0.0, 0.6),
            arms=arms, heels=who.u(12, 24) * DEG if deep and who.chance(0.6) else 0.0, last=number + 1 == (step.count or 1),
        )  # fmt: skip


def _down_and_up(
    score: Score,
    who: Performer,
    *,
    knees: float,
    lean: float,
    hold_s: float,
    arms: str = "hang",
    heels: float = 0.0,
    last: bool = True,
) -> None:
    down_s, up_s = who.u(0.95, 1.3), who.u(0.85, 1.2)
    spine = who.u(0.3, 0.45) * lean
    z = score.place.floor_m + squat_m(who, knees) + 0.6 * np.sin(heels) * who.anatomy.foot_m
    score.move(0.0, down_s * 0.95, pitch=(lean - spine) * DEG, flex=who.traits["flex"] + (spine - 3) * DEG)
    score.move(0.06, down_s, z=float(z))
    score.move(0.0, down_s, gaze=who.about(14, 6) * DEG)
    x, y = middle(score, who)
    score.put(0.05, (0.6 if heels else 1.0) * down_s, com=(x + (0.78 if heels else 0.0) * who.anatomy.foot_m, y))
    splay = (who.u(14, 20) if arms == "low" else who.u(2, 14)) * DEG
    for side in SIDES:
        score.move(0.0, down_s, **{f"{side}_splay": splay * who.u(0.8, 1.2)})
        if heels:
            score.move(0.42 * down_s, 0.6 * down_s, **{f"{side}_tip": heels * who.u(0.9, 1.1)})
        goal = _squat_hands(who, arms)
        if goal is not None:
            score.reach(side, goal, who.u(0, 0.06), down_s * who.u(0.82, 0.92), 0.03)
    score.wait(down_s * 1.02 + hold_s)
    stand_tall(score, who, 0.0, up_s, arms=last and arms != "hang")
    for side in SIDES:
        score.move(0.1, up_s, **{f"{side}_splay": 0.0})
        score.move(0.05, 0.55 * up_s, **{f"{side}_tip": 0.0})
    score.wait(up_s + (who.u(0.2, 0.4) if last else who.u(0.0, 0.2)))


def _squat_hands(who: Performer, arms: str) -> Goal | None:
    if arms == "ahead":
        return OnChest(
            ahead=who.about(0.88, 0.03), out=who.about(-0.05, 0.05), up=who.about(0.12, 0.1), elbow=(-0.2, 0.7, -0.7)
        )
    if arms == "knees":
        return OnBone(along=who.u(0.78, 0.9))
    if arms == "low":  # to a thing that lies ahead of the feet
        return OnChest(ahead=who.u(0.5, 0.65), out=who.u(-0.2, -0.1), up=-who.u(0.55, 0.7), elbow=(-0.4, 0.8, -0.2))
    if arms == "clasped":
        return OnChest(
            ahead=who.about(0.48, 0.03),
            out=-0.285,
            up=who.about(-0.16, 0.04),
            elbow=(-0.2, 0.7, -0.7),
            fingers=(0.5, -0.7, 0.5),
            back=(0.6, 0.7, 0.0),
        )
    return None


def raise_arm(score: Score, who: Performer, side: str, after_s: float, duration_s: float) -> None:
    """An arm goes up through the front; above the horizontal the shoulder blade turns along, one degree for two (Inman 1944)."""
    ahead = OnChest(ahead=who.u(0.86, 0.92), out=who.u(0.05, 0.2), up=who.u(0.1, 0.25), elbow=(-0.3, 0.8, -0.6))
    above = OnChest(ahead=who.u(0.04, 0.22), out=who.u(-0.22, 0.12), up=who.u(0.98, 1.07), elbow=(-0.15, 0.95, 0.0))
    score.reach(side, ahead, after_s, 0.72 * duration_s, 0.03)
    score.reach(side, above, after_s + 0.28 * duration_s, 0.72 * duration_s)
    score.move(after_s + 0.3 * duration_s, 0.7 * duration_s, **{f"{side}_shrug": who.u(20, 28) * DEG})


def lower_arm(score: Score, who: Performer, side: str, after_s: float, duration_s: float) -> None:
    """An arm comes down again, by the side or by the front."""
    if who.chance(0.5):
        via = OnChest(ahead=who.u(0.25, 0.4), out=who.u(0.75, 0.85), up=who.u(0.0, 0.2), elbow=(-0.6, 0.3, -0.6))
    else:
        via = OnChest(ahead=who.u(0.8, 0.9), out=who.u(0.1, 0.25), up=who.u(-0.1, 0.15), elbow=(-0.4, 0.7, -0.6))
    score.reach(side, via, after_s, 0.68 * duration_s)
    score.reach(side, who.hang(), after_s + 0.32 * duration_s, 0.68 * duration_s, 0.02)
    score.move(after_s, 0.6 * duration_s, **{f"{side}_shrug": 0.0})


# --- stretching arms, sides, back or a leg ---


def stretch(score: Score, who: Performer, step: Step) -> None:
    """Stretch arms, sides, back or a leg, as the words say."""
    for number in range(step.count or 1):
        if number:
            score.wait(who.u(0.1, 0.4))
        if step.body_part in ("leg", "foot", "knee"):
            _stretch_leg(score, who, step.side or who.side(0.5))
        elif step.direction == "back":
            bend_back(score, who, step)
        elif step.direction == "down":
            bend_down(score, who, Step(action="bend", body_part="foot", speed=step.speed, manner=step.manner))
        elif step.direction == "forward":
            _stretch_forward(score, who)
        else:
            _stretch_up(score, who, step)


def _stretch_up(score: Score, who: Performer, step: Step) -> None:
    """Arms overhead, the back arches, often on tiptoe; to a side if asked for."""
    up_s, hold_s, down_s = who.u(1.0, 1.4), who.u(0.5, 1.1), who.u(0.9, 1.3)
    sides = (step.side,) if step.side else SIDES if who.chance(0.8) else (who.side(),)
    lag = who.u(0.0, 0.15)
    for number, side in enumerate(sides):
        raise_arm(score, who, side, lag * number, up_s)
    score.move(0.1, up_s, flex=-who.u(6, 16) * DEG, pitch=-who.u(0, 4) * DEG, gaze=-who.u(5, 35) * DEG)
    tiptoe = who.chance(0.4) and step.direction not in ("left", "right") and step.body_part != "waist"
    x, y = middle(score, who)
    if tiptoe:
        tip = who.u(10, 22) * DEG
        x += 0.78 * who.anatomy.foot_m
        score.put(0.0, 0.6 * up_s, com=(x, y))
        score.move(
            0.52 * up_s,
            0.6 * up_s,
            left_tip=tip,
            right_tip=tip,
            z=score.values["z"] + float(np.sin(tip)) * who.anatomy.foot_m,
        )
    score.wait(up_s)
    leaning = (
        [step.direction]
        if step.direction in ("left", "right")
        else ["left", "right"]
        if step.body_part == "waist" or (not tiptoe and who.chance(0.25))
        else []
    )
    for lean in leaning:
        sign, lean_s = SIGN[str(lean)], who.u(0.8, 1.1)
        score.move(
            0.0, lean_s, side=sign * who.u(20, 32) * DEG, roll=sign * who.u(3, 8) * DEG, tilt=sign * who.u(0, 10) * DEG
        )
        score.put(0.0, lean_s, com=(x, y + sign * 0.02))
        score.wait(lean_s + who.u(0.2, 0.5))
    score.wait(hold_s)
    score.move(0.0, 0.6 * down_s, left_tip=0.0, right_tip=0.0)
    stand_tall(score, who, 0.0, down_s, arms=False)
    for side in sides:
        lower_arm(score, who, side, who.u(0, 0.1), down_s)
    score.wait(down_s + who.u(0.1, 0.3))


def _stretch_forward(score: Score, who: Performer) -> None:
    """Hands clasped and pushed forward, the upper back rounded."""
    out_s, hold_s, back_s = who.u(0.8, 1.2), who.u(0.4, 0.9), who.u(0.8, 1.1)
    score.move(
        0.0, out_s, flex=who.traits["flex"] + who.u(28, 38) * DEG, pitch=who.u(10, 20) * DEG, gaze=who.u(30, 50) * DEG
    )
    for side in SIDES:
        far = OnChest(
            ahead=0.93,
            out=-0.26,
            up=who.u(0.05, 0.2),
            elbow=(-0.2, 0.9, -0.2),
            fingers=(0.7, -0.7, 0.0),
            back=(0.3, 0.3, 0.9),
        )
        score.reach(side, far, who.u(0, 0.05), out_s)
    score.wait(out_s + hold_s)
    stand_tall(score, who, 0.0, back_s)
    score.wait(back_s + who.u(0.1, 0.3))


def _stretch_leg(score: Score, who: Performer, side: str) -> None:
    """One heel goes ahead, toes up, knee straight; the hips go back, the trunk leans over the leg, hands on the thigh."""
    shift_s, step_s, lean_s, hold_s = who.u(0.85, 1.0), who.u(0.55, 0.75), who.u(0.8, 1.1), who.u(0.5, 1.2)
    stand = OTHER[side]
    score.put(0.0, shift_s, 0.85, com=_between(middle(score, who), middle(score, who, stand), 0.85))
    score.wait(0.8 * shift_s)
    x, y = score.at(side)
    body = who.anatomy
    stride = who.u(0.30, 0.38) * body.leg_m
    heel = 4 / 3 * body.foot_m
    yaw = score.values[f"{side}_yaw"] - score.place.yaw_rad
    score.put(0.0, step_s, **{side: (x + stride - heel * np.cos(yaw), y - heel * np.sin(yaw))})
    score.move(0.0, step_s, **{f"{side}_pivot": 0.0, f"{side}_tip": -who.u(14, 26) * DEG})
    score.hump(0.0, step_s, **{f"{side}_z": 0.05})
    score.wait(0.9 * step_s)
    knee = who.u(22, 40) * DEG
    lean = who.u(45, 65)
    score.move(0.0, lean_s, z=score.place.floor_m + squat_m(who, knee) - 0.01 * who.tall)
    score.move(0.0, lean_s, pitch=0.62 * lean * DEG, flex=0.38 * lean * DEG, gaze=who.u(35, 55) * DEG)
    for each in SIDES:
        score.reach(each, OnBone(along=who.u(0.6, 0.85)), 0.0, lean_s, 0.04)
    score.wait(lean_s + hold_s)
    back_s = who.u(0.8, 1.0)
    stand_tall(score, who, 0.0, back_s)
    score.put(0.0, back_s, com=_between(middle(score, who), middle(score, who, stand), 0.85))
    score.wait(0.75 * back_s)
    score.put(0.0, step_s, **{side: (x, y)})
    score.move(0.0, step_s, **{f"{side}_pivot": 1.0, f"{side}_tip": 0.0})
    score.hump(0.0, step_s, **{f"{side}_z": 0.045})
    score.wait(0.85 * step_s)
    score.put(0.0, shift_s, com=middle(score, who))
    score.wait(shift_s + 0.1)


def _between(start: tuple[float, float], end: tuple[float, float], part: float) -> tuple[float, float]:
    return start[0] + part * (end[0] - start[0]), start[1] + part * (end[1] - start[1])
