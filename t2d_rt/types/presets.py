"""Files of radars: the packaged presets by name, and YAML files of fields and values."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from t2d_rt.core.checks import shown, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_yaml
from t2d_rt.core.plugins import loaded, plugins


def preset_names() -> list[str]:
    """Names that `Radar.preset` knows, those of other packages included."""
    own = _packaged()
    return sorted([*own, *plugins("radars", own)])


def preset_fields(name: str) -> dict[str, Any]:
    """Field names and values of a preset, from its packaged YAML file or from another package."""
    own, wanted = _packaged(), str(name).lower().replace("_", "-")
    if wanted in own:
        return read_radar(_preset_folder() / f"{wanted}.yaml")
    others = plugins("radars", own)
    if wanted not in others:
        raise unknown_name("radar preset", name, sorted([*own, *others]), hint=", or give a YAML file")
    found = loaded(others[wanted])
    values = found.model_dump() if hasattr(found, "model_dump") else found
    if not isinstance(values, Mapping):
        raise InputError(
            f"the radar {wanted} of another package must be a Radar or a mapping of its fields, got {shown(found)}"
        )
    return dict(values)


def _packaged() -> list[str]:
    return [entry.name.removesuffix(".yaml") for entry in _preset_folder().iterdir() if entry.name.endswith(".yaml")]


def _preset_folder() -> Path:
    # By path, not as a package: data of the radar stage, none of its code.
    return Path(str(files("t2d_rt"))) / "radar" / "presets"


def read_radar(path: str | Path) -> dict[str, Any]:
    """Field names and values of a radar's YAML file."""
    return read_yaml(path, noun="radar file", example="field names and values such as 'prf_hz: 10240'")
