"""What a fall is to be like: `FallPlan`; and when each of its phases begins: `FallEvents`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from t2d_rt.core.checks import flag, integer, number, shown
from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions.slots import FALL_TYPES, FallType

Heading = Literal["forward", "back", "left", "right"]
HEADINGS: tuple[Heading, ...] = get_args(Heading)

LONGEST_REST_S = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FallPlan:
    """A fall; what is None is drawn from the seed, as are all of a person's small differences."""

    type: FallType
    direction: Heading | None = None
    """Where the body falls; None: back or aside for a slip, forward for a trip, any for a collapse."""
    strength: float | None = None
    """0 (slow, half caught) to 1 (sudden, limp)."""
    time_s: float | None = None
    """When it begins in the lead; the nearest heel strike (slip), mid-swing (trip) or frame (collapse) is taken."""
    protective_arms: bool = True
    """Whether the arms reach for the floor."""
    rest_s: float = 1.5
    """How long the body lies at rest before the motion ends or it gets up."""
    get_up: bool = False
    mass_kg: float | None = None
    """None: a body mass index of 20 to 27."""
    seed: int = 0

    def __post_init__(self) -> None:
        if self.type not in FALL_TYPES:
            raise InputError(f"a fall's type must be one of {', '.join(FALL_TYPES)}, got {shown(self.type)}")
        if self.direction is not None and self.direction not in HEADINGS:
            raise InputError(f"a fall's direction must be one of {', '.join(HEADINGS)}, got {shown(self.direction)}")
        if (self.type, self.direction) == ("trip", "back"):
            raise InputError("a trip throws nobody backward, for the walk goes on; choose a slip, or another direction")
        if self.strength is not None:
            number("strength", self.strength, 0, 1)
        if self.time_s is not None:
            number("time_s", self.time_s, 0, unit="s")
        number("rest_s", self.rest_s, 0.3, LONGEST_REST_S, unit="s")
        if self.mass_kg is not None:
            number("mass_kg", self.mass_kg, 10, 250, unit="kg")
        flag("protective_arms", self.protective_arms)
        flag("get_up", self.get_up)
        integer("seed", self.seed)


@dataclass(frozen=True, slots=True, kw_only=True)
class FallEvents:
    """Instants of a fall [s], from the motion's first frame."""

    event_s: float
    """Balance is lost: the foot slips or is caught, or the muscles give way."""
    impact_s: float
    """Pelvis, thigh or trunk strikes the floor."""
    rest_s: float
    """The body has come to rest."""
    get_up_s: float | None = None
    """It begins to get up."""
