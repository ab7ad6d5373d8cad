"""A movement written down before it is rendered: who makes it, what every part of the body is asked to do, and when.

A value goes from one target to the next along a minimum-jerk curve (Flash and Hogan 1985). Movements of the same part add up, so
that they may overlap (Flash and Henis 1991): nothing stops where the next thing begins, and all is twice differentiable.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from t2d_rt.motion.descriptions.slots import Step
from t2d_rt.motion.generate.made.hands import SIGN, Anatomy, Goal, Hang, InSpace, OnChest, OnPelvis, Triple
from t2d_rt.motion.interpolate import minimum_jerk

Posture = Literal["standing", "sitting", "sitting on the floor", "lying on the floor", "lying on a bed"]

SIDES = "left", "right"
OTHER = {"left": "right", "right": "left"}
DEG = np.pi / 180

HEAD_AND_TRUNK = "pitch", "roll", "flex", "side", "twist", "gaze", "look", "tilt"
OF_A_SIDE = "x", "y", "z", "yaw", "tip", "pivot", "splay", "loose", "shrug"

CHANNELS: tuple[str, ...] = (
    *("x", "y", "z", "balanced", "com_x", "com_y", "yaw", "spin", *HEAD_AND_TRUNK),
    *(f"{side}_{part}" for side in SIDES for part in OF_A_SIDE),
    "ground",
)
"""The channels that an act moves.

Middle of the hips: x, y, z [m], of which x and y count as far as `balanced` is below 1; centre of mass: com_x, com_y [m], as far
as that is above 0. Pelvis [rad]: yaw, pitch (forward), roll (to the left), then spin about the body's long axis. Spine, against the
pelvis: flex (forward), side and twist (to the left). Head: gaze (down, in space), look (to the left, against the chest), tilt.
Each foot: x, y, z [m] of its pivot over where it stands flat, yaw, tip (heel up), pivot (1 the ball, 0 the heel), splay of its
knee, and loose: 1 where it lies about, so that it goes with the shank, and x, y, z are the ankle's. Each shoulder's shrug. Ground:
height [m] of what arms may not sink into.
"""

INDEX = {name: number for number, name in enumerate(CHANNELS)}

POINTS = {"hips": "", "com": "com_", "left": "left_", "right": "right_"}
"""Prefix of the channels x, y (and z) of each part that has a place: the hips, the centre of mass and both feet."""

SPEED = {"slow": 0.68, "normal": 1.0, "fast": 1.38}
MANNER = {None: 1.0, "careful": 0.78, "happy": 1.10, "angry": 1.28, "sad": 0.82}
"""Factors on the pace: slow ones take 1.5 times as long as at ease, fast ones 0.7 times."""

SLUMP = {None: 0.0, "careful": 2.0, "happy": -3.0, "angry": 3.0, "sad": 13.0}
"""Flexion [degrees] that a manner adds to the spine, and 0.6 of it to the gaze; sad people hold the thorax flexed and the
head down (Michalak 2009)."""

BEFORE_S, AFTER_S = (0.1, 2.4), (0.0, 2.2)
"""Ranges of the time at rest before and after a motion, because recordings begin and end at no fixed instant."""

PROMPT = 0.2
"""Factor on the time at rest before a step that has a given duration."""

SHIFT, SHIFT_ASIDE, SHIFT_BACK = (0.12, 0.34), 0.12, 0.3
"""Range of the length of a step ahead or back, and greatest one aside, before and after an action on the spot, over stature (half a
step to a step); and the chance that it goes back."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """A change of one channel from `start_s` on."""

    channel: str
    start_s: float
    duration_s: float
    change: float
    skew: float
    """Above 1 it begins slowly and ends fast: the fraction of time is raised to this power."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grasp:
    """A hand's movement from its last goal to the next."""

    goal: Goal
    start_s: float
    duration_s: float
    aside_m: float
    """Greatest distance [m] by which its path bends outward, so that the hand goes round the body."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """The frame in the room in which an action is written down: x is ahead of the person, whose floor is at `floor_m`."""

    x_m: float = 0.0
    y_m: float = 0.0
    floor_m: float = 0.0
    yaw_rad: float = 0.0

    def world(self, x: float, y: float, z: float = 0.0) -> tuple[float, float, float]:
        """A point of this place in the room's coordinates [m]."""
        c, s = float(np.cos(self.yaw_rad)), float(np.sin(self.yaw_rad))
        return self.x_m + c * x - s * y, self.y_m + s * x + c * y, self.floor_m + z

    def local(self, x: float, y: float) -> tuple[float, float]:
        """A point of the room, x and y, in the coordinates of this place [m]."""
        c, s = float(np.cos(self.yaw_rad)), float(np.sin(self.yaw_rad))
        return c * (x - self.x_m) + s * (y - self.y_m), -s * (x - self.x_m) + c * (y - self.y_m)

    def hold(
        self,
        x: float,
        y: float,
        z: float,
        *,
        elbow: Triple,
        fingers: Triple,
        back: Triple = (0.0, 0.0, 1.0),
        held: bool = True,
    ) -> InSpace:
        """A hand's goal at a point [m] here, elbow, fingers and back of the hand seen from here as well (see `InSpace`)."""
        return InSpace(at=self.world(x, y, z), elbow=elbow, fingers=fingers, back=back, yaw_rad=self.yaw_rad, held=held)


