"""The smallest groups' factors, straight from the echoes, for several pairs of antennas at once."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.core.backend import Backend, one_thread_at_a_time
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.radar.array_delays import ArrayDelays, extra_length
from t2d_rt.radar.buckets import Members
from t2d_rt.radar.coefficients import AmplitudeFrames, phases
from t2d_rt.radar.groups import Level
from t2d_rt.radar.interpolants import hermite
from t2d_rt.radar.sweep import Sweep, cubic_at, moved, nodes, rotated, sin_cos, summed, times_phasor
from t2d_rt.radar.windows import Window


@dataclass(frozen=True, slots=True)
class Factors:
    """Factors of a level's groups, sampled."""

    values: Any
    """Flat float32 (group, sample, node, 2) on the device."""
    samples: int
    first: int
    """Place of the first sample, counted from the window's start."""


@dataclass(frozen=True, slots=True)
class Leaves:
    """The echoes that the first level's groups add up."""

    members: Members
    fields: AmplitudeFrames
    """Amplitudes of the echoes at the frames."""
    phase: tuple[Any, Any]
    """Tables of `phases`, relative to the groups."""
    ends: tuple[ArrayDelays, ...] = ()
    """Transmitters and receivers, each pair of which is to have groups of its own."""


def leaves(window: Window, level: Level, sweep: Sweep, backend: Backend) -> Leaves:
    """The echoes of the first level's groups."""
    intervals, count = window.delay.shape[0] - 1, window.delay.shape[1]
    interval, echo = window.lit
    members = Members.of(interval, level.group[echo], echo, shape=(intervals, len(level)), per=1, size=count)
    phase = phases(window.delay, window.delay_slope, sweep, level, 0.0, backend)
    return Leaves(members, AmplitudeFrames.of(window, sweep, backend), phase)


@one_thread_at_a_time
def smallest(window: Window, level: Level, leaves: Leaves, sweep: Sweep, backend: Backend) -> Factors:
    """Factors of the first level's groups, those of one pair of antennas after those of another, straight from the echoes.

    One kernel: its lanes are (group, frame interval), its loop runs over the group's echoes, of which a lane reads each once for
    all instants and all pairs. Every level takes two samples before and three after: an interval before the window, and a little
    more than one after it, where the last lanes go on with the last interval's cubics.
    """
    import drjit as dr

    Float32, UInt32, Packet = backend.Float32, backend.UInt32, backend.arrays.Array4f
    members, groups, intervals = leaves.members, leaves.members.bins, len(window.delay) - 1
    lane = dr.arange(UInt32, groups * (intervals + 1))
    per_group = dr.opaque(UInt32, intervals + 1)
    group = lane // per_group
    place = lane - group * per_group
    interval = dr.minimum(place, dr.opaque(UInt32, intervals - 1))
    beyond = Float32(place - interval)
    row = interval * dr.opaque(UInt32, groups) + group
    starts = UInt32(members.starts.astype(np.uint32))
    echoes = UInt32(members.members.astype(np.uint32))
    width = dr.opaque(UInt32, intervals)
    per_cycle, per_rate, _ = (dr.opaque(Float32, value) for value in sweep.per_cycle(window.step_s))
    x = [float(v) for v in nodes(level.nodes)[::2]]
    pairs = math.prod(len(end) for end in leaves.ends)
    ends = [_ExtraPhases(end, group, interval, sweep, window, backend) for end in leaves.ends if end.table is not None]

    def values_of(i: Any) -> list[Any]:
        echo = dr.gather(UInt32, echoes, i)
        member = echo * width + interval
        parts = leaves.fields.cubics(echo, interval)
        cycles, theta = dr.gather(Packet, leaves.phase[0], member), dr.gather(Float32, leaves.phase[1], member)
        of_pairs = [(cycles, theta)] * pairs
        if ends:
            out, back = (end.cycles(echo) for end in ends)
            more = [Packet([a + b for a, b in zip(*pair, strict=True)]) for pair in itertools.product(out, back)]
            of_pairs = [(cycles + each, theta + each[0] * per_cycle) for each in more]
        out = []
        for k in range(level.rate):
            u = beyond + k / level.rate
            at_nodes = _at_nodes(parts, u, level.nodes)
            for cubic, start in of_pairs:
                travelled, rate = moved(cubic, u)
                sin, cos = sin_cos(cubic[0] + travelled)
                theta = start + travelled * per_cycle + rate * per_rate
                out += rotated(times_phasor(at_nodes, sin, cos), theta, x, small=True)
        return out

    numbers = 2 * level.nodes
    ends_of_row = dr.gather(UInt32, starts, row), dr.gather(UInt32, starts, row + 1)
    sums = summed(Float32, ends_of_row, 1, level.rate * pairs * numbers, values_of)
    by_pair = np.reshape(np.arange(len(sums)), (level.rate, pairs, numbers)).swapaxes(0, 1).reshape(pairs, -1)
    values: Any = [dr.ravel(backend.arrays.ArrayXf([sums[k] for k in each])) for each in by_pair.tolist()]
    dr.eval(values)  # all at once; else each pair's would run the loop again
    values = dr.concat(values) if pairs > 1 else values[0]
    dr.eval(values)
    return Factors(values, (intervals + 1) * level.rate, -level.rate)


