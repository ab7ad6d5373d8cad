"""Storage of an ADC cube's rows on disk: in a temporary file while the cube is computed, or in the folder of a recording."""

from __future__ import annotations

import math
import os
import stat
import tempfile
import weakref
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.core.files import regular_file

BLOCK_BYTES = 8 * 2**20
"""Number of bytes that are read or written at once."""
NAME, DIMENSIONS = "adc", ("chirp", "antenna", "sample")
DTYPE = np.dtype(np.complex64)
CHECKSUM_BYTES = 4
"""Size of the checksum at the end of every chunk in a recording's folder (codec crc32c of zarr)."""
LARGEST_CHUNK_BYTES = 2**30
"""Greatest size of a chunk that is read; `new_array` makes chunks of BLOCK_BYTES, or of one chirp where that is more."""
CODECS = ({"name": "bytes", "configuration": {"endian": "little"}}, {"name": "crc32c"})
"""Codecs of the array "adc"; it is not compressed, because phases cannot be."""


class ScratchFile:
    """A temporary file without a name (in TMPDIR).

    The system frees it as soon as no object or process can read it any more, however these ended.
    """

    def __init__(self) -> None:
        try:
            with tempfile.TemporaryFile(prefix="t2d-rt-", buffering=0) as file:
                self._file = os.dup(file.fileno())
        except OSError as error:
            raise _no_room(error) from error
        self.size = 0
        """Size of the file [bytes]."""
        self._failed: InputError | None = None
        # Closed with this object and not during shutdown, when the descriptor may already belong to another file.
        weakref.finalize(self, os.close, self._file).atexit = False

    def read(self, offset: int, shape: tuple[int, ...]) -> np.ndarray:
        """Reads complex64 numbers of a shape, from an offset [bytes]."""
        if self._failed is not None:
            raise self._failed
        values = np.empty(shape, DTYPE)
        data = values.reshape(-1).view(np.uint8).data
        while len(data):
            count = os.preadv(self._file, [data], offset)
            if not count:
                raise InputError("the temporary file of the ADC samples ends early; simulate again")
            data, offset = data[count:], offset + count
        return values

    def write(self, offset: int, values: np.ndarray) -> None:
        """Writes numbers at an offset [bytes]."""
        data = np.ascontiguousarray(values).reshape(-1).view(np.uint8).data
        try:
            while len(data):
                count = os.pwrite(self._file, data, offset)
                data, offset = data[count:], offset + count
        except OSError as error:
            raise _no_room(error) from error
        self.size = max(self.size, offset)

    def add(self, values: np.ndarray) -> int:
        """Appends numbers, and returns their offset [bytes]."""
        offset = self.size
        self.write(offset, values)
        return offset

    def append(self, block: bytes) -> None:
        """Appends bytes, for `pickle` and `copy`. A full disk is reported only on reading, since an error here would make a process
        pool hang."""
        try:
            self.write(self.size, np.frombuffer(block, np.uint8))
        except InputError as error:
            self._failed = self._failed or error

    def __reduce__(self) -> tuple[Any, ...]:
        # The content is pickled, in blocks, because another process cannot open a file without a name.
        return ScratchFile, (), None, self.blocks()

    def blocks(self) -> Iterator[bytes]:
        """The content of the file, block by block."""
        for offset in range(0, self.size, BLOCK_BYTES):
            size = min(BLOCK_BYTES, self.size - offset)
            yield self.read(offset, (size // DTYPE.itemsize,)).tobytes()


class ScratchRows:
    """Rows (antenna, sample) in a temporary file, written from the first one on."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.shape = shape
        self._written = 0
        """Number of rows written so far; reading any after these is an error, not zeros."""
        self._file = ScratchFile()

    def read(self, start: int, stop: int) -> np.ndarray:
        """Rows start..stop, complex64 (row, antenna, sample)."""
        if stop > self._written:
            raise InputError(
                f"chirps {start}..{stop} of the ADC samples were asked for, and only {self._written} of {self.shape[0]} have "
                "been written; simulate again"
            )
        return self._file.read(start * row_bytes(self.shape), (stop - start, *self.shape[1:]))

    def write(self, start: int, rows: np.ndarray) -> None:
        """Writes rows from `start` on, which must not lie beyond the rows written so far."""
        if start > self._written or start + len(rows) > self.shape[0] or rows.shape[1:] != self.shape[1:]:
            raise InputError(
                f"rows {rows.shape} from {start} on do not fit {self._written} of {self.shape} written so far"
            )
        self._file.write(start * row_bytes(self.shape), np.asarray(rows, DTYPE))
        self._written = max(self._written, start + len(rows))


class SavedRows:
    """Rows (antenna, sample) of the array "adc" in a recording's folder; an error if the folder no longer holds the same recording.

    It is opened when first read, so that errors arise where samples are used and not while a process pool unpickles them.
    """

    def __init__(self, folder: Path, shape: tuple[int, ...], sha256: str) -> None:
        self.folder = folder
        """Absolute path, as the working directory may change."""
        self.shape = shape
        self.sha256 = sha256
        """Checksum of the samples, as in the array's attributes."""
        self._array: Any = None
        self._state: tuple[int, ...] | None = None

    @classmethod
    def of(cls, folder: Path) -> SavedRows:
        """The rows that the folder holds now."""
        array = _saved_array(folder)
        return cls(folder, tuple(array.shape), str(array.attrs.get("sha256")))

    def read(self, start: int, stop: int) -> np.ndarray:
        """Rows start..stop, complex64 (row, antenna, sample)."""
        state = self._opened()
        self._check_chunks(start, stop)
        try:
            rows = np.asarray(self._array[start:stop])
        except Exception as error:  # zarr and its codecs may raise anything
            raise _damaged(self.folder, str(error)) from error
        self._check_chunks(start, stop)  # zarr would read a missing chunk as fill values
        if self._state_now() != state:
            raise _damaged(self.folder, "replaced while they were read")
        return rows

    def __reduce__(self) -> tuple[Any, ...]:
        return SavedRows, (self.folder, self.shape, self.sha256)

    def _opened(self) -> tuple[int, ...]:
        """Opens the array, or opens it anew if its files have changed."""
        state = self._state_now()
        if state != self._state:
            array = _saved_array(self.folder)
            if tuple(array.shape) != self.shape or array.attrs.get("sha256") != self.sha256:
                raise InputError(f"{self.folder} holds another recording by now; load it again")
            self._array, self._state = array, state
        return state

    def _state_now(self) -> tuple[int, ...]:
        try:
            status = (self.folder / NAME / "zarr.json").stat()
        except OSError as error:
            raise _damaged(self.folder, error.strerror or str(error)) from error
        return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns

    def _check_chunks(self, start: int, stop: int) -> None:
        """Checks that every chunk of these rows is a complete file."""
        rows = int(self._array.chunks[0])
        expected = rows * row_bytes(self.shape) + CHECKSUM_BYTES
        for chunk in range(start // rows, -(-stop // rows)):
            try:
                status = (self.folder / NAME / "c" / str(chunk) / "0" / "0").stat()
            except OSError as error:
                raise _damaged(self.folder, f"chunk {chunk}: {error.strerror}") from error
            if not stat.S_ISREG(status.st_mode) or status.st_size != expected:
                raise _damaged(self.folder, f"chunk {chunk} has {status.st_size} bytes, expected {expected}")


@dataclass(frozen=True, eq=False)
class FileRows:
    """Rows (antenna, sample) of a file of measured samples, which are decoded when read; an error if the file has changed."""

    path: Path
    """Absolute path of the file."""
    shape: tuple[int, int, int]
    begin: int
    """Offset of the first row in the file [bytes]."""
    dtype: np.dtype[Any]
    row_numbers: int
    """How many numbers make a row."""
    decode: Callable[[np.ndarray], np.ndarray] | None = None
    """Function that decodes rows of numbers (row, number) to as many rows of complex64 samples; None before it is known."""
    held: np.ndarray | None = None
    """All numbers (row, number), where those of a row are not contiguous in the file; None where they are read when needed."""
    state: tuple[int, int] = field(init=False)
    """Size and modification time of the file."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "state", self._state(self.path.stat()))

    def numbers(self, start: int, stop: int) -> np.ndarray:
        """Numbers of rows start..stop as stored in the file, (row, number)."""
        if self.held is not None:
            return self.held[start:stop]
        values = np.empty((stop - start, self.row_numbers), self.dtype)
        with regular_file(self.path, noun="recording") as file:
            file.seek(self.begin + start * self.row_numbers * self.dtype.itemsize)
            count = file.readinto(values.reshape(-1).view(np.uint8).data)  # type: ignore[attr-defined]
            if count != values.nbytes or self._state(os.fstat(file.fileno())) != self.state:
                raise InputError(f"{self.path} has changed since it was loaded; load it again")
        return values

    def read(self, start: int, stop: int) -> np.ndarray:
        """Samples of rows start..stop, complex64 (row, antenna, sample)."""
        assert self.decode is not None
        return self.decode(self.numbers(start, stop)).reshape(stop - start, *self.shape[1:])

    @staticmethod
    def _state(status: os.stat_result) -> tuple[int, int]:
        return status.st_size, status.st_mtime_ns


def new_array(folder: Path, shape: tuple[int, ...]) -> Any:
    """Creates the zarr array "adc" of complex64 in the group `folder`."""
    import zarr
    from zarr.codecs import Crc32cCodec

    zarr.open_group(folder, mode="a")
    return zarr.create_array(
        folder,
        name=NAME,
        shape=shape,
        chunks=(min(shape[0], block_rows(shape)), *shape[1:]),
        dtype="complex64",
        compressors=[Crc32cCodec()],
        fill_value=complex(np.nan, np.nan),  # value that readers get for a missing chunk
        config={"write_empty_chunks": True},
        dimension_names=DIMENSIONS,
    )


def _saved_array(folder: Path) -> Any:
    """The zarr array "adc" of a recording's folder; refuses one of another layout than that of `new_array`, which could ask for any
    amount of memory."""
    import zarr

    try:
        array: Any = zarr.open_array(folder / NAME, mode="r", zarr_format=3)
        shape, chunks, codecs = tuple(array.shape), tuple(array.chunks), tuple(array.metadata.to_dict()["codecs"])
    except Exception as error:  # zarr may raise anything
        raise _damaged(folder, str(error)) from error
    if len(shape) != 3 or 0 in shape or array.dtype != DTYPE:
        raise InputError(f"{folder} holds samples of shape {shape} and type {array.dtype}; expected a complex64 cube")
    if chunks[1:] != shape[1:] or codecs != CODECS or chunks[0] * row_bytes(shape) > LARGEST_CHUNK_BYTES:
        raise InputError(f"{folder} holds samples in another layout than t2d-rt writes; simulate it again")
    return array


def block_rows(shape: tuple[int, ...]) -> int:
    """Number of chirps that are read or written at once."""
    return max(1, BLOCK_BYTES // row_bytes(shape))


def row_bytes(shape: tuple[int, ...]) -> int:
    """Size of one chirp [bytes]."""
    return DTYPE.itemsize * math.prod(shape[1:])


def _damaged(folder: Path, reason: str) -> InputError:
    return InputError(f"the ADC samples in {folder} are damaged or gone ({reason}); simulate it again")


def _no_room(error: OSError) -> InputError:
    return InputError(
        f"cannot write the ADC samples to the folder for temporary files ({error.strerror or error}); free space, or set "
        "TMPDIR to a folder with more"
    )
