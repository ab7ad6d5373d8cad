"""Echoes to the ADC cube: the only code that knows chirps.

Around mid-sweep, x in -1..1 over the sweep, an echo's phase is (docs/physics.md, eq. 16)

    psi + theta x + eps x^2,   psi = 2 pi (f_m tau - S tau^2/2),  theta = pi B (tau + f_m tau'/S),  eps = 2 pi (T/2)^2 S tau'

theta is the beat with its range-Doppler coupling. Echoes are sorted into buckets of a quarter of a range bin by theta; within a
bucket exp(j (theta - theta_bucket) x) is a Chebyshev series of six terms, 2 j^m J_m T_m(x) (Jacobi-Anger), so that one sine and
cosine per echo and chirp serve the whole sweep; a small matrix product per chirp then gives the samples. One kernel does
the sum: its lanes are (bucket, a few chirps), its loop runs over the bucket's echoes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.backend import Backend, select
from t2d_rt.constants import SPEED_OF_LIGHT
from t2d_rt.errors import InputError
from t2d_rt.radar.interpolants import hermite, spline_slopes
from t2d_rt.types import EchoArrays, Echoes, EchoStream, Radar, stream

BUCKETS_PER_BIN = 4
# A spline's end conditions fade by 0.268 per frame: 1e-7 after 12 frames.
HALO_FRAMES = 12
# Coefficients of one block: echoes x frames x 21 float32, at most 84 MB.
BLOCK_ECHO_FRAMES = 1_000_000
# Over a longer block a walking body spans many buckets.
BLOCK_FRAMES = 64
MOST_SLOTS = 1000
"""Buckets that an echo may cross in a frame interval."""
TERMS = 6
"""Chebyshev orders of the sweep."""
SLOPE_TERMS = 4
"""Those of the amplitude's slope, itself a small part."""

VECTOR = 16
"""Lanes of the widest CPU vectors."""
MAX_UNROLL = 8
"""Chirps that a lane holds in registers."""

Progress = Callable[[float], None]


def synthesize(
    echoes: Echoes | EchoStream,
    radar: Radar,
    *,
    device: str = "auto",
    progress: Progress | None = None,
) -> np.ndarray:
    """ADC cube (chirp, antenna, sample) complex64 [sqrt(W)] of all chirps that lie within the echoes' record.

    Motion within a chirp is included. The direct sum of the same echoes (`direct.direct_sum`) is met within -50 dB NMSE.
    `progress` is called with the share done, 0..1, after every block.
    """
    from threadpoolctl import threadpool_limits

    source = stream(echoes)
    duration_s = float(source.times_s[-1] - source.times_s[0])
    starts = radar.chirp_times_s(duration_s)
    cube = np.zeros((len(starts), 1, radar.samples), np.complex64)
    # Threads of BLAS that wait for its next product would take the kernels' cores.
    with threadpool_limits(1, user_api="blas"):
        for chirps, samples in synthesize_blocks(source, radar, starts, select(device)):
            cube[chirps, 0] = samples
            if progress is not None:
                progress(chirps.stop / len(starts))
    return cube


def synthesize_blocks(
    source: EchoStream, radar: Radar, starts_s: np.ndarray, backend: Backend
) -> Iterator[tuple[slice, np.ndarray]]:
    """Blocks (chirps, samples (len, sample)) in order; only a few frames of echoes are in memory at a time."""
    step = float(source.times_s[-1] - source.times_s[0]) / (len(source.times_s) - 1)
    mid_times = starts_s + radar.mid_time_s
    sweep = _Sweep.of(radar)
    for window in _windows(source):
        first = np.searchsorted(mid_times, window.start * step)
        last = (
            np.searchsorted(mid_times, window.stop * step) if window.stop < len(source.times_s) - 1 else len(mid_times)
        )
        if first < last:
            position = mid_times[first:last] / step - window.start
            yield slice(int(first), int(last)), _block(window, position, step, sweep, backend)


@dataclass(frozen=True, slots=True)
class _Sweep:
    """The figures of a sweep that the sum needs."""

    mid_hz: float
    slope: float
    half_time_s: float
    x: np.ndarray

    @classmethod
    def of(cls, radar: Radar) -> _Sweep:
        half = radar.mid_time_s
        return cls(radar.mid_frequency_hz, radar.slope_hz_per_s, half, radar.sample_times_s / half - 1)

    @property
    def theta_per_s(self) -> float:
        """theta per second of delay."""
        return 2 * math.pi * self.slope * self.half_time_s

    @property
    def bucket_s(self) -> float:
        """Width of a bucket in delay: a bin is 1/B, B = 2 S T_half."""
        return 1 / (2 * self.slope * self.half_time_s * BUCKETS_PER_BIN)


