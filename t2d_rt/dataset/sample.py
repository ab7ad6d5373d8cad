"""One sample of a recipe, as a pure function of the recipe and its index: its motion, its place before the radar, and interferers.

The motion is made, varied, cut or held to the length of the records, and judged by the filter. Its place (distance, angle and
offset) is drawn such that there is room in the scene. Interferers are fans, curtains, pets and second persons at random places.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from t2d_rt.core.checks import integer
from t2d_rt.core.constants import STANDARD_GRAVITY
from t2d_rt.core.errors import T2DError
from t2d_rt.dataset.recipe import OWN_BODY, Beside, Condition, Recipe, Side, integer_seed
from t2d_rt.dataset.subjects import subject_of
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.sources import MotionText
from t2d_rt.motion import place
from t2d_rt.motion.carry import carry
from t2d_rt.motion.check import check_motion, passes
from t2d_rt.motion.descriptions.grammar import grammar_descriptions
from t2d_rt.motion.descriptions.slots import Activity, Description
from t2d_rt.motion.generate import COMPOSED
from t2d_rt.motion.generate.library.individual import drawn_person
from t2d_rt.pipeline.targets import things
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.scene import Curtain, Mover, Pet, TableFan
from t2d_rt.scene.things import outline
from t2d_rt.types import Motion, Radar

LASTING: frozenset[Activity] = frozenset({"walking", "abnormal_walking", "running", "dancing"})
"""Classes whose main action can last as long as asked for; it is made as long as a record."""
STEP_S = 0.25
"""Time between the starts of the pieces of a motion that are compared [s]."""
MOVING_MPS = 0.08
"""Mean speed of the joints above which a person counts as moving [m/s]; people who stand sway at 0.01 to 0.07 m/s."""
GOING: frozenset[str] = frozenset({"walk", "run", "dance", "jump", "turn", "climb"})
"""Actions after which a person comes to a stop: holding a pose in the middle of them would be no rest."""
REACH_M = 2.0
"""Greatest distance of the pelvis from its mean position [m]; longer paths are bent to arcs."""
RADII_M = 6.0, 4.5, 3.5, 2.8, 2.3, 1.9, 1.6, 1.3, 1.0
"""Radii of the arcs that are tried [m]."""
MOST_LEAN_DEG = 25.0
"""Greatest lean into a curve [deg]: that of 3 m/s on a circle of 2 m radius."""


@dataclass(frozen=True, slots=True)
class SampleMotion:
    """The motion of a sample, and how it was made."""

    source: MotionText
    motion: Motion
    """The motion, cut or held to its length, not yet placed."""
    passed: bool
    """Whether the filter accepts it as one of its class."""
    reasons: tuple[str, ...]
    attempts: int
    made_s: float
    """Duration of the motion as it was made, before it was cut or held [s]."""
    origin: tuple[str, ...] = field(default=())
    """Sentence, person, clips and edits from which it was made."""


@functools.lru_cache(maxsize=64)
def descriptions(activity: Activity, count: int, seed: int) -> tuple[Description, ...]:
    """The descriptions of a class, in order."""
    return tuple(grammar_descriptions(activity, count, seed=seed))


@functools.lru_cache(maxsize=16)
def sample_motion(
    recipe: Recipe, activity: Activity, description: int, number: int, conditions: tuple[Condition, ...] = ()
) -> SampleMotion:
    """The motion of that number: the first one that passes the filter within the recipe's attempts. Else the first that can be made
    and whose person can carry what these conditions ask for.

    Motions that do not pass are kept, with the verdict in their record: dropping them would leave out exactly what the filter does
    not know. Raises T2DError where none of the attempts can be made.
    """
    described = descriptions(activity, recipe.descriptions_per_class, recipe.seed)[description]
    first: SampleMotion | None = None
    failure: T2DError | None = None
    for attempt in range(recipe.attempts):
        source = _drawn(recipe, activity, described, number, attempt, recipe.side_at(description))
        try:
            candidate = _fitted(source, recipe, number, activity, attempt + 1)
            for condition in conditions:
                carry(candidate.motion, condition.carries)
        except T2DError as error:  # some attempts at a fall do not come to one
            failure = failure or error
            continue
        if candidate.passed:
            return candidate
        first = first or candidate
    if first is None:
        assert failure is not None, "there is at least one attempt"
        raise failure
    return first


def _drawn(
    recipe: Recipe, activity: Activity, description: Description, number: int, attempt: int, side: Side | None
) -> MotionText:
    """Person, gait and provider for one attempt."""
    motion, person, gait, provider = (
        recipe.seeds(number, f"{purpose} {attempt}") for purpose in ("motion", "person", "gait", "provider")
    )
    provider_name = recipe.providers[int(np.random.default_rng(provider).integers(len(recipe.providers)))]
    values: dict[str, object] = {"gait_spread": recipe.gait_spread}
    factor = float(np.random.default_rng(gait).uniform(*recipe.gait_factors))
    subject = subject_of(recipe, description.subject, number, side) if provider_name in COMPOSED else None
    if subject is not None:
        factor = subject.gait_factor
        values |= {"body": subject.body, "stature_m": subject.stature_m, "person_seed": subject.seed}
    elif provider_name in COMPOSED:  # other providers choose the person themselves
        rng = np.random.default_rng(person)
        body = recipe.bodies[int(rng.integers(len(recipe.bodies)))]
        body, stature_m = drawn_person(description.subject, rng, body=None if body == OWN_BODY else body)
        values |= {"body": body, "stature_m": round(stature_m, 4)}
    if factor != 1.0:
        values["gait_factor"] = round(factor, 4)
    if provider_name in COMPOSED and description.steps[-1].action in GOING:
        values["stand_s"] = round((1.0 - recipe.moving_fractions[0]) * recipe.duration_s, 4)
    if provider_name in COMPOSED and activity in LASTING:
        values["duration_s"] = round(recipe.duration_s * max(1.0, factor), 4)
    return MotionText(text=description.sentence, seed=integer_seed(motion), provider=provider_name, **values)


def _fitted(source: MotionText, recipe: Recipe, number: int, activity: Activity, attempts: int) -> SampleMotion:
    """Cuts or holds a motion to the length of a record, bends it to an arc if its path is long, and judges it.

    Of the pieces of the motion, which may end in rest, the first one is used that the filter accepts as one of the class, in the
    order of `_starts`; where it accepts none, the first.
    """
    rng = np.random.default_rng(recipe.seeds(number, "moving"))
    moving, side = float(rng.uniform(*recipe.moving_fractions)), float(rng.choice([-1.0, 1.0]))
    whole_motion, length_s = source.made(), recipe.duration_s
    # one frame more than needed, as durations are whole numbers of frames
    rest_s = max(length_s - whole_motion.duration_s, (1.0 - moving) * length_s) + 1.0 / whole_motion.rate_hz
    source = source.model_copy(update={"hold_s": round(rest_s, 6)})
    first: MotionText | None = None
    for start_s in _starts(source.piece(whole_motion), length_s, moving):
        cut = source.model_copy(update={"start_s": start_s, "stop_s": start_s + length_s})
        cut = cut.model_copy(update={"radius_m": arc_radius_m(cut.piece(whole_motion), side)})
        if passes(cut.piece(whole_motion), activity):
            return _cut(cut, (), attempts, whole_motion)
        first = first or cut
    assert first is not None, "there is at least one piece"
    return _cut(first, check_motion(first.piece(whole_motion), expected=activity).reasons, attempts, whole_motion)


def _cut(source: MotionText, reasons: tuple[str, ...], attempts: int, whole_motion: Motion) -> SampleMotion:
    return SampleMotion(
        source, source.piece(whole_motion), not reasons, reasons, attempts, whole_motion.duration_s, whole_motion.origin
    )


def moves(motion: Motion) -> np.ndarray:
    """Whether the person moves in each interval between frames, bool (T - 1,)."""
    steps = np.linalg.norm(np.diff(motion.joints, axis=0), axis=-1)
    return np.asarray(steps.mean(axis=1) * motion.rate_hz > MOVING_MPS)


def _starts(motion: Motion, length_s: float, moving: float) -> list[float]:
    """Start times of the pieces of a motion [s]: first those in which the person moves for about the fraction `moving` of the time,
    to a twentieth; among these the liveliest first, which has the greatest sum of squared joint steps."""
    squares = np.sum(np.diff(motion.joints, axis=0) ** 2, axis=(1, 2))
    energy_sum, moving_sum = (np.concatenate([[0.0], np.cumsum(values)]) for values in (squares, moves(motion)))
    starts = np.arange(0.0, motion.duration_s - length_s + 1e-9, STEP_S)
    frames = np.rint(starts * motion.rate_hz).astype(int)
    count = round(length_s * motion.rate_hz)
    ends = np.minimum(frames + count, len(squares))
    energy, fraction = energy_sum[ends] - energy_sum[frames], (moving_sum[ends] - moving_sum[frames]) / count
    return [float(starts[index]) for index in np.lexsort((-energy, np.rint(20.0 * np.abs(fraction - moving))))]


def arc_radius_m(motion: Motion, side: float) -> float:
    """Radius of the arc that keeps the pelvis within `REACH_M` of its mean position, to the left if positive; 0 if the path needs
    no bending.

    It is the widest of `RADII_M` that does so, to the `side` (1 or -1) if possible; where none does, the one with the least
    excursion. No arc is so narrow that the person would have to lean in by more than `MOST_LEAN_DEG`.
    """
    steps = np.diff(motion.joints[:, 0, :2], axis=0) @ [1.0, 1.0j]
    length = np.cumsum(np.abs(steps))
    fastest = np.percentile(np.abs(steps), 90) * motion.rate_hz
    least_m = fastest**2 / (STANDARD_GRAVITY * math.tan(math.radians(MOST_LEAN_DEG)))
    best, strays_m = 0.0, math.inf
    for radius_m in (math.inf, *(sign * magnitude_m for magnitude_m in RADII_M for sign in (side, -side))):
        track = np.cumsum(steps * np.exp(1j * length / radius_m))
        reach_m = float(np.abs(track - track.mean()).max())
        if abs(radius_m) >= least_m and reach_m < strays_m:
            best, strays_m = 0.0 if math.isinf(radius_m) else radius_m, reach_m
        if strays_m <= REACH_M:
            break
    return best


def provenance(cut: SampleMotion) -> Mapping[str, object]:
    """Fields of a sample's record about its motion."""
    return {
        "passed": cut.passed,
        "reasons": list(cut.reasons),
        "attempts": cut.attempts,
        "made_s": round(cut.made_s, 6),
        "start_s": cut.source.start_s,
        "held_s": cut.source.hold_s,
        "moving": round(float(moves(cut.motion).mean()), 4),
        "arc_m": cut.source.radius_m,
        "sources": list(cut.origin),
    }


