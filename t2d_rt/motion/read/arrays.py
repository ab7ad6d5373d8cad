"""Read NumPy's .npy and .npz files with care: no pickles, and no more bytes than the limit, whatever a header promises."""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import npy_header, read_bytes, size
from t2d_rt.motion.read.samples import plausible

MAX_BYTES = 250_000_000
"""Largest file, and largest array in it: 100 000 frames of SMPL-X in double precision are 130 MB."""

MAX_ARRAYS = 200


@dataclass(frozen=True, slots=True)
class Arrays:
    """Arrays of a file by name, decoded when asked for; that of a .npy has the name ""."""

    path: Path
    texts: Mapping[str, bytes | np.ndarray]
    """Each array, or its .npy bytes."""
    given_hz: float | None = None
    """The rate that the user gives, whatever the file says."""

    def __contains__(self, name: str) -> bool:
        return name in self.texts

    def first(self, *names: str) -> str | None:
        """The first of some names that the file has."""
        return next((name for name in names if name in self.texts), None)

    def get(self, name: str) -> np.ndarray:
        """An array by name; raises an InputError if it holds Python objects or is damaged."""
        text = self.texts[name]
        return text if isinstance(text, np.ndarray) else _decoded(text, f"{self.path}{f': {name}' if name else ''}")

    def samples(self, name: str, dims: tuple[int, ...]) -> np.ndarray:
        """An array by name, checked by `samples_of`."""
        return samples_of(self.get(name), f"{self.path}: {name or 'the array'}", dims)

    def scalar(self, *names: str) -> float | None:
        """A number by the first of its names that is there, None without; raises an InputError if it is not one finite number."""
        name = self.first(*names)
        if name is None:
            return None
        value = self.get(name)
        if value.size != 1 or not np.issubdtype(value.dtype, np.number) or not np.isfinite(value).all():
            raise InputError(
                f"{self.path}: {name} must be one number, got {shown(value.item() if value.size == 1 else value)}"
            )
        return float(np.real(value).reshape(()))


def read_arrays(path: Path) -> Arrays:
    """All arrays of a .npy or .npz file, not yet decoded; raises an InputError if the file is neither or is damaged."""
    data = read_bytes(path, limit=MAX_BYTES, noun="array file")
    if not data:
        raise InputError(f"{path} is empty; expected arrays saved by numpy")
    if data[:2] == b"PK":
        return Arrays(path, _members(data, path))
    if data[:6] != b"\x93NUMPY":
        raise InputError(f"{path} is neither a .npy nor a .npz file: save the joints with numpy.save or numpy.savez")
    return Arrays(path, {"": data})


def _members(data: bytes, path: Path) -> dict[str, bytes]:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = [entry for entry in archive.infolist() if entry.filename.endswith(".npy")]
            if sum(entry.file_size for entry in entries) > MAX_BYTES or len(entries) > MAX_ARRAYS:
                raise InputError(
                    f"{path} holds more than {size(MAX_BYTES)} or {MAX_ARRAYS} arrays; keep the joints only"
                )
            members = {}
            for entry in entries:
                with archive.open(entry) as member:
                    members[entry.filename.removesuffix(".npy")] = member.read(entry.file_size)
    except InputError:
        raise
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, NotImplementedError, RuntimeError, ValueError):
        raise InputError(f"{path} is not a valid .npz file: it is cut short or damaged") from None
    if not members:
        raise InputError(f"{path} holds no arrays; save the joints with numpy.savez")
    return members


def _decoded(text: bytes, what: str) -> np.ndarray:
    stream = io.BytesIO(text)
    try:
        shape, _, dtype = npy_header(stream)
    except Exception:  # numpy raises whatever a malformed header makes its parser raise
        raise InputError(f"{what} is damaged: its header cannot be read") from None
    if dtype.hasobject:
        raise InputError(f"{what} holds Python objects (a pickle, which could run code); save it as plain numbers")
    if math.prod(shape) * dtype.itemsize > len(text) - stream.tell():
        raise InputError(f"{what} is cut short: its header promises an array of shape {shown(shape)}")
    stream.seek(0)
    try:
        return np.asarray(np.lib.format.read_array(stream, allow_pickle=False))
    except (ValueError, TypeError, EOFError):
        raise InputError(f"{what} is damaged: its data cannot be read") from None


def samples_of(values: Any, what: str, dims: tuple[int, ...]) -> np.ndarray:
    """Real numbers as float64, NaN where they are absurd; surplus leading dimensions of 1 are dropped. Raises an InputError if the
    number of dimensions is then not among `dims`."""
    if not (np.issubdtype(values.dtype, np.floating) or np.issubdtype(values.dtype, np.integer)):
        hint = "; a radar's samples are no motion, load_recording reads them" if np.iscomplexobj(values) else ""
        raise InputError(f"{what} must hold real numbers, got {shown(values)}{hint}")
    while values.ndim > max(dims) and values.shape[0] == 1:
        values = values[0]
    if values.ndim not in dims or not values.size:
        raise InputError(
            f"{what} must have {' or '.join(map(str, dims))} dimensions and some frames, got {shown(values)}"
        )
    return plausible(values.astype(np.float64))
