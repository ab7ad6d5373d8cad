"""Vital signs of a person at rest: displacement of the chest from the phase of its echo, and the rates of breathing and heartbeat.

A displacement d towards the radar changes the phase of an echo by 4 pi d / lambda (Droitcour et al., IEEE Trans. Microw. Theory
Tech. 52(3), 2004). Static echoes add a constant, the centre of the circle that the moving echo describes in the complex plane.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.core.checks import interval
from t2d_rt.core.errors import InputError, warn
from t2d_rt.signal.multiplex import separated
from t2d_rt.signal.range import check_recording, gate, range_fft
from t2d_rt.types.radar import Radar

SLOW_HZ = 40.0
"""Chirps are averaged to about this rate [Hz]; a body at rest moves more slowly."""
RANGE_ZOOM = 8
"""Interpolated range cells in each of the radar's range bins."""
RANGE_WINDOW = "kaiser", 2.5
"""Fine enough to separate parts of a trunk (its main lobe has 2.6 bins, where Hann's has 4). Static echoes in its side lobes, at
-20 dB, do not change the phase."""
BREATHS_HZ, BEATS_HZ = (0.08, 0.7), (0.75, 3.0)
"""Bands in which breathing and heartbeat are searched [Hz]: 5 to 42 breaths and 45 to 180 beats a minute."""
BREATH_HARMONICS, BEAT_HARMONICS = 6, 3
"""Number of harmonics of each rate in a least-squares fit of the displacement."""
SHORTEST_S = 10.0
"""Least duration of a record [s]. Rates are searched from two cycles in the record on, here 0.2 Hz."""
HEARTS_DB = 17.0
"""Power of the heart's line over the median of the band [dB] below which a warning is given: of 300 records of noise alone (16 s at
40 Hz to 60 s at 20 Hz) the greatest read 16.1 dB, of as many of a breath in noise 8.6 dB."""
WEAKEST, CHEST_M = 0.1, 0.25
"""Range cells whose phase may be used: least variance relative to the cell that varies most, and greatest distance from it [m], the
depth of a trunk."""
SCATTER = 0.1
"""Scatter of an echo's radius about its circle, relative to the radius, that is too small to prefer a weaker cell: it changes the
phase by 0.1 rad, 0.04 mm at 60 GHz."""
NOISY = 0.2
"""Variance of an echo's radius about its circle, over the square of its mean, from which a cell counts as noise. Noise alone has
4/pi - 1 = 0.27, an echo as strong as the noise 0.22, one 4 dB stronger 0.14. Of 60 records of noise, 50 are recognised with 10 s at
20 profiles a second, and all with 16 s at 40."""
BREATH_M = 1e-3, 24e-3
"""Depths of a breath without a warning [m]: from a quarter of the shallowest to twice the deepest of the 4 to 12 mm by which chests
move."""
LEAKAGE_BINS = 1.5
"""Range bins next to the radar that leakage and flicker noise fill: the main lobe of `RANGE_WINDOW`."""
AS_GOOD = 0.9
"""Goodness relative to the best cell's from which a stronger cell is preferred."""
LEAST_OWN = 2e-3
"""Least fraction of a frequency's power that a breath and its harmonics must leave, so that the frequency can be separated from
them."""
ZOOM = 16
"""Interpolated frequencies for each line of a spectrum."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VitalSigns:
    """Vital signs from the phase of the echo of a person at rest."""

    range_m: float
    """Range of the cell that varies most [m]; the phase may be that of a cell near it."""
    time_s: np.ndarray
    """Times of the profiles [s], (T,)."""
    displacement_m: np.ndarray
    """Displacement of the chest towards the radar, relative to its mean [m], (T,)."""
    excursion_m: float
    """Greatest minus least displacement in the record [m]."""
    breathing_hz: float
    breathing_m: float
    """Depth of the mean breath [m], peak to peak."""
    heartbeat_hz: float
    heartbeat_m: float
    """Depth of the mean beat [m], peak to peak."""
    heartbeat_db: float
    """Power of the heart's harmonics over the median of the band, after removing the breath [dB]; below `HEARTS_DB` there is a
    warning."""

    def __str__(self) -> str:
        breaths, beats = 60 * self.breathing_hz, 60 * self.heartbeat_hz
        return (
            f"person at {self.range_m:.2f} m, {1e3 * self.excursion_m:.2f} mm over the record: {self.breathing_hz:.3f} Hz "
            f"({breaths:.1f} breaths a minute) by {1e3 * self.breathing_m:.2f} mm, {self.heartbeat_hz:.2f} Hz ({beats:.0f} beats a "
            f"minute) by {1e3 * self.heartbeat_m:.2f} mm, {self.heartbeat_db:.0f} dB over the median of its band"
        )


def vital_signs(adc: Any, radar: Radar, *, range_gate_m: tuple[float, float] | None = None) -> VitalSigns:
    """Displacement of the chest, rates of breath and heart of one person at rest, from ADC samples (chirp, antenna, sample).

    range_gate_m: nearest and farthest range that is searched [m]; all by default. With several persons it selects one.

    The person is taken to be in the range cell that varies most over all antennas, among those whose echo follows a circle, which
    noise does not. Of the cells near it the one is used whose echo follows its circle best. Other movements of the person would be
    taken for vital signs. There is a warning if the cell may hold only noise or leakage, or if the breath is too deep or too
    shallow for a chest.
    Bursts must come faster than 6 Hz, twice the highest heart rate that is searched.
    """
    check_recording(adc, radar)
    adc, radar = separated(adc, radar)
    cube = adc if adc.ndim == 3 else adc[:, None]
    time_s, slow = slow_time(cube, radar, radar.loops_per_frame or max(1, round(1 / (radar.loop_interval_s * SLOW_HZ))))
    if len(time_s) < 2 or time_s[-1] - time_s[0] < SHORTEST_S - 1.0:
        raise InputError(
            f"vital signs need {SHORTEST_S:g} s or more, got {np.ptp(time_s) if len(time_s) else 0.0:.3g} s; record longer"
        )
    axis_m = radar.range_axis_m(RANGE_ZOOM * radar.samples)
    bins = gate(axis_m, None if range_gate_m is None else interval("range_gate_m", range_gate_m, unit="m"))
    profile = range_fft(slow, window=RANGE_WINDOW, n_fft=RANGE_ZOOM * radar.samples, bins=bins)
    signs = signs_of(profile, axis_m[bins], time_s, radar.wavelength_m)
    if signs.range_m < (near_m := LEAKAGE_BINS * radar.range_resolution_m):
        warn(
            f"what varies most is at {signs.range_m:.2f} m, where the radar's leakage and flicker noise lie (below {near_m:.2g} m) "
            "and may be no person; give range_gate_m"
        )
    return signs


def signs_of(profile: np.ndarray, range_m: np.ndarray, time_s: np.ndarray, wavelength_m: float) -> VitalSigns:
    """The vital signs from complex range profiles (T, antenna, range), such as those of devices without ADC samples."""
    long_s = time_s[-1] - time_s[0]
    rate_hz, needed_hz = (len(time_s) - 1) / long_s, 2 * (BEATS_HZ[1] + 1 / long_s)
    if rate_hz < needed_hz:
        raise InputError(
            f"vital signs need {needed_hz:.3g} profiles a second or more, twice the fastest heartbeat looked for and a line, "
            f"got {rate_hz:.3g}; record bursts that follow faster (frame_interval_s)"
        )
    variance = profile.var(axis=0, dtype=np.complex128).real.sum(axis=0)
    if not variance.max() > 1e-12 * np.mean(np.abs(profile) ** 2, axis=0).sum(axis=0).max():
        raise InputError(
            "vital signs need something that moves, and all chirps are alike; give a recording of a person"
        )
    cell, displacement = _clearest(profile, variance, range_m, time_s, wavelength_m)
    breath = _peak_hz(*_spectrum(displacement, time_s, BREATHS_HZ), BREATHS_HZ)[0]
    beat, over_db, harmonics = _beat(displacement, time_s, breath)
    parts = _depths(displacement, time_s, breath, beat, harmonics)
    if not BREATH_M[0] <= parts[0] <= BREATH_M[1]:
        warn(
            f"what is told as a breath moves by {1e3 * parts[0]:.2g} mm, where chests move by 4 to 12 mm: it may be no chest; give "
            "range_gate_m, or record from the front"
        )
    return VitalSigns(
        range_m=float(range_m[cell]), time_s=time_s, displacement_m=displacement,
        excursion_m=float(np.ptp(displacement)), breathing_hz=breath, breathing_m=parts[0], heartbeat_hz=beat,
        heartbeat_m=parts[1], heartbeat_db=over_db,
    )  # fmt: skip


def slow_time(cube: Any, radar: Radar, together: int) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] (T,) and means (T, antenna, sample) of groups of `together` rows; rows after the last whole group are left out."""
    count = len(cube) // together
    times_s = radar.chirp_starts_s(count * together).reshape(count, together).mean(axis=1)
    slow = np.empty((count, *cube.shape[1:]), np.complex64)
    for row in range(count):
        slow[row] = np.asarray(cube[row * together : (row + 1) * together]).mean(axis=0)
    return times_s, slow


