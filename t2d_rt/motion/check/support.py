"""What carries the body: feet that are planted and how far they slide, the floor and how deep the body sinks into it, flight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.motion.check.tracks import GRAVITY_MPS2, RATE_HZ, Tracks, rate_of, spans

FOOT_POINTS = "ankle", "foot", "toe"

RADII = {
    "pelvis": 0.03, "hip": 0.03, "spine1": 0.015, "spine2": 0.015, "spine3": 0.015, "collar": 0.015, "shoulder": 0.015,
    "neck": 0.015, "head": 0.025, "knee": 0.012, "elbow": 0.005, "wrist": 0.003, "hand": 0.0, "head_top": 0.0, "ankle": 0.0,
    "foot": 0.0, "toe": 0.0,
}  # fmt: skip
"""Distance of a joint from the skin over stature, less 2 to 3 cm by which files place joints differently: a joint nearer to the
floor has the body in the floor. Ankles, balls and toes stand where the file has them: readers put the floor under the lowest."""

PLANTED_MPS = 0.45
"""A foot whose slowest point is slower is planted; in swing none of its points is."""

NEAR = 0.035
"""Height over stature above the lowest foot, each point from its own lowest level, up to which a foot shares in carrying the
body."""

LEAST_CONTACT_S, EDGE = 0.12, 0.2
"""Shortest contact that counts, and the fraction left out at both its ends: a foot that lands or leaves moves."""

AIRBORNE = 0.035
"""Height of the lowest point over stature from which the body is off the floor."""

ON_FLOOR = 0.15
"""Height of the hips over stature of one who sits or lies on the floor; in the deepest squat they are at 0.17."""

SEATED_THIGH, SEATED_SPEED_MPS = 0.6, 0.25
"""Greatest drop of the knee below the hip, over the thigh's length, of one who sits, and how slowly the hips move."""


@dataclass(frozen=True, slots=True)
class Contact:
    """One foot on the ground."""

    side: str
    start: int
    stop: int
    """Frames at `RATE_HZ`, the last not included."""
    place: np.ndarray
    """Of the foot's ball (3,) [m], median."""
    skate_m: float
    """Extent of the track of ankle, ball or toe, that of them that rests best, over the middle 60 % of the contact."""


@dataclass(frozen=True, slots=True)
class Feet:
    """Points of both feet, (T, P, ...)."""

    sides: tuple[str, ...]
    """Of each point."""
    heights: np.ndarray
    """Above each point's own lowest level [m], (T, P)."""
    velocity: np.ndarray
    """[m/s], (T, P, 3)."""


def feet_of(body: Tracks) -> Feet:
    """Ankles, balls and, where known, toes."""
    points = [(name.split("_")[0], name) for name in feet_names(body)]
    index = [body.names.index(name) for _, name in points]
    heights = body.joints[:, index, 2]
    # A foot of the other side has the same build: a foot that never comes down has its level from there.
    level = np.percentile(heights, 5, axis=0)
    lowest = {name.split("_")[1]: np.inf for _, name in points}
    for (_, name), value in zip(points, level, strict=True):
        lowest[name.split("_")[1]] = min(lowest[name.split("_")[1]], value)
    level = np.minimum(level, [lowest[name.split("_")[1]] + 0.02 * body.stature_m for _, name in points])
    return Feet(
        tuple(side for side, _ in points), heights - level, body.velocity[:, index]
    )  # fmt: skip


def airborne(body: Tracks) -> np.ndarray:
    """Where no part of the body is at the floor, no foot is planted at any height and nobody sits, (T,)."""
    lowest = clearance(body).min(axis=1)
    feet = feet_of(body)
    slow = np.linalg.norm(feet.velocity, axis=-1) < PLANTED_MPS
    # Planted on a step: slow for a while. At the top of a jump the feet are slow for 0.1 s at most.
    planted = np.zeros(len(lowest), bool)
    for point in range(slow.shape[1]):
        for start, stop in spans(slow[:, point], least=round(0.15 * RATE_HZ)):
            planted[start:stop] = True
    return (lowest > AIRBORNE * body.stature_m) & ~planted & ~seated(body)


def seated(body: Tracks) -> np.ndarray:
    """Where thighs are level or higher and the hips slow: something else than the feet carries the body, (T,)."""
    drop = (body["hips"] - body["knees"])[:, 2] / (0.5 * body.leg_m)
    speed = np.linalg.norm(rate_of(body["hips"]), axis=-1)
    return (drop < SEATED_THIGH) & (speed < SEATED_SPEED_MPS)


