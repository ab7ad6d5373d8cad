"""Records for training a background: from a folder of recordings in which nobody moves, or from simulated empty rooms.

The default background is trained on simulated rooms with static clutter, receiver noise, and sometimes a fan, a curtain or a pet.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import file_path, integer, positive
from t2d_rt.core.errors import InputError
from t2d_rt.noise.background import BackgroundRecord, Grid
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.recording.read import load_recording
from t2d_rt.recording.recording import Recording
from t2d_rt.scene import CeilingFan, Curtain, Mover, Pet, TableFan
from t2d_rt.signal import spectrogram
from t2d_rt.simulate import simulate
from t2d_rt.types import MovingMesh, Radar, Scene

ENDINGS = ".npz", ".zarr", ".npy", ".bin"
RADAR_FILE = "radar.yaml"
MTI = "mean"
"""MTI filter of recordings that specify none: without a filter static clutter would dominate."""


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
    processing: options of `signal.spectrogram`, for all files but .npz; mti is "mean" unless given. For a .zarr folder they
        override the options stored in it.
    lanes: number of LVDS lanes of raw captures, 2 or 4.
    iq, conjugate: properties of measured samples, as in `load_recording`.
    """
    place = file_path("folder", folder)
    if not place.is_dir():
        raise InputError(f"{place} is not a folder; give one with recordings in which nobody moves")
    files = sorted(file for file in place.iterdir() if file.suffix.lower() in ENDINGS and file.name[0] != ".")
    if not files:
        raise InputError(f"{place} holds no recording; it must have files that end in {', '.join(ENDINGS)}")
    return [_record(file, dict(processing or {}), lanes, iq, conjugate) for file in files]


def record_of(recording: Recording, name: str, processing: Mapping[str, Any], *, calibrated: bool) -> BackgroundRecord:
    """The spectrogram of a recording as a record; its powers are in W if it is calibrated."""
    options = {"mti": MTI, **recording.processing, **processing}
    image = spectrogram(recording.cube, recording.radar, **options)
    grid = Grid.of_columns(image.velocity_mps, image.time_s)
    return BackgroundRecord.of(name, image.power, grid, carrier_hz=recording.radar.carrier_hz, calibrated=calibrated)


def _record(
    path: Path, processing: dict[str, Any], lanes: int | None, iq: str, conjugate: bool | None
) -> BackgroundRecord:
    """The record in a file, or made from the spectrogram of a recording."""
    ending = path.suffix.lower()
    if ending == ".npz":
        return BackgroundRecord.load(path)
    if ending == ".zarr":
        recording = load_recording(path)
        return record_of(recording, path.stem, processing, calibrated=recording.experiment is not None)
    own_radar, common_radar = path.with_suffix(".yaml"), path.with_name(RADAR_FILE)
    radar = own_radar if own_radar.is_file() else common_radar
    if not radar.is_file():
        raise InputError(
            f"{path} holds samples only, and there is neither {own_radar.name} nor {RADAR_FILE} with its radar; write one"
        )
    recording = load_recording(path, radar, lanes=lanes if ending == ".bin" else None, iq=iq, conjugate=conjugate)
    return record_of(recording, path.stem, processing, calibrated=False)


ROOMS = "living_room", "bedroom", "hospital_room", "corridor", "empty_room"
MOVERS = "fan", "ceiling_fan", "curtain", "pet"
MOVER_COUNTS = (0.1, 0.5, 0.4)
"""Probabilities of none, one or two movers in a room."""
FLICKER_CORNER_HZ = 50e3
"""Corner frequency of the receiver's 1/f noise [Hz]; an assumption, as receivers differ by decades."""
ACCURACY = {"occlusion": False, "clutter_occlusion": False, "sagitta_scale": 3.0}
"""A coarse accuracy, because a background model uses only powers, not phases."""


def empty_room_record(seed: int, *, duration_s: float = 5.0, radar: Radar | None = None) -> BackgroundRecord:
    """The spectrogram of a simulated empty room, with the `table2` radar by default; room, movers and noise depend only on the
    seed."""
    recording = empty_room(seed, duration_s=duration_s, radar=radar)
    return record_of(recording, f"room_{seed:04d}", {}, calibrated=True)


