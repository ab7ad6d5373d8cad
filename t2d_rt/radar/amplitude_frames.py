"""Amplitudes of echoes between frames: cubics, made by the kernels that read them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.core.backend import Backend, aligned_empty, one_thread_at_a_time
from t2d_rt.radar.interpolants import hermite
from t2d_rt.radar.sweep import Sweep
from t2d_rt.radar.windows import Window


def cubic(frames: list[Any], scale: Any | None) -> list[Any]:
    """Between the second and the third of four frames, times a factor where there is one."""
    middle = 0.5 * (frames[2] - frames[0]), 0.5 * (frames[3] - frames[1])
    return [c if scale is None else c * scale for c in hermite(frames[1], frames[2], *middle)]


@dataclass(frozen=True, slots=True)
class AmplitudeFrames:
    """Amplitudes at the frames, as kernels read them that make the cubics of `amplitudes` themselves."""

    parts: list[tuple[Any, Any | None]]
    """Flat float32 (echo, frame, 2) on the device and the factor on the cubics, of the amplitude and of its slope."""
    frames: Any
    """n + 5."""
    pair: Any
    """Type of two numbers that are read together."""

    @classmethod
    @one_thread_at_a_time
    def of(cls, window: Window, sweep: Sweep, backend: Backend) -> AmplitudeFrames:
        """Of a window."""
        import drjit as dr

        half_band = dr.opaque(backend.Float32, sweep.slope * sweep.half_time_s)
        # Neighbouring lanes are neighbouring intervals of one echo.
        parts = [
            (_by_echo(values, backend), scale)
            for values, scale in ((window.amplitude, None), (window.sweep, half_band))
            if values is not None
        ]
        return cls(parts, dr.opaque(backend.UInt32, len(window.amplitude)), backend.arrays.Array2f)

    def cubics(self, echo: Any, interval: Any) -> list[list[Any]]:
        """As `amplitudes` has them, of echoes in an interval."""
        import drjit as dr

        place = echo * self.frames + interval
        found = []
        for values, scale in self.parts:
            frames = [dr.gather(self.pair, values, place + k) for k in range(4)]
            found += [cubic([each[part] for each in frames], scale) for part in range(2)]
        return found


def _by_echo(values: np.ndarray, backend: Backend) -> Any:
    """Complex64 values (T, N) as flat Float32 (N, T, 2) on the device."""
    flat = aligned_empty(values.size, np.complex64)
    flat.reshape(values.shape[::-1])[:] = values.T
    return backend.Float32(flat.view(np.float32))
