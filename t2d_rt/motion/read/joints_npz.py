"""Read arrays of joints: Kimodo's .npz, a .npz with joints, names and a rate, or a bare .npy whose order its limbs tell."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from t2d_rt.core.checks import numbered, shown
from t2d_rt.core.errors import InputError
from t2d_rt.motion.quaternions import from_matrix
from t2d_rt.motion.read.arrays import Arrays, samples_of
from t2d_rt.motion.read.clock import stated_rate
from t2d_rt.motion.read.detect import Up
from t2d_rt.motion.read.humanml3d import WIDTH, read_joints, read_vectors
from t2d_rt.motion.read.joint_sets import ORDERS, absent_joints, likeliest_order, named_points, unlikeness
from t2d_rt.motion.read.samples import filled, seen
from t2d_rt.motion.read.subjects import Labels, People, one_of, people_of_labels, subjects
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.motion.skeletons import tables
from t2d_rt.types.motion import CANONICAL_JOINTS

# --- Kimodo's .npz: posed_joints (T, 30, 3) [m], global_rot_mats (T, 30, 3, 3), 30 frames a second, y up, facing z ---


RATE_HZ = 30.0
JOINTS = 30

PLACES: Mapping[str, int] = tables()["kimodo"]
"""Index of each canonical joint among those of the file."""


def read_kimodo(arrays: Arrays) -> Tracks:
    """Tracks of positions and, where the file has them, rotations; raises an InputError if an array has a wrong shape."""
    joints = arrays.samples("posed_joints", (3,))
    if joints.shape[1:] != (JOINTS, 3):
        raise InputError(f"{arrays.path}: posed_joints must have shape (time, {JOINTS}, 3), got {joints.shape}")
    given_hz = stated_rate(arrays, len(joints))
    rate_hz = RATE_HZ if given_hz is None else given_hz
    joints = seen(joints)
    points = {name: joints[:, place] for name, place in PLACES.items()}
    orientations, lost = {}, np.zeros(len(joints), dtype=bool)
    if "global_rot_mats" in arrays:
        matrices = arrays.samples("global_rot_mats", (4,))
        if matrices.shape != (*joints.shape, 3):
            raise InputError(
                f"{arrays.path}: global_rot_mats must have shape {(*joints.shape, 3)}, got {shown(matrices)}"
            )
        rows, lost = filled(matrices.reshape(len(matrices), -1), f"{arrays.path}: global_rot_mats")
        matrices = rows.reshape(matrices.shape)
        deviation = np.abs(matrices @ np.swapaxes(matrices, -1, -2) - np.eye(3)).max()
        if not (deviation < 1e-2 and (np.linalg.det(matrices) > 0).all()):
            raise InputError(
                f"{arrays.path}: global_rot_mats are no rotation matrices; they deviate by {deviation:.2g}"
            )
        turned = from_matrix(matrices)
        orientations = {name: turned[:, place] for name, place in PLACES.items()}
    return Tracks(form="Kimodo", points=points, turned=orientations, rate_hz=rate_hz, unit_m=1.0, up="y").without(lost)


# --- plain arrays of joints: a .npz with joints, names and a rate, or a bare .npy whose order is found from its limbs ---


JOINT_FIELDS = ("joints", "positions", "joints3d", "keypoints", "keypoints3d", "motion", "poses3d", "arr_0", "")
NAMED_RATE_HZ = 30.0
"""Rate of cameras, which is assumed if a file tells none."""

MOST_JOINTS = 200

SURE = 0.5
"""Confidence or visibility below which an estimator has guessed a point."""

FORMS = (
    "(T, 22, 3) HumanML3D joints, (T, 263) HumanML3D vectors, (T, K, 3) joints with `names` in a .npz, or (T, K, 4) with a "
    "confidence of 0 to 1 behind each"
)


def read_plain(arrays: Arrays) -> People:
    """The persons of joints (T, K, 3) or (T, P, K, 3), named or in a known order, or of HumanML3D vectors (T, 263)."""
    key = arrays.first(*JOINT_FIELDS) or (next(iter(arrays.texts)) if len(arrays.texts) == 1 else None)
    if key is None:
        raise InputError(f"{arrays.path} holds {shown(list(arrays.texts))} but no joints; expected {FORMS}")
    persons = _persons(arrays, key)
    what = f"{arrays.path}: {key or 'the array'}"
    if "" in persons:
        return _people(persons[""], arrays, what)
    return {name: partial(_person, values, arrays, what) for name, values in persons.items()}


def _person(values: Any, arrays: Arrays, what: str) -> Tracks:
    return one_of(_people(values, arrays, what), None)


def _persons(arrays: Arrays, key: str) -> dict[str, np.ndarray]:
    """Arrays (T, K, 3) of the persons in an array (T, P, K, 3) or (P, T, K, 3) who are ever seen, by number; a single one is ""."""
    array = arrays.get(key)
    if array.ndim != 4 or array.shape[3] not in (3, 4, 5) or min(array.shape) < 2 or array.dtype.kind not in "fiu":
        return {"": array}
    people = np.moveaxis(array, int(array.shape[1] < array.shape[0]), 0)
    if len(people) > 30:
        return {"": array}
    present = {str(number): person for number, person in enumerate(people, 1) if np.nan_to_num(person).any()}
    return present if len(present) > 1 else {"": next(iter(present.values()), array)}


def _people(values: Any, arrays: Arrays, what: str) -> People:
    """The subjects whose joints are in one array, told apart by the joints' names."""
    values = samples_of(values, what, (2, 3))
    if values.ndim == 3 and values.shape[0] == 1 and values.shape[2] not in (3, 4, 5):
        values = values[0]
    names = _names(arrays)
    if names is None:
        return {"": partial(_without_names, values, arrays)}
    (joints, layout), labels = _joints(values, arrays, names), numbered(names, "#")
    if len(set(names)) < len(names) and not subjects(labels, absent_joints):
        named_points(joints, names)  # refuses names that are repeated by mistake
    place = {label: number for number, label in enumerate(labels)}
    return people_of_labels(labels, absent_joints, partial(_of_subject, arrays, joints, place, layout))


