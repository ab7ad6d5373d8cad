"""Installed packages: versions of those that a result depends on; and the entry points by which other packages add radars, motion
readers, movers, scatterers and models (docs/extend.md)."""

from __future__ import annotations

import platform
import sys
from collections.abc import Collection
from functools import cache
from importlib.metadata import EntryPoint, PackageNotFoundError, entry_points, version
from typing import Any, Literal

from t2d_rt.core.errors import InputError

Group = Literal["radars", "readers", "movers", "models", "scatterers"]


def versions() -> dict[str, str]:
    """Versions of t2d-rt and of the packages on which results depend."""
    names = "t2d-rt", "numpy", "scipy", "drjit", "mitsuba", "sionna-rt"
    return {"python": platform.python_version()} | {name: _version(name) for name in names}


@cache
def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # a checkout that is not installed
        return "unknown"


def plugins(group: Group, built_in: Collection[str]) -> dict[str, EntryPoint]:
    """Entry points of the group t2d_rt.GROUP by name, without loading them; refuses a name that t2d-rt or another package already
    uses."""
    by_name: dict[str, EntryPoint] = {}
    for entry in _registered(group, tuple(sys.path)):
        if entry.name in built_in or entry.name in by_name:
            owner = "t2d-rt itself" if entry.name in built_in else f"the package {_package(by_name[entry.name])}"
            raise InputError(
                f"the package {_package(entry)} adds {entry.name} to the {group}, a name that {owner} has; rename or uninstall it"
            )
        by_name[entry.name] = entry
    return by_name


@cache
def _registered(group: Group, path: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    """Entry points of the packages on Python's `path`; cached, for a search takes 30 ms and a simulation needs them twice."""
    return tuple(entry_points(group=f"t2d_rt.{group}"))


def loaded(entry: EntryPoint) -> Any:
    """The object to which an entry point refers."""
    try:
        return entry.load()
    except Exception as error:  # other people's code may raise anything
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"{entry.name} of the package {_package(entry)} cannot be loaded ({reason}); repair or uninstall that package"
        ) from error


def _package(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist is not None else entry.value
