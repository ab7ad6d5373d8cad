"""What the commands print, and the pictures that they write."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from t2d_rt.core.errors import InputError, printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from t2d_rt.recording.recording import Recording
    from t2d_rt.types import Radar


def say(text: object, *, file: TextIO | None = None) -> None:
    """Prints what may hold names and texts of a user's files: nothing in them reaches the terminal as a command to it."""
    print(printable(str(text)), file=file)


def check_picture(picture: Path, *, overwrite: bool) -> None:
    """Refuses a name for a picture that is no picture's, is taken, or cannot be written."""
    from t2d_rt.core.atomic_write import check_place

    if picture.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise InputError(f"a picture ends in .png, .pdf or .svg, got '{picture}'; choose another name")
    if picture.is_dir():
        raise InputError(f"{picture} is a folder; choose another name for the picture")
    check_place(picture, overwrite=overwrite)


def write_picture(figure: Figure, picture: Path, *, overwrite: bool) -> None:
    """Writes a figure whole or not at all."""
    from t2d_rt.core.atomic_write import check_taken, replacing

    with replacing(picture, lambda: check_taken(picture, overwrite=overwrite)) as new:
        figure.savefig(new)


def radar_info(radar: Radar) -> str:
    """What a radar resolves, a line for each figure."""
    rows = [
        ("mid-sweep frequency", f"{radar.mid_frequency_hz / 1e9:.4f} GHz"),
        ("bandwidth", f"{radar.bandwidth_hz / 1e9:.4f} GHz"),
        ("range bin", f"{radar.range_resolution_m * 100:.2f} cm"),
        ("farthest range", f"{radar.max_range_m:.2f} m"),
        ("unambiguous speed", f"+-{radar.max_speed_mps:.2f} m/s"),
        ("chirp rate", f"{radar.prf_hz:.6g} Hz"),
        ("antennas", f"{len(radar.tx_offsets_m)} x {len(radar.rx_offsets_m)} (tx x rx), {radar.multiplexing}"),
    ]
    return "\n".join(f"{name:22}{value}" for name, value in rows)


def recording_info(result: Recording) -> str:
    """What a result holds, a line for each setting."""
    rows = [
        ("adc", " x ".join(str(n) for n in result.cube.shape) + " (chirp, antenna, sample)"),
        *((name, str(value)) for name, value in result.settings.items()),
        ("versions", ", ".join(f"{name} {value}" for name, value in result.versions.items())),
    ]
    return radar_info(result.radar) + "\n" + "\n".join(f"{name:22}{value}" for name, value in rows)
