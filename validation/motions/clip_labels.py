"""Labels of clips by what is measured of them: steady walks, starts, stops, turns, jumps, dances, quiet standing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from t2d_rt.motion.check import check_motion
from t2d_rt.motion.contacts import grown, plant, runs, soles
from t2d_rt.motion.generate.chain import Piece, heading_rad
from t2d_rt.motion.generate.library.individual import STATURE_M, individual, lively
from t2d_rt.motion.generate.library.store import RATE_HZ, Segment
from t2d_rt.motion.kinematics import INDEX, motion_of, retargeted

BALL_M = 0.025
"""Height of the ball's joint over the floor."""
QUIET_MPS = 1.0
"""Mean speed of joints of one who has come to rest between jumps, standing on both feet."""
DANCES = "dance", "stepping dance"
"""Rules of dances."""
LEAST_DANCE_S = 1.0
"""Duration of a dance's shortest stretch: two beats of music."""
PEOPLE = 4
"""People of each kind who must be able to dance it: whatever their proportions and habits, the filter lets it pass."""
DANCE_STEP_S = 0.25
"""Steps in which stretches of a dance are tried."""
STILL_MPS = 0.15
"""Mean speed of joints of one who stands still."""


def labelled(clip: str, piece: Piece, rule: str) -> list[Segment]:
    """Segments of a part by a rule, measured."""
    whole = [(0, len(piece))]
    found: list[Segment] = []
    if rule == "walk":
        found = walks(clip, piece)
    elif rule in ("run", "stealthy"):
        action, activity = ("run", "running") if rule == "run" else ("walk", "walking")
        found = [measured(clip, piece, *each, activity=activity, action=action, kind="steady") for each in whole]
        found = [replace(each, manner="careful" if rule == "stealthy" else "") for each in found]
    elif rule == "jump":
        found = jumps(clip, piece)
    elif rule in ("jacks", "hop"):
        found = [measured(clip, piece, *each, activity="jumping", action="jump", kind=rule) for each in whole]
    elif rule in DANCES:
        found = dances(clip, piece)
    elif rule.startswith("getup"):
        found = [measured(clip, piece, *each, activity="sitting", action="stand_up", kind=rule[6:]) for each in whole]
    found = [each for each in found if each.action not in ("walk", "turn") or believable(each, piece)]
    found = [each for each in found if each.action == "stand_up" or sound(each, piece)]
    if rule not in DANCES:  # dancers wait in poses of their own
        found += stands(clip, piece)
    return [replace(each, name=f"{clip}.{number}") for number, each in enumerate(found)]


def believable(segment: Segment, piece: Piece) -> bool:
    """Whether a walk's feet stand while they should, and it goes where it faces."""
    ahead = segment.kind != "steady" or abs(segment.travel_deg) < 12 or segment.distance_m < 0.5
    return ahead and carried(piece.part(segment.start, segment.stop))


def sound(segment: Segment, piece: Piece, *, quiet: bool = False) -> bool:
    """Whether the filter of generated motions lets the recorded one pass, once its feet are on the floor."""
    part = piece.part(segment.start, segment.stop)
    root = part.poses.root + [0.0, 0.0, BALL_M]
    motion = motion_of(plant(replace(part.poses, root=root), part.planted, floor_m=BALL_M))
    expected = segment.activity if segment.kind in ("", "steady") else None
    verdict = check_motion(motion, expected=expected)  # type: ignore[arg-type]
    if not (verdict.passed or quiet):
        print(f"{segment.clip} {segment.action} {segment.kind}: {verdict}")
    return verdict.passed


