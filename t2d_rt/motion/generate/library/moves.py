"""Make walking, running, jumping, dancing, turning and standing from clips, in the manner that a description asks for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.motion import quaternions
from t2d_rt.motion.contacts import plant, runs
from t2d_rt.motion.descriptions.slots import Action, Manner, Step
from t2d_rt.motion.generate import NOT_MADE
from t2d_rt.motion.generate.chain import Piece, from_rotation_vector, joined, moved, swung
from t2d_rt.motion.generate.library import edits
from t2d_rt.motion.generate.library.dances import dance
from t2d_rt.motion.generate.library.edits import best_crossing
from t2d_rt.motion.generate.library.individual import Maker, stand
from t2d_rt.motion.generate.library.store import RATE_HZ, Segment, Store
from t2d_rt.motion.interpolate import low_pass, minimum_jerk
from t2d_rt.motion.kinematics import INDEX
from t2d_rt.motion.vary.arcs import MOST_TWIST_RAD

# --- manners: small changes of posture, swing of the arms and height of steps, beside those of the speed ---


@dataclass(frozen=True, slots=True)
class Change:
    """The changes that a manner or a person's style makes to a piece."""

    tempo: float = 1.0
    stride: float = 1.0
    trunk_deg: float = 0.0
    """Forward lean of the trunk."""
    head_deg: float = 0.0
    """Downward nod of the head."""
    arms: float = 1.0
    """Factor of the arms' swing."""
    elbows_deg: float = 0.0
    """Further bend of the elbows."""
    apart_deg: float = 0.0
    """Angle by which the arms are farther from the body."""
    bounce: float = 1.0
    """Factor of the pelvis's rise and fall."""
    crouch: float = 0.0
    """Lowering of the pelvis over the length of the legs."""


CHANGES: Mapping[Manner, Change] = {
    "careful": Change(0.9, 0.88, trunk_deg=4, head_deg=9, arms=0.6, elbows_deg=12, apart_deg=6, crouch=0.015),
    "happy": Change(1.07, 1.03, trunk_deg=-3, head_deg=-6, arms=1.35, bounce=1.25),
    "angry": Change(1.1, 1.08, trunk_deg=5, head_deg=3, arms=1.3, elbows_deg=15),
    "sad": Change(0.87, 0.88, trunk_deg=6, head_deg=16, arms=0.55, bounce=0.8),
}
"""Sadness: walking slower by a fifth, arms that swing little, a slumped trunk and a bowed head, little bounce (Michalak et al.
2009); anger and joy: faster, larger swing, an erect trunk in joy (Roether, Omlor, Christensen, Giese 2009; Gross, Crane,
Fredrickson 2012). Care: shorter and slower steps, gaze to the floor, as on slippery ground (Cham, Redfern 2002)."""

STRENGTH = 0.6, 1.3
"""Range of the strength of a change in a sample."""

RUN_SWING, WALK_SWING_S_PER_M, SWING_SPREAD = 0.15, 0.155, 0.3
"""Medians of the wrists' swing against the shoulders, over stature, in runs and, by speed [s/m], in walks; standard deviation of
its logarithm. Four recorded runners at 2.5 to 3.5 m/s have 0.09, 0.16, 0.175 and 0.19, the first in six of the eight clips; seven
walkers at 0.9 to 1.6 m/s have 0.10 to 0.27 s/m times their speed."""

SWUNG, ELBOWS_SWUNG = (0.6, 3.0), 1.2
"""Limits of the factor by which arms swing farther for that, and the greatest factor of elbows, which bend to 150 degrees."""

STYLES: Mapping[str, Change] = {
    "run": Change(trunk_deg=3, head_deg=4, arms=SWING_SPREAD, elbows_deg=10, apart_deg=5, bounce=0.12, crouch=0.008),
    "walk": Change(trunk_deg=3, head_deg=5, arms=SWING_SPREAD, elbows_deg=14, apart_deg=6, bounce=0.1, crouch=0.01),
    "jump": Change(trunk_deg=4.5, head_deg=8, arms=0.25, elbows_deg=16, apart_deg=7, bounce=0.0, crouch=0.012),
}
"""Standard deviations of how runners differ at one speed: lean 3 degrees, elbows 10 degrees, rise of the pelvis 12 % (Williams and
Cavanagh 1987; Folland et al. 2017); factors by their logarithms."""