def clearance(body: Tracks) -> np.ndarray:
    """Height of the skin at each joint over the floor [m], (T, J)."""
    radii = [RADII[name.removeprefix("left_").removeprefix("right_")] for name in body.names]
    return body.joints[..., 2] - np.array(radii) * body.stature_m


def penetration_m(body: Tracks) -> float:
    """Deepest that the body sinks into the floor for two frames or more [m]."""
    depth = -clearance(body).min(axis=1)
    return max(0.0, float(np.minimum(depth[1:], depth[:-1]).max()))


def floor_offset_m(contacts: list[Contact]) -> float:
    """Height of the lowest planted foot over the floor [m]; 0 where none is planted."""
    return min((float(each.place[2]) for each in contacts), default=0.0)


def floating_s(body: Tracks) -> float:
    """Longest excess of a flight over what its own rise and fall allow [s].

    A body that rises by u to the top of its flight and falls by d from there flies for sqrt(2 u / g) + sqrt(2 d / g).
    """
    return _excess_s(body, airborne(body))


def flights_s(body: Tracks) -> list[tuple[float, float, float]]:
    """Flights of 0.05 s or more: start [s], duration [s], rise of the centre of mass from take-off [m]."""
    height = body.centre_of_mass[:, 2]
    return [
        (start / RATE_HZ, (stop - start) / RATE_HZ, float(height[start:stop].max() - height[start]))
        for start, stop in spans(airborne(body), gap=2, least=3)
    ]


def contacts(body: Tracks) -> list[Contact]:
    """Times at which a foot is planted, in order of their begin."""
    feet = feet_of(body)
    lowest = feet.heights.min(axis=1)
    # The feet of one who sits or lies carry little and may be drawn over the floor.
    free = ~airborne(body) & ~seated(body) & (body["hips"][:, 2] > ON_FLOOR * body.stature_m)
    found = []
    for side in ("left", "right"):
        own = [point for point, each in enumerate(feet.sides) if each == side]
        speed = np.linalg.norm(feet.velocity[:, own], axis=-1)
        carrying = feet.heights[:, own].min(axis=1) - lowest < NEAR * body.stature_m
        active = (speed.min(axis=1) < PLANTED_MPS) & carrying & free
        for start, stop in spans(active, gap=3, least=round(LEAST_CONTACT_S * RATE_HZ)):
            found.append(_contact(body, side, start, stop))
    return sorted(found, key=lambda each: each.start)


def _contact(body: Tracks, side: str, start: int, stop: int) -> Contact:
    edge = round(EDGE * (stop - start))
    middle = slice(start + edge, stop - edge)
    names = [name for name in feet_names(body) if name.startswith(side)]
    # A foot rolls: while its ankle passes over, its ball rests, or its toe does.
    skate = [_extent_m(body[name][middle, :2]) for name in names]
    place = np.median(body[f"{side}_foot"][middle], axis=0)
    level = float(np.median(np.min([body[name][middle, 2] for name in names], axis=0)))
    return Contact(side, start, stop, np.array([place[0], place[1], level]), min(skate))


def _extent_m(track: np.ndarray) -> float:
    """Twice the greatest distance from the middle of what a track (T, 2) covers."""
    middle = 0.5 * (track.min(axis=0) + track.max(axis=0))
    return 2 * float(np.linalg.norm(track - middle, axis=-1).max())


def feet_names(body: Tracks) -> list[str]:
    """Ankles, balls and, where known, toes."""
    names = [f"{side}_{point}" for side in ("left", "right") for point in FOOT_POINTS]
    return [name for name in names if name in body.names]


def sliding_s(body: Tracks) -> float:
    """Longest time in which nothing that could carry the body rests, beyond what its flight allows [s].

    It tells feet that slide over the floor, and bodies that are carried by nothing.
    """
    speed = np.linalg.norm(body.velocity, axis=-1)
    near = clearance(body) < NEAR * body.stature_m
    near[:, [body.names.index(name) for name in feet_names(body)]] = True
    resting = (near & (speed < PLANTED_MPS)).any(axis=1) | seated(body)
    return _excess_s(body, ~resting)


def _excess_s(body: Tracks, free: np.ndarray) -> float:
    """Longest excess of the spans in which the body is free over a flight with the same rise and fall [s]."""
    height = body.centre_of_mass[:, 2]
    excess = 0.0
    for start, stop in spans(free, gap=2, least=3):
        first, last = max(start - 1, 0), min(stop, len(height) - 1)
        top = height[first : last + 1].max()
        allowed = sum(np.sqrt(2 * (top - height[end]) / GRAVITY_MPS2) for end in (first, last))
        excess = max(excess, (last - first) / RATE_HZ - float(allowed))
    return excess