TRIES = 60
"""Number of places that are tried in a room."""
CLEARANCE_M = 0.15
"""Least distance of a joint from a wall or from furniture [m]: about half the depth of a body. Carried things need none."""
NEAREST_M = 0.8
"""Least horizontal distance of a joint from the radar [m]."""
LOW_M = 0.12
"""Height of things that can be stepped over [m]."""
WIDTH_M = 1.5
"""Greatest offset of the middle of a path from the line of the boresight, in a room [m]."""
STATIC_MPS = 0.05
"""Radial speed up to which a person counts as neither approaching nor receding [m/s]."""
RANGE_ERROR_M = 0.002
"""Greatest sum of a place's overlap and its deviation from the drawn mean range [m] with which no other place is tried."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where a motion takes place relative to the radar."""

    range_m: float
    """Mean range of the pelvis [m]."""
    approaching: float
    """Of the time in which the range changes by more than `STATIC_MPS`, the fraction in which it falls; 0.5 if it never does."""
    nearer_m: float
    """How much nearer the pelvis is at the end than at the beginning [m]; negative if it is farther away."""
    angle_deg: float
    distance_m: float
    aside_m: float
    height_m: float
    """Height of the radar [m]; distance, angle and offset are those of the start of the motion."""
    overlap_m: float
    """Greatest overlap of the motion with walls, furniture or the surroundings of the radar [m]."""