CADENCE_FRACTION = 0.5, 0.12
"""Mean and deviation of the part of a change of speed (as a logarithm) that cadence takes; stride takes the rest."""


def styled(maker: Maker, piece: Piece, step: Step) -> Piece:
    """A run, walk or jump in the style of this person."""
    if step.action not in STYLES:
        return piece
    spread, draw = STYLES[step.action], maker.rng.standard_normal(7).clip(-2, 2)
    change = Change(
        trunk_deg=spread.trunk_deg * draw[0],
        head_deg=spread.head_deg * draw[1],
        arms=float(np.exp(spread.arms * draw[2])),
        elbows_deg=spread.elbows_deg * draw[3],
        apart_deg=spread.apart_deg * abs(draw[4]),
        bounce=float(np.exp(spread.bounce * draw[5])),
        crouch=spread.crouch * abs(draw[6]),
    )
    if step.action != "jump":
        median = RUN_SWING if step.action == "run" else WALK_SWING_S_PER_M * edits.rate_of(piece.poses)
        change = replace(change, arms=float(np.clip(median * change.arms / max(edits.swing_of(piece), 1e-3), *SWUNG)))
    return _changed(piece, step, change, 1.0)


def with_manner(piece: Piece, step: Step, rng: np.random.Generator) -> Piece:
    """The piece in the step's manner."""
    if step.manner is None:
        return piece
    strength = float(rng.uniform(*STRENGTH))
    return _changed(piece, step, CHANGES[step.manner], strength).noted(f"{step.manner} by {strength:.2f}")


def _changed(piece: Piece, step: Step, change: Change, strength: float) -> Piece:
    """The piece with a change of the given strength."""
    travels = step.action in ("walk", "run")
    # A manner has its own pace, unless the description says the speed.
    pace = strength if step.speed == "normal" else 0.0
    piece = (edits.paced if step.action in ("jump", "dance") else edits.tempo)(piece, change.tempo**pace)
    if travels:
        piece = edits.strided(piece, change.stride**pace)
    arms = change.arms**strength
    if step.action in ("dance", "jump"):
        # Arms of dancers and jumpers swing as far as they can; if they swung farther, they would be faster than recorded ones.
        arms = min(arms, 1.0)
    local = piece.poses.local.copy()
    for joint, part in (("spine1", 0.4), ("spine2", 0.3), ("spine3", 0.3)):
        _turned(local, joint, [0.0, np.radians(change.trunk_deg) * strength * part, 0.0])
    for joint in ("neck", "head"):
        _turned(local, joint, [0.0, 0.5 * strength * np.radians(change.head_deg), 0.0])
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for joint in ("shoulder", "elbow"):
            index = INDEX[f"{side}_{joint}"]
            factor = arms if joint == "shoulder" else min(arms, ELBOWS_SWUNG)
            local[:, index] = swung(local[:, index], factor, piece.poses.rate_hz)
        _turned(local, f"{side}_elbow", [0.0, 0.0, -sign * strength * np.radians(change.elbows_deg)])
        _turned(local, f"{side}_shoulder", [sign * strength * np.radians(change.apart_deg), 0.0, 0.0])
    root = piece.poses.root.copy()
    if travels:
        middle = root[:, 2].mean()
        root[:, 2] = middle + (root[:, 2] - middle) * change.bounce**strength
    root[:, 2] -= strength * change.crouch * piece.poses.skeleton.leg_m
    return piece.posed(root=root, local=local)


def _turned(local: np.ndarray, joint: str, vector: list[float] | np.ndarray) -> None:
    index = INDEX[joint]
    local[:, index] = quaternions.multiply(local[:, index], from_rotation_vector(np.array(vector)))


# --- walking, running, jumping, dancing, turning and standing from clips: one piece for a step of a description ---


