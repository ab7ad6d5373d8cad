"""`--add`: movers and further persons beside the motion file's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from t2d_rt.scene.movers import Mover, mover, parsed, with_words
from t2d_rt.types.fields import Fields, Number

if TYPE_CHECKING:
    from t2d_rt.types import Motion, Radar


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

    def motion(self, radar: Radar) -> Motion:
        """The file's motion from `start_s` to `stop_s`, where `place` puts it."""
        from t2d_rt.motion import load_motion, place, trim

        motion = trim(load_motion(self.file), self.start_s, self.stop_s)
        return place(
            motion,
            distance_m=self.distance_m,
            angle_deg=self.angle_deg,
            radar_position_m=radar.position_m,
            boresight=radar.boresight,
        )


def additions(entries: Sequence[str | Mapping[str, Any]]) -> list[Mover | Person]:
    """What the entries of `--add` name."""
    found: list[Mover | Person] = []
    for entry in entries:
        kind, words, fields = parsed(entry)
        if kind == "person":
            found.append(Person(**with_words(entry, "file", ",".join(words), fields)))
        else:
            found.append(mover(entry))
    return found
