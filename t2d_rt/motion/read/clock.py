"""Find a file's frame rate from the times of its frames, compare it with the stated one, and bring frames onto an even clock."""

from __future__ import annotations

import math
import re
from contextlib import suppress
from dataclasses import replace

import numpy as np

from t2d_rt.core.errors import InputError, warn
from t2d_rt.motion.quaternions import continuous, normalise
from t2d_rt.motion.read.arrays import Arrays
from t2d_rt.motion.read.tracks import Times, Tracks
from t2d_rt.types.motion import checked_rate

UNITS_S = {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "ns": 1e-9}

TIME_FIELD = re.compile(
    rf"(?:frame_?)?(?:time_?stamps?|times?|ts?|elapsed(?:_?time)?|clock)(?:_?({'|'.join(UNITS_S)}))?", re.IGNORECASE
)
"""Names that files of arrays give to the times of their frames, and the unit in such a name."""

RATE_FIELDS = (
    "fps", "rate_hz", "rate", "frame_rate", "framerate", "mocap_framerate", "mocap_frame_rate", "sampling_rate", "sample_rate",
)  # fmt: skip

LENGTH_FIELD = "mocap_time_length"

STEP_FIELDS = ("dt", "frame_time", "timestep", "time_step", "step_s")

STEPS = ((1e-3, 1.0, 1.0), (1.001, 1e3, 1e-3), (1.001e3, 1.5e5, 1e-6), (1.5e5, 1e6, 1e-7), (1.001e6, 1e9, 1e-9))
"""Least and greatest usual step of times without a unit, and the unit [s] that it implies: Windows counts tenths of a microsecond.
A step of 1 counts frames."""

SAME = 0.02
"""Relative difference up to which two rates are the same."""

LEAST_FRAMES = 3


def times_of(arrays: Arrays, frames: int) -> Times | None:
    """Times of the frames in a file of arrays, None if it has none; times of another number than the frames are warned of."""
    rate_name = arrays.first(*RATE_FIELDS, *STEP_FIELDS) or ""
    for name, unit in _time_fields(arrays):
        values = arrays.get(name)
        if values.dtype.kind == "M":
            values = values.astype("datetime64[ns]").astype(np.int64)
        if values.dtype.kind in "US":
            with suppress(ValueError):  # dates, or no times
                values = values.astype(np.float64)
        if values.size > 1 and values.size == max(values.shape) and values.dtype.kind in "fiu":
            if values.size == frames:
                unit_s = UNITS_S[unit.lower()] if unit else None
                return Times(values=values.ravel().astype(np.float64), name=name, unit_s=unit_s, rate_name=rate_name)
            warn(
                f"{arrays.path.name}: {name} has {values.size} entries for {frames} frames and is left unread; store one for each"
            )
    return None


def _time_fields(arrays: Arrays) -> list[tuple[str, str | None]]:
    """Names of the arrays that hold times, and the unit in each name, if any."""
    return [(name, match[1]) for name in arrays.texts if (match := TIME_FIELD.fullmatch(name))]


def stated_rate(arrays: Arrays, frames: int) -> float | None:
    """The rate [Hz] that was given, or that a file of arrays states; a warning where it states another one besides."""
    if arrays.given_hz is not None:
        return arrays.given_hz
    stated = {name: arrays.scalar(name) for name in RATE_FIELDS if name in arrays}
    stated |= {name: 1.0 / step for name in STEP_FIELDS if name in arrays and (step := arrays.scalar(name))}
    rates = {name: checked_rate(rate) for name, rate in stated.items() if rate is not None}
    length_s = arrays.scalar(LENGTH_FIELD) if LENGTH_FIELD in arrays else None
    if not rates:
        return tidy(frames / length_s) if length_s else None
    name, rate_hz = next(iter(rates.items()))
    if _time_fields(arrays):
        return rate_hz
    for other, rate in rates.items():
        if not same_rate(rate, rate_hz):
            warn_of_contradiction(f"{other} of {rate:g} Hz contradicts {name} of {rate_hz:g} Hz, which is taken", rate)
            return rate_hz
    if not length_s or length_s < 0 or abs(length_s * rate_hz - frames) <= max(2.0, SAME * frames):
        return rate_hz
    by_length_hz, contradiction = tidy(frames / length_s), f"{frames} frames at {name} of {rate_hz:g} Hz contradict"
    times = max(rate_hz, by_length_hz) / min(rate_hz, by_length_hz)
    if times > 1.5 and abs(times - round(times)) < SAME * times:  # every second frame left out, or doubled
        warn_of_contradiction(
            f"{contradiction} {LENGTH_FIELD} of {length_s:g} s, by which {by_length_hz:g} Hz are taken", rate_hz
        )
        return by_length_hz
    warn_of_contradiction(f"{contradiction} {LENGTH_FIELD} of {length_s:g} s; {rate_hz:g} Hz are taken", by_length_hz)
    return rate_hz