SPEEDS_MPS: Mapping[tuple[str, str], tuple[float, float]] = {
    ("walk", "slow"): (0.80, 0.10), ("walk", "normal"): (1.27, 0.11), ("walk", "fast"): (1.75, 0.13),
    ("run", "slow"): (2.45, 0.2), ("run", "normal"): (3.0, 0.25), ("run", "fast"): (3.7, 0.3),
}  # fmt: skip
"""Mean and standard deviation of speeds over the floor of an adult with legs of 0.86 m; comfortable walking of men and women
1.27 to 1.46 m/s, fast 1.7 to 2.5 (Bohannon 1997). Other legs: times sqrt(leg / 0.86 m), equal Froude numbers (Alexander 1989)."""

LEG_M = 0.86

DURATION_S: Mapping[Action, tuple[float, float]] = {
    "walk": (4.0, 7.0),
    "run": (3.0, 5.0),
    "dance": (6.0, 9.0),
    "stand": (1.5, 3.0),
    "jump": (2.5, 7.0),
}
"""Range of durations [s] if none is given; a step beside others has half of it."""

JOGS, SLOWEST_STEPS_HZ = 0.6, 1.4
"""Chance that a runner has a walker's trunk and arms, and steps per second of the slowest walk."""

WALKERS_TRUNK, WALKERS_ARMS = (0.4, 1.0), (0.3, 0.8)
"""Ranges of how much of a walker's trunk and arms a run takes over, from none (0) to all (1)."""

WARP = 0.72, 1.38
"""Limits of the factor by which a clip's speed is changed, on average half of it (as a logarithm) by tempo and half by stride, as
people do: step length over cadence stays constant (Sekiya, Nagasaki 1998)."""

MOST_QUICKENED = 1.6
"""Factor by which the steps of a turn on the spot come faster than those of a slow walk: 120 a minute for 75."""

APART_RAD = 0.065
"""Angle by which each leg is held apart in a turn on the spot, 6 cm at the ankle: chosen so that feet pass each other while
one stays behind the turning body."""

SHORTEST_FLIGHT_S = 0.1
"""Shortest flight of a jump; a step of a run takes as long, and jumping jacks 0.25 s."""

LANDING_S = 0.5
"""Time after a flight in which the knees give and straighten again."""

LATE_S, LATE_OF_LASTING_S = 1.6, 0.8
"""Longest time by which a person stands longer before the first jump, and before jumps that are to last for a given time."""

LIFTED_S = 0.4
"""Time in which the free leg is drawn up before hopping, or put down after it."""

QUIET_S = 0.8
"""Time of standing before and after a turn on the spot."""

ROUND_M = 0.05, 0.14
"""Range of the radius of the circle that the hips go round in a turn on the spot, as feet are set down beside each other."""

MOST_SLOWED = 2.5
"""Greatest factor by which a turn with a given duration is slower than one at ease; the rest of the time is spent standing."""

TRAVEL_HZ = 0.4
"""Frequency below which hips travel, and above which they sway with the steps (0.7 to 1.5 strides a second)."""

STEP_S = 1.2
"""Time in which a foot is lifted and stands again."""

KNEES_RISE_DEG = 0.0, 20.0
"""Range of the angle by which a thigh is raised higher in the middle of a step on the spot than in walking."""

SENSES: Mapping[str | None, float] = {"left": 1.0, "right": -1.0, "counterclockwise": 1.0, "clockwise": -1.0}
"""Sign of the change of heading in each direction that has a sense of rotation, left positive."""

TURNS_DEG: Mapping[str | None, float] = {"back": 180.0, "clockwise": 360.0, "counterclockwise": 360.0}
"""Angles of turns; others are of 90 degrees."""


