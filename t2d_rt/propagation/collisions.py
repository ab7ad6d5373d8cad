"""Targets that go through the static scene, or start outside the room: which, when and where."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Literal

import numpy as np

from t2d_rt.core.backend import Backend
from t2d_rt.core.errors import InputError, warn
from t2d_rt.propagation.mirrors import Mirrors, has_room, sphere
from t2d_rt.types import CANONICAL_JOINTS, Ellipsoids, Motion, MovingMesh, Radar, RadarTrack, Scene

SAMPLE_RATE_HZ = 25.0
"""Mean rate [Hz] of the instants at which targets are tested: a walker goes 6 cm from one to the next."""
GOLDEN = 0.6180339887
"""Instants are uneven by multiples of this fraction of their interval: at even ones a fan of 1500 rpm would seem static."""
DEEP_M = 0.05
"""Distance [m] that a point must reach on both sides of a surface to have gone through it: feet dip into floors, doors close flush
with their wall, people sink into a sofa. An antenna is a point, and has gone through at any distance."""
PARTS = 12
"""Number of parts of a mesh whose middles are tested: a hand that touches a table is not through it."""
INSTANTS_AT_ONCE, VERTICES_AT_ONCE = 50, 2_500_000
"""Number of instants of a mesh that are posed at once, for memory; fewer if it has many vertices."""
MIDDLE = (
    ("left_knee", "right_knee", "left_ankle", "right_ankle"),
    ("left_knee", "right_knee"),
    ("pelvis",),
    ("spine3",),
    ("head",),
)
"""Joints that a person's middle runs by, from between the shins to the head; arms and feet may touch what they like."""
KNEES = 1
ENCLOSED = 2 / 3
"""Fraction of directions from its middle in which a room ends at something: open windows and doors leave more."""
FLAT = 0.7
"""Vertical component of a unit normal from which a surface lies flat."""
LEAST_S = 0.1
"""Least length of a record [s]; one that ends earlier is none."""
Collisions = Literal["warn", "stop", "ignore"]
"""What becomes of a target that goes through something: a warning, the end of the record just before, nothing."""


@dataclass(frozen=True, slots=True)
class Held:
    """A thing that a person carries."""

    mesh: MovingMesh
    points: np.ndarray
    """Numbers of vertices that are spread all over it."""
    pelvis_at: Callable[[np.ndarray], np.ndarray]
    """Function that gives the place of the person's pelvis (K, 3) [m] at times (K,) [s]."""


Tested = Motion | MovingMesh | Ellipsoids | Held


@dataclass(frozen=True, slots=True)
class Collision:
    """Where a target first goes through something, or stands at the start if that is outside the room."""

    target: int
    time_s: float
    place_m: np.ndarray
    """Place of the collision, (3,)."""
    surface: str | None
    """Name of the surface that the target goes through; None for a target that starts outside."""


def checked_time(
    collisions: Collisions,
    scene: Scene,
    targets: Sequence[Tested],
    names: Sequence[str],
    radar: Radar,
    time_s: tuple[float, float],
    *,
    outside: bool,
    backend: Backend,
) -> tuple[float, float]:
    """First and last instant of the record [s]: all of it, or up to where a target goes through something.

    `outside` tells whether the radar may stand, and a target may start, outside the room. With "stop" an InputError is raised if
    the radar itself collides or stands outside, or if too little of the record is left.
    """
    if collisions == "ignore":
        return time_s
    start, stop = time_s
    if (crossed := radar_crossing(scene, radar, start, stop, backend)) is not None:
        when_s, place, name = crossed
        text = f"the radar goes through {name} of {scene.name} at {when_s - start:.2f} s, at {_place_text(place)}"
        if collisions == "stop":
            raise InputError(f"{text}; give another track")
        warn(f"{text}; give another track")
    if not outside and (beyond := radar_outside(scene, radar, time_s, backend)) is not None:
        when_s, place = beyond
        moves = radar.track is not None
        when = f" at {when_s - start:.2f} s of the record" if moves else ""
        text = f"the radar is at {_place_text(place)}{when}, outside {_reach_text(scene)}; "
        text += "give another track" if moves else "move it (position_m)"
        text += ", choose another room, or allow transmissions for paths through walls"
        if collisions == "stop":
            raise InputError(text)
        warn(text)
    for collision in find_collisions(scene, targets, radar, start, stop, outside=outside, backend=backend):
        text = _collision_text(collision, scene, names, start)
        if collisions == "warn":
            hint = " (distance_m, angle_deg)" if isinstance(targets[collision.target], Motion) else ""
            warn(f"{text}; place it elsewhere{hint}, choose another room, or end the record there (collisions 'stop')")
        elif collision.time_s - start < LEAST_S:
            raise InputError(f"{text}, which leaves no record to stop at; place it elsewhere or choose another room")
        else:
            stop = min(stop, collision.time_s)
    return start, stop


