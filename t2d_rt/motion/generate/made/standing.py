"""Write bending, squatting and stretching with both feet on the floor, and standing on one leg."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from t2d_rt.motion.descriptions.slots import Side, Step
from t2d_rt.motion.generate.made.act import DEG, INDEX, OTHER, SIDES, SIGN, Act, middle, stand_tall
from t2d_rt.motion.generate.made.hands import Goal, OnBone, OnChest, OnPelvis
from t2d_rt.motion.generate.made.render import still

# --- bending and squatting with both feet on the floor ---


MORE_KNEES = np.array([0, 14, 28, 42, 56]) * DEG
"""Angles by which the knees may bend farther than was drawn, so that hands come down to the floor."""

MOST_KNEES = 122 * DEG

BEND_LOG_S = (0.14, 0.18), (0.2, 0.17), (-0.6, 1.0)
"""Means and deviations of the logarithms of the times [s] of going down, of coming up and of the rest between. In six recorded
bends the hips go down by 94 % of their way in 0.65 to 0.82 s and up in 0.80 to 0.87 s, at up to 0.7 to 0.9 m/s."""

STOOPS, SCOOP_KNEES_DEG = 0.25, (68.0, 124.0)
"""Chance that the knees stay nearly straight if nothing is said of them, and how far they bend otherwise: people lift in between
a stoop and a squat, most with the knees half bent (Burgess-Limerick 1997)."""

STOOP, SCOOP = 105 * DEG, 84 * DEG
"""Greatest lean with the knees nearly straight, and with them bent."""


def bend(act: Act, step: Step) -> None:
    """Bend as the step says: to a thing on the floor, to knee or foot, to a side, backward, or the knees."""
    if step.direction in ("left", "right") and step.object is None:
        _repeat(act, step, _bend_aside)
    elif step.direction == "back":
        _repeat(act, step, bend_back)
    elif step.body_part == "knee":
        _repeat(act, step, _bend_knees)
    else:
        _repeat(act, step, bend_down)


def _repeat(act: Act, step: Step, once: Callable[[Act, Step], None]) -> None:
    for number in range(step.count or 1):
        if number:
            act.wait(act.u(0.0, 0.3))
        once(act, step)


def bend_down(act: Act, step: Step) -> None:
    """Bend forward and down until the hand is at its goal, the lumbar spine first, the hips after (Esola 1996), in 2 to 4 s."""
    side = step.side or act.side()
    touch = step.body_part == "foot" or step.object == "floor" or step.direction == "down"
    if step.body_part in ("arm", "hand") and step.object is None:
        _bend_arms_out(act, step)
        return
    picks = step.object == "ball" or (step.body_part is None and not touch and act.chance(0.5))
    down_s, up_s, rest_s = (float(np.exp(act.about(mean, spread))) for mean, spread in BEND_LOG_S)
    stoops = step.body_part in ("waist", "foot", "leg") or act.chance(STOOPS)
    knees = act.u(8, 24) * DEG if stoops else act.u(*SCOOP_KNEES_DEG) * DEG
    both = (touch and act.chance(0.5)) or (not picks and act.chance(0.5))
    goals = _low_goals(act, step, side, both=both, picks=picks)
    free = OTHER[side]
    fraction, twist = act.u(0.32, 0.58), 0.0 if both else -SIGN[side] * act.u(2, 14) * DEG
    shape = _leaned(act, goals, knees, fraction=fraction, twist=twist, most_rad=STOOP if stoops else SCOOP)
    act.move(0.0, 0.8 * down_s, flex=0.55 * shape["flex"], gaze=act.about(45, 12) * DEG)
    act.move(0.18 * down_s, 0.85 * down_s, **{**shape, "z": act.values["z"]})
    act.move(0.08 * down_s, 0.92 * down_s, z=shape["z"])
    forward = act.u(0.0, 0.25) * act.anatomy.foot_m
    x, y = middle(act)
    act.put("com", 0.1 * down_s, 0.9 * down_s, (x + forward, y))
    for hand, goal in goals.items():
        act.reach(hand, goal, act.u(0.05, 0.15) * down_s, down_s * act.u(0.88, 0.96), 0.02)
    if not both:
        free_goal = OnBone(along=act.u(0.55, 0.9)) if act.chance(0.55) else act.hang()
        act.reach(free, free_goal, 0.15 * down_s, 0.8 * down_s, 0.05)
    act.wait(1.03 * down_s + rest_s)
    if picks:
        for hand in goals:
            near = act.u(0.42, 0.55), act.u(-0.28, -0.12), act.u(-0.55, -0.4)
            act.reach(hand, OnChest(at=near, elbow=(-0.5, 0.5, -0.8)), 0.1 * up_s, up_s * act.u(0.9, 1.0))
        if not both:
            act.reach(free, act.hang(), 0.15 * up_s, 0.8 * up_s, 0.05)
    stand_tall(act, 0.0, up_s, arms=not picks)
    act.wait(up_s)
    if picks and act.chance(0.5):
        act.wait(0.3)
        for hand in SIDES:
            act.reach(hand, act.hang(), 0.0, act.u(0.6, 0.9))
        act.wait(0.6)
    act.wait(act.u(0.15, 0.35))


def _bend_arms_out(act: Act, step: Step) -> None:
    """Bend forward from the hips with one or both arms held out, ahead or to the sides."""
    down_s, up_s = act.u(0.9, 1.2), act.u(0.9, 1.2)
    lean = act.u(50, 80)
    act.move(0.0, 0.9 * down_s, flex=0.4 * lean * DEG, gaze=act.u(30, 50) * DEG)
    act.move(0.15, 0.95 * down_s, pitch=0.6 * lean * DEG, z=act.place.floor_m + squat_m(act, act.u(8, 30) * DEG))
    aside = act.chance(0.4)
    for side in (step.side,) if step.side else SIDES:
        ahead, out = (act.u(0.1, 0.3), act.u(0.82, 0.9)) if aside else (act.u(0.8, 0.9), act.u(0.05, 0.2))
        goal = OnChest(at=(ahead, out, act.u(0.0, 0.35)), elbow=(-0.5, 0.3, -0.8))
        act.reach(side, goal, act.u(0.0, 0.1), down_s)
    act.wait(1.05 * down_s + act.u(0.1, 0.5))
    stand_tall(act, 0.0, up_s)
    act.wait(up_s + act.u(0.15, 0.35))


def _low_goals(act: Act, step: Step, side: str, *, both: bool, picks: bool) -> dict[str, Goal]:
    """Goals of the hands by side: a thing ahead of the feet, floor, feet, shins or knees."""
    sides = SIDES if both else (side,)
    goals: dict[str, Goal] = {}
    ahead, aside = act.u(0.12, 0.42), act.u(-0.06, 0.20)
    if step.direction in ("left", "right"):
        aside += (0.28 if step.direction == "left" else -0.28) * SIGN[side]
    for hand in sides:
        if step.body_part == "foot":
            x, y = act.at(hand)
            point, fingers = (x - act.u(0.0, 0.05), y + SIGN[hand] * 0.015, 0.055 * act.tall + 0.02), (0.4, 0.0, -0.9)
        elif (step.body_part == "waist" and not picks) or not (
            picks or step.object == "floor" or step.direction == "down" or act.chance(0.5)
        ):
            along = act.u(0.15, 0.75)
            goals[hand] = OnBone(upper="knee", lower="ankle", along=along, lift=0.05)
            continue
        else:
            x = act.anatomy.foot_m + ahead
            y = SIGN[hand] * (aside if not both else act.u(0.07, 0.10) if picks else 0.12)
            # The hand's end comes to the floor, or beside the thing that lies there.
            point, fingers = (x, y, 0.95 * act.anatomy.hand_m + (0.03 if picks else 0.012)), (0.35, -0.1, -0.95)
        goal = act.place.hold(*point, elbow=(-0.4, 0.8, 0.3), fingers=fingers, back=(0.5, 0.8, 0.3), held=not picks)
        goals[hand] = goal
    return goals


def _leaned(
    act: Act, goals: dict[str, Goal], knees_rad: float, *, fraction: float, twist: float, most_rad: float
) -> dict[str, float]:
    """Channels of the smallest lean up to `most_rad` with which the hands reach their goals with the elbows a little bent, the
    knees bent by an angle, or by a greater one if that is not enough.

    fraction: the spine's part of the lean; the hips do the rest.
    """
    body = act.anatomy
    bends = np.minimum(knees_rad + MORE_KNEES, MOST_KNEES)
    leans, knees = (grid.ravel() for grid in np.meshgrid(np.linspace(15 * DEG, most_rad, 16), bends))
    heights = act.place.floor_m + np.array([squat_m(act, knee) for knee in knees])
    values = {**act.values, "twist": twist}
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


def squat_m(act: Act, knees_rad: float) -> float:
    """Height [m] of the hips over flat feet, with the knees bent by an angle and the hips somewhat behind the ankles."""
    thigh, shank = (act.anatomy.skeleton.bone_m(f"left_{joint}") for joint in ("knee", "ankle"))
    length2 = thigh**2 + shank**2 + 2 * thigh * shank * np.cos(knees_rad)
    behind = 0.16 * act.anatomy.leg_m * np.sin(min(knees_rad, np.pi / 2))
    return float(min(act.anatomy.ankle_m + np.sqrt(length2 - behind**2), act.anatomy.standing_m))


def _bend_aside(act: Act, step: Step) -> None:
    """Bend to a side: a hand slides down the thigh, the hips go the other way; the other arm hangs, is on the hip or overhead."""
    lean = step.direction or "left"
    sign = SIGN[lean]
    down_s, up_s = act.u(0.8, 1.15), act.u(0.8, 1.15)
    x, y = middle(act)
    act.move(0.0, down_s, side=sign * act.u(38, 50) * DEG, twist=sign * act.about(0, 4) * DEG)
    act.move(0.05, down_s, roll=sign * act.u(8, 14) * DEG, tilt=sign * act.u(4, 14) * DEG)
    act.move(0.05, down_s, flex=act.habits.flex + act.about(2, 3) * DEG)
    act.put("com", 0.05, down_s, (x, y + sign * 0.02))
    act.reach(lean, OnBone(along=act.u(0.72, 0.9), lift=0.0, out=0.062 + 0.012), 0.05, down_s * 0.95, 0.03)
    how = act.rng.choice(["hang", "hip", "over"])
    if how == "hip":
        act.reach(OTHER[lean], OnPelvis(), 0.0, 0.9 * down_s, 0.05)
    elif how == "over":
        raise_arm(act, OTHER[lean], 0.0, down_s)
    act.wait(down_s + act.u(0.2, 0.6))
    stand_tall(act, 0.0, up_s)
    if how == "over":
        act.grasps[OTHER[lean]].pop()
        lower_arm(act, OTHER[lean], 0.0, up_s)
    act.wait(up_s + act.u(0.1, 0.3))


def bend_back(act: Act, step: Step) -> None:
    """Bend backward: hips go forward, hands mostly to the hips, knees give; the spine extends by 30 to 40 degrees (Kapandji)."""
    down_s, up_s = act.u(0.9, 1.3), act.u(0.9, 1.2)
    act.move(0.0, down_s, flex=-act.u(30, 40) * DEG, pitch=-act.u(14, 20) * DEG)
    act.move(0.15, down_s, gaze=-act.u(25, 45) * DEG)
    act.move(0.0, down_s, z=act.values["z"] - act.u(0.008, 0.02) * act.tall)
    if act.chance(0.75):
        hand = OnPelvis(at=(-0.045, 0.055, 0.045), fingers=(-0.2, -0.5, -0.8), back=(-0.9, 0.4, 0.0))
        for side in SIDES:
            act.reach(side, hand, 0.0, 0.75 * down_s, 0.07)
    act.wait(down_s + act.u(0.2, 0.7))
    stand_tall(act, 0.0, up_s)
    act.wait(up_s + act.u(0.1, 0.3))


def _bend_knees(act: Act, step: Step) -> None:
    """Bend both knees in a shallow squat."""
    _down_and_up(act, act.u(74, 96) * DEG, act.u(20, 32), hold_s=act.u(0.1, 0.4))


CROUCH_S = 6.0
"""Duration from which a single squat is a rest on the heels."""
DOWN_AND_UP_S = 3.0
"""Approximate time that going down and coming up take in it."""
CROUCH_DEG = 140.0, 152.0
"""Range of its bend of the knees: 149 degrees in 26 people who crouched (Hyodo 2017, Braz. J. Phys. Ther. 21: 159), at most 157 in
thirty who often do (Hemmerich 2006, J. Orthop. Res. 24: 770); thighs lie on calves."""


def squat(act: Act, step: Step) -> None:
    """Down and up in 2 to 3 s, shanks and trunk leaning about alike so that the weight stays over the feet (Schoenfeld 2010); or,
    once for a long time, all the way down, where one rests on the heels.
    """
    count, lasting_s = step.count or 1, step.duration_s or 0.0
    rests = count == 1 and lasting_s >= CROUCH_S
    for number in range(count):
        deep = act.chance(0.3)
        odds = [0.35, 0.65, 0.0, 0.0] if rests else [0.4, 0.25, 0.25, 0.1]
        arms = str(act.rng.choice(["ahead", "knees", "clasped", "hang"], p=odds))
        if step.body_part in ("arm", "hand"):
            arms = "ahead"
        elif step.object == "ball":
            arms = "low"
        crouches = rests and arms != "low"
        knees = act.u(*CROUCH_DEG) if crouches else act.u(112, 130) if deep or rests else act.u(78, 110)
        lean, hold_s = act.u(30, 42) + (6 if (deep and not crouches) or arms == "low" else 0), act.u(0.0, 0.6)
        heels = act.u(12, 24) * DEG if deep and (rests or act.chance(0.6)) else 0.0
        last = number + 1 == count
        hold_s = lasting_s - DOWN_AND_UP_S if rests else hold_s
        _down_and_up(act, knees * DEG, lean, hold_s=hold_s, arms=arms, heels=heels, last=last, side=step.side)


def _down_and_up(
    act: Act,
    knees: float,
    lean: float,
    *,
    hold_s: float,
    arms: str = "hang",
    heels: float = 0.0,
    last: bool = True,
    side: Side | None = None,
) -> None:
    """Into a squat and up again: knees bent and heels raised by angles [rad], the trunk leaning by `lean` [degrees];
    of one `side`, the other hand is on the knee."""
    down_s, up_s = act.u(0.95, 1.3), act.u(0.85, 1.2)
    spine = act.u(0.3, 0.45) * lean
    z = act.place.floor_m + squat_m(act, knees) + 0.6 * np.sin(heels) * act.anatomy.foot_m
    act.move(0.0, down_s * 0.95, pitch=(lean - spine) * DEG, flex=act.habits.flex + (spine - 3) * DEG)
    act.move(0.06, down_s, z=float(z))
    act.move(0.0, down_s, gaze=act.about(14, 6) * DEG)
    x, y = middle(act)
    act.put("com", 0.05, (0.6 if heels else 1.0) * down_s, (x + (0.78 if heels else 0.0) * act.anatomy.foot_m, y))
    splay = (act.u(14, 20) if arms == "low" else act.u(2, 14)) * DEG
    for body_side in SIDES:
        act.limb(body_side, 0.0, down_s, splay=splay * act.u(0.8, 1.2))
        if heels:
            act.limb(body_side, 0.42 * down_s, 0.6 * down_s, tip=heels * act.u(0.9, 1.1))
        goal = _squat_hands(act, arms if side in (None, body_side) else "knees")
        if goal is not None:
            act.reach(body_side, goal, act.u(0, 0.06), down_s * act.u(0.82, 0.92), 0.03)
    act.wait(down_s * 1.02 + hold_s)
    stand_tall(act, 0.0, up_s, arms=last and arms != "hang")
    for body_side in SIDES:
        act.limb(body_side, 0.1, up_s, splay=0.0)
        act.limb(body_side, 0.05, 0.55 * up_s, tip=0.0)
    act.wait(up_s + (act.u(0.2, 0.4) if last else act.u(0.0, 0.2)))


def _squat_hands(act: Act, arms: str) -> Goal | None:
    if arms == "ahead":
        return OnChest(
            at=(act.about(0.88, 0.03), act.about(-0.05, 0.05), act.about(0.12, 0.1)), elbow=(-0.2, 0.7, -0.7)
        )
    if arms == "knees":
        return OnBone(along=act.u(0.78, 0.9))
    if arms == "low":  # to a thing that lies ahead of the feet
        return OnChest(at=(act.u(0.5, 0.65), act.u(-0.2, -0.1), -act.u(0.55, 0.7)), elbow=(-0.4, 0.8, -0.2))
    if arms == "clasped":
        at = act.about(0.48, 0.03), -0.285, act.about(-0.16, 0.04)
        return OnChest(at=at, elbow=(-0.2, 0.7, -0.7), fingers=(0.5, -0.7, 0.5), back=(0.6, 0.7, 0.0))
    return None


def raise_arm(act: Act, side: str, after_s: float, duration_s: float) -> None:
    """An arm goes up through the front; above the horizontal the shoulder blade turns along, one degree for two (Inman 1944)."""
    ahead = OnChest(at=(act.u(0.86, 0.92), act.u(0.05, 0.2), act.u(0.1, 0.25)), elbow=(-0.3, 0.8, -0.6))
    above = OnChest(at=(act.u(0.04, 0.22), act.u(-0.22, 0.12), act.u(0.98, 1.07)), elbow=(-0.15, 0.95, 0.0))
    act.reach(side, ahead, after_s, 0.72 * duration_s, 0.03)
    act.reach(side, above, after_s + 0.28 * duration_s, 0.72 * duration_s)
    act.limb(side, after_s + 0.3 * duration_s, 0.7 * duration_s, shrug=act.u(20, 28) * DEG)


def lower_arm(act: Act, side: str, after_s: float, duration_s: float) -> None:
    """An arm comes down again, by the side or by the front."""
    if act.chance(0.5):
        via = OnChest(at=(act.u(0.25, 0.4), act.u(0.75, 0.85), act.u(0.0, 0.2)), elbow=(-0.6, 0.3, -0.6))
    else:
        via = OnChest(at=(act.u(0.8, 0.9), act.u(0.1, 0.25), act.u(-0.1, 0.15)), elbow=(-0.4, 0.7, -0.6))
    act.reach(side, via, after_s, 0.68 * duration_s)
    act.reach(side, act.hang(), after_s + 0.32 * duration_s, 0.68 * duration_s, 0.02)
    act.limb(side, after_s, 0.6 * duration_s, shrug=0.0)


# --- stretching arms, sides, back or a leg ---


def stretch(act: Act, step: Step) -> None:
    """Stretch arms, sides, back or a leg, as the step says."""
    for number in range(step.count or 1):
        if number:
            act.wait(act.u(0.1, 0.4))
        if step.body_part in ("leg", "foot", "knee"):
            _stretch_leg(act, step.side or act.side(0.5))
        elif step.direction == "back":
            bend_back(act, step)
        elif step.direction == "down":
            bend_down(act, Step(action="bend", body_part="foot", speed=step.speed, manner=step.manner))
        elif step.direction == "forward":
            _stretch_forward(act)
        else:
            _stretch_up(act, step)


def _stretch_up(act: Act, step: Step) -> None:
    """Arms overhead, the back arches, often on tiptoe; to a side if asked for."""
    up_s, hold_s, down_s = act.u(1.0, 1.4), act.u(0.5, 1.1), act.u(0.9, 1.3)
    sides = (step.side,) if step.side else SIDES if act.chance(0.8) else (act.side(),)
    lag = act.u(0.0, 0.15)
    for number, side in enumerate(sides):
        raise_arm(act, side, lag * number, up_s)
    act.move(0.1, up_s, flex=-act.u(6, 16) * DEG, pitch=-act.u(0, 4) * DEG, gaze=-act.u(5, 35) * DEG)
    tiptoe = act.chance(0.4) and step.direction not in ("left", "right") and step.body_part != "waist"
    x, y = middle(act)
    if tiptoe:
        tip = act.u(10, 22) * DEG
        x += 0.78 * act.anatomy.foot_m
        act.put("com", 0.0, 0.6 * up_s, (x, y))
        z = act.values["z"] + float(np.sin(tip)) * act.anatomy.foot_m
        act.move(0.52 * up_s, 0.6 * up_s, left_tip=tip, right_tip=tip, z=z)
    act.wait(up_s)
    leaning: tuple[str, ...] = ()
    if step.direction in ("left", "right"):
        leaning = (step.direction,)
    elif step.body_part == "waist" or (not tiptoe and act.chance(0.25)):
        leaning = SIDES
    for lean in leaning:
        sign, lean_s = SIGN[lean], act.u(0.8, 1.1)
        act.move(0.0, lean_s, side=sign * act.u(20, 32) * DEG, roll=sign * act.u(3, 8) * DEG)
        act.move(0.0, lean_s, tilt=sign * act.u(0, 10) * DEG)
        act.put("com", 0.0, lean_s, (x, y + sign * 0.02))
        act.wait(lean_s + act.u(0.2, 0.5))
    act.wait(hold_s)
    act.move(0.0, 0.6 * down_s, left_tip=0.0, right_tip=0.0)
    stand_tall(act, 0.0, down_s, arms=False)
    for side in sides:
        lower_arm(act, side, act.u(0, 0.1), down_s)
    act.wait(down_s + act.u(0.1, 0.3))


def _stretch_forward(act: Act) -> None:
    """Hands clasped and pushed forward, the upper back rounded."""
    out_s, hold_s, back_s = act.u(0.8, 1.2), act.u(0.4, 0.9), act.u(0.8, 1.1)
    act.move(0.0, out_s, flex=act.habits.flex + act.u(28, 38) * DEG, pitch=act.u(10, 20) * DEG)
    act.move(0.0, out_s, gaze=act.u(30, 50) * DEG)
    for side in SIDES:
        far = 0.93, -0.26, act.u(0.05, 0.2)
        goal = OnChest(at=far, elbow=(-0.2, 0.9, -0.2), fingers=(0.7, -0.7, 0.0), back=(0.3, 0.3, 0.9))
        act.reach(side, goal, act.u(0, 0.05), out_s)
    act.wait(out_s + hold_s)
    stand_tall(act, 0.0, back_s)
    act.wait(back_s + act.u(0.1, 0.3))


def _stretch_leg(act: Act, side: str) -> None:
    """One heel goes ahead, toes up, knee straight; the hips go back, the trunk leans over the leg, hands on the thigh."""
    shift_s, step_s, lean_s, hold_s = act.u(0.85, 1.0), act.u(0.55, 0.75), act.u(0.8, 1.1), act.u(0.5, 1.2)
    stand = OTHER[side]
    act.put("com", 0.0, shift_s, _between(middle(act), middle(act, stand), 0.85), 0.85)
    act.wait(0.8 * shift_s)
    x, y = act.at(side)
    body = act.anatomy
    stride = act.u(0.30, 0.38) * body.leg_m
    heel = 4 / 3 * body.foot_m
    yaw = act.values[f"{side}_yaw"] - act.place.yaw_rad
    act.put(side, 0.0, step_s, (x + stride - heel * np.cos(yaw), y - heel * np.sin(yaw)))
    act.limb(side, 0.0, step_s, pivot=0.0, tip=-act.u(14, 26) * DEG)
    act.hump(f"{side}_z", 0.0, step_s, 0.05)
    act.wait(0.9 * step_s)
    knee = act.u(22, 40) * DEG
    lean = act.u(45, 65)
    act.move(0.0, lean_s, z=act.place.floor_m + squat_m(act, knee) - 0.01 * act.tall)
    act.move(0.0, lean_s, pitch=0.62 * lean * DEG, flex=0.38 * lean * DEG, gaze=act.u(35, 55) * DEG)
    for hand in SIDES:
        act.reach(hand, OnBone(along=act.u(0.6, 0.85)), 0.0, lean_s, 0.04)
    act.wait(lean_s + hold_s)
    back_s = act.u(0.8, 1.0)
    stand_tall(act, 0.0, back_s)
    act.put("com", 0.0, back_s, _between(middle(act), middle(act, stand), 0.85))
    act.wait(0.75 * back_s)
    act.put(side, 0.0, step_s, (x, y))
    act.limb(side, 0.0, step_s, pivot=1.0, tip=0.0)
    act.hump(f"{side}_z", 0.0, step_s, 0.045)
    act.wait(0.85 * step_s)
    act.put("com", 0.0, shift_s, middle(act))
    act.wait(shift_s + 0.1)


def _between(start: tuple[float, float], end: tuple[float, float], part: float) -> tuple[float, float]:
    return start[0] + part * (end[0] - start[0]), start[1] + part * (end[1] - start[1])


# --- standing on one leg ---


HELD_S, LEAST_HELD_S = (3.0, 7.0), 0.5
"""Range of the time for which a leg is held up if none is given, and the least time [s]."""

SWAY_M, SWAY_S = 0.008, (0.4, 0.9)
"""Standard deviation [m] of the places between which the centre of mass goes over one foot, chosen above the 2 to 5 mm over both,
and the range of the time from one place to the next [s]."""


def balance(act: Act, step: Step) -> None:
    """Stand on the leg of the step's side: the weight goes over it, the other foot is held before or behind it, arms balance."""
    stand = step.side or act.side(0.5)
    free, begin_s = OTHER[stand], act.now_s
    shift_s, lift_s, down_s = act.u(0.7, 1.0), act.u(0.6, 0.9), act.u(0.6, 0.8)
    home, (x, y) = act.at(free), middle(act, stand)
    act.put("com", 0.0, shift_s, (x, y))
    how = str(act.rng.choice(["out", "hips", "hang"], p=[0.5, 0.2, 0.3]))
    for side in SIDES if how != "hang" else ():
        out = OnChest(at=(act.u(0.0, 0.2), act.u(0.7, 0.9), act.u(-0.3, 0.05)), elbow=(-0.5, 0.3, -0.8))
        act.reach(side, out if how == "out" else OnPelvis(), 0.1, shift_s)
    act.wait(0.75 * shift_s)
    _hold_leg(act, free, lift_s)
    act.wait(lift_s)
    hold_s = act.u(*HELD_S) if step.duration_s is None else step.duration_s - (act.now_s - begin_s) - down_s / act.tempo
    end_s = act.now_s + max(hold_s, LEAST_HELD_S)
    while act.now_s < end_s:
        sway_s = act.u(*SWAY_S) * act.tempo
        act.put("com", 0.0, 1.3 * sway_s, (x + act.about(0, SWAY_M), y + act.about(0, SWAY_M)))
        act.move(0.0, 1.3 * sway_s, roll=act.about(0, 1.5) * DEG, side=act.about(0, 2) * DEG)
        act.wait(sway_s)
    act.put(free, 0.0, 0.7 * down_s, (*home, 0.0))
    act.limb(free, 0.0, 0.7 * down_s, loose=0.0, tip=0.0, splay=0.0)
    stand_tall(act, 0.45 * down_s, 0.8 * down_s, arms=how != "hang")
    act.wait(down_s)
    act.notes.append(f"on the {stand} leg")


def _hold_leg(act: Act, side: str, lift_s: float) -> None:
    """A leg is drawn up before the body, or its foot behind it: angles of thigh and shank from the vertical."""
    thigh, shank = (act.u(48, 85), act.u(-10, 18)) if act.chance(0.5) else (act.u(-5, 15), act.u(58, 95))
    thigh_m, shank_m = (act.anatomy.skeleton.bone_m(f"{side}_{joint}") for joint in ("knee", "ankle"))
    hip_x, hip_y = middle(act, OTHER[side])[0], SIGN[side] * act.anatomy.hips_m
    ahead = thigh_m * np.sin(thigh * DEG) - shank_m * np.sin(shank * DEG)
    height = act.anatomy.standing_m - thigh_m * np.cos(thigh * DEG) - shank_m * np.cos(shank * DEG)
    act.put(side, 0.0, lift_s, (hip_x + float(ahead), hip_y + SIGN[side] * 0.02, float(height) - act.anatomy.sole_m))
    act.limb(side, 0.0, lift_s, loose=1.0, splay=act.u(0, 8) * DEG)