def made_of_clips(maker: Maker, step: Step, *, alone: bool = True) -> Piece:
    """The piece that a step asks for; with `alone` it is all of its description, and so may last longer.

    Raises an InputError if the library has no clips of its action.
    """
    clips = own_clips(maker.store, step)
    if step.action not in ACTIONS and not clips:
        raise InputError(f"the library has no clips of {step.action}; it makes {', '.join(ACTIONS)}")
    low, high = DURATION_S.get(step.action, (2.0, 4.0))
    duration_s = step.duration_s or float(maker.rng.uniform(low, high)) * (1.0 if alone else 0.5)
    piece = _as_recorded(maker, step, clips) if clips else ACTIONS[step.action](maker, step, duration_s)
    return with_manner(piece, step, maker.rng)


def own_clips(store: Store, step: Step) -> list[Segment]:
    """A user's clips that show just what a step asks for: an action of which no clip ships, or one in the step's direction."""
    clips = [segment for segment in store.segments if segment.clip in store.own and segment.action == step.action]
    if step.action in ACTIONS:
        return [segment for segment in clips if segment.direction and segment.direction == step.direction]
    return [segment for segment in clips if segment.direction == step.direction] or clips


def _as_recorded(maker: Maker, step: Step, segments: list[Segment]) -> Piece:
    """A clip as it is, at the pace of the step's speed, or at that of its duration."""
    # The mirror image of a clip with a sense of rotation would show the other sense.
    piece = maker.piece(maker.draw(segments), mirror=False if step.direction in SENSES else None)
    pace = {"slow": 0.85, "normal": 1.0, "fast": 1.15}[step.speed] * maker.person.tempo
    if step.duration_s is not None:
        pace = float(np.clip(len(piece) / RATE_HZ / step.duration_s, *WARP))
    return edits.tempo(piece, pace)


def gait(maker: Maker, step: Step, duration_s: float) -> Piece:
    """Walking or running: a clip of about the speed, warped to it, going on in others of the same speed at the same phase."""
    if step.direction == "in_place":
        return _in_place(maker, step, duration_s)
    mean, spread = SPEEDS_MPS[step.action, step.speed]
    leg_factor = float(np.sqrt(maker.person.skeleton.leg_m / LEG_M))
    drawn_mps = float(np.clip(maker.rng.normal(mean, spread), mean - 2 * spread, mean + 2 * spread))
    target_mps = leg_factor * drawn_mps * maker.person.tempo
    if step.direction == "back":
        target_mps *= 0.75  # people walk backward at about 0.7 to 0.8 of their pace (Thorstensson 1986)
    first = _first_clip(maker, step, target_mps)
    mirror = bool(maker.rng.random() < 0.5)
    whole = maker.piece(first, mirror=mirror)
    factor = float(np.clip(target_mps / max(edits.rate_of(whole.poses), 0.1), *WARP))
    fraction = CADENCE_FRACTION[0] + CADENCE_FRACTION[1] * float(np.clip(maker.rng.standard_normal(), -2, 2))
    count = round(duration_s * RATE_HZ * factor**fraction) + 1
    others = _alike(maker, first) if step.action == "walk" else [first]  # runs are few, and one would be in every third
    begin = int(maker.rng.integers(0, max(1, len(whole) - count + 1))) if len(whole) > count else 0
    whole = whole.part(begin, len(whole))
    while len(whole) < count:
        candidates = dict.fromkeys([maker.draw(others), maker.draw(others), first])
        seams = [best_crossing(whole, maker.piece(segment, mirror=mirror)) for segment in candidates]
        whole = min(seams, key=attrgetter("apart_m")).joined()
    whole = whole.part(0, count)
    whole = _jogging(maker, whole) if step.action == "run" else whole
    whole = edits.strided(edits.tempo(whole, factor**fraction), factor ** (1 - fraction))
    whole = styled(maker, whole, step)
    whole = whole.noted(f"speed {factor:.2f} times the clips', {edits.rate_of(whole.poses):.2f} m/s")
    return directed(maker, whole, step)