def on_clock(tracks: Tracks) -> Tracks:
    """Tracks on an even clock at the rate of their times: frames at uneven times are interpolated, lost frames are NaN."""
    times, frames = tracks.times, len(tracks)
    if times is None or len(times.values) != frames or frames < LEAST_FRAMES:
        return tracks
    stated_hz = None if tracks.rate_assumed else tracks.rate_hz
    if (np.diff(times.values) < 0).all():
        warn(
            f"its clock ({times.name}) runs backward: the frames are taken in the order of their times, the last one first; "
            "reverse the times if the frames stand in their own order"
        )
        tracks, times = tracks.at(np.arange(frames)[::-1]), replace(times, values=times.values[::-1])
    seconds, in_order = _seconds(times, stated_hz)
    if seconds is None:
        return tracks.saying(f"its clock ({times.name}) tells no rate")
    tracks = tracks.at(np.flatnonzero(in_order))
    lost = frames - len(seconds)
    clauses = [f"{lost} frame(s) left out whose {times.name} does not go on"] if not in_order.all() else []
    step_s, places = _grid(seconds)
    rate_hz = tidy(1.0 / step_s)
    if places is None:
        steps = np.diff(seconds)
        rate_hz = max(1.0, float(round(1.0 / steps[steps < 1.5 * step_s].mean())))
        clauses.append(f"frames {1e3 * steps.min():.3g} to {1e3 * steps.max():.3g} ms apart brought onto an even clock")
        tracks = _resampled(tracks, seconds, rate_hz)
    elif len(places) < places[-1] + 1:
        clauses.append(f"{places[-1] + 1 - len(places)} frame(s) lost by its {times.name}")
        tracks = _spread(tracks, places)
    if stated_hz is not None and not same_rate(rate_hz, stated_hz):
        chosen_clock = f"{times.name}, whose steps of {1e3 * step_s:.4g} ms are {rate_hz:g} Hz, which is taken"
        warn_of_contradiction(f"{times.rate_name} of {stated_hz:g} Hz contradicts {chosen_clock}", stated_hz)
    checked_rate(rate_hz)
    return replace(tracks, rate_hz=rate_hz, rate_assumed=False).saying(f"rate by its {times.name}", *clauses)


def warn_of_contradiction(sentence: str, other_hz: float) -> None:
    """Warns that two rates contradict each other, and says how to choose the other one."""
    warn(f"{sentence}; give rate_hz={other_hz:g} (--motion.rate_hz {other_hz:g}) if that is right")


def same_rate(rate_hz: float, other_hz: float) -> bool:
    """Whether two rates are the same but for the rounding in files."""
    return abs(rate_hz - other_hz) <= SAME * other_hz


def tidy(rate_hz: float, within: float = 5e-4) -> float:
    """The nearest whole number if the rate is within this part of it, else the rate: files round steps, 1/120 s to .0083333."""
    return float(round(rate_hz)) if abs(rate_hz - round(rate_hz)) < within * rate_hz else rate_hz


def _seconds(times: Times, stated_hz: float | None) -> tuple[np.ndarray | None, np.ndarray]:
    """Ascending times [s] and a mask (T,) of the frames that have them; None if the values are no times."""
    values = times.values - times.values[np.isfinite(times.values)][:1].sum()  # times since 1970 leave too few digits
    before = np.maximum.accumulate(np.concatenate([[-np.inf], np.nan_to_num(values, nan=-np.inf)[:-1]]))
    in_order = values > before
    ascending = values[in_order]
    if np.count_nonzero(values <= before) > 0.05 * len(values) and len(ascending) >= LEAST_FRAMES:
        # The digits are too few to tell neighbours apart, or these are no times.
        frames = np.arange(len(values))
        line = np.polyfit(frames, values, 1) if np.isfinite(values).all() else np.zeros(2)
        even = np.polyval(line, frames)
        coarse = line[0] > 0 and np.abs(values - even).max() <= np.diff(ascending).max()
        in_order, ascending = np.ones(len(values), bool), even if coarse else ascending[:0]
    if len(ascending) < LEAST_FRAMES:
        return None, in_order
    step = float(np.median(np.diff(ascending)))
    unit_s = times.unit_s
    if unit_s is None and stated_hz is not None:
        unit_s = next((unit for unit in (*UNITS_S.values(), 1e-7) if same_rate(1.0 / (step * unit), stated_hz)), None)
    if unit_s is None:
        unit_s = next((unit for low, high, unit in STEPS if low <= step < high), None)
    if unit_s is None or not 1e-4 < step * unit_s < 1.0:
        return None, in_order
    return ascending * unit_s, in_order


