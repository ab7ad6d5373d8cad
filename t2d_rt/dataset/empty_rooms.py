"""Empty rooms that are simulated: static clutter, receiver noise, and now and then a fan, a curtain or a pet.

The default background is learned from their spectrograms.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from t2d_rt.core.checks import integer, positive
from t2d_rt.noise.background.records import BackgroundRecord, Grid
from t2d_rt.propagation.scenes import load_scene
from t2d_rt.recording.recording import Recording
from t2d_rt.scene import CeilingFan, Curtain, Mover, Pet, TableFan
from t2d_rt.signal import spectrogram
from t2d_rt.simulate import simulate
from t2d_rt.types import MovingMesh, Radar, Scene

ROOMS = "living_room", "bedroom", "hospital_room", "corridor", "empty_room"
KINDS = "fan", "ceiling_fan", "curtain", "pet"
COUNTS = (0.1, 0.5, 0.4)
"""How often a room holds none, one or two of them."""
FLICKER_CORNER_HZ = 50e3
"""Frequency at which the receiver's 1/f noise equals its thermal noise; an assumption, receivers differ by decades."""
ACCURACY = {"occlusion": False, "clutter_occlusion": False, "sagitta_scale": 3.0}
"""Coarse: a background is told by its powers, not by its phases."""
PROCESSING: dict[str, Any] = {"mti": "mean"}
"""Of the spectrogram: windows as by default; the mean over the record takes away the static clutter."""


def empty_room_record(seed: int, *, duration_s: float = 5.0, radar: Radar | None = None) -> BackgroundRecord:
    """The spectrogram of an empty room, `table2` by default; room, movers and noise follow from the seed."""
    recording = empty_room(seed, duration_s=duration_s, radar=radar)
    image = spectrogram(recording.cube, recording.radar, **PROCESSING)
    grid = Grid.of_columns(image.velocity_mps, image.time_s)
    return BackgroundRecord.of(
        f"room_{seed:04d}", image.power, grid, carrier_hz=recording.radar.carrier_hz, calibrated=True
    )


def empty_room(seed: int, *, duration_s: float = 5.0, radar: Radar | None = None) -> Recording:
    """A recording of an empty room with the receiver's noise."""
    rng = np.random.default_rng(integer("seed", seed))
    duration_s = positive("duration_s", duration_s, 3600, unit="s")
    radar = Radar.preset("table2") if radar is None else radar
    scene = load_scene(ROOMS[rng.integers(len(ROOMS))])
    movers = movers_of(scene, rng)
    targets = [each.mesh(0, duration_s) for each in movers] or [_static(duration_s)]
    found = simulate(
        targets, radar=radar, scene=scene, reflections=0, collisions="ignore", accuracy=ACCURACY, seed=seed,
        measure_error=False,
    )  # fmt: skip
    cube = np.asarray(found.cube) + receiver_noise(found.cube.shape, radar, rng)
    settings = {**found.settings, "movers": [each.model_dump(mode="json") for each in movers]}
    return Recording(cube, radar, settings=settings, versions=found.versions)


def receiver_noise(shape: tuple[int, ...], radar: Radar, rng: np.random.Generator) -> np.ndarray:
    """Thermal noise of `Radar.noise_power_w`, and of the 1/f noise the part that is slower than a chirp, complex64.

    With N0 the thermal density, the 1/f noise has N0 f_c / |f|. What is slower than a chirp is the same for all of its samples; it
    is drawn by its spectrum over the chirps, up to half the chirp rate.
    """
    chirps, antennas, samples = shape
    parts = (rng.standard_normal((chirps, antennas, 2 * samples), np.float32)).view(np.complex64)
    noise = parts * np.float32(np.sqrt(radar.noise_power_w / 2))
    frequency = np.fft.fftfreq(chirps, radar.loop_interval_s)
    frequency[0] = np.inf  # no offset
    density = radar.noise_power_w / radar.sample_rate_hz * FLICKER_CORNER_HZ / np.abs(frequency)
    step_hz = 1 / (chirps * radar.loop_interval_s)
    drawn = rng.standard_normal((chirps, antennas, 2)).view(np.complex128)[..., 0]
    flicker = np.fft.ifft(drawn * np.sqrt(density * step_hz / 2)[:, None], axis=0) * chirps
    return noise + flicker.astype(np.complex64)[:, :, None]


def movers_of(scene: Scene, rng: np.random.Generator) -> list[Mover]:
    """None, one or two movers in front of the radar, inside the room, no pet nearer than 2.5 m."""
    count = int(rng.choice(len(COUNTS), p=COUNTS))
    kinds = rng.choice(KINDS, size=count, replace=False)
    return [_mover(str(kind), np.asarray(scene.bounds_m), rng) for kind in kinds]


def _static(duration_s: float) -> MovingMesh:
    """What stands for the targets of a room without any: a tetrahedron of 1 cm that lies on the floor."""
    corners = np.array([[0.0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1]]) / 100 + [2.0, 0, 0.01]
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    return MovingMesh(np.stack([corners, corners]), faces, np.array([0.0, duration_s]), "wood")


def _mover(kind: str, bounds: np.ndarray, rng: np.random.Generator) -> Mover:
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
