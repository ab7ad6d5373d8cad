"""Movers: fans, curtains, doors and pets, each a model that makes its moving mesh.

>>> mover("fan:2,1,1.2,rpm=600").rpm
600.0
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

from t2d_rt.core.checks import shown, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.core.plugins import loaded, plugins
from t2d_rt.scene.movers.curtain import Curtain
from t2d_rt.scene.movers.door import Door
from t2d_rt.scene.movers.fans import CeilingFan, TableFan
from t2d_rt.scene.movers.pet import Pet
from t2d_rt.types import MovingMesh
from t2d_rt.types.fields import Fields


class OwnMover(Fields, ABC):
    """Base class for movers of other packages: their fields, of which `kind` is the registered name, and their mesh."""

    noun: ClassVar[str] = "mover"

    @abstractmethod
    def mesh(self, start_s: float, stop_s: float) -> MovingMesh:
        """The mover's surface from `start_s` to `stop_s` [s]."""


Mover = TableFan | CeilingFan | Curtain | Door | Pet | OwnMover
KINDS: dict[str, type[Mover]] = {
    "fan": TableFan,
    "ceiling_fan": CeilingFan,
    "curtain": Curtain,
    "door": Door,
    "pet": Pet,
}

__all__ = ["KINDS", "CeilingFan", "Curtain", "Door", "Mover", "OwnMover", "Pet", "TableFan", "mover", "parsed"]


def mover(entry: str | Mapping[str, Any]) -> Mover:
    """A mover from "kind:x,y,z,key=value,..." or from a mapping {kind: ..., position_m: [x, y, z], key: value, ...}."""
    kind, place, fields = parsed(entry)
    return kind_named(kind)(**with_words(entry, "position_m", place, fields))


def kind_names() -> list[str]:
    """Names of the kinds of movers, those of other packages last; none of these is loaded."""
    return [*KINDS, *plugins("movers", KINDS)]


def kind_named(name: str) -> type[Mover]:
    """The class of a kind of mover; of other packages only the one that defines it is loaded."""
    if name in KINDS:
        return KINDS[name]
    others = plugins("movers", KINDS)
    if name not in others:
        raise unknown_name("mover", name, [*KINDS, *others])
    kind = loaded(others[name])
    if not (isinstance(kind, type) and issubclass(kind, OwnMover) and "kind" in kind.model_fields):
        raise InputError(
            f"the mover {name} of another package must be a class on OwnMover with a field kind, got {shown(kind)}"
        )
    if kind.model_fields["kind"].default != name:
        raise InputError(
            f"the mover {name} of another package must have kind '{name}' by default; correct that package"
        )
    return kind


def with_words(entry: Any, key: str, value: Any, fields: Mapping[str, Any]) -> dict[str, Any]:
    """Fields with `value`, if there is one, added as `key`; refuses a key that `entry` gives twice."""
    if value and key in fields:
        raise InputError(f"{entry!r:.100} gives {key} twice; give it once")
    return {**fields, key: value} if value else dict(fields)


def parsed(entry: str | Mapping[str, Any]) -> tuple[str, list[str], dict[str, Any]]:
    """Splits a text "kind:value,...,key=value,...", or a mapping with a kind, into kind, values without a key, and values by
    key."""
    if isinstance(entry, Mapping) and isinstance(entry.get("kind"), str):
        return entry["kind"], [], {str(key): value for key, value in entry.items() if key != "kind"}
    if not isinstance(entry, str) or ":" not in entry:
        raise InputError(f"a mover is written as kind:x,y,z,key=value or as a mapping with a kind, got {shown(entry)}")
    kind, _, rest = entry.partition(":")
    pairs = [word.partition("=") for word in rest.split(",")]
    fields = {key.strip(): None if value.strip() == "none" else value.strip() for key, equals, value in pairs if equals}
    words = [word.strip() for word, equals, _ in pairs if not equals and word.strip()]
    if len(fields) < sum(bool(equals) for _, equals, _ in pairs):
        raise InputError(f"{entry!r:.100} gives a key twice; give it once")
    return kind.strip(), words, fields
