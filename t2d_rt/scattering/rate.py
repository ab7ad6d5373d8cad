"""Surface rate at which the splines of a moving target's delays and facets' amplitudes hold (docs/physics.md, eq. 22)."""

from __future__ import annotations

import math

import numpy as np

from t2d_rt.constants import SPEED_OF_LIGHT
from t2d_rt.geometry.vectors import lengths
from t2d_rt.memory import blocks
from t2d_rt.types import Ellipsoids, MovingMesh, Radar

TOLERANCE_DB = -38.0
"""What the splines may add to the field's error unless something else is asked for."""
ROTATION_RAD = 0.1
"""Greatest rotation of a mesh's edges between frames, root mean square, for the cubics of facets' amplitudes: a fan's moving
field errs by -23.6 dB at 0.1 rad, by -18 dB at 0.2 (validation/report, movers). A walker's delays ask for more than that."""
DB_PER_OCTAVE = 6.0
"""What half of that rotation gains, by the same figures."""
LEAST_HZ, MOST_HZ, STEP_HZ = 40.0, 10_000.0, 5.0
PROBE_RATE_HZ, FINER = 240.0, 4.0
"""Rate at which motion is sampled, unless the record is shorter than such a short record; factor on it for faster motion."""
PROBE_FRAMES = 12
"""Frames of one short record, five of which make a fourth difference."""
RECORDS_PER_S, LEAST_RECORDS, MOST_RECORDS = 3, 4, 40
LEAST_PROBED_S = 0.5
"""So much of a periodic motion is probed, or a period."""
MISSED = 1.15
"""The rate rises where the whole record asks for so many times more than its short records: less is their scatter."""
CHEAP_POINTS = 2_000_000
"""Points times instants at which a whole record is probed: a mesh of 600 vertices has as many in 14 s, a body's 17 ellipsoids in
eight minutes. Of more, as many short records are taken."""


def needed_rate_hz(
    geometry: MovingMesh | Ellipsoids,
    radar: Radar,
    span_s: tuple[float, float],
    tolerance_db: float = TOLERANCE_DB,
    *,
    stand_in: Ellipsoids | None = None,
) -> float:
    """Rate of surface frames [Hz] that a target needs between two times, as `SurfaceRate` has it."""
    return SurfaceRate(geometry, radar, span_s, stand_in).needed_hz(tolerance_db)


