"""Samples of an ADC cube as the sum of echoes makes them last: few numbers for each chirp, times a matrix over the sweep.

Of a large cube these numbers are kept in place of the samples: for a body before an array they are a tenth of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from t2d_rt.errors import InputError
from t2d_rt.rows import DTYPE, ScratchFile

PRODUCT_CHIRPS = 512
"""Chirps at once from numbers to samples: few enough that buckets which the target has left, or not reached, are left out."""
BASIS_NUMBERS = 8_000_000
"""Size of the matrix; a very wide sweep is worked on in pieces of its samples."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Some chirps' samples: numbers (chirp, bucket x Q) times the buckets' carriers over the sweep times weights."""

    numbers: np.ndarray
    """complex64; the samples themselves where there are no `weights`."""
    theta: np.ndarray
    """The buckets' carriers in phase over x, (bucket,)."""
    weights: np.ndarray | None
    """What each of the Q adds to the samples, (Q, sample)."""
    x: np.ndarray
    """Places of the samples in the sweep, -1..1, (sample,)."""
    phase: np.ndarray | None
    """Factor of each chirp's samples, (chirp,); these are added to what there is."""
    band: float
    """How far from its bucket's carrier the phase over x of what it holds may be."""

    @classmethod
    def of_samples(cls, samples: np.ndarray) -> Piece:
        """Samples (chirp, sample) as they are."""
        return cls(samples, np.zeros(1), None, np.zeros(0), None, np.inf)

    def at(self, places: slice) -> Piece:
        """The same at some of the samples."""
        if self.weights is None:
            return replace(self, numbers=self.numbers[:, places])
        return replace(self, weights=self.weights[:, places], x=self.x[places])

    def put(self, out: np.ndarray) -> None:
        """Fills `out` (chirp, sample), or adds to it."""
        if self.weights is None:
            out[:] = self.numbers
        elif self.phase is None:
            self._multiply(out)
        else:
            samples = np.empty(out.shape, DTYPE)
            self._multiply(samples)
            out += samples * self.phase[:, None]

    def _multiply(self, out: np.ndarray) -> None:
        assert self.weights is not None
        size = max(1, BASIS_NUMBERS // max(1, len(self.theta) * len(self.weights)))
        for first in range(0, len(self.x), size):
            some = slice(first, first + size)
            carriers = np.exp(1j * np.outer(self.theta, self.x[some]))
            basis = (carriers[:, None] * self.weights[:, some]).astype(DTYPE)
            np.matmul(self.numbers, basis.reshape(-1, basis.shape[2]), out=out[:, some])


@dataclass(frozen=True, slots=True)
class Product:
    """What buckets return at each chirp, over the sweep."""

    numbers: np.ndarray
    """(chirp, bucket, Q) complex64."""
    weights: np.ndarray
    """As those of a `Piece`, like all that follow."""
    theta: np.ndarray
    x: np.ndarray
    band: float
    phase: np.ndarray | None = None

    def pieces(self) -> Iterator[tuple[slice, Piece]]:
        """Pieces of `PRODUCT_CHIRPS`, each with the buckets that hold anything at these."""
        for start in range(0, len(self.numbers), PRODUCT_CHIRPS):
            chirps = slice(start, min(start + PRODUCT_CHIRPS, len(self.numbers)))
            part = self.numbers[chirps]
            used = part.view(np.uint64).any(axis=(0, 2))  # as integers: six times as fast
            phase = None if self.phase is None else self.phase[chirps]
            numbers = part[:, used].reshape(len(part), -1)
            yield chirps, Piece(numbers, self.theta[used], self.weights, self.x, phase, self.band)

    def put(self, out: np.ndarray) -> None:
        """Fills `out` (chirp, sample), or adds to it."""
        for chirps, piece in self.pieces():
            piece.put(out[chirps])


class ProductRows:
    """Rows (antenna, sample) of a cube, as pieces whose numbers lie in a temporary file without a name.

    They are added in layers, each a sum of echoes over the whole record; a row is the sum of its layers.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.shape = shape
        self._file = ScratchFile()
        self._layers: list[list[_Stored]] = []
        self._whole = False

    def begin(self) -> None:
        """A layer, to which pieces are added from now on."""
        self._layers.append([])
        self._whole = False

    def end(self) -> None:
        """The layer is whole."""
        self._whole = True

    def add(self, row: int, antenna: int, product: Product) -> None:
        """A product from a row on, to the last layer."""
        for chirps, piece in product.pieces():
            if piece.numbers.shape[1] > self.shape[2] and piece.phase is None:
                samples = np.empty((len(piece.numbers), self.shape[2]), DTYPE)
                piece.put(samples)
                piece = Piece.of_samples(samples)
            self._append(row + chirps.start, antenna, piece)

    def add_samples(self, row: int, samples: np.ndarray) -> None:
        """Samples (row, antenna, sample) from a row on, to the last layer; where they are zero nothing is kept."""
        for first in range(0, len(samples), PRODUCT_CHIRPS):
            for antenna, some in enumerate(samples[first : first + PRODUCT_CHIRPS].swapaxes(0, 1)):
                if some.any():
                    self._append(row + first, antenna, Piece.of_samples(some))

    def _append(self, row: int, antenna: int, piece: Piece) -> None:
        offset = self._file.append(piece.numbers)
        rows, width = piece.numbers.shape
        stored = replace(piece, numbers=np.empty((0, width)))
        self._layers[-1].append(_Stored(row, row + rows, antenna, offset, stored))

    def spread(self, start: int, stop: int) -> float:
        """By how much the phases over x of anything in rows start..stop differ at most."""
        pieces = (each.piece for layer in self._layers for each in self._some(layer, start, stop))
        some = [piece for piece in pieces if len(piece.theta)]
        low = min((float(piece.theta.min()) - piece.band for piece in some), default=0.0)
        return max((float(piece.theta.max()) + piece.band for piece in some), default=0.0) - low

    def _some(self, layer: list[_Stored], start: int, stop: int) -> Iterator[_Stored]:
        """Those of a layer's pieces that hold any of rows start..stop."""
        return (each for each in layer if each.start < stop and each.stop > start)

    def read(self, start: int, stop: int, every: int = 1) -> np.ndarray:
        """Rows start..stop, complex64 (row, antenna, sample), `every` so many samples; pieces are multiplied whole, so that
        these are the same bits whatever rows are asked for."""
        from threadpoolctl import threadpool_limits

        if not self._whole:
            raise InputError("the ADC samples were not summed to their end; simulate again")
        rows: np.ndarray | None = None
        with threadpool_limits(1, user_api="blas"):
            for layer in self._layers:
                found = np.zeros((stop - start, self.shape[1], len(range(0, self.shape[2], every))), DTYPE)
                for each in self._some(layer, start, stop):
                    self._put(each, start, found, slice(None, None, every))
                rows = found if rows is None else rows + found
        assert rows is not None, "a whole sum has a layer"
        return rows

    def _put(self, each: _Stored, start: int, rows: np.ndarray, samples: slice) -> None:
        """Puts some samples of a stored piece into rows from `start` on."""
        numbers = self._file.read(each.offset, (each.stop - each.start, each.piece.numbers.shape[1]))
        piece = replace(each.piece, numbers=numbers).at(samples)
        first, last = max(start, each.start), min(start + len(rows), each.stop)
        inside = rows[first - start : last - start, each.antenna]
        if last - first == each.stop - each.start:
            piece.put(inside)
        else:
            whole = np.zeros((each.stop - each.start, rows.shape[2]), DTYPE)
            whole[first - each.start : last - each.start] = inside
            piece.put(whole)
            inside[:] = whole[first - each.start : last - each.start]

    def append(self, block: bytes) -> None:
        """The next bytes of the file, for `pickle` and `copy`."""
        self._file.append(np.frombuffer(block, np.uint8))

    def __reduce__(self) -> tuple[Any, ...]:
        # By value, in blocks: a file without a name cannot be opened by another process.
        return ProductRows, (self.shape,), {"_layers": self._layers, "_whole": self._whole}, self._file.blocks()


@dataclass(frozen=True, slots=True)
class _Stored:
    """A piece on disk."""

    start: int
    """Its first row of the cube, and the one after its last."""
    stop: int
    antenna: int
    offset: int
    """Of its numbers in the file."""
    piece: Piece
    """Without its numbers, of which there are none but their width."""