def _in_place(maker: Maker, step: Step, duration_s: float) -> Piece:
    """A walk or run without its travel; in a walk the thighs are raised more. It is made longer and then cut, because a first and a
    last step that are not whole would reach ahead and behind."""
    whole = gait(maker, step.model_copy(update={"direction": None}), duration_s + 2 * STEP_S)
    travel = low_pass(whole.poses.root[:, :2], TRAVEL_HZ, RATE_HZ)
    whole = edits.shifted(whole, np.pad(travel[0] - travel, ((0, 0), (0, 1)))).noted("on the spot")
    rise = float(np.radians(maker.rng.uniform(*KNEES_RISE_DEG))) if step.action == "walk" else 0.0
    local = whole.poses.local.copy()
    for number, side in enumerate(edits.SIDES):
        lifted = np.zeros((len(whole), 1))
        for start, stop in runs(np.asarray(~whole.planted[:, number].any(axis=1))):
            lifted[start:stop, 0] = np.sin(np.pi * np.arange(1, stop - start + 1) / (stop - start + 1)) ** 2
        for joint, part in (("hip", -rise), ("knee", rise)):
            _turned(local, f"{side}_{joint}", part * lifted * [0.0, 1.0, 0.0])
    whole = replace(whole, poses=plant(replace(whole.poses, local=local), whole.planted, floor_m=0.0))
    first = round(STEP_S * RATE_HZ)
    return whole.part(first, min(first + round(duration_s * RATE_HZ) + 1, len(whole)))


def _jogging(maker: Maker, legs: Piece) -> Piece:
    """Recorded runners' legs and pelvis with a part of a walker's trunk and arms, because few runs are recorded but many walks."""
    if maker.rng.random() >= JOGS:
        return legs
    lasting_s = (len(edits.passes(legs)) + 4) / SLOWEST_STEPS_HZ
    walk = gait(maker, Step(action="walk", speed="normal" if maker.rng.random() < 0.5 else "fast"), lasting_s)
    trunk, arms = maker.rng.uniform(*WALKERS_TRUNK), maker.rng.uniform(*WALKERS_ARMS)
    return edits.carrying(legs, walk, trunk=float(trunk), arms=float(arms))


def _first_clip(maker: Maker, step: Step, target_mps: float) -> Segment:
    """A clip whose speed on the person's legs is near the wanted one."""
    segments = [clip for clip in maker.segments(step.action, "steady") if clip.direction in ("", "forward", "straight")]
    if step.action == "walk":
        manner_clips = [clip for clip in segments if step.manner and clip.manner == step.manner]
        neutral = [clip for clip in segments if not clip.manner]
        segments = manner_clips if manner_clips and maker.rng.random() < 0.4 else neutral
    scaled = np.array([clip.speed_mps for clip in segments]) * np.sqrt(maker.person.skeleton.leg_m / LEG_M)
    misfit = np.log(np.maximum(scaled, 0.05) / target_mps)
    # A clip is half as likely at 12 % off the speed, a run (of which there are few) at 35 %; the nearest one is always possible.
    width = 0.1 if step.action == "walk" else 0.3
    weights = np.exp(-((np.abs(misfit) - np.abs(misfit).min()) ** 2) / (2 * width**2))
    return maker.draw(segments, list(weights))


def _alike(maker: Maker, first: Segment) -> list[Segment]:
    """Clips of the same subject at a like speed, the clip itself among them."""
    sources = maker.store.sources
    same = sources[first.clip].subject, first.manner, first.direction
    return [
        segment
        for segment in maker.segments(first.action, "steady")
        if segment.name == first.name
        or (
            abs(segment.speed_mps / first.speed_mps - 1) < 0.1
            and (sources[segment.clip].subject, segment.manner, segment.direction) == same
        )
    ]


