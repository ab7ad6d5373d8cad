"""`Echoes`: what every scattering model returns and `radar.synthesize` alone turns into chirps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from t2d_rt.core.checks import check_shape, numeric
from t2d_rt.core.errors import InputError
from t2d_rt.types.radar import Radar

KINDS: dict[str, Any] = {
    "times_s": float,
    "delay_s": float,
    "amplitude": np.complex64,
    "slope": np.complex64,
    "departure_m": np.float32,
    "arrival_m": np.float32,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Echoes:
    """Returns of N scatterers at T surface frames.

    Between frames the amplitude (and its slope) is a cubic through four frames (Catmull-Rom: the derivative at a frame
    is the central difference, one-sided at the ends), the delay a C2 cubic spline (physics.md, eq. 14).
    """

    times_s: np.ndarray
    """Frame times [s], uniform, float64 (T,)."""
    delay_s: np.ndarray
    """Round-trip delay [s], float64 (T, N)."""
    amplitude: np.ndarray
    """Field at mid-sweep, or with `slope` the line's value there [sqrt(W) at the ADC], complex64 (T, N), without
    exp(j 2 pi f_c tau); |amplitude|^2 is received power."""
    slope: np.ndarray | None = None
    """d amplitude / d frequency [sqrt(W)/Hz], complex64 (T, N); None where the amplitude is flat over the sweep."""
    departure_m: np.ndarray | None = None
    """Apparent positions of the echoes as seen by the transmitters [m], world, float32 (T, N, 3): they say how the delay
    differs from one antenna of an array to the next; `delay_s` is that of the arrays' centres. None: far away on the
    boresight, where all antennas see the same delay."""
    arrival_m: np.ndarray | None = None
    """Apparent positions as seen by the receivers; None: the same as by the transmitters."""

    def __post_init__(self) -> None:
        for name, dtype in KINDS.items():
            if (value := getattr(self, name)) is not None or name in ("times_s", "delay_s", "amplitude"):
                object.__setattr__(self, name, _checked(f"{name} of echoes", value, dtype))
        check_shape("times_s of echoes", self.times_s, ("time",))
        frames = len(self.times_s)
        if self.delay_s.ndim != 2 or self.delay_s.shape[0] != frames:
            raise InputError(f"delay_s must have shape ({frames}, scatterer), got {self.delay_s.shape}")
        for name in ("amplitude", "slope"):
            if (values := getattr(self, name)) is not None and values.shape != self.delay_s.shape:
                raise InputError(f"{name} must have the delay's shape {self.delay_s.shape}, got {values.shape}")
        for name in ("departure_m", "arrival_m"):
            if (points := getattr(self, name)) is not None and points.shape != (*self.delay_s.shape, 3):
                raise InputError(f"{name} must have shape {(*self.delay_s.shape, 3)}, got {points.shape}")
        if frames < 4:
            raise InputError(f"echoes need at least 4 frames to interpolate, got {frames}; raise the surface rate")
        steps = np.diff(self.times_s)
        if not (steps > 0).all() or np.ptp(steps) > 1e-6 * steps.mean():
            raise InputError("times_s must be uniform and increasing")

    @property
    def rate_hz(self) -> float:
        """Surface rate: frames per second [Hz]."""
        return (len(self.times_s) - 1) / float(self.times_s[-1] - self.times_s[0])


def _checked(name: str, value: Any, dtype: Any) -> np.ndarray:
    """Finite numbers as `dtype`; complex ones only where that is complex."""
    numbers = numeric(name, value)
    if np.iscomplexobj(numbers) and dtype is not np.complex64:
        raise InputError(f"{name} must hold real numbers, got {numbers.dtype}")
    # Larger ones are refused as infinite: single precision ends at 3.4e38.
    if not np.isfinite(numbers).all() or not (numbers.size == 0 or np.abs(numbers).max() < 1e30):
        raise InputError(f"{name} must be finite, got NaN or infinite values")
    return np.asarray(numbers, dtype)


class EchoArrays(NamedTuple):
    """The arrays of `Echoes` for some of its frames."""

    delay_s: np.ndarray
    amplitude: np.ndarray
    slope: np.ndarray | None = None
    departure_m: np.ndarray | None = None
    arrival_m: np.ndarray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Repetition:
    """How echoes of a few periods stand for those of a whole record."""

    period_s: float
    span_s: tuple[float, float]
    """The record."""
    radar: Radar
    """The radar with another PRF, whose chirps over some periods begin at equal steps of one period."""
    first: int
    """Row of its first chirp that is used; before it the record of the echoes begins."""
    rows: int
    """Number of rows that are used."""
    periods: int
    """Number of periods that these rows are of, coprime with theirs."""
    gain: Callable[[np.ndarray], np.ndarray] | None = None
    """Factor (K,) on the field at times [s] (K,); None is 1."""

    @property
    def step_s(self) -> float:
        """Time from one row to the next [s]."""
        return self.periods * self.period_s / self.rows
