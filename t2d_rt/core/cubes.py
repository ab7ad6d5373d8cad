"""ADC cubes in memory or, if they are large, on disk; writing and reading them by ranges of chirps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.core.backend import aligned_zeros
from t2d_rt.core.cube_storage import DTYPE, FileRows, SavedRows, ScratchRows, block_rows, row_bytes
from t2d_rt.core.errors import InputError
from t2d_rt.core.factored_cubes import ProductRows

LARGE_BYTES = 512 * 2**20
"""Size beyond which a cube is not held in memory [bytes]; nor are cubes beyond `LARGE_FRACTION` of a run's memory limit."""
LARGE_FRACTION = 1 / 8


@dataclass(frozen=True, slots=True)
class GatedRows:
    """Rows of a cube of which only the range cells of a gate are kept."""

    cells: np.ndarray
    """Windowed range FFT of each chirp in these cells, complex64 (chirp, antenna, cell)."""
    bins: slice
    """Range bins of the gate."""
    window: str
    """Name of the window over the samples of a chirp."""
    samples: int
    """Number of samples of a chirp."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers of chirps, antennas and samples."""
        return (*self.cells.shape[:2], self.samples)

    def read(self, start: int, stop: int) -> np.ndarray:
        """Raises an InputError, for samples cannot be recovered from range cells."""
        raise InputError(
            "this recording keeps the range cells of its gate and no ADC samples; simulate it without a range gate"
        )


