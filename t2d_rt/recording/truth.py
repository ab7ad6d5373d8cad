"""Ground truth of a recording over time: joints, segments, contacts and visibility of each person, range and speed of each
target."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from t2d_rt.body.fit import fit
from t2d_rt.body.outfit import Outfit
from t2d_rt.body.segments import SEGMENTS, segment_of_faces
from t2d_rt.body.template import template
from t2d_rt.core.constants import unit_of
from t2d_rt.geometry.vectors import edge_cross
from t2d_rt.motion import track
from t2d_rt.motion.contacts import SIDES, contacts
from t2d_rt.motion.kinematics import poses_of
from t2d_rt.pipeline.echo_model import Model, with_method
from t2d_rt.pipeline.targets import in_frame, passing, segments, skin
from t2d_rt.propagation.occluders import Occluders
from t2d_rt.propagation.visibility import Occlusion, Viewpoints, viewpoints_at
from t2d_rt.recording.path_table import (
    Nearby,
    mean_range_m,
    record_times,
    reference_points,
    seen_from_radar,
    sight,
    target_names,
)
from t2d_rt.types import Accuracy, Ellipsoids, Material, Motion, MovingMesh, Radar
from t2d_rt.types.motion import CANONICAL_JOINTS, OPTIONAL_JOINTS

if TYPE_CHECKING:
    import xarray as xr

TRUTH_RATE_HZ = 50.0
"""Rate of the truth where no times are given [Hz]: a fast foot moves by some 8 cm from one instant to the next."""
MADE_FOR = re.compile(r"made for .*, class (\w+), by ")
"""Pattern for the origin of a motion that was made from a sentence. The class is read from the origin because edits, motion files
and stored experiments already preserve that; a separate field would have to be passed through each of them."""

CYCLES = "breathing", "heartbeat"
"""Fields of a motion that describe movements of the front of the trunk."""
XYZ = "forward", "left", "up"
PARTS = "heel", "ball"
OF_SEGMENTS = "range_m", "speed_mps", "azimuth_rad", "elevation_rad", "visible"
TRUTH_COLUMNS: tuple[str, ...] = (
    "time_s",
    *(f"{joint}_{axis}_m" for joint in CANONICAL_JOINTS for axis in XYZ),
    *(f"{segment}_{name}" for name in OF_SEGMENTS for segment in SEGMENTS),
    *(f"{side}_{part}_stands" for side in SIDES for part in PARTS),
    "breathing_m",
)
"""Columns of a person's truth as a single table: time, the 22 joints, five figures of each segment, contacts (0 or 1),
breathing."""


class Person(NamedTuple):
    """A target that is moved by a skeleton."""

    number: int
    """Index of the target."""
    motion: Motion
    body: str
    worn: str | Material | Outfit
    """What the person wears, or the one material of the whole body."""


def truth_table(
    model: Model, accuracy: Accuracy, times_s: np.ndarray | None = None, *, visible: bool = True
) -> xr.Dataset:
    """Ground truth for a recording at instants of the record (K,) [s]; every 20 ms by default.

    Of all targets (target, time_s): `range_m`, `speed_mps` (positive = approaching), `azimuth_rad` (left > 0) and `elevation_rad`
    of the reference point, the pelvis of a person. Of persons (person, time_s, ...): `joints_m` (joint, xyz), forward, left and
    up from the radar; `segment_range_m`, `segment_speed_mps`, `segment_azimuth_rad` and `segment_elevation_rad` (segment) of the
    middles of the body's 17 segments; `segment_visible` (segment), the fraction of the area facing the radar that neither the body
    itself, another target nor the scene hides, left out without `visible`; `contact` (foot, part), whether heel and ball of each
    foot touch the ground; `activity`, what the person does, or "" where the motion does not say; `breathing_m` and `heartbeat_m`,
    how far breath and heartbeat have moved the front of the trunk forward. Ranges and speeds are means over transmitters and
    receivers. A target without joints, such as a fan or a mesh, is no person. The coordinate `made_for` (person) is the class for
    which the whole motion was made, "" for a motion from a file; `breathing_hz` and `heartbeat_hz` are breaths and beats per
    second, 0 without any.
    """
    import xarray as xr

    times_s = record_times(model.span_s, TRUTH_RATE_HZ) if times_s is None else times_s
    nearby = Nearby.instants(times_s, model.span_s)
    names, people = target_names(model.modelled), persons(model)
    optional = [name for name in OPTIONAL_JOINTS if people and all(name in person.motion.names for person in people)]
    joints = [*CANONICAL_JOINTS, *optional]
    points = Nearby(*(reference_points(model, instants_s) for instants_s in nearby))
    overall = _polar(model.radar, points, nearby.later - nearby.earlier)
    data = xr.Dataset(
        {
            **{name: (("target", "time_s"), values) for name, values in overall.items()},
            **_of_persons(model, people, joints, nearby),
        },
        coords={
            "time_s": times_s,
            "target": names,
            "person": [names[person.number] for person in people],
            "joint": joints,
            "xyz": list(XYZ),
            "segment": list(SEGMENTS),
            "foot": list(SIDES),
            "part": list(PARTS),
            "made_for": ("person", np.array([made_for(person.motion) for person in people], dtype=np.str_)),
            **{
                f"{name}_hz": (
                    "person",
                    np.array([cycle.rate_hz if (cycle := getattr(person.motion, name)) else 0.0 for person in people]),
                )
                for name in CYCLES
            },
        },
    )
    if visible:
        at_s = np.clip(model.span_s[0] + nearby.now, *model.span_s)
        fractions = visible_fractions(model, accuracy, people, at_s)
        data["segment_visible"] = ("person", "time_s", "segment"), fractions
    for name, values in data.variables.items():
        values.attrs["units"] = unit_of(str(name))
    return data


def person_rows(truth: xr.Dataset) -> np.ndarray:
    """Truth of the first person as a table with the columns `TRUTH_COLUMNS`, float32 (time, column); without visible fractions if
    the truth has none."""
    person = truth.isel(person=0)
    columns = [
        truth.time_s.values[:, None],
        person.joints_m.sel(joint=list(CANONICAL_JOINTS)).values.reshape(len(truth.time_s), -1),
        *(person[f"segment_{name}"].values for name in OF_SEGMENTS if f"segment_{name}" in person),
        person.contact.values.reshape(len(truth.time_s), -1),
        person.breathing_m.values[:, None],
    ]
    return np.concatenate(columns, axis=1).astype(np.float32)


def _of_persons(
    model: Model, people: Sequence[Person], joints: Sequence[str], nearby_s: Nearby
) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    """Joints, contacts, and ranges, speeds and directions of the segments, for all persons."""
    at = Nearby(*(np.clip(model.span_s[0] + instants_s, *model.span_s) for instants_s in nearby_s))
    shape = len(people), len(at.now)
    middles = Nearby(*(np.zeros((*shape, len(SEGMENTS), 3)) for _ in at))
    places, stands = np.zeros((*shape, len(joints), 3)), np.zeros((*shape, 2, 2), bool)
    cycles, does = {name: np.zeros(shape) for name in CYCLES}, list[np.ndarray]()
    for row, (number, motion, body, worn) in enumerate(people):
        joints_m = in_frame(model.radar, at.now, track(motion)(at.now)[0][:, [motion.index(name) for name in joints]])
        places[row] = (joints_m - np.asarray(model.radar.position_m)) @ model.radar.axes.T
        own_limbs = model.geometries[number]
        limbs = own_limbs
        if not isinstance(limbs, Ellipsoids):
            limbs = passing(segments(motion, body, material=worn), model.radar)
        for middle, instants_s in zip(middles, at, strict=True):
            middle[row] = limbs.at(instants_s)[0]
        frames = np.clip(np.rint(at.now * motion.rate_hz).astype(int), 0, len(motion.joints) - 1)
        stands[row] = contacts(poses_of(motion))[frames]
        does.append(motion.activity_at(at.now))
        for name, moved in cycles.items():
            if (cycle := getattr(motion, name)) is not None:
                moved[row] = cycle.displacement_m(at.now)
    limbs_polar = _polar(model.radar, middles, (nearby_s.later - nearby_s.earlier)[:, None])
    return {
        "joints_m": (("person", "time_s", "joint", "xyz"), places),
        **{f"segment_{name}": (("person", "time_s", "segment"), values) for name, values in limbs_polar.items()},
        "contact": (("person", "time_s", "foot", "part"), stands),
        "activity": (("person", "time_s"), np.array(does, np.str_).reshape(shape)),
        **{f"{name}_m": (("person", "time_s"), moved) for name, moved in cycles.items()},
    }


def persons(model: Model) -> list[Person]:
    """The targets that are moved by a skeleton: motions, and meshes and ellipsoids that `skin` and `segments` made of motions."""
    people = []
    for number, source in enumerate(model.targets):
        if isinstance(source, Motion):
            people.append(Person(number, source, model.body, "skin" if model.material is None else model.material))
        elif isinstance(source, (MovingMesh, Ellipsoids)) and source.made and source.made.by in ("skin", "segments"):
            arguments: Mapping[str, Any] = source.made.arguments
            people.append(Person(number, arguments["motion"], arguments["body"], arguments["material"]))
    return people


class Doing(NamedTuple):
    """What a person does during an interval of a record."""

    person: str
    activity: str
    begin_s: float
    end_s: float


def doings(model: Model) -> list[Doing]:
    """What each person does, and during which interval [s], as far as the motions say; in order for each person."""
    names, (first_s, last_s), activities = target_names(model.modelled), model.span_s, []
    for number, motion, *_ in persons(model):
        begins = [*motion.activities, ("", np.inf)]
        for (activity, begin_s), (_, end_s) in pairwise(begins):
            begin_s, end_s = max(begin_s - first_s, 0.0), min(end_s, last_s) - first_s
            if end_s > begin_s:
                activities.append(Doing(names[number], activity, begin_s, end_s))
    return activities


def made_for(motion: Motion) -> str:
    """The class that a motion was made for; "" where its origin does not say."""
    match = MADE_FOR.match(motion.origin[0]) if motion.origin else None
    return match[1] if match else ""


def _polar(radar: Radar, points: Nearby, apart_s: np.ndarray) -> dict[str, np.ndarray]:
    """Range, speed and direction of points (..., 3); `apart_s` is the time between their earlier and later positions [s]."""
    ranges = Nearby(*(mean_range_m(radar, point) for point in points))
    azimuth, elevation = seen_from_radar(radar, points.now - np.asarray(radar.position_m))
    return {
        "range_m": ranges.now,
        "speed_mps": (ranges.earlier - ranges.later) / apart_s,
        "azimuth_rad": azimuth,
        "elevation_rad": elevation,
    }


def visible_fractions(model: Model, accuracy: Accuracy, people: Sequence[Person], at_s: np.ndarray) -> np.ndarray:
    """Visible fraction of each segment (person, K, segment) at times [s] (K,): the projected area of its faces that the radar can
    see over that of its faces that face the radar, on the lines of sight of transmitters and receivers. For separated antennas the
    area is the geometric mean of those projected towards both. It is 0 for a segment without a face towards the radar."""
    fractions = np.zeros((len(people), len(at_s), len(SEGMENTS)))
    if not people:
        return fractions
    skinned = with_method(model, "mesh")
    fast = skinned.fast_rotating(accuracy)
    meshes = {k: mesh for k, mesh in enumerate(skinned.geometries) if isinstance(mesh, MovingMesh) and not fast[k]}
    meshes |= {
        person.number: passing(skin(person.motion, person.body, material=person.worn), model.radar)
        for person in people
        if person.number not in meshes
    }
    occluders, order, owners = Occluders(list(meshes.values())), list(meshes), [_owners(person) for person in people]
    viewpoints = Viewpoints(occluders, at_s, model.backend, wavelength_m=None)
    views = [
        Occlusion(
            viewpoints,
            view,
            unblocked=None if model.scene is None else partial(model.blockage.fraction, sight(model, end)),
        )
        for end, view in enumerate(viewpoints_at(model.radar.views_m))
    ]
    for first in range(0, len(at_s), viewpoints.at_once):
        chunk_s = at_s[first : first + viewpoints.at_once]
        vertex_fractions = [occluders.split(occlusion) for occlusion in viewpoints.traced(views, chunk_s)]
        for row, person in enumerate(people):
            mesh = meshes[person.number]
            for k, posed in enumerate(mesh.at(chunk_s)):
                corners = posed[mesh.faces]
                facing = projected_areas(corners, model.radar.views_m)
                free = np.prod(
                    [fraction[order.index(person.number)][k][mesh.faces].mean(axis=1) for fraction in vertex_fractions],
                    axis=0,
                )
                whole, visible = (np.bincount(owners[row], areas, len(SEGMENTS)) for areas in (facing, facing * free))
                fractions[row, first + k] = visible / np.maximum(whole, 1e-12)
    return fractions


def _owners(person: Person) -> np.ndarray:
    """Index of the segment to which each face of the skin belongs."""
    return segment_of_faces(fit(template(person.body), person.motion))


def projected_areas(corners: np.ndarray, places: Sequence[np.ndarray]) -> np.ndarray:
    """Twice the projected area of triangles (F, 3, 3) as seen from places, as the geometric mean over these, (F,); 0 for triangles
    that face away from one of them."""
    areas = []
    for place in places:
        ahead = place - corners.mean(axis=1)
        across = np.einsum("fi,fi->f", edge_cross(corners), ahead) / np.linalg.norm(ahead, axis=1)
        areas.append(np.maximum(across, 0.0))
    return np.prod(areas, axis=0) ** (1 / len(areas))
