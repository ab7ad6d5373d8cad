"""The files of a recording: the zarr folder in which it is saved, and single files for other programs.

The folder is a group of arrays and attributes, whose checksum detects changes. A file for other programs (MATLAB .mat, HDF5 .h5,
NetCDF .nc, NumPy .npz) holds `adc` (chirp, antenna, sample), `spectrogram` (velocity_mps, time_s), their axes and units, and, as
JSON texts, how the recording was made. NetCDF has no complex numbers: there `adc_real` and `adc_imag` replace `adc`.
"""

from __future__ import annotations

import hashlib
import json
import re
import warnings
import zipfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2d_rt.core.atomic_write import check_place, check_taken, settle, writing
from t2d_rt.core.checks import file_path, flag
from t2d_rt.core.cube_storage import DIMENSIONS, DTYPE, NAME, SavedRows, new_array, row_bytes
from t2d_rt.core.cubes import Cube, DiskCube, is_large, row_blocks
from t2d_rt.core.errors import InputError
from t2d_rt.core.stored_arrays import Inputs, packed, unpacked
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.recording.parts import read_parts, write_parts
from t2d_rt.types import Accuracy, Radar

if TYPE_CHECKING:
    import xarray as xr

FORMAT = 4
"""Format of the folders that `save` writes; `load` refuses any other."""
MADE_BY = "t2d-rt"
"""Mark of a folder that this package wrote; only folders with it, or of the formats before it, are ever replaced."""
UNMARKED_FORMATS = ("1", "2")
"""Formats from before that mark; such folders are recognised by their attributes."""
ARRAYS = (NAME, "spectrogram", "chirp_time_s", "sample_time_s", "velocity_mps", "time_s")
INPUTS = "inputs"
"""Name of the folder for arrays that the experiment refers to."""
PARTS = "parts"
"""Name of the folder for the parts into which a recording was split."""
FILES = re.compile(
    rf"zarr\.json|{INPUTS}/[0-9a-f]{{32}}\.npz|{PARTS}/\d+\.npz|({'|'.join(ARRAYS)})/(zarr\.json|c(/\d+)*)"
)
"""Pattern for the files in a recording's folder, by their paths within it."""
LARGEST_METADATA_BYTES = 64 * 2**20
"""Greatest size of a recording's zarr.json, which holds its settings [bytes]."""


def write_folder(
    folder: Path,
    cube: Cube,
    labelled: xr.Dataset,
    adc: Mapping[str, str],
    inputs: Inputs,
    parts: Mapping[str, DiskCube],
) -> None:
    """Writes a new folder with the cube, the `labelled` spectrogram and axes with all attributes, the inputs and the parts; `adc`
    are the attributes of the cube."""
    samples, digest = new_array(folder, cube.shape), hashlib.sha256()
    for rows, block in row_blocks(cube):
        samples[rows] = block
        digest.update(np.ascontiguousarray(block, np.complex64).view(np.uint8).data)
    samples.attrs.update({**adc, "sha256": digest.hexdigest()})
    with warnings.catch_warnings():
        # Without consolidated metadata a plain xarray.open_zarr warns, with it the writer does; both can read either.
        warnings.filterwarnings("ignore", message="Consolidated metadata is currently not part")
        labelled.to_zarr(folder, mode="a", consolidated=True, write_empty_chunks=True)
    if inputs:
        (folder / INPUTS).mkdir()
    for name, arrays in inputs.items():
        (folder / INPUTS / f"{name}.npz").write_bytes(packed(arrays))
    if parts:
        write_parts(folder / PARTS, parts)
    metadata = _metadata(folder)
    metadata["attributes"]["checksum"] = _checksum(folder, metadata)
    (folder / "zarr.json").write_text(json.dumps(metadata, indent=2), encoding="utf-8")


def read_folder(source: Path) -> dict[str, Any]:
    """Arguments of a `Recording` from a folder that `write_folder` wrote; refuses one that is incomplete or was changed."""
    while True:
        before = _state(source)
        try:
            return _read(source)
        except InputError:
            if _state(source) == before:  # unchanged state: the folder was not replaced while it was read
                raise