def _clearest(
    profile: np.ndarray, variance: np.ndarray, range_m: np.ndarray, time_s: np.ndarray, wavelength_m: float
) -> tuple[int, np.ndarray]:
    """Index of the cell that varies most, and displacement (T,) [m] of the best cell near it, whose echo follows a circle most
    closely in relation to its breath.

    Neighbouring cells hold different parts of a trunk. Where parts that move differently share a cell, its echo leaves the circle
    and the phase follows neither. A cell that hardly moves follows a circle as well, hence the power of the breath is compared with
    the scatter. Among cells that are equally good the strongest is taken. Noise follows no circle and is not taken for a person as
    long as other cells do.
    """
    varying = np.flatnonzero(variance >= WEAKEST * variance.max())
    moved, scatters = zip(*(_displacement(profile[:, :, cell], wavelength_m) for cell in varying), strict=True)
    scatter = np.array(scatters)
    likely = (scatter < NOISY) | (scatter.min() >= NOISY)
    most = varying[int(np.where(likely, variance[varying], -np.inf).argmax())]
    beside = likely & (np.abs(range_m[varying] - range_m[most]) <= CHEST_M)
    near = np.flatnonzero(beside & (variance[varying] >= WEAKEST * variance[most]))
    breaths = [_spectrum(moved[number], time_s, BREATHS_HZ)[1].max() for number in near]
    goodness = np.array(breaths) / (scatter[near] + SCATTER**2)
    good = goodness >= AS_GOOD * goodness.max()
    best = int(near[np.where(good, variance[varying[near]], -np.inf).argmax()])
    if scatter[best] >= NOISY:
        warn(
            f"the echo at {range_m[varying[best]]:.2f} m does not keep to a circle: the variance of its radius is "
            f"{scatter[best]:.2f} of its mean squared, where noise alone has 0.27, so that nothing of a chest may be in it; "
            "give range_gate_m, or record nearer"
        )
    return int(most), np.asarray(moved[best])


