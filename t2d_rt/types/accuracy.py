"""`Accuracy`: how finely an experiment is modelled, every numerical setting in one place."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from t2d_rt.core.errors import InputError
from t2d_rt.types.fields import Count, Decibel, Fields, Number

EVERY_PATH_DB = -200.0
"""A level below that of every path pair."""
Scale = Annotated[Number, Field(ge=0.01, le=100)]
Rate = Annotated[Number, Field(ge=10, le=10_000)]


class PathTier(Fields):
    """How path pairs of one range of levels are modelled; in free space there is the direct path alone, in the first tier."""

    model_config = ConfigDict(use_attribute_docstrings=True)
    noun: ClassVar[str] = "path tier"

    level_db: Decibel
    """Lowest level of its path pairs [dB], relative to the strongest one, averaged over the targets; the last tier takes all weaker
    ones."""
    scatterer: Literal["facets", "ellipsoids"] = "facets"
    """What represents a body; other targets keep their facets. Ellipsoids give the right power, but not the right phase. Where the
    first tier has ellipsoids, all others have them, too."""
    sagitta_scale: Scale = 1.0
    """Phase sagitta of the facets relative to the first tier's; cost falls with its inverse."""
    greatest_sagitta_rad: Annotated[Number, Field(gt=0, le=10)] = 10.0
    """Limit of that scaled phase sagitta [rad]; the first tier's own sagitta is kept where it is greater."""
    patch_span_scale: Scale = 1.0
    """Span in delay of the patches into which facets are merged, relative to the first tier's."""
    patch_phase_scale: Scale = 1.0
    """Phase by which a patch may change from one surface frame to the next, relative to the first tier's."""
    visibility: Literal["occlusion", "blockage"] = "occlusion"
    """What is traced: "occlusion" by the targets and blockage by the scene, or "blockage" by the scene alone, at a few points of
    each target."""
    diffuse_points: Annotated[Count, Field(ge=0, le=1_000_000)] = 4_000
    """Least number of diffuse points of a mesh; it does not change their power."""
    decimation: Annotated[Count, Field(ge=1, le=100)] = 1
    """Ellipsoids and fast-rotating targets are evaluated only at every n-th surface frame, n being this number."""


DEFAULT_TIERS = (
    PathTier(level_db=-6.0),
    PathTier(
        level_db=-25.0,
        sagitta_scale=4.0,
        greatest_sagitta_rad=3.5,
        patch_span_scale=2.0,
        patch_phase_scale=4.0,
    ),
    PathTier(
        level_db=EVERY_PATH_DB,
        scatterer="ellipsoids",
        sagitta_scale=8.0,
        greatest_sagitta_rad=6.0,
        patch_span_scale=4.0,
        patch_phase_scale=8.0,
        visibility="blockage",
        diffuse_points=250,
        decimation=2,
    ),
)
"""Dominant, secondary and minor paths."""
ELLIPSOID_TIERS = tuple(tier.model_copy(update={"scatterer": "ellipsoids"}) for tier in DEFAULT_TIERS)
"""The default tiers with ellipsoids in place of bodies over all path pairs, for tolerances of a few decibels."""


