"""Arrays of joints -> tracks: Kimodo's .npz, a .npz with joints, names and a rate, or a bare .npy ordered by its limbs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.motion.quaternions import from_matrix
from t2d_rt.motion.read.arrays import Arrays, samples_of
from t2d_rt.motion.read.clock import stated_rate
from t2d_rt.motion.read.detect import Up
from t2d_rt.motion.read.humanml3d import WIDTH, read_joints, read_vectors
from t2d_rt.motion.read.joint_sets import ORDERS, absent_joints, guessed_order, named_points
from t2d_rt.motion.read.samples import filled, seen
from t2d_rt.motion.read.subjects import Labels, check_only, chosen, numbered, of_labels, subjects
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.motion.skeletons import tables
from t2d_rt.types.motion import CANONICAL_JOINTS

# --- kimodo's .npz -> tracks: posed_joints (T, 30, 3) [m], global_rot_mats (T, 30, 3, 3), 30 frames a second, y up,
# facing z ---


RATE_HZ = 30.0
JOINTS = 30

PLACES: Mapping[str, int] = tables()["kimodo"]
"""Canonical joint -> its place among those of the file."""

LEAST_ORTHONORMAL = 1e-2
"""Deviation of R R^T from the unit matrix from which matrices are no rotations."""


def read_kimodo(arrays: Arrays) -> Tracks:
    """Positions and, where the file has them, rotations."""
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
        if not (deviation < LEAST_ORTHONORMAL and (np.linalg.det(matrices) > 0).all()):
            raise InputError(
                f"{arrays.path}: global_rot_mats are no rotation matrices; they deviate by {deviation:.2g}"
            )
        turned = from_matrix(matrices)
        orientations = {name: turned[:, place] for name, place in PLACES.items()}
    return Tracks(form="Kimodo", points=points, turned=orientations, rate_hz=rate_hz, unit_m=1.0, up="y").without(lost)


# --- plain arrays of joints -> tracks: a .npz with joints, names and a rate, or a bare .npy whose order is found from
# its limbs ---


JOINT_FIELDS = ("joints", "positions", "joints3d", "keypoints", "keypoints3d", "motion", "poses3d", "arr_0", "")
NAME_FIELDS = ("names", "joint_names", "joints_names")
NAMED_RATE_HZ = 30.0
"""Of cameras, where a file does not say."""

MOST_JOINTS = 200

MOST_PERSONS = 30
"""In one array."""

FORMS = "(T, 22, 3) HumanML3D joints, (T, 263) HumanML3D vectors, or (T, K, 3) joints with `names` in a .npz"


def read_plain(arrays: Arrays, subject: str | None = None) -> Tracks:
    """Joints (T, K, 3), named or in a known order, or HumanML3D vectors (T, 263); of several persons (T, P, K, 3) one."""
    key = arrays.first(*JOINT_FIELDS) or (next(iter(arrays.texts)) if len(arrays.texts) == 1 else None)
    if key is None:
        raise InputError(f"{arrays.path} holds {shown(list(arrays.texts))} but no joints; expected {FORMS}")
    persons = _persons(arrays, key)
    what = f"{arrays.path}: {key or 'the array'}"
    values, who = chosen(persons, None if "" in persons else subject, partial(samples_of, what=what, dims=(2, 3)))
    tracks = _of_one(values, arrays, subject if "" in persons else None)
    return replace(tracks, told=(*who, *tracks.told))


def _persons(arrays: Arrays, key: str) -> dict[str, np.ndarray]:
    """Persons by number of an array (T, P, K, 3) or (P, T, K, 3), those who are seen at all; an only one has no name."""
    found = arrays.get(key)
    if found.ndim != 4 or found.shape[3] != 3 or min(found.shape) < 2 or found.dtype.kind not in "fiu":
        return {"": found}
    people = np.moveaxis(found, int(found.shape[1] < found.shape[0]), 0)
    if len(people) > MOST_PERSONS:
        return {"": found}
    there = {str(number): each for number, each in enumerate(people, 1) if np.nan_to_num(each).any()}
    return there if len(there) > 1 else {"": next(iter(there.values()), found)}


def _of_one(values: np.ndarray, arrays: Arrays, subject: str | None) -> Tracks:
    if values.ndim == 3 and values.shape[0] == 1 and values.shape[2] != 3:
        values = values[0]
    names = _names(arrays)
    if names is None:
        check_only(subject)
        if values.ndim == 2 and values.shape[1] == WIDTH:
            return _at_rate(read_vectors(values), arrays)
        return _at_rate(_in_order(_joints(values, arrays, names), arrays), arrays)
    joints, labels = _joints(values, arrays, names), numbered(names)
    if len(set(names)) < len(names) and not subjects(labels, absent_joints):
        named_points(joints, names)  # refuses names that are repeated by mistake
    place = {label: number for number, label in enumerate(labels)}
    (points, sources), who = of_labels(labels, absent_joints, subject, partial(_of_subject, joints, place))
    told = (*who, f"{len({each for source in sources.values() for each in source})} of its {len(names)} named joints")
    return _at_rate(
        Tracks(form="named joints", points=points, rate_hz=NAMED_RATE_HZ, told=told, up=_up(arrays)), arrays
    )


def _of_subject(
    joints: np.ndarray, place: Mapping[str, int], own: Labels
) -> tuple[dict[str, np.ndarray], dict[str, tuple[str, ...]]]:
    """Points of the subject who has these labels, and which of them stand for which joint."""
    return named_points(joints[:, [place[each] for each in own.values()]], tuple(own))


def _at_rate(tracks: Tracks, arrays: Arrays) -> Tracks:
    rate_hz = stated_rate(arrays, len(tracks))
    return replace(tracks, rate_hz=tracks.rate_hz if rate_hz is None else rate_hz, rate_assumed=rate_hz is None)


def _joints(values: np.ndarray, arrays: Arrays, names: Sequence[str] | None) -> np.ndarray:
    """(T, K, 3) from (T, K, 3), from (T, 3 K), or from (K, 3, T) as motion diffusion models write it."""
    if values.ndim == 3 and values.shape[2] != 3 and values.shape[1] == 3:
        values = np.moveaxis(values, 2, 0)
    if values.ndim == 2 and values.shape[1] % 3 == 0:
        values = values.reshape(len(values), -1, 3)
    if values.ndim != 3 or values.shape[2] != 3 or values.shape[1] > MOST_JOINTS:
        raise InputError(f"{arrays.path} holds an array of shape {shown(values.shape)}; expected {FORMS}")
    if names is not None and len(names) != values.shape[1]:
        raise InputError(f"{arrays.path} names {len(names)} joints but holds {values.shape[1]}")
    return seen(values)


def _in_order(joints: np.ndarray, arrays: Arrays) -> Tracks:
    order = guessed_order(joints)
    if order is None:
        never = np.flatnonzero(np.isnan(joints).any(axis=-1).all(axis=0))
        unseen = (
            f", and {'those' if len(never) > 1 else 'that'} at {shown(never.tolist())} never seen" if len(never) else ""
        )
        raise InputError(
            f"{arrays.path}: {joints.shape[1]} joints without names{unseen} make no person in any known order "
            f"({', '.join(f'{name}: {len(each)}' for name, each in ORDERS.items())}); store their `names`"
        )
    if order == "HumanML3D":
        tracks = read_joints(joints[:, : len(CANONICAL_JOINTS)])
        more = joints.shape[1] - len(CANONICAL_JOINTS)
        return tracks if not more else replace(tracks, told=(f"the first 22 of its {joints.shape[1]} joints",))
    points, _ = named_points(joints, ORDERS[order])
    return Tracks(form=f"joints in the order of {order}", points=points, rate_hz=NAMED_RATE_HZ)


def _names(arrays: Arrays) -> tuple[str, ...] | None:
    key = arrays.first(*NAME_FIELDS)
    if key is None:
        return None
    found = arrays.get(key)
    if found.ndim != 1 or found.dtype.kind not in "US":
        raise InputError(f"{arrays.path}: {key} must be a list of joint names, got {shown(found)}")
    return tuple(each.decode("utf-8", "replace") if isinstance(each, bytes) else str(each) for each in found.tolist())


def _up(arrays: Arrays) -> Up | None:
    if "up" not in arrays:
        return None
    found: Any = arrays.get("up")
    word = str(found.reshape(-1)[0]).lower() if found.size == 1 and found.dtype.kind in "US" else ""
    if word.lstrip("+") not in ("x", "y", "z", "-x", "-y", "-z"):
        raise InputError(f"{arrays.path}: up must be an axis such as 'z' or '-y', got {shown(found)}")
    return cast(Up, word.lstrip("+"))
