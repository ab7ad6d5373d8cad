"""Stretching arms, sides, back or a leg."""

from __future__ import annotations

import numpy as np

from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate.made.hands import OnBone, OnChest
from t2d_rt.motion.generate.made.performer import Performer, middle, stand_tall
from t2d_rt.motion.generate.made.score import DEG, OTHER, SIDES, SIGN, Score
from t2d_rt.motion.generate.made.standing import bend_back, bend_down, lower_arm, raise_arm, squat_m


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