def placing(
    recipe: Recipe,
    number: int,
    scene: str,
    motion: Motion,
    side: Side | None = None,
    loaded: Sequence[Motion] = (),
) -> Place:
    """The place for a motion's number: the first drawn one with room for the motion and for `loaded`, which is the same motion with
    what the person carries under each condition. Where none has room, the one that lacks least.

    The mean range of the person is drawn, not that of the start, and it is kept for the first half of the tries: so classes that
    travel have the same ranges as those that do not, and approach as often as they recede.
    """
    rng = np.random.default_rng(recipe.seeds(number, "view"))
    height_m = round(float(rng.uniform(*recipe.heights_m)), 4)
    range_m = float(rng.uniform(*recipe.distances_m))
    # 10 poses a second are enough to find where a body goes
    stride = max(1, round(motion.rate_hz / 10.0))
    spans = (recipe.angles_deg,) if side is None else side.angles_deg
    tracks = [tracked for person in (motion, *loaded) for tracked in _tracks(person, stride)]
    track = tracks[0][0]
    low, high, boxes = scene_extent(scene)
    best, least = None, math.inf
    for attempt in range(TRIES):
        if attempt >= TRIES // 2:
            range_m = float(rng.uniform(*recipe.distances_m))
        angle_deg = round(_angle_deg(rng, spans), 3)
        # The middle of the path, not its start, lies beside the boresight; else more motions would recede than approach.
        middle_m = 0.0 if scene == "free_space" else float(rng.uniform(-WIDTH_M, WIDTH_M))
        pelvis = _moved(track[:, :1], 0.0, angle_deg, 0.0)[:, 0] - [0.0, 0.0, height_m]
        aside_m = round(middle_m - float(pelvis[:, 1].mean()), 4)
        pelvis[:, 1] += aside_m
        distance_m = round(_start_m(pelvis, range_m), 4)
        overlap_m = max(
            _overlap(_moved(points, distance_m, angle_deg, aside_m), low, high, boxes, clearance_m)
            for points, clearance_m in tracks
        )
        ranges_m = np.linalg.norm(pelvis + [distance_m, 0.0, 0.0], axis=-1)
        mean_m = float(ranges_m.mean())
        lacks = overlap_m + abs(mean_m - range_m)
        if lacks < least:
            least = lacks
            rates = np.diff(ranges_m) * motion.rate_hz / stride
            comes, goes = (int(np.sum(sign * rates > STATIC_MPS)) for sign in (-1.0, 1.0))
            best = Place(
                range_m=round(mean_m, 3),
                approaching=round(comes / (comes + goes), 4) if comes + goes else 0.5,
                nearer_m=round(float(ranges_m[0] - ranges_m[-1]), 3),
                distance_m=distance_m,
                angle_deg=angle_deg,
                aside_m=aside_m,
                height_m=height_m,
                overlap_m=round(overlap_m, 3),
            )
        if lacks < RANGE_ERROR_M:
            break
    assert best is not None, "places were drawn"
    return best


