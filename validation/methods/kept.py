"""The reference's samples, which take minutes, kept on disk for the next time that the same ones are asked for."""

from __future__ import annotations

import hashlib
import inspect
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.types import MovingMesh, Radar
from validation.methods import reference

CACHE = Path(__file__).parents[1] / ".cache"


def kept_samples(
    surface: MovingMesh, radar: Radar, chirps: np.ndarray, samples: np.ndarray, **options: Any
) -> np.ndarray:
    """`reference_samples` of the same arguments."""
    moments = surface.times_s[0] + radar.chirp_times_s(surface.duration_s)[chirps]
    inputs = (
        radar.model_dump_json(), chirps.tolist(), samples.tolist(), sorted((k, repr(v)) for k, v in options.items()),
        surface.at(moments).round(9).tobytes(), surface.faces.tolist(), inspect.getsource(reference),
    )  # fmt: skip
    file = CACHE / f"reference_{hashlib.sha256(repr(inputs).encode()).hexdigest()[:20]}.npy"
    if file.exists():
        return np.asarray(np.load(file, allow_pickle=False))
    found = reference.reference_samples(surface, radar, chirps, samples, **options)
    CACHE.mkdir(exist_ok=True)
    np.save(file, found)
    return found
