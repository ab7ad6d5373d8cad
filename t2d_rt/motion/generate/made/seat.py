"""Write sitting down on a chair, standing up from it, and climbing stairs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate.made.act import (
    DEG,
    INDEX,
    LATERAL,
    OTHER,
    SIDES,
    SIGN,
    Act,
    Place,
    at_ease,
    middle,
    stance_foot,
    stand_tall,
    turn_on_the_spot,
)
from t2d_rt.motion.generate.made.hands import Goal, OnBone, OnChest
from t2d_rt.motion.generate.made.render import still

# --- sitting down on a chair and standing up from it ---


SEAT_M = 0.38, 0.53
"""Heights of seats for a stature of 1.72 m; they grow with the person."""


STAIR_M = 0.31, 0.37
"""Range of the height of two treads of a stair, which serve as a seat."""


SHORTEST_SIT_S = 1.65
"""Least time from the first movement to rest on the seat. In fourteen recorded sits the hips took 1.40 to 4.37 s, median 1.94, in
most of them with a stay on the way and so with two peaks of speed; fifty people took 1.97 s (Kerr 1997)."""

HESITATING, UNBROKEN_S = 0.8, 2.4
"""Chance of such a stay, and the duration from which there is always one."""


def sit(act: Act, step: Step, *, backrest: bool = True) -> None:
    """Sit down on what stands behind: the trunk leans forward while the hips go back and down over the feet, hesitate, and are let
    down behind them; the trunk comes up when the seat carries (Kralj 1990: 5 phases).
    """
    if step.action == "sit" and step.direction in ("left", "right"):
        turn_on_the_spot(act, SIGN[step.direction] * act.u(78, 100) * DEG)
    on_stair = step.object == "stair"
    seat_m = act.u(*STAIR_M) if on_stair else act.u(*SEAT_M) * act.tall / 1.72
    hips = seated_hips(act, seat_m, shank_rad=act.u(2, 17) * DEG)
    down_s = SHORTEST_SIT_S + float(np.exp(act.about(-0.3, 0.8)))
    plop = step.manner in ("angry", "sad") or act.chance(0.2)
    support = _support(act, step, seat_m)
    flex = act.habits.flex + act.about(13, 4) * DEG
    pitch = counterbalance(act, hips, flex, behind_m=act.u(0.05, 0.085) * act.tall / 1.72)
    # Durations of both lowerings, what is between them is the stay, and the part of the way that the first one takes.
    last_s = min(act.u(0.85, 1.35), 0.7 * down_s) if down_s > UNBROKEN_S or act.chance(HESITATING) else down_s
    before_s = down_s - last_s
    first_s, first = min(before_s, act.u(0.8, 1.2)), act.u(0.16, 0.36) if before_s else 0.0
    act.move(0.0, 0.12 + before_s + 0.4 * last_s, pitch=pitch, flex=flex)
    act.move(0.12, 0.7 * down_s, gaze=act.about(30, 8) * DEG)
    if act.chance(0.4):
        _glance(act, down_s)
    seat_z = act.place.floor_m + hips[2]
    act.move(0.12, first_s, z=act.values["z"] + first * (seat_z - act.values["z"]))
    act.move(0.12 + before_s, last_s, 1.12 if plop else 0.98, z=seat_z)
    act.move(0.12 + before_s + 0.2 * last_s, 0.7 * last_s, balanced=0.0)
    act.put("hips", 0.12, before_s + 0.9 * last_s, hips[:2])
    x, y = middle(act)
    act.put("com", 0.12, 0.8 * down_s, (x - 0.3 * act.anatomy.foot_m, y))
    leans = backrest and not on_stair and act.chance(0.5)
    resting = _resting_hands(act, seat_m, leans=leans)
    for side in SIDES:
        goal = support.get(side)
        if goal is not None:
            act.reach(side, goal, act.u(0.05, 0.25) * down_s, 0.6 * down_s, 0.06)
            act.reach(side, resting[side], 1.15 * down_s + act.u(0.1, 0.5), act.u(0.6, 0.9), 0.08)
        else:
            act.reach(side, resting[side], 0.4 * down_s + act.u(0, 0.15), down_s * act.u(0.7, 0.9), 0.07)
    act.wait(0.12 + down_s * 0.92)
    settle(act, step, leans=leans)
    act.posture = "sitting"
    act.notes.append(f"sits on a seat {seat_m:.2f} m high, whose middle is {-hips[0]:.2f} m behind the ankles")


def settle(act: Act, step: Step, *, leans: bool) -> None:
    """The trunk comes up once the seat carries, and rests: against the backrest, upright, or bowed over the thighs."""
    up_s = act.u(0.7, 1.3)
    bowed = not leans and act.chance(0.3)
    flex = act.habits.flex + (act.about(28, 6) if bowed else act.about(16, 8)) * DEG
    pitch = (act.about(14, 9) if bowed else act.about(-24, 5) if leans else act.about(-7, 8)) * DEG
    act.move(0.0, up_s, pitch=pitch, side=act.about(0, 4) * DEG)
    act.move(0.05, up_s * act.u(0.95, 1.2), flex=flex, twist=act.about(0, 8) * DEG)
    act.move(0.1, up_s, gaze=act.habits.gaze + act.about(4, 9) * DEG, look=act.about(0, 18) * DEG)
    for number, side in enumerate(SIDES):  # a foot finds a better place
        if act.chance(0.4):
            x, y = act.at(side)
            after = up_s * 0.6 + 0.3 * number
            act.put(side, after, 0.5, (x + act.u(-0.03, 0.13) * act.tall / 1.72, y + SIGN[side] * act.u(-0.01, 0.07)))
            act.hump(f"{side}_z", after, 0.5, 0.05)
    act.wait(up_s + act.u(0.2, 2.2))
    if step.manner == "sad":
        act.move(-0.6, 0.9, gaze=act.values["gaze"] + 14 * DEG)


def seated_hips(act: Act, seat_m: float, *, shank_rad: float) -> tuple[float, float, float]:
    """Middle of the hips on a seat, x, y and z [m], so far behind the feet that the shanks lean forward by an angle."""
    body = act.anatomy
    ankle_x = 0.5 * sum(
        act.at(side)[0] - body.foot_m * np.cos(act.values[f"{side}_yaw"] - act.place.yaw_rad) for side in SIDES
    )
    thigh, shank = (0.5 * sum(body.skeleton.bone_m(f"{side}_{joint}") for side in SIDES) for joint in ("knee", "ankle"))
    knee_x, knee_z = ankle_x + shank * np.sin(shank_rad), body.ankle_m + shank * np.cos(shank_rad)
    z = seat_m + body.seat_m
    aside = act.habits.half_width - body.hips_m
    return float(knee_x - np.sqrt(thigh**2 - (z - knee_z) ** 2 - min(aside**2, 0.01))), 0.0, z


LEANS = np.linspace(10, 36, 14) * DEG


def counterbalance(act: Act, hips: tuple[float, float, float], flex: float, *, behind_m: float) -> float:
    """Least pitch of the pelvis [rad] at which a body just over its seat has its centre of mass no farther than `behind_m` behind
    the ankles, from where its speed carries it over the feet (Pai and Patton 1997).
    """
    x, y, z = act.place.world(*hips)
    values = {**act.values, "x": x, "y": y, "z": z, "balanced": 0.0, "flex": flex}
    table = np.tile([values[name] for name in INDEX], (len(LEANS), 1))
    table[:, INDEX["pitch"]] = LEANS
    _, com = still(act.anatomy, table)
    ahead = np.array([act.place.local(*point[:2])[0] for point in com])
    ankle_x = float(np.mean([act.at(side)[0] for side in SIDES])) - act.anatomy.foot_m
    enough = ahead > ankle_x - behind_m
    return float(LEANS[int(np.argmax(enough))] if enough.any() else LEANS[-1])


def stand_up(act: Act, step: Step) -> None:
    """Stand up from a chair: feet back, trunk forward, seat-off at a third of the time, then everything extends (Schenkman 1990;
    1.3 to 2.3 s from the first lean to standing, Kerr 1997).
    """
    _feet_back(act)
    first_s, rise_s = act.u(0.50, 0.95), float(np.exp(act.about(0.35, 0.26)))
    flex = act.habits.flex + act.about(14, 4) * DEG
    hips = (*act.at("hips"), act.values["z"] - act.place.floor_m)
    pitch = counterbalance(act, hips, flex, behind_m=act.u(0.05, 0.08) * act.tall / 1.72)
    act.move(0.0, first_s * 1.3, pitch=pitch)
    act.move(0.04, first_s * 1.25, flex=flex, side=0.0, twist=0.0, look=0.0)
    act.move(0.1, first_s, gaze=act.about(22, 7) * DEG)
    _push(act, step, first_s)
    act.wait(0.85 * first_s)
    x, y = middle(act)
    act.put("com", 0.0, 0.1, (x - 0.25 * act.anatomy.foot_m, y))
    act.put("com", 0.2, rise_s, (x, y))
    act.move(0.0, rise_s, 0.97, z=act.place.floor_m + act.anatomy.standing_m)
    act.move(-0.08, 0.62 * rise_s, balanced=1.0)
    act.move(0.18 * rise_s, 0.9 * rise_s, pitch=0.0, roll=0.0)
    act.move(0.25 * rise_s, 0.9 * rise_s, flex=act.habits.flex)
    act.move(0.3 * rise_s, 0.8 * rise_s, gaze=act.habits.gaze, tilt=0.0)
    for side, goal in at_ease(act).items():
        act.reach(side, goal, (0.22 + act.u(0, 0.12)) * rise_s, rise_s * act.u(0.7, 0.9), 0.07)
    act.wait(rise_s + act.u(0.1, 0.2))
    stand_tall(act, 0.0, 0.4, arms=False)
    act.wait(act.u(0.4, 1.8))
    act.posture = "standing"


def _feet_back(act: Act) -> None:
    """Feet go back under the seat as far as rising needs, with shanks 15 to 20 degrees forward."""
    reach = act.u(0.0, 0.06)
    for number, side in enumerate((act.handed, OTHER[act.handed])):
        x, y = act.at(side)
        home = act.anatomy.foot_m * np.cos(act.habits.toe_out)
        back = max(0.0, x - home) + reach
        if back < 0.02:
            continue
        act.put(side, 0.14 * number, 0.5, (x - back, y))
        act.hump(f"{side}_z", 0.14 * number, 0.45, 0.018)
        act.hump(f"{side}_tip", 0.14 * number - 0.04, 0.4, 9 * DEG)
    act.wait(act.u(0.35, 0.55))


def _push(act: Act, step: Step, first_s: float) -> None:
    """Hands on the knees, or on the seat beside the hips, or swinging forward."""
    odds = [0.7, 0.2, 0.1] if step.manner == "careful" else [0.35, 0.25, 0.40]
    how = act.rng.choice(["knees", "seat", "thighs"], p=odds)
    hips_x, hips_m = act.at("hips")[0], act.values["z"] - act.place.floor_m
    for side in SIDES:
        if how == "knees":
            act.reach(side, OnBone(along=act.u(0.78, 0.9)), 0.05, 0.8 * first_s)
        elif how == "seat":
            x, y = hips_x + act.u(0.02, 0.08), SIGN[side] * (act.anatomy.hips_m + 0.085 * act.tall)
            goal = act.place.hold(x, y, hips_m - 0.03, elbow=(-0.9, 0.35, 0.3), fingers=(0.9, 0.1, -0.3))
            act.reach(side, goal, 0.0, 0.7 * first_s, 0.06)


def _support(act: Act, step: Step, seat_m: float) -> dict[str, Goal]:
    """Goals of hands that hold something while sitting down: armrests or knees; empty if they hold nothing."""
    odds = [0.1, 0.5, 0.25, 0.15] if step.manner == "careful" else [0.35, 0.25, 0.25, 0.15]
    if step.object == "stair":
        return {}
    how = act.rng.choice(["none", "arms", "knees", "one"], p=odds)
    sides = SIDES if how in ("arms", "knees") else (act.side(),) if how == "one" else ()
    if how == "knees":
        return {side: OnBone(along=act.u(0.7, 0.85)) for side in sides}
    return {side: _armrest(act, seat_m, side) for side in sides}


def _armrest(act: Act, seat_m: float, side: str) -> Goal:
    """A hand on the end of a chair's arm."""
    x = seated_hips(act, seat_m, shank_rad=8 * DEG)[0] + act.u(0.14, 0.22)
    y, height = SIGN[side] * (act.anatomy.hips_m + 0.10 * act.tall), seat_m + 0.22 * act.tall / 1.72
    return act.place.hold(x, y, height, elbow=(-0.9, 0.5, 0.2), fingers=(0.9, 0.0, -0.2))