@dataclass(frozen=True, slots=True)
class _Window:
    """Frames start..stop of the echoes that are not silent there, with what their interpolation needs.

    n = stop - start intervals, L echoes.
    """

    start: int
    stop: int
    delay: np.ndarray
    """[s], (n + 1, L)."""
    delay_slope: np.ndarray
    """[s per frame], (n + 1, L)."""
    amplitude: np.ndarray
    """complex64 (n + 3, L): one frame more at either end."""
    sweep: np.ndarray | None
    """Slope over frequency, likewise."""


def _windows(source: EchoStream) -> Iterator[_Window]:
    """Cuts the record into blocks of intervals; every frame is asked for once, the next ones while a block is worked on."""
    total = len(source.times_s)
    held: list[tuple[int, EchoArrays]] = []
    start, intervals, asked = 0, 1, min(total, 2 + HALO_FRAMES)
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(source.frames, 0, asked)
        come = 0
        while start < total - 1:
            stop = min(start + intervals, total - 1)
            low, high = max(0, start - HALO_FRAMES), min(total, stop + 1 + HALO_FRAMES)
            if high > come:
                held.append((come, coming.result()))
                come = asked
                intervals = int(np.clip(BLOCK_ECHO_FRAMES // max(1, held[0][1][0].shape[1]), 4, BLOCK_FRAMES))
                asked = min(total, stop + intervals + 1 + HALO_FRAMES)
                if asked > come:
                    coming = pool.submit(source.frames, come, asked)
            held = [part for part in held if part[0] + len(part[1][0]) > low]
            yield _window(held, low, high, start, stop, total)
            start = stop


def _window(held: list[tuple[int, EchoArrays]], low: int, high: int, start: int, stop: int, total: int) -> _Window:
    near = max(0, start - 1), min(total, stop + 2)
    lit = [part[1] != 0 for part in _rows(held, *near)]
    live = np.flatnonzero(np.any(np.concatenate(lit), axis=0))

    def taken(field: int, first: int, last: int) -> np.ndarray:
        return np.concatenate([np.take(part[field], live, axis=1) for part in _rows(held, first, last)])  # type: ignore[arg-type]

    def with_ends(field: int) -> np.ndarray:
        values = taken(field, *near)
        # Beyond the record the line through its last two frames, which makes the central difference the one-sided one.
        before = [2 * values[:1] - values[1:2]] if start == 0 else []
        after = [2 * values[-1:] - values[-2:-1]] if stop == total - 1 else []
        return np.ascontiguousarray(np.concatenate([*before, values, *after]))

    delay = taken(0, low, high)
    keep = slice(start - low, stop - low + 1)
    return _Window(
        start=start,
        stop=stop,
        delay=delay[keep],
        delay_slope=spline_slopes(len(delay))[keep] @ delay,
        amplitude=with_ends(1),
        sweep=None if held[0][1][2] is None else with_ends(2),
    )


def _rows(held: list[tuple[int, EchoArrays]], first: int, last: int) -> list[EchoArrays]:
    """Frames first..last-1 of what is held, as views."""
    found = []
    for begin, (delay, amplitude, slope) in held:
        cut = slice(max(first - begin, 0), max(last - begin, 0))
        if begin < last and cut.start < len(delay):
            found.append((delay[cut], amplitude[cut], None if slope is None else slope[cut]))
    return found


def _block(window: _Window, position: np.ndarray, step: float, sweep: _Sweep, backend: Backend) -> np.ndarray:
    """Samples (chirp, sample) complex64 of chirps at `position` (in frames after window.start)."""
    if not window.delay.size:
        return np.zeros((len(position), len(sweep.x)), np.complex64)
    plan = _plan(window, position, step, sweep)
    moments = _moments(plan, _coefficients(window, sweep, plan.origin_s, backend), position, step, sweep, backend)
    return moments.reshape(-1, len(position)).T @ _basis(plan, sweep)


@dataclass(frozen=True, slots=True)
class _Plan:
    """Which echoes fall into which bucket during which slot, a slot being a part of a frame interval in which no echo moves
    by more than a bucket."""

    origin_s: float
    buckets: np.ndarray
    """Numbers of the occupied buckets (K,), counted from origin_s."""
    slots_per_interval: int
    starts: np.ndarray
    """(slot, K + 1) positions in `members`."""
    members: np.ndarray
    """interval * N + echo of each member."""


def _plan(window: _Window, position: np.ndarray, step: float, sweep: _Sweep) -> _Plan:
    from scipy.sparse import coo_array

    # tau + f_m tau'/S: the delay that the beat frequency shows.
    effective = window.delay + window.delay_slope * (sweep.mid_hz / sweep.slope / step)
    lit = window.amplitude != 0
    used = lit[:-3] | lit[1:-2] | lit[2:-1] | lit[3:]
    interval, echo = np.nonzero(used)
    before, after = effective[interval, echo], effective[interval + 1, echo]
    travel = float(np.abs(after - before).max()) / sweep.bucket_s
    if travel > MOST_SLOTS:
        raise InputError(
            f"echoes move by {travel * sweep.bucket_s * SPEED_OF_LIGHT / 2:.3g} m of range from one frame to the next, at most "
            f"{MOST_SLOTS * sweep.bucket_s * SPEED_OF_LIGHT / 2:.3g} m can be followed; give delay_s in seconds, or more frames"
        )
    slots = max(1, math.ceil(travel))
    origin = float(min(before.min(), after.min())) - sweep.bucket_s
    members = (interval * window.delay.shape[1] + echo).astype(np.int32)
    rows, columns = [], []
    for slot in range(slots):
        share = (slot + 0.5) / slots
        rows.append(((before + share * (after - before) - origin) / sweep.bucket_s).astype(np.int32))
        columns.append(interval * slots + slot)
    bucket = np.concatenate(rows)
    occupied = np.flatnonzero(np.bincount(bucket))
    rank = np.zeros(occupied[-1] + 1, np.int64)
    rank[occupied] = np.arange(len(occupied))
    row = np.concatenate(columns) * len(occupied) + rank[bucket]
    # A counting sort: the rows of a CSR matrix are the buckets' members.
    shape = ((window.stop - window.start) * slots * len(occupied), window.delay.size)
    table = coo_array((np.ones(len(row), np.int8), (row, np.tile(members, slots))), shape=shape).tocsr()
    return _Plan(origin, occupied, slots, table.indptr, table.indices)


def _coefficients(window: _Window, sweep: _Sweep, origin_s: float, backend: Backend) -> list[Any]:
    """Flat float32 tables of four numbers per (interval, echo), read together: cubics in the frame step u of

    phase [turns]; amplitude, real and imaginary part; its slope over half the sweep likewise, or none; last theta at u = 0.
    """
    import drjit as dr

    Float32, Float64, UInt32 = backend.Float32, backend.Float64, backend.UInt32
    echoes = dr.opaque(UInt32, window.delay.shape[1])
    lane = dr.arange(UInt32, window.delay[:-1].size)
    mid, ramp, origin, per_s, half_band = (
        dr.opaque(Float64, float(x))
        for x in (sweep.mid_hz, sweep.slope, origin_s, sweep.theta_per_s, sweep.slope * sweep.half_time_s)
    )
    delays, slopes = (Float64(np.ascontiguousarray(a).ravel()) for a in (window.delay, window.delay_slope))
    turns: list[Any] = []
    turns_slope: list[Any] = []
    first = None
    for index in (lane, lane + echoes):
        tau, rate = dr.gather(Float64, delays, index), dr.gather(Float64, slopes, index)
        first = tau if first is None else first
        turns.append(mid * tau - 0.5 * ramp * tau * tau)
        turns_slope.append((mid - ramp * tau) * rate)
    # float64 up to here: thousands of turns, of which the fraction counts.
    phase: Any = hermite(*turns, *turns_slope)
    cubics: list[Any] = [(phase[0] - dr.floor(phase[0]), *phase[1:])]
    for values, scale in ((window.amplitude, None), (window.sweep, Float32(half_band))):
        if values is None:
            continue
        parts = Float32(values.view(np.float32).ravel())
        for part in range(2):
            frames = [dr.gather(Float32, parts, 2 * (lane + k * echoes) + part) for k in range(4)]
            middle = 0.5 * (frames[2] - frames[0]), 0.5 * (frames[3] - frames[1])
            cubics.append([c if scale is None else c * scale for c in hermite(frames[1], frames[2], *middle)])
    tables = [dr.ravel(backend.arrays.Array4f(*map(Float32, cubic))) for cubic in cubics]
    tables.append(Float32((first - origin) * per_s))
    dr.eval(tables)
    return tables


def _moments(
    plan: _Plan, tables: list[Any], position: np.ndarray, step: float, sweep: _Sweep, backend: Backend
) -> np.ndarray:
    """Chebyshev coefficients of every bucket over the sweep, complex64 (TERMS, bucket, chirp)."""
    import drjit as dr

    Float32, UInt32, Packet = backend.Float32, backend.UInt32, backend.arrays.Array4f
    buckets = len(plan.buckets)
    slot = np.floor(position * plan.slots_per_interval).astype(np.int64)
    slot = np.clip(slot, 0, (len(plan.starts) - 1) // buckets - 1)
    lanes = _Lanes.of(slot)

    # All that changes from block to block comes in as arrays: a number in the code would compile a new kernel.
    def lanes_of(values: np.ndarray) -> Any:
        return UInt32(values.astype(np.uint32).ravel())

    # (bucket, group of chirps) where there are echoes, and shares of them
    row = np.arange(buckets)[:, None] + slot[lanes.chirp] * buckets
    bucket, group = np.nonzero(plan.starts[row + 1] > plan.starts[row])
    row, chirps = row[bucket, group], lanes.chirp[group]
    begin = lanes_of(plan.starts[row][:, None] + np.arange(lanes.shares))
    end = lanes_of(np.repeat(plan.starts[row + 1], lanes.shares))
    chirp = lanes_of(np.repeat(chirps, lanes.shares))
    stride = dr.opaque(UInt32, lanes.shares)
    members = UInt32(plan.members.astype(np.uint32))
    times = position - np.floor(slot / plan.slots_per_interval)
    times = Float32(np.append(times, np.zeros(lanes.unroll)).astype(np.float32))
    u = [dr.gather(Float32, times, chirp + k) for k in range(lanes.unroll)]
    centres = (plan.buckets[bucket] + 0.5) * sweep.bucket_s * sweep.theta_per_s
    centre = Float32(np.repeat(centres, lanes.shares).astype(np.float32))
    # From phase in turns (and turns per frame step) to theta and eps.
    per_turn, per_rate, eps_per_rate = (
        dr.opaque(Float32, value)
        for value in (
            sweep.theta_per_s / sweep.mid_hz,
            sweep.theta_per_s / (sweep.slope * step),
            2 * math.pi * sweep.half_time_s**2 * sweep.slope / (sweep.mid_hz * step),
        )
    )

    def add(i: Any, sums: list[list[Any]]) -> tuple[Any, list[list[Any]]]:
        member = dr.gather(UInt32, members, i)
        phase, *fields = (dr.gather(Packet, table, member) for table in tables[:-1])
        theta_start = dr.gather(Float32, tables[-1], member) - centre
        new = []
        for time, acc in zip(u, sums, strict=True):
            travelled = time * (phase[1] + time * (phase[2] + time * phase[3]))
            rate = phase[1] + time * (2 * phase[2] + time * (3 * phase[3]))
            theta = theta_start + travelled * per_turn + rate * per_rate
            half_eps = 0.5 * eps_per_rate * rate
            turns = phase[0] + travelled
            # eps x^2 = h (T_0 + T_2), h = eps/2
            sin, cos = dr.sincos((turns - dr.round(turns)) * (2 * math.pi) + half_eps)
            weights = _jacobi_anger(theta)
            real, imag = _turned(fields[0], fields[1], time, sin, cos)
            out = []
            for (re, im), w, bend in zip(acc, weights, _bend(weights), strict=False):
                bend = half_eps * bend
                out.append((re + real * w + imag * bend, im + imag * w - real * bend))
            if len(fields) > 2:
                real, imag = _turned(fields[2], fields[3], time, sin, cos)
                out += [(re + real * w, im + imag * w) for (re, im), w in zip(acc[TERMS:], weights, strict=False)]
            new.append(out)
        return i + stride, new

    count = TERMS + SLOPE_TERMS if len(tables) > 4 else TERMS
    zeros = [[(dr.zeros(Float32, dr.width(begin)),) * 2 for _ in range(count)] for _ in range(lanes.unroll)]
    _, sums = dr.while_loop(
        state=(begin, zeros), cond=lambda i, sums: i < end, body=add, labels=("i", "sums"), mode="symbolic"
    )
    dr.eval(sums)
    planes = np.zeros((count, buckets * len(position)), np.complex64)
    for k, acc in enumerate(sums):
        valid = chirps + k < lanes.end[group]
        place = (bucket * len(position) + chirps + k)[valid]
        for plane, parts in zip(planes, acc, strict=True):
            real, imag = (part.numpy().reshape(-1, lanes.shares).sum(axis=1) for part in parts)
            plane[place] = (real + 1j * imag)[valid]
    return _with_slope(planes.reshape(count, buckets, -1))


@dataclass(frozen=True, slots=True)
class _Lanes:
    """How the chirps of a block, slot by slot, are dealt to lanes: a lane takes `unroll` chirps of one slot, so that it reads an
    echo once for all of them, and one of `shares` of a bucket's echoes."""

    chirp: np.ndarray
    """First chirp of each group."""
    end: np.ndarray
    """End of the group's slot."""
    unroll: int
    shares: int

    @classmethod
    def of(cls, slot: np.ndarray) -> _Lanes:
        """Groups for the slot of each chirp, ascending (chirp,)."""
        bounds = np.flatnonzero(np.diff(slot, prepend=-1, append=slot[-1] + 1))
        longest = int(np.diff(bounds).max())
        groups = -(-longest // MAX_UNROLL)
        unroll = -(-longest // groups)
        counts = -(-np.diff(bounds) // unroll)
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        shares = VECTOR // min(VECTOR, 1 << (groups - 1).bit_length())
        return cls(np.repeat(bounds[:-1], counts) + within * unroll, np.repeat(bounds[1:], counts), unroll, shares)


def _turned(real: Any, imag: Any, u: Any, sin: Any, cos: Any) -> tuple[Any, Any]:
    """A complex cubic at u, times exp(j phase)."""
    re, im = (c[0] + u * (c[1] + u * (c[2] + u * c[3])) for c in (real, imag))
    return re * cos - im * sin, re * sin + im * cos


def _jacobi_anger(theta: Any) -> tuple[Any, ...]:
    """J_0, 2 J_1 ... 2 J_5 of |theta| <= pi/4, each to 3e-6 (Abramowitz & Stegun 9.1.10)."""
    t = theta * theta
    return (
        1 + t * (-1 / 4 + t * (1 / 64 - t * (1 / 2304))),
        theta * (1 + t * (-1 / 8 + t * (1 / 192 - t * (1 / 9216)))),
        t * (1 / 4 + t * (-1 / 48 + t * (1 / 1536))),
        theta * t * (1 / 24 + t * (-1 / 384 + t * (1 / 15360))),
        t * t * (1 / 192 - t * (1 / 3840)),
        theta * t * t * (1 / 1920 - t * (1 / 46080)),
    )


def _bend(w: tuple[Any, ...]) -> tuple[Any, ...]:
    """What exp(j h T_2), to first order in h, takes from each weight: w_m - j h b_m; from T_2 T_m = (T_{m+2} + T_{|m-2|})/2."""
    return 0.5 * w[2], 0.5 * (w[3] - w[1]), w[0] + 0.5 * w[4], 0.5 * (w[1] + w[5]), 0.5 * w[2], 0.5 * w[3]


def _with_slope(planes: np.ndarray) -> np.ndarray:
    """Sums with j^m put in and the part linear in x, x T_m = (T_{m-1} + T_{m+1})/2, added: (TERMS, bucket, chirp)."""
    factor = np.array([1, 1j, -1, -1j, 1, 1j], np.complex64)[:, None, None]
    out = planes[:TERMS] * factor
    if len(planes) > TERMS:
        t0, t1, t2, t3 = planes[TERMS:] * factor[:SLOPE_TERMS]
        out[0] += 0.5 * t1
        out[1] += t0 + 0.5 * t2
        out[2] += 0.5 * (t1 + t3)
        out[3] += 0.5 * t2
        out[4] += 0.5 * t3
    return out


def _basis(plan: _Plan, sweep: _Sweep) -> np.ndarray:
    """What each Chebyshev coefficient of each bucket adds to the samples, complex64 (TERMS * bucket, sample)."""
    delay = plan.origin_s + (plan.buckets + 0.5) * sweep.bucket_s
    carrier = np.exp(1j * np.outer(delay * sweep.theta_per_s, sweep.x))
    chebyshev = np.cos(np.outer(np.arange(TERMS), np.arccos(np.clip(sweep.x, -1, 1))))
    return (chebyshev[:, None, :] * carrier).reshape(-1, len(sweep.x)).astype(np.complex64)