def directed(maker: Maker, piece: Piece, step: Step) -> Piece:
    """A straight walk or run as the direction says: backward, bent left or right by a quarter turn, or round in a circle."""
    if step.direction == "back":
        piece = edits.backwards(piece)
        return moved(piece, 0.0, piece.poses.root[0, :2], np.zeros(2))
    if step.direction not in SENSES:
        return piece
    sign = SENSES[step.direction]
    duration_s = len(piece) / RATE_HZ
    fraction = np.linspace(0, 1, len(piece))
    if step.direction in ("left", "right"):
        angle = np.radians(maker.rng.uniform(70, 100))
        within = min(0.6, (1.6 if step.action == "walk" else 1.1) / duration_s)
        start = float(maker.rng.uniform(0.15, max(0.16, 0.85 - within)))
        profile = angle * minimum_jerk((fraction - start) / within)
        note = f"bent {'left' if sign > 0 else 'right'} by {np.degrees(angle):.0f} degrees"
    else:
        # At walking pace people round circles of 0.7 to 1.5 m; faster than 60 degrees a second they would have to lean.
        radius_m = maker.rng.uniform(0.9, 1.6) * max(1.0, edits.rate_of(piece.poses) / 1.2) ** 2
        profile = edits.rate_of(piece.poses) / radius_m * fraction * duration_s
        note = f"bent to a circle of {radius_m:.1f} m"
    return edits.bent(piece, sign * profile).noted(note)


def _sense(maker: Maker, step: Step) -> float:
    """Sign of a turn's angle, 1 to the left: drawn if the step says no direction; a turn back goes to the left."""
    return SENSES.get(step.direction, 1.0) if step.direction else float(maker.rng.choice([-1, 1]))


def angle_deg(step: Step) -> float:
    """Angle of a turn [degrees]: the one that the step says, or that of its direction."""
    return step.angle_deg or TURNS_DEG.get(step.direction, 90.0)


def turn(maker: Maker, step: Step, _: float) -> Piece:
    """Turning on the spot in small steps, from standing to standing: a slow walk whose heading is turned and whose steps are so
    short that it goes round a circle of `ROUND_M`. Its duration follows from the angle, or, if only the duration is said, the angle
    from the duration."""
    sign = _sense(maker, step)
    rate = {"slow": 55.0, "normal": 85.0, "fast": 120.0}[step.speed] * maker.person.tempo
    angle = np.radians(angle_deg(step))
    if step.duration_s is not None and step.angle_deg is None and step.direction != "back":
        angle = max(angle, np.radians(rate * (step.duration_s - 2 * QUIET_S - 0.9)))
    at_ease_s = float(np.degrees(angle)) / rate + 0.9
    turn_s = float(np.clip((step.duration_s or 0.0) - 2 * QUIET_S, at_ease_s, MOST_SLOWED * at_ease_s))
    quiet_s = QUIET_S if step.duration_s is None else max((step.duration_s - turn_s) / 2, 0.3)
    walk = quickened(gait(maker, Step(action="walk", speed="slow"), MOST_QUICKENED * turn_s), float(angle), turn_s)
    heading = angle * minimum_jerk((np.linspace(0, 1, len(walk)) - 0.1) / 0.8)
    pace_mps = maker.rng.uniform(*ROUND_M) * np.gradient(heading) * RATE_HZ
    short = edits.straddled(edits.strided(walk, pace_mps / max(edits.rate_of(walk.poses), 0.1)), APART_RAD)
    turned = edits.bent(short, sign * heading)
    turned = turned.noted(f"turned {'left' if sign > 0 else 'right'} by {np.degrees(angle):.0f} degrees")
    quiet = stand(maker, Step(action="stand"), quiet_s)
    return joined([quiet, turned, stand(maker, Step(action="stand"), quiet_s)], blend_s=0.5)


def quickened(walk: Piece, angle_rad: float, lasting_s: float) -> Piece:
    """The part of a walk that lasts `lasting_s`, with steps so quick, up to `MOST_QUICKENED` times, that a body which turns by an
    angle meanwhile turns no farther over a standing foot than hips do."""
    stands = [stop - start for side in range(2) for start, stop in runs(np.asarray(walk.planted[:, side].any(axis=1)))]
    stance_s = float(np.median(stands)) / RATE_HZ if stands else 0.0
    fastest = 1.875 / 0.8 * angle_rad / lasting_s  # of a minimum-jerk turn in the middle 80 % of the time
    factor = float(np.clip(fastest * stance_s / (2 * MOST_TWIST_RAD), 1.0, MOST_QUICKENED))
    return edits.tempo(walk.part(0, round(factor * lasting_s * RATE_HZ) + 1), factor)