def _place_text(place_m: np.ndarray) -> str:
    return f"({', '.join(f'{x:.2f}' for x in place_m)}) m"


def _reach_text(scene: Scene) -> str:
    low, high = (", ".join(f"{x:.4g}" for x in corner) for corner in scene.bounds_m)
    return f"{scene.name}, which reaches from ({low}) to ({high}) m"


def _collision_text(collision: Collision, scene: Scene, names: Sequence[str], start_s: float) -> str:
    """The first half of a sentence: who meets what, when and where."""
    name = names[collision.target] + (f" (target {collision.target + 1} of {len(names)})" if len(names) > 1 else "")
    where = _place_text(collision.place_m)
    if collision.surface is None:
        return f"{name} starts at {where}, outside {_reach_text(scene)}"
    return f"{name} goes through {collision.surface} of {scene.name} at {collision.time_s - start_s:.2f} s, at {where}"


def find_collisions(
    scene: Scene,
    targets: Sequence[Tested],
    radar: Radar,
    start_s: float,
    stop_s: float,
    *,
    outside: bool = False,
    backend: Backend,
) -> list[Collision]:
    """The first collision of each target that has any, between two times [s].

    `outside` tells whether targets may start outside, beyond the bounding box of a scene that is a room or has the antennas inside.
    """
    mirrors = Mirrors.of(scene, backend, radar.tx_position_m)
    times = uneven_times(start_s, stop_s)
    low, high = scene.bounds_m
    encloses_radar = all(((low < place) & (place < high)).all() for place in (radar.tx_position_m, radar.rx_position_m))
    has_outside = not outside and (encloses_radar or is_room(mirrors))
    collisions = []
    for number, target in enumerate(targets):
        track = middles(target, times)
        start = track[0].mean(axis=0)
        if has_outside and _beyond(scene, start, DEEP_M):
            collisions.append(Collision(number, start_s, start, None))
            continue
        crossings = [first_crossing(mirrors, *line) for line in _lines(target, track, times)]
        if met := [crossing for crossing in crossings if crossing is not None]:
            collisions.append(Collision(number, *min(met, key=itemgetter(0))))
    return collisions


def radar_outside(
    scene: Scene, radar: Radar, time_s: tuple[float, float], backend: Backend
) -> tuple[float, np.ndarray] | None:
    """Time [s] and place (3,) [m] at which an antenna first stands outside a room between two times [s]; None where none does, or
    the scene is no room."""
    times_s = np.array(time_s[:1]) if radar.track is None else _track_times(radar.track, *time_s)
    centres = np.broadcast_to([radar.tx_position_m, radar.rx_position_m], (len(times_s), 2, 3))
    if radar.track is not None:
        centres = radar.passing(times_s).back.points(centres)
    beyond = np.argwhere(_beyond(scene, centres, 0.0))
    if not len(beyond) or not is_room(Mirrors.of(scene, backend)):
        return None
    instant, antenna = beyond[0]
    return float(times_s[instant]), centres[instant, antenna]