@dataclass(frozen=True, slots=True, kw_only=True)
class Habits:
    """A person's posture and stance, which stay the same throughout."""

    flex: float
    """Flexion of the spine in quiet standing [rad]."""
    gaze: float
    out: float
    """Angle by which the arms hang outward [rad]."""
    half_width: float
    """Half the distance of the feet [m]."""
    toe_out: float
    ahead: float
    """Distance by which the left foot stands ahead, over stature."""
    lean: float
    """Place of the centre of mass over the foot: 0 at the ankle, 1 at the ball."""


@dataclass(slots=True, kw_only=True)
class Act:
    """What a person does, as it is written down; times are in seconds."""

    anatomy: Anatomy
    rng: np.random.Generator
    handed: str
    """The better hand, left or right."""
    habits: Habits
    values: dict[str, float]
    """Value that each channel has when all moves are over."""
    first: dict[str, float] = field(default_factory=dict)
    """Value that each channel begins with."""
    moves: list[Move] = field(default_factory=list)
    grasps: dict[str, list[Grasp]] = field(default_factory=lambda: {"left": [], "right": []})
    starts: dict[str, Goal] = field(default_factory=dict)
    """Goal at which each hand begins."""
    now_s: float = 0.0
    tempo: float = 1.0
    place: Place = field(default_factory=Place)
    home: Place | None = None
    """The place before the bed in which the person lies."""
    posture: Posture = "standing"
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.values = {name: float(self.values.get(name, 0.0)) for name in CHANNELS}
        self.first = dict(self.values)

    # --- random draws ---

    def u(self, low: float, high: float) -> float:
        """A draw between two values."""
        return float(self.rng.uniform(low, high))

    def about(self, mean: float, deviation: float) -> float:
        """A draw around a value, within two deviations."""
        return mean + deviation * float(np.clip(self.rng.standard_normal(), -2.0, 2.0))

    def chance(self, probability: float) -> bool:
        """Whether something of this probability happens."""
        return bool(self.rng.random() < probability)

    def side(self, probability: float = 0.8) -> str:
        """The side of the hand that acts: that of the better one with this probability."""
        return self.handed if self.chance(probability) else OTHER[self.handed]

    def wobble(self, mean: float) -> tuple[float, float]:
        """A value for each side about the same mean, not quite alike."""
        common = self.about(0, 0.10)
        return mean * (1 + common + self.about(0, 0.05)), mean * (1 + common + self.about(0, 0.05))

    def hang(self) -> Hang:
        """An arm that hangs in this person's way."""
        return Hang(
            forward_rad=self.about(6, 6) * DEG,
            out_rad=self.about(self.habits.out, 2 * DEG),
            bend_rad=self.about(22, 8) * DEG,
        )

    @property
    def tall(self) -> float:
        """Stature of the person [m]."""
        return self.anatomy.stature_m

    # --- what is written ---

    def move(self, after_s: float, duration_s: float, skew: float = 1.0, /, **targets: float) -> None:
        """Bring channels to targets, from `after_s` after now on; both times are divided by the tempo."""
        start_s, lasting_s = self.now_s + after_s / self.tempo, max(duration_s / self.tempo, 0.12)
        for channel, target in targets.items():
            change = target - self.values[channel]
            if change:
                self.moves.append(
                    Move(channel=channel, start_s=start_s, duration_s=lasting_s, change=change, skew=skew)
                )
            self.values[channel] = target

    def limb(self, side: str, after_s: float, duration_s: float, /, **targets: float) -> None:
        """`move` for the foot's channels of a side, or its shoulder's shrug: `limb("left", 0.0, 1.0, tip=0.2)`."""
        self.move(after_s, duration_s, **{f"{side}_{part}": target for part, target in targets.items()})

    def put(self, part: str, after_s: float, duration_s: float, point: tuple[float, ...], skew: float = 1.0) -> None:
        """Bring hips (x, y, z), com (x, y), or the left or right foot (x, y) or (x, y, z) to a point of the action's place."""
        targets = {f"{POINTS[part]}{axis}": value for axis, value in zip("xyz", self.place.world(*point), strict=True)}
        if len(point) == 2:
            del targets[f"{POINTS[part]}z"]
        self.move(after_s, duration_s, skew, **targets)

    def hump(self, channel: str, after_s: float, duration_s: float, height: float) -> None:
        """Raise a channel by a height and bring it back: two moves that overlap."""
        value = self.values[channel]
        self.move(after_s, 0.62 * duration_s, **{channel: value + height})
        self.move(after_s + 0.38 * duration_s, 0.62 * duration_s, **{channel: value})

    def reach(self, side: str, goal: Goal, after_s: float, duration_s: float, aside_m: float = 0.0) -> None:
        """Bring a hand to a goal."""
        start_s, lasting_s = self.now_s + after_s / self.tempo, max(duration_s / self.tempo, 0.15)
        self.grasps[side].append(Grasp(goal=goal, start_s=start_s, duration_s=lasting_s, aside_m=aside_m))

    def wait(self, duration_s: float) -> None:
        """Let time pass; moves may run on."""
        self.now_s += duration_s / self.tempo

    def lift(self, height_m: float) -> None:
        """Begin the act on a floor that is higher by this."""
        for channel in ("z", "left_z", "right_z", "ground"):
            self.values[channel] += height_m
            self.first[channel] += height_m
        self.place = replace(self.place, floor_m=self.place.floor_m + height_m)

    # --- what has been written ---

    def at(self, part: str) -> tuple[float, float]:
        """Place of hips, com or a foot after all moves, x and y in the action's place [m]."""
        return self.place.local(self.values[f"{POINTS[part]}x"], self.values[f"{POINTS[part]}y"])

    def goal(self, side: str) -> Goal:
        """The last goal of a hand."""
        return self.grasps[side][-1].goal if self.grasps[side] else self.starts[side]

    @property
    def end_s(self) -> float:
        """Time at which the last move ends."""
        actions: list[Move | Grasp] = [*self.moves, *self.grasps["left"], *self.grasps["right"]]
        return max([self.now_s, *(action.start_s + action.duration_s for action in actions)])

    def sampled(self, times_s: np.ndarray) -> np.ndarray:
        """Channels (T, C) at times (T,)."""
        table = np.tile([self.first[name] for name in CHANNELS], (len(times_s), 1))
        for move in self.moves:
            table[:, INDEX[move.channel]] += move.change * progress(times_s, move.start_s, move.duration_s, move.skew)
        return table