def _resting_hands(act: Act, seat_m: float, *, leans: bool) -> dict[str, Goal]:
    """Hands on the thighs, on the knees, in the lap, folded before the belly, or on the chair's arms."""
    how = act.rng.choice(["thighs", "knees", "lap", "belly"], p=[0.4, 0.2, 0.2, 0.2])
    if how == "belly":
        at = act.u(0.36, 0.44), -0.22, -act.u(0.32, 0.45)
        folded = OnChest(at=at, elbow=(-0.5, 0.6, -0.6), fingers=(0.4, -0.8, 0.2), back=(0.9, 0.4, 0.2))
        return dict.fromkeys(SIDES, folded)
    along = act.wobble({"thighs": 0.62, "knees": 0.84, "lap": 0.50}[how] * (0.68 if leans else 1.0))
    out = {"thighs": 0.0, "knees": 0.003, "lap": -0.022}[how]
    goals: dict[str, Goal] = {
        side: OnBone(along=min(part, 0.92), out=out) for side, part in zip(SIDES, along, strict=True)
    }
    for side in SIDES:
        if not leans and act.chance(0.2):
            goals[side] = _armrest(act, seat_m, side)
    return goals


def _glance(act: Act, down_s: float) -> None:
    """A look over the shoulder at the seat."""
    sign = SIGN[act.side(0.5)]
    act.move(-0.2, 0.5, look=sign * act.u(25, 42) * DEG, twist=sign * act.u(5, 12) * DEG)
    act.move(0.45 * down_s, 0.6, look=0.0, twist=0.0)


