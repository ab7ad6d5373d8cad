"""Reads recordings, simulated or measured, from files."""

from __future__ import annotations

from pathlib import Path

from t2d_rt.core.checks import choice, file_path, flag, instance
from t2d_rt.core.errors import InputError
from t2d_rt.experiment.catalog import radar_named
from t2d_rt.recording.recording import Recording
from t2d_rt.signal import load_cube
from t2d_rt.signal.measured import ORDERS, load_dca1000, warn_of_mirror, warn_of_period
from t2d_rt.types import Radar


def load_recording(
    path: str | Path,
    radar: Radar | str | Path | None = None,
    *,
    lanes: int | None = None,
    iq: str = "IQ",
    conjugate: bool | None = None,
) -> Recording:
    """A recording, simulated or measured: the .zarr folder of a result, or a .npy or .bin file of measured ADC samples.

    radar: the radar of a .npy or .bin file, which holds samples only: a `Radar`, a preset's name, a .yaml or a .cfg file. A .zarr
        folder contains its radar.
    lanes: number of LVDS lanes, 2 or 4, of a raw capture of TI's DCA1000 (.bin); see `signal.load_dca1000`.
    iq: "QI" if measured samples have Q before I, "I" if they are real: their beat frequencies are then taken as positive.
    conjugate: whether their IF is the conjugate of the one here, which has positive beat frequencies. Left out, it is not, and
        there is a warning if samples look conjugated, with most power in the upper half of the range axis.

    Samples of a .npy file are (chirp, sample) or (chirp, antenna, sample); see `signal.load_cube`. Large files are read when used.
    Levels of a measured recording are those of its samples: powers [dB re 1 W] only where these are calibrated to sqrt(W).
    """
    source = file_path("path", path)
    choice("iq", iq, ORDERS)
    mirrored = False if conjugate is None else flag("conjugate", conjugate)
    if source.is_dir() or source.suffix.lower() == ".zarr":
        if radar is not None:
            raise InputError(f"{source} is a result, which holds its own radar, and a radar was given; leave radar out")
        if lanes is not None or iq != "IQ" or conjugate is not None:
            raise InputError(
                f"lanes, iq and conjugate are those of measured samples, and {source} is a result; leave them out"
            )
        return Recording.load(source)
    if not source.exists():
        raise InputError(
            f"cannot read recording {source}: there is none of that name; give the .zarr folder that simulate wrote, or measured "
            "samples (.npy, or .bin of a DCA1000)"
        )
    if source.name.lower().endswith((".bvh", ".bvh.gz", ".c3d", ".trc", ".amc")):
        raise InputError(
            f"{source} is a motion, not a recording; simulate it first (t2d-rt simulate {source.name} -o a.zarr)"
        )
    raw = source.suffix.lower() == ".bin"
    if raw != (lanes is not None):
        raise InputError(
            f"{source} is a raw capture; give its LVDS lanes, lanes=2 (xWR16xx, 18xx, 68xx) or lanes=4 (xWR12xx, 14xx)"
            if raw
            else f"lanes are those of a raw capture (.bin), got {source}; leave them out"
        )
    if radar is None:
        raise InputError(
            f"{source} holds samples only; give its radar, a Radar, a preset's name, a .yaml or a .cfg file"
        )
    measuring_radar = radar_named(radar)
    instance("radar", measuring_radar, Radar, "a Radar", hint="Radar.preset('table2') makes one")
    if lanes is not None:
        cube = load_dca1000(source, measuring_radar, lanes=lanes, iq=iq, conjugate=mirrored)
    else:
        cube = load_cube(source, iq=iq, conjugate=mirrored)
    recording = Recording(cube, measuring_radar)
    warn_of_period(cube, measuring_radar, source)
    if conjugate is None:
        warn_of_mirror(cube, source, iq)
    return recording
