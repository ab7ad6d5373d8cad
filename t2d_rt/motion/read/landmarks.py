"""Read text files of cameras and pose estimators as arrays of joints, which are then read like those of a .npz file.

NTU RGB+D's `.skeleton` (Shahroudy et al. 2016): frames of bodies of 25 joints of a Kinect v2 [m]. JSON: frames of OpenPose's
`pose_keypoints_3d` or of MediaPipe's world landmarks, one list of them in a file.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes
from t2d_rt.motion.read.arrays import Arrays
from t2d_rt.motion.read.bvh import MAX_FRAMES
from t2d_rt.motion.read.clock import RATE_FIELDS, TIME_FIELD
from t2d_rt.motion.read.joint_sets import ORDERS
from t2d_rt.motion.read.samples import plausible

MAX_BYTES = 100_000_000

KINECT_JOINTS, KINECT_NUMBERS, BODY_NUMBERS = 25, 12, 10
"""In a .skeleton file: the joints of a body, the numbers of a joint, and the numbers of the line before the joints."""
TRACKED = {0: 0.0, 1: 0.4, 2: 1.0}
"""Confidence that a Kinect's tracking state stands for: not tracked, inferred, tracked."""
MOST_BODIES = 30

FRAME_LISTS = ("frames", "annotations", "results", "poses", "data", "landmarks")
WORLD = ("poseworldlandmarks", "worldlandmarks")
IN_PICTURE = ("poselandmarks", "landmarks", "landmark", "keypoints3d", "keypoints")
"""Names of the landmarks of a frame, without underscores and in lower case; those in metres come first."""

Person = list[list[float]]
"""For each point x, y, z, and a confidence where there is one; empty if nobody is seen."""


def read_ntu(path: Path) -> Arrays:
    """Joints (T, P, 25, 4) with confidences, and their names; persons are in the order of how long they are seen.

    Raises an InputError if the file is no skeleton file of NTU RGB+D.
    """
    words = iter(read_bytes(path, limit=MAX_BYTES, noun="skeleton file").split())
    bodies: dict[str, dict[int, np.ndarray]] = {}
    try:
        frames = int(next(words))
        if not 2 <= frames <= MAX_FRAMES:
            raise InputError(f"{path} has {frames} frames; expected 2 to {MAX_FRAMES}")
        for frame in range(frames):
            for _ in range(_count(next(words), MOST_BODIES)):
                name = next(words).decode("ascii", "replace")
                _take(words, BODY_NUMBERS - 1)
                if int(next(words)) != KINECT_JOINTS:
                    raise ValueError
                rows = _take(words, KINECT_JOINTS * KINECT_NUMBERS).reshape(KINECT_JOINTS, KINECT_NUMBERS)
                sure = [TRACKED[int(state)] for state in rows[:, -1]]
                bodies.setdefault(name, {})[frame] = np.column_stack([rows[:, :3], sure])
    except InputError:
        raise
    except (ValueError, KeyError, OverflowError, StopIteration):
        raise InputError(
            f"{path} is not an NTU RGB+D skeleton file, or cut short: frames of bodies of {KINECT_JOINTS} joints with "
            f"{KINECT_NUMBERS} numbers each are expected"
        ) from None
    if not 0 < len(bodies) <= MOST_BODIES:
        raise InputError(f"{path} holds {len(bodies)} bodies; expected 1 to {MOST_BODIES}")
    joints = np.full((frames, len(bodies), KINECT_JOINTS, 4), np.nan)
    for place, body in enumerate(sorted(bodies.values(), key=len, reverse=True)):
        joints[list(body), place] = list(body.values())
    return Arrays(path, {"joints": joints if len(bodies) > 1 else joints[:, 0], "names": np.array(ORDERS["Kinect v2"])})


def _count(word: bytes, most: int) -> int:
    number = int(word)
    if not 0 <= number <= most:
        raise ValueError
    return number


def _take(words: Iterator[bytes], count: int) -> np.ndarray:
    return np.array([float(next(words)) for _ in range(count)])


