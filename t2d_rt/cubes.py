"""ADC cubes in memory or on disk, by their size."""

from __future__ import annotations

import math
import shutil
import tempfile
import weakref
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Literal

import numpy as np

from t2d_rt.errors import InputError

LARGE_BYTES = 512 * 2**20
"""Cubes beyond it go to disk, and those beyond `LARGE_SHARE` of what a run may take."""
LARGE_SHARE = 1 / 8
BLOCK_BYTES = 8 * 2**20
"""What is read or written at once."""
NAME, DIMENSIONS = "adc", ("chirp", "antenna", "sample")


class DiskCube:
    """A complex64 cube (chirp, antenna, sample) in the zarr array "adc" of a folder, read and written by ranges of chirps."""

    ndim = 3
    dtype = np.dtype(np.complex64)

    def __init__(self, folder: Path, *, mode: Literal["r", "r+"] = "r") -> None:
        import zarr

        self.folder = folder
        self.array: Any = zarr.open_array(folder / NAME, mode=mode)
        self.shape: tuple[int, ...] = self.array.shape

    @classmethod
    def scratch(cls, shape: tuple[int, ...]) -> DiskCube:
        """Zeros in a folder under the system's place for temporary files (TMPDIR), gone with the object."""
        folder = Path(tempfile.mkdtemp(prefix="t2d-rt-"))
        try:
            new_array(folder, shape)
            cube = cls(folder, mode="r+")
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        weakref.finalize(cube, shutil.rmtree, folder, ignore_errors=True)
        return cube

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, place: Any) -> np.ndarray:
        return np.asarray(self.array[place])

    def __setitem__(self, place: Any, values: np.ndarray) -> None:
        try:
            self.array[place] = values
        except OSError as error:
            raise InputError(
                f"cannot write the ADC samples to {self.folder}: {error.strerror or error}; free space, or set TMPDIR to a "
                "folder with more"
            ) from error

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self.array[...], dtype)


class CubeWriter:
    """Fills a cube from its first row on; of one on disk, whole chunks are written while the next rows are worked on.

    >>> cube = np.zeros((3, 1, 2), np.complex64)
    >>> with CubeWriter(cube) as writer:
    ...     writer.room(2)[:] = 1
    ...     writer.room(1)[:] = 2
    >>> cube[:, 0, 0].real.tolist()
    [1.0, 1.0, 2.0]
    """

    def __init__(self, cube: Cube) -> None:
        self._cube = cube
        self._row = 0
        """Row of the cube that the buffer begins with; in memory, the next one."""
        self._held = 0
        """Rows in the buffer."""
        self._buffer = self._other = np.empty((0, *cube.shape[1:]), DiskCube.dtype)
        self._writing: Future[None] | None = None
        self._pool = ThreadPoolExecutor(1)

    def __enter__(self) -> CubeWriter:
        return self

    def __exit__(self, failed: type[BaseException] | None, *_: object) -> None:
        try:
            if failed is None and isinstance(self._cube, DiskCube):
                self._hand_over(self._held)
                self._wait()
        finally:
            self._pool.shutdown()

    def room(self, rows: int) -> np.ndarray:
        """The next rows, to be filled before the next call; what they hold before is anything."""
        if isinstance(self._cube, np.ndarray):
            self._row += rows
            return self._cube[self._row - rows : self._row]
        self._hand_over(self._held // _rows(self._cube.shape) * _rows(self._cube.shape))
        if len(self._buffer) < self._held + rows:
            grown = np.empty((self._held + rows, *self._cube.shape[1:]), DiskCube.dtype)
            grown[: self._held] = self._buffer[: self._held]
            self._buffer = grown
        self._held += rows
        return self._buffer[self._held - rows : self._held]

    def _hand_over(self, rows: int) -> None:
        """Lets the buffer's first rows be written, and goes on with the others in the other buffer."""
        if not rows:
            return
        self._wait()
        left = self._buffer[rows : self._held]
        if len(self._other) < len(left):
            self._other = np.empty_like(self._buffer)
        self._other[: len(left)] = left
        place = slice(self._row, self._row + rows)
        self._writing = self._pool.submit(self._cube.__setitem__, place, self._buffer[:rows])
        self._buffer, self._other = self._other, self._buffer
        self._row, self._held = place.stop, len(left)

    def _wait(self) -> None:
        if self._writing is not None:
            self._writing.result()


class CubeAdder:
    """Adds to a cube from its first row on, as `CubeWriter` fills one.

    >>> cube = np.ones((3, 1, 2), np.complex64)
    >>> with CubeAdder(cube) as adder:
    ...     adder.room(2)[:] = 1
    ...     adder.room(1)[:] = 2
    >>> cube[:, 0, 0].real.tolist()
    [2.0, 2.0, 3.0]
    """

    def __init__(self, cube: Cube) -> None:
        self._cube, self._row = cube, 0
        self._held = np.zeros((0, *cube.shape[1:]), DiskCube.dtype)

    def __enter__(self) -> CubeAdder:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self._add()

    def room(self, rows: int) -> np.ndarray:
        """What is added to the next rows, to be filled before the next call; what it holds before is anything."""
        self._add()
        self._held = np.empty((rows, *self._cube.shape[1:]), DiskCube.dtype)
        return self._held

    def _add(self) -> None:
        place = slice(self._row, self._row + len(self._held))
        self._cube[place] = np.asarray(self._cube[place]) + self._held
        self._row = place.stop


Cube = np.ndarray | DiskCube
"""(chirp, antenna, sample) complex [sqrt(W)]."""


def is_large(shape: tuple[int, ...], limit_bytes: float = math.inf) -> bool:
    """Whether a complex64 cube of that shape goes to disk, in a run that may take `limit_bytes` of memory."""
    return math.prod(shape) * DiskCube.dtype.itemsize > min(LARGE_BYTES, LARGE_SHARE * limit_bytes)


def new_cube(shape: tuple[int, ...], limit_bytes: float = math.inf) -> Cube:
    """Zeros complex64, on disk where they are large."""
    return DiskCube.scratch(shape) if is_large(shape, limit_bytes) else np.zeros(shape, np.complex64)


def new_array(folder: Path, shape: tuple[int, ...]) -> Any:
    """The zarr array "adc" of complex64 zeros in the group `folder`, which is made; not compressed: phases do not compress."""
    import zarr

    zarr.open_group(folder, mode="a")
    return zarr.create_array(
        folder,
        name=NAME,
        shape=shape,
        chunks=(min(shape[0], _rows(shape)), *shape[1:]),
        dtype="complex64",
        compressors=None,
        dimension_names=DIMENSIONS,
    )


def row_blocks(cube: Cube) -> Iterator[tuple[slice, np.ndarray]]:
    """The cube in ranges of chirps."""
    for start in range(0, len(cube), _rows(cube.shape)):
        part = slice(start, min(start + _rows(cube.shape), len(cube)))
        yield part, np.asarray(cube[part])


def _rows(shape: tuple[int, ...]) -> int:
    return max(1, BLOCK_BYTES // DiskCube.dtype.itemsize // int(np.prod(shape[1:])))