def _without_names(values: np.ndarray, arrays: Arrays) -> Tracks:
    """Tracks of joints in a known order, or of HumanML3D vectors."""
    if values.ndim == 2 and values.shape[1] == WIDTH:
        return _at_rate(read_vectors(values), arrays)
    joints, clauses = _joints(values, arrays, None)
    return _at_rate(_in_order(joints, arrays), arrays).saying(*clauses)


def _of_subject(
    arrays: Arrays, joints: np.ndarray, place: Mapping[str, int], layout: tuple[str, ...], labels: Labels
) -> Tracks:
    """The subject who has these labels; `place` gives the index of each among the joints (T, K, 3)."""
    points, sources = named_points(joints[:, [place[label] for label in labels.values()]], tuple(labels))
    clauses = (
        f"{len({name for source in sources.values() for name in source})} of its {len(place)} named joints",
        *layout,
    )
    tracks = Tracks(form="named joints", points=points, rate_hz=NAMED_RATE_HZ, clauses=clauses, up=_up(arrays))
    return _at_rate(tracks, arrays)


def _at_rate(tracks: Tracks, arrays: Arrays) -> Tracks:
    rate_hz = stated_rate(arrays, len(tracks))
    return replace(tracks, rate_hz=tracks.rate_hz if rate_hz is None else rate_hz, rate_assumed=rate_hz is None)


def _joints(values: np.ndarray, arrays: Arrays, names: Sequence[str] | None) -> tuple[np.ndarray, tuple[str, ...]]:
    """Joints (T, K, 3), and clauses on how they were found: from (T, K, 3), with a confidence behind each point or without, from
    (T, 3 K), joint by joint or all x first (MARS), or from (K, 3, T) as motion diffusion models write it."""
    clauses: tuple[str, ...] = ()
    if values.ndim == 3 and values.shape[2] in (4, 5) and values.shape[1] != 3:
        values, clauses = _of_confidence(values, arrays.path)
    layouts = _layouts(values)
    fitting = [layout for layout in layouts.values() if layout.shape[1] <= MOST_JOINTS]
    if not fitting:
        raise InputError(f"{arrays.path} holds an array of shape {shown(values.shape)}; expected {FORMS}")
    if names is not None and all(len(names) != layout.shape[1] for layout in fitting):
        raise InputError(f"{arrays.path} names {len(names)} joints but holds {fitting[0].shape[1]}")
    joints = {label: seen(layout) for label, layout in layouts.items() if layout.shape[1] <= MOST_JOINTS}
    how = min(joints, key=lambda label: _unlikely(joints[label], names)) if len(joints) > 1 else next(iter(joints))
    return joints[how], (*clauses, how) if how else clauses


