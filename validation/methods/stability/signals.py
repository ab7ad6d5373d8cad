"""The chain behind the echoes: float32, aliasing, range-Doppler coupling, MTI at its notch, long records."""

from __future__ import annotations

import math
import re
import tracemalloc
import warnings

import numpy as np

import t2d_rt as t2d
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.signal import mti, range_doppler, spectrogram
from t2d_rt.types import PEC, Ellipsoids, MovingMesh, Radar
from validation.methods.reference import refined
from validation.methods.stability.case import Case, Theme
from validation.physics.rcs import sphere
from validation.report import at_least, at_most, new_figure, save_chart

BALL_M = 0.1
RANGES_M = (1.0, 10.0, 30.0, 100.0)
FLOAT32_SPEED_MPS, FLOAT32_S = 1.0, 0.1
FAST_MPS, FOLDED_S = 3.0, 0.3
COUPLED_MPS = 4.0
SLOW_MPS = 0.05
LONG_S, MESH_S = 60.0, 30.0
BREATH_M, BREATH_HZ = 5e-3, 0.3


def theme() -> Theme:
    radar = Radar.preset("table2")
    precision, precision_chart = float32(radar)
    notch, notch_chart = moving_target_indication(radar)
    return Theme(
        cases=[*precision, aliasing(), coupling(radar), *notch, *long_record(), memory()],
        charts=[precision_chart, notch_chart],
    )


def moving_ball(radar: Radar, start_m: float, speed_mps: float, duration_s: float) -> Ellipsoids:
    """A conducting sphere whose nearest point approaches from `start_m`, by the ellipsoid model: exact at any range."""
    times = np.array([0.0, duration_s])
    x = start_m + BALL_M - speed_mps * times
    centres = radar.tx_position_m + np.stack([x, 0 * x, 0 * x], axis=1)
    return Ellipsoids(np.full((1, 3), BALL_M), centres[:, None], times, material=PEC)


def samples(target: Ellipsoids, radar: Radar) -> np.ndarray:
    """ADC samples (chirp, sample)."""
    return np.asarray(t2d.simulate(target, radar=radar, method="ellipsoid").cube[:, 0])


def exact_phase(radar: Radar, range_m: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """IF phase [rad] of physics.md, eq. 1, in float64, less whole turns; range (chirp, sample) at the samples' own times."""
    t = radar.sample_times_s[samples]
    delay = 2 * range_m / SPEED_OF_LIGHT
    cycles = radar.carrier_hz * delay + radar.slope_hz_per_s * (delay * t - delay**2 / 2)
    return 2 * math.pi * (cycles % 1)


# --- float32 --------------------------------------------------------------------------------------------------------


def float32(radar: Radar) -> tuple[list[Case], str]:
    """Phases of a sphere at 1 m/s: 2 k R in single precision, and the cube's own."""
    # A tenth of the bandwidth, that 100 m do not fold.
    radar = radar.replace(slope_hz_per_s=radar.slope_hz_per_s / 10)
    places = np.arange(radar.samples)
    naive, ours = [], []
    for start in RANGES_M:
        cube = samples(moving_ball(radar, start, FLOAT32_SPEED_MPS, FLOAT32_S), radar)
        times = radar.chirp_starts_s(len(cube))[:, None] + radar.sample_times_s
        range_m = start - FLOAT32_SPEED_MPS * times
        exact = exact_phase(radar, range_m, places)
        k = np.float32(2 * math.pi / radar.wavelength_m)
        single = np.float32(2) * k * range_m.astype(np.float32)
        # Its phase against the same formula in float64: what the rounding of range and product cost.
        double = 2 * float(k) * range_m
        naive.append(_rms(single.astype(np.float64) - double))
        ours.append(_rms(np.angle(cube * np.exp(-1j * exact)) - np.angle(np.sum(cube * np.exp(-1j * exact)))))
    cases = [
        Case(
            f"float32 at {start:g} m",
            at_least("phase 2 k R in float32, RMS error", naive[n], limit, "rad"),
            at_most("phase of the ADC samples", ours[n], 2e-5, "rad"),
        )
        for n, (start, limit) in enumerate(zip(RANGES_M, (1e-5, 1e-4, 1e-3, 3e-3), strict=True))
    ]
    figure, axis = new_figure()
    axis.loglog(RANGES_M, naive, "o--", label="2 k R in float32")
    axis.loglog(RANGES_M, ours, "s-", label="t2d_rt, ADC samples (complex64)")
    axis.set(xlabel="range [m]", ylabel="RMS error of phase [rad]", title="sphere approaching at 1 m/s, 77 GHz")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3, which="both")
    return cases, save_chart(figure, "stability_float32.png")


