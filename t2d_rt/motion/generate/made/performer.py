"""Who makes a movement: habits that are drawn once, and what a description's words do to tempo and posture."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate.made.hands import Anatomy, Hang
from t2d_rt.motion.generate.made.score import DEG, OTHER, SIDES, SIGN, Score

SPEED = {"slow": 0.68, "normal": 1.0, "fast": 1.38}
MANNER = {None: 1.0, "careful": 0.78, "happy": 1.10, "angry": 1.28, "sad": 0.82}
"""Factors on the pace: slow ones take 1.5 times as long as at ease, fast ones 0.7 times."""

SLUMP = {None: 0.0, "careful": 2.0, "happy": -3.0, "angry": 3.0, "sad": 13.0}
"""Flexion [degrees] that a manner adds to the spine, and half of it to the gaze; sad people hold the thorax flexed and the
head down (Michalak 2009)."""

BEFORE_S, AFTER_S = (0.2, 1.4), (0.0, 1.0)
"""Time at rest before a motion and after it: recordings begin and end at no fixed instant, and motions differ by it."""

PROMPT = 0.2
"""Factor on the time at rest before a step that is to last for a given time."""

SHIFT, SHIFT_ASIDE, SHIFT_BACK = (0.12, 0.34), 0.12, 0.3
"""How far one steps ahead or back, and at most aside, before and after what is done on the spot, over stature: half a step to a
step; and the chance that it is back."""


@dataclass(frozen=True)
class Performer:
    """A person and one performance's draws."""

    anatomy: Anatomy
    rng: np.random.Generator
    handed: str
    traits: dict[str, float] = field(default_factory=dict)

    def u(self, low: float, high: float) -> float:
        """A draw between two values."""
        return float(self.rng.uniform(low, high))

    def about(self, mean: float, deviation: float) -> float:
        """A draw around a value, within two deviations."""
        return mean + deviation * float(np.clip(self.rng.standard_normal(), -2.0, 2.0))

    def chance(self, probability: float) -> bool:
        """Whether something is so."""
        return bool(self.rng.random() < probability)

    def side(self, probability: float = 0.8) -> str:
        """The side of the hand that does it: the better one, mostly."""
        return self.handed if self.chance(probability) else OTHER[self.handed]

    @property
    def tall(self) -> float:
        """Stature of the performer [m]."""
        return self.anatomy.stature_m

    def upright(self) -> dict[str, float]:
        """Trunk and head of quiet standing."""
        return {
            "pitch": 0.0,
            "roll": 0.0,
            "flex": self.traits["flex"],
            "side": 0.0,
            "twist": 0.0,
            "gaze": self.traits["gaze"],
            "look": 0.0,
            "tilt": 0.0,
        }

    def hang(self) -> Hang:
        """An arm that hangs in this person's way."""
        return Hang(
            forward_rad=self.about(6, 4) * DEG,
            out_rad=self.about(self.traits["out"], 1.5 * DEG),
            bend_rad=self.about(20, 6) * DEG,
        )

    def wobble(self, mean: float) -> tuple[float, float]:
        """The same thing for both sides, not quite alike."""
        both = self.about(0, 0.10)
        return mean * (1 + both + self.about(0, 0.05)), mean * (1 + both + self.about(0, 0.05))


def performer(anatomy: Anatomy, rng: np.random.Generator, *, handed: str, step: Step) -> Performer:
    """Habits of posture and stance, drawn once."""
    slump = SLUMP[step.manner]
    draw = rng.standard_normal(8).clip(-2, 2)
    apart = 1.6 if step.body_part in ("leg", "foot") and step.action in ("sit", "squat", "stand_up") else 1.0
    traits = {
        "flex": (5 + 3 * draw[0] + slump) * DEG, "gaze": (5 + 5 * draw[1] + 0.6 * slump) * DEG, "out": (12 + 1.5 * draw[2]) * DEG,
        "half_width": apart * (0.056 + 0.011 * draw[3]) * anatomy.stature_m, "toe_out": (9 + 4.5 * draw[4]) * DEG,
        "ahead": 0.02 * draw[5], "lean": 0.36 + 0.05 * draw[6],
    }  # fmt: skip
    return Performer(anatomy, rng, handed, traits)


def tempo_of(step: Step, rng: np.random.Generator, individual: float) -> float:
    """Factor on the speed of everything."""
    return (
        individual
        * SPEED[step.speed]
        * MANNER[step.manner]
        * float(np.exp(0.08 * np.clip(rng.standard_normal(), -2.0, 2.0)))
    )


def stance(who: Performer, *, waits: float = 1.0) -> Score:
    """A score that begins with quiet standing, ankles about the origin, facing +x; `waits` is a factor on how long it stands."""
    body, traits = who.anatomy, who.traits
    values: dict[str, float] = {
        "z": body.standing_m,
        "balanced": 1.0,
        "com_x": traits["lean"] * body.foot_m,
        **who.upright(),
    }
    for side in SIDES:
        x, y = stance_foot(who, side)
        values |= {f"{side}_x": x, f"{side}_y": y, f"{side}_yaw": SIGN[side] * traits["toe_out"], f"{side}_pivot": 1.0}
    values["tilt"] = who.about(0, 1.5) * DEG
    score = Score(values=values)
    score.starts = {side: who.hang() for side in SIDES}
    score.wait(waits * who.u(*BEFORE_S))
    return score


def stance_foot(who: Performer, side: str) -> tuple[float, float]:
    """Ball of a foot in quiet standing, x and y [m] where the person is."""
    ahead = SIGN[side] * who.traits["ahead"] * who.tall
    reach = who.anatomy.foot_m
    turn = who.traits["toe_out"]
    return ahead + reach * np.cos(turn), SIGN[side] * (who.traits["half_width"] + reach * np.sin(turn))