def _displacement(cell: np.ndarray, wavelength_m: float) -> tuple[np.ndarray, float]:
    """Displacement (T,) [m] from the phase of antennas (T, A) about the centres of their circles, and the variance of the radii
    over the square of their mean. A shorter path turns the phase backwards, because the IF conjugates the received wave.

    Phase steps are taken from the sum over antennas of products of neighbouring instants, so that a faded antenna has little
    weight.
    """
    moving = cell - np.array([circle_centre(antenna) for antenna in cell.T])
    phase = np.cumsum(np.angle(np.sum(moving[1:] * moving[:-1].conj(), axis=1)))
    displacement_m = -wavelength_m / (4 * math.pi) * np.concatenate([[0.0], phase])
    radii = np.abs(moving)
    return displacement_m - displacement_m.mean(), float(radii.var(axis=0).sum() / np.sum(radii.mean(axis=0) ** 2))


def circle_centre(points: np.ndarray) -> complex:
    """Centre of the circle through complex points (T,) by Pratt's fit (Comput. Graph. 21(4), 1987), which does not shrink for short
    arcs."""
    middle = points.mean()
    scale = math.sqrt(float(np.mean(np.abs(points - middle) ** 2))) or 1.0
    z = (points - middle) / scale
    rows = np.column_stack([np.abs(z) ** 2, z.real, z.imag, np.ones(len(z))])
    # Minimise |rows a| under B^2 + C^2 - 4 A D = 1: the smallest positive eigenvalue of constraint^-1 normal.
    normal = rows.T @ rows
    inverse = np.array([[0, 0, 0, -0.5], [0, 1, 0, 0], [0, 0, 1, 0], [-0.5, 0, 0, 0]])
    values, vectors = np.linalg.eig(inverse @ normal)
    values = np.where(values.real > -1e-9 * np.abs(values).max(), values.real, np.inf)
    a, b, c, _ = vectors[:, int(values.argmin())].real
    if abs(a) < 1e-12:
        return 0j  # the points are on a straight line: angles are taken about the origin
    return complex(middle + scale * complex(-b, -c) / (2 * a))