def _rms(phase_rad: np.ndarray) -> float:
    """Without whole turns."""
    return float(np.sqrt(np.mean(np.angle(np.exp(1j * phase_rad)) ** 2)))


# --- aliasing, coupling ---------------------------------------------------------------------------------------------


def aliasing() -> Case:
    """3 m/s where 1.23 m/s is the limit: the spectrogram folds; the warning names the prf_hz that helps."""
    radar = Radar.preset("table2-uniform")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        folded = _peak_speed(samples(moving_ball(radar, 3, FAST_MPS, FOLDED_S), radar), radar)
    better = radar.replace(prf_hz=_advised_prf_hz(said) or radar.prf_hz)
    with warnings.catch_warnings(record=True) as left:
        warnings.simplefilter("always")
        read = _peak_speed(samples(moving_ball(better, 3, FAST_MPS, FOLDED_S), better), better)
    quiet = not any("unambiguous" in str(w.message) for w in left)
    return Case(
        f"aliasing, {FAST_MPS:g} m/s at a limit of {radar.max_speed_mps:.3g} m/s",
        at_least("plain STFT, speed read", abs(folded - FAST_MPS), 1, "m/s"),
        at_most(
            "warns and names a prf_hz; the speed read with it", abs(read - FAST_MPS) if quiet else math.nan, 0.05, "m/s"
        ),
    )


def _advised_prf_hz(said: list[warnings.WarningMessage]) -> float | None:
    """What the warning of aliasing tells to take."""
    advice = [found[1] for each in said if (found := re.search(r"raise prf_hz to (\d+)", str(each.message)))]
    return float(advice[0]) if advice else None


def _peak_speed(adc: np.ndarray, radar: Radar) -> float:
    image = spectrogram(adc, radar, mti="none", n_window=256, n_fft=2048)
    return float(image.velocity_mps[image.power.sum(axis=1).argmax()])


def coupling(radar: Radar) -> Case:
    """Range of a sphere at 4 m/s, halfway through the record, from the range-Doppler map's peak (a parabola in dB)."""
    target = moving_ball(radar, 3, COUPLED_MPS, 0.02)
    adc = samples(target, radar)
    middle = radar.chirp_starts_s(len(adc)).mean() + radar.mid_time_s
    plain, corrected = (_peak_range(adc, radar, option) - (3 - COUPLED_MPS * middle) for option in (False, True))
    return Case(
        f"range-Doppler coupling at {COUPLED_MPS:g} m/s",
        at_least("plain range axis", abs(plain) * 1e3, 5, "mm"),
        at_most("correct_coupling=True", abs(corrected) * 1e3, 1, "mm"),
    )


def _peak_range(adc: np.ndarray, radar: Radar, correct: bool) -> float:
    found = range_doppler(adc, radar, range_window="blackmanharris", correct_coupling=correct)
    row, column = np.unravel_index(found.power.argmax(), found.power.shape)
    a, b, c = 10 * np.log10(found.power[row, column - 1 : column + 2])
    return float(found.range_m[column] + 0.5 * (a - c) / (a - 2 * b + c) * (found.range_m[1] - found.range_m[0]))


# --- MTI ------------------------------------------------------------------------------------------------------------


