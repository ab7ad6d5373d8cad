"""What keeps a body from moving like a machine: sway, breath, and noise of the muscles that grows with the movement."""

from __future__ import annotations

import numpy as np

from t2d_rt.motion.generate.made.score import DEG, INDEX

SWAY_HZ = 0.08, 1.2
"""Band of quiet standing's sway; most of its power lies below 0.5 Hz (Winter 1995)."""

MOTOR_HZ = 2.5, 12.0
"""Band of the irregularities of a movement, corrections and physiological tremor among them."""

SWAY = {
    "com_x": 0.0035, "com_y": 0.0025, "pitch": 0.5 * DEG, "roll": 0.3 * DEG, "yaw": 0.5 * DEG, "flex": 0.7 * DEG, "side": 0.4 * DEG,
    "twist": 0.8 * DEG, "gaze": 1.6 * DEG, "look": 1.8 * DEG, "tilt": 0.7 * DEG, "left_shrug": 0.5 * DEG, "right_shrug": 0.5 * DEG,
}  # fmt: skip
"""Standard deviation at rest [m, rad]; the centre of mass sways by 3 to 5 mm forward and back, 2 to 3 mm sideways (Winter 1995)."""

MOTOR = {
    "com_x": 0.0015, "com_y": 0.001, "pitch": 0.32 * DEG, "roll": 0.22 * DEG, "yaw": 0.25 * DEG, "flex": 0.4 * DEG,
    "side": 0.3 * DEG, "twist": 0.35 * DEG, "gaze": 0.6 * DEG, "look": 0.5 * DEG, "tilt": 0.35 * DEG,
    "left_shrug": 0.3 * DEG, "right_shrug": 0.3 * DEG,
}  # fmt: skip
"""The same in full movement, over `MOTOR_HZ`."""

SWAY_SLOPE, MOTOR_SLOPE = 1.2, 1.83
"""Powers of frequency with which displacements fall; the latter so that spectra of joint speeds between 3 and 12 Hz and their jerk
are those of recorded bends."""

HAND_SWAY_M, HAND_MOTOR_M = 0.006, 0.0032
BREATH_RAD = 0.7 * DEG


def wander(
    rng: np.random.Generator, times_s: np.ndarray, count: int, band_hz: tuple[float, float], slope: float
) -> np.ndarray:
    """Smooth noise (T, count) of unit deviation: sines of random phase whose density falls with frequency to the power `slope`."""
    octaves = np.log2(band_hz[1] / band_hz[0])
    lines = max(8, round(6 * octaves))
    frequency = band_hz[0] * 2 ** (octaves * (np.arange(lines) + rng.random((count, lines))) / lines)
    amplitude = frequency ** (0.5 - slope)
    amplitude *= np.sqrt(2 / (amplitude**2).sum(axis=1, keepdims=True))
    phase = 2 * np.pi * (frequency[None] * times_s[:, None, None] + rng.random((count, lines)))
    return (amplitude * np.sin(phase)).sum(axis=-1)


def activity(values: np.ndarray, rate_hz: float) -> np.ndarray:
    """How much the body moves (T,), 0 at rest, about 1 in a brisk movement: speeds of trunk, hips and feet."""
    from scipy.ndimage import gaussian_filter1d

    scale = {
        "z": 0.5, "x": 0.5, "y": 0.5, "com_x": 0.3, "com_y": 0.3, "yaw": 1.5, "pitch": 1.2, "flex": 1.0, "side": 1.0, "spin": 1.5,
        "twist": 1.0, "left_x": 1.2, "right_x": 1.2, "left_z": 0.8, "right_z": 0.8,
    }  # fmt: skip
    rate = np.gradient(values, axis=0) * rate_hz
    power = sum((rate[:, INDEX[name]] / full) ** 2 for name, full in scale.items())
    return np.tanh(gaussian_filter1d(np.sqrt(power), 0.06 * rate_hz, mode="nearest"))


def shaken(
    values: np.ndarray, times_s: np.ndarray, moving: np.ndarray, rng: np.random.Generator, amount: float
) -> np.ndarray:
    """Channels (T, C) with sway and with noise of movement; feet, hips' height and seat stay as they are."""
    found = values.copy()
    slow = wander(rng, times_s, len(SWAY), SWAY_HZ, SWAY_SLOPE)
    fast = wander(rng, times_s, len(MOTOR), MOTOR_HZ, MOTOR_SLOPE)
    for number, (name, size) in enumerate(SWAY.items()):
        found[:, INDEX[name]] += amount * size * slow[:, number]
    for number, (name, size) in enumerate(MOTOR.items()):
        found[:, INDEX[name]] += amount * size * moving * fast[:, number]
    breath = np.sin(2 * np.pi * (rng.uniform(0.2, 0.32) * times_s + rng.random()))
    found[:, INDEX["flex"]] -= BREATH_RAD * breath
    for side in ("left", "right"):
        found[:, INDEX[f"{side}_shrug"]] += BREATH_RAD * breath
    return found


def hand_noise(times_s: np.ndarray, moving: np.ndarray, rng: np.random.Generator, amount: float) -> np.ndarray:
    """Shifts (T, 3) [m] of a hand that is free."""
    slow = wander(rng, times_s, 3, (0.15, 1.2), SWAY_SLOPE)
    fast = wander(rng, times_s, 3, MOTOR_HZ, MOTOR_SLOPE)
    return amount * (HAND_SWAY_M * slow + HAND_MOTOR_M * moving[:, None] * fast)