def jump(maker: Maker, step: Step, duration_s: float) -> Piece:
    """Jumps one after another: forward, up, on one leg, or jumping jacks; as many as are asked for, or for as long.

    If both are given, the duration counts: quick jumps are taken, and a note tells how many fit.
    """
    kinds = _kinds(maker, step)
    segments = maker.segments("jump", *kinds)
    pace = {"slow": 0.85, "normal": 1.0, "fast": 1.05}[step.speed] * maker.person.tempo
    if step.count is not None and step.duration_s is not None:
        # Only recordings whose jumps follow so quickly, with time for one more to stand in, or else the quickest.
        jump_s = {segment.name: segment.duration_s / max(segment.count, 1) for segment in segments}
        most_s = max(pace * step.duration_s / (step.count + 1), min(jump_s.values()))
        segments = [segment for segment in segments if jump_s[segment.name] <= most_s]
    # Quick jumps are mostly those that follow one another, slow jumps those with standing and balancing around them.
    often = {"slow": -1.0, "normal": 0.0, "fast": 1.0}[step.speed]
    chances = [(max(segment.count, 1) / segment.duration_s) ** often for segment in segments]
    pieces: list[Piece] = []
    done, total_s = 0, 0.0
    first = maker.draw(segments, chances)  # a person jumps in one way throughout
    same_clip = [segment for segment in segments if segment.clip == first.clip]
    while not _enough(step, done, total_s, duration_s):
        piece = maker.piece(maker.draw(same_clip) if pieces else first)
        piece = edits.paced(piece, pace * float(np.exp(0.06 * maker.rng.standard_normal())))
        if step.count is not None:
            piece = _with_flights(piece, step.count - done)
        if not pieces:
            late_s = LATE_S if step.duration_s is None else LATE_OF_LASTING_S
            piece = _begun_late(maker, piece, first.clip, late_s)
        piece = _thrown(maker, piece, step)
        pieces.append(piece)
        done += len(flights(piece))
        total_s += len(piece) / RATE_HZ
    whole = joined(pieces)
    if step.duration_s is not None:
        whole = _until(maker, whole, step.duration_s, first.clip)
        fit = len(flights(whole))
        if fit < (step.count or 0):
            whole = whole.noted(f"{NOT_MADE}count {step.count} of jump ({fit} within {step.duration_s:g} s)")
    whole = styled(maker, whole, step) if "jacks" not in kinds else whole
    return _on_one_leg(maker, whole, step.side) if step.body_part in ("foot", "leg") else whole


def _kinds(maker: Maker, step: Step) -> tuple[str, ...]:
    """Kinds of the recorded jumps that show what a step asks for."""
    ahead = step.direction in ("forward", "straight", None)
    if step.body_part in ("foot", "leg") and ahead and any(segment.kind == "hop" for segment in maker.store.segments):
        return ("hop",) if step.direction is None else ("hop", "forward")
    if step.body_part in ("arm", "hand") and step.direction is None:
        return ("jacks",)
    if step.direction in ("clockwise", "counterclockwise", None):  # which way is left open
        return ("forward", "up")
    return ("forward",) if ahead else ("up",)


def _enough(step: Step, done: int, total_s: float, duration_s: float) -> bool:
    if step.count is not None:
        return done >= step.count
    return total_s >= (duration_s if step.duration_s is not None else 0.75 * duration_s)


def flights(piece: Piece) -> list[tuple[int, int]]:
    """First frame, and the one after the last, of each time of `SHORTEST_FLIGHT_S` or longer in which neither foot stands."""
    air = np.asarray(~piece.planted.any(axis=(1, 2)))
    return [(start, stop) for start, stop in runs(air) if stop - start >= SHORTEST_FLIGHT_S * RATE_HZ]