def progress(times_s: np.ndarray, start_s: float, duration_s: float, skew: float = 1.0) -> np.ndarray:
    """Part (T,) of a move that is done at times (T,)."""
    return minimum_jerk(np.clip((times_s - start_s) / duration_s, 0.0, 1.0) ** skew)


# --- how an act begins ---


def stance(anatomy: Anatomy, rng: np.random.Generator, *, handed: str, step: Step, waits: float = 1.0) -> Act:
    """An act that begins with quiet standing, ankles about the origin, facing +x; habits are drawn, as the step's manner has them.

    waits: factor on how long the person stands first.
    """
    slump = SLUMP[step.manner]
    draw = rng.standard_normal(8).clip(-2, 2)
    apart = 1.6 if step.body_part in ("leg", "foot") and step.action in ("sit", "squat", "stand_up") else 1.0
    habits = Habits(
        flex=(6 + 5 * draw[0] + slump) * DEG,
        gaze=(5 + 8 * draw[1] + 0.6 * slump) * DEG,
        out=(12 + 3.5 * draw[2]) * DEG,
        half_width=apart * (0.058 + 0.016 * draw[3]) * anatomy.stature_m,
        toe_out=(9 + 6 * draw[4]) * DEG,
        ahead=0.028 * draw[5],
        lean=0.36 + 0.05 * draw[6],
    )
    values = {"z": anatomy.standing_m, "balanced": 1.0, "com_x": habits.lean * anatomy.foot_m}
    act = Act(anatomy=anatomy, rng=rng, handed=handed, habits=habits, values=values | upright(habits))
    for side in SIDES:
        x, y = stance_foot(act, side)
        feet = {"x": x, "y": y, "yaw": SIGN[side] * habits.toe_out, "pivot": 1.0}
        act.values |= {f"{side}_{part}": float(value) for part, value in feet.items()}
    act.values["tilt"] = act.about(0, 1.5) * DEG
    act.first = dict(act.values)
    act.starts = at_ease(act)
    act.wait(waits * act.u(*BEFORE_S))
    return act


