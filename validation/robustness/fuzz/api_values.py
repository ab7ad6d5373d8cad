"""Calls of the public functions with unusual values of the right type: zero, tiny, huge, empty, turned, NaN in one place."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from validation.robustness.api_calls import calls
from validation.robustness.fuzz.api_calls import attempted
from validation.robustness.fuzz.case import Attempt, chance, pick

OFTEN = "simulate", "simulate a mesh", "spectrogram", "synthesize", "MovingMesh", "motion_from_joints", "point_cloud"
"""Calls with the most to go wrong."""
FACTORS = (0.0, -1.0, 1e-12, 1e-3, 0.5, 0.999, 1.001, 2.0, 10.0, 1e3, 1e9, 1e30)
STEPS = (-1, 1, 2, -2, 7, 100, 4096)
WORDS = (
    "", "mean", "hann", "none", "auto", "adult", "pec", "skin", "metal", "wood", "blackmanharris", "os", "ca", "highpass",
    "canceller", "coherent", "boxcar",
)  # fmt: skip


def attempt(rng: np.random.Generator, folder: Path) -> Attempt:
    """One call."""
    all_calls = calls(folder)
    call = pick(rng, [each for each in all_calls if each.name in OFTEN] if chance(rng, 0.3) else all_calls)
    chosen = {}
    for _ in range(1 if chance(rng, 0.5) else 2):
        key = pick(rng, sorted(call.arguments))
        chosen[key] = unusual(rng, call.arguments[key])
    return attempted(call, chosen)


def unusual(rng: np.random.Generator, value: Any) -> Any:
    """A value of the same type."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return pick(rng, [value + step for step in STEPS] + [0, value * 2, value // 2])
    if isinstance(value, float):
        return pick(
            rng,
            [value * factor for factor in FACTORS] + [0.0, float(round(value)), int(value) if abs(value) < 1e9 else 1],
        )
    if isinstance(value, np.ndarray) and value.dtype.kind in "iufc":
        return _array(rng, value)
    if isinstance(value, tuple | list):
        changed = [unusual(rng, each) if chance(rng, 0.5) else each for each in value]
        return pick(rng, (changed, changed[::-1], changed[:-1], changed + changed[:1], tuple(changed)))
    if isinstance(value, str):
        return pick(rng, WORDS)
    if value is None:
        return pick(rng, (0, 1, -1, 0.5, 2.0, 64, 1e-9, 1e6, True, (0.5, 2.0), "x", np.array([0.1, 0.2])))
    return value


def _array(rng: np.random.Generator, value: np.ndarray) -> np.ndarray:
    """The same numbers in another order, number, layout or scale, or with an odd one among them."""
    if not value.size:
        return value
    odd = value.copy()
    place = np.unravel_index(int(rng.integers(value.size)), value.shape)
    odd[place] = (
        pick(rng, (np.nan, np.inf, 1e30, -1.0)) if value.dtype.kind in "fc" else pick(rng, (-1, 0, 10**6, 2**31 - 1))
    )
    calls: tuple[Callable[[], Any], ...] = (
        lambda: odd,
        lambda: odd,
        lambda: value[::-1],
        lambda: value[:0],
        lambda: value[:1],
        lambda: value[:2],
        lambda: np.concatenate([value, value]),
        lambda: value.T,
        lambda: value[..., None],
        lambda: value[0],
        lambda: np.asfortranarray(value),
        lambda: np.repeat(value, 2, axis=0)[::2],
        lambda: value.tolist(),
        lambda: value * 0,
        lambda: (value * pick(rng, FACTORS)).astype(value.dtype),
        lambda: value.astype(np.float32 if value.dtype.kind == "f" else value.dtype),
        lambda: value.astype(np.longdouble if value.dtype.kind == "f" else value.dtype),
        lambda: value.astype(value.dtype.newbyteorder(">")),
        lambda: np.ma.masked_array(value, np.arange(value.size).reshape(value.shape) == 0),
        lambda: _read_only(value),
    )
    return pick(rng, calls)()


def _read_only(value: np.ndarray) -> np.ndarray:
    value = value.copy()
    value.flags.writeable = False
    return value
