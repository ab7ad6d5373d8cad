"""Sitting down, standing up, and stairs."""

from __future__ import annotations

import numpy as np

from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate.made.hands import Goal, InSpace, OnBone
from t2d_rt.motion.generate.made.performer import (
    BEFORE_S,
    LATERAL,
    PROMPT,
    Performer,
    middle,
    stance,
    stance_foot,
    stand_tall,
    turn_on_the_spot,
)
from t2d_rt.motion.generate.made.render import still
from t2d_rt.motion.generate.made.score import DEG, INDEX, OTHER, SIDES, SIGN, Place, Score

# --- sitting down on a chair and standing up from it ---


SEAT_M = 0.40, 0.50
"""Heights of seats for a stature of 1.72 m; they grow with the person."""


STAIR_M = 0.31, 0.37
"""Two treads of a stair, on which one sits."""


def sit(score: Score, who: Performer, step: Step, *, backrest: bool = True) -> None:
    """Sit down on what stands behind: the trunk leans forward while the hips go back and down, and comes up when the seat carries
    (Kralj 1990: 5 phases; Kerr 1997: 1.5 to 2.5 s).
    """
    if step.action == "sit" and step.direction in ("left", "right"):
        turn_on_the_spot(score, who, SIGN[step.direction] * who.u(78, 100) * DEG)
    on_stair = step.object == "stair"
    seat_m = who.u(*STAIR_M) if on_stair else who.u(*SEAT_M) * who.tall / 1.72
    hips = seated_hips(score, who, seat_m, shank_rad=who.u(3, 15) * DEG)
    down_s = who.u(1.15, 1.55)
    plop = step.manner in ("angry", "sad") or who.chance(0.2)
    support = _support(score, who, step, seat_m)
    flex = who.traits["flex"] + who.about(13, 4) * DEG
    pitch = counterbalance(score, who, hips, flex, behind_m=who.u(0.075, 0.105) * who.tall / 1.72)
    score.move(0.0, 0.85 * down_s, pitch=pitch, flex=flex)
    score.move(0.12, 0.7 * down_s, gaze=who.about(30, 8) * DEG)
    if who.chance(0.4):
        _glance(score, who, down_s)
    score.move(0.12, down_s, 1.12 if plop else 0.98, z=score.place.floor_m + hips[2])
    score.move(0.12 + 0.3 * down_s, 0.7 * down_s, balanced=0.0)
    score.put(0.12, down_s, hips=hips[:2])
    x, y = middle(score, who)
    score.put(0.12, 0.8 * down_s, com=(x - 0.3 * who.anatomy.foot_m, y))
    leans = backrest and not on_stair and who.chance(0.55)
    rest = _resting_hands(who, leans=leans)
    for side in SIDES:
        goal = support.get(side)
        if goal is not None:
            score.reach(side, goal, 0.15 * down_s, 0.75 * down_s, 0.06)
            score.reach(side, rest[side], 1.15 * down_s + who.u(0.1, 0.5), who.u(0.6, 0.9), 0.06)
        else:
            score.reach(side, rest[side], 0.3 * down_s + who.u(0, 0.15), down_s * who.u(0.8, 1.0), 0.05)
    score.wait(0.12 + down_s * 0.88)
    settle(score, who, step, leans=leans)
    score.posture = "sitting"
    score.notes.append(f"sits on a seat {seat_m:.2f} m high, whose middle is {-hips[0]:.2f} m behind the ankles")


def settle(score: Score, who: Performer, step: Step, *, leans: bool) -> None:
    """The trunk comes up once the seat carries, and rests, against the backrest or not."""
    up_s = who.u(0.75, 1.1)
    flex = who.traits["flex"] + who.about(16, 4) * DEG
    pitch = who.about(-20 if leans else -11, 3) * DEG
    score.move(0.0, up_s, pitch=pitch, side=who.about(0, 2) * DEG)
    score.move(0.05, up_s * who.u(0.95, 1.2), flex=flex, twist=who.about(0, 3) * DEG)
    score.move(0.1, up_s, gaze=who.traits["gaze"] + who.about(0, 4) * DEG, look=who.about(0, 10) * DEG)
    if who.chance(0.35):  # one foot finds a better place
        side = who.side(0.5)
        x, y = score.at(side)
        score.put(up_s * 0.6, 0.45, **{side: (x + who.u(0.03, 0.10), y + SIGN[side] * who.u(-0.01, 0.03))})
        score.hump(up_s * 0.6, 0.45, **{f"{side}_z": 0.02})
    score.wait(up_s + who.u(0.5, 1.1))
    if step.manner == "sad":
        score.move(-0.6, 0.9, gaze=score.values["gaze"] + 14 * DEG)