def moving_target_indication(radar: Radar) -> tuple[list[Case], str]:
    """What cancellers take from slow targets, and from one at the blind speed lambda PRF / 2."""
    blind = 2 * radar.max_speed_mps
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        at_notch = samples(moving_ball(radar, 5, blind, 0.02), radar)
    better = radar.replace(prf_hz=_advised_prf_hz(said) or radar.prf_hz)
    advised = samples(moving_ball(better, 5, blind, 0.02), better)
    slow = samples(moving_ball(radar, 3, SLOW_MPS, 1.0), radar)
    rest = samples(moving_ball(radar, 3, 0, 0.1), radar)
    cases = [
        Case(
            f"MTI, a target of {SLOW_MPS * 100:g} cm/s for 1 s",
            at_least("two-pulse canceller, power lost", -_left_db(slow, "canceller", (1.0, -1.0)), 30, "dB"),
            at_most("mti='mean', the default", abs(_left_db(slow, "mean")), 1, "dB"),
        ),
        Case(
            f"MTI at its notch, {blind:.3g} m/s",
            at_least("two-pulse canceller, power lost", -_left_db(at_notch, "canceller", (1.0, -1.0)), 20, "dB"),
            at_most("warns and names a prf_hz; lost with it by mti='mean'", abs(_left_db(advised, "mean")), 1, "dB"),
        ),
        Case(
            "MTI, a target at rest",
            at_least("the paper's kernel 1 -2 3 -2 1, power left", _left_db(rest, "canceller"), -0.1, "dB"),
            at_most("mti='mean', power left", _left_db(rest, "mean"), -80, "dB"),
        ),
    ]
    return cases, _notch_chart(radar)


def _left_db(adc: np.ndarray, method: str, kernel: tuple[float, ...] = (1, -2, 3, -2, 1)) -> float:
    """Power after MTI over that before [dB]; 200 dB down where nothing is left."""
    fraction = np.sum(np.abs(mti(adc, method, kernel=kernel)[2:-2]) ** 2) / np.sum(np.abs(adc[2:-2]) ** 2)
    return float(10 * np.log10(max(fraction, 1e-20)))


def _notch_chart(radar: Radar) -> str:
    speeds = np.geomspace(3e-4, radar.max_speed_mps, 300)
    times = radar.chirp_starts_s(round(0.5 * radar.prf_hz))
    tones = np.exp(-2j * math.pi * 2 * speeds / radar.wavelength_m * times[:, None])
    settings = {
        "two-pulse canceller": {"method": "canceller", "kernel": (1.0, -1.0)},
        "the paper's kernel 1 -2 3 -2 1": {"method": "canceller"},
        "high-pass at 0.1 m/s": {"method": "highpass", "prf_hz": radar.prf_hz, "cutoff_hz": 2 * 0.1 / radar.wavelength_m},
        "mean over 0.5 s (the default)": {"method": "mean"},
    }  # fmt: skip
    figure, axis = new_figure()
    for (name, options), style in zip(settings.items(), ("-", "--", "-.", "-"), strict=True):
        power = np.mean(np.abs(mti(tones, **options)[2:-2]) ** 2, axis=0)
        axis.semilogx(speeds, 10 * np.log10(np.maximum(power, 1e-9)), style, label=name)
    axis.set(xlabel="speed [m/s]", ylabel="power after MTI [dB]", ylim=(-70, 40), title="MTI over speed, table2")
    axis.legend(fontsize=8, loc="upper left")
    axis.grid(alpha=0.3, which="both")
    return save_chart(figure, "stability_mti.png")


# --- long records ---------------------------------------------------------------------------------------------------