def _layouts(values: np.ndarray) -> dict[str, np.ndarray]:
    """Joints (T, K, 3) in each layout that an array may have, by the clause that reports it, "" for a usual layout."""
    if values.ndim == 2 and values.shape[1] % 3 == 0:
        return {
            "": values.reshape(len(values), -1, 3),
            "columns of all x, all y, all z": values.reshape(len(values), 3, -1).swapaxes(1, 2),
        }
    if values.ndim != 3:
        return {}
    if values.shape[2] != 3 and values.shape[1] == 3:
        return {"": np.moveaxis(values, 2, 0), "rows of all x, all y, all z": values.swapaxes(1, 2)}
    return {"": values} if values.shape[2] == 3 else {}


def _unlikely(joints: np.ndarray, names: Sequence[str] | None) -> float:
    """How unlike a person joints (T, K, 3) are with these names, or else in the order that fits best; infinite if none fits."""
    if names is None:
        return likeliest_order(joints)[1]
    if len(names) != joints.shape[1] or absent_joints(names) or len(set(names)) < len(names):
        return math.inf
    return unlikeness(named_points(joints, names)[0])


def _of_confidence(values: np.ndarray, path: Path) -> tuple[np.ndarray, tuple[str, ...]]:
    """Points (T, K, 3) of an estimator, NaN where the confidence is 0 or missing, and clauses on that for the report."""
    points, confidence = values[..., :3], values[..., 3]
    stated = np.isfinite(confidence)
    if not ((confidence[stated] >= 0) & (confidence[stated] <= 1)).all():
        raise InputError(
            f"{path}: the fourth number of each point must be a confidence from 0 to 1, got "
            f"{shown(np.nanmax(np.abs(confidence)))}; store x, y, z alone if it is another"
        )
    unseen, guessed = ~(confidence > 0), stated & (confidence > 0) & (confidence < SURE)
    clauses = [f"{np.mean(unseen):.1%} of the points have no confidence and count as not seen"] * bool(unseen.any())
    clauses += [f"{np.mean(guessed):.1%} of the points have a confidence under {SURE:g}"] * bool(guessed.any())
    return np.where(unseen[..., None], np.nan, points), tuple(clauses)


def _in_order(joints: np.ndarray, arrays: Arrays) -> Tracks:
    order = likeliest_order(joints)[0]
    if order is None:
        never = np.flatnonzero(np.isnan(joints).any(axis=-1).all(axis=0))
        unseen = (
            f", and {'those' if len(never) > 1 else 'that'} at {shown(never.tolist())} never seen" if len(never) else ""
        )
        raise InputError(
            f"{arrays.path}: {joints.shape[1]} joints without names{unseen} make no person in any known order "
            f"({', '.join(f'{name}: {len(joint_names)}' for name, joint_names in ORDERS.items())}); store their `names`"
        )
    if order == "HumanML3D":
        tracks = read_joints(joints[:, : len(CANONICAL_JOINTS)])
        more = joints.shape[1] - len(CANONICAL_JOINTS)
        return tracks if not more else replace(tracks, clauses=(f"the first 22 of its {joints.shape[1]} joints",))
    if order.startswith("MediaPipe") and np.nanmin(joints[..., :2]) >= 0 and np.nanmax(joints[..., :2]) <= 1:
        raise InputError(
            f"{arrays.path} holds MediaPipe's landmarks in the picture, x and y from 0 to 1, of which no lengths follow; store its "
            "world landmarks (pose_world_landmarks), in metres"
        )
    points, _ = named_points(joints, ORDERS[order])
    rate_hz = tables()["order_rates_hz"].get(order, NAMED_RATE_HZ)
    return Tracks(form=f"joints in the order of {order}", points=points, rate_hz=rate_hz)


def _names(arrays: Arrays) -> tuple[str, ...] | None:
    key = arrays.first("names", "joint_names", "joints_names")
    if key is None:
        return None
    stored = arrays.get(key)
    if stored.ndim != 1 or stored.dtype.kind not in "US":
        raise InputError(f"{arrays.path}: {key} must be a list of joint names, got {shown(stored)}")
    return tuple(name.decode("utf-8", "replace") if isinstance(name, bytes) else str(name) for name in stored.tolist())


def _up(arrays: Arrays) -> Up | None:
    if "up" not in arrays:
        return None
    stored: Any = arrays.get("up")
    word = str(stored.reshape(-1)[0]).lower() if stored.size == 1 and stored.dtype.kind in "US" else ""
    if word.lstrip("+") not in ("x", "y", "z", "-x", "-y", "-z"):
        raise InputError(f"{arrays.path}: up must be an axis such as 'z' or '-y', got {shown(stored)}")
    return cast(Up, word.lstrip("+"))