def seated_hips(score: Score, who: Performer, seat_m: float, *, shank_rad: float) -> tuple[float, float, float]:
    """Middle of the hips on a seat [m], so far behind the feet that the shanks lean forward by an angle."""
    body = who.anatomy
    ankle_x = 0.5 * sum(
        score.at(side)[0] - body.foot_m * np.cos(score.values[f"{side}_yaw"] - score.place.yaw_rad) for side in SIDES
    )
    thigh, shank = (0.5 * sum(body.skeleton.bone_m(f"{side}_{joint}") for side in SIDES) for joint in ("knee", "ankle"))
    knee_x, knee_z = ankle_x + shank * np.sin(shank_rad), body.ankle_m + shank * np.cos(shank_rad)
    z = seat_m + body.seat_m
    aside = who.traits["half_width"] - body.hips_m
    return float(knee_x - np.sqrt(thigh**2 - (z - knee_z) ** 2 - min(aside**2, 0.01))), 0.0, z


LEANS = np.linspace(10, 36, 14) * DEG


def counterbalance(
    score: Score, who: Performer, hips: tuple[float, float, float], flex: float, *, behind_m: float
) -> float:
    """Least pitch of the pelvis at which a body just over its seat has its centre of mass no farther than `behind_m` behind the
    ankles: what its speed carries over the feet (Pai and Patton 1997).
    """
    x, y, z = score.place.world(*hips)
    values = {**score.values, "x": x, "y": y, "z": z, "balanced": 0.0, "flex": flex}
    table = np.tile([values[name] for name in INDEX], (len(LEANS), 1))
    table[:, INDEX["pitch"]] = LEANS
    _, com = still(who.anatomy, table)
    ahead = np.array([score.place.local(*each[:2])[0] for each in com])
    ankle_x = float(np.mean([score.at(side)[0] for side in SIDES])) - who.anatomy.foot_m
    enough = ahead > ankle_x - behind_m
    return float(LEANS[int(np.argmax(enough))] if enough.any() else LEANS[-1])


def seated(who: Performer, step: Step) -> Score:
    """A score that begins in a chair."""
    score = stance(who)
    sit(score, who, Step(action="sit", object=step.object, manner=step.manner), backrest=True)
    return begun(score, who, step)


def begun(score: Score, who: Performer, step: Step) -> Score:
    """A score that begins where another one ends, at rest, before a step."""
    found = Score(
        values=dict(score.values), place=score.place, home=score.home, notes=list(score.notes), posture=score.posture
    )
    found.starts = {side: score.goal(side) for side in SIDES}
    found.wait((1.0 if step.duration_s is None else PROMPT) * who.u(*BEFORE_S))
    return found