def empty_room(seed: int, *, duration_s: float = 5.0, radar: Radar | None = None) -> Recording:
    """A recording of an empty room with receiver noise."""
    rng = np.random.default_rng(integer("seed", seed))
    duration_s = positive("duration_s", duration_s, 3600, unit="s")
    radar = Radar.preset("table2") if radar is None else radar
    scene = load_scene(ROOMS[rng.integers(len(ROOMS))])
    movers = movers_of(scene, rng)
    targets = [mover.mesh(0, duration_s) for mover in movers] or [_static(duration_s)]
    recording = simulate(
        targets,
        radar=radar,
        scene=scene,
        reflections=0,
        collisions="ignore",
        accuracy=ACCURACY,
        seed=seed,
        measure_error=False,
    )
    cube = np.asarray(recording.cube) + receiver_noise(recording.cube.shape, radar, rng)
    settings = {**recording.settings, "movers": [mover.model_dump(mode="json") for mover in movers]}
    return Recording(cube, radar, settings=settings, versions=recording.versions)


def receiver_noise(shape: tuple[int, ...], radar: Radar, rng: np.random.Generator) -> np.ndarray:
    """Receiver noise (chirp, antenna, sample), complex64 [sqrt(W)]: thermal noise of `Radar.noise_power_w`, and the part of the 1/f
    noise that is slower than a chirp.

    With N0 the thermal density, 1/f noise has the density N0 f_c / |f|. Its slow part is the same for all samples of a chirp; it is
    drawn by its spectrum over the chirps, up to half the chirp rate.
    """
    chirps, antennas, samples = shape
    parts = (rng.standard_normal((chirps, antennas, 2 * samples), np.float32)).view(np.complex64)
    noise = parts * np.float32(np.sqrt(radar.noise_power_w / 2))
    frequency = np.fft.fftfreq(chirps, radar.loop_interval_s)
    frequency[0] = np.inf  # no DC component
    density = radar.noise_power_w / radar.sample_rate_hz * FLICKER_CORNER_HZ / np.abs(frequency)
    step_hz = 1 / (chirps * radar.loop_interval_s)
    white_noise = rng.standard_normal((chirps, antennas, 2)).view(np.complex128)[..., 0]
    flicker = np.fft.ifft(white_noise * np.sqrt(density * step_hz / 2)[:, None], axis=0) * chirps
    return noise + flicker.astype(np.complex64)[:, :, None]


def movers_of(scene: Scene, rng: np.random.Generator) -> list[Mover]:
    """None, one or two random movers in front of the radar, inside the room; pets are at least 2.5 m away."""
    count = int(rng.choice(len(MOVER_COUNTS), p=MOVER_COUNTS))
    kinds = rng.choice(MOVERS, size=count, replace=False)
    return [_mover(str(kind), np.asarray(scene.bounds_m), rng) for kind in kinds]


def _static(duration_s: float) -> MovingMesh:
    """A stand-in for targets in a room without any: a tetrahedron of 1 cm on the floor."""
    corners = np.array([[0.0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1]]) / 100 + [2.0, 0, 0.01]
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    return MovingMesh(np.stack([corners, corners]), faces, np.array([0.0, duration_s]), "wood")


def _mover(kind: str, bounds: np.ndarray, rng: np.random.Generator) -> Mover:
    """A mover at a random place within the room's corners (2, 3) m; the order of the draws must not change, as results depend on
    it."""
    (_, low_y, _), (far_x, high_y, top) = bounds
    y = float(rng.uniform(0.7 * low_y, 0.7 * high_y))
    seed = int(rng.integers(2**31))
    if kind == "fan":
        return TableFan(
            position_m=(float(rng.uniform(1.5, far_x - 0.5)), y, float(rng.uniform(0.8, 1.3))),
            heading_deg=float(rng.uniform(90, 270)),
            rpm=float(rng.uniform(150, 420)),
            swing_deg=float(rng.choice([0.0, 80.0])),
        )
    if kind == "ceiling_fan":
        return CeilingFan(
            position_m=(float(rng.uniform(1.5, far_x - 1)), 0.0, top - 0.3), rpm=float(rng.uniform(60, 120))
        )
    if kind == "curtain":
        draught_m = float(rng.uniform(0.02, 0.1))
        return Curtain(position_m=(far_x - 0.15, y, top - 0.2), draught_m=draught_m, seed=seed)
    animal, radius_m = (("dog", 1.1), ("cat", 0.5))[int(rng.integers(2))]
    return Pet(
        animal=animal,
        position_m=(float(rng.uniform(2.5, max(2.6, far_x - 1))), y, 0.0),
        heading_deg=float(rng.uniform(0, 360)),
        speed_mps=float(rng.uniform(0.4, 0.8)),
        turn_radius_m=radius_m * float(rng.uniform(1, 1.5)),
    )