def _tracks(motion: Motion, stride: int) -> list[tuple[np.ndarray, float]]:
    """For a motion that starts 1 m ahead at angle 0: positions (T, P, 3) of its joints, and of points of each carried thing, at
    every `stride`-th frame; each with the clearance that it needs [m]."""
    base = place(motion, distance_m=1.0, radar_position_m=(0.0, 0.0, 1.0))
    times_s = base.times_s[::stride]
    carried = [(thing.at(times_s)[:, outline(thing.rest)], 0.0) for thing in things(base)]
    return [(base.joints[::stride], CLEARANCE_M), *carried]


def _angle_deg(rng: np.random.Generator, spans: Sequence[tuple[float, float]]) -> float:
    """An angle drawn uniformly from ranges [deg]."""
    offset_deg = float(rng.uniform(0.0, sum(high - low for low, high in spans)))
    for low, high in spans:
        if offset_deg <= high - low:
            break
        offset_deg -= high - low
    return min(low + offset_deg, high)


def _start_m(pelvis: np.ndarray, range_m: float) -> float:
    """Distance of the start [m], at least 0.3, at which the mean range of the pelvis is `range_m`, or comes nearest to it; its
    track (T, 3) is relative to the radar, for a start at distance 0."""
    start_m = range_m
    for _ in range(20):  # the mean range grows by nearly as much as the distance
        start_m = max(0.3, start_m + range_m - float(np.linalg.norm(pelvis + [start_m, 0.0, 0.0], axis=-1).mean()))
    return start_m