class Accuracy(Fields):
    """How finely an experiment is modelled; frozen, every field checked. `plan` chooses one for a tolerance.

    >>> Accuracy(visibility_rate_hz=50).visibility_rate_hz
    50.0
    """

    model_config = ConfigDict(use_attribute_docstrings=True)
    noun: ClassVar[str] = "accuracy"
    written: ClassVar[Mapping[str, str]] = {"tiers": "a list of mappings, as in [{level_db: -6}, {level_db: -200}]"}

    sagitta_rad: Annotated[Number, Field(ge=0.01, le=10)] | None = None
    """Greatest phase sagitta of a facet [rad], in place of each mesh's own: 1.5 for a body, whose facets are curved, where its
    radius is 0.1 m; 0.07 for the flat facets of other meshes, which gives 0.3 dB of RCS. The number of facets is inversely
    proportional to it."""
    sagitta_scale: Scale = 1.0
    """Factor on that phase sagitta."""
    surface_rate_hz: Rate | None = None
    """Rate at which the shape of every target is evaluated [Hz], in place of what its motion needs. Cost is proportional."""
    spline_error_db: Annotated[Number, Field(ge=-100, le=0)] = -32.0
    """Field error that splines between surface frames may add [dB]; it sets the surface rate where none is given."""
    occlusion: bool = True
    """Whether targets occlude themselves and one another; the scene blocks paths in any case."""
    clutter_occlusion: bool | None = None
    """Whether targets occlude parts of the static scene; as `occlusion` by default."""
    visibility_rate_hz: Annotated[Number, Field(ge=1, le=1_000)] = 25.0
    """Rate at which visibility is sampled [Hz]; it is interpolated in between. 25 suits walking. Cost is proportional, and the
    surface rate is no lower unless `surface_rate_hz` is given."""
    visibility_subdivision: Annotated[Count, Field(ge=0, le=4)] = 0
    """How often the edges of the meshes are halved for the points at which visibility is sampled; each time costs a factor of 4."""
    fast_rotating_hz: Annotated[Number, Field(ge=1, le=100_000)] | None = None
    """Surface rate [Hz] above which a target counts as fast-rotating: its visibility is not sampled point by point, but averaged. 8
    times the visibility rate by default."""
    repeats: bool = True
    """Whether targets that rotate fast and at a constant rate, such as a fan's blades, are computed for a few rotations only, from
    which the whole record is interpolated."""
    dynamic_range_db: Annotated[Number, Field(ge=0, le=200.0)] = 60.0
    """Path pairs weaker than the strongest one by more than that, at their best points, are left out [dB]."""
    least_level_db: Annotated[Number, Field(ge=-200, le=0)] = EVERY_PATH_DB
    """Path pairs below that level, relative to the strongest one and averaged over the targets, are left out [dB]."""
    tiers: tuple[PathTier, ...] = DEFAULT_TIERS
    """How path pairs of each range of levels are modelled, from dominant to minor ones."""
    synthesis_error_db: Annotated[Number, Field(ge=-90, le=-10)] = -50.0
    """Field error that the sum of echoes to the ADC cube may add [dB]."""

    @model_validator(mode="after")
    def _check_tiers(self) -> Self:
        if not self.tiers:
            raise InputError(
                "accuracy key tiers must hold at least one tier, got none; leave it out to have the default"
            )
        if self.tiers[0].visibility != "occlusion":
            raise InputError("the first path tier must have visibility 'occlusion'; coarser tiers come after it")
        if self.by_ellipsoids and any(tier.scatterer != "ellipsoids" for tier in self.tiers):
            raise InputError(
                "a path tier of facets comes after a first one of ellipsoids; make all of them ellipsoids, or the first one facets"
            )
        finest = ("occlusion", "blockage")
        for one, next_ in pairwise(self.tiers):
            if not next_.level_db < one.level_db or finest.index(next_.visibility) < finest.index(one.visibility):
                raise InputError(
                    f"path tiers must go from high to low levels and from fine to coarse visibility, got {one.level_db:g} dB "
                    f"({one.visibility}) before {next_.level_db:g} dB ({next_.visibility}); sort them"
                )
        return self

    @property
    def by_ellipsoids(self) -> bool:
        """Whether bodies are ellipsoids over all path pairs, in free space too."""
        return self.tiers[0].scatterer == "ellipsoids"

    @property
    def fastest_sampled_hz(self) -> float:
        """Greatest surface rate of targets whose visibility is sampled point by point [Hz]."""
        return 8.0 * self.visibility_rate_hz if self.fast_rotating_hz is None else self.fast_rotating_hz

    @property
    def occludes_clutter(self) -> bool:
        """Whether targets occlude parts of the static scene."""
        return self.occlusion if self.clutter_occlusion is None else self.clutter_occlusion

    def replace(self, **changes: object) -> Accuracy:
        """A copy with some fields changed, checked like a new one. Fields that count as set by the user still do in the copy."""
        set_values = {name: getattr(self, name) for name in self.model_fields_set}
        return type(self)(**{**set_values, **changes})