def _grid(seconds: np.ndarray) -> tuple[float, np.ndarray | None]:
    """Step of the clock [s], and the whole number of steps (T,) from the first frame to each, None if times are uneven."""
    frames, step_s = np.arange(len(seconds)), float(np.median(np.diff(seconds)))
    mean_s, start_s = np.polyfit(frames, seconds, 1).tolist()
    digit = next((10.0**-power for power in range(1, 10) if _whole(seconds * 10.0**power)), 0.0)
    # The error of the last digit, where times are rounded or cut.
    rounding = 0.55 * digit if digit < 0.99 * mean_s else 0.0
    # At 60 Hz, 0.05 steps put a walker's foot at 4 m/s 3 mm off.
    if np.abs(seconds - start_s - mean_s * frames).max() <= max(0.05 * mean_s, rounding):
        return mean_s, frames
    places = np.concatenate([[0], np.cumsum(np.maximum(1, np.round(np.diff(seconds) / step_s)))]).astype(int)
    step_s, start_s = np.polyfit(places, seconds, 1).tolist()
    even = np.abs(seconds - start_s - step_s * places).max() <= max(0.25 * step_s, rounding)
    if places[-1] > 100 * len(places):
        raise InputError(
            f"the times of the frames leap by {np.diff(seconds).max():.3g} s; repair them, or give rate_hz"
        )
    return step_s, places if even and places[-1] >= len(places) else None


def _whole(values: np.ndarray) -> bool:
    return bool((np.abs(values - np.round(values)) < 1e-3).all())


def _spread(tracks: Tracks, places: np.ndarray) -> Tracks:
    """Tracks with each frame at its place on the clock, and NaN between."""
    frames = np.arange(places[-1] + 1)
    before = np.searchsorted(places, frames, side="right") - 1
    return tracks.at(before).without(places[before] != frames)


def _resampled(tracks: Tracks, seconds: np.ndarray, rate_hz: float) -> Tracks:
    """Tracks at even times by cubic splines; NaN between frames that are more than two steps apart."""
    even = seconds[0] + np.arange(math.floor((seconds[-1] - seconds[0]) * rate_hz + 0.5) + 1) / rate_hz
    after = np.clip(np.searchsorted(seconds, even - 1e-3 / rate_hz), 1, len(seconds) - 1)
    near = np.minimum(np.abs(even - seconds[after]), np.abs(even - seconds[after - 1])) < 1e-2 / rate_hz
    lost = (seconds[after] - seconds[after - 1] > 2.0 / rate_hz) & ~near

    points = {name: _splined(track, seconds, even, lost) for name, track in tracks.points.items()}
    turned = {
        name: normalise(_splined(continuous(track), seconds, even, lost)) for name, track in tracks.turned.items()
    }
    return replace(tracks, points=points, turned=turned)


def _splined(track: np.ndarray, seconds: np.ndarray, even: np.ndarray, lost: np.ndarray) -> np.ndarray:
    """A track (K, N) at the times `even` (K,), splined from the track (T, N) of frames at `seconds` (T,).

    NaN where it is `lost` (K,), or where the frame before or after lacks the point.
    """
    from scipy.interpolate import make_interp_spline

    present = np.isfinite(track).all(axis=-1)
    if present.sum() < 2:
        return np.full((len(even), track.shape[1]), np.nan)
    spline = make_interp_spline(seconds[present], track[present], k=min(3, int(present.sum()) - 1))
    absent = np.interp(even, seconds, ~present) > 0
    return np.where((lost | absent)[:, None], np.nan, spline(np.minimum(even, seconds[-1])))
