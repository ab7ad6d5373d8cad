"""Real recordings as labelled maps: one interface, an adapter for each kind of data. Nothing of the data is kept or shipped."""

from __future__ import annotations

from pathlib import Path

from t2d_rt.core.checks import file_path, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.learn.adapters.arrays import HDF5, NPZ
from t2d_rt.learn.adapters.class_folders import CI4R, PNG, RADHAR
from t2d_rt.learn.adapters.interface import Adapter, AdapterOptions, RealMaps, content_hash
from t2d_rt.learn.adapters.parrad import PARRAD

ADAPTERS: dict[str, Adapter] = {each.name: each for each in (PARRAD, RADHAR, CI4R, PNG, HDF5, NPZ)}
"""By name; a new kind of data is one module and its entry here."""

__all__ = ["ADAPTERS", "Adapter", "AdapterOptions", "RealMaps", "read_real"]


def read_real(path: str | Path, adapter: str, options: AdapterOptions | None = None) -> RealMaps:
    """Maps of real recordings.

    path: a file or a folder, wherever it lies.
    adapter: one of parrad, radhar, ci4r, png, hdf5, npz.
    options: classes, size and axes, as far as the files do not tell them.
    """
    if adapter not in ADAPTERS:
        raise unknown_name("adapter", adapter, ADAPTERS)
    source = file_path("the path of real data", path)
    if not source.exists():
        raise InputError(f"{source} does not exist; give the path of your copy of the data")
    chosen = ADAPTERS[adapter]
    maps, files = chosen.read(source, options or AdapterOptions())
    return RealMaps(
        maps=maps.checked_for_training(),
        adapter=chosen.name,
        licence=chosen.licence,
        sha256=content_hash(source, files),
        files=len(files),
    )