def stand_up(score: Score, who: Performer, step: Step) -> None:
    """Stand up from a chair: feet back, trunk forward, seat-off at a third of the time, then everything extends (Schenkman 1990;
    1.3 to 2.3 s from the first lean to standing, Kerr 1997).
    """
    _feet_back(score, who)
    first_s, rise_s = who.u(0.50, 0.68), who.u(1.0, 1.3)
    flex = who.traits["flex"] + who.about(14, 4) * DEG
    hips = (*score.at("hips"), score.values["z"] - score.place.floor_m)
    pitch = counterbalance(score, who, hips, flex, behind_m=who.u(0.05, 0.08) * who.tall / 1.72)
    score.move(0.0, first_s * 1.3, pitch=pitch)
    score.move(0.04, first_s * 1.25, flex=flex, side=0.0, twist=0.0, look=0.0)
    score.move(0.1, first_s, gaze=who.about(22, 7) * DEG)
    _push(score, who, step, first_s)
    score.wait(0.85 * first_s)
    x, y = middle(score, who)
    score.put(0.0, 0.1, com=(x - 0.25 * who.anatomy.foot_m, y))
    score.put(0.2, rise_s, com=(x, y))
    score.move(0.0, rise_s, 0.97, z=score.place.floor_m + who.anatomy.standing_m)
    score.move(-0.08, 0.62 * rise_s, balanced=1.0)
    score.move(0.18 * rise_s, 0.9 * rise_s, pitch=0.0, roll=0.0)
    score.move(0.25 * rise_s, 0.9 * rise_s, flex=who.traits["flex"])
    score.move(0.3 * rise_s, 0.8 * rise_s, gaze=who.traits["gaze"], tilt=0.0)
    for side in SIDES:
        score.reach(side, who.hang(), (0.22 + who.u(0, 0.12)) * rise_s, rise_s * who.u(0.7, 0.9), 0.05)
    score.wait(rise_s + who.u(0.1, 0.2))
    stand_tall(score, who, 0.0, 0.4, arms=False)
    score.wait(who.u(0.4, 0.7))
    score.posture = "standing"


def _feet_back(score: Score, who: Performer) -> None:
    """Feet go under the seat as far as one needs them to rise: shanks 15 to 20 degrees forward."""
    reach = who.u(0.0, 0.06)
    for number, side in enumerate((who.handed, OTHER[who.handed])):
        x, y = score.at(side)
        home = who.anatomy.foot_m * np.cos(who.traits["toe_out"])
        back = max(0.0, x - home) + reach
        if back < 0.02:
            continue
        score.put(0.14 * number, 0.5, **{side: (x - back, y)})
        score.hump(0.14 * number, 0.45, **{f"{side}_z": 0.018})
        score.hump(0.14 * number - 0.04, 0.4, **{f"{side}_tip": 9 * DEG})
    score.wait(who.u(0.35, 0.55))


def _push(score: Score, who: Performer, step: Step, first_s: float) -> None:
    """Hands on the knees, or on the seat beside the hips, or swinging forward."""
    how = who.rng.choice(
        ["knees", "seat", "thighs"], p=[0.7, 0.2, 0.1] if step.manner == "careful" else [0.35, 0.25, 0.40]
    )
    for side in SIDES:
        if how == "knees":
            score.reach(side, OnBone(along=who.u(0.78, 0.9)), 0.05, 0.8 * first_s)
        elif how == "seat":
            x, _ = score.at("hips")
            point = score.place.world(
                x + who.u(0.02, 0.08),
                SIGN[side] * (who.anatomy.hips_m + 0.085 * who.tall),
                score.values["z"] - score.place.floor_m - 0.03,
            )
            score.reach(
                side,
                InSpace(point=point, elbow=(-0.9, 0.35, 0.3), fingers=(0.9, 0.1, -0.3), yaw_rad=score.place.yaw_rad),
                0.0,
                0.7 * first_s,
                0.06,
            )


def _support(score: Score, who: Performer, step: Step, seat_m: float) -> dict[str, Goal]:
    """What the hands hold while sitting down: armrests, the own knees, or nothing."""
    odds = [0.1, 0.5, 0.25, 0.15] if step.manner == "careful" else [0.5, 0.2, 0.15, 0.15]
    if step.object == "stair":
        return {}
    how = who.rng.choice(["none", "arms", "knees", "one"], p=odds)
    sides = SIDES if how in ("arms", "knees") else (who.side(),) if how == "one" else ()
    if how == "knees":
        return {side: OnBone(along=who.u(0.7, 0.85)) for side in sides}
    hips_x = seated_hips(score, who, seat_m, shank_rad=8 * DEG)[0]
    height = seat_m + 0.22 * who.tall / 1.72
    found: dict[str, Goal] = {}
    for side in sides:
        point = score.place.world(
            hips_x + who.u(0.14, 0.22), SIGN[side] * (who.anatomy.hips_m + 0.10 * who.tall), height
        )
        found[side] = InSpace(
            point=point, elbow=(-0.9, 0.5, 0.2), fingers=(0.9, 0.0, -0.2), yaw_rad=score.place.yaw_rad
        )
    return found