def _read(source: Path) -> dict[str, Any]:
    if not source.is_dir():
        with suppress(OSError):  # the folder may be missing, or not writable
            settle(source)
    if not source.is_dir():
        raise InputError(f"{source} is not a result folder; give a .zarr folder that `simulate` wrote")
    try:
        metadata = _metadata(source)
        attributes = metadata["attributes"]
        if attributes["format"] != str(FORMAT):
            raise InputError(f"{source} has format {attributes['format']}, expected {FORMAT}; simulate it again")
        if attributes["checksum"] != _checksum(source, metadata):
            raise InputError(f"{source} is damaged: it is not as it was written; simulate it again")
        contents = {name: json.loads(attributes[name]) for name in ("settings", "processing", "versions")}
        experiment, accuracy = (json.loads(attributes[name]) for name in ("experiment", "accuracy"))
        rows = SavedRows.of(source)
        on_disk = DiskCube(rows)
        cube = on_disk if is_large(rows.shape) else np.asarray(on_disk)
        contents |= {
            "cube": cube,
            "radar": Radar(**json.loads(attributes["radar"])),
            "experiment": None if experiment is None else Experiment.model_validate(experiment),
            "accuracy": None if accuracy is None else Accuracy.model_validate(accuracy),
            "inputs": {file.stem: unpacked(file) for file in sorted((source / INPUTS).glob("*.npz"))},
            "parts": read_parts(source / PARTS),
        }
        if rows.sha256 != _sha256(cube):
            raise InputError(f"the ADC samples in {source} are damaged; simulate it again")
        return contents
    except InputError:
        raise
    except Exception as error:  # a damaged file may raise anything
        raise not_a_result(source, error) from error


def json_text(name: str, values: Mapping[str, Any]) -> str:
    """Values as JSON text for the attributes of a recording; an InputError calls them by `name`."""
    try:
        return json.dumps(values)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} of a result must be plain numbers, texts and lists of them: {error}") from None


def plain(value: Any) -> Any:
    """Converts NumPy numbers and arrays to numbers and lists, which JSON accepts."""
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def not_a_result(source: Path, error: Exception) -> InputError:
    """The error for a folder in which something is missing or wrong."""
    reason = f"no {error}" if isinstance(error, KeyError) else error
    return InputError(f"{source} does not hold a t2d-rt result ({reason}); simulate it again")


def check_free(target: Path, *, overwrite: bool) -> None:
    """Refuses a path for a recording that exists or cannot be written, before any work is done."""
    if target.is_file():
        raise InputError(f"{target} is a file and a result is a folder; choose another name")
    check_place(target, overwrite=overwrite)
    check_replaceable(target, overwrite=overwrite)


def check_replaceable(target: Path, picture: Path | None = None, *, overwrite: bool) -> None:
    """Refuses a path that exists, unless `overwrite` is set and it is the folder of a recording and holds nothing else; likewise a
    picture that exists."""
    for place in (target, picture):
        if place is not None:
            check_taken(place, overwrite=overwrite)
    if not target.exists():
        return
    try:
        attributes = _metadata(target)["attributes"]
        marked = attributes.get("made_by") == MADE_BY
        unmarked = (
            attributes.get("format") in UNMARKED_FORMATS and {"radar", "settings", "processing"} <= attributes.keys()
        )
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        marked = unmarked = False
    if not (marked or unmarked):
        raise InputError(f"{target} is a folder but not a result, so it is not replaced; choose another name")
    for path in target.rglob("*"):
        if not path.is_dir() and not FILES.fullmatch(path.relative_to(target).as_posix()):
            raise InputError(
                f"{target} is not replaced, for it holds {path.name} besides a result; move that elsewhere"
            )


def _state(folder: Path) -> tuple[int, ...] | None:
    """Identity of a folder (device, inode, time of modification), which changes when it is replaced or written to; None if there is
    none."""
    try:
        status = folder.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino, status.st_mtime_ns


def _metadata(folder: Path) -> dict[str, Any]:
    """The zarr.json of the group, with the metadata of the arrays."""
    path = folder / "zarr.json"
    if not path.is_file() or path.stat().st_size > LARGEST_METADATA_BYTES:
        raise ValueError("its zarr.json is missing or too large")
    metadata = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(metadata, dict):
        raise ValueError("its zarr.json is no JSON object")
    return metadata