def _at_nodes(parts: list[Any], u: Any, count: int) -> list[Any]:
    """An echo's amplitude at u, cubics of its parts in the frame step, at nodes of the sweep: real and imaginary parts in turn."""
    values = [cubic_at(part, u) for part in parts]
    slopes = values[2:] or [0.0, 0.0]
    return [
        value + node * slope for node in nodes(count).tolist() for value, slope in zip(values[:2], slopes, strict=True)
    ]


class _ExtraPhases:
    """Extra phases of the leaves' echoes from each antenna of an array's end, relative to those of their groups."""

    def __init__(
        self, delays: ArrayDelays, group: Any, interval: Any, sweep: Sweep, window: Window, backend: Backend
    ) -> None:
        import drjit as dr

        Float32, self.packet = backend.Float32, backend.arrays.Array4f
        frames = len(window.delay)
        self.table: Any = delays.table
        self.interval = interval
        self.frames = dr.opaque(backend.UInt32, frames)
        self.centre, *self.offsets = (
            [dr.opaque(Float32, float(x)) for x in place] for place in (delays.end.centre_m, *delays.end.offsets_m)
        )
        # The residual video phase of the extra delay, -S tau e, with the window's mean delay: within a group it hardly differs.
        mid_hz = sweep.mid_hz - sweep.slope * float(window.delay.mean())
        self.per_metre = dr.opaque(Float32, mid_hz / SPEED_OF_LIGHT)
        self.groups = []
        for delay, slope in (levels[0] for levels in delays.groups):
            own = Float32(
                (np.stack([delay, slope], axis=-1).swapaxes(0, 1) * SPEED_OF_LIGHT).astype(np.float32).ravel()
            )
            place = (group * self.frames + interval) * 2
            self.groups.append([dr.gather(Float32, own, place + k) for k in range(4)])

    def cycles(self, echo: Any) -> list[list[Any]]:
        """Cubics of the phase [cycles] of each antenna."""
        import drjit as dr

        place = echo * self.frames + self.interval
        points, steps = ([dr.gather(self.packet, values, place + k) for k in (0, 1)] for values in self.table)
        lines_of_sight = [[point[axis] - self.centre[axis] for axis in range(3)] for point in points]
        found = []
        for offset, own in zip(self.offsets, self.groups, strict=True):
            (extra, slope), (later, slope_later) = (
                extra_length(line_of_sight, step, offset, dr.sqrt)
                for line_of_sight, step in zip(lines_of_sight, steps, strict=True)
            )
            relative = extra - own[0], later - own[2], slope - own[1], slope_later - own[3]
            found.append(list(hermite(*(value * self.per_metre for value in relative))))
        return found
