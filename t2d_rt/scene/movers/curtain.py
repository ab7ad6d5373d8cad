"""A curtain in a draught."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from t2d_rt.core.constants import STANDARD_GRAVITY
from t2d_rt.scene.movers.solids import Angle, Length, Substance, about_z, check_size, moving, sheet
from t2d_rt.types import MovingMesh
from t2d_rt.types.fields import Count, Fields, Number, Vector

THICKNESS_M = 0.002
MODES = 3
"""Number of modes of the hanging cloth that the draught excites; the n-th has 1/n^2 of the amplitude."""
SAGITTA_RAD = 0.5
"""Phase sagitta of its facets [rad], rather large: most of a curtain's echo is diffuse, and its folds are narrow."""
PER_FOLD, ROW_M = 12, 0.1
"""Columns of vertices in a fold, and height of a row of vertices [m]."""


class Curtain(Fields):
    """A curtain in folds that hangs from its rail and swings in a draught.

    Each vertical strip swings in the modes of a hanging chain, J_0(j_n sqrt(d/H)) at d above the lower edge, with angular
    frequencies (j_n/2) sqrt(g/H): 0.4, 0.9 and 1.5 Hz for 2.2 m (Bernoulli; Watson, Bessel Functions, 1). Their phases run
    along it as waves.
    """

    noun: ClassVar[str] = "curtain"

    kind: Literal["curtain"] = "curtain"
    position_m: Vector
    """Position of the middle of its upper edge, at the rail [m]."""
    heading_deg: Angle = 180.0
    """Direction that its front faces: 0 is +x, 90 is +y."""
    width_m: Length = 1.2
    height_m: Length = 2.2
    fold_m: Annotated[Number, Field(gt=0.02, le=1)] = 0.15
    """Distance from one fold to the next [m]."""
    depth_m: Annotated[Number, Field(ge=0, le=0.5)] = 0.04
    """Depth of the folds, from crest to trough [m]."""
    draught_m: Annotated[Number, Field(ge=0, le=0.5)] = 0.08
    """Strength of the draught: amplitude of the slowest mode at the lower edge [m]."""
    wavelength_m: Annotated[Number, Field(ge=0.1, le=20)] = 1.0
    """Wavelength of the waves that run along the curtain [m]."""
    seed: Annotated[Count, Field(ge=0)] = 0
    """Seed of the waves' phases and directions."""
    material: Substance = "fabric"

    @model_validator(mode="after")
    def _check_together(self) -> Self:
        rows, columns = self._grid
        check_size(2 * rows * columns, self.noun, "lower width_m or height_m, or raise fold_m")
        return self

    @property
    def _grid(self) -> tuple[int, int]:
        """Numbers of rows and columns of vertices on each side."""
        columns = max(4, math.ceil(PER_FOLD * self.width_m / self.fold_m)) + 1
        return max(4, math.ceil(self.height_m / ROW_M)) + 1, columns

    def mesh(self, start_s: float, stop_s: float) -> MovingMesh:
        """The cloth from `start_s` to `stop_s` [s]."""
        from scipy.special import j0, jn_zeros

        rows, columns = self._grid
        aside = np.linspace(-self.width_m / 2, self.width_m / 2, columns)
        up = np.linspace(0, 1, rows)
        folds = self.depth_m / 2 * np.sin(2 * math.pi * aside / self.fold_m)
        # Seen from its front, which faces +x, the curtain's +y is to the right.
        rest = np.stack(np.broadcast_arrays(folds, aside, (up[:, None] - 1) * self.height_m), axis=-1)
        zeros = jn_zeros(0, MODES)
        frequency = zeros / 2 * math.sqrt(STANDARD_GRAVITY / self.height_m)
        mode_shapes = j0(zeros * np.sqrt(up)[:, None]) * self.draught_m / np.arange(1, MODES + 1) ** 2
        mode_shapes[-1] = 0  # at the rail the mode is zero only up to rounding
        # Each mode is a wave that runs along the curtain in one of the two directions.
        rng = np.random.default_rng(self.seed)
        phase, direction = rng.uniform(0, 2 * math.pi, MODES), rng.choice([-1, 1], MODES)
        wave = direction * 2 * math.pi * aside[:, None] / self.wavelength_m + phase
        half = np.array([THICKNESS_M / 2, 0, 0])
        front, faces = sheet(rest + half, rest - half)
        track = partial(self._swung, front, mode_shapes, frequency, wave)
        return moving(self, track, faces, (start_s, stop_s), sagitta_rad=SAGITTA_RAD, name=self.noun)

    def _swung(
        self, rest: np.ndarray, mode_shapes: np.ndarray, frequency: np.ndarray, wave: np.ndarray, times_s: np.ndarray
    ) -> np.ndarray:
        swing = np.einsum("rm,kcm->krc", mode_shapes, np.sin(frequency * times_s[:, None, None] - wave))
        moved = np.repeat(rest[None], len(times_s), axis=0)
        moved[..., 0] += np.concatenate([swing, swing[..., ::-1]], axis=2).reshape(len(times_s), -1)
        return moved @ about_z(math.radians(self.heading_deg)).T + self.position_m
