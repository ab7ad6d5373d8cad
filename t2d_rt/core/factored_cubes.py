"""The last step of the sum of echoes, samples = coefficients of each chirp times a matrix over the sweep; cubes that keep these.

Of a large cube the coefficients are kept in place of the samples: for a body before an array they are a tenth of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from threading import Lock

import numpy as np

from t2d_rt.core.backend import one_blas_thread
from t2d_rt.core.cube_storage import DTYPE, ScratchFile
from t2d_rt.core.errors import InputError

PIECE_CHIRPS = 512
"""Chirps of a piece: few enough that buckets which the target has left, or not reached, are left out."""
PRODUCT_CHIRPS = 128
"""Chirps that are multiplied at once. A part of a piece is multiplied in the same blocks as the whole, for the same bits."""
BASIS_NUMBERS = 8_000_000
"""Size of the matrix; a very wide sweep is worked on in pieces of its samples."""
_alone = Lock()
"""The number of BLAS threads is one setting of the process."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Some chirps of one antenna: coefficients (chirp, bucket x Q) times the buckets' carriers over the sweep times weights."""

    coefficients: np.ndarray
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
    """Greatest |theta - the bucket's theta| of anything in it [rad]."""

    @classmethod
    def of_samples(cls, samples: np.ndarray, phase: np.ndarray | None = None) -> Piece:
        """Samples (chirp, sample) as they are, of which nothing is known."""
        return cls(samples, np.zeros(1), None, np.zeros(0), phase, np.inf)

    def at(self, samples: slice) -> Piece:
        """The same at some of the samples."""
        if self.weights is None:
            return replace(self, coefficients=self.coefficients[:, samples])
        return replace(self, weights=self.weights[:, samples], x=self.x[samples])

    def put(self, out: np.ndarray) -> None:
        """Fills `out` (chirp, sample), or adds to it where there is a phase."""
        if self.phase is not None:
            out += self.samples() * self.phase[:, None]
        elif self.weights is None:
            out[:] = self.coefficients
        else:
            self._multiply(out)

    def samples(self) -> np.ndarray:
        """Those before the phase, complex64 (chirp, sample)."""
        if self.weights is None:
            return self.coefficients
        out = np.empty((len(self.coefficients), len(self.x)), DTYPE)
        self._multiply(out)
        return out

    def _multiply(self, out: np.ndarray) -> None:
        assert self.weights is not None
        size = max(1, BASIS_NUMBERS // max(1, len(self.theta) * len(self.weights)))
        for first in range(0, len(self.x), size):
            some = slice(first, first + size)
            carriers = np.exp(1j * np.outer(self.theta, self.x[some]))
            basis = (carriers[:, None] * self.weights[:, some]).astype(DTYPE)
            basis = basis.reshape(-1, basis.shape[2])
            for start in range(0, len(out), PRODUCT_CHIRPS):
                chirps = slice(start, start + PRODUCT_CHIRPS)
                np.matmul(self.coefficients[chirps], basis, out=out[chirps, some])


@dataclass(frozen=True, slots=True)
class Product:
    """What buckets return at each chirp of one antenna, over the sweep."""

    coefficients: np.ndarray
    """(chirp, bucket, Q) complex64."""
    weights: np.ndarray
    """What each of the Q adds to the samples, (Q, sample)."""
    theta: np.ndarray
    """The buckets' carriers in phase over x, (bucket,)."""
    x: np.ndarray
    """Places of the samples in the sweep, -1..1, (sample,)."""
    band: float
    """Greatest |theta - the bucket's theta| of anything in a bucket [rad]."""
    phase: np.ndarray | None = None
    """Factor of each chirp's samples, (chirp,); these are added to what there is."""

    def pieces(self) -> Iterator[tuple[slice, Piece]]:
        """Pieces of `PIECE_CHIRPS`, each with the buckets that hold anything at these."""
        for start in range(0, len(self.coefficients), PIECE_CHIRPS):
            chirps = slice(start, min(start + PIECE_CHIRPS, len(self.coefficients)))
            part = self.coefficients[chirps]
            used = part.view(np.uint64).any(axis=(0, 2))  # as integers: six times as fast
            phase = None if self.phase is None else self.phase[chirps]
            found = part[:, used].reshape(len(part), -1)
            yield chirps, Piece(found, self.theta[used], self.weights, self.x, phase, self.band)

    def put(self, out: np.ndarray) -> None:
        """Fills `out` (chirp, sample), or adds to it where there is a phase."""
        for chirps, piece in self.pieces():
            piece.put(out[chirps])


def together(products: Sequence[Product]) -> Product:
    """The sum of products of the same chirps, whose buckets are the same ones where their carriers are."""
    if len(products) == 1:
        return products[0]
    first = products[0]
    theta, place = np.unique(np.concatenate([each.theta for each in products]), return_inverse=True)
    coefficients = np.zeros((len(first.coefficients), len(theta), len(first.weights)), DTYPE)
    begin = 0
    for each in products:
        coefficients[:, place[begin : begin + len(each.theta)]] += each.coefficients
        begin += len(each.theta)
    return replace(first, coefficients=coefficients, theta=theta)


class ProductRows:
    """Rows (antenna, sample) of a cube, as pieces whose coefficients lie in a temporary file without a name.

    They are added in layers, each a sum of echoes over the whole record; a row is the sum of its layers.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.shape = shape
        self._file = ScratchFile()
        self._layers: list[_Layer] = []
        self._whole = False

    def begin(self) -> None:
        """A layer, to which pieces are added from now on."""
        self._layers.append(_Layer())
        self._whole = False

    def end(self) -> None:
        """The layer is whole."""
        self._whole = True

    def add(self, row: int, antenna: int, product: Product) -> None:
        """A product from a row on, to the last layer."""
        for chirps, piece in product.pieces():
            many = piece.coefficients.shape[1] > self.shape[2]
            self._append(row + chirps.start, antenna, Piece.of_samples(piece.samples(), piece.phase) if many else piece)

    def add_samples(self, row: int, samples: np.ndarray) -> None:
        """Samples (row, antenna, sample) from a row on, to the last layer; where they are zero nothing is kept."""
        for first in range(0, len(samples), PIECE_CHIRPS):
            for antenna, some in enumerate(samples[first : first + PIECE_CHIRPS].swapaxes(0, 1)):
                if some.any():
                    self._append(row + first, antenna, Piece.of_samples(some))

    def _append(self, row: int, antenna: int, piece: Piece) -> None:
        offset = self._file.add(piece.coefficients)
        rows, width = piece.coefficients.shape
        stored = replace(piece, coefficients=np.empty((0, width), DTYPE))
        self._layers[-1].add(_Stored(row, row + rows, antenna, offset, stored))

    def spread(self, start: int, stop: int) -> float:
        """By how much the phases over x of anything in rows start..stop differ at most."""
        pieces = (each.piece for layer in self._layers for each in layer.within(start, stop))
        some = [piece for piece in pieces if len(piece.theta)]
        low = min((float(piece.theta.min()) - piece.band for piece in some), default=0.0)
        return max((float(piece.theta.max()) + piece.band for piece in some), default=0.0) - low

    def read(self, start: int, stop: int, every: int = 1) -> np.ndarray:
        """Rows start..stop, complex64 (row, antenna, sample), of `every` so many samples; the same bits whatever rows are read."""
        if not self._whole:
            raise InputError("the ADC samples were not summed to their end; simulate again")
        samples = slice(None, None, every)
        rows: np.ndarray | None = None
        with _alone, one_blas_thread:
            for layer in self._layers:
                found = np.zeros((stop - start, self.shape[1], len(range(0, self.shape[2], every))), DTYPE)
                for each in layer.within(start, stop):
                    self._put(each, start, found, samples)
                rows = found if rows is None else rows + found
        assert rows is not None, "a whole sum has a layer"
        return rows

    def _put(self, each: _Stored, start: int, rows: np.ndarray, samples: slice) -> None:
        """Puts some samples of a stored piece into rows from `start` on."""
        first, last = max(start, each.start), min(start + len(rows), each.stop)
        inside = rows[first - start : last - start, each.antenna]
        # Whole blocks of chirps, counted from the piece's first.
        low = each.start + (first - each.start) // PRODUCT_CHIRPS * PRODUCT_CHIRPS
        high = min(each.start - (each.start - last) // PRODUCT_CHIRPS * PRODUCT_CHIRPS, each.stop)
        piece = each.rows(self._file, low, high).at(samples)
        if (low, high) == (first, last):
            piece.put(inside)
        else:
            block = np.zeros((high - low, rows.shape[2]), DTYPE)
            block[first - low : last - low] = inside
            piece.put(block)
            inside[:] = block[first - low : last - low]

    @classmethod
    def sum_of(cls, each: Sequence[ProductRows]) -> ProductRows:
        """Rows that are the sums of those of cubes of one shape."""
        found = cls(each[0].shape)
        for rows in each:
            moved = found._file.size
            for block in rows._file.blocks():
                found._file.add(np.frombuffer(block, np.uint8))
            for layer in rows._layers:
                found.begin()
                for stored in layer.within(0, found.shape[0]):
                    found._layers[-1].add(replace(stored, offset=stored.offset + moved))
        found.end()
        return found

    def arrays(self) -> dict[str, np.ndarray]:
        """All that it takes to make the rows again (`from_arrays`), as plain arrays for a file."""
        every = [(number, each) for number, layer in enumerate(self._layers) for each in layer.within(0, self.shape[0])]
        matrices: dict[bytes, tuple[int, Piece]] = {}
        table = []
        for number, each in every:
            piece, matrix = each.piece, -1
            if piece.weights is not None:
                key = piece.weights.tobytes() + piece.x.tobytes()
                matrix, _ = matrices.setdefault(key, (len(matrices), piece))
            phases = 0 if piece.phase is None else len(piece.phase)
            row = number, each.start, each.stop, each.antenna, each.offset, piece.coefficients.shape[1], matrix
            table.append([*row, len(piece.theta), phases])
        found = {
            "shape": np.array(self.shape), "layers": np.array(len(self._layers)),
            "table": np.array(table, np.int64).reshape(-1, 9), "band": np.array([each.piece.band for _, each in every]),
            "theta": np.concatenate([np.zeros(0), *(each.piece.theta for _, each in every)]),
            "phase": np.concatenate([np.zeros(0, DTYPE), *(each.piece.phase for _, each in every if each.piece.phase is not None)]),
            "coefficients": self._file.read(0, (self._file.size // DTYPE.itemsize,)),
        }  # fmt: skip
        for matrix, piece in matrices.values():
            assert piece.weights is not None  # such pieces have no matrix
            found |= {f"weights{matrix}": piece.weights, f"x{matrix}": piece.x}
        return found

    @classmethod
    def from_arrays(cls, given: Mapping[str, np.ndarray]) -> ProductRows:
        """The rows that `arrays` described."""
        arrays = {name: given[name] for name in given}
        found = cls(tuple(arrays["shape"].tolist()))
        found._file.add(arrays["coefficients"])
        found._layers = [_Layer() for _ in range(int(arrays["layers"]))]
        buckets, phases = 0, 0
        for row, band in zip(arrays["table"].tolist(), arrays["band"].tolist(), strict=True):
            layer, start, stop, antenna, offset, width, matrix, count, many = row
            theta, phase = arrays["theta"][buckets : buckets + count], arrays["phase"][phases : phases + many]
            buckets, phases = buckets + count, phases + many
            weights, x = (None, np.zeros(0)) if matrix < 0 else (arrays[f"weights{matrix}"], arrays[f"x{matrix}"])
            piece = Piece(np.empty((0, width), DTYPE), theta, weights, x, phase if many else None, band)
            found._layers[layer].add(_Stored(start, stop, antenna, offset, piece))
        found.end()
        return found


@dataclass(frozen=True, slots=True)
class _Stored:
    """A piece on disk."""

    start: int
    """Its first row of the cube, and the one after its last."""
    stop: int
    antenna: int
    offset: int
    """Of its coefficients in the file [byte]."""
    piece: Piece
    """With no rows of coefficients, but of their width."""

    def rows(self, file: ScratchFile, first: int, last: int) -> Piece:
        """Some rows of it."""
        width, skipped = self.piece.coefficients.shape[1], first - self.start
        found = file.read(self.offset + skipped * width * DTYPE.itemsize, (last - first, width))
        phase = self.piece.phase
        return replace(
            self.piece, coefficients=found, phase=None if phase is None else phase[skipped : last - self.start]
        )


class _Layer:
    """Pieces in the order in which they were added: by windows of rows that follow one another, antenna by antenna in each."""

    def __init__(self) -> None:
        self._pieces: list[_Stored] = []
        self._bounds: np.ndarray | None = None
        """First rows of the pieces and the ones after their last, (2, piece), once they are asked for."""

    def add(self, piece: _Stored) -> None:
        self._pieces.append(piece)
        self._bounds = None

    def within(self, start: int, stop: int) -> Iterator[_Stored]:
        """Pieces that hold any of rows start..stop."""
        if self._bounds is None:
            self._bounds = np.array([(each.start, each.stop) for each in self._pieces]).reshape(-1, 2).T
        first, last = self._bounds
        return (self._pieces[k] for k in np.flatnonzero((first < stop) & (last > start)).tolist())
