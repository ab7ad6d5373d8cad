"""From echoes to the ADC cube: the only code that knows chirps.

Relative to mid-sweep, with x in -1..1 over the sweep, the phase of an echo is (docs/physics.md, eq. 16)

    psi + theta x + eps x^2,   psi = 2 pi (f_m tau - S tau^2/2),  theta = pi B (tau + f_m tau'/S),  eps = 2 pi (T/2)^2 S tau'

theta is the beat with its range-Doppler coupling. Many echoes are first merged, level by level, into a few groups (`multilevel`).
The remaining echoes or groups are sorted by theta into buckets of fixed delay and summed at every chirp, at a few nodes of the
sweep; a small matrix product per chirp then gives the samples (`products`).
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from t2d_rt.core import checks
from t2d_rt.core.backend import Backend, aligned_empty, one_blas_thread, prefetched, select
from t2d_rt.core.cubes import Cube, CubeAdder, CubeWriter, DiskCube, is_large
from t2d_rt.core.factored_cubes import PIECE_CHIRPS, Piece, Product, ProductRows, together
from t2d_rt.core.memory import MemoryLimit, reused
from t2d_rt.radar.array_delays import array_delays, ends
from t2d_rt.radar.coefficients import AmplitudeFrames, fields_at, phases
from t2d_rt.radar.delay_bins import SLOT_BINS, Buckets, buckets
from t2d_rt.radar.groups import GroupLevel, bucket_bins, bucket_theta, by_part, levels
from t2d_rt.radar.multilevel import Factors, at_antennas, at_instants, factors, leaves
from t2d_rt.radar.prolate import band_nodes, band_weights
from t2d_rt.radar.sweep import Instants, Sweep
from t2d_rt.radar.windows import Delay, Window, Windows, block_end, filtered
from t2d_rt.types import EchoArrays, Echoes, Radar, stream
from t2d_rt.types.scatterer import EchoParts, Scatterer

FEW_ECHOES, WIDE_BUCKET_BINS, BUCKET_BINS = 500, 9.0, 0.5
"""Up to FEW_ECHOES echoes are summed in wide buckets, and more echoes in narrow ones [range bins]: wide buckets need more nodes,
thus more work for each echo, but there are fewer buckets to make samples of."""
ECHO_ERROR = 3e-6
"""Relative error of the interpolation nodes of these buckets: that of float32."""
BUCKET_FRACTION = 0.25
"""Fraction of the tolerance that is allowed for the nodes of a bucket. Their error changes as a target passes from bucket to
bucket, which makes lines in its Doppler spectrum: for a moving sphere at -101 dBc, and at -80 dBc if the whole tolerance were
allowed."""
RECEIVERS, MOST_SUMS = 4, 400
"""Number of receivers computed at once; and greatest number of sums in one lane of the kernel over echoes, which limits how many
transmitters are computed with them."""
MOST_INSTANTS, FEWER_INSTANTS, MANY_ECHOES = 20_000, 2_500, 50_000
"""Greatest number of chirps of a window for which buckets are summed at once, as chirps may come far faster than surface frames;
and the lower number for windows of more than MANY_ECHOES echoes, which take memory themselves."""
WAITING_BYTES, FIELDS_BYTES = 128e6, 64e6
"""Greatest size of the coefficients that wait to become samples, and of those of parts that are summed at once [bytes]; there may
be hundreds of parts."""
USUAL_NODES = 24
"""Usual number of nodes of a bucket at each chirp, for estimates of memory."""

Progress = Callable[[float], None]


def synthesize(
    echoes: Echoes | Scatterer,
    radar: Radar,
    *,
    tolerance_db: float = -50.0,
    device: str = "auto",
    read_frames: int | None = None,
    onto: Cube | None = None,
    memory: MemoryLimit | None = None,
    progress: Progress | None = None,
    parts: EchoParts | None = None,
) -> Cube:
    """ADC cube (chirp, antenna, sample) complex64 [sqrt(W)] of all chirps that lie within the echoes' record.

    A large one is a `DiskCube`: its products are on disk, and samples are computed from them when they are read.

    Motion within a chirp is included; echoes from beyond the range axis are not (`windows.filtered`). The cube differs from the
    direct sum of the same echoes (`direct.direct_sum`) by at most `tolerance_db` of NMSE.

    read_frames: about how many frames of echoes are held at once; by default as many as fit a fixed amount of memory. It does not
        change the result.
    onto: a cube of the same shape, to which the samples are added and which is returned.
    memory: the limit of memory; unused memory is given back between windows.
    progress: called with the fraction done, 0..1.
    parts: to which part of the recording each echo belongs, or that it is left out.
    """
    checks.instance("radar", radar, Radar, "a Radar", hint="Radar.preset('table2') makes one")
    assert getattr(echoes, "repeats", None) is None, "echoes that repeat are summed by add_repeated"
    checks.number("tolerance_db", tolerance_db, -90, -10, unit="dB", hint="-50 suits most uses")
    if read_frames is not None:
        checks.integer("read_frames", read_frames, 1)
    if progress is not None:
        checks.call("progress", progress, "a function of the fraction done")
    source = stream(echoes)
    memory = MemoryLimit.of() if memory is None else checks.instance("memory", memory, MemoryLimit, "a MemoryLimit")
    with Synthesis(
        source.times_s,
        radar,
        tolerance_db=tolerance_db,
        device=device,
        onto=onto,
        memory=memory,
        progress=progress,
        parts=parts,
    ) as synthesis:
        for first, arrays in prefetched(_read(source, read_frames)):
            synthesis.add(first, arrays)
    return synthesis.cube


def _read(source: Scatterer, read_frames: int | None) -> Iterator[tuple[int, EchoArrays]]:
    """All echoes of a scatterer in order, block by block, each with the index of its first frame."""
    first, frames, echoes = 0, len(source.times_s), source.echoes
    while first < frames:
        last = block_end(
            first, frames, echoes=echoes, vertices=source.vertices, at_once=source.at_once, read_frames=read_frames
        )
        arrays = EchoArrays(*source.frames(first, last))
        yield first, arrays
        first, echoes = last, arrays.delay_s.shape[1]


class Synthesis:
    """Sums blocks of echoes, which must come in order, to an ADC cube. A context manager: the cube is complete when it is left."""

    def __init__(
        self,
        times_s: np.ndarray,
        radar: Radar,
        *,
        tolerance_db: float,
        device: str,
        memory: MemoryLimit,
        onto: Cube | None = None,
        progress: Progress | None = None,
        parts: EchoParts | None = None,
    ) -> None:
        """Arguments as in `synthesize`, for echoes at surface frames `times_s` [s] (T,)."""
        self._radar, self._memory, self._progress = radar, memory, progress
        self._sweep, self._tolerance, self._backend = Sweep.of(radar), 10 ** (tolerance_db / 20), select(device)
        self._windows = Windows(times_s, None if parts is None else parts.number)
        self._parts = 1 if parts is None else parts.count
        self._of_parts = [_Products(rows) for rows in (parts.rows if parts else ())]
        starts_s = radar.chirp_times_s(float(times_s[-1] - times_s[0]))
        self._mid_times_s, self._last = starts_s + radar.mid_time_s, len(times_s) - 1
        shape = len(starts_s), radar.antennas, radar.samples
        if onto is not None:
            checks.instance("onto", onto, (np.ndarray, DiskCube), "an ADC cube")
            checks.check_shape("onto", onto, shape)
        self.cube = _new_cube(shape, memory) if onto is None else onto
        self._filler = _filler(self.cube, onto, radar)
        self._pool, self._done = ThreadPoolExecutor(1), 0
        self._jobs: deque[tuple[Future[None], int]] = deque()
        """Tasks of the second thread in order, each of which makes samples of coefficients, and the size of these [bytes]."""

    def __enter__(self) -> Synthesis:
        with ExitStack() as opened:
            opened.enter_context(one_blas_thread)
            for sink in (self._filler, *self._of_parts):
                opened.enter_context(sink)
            opened.callback(self._pool.shutdown)
            opened.push(self._finish)
            self._open = opened.pop_all()
        return self

    def add(self, first: int, echoes: EchoArrays) -> None:
        """Adds the echoes at frames from `first` on; blocks must follow one another."""
        for window in self._windows.add(first, filtered(echoes, self._radar)):
            self._sum(window)
            del window  # so that its memory can be given back
            self._memory.release()

    def _sum(self, window: Window) -> None:
        """Computes the rows of the cube whose chirps lie in a window."""
        first, last = np.searchsorted(self._mid_times_s, np.array([window.start, window.stop]) * window.step_s).tolist()
        if window.stop == self._last:
            last = len(self._mid_times_s)
        if first == last:
            return
        if first != self._done:
            raise RuntimeError(f"rows {self._done}..{first} of a cube were left out")
        position = self._mid_times_s[first:last] / window.step_s - window.start
        sums = _sums(window, self._radar, position, self._sweep, self._tolerance, self._parts, self._backend)
        # Samples are made in another thread: with the first sums of a window most of its kernels are done.
        head = list(itertools.islice(sums, 1))
        self._wait()
        for sink in (self._filler, *self._of_parts):
            sink.next(last - first)
        for antenna, chirps, products in _products(itertools.chain(head, sums), self._radar, slice(first, last)):
            while sum(size for _, size in self._jobs) > WAITING_BYTES:
                self._jobs.popleft()[0].result()
            size = sum(product.coefficients.nbytes for product in products)
            self._jobs.append((self._pool.submit(self._put, antenna, chirps, products), size))
        self._done = last
        if self._progress is not None:
            self._progress(last / len(self._mid_times_s))

    def _put(self, antenna: int, chirps: slice, products: Sequence[Product]) -> None:
        """Hands the sums of some chirps of the next rows to the fillers: those of each part to the part's own, and all together to
        the cube's."""
        for of_products in zip(*(product.pieces() for product in products), strict=True):
            pieces = [piece for _, piece in of_products]
            row = chirps.start + of_products[0][0].start
            for part, piece in zip(self._of_parts, pieces, strict=False):
                part.put(antenna, row, piece)
            self._filler.put(antenna, row, together(pieces))

    def _wait(self) -> None:
        while self._jobs:
            self._jobs.popleft()[0].result()

    def _finish(self, kind: Any, *_: Any) -> None:
        """Completes the cube after the last block: waits for all samples and checks that all rows have come; an error here also
        closes the filler as failed."""
        if kind is None:
            self._wait()
            if self._done != len(self._mid_times_s):
                raise RuntimeError(f"rows {self._done}..{len(self._mid_times_s)} of a cube were left out")

    def __exit__(self, *failed: Any) -> None:
        self._open.__exit__(*failed)


