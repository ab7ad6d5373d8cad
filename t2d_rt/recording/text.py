"""What an interpreter prints of a recording."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from t2d_rt.core.errors import printable
from t2d_rt.core.html_repr import html_table, size
from t2d_rt.types import Radar


def cube_size(shape: tuple[int, ...], radar: Radar) -> str:
    """Size and duration of a cube (chirp, antenna, sample)."""
    chirps, antennas, samples = shape
    last_s = float(radar.chirp_starts_s(chirps)[-1]) if chirps else 0.0
    plural = "" if antennas == 1 else "s"
    return f"{size(chirps)} chirps x {antennas} antenna{plural} x {samples} samples, {last_s:.2f} s"


def made_with(settings: Mapping[str, Any], *, measured: bool) -> str:
    """Method, scene, error and SNR, as far as the settings tell them; else whether the recording was measured."""
    known = [str(settings[name]) for name in ("method", "scene") if name in settings]
    if settings.get("error_db") is not None:
        known.append(f"measured error {settings['error_db']:.1f} dB")
    if (
        settings.get("snr_db") is not None and settings.get("noise_dbm") is not None
    ):  # earlier versions had one over white noise
        known.append(f"SNR {settings['snr_db']:.1f} dB")
    return printable(", ".join(known)) or ("measured" if measured else "simulated")


def at_a_glance(
    shape: tuple[int, ...], radar: Radar, settings: Mapping[str, Any], processing: Mapping[str, Any], *, measured: bool
) -> str:
    """The table that a notebook shows of a recording with a cube of that shape (chirp, antenna, sample)."""
    error = "not measured" if settings.get("error_db") is None else f"{settings['error_db']:.1f} dB"
    pictures = "plot(), plot_range_time(), plot_range_doppler(), view()"
    rows = [
        ("ADC cube", f"{cube_size(shape, radar)}, {8 * math.prod(shape) / 1e6:.4g} MB"),
        ("made with", made_with(settings, measured=measured)),
        ("error of the field", error),
        ("noise", noise_of(settings, measured=measured)),
        ("radar", repr(radar)),
        ("spectrogram", ", ".join(f"{name} {value}" for name, value in processing.items()) or "by default"),
        ("pictures", pictures),
    ]
    return html_table("Recording", rows)


def noise_of(settings: Mapping[str, Any], *, measured: bool) -> str:
    """Effects of the receiver, and the level of what they add."""
    if "noise" not in settings:
        return "as it was measured" if measured else "none"
    noise_dbm = settings.get("noise_dbm")
    return ", ".join([str(settings["noise"]), *([] if noise_dbm is None else [f"together {noise_dbm:.1f} dBm"])])