class DiskCube:
    """A complex64 cube (chirp, antenna, sample) whose rows are stored on disk, or computed from what is stored there; read by
    ranges of chirps.

    It can be read as long as the cube, or an array that reads from it, exists: see `ScratchRows`, `ProductRows`, `SavedRows` and
    `FileRows`. With `GatedRows` only range cells can be read.
    """

    ndim = 3
    dtype = DTYPE

    def __init__(self, rows: ScratchRows | ProductRows | SavedRows | FileRows | GatedRows) -> None:
        self.rows = rows

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers of chirps, antennas and samples."""
        return self.rows.shape

    def __len__(self) -> int:
        return self.shape[0]

    def __repr__(self) -> str:
        where: Any = "a temporary file"
        if isinstance(self.rows, SavedRows | FileRows):
            where = self.rows.folder if isinstance(self.rows, SavedRows) else self.rows.path
        if isinstance(self.rows, GatedRows):
            where = "cells of a range gate"
        return f"DiskCube({' x '.join(map(str, self.shape))} in {where})"

    def __getitem__(self, place: Any) -> np.ndarray:
        """Indexes as NumPy does: chirps by number, slice or list, other axes by number or slice."""
        axes = place if isinstance(place, tuple) else (place,)
        if any(axis is Ellipsis for axis in axes):
            ellipsis_place = next(n for n, axis in enumerate(axes) if axis is Ellipsis)
            axes = (*axes[:ellipsis_place], *[slice(None)] * (self.ndim + 1 - len(axes)), *axes[ellipsis_place + 1 :])
        axes = (*axes, *[slice(None)] * (self.ndim - len(axes)))
        if len(axes) > self.ndim or not all(isinstance(axis, int | np.integer | slice) for axis in axes[1:]):
            raise IndexError("a cube on disk takes chirps, antenna, sample; read it into memory first (numpy.asarray)")
        return self.outer(axes)

    def spread(self, start: int, stop: int) -> float:
        """Greatest difference between beat frequencies that chirps start..stop record, as a phase [rad from mid-sweep to its end];
        infinite where it is not known."""
        return self.rows.spread(start, stop) if isinstance(self.rows, ProductRows) else np.inf

    def every(self, start: int, stop: int, step: int) -> np.ndarray:
        """Chirps start..stop at every `step`-th sample, complex64 (chirp, antenna, sample)."""
        if isinstance(self.rows, ProductRows):
            return self.rows.read(start, stop, step)
        return self[start:stop, :, ::step]

    def mixed(self, matrix: np.ndarray, start: int, step: int) -> np.ndarray:
        """Product of a matrix (mixture, chirp) with the chirps from `start` on, at every `step`-th sample, complex64 (mixture,
        antenna, sample)."""
        if isinstance(self.rows, ProductRows):
            return self.rows.mixed(matrix, start, step)
        return np.tensordot(matrix, self.every(start, start + matrix.shape[1], step), 1)

    def outer(self, axes: tuple[Any, ...]) -> np.ndarray:
        """Indexes each axis independently by an int, a slice or a list; only the blocks that hold such chirps are read."""
        if isinstance(axes[0], slice) and axes[0].step in (None, 1) and all(map(_is_all, axes[1:])):
            start, stop, _ = axes[0].indices(len(self))
            return self.rows.read(start, max(start, stop))
        numbers = np.arange(len(self))[axes[0]]
        places: Any
        if not isinstance(axes[0], slice) and numbers.ndim == 1:
            chirps, places = np.unique(numbers, return_inverse=True)
        else:
            chirps, places = np.atleast_1d(numbers), slice(None)
        samples = np.empty((len(chirps), *_selected(np.empty((0, *self.shape[1:]), DTYPE), axes[1:]).shape[1:]), DTYPE)
        cuts = np.flatnonzero(np.diff(chirps // block_rows(self.shape))) + 1
        for part in np.split(np.arange(len(chirps)), cuts) if len(chirps) else ():
            first, last = sorted((int(chirps[part[0]]), int(chirps[part[-1]])))
            block = self.rows.read(first, last + 1)
            samples[part[0] : part[-1] + 1] = _selected(block[chirps[part] - first], axes[1:])
        return samples[0] if numbers.ndim == 0 else samples[places]

    def __setitem__(self, place: slice, values: np.ndarray) -> None:
        start, stop, step = place.indices(len(self))
        if not isinstance(self.rows, ScratchRows) or step != 1 or len(values) != stop - start:
            raise InputError(f"{self} takes whole chirps in a row, and only until it is saved; copy it to memory first")
        self.rows.write(start, values)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        if copy is False:
            raise ValueError(f"{self} must be read to be an array; allow a copy")
        return np.asarray(self[:], dtype)


def _is_all(axis: Any) -> bool:
    return isinstance(axis, slice) and axis == slice(None)


def _selected(block: np.ndarray, axes: tuple[Any, ...]) -> np.ndarray:
    """Rows indexed along their other axes, from the last axis on, because an integer removes its axis."""
    for number in range(len(axes), 0, -1):
        block = block[(slice(None),) * number + (axes[number - 1],)]
    return block


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
        """Row of the cube at which the buffer begins; in memory, the next row."""
        self._held = 0
        """Number of rows in the buffer."""
        self._buffer = self._other = np.empty((0, *cube.shape[1:]), DTYPE)
        self._writing: Future[None] | None = None
        self._pool = ThreadPoolExecutor(1)

    def __enter__(self) -> CubeWriter:
        return self

    def __exit__(self, failed: type[BaseException] | None, *_: object) -> None:
        try:
            if failed is None and isinstance(self._cube, DiskCube):
                self._submit(self._held)
                self._wait()
        finally:
            self._pool.shutdown()

    def room(self, rows: int) -> np.ndarray:
        """Array (row, antenna, sample) for the next rows, to be filled before the next call; it is not initialised."""
        if isinstance(self._cube, np.ndarray):
            self._row += rows
            return self._cube[self._row - rows : self._row]
        self._submit(self._held // block_rows(self._cube.shape) * block_rows(self._cube.shape))
        if len(self._buffer) < self._held + rows:
            grown = np.empty((self._held + rows, *self._cube.shape[1:]), DTYPE)
            grown[: self._held] = self._buffer[: self._held]
            self._buffer = grown
        self._held += rows
        return self._buffer[self._held - rows : self._held]

    def _submit(self, rows: int) -> None:
        """Starts writing the first rows of the buffer, and continues with the others in the other buffer."""
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
        self._held = np.zeros((0, *cube.shape[1:]), DTYPE)
        self._products = cube.rows if isinstance(cube, DiskCube) and isinstance(cube.rows, ProductRows) else None

    def __enter__(self) -> CubeAdder:
        if self._products is not None:
            self._products.begin()
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self._add()
            if self._products is not None:
                self._products.end()

    def room(self, rows: int) -> np.ndarray:
        """Array (row, antenna, sample) for what is added to the next rows, to be filled before the next call; it is not
        initialised."""
        self._add()
        self._held = np.empty((rows, *self._cube.shape[1:]), DTYPE)
        return self._held

    def _add(self) -> None:
        place = slice(self._row, self._row + len(self._held))
        if self._products is not None:
            self._products.add_samples(place.start, self._held)
        else:
            self._cube[place] = np.asarray(self._cube[place]) + self._held
        self._row = place.stop


Cube = np.ndarray | DiskCube
"""ADC samples (chirp, antenna, sample), complex [sqrt(W)]."""


def is_large(shape: tuple[int, ...], limit_bytes: float = math.inf) -> bool:
    """Whether a complex64 cube of that shape is stored on disk, in a run whose memory limit is `limit_bytes`."""
    return shape[0] * row_bytes(shape) > min(LARGE_BYTES, LARGE_FRACTION * limit_bytes)


def new_cube(shape: tuple[int, ...], limit_bytes: float = math.inf) -> Cube:
    """A complex64 cube to be filled from its first row on; a large one is on disk, one in memory holds zeros."""
    return DiskCube(ScratchRows(shape)) if is_large(shape, limit_bytes) else aligned_zeros(shape, DTYPE)


def check_complex64(cube: np.ndarray) -> None:
    """Refuses samples that would become infinite or zero in complex64, in which recordings are stored."""
    greatest = float(np.abs(cube).max(initial=0.0)) if cube.dtype.itemsize > DTYPE.itemsize else 0.0
    if greatest and not 1e-30 < greatest < 1e30:
        raise InputError(
            f"ADC samples are kept as complex64 and must lie within 1e-30..1e30 sqrt(W), got up to {greatest:.3g}; scale them"
        )


def row_blocks(cube: Cube) -> Iterator[tuple[slice, np.ndarray]]:
    """The cube in ranges of chirps: slices and their samples."""
    for start in range(0, len(cube), block_rows(cube.shape)):
        part = slice(start, min(start + block_rows(cube.shape), len(cube)))
        yield part, np.asarray(cube[part])


SINGLE_ROWS = 4
"""Number of rows that are added in float32, and of their sums; beyond that in float64. Sums of four equal numbers are exact."""


def column_sums(samples: np.ndarray) -> np.ndarray:
    """Sum over axis 0 of complex samples (row, ...), complex128 (...), to seven digits; exact where all rows are the same.

    For complex64 it takes two thirds of NumPy's time.

    >>> column_sums(np.ones((40, 2), np.complex64)).tolist()
    [(40+0j), (40+0j)]
    """
    if samples.dtype != np.complex64:
        return np.asarray(samples.sum(axis=0, dtype=np.complex128))
    parts = np.ascontiguousarray(samples).reshape(len(samples), -1).view(np.float32)
    whole = len(parts) // SINGLE_ROWS**2 * SINGLE_ROWS**2
    block_sums = parts[:whole].reshape(-1, SINGLE_ROWS, SINGLE_ROWS, parts.shape[1]).sum(axis=1).sum(axis=1)
    sums = block_sums.sum(axis=0, dtype=np.float64) + parts[whole:].sum(axis=0, dtype=np.float64)
    return np.asarray(sums.view(np.complex128).reshape(samples.shape[1:]))