def _resting_hands(who: Performer, *, leans: bool) -> dict[str, Goal]:
    """Hands on the thighs, on the knees, or in the lap."""
    how = who.rng.choice(["thighs", "knees", "lap"], p=[0.5, 0.25, 0.25])
    along = who.wobble({"thighs": 0.62, "knees": 0.84, "lap": 0.50}[how] * (0.68 if leans else 1.0))
    out = {"thighs": 0.0, "knees": 0.003, "lap": -0.022}[how]
    return {side: OnBone(along=min(each, 0.92), out=out) for side, each in zip(SIDES, along, strict=True)}


def _glance(score: Score, who: Performer, down_s: float) -> None:
    """A look over the shoulder at the seat."""
    sign = SIGN[who.side(0.5)]
    score.move(-0.2, 0.5, look=sign * who.u(25, 42) * DEG, twist=sign * who.u(5, 12) * DEG)
    score.move(0.45 * down_s, 0.6, look=0.0, twist=0.0)


# --- climbing a stair, up or down ---


RISER_M, TREAD_M = (0.155, 0.185), (0.27, 0.31)
"""Of stairs in buildings; 0.17 and 0.29 m are the common ones."""

CADENCE_PER_MIN = 90, 110
"""Of adults at ease on stairs (Riener 2002; Nadeau 2003)."""

RUNNING = 1.4
"""Factor on the cadence of one who runs up a stair; both feet never leave it at once."""


def climb(score: Score, who: Performer, step: Step) -> None:
    """Step over step, one foot on each tread; the feet are brought together on the last one (McFadyen and Winter 1988)."""
    down = step.direction == "down"
    count = step.count or int(who.rng.integers(3, 6))
    riser, tread = who.u(*RISER_M), who.u(*TREAD_M)
    period = 60.0 / who.u(*CADENCE_PER_MIN) / (RUNNING if step.action == "run" else 1.0)
    lead = who.side(0.65)
    rail = who.side(0.5) if step.object == "handrail" or step.manner == "careful" or who.chance(0.25) else None
    slope = -riser if down else riser
    if (
        down and score.place.floor_m == 0 and not score.moves
    ):  # begins on the upper floor, so that the lower one is at 0
        score.lift(count * riser)
    start = score.place
    score.wait(who.u(0.4, 0.7) * score.tempo)
    _prepare(score, who, down=down)
    side = lead
    toes = who.anatomy.foot_m * who.u(0.85, 1.0) if not down else who.anatomy.foot_m * 1.25
    for number in range(1, count + 2):
        last = number == count + 1
        level = min(number, count)
        x = level * tread + toes
        y = stance_foot(who, side)[1] * who.u(0.78, 0.95)
        _tread(score, who, side, (x, y, level * slope), period=period, rise=slope, last=last)
        if rail is not None:
            _slide_rail(score, who, rail, x=level * tread, height=level * slope, period=period)
        elif not last:
            _swing_arms(score, who, side, period)
        side = OTHER[side]
    score.wait(0.25 * period)
    end = start.world(count * tread + toes - who.anatomy.foot_m, 0.0, count * slope)
    score.place = Place(x_m=end[0], y_m=end[1], floor_m=end[2], yaw_rad=start.yaw_rad)
    stand_tall(score, who, 0.0, 0.8)
    score.wait(who.u(0.9, 1.2))
    kind = "down" if down else "up"
    score.notes.append(
        f"climbs {kind} {count} treads, {riser:.3f} m high and {tread:.3f} m deep, the first one's foot at "
        f"{tread + toes:.2f} m; ends {abs(count * slope):.2f} m {'below' if down else 'above'} the start"
    )


def _prepare(score: Score, who: Performer, *, down: bool) -> None:
    score.move(
        0.0, 0.6, gaze=(who.u(28, 40) if down else who.u(16, 28)) * DEG, flex=who.traits["flex"] + who.u(2, 6) * DEG
    )
    score.move(0.0, 0.6, pitch=(who.u(1, 4) if down else who.u(6, 10)) * DEG)


