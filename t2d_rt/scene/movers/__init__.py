"""Movers: fans, curtains, doors and pets, each a model that makes its moving mesh.

>>> mover("fan:2,1,1.2,rpm=600").rpm
600.0
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any

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
    fields = parsed(entry)
    kind = fields["kind"]
    if kind not in KINDS:
        close = difflib.get_close_matches(str(kind), KINDS, n=1)
        hint = f"did you mean {close[0]}?" if close else f"choose one of {', '.join(KINDS)}"
        raise InputError(f"unknown mover {kind!r}; {hint}")
    return KINDS[kind](**fields)


def parsed(entry: str | Mapping[str, Any]) -> dict[str, Any]:
    """Names and values of a text "kind:value,value,...,key=value,...", the values without a name as position_m; of a mapping its own."""
    if isinstance(entry, Mapping):
        if "kind" not in entry:
            raise InputError(f"a mover must be a mapping with a kind, got {dict(entry)!r:.60}; give kind: fan, say")
        return {str(key): value for key, value in entry.items()}
    if not isinstance(entry, str) or ":" not in entry:
        raise InputError(f"a mover is written as kind:x,y,z,key=value, got {entry!r:.60}; fan:2,1,1.2,rpm=900, say")
    kind, _, rest = entry.partition(":")
    words = [word.strip() for word in rest.split(",") if word.strip()]
    fields: dict[str, Any] = {"kind": kind.strip()}
    if place := [word for word in words if "=" not in word]:
        fields["position_m"] = place
    for name, _, value in (word.partition("=") for word in words if "=" in word):
        if name.strip() in fields:
            raise InputError(f"{name.strip()} is given twice in {entry!r}; give it once")
        fields[name.strip()] = value.strip()
    return fields
