"""`to_world` of a Mitsuba XML file as a matrix, and the numbers in its attributes."""

from __future__ import annotations

import math
from xml.etree.ElementTree import Element

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError

NUMBERS = "0123456789+-.eE"


def to_world(transform: Element | None) -> np.ndarray:
    """The matrix (4, 4) of a <transform>: its steps one after another, the identity for None."""
    steps = {"translate": _translate, "scale": _scale, "rotate": _rotate, "matrix": _matrix, "lookat": _lookat}
    matrix = np.eye(4)
    for step in [] if transform is None else transform:
        if step.tag not in steps:
            raise InputError(f"a transform holds <{shown(step.tag)[1:-1]}>; write it with {', '.join(steps)}")
        matrix = steps[step.tag](step) @ matrix
    if not np.isfinite(matrix).all() or not np.array_equal(matrix[3], [0, 0, 0, 1]):
        raise InputError("a transform is not finite, or not affine; its last row must be 0 0 0 1")
    return matrix


def moved(vertices: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Vertices (V, 3) under an affine matrix (4, 4), rounded to float32 as ray tracers hold them."""
    if np.array_equal(matrix, np.eye(4)):
        return vertices
    with np.errstate(over="ignore", invalid="ignore"):  # what does not fit is found to be infinite where it is checked
        there = vertices @ matrix[:3, :3].T + matrix[:3, 3]
        return there.astype(np.float32).astype(np.float64)


def numbers(text: str | None, *counts: int) -> list[float]:
    """Finite numbers of an attribute, parted by spaces or commas: as many as one of the counts says."""
    words = (text or "").replace(",", " ").split()
    try:
        if len(words) not in counts or not set("".join(words)) <= set(NUMBERS):
            raise ValueError
        found = [float(word) for word in words]
        if not np.isfinite(found).all():
            raise ValueError
    except ValueError:
        expected = " or ".join(str(count) for count in counts)
        raise InputError(f"{expected} finite numbers were expected, got {shown(text)}; correct it") from None
    return found


def _vector(step: Element, default: float, *, others: tuple[str, ...] = ()) -> np.ndarray:
    """x, y, z of a step, from `value` (one or three numbers) or one by one."""
    unknown = step.attrib.keys() - {"x", "y", "z", "value", *others}
    if unknown or ("value" in step.attrib and step.attrib.keys() & {"x", "y", "z"}):
        raise InputError(f"<{step.tag}> takes either value or x, y and z, got {shown(sorted(step.attrib))}; correct it")
    if "value" in step.attrib:
        return np.broadcast_to(numbers(step.get("value"), 1, 3), 3)
    return np.array([numbers(step.get(axis, str(default)), 1)[0] for axis in "xyz"])


def _translate(step: Element) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = _vector(step, 0.0)
    return matrix


def _scale(step: Element) -> np.ndarray:
    return np.diag([*_vector(step, 1.0), 1.0])


def _rotate(step: Element) -> np.ndarray:
    """About an axis, whose length does not count, by an angle in degrees (Rodrigues)."""
    axis, angle = _vector(step, 0.0, others=("angle",)), math.radians(numbers(step.get("angle"), 1)[0])
    length = np.linalg.norm(axis)
    if not length:
        raise InputError("<rotate> has no axis; give x, y or z")
    x, y, z = axis / length
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(4)
    matrix[:3, :3] += math.sin(angle) * across + (1 - math.cos(angle)) * across @ across
    return matrix


def _matrix(step: Element) -> np.ndarray:
    values = np.array(numbers(step.get("value"), 9, 16))
    if len(values) == 16:
        return values.reshape(4, 4)
    matrix = np.eye(4)
    matrix[:3, :3] = values.reshape(3, 3)
    return matrix


def _lookat(step: Element) -> np.ndarray:
    """z of the shape towards the target, y as far up as may be."""
    origin, target, up = (np.array(numbers(step.get(name), 3)) for name in ("origin", "target", "up"))
    ahead = target - origin
    left = np.cross(up, ahead)
    if not np.linalg.norm(left) > 0:
        raise InputError("<lookat> looks nowhere, or along its up; give another target or up")
    ahead, left = ahead / np.linalg.norm(ahead), left / np.linalg.norm(left)
    matrix = np.eye(4)
    matrix[:3] = np.stack([left, np.cross(ahead, left), ahead, origin], axis=1)
    return matrix
