"""Clothing: materials by part of the body, cloth at a distance from the skin, shoes around the feet."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.core.checks import number, shown, text
from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import unit, vertex_normals
from t2d_rt.types.material import ByPart, Material, known_material
from t2d_rt.types.motion import CANONICAL_JOINTS

BARE = "head", "neck", "left_hand", "right_hand"
BARE_JOINTS = "neck", "head", "left_wrist", "right_wrist"
SHOD_JOINTS = "left_ankle", "left_foot", "right_ankle", "right_foot"
"""Joints that move the bare parts of a dressed body, and those that move what is in shoes."""
UPPER_M, TOE_M = 0.004, 0.012
"""Thickness of a shoe's upper, and space in front of the toes, for which shoemakers allow 10 to 15 mm [m]; both are choices."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outfit:
    """What a person wears: shoes, and cloth on all but head, neck and hands.

    >>> Outfit(name="barefoot", shoes="skin", sole_m=0).cloth
    'clothed'
    """

    name: str = "outfit"
    cloth: str | Material = "clothed"
    """Material of trunk, arms and legs."""
    bare: str | Material = "skin"
    """Material of head, neck and hands."""
    shoes: str | Material = "shoe"
    """Material of the feet."""
    cloth_m: float = 0.003
    """Distance of the cloth's surface from the skin [m]."""
    sole_m: float = 0.025
    """Thickness of the soles [m]; 0 keeps the shape of the bare foot, with the material `shoes`."""

    def __post_init__(self) -> None:
        text("name of an outfit", self.name)
        for field in ("cloth", "bare", "shoes"):
            known_material(f"material of an outfit's {field}", getattr(self, field))
        # Thicker cloth would touch that of the other limb, and thicker soles would not bend with the foot.
        number("cloth_m", self.cloth_m, 0, 0.02, unit="m", hint="0.003 is a shirt, 0.012 a coat")
        number("sole_m", self.sole_m, 0, 0.06, unit="m", hint="0.025 is an ordinary shoe, 0 none")

    def of_faces(self, faces: np.ndarray, weights: np.ndarray) -> ByPart:
        """Material of each of the faces (F, 3) of a body that follows the joints by `weights` (V, 22): that of the part that moves
        the face most."""
        bare, shod = (_of_joints(weights, joints)[faces].sum(axis=1) for joints in (BARE_JOINTS, SHOD_JOINTS))
        return self._by_part(np.argmax([3 - bare - shod, bare, shod], axis=0))

    def of_segments(self, names: Sequence[str]) -> ByPart:
        """Material of each of a body's segments."""
        return self._by_part(np.array([1 if name in BARE else 2 if name.endswith("_foot") else 0 for name in names]))

    def _by_part(self, part: np.ndarray) -> ByPart:
        return ByPart((self.cloth, self.bare, self.shoes), part)


OUTFITS: Mapping[str, Outfit] = {"dressed": Outfit(name="dressed"), "coat": Outfit(name="coat", cloth_m=0.012)}
"""Outfits by name. The distance of cloth from the skin is a choice."""


def outfit_of(material: Any) -> Outfit | None:
    """The outfit that is given, or named; None if `material` is a single material for the whole body."""
    if isinstance(material, Outfit):
        return material
    if isinstance(material, ByPart):
        raise InputError(
            f"a body takes a material or an Outfit, got {shown(material)}; its parts are those of an Outfit"
        )
    known_material("material", material, others=OUTFITS)
    return OUTFITS.get(material) if isinstance(material, str) else None


def materials_of(material: str | Material | Outfit, of: Callable[[Outfit], ByPart]) -> str | Material | ByPart:
    """The materials of an outfit by part, from `of`; a single material of the whole body is returned unchanged."""
    outfit = outfit_of(material)
    return of(outfit) if outfit is not None else material  # type: ignore[return-value]


def put_on(
    outfit: Outfit, vertices: np.ndarray, faces: np.ndarray, weights: np.ndarray, joints: Mapping[str, np.ndarray]
) -> np.ndarray:
    """Vertices (V, 3) m of a bare body at rest on z = 0, with cloth and shoes around it.

    The undersides of the feet, and all joints, stay where they are: feet are raised within their shoes by the thickness of the
    soles, and shins become shorter by that. `weights` (V, 22) are those with which vertices follow the joints.
    """
    normals = vertex_normals(vertices, faces)
    bare, shod = _of_joints(weights, BARE_JOINTS), _of_joints(weights, SHOD_JOINTS)
    dressed = vertices + outfit.cloth_m * (1 - bare - shod)[:, None] * normals
    if not outfit.sole_m:
        return dressed
    for side, leftward in (("left", 1), ("right", -1)):
        foot, forward = _of_joints(weights, (f"{side}_ankle", f"{side}_foot")), _forward(side, joints)
        heights_m, along = vertices[:, 2] - vertices[foot > 0.5, 2].min(), vertices @ forward
        under = foot * _ramp(-normals[:, 2], 0.1, 0.4) * (1 - _ramp(heights_m, 0.02, 0.04))
        dressed += UPPER_M * (foot * (1 - under))[:, None] * normals
        toes = foot * _ramp(along, joints[f"{side}_foot"] @ forward, along[foot > 0.5].max())
        dressed += TOE_M * toes[:, None] * forward
        ankle_m, knee_m = (joints[f"{side}_{name}"][2] for name in ("ankle", "knee"))
        raised = np.clip((knee_m - vertices[:, 2]) / (knee_m - ankle_m), 0, 1) * (vertices[:, 1] * leftward > 0)
        dressed[:, 2] += outfit.sole_m * raised * (1 - under)
    return dressed


def _of_joints(weights: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Total weight of some joints at each vertex, 0..1 (V,)."""
    return np.asarray(weights[:, [CANONICAL_JOINTS.index(name) for name in names]].sum(axis=1))


def _forward(side: str, joints: Mapping[str, np.ndarray]) -> np.ndarray:
    """Horizontal unit vector from ankle to toes (3,)."""
    return unit((joints[f"{side}_toe"] - joints[f"{side}_ankle"]) * [1, 1, 0])


def _ramp(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Smooth step from 0 at `low` to 1 at `high`."""
    fraction = np.clip((values - low) / (high - low), 0, 1)
    return np.asarray(fraction * fraction * (3 - 2 * fraction))