def _with_flights(piece: Piece, most: int) -> Piece:
    """A piece up to the middle of the contact after the given number of flights."""
    spans = flights(piece)
    if len(spans) <= most:
        return piece
    return piece.part(0, (spans[most - 1][1] + spans[most][0]) // 2)


def _until(maker: Maker, piece: Piece, duration_s: float, clip: str) -> Piece:
    """Jumps of the given duration: up to the last landing before its end, and then standing."""
    count = round(duration_s * RATE_HZ) + 1
    landed = [stop for _, stop in flights(piece) if stop + LANDING_S * RATE_HZ < count]
    if not landed:
        return piece.part(0, count)
    jump_frames = min(len(piece), landed[-1] + round(LANDING_S * RATE_HZ))
    if jump_frames >= count:
        return piece.part(0, count)
    quiet = stand(maker, Step(action="stand"), (count - jump_frames) / RATE_HZ, clip=clip)
    return joined([piece.part(0, jump_frames), quiet], blend_s=0.5).part(0, count)


def _on_one_leg(maker: Maker, piece: Piece, side: str | None) -> Piece:
    """Jumps of both legs with one of them drawn up from beginning to end, so that they are done on the `side` leg."""
    stands = side or str(maker.rng.choice(["left", "right"]))
    free = "right" if stands == "left" else "left"
    frames = np.arange(len(piece))
    ramp = LIFTED_S * RATE_HZ
    weight = minimum_jerk(np.clip(np.minimum(frames, frames[::-1]) / ramp, 0.0, 1.0))[:, None]
    local = piece.poses.local.copy()
    for joint, degrees in (("hip", -40.0), ("knee", 105.0)):
        number = INDEX[f"{free}_{joint}"]
        up = quaternions.about_axis(np.array([0.0, 1.0, 0.0]), np.full(len(piece), np.radians(degrees)))
        local[:, number] = quaternions.blend(local[:, number], up, weight)
    planted = piece.planted.copy()
    planted[weight[:, 0] > 0, int(free == "right")] = False
    return replace(piece, poses=replace(piece.poses, local=local), planted=planted).noted(f"on the {stands} leg")


def _begun_late(maker: Maker, piece: Piece, clip: str, more_s: float) -> Piece:
    """A jump with less of the standing before it, or with up to `more_s` more of it."""
    lifted = np.flatnonzero(~piece.planted.any(axis=(1, 2)))
    most = int(lifted[0]) // 2 if len(lifted) else 0
    change = int(maker.rng.integers(-round(more_s * RATE_HZ), most + 1))
    if change >= 0:
        return piece.part(change, len(piece))
    quiet = stand(maker, Step(action="stand"), -change / RATE_HZ, clip=clip)
    return joined([quiet, piece], blend_s=0.6)


def _thrown(maker: Maker, piece: Piece, step: Step) -> Piece:
    """A jump moved back or aside, or turned, while it is in the air; forward jumps become shorter or longer than recorded ones."""
    if step.direction in ("forward", "straight", None):
        return edits.strided(piece, float(maker.rng.uniform(0.7, 1.3)))
    if step.direction not in ("back", "left", "right", "clockwise", "counterclockwise"):
        return piece
    air = np.asarray(~piece.planted.any(axis=(1, 2)))
    top = int(piece.poses.root[:, 2].argmax())
    low, high = top, top
    while low > 1 and air[low - 1]:
        low -= 1
    while high < len(piece) - 2 and air[high + 1]:
        high += 1
    profile = minimum_jerk((np.arange(len(piece)) - low) / max(high - low, 1))
    if step.direction in ("clockwise", "counterclockwise"):
        return edits.bent(piece, SENSES[step.direction] * np.pi / 2 * profile).noted("turned in the air")
    angle = {"back": np.pi, "left": np.pi / 2, "right": -np.pi / 2}[step.direction]
    distance_m = maker.rng.uniform(0.3, 0.6) * maker.person.skeleton.leg_m
    carried = distance_m * np.array([np.cos(angle), np.sin(angle), 0.0])
    return edits.shifted(piece, profile[:, None] * carried).noted(f"carried {distance_m:.2f} m {step.direction}")


ACTIONS: Mapping[Action, Callable[[Maker, Step, float], Piece]] = {
    "walk": gait,
    "run": gait,
    "turn": turn,
    "stand": stand,
    "jump": jump,
    "dance": dance,
}
"""The function that makes each action."""
