"""The reference's samples, which take minutes, kept on disk for the next time that the same ones are asked for."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from pathlib import Path

import numpy as np

from t2d_rt.geometry import curved
from t2d_rt.types import MovingMesh, Radar
from validation.methods import reference
from validation.methods.reference import Converged

CACHE = Path(__file__).parents[1] / ".cache"


def kept_samples(
    surface: MovingMesh,
    radar: Radar,
    chirps: np.ndarray,
    samples: np.ndarray,
    how: Converged,
    *,
    folder: Path = CACHE,
    compute: Callable[..., np.ndarray] = reference.reference_samples,
) -> np.ndarray:
    """What `compute` makes of the other arguments, read from `folder` where it was made before."""
    instants = surface.times_s[0] + radar.chirp_times_s(surface.duration_s)[chirps]
    inputs = (
        radar.model_dump_json(), chirps.tolist(), samples.tolist(), repr(how),
        surface.at(instants).round(9).tobytes(), surface.faces.tolist(), surface.curved,
        *(inspect.getsource(each) for each in (reference, curved)),
    )  # fmt: skip
    file = folder / f"reference_{hashlib.sha256(repr(inputs).encode()).hexdigest()[:20]}.npy"
    if file.exists():
        return np.asarray(np.load(file, allow_pickle=False))
    found = compute(surface, radar, chirps, samples, how)
    folder.mkdir(exist_ok=True)
    np.save(file, found)
    return found
