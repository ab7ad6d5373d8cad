"""Movers: fans, curtains, doors and pets, each a model that makes its moving mesh.

>>> mover("fan:2,1,1.2,rpm=600").rpm
600.0
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from t2d_rt.checks import shown, unknown_name
from t2d_rt.errors import InputError
from t2d_rt.scene.movers.curtain import Curtain
from t2d_rt.scene.movers.door import Door
from t2d_rt.scene.movers.fans import CeilingFan, TableFan
from t2d_rt.scene.movers.pet import Pet

Mover = TableFan | CeilingFan | Curtain | Door | Pet
KINDS: dict[str, type[Mover]] = {
    "fan": TableFan, "ceiling_fan": CeilingFan, "curtain": Curtain, "door": Door, "pet": Pet,
}  # fmt: skip

__all__ = ["KINDS", "CeilingFan", "Curtain", "Door", "Mover", "Pet", "TableFan", "mover", "parsed"]


def mover(entry: str | Mapping[str, Any]) -> Mover:
    """A mover from "kind:x,y,z,key=value,..." or from a mapping {kind: ..., position_m: [x, y, z], key: value, ...}."""
    kind, place, fields = parsed(entry)
    if kind not in KINDS:
        raise unknown_name("mover", kind, KINDS)
    return KINDS[kind](**with_words(entry, "position_m", place, fields))


def with_words(entry: Any, key: str, value: Any, fields: Mapping[str, Any]) -> dict[str, Any]:
    """Fields with the one that is given without its key, where it is."""
    if value and key in fields:
        raise InputError(f"{entry!r:.100} gives {key} twice; give it once")
    return {**fields, key: value} if value else dict(fields)


def parsed(entry: str | Mapping[str, Any]) -> tuple[str, list[str], dict[str, Any]]:
    """Kind, values without a key and values by key, of a text "kind:value,...,key=value,..." or of a mapping with a kind."""
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