def read_json(tree: Any, path: Path) -> Arrays:
    """Joints (T, P, K, 3 or 4) of a JSON tree of frames, with rate and times that it states; raises an InputError for others."""
    top = tree if isinstance(tree, dict) else {}
    frames = next((top[name] for name in top if name.lower() in FRAME_LISTS and isinstance(top[name], list)), tree)
    if not isinstance(frames, list) or not 2 <= len(frames) <= MAX_FRAMES:
        raise InputError(
            f"{path} holds no list of frames: expected DeepMimic's \"Frames\", or a list of OpenPose's frames with "
            "pose_keypoints_3d or of MediaPipe's with pose_world_landmarks; join the files of single frames into one list"
        )
    people, openpose = [], False
    for number, frame in enumerate(frames):
        try:
            people.append(_people(frame))
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        except (TypeError, ValueError, LookupError, AttributeError, RecursionError):
            raise InputError(f"{path}: frame {number} holds no points x, y, z; got {shown(frame)}") from None
        openpose = openpose or (isinstance(frame, dict) and "people" in frame)
    joints = _followed(people, path)
    arrays = {"joints": joints if joints.shape[1] > 1 else joints[:, 0]}
    if openpose and joints.shape[2] == len(ORDERS["OpenPose BODY_25"]):
        arrays["names"] = np.array(ORDERS["OpenPose BODY_25"])
    arrays |= {name: np.array(top[name], float) for name in RATE_FIELDS if isinstance(top.get(name), int | float)}
    stamps = next((name for name in _fields(frames[0]) if TIME_FIELD.fullmatch(name)), None)
    if stamps is not None and all(
        isinstance(frame, dict) and isinstance(frame.get(stamps), int | float) for frame in frames
    ):
        arrays[stamps] = np.array([frame[stamps] for frame in frames], float)
    return Arrays(path, arrays)


def _fields(frame: Any) -> Sequence[str]:
    return list(frame) if isinstance(frame, dict) else ()


def _people(frame: Any) -> list[Person]:
    """The persons of one frame."""
    if isinstance(frame, dict):
        if "people" in frame:
            return [points for person in frame["people"] if (points := _of_openpose(person))]
        fields = {key.replace("_", "").lower(): value for key, value in frame.items()}
        landmarks = next((fields[name] for name in (*WORLD, *IN_PICTURE) if fields.get(name) is not None), None)
        return [] if landmarks is None and not set(fields) - {"timestamp"} else _people(landmarks)
    if isinstance(frame, list):
        frame = [entry for entry in frame if entry != []]
    if not frame:  # nobody is seen
        return []
    if isinstance(frame[0], list) and isinstance(frame[0][0], list | dict):
        return [_landmarks(person) for person in frame]
    return [_landmarks(frame)]


def _of_openpose(person: dict[str, Any]) -> Person:
    values = person.get("pose_keypoints_3d") or []
    if not values and person.get("pose_keypoints_2d"):
        raise InputError(
            "OpenPose's points lie in the picture (pose_keypoints_2d), of which no lengths follow; give its 3-D ones"
        )
    return [[float(number) for number in values[start : start + 4]] for start in range(0, len(values), 4)]


def _landmarks(points: Any) -> Person:
    """Points as [x, y, z] or {"x": ..., "y": ..., "z": ...}, with a visibility or without."""
    rows = []
    for point in points:
        if isinstance(point, dict):
            sure = [point[name] for name in ("visibility", "score", "confidence") if name in point]
            point = [point["x"], point["y"], point["z"], *sure[:1]]
        rows.append([float(number) for number in point])
    return rows


def _followed(people: Sequence[Sequence[Person]], path: Path) -> np.ndarray:
    """Joints (T, P, K, N) of persons who are followed by where they were last, because estimators list them in any order."""
    from scipy.optimize import linear_sum_assignment

    shapes = {(len(person), len(point)) for frame_people in people for person in frame_people for point in person}
    most = max(map(len, people))
    if len(shapes) != 1 or next(iter(shapes))[1] not in (3, 4, 5) or most > MOST_BODIES:
        raise InputError(
            f"{path}: every person must have the same points of x, y, z and a confidence, got {shown(sorted(shapes))}"
        )
    joints = np.full((len(people), most, *next(iter(shapes))), np.nan)
    last = np.full((most, 3), np.inf)
    for frame, persons in enumerate(people):
        if not persons:
            continue
        here = plausible(np.array(persons, float))
        sure = np.isfinite(here[..., :3]).all(axis=2, keepdims=True) & (np.nan_to_num(here[..., 3:4]) > 0).all(
            2, keepdims=True
        )
        middle = np.where(sure, here[..., :3], 0.0).sum(axis=1) / np.maximum(sure.sum(axis=1), 1)
        away = np.linalg.norm(np.nan_to_num(middle[:, None] - last, posinf=1e6, neginf=-1e6), axis=2)
        for who, place in zip(*linear_sum_assignment(away), strict=True):
            joints[frame, place], last[place] = here[who], middle[who]
    return joints


def json_of(path: Path) -> Any:
    """The tree of a JSON file; raises an InputError if it is not valid."""
    text = read_bytes(path, limit=MAX_BYTES, noun="JSON file")
    try:
        return json.loads(text, parse_int=float)  # floats, as no number of digits overflows them
    except (ValueError, RecursionError):
        raise InputError(f'{path} is not valid JSON; a DeepMimic motion is an object with "Frames"') from None