def travel(piece: Piece, window_s: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Speed [m/s] and direction [rad] of the pelvis over the floor (T,), means over a step."""
    from scipy.ndimage import uniform_filter1d

    track = uniform_filter1d(piece.poses.root[:, :2], round(window_s * RATE_HZ), axis=0, mode="nearest")
    velocity = np.gradient(track, 1 / RATE_HZ, axis=0)
    return np.linalg.norm(velocity, axis=-1), np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))


def walks(clip: str, piece: Piece) -> list[Segment]:
    """Steady straight stretches, starts and stops, turns."""
    speed, _ = travel(piece)
    heading = heading_rad(piece.poses)
    usual = float(np.median(speed[speed > 0.3])) if (speed > 0.3).any() else 0.0
    if usual == 0.0:
        return []
    from scipy.ndimage import uniform_filter1d

    even = uniform_filter1d(heading, round(1.0 * RATE_HZ), mode="nearest")
    turning = np.abs(np.gradient(even, 1 / RATE_HZ)) > np.radians(12)
    edge = round(0.25 * RATE_HZ)
    steady = (np.abs(speed / usual - 1) < 0.25) & ~turning
    steady[:edge] |= steady[edge : edge + 1]
    steady[-edge:] |= steady[-edge - 1 : -edge]
    found = []
    for start, stop in runs(steady):
        if stop - start >= 1.5 * RATE_HZ:
            found.append(measured(clip, piece, start, stop, activity="walking", action="walk", kind="steady"))
    slow = speed < 0.2
    if slow[:edge].any() and (speed > 0.8 * usual).any():
        going = int(np.argmax(speed > 0.8 * usual))
        stop = min(len(piece), going + round(1.5 * RATE_HZ))
        found.append(measured(clip, piece, 0, stop, activity="walking", action="walk", kind="start"))
    if slow[-edge:].any() and (speed > 0.8 * usual).any():
        going = len(piece) - 1 - int(np.argmax(speed[::-1] > 0.8 * usual))
        found.append(
            measured(
                clip,
                piece,
                max(0, going - round(1.5 * RATE_HZ)),
                len(piece),
                activity="walking",
                action="walk",
                kind="stop",
            )
        )
    for start, stop in runs(turning & (speed > 0.1)):
        turn = np.degrees(even[stop - 1] - even[start])
        if abs(turn) > 30 and stop - start >= 0.5 * RATE_HZ:
            first, last = max(0, start - edge), min(len(piece), stop + edge)
            found.append(measured(clip, piece, first, last, activity="walking", action="turn", kind="turn"))
    return found


def jumps(clip: str, piece: Piece) -> list[Segment]:
    """Single jumps with the crouch before and the recovery after, from standing to standing."""
    points, root = soles(piece.poses)[..., 2].min(axis=2), piece.poses.root[:, 2]
    standing = float(np.percentile(root, 60))
    flights = [
        (a, b)
        for a, b in runs(points.min(axis=1) > 0.05)
        if b - a >= 0.12 * RATE_HZ and root[a:b].max() > standing + 0.06
    ]
    joints, _ = piece.poses.world()
    activity = np.linalg.norm(np.gradient(joints, 1 / RATE_HZ, axis=0), axis=-1).mean(axis=1)
    activity += 10.0 * (root < standing - 0.08) + 10.0 * (points > 0.08).any(axis=1)
    found = []
    for first, last in grouped(flights, activity):
        take_off, landing = flights[first][0], flights[last][1]
        low = flights[first - 1][1] if first else 0
        high = flights[last + 1][0] if last + 1 < len(flights) else len(piece)
        start = quietest(activity, max(low, take_off - round(1.6 * RATE_HZ)), take_off - round(0.1 * RATE_HZ))
        stop = quietest(activity, landing + round(0.1 * RATE_HZ), min(high, landing + round(1.8 * RATE_HZ)))
        if start is None or stop is None or max(activity[start], activity[stop - 1]) > QUIET_MPS:
            continue
        step = root_step(piece, *flights[first])
        kind = "up" if np.linalg.norm(step) < 0.25 else "forward" if step[0] > 0 else "back"
        each = measured(clip, piece, start, stop, activity="jumping", action="jump", kind=kind)
        rise = float(root[take_off:landing].max() - standing)
        found.append(replace(each, rise_m=round(rise, 3), count=last - first + 1))
    return found


def grouped(flights: list[tuple[int, int]], activity: np.ndarray) -> list[tuple[int, int]]:
    """First and last flights of series between which the body does not come to rest."""
    found: list[tuple[int, int]] = []
    for number in range(len(flights)):
        rests = number == 0 or activity[flights[number - 1][1] : flights[number][0]].min() < QUIET_MPS
        if rests or not found:
            found.append((number, number))
        else:
            found[-1] = (found[-1][0], number)
    return found


def dances(clip: str, piece: Piece) -> list[Segment]:
    """A dance as a whole or, where the filter does not let it pass, its longest stretch that passes, whoever dances it."""
    piece = replace(piece, planted=grown(piece.poses, piece.planted))
    danced_by = [piece]
    for number, subject in enumerate(PEOPLE * tuple(STATURE_M)):
        rng = np.random.default_rng(number)
        who = individual(subject, rng)
        danced_by.append(lively(replace(piece, poses=retargeted(piece.poses, who.skeleton)), who, rng))
    first, last = danced(piece)
    length, least = last - first, round(LEAST_DANCE_S * RATE_HZ)
    step = round(DANCE_STEP_S * RATE_HZ)
    while length >= least:
        for start in range(first, last - length + 1, step):
            found = measured(clip, piece, start, start + length, activity="dancing", action="dance")
            if all(sound(found, each, quiet=True) for each in danced_by):
                return [found]
        length -= step
    return []


def danced(piece: Piece) -> tuple[int, int]:
    """The frames of a dance without the steps before and after it, in which the arms hang."""
    joints, _ = piece.poses.world()
    hands = joints[:, [INDEX["left_wrist"], INDEX["right_wrist"]], 2].max(axis=1)
    raised = np.flatnonzero(hands > piece.poses.root[:, 2] + 0.2)
    if len(raised) < RATE_HZ:
        return 0, len(piece)
    edge = round(0.3 * RATE_HZ)
    return max(0, int(raised[0]) - edge), min(len(piece), int(raised[-1]) + edge)


def quietest(activity: np.ndarray, start: int, stop: int) -> int | None:
    """Frame at which the body moves least."""
    return None if stop - start < 3 or start < 0 or stop > len(activity) else start + int(activity[start:stop].argmin())


def root_step(piece: Piece, start: int, stop: int) -> np.ndarray:
    """Step of the pelvis (2,) in the heading at `start`: ahead, to the left."""
    angle = -heading_rad(piece.poses)[start]
    way = piece.poses.root[min(stop, len(piece) - 1), :2] - piece.poses.root[start, :2]
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ way


def stands(clip: str, piece: Piece) -> list[Segment]:
    """Stretches of quiet standing of 0.6 s and more."""
    joints, _ = piece.poses.world()
    speed = np.linalg.norm(np.gradient(joints, 1 / RATE_HZ, axis=0), axis=-1).mean(axis=1)
    upright = piece.poses.root[:, 2] > 0.95 * np.percentile(piece.poses.root[:, 2], 70)
    return [
        measured(clip, piece, start, stop, activity="standing", action="stand")
        for start, stop in runs((speed < STILL_MPS) & upright & piece.planted.any(axis=(1, 2)))
        if stop - start >= 0.6 * RATE_HZ
    ]


def measured(clip: str, piece: Piece, start: int, stop: int, *, activity: str, action: str, kind: str = "") -> Segment:
    """A segment with its speed, turn, cadence and distances."""
    part = piece.part(start, stop)
    root = part.poses.root
    way = root[-1, :2] - root[0, :2]
    distance = float(np.linalg.norm(way))
    heading = heading_rad(part.poses)
    edge = max(1, min(30, len(part) // 4))
    turn = heading[-edge:].mean() - heading[:edge].mean()
    length = float(np.linalg.norm(np.diff(root[:: round(RATE_HZ / 6), :2], axis=0), axis=-1).sum())
    speed = length / ((len(root[:: round(RATE_HZ / 6)]) - 1) * round(RATE_HZ / 6) / RATE_HZ)
    cadence = cadence_hz(part)
    ahead = 0.0
    if distance > 0.5:
        ahead = float(np.degrees(np.angle(np.exp(1j * (np.arctan2(way[1], way[0]) - heading.mean())))))
    return Segment(
        name=clip, clip=clip, start=start, stop=stop, activity=activity, action=action, kind=kind, speed_mps=round(speed, 3),
        turn_deg=round(float(np.degrees(turn)), 1), travel_deg=round(ahead, 1), cadence_hz=round(cadence, 3),
        stride_m=round(2 * speed / cadence, 3) if cadence and action in ("walk", "run") else 0.0, distance_m=round(distance, 3),
    )  # fmt: skip


def cadence_hz(piece: Piece) -> float:
    """Steps per second: how often one ankle passes the other along the heading."""
    joints, _ = piece.poses.world()
    angle = heading_rad(piece.poses)
    apart = joints[:, INDEX["left_ankle"], :2] - joints[:, INDEX["right_ankle"], :2]
    ahead = (apart * np.stack([np.cos(angle), np.sin(angle)], axis=-1)).sum(-1)
    passed = np.flatnonzero(np.diff(np.sign(ahead)) != 0)
    return float((len(passed) - 1) * RATE_HZ / (passed[-1] - passed[0])) if len(passed) > 1 else 0.0


def carried(piece: Piece) -> bool:
    """Whether a walk's feet belong to its track: a foot stands nearly all the time."""
    stands = piece.planted.any(axis=(1, 2))
    inner = [stop - start for start, stop in runs(~stands) if start > 0 and stop < len(stands)]
    return bool(stands.mean() > 0.45) and max(inner, default=0) < 0.4 * RATE_HZ
