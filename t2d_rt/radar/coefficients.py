"""Fields of echoes at nodes of the sweep, at any instants (docs/physics.md, eq. 16).

One kernel computes the sum: it has a lane for each bucket and instant, and loops over the echoes of the bucket.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.core.backend import Backend, aligned_empty, one_thread_at_a_time
from t2d_rt.radar.delay_bins import Buckets
from t2d_rt.radar.groups import GroupLevel
from t2d_rt.radar.interpolants import hermite
from t2d_rt.radar.sweep import Instants, Sweep, cubic_at, moved, rotated, sin_cos, summed, times_phasor
from t2d_rt.radar.windows import Window


def cubic(frames: list[Any], scale: Any | None) -> list[Any]:
    """Coefficients of the cubic between the second and the third of four frames, times a factor unless that is None."""
    middle = 0.5 * (frames[2] - frames[0]), 0.5 * (frames[3] - frames[1])
    return [c if scale is None else c * scale for c in hermite(frames[1], frames[2], *middle)]


@dataclass(frozen=True, slots=True)
class AmplitudeFrames:
    """Amplitudes of echoes at the frames on the device, from which kernels compute the cubics between the frames."""

    parts: list[tuple[Any, Any | None]]
    """Of the amplitude and, if there is one, of its slope: flat float32 (echo, frame, 2) on the device, and a factor on the
    cubics."""
    frames: Any
    """Number of frames, n + 5 for n intervals, on the device."""
    pair: Any
    """Dr.Jit type of the two numbers that are read at once."""

    @classmethod
    @one_thread_at_a_time
    def of(cls, window: Window, sweep: Sweep, backend: Backend) -> AmplitudeFrames:
        """The amplitudes of a window's echoes, ready for the kernels of a backend."""
        import drjit as dr

        half_band = dr.opaque(backend.Float32, sweep.slope * sweep.half_time_s)
        # Neighbouring lanes are neighbouring intervals of one echo, so they read neighbouring numbers.
        parts = [
            (_by_echo(values, backend), scale)
            for values, scale in ((window.amplitude, None), (window.sweep, half_band))
            if values is not None
        ]
        return cls(parts, dr.opaque(backend.UInt32, len(window.amplitude)), backend.arrays.Array2f)

    def cubics(self, echo: Any, interval: Any) -> list[list[Any]]:
        """Cubics of echoes in an interval: of the real and the imaginary part of the amplitude, then of its slope over half the
        sweep if there is one."""
        import drjit as dr

        place = echo * self.frames + interval
        cubics = []
        for values, scale in self.parts:
            frames = [dr.gather(self.pair, values, place + k) for k in range(4)]
            cubics += [cubic([frame[part] for frame in frames], scale) for part in range(2)]
        return cubics


def _by_echo(values: np.ndarray, backend: Backend) -> Any:
    """Complex64 values (T, N) as flat Float32 (N, T, 2) on the device."""
    flat = aligned_empty(values.size, np.complex64)
    flat.reshape(values.shape[::-1])[:] = values.T
    return backend.Float32(flat.view(np.float32))


MOST_PARTS, ENOUGH_LANES = 16, 1 << 14
"""The echoes of a bucket are divided among up to so many lanes, where the kernel would have fewer lanes than the second number."""


@one_thread_at_a_time
def phases(
    delay: np.ndarray,
    delay_slope: np.ndarray,
    sweep: Sweep,
    references: GroupLevel | None,
    origin_s: float,
    backend: Backend,
) -> tuple[Any, Any]:
    """Phases of echoes or groups as the kernels read them, for delays [s] (n + 3, L) and their slopes [s per frame].

    Two flat float32 tables over (echo, interval): the phase [cycles] as a cubic in the frame step u, four coefficients each, and
    theta at u = 0. Neighbouring lanes are mostly neighbouring intervals of one echo, so they read neighbouring numbers. Both are
    relative to the echo's group among the `references`; without any, the phase lacks whole cycles and theta is that of the delay
    after `origin_s`. Delays are float64, as needed for the fraction of thousands of cycles.
    """
    import drjit as dr

    Float32, Real, UInt32 = backend.Float32, backend.Float64, backend.UInt32
    echo, interval, echoes = _echo_interval(delay, backend)
    at_frame = interval * echoes + echo
    mid, ramp, origin, per_s = (
        dr.opaque(Real, float(x)) for x in (sweep.mid_hz, sweep.slope, origin_s, sweep.theta_per_s)
    )
    ends, first = _cycles(delay, delay_slope, [at_frame, at_frame + echoes], mid, ramp, Real)
    if references is None:
        cubic: Any = hermite(*ends)
        cubic = (cubic[0] - dr.floor(cubic[0]), *cubic[1:])
        first -= origin
    else:
        count = dr.opaque(UInt32, references.delay.shape[1])
        place = dr.gather(UInt32, UInt32(references.group.astype(np.uint32)), echo) + interval * count
        others, other = _cycles(references.delay, references.delay_slope, [place, place + count], mid, ramp, Real)
        cubic = hermite(*(end - other for end, other in zip(ends, others, strict=True)))
        first -= other
    tables = dr.ravel(backend.arrays.Array4f(*map(Float32, cubic))), Float32(first * per_s)
    dr.eval(tables)
    return tables


