"""A movement written down before it is rendered: what every part of the body is asked to do, and when.

A value goes from one target to the next along a minimum-jerk curve (Flash and Hogan 1985). Movements of the same part add up, so
that they may overlap (Flash and Henis 1991): nothing stops where the next thing begins, and all is twice differentiable.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from t2d_rt.motion.generate.made.hands import Goal, Hang
from t2d_rt.motion.interpolate import minimum_jerk

Posture = Literal["standing", "sitting", "sitting on the floor", "lying on the floor", "lying on a bed"]

SIDES = "left", "right"
SIGN = {"left": 1.0, "right": -1.0}
OTHER = {"left": "right", "right": "left"}
DEG = np.pi / 180

CHANNELS: tuple[str, ...] = (
    "x", "y", "z", "balanced", "com_x", "com_y", "yaw", "pitch", "roll", "spin", "flex", "side", "twist", "gaze", "look", "tilt",
    *(
        f"{side}_{part}"
        for side in ("left", "right")
        for part in ("x", "y", "z", "yaw", "tip", "pivot", "splay", "loose", "shrug")
    ),
    "ground",
)  # fmt: skip
"""What a score moves.

Hips, their middle: x, y, z [m], level ones used as far as `balanced` is below 1; centre of mass com_x, com_y [m], used as far as it
is above 0. Pelvis [rad]: yaw, pitch (forward), roll (to the left), then spin about the body's long axis. Spine, against the pelvis:
flex (forward), side (to the left), twist (to the left). Head: gaze (down, in space), look (to the left, against the chest), tilt.
Each foot: x, y, z [m] of its pivot over where it stands flat, yaw, tip (heel up), pivot (1 the ball, 0 the heel), splay of its
knee, and loose: 1 where it lies about, so that it goes with the shank, and x, y, z are the ankle's. Each shoulder's shrug. Ground:
height [m] of what arms may not sink into.
"""

INDEX = {name: number for number, name in enumerate(CHANNELS)}


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
    """A hand's way from its last goal to the next."""

    goal: Goal
    start_s: float
    duration_s: float
    aside_m: float
    """Greatest distance [m] by which the way bends outward, so that the hand goes round the body."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where in the room an action is written down: its x is ahead of the person, its floor is where the person stands."""

    x_m: float = 0.0
    y_m: float = 0.0
    floor_m: float = 0.0
    yaw_rad: float = 0.0

    def world(self, x: float, y: float, z: float = 0.0) -> tuple[float, float, float]:
        """A point of the room [m]."""
        c, s = float(np.cos(self.yaw_rad)), float(np.sin(self.yaw_rad))
        return self.x_m + c * x - s * y, self.y_m + s * x + c * y, self.floor_m + z

    def local(self, x: float, y: float) -> tuple[float, float]:
        """A point of the room as the person sees it [m]."""
        c, s = float(np.cos(self.yaw_rad)), float(np.sin(self.yaw_rad))
        return c * (x - self.x_m) + s * (y - self.y_m), -s * (x - self.x_m) + c * (y - self.y_m)


@dataclass(slots=True)
class Score:
    """A score that is being written; times in seconds."""

    values: dict[str, float]
    """Value that each channel has when all moves are over."""
    first: dict[str, float] = field(default_factory=dict)
    moves: list[Move] = field(default_factory=list)
    grasps: dict[str, list[Grasp]] = field(default_factory=lambda: {"left": [], "right": []})
    starts: dict[str, Goal] = field(default_factory=lambda: {"left": Hang(), "right": Hang()})
    now_s: float = 0.0
    tempo: float = 1.0
    place: Place = field(default_factory=Place)
    home: Place | None = None
    """The place before the bed, of one who lies in it."""
    posture: Posture = "standing"
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.values = {name: float(self.values.get(name, 0.0)) for name in CHANNELS}
        self.first = dict(self.values)

    def move(self, after_s: float, duration_s: float, skew: float = 1.0, /, **targets: float) -> None:
        """Bring channels to targets, from `after_s` after now on; both times are divided by the tempo."""
        for channel, target in targets.items():
            change = target - self.values[channel]
            if change:
                self.moves.append(Move(
                    channel=channel, start_s=self.now_s + after_s / self.tempo, duration_s=max(duration_s / self.tempo, 0.12),
                    change=change, skew=skew,
                ))  # fmt: skip
            self.values[channel] = target

    def put(self, after_s: float, duration_s: float, skew: float = 1.0, /, **points: tuple[float, ...]) -> None:
        """Bring hips (x, y, z), com (x, y), left and right foot (x, y) or (x, y, z) to points of the place where the action is."""
        targets: dict[str, float] = {}
        for part, point in points.items():
            x, y, z = self.place.world(*point)
            prefix = {"hips": "", "com": "com_", "left": "left_", "right": "right_"}[part]
            targets |= {f"{prefix}x": x, f"{prefix}y": y} | ({f"{prefix}z": z} if len(point) > 2 else {})
        self.move(after_s, duration_s, skew, **targets)

    def at(self, part: str) -> tuple[float, float]:
        """Where hips, com or a foot are in the end, x and y in the action's place [m]."""
        prefix = {"hips": "", "com": "com_", "left": "left_", "right": "right_"}[part]
        return self.place.local(self.values[f"{prefix}x"], self.values[f"{prefix}y"])

    def hump(self, after_s: float, duration_s: float, **heights: float) -> None:
        """Raise channels by heights and bring them back: two moves that overlap."""
        for channel, height in heights.items():
            value = self.values[channel]
            self.move(after_s, 0.62 * duration_s, **{channel: value + height})
            self.move(after_s + 0.38 * duration_s, 0.62 * duration_s, **{channel: value})

    def reach(self, side: str, goal: Goal, after_s: float, duration_s: float, aside_m: float = 0.0) -> None:
        """Bring a hand to a goal."""
        self.grasps[side].append(Grasp(
            goal=goal, start_s=self.now_s + after_s / self.tempo, duration_s=max(duration_s / self.tempo, 0.15), aside_m=aside_m,
        ))  # fmt: skip

    def goal(self, side: str) -> Goal:
        """Where a hand is when all is over."""
        return self.grasps[side][-1].goal if self.grasps[side] else self.starts[side]

    def wait(self, duration_s: float) -> None:
        """Let time pass; moves may run on."""
        self.now_s += duration_s / self.tempo

    def lift(self, height_m: float) -> None:
        """Begin on a floor that is higher."""
        for each in ("z", "left_z", "right_z", "ground"):
            self.values[each] += height_m
            self.first[each] += height_m
        self.place = replace(self.place, floor_m=self.place.floor_m + height_m)

    @property
    def end_s(self) -> float:
        """When the last move ends."""
        ends = [each.start_s + each.duration_s for each in self.moves]
        ends += [each.start_s + each.duration_s for side in SIDES for each in self.grasps[side]]
        return max([self.now_s, *ends])

    def sampled(self, times_s: np.ndarray) -> np.ndarray:
        """Channels (T, C) at times (T,)."""
        found = np.tile([self.first[name] for name in CHANNELS], (len(times_s), 1))
        for each in self.moves:
            found[:, INDEX[each.channel]] += each.change * progress(times_s, each.start_s, each.duration_s, each.skew)
        return found


def progress(times_s: np.ndarray, start_s: float, duration_s: float, skew: float = 1.0) -> np.ndarray:
    """Part (T,) of a move that is done."""
    return minimum_jerk(np.clip((times_s - start_s) / duration_s, 0.0, 1.0) ** skew)
