"""`--add`: movers and further persons beside the motion file's."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal
from warnings import warn

from pydantic import Field

from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.scene.movers import Mover, mover, parsed, with_words
from t2d_rt.types.fields import Fields, Number

if TYPE_CHECKING:
    from t2d_rt.types import Motion, Radar


FIELD = re.compile(r"\s*[A-Za-z_]+\s*=")
"""A word of an entry that gives a field; anything else belongs to the name of the file."""


class Person(Fields):
    """One more person, from a motion file, placed before the radar."""

    noun: ClassVar[str] = "person"
    if_missing: ClassVar[str] = "write person:FILE.bvh"

    kind: Literal["person"] = "person"
    file: str
    distance_m: Annotated[Number, Field(gt=0)] | None = None
    angle_deg: Number = 0.0
    start_s: Annotated[Number, Field(ge=0)] = 0.0
    stop_s: Number | None = None
    subject: str | None = None

    def motion(self, radar: Radar) -> Motion:
        """The file's motion from `start_s` to `stop_s`, where `place` puts it."""
        from t2d_rt.experiment.catalog import motion_path
        from t2d_rt.motion import load_motion, place

        motion = cut(load_motion(motion_path(self.file), subject=self.subject), self.start_s, self.stop_s)
        return place(
            motion,
            distance_m=self.distance_m,
            angle_deg=self.angle_deg,
            radar_position_m=radar.position_m,
            boresight=radar.boresight,
        )


def cut(motion: Motion, start_s: float, stop_s: float | None) -> Motion:
    """The piece from `start_s` to `stop_s` or, with a warning, to the motion's end where that comes first."""
    from t2d_rt.motion import trim

    end = motion.duration_s
    if not 0 <= start_s < end:
        raise InputError(
            f"start_s must lie within the motion's 0 ... {end:.6g} s, got {start_s:g}; choose an earlier start"
        )
    if stop_s is not None and not stop_s > start_s:
        raise InputError(f"stop_s must lie after start_s of {start_s:g} s, got {stop_s:g}; choose a later stop")
    if stop_s is not None and stop_s > end:
        warn(
            f"the motion ends at {end:.6g} s, before stop_s of {stop_s:g} s; it is used to its end",
            T2DWarning,
            stacklevel=2,
        )
        stop_s = end
    return trim(motion, start_s, stop_s) if start_s or stop_s is not None else motion


def additions(entries: Sequence[str | Mapping[str, Any]] | None) -> list[Mover | Person]:
    """What the entries of `--add` name."""
    return [_person(entry) if _kind(entry) == "person" else mover(entry) for entry in entries or ()]


def _kind(entry: str | Mapping[str, Any]) -> Any:
    return entry.partition(":")[0].strip() if isinstance(entry, str) else entry.get("kind")


def _person(entry: str | Mapping[str, Any]) -> Person:
    if not isinstance(entry, str):
        return Person(**{str(key): value for key, value in entry.items()})
    words = entry.partition(":")[2].split(",")
    is_field = [FIELD.match(word) is not None for word in words]
    _, _, fields = parsed(f"person:{','.join(word for word, field in zip(words, is_field, strict=True) if field)}")
    # What is no field is the file's name as it stands: names may hold commas and spaces.
    file = ",".join(word for word, field in zip(words, is_field, strict=True) if not field).strip()
    return Person(**with_words(entry, "file", file, fields))