def middle(score: Score, who: Performer, side: str | None = None) -> tuple[float, float]:
    """Where the centre of mass belongs over both feet, or over one of them, x and y in the action's place [m]."""
    x, y = 0.0, 0.0
    sides = SIDES if side is None else (side,)
    for each in sides:
        ball = score.at(each)
        yaw = score.values[f"{each}_yaw"] - score.place.yaw_rad
        back = (1 - who.traits["lean"]) * who.anatomy.foot_m
        x += (ball[0] - back * np.cos(yaw)) / len(sides)
        y += (ball[1] - back * np.sin(yaw)) / len(sides)
    return x, y


def stand_tall(score: Score, who: Performer, after_s: float, duration_s: float, *, arms: bool = True) -> None:
    """Back to quiet standing over the feet; hips, trunk and head do not arrive together."""
    score.put(after_s, duration_s, com=middle(score, who))
    score.move(after_s, duration_s, z=score.place.floor_m + who.anatomy.standing_m, balanced=1.0)
    for channel, target in who.upright().items():
        score.move(after_s + who.u(0.0, 0.12), duration_s * who.u(0.85, 1.15), **{channel: target})
    if arms:
        for side in SIDES:
            score.reach(side, who.hang(), after_s + who.u(0.05, 0.2), duration_s * who.u(0.75, 1.0), 0.04)


LATERAL = 0.30
"""Part of the way to the foot that stands which the centre of mass goes in one step: the faster, the less, as the force under the
foot does the rest (an inverted pendulum swayed at the cadence moves by a third to a quarter of what its foot does)."""


def step_to(
    score: Score,
    who: Performer,
    side: str,
    point: tuple[float, float],
    *,
    yaw: float,
    duration_s: float,
    lift_m: float = 0.05,
    leaves: float = 0.65,
) -> None:
    """One foot goes to a point of the action's place while the other carries; `leaves` is the part of `duration_s` after which the
    centre of mass sets off to where it then belongs."""
    there, home = middle(score, who, OTHER[side]), middle(score, who)
    score.put(
        -0.25 * duration_s,
        0.95 * duration_s,
        com=(home[0] + LATERAL * (there[0] - home[0]), home[1] + LATERAL * (there[1] - home[1])),
    )
    begin, swing = 0.30 * duration_s, 0.66 * duration_s
    score.put(begin, swing, **{side: point})
    score.move(begin, swing, **{f"{side}_yaw": yaw})
    score.hump(begin, swing, **{f"{side}_z": lift_m})
    score.hump(begin - 0.08, 0.7 * swing, **{f"{side}_tip": who.u(14, 24) * DEG})
    score.wait(duration_s)
    score.put((leaves - 1) * duration_s, 0.95 * duration_s, com=middle(score, who))


WITH_THE_FOOT = 0.2
"""`leaves` of a step that goes on, as in walking: the pelvis is half-way between the feet when the foot lands, and not over the
one behind, so that it need not sink."""


def shift(score: Score, who: Performer) -> None:
    """A step of each foot to a place near by: people seldom do a thing just where they happen to stand."""
    ahead, aside = who.u(*SHIFT) * who.tall, who.u(-SHIFT_ASIDE, SHIFT_ASIDE) * who.tall
    if who.chance(SHIFT_BACK):
        ahead = -0.7 * ahead  # steps back are shorter
    first = "left" if aside > 0 else "right"
    period, lift_m = who.u(0.55, 0.72), who.u(0.05, 0.08)
    for side in (first, OTHER[first]):
        x, y = stance_foot(who, side)
        yaw = score.place.yaw_rad + SIGN[side] * who.traits["toe_out"]
        step_to(
            score, who, side, (x + ahead, y + aside), yaw=yaw, duration_s=period, lift_m=lift_m, leaves=WITH_THE_FOOT
        )
    x, y, _ = score.place.world(ahead, aside)
    score.place = replace(score.place, x_m=x, y_m=y)
    # Hips, too, which balance places now: what leaves balance for a seat or the floor begins from there.
    score.put(0.0, 0.4, com=middle(score, who), hips=(0.0, 0.0))


def turn_on_the_spot(score: Score, who: Performer, angle_rad: float) -> None:
    """Turn by small steps; the head leads, the pelvis follows, then the feet. Ends with a new place for the action."""
    count = max(2, round(abs(angle_rad) / (35 * DEG)))
    steps = count + 1
    lead = "left" if angle_rad > 0 else "right"
    begin = score.place.yaw_rad
    period = who.u(0.50, 0.62)
    score.move(0.0, 0.6, look=np.sign(angle_rad) * who.u(18, 30) * DEG)
    score.move(0.15, period * steps, yaw=begin + angle_rad)
    side = lead
    centre = score.place.world(0.0, 0.0)
    for number in range(1, steps + 1):
        # Each foot goes as far as the trunk will be, the last one beside the other.
        yaw = begin + angle_rad * min(1.0, (number + 0.6) / (steps + 0.0) if number < steps - 1 else 1.0)
        c, s = np.cos(yaw), np.sin(yaw)
        x, y = stance_foot(who, side)
        there = score.place.local(centre[0] + c * x - s * y, centre[1] + s * x + c * y)
        step_to(
            score,
            who,
            side,
            there,
            yaw=yaw + SIGN[side] * who.traits["toe_out"],
            duration_s=period,
            lift_m=who.u(0.03, 0.055),
        )
        side = OTHER[side]
    score.move(-0.3, 0.6, look=0.0)
    score.place = type(score.place)(
        x_m=centre[0], y_m=centre[1], floor_m=score.place.floor_m, yaw_rad=begin + angle_rad
    )
    score.put(0.0, 0.4, com=middle(score, who))
