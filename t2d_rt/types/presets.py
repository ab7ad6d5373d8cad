"""Files of radars: the packaged presets by name, and YAML files of fields and values."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Any

from t2d_rt.checks import unknown_name
from t2d_rt.files import read_yaml


def preset_names() -> list[str]:
    """Names that `Radar.preset` knows."""
    return sorted(
        entry.name.removesuffix(".yaml") for entry in _preset_folder().iterdir() if entry.name.endswith(".yaml")
    )


def preset_path(name: str) -> Path:
    """The packaged YAML file of a preset."""
    known = preset_names()
    wanted = str(name).lower().replace("_", "-")
    if wanted not in known:
        raise unknown_name("radar preset", name, known, hint=", or give a YAML file")
    return _preset_folder() / f"{wanted}.yaml"


def _preset_folder() -> Path:
    # By path, not as a package: data of the radar stage, none of its code.
    return Path(str(files("t2d_rt"))) / "radar" / "presets"


def read_radar(path: str | Path) -> dict[str, Any]:
    """Field names and values of a radar's YAML file."""
    return read_yaml(path, noun="radar file", example="field names and values such as 'prf_hz: 10240'")
