"""A body template: the rest surface, how it hangs on the canonical joints, and rings that show where they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from t2d_rt.core.checks import unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.core.resources import listing, resource
from t2d_rt.types.motion import CANONICAL_JOINTS, OPTIONAL_JOINTS

Ring = tuple[np.ndarray, np.ndarray]
"""Vertex indices (R,) and weights (R,) whose weighted mean is a joint."""


ABOUT: Mapping[str, str] = MappingProxyType(
    {
        "adult": "a slim adult between man and woman",
        "child": "a child of 7 to 8 years",
        "heavy": "an adult of body mass index 35",
        "man": "an average man",
        "old": "an adult of about 70 years",
        "woman": "an average woman",
    }
)
"""Who the shipped bodies are; meshes/README.md has their measures and where these come from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Template:
    """A closed control cage in its rest pose: facing +x, left is +y, z up, feet on z = 0, metres."""

    name: str
    vertices: np.ndarray
    """Rest vertices [m], (V, 3)."""
    faces: np.ndarray
    """Triangles, counter-clockwise from outside, int32 (F, 3)."""
    weights: np.ndarray
    """Skinning weights of the 22 canonical joints, at most four per vertex, rows sum to 1, (V, 22)."""
    joints: Mapping[str, np.ndarray]
    """Rest positions [m] (3,) of the canonical joints and of all optional ends."""
    rings: Mapping[str, Ring]
    """Rings of surface vertices around hips, knees, ankles, shoulders, elbows, wrists and head."""

    @property
    def stature_m(self) -> float:
        """Height over the soles at rest [m]."""
        return float(np.ptp(self.vertices[:, 2]))

    def __reduce__(self) -> tuple[Any, ...]:
        return template, (self.name,)  # pickled by its name


def bodies() -> list[str]:
    """Names of the shipped bodies."""
    return [name.removesuffix(".npz") for name in listing("meshes", ".npz")]


def template(name: str = "adult") -> Template:
    """The shipped body of that name."""
    if not isinstance(name, str) or name not in bodies():
        raise unknown_name("body", name, bodies())
    return _read(name)


def rest_joints(body: str = "adult") -> dict[str, np.ndarray]:
    """Places [m] (3,) of the 22 canonical joints and the five ends of a body that stands in its rest pose: facing +x, left is +y,
    soles on z = 0, legs a little apart, arms hanging away from the trunk.

    Their differences are the bones of a skeleton in that body's proportions, which a motion may be fitted to.
    """
    return {name: place.copy() for name, place in template(body).joints.items()}


@lru_cache(maxsize=8)
def _read(name: str) -> Template:
    with np.load(resource("meshes", f"{name}.npz"), allow_pickle=False) as data:
        names = [str(joint) for joint in data["joint_names"]]
        if names != [*CANONICAL_JOINTS, *OPTIONAL_JOINTS]:
            raise InputError(f"body {name!r} has joints {names}; expected the 22 canonical joints and the five ends")
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
    """Joints (..., 3) read off posed surface vertices (..., V, 3): the weighted mean of each ring."""
    return {name: weight @ vertices[..., index, :] for name, (index, weight) in body.rings.items()}
