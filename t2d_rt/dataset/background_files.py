"""Folders of recordings in which nobody moves, as records that a background is learned from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from t2d_rt.core.checks import file_path
from t2d_rt.core.errors import InputError
from t2d_rt.noise.background import BackgroundRecord, Grid
from t2d_rt.recording.read import load_recording
from t2d_rt.recording.recording import Recording
from t2d_rt.signal import spectrogram

ENDINGS = ".npz", ".zarr", ".npy", ".bin"
RADAR_FILE = "radar.yaml"
MTI = "mean"
"""Of recordings that say nothing else: an unfiltered one shows little but its static clutter."""


def background_records(
    folder: str | Path,
    *,
    processing: Mapping[str, Any] | None = None,
    lanes: int | None = None,
    iq: str = "IQ",
    conjugate: bool | None = None,
) -> list[BackgroundRecord]:
    """The records of a folder, in the order of their names.

    folder: holds .npz (records that t2d-rt background simulate writes), .zarr (results), .npy (ADC samples) or .bin (raw captures
        of TI's DCA1000). The radar of NAME.npy or NAME.bin is in NAME.yaml or, for all of them, in radar.yaml.
    processing: options of `signal.spectrogram`, of all but .npz; mti is "mean" unless given. Of a .zarr they change its own.
    lanes: LVDS lanes of raw captures, 2 or 4. iq, conjugate: of measured samples, as of `load_recording`.
    """
    place = file_path("folder", folder)
    if not place.is_dir():
        raise InputError(f"{place} is not a folder; give one with recordings in which nobody moves")
    files = sorted(each for each in place.iterdir() if each.suffix.lower() in ENDINGS and each.name[0] != ".")
    if not files:
        raise InputError(f"{place} holds no recording; it must have files that end in {', '.join(ENDINGS)}")
    return [_record(each, dict(processing or {}), lanes, iq, conjugate) for each in files]


def record_of(recording: Recording, name: str, processing: Mapping[str, Any]) -> BackgroundRecord:
    """The spectrogram of a recording as a record; powers are in W where the recording was simulated."""
    options = {"mti": MTI, **recording.processing, **processing}
    image = spectrogram(recording.cube, recording.radar, **options)
    return BackgroundRecord.of(
        name, image.power, Grid.of_columns(image.velocity_mps, image.time_s), carrier_hz=recording.radar.carrier_hz,
        calibrated=recording.experiment is not None,
    )  # fmt: skip


def _record(
    path: Path, processing: dict[str, Any], lanes: int | None, iq: str, conjugate: bool | None
) -> BackgroundRecord:
    ending = path.suffix.lower()
    if ending == ".npz":
        return BackgroundRecord.load(path)
    if ending == ".zarr":
        return record_of(load_recording(path), path.stem, processing)
    own, common = path.with_suffix(".yaml"), path.with_name(RADAR_FILE)
    radar = own if own.is_file() else common
    if not radar.is_file():
        raise InputError(
            f"{path} holds samples only, and there is neither {own.name} nor {RADAR_FILE} with its radar; write one"
        )
    recording = load_recording(path, radar, lanes=lanes if ending == ".bin" else None, iq=iq, conjugate=conjugate)
    return record_of(recording, path.stem, processing)