def radar_crossing(
    scene: Scene, radar: Radar, start_s: float, stop_s: float, backend: Backend
) -> tuple[float, np.ndarray, str] | None:
    """Time [s], place (3,) [m] and name of the surface that the track of a radar first goes through, however little, or None."""
    if radar.track is None:
        return None
    times_s = _track_times(radar.track, start_s, stop_s)
    line_m = radar.track.places_m(times_s)
    crossings = []
    for mirror in Mirrors.of(scene, backend, radar.tx_position_m).parts:
        depth_m = line_m @ mirror.normal - mirror.offset_m
        before = np.flatnonzero((depth_m[:-1] != 0) & (np.sign(depth_m[:-1]) != np.sign(depth_m[1:])))
        fraction = depth_m[before] / (depth_m[before] - depth_m[before + 1])
        places = line_m[before] + fraction[:, None] * (line_m[before + 1] - line_m[before])
        met = np.flatnonzero(mirror.holds(places))[:1]
        when_s = times_s[before] + fraction * (times_s[before + 1] - times_s[before])
        crossings += [(float(when_s[index]), places[index], scene.surfaces[mirror.surface].name) for index in met]
    return min(crossings, key=itemgetter(0), default=None)


def _track_times(track: RadarTrack, start_s: float, stop_s: float) -> np.ndarray:
    """Instants of the record [s] at which a radar is tested: also those of its track's poses."""
    poses_s = np.array(track.times_s)
    return np.union1d(uneven_times(start_s, stop_s), poses_s[(poses_s > start_s) & (poses_s < stop_s)])


def is_room(mirrors: Mirrors) -> bool:
    """Whether a scene has an inside for people: it is as large as a room, and most rays from its middle meet something."""
    low, high = mirrors.scene.bounds_m
    if not has_room(high - low):
        return False
    directions = sphere(1000)
    distance, _ = mirrors.first(np.broadcast_to((low + high) / 2, directions.shape), directions)
    return bool(np.isfinite(distance).mean() > ENCLOSED)


def _beyond(scene: Scene, places_m: np.ndarray, deep_m: float) -> np.ndarray:
    """Whether places (..., 3) [m] lie more than `deep_m` beyond the box around a scene, bool (...)."""
    low, high = scene.bounds_m
    return np.asarray(((places_m < low - deep_m) | (places_m > high + deep_m)).any(axis=-1))


