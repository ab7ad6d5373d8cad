"""The last step of the sum of echoes: samples = coefficients of each chirp times functions over the sweep; and cubes that store
these factors.

For a large cube the coefficients are stored instead of the samples: for a body before an antenna array they take a tenth of the
space.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from threading import Lock
from typing import Any

import numpy as np

from t2d_rt.core.backend import one_blas_thread
from t2d_rt.core.cube_storage import DTYPE, ScratchFile
from t2d_rt.core.errors import InputError

PIECE_CHIRPS = 512
"""Number of chirps in a piece: few enough that buckets which the target has left or not yet reached can be left out."""
PRODUCT_CHIRPS = 128
"""Number of chirps that are multiplied at once. Pieces are always multiplied in the same blocks, for the same bits."""
BASIS_NUMBERS = 8_000_000
"""Greatest size of the matrix; a very wide sweep is processed in pieces of its samples."""
LEFT_OUT = 1e-7
"""Functions of the sample that are weaker than the strongest by this factor are left out when their number is reduced."""
_alone = Lock()
"""Lock for the number of BLAS threads, which is a setting of the whole process."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Some chirps of one antenna: coefficients (chirp, bucket x Q) times, for each bucket, its carrier over the sweep times
    weights."""

    coefficients: np.ndarray
    """Coefficients, complex64; the samples themselves where there are no `weights`."""
    theta: np.ndarray
    """Carrier of each bucket: its phase per unit of x, (bucket,)."""
    weights: np.ndarray | None
    """Function of the sample that belongs to each of the Q nodes, (Q, sample). None for plain samples."""
    x: np.ndarray
    """Positions of the samples in the sweep, -1..1, (sample,)."""
    phase: np.ndarray | None
    """Phase factor of each chirp, (chirp,); samples with a phase are added to what is there, without (None) they replace it."""
    band: float
    """Greatest |theta - theta of the bucket| of any echo in it [rad]."""

    @classmethod
    def of_samples(cls, samples: np.ndarray, phase: np.ndarray | None = None) -> Piece:
        """A piece of plain samples (chirp, sample), whose beat frequencies are not known."""
        return cls(samples, np.zeros(1), None, np.zeros(0), phase, np.inf)

    def as_samples(self) -> Piece:
        """The same piece as plain samples; how far apart its beat frequencies are is kept."""
        low, high = float(self.theta.min()) - self.band, float(self.theta.max()) + self.band
        middle = np.array([(low + high) / 2])
        return Piece(self.samples(), middle, None, np.zeros(0), self.phase, (high - low) / 2)

    def at(self, samples: slice) -> Piece:
        """The piece at some of the samples."""
        if self.weights is None:
            return replace(self, coefficients=self.coefficients[:, samples])
        return replace(self, weights=self.weights[:, samples], x=self.x[samples])

    def put(self, out: np.ndarray) -> None:
        """Writes the samples to `out` (chirp, sample), or adds them to it where there is a phase."""
        if self.phase is not None:
            out += self.samples() * self.phase[:, None]
        elif self.weights is None:
            out[:] = self.coefficients
        else:
            self._multiply(out)

    def samples(self) -> np.ndarray:
        """Samples before the phase is applied, complex64 (chirp, sample)."""
        if self.weights is None:
            return self.coefficients
        out = np.empty((len(self.coefficients), len(self.x)), DTYPE)
        self._multiply(out)
        return out

    def through(self, matrix: np.ndarray) -> np.ndarray:
        """Samples, with the phase, times a matrix (sample, cell), complex64 (chirp, cell); the matrix is first applied to the
        functions of the sample, which are few."""
        functions = matrix if self.weights is None else _functions(self)[1].astype(DTYPE) @ matrix
        cells = self.coefficients @ functions
        return cells if self.phase is None else (cells * self.phase[:, None]).astype(DTYPE)

    def _multiply(self, out: np.ndarray) -> None:
        assert self.weights is not None
        size = max(1, BASIS_NUMBERS // max(1, len(self.theta) * len(self.weights)))
        for first in range(0, len(self.x), size):
            samples = slice(first, first + size)
            carriers = np.exp(1j * np.outer(self.theta, self.x[samples]))
            basis = (carriers[:, None] * self.weights[:, samples]).astype(DTYPE)
            basis = basis.reshape(-1, basis.shape[2])
            for start in range(0, len(out), PRODUCT_CHIRPS):
                chirps = slice(start, start + PRODUCT_CHIRPS)
                np.matmul(self.coefficients[chirps], basis, out=out[chirps, samples])


@dataclass(frozen=True, slots=True)
class Product:
    """Sums of buckets at each chirp of one antenna, as coefficients at the nodes of the sweep."""

    coefficients: np.ndarray
    """Coefficients, complex64 (chirp, bucket, Q)."""
    weights: np.ndarray
    """Function of the sample that belongs to each of the Q nodes, (Q, sample)."""
    theta: np.ndarray
    """Carrier of each bucket: its phase per unit of x, (bucket,)."""
    x: np.ndarray
    """Positions of the samples in the sweep, -1..1, (sample,)."""
    band: float
    """Greatest |theta - theta of the bucket| of any echo in a bucket [rad]."""
    phase: np.ndarray | None = None
    """Phase factor of each chirp, (chirp,); samples with a phase are added to what is there, without (None) they replace it."""

    def pieces(self) -> Iterator[tuple[slice, Piece]]:
        """Pieces of `PIECE_CHIRPS` chirps, each with the buckets that are not empty there."""
        for start in range(0, len(self.coefficients), PIECE_CHIRPS):
            chirps = slice(start, min(start + PIECE_CHIRPS, len(self.coefficients)))
            part = self.coefficients[chirps]
            numbers = part.view(np.uint64)  # compared as integers, which is six times as fast
            used = numbers[0].any(axis=1)  # most of the buckets that are not empty are so at the first chirp
            if not used.all():
                used[~used] = numbers[:, ~used].any(axis=(0, 2))
            phase = None if self.phase is None else self.phase[chirps]
            coefficients = (part if used.all() else part[:, used]).reshape(len(part), -1)
            yield chirps, Piece(coefficients, self.theta[used], self.weights, self.x, phase, self.band)


def together(pieces: Sequence[Piece]) -> Piece:
    """The sum of pieces of the same chirps and weights; buckets with the same carrier are merged."""
    if len(pieces) == 1:
        return pieces[0]
    first = pieces[0]
    assert first.weights is not None, "samples have no buckets"
    theta, place = np.unique(np.concatenate([piece.theta for piece in pieces]), return_inverse=True)
    shape = len(first.coefficients), len(theta), len(first.weights)
    total = np.zeros(shape, DTYPE)
    ends = np.cumsum([len(piece.theta) for piece in pieces])
    for piece, buckets in zip(pieces, np.split(place, ends[:-1]), strict=True):
        if len(buckets):
            # The buckets of a part are mostly contiguous: a slice takes a third of the time.
            side_by_side = buckets[-1] - buckets[0] == len(buckets) - 1 and bool(np.all(np.diff(buckets) > 0))
            where: Any = slice(buckets[0], buckets[-1] + 1) if side_by_side else buckets
            total[:, where] += piece.coefficients.reshape(shape[0], len(buckets), shape[2])
    return replace(first, coefficients=total.reshape(shape[0], -1), theta=theta)


class ProductRows:
    """Rows (antenna, sample) of a cube, as pieces whose coefficients are stored in a temporary file.

    They are added in layers, each of which is a sum of echoes over the whole record; a row is the sum of its layers.
    """

    def __init__(self, shape: tuple[int, ...], file: ScratchFile | None = None) -> None:
        """`file` is a file that other rows use as well, because a process may open only a limited number of files."""
        self.shape = shape
        self._file = file or ScratchFile()
        self._shared = file is not None
        self._layers: list[_Layer] = []
        self._whole = False

    def begin(self) -> None:
        """Begins a layer, to which pieces are then added."""
        self._layers.append(_Layer())
        self._whole = False

    def end(self) -> None:
        """Ends the layer."""
        self._whole = True

    def __getstate__(self) -> dict[str, Any]:
        return (self.sum_of([self]) if self._shared else self).__dict__  # without the rows of others

    def add(self, row: int, antenna: int, piece: Piece) -> None:
        """Adds a piece to the current layer, from a row on."""
        many = piece.coefficients.shape[1] > self.shape[2]
        self._append(row, antenna, piece.as_samples() if many else piece)

    def add_samples(self, row: int, samples: np.ndarray) -> None:
        """Adds samples (row, antenna, sample) to the current layer, from a row on; zeros are not stored."""
        for first in range(0, len(samples), PIECE_CHIRPS):
            for antenna, chirp_samples in enumerate(samples[first : first + PIECE_CHIRPS].swapaxes(0, 1)):
                if chirp_samples.any():
                    self._append(row + first, antenna, Piece.of_samples(chirp_samples))

    def _append(self, row: int, antenna: int, piece: Piece) -> None:
        offset = self._file.add(piece.coefficients)
        rows, width = piece.coefficients.shape
        none = np.empty((0, width), DTYPE)
        stored = Piece(none, piece.theta, piece.weights, piece.x, piece.phase, piece.band)  # `replace` is slow
        self._layers[-1].add(_Stored(row, row + rows, antenna, offset, stored))

    def spread(self, start: int, stop: int) -> float:
        """Greatest difference of the phases per unit of x of any echoes in rows start..stop."""
        low, high = self.phases(start, stop)
        return high - low

    def phases(self, start: int, stop: int) -> tuple[float, float]:
        """Least and greatest phase per unit of x of any echo in rows start..stop; zeros where there is none."""
        pieces = (stored.piece for layer in self._layers for stored in layer.within(start, stop))
        nonempty = [piece for piece in pieces if len(piece.theta)]
        low = min((float(piece.theta.min()) - piece.band for piece in nonempty), default=0.0)
        return low, max((float(piece.theta.max()) + piece.band for piece in nonempty), default=0.0)

    def read(self, start: int, stop: int, every: int = 1) -> np.ndarray:
        """Rows start..stop at every `every`-th sample, complex64 (row, antenna, sample); the bits do not depend on which rows are
        read together."""
        if not self._whole:
            raise InputError("the ADC samples were not summed to their end; simulate again")
        samples = slice(None, None, every)
        rows: np.ndarray | None = None
        with _alone, one_blas_thread:
            for layer in self._layers:
                layer_rows = np.zeros((stop - start, self.shape[1], len(range(0, self.shape[2], every))), DTYPE)
                for stored in layer.within(start, stop):
                    self._put(stored, start, layer_rows, samples)
                rows = layer_rows if rows is None else rows + layer_rows
        assert rows is not None, "a whole sum has a layer"
        return rows

    def through(self, matrix: np.ndarray, start: int, stop: int) -> np.ndarray:
        """Rows start..stop times a matrix (sample, cell), complex64 (row, antenna, cell), without computing the samples."""
        cells = np.zeros((stop - start, self.shape[1], matrix.shape[1]), DTYPE)
        for layer in self._layers:
            for stored in layer.within(start, stop):
                first, last = max(start, stored.start), min(stop, stored.stop)
                cells[first - start : last - start, stored.antenna] += stored.rows(self._file, first, last).through(
                    matrix
                )
        return cells

    def mixed(self, matrix: np.ndarray, start: int, every: int = 1) -> np.ndarray:
        """Product of a matrix (mixture, row) with the rows from `start` on, at every `every`-th sample, complex64 (mixture,
        antenna, sample).

        The matrix is applied to the coefficients, which are fewer than the samples: short-time spectra take half the time of
        computing rows and their FFT. The bits depend on how BLAS is called.
        """
        mixtures = np.zeros((len(matrix), self.shape[1], len(range(0, self.shape[2], every))), DTYPE)
        for layer in self._layers:
            for stored in layer.within(start, start + matrix.shape[1]):
                first, last = max(start, stored.start), min(start + matrix.shape[1], stored.stop)
                piece = stored.rows(self._file, first, last).at(slice(None, None, every))
                weights = matrix[:, first - start : last - start]
                with_phase = weights if piece.phase is None else (weights * piece.phase).astype(DTYPE)
                mixtures[:, stored.antenna] += replace(
                    piece, coefficients=with_phase @ piece.coefficients, phase=None
                ).samples()
        return mixtures

    def column_sums(self) -> np.ndarray:
        """Sum of all rows, complex128 (antenna, sample); coefficients with the same carriers are added first."""
        sums = np.zeros(self.shape[1:], np.complex128)
        summed: dict[tuple[int, bytes], tuple[Piece, dict[float, np.ndarray]]] = {}
        for layer in self._layers:
            for stored in layer.within(0, self.shape[0]):
                piece = stored.rows(self._file, stored.start, stored.stop)
                ones = np.ones(len(piece.coefficients), DTYPE) if piece.phase is None else piece.phase.astype(DTYPE)
                total = (ones @ piece.coefficients).astype(np.complex128)
                if piece.weights is None:
                    sums[stored.antenna] += total
                    continue
                if not len(piece.theta):
                    continue
                key = stored.antenna, piece.weights.tobytes() + piece.x.tobytes()
                _, by_theta = summed.setdefault(key, (piece, {}))
                for theta, value in zip(piece.theta.tolist(), total.reshape(len(piece.theta), -1), strict=True):
                    by_theta[theta] = by_theta.get(theta, 0) + value
        for (antenna, _), (piece, by_theta) in summed.items():
            coefficients = np.concatenate(list(by_theta.values()))[None].astype(DTYPE)
            theta = np.array(list(by_theta))
            sums[antenna] += replace(piece, coefficients=coefficients, theta=theta, phase=None).samples()[0]
        return sums

    def _put(self, stored: _Stored, start: int, rows: np.ndarray, samples: slice) -> None:
        """Writes or adds some samples of a stored piece to rows from `start` on."""
        first, last = max(start, stored.start), min(start + len(rows), stored.stop)
        inside = rows[first - start : last - start, stored.antenna]
        # whole blocks of chirps, counted from the first chirp of the piece
        low = stored.start + (first - stored.start) // PRODUCT_CHIRPS * PRODUCT_CHIRPS
        high = min(stored.start - (stored.start - last) // PRODUCT_CHIRPS * PRODUCT_CHIRPS, stored.stop)
        piece = stored.rows(self._file, low, high).at(samples)
        if (low, high) == (first, last):
            piece.put(inside)
        else:
            block = np.zeros((high - low, rows.shape[2]), DTYPE)
            block[first - low : last - low] = inside
            piece.put(block)
            inside[:] = block[first - low : last - low]

    def in_one_basis(self, start: int, stop: int) -> tuple[np.ndarray, Piece]:
        """Rows start..stop as coefficients, complex64 (row, antenna, K), of K common functions of the sample, and these functions
        as a piece without rows. K is small where the beat frequencies are close together; else all samples are used."""
        stored_pieces = [
            stored for layer in self._layers for stored in layer.within(start, stop) if len(stored.piece.theta)
        ]
        all_samples = Piece.of_samples(np.empty((0, self.shape[2]), DTYPE))
        if not stored_pieces or any(stored.piece.weights is None for stored in stored_pieces):
            return self.read(start, stop), all_samples
        basis = _orthonormal(list(dict(_functions(stored.piece) for stored in stored_pieces).values()))
        if len(basis) > self.shape[2] // 2:
            return self.read(start, stop), all_samples
        rows = np.zeros((stop - start, self.shape[1], len(basis)), DTYPE)
        for stored in stored_pieces:
            first, last = max(start, stored.start), min(stop, stored.stop)
            onto = (_functions(stored.piece)[1] @ basis.conj().T).astype(DTYPE)
            rows[first - start : last - start, stored.antenna] += (
                stored.rows(self._file, first, last).coefficients @ onto
            )
        low = min(float(stored.piece.theta.min()) - stored.piece.band for stored in stored_pieces)
        high = max(float(stored.piece.theta.max()) + stored.piece.band for stored in stored_pieces)
        x, middle = stored_pieces[0].piece.x, (low + high) / 2
        weights = basis * np.exp(-1j * middle * x)
        return rows, Piece(np.empty((0, len(basis)), DTYPE), np.array([middle]), weights, x, None, (high - low) / 2)

    @classmethod
    def sum_of(cls, summands: Sequence[ProductRows], file: ScratchFile | None = None) -> ProductRows:
        """Sum, row by row, of cubes of the same shape, in a new file or the one given."""
        total = cls(summands[0].shape, file)
        for rows in summands:
            for layer in rows._layers:
                total.begin()
                for stored in layer.within(0, total.shape[0]):
                    total._append(stored.start, stored.antenna, stored.rows(rows._file, stored.start, stored.stop))
        total._whole = all(rows._whole for rows in summands)
        return total

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything from which `from_arrays` can restore the rows, as plain arrays for a file."""
        numbered_pieces = [
            (number, stored) for number, layer in enumerate(self._layers) for stored in layer.within(0, self.shape[0])
        ]
        matrices: dict[bytes, tuple[int, Piece]] = {}
        table, numbers = [], np.empty(sum(stored.numbers for _, stored in numbered_pieces), DTYPE)
        written = 0
        for number, stored in numbered_pieces:
            piece, matrix = stored.piece, -1
            if piece.weights is not None:
                key = piece.weights.tobytes() + piece.x.tobytes()
                matrix, _ = matrices.setdefault(key, (len(matrices), piece))
            phases = 0 if piece.phase is None else len(piece.phase)
            row = (
                number,
                stored.start,
                stored.stop,
                stored.antenna,
                written * DTYPE.itemsize,
                piece.coefficients.shape[1],
                matrix,
            )
            table.append([*row, len(piece.theta), phases])
            numbers[written : written + stored.numbers] = stored.rows(
                self._file, stored.start, stored.stop
            ).coefficients.ravel()
            written += stored.numbers
        pieces = [stored.piece for _, stored in numbered_pieces]
        description = {
            "shape": np.array(self.shape), "layers": np.array(len(self._layers)),
            "table": np.array(table, np.int64).reshape(-1, 9), "band": np.array([piece.band for piece in pieces]),
            "theta": np.concatenate([np.zeros(0), *(piece.theta for piece in pieces)]),
            "phase": np.concatenate([np.zeros(0, DTYPE), *(piece.phase for piece in pieces if piece.phase is not None)]),
            "coefficients": numbers,
        }  # fmt: skip
        for matrix, piece in matrices.values():
            assert piece.weights is not None  # such pieces have no matrix
            description |= {f"weights{matrix}": piece.weights, f"x{matrix}": piece.x}
        return description

    @classmethod
    def from_arrays(cls, description: Mapping[str, np.ndarray], file: ScratchFile | None = None) -> ProductRows:
        """The rows that `arrays` described, in a new file or the one given."""
        arrays = {name: description[name] for name in description}
        rows = cls(tuple(arrays["shape"].tolist()), file)
        before = rows._file.add(arrays["coefficients"])
        rows._layers = [_Layer() for _ in range(int(arrays["layers"]))]
        buckets, phases = 0, 0
        for row, band in zip(arrays["table"].tolist(), arrays["band"].tolist(), strict=True):
            layer, start, stop, antenna, offset, width, matrix, count, many = row
            theta, phase = arrays["theta"][buckets : buckets + count], arrays["phase"][phases : phases + many]
            buckets, phases = buckets + count, phases + many
            weights, x = (None, np.zeros(0)) if matrix < 0 else (arrays[f"weights{matrix}"], arrays[f"x{matrix}"])
            piece = Piece(np.empty((0, width), DTYPE), theta, weights, x, phase if many else None, band)
            rows._layers[layer].add(_Stored(start, stop, antenna, before + offset, piece))
        rows.end()
        return rows