def resumed(act: Act, step: Step) -> Act:
    """An act that begins where another one ends, at rest, before a step."""
    next_act = replace(
        act, moves=[], grasps={"left": [], "right": []}, starts={side: act.goal(side) for side in SIDES}, now_s=0.0
    )
    next_act.wait((1.0 if step.duration_s is None else PROMPT) * next_act.u(*BEFORE_S))
    return next_act


def tempo_of(step: Step, rng: np.random.Generator, individual: float) -> float:
    """Factor on the pace of a step: that of the person, of its speed and manner, and of a random variation."""
    variation = float(np.exp(0.08 * np.clip(rng.standard_normal(), -2.0, 2.0)))
    return individual * SPEED[step.speed] * MANNER[step.manner] * variation


# --- standing, and steps on the spot ---


def upright(habits: Habits) -> dict[str, float]:
    """Channels of trunk and head in quiet standing."""
    return dict.fromkeys(HEAD_AND_TRUNK, 0.0) | {"flex": habits.flex, "gaze": habits.gaze}


def stance_foot(act: Act, side: str) -> tuple[float, float]:
    """Ball of a foot in quiet standing, x and y in the action's place [m]."""
    reach, turn = act.anatomy.foot_m, act.habits.toe_out
    ahead = SIGN[side] * act.habits.ahead * act.tall
    return ahead + reach * np.cos(turn), SIGN[side] * (act.habits.half_width + reach * np.sin(turn))


def middle(act: Act, side: str | None = None) -> tuple[float, float]:
    """Place where the centre of mass belongs over both feet, or over one of them, x and y in the action's place [m]."""
    x, y = 0.0, 0.0
    sides = SIDES if side is None else (side,)
    back = (1 - act.habits.lean) * act.anatomy.foot_m
    for foot in sides:
        ball = act.at(foot)
        yaw = act.values[f"{foot}_yaw"] - act.place.yaw_rad
        x += (ball[0] - back * np.cos(yaw)) / len(sides)
        y += (ball[1] - back * np.sin(yaw)) / len(sides)
    return x, y


def stand_tall(act: Act, after_s: float, duration_s: float, *, arms: bool = True) -> None:
    """Back to quiet standing over the feet; hips, trunk and head do not arrive together."""
    act.put("com", after_s, duration_s, middle(act))
    act.move(after_s, duration_s, z=act.place.floor_m + act.anatomy.standing_m, balanced=1.0)
    for channel, target in upright(act.habits).items():
        act.move(after_s + act.u(0.0, 0.12), duration_s * act.u(0.85, 1.15), **{channel: target})
    if arms:
        for side, goal in at_ease(act).items():
            act.reach(side, goal, after_s + act.u(0.05, 0.2), duration_s * act.u(0.75, 1.0), 0.04)


def at_ease(act: Act) -> dict[str, Goal]:
    """Goals of the hands in standing: hanging, clasped before the belly, or one or both of them on the hips."""
    how = act.rng.choice(["hang", "clasped", "hips", "one"], p=[0.45, 0.25, 0.15, 0.15])
    if how == "clasped":
        at = act.u(0.34, 0.46), -0.27, -act.u(0.4, 0.62)
        return dict.fromkeys(
            SIDES, OnChest(at=at, elbow=(-0.5, 0.6, -0.6), fingers=(0.4, -0.8, -0.4), back=(0.8, 0.4, 0.2))
        )
    on_hips = {"hang": (), "hips": SIDES, "one": (act.side(0.5),)}[how]
    return {side: OnPelvis() if side in on_hips else act.hang() for side in SIDES}


