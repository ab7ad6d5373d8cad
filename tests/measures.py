"""What several files of tests measure results by."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def db(ratio: float | np.ndarray) -> np.ndarray:
    """Decibels of a power ratio."""
    return 10 * np.log10(ratio)


def nmse_db(found: np.ndarray, expected: np.ndarray) -> float:
    """Energy of the difference over that of what is expected [dB]; -400 where there is none."""
    error = max(float(np.sum(np.abs(found - expected) ** 2)), 1e-40 * float(np.sum(np.abs(expected) ** 2)))
    return float(db(error / float(np.sum(np.abs(expected) ** 2))))


def volume(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """What closed meshes of vertices (..., V, 3) hold (...)."""
    a, b, c = (vertices[..., faces[:, i], :] for i in range(3))
    return (a * np.cross(b, c)).sum((-1, -2)) / 6


def check_picture(path: Path, colours: int = 200) -> None:
    """A PNG, and not one of few colours: a spectrogram has all of its map's, white margins and text alone some dozens."""
    from matplotlib.image import imread

    assert path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    pixels = imread(path)[..., :3]
    assert min(pixels.shape[:2]) > 200
    assert pixels.std() > 0.1
    assert len(np.unique((pixels * 255).astype(int) @ [65_536, 256, 1])) > colours
