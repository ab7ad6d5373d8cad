"""Body templates: the surface at rest, its weights on the canonical joints, and rings of vertices that mark the joints."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from t2d_rt.body.outfit import Outfit, put_on
from t2d_rt.core.checks import unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.core.resources import listing, resource
from t2d_rt.geometry.vectors import unit
from t2d_rt.types.motion import CANONICAL_JOINTS

LIMB_GIRTHS = {"hip": 1.1, "knee": 0.8, "shoulder": 1.2, "elbow": 1.3}
"""The entries of `GIRTHS` for limbs."""

Ring = tuple[np.ndarray, np.ndarray]
"""Vertex indices (R,) and weights (R,), whose weighted mean is the position of a joint."""


ABOUT: Mapping[str, str] = {
    "adult": "a slim adult between man and woman",
    "child": "a child of 7 to 8 years",
    "heavy": "an adult of body mass index 35",
    "man": "an average man",
    "old": "an adult of about 70 years",
    "woman": "an average woman",
}
"""Descriptions of the shipped bodies; meshes/README.md has their measures and sources."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Template:
    """A closed control cage in its rest pose: facing +x, left is +y, z up, feet on z = 0, in metres."""

    name: str
    vertices: np.ndarray
    """Vertices at rest [m], (V, 3)."""
    faces: np.ndarray
    """Triangles, counter-clockwise from outside, int32 (F, 3)."""
    weights: np.ndarray
    """Skinning weights of the 22 canonical joints, (V, 22); at most four per vertex are not zero, and rows sum to 1."""
    joints: Mapping[str, np.ndarray]
    """Positions at rest [m] (3,) of the canonical joints and of all optional ends."""
    rings: Mapping[str, Ring]
    """Rings of surface vertices around hips, knees, ankles, shoulders, elbows, wrists and head."""

    like: np.ndarray | None = None
    """Rest vertices [m], (V, 3), of the shipped body in the same outfit from which this one was made, and whose facets it shares;
    None for a shipped body."""
    outfit: Outfit | None = None
    """Outfit that the body wears; None for the bare body."""

    @property
    def stature_m(self) -> float:
        """Height above the soles at rest [m]."""
        return float(np.ptp(self.vertices[:, 2]))

    @property
    def bmi(self) -> float:
        """Body mass index [kg/m^2]."""
        return DENSITY_KG_PER_M3 * _volume_m3(self.vertices, self.faces) / self.stature_m**2

    @property
    def bmi_limits(self) -> tuple[float, float]:
        """Least and greatest body mass index for which this body can be made [kg/m^2]."""
        return BMI[self.name.partition("@")[0]]

    def __reduce__(self) -> tuple[Any, ...]:
        return template, (self.name, self.outfit)  # pickled by its name


def bodies() -> list[str]:
    """Names of the shipped bodies."""
    return [name.removesuffix(".npz") for name in listing("meshes", ".npz")]


GIRTHS: Mapping[str, float | tuple[float, float]] = {
    **dict.fromkeys(("pelvis", "spine1", "spine2"), (2.0, 1.4)),
    **dict.fromkeys(("spine3", "left_collar", "right_collar"), (1.4, 1.0)),
    **{f"{side}_{joint}": power for side in ("left", "right") for joint, power in LIMB_GIRTHS.items()},
}
"""Powers of the root of the body mass index with which each part grows across its bone, for the trunk in depth and breadth; fitted
to the five shipped adults with an index of 21.6 to 35. Head, hands and feet do not grow."""

BMI = {"child": (13.5, 19.5)} | dict.fromkeys(("adult", "heavy", "man", "old", "woman"), (18.5, 40.0))
"""Least and greatest body mass index for which each body can be made. Children: those of 5 and 95 % at 7.5 years (CDC growth charts
2000). Adults: from underweight to obese of class III (WHO Technical Report Series 894, 2000)."""

DENSITY_KG_PER_M3 = 1000.0
"""Mean density of a body [kg/m^3]; a body just floats."""


def template(name: str = "adult", outfit: Outfit | None = None) -> Template:
    """The shipped body of that name or, as "man@31.5", the same person with another body mass index [kg/m^2]; bare, or in an
    outfit."""
    if outfit is not None:
        return _dressed(name, outfit)
    base, at, bmi = name.partition("@") if isinstance(name, str) else (name, "", "")
    if not isinstance(name, str) or base not in bodies():
        raise unknown_name("body", name, bodies(), hint=', or one with its body mass index as "man@31.5"')
    if not at:
        return _read(base)
    try:
        bmi_value = float(bmi)
    except ValueError:
        bmi_value = math.nan
    low, high = BMI[base]
    if not low <= bmi_value <= high:
        raise InputError(
            f"the body mass index of {base} must be {low:g} to {high:g} kg/m^2, got {bmi!r} in body {name!r}"
        )
    return _of_girth(name, base, bmi_value)


