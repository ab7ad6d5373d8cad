"""`Echoes`: what every scattering model returns. `radar.synthesize` alone turns them into chirps."""

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
    """Echoes of N scatterers at T surface frames.

    Between frames the amplitude (and its slope) is a cubic through four frames (Catmull-Rom: the derivative at a frame is the
    central difference, one-sided at the ends), the delay a C2 cubic spline (physics.md, eq. 14).
    """

    times_s: np.ndarray
    """Frame times [s], uniform, float64 (T,)."""
    delay_s: np.ndarray
    """Round-trip delay [s], float64 (T, N)."""
    amplitude: np.ndarray
    """Complex field at mid-sweep [sqrt(W) at the ADC], complex64 (T, N), without exp(j 2 pi f_c tau); |amplitude|^2 is received
    power. With `slope`, the value at mid-sweep of a straight line over frequency."""
    slope: np.ndarray | None = None
    """d amplitude / d frequency [sqrt(W)/Hz], complex64 (T, N); None where the amplitude is flat over the sweep."""
    departure_m: np.ndarray | None = None
    """Apparent positions of the echoes as seen by the transmitters [m], world, float32 (T, N, 3). From them follows how the delay
    differs from one antenna of an array to the next; `delay_s` is that of the arrays' centres. None means far away on the
    boresight, where all antennas see the same delay."""
    arrival_m: np.ndarray | None = None
    """Apparent positions as seen by the receivers [m], (T, N, 3); None means those seen by the transmitters."""

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
    """A finite array of `dtype`; refuses complex numbers unless `dtype` is complex."""
    numbers = numeric(name, value)
    if np.iscomplexobj(numbers) and dtype is not np.complex64:
        raise InputError(f"{name} must hold real numbers, got {numbers.dtype}")
    # Larger numbers become infinite here and are then refused: single precision ends at 3.4e38.
    if not np.isfinite(numbers).all() or not (numbers.size == 0 or np.abs(numbers).max() < 1e30):
        raise InputError(f"{name} must be finite, got NaN or infinite values")
    return np.asarray(numbers, dtype)


class EchoArrays(NamedTuple):
    """The arrays of `Echoes` for some of the frames."""

    delay_s: np.ndarray
    amplitude: np.ndarray
    slope: np.ndarray | None = None
    departure_m: np.ndarray | None = None
    arrival_m: np.ndarray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Repetition:
    """How the echoes of a few periods of a rotation stand for those of the whole record (`radar.repetition`)."""

    period_s: float
    span_s: tuple[float, float]
    """First and last instant of the whole record [s]."""
    radar: Radar
    """The radar with another PRF: its chirps in a few periods fall on equally spaced phases of the period."""
    first: int
    """Index of its first chirp that is used; chirps before it only serve to begin the splines."""
    rows: int
    """Number of chirps that are used."""
    periods: int
    """Number of periods in which these chirps lie; it has no common divisor with their number."""
    gain: Callable[[np.ndarray], np.ndarray] | None = None
    """Factor (K,) on the field at times [s] (K,), such as the visibility of the whole target; None is 1."""

    @property
    def step_s(self) -> float:
        """Time from one chirp to the next [s]."""
        return self.periods * self.period_s / self.rows