class SurfaceRate:
    """Rate of surface frames that a target needs between two times, from the fourth derivative of its points' paths.

    A cubic spline of frames h apart misses x(t) by 16 u^2 (1 - u)^2 h^4 x''''/384 within an interval; the square of that has the
    mean 0.406. It is found in short records; `stand_in`, a few points that move with the geometry, tell from the whole record, or
    from as much of it as `CHEAP_POINTS` allow, whether these missed a jerk. Motion is probed once for all tolerances.
    """

    def __init__(
        self,
        geometry: MovingMesh | Ellipsoids,
        radar: Radar,
        span_s: tuple[float, float],
        stand_in: Ellipsoids | None = None,
    ) -> None:
        if isinstance(geometry, MovingMesh) and geometry.period_s is not None:  # one period tells all
            span_s = span_s[0], min(span_s[1], span_s[0] + max(geometry.period_s, LEAST_PROBED_S))
        self._geometry, self._radar, self._span_s = geometry, radar, span_s
        self._stand_in = geometry if stand_in is None else stand_in
        self._known: dict[tuple[int, float, int], tuple[float, float]] = {}
        self._needed_hz: dict[float, float] = {}

    def needed_hz(self, tolerance_db: float = TOLERANCE_DB) -> float:
        """The rate [Hz] at which splines add no more than that to the field's error."""
        if tolerance_db not in self._needed_hz:
            self._needed_hz[tolerance_db] = self._found_hz(tolerance_db)
        return self._needed_hz[tolerance_db]

    def _found_hz(self, tolerance_db: float) -> float:
        probe_hz = max(PROBE_RATE_HZ, (PROBE_FRAMES - 1) / self._length_s)
        needed = self._probed_hz(probe_hz, tolerance_db)
        while probe_hz < needed < MOST_HZ:
            probe_hz *= FINER
            needed = self._probed_hz(probe_hz, tolerance_db)
        return float(np.clip(math.ceil(needed / STEP_HZ) * STEP_HZ, LEAST_HZ, MOST_HZ))

    @property
    def _length_s(self) -> float:
        return self._span_s[1] - self._span_s[0]

    def _probed_hz(self, probe_hz: float, tolerance_db: float) -> float:
        """The rate that motion sampled so often asks for."""
        records = int(np.clip(RECORDS_PER_S * self._length_s, LEAST_RECORDS, MOST_RECORDS))
        needed = self._asked_hz(self._geometry, probe_hz, records, tolerance_db)
        affordable = CHEAP_POINTS // (PROBE_FRAMES * self._stand_in.point_count)
        whole = min(affordable, math.ceil(self._length_s * probe_hz / (PROBE_FRAMES - 1)))
        if whole > records:
            short, all_of_it = (
                self._asked_hz(self._stand_in, probe_hz, count, tolerance_db) for count in (records, whole)
            )
            if all_of_it > MISSED * short:
                return needed * all_of_it / short
        return needed

    def _asked_hz(self, geometry: MovingMesh | Ellipsoids, probe_hz: float, records: int, tolerance_db: float) -> float:
        """The rate that so many short records of a geometry ask for [Hz], at least 1."""
        step = 1 / probe_hz
        key = id(geometry), probe_hz, records
        if key not in self._known:
            begin = np.linspace(self._span_s[0], self._span_s[1] - (PROBE_FRAMES - 1) * step, records)
            some = list(blocks(begin, PROBE_FRAMES * geometry.point_count))
            found = [_mean_squares(geometry, self._radar, each, step) for each in some]
            self._known[key] = _mean(found, [len(each) for each in some])
        phase, rotation = self._known[key]
        for_delays = max(1.0, float((0.406 * phase / 10 ** (tolerance_db / 10)) ** 0.125))
        if not len(geometry.faces):
            return for_delays
        rotation_rad = ROTATION_RAD * 2 ** ((tolerance_db - TOLERANCE_DB) / DB_PER_OCTAVE)
        return max(for_delays, math.sqrt(rotation) / step / rotation_rad)


def _mean_squares(
    geometry: MovingMesh | Ellipsoids, radar: Radar, begin_s: np.ndarray, step_s: float
) -> tuple[float, float]:
    """Mean squares over short records that begin at `begin_s`: of what a spline misses of the phases,
    for frames one second apart [rad], and of the angles by which edges rotate from frame to frame [rad]."""
    times = (begin_s[:, None] + step_s * np.arange(PROBE_FRAMES)).ravel()
    points = geometry.points_at(times)
    paths = sum(lengths(points - place) for place in (radar.tx_position_m, radar.rx_position_m))
    fourth = np.diff(np.reshape(paths, (len(begin_s), PROBE_FRAMES, -1)), n=4, axis=1) / step_s**4
    rad_per_m = 2 * math.pi * radar.mid_frequency_hz / SPEED_OF_LIGHT
    phase = np.mean((rad_per_m * fourth / 384) ** 2)
    if not len(geometry.faces):
        return float(phase), 0.0

    def squares(faces: np.ndarray) -> tuple[float, float]:
        edges = points.take(faces[:, 1], axis=1)
        edges -= points.take(faces[:, 0], axis=1)  # `take` is several times as fast as an index
        rotation = np.diff(edges.reshape(len(begin_s), PROBE_FRAMES, -1, 3), axis=1)
        return float(np.vdot(rotation, rotation)) / rotation.size, float(np.vdot(edges, edges)) / edges.size

    some = list(blocks(geometry.faces, 2 * len(times)))  # edges and their differences
    rotation, edges = _mean([squares(each) for each in some], [len(each) for each in some])
    return float(phase), rotation / edges


def _mean(values: list[tuple[float, float]], counts: list[int]) -> tuple[float, float]:
    """Means of two numbers over blocks of unlike size."""
    if len(values) == 1:
        return values[0]
    first, second = np.average(values, axis=0, weights=counts)
    return float(first), float(second)