@lru_cache(maxsize=64)
def _dressed(name: str, outfit: Outfit) -> Template:
    """A body with cloth and shoes around it."""
    body = template(name)
    vertices = put_on(outfit, body.vertices, body.faces, body.weights, body.joints)
    like = None if body.like is None else template(name.partition("@")[0], outfit).vertices
    return replace(body, vertices=vertices, like=like, outfit=outfit)


@lru_cache(maxsize=64)
def _of_girth(name: str, base: str, bmi: float) -> Template:
    """A shipped body made thicker or thinner: each part grows by its own power of a common factor, chosen to give the volume asked
    for."""
    body, (powers, growth) = _read(base), _growth(base)
    volume_m3 = bmi * body.stature_m**2 / DENSITY_KG_PER_M3
    girth, vertices = 1.0, body.vertices
    for _ in range(5):  # the volume grows about with the square of the girth
        girth *= math.sqrt(volume_m3 / _volume_m3(vertices, body.faces))
        vertices = body.vertices + np.tensordot(girth**powers - 1, growth, 1)
    return replace(body, name=name, vertices=vertices, like=body.vertices)


@lru_cache(maxsize=8)
def _growth(base: str) -> tuple[np.ndarray, np.ndarray]:
    """Powers of the girth (P,), and for each of them the displacement of the vertices (P, V, 3) [m] where its part doubles its
    girth."""
    body, growth = _read(base), dict[float, np.ndarray]()
    depth, breadth = np.diag([1.0, 0.0, 0.0]), np.diag([0.0, 1.0, 0.0])
    for joint, powers in GIRTHS.items():
        scaled = body.weights[:, [CANONICAL_JOINTS.index(joint)]] * (body.vertices - body.joints[joint])
        if isinstance(powers, tuple):
            parts = {powers[0]: depth, powers[1]: breadth}
        else:
            along = unit(body.joints[_end(joint)] - body.joints[joint])
            parts = {powers: np.eye(3) - np.outer(along, along)}
        for power, across in parts.items():
            growth[power] = growth.get(power, np.zeros_like(scaled)) + scaled @ across
    return np.array(list(growth)), np.array(list(growth.values()))


def _end(joint: str) -> str:
    """Name of the joint at the far end of a limb's bone."""
    side, _, start = joint.partition("_")
    return f"{side}_{dict(shoulder='elbow', elbow='wrist', hip='knee', knee='ankle')[start]}"


def _volume_m3(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c))) / 6


def rest_joints(body: str = "adult") -> dict[str, np.ndarray]:
    """Positions [m] (3,) of the 22 canonical joints and the five ends of a body in its rest pose: facing +x, left is +y, soles on z
    = 0, legs slightly apart, arms hanging away from the trunk.

    Their differences are the bones of a skeleton with that body's proportions, to which a motion may be fitted.
    """
    return {name: place.copy() for name, place in template(body).joints.items()}


@lru_cache(maxsize=8)
def _read(name: str) -> Template:
    with np.load(resource("meshes", f"{name}.npz"), allow_pickle=False) as data:
        names = [str(joint) for joint in data["joint_names"]]
        weights = data["weights"].astype(np.float64)
        starts, indices, ring_weights = (data[f"ring_{part}"] for part in ("starts", "vertices", "weights"))
        rings = {
            str(ring): (indices[i:j].astype(np.intp), ring_weights[i:j].astype(np.float64))
            for ring, i, j in zip(data["ring_names"], starts, starts[1:], strict=False)
        }
        return Template(
            name=name,
            vertices=data["vertices"].astype(np.float64),
            faces=data["faces"].astype(np.int32),
            weights=weights / weights.sum(1, keepdims=True),
            joints=MappingProxyType(dict(zip(names, data["joints"].astype(np.float64), strict=True))),
            rings=MappingProxyType(rings),
        )


def regressed_joints(body: Template, vertices: np.ndarray) -> dict[str, np.ndarray]:
    """Joints (..., 3) from posed surface vertices (..., V, 3): the weighted mean of each ring."""
    return {name: weight @ vertices[..., index, :] for name, (index, weight) in body.rings.items()}