def _cycles(
    delay: np.ndarray, delay_slope: np.ndarray, frames: list[Any], mid: Any, ramp: Any, Real: Any
) -> tuple[list[Any], Any]:
    """Phase f_mid tau - S tau^2 / 2 [cycles] at both frames and its slopes there, and the delay at the first frame, on the device.

    `frames` are the indices of both frames among the delays, `mid` and `ramp` are f_mid and S.
    """
    import drjit as dr

    flat = [Real(np.ascontiguousarray(values).ravel()) for values in (delay, delay_slope)]
    taus, rates = ([dr.gather(Real, values, place) for place in frames] for values in flat)
    phase = [mid * tau - 0.5 * ramp * tau * tau for tau in taus]
    return phase + [(mid - ramp * tau) * rate for tau, rate in zip(taus, rates, strict=True)], taus[0]


def _echo_interval(delay: np.ndarray, backend: Backend) -> tuple[Any, Any, Any]:
    """Index of the echo and of the interval of every lane for delays (n + 3, L), and L."""
    import drjit as dr

    UInt32 = backend.UInt32
    lane, intervals = dr.arange(UInt32, delay[:-1].size), dr.opaque(UInt32, len(delay) - 1)
    echo = lane // intervals
    return echo, lane - echo * intervals, dr.opaque(UInt32, delay.shape[1])


@one_thread_at_a_time
def fields_at(
    buckets: Buckets,
    table: tuple[Any, Any],
    fields: AmplitudeFrames,
    instants: Instants,
    places: np.ndarray,
    backend: Backend,
) -> np.ndarray:
    """Sums of the echoes of every bucket at `places` of the sweep, pairs +x, -x; flat complex64, part after part, each (instant,
    bucket, place).

    `table` is that of `phases` with the origin of the buckets, `fields` are the amplitudes of the echoes.
    """
    import drjit as dr

    lanes = Lanes.of(buckets, table, instants, backend)
    u, x = lanes.u, places[::2].tolist()

    def values_of(i: Any) -> list[Any]:
        echo, cubic, theta = lanes.read(i)
        parts = fields.cubics(echo, lanes.interval)
        travelled, rate = moved(cubic, u)
        theta = theta + travelled * lanes.per_cycle + rate * lanes.per_rate
        eps = lanes.eps_per_rate * rate
        sin, cos = sin_cos(cubic[0] + travelled + eps * (0.25 / math.pi))
        numbers = times_phasor([cubic_at(part, u) for part in parts], sin, cos)
        slopes = numbers[2:] or [0.0, 0.0]
        values = [a + place * b for place in places.tolist() for a, b in zip(numbers[:2], slopes, strict=True)]
        return rotated(values, theta, x, bend=eps)

    sums = summed(backend.Float32, (lanes.begin, lanes.end), lanes.step, 2 * len(places), values_of)
    if lanes.parts > 1:
        dr.eval(sums)  # all at once, for evaluating the sums one by one would run the loop again for each
        sums = [dr.block_sum(part, lanes.parts) for part in sums]
    return lanes.scattered(sums, backend).ravel()


