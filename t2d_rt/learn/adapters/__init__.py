"""Real recordings as labelled maps: a common interface, and an adapter for each kind of data. No such data is kept or shipped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from t2d_rt.core.checks import file_path, instance, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Dataset
from t2d_rt.dataset.shards import RECIPE, SHARDS
from t2d_rt.learn.adapters.arrays import HDF5, NPZ, npz_arrays
from t2d_rt.learn.adapters.class_folders import CI4R, ENDINGS, PNG, RADHAR, picture_adapter
from t2d_rt.learn.adapters.interface import (
    AXES,
    Adapter,
    AdapterOptions,
    RealMaps,
    card_path,
    class_names,
    content_hash,
)
from t2d_rt.learn.adapters.parrad import PARRAD, RADARS
from t2d_rt.learn.maps import LabelledMaps, maps_of


def read_dataset(path: Path, options: AdapterOptions) -> tuple[LabelledMaps, list[Path]]:
    """Maps of a data set of this program; its samples count as events."""
    data = Dataset(path)
    maps = maps_of(data, size=options.size, dynamic_range_db=options.dynamic_range_db, speeds_mps=options.cut_mps)
    if options.classes is not None:
        names = class_names(list(maps.classes), options, path)
        maps = maps.relabelled(names, options.classes)
    events = {"event": np.array([f"sample {name}" for name in maps.names])}
    return replace(maps, groups={**events, **maps.groups}), sorted((path / SHARDS).glob("*"))


def of_recipe(data: Dataset, options: AdapterOptions) -> AdapterOptions:
    """Options with the carrier and the treatment of static echoes that the data set's recipe specifies.

    Raises InputError where a card specifies others, or specifies axes, as a data set has its own.
    """
    card, recipe = card_path(data.path), data.recipe
    carriers = sorted({(condition.radar or recipe.radar).carrier_hz for condition in recipe.conditions})
    mti = None if recipe.products.spectrogram is None else recipe.products.spectrogram.mti
    axes = sorted(options.told - {"adapter", "classes", "carrier_hz", "mti"})
    if axes:
        raise InputError(f"{card} tells {', '.join(axes)}, which a data set tells itself; leave them out")
    if "carrier_hz" in options.told and all(
        abs(carrier - (options.carrier_hz or 0.0)) > 1e-3 * carrier for carrier in carriers
    ):
        carriers_ghz = ", ".join(f"{carrier / 1e9:g}" for carrier in carriers)
        raise InputError(
            f"{card} tells a carrier of {(options.carrier_hz or 0.0) / 1e9:g} GHz, the recipe {carriers_ghz} GHz; correct the card"
        )
    if "mti" in options.told and mti is not None and options.mti != mti:
        raise InputError(f"{card} tells mti {options.mti}, the recipe {mti}; correct the card")
    carrier_hz = carriers[0] if len(carriers) == 1 else options.carrier_hz
    return replace(options, carrier_hz=carrier_hz, mti=mti)


DATASET = Adapter(
    name="dataset",
    about="The folder of a data set that t2d-rt dataset wrote.",
    licence="Terms of the motions are in its data card.",
    read=read_dataset,
    axes=lambda path: AXES,
)
ADAPTERS: dict[str, Adapter] = {adapter.name: adapter for adapter in (PARRAD, RADHAR, CI4R, PNG, HDF5, NPZ, DATASET)}
"""Adapters by name; a new kind of data needs one module and an entry here."""

__all__ = ["ADAPTERS", "Adapter", "AdapterOptions", "RealMaps", "adapter_for", "of_recipe", "read_real"]


def read_real(path: str | Path, adapter: str | None = None, options: AdapterOptions | None = None) -> RealMaps:
    """Labelled maps: of real recordings, or of a data set of this program.

    path: a file or a folder. The card beside it (`card.yaml` in a folder, `maps.npz.card.yaml` beside maps.npz) specifies what the
        files do not: adapter, classes, speed_mps or cell_mps, duration_s or rate_hz, positive, carrier_hz, mti.
    adapter: one of parrad, radhar, ci4r, png, hdf5, npz, dataset; by default the card's, or the one for files of this kind.
    options: classes, size and axes, as far as neither the files nor the card specify them.
    """
    source = file_path("the path of real data", path)
    if not source.exists():
        raise InputError(f"{source} does not exist; give the path of your copy of the data")
    if options is not None:
        instance("options", options, AdapterOptions, "AdapterOptions")
    options = (options or AdapterOptions()).with_card(source)
    name = adapter or options.adapter or adapter_for(source)
    if not isinstance(name, str) or name not in ADAPTERS:
        raise unknown_name("adapter", name, ADAPTERS)
    reader = ADAPTERS[name]
    if name == DATASET.name:
        options = of_recipe(Dataset(source), options)
    maps, files = reader.read(source, options)
    card, axes_of_files = card_path(source), set(reader.axes(source))
    return RealMaps(
        maps=maps.checked_for_training(),
        adapter=reader.name,
        licence=reader.licence,
        sha256=content_hash(source, [*files, *([card] if card.is_file() else [])]),
        files=len(files),
        carrier_hz=options.carrier_hz,
        mti=options.mti,
        assumed=tuple(axis for axis, names in AXES.items() if axis not in axes_of_files and not names & options.told),
    )


def adapter_for(source: Path) -> str:
    """The name of the adapter for files of this kind."""
    if source.is_file():
        if source.suffix.lower() in (".h5", ".hdf5"):
            return "hdf5"
        if source.suffix.lower() == ".npz":
            return "parrad" if npz_arrays(source, RADARS) else "npz"
    elif (source / RECIPE).is_file():
        return "dataset"
    elif any(file.suffix.lower() in ENDINGS for file in source.rglob("*")):
        return picture_adapter(source)
    elif any(source.rglob("*.txt")):
        return "radhar"
    raise InputError(
        f"{source} is no data that an adapter reads; give an .npz or HDF5 file, a folder of pictures or of point clouds for each "
        "class, or a data set of this program"
    )
