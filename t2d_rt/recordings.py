"""Recordings from files, simulated or measured."""

from __future__ import annotations

from pathlib import Path

from t2d_rt.checks import file_path
from t2d_rt.errors import InputError
from t2d_rt.named import radar_named
from t2d_rt.result import Recording
from t2d_rt.signal import load_cube
from t2d_rt.signal.dca1000 import load_dca1000
from t2d_rt.types import Radar


def load_recording(path: str | Path, radar: Radar | str | Path | None = None, *, lanes: int | None = None) -> Recording:
    """A recording, simulated or measured: the .zarr folder of a result, or a .npy or .bin file of measured ADC samples.

    radar: of a .npy or .bin file, which holds samples only: a `Radar`, a preset's name or a .yaml file. A result holds its own.
    lanes: LVDS lanes, 2 or 4, of a raw capture of TI's DCA1000 (.bin); see `signal.load_dca1000`.

    Samples of a .npy file are complex, (chirp, sample) or (chirp, antenna, sample); see `signal.load_cube`. Levels of a measured
    recording are those of its samples: they are powers [dB re 1 W] only where the samples are calibrated to sqrt(W).
    """
    source = file_path("path", path)
    if source.is_dir() or source.suffix.lower() == ".zarr":
        if radar is not None:
            raise InputError(f"{source} is a result, which holds its own radar, and a radar was given; leave radar out")
        return Recording.load(source)
    raw = source.suffix.lower() == ".bin"
    if raw != (lanes is not None):
        raise InputError(
            f"{source} is a raw capture; give its LVDS lanes, lanes=2 (xWR16xx, 18xx, 68xx) or lanes=4 (xWR12xx, 14xx)"
            if raw
            else f"lanes are those of a raw capture (.bin), got {source}; leave them out"
        )
    if lanes is not None and radar is not None:
        known = radar_named(radar)
        return Recording(load_dca1000(source, known, lanes=lanes), known)
    cube = None if raw else load_cube(source)
    if radar is None or cube is None:
        raise InputError(f"{source} holds samples only; give its radar, a Radar, a preset's name or a .yaml file")
    return Recording(cube, radar_named(radar))
