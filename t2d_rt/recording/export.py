"""A result as one file that others read: MATLAB (.mat), HDF5 (.h5), NetCDF (.nc) and NumPy (.npz).

Each holds `adc` (chirp, antenna, sample), `spectrogram` (velocity_mps, time_s), their axes, the unit of each, and as JSON texts
what the result was made with. NetCDF has no complex numbers: there `adc_real` and `adc_imag` stand for `adc`.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.core.atomic_write import check_place, check_taken, replacing
from t2d_rt.core.checks import file_path, flag
from t2d_rt.core.cube_storage import DIMENSIONS, DTYPE, NAME, row_bytes
from t2d_rt.core.cubes import Cube, row_blocks
from t2d_rt.core.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

LARGEST_BYTES = {".mat": 2**31 - 2**10, ".nc": 2 * (2**32 - 2**10)}
"""Of a cube: MATLAB's variables have up to 2 GiB in files before version 7.3 (its manual, "MAT-File Versions"), those of NetCDF-3,
one for each part of a complex number, less than 4 GiB."""


def check_export(path: str | Path, cube: Cube, *, overwrite: bool) -> Path:
    """The place for the file, if its ending is known, the cube goes into it, and it may be written."""
    target = file_path("path", path).resolve()
    flag("overwrite", overwrite)
    kind = target.suffix.lower()
    if kind not in WRITERS:
        raise InputError(f"a result is exported to a file that ends in {', '.join(WRITERS)}, got {target.name!r}")
    size = len(cube) * row_bytes(cube.shape)
    if size > LARGEST_BYTES.get(kind, size):
        raise InputError(
            f"an ADC cube of {size / 1e9:.3g} GB is more than the {LARGEST_BYTES[kind] / 1e9:.3g} GB that a {kind} file takes; "
            "export it to .h5 or .npz, or cut the record"
        )
    if kind in (".h5", ".hdf5"):
        _h5py()
    if target.is_dir():
        raise InputError(f"{target} is a folder; choose another name for the file")
    check_place(target, overwrite=overwrite)
    return target


def write_export(
    target: Path, cube: Cube, labelled: xr.Dataset, attributes: Mapping[str, str], *, overwrite: bool
) -> None:
    """Writes the cube, and the labelled arrays and axes with the units in their attributes; a failure changes nothing."""
    with replacing(target, lambda: check_taken(target, overwrite=overwrite)) as new:
        WRITERS[target.suffix.lower()](new, cube, labelled, attributes)


def _units(labelled: xr.Dataset) -> dict[str, str]:
    return {NAME: "sqrt(W)"} | {str(name): str(array.attrs["units"]) for name, array in labelled.variables.items()}


def _write_mat(new: Path, cube: Cube, labelled: xr.Dataset, attributes: Mapping[str, str]) -> None:
    """MATLAB 5: arrays by their names, `units` and `attributes` as structures of texts."""
    from scipy.io import savemat

    arrays = {str(name): array.values for name, array in labelled.variables.items()}
    texts = {"units": _units(labelled), "attributes": dict(attributes)}
    savemat(new, {NAME: np.asarray(cube), **arrays, **texts}, appendmat=False, oned_as="column")


def _write_netcdf(new: Path, cube: Cube, labelled: xr.Dataset, attributes: Mapping[str, str]) -> None:
    """NetCDF-3 with 64-bit offsets, which needs no further library."""
    whole = np.asarray(cube)
    parts = {
        f"{NAME}_{word}": (DIMENSIONS, part, {"units": "sqrt(W)"})
        for word, part in (("real", whole.real), ("imag", whole.imag))
    }
    data = labelled.assign(parts).assign_attrs(attributes)
    data.to_netcdf(new, engine="scipy", format="NETCDF3_64BIT")


def _write_npz(new: Path, cube: Cube, labelled: xr.Dataset, attributes: Mapping[str, str]) -> None:
    """Arrays by their names, `units` and `attributes` as JSON texts; the cube block by block."""
    with zipfile.ZipFile(new, "w", allowZip64=True) as archive:
        header = {"descr": np.lib.format.dtype_to_descr(DTYPE), "fortran_order": False, "shape": tuple(cube.shape)}
        with archive.open(f"{NAME}.npy", "w", force_zip64=True) as file:
            np.lib.format.write_array_header_2_0(file, header)
            for _, block in row_blocks(cube):
                file.write(np.ascontiguousarray(block, DTYPE).data)
        arrays = {str(name): array.values for name, array in labelled.variables.items()}
        texts = {"units": json.dumps(_units(labelled)), "attributes": json.dumps(dict(attributes))}
        for name, value in {**arrays, **texts}.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.asarray(value), allow_pickle=False)


def _write_hdf5(new: Path, cube: Cube, labelled: xr.Dataset, attributes: Mapping[str, str]) -> None:
    """HDF5 with dimension scales; the cube block by block, complex as h5py has it (a compound of r and i)."""
    units = _units(labelled)
    with _h5py().File(new, "w") as file:
        file.attrs.update(attributes)
        samples = file.create_dataset(NAME, shape=cube.shape, dtype=DTYPE)
        for rows, block in row_blocks(cube):
            samples[rows] = block
        for name, array in labelled.variables.items():
            values = array.values if array.dtype.kind != "U" else array.values.astype(object)  # h5py's texts
            file.create_dataset(str(name), data=values)
        dimensions = {NAME: DIMENSIONS} | {str(name): array.dims for name, array in labelled.variables.items()}
        for name in labelled.coords:
            file[name].make_scale(name)
        for name, axes in dimensions.items():
            file[name].attrs["units"] = units[name]
            for number, axis in enumerate(axes):
                file[name].dims[number].label = axis
                scale = next((str(c) for c, array in labelled.coords.items() if array.dims == (axis,)), name)
                if scale != name and name not in labelled.coords:
                    file[name].dims[number].attach_scale(file[scale])


def _h5py() -> Any:
    with suppress(ImportError):
        import h5py

        return h5py
    raise InputError(
        "an HDF5 file needs the package h5py, which is not installed; run pip install h5py, or export to .mat, .nc or .npz"
    )


WRITERS: dict[str, Callable[[Path, Cube, xr.Dataset, Mapping[str, str]], None]] = {
    ".mat": _write_mat, ".h5": _write_hdf5, ".hdf5": _write_hdf5, ".nc": _write_netcdf, ".npz": _write_npz,
}  # fmt: skip
"""By a file's ending."""
