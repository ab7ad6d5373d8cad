"""A door that opens and closes."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from t2d_rt.core.errors import InputError
from t2d_rt.scene.movers.solids import Angle, Seconds, Substance, about_z, check_speed, ease, moving, sheet
from t2d_rt.types import MovingMesh
from t2d_rt.types.fields import Fields, Number, Vector

STEP_M = 0.1
"""Distance between vertices [m], the points at which visibility is sampled."""


class Door(Fields):
    """The leaf of a door, which opens smoothly, once or periodically.

    The speed of its edge is at most 15/8 x width x angle / opening_s.
    """

    noun: ClassVar[str] = "door"

    kind: Literal["door"] = "door"
    position_m: Vector
    """Position of the lower end of its hinges [m]."""
    heading_deg: Angle = 90.0
    """Direction of the closed leaf from its hinges: 0 is +x, 90 is +y."""
    width_m: Annotated[Number, Field(ge=0.01, le=10)] = 0.8
    height_m: Annotated[Number, Field(ge=0.01, le=10)] = 2.0
    thickness_m: Annotated[Number, Field(ge=0.001, le=0.5)] = 0.04
    angle_deg: Angle = 80.0
    """Angle by which it opens, counter-clockwise seen from above; negative opens clockwise."""
    opens_at_s: Annotated[Number, Field(ge=0)] = 0.5
    opening_s: Seconds = 1.5
    """Duration of opening, and of closing."""
    period_s: Seconds | None = 5.0
    """Time from one opening to the next; it begins to close half of that after it begins to open. None: it opens only once."""
    material: Substance = "wood"

    @model_validator(mode="after")
    def _check_together(self) -> Self:
        if self.period_s is not None and self.period_s < 2 * self.opening_s:
            raise InputError(
                f"a door of period_s {self.period_s:g} s cannot open and close in {self.opening_s:g} s each; "
                f"raise period_s to {2 * self.opening_s:g} or more"
            )
        speed_mps = 15 / 8 * self.width_m * math.radians(abs(self.angle_deg)) / self.opening_s
        check_speed(speed_mps, "door's edge", "raise opening_s")
        return self

    def opening(self, times_s: np.ndarray) -> np.ndarray:
        """Fraction of the angle by which it is open at times (K,), 0..1, (K,)."""
        since = times_s - self.opens_at_s
        if self.period_s is None:
            return ease(since / self.opening_s)
        since = np.where(since < 0, 0, since % self.period_s)
        return ease(since / self.opening_s) - ease((since - self.period_s / 2) / self.opening_s)

    def mesh(self, start_s: float, stop_s: float) -> MovingMesh:
        """The leaf from `start_s` to `stop_s` [s]."""
        along = np.linspace(0, self.width_m, max(2, math.ceil(self.width_m / STEP_M)) + 1)
        up = np.linspace(0, self.height_m, max(2, math.ceil(self.height_m / STEP_M)) + 1)
        middle = np.stack(np.broadcast_arrays(along, 0.0, up[:, None]), axis=-1)
        half = np.array([0, self.thickness_m / 2, 0])
        leaf, faces = sheet(middle - half, middle + half)

        return moving(self, partial(self._opened, leaf), faces, (start_s, stop_s), name=self.noun)

    def _opened(self, leaf: np.ndarray, times_s: np.ndarray) -> np.ndarray:
        angle = np.radians(self.heading_deg + self.angle_deg * self.opening(times_s))
        return np.einsum("kij,vj->kvi", about_z(angle), leaf) + self.position_m