# --- climbing a stair, up or down ---


RISER_M, TREAD_M = (0.155, 0.185), (0.27, 0.31)
"""Ranges of the heights and depths of stairs' treads in buildings; 0.17 and 0.29 m are the common ones."""

CADENCE_PER_MIN = 90, 110
"""Steps a minute of adults at ease on stairs (Riener 2002; Nadeau 2003)."""

RUNNING = 1.4
"""Factor on the cadence in running on a stair; both feet never leave it at once."""


def climb(act: Act, step: Step) -> None:
    """Step over step, one foot on each tread; the feet are brought together on the last one (McFadyen and Winter 1988)."""
    down = step.direction == "down"
    count = step.count or int(act.rng.integers(3, 6))
    riser_m, tread_m = act.u(*RISER_M), act.u(*TREAD_M)
    period_s = 60.0 / act.u(*CADENCE_PER_MIN) / (RUNNING if step.action == "run" else 1.0)
    lead = act.side(0.65)
    rail = act.side(0.5) if step.object == "handrail" or step.manner == "careful" or act.chance(0.25) else None
    slope = -riser_m if down else riser_m
    if down and act.place.floor_m == 0 and not act.moves:  # begins on the upper floor, so that the lower one is at 0
        act.lift(count * riser_m)
    start = act.place
    act.wait(act.u(0.4, 0.7) * act.tempo)
    act.move(0.0, 0.6, gaze=(act.u(28, 40) if down else act.u(16, 28)) * DEG, flex=act.habits.flex + act.u(2, 6) * DEG)
    act.move(0.0, 0.6, pitch=(act.u(1, 4) if down else act.u(6, 10)) * DEG)
    side = lead
    toes = act.anatomy.foot_m * act.u(0.85, 1.0) if not down else act.anatomy.foot_m * 1.25
    for number in range(1, count + 2):
        last = number == count + 1
        level = min(number, count)
        x = level * tread_m + toes
        y = stance_foot(act, side)[1] * act.u(0.78, 0.95)
        _tread(act, side, (x, y, level * slope), period_s=period_s, rise=slope, last=last)
        if rail is not None:
            _slide_rail(act, rail, x=level * tread_m, height=level * slope, period_s=period_s)
        elif not last:
            _swing_arms(act, side, period_s)
        side = OTHER[side]
    act.wait(0.25 * period_s)
    end = start.world(count * tread_m + toes - act.anatomy.foot_m, 0.0, count * slope)
    act.place = Place(x_m=end[0], y_m=end[1], floor_m=end[2], yaw_rad=start.yaw_rad)
    stand_tall(act, 0.0, 0.8)
    act.wait(act.u(0.9, 1.2))
    kind = "down" if down else "up"
    act.notes.append(
        f"climbs {kind} {count} treads, {riser_m:.3f} m high and {tread_m:.3f} m deep, the first one's foot at "
        f"{tread_m + toes:.2f} m; ends {abs(count * slope):.2f} m {'below' if down else 'above'} the start"
    )


