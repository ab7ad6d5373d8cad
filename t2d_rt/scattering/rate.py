"""Surface rate at which the splines of a moving target's delays and facets' amplitudes hold (docs/physics.md, eq. 22)."""

from __future__ import annotations

import math
from bisect import bisect_left
from functools import cached_property

import numpy as np
from scipy.signal.windows import blackmanharris

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.memory import blocks
from t2d_rt.geometry.vectors import norms
from t2d_rt.types import Ellipsoids, MovingMesh, Radar
from t2d_rt.types.mesh import Track
from t2d_rt.types.splines import spline

TOLERANCE_DB = -29.0
"""Error that the splines may add to the field's by default [dB]."""
ROTATION_RAD = 0.1
"""Greatest rotation of a mesh's edges between frames, root mean square, for the cubics of facets' amplitudes: a fan's moving
field errs by -23.6 dB at 0.1 rad, by -18 dB at 0.2 (validation/report, movers). A walker's delays ask for more than that."""
ROTATION_DB, DB_PER_OCTAVE = -23.6, 6.0
"""Error of the field at that rotation [dB], and what half the rotation gains [dB], by the same figures."""
LEAST_HZ, MOST_HZ, STEP_HZ = 40.0, 10_000.0, 5.0
RAISED = 2**0.25
"""Ratio of one rate that is tried to the one before."""
LEVEL, STEEP_DB = 2, -3.0
"""Number of steps of the rate, and change [dB] of what splines miss over them above which all of these rates miss some motion."""
RESOLVED_DB, SMALL_DB = -36.0, -50.0
"""Level [dB] that splines may miss of such a motion, which takes 4.2 frames a period and keeps the amplitude within 1.2 %, and
level [dB] below which no motion counts, that of a vibration of 1.4 um at 77 GHz."""
QUIET = 0.25
"""Fraction of a target's points that move least: what splines miss of them shows a vibration beside a walker's feet."""
LINE_HZ = 9.0, 60.0
"""Between these frequencies [Hz] a vibration is looked for as a line of the spectrum, which shows it beside a walk's own
movements; slower ones are resolved anyway, and of faster ones the splines tell."""
LINE_DB, LEAST_LINE_DB = 5.0, -47.0
"""A vibration is a line that stands the first [dB] above the strongest frequencies on both sides and has the second [dB of a radian
squared] of energy, that of an amplitude of 2 um towards a radar at 77 GHz. In 2 of 122 recordings of people there is one, which is
the file's own; weaker ones come from rounding and filtering of files."""
LINE_HALF_WIDTH_HZ, SIDE_HZ = 1.5, 4.0
"""Half width of a line [Hz], and how far from it the sides reach with which it is compared [Hz]."""
LINE_FRAMES = 4.2
"""Surface frames in the period of a line, as for `RESOLVED_DB`."""
LEAST_LINE_S = 1.0
"""Duration [s] below which a record does not tell lines from movements."""
FASTEST_HZ = 480.0
"""Rate [Hz] up to which small motions are sought in what is no recorded motion of a body."""
RECORDED_HZ = 240.0
"""People are recorded at up to this rate. What is given more often, or as a function of time, is given so for something fast and
small, which a body's own movements may hide."""
ROUNDED = 1e-6
"""Relative error of a rate that is worked out from times."""
STEADY_HZ, STEADY_S, LEAST_STEADY_S = (9.0, 240.0), 0.8, 0.2
"""Between these frequencies [Hz] all motion is resolved that goes on in each piece of `STEADY_S` [s] of a record: steps on the
floor pass, a vibration goes on, hidden or not. Records shorter than `LEAST_STEADY_S` [s] do not tell its frequency."""
PROBE_RATE_HZ, FINER = 240.0, 4.0
"""Rate [Hz] at which motion is sampled, higher for a record of fewer than `PROBE_FRAMES`; factor on it for faster motion."""
PROBE_FRAMES = 12
"""Number of frames of one short record; five make a fourth difference."""
RECORDS_PER_S, LEAST_RECORDS, MOST_RECORDS = 3, 4, 20
LEAST_PROBED_S = 0.5
"""Least length of a periodic motion that is probed [s]; a longer period is probed as a whole."""
CHEAP_POINTS = 2_000_000
"""Points times instants up to which a whole record is probed: a mesh of 600 vertices has as many in 14 s, a body's 17 ellipsoids in
eight minutes. Of longer records pieces are taken."""
PIECES, LEAST_FRAMES, END_FRAMES = 4, 240, 3
"""Number of these pieces, least number of instants in all of them together, and number of frames at either end of a piece that do
not count, because the spline ends there and the record does not."""
MOST_POINTS, MOST_FACES = 300, 1000
"""Points of a mesh whose paths are interpolated, and faces of which an edge tells how it rotates."""