LATERAL = 0.30
"""Part of the way to the standing foot that the centre of mass goes in one step; it is less in faster steps, as the force under the
foot does the rest (an inverted pendulum swayed at the cadence moves by a third to a quarter of what its foot does)."""

WITH_THE_FOOT = 0.2
"""`leaves` of a step that goes on, as in walking: the pelvis is half-way between the feet when the foot lands, and not over the
one behind, so that it need not sink."""


def step_to(
    act: Act,
    side: str,
    point: tuple[float, float],
    *,
    yaw: float,
    duration_s: float,
    lift_m: float,
    leaves: float = 0.65,
) -> None:
    """One foot goes to a point of the action's place while the other carries; `leaves` is the part of `duration_s` after which the
    centre of mass sets off to where it then belongs."""
    over, home = middle(act, OTHER[side]), middle(act)
    sway = home[0] + LATERAL * (over[0] - home[0]), home[1] + LATERAL * (over[1] - home[1])
    act.put("com", -0.25 * duration_s, 0.95 * duration_s, sway)
    begin_s, swing_s = 0.30 * duration_s, 0.66 * duration_s
    act.put(side, begin_s, swing_s, point)
    act.limb(side, begin_s, swing_s, yaw=yaw)
    act.hump(f"{side}_z", begin_s, swing_s, lift_m)
    act.hump(f"{side}_tip", begin_s - 0.08, 0.7 * swing_s, act.u(14, 24) * DEG)
    act.wait(duration_s)
    act.put("com", (leaves - 1) * duration_s, 0.95 * duration_s, middle(act))


def shift(act: Act) -> None:
    """A step of each foot to a place near by, because people seldom act just where they happen to stand."""
    ahead, aside = act.u(*SHIFT) * act.tall, act.u(-SHIFT_ASIDE, SHIFT_ASIDE) * act.tall
    if act.chance(SHIFT_BACK):
        ahead = -0.7 * ahead  # steps back are shorter
    first = "left" if aside > 0 else "right"
    period_s, lift_m = act.u(0.55, 0.72), act.u(0.05, 0.08)
    for side in (first, OTHER[first]):
        x, y = stance_foot(act, side)
        yaw = act.place.yaw_rad + SIGN[side] * act.habits.toe_out
        point = x + ahead, y + aside
        step_to(act, side, point, yaw=yaw, duration_s=period_s, lift_m=lift_m, leaves=WITH_THE_FOOT)
    x, y, _ = act.place.world(ahead, aside)
    act.place = replace(act.place, x_m=x, y_m=y)
    # The hips, which balance places now, go there too: a movement from balance to a seat or the floor begins from there.
    act.put("com", 0.0, 0.4, middle(act))
    act.put("hips", 0.0, 0.4, (0.0, 0.0))


def turn_on_the_spot(act: Act, angle_rad: float) -> None:
    """Turn by small steps; the head leads, the pelvis follows, then the feet. Ends with a new place for the action."""
    steps = max(2, round(abs(angle_rad) / (35 * DEG))) + 1
    begin_rad = act.place.yaw_rad
    period_s = act.u(0.50, 0.62)
    act.move(0.0, 0.6, look=np.sign(angle_rad) * act.u(18, 30) * DEG)
    act.move(0.15, period_s * steps, yaw=begin_rad + angle_rad)
    side = "left" if angle_rad > 0 else "right"
    centre = act.place.world(0.0, 0.0)
    for number in range(1, steps + 1):
        # Each foot goes as far as the trunk will be, the last one beside the other.
        yaw = begin_rad + angle_rad * min(1.0, (number + 0.6) / steps if number < steps - 1 else 1.0)
        c, s = np.cos(yaw), np.sin(yaw)
        x, y = stance_foot(act, side)
        point = act.place.local(centre[0] + c * x - s * y, centre[1] + s * x + c * y)
        yaw += SIGN[side] * act.habits.toe_out
        step_to(act, side, point, yaw=yaw, duration_s=period_s, lift_m=act.u(0.045, 0.07))
        side = OTHER[side]
    act.move(-0.3, 0.6, look=0.0)
    act.place = replace(act.place, x_m=centre[0], y_m=centre[1], yaw_rad=begin_rad + angle_rad)
    act.put("com", 0.0, 0.4, middle(act))