def _tread(
    score: Score,
    who: Performer,
    side: str,
    point: tuple[float, float, float],
    *,
    period: float,
    rise: float,
    last: bool,
) -> None:
    """One step: weight over the other foot, swing, placement, then the body is lifted or let down over it."""
    body = who.anatomy
    floor = score.place.floor_m
    stand = OTHER[side]
    height = score.values[f"{stand}_z"] - floor
    # The body goes over the foot that carries and on, sideways by a part only of the way to it.
    # Moves that last two periods add up to an even speed; the body is over a foot's middle when that has carried it half the way.
    score.put(
        0.13 * period,
        (2.0 if not last else 1.3) * period,
        com=(point[0] - (0.5 if not last else 1 - who.traits["lean"]) * body.foot_m, score.at("com")[1]),
    )
    score.put(-0.25 * period, 0.95 * period, com=(score.at("com")[0], LATERAL * middle(score, who, stand)[1]))
    target = point[2]
    swing, begin = 0.72 * period, 0.27 * period
    carried = height if rise > 0 else target
    give = (0.02 if rise > 0 else 0.026) * who.tall * (0.0 if last else 1.0)
    score.move(
        -0.1 * period if rise > 0 else 0.08 * period,
        (1.2 if rise > 0 else 0.98) * period,
        z=floor + carried + body.standing_m - give,
    )
    score.put(begin, swing, **{side: point[:2]})
    change = target - (score.values[f"{side}_z"] - floor)
    clearance = who.u(0.045, 0.075)
    if change >= 0:  # over the edge first, then down onto the tread
        score.move(begin - 0.02, 0.80 * swing, **{f"{side}_z": floor + target + clearance})
        score.move(begin + 0.45 * swing, 0.58 * swing, **{f"{side}_z": floor + target})
        score.move(begin - 0.34 * period, 0.6 * period, **{f"{side}_tip": who.u(16, 26) * DEG})
        score.move(begin + 0.25 * swing, 0.7 * swing, **{f"{side}_tip": 0.0})
    else:  # the ball first; the knee that carries bends and lets the body down meanwhile
        score.hump(begin - 0.02, 0.5 * swing, **{f"{side}_z": 0.03})
        score.move(begin + 0.3 * swing, 0.75 * swing, **{f"{side}_z": floor + target})
        score.move(begin - 0.3 * period, 0.6 * period, **{f"{side}_tip": who.u(24, 34) * DEG})
        score.move(begin + 0.8 * swing, 0.55 * swing, **{f"{side}_tip": 0.0})
        score.move(0.5 * period, 0.6 * period, **{f"{stand}_tip": who.u(14, 22) * DEG if not last else 0.0})
    sway = SIGN[stand] * who.u(1.0, 2.5) * DEG
    score.move(
        0.1,
        0.8 * period,
        roll=sway,
        side=-0.8 * sway,
        yaw=score.place.yaw_rad - SIGN[side] * who.u(1, 4) * DEG * (0.0 if last else 1.0),
    )
    score.wait(period)


def _swing_arms(score: Score, who: Performer, side: str, period: float) -> None:
    """The arm of the other side goes forward with the swinging leg; less than in level walking."""
    for each in SIDES:
        forward = each != side
        goal = who.hang()
        angle = who.u(14, 24) * DEG if forward else -who.u(2, 9) * DEG
        bend = goal.bend_rad + (who.u(8, 18) * DEG if forward else 0.0)
        score.reach(
            each, type(goal)(forward_rad=angle, out_rad=goal.out_rad, bend_rad=bend), -0.75 * period, 0.9 * period
        )


def _slide_rail(score: Score, who: Performer, side: str, *, x: float, height: float, period: float) -> None:
    """The hand takes the rail ahead, 0.9 m over the treads, at every step anew."""
    tall = who.tall / 1.72
    point = score.place.world(x + who.u(0.12, 0.22), SIGN[side] * 0.30 * tall, height + 0.92 * tall)
    goal = InSpace(point=point, elbow=(-0.8, 0.5, -0.6), fingers=(0.9, 0.0, 0.3), yaw_rad=score.place.yaw_rad)
    score.reach(side, goal, -0.8 * period, 0.8 * period, 0.03)
