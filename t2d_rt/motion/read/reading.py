"""How a file is to be read, and where a motion comes from."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from t2d_rt.core.checks import LARGEST_M, array, choice, flag, number, positive, text
from t2d_rt.core.errors import InputError, printable
from t2d_rt.motion.read.detect import UNITS_M, GivenUp, Up
from t2d_rt.motion.read.root import Root
from t2d_rt.types.motion import checked_rate

AXES = ("x", "y", "z", "-x", "-y", "-z", "file")

LOWEST_CUTOFF_HZ = 0.1
"""Below, a low-pass leaves nothing of human movement and the filter's coefficients lose their digits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What the user says of a file; None is detected. The fields are `load_motion`'s options."""

    units: float | str | None = None
    up: GivenUp | None = None
    floor: float | None = None
    drop_tpose: bool | None = None
    smooth_hz: float | Literal["auto"] | None = "auto"
    flavour: str | None = None
    rate_hz: float | None = None
    subject: str | None = None
    root: Root | None = None

    def __post_init__(self) -> None:
        if self.units is not None and not isinstance(self.units, str):
            positive("units", self.units, hint=f"metres per unit or one of {', '.join(UNITS_M)}")
        if self.floor is not None:
            number("floor", self.floor, -LARGEST_M, LARGEST_M, unit="m")
        if self.drop_tpose is not None:
            flag("drop_tpose", self.drop_tpose)
        if self.smooth_hz is not None and not (isinstance(self.smooth_hz, str) and self.smooth_hz == "auto"):
            number("smooth_hz", self.smooth_hz, LOWEST_CUTOFF_HZ, unit="Hz", hint="a cut-off in Hz, None or 'auto'")
        if self.rate_hz is not None:
            checked_rate(self.rate_hz)
        if self.root is not None:
            choice("root", self.root, ("file", "feet"))
        if isinstance(self.up, str):
            choice("up", self.up, AXES, hint="or give a vector in the file's axes")
        elif self.up is not None and not np.linalg.norm(array("up", self.up, (3,), limit=LARGEST_M)) > 0:
            raise InputError(
                "up must be an axis such as 'z' or '-y', 'file', or a vector of some length, got one without"
            )
        for name, value in (("flavour", self.flavour), ("subject", self.subject)):
            if value is not None:
                text(name, value)

    @property
    def axis(self) -> Up | tuple[float, float, float] | None:
        """The upward direction in the file that was given, None where it is to be found."""
        if self.up is None or isinstance(self.up, str):
            return None if self.up == "file" else self.up
        x, y, z = (float(value) for value in self.up)
        return x, y, z


def file_origin(path: Path) -> str:
    """A file by its name, without the folders of this machine, and its content."""
    with path.open("rb") as file:
        return f"{printable(path.name)}, sha256 {hashlib.file_digest(file, 'sha256').hexdigest()}"