@dataclass(frozen=True, slots=True, kw_only=True)
class Lanes:
    """Lanes of a kernel over buckets, on the device: one for each bucket and instant at which the bucket has members (echoes or
    groups). Several lanes share the members where there are fewer lanes than a device can use.

    All that changes from window to window is passed in arrays: a number in the code would compile a new kernel.
    """

    parts: int
    """Number of lanes for one bucket and instant."""
    begin: Any
    """Position, among `members`, of a lane's first member."""
    end: Any
    """Position after the last member of the lane's bucket."""
    step: Any
    """Step from one member of a lane to its next: `parts`."""
    members: Any
    """Indices of the echoes or groups, bucket after bucket."""
    table: tuple[Any, Any]
    """Phases of the members, as `phases` returns them."""
    packet: Any
    """Dr.Jit type of the four numbers that are read at once."""
    interval: Any
    """Index of the frame interval in which the instant lies."""
    intervals: Any
    """Number of intervals for which the table has phases of a member."""
    instant: Any
    """Index of the instant."""
    u: Any
    """Position of the instant within its interval, 0..1."""
    centre: Any
    """theta of the middle of the bucket."""
    place: Any
    """Index of the lane's result, the same for all `parts`."""
    empty: np.ndarray
    """Indices of the results that no lane computes: buckets without members."""
    results: int
    per_cycle: Any
    """`Instants.per_cycle` on the device: theta per cycle, then theta and eps per cycle per frame."""
    per_rate: Any
    eps_per_rate: Any

    @classmethod
    def of(
        cls,
        buckets: Buckets,
        table: tuple[Any, Any],
        instants: Instants,
        backend: Backend,
        most_parts: int = MOST_PARTS,
    ) -> Lanes:
        """Lanes for all members of buckets at some instants."""
        import drjit as dr

        Float32, UInt32, members = backend.Float32, backend.UInt32, buckets.members
        slot = members.slot(instants.position)
        occupied = (np.diff(members.starts) > 0).reshape(-1, members.bins).T[:, slot]
        bin_number, instant = np.nonzero(occupied)
        empty_bin, empty_at = np.nonzero(~occupied)
        row = slot[instant] * members.bins + bin_number
        parts = most_parts
        while parts > 1 and len(row) * parts > ENOUGH_LANES:
            parts //= 2
        first = backend.lanes(np.repeat(instant, parts))
        interval = slot // members.slots_per_interval
        times = instants.position + 1 - interval
        times = Float32(times.astype(np.float32))
        per_cycle, per_rate, eps_per_rate = (dr.opaque(Float32, value) for value in instants.per_cycle)
        return cls(
            parts=parts,
            begin=backend.lanes(members.starts[row][:, None] + np.arange(parts)),
            end=backend.lanes(np.repeat(members.starts[row + 1], parts)),
            step=dr.opaque(UInt32, parts),
            members=backend.lanes(members.members),
            table=table,
            packet=backend.arrays.Array4f,
            interval=backend.lanes(np.repeat(interval[instant], parts)),
            intervals=dr.opaque(UInt32, (len(members.starts) - 1) // members.bins // members.slots_per_interval),
            instant=first,
            u=dr.gather(Float32, times, first),
            centre=backend.lanes(np.repeat(buckets.centres[bin_number], parts), Float32),
            place=backend.lanes(buckets.place(bin_number, instant, len(instants))),
            empty=buckets.place(empty_bin, empty_at, len(instants)),
            results=members.bins * len(instants),
            per_cycle=per_cycle,
            per_rate=per_rate,
            eps_per_rate=eps_per_rate,
        )

    def read(self, i: Any) -> tuple[Any, Any, Any]:
        """Index of the i-th member, the cubic of its phase [cycles], and its theta at the beginning of the interval, relative to
        the middle of the bucket."""
        import drjit as dr

        member = dr.gather(type(self.members), self.members, i)
        place = member * self.intervals + self.interval
        cubics, thetas = self.table
        cubic = dr.gather(self.packet, cubics, place)
        return member, cubic, dr.gather(type(thetas), thetas, place) - self.centre

    def scattered(self, sums: list[Any], backend: Backend) -> np.ndarray:
        """Sums of real and imaginary parts as complex64 numbers (result, number); zeros for results that no lane computes."""
        import drjit as dr

        out = dr.empty(backend.Float32, self.results * len(sums))
        # One scatter: each further scatter into the same array would run the loop again.
        dr.scatter(out, backend.arrays.ArrayXf(sums), self.place)
        numbers = np.asarray(out.numpy()).view(np.complex64).reshape(self.results, -1)
        numbers[self.empty] = 0
        return numbers