@dataclass(frozen=True, slots=True)
class _Stored:
    """A piece whose coefficients are on disk."""

    start: int
    """First row of the piece in the cube; `stop` is the one after its last row."""
    stop: int
    antenna: int
    offset: int
    """Offset of its coefficients in the file [bytes]."""
    piece: Piece
    """The piece with an empty array of coefficients (0, width) in place of the stored ones."""

    @property
    def numbers(self) -> int:
        """Number of its coefficients."""
        return (self.stop - self.start) * self.piece.coefficients.shape[1]

    def rows(self, file: ScratchFile, first: int, last: int) -> Piece:
        """The piece with some of its rows, read from the file."""
        width, skipped = self.piece.coefficients.shape[1], first - self.start
        coefficients = file.read(self.offset + skipped * width * DTYPE.itemsize, (last - first, width))
        phase = self.piece.phase
        return replace(
            self.piece, coefficients=coefficients, phase=None if phase is None else phase[skipped : last - self.start]
        )


def _functions(piece: Piece) -> tuple[bytes, np.ndarray]:
    """The functions of the sample, complex (bucket x Q, sample), to which a piece's coefficients belong, and a key that identifies
    them."""
    assert piece.weights is not None, "samples are no sum"
    carriers = np.exp(1j * np.outer(piece.theta, piece.x))
    key = piece.theta.tobytes() + piece.weights.tobytes()
    return key, (carriers[:, None] * piece.weights).reshape(-1, len(piece.x))


def _orthonormal(functions: Sequence[np.ndarray]) -> np.ndarray:
    """An orthonormal basis (K, sample) of given functions (several, sample)."""
    scaled, basis = functions[0][:0], functions[0][:0]
    for function in functions:
        _, values, basis = np.linalg.svd(np.concatenate([scaled, function]), full_matrices=False)
        basis = basis[values > LEFT_OUT * values[0]]
        scaled = values[: len(basis), None] * basis
    return basis


class _Layer:
    """Pieces in the order in which they were added: one window of rows after the other, antenna by antenna in each."""

    def __init__(self) -> None:
        self._pieces: list[_Stored] = []
        self._bounds: np.ndarray | None = None
        """First rows of the pieces and the rows after their last, (2, piece); computed when first needed."""

    def add(self, piece: _Stored) -> None:
        self._pieces.append(piece)
        self._bounds = None

    def within(self, start: int, stop: int) -> Iterator[_Stored]:
        """Pieces that overlap rows start..stop."""
        if self._bounds is None:
            self._bounds = np.array([(piece.start, piece.stop) for piece in self._pieces]).reshape(-1, 2).T
        first, last = self._bounds
        return (self._pieces[k] for k in np.flatnonzero((first < stop) & (last > start)).tolist())