def _moved(track: np.ndarray, distance_m: float, angle_deg: float, aside_m: float) -> np.ndarray:
    """A track (T, J, 3) that starts 1 m ahead at angle 0, moved to where `place` and `aside` would put it."""
    angle = math.radians(angle_deg)
    cos, sin = math.cos(angle), math.sin(angle)
    local = track - np.array([1.0, 0.0, 0.0])
    x = cos * local[..., 0] - sin * local[..., 1] + distance_m
    y = sin * local[..., 0] + cos * local[..., 1] + aside_m
    return np.stack([x, y, local[..., 2]], axis=-1)


BODY_M = 0.5
"""How far a body extends beyond its joints in the range cells [m]: hands, head and belly, and two range bins for the window."""
NEAREST_GATE_M = 0.3
"""Nearest range of a gate [m]; nearer cells hold the receiver's offset and leakage."""


def range_gate(recipe: Recipe, drawn: Sample) -> tuple[float, float] | None:
    """Nearest and farthest range of the spectrogram's cells [m]; None for all.

    Unless the recipe gives it, the gate depends on the scene only: up to the farthest corner of the room, or in free space all
    ranges that persons of the recipe reach. A gate for each person would let the noise level reveal how far the person goes.
    """
    spectrogram = recipe.products.spectrogram
    gate_m = None if spectrogram is None else spectrogram.range_gate_m
    if gate_m is None or isinstance(gate_m, tuple):
        return gate_m
    radar = np.array(drawn.experiment.radar.position_m)
    if drawn.experiment.scene != "free_space":
        low, high, _ = scene_extent(str(drawn.experiment.scene))
        farthest_m = float(np.linalg.norm(np.maximum(np.abs(high - radar), np.abs(low - radar))))
        return NEAREST_GATE_M, round(farthest_m, 3)
    return NEAREST_GATE_M, round(recipe.distances_m[1] + REACH_M + BODY_M, 3)


def _overlap(track: np.ndarray, low: np.ndarray, high: np.ndarray, boxes: np.ndarray, clearance_m: float) -> float:
    """Greatest overlap of points (T, J, 3) with the walls, with boxes (B, 2, 3) and a margin, and with the surroundings of the
    radar [m]."""
    wall_overlap_m = np.maximum(low + clearance_m - track, track - high + clearance_m)[..., :2].max()
    radar_overlap_m = NEAREST_M - np.linalg.norm(track[..., :2], axis=-1).min()
    overlap_m = max(0.0, float(wall_overlap_m), float(radar_overlap_m))
    margin = np.array([clearance_m, clearance_m, 0.0])
    for first, last in boxes:
        inside = np.minimum(track - first + margin, last + margin - track)
        overlap_m = max(overlap_m, float(inside.min(axis=-1).max()))
    return overlap_m


