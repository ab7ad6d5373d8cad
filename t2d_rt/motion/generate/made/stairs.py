"""Climbing a stair, up or down."""

from __future__ import annotations

from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate.made.hands import InSpace
from t2d_rt.motion.generate.made.performer import LATERAL, Performer, middle, stance_foot, stand_tall
from t2d_rt.motion.generate.made.score import DEG, OTHER, SIDES, SIGN, Place, Score

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