def long_record() -> list[Case]:
    """A sphere that breathes by 5 mm for a minute: phase at its end, floor of its spectrum."""
    radar = Radar.preset("table2-uniform")
    cube = samples(_breathing(radar, LONG_S), radar)
    middle = radar.samples // 2
    times = radar.chirp_starts_s(len(cube)) + radar.sample_times_s[middle]
    range_m = _breath_range_m(times)
    exact = exact_phase(radar, range_m[:, None], np.array([middle]))[:, 0]
    rotated = cube[:, middle] * np.exp(-1j * exact)
    error = np.angle(rotated / rotated[: len(rotated) // 60].sum())
    # A simulator whose clock is added up in float32.
    clock = np.cumsum(np.full(len(times), np.float32(radar.loop_interval_s)), dtype=np.float32) - radar.loop_interval_s
    late = _breath_range_m(clock + radar.sample_times_s[middle]) - range_m
    drift = 4 * math.pi / radar.wavelength_m * np.abs(late)
    first, last = (_floor_db(part[:, middle]) for part in (cube[: len(cube) // 60], cube[-(len(cube) // 60) :]))
    return [
        Case(
            "60 s, drift of phase",
            at_least("clock added up in float32", float(drift.max()), 0.05, "rad"),
            at_most("phase of the ADC samples, worst of the record", float(np.abs(error).max()), 1e-3, "rad"),
        ),
        Case(
            "60 s, floor of the spectrum in its last second against its first",
            at_least("the same with the phase in float32, 2 k R", _single_floor_db(radar, range_m) - last, 10, "dB"),
            at_most("difference of the floors", abs(last - first), 6, "dB"),
        ),
    ]


def memory() -> Case:
    """A mesh that breathes for half a minute: a few echoes of many facets."""
    radar = Radar.preset("table2-uniform").replace(samples=16)
    unit, faces = sphere(BALL_M, radar.tx_position_m, 3)

    def track(times_s: np.ndarray) -> np.ndarray:
        x = _breath_range_m(times_s) + BALL_M
        return unit + np.stack([x, 0 * x, 0 * x], axis=1)[:, None]

    surface = MovingMesh.from_track(track, faces, np.array([0.0, MESH_S]), PEC)
    tracemalloc.start()
    found = t2d.simulate(surface, radar=radar, accuracy={"occlusion": False})
    peak = tracemalloc.get_traced_memory()[1] - found.cube[:].nbytes
    tracemalloc.stop()
    frames = round(found.settings["surface_rates_hz"][0] * MESH_S)
    vertices = refined(surface, radar, surface.sagitta_rad).operator.shape[0]
    return Case(
        f"{MESH_S:g} s of a breathing mesh, memory beside the cube",
        at_least(
            f"its {vertices} vertices at all {frames} frames at once, 16 bytes each",
            16 * vertices * frames / 1e6,
            400,
            "MB",
        ),
        at_most("peak of what the simulation holds", peak / 1e6, 250, "MB"),
    )


def _breath_range_m(times_s: np.ndarray) -> np.ndarray:
    return 3 + BREATH_M * np.sin(2 * math.pi * BREATH_HZ * times_s)


def _breathing(radar: Radar, duration_s: float) -> Ellipsoids:
    """At rest but for a sine of its range, as a function: a spline of frames would be off by its own error."""

    def track(times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = _breath_range_m(times_s) + BALL_M
        centres = radar.tx_position_m + np.stack([x, 0 * x, 0 * x], axis=1)
        return centres[:, None], np.broadcast_to(np.eye(3), (len(x), 1, 3, 3))

    return Ellipsoids.from_track(track, np.full((1, 3), BALL_M), np.array([0.0, duration_s]), PEC)


def _floor_db(series: np.ndarray) -> float:
    """Median of the spectrum beyond a quarter of the band, under its peak [dB]."""
    spectrum = np.abs(np.fft.fft(series * np.blackman(len(series)))) ** 2
    far = np.abs(np.fft.fftfreq(len(series))) > 0.25
    return float(10 * np.log10(np.median(spectrum[far]) / spectrum.max()))


def _single_floor_db(radar: Radar, range_m: np.ndarray) -> float:
    """Of the last second, with the phase 2 k R in float32."""
    k = np.float32(2 * math.pi / radar.wavelength_m)
    phase = np.float32(2) * k * range_m[-len(range_m) // 60 :].astype(np.float32)
    return _floor_db(np.exp(1j * phase))
