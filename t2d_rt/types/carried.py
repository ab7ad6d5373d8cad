"""`Carried`: a thing that moves with a joint of a person."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from t2d_rt.core.checks import LARGEST_M, array, shown, text, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.types.material import THING_NAMES, Material, known_material
from t2d_rt.types.splines import set_fields

ROTATION_LIMIT = 1e3
"""Greatest component of a quaternion that is accepted; larger ones are taken for a mistake."""
HANDLE_M = 0.12
"""Length of a carried bag's handle, from its grip to its top [m]."""
WHEEL_M, RIM_M = 0.305, 0.26
"""Radii of a wheelchair's rear wheels, of 24 inches, and of their hand rims [m]."""
SIZES = {"bag": 3, "ball": 1, "box": 3, "backpack": 3, "cane": 2, "crutch": 2, "walker": 2, "wheelchair": 4}
"""Number of dimensions that describe the size of each kind of thing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Carried:
    """A thing that a person carries, rigid in the frame of one joint; `carry` makes it, and poses the arms that hold it."""

    thing: str
    """Kind of the thing: bag, box, cane, ... (`SIZES`)."""
    joint: str
    """Joint of the motion that moves the thing rigidly."""
    position_m: tuple[float, float, float]
    """Origin of the thing in the joint's frame [m]."""
    rotation: tuple[float, float, float, float]
    """Its axes, x forward, y left and z up, in the joint's frame: a unit quaternion x, y, z, w."""
    size_m: tuple[float, ...]
    """Its dimensions [m] as `motion.carriers.SIZES_M` lists them, followed by dimensions fitted to the person; for a wheelchair
    also how far ahead of the hips, and how high, its footrest is."""
    material: str | Material

    def __post_init__(self) -> None:
        text("joint", self.joint)
        if not isinstance(self.thing, str) or self.thing not in SIZES:
            raise unknown_name("thing", self.thing, list(SIZES))
        known_material(f"material of a {self.thing}", self.material, others=THING_NAMES)
        position = array("position_m", self.position_m, (3,), limit=LARGEST_M, unit="m")
        rotation = array("rotation", self.rotation, (4,), limit=ROTATION_LIMIT)
        sizes = array("size_m", self.size_m, hint="dimensions [m]", limit=LARGEST_M, unit="m")
        if abs(np.linalg.norm(rotation) - 1) > 1e-6:
            raise InputError(f"rotation must be a unit quaternion x, y, z, w, got {shown(self.rotation)}")
        if sizes.shape != (SIZES[self.thing],) or not (sizes > 0).all():
            raise InputError(
                f"size_m of a {self.thing} must be {SIZES[self.thing]} positive dimensions [m], got {shown(self.size_m)}; use carry"
            )
        arrays = {"position_m": position, "rotation": rotation, "size_m": sizes}
        set_fields(self, **{name: tuple(values.tolist()) for name, values in arrays.items()})
