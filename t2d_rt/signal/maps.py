"""Results of the signal processing: arrays with their axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeProfile:
    """Complex range profile of every chirp."""

    profile: np.ndarray
    """Range profiles [sqrt(W)], complex (chirp, antenna, range) or (chirp, range)."""
    range_m: np.ndarray
    time_s: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class Spectrogram:
    """Micro-Doppler spectrogram: power by radial speed and time."""

    power: np.ndarray
    """Power [W], (velocity, time)."""
    velocity_mps: np.ndarray
    """Speeds [m/s], ascending, positive = approaching, (velocity,)."""
    time_s: np.ndarray
    """Centres of the windows [s], (time,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeDoppler:
    """Range-Doppler map of one coherent interval."""

    power: np.ndarray
    """Power [W], (velocity, range)."""
    velocity_mps: np.ndarray
    """Speeds [m/s], ascending, positive = approaching, (velocity,)."""
    range_m: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeTime:
    """Power over range and time."""

    power: np.ndarray
    """Power [W], (range, time)."""
    range_m: np.ndarray
    time_s: np.ndarray
    """Centres of the windows [s], (time,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ArraySpectrum:
    """Range-Doppler spectra of all virtual antennas over one coherent interval."""

    spectrum: np.ndarray
    """Spectra [sqrt(W)], complex (velocity, antenna, range)."""
    velocity_mps: np.ndarray
    """Speeds [m/s], ascending, positive = approaching, (velocity,)."""
    range_m: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeAngle:
    """Range-azimuth map of one coherent interval."""

    power: np.ndarray
    """Power [W], (range, azimuth)."""
    range_m: np.ndarray
    azimuth_rad: np.ndarray
    """Azimuths [rad], positive to the left, (azimuth,)."""

    def __repr__(self) -> str:
        size = f"{len(self.range_m)} ranges x {len(self.azimuth_rad)} azimuths"
        return f"RangeAngle({size}, {_span(self.range_m)} m, {_span(np.degrees(self.azimuth_rad))} deg)"


@dataclass(frozen=True, slots=True, kw_only=True)
class PointCloud:
    """Detected points, each field (point,), frame after frame."""

    time_s: np.ndarray
    """Centre of the frame in which each point was detected [s]."""
    range_m: np.ndarray
    azimuth_rad: np.ndarray
    """Azimuths [rad], positive to the left."""
    elevation_rad: np.ndarray
    """Elevations [rad], positive upwards."""
    speed_mps: np.ndarray
    """Speeds [m/s], positive = approaching."""
    snr_db: np.ndarray
    """Power of the peak cell, averaged over the antennas, relative to the noise level of the cells near it [dB]."""
    nearest_m: float = 0.0
    """Range below which points were left out [m]."""

    def __repr__(self) -> str:
        if not len(self.time_s):
            return "PointCloud(no points)"
        spans = f"{_span(self.range_m)} m, {_span(self.speed_mps)} m/s, {_span(self.time_s)} s"
        return f"PointCloud({len(self.time_s)} points, {spans})"

    @property
    def xyz_m(self) -> np.ndarray:
        """Positions relative to the radar in its frame [m]: x boresight, y left, z up, (point, 3)."""
        level = self.range_m * np.cos(self.elevation_rad)
        return np.stack(
            [
                level * np.cos(self.azimuth_rad),
                level * np.sin(self.azimuth_rad),
                self.range_m * np.sin(self.elevation_rad),
            ],
            axis=-1,
        )


def _span(values: np.ndarray) -> str:
    """Least and greatest value, as text."""
    return f"{np.min(values):.2f} to {np.max(values):.2f}"