class SurfaceRate:
    """Surface rate that a target needs between two times, from what splines of its points' paths miss.

    For a target too large to be probed as a whole, this is found with a `stand_in`, a few points that move with it; fourth
    derivatives in short records tell how much higher a rate its own points need. Motion is probed once for all tolerances.
    """

    def __init__(
        self,
        geometry: MovingMesh | Ellipsoids,
        radar: Radar,
        span_s: tuple[float, float],
        stand_in: Ellipsoids | None = None,
    ) -> None:
        self._periodic = isinstance(geometry, MovingMesh) and geometry.period_s is not None
        if isinstance(geometry, MovingMesh) and geometry.period_s is not None:  # one period tells all
            span_s = span_s[0], min(span_s[1], span_s[0] + max(geometry.period_s, LEAST_PROBED_S))
        self._geometry, self._radar, self._span_s = geometry, radar, span_s
        self._stand_in = geometry if stand_in is None else stand_in
        self._known: dict[tuple[bool, float], tuple[float, float]] = {}
        self._pieces: dict[float, list[tuple[np.ndarray, np.ndarray, Track]]] = {}
        self._missed: dict[float, np.ndarray] = {}
        self._needed_hz: dict[float, float] = {}
        self._path_lengths, self._point_count = _path_lengths(
            self._stand_in, radar, specular=isinstance(geometry, Ellipsoids)
        )

    def needed_hz(self, tolerance_db: float = TOLERANCE_DB) -> float:
        """The rate [Hz] at which splines add no more than `tolerance_db` to the field's error and resolve all that moves."""
        if tolerance_db not in self._needed_hz:
            vibration_hz = max(self._line_hz, self._steady_hz)
            delays_hz = max(self._more * self._resolving_hz(tolerance_db), LINE_FRAMES * vibration_hz)
            needed = max(self.rotation_hz(tolerance_db), delays_hz)
            self._needed_hz[tolerance_db] = float(np.clip(_stepped(needed), LEAST_HZ, MOST_HZ))
        return self._needed_hz[tolerance_db]

    def rotation_hz(self, tolerance_db: float = TOLERANCE_DB) -> float:
        """The rate [Hz] that the rotation of a mesh's edges needs; 0 for ellipsoids."""
        if not len(self._geometry.faces):
            return 0.0
        probe_hz, rad_per_s = 0.0, 1.0
        angle_rad = ROTATION_RAD * 2 ** ((tolerance_db - TOLERANCE_DB) / DB_PER_OCTAVE)
        while probe_hz < min(rad_per_s / angle_rad, MOST_HZ):
            probe_hz = max(FINER * probe_hz, self._probe_hz)
            rad_per_s = math.sqrt(self._mean_squares(self._geometry, probe_hz)[1]) * probe_hz
        return rad_per_s / angle_rad

    def error_db(self, rate_hz: float) -> float:
        """What splines at that rate add to the field's error [dB]: of delays and of facets' amplitudes."""
        rotation_db = ROTATION_DB + DB_PER_OCTAVE * math.log2(max(self.rotation_hz() / rate_hz, 1e-3))
        return float(10 * np.log10(10 ** (rotation_db / 10) + 10 ** (self._missed_db(rate_hz / self._more)[0] / 10)))

    @cached_property
    def _line_hz(self) -> float:
        """Frequency of the fastest vibration [Hz] that stands as a line in the spectrum of the phases, 0 without any.

        Only the middle of a record too large to be probed as a whole is searched. Rotors are not searched: their lines are
        harmonics, which count by what splines miss of them.
        """
        if self._length_s < LEAST_LINE_S or self._is_rotor:
            return 0.0
        pieces, highest_hz = self._probed(LEAST_HZ), LINE_HZ[1]
        if len(pieces) == 1:
            times_s, phases, _ = pieces[0]
        else:
            middle_s, half_s = sum(self._span_s) / 2, self._most_frames / self._probe_hz / 2
            times_s = np.linspace(middle_s - half_s, middle_s + half_s, self._most_frames)
            phases = self._phases(times_s)
        highest_hz = min(highest_hz, 0.5 * self._given_hz)  # frames that were given hold no faster one
        return fastest_line_hz(phases, (len(times_s) - 1) / (times_s[-1] - times_s[0]), highest_hz)

    @cached_property
    def _steady_hz(self) -> float:
        """Highest frequency [Hz] of what may be a vibration of a target that is given finely in time, 0 where nothing may be one.

        Only the middle of a record too large to be probed as a whole is searched.
        """
        if self._length_s < LEAST_STEADY_S or self._is_rotor or self._given_hz < RECORDED_HZ * (1 + ROUNDED):
            return 0.0
        highest_hz = min(STEADY_HZ[1], 0.5 * self._given_hz)
        length_s = min(self._length_s, self._most_frames / (2 * STEADY_HZ[1]))
        begin_s = (sum(self._span_s) - length_s) / 2
        times_s = np.linspace(begin_s, begin_s + length_s, math.ceil(2 * STEADY_HZ[1] * length_s) + 1)
        return fastest_steady_hz(self._phases(times_s), (len(times_s) - 1) / length_s, highest_hz)

    @property
    def _is_rotor(self) -> bool:
        """Whether lines in its spectrum may be harmonics of a rotation."""
        made = self._stand_in.made
        return self._periodic or (made is not None and made.by == "mover")

    @cached_property
    def _given_hz(self) -> float:
        """Rate at which the geometry's places were given [Hz]; infinite for a function of time."""
        return math.inf if self._stand_in.made is None else 1 / float(np.diff(self._stand_in.times_s).min())

    @property
    def _length_s(self) -> float:
        return self._span_s[1] - self._span_s[0]

    @property
    def _fastest_hz(self) -> float:
        """Rate of frames [Hz] up to which small motions are sought, no higher than that of the frames that were given."""
        made = self._stand_in.made
        if made is None or made.by == "mover":
            return FASTEST_HZ
        of_body = made.by in {"skin", "segments"}
        return 0.0 if of_body and self._given_hz < RECORDED_HZ * (1 + ROUNDED) else min(FASTEST_HZ, self._given_hz)

    @property
    def _probe_hz(self) -> float:
        return max(PROBE_RATE_HZ, (PROBE_FRAMES - 1) / self._length_s)

    def _probe_hz_for(self, rate_hz: float) -> float:
        """How often motion is sampled to tell what splines of frames at that rate miss: twice as often at least."""
        return self._probe_hz * 2 ** max(0, math.ceil(math.log2(2 * rate_hz / self._probe_hz)))

    @property
    def _more(self) -> float:
        """Factor by which the geometry needs a higher rate than its stand-in, by their fourth derivatives."""
        if self._stand_in is self._geometry:
            return 1.0
        fine, rough = (self._mean_squares(target, self._probe_hz)[0] for target in (self._geometry, self._stand_in))
        return float((fine / rough) ** 0.125) if rough > 0 else 1.0

    def _resolving_hz(self, tolerance_db: float) -> float:
        """The lowest rate [Hz] that resolves the motion, from `LEAST_HZ` on."""
        failed, rate = 0.0, LEAST_HZ
        while rate < MOST_HZ and not self._resolves(rate, tolerance_db):
            failed, rate = rate, rate * RAISED
        between = range(math.floor(failed) + 1, math.ceil(rate))
        number = bisect_left(between, True, key=lambda rate_hz: self._resolves(rate_hz, tolerance_db))
        return between[number] if failed and number < len(between) else rate

    def _resolves(self, rate_hz: float, tolerance_db: float) -> bool:
        """Whether splines of frames at that rate miss no more than is tolerated, and little of the fastest motion that counts.

        Below twice its frequency splines miss all of a motion, whatever their rate.
        """
        missed_db = self._missed_db(rate_hz)
        if missed_db[0] > tolerance_db:
            return False
        highest_hz = min(2 * rate_hz, self._probe_hz_for(rate_hz) / 2)
        highest_hz = max(highest_hz, self._fastest_hz)
        rates = LEAST_HZ * RAISED ** np.arange(-8, 4 * math.log2(highest_hz / LEAST_HZ))
        rates = rates[rates > 3 / self._length_s]
        misses_db = np.reshape([self._missed_db(rate) for rate in rates], (-1, 2))
        level = (misses_db[LEVEL:] > misses_db[:-LEVEL] + STEEP_DB) & (misses_db[LEVEL:] > SMALL_DB)
        # It must hold twice in a row, because frames that fall together with those of the file miss less.
        counts = np.where(level[1:] & level[:-1], misses_db[LEVEL + 1 :], math.inf)
        return bool((missed_db <= counts + RESOLVED_DB).all())

    def _missed_db(self, rate_hz: float) -> np.ndarray:
        """Energy (2,) [dB of a radian squared] of what splines of frames at that rate miss of the phases of the stand-in: the mean
        over its points, and the value below which the `QUIET` fraction of them lies."""
        if rate_hz not in self._missed:
            total, count = np.zeros(1), 0
            for times_s, phases, curve in self._probed(rate_hz):
                length_s = times_s[-1] - times_s[0]
                frames_s = np.linspace(times_s[0], times_s[-1], max(4, math.ceil(length_s * rate_hz) + 1))
                wrong = spline(frames_s, curve(frames_s))(times_s) - phases
                if length_s < 0.9 * self._length_s:
                    ends_s = min(END_FRAMES / rate_hz, length_s / 3)
                    wrong = wrong[(times_s >= times_s[0] + ends_s) & (times_s <= times_s[-1] - ends_s)]
                total, count = total + np.einsum("tv,tv->v", wrong, wrong), count + len(wrong)
            self._missed[rate_hz] = 10 * np.log10(np.array([total.mean(), np.quantile(total, QUIET)]) / count + 1e-30)
        return self._missed[rate_hz]

    def _probed(self, rate_hz: float) -> list[tuple[np.ndarray, np.ndarray, Track]]:
        """Times (K,) [s] and phases (K, V) [rad] of the whole record or of pieces, often enough for frames at that rate, and their
        splines."""
        probe_hz = self._probe_hz_for(rate_hz)
        if probe_hz not in self._pieces:
            count = math.ceil(self._length_s * probe_hz) + 1
            if count <= self._most_frames:
                times = [np.linspace(*self._span_s, count)]
            else:
                long = np.arange(self._most_frames // PIECES) / probe_hz
                times = [begin + long for begin in np.linspace(self._span_s[0], self._span_s[1] - long[-1], PIECES)]
            phases = [self._phases(piece_s) for piece_s in times]
            self._pieces[probe_hz] = [
                (piece_s, piece_phases, spline(piece_s, piece_phases))
                for piece_s, piece_phases in zip(times, phases, strict=True)
            ]
        return self._pieces[probe_hz]

    @property
    def _most_frames(self) -> int:
        """Greatest number of instants at which all points are probed."""
        return max(LEAST_FRAMES, CHEAP_POINTS // self._point_count)

    def _phases(self, times_s: np.ndarray) -> np.ndarray:
        """Phases (K, V) [rad] of the paths over the stand-in's points, `MOST_POINTS` of them at most."""
        paths = [self._path_lengths(block_s) for block_s in blocks(times_s, self._point_count)]
        return 2 * math.pi * self._radar.mid_frequency_hz / SPEED_OF_LIGHT * np.concatenate(paths)

    def _mean_squares(self, geometry: MovingMesh | Ellipsoids, probe_hz: float) -> tuple[float, float]:
        """What `_mean_squares` finds in short records spread over the whole record, sampled at `probe_hz`."""
        key = geometry is self._geometry, probe_hz
        if key not in self._known:
            step = 1 / probe_hz
            records = int(np.clip(RECORDS_PER_S * self._length_s, LEAST_RECORDS, MOST_RECORDS))
            begin = np.linspace(self._span_s[0], self._span_s[1] - (PROBE_FRAMES - 1) * step, records)
            parts = list(blocks(begin, PROBE_FRAMES * geometry.point_count))
            squares = [_mean_squares(geometry, self._radar, begins, step) for begins in parts]
            self._known[key] = _mean(squares, [len(begins) for begins in parts])
        return self._known[key]


def _mean_squares(
    geometry: MovingMesh | Ellipsoids, radar: Radar, begin_s: np.ndarray, step_s: float
) -> tuple[float, float]:
    """Mean squares over short records that begin at `begin_s`: of the fourth derivative of the paths [m/s^4], and of the angles by
    which edges rotate from frame to frame [rad]."""
    times = (begin_s[:, None] + step_s * np.arange(PROBE_FRAMES)).ravel()
    points = geometry.points_at(times)
    paths = _paths(points, radar).reshape(len(begin_s), PROBE_FRAMES, -1)
    fourth = float(np.mean((np.diff(paths, n=4, axis=1) / step_s**4) ** 2))
    if not len(geometry.faces):
        return fourth, 0.0

    faces = geometry.faces[_evenly(len(geometry.faces), MOST_FACES)]
    edges = points.take(faces[:, 1], axis=1)
    edges -= points.take(faces[:, 0], axis=1)  # `take` is several times as fast as an index
    rotation = np.diff(edges.reshape(len(begin_s), PROBE_FRAMES, -1, 3), axis=1)
    return fourth, float(np.mean(rotation**2) / np.mean(edges**2))


def _path_lengths(geometry: MovingMesh | Ellipsoids, radar: Radar, *, specular: bool) -> tuple[Track, int]:
    """Function that gives the lengths (K, V) [m], at times (K,) [s], of the paths over at most `MOST_POINTS` of a target's points,
    and how many points it computes for them. With `specular`, ellipsoids have the paths over their specular points."""
    points, made = _evenly(geometry.point_count, MOST_POINTS), geometry.made
    if specular and isinstance(geometry, Ellipsoids):
        return lambda times_s: _specular_paths(geometry, times_s, radar)[:, points], geometry.point_count
    if isinstance(geometry, MovingMesh) and made is not None and made.by == "arrays":
        vertices_at = spline(geometry.times_s, made.arguments["vertices"][:, points])
        return lambda times_s: _paths(vertices_at(times_s), radar), len(points)
    return lambda times_s: _paths(geometry.points_at(times_s)[:, points], radar), geometry.point_count


def fastest_line_hz(phases: np.ndarray, rate_hz: float, highest_hz: float = LINE_HZ[1]) -> float:
    """Frequency [Hz] of the fastest vibration that stands as a line in the spectrum of phases (K, V) [rad], 0 without any.

    It is sought in the mean spectrum of the points, and in the spectrum below which the `QUIET` fraction of them lies.
    """
    frequency_hz, spectra = _spectra(phases, rate_hz, np.hanning(len(phases))[1:-1])
    step_hz = frequency_hz[1]
    near, far = (
        max(math.ceil(width_hz / step_hz), least) for width_hz, least in ((LINE_HALF_WIDTH_HZ, 3), (SIDE_HZ, 6))
    )
    fastest_hz = 0.0
    for spectrum in (spectra.mean(axis=1), np.quantile(spectra, QUIET, axis=1)):
        level_db = 10 * np.log10(spectrum + 1e-30)
        energy_db = 10 * np.log10(np.convolve(spectrum, np.ones(3), "same") + 1e-30)
        sides = np.lib.stride_tricks.sliding_window_view(level_db, far - near + 1).max(axis=1)
        below, above = sides[: len(level_db) - 2 * far], sides[far + near : far + near + len(level_db) - 2 * far]
        inside = slice(far, len(level_db) - far)
        stands = level_db[inside] - np.maximum((below + above) / 2, above) > LINE_DB
        at_hz = frequency_hz[inside][stands & (energy_db[inside] > LEAST_LINE_DB)]
        fastest_hz = max([fastest_hz, *at_hz[(at_hz >= LINE_HZ[0]) & (at_hz <= highest_hz)]])
    return float(fastest_hz)


def fastest_steady_hz(phases: np.ndarray, rate_hz: float, highest_hz: float = STEADY_HZ[1]) -> float:
    """Highest frequency [Hz] at which one of phases (K, V) [rad] has energy that goes on all the time, 0 without any.

    It needs the energy of a vibration that counts, `LEAST_LINE_DB`: no spectrum tells it from a walk's own movements. What
    leaks from the swings of arms and legs is less than that energy, as the window's side lobes lie at -92 dB.
    """
    count = min(len(phases), round(STEADY_S * rate_hz))
    window = blackmanharris(count - 2, sym=False)
    of_tone = len(window) * np.sum(window**2) / np.sum(window) ** 2  # its energy over that in one bin
    starts = np.linspace(0, len(phases) - count, math.ceil(2 * len(phases) / count) - 1).astype(int)
    of_pieces = [_spectra(phases[start : start + count], rate_hz, window) for start in starts]
    frequency_hz = of_pieces[0][0]
    energies = of_tone * np.min([spectra for _, spectra in of_pieces], axis=0)
    counts = (energies > 10 ** (LEAST_LINE_DB / 10)).any(axis=1)
    return float(max(frequency_hz[counts & (frequency_hz >= STEADY_HZ[0]) & (frequency_hz <= highest_hz)], default=0.0))


def _spectra(phases: np.ndarray, rate_hz: float, window: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (F,) [Hz] and energies (F, V) [rad^2] of phases (K, V) [rad] at these, which add up to the phases' mean squares;
    the window is two samples shorter than the phases.

    They are those of accelerations, divided by the fourth power of the frequency: a window then keeps the strong slow movements out
    of the weak fast ones.
    """
    accelerations = np.diff(phases, n=2, axis=0) * (rate_hz / (2 * math.pi)) ** 2
    count = len(accelerations)
    frequency_hz = np.fft.rfftfreq(count, 1 / rate_hz)
    weighted = np.fft.rfft(accelerations * window[:, None], axis=0)
    spectra = np.abs(weighted) ** 2 * 2 / count / np.sum(window**2)
    return frequency_hz, spectra / np.maximum(frequency_hz, frequency_hz[1])[:, None] ** 4


def _paths(points: np.ndarray, radar: Radar) -> np.ndarray:
    """Lengths (K, V) [m] of the paths over points (K, V, 3)."""
    return norms(points - radar.tx_position_m) + norms(points - radar.rx_position_m)


def _specular_paths(ellipsoids: Ellipsoids, times_s: np.ndarray, radar: Radar) -> np.ndarray:
    """Lengths (K, V) [m] of the paths over ellipsoids' specular points as in the far field: a rotation alone changes them.

    The point lies nearer than the centre by the length of the vector of the semi-axes' components towards the radar (eq. 8).
    """
    centres, axes = ellipsoids.at(times_s)
    towards = 0.5 * (radar.tx_position_m + radar.rx_position_m) - centres
    far = np.maximum(norms(towards), 1e-9)[..., None]  # one that lies about the antennas is refused later
    along = np.einsum("kvi,kvij->kvj", towards / far, axes)
    return _paths(centres, radar) - 2 * norms(along * ellipsoids.semi_axes_m)


def _evenly(count: int, most: int) -> np.ndarray:
    """At most `most` whole numbers below `count`, evenly spaced."""
    return np.linspace(0, count - 1, min(count, most)).astype(int)


def _stepped(rate_hz: float) -> float:
    return math.ceil(rate_hz / STEP_HZ) * STEP_HZ


def _mean(values: list[tuple[float, float]], counts: list[int]) -> tuple[float, float]:
    """Means of two numbers over blocks of unlike size."""
    if len(values) == 1:
        return values[0]
    first, second = np.average(values, axis=0, weights=counts)
    return float(first), float(second)