def _lines(target: Tested, track_m: np.ndarray, times_s: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    """Yields lines (L, N, 3) [m], their times (L, N) [s], and how upright the normals of what they may go through are at least."""
    if isinstance(target, Motion):
        # A table's top lies flat across the body: steps in time pass over and under it, lines along the body meet it.
        bones = np.stack([track_m[:, :-1], track_m[:, 1:]], axis=2)
        yield bones.reshape(-1, 2, 3), np.broadcast_to(times_s[:, None, None], bones.shape[:3]).reshape(-1, 2), FLAT
        # Knees swing ahead of the body; they are there to lead around the seat of a chair.
        track_m = np.delete(track_m, KNEES, axis=1)
    elif isinstance(target, Held):
        # A thing may be within a wall that it moves along, or have the back of a chair between itself and the body.
        for some_s, vertices in _posed(target.mesh, times_s):
            points_m = vertices[:, target.points]
            reach_m = np.stack(np.broadcast_arrays(target.pelvis_at(some_s)[:, None], points_m), axis=2)
            yield reach_m.reshape(-1, 2, 3), np.repeat(some_s, 2 * len(target.points)).reshape(-1, 2), 0.0
    yield track_m.transpose(1, 0, 2), np.broadcast_to(times_s, track_m.shape[1::-1]), 0.0


def uneven_times(start_s: float, stop_s: float) -> np.ndarray:
    """Instants [s] at which targets are tested, the first and the last of them the times given."""
    count = max(2, int(np.ceil((stop_s - start_s) * SAMPLE_RATE_HZ)) + 1)
    uneven = np.arange(count) + np.arange(count) * GOLDEN % 1
    return start_s + (stop_s - start_s) * uneven / uneven[-1]


def middles(target: Tested, times_s: np.ndarray) -> np.ndarray:
    """Points (K, P, 3) [m] that stand for a target: a person's middle, the middles of a mesh's parts, ellipsoids' centres."""
    if isinstance(target, Motion):
        joints = target.joints
        numbers = [[CANONICAL_JOINTS.index(name) for name in names] for names in MIDDLE]
        line = np.stack([joints[:, columns].mean(axis=1) for columns in numbers], axis=1)
        frame = np.clip(times_s * target.rate_hz, 0, len(line) - 1)
        before = np.minimum(frame.astype(int), len(line) - 2)
        fraction = (frame - before)[:, None, None]
        return np.asarray((1 - fraction) * line[before] + fraction * line[before + 1])
    if isinstance(target, Ellipsoids):
        return target.at(times_s)[0]
    if isinstance(target, Held):
        target = target.mesh
    # A mesh has no joints: the middles of parts of it move as smoothly as these, and none of them lies on its surface.
    part = _parts(target.rest)
    members = [np.flatnonzero(part == number) for number in range(part.max() + 1)]
    return np.concatenate(
        [
            np.stack([vertices[:, of_part].mean(axis=1) for of_part in members], axis=1)
            for _, vertices in _posed(target, times_s)
        ]
    )


def _posed(mesh: MovingMesh, times_s: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yields blocks of the times, (K,) [s] each, and the vertices (K, V, 3) [m] of a mesh at these."""
    step = max(1, min(INSTANTS_AT_ONCE, VERTICES_AT_ONCE // len(mesh.rest)))
    for first in range(0, len(times_s), step):
        some_s = times_s[first : first + step]
        yield some_s, mesh.at(some_s)


def _parts(rest: np.ndarray) -> np.ndarray:
    """Number of the part of each vertex (V,): whichever is nearest of a few, each as far as may be from the others."""
    nearest, part = np.full(len(rest), np.inf), np.zeros(len(rest), int)
    for number in range(min(PARTS, len(rest))):
        farthest = rest[np.argmax(nearest)] if number else rest.mean(axis=0)
        distance = np.linalg.norm(rest - farthest, axis=1)
        part[distance < nearest] = number
        nearest = np.minimum(nearest, distance)
    return np.unique(part, return_inverse=True)[1].ravel()


def first_crossing(
    mirrors: Mirrors, lines_m: np.ndarray, times_s: np.ndarray, least_upright: float
) -> tuple[float, np.ndarray, str] | None:
    """Time [s], place (3,) [m] and surface name where any of lines from point to point (L, N, 3) [m], whose times are (L, N) [s],
    first goes through a surface whose unit normal is at least `least_upright` along z; None where none does."""
    line, point = np.nonzero(~mirrors.free(lines_m[:, :-1], lines_m[:, 1:]))
    if not len(line):
        return None
    start, step = lines_m[line, point], lines_m[line, point + 1] - lines_m[line, point]
    length = np.linalg.norm(step, axis=1)
    distance, met = mirrors.first(start, step / length[:, None])
    fraction = distance / length
    when_s = times_s[line, point] + fraction * (times_s[line, point + 1] - times_s[line, point])
    for number in np.argsort(when_s):
        mirror = mirrors.parts[met[number]]
        if fraction[number] > 1 or abs(mirror.normal[2]) < least_upright:
            continue
        if _through(lines_m[line[number]] @ mirror.normal - mirror.offset_m, int(point[number])):
            place = start[number] + fraction[number] * step[number]
            return float(when_s[number]), place, mirrors.scene.surfaces[mirror.surface].name
    return None


def _through(depth_m: np.ndarray, point: int) -> bool:
    """Whether a line with those signed distances from a plane (N,) comes from well before it and goes to well behind it."""
    return _reach(depth_m[point::-1]) > DEEP_M and _reach(depth_m[point + 1 :]) > DEEP_M


def _reach(depth_m: np.ndarray) -> float:
    """Distance [m] from a plane that a line reaches before it first changes sides."""
    sides = np.flatnonzero(np.sign(depth_m) != np.sign(depth_m[0]))
    return float(np.abs(depth_m[: sides[0] if len(sides) else None]).max())