def _spectrum(values: np.ndarray, time_s: np.ndarray, band_hz: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies of a band [Hz] (F,), not less than two cycles in the record, and the power of the values there after removing a
    parabola, (F,)."""
    trend = np.polynomial.Polynomial.fit(time_s, values, 2)(time_s)
    power = np.abs(np.fft.rfft((values - trend) * np.hanning(len(values)), ZOOM * len(values))) ** 2
    axis = np.fft.rfftfreq(ZOOM * len(values), (time_s[-1] - time_s[0]) / (len(time_s) - 1))
    inside = (axis >= max(band_hz[0], 2.0 / (time_s[-1] - time_s[0]))) & (axis <= band_hz[1])
    return axis[inside], power[inside]


def _peak_hz(axis: np.ndarray, power: np.ndarray, band_hz: tuple[float, float]) -> tuple[float, float]:
    """Frequency of the strongest line in the spectrum of a band [Hz], and its power over the median [dB]."""
    inner = power[1:-1]
    maxima = 1 + np.flatnonzero((inner >= power[:-2]) & (inner > power[2:]))
    best = int(maxima[power[maxima].argmax()]) if len(maxima) else int(power.argmax())
    edge, beyond = (-1, f"faster than {band_hz[1]:g}") if band_hz == BEATS_HZ else (0, f"slower than {axis[0]:.2g}")
    if power[edge] > power[best]:
        warn(f"what is {beyond} Hz moves more than the line that is told; record longer, or of somebody at rest")
    level = 10 * math.log10(max(float(power[best]), 1e-300) / max(float(np.median(power)), 1e-300))
    return float(axis[best]), level


def _beat(values: np.ndarray, time_s: np.ndarray, breath: float) -> tuple[float, float, int]:
    """Heart rate [Hz], power of its lines over the median of the band [dB], and how many harmonics belong to the breath alone.

    If the heart rate is a multiple of the breathing rate, the fit ascribes it to the breath, and only harmonics of the heart that
    the breath lacks remain. So if the line found, its half or its third is such a multiple and moves more than its own harmonics,
    as the first harmonic of a pulse does, that is taken as the heart rate.
    """
    line, over_db = _peak_hz(*_beats(values, time_s, breath), BEATS_HZ)
    near_hz = 1 / (time_s[-1] - time_s[0])
    if over_db < HEARTS_DB:
        warn(
            f"no line of a heart stands out ({over_db:.0f} dB where {HEARTS_DB:g} are due): its rate may be noise, and a "
            f"multiple of {breath:.3g} Hz may be hidden by the breath; record longer, or nearer"
        )
        return line, over_db, BREATH_HARMONICS
    for part in (2, 3, 1):
        rate = line / part
        multiple = round(rate / breath)
        hidden = multiple <= BREATH_HARMONICS and (part - 1) * multiple <= BREATH_HARMONICS
        unmasked = part == 1 or part * multiple > BREATH_HARMONICS
        off_hz = abs(rate - multiple * breath)
        if not (hidden and unmasked) or off_hz > near_hz or rate < BEATS_HZ[0] - near_hz:
            continue
        on = part > 1 or off_hz < near_hz / 4
        harmonics = multiple - 1 if on else BREATH_HARMONICS
        pulses = [k * rate for k in range(1, BEAT_HARMONICS + 1)]
        moves = _fitted(values, time_s, [(breath, harmonics), *((pulse, 1) for pulse in pulses)])[1][1:]
        if np.argmax(moves) > 0:
            line = pulses[int(np.argmax(moves))] if part == 1 else line
        elif on:
            warn(
                f"a heart of {rate:.2f} Hz, {multiple} times the breathing rate, is told by its harmonics; what moves so may all "
                "be the breath's own: record at another breathing rate to be sure"
            )
            return rate, over_db, harmonics
    if line > BEATS_HZ[1]:
        warn(
            f"the line that is told, {line:.2f} Hz, is faster than {BEATS_HZ[1]:g} Hz; record longer, or of somebody at rest"
        )
    return line, over_db, BREATH_HARMONICS


def _beats(values: np.ndarray, time_s: np.ndarray, breath: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies in `BEATS_HZ` [Hz] (F,), and the power that a heart of each frequency explains in addition to a breath (F,).

    A joint least-squares fit under a Hann window has a parabola, the breath with its harmonics at the rate that fits best, and one
    more frequency; the power of that frequency is the amount by which it lowers the residual. A heart explains the sum over its
    harmonics.
    """
    from scipy.optimize import minimize_scalar

    count, span_s = len(values), time_s[-1] - time_s[0]
    window = np.hanning(count + 2)[1:-1] / math.sqrt(3 / 8)

    def breathing(rate: float) -> tuple[np.ndarray, np.ndarray]:
        """Orthonormal columns of parabola and breath (T, C), and the residual of the values (T,)."""
        base = np.linalg.qr(window[:, None] * _columns(time_s, [(rate, BREATH_HARMONICS)])[0])[0]
        return base, window * values - base @ (base.T @ (window * values))

    bounds = breath - 0.5 / span_s, breath + 0.5 / span_s
    fitted = minimize_scalar(lambda rate: float(np.sum(breathing(rate)[1] ** 2)) * 1e6, bounds=bounds, method="bounded")
    base, residual = breathing(float(fitted.x))
    # Products of cosine and sine of each frequency with the residual, with the columns, and with one another.
    products = np.fft.rfft(np.column_stack([residual, base]) * window[:, None], ZOOM * count, axis=0)
    twice = np.fft.fft(window**2, ZOOM * count)[2 * np.arange(len(products)) % (ZOOM * count)]
    cosine, sine = products.real[:, 1:], -products.imag[:, 1:]
    even = (1 + LEAST_OWN) * count / 2 + twice.real / 2 - np.sum(cosine**2, axis=1)
    odd = (1 + LEAST_OWN) * count / 2 - twice.real / 2 - np.sum(sine**2, axis=1)
    mixed = -twice.imag / 2 - np.sum(cosine * sine, axis=1)
    left = products[:, 0]
    explained = (odd * left.real**2 + 2 * mixed * left.real * left.imag + even * left.imag**2) / (even * odd - mixed**2)
    axis = np.fft.rfftfreq(ZOOM * count, span_s / (count - 1))
    explained[axis > axis[-1] - 1 / span_s] = 0  # above that frequency there are aliases
    inside = np.flatnonzero((axis >= BEATS_HZ[0]) & (axis <= BEATS_HZ[1]))
    harmonics = np.arange(1, BEAT_HARMONICS + 1)[:, None] * inside
    of_harmonics = np.where(harmonics < len(axis), explained[np.minimum(harmonics, len(axis) - 1)], 0)
    # The first harmonic of a pulse is its strongest, unless the breath hides it.
    hidden = even[inside] + odd[inside] < count / 2
    return axis[inside], np.minimum(of_harmonics, np.where(hidden, np.inf, of_harmonics[0])).sum(axis=0)


def _depths(values: np.ndarray, time_s: np.ndarray, breath: float, beat: float, harmonics: int) -> list[float]:
    """Depths [m], peak to peak, of the mean breath and the mean beat, at the best-fitting rates near the given ones.

    A rate that is slightly off would blur the mean over the record; the rates of the spectra are still those reported, as people
    breathe unevenly.
    """
    from scipy.optimize import minimize

    step_hz = 1 / (ZOOM * (time_s[-1] - time_s[0]))

    def lines(moved: np.ndarray) -> list[tuple[float, int]]:
        breath_hz, beat_hz = np.array([breath, beat]) + step_hz * np.clip(moved, -2, 2)
        return [(breath_hz, harmonics), (beat_hz, BEAT_HARMONICS)]

    def residual(moved: np.ndarray) -> float:
        return float(np.sum((values - _fitted(values, time_s, lines(moved))[0]) ** 2)) * 1e6

    options = {"xatol": 0.05, "maxiter": 60, "initial_simplex": np.eye(3, 2)}
    return _fitted(values, time_s, lines(minimize(residual, np.zeros(2), method="Nelder-Mead", options=options).x))[1]


def _fitted(values: np.ndarray, time_s: np.ndarray, lines: list[tuple[float, int]]) -> tuple[np.ndarray, list[float]]:
    """Least-squares sum of a parabola and the harmonics of some rates (T,), and the peak-to-peak depth of each rate's part."""
    matrix, owned = _columns(time_s, lines)
    factors = np.linalg.solve(matrix.T @ matrix, matrix.T @ values)
    parts = [float(np.ptp(matrix[:, owned == owner] @ factors[owned == owner])) for owner in range(len(lines))]
    return matrix @ factors, parts


def _columns(time_s: np.ndarray, lines: list[tuple[float, int]]) -> tuple[np.ndarray, np.ndarray]:
    """Columns of a parabola and of harmonics of rates [Hz] (T, C), and the index of the rate to which each column belongs, or
    -1."""
    middle = time_s - time_s.mean()
    # Harmonics within a line of half the profile rate, or above, would be aliases of others.
    most_hz = ((len(middle) - 1) / 2 - 1) / (middle[-1] - middle[0])
    columns, owners = [(middle / (middle[-1] or 1.0)) ** k for k in range(3)], [-1] * 3
    for owner, (rate, harmonics) in enumerate(lines):
        for k in range(1, min(harmonics, int(most_hz / rate)) + 1):
            columns += [np.cos(2 * np.pi * k * rate * middle), np.sin(2 * np.pi * k * rate * middle)]
            owners += [owner] * 2
    return np.column_stack(columns), np.array(owners)
