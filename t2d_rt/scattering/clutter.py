"""Echoes of the static scene: mirrors' by Friis' equation, rough points' by the radar equation (docs/physics.md, eq. 26)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.scattering.antennas import seen_by
from t2d_rt.types import EchoArrays, EchoStream, Radar, StaticPath
from t2d_rt.types.path_fields import SweepNodes, received

Fractions = Callable[[np.ndarray], np.ndarray]
"""0..1 (K, N) at times [s] (K,)."""


def mirror_echoes(
    paths: Sequence[StaticPath], radar: Radar, *, times_s: np.ndarray, fractions: Fractions | None = None
) -> EchoStream:
    """One echo of each path at surface frames `times_s`, of which `fractions` are not occluded."""
    departure, arrival = (np.array([getattr(path, end) for path in paths]) for end in ("departure_m", "arrival_m"))
    length = np.linalg.norm(arrival - radar.rx_position_m, axis=1)
    gain = radar.tx_pattern.gain((departure - radar.tx_position_m) / length[:, None] @ radar.axes.T)
    gain = gain * radar.rx_pattern.gain((arrival - radar.rx_position_m) / length[:, None] @ radar.axes.T)
    # An echo of sigma / R^4 = 4 pi / L^2 is what Friis' equation gives.
    scale = radar.link_amplitude * math.sqrt(4 * math.pi) / length * np.sqrt(gain)
    nodes = SweepNodes.of(radar)
    value, slope = nodes.line(np.conj([received(path, nodes.frequencies_hz) for path in paths]).T)
    echoes = EchoArrays(
        delay_s=length / SPEED_OF_LIGHT, amplitude=scale * value, slope=scale * slope,
        departure_m=departure if radar.is_array else None, arrival_m=arrival if radar.is_array else None,
    )  # fmt: skip
    return _standing(echoes, times_s, fractions)


def rough_echoes(
    points_m: np.ndarray,
    rcs_m2: np.ndarray,
    radar: Radar,
    *,
    times_s: np.ndarray,
    seed: int,
    fractions: Fractions | None = None,
) -> EchoStream:
    """One echo of random phase of each point (Q, 3) at surface frames `times_s`, of which `fractions` are not occluded."""
    phase = 2 * math.pi * np.random.default_rng(seed).random(len(points_m))
    ranges = [np.linalg.norm(points_m - place, axis=1) for place in (radar.tx_position_m, radar.rx_position_m)]
    amplitude = radar.link_amplitude * np.sqrt(rcs_m2) / (ranges[0] * ranges[1]) * np.exp(1j * phase)
    echoes = EchoArrays(delay_s=(ranges[0] + ranges[1]) / SPEED_OF_LIGHT, amplitude=amplitude)
    return _standing(seen_by(radar, echoes, points_m), times_s, fractions)


def _standing(echoes: EchoArrays, times_s: np.ndarray, fractions: Fractions | None) -> EchoStream:
    """Constant echoes (N, ...) as a stream, times the fractions that are not occluded."""

    def frames(start: int, stop: int) -> EchoArrays:
        static = [None if field is None else np.broadcast_to(field, (stop - start, *field.shape)) for field in echoes]
        found = EchoArrays(*static)  # type: ignore[arg-type]
        unblocked = 1.0 if fractions is None else fractions(times_s[start:stop])
        return found._replace(
            amplitude=(found.amplitude * unblocked).astype(np.complex64),
            slope=None if found.slope is None else (found.slope * unblocked).astype(np.complex64),
            departure_m=None if found.departure_m is None else found.departure_m.astype(np.float32),
            arrival_m=None if found.arrival_m is None else found.arrival_m.astype(np.float32),
        )

    return EchoStream(times_s=times_s, frames=frames)