def _tread(act: Act, side: str, point: tuple[float, float, float], *, period_s: float, rise: float, last: bool) -> None:
    """One step: weight over the other foot, swing, placement, then the body is lifted or let down over it."""
    body = act.anatomy
    floor = act.place.floor_m
    stand = OTHER[side]
    height = act.values[f"{stand}_z"] - floor
    # The body goes over the foot that carries and on, but sideways only by a part of the way to it.
    # Moves that last two periods add up to an even speed; the body is over a foot's middle half-way through its support.
    ahead = point[0] - (1 - act.habits.lean if last else 0.5) * body.foot_m
    act.put("com", 0.13 * period_s, (1.3 if last else 2.0) * period_s, (ahead, act.at("com")[1]))
    act.put("com", -0.25 * period_s, 0.95 * period_s, (act.at("com")[0], LATERAL * middle(act, stand)[1]))
    target = point[2]
    swing_s, begin_s = 0.72 * period_s, 0.27 * period_s
    # The knee that carries gives a little, except in the last step.
    give = (0.02 if rise > 0 else 0.026) * act.tall * (0.0 if last else 1.0)
    hips_m = floor + (height if rise > 0 else target) + body.standing_m - give
    after, lasting_s = (-0.1, 1.2) if rise > 0 else (0.08, 0.98)
    act.move(after * period_s, lasting_s * period_s, z=hips_m)
    act.put(side, begin_s, swing_s, point[:2])
    change = target - (act.values[f"{side}_z"] - floor)
    clearance = act.u(0.045, 0.075)
    if change >= 0:  # over the edge first, then down onto the tread
        act.limb(side, begin_s - 0.02, 0.80 * swing_s, z=floor + target + clearance)
        act.limb(side, begin_s + 0.45 * swing_s, 0.58 * swing_s, z=floor + target)
        act.limb(side, begin_s - 0.34 * period_s, 0.6 * period_s, tip=act.u(16, 26) * DEG)
        act.limb(side, begin_s + 0.25 * swing_s, 0.7 * swing_s, tip=0.0)
    else:  # the ball first; the knee that carries bends and lets the body down meanwhile
        act.hump(f"{side}_z", begin_s - 0.02, 0.5 * swing_s, 0.03)
        act.limb(side, begin_s + 0.3 * swing_s, 0.75 * swing_s, z=floor + target)
        act.limb(side, begin_s - 0.3 * period_s, 0.6 * period_s, tip=act.u(24, 34) * DEG)
        act.limb(side, begin_s + 0.8 * swing_s, 0.55 * swing_s, tip=0.0)
        act.limb(stand, 0.5 * period_s, 0.6 * period_s, tip=act.u(14, 22) * DEG if not last else 0.0)
    sway = SIGN[stand] * act.u(1.0, 2.5) * DEG
    yaw = act.place.yaw_rad - SIGN[side] * act.u(1, 4) * DEG * (0.0 if last else 1.0)
    act.move(0.1, 0.8 * period_s, roll=sway, side=-0.8 * sway, yaw=yaw)
    act.wait(period_s)


def _swing_arms(act: Act, side: str, period_s: float) -> None:
    """The arm of the other side goes forward with the swinging leg; less than in level walking."""
    for arm in SIDES:
        forward = arm != side
        goal = act.hang()
        angle = act.u(14, 24) * DEG if forward else -act.u(2, 9) * DEG
        bend = goal.bend_rad + (act.u(8, 18) * DEG if forward else 0.0)
        act.reach(arm, replace(goal, forward_rad=angle, bend_rad=bend), -0.75 * period_s, 0.9 * period_s)


def _slide_rail(act: Act, side: str, *, x: float, height: float, period_s: float) -> None:
    """The hand takes the rail anew at every step, ahead and 0.9 m over the treads."""
    tall = act.tall / 1.72
    point = x + act.u(0.12, 0.22), SIGN[side] * 0.30 * tall, height + 0.92 * tall
    goal = act.place.hold(*point, elbow=(-0.8, 0.5, -0.6), fingers=(0.9, 0.0, 0.3))
    act.reach(side, goal, -0.8 * period_s, 0.8 * period_s, 0.03)