def _new_cube(shape: tuple[int, int, int], memory: MemoryLimit) -> Cube:
    """A cube without initial values: every row must be written."""
    if is_large(shape, memory.limit_bytes):
        return DiskCube(ProductRows(shape))
    return aligned_empty(math.prod(shape), np.complex64, reused).reshape(shape)


def _filler(cube: Cube, onto: Cube | None, radar: Radar) -> _Samples | _Products:
    """The filler of a new cube, or one that adds to the cube `onto`."""
    if isinstance(cube, DiskCube) and isinstance(cube.rows, ProductRows):
        return _Products(cube.rows)
    return _Samples(CubeWriter(cube) if onto is None else CubeAdder(cube), zeroed=radar.multiplexing == "ddm")


class _Samples:
    """Fills a cube with samples."""

    def __init__(self, writer: CubeWriter | CubeAdder, *, zeroed: bool) -> None:
        self._writer, self._zeroed = writer, zeroed
        self._out = np.empty((0, 0, 0), np.complex64)

    def __enter__(self) -> _Samples:
        self._writer.__enter__()
        return self

    def __exit__(self, *failed: Any) -> None:
        self._writer.__exit__(*failed)

    def next(self, rows: int) -> None:
        """Goes on to the next rows; all pieces of the rows before must have been put."""
        self._out = self._writer.room(rows)
        if self._zeroed:
            self._out[:] = 0

    def put(self, antenna: int, row: int, piece: Piece) -> None:
        """Adds the samples of a piece to the rows that begin with `row`."""
        piece.put(self._out[row : row + len(piece.coefficients), antenna])