@functools.lru_cache(maxsize=32)
def scene_extent(scene: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least and greatest corner (3,) of a scene [m], and the boxes (B, 2, 3) of its furniture [m]; none in free space."""
    if scene == "free_space":
        return np.full(3, -np.inf), np.full(3, np.inf), np.zeros((0, 2, 3))
    surfaces = load_scene(scene).surfaces
    corners = np.array([(surface.vertices.min(axis=0), surface.vertices.max(axis=0)) for surface in surfaces])
    low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    # Boxes are along the walls' axes: furniture that stands at an angle takes up more room here than in fact.
    # Walls, doors and windows are flat and part of the room's shell; everything inside the shell is furniture.
    shell = np.any((corners[:, 1] <= low + 0.05) | (corners[:, 0] >= high - 0.05), axis=1)
    stands = ~shell & (corners[:, 1, 2] > LOW_M)
    return low, high, corners[stands]


WALKS = 20
"""Number of descriptions of walks for second persons."""

RESERVED_SEED = 1 << 40
"""Added to a recipe's seed for descriptions that no labelled sample has."""

CIRCLE_RADIUS_M = {"dog": 1.0, "cat": 0.6}
"""Radius of the circles on which pets walk [m]."""


@functools.lru_cache(maxsize=4)
def reserved_walks(recipe: Recipe) -> tuple[Description, ...]:
    """Descriptions of walks for second persons, with sentences that no sample of the recipe is labelled with.

    They occur on all sides of every split, so no class can be recognised by them.
    """
    used_sentences = {
        description.sentence
        for name in recipe.classes
        for description in descriptions(name, recipe.descriptions_per_class, recipe.seed)
    }
    count = WALKS
    while True:
        walks = descriptions("walking", count, recipe.seed + RESERVED_SEED)
        unused = [walk for walk in walks if walk.sentence not in used_sentences]
        if len(unused) >= WALKS:
            return tuple(unused[:WALKS])
        count *= 2


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """A random length or angle, rounded to a thousandth."""
    return round(float(rng.uniform(low, high)), 3)


def interferer(beside: Beside, recipe: Recipe, number: int) -> Mover | MotionText | None:
    """The mover or second person beside the person of a motion's number, in the world of a radar at (0, 0) m that looks along +x;
    None where the condition has none."""
    rng = np.random.default_rng(recipe.seeds(number, f"beside {beside}"))
    side = float(rng.choice([-1.0, 1.0]))
    between = functools.partial(_between, rng)
    if beside == "fan":
        place = between(2.5, 4.5), side * between(1.0, 1.8), between(0.8, 1.3)
        return TableFan(position_m=place, heading_deg=180.0 + between(-40, 40), rpm=between(200, 400))
    if beside == "curtain":
        place = between(2.5, 4.5), side * between(1.6, 2.0), 2.3
        return Curtain(position_m=place, heading_deg=-90.0 * side, seed=integer_seed(recipe.seeds(number, "curtain")))
    if beside == "pet":
        place = between(2.5, 4.0), side * between(0.8, 1.4), 0.0
        animal: Literal["dog", "cat"] = "dog" if rng.random() < 0.5 else "cat"
        return Pet(
            animal=animal,
            position_m=place,
            heading_deg=between(0, 360),
            speed_mps=between(0.4, 0.9),
            turn_radius_m=CIRCLE_RADIUS_M[animal],
        )
    if beside == "person":
        walks = reserved_walks(recipe)
        walk = walks[int(rng.integers(len(walks)))]
        body, stature_m = drawn_person(walk.subject, rng)
        return MotionText(
            text=walk.sentence,
            seed=integer_seed(recipe.seeds(number, "second person")),
            body=body,
            stature_m=round(stature_m, 4),
            duration_s=recipe.duration_s,
            distance_m=between(2.5, 4.5),
            angle_deg=between(-180, 180),
            aside_m=side * between(1.2, 1.8),
            hold_s=recipe.duration_s,
            stop_s=recipe.duration_s,
        )
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """Position of a sample in the recipe."""

    index: int
    activity: Activity
    description: int
    """Index of the description among those of the class."""
    repetition: int
    """Index of the motion among those of the description."""
    number: int
    """Index of the motion in the recipe; it seeds everything that is drawn for the motion."""
    condition: Condition


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """A sample before it is simulated."""

    cell: Cell
    description: Description
    subject: int | None
    """Index of the subject among those of the recipe; None where there are none."""
    cut: SampleMotion
    place: Place
    experiment: Experiment
    measured: bool
    """Whether the field error of the sample is measured."""


def cell_of(recipe: Recipe, index: int) -> Cell:
    """The cell of a sample's index.

    Classes alternate fastest, then conditions if each motion is recorded under all of them, then descriptions, then repetitions: so
    the first samples are balanced over the classes and have as many descriptions as possible.
    """
    index = integer("the index of a sample", index, 0, recipe.samples - 1)
    rest, class_number = divmod(index, len(recipe.classes))
    condition_number = 0
    if recipe.each_condition:
        rest, condition_number = divmod(rest, len(recipe.conditions))
    repetition, description = divmod(rest, recipe.descriptions_per_class)
    number = rest * len(recipe.classes) + class_number
    if not recipe.each_condition:
        side = recipe.side_at(description)
        allowed = [side is None or condition.name in side.conditions for condition in recipe.conditions]
        weights = np.array([condition.weight for condition in recipe.conditions]) * allowed
        rng = np.random.default_rng(recipe.seeds(number, "condition"))
        condition_number = int(rng.choice(len(weights), p=weights / weights.sum()))
    return Cell(
        index=index,
        activity=recipe.classes[class_number],
        description=description,
        repetition=repetition,
        number=number,
        condition=recipe.conditions[condition_number],
    )


def description_of(recipe: Recipe, cell: Cell) -> Description:
    """Description of what the person of a cell does."""
    return descriptions(cell.activity, recipe.descriptions_per_class, recipe.seed)[cell.description]


def sample(recipe: Recipe, index: int) -> Sample:
    """A sample by its index. Its motion is made in the process, because its length and the room that it needs must be known.

    Each thing that is drawn has its own random stream, seeded by the recipe's hash, a number and a word. So a sample does not
    depend on which others are made, and the conditions of one motion differ in nothing but the condition. Raises InputError for an
    index beyond the recipe, and T2DError where no motion of the description can be made.
    """
    cell = cell_of(recipe, index)
    recorded = recipe.conditions if recipe.each_condition else (cell.condition,)
    cut = sample_motion(recipe, cell.activity, cell.description, cell.number, recorded)
    condition, side = cell.condition, recipe.side_at(cell.description)
    # one place for all conditions of a motion, with room for the things carried in each of them
    loaded = [carry(cut.motion, other.carries) for other in recorded if other.carries]
    place = placing(recipe, cell.number, condition.scene, cut.motion, side, loaded)
    radar = _raised(recipe.radar if condition.radar is None else condition.radar, place.height_m)
    source = cut.source.model_copy(
        update={
            "distance_m": place.distance_m,
            "angle_deg": place.angle_deg,
            "aside_m": place.aside_m,
            "carries": condition.carries,
        }
    )
    beside = interferer(condition.beside, recipe, cell.number)
    experiment = Experiment(
        targets=(source,) if beside is None else (source, beside),
        radar=radar,
        scene=condition.scene,
        reflections=condition.reflections,
        clutter=condition.clutter,
        method=condition.method,
        material=condition.material,
        body=source.body or "adult",
        seed=integer_seed(recipe.seeds(index, "diffuse points and noise")),
        noise=recipe.noise,
    )
    chance = float(np.random.default_rng(recipe.seeds(index, "error")).random())
    description = description_of(recipe, cell)
    subject = None if cut.source.person_seed is None else subject_of(recipe, description.subject, cell.number, side)
    return Sample(
        cell=cell,
        description=description,
        subject=None if subject is None else subject.number,
        cut=cut,
        place=place,
        experiment=experiment,
        measured=chance < recipe.error_fraction,
    )


def _raised(radar: Radar, height_m: float) -> Radar:
    """The radar at (0, 0) m and a height, looking along +x."""
    return radar.model_copy(update={"position_m": (0.0, 0.0, height_m), "boresight": (1.0, 0.0, 0.0)})
