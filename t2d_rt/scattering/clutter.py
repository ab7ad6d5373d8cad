"""Echoes of the static scene: of mirrors by Friis' equation, of rough surfaces by the radar equation (docs/physics.md, eq. 26)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from typing_extensions import override

from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.scattering.antennas import seen_by
from t2d_rt.types import EchoArrays, Radar, StaticPath
from t2d_rt.types.path_fields import SweepNodes, received
from t2d_rt.types.scatterer import EchoLabels, Fraction, FrameBlock, Poses, Scatterer, Visibility

StaticEchoes = EchoArrays | Callable[[np.ndarray], EchoArrays]
"""Echoes of N paths as arrays (N, ...), or a function that gives them as arrays (T, N, ...) at times (T,) [s]."""


def mirror_echoes(
    paths: Sequence[StaticPath], radar: Radar, *, times_s: np.ndarray, fractions: Fraction | None = None
) -> StaticScatterer:
    """One echo for each path at surface frames `times_s` (T,) [s], times the fraction of its field that targets do not occlude."""
    moves = any(path.at is not None for path in paths)
    echoes = partial(_mirrored, paths, radar) if moves else _mirrored(paths, radar)
    return _standing(echoes, times_s, fractions, [path.name for path in paths])


def _mirrored(paths: Sequence[StaticPath], radar: Radar, times_s: np.ndarray | None = None) -> EchoArrays:
    """Echoes of N paths as arrays (N,), or as arrays (T, N) at times (T,) [s] of a radar that moves."""
    if times_s is not None:
        paths = [path if path.at is None else path.at(times_s) for path in paths]
    departure, arrival = (
        np.stack([getattr(path, end) for path in paths], axis=-2) for end in ("departure_m", "arrival_m")
    )
    length = np.linalg.norm(arrival - radar.rx_position_m, axis=-1)
    gain = radar.tx_pattern.gain((departure - radar.tx_position_m) / length[..., None] @ radar.axes.T)
    gain = gain * radar.rx_pattern.gain((arrival - radar.rx_position_m) / length[..., None] @ radar.axes.T)
    # An echo of sigma / R^4 = 4 pi / L^2 is what Friis' equation gives.
    scale = radar.link_amplitude * math.sqrt(4 * math.pi) / length * np.sqrt(gain)
    nodes = SweepNodes.of(radar)
    spectra = np.conj([received(path, nodes.frequencies_hz) for path in paths])
    value, slope = nodes.line(np.moveaxis(spectra, 0, -1))
    return _with_single_places(
        EchoArrays(
            delay_s=length / SPEED_OF_LIGHT,
            amplitude=scale * value,
            slope=scale * slope,
            departure_m=departure if radar.is_array else None,
            arrival_m=arrival if radar.is_array else None,
        )
    )


def rough_echoes(
    points_m: np.ndarray,
    rcs_m2: np.ndarray,
    radar: Radar,
    *,
    times_s: np.ndarray,
    seed: int,
    fractions: Fraction | None = None,
) -> StaticScatterer:
    """One echo of random phase for each point (Q, 3) [m] with RCS (Q,) [m^2] at surface frames `times_s` (T,) [s], times the
    fraction of its field that targets do not occlude."""
    phase = 2 * math.pi * np.random.default_rng(seed).random(len(points_m))
    ranges = [np.linalg.norm(points_m - place, axis=1) for place in (radar.tx_position_m, radar.rx_position_m)]
    amplitude = radar.link_amplitude * np.sqrt(rcs_m2) / (ranges[0] * ranges[1]) * np.exp(1j * phase)
    echoes = EchoArrays(delay_s=(ranges[0] + ranges[1]) / SPEED_OF_LIGHT, amplitude=amplitude)
    echoes = _with_single_places(seen_by(radar, echoes, points_m))
    return _standing(echoes, times_s, fractions, ["rough wall"] * len(points_m))


def _with_single_places(echoes: EchoArrays) -> EchoArrays:
    return echoes._replace(
        departure_m=None if echoes.departure_m is None else echoes.departure_m.astype(np.float32),
        arrival_m=None if echoes.arrival_m is None else echoes.arrival_m.astype(np.float32),
    )


def _standing(
    echoes: StaticEchoes, times_s: np.ndarray, fractions: Fraction | None, names: Sequence[str]
) -> StaticScatterer:
    return StaticScatterer(times_s=times_s, static=echoes, unblocked=fractions, names=names, echoes=len(names))


@dataclass(frozen=True, kw_only=True, eq=False)
class StaticScatterer(Scatterer):
    """Echoes of the static scene, times the fractions that targets do not occlude."""

    static: StaticEchoes
    """The echoes without occlusion; for a radar that moves, a function of the times."""
    unblocked: Fraction | None
    """Fractions of the fields that targets do not occlude, (K, N); None: nothing is occluded."""
    names: Sequence[str]
    """Names of the paths, (N,)."""

    @property
    @override
    def labels(self) -> EchoLabels:
        return EchoLabels.of(self.echoes, path=self.names, bounces=0)

    @property
    @override
    def fractions(self) -> Iterable[Fraction]:
        return () if self.unblocked is None else (self.unblocked,)

    @override
    def scatter(self, block: FrameBlock, poses: Poses, seen: Visibility) -> EchoArrays:
        if callable(self.static):
            echoes = self.static(block.times_s)
        else:
            shape = block.last - block.first
            static = [None if array is None else np.broadcast_to(array, (shape, *array.shape)) for array in self.static]
            echoes = EchoArrays(*static)  # type: ignore[arg-type]
        unblocked = 1.0 if self.unblocked is None else seen[self.unblocked]
        return echoes._replace(
            amplitude=(echoes.amplitude * unblocked).astype(np.complex64),
            slope=None if echoes.slope is None else (echoes.slope * unblocked).astype(np.complex64),
        )