class _Products:
    """Fills a cube with a layer of products, from which samples are computed when they are read."""

    def __init__(self, rows: ProductRows) -> None:
        self._rows, self._first, self._stop = rows, 0, 0

    def __enter__(self) -> _Products:
        self._rows.begin()
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self._rows.end()

    def next(self, rows: int) -> None:
        """Goes on to the next rows."""
        self._first, self._stop = self._stop, self._stop + rows

    def put(self, antenna: int, row: int, piece: Piece) -> None:
        """Stores a piece for the rows that begin with `row`."""
        self._rows.add(self._first + row, antenna, piece)


def _products(sums: Iterator[_Sum], radar: Radar, rows: slice) -> Iterator[tuple[int, slice, list[Product]]]:
    """Results of `_sums` with the index of the cube's antenna and the chirps, counted from the first of the cube's `rows`; with
    "ddm" they get the phase of their transmitter."""
    phase = radar.tx_phase(np.arange(rows.start, rows.stop)).astype(np.complex64)
    for tx, rx, chirps, products in sums:
        if radar.multiplexing == "ddm":
            yield rx, chirps, [replace(product, phase=phase[chirps, tx]) for product in products]
        else:
            yield tx * len(radar.rx_positions_m) + rx, chirps, products


def _sums(
    window: Window,
    radar: Radar,
    position: np.ndarray,
    sweep: Sweep,
    tolerance: float,
    parts: int,
    backend: Backend,
) -> Iterator[_Sum]:
    """What each pair of transmitter and receiver records of the chirps with mid-sweep at `position` [frames after window.start],
    for each of the `parts`; one block of chirps after the other."""
    rate = len(position) / (window.stop - window.start)
    both = ends(window, radar)
    outermost = (end.only(outer).extra_delays() for end, outer in zip(both, np.transpose(radar.outermost), strict=True))
    extremes = [] if window.apparent is None else [_both(*pair) for pair in zip(*outermost, strict=True)]
    tree = levels(window, sweep, rate, tolerance, extremes) if window.delay.size else []
    late = [0.0] * len(radar.tx_positions_m)
    if radar.multiplexing == "tdm":
        late = [tx / radar.prf_hz / window.step_s for tx in range(len(late))]
    instants = [Instants(position + slot, window.step_s, sweep) for slot in late]
    if not tree:
        for (tx, out), (rx, back) in itertools.product(*(enumerate(end.extra_delays()) for end in both)):
            extra, slope = _both(out, back)
            delayed = replace(window, delay=window.delay + extra, delay_slope=window.delay_slope + slope)
            for chirps in _chirp_blocks(len(position), window, parts):
                yield tx, rx, chirps, _sum_echoes(delayed, instants[tx][chirps], parts, backend)
        return
    count, part_of = len(tree[-1]), np.zeros(len(tree[-1]), int)
    if parts > 1:
        assert window.part is not None, "parts are numbered"
        tree, part_of = by_part(tree, np.maximum(window.part, 0), parts)
    echo_leaves = leaves(window, tree[0], sweep, backend)
    send, receive = array_delays(both, [level.mean for level in tree], backend)
    at_once = max(1, MOST_SUMS // (RECEIVERS * 2 * tree[0].nodes * tree[0].rate))
    for tx_batch, rx_batch in itertools.product(_batches(len(send), at_once), _batches(len(receive), RECEIVERS)):
        deep, leaves_here = at_antennas(tree, echo_leaves, send.only(tx_batch), receive.only(rx_batch))
        inner = factors(window, deep, leaves_here, sweep, backend)
        for number, tx in enumerate(tx_batch):
            top = deep[-1].part(number, len(tx_batch))
            groups = _Groups(top, inner, number * len(top), count, len(rx_batch), parts, part_of)
            for chirps in _chirp_blocks(len(position), window, parts * len(rx_batch)):
                all_products = _sum_groups(groups, instants[tx][chirps], tolerance, backend)
                of_rx = (all_products[first : first + parts] for first in range(0, len(all_products), parts))
                yield from ((tx, rx, chirps, products) for rx, products in zip(rx_batch, of_rx, strict=True))


def _chirp_blocks(count: int, window: Window, results: int) -> list[slice]:
    """Slices of a window's chirps that are summed at once, for `results` sums per chirp."""
    size = FEWER_INSTANTS if window.delay.shape[1] > MANY_ECHOES else MOST_INSTANTS
    if window.part is not None:
        fit = int(FIELDS_BYTES / (8 * USUAL_NODES * results)) // PIECE_CHIRPS * PIECE_CHIRPS
        size = min(size, max(PIECE_CHIRPS, fit))
    return [slice(first, first + size) for first in range(0, count, size)]


def _batches(count: int, size: int) -> list[range]:
    return [range(first, min(first + size, count)) for first in range(0, count, size)]


def _both(out: Delay, back: Delay) -> Delay:
    return out[0] + back[0], out[1] + back[1]


_Sum = tuple[int, int, slice, list[Product]]
"""Indices of a transmitter and a receiver, a slice of a window's chirps, and the products that this pair records, one for each
part."""


def _sum_echoes(window: Window, instants: Instants, parts: int, backend: Backend) -> list[Product]:
    """Sums echo by echo at the chirps `instants`: one product for each of the parts."""
    sweep = instants.sweep
    # The time slot of an antenna may come a little after the window's end.
    inside = window.lit[0] > 0
    interval, echo = window.lit[0][inside], window.lit[1][inside]
    recorded = np.clip(np.floor(instants.position).astype(int) + 1, 0, len(window.delay) - 2)
    width = WIDE_BUCKET_BINS if window.delay.shape[1] <= FEW_ECHOES else BUCKET_BINS
    limit = math.pi * (width + min(width, SLOT_BINS)) / 2
    nodes, weights = band_nodes(limit, ECHO_ERROR), band_weights(limit, ECHO_ERROR, sweep.x)
    if not np.isin(recorded, interval).any():
        none = np.zeros((len(instants), 0, len(nodes)), np.complex64)
        return [Product(none, weights, np.zeros(0), sweep.x, 0.0)] * parts
    apart = None if parts == 1 or window.part is None else window.part[echo]
    bucket_set = buckets((window.delay, window.delay_slope), interval, echo, instants, width, apart=apart)
    table = phases(window.delay, window.delay_slope, sweep, None, bucket_set.origin_s, backend)
    fields = fields_at(bucket_set, table, AmplitudeFrames.of(window, sweep, backend), instants, nodes, backend)
    return _apart(fields, bucket_set, parts, (weights, sweep, limit))


@dataclass(frozen=True, slots=True)
class _Groups:
    """Groups of one transmitter with several receivers, and their factors; ordered by receiver."""

    top: GroupLevel
    """The groups of all these receivers."""
    factors: Factors
    first: int
    """Index of the first of these groups among the factors."""
    count: int
    """Number of groups of a receiver before they are divided by part."""
    receivers: int
    parts: int
    part: np.ndarray
    """Index of the part of each group of a receiver."""


def _sum_groups(groups: _Groups, instants: Instants, tolerance: float, backend: Backend) -> list[Product]:
    """Sums group by group at the chirps `instants`: one product for each receiver and part, ordered by receiver."""
    sweep, top = instants.sweep, groups.top
    interval, group = np.indices((len(top.delay) - 2, len(top))).reshape(2, -1)
    receiver, group_number = np.divmod(group, len(top) // groups.receivers)
    bins, apart = bucket_bins(top, groups.count, sweep), receiver * groups.parts + groups.part[group_number]
    bucket_set = buckets((top.delay, top.delay_slope), interval + 1, group, instants, bins, apart=apart)
    table = phases(top.delay, top.delay_slope, sweep, None, bucket_set.origin_s, backend)
    limit, tolerance = bucket_theta(bins, top.bins), BUCKET_FRACTION * tolerance
    nodes = band_nodes(limit, tolerance)
    fields = at_instants(groups.factors, groups.first, top, bucket_set, table, instants, nodes, backend)
    return _apart(
        fields, bucket_set, groups.receivers * groups.parts, (band_weights(limit, tolerance, sweep.x), sweep, limit)
    )


def _apart(fields: np.ndarray, bucket_set: Buckets, parts: int, over: tuple[np.ndarray, Sweep, float]) -> list[Product]:
    """Products of the parts, from flat fields of buckets that hold the parts one after the other, each (chirp, bucket, Q)."""
    (weights, sweep, limit), theta = over, bucket_set.theta(over[1])
    products = []
    for first, last in pairwise(np.searchsorted(bucket_set.part, np.arange(parts + 1)).tolist()):
        of_part = fields[first * len(fields) // len(theta) : last * len(fields) // len(theta)]
        of_part = of_part.reshape(len(fields) // (len(theta) * len(weights)), last - first, len(weights))
        products.append(Product(of_part, weights, theta[first:last], sweep.x, limit))
    return products