def _checksum(folder: Path, metadata: Mapping[str, Any]) -> str:
    """Checksum of the metadata, without this checksum itself, and of all files except the samples, whose own checksum is part of
    the metadata."""
    attributes = {name: value for name, value in metadata["attributes"].items() if name != "checksum"}
    digest = hashlib.sha256(json.dumps({**metadata, "attributes": attributes}, sort_keys=True).encode())
    files = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if not path.is_dir()}
    for name in sorted(files):
        hidden = name.rpartition("/")[2].startswith(".")  # file systems and desktops leave hidden files
        if name == "zarr.json" or name.startswith(f"{NAME}/c/") or hidden:
            continue
        if not files[name].is_file():
            raise InputError(f"{folder} holds {name}, which is no plain file; simulate it again")
        with files[name].open("rb") as file:
            digest.update(f"\n{name} {hashlib.file_digest(file, 'sha256').hexdigest()}".encode())
    return digest.hexdigest()


def _sha256(cube: Cube) -> str:
    """Checksum of all samples in order."""
    digest = hashlib.sha256()
    for _, block in row_blocks(cube):
        digest.update(np.ascontiguousarray(block).view(np.uint8).data)
    return digest.hexdigest()


LARGEST_BYTES = {".mat": 2**31 - 2**10, ".nc": 2 * (2**32 - 2**10)}
"""Greatest size of a cube [bytes]: MATLAB's variables have up to 2 GiB in files before version 7.3 (its manual, "MAT-File
Versions"), those of NetCDF-3, one each for real and imaginary parts, less than 4 GiB."""


def check_export(path: str | Path, cube: Cube, *, overwrite: bool) -> Path:
    """The path for an exported file; refuses an unknown ending, a cube too large for the format, and a path that cannot be
    written."""
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
    """Writes the cube, and the labelled arrays and axes with their units, to a file for other programs; an error leaves an existing
    file unchanged."""
    with writing(target, overwrite=overwrite) as new:
        WRITERS[target.suffix.lower()](new, cube, labelled, attributes)


def _units(labelled: xr.Dataset) -> dict[str, str]:
    return {NAME: "sqrt(W)"} | {str(name): str(array.attrs["units"]) for name, array in labelled.variables.items()}


def _write_mat(new: Path, cube: Cube, labelled: xr.Dataset, attributes: Mapping[str, str]) -> None:
    """MATLAB 5 file: arrays by their names; `units` and `attributes` as structures of texts."""
    from scipy.io import savemat

    arrays = {str(name): array.values for name, array in labelled.variables.items()}
    texts = {"units": _units(labelled), "attributes": dict(attributes)}
    savemat(new, {NAME: np.asarray(cube), **arrays, **texts}, appendmat=False, oned_as="column")


def _write_netcdf(new: Path, cube: Cube, labelled: xr.Dataset, attributes: Mapping[str, str]) -> None:
    """NetCDF-3 file with 64-bit offsets, which needs no further library."""
    whole = np.asarray(cube)
    parts = {
        f"{NAME}_{word}": (DIMENSIONS, part, {"units": "sqrt(W)"})
        for word, part in (("real", whole.real), ("imag", whole.imag))
    }
    data = labelled.assign(parts).assign_attrs(attributes)
    data.to_netcdf(new, engine="scipy", format="NETCDF3_64BIT")


def _write_npz(new: Path, cube: Cube, labelled: xr.Dataset, attributes: Mapping[str, str]) -> None:
    """NumPy .npz file: arrays by their names; `units` and `attributes` as JSON texts; the cube is written block by block."""
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
    """HDF5 file with dimension scales; the cube is written block by block, complex numbers as h5py stores them (a compound of r and
    i)."""
    units = _units(labelled)
    with _h5py().File(new, "w") as file:
        file.attrs.update(attributes)
        samples = file.create_dataset(NAME, shape=cube.shape, dtype=DTYPE)
        for rows, block in row_blocks(cube):
            samples[rows] = block
        for name, array in labelled.variables.items():
            values = array.values if array.dtype.kind != "U" else array.values.astype(object)  # h5py's form of texts
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
    ".mat": _write_mat,
    ".h5": _write_hdf5,
    ".hdf5": _write_hdf5,
    ".nc": _write_netcdf,
    ".npz": _write_npz,
}
"""Functions that write files for other programs, by file ending."""
