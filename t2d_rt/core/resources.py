"""Finds the data that is shipped with the package (meshes, scenes, motions), both in a checkout and in an installed wheel."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from t2d_rt.core.errors import InputError

Kind = Literal["meshes", "meshes/furniture", "scenes", "motions", "backgrounds"]

_PACKAGE = Path(__file__).resolve().parents[1]
_IN_CHECKOUT: dict[Kind, str] = {
    "meshes": "meshes",
    "meshes/furniture": "meshes/furniture",
    "scenes": "scenes",
    "motions": "examples/motions",
    "backgrounds": "backgrounds",
}


def folder(kind: Kind) -> Path:
    """Folder of shipped data: `t2d_rt/_data/<kind>` where installed, beside the package in a checkout."""
    for path in (_PACKAGE / "_data" / kind, _PACKAGE.parent / _IN_CHECKOUT[kind]):
        if path.is_dir():
            return path
    raise InputError(f"the package's own {kind} are missing; install t2d-rt again")


def resource(kind: Kind, name: str) -> Path:
    """Path of a shipped file, e.g. `resource("meshes", "adult.npz")`; the name must not lead out of the folder."""
    root = folder(kind).resolve()
    path = (root / name).resolve() if "\0" not in name else root
    if path == root or not path.is_relative_to(root) or not path.exists():
        raise InputError(f"{name!r} is not one of the shipped {kind}; choose one of {', '.join(listing(kind))}")
    return path


def listing(kind: Kind, suffix: str = "") -> list[str]:
    """Names in the folder that end in `suffix`, sorted."""
    return sorted(
        path.name for path in folder(kind).iterdir() if path.name.endswith(suffix) and path.name[0] not in "._"
    )
