"""Spectrograms that are kept as pictures, a folder for each class: colour or grey tells the level."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.learn.adapters.interface import Adapter, AdapterOptions, Piece, class_of, files_below, maps_from
from t2d_rt.learn.maps import LabelledMaps

ENDINGS = ".png", ".jpg", ".jpeg", ".bmp"
MAX_CELLS = 16_000_000
COLOUR_ERROR = 60.0
"""Greatest mean distance of a picture's colours from the colour map, of 442 between black and white; JPEG stays far below."""


def read_pictures(path: Path, options: AdapterOptions, *, colours: str) -> tuple[LabelledMaps, list[Path]]:
    """A map for every picture; rows are speeds from the greatest down, columns times. The class is the file's folder."""
    files = files_below(path, ENDINGS, "pictures")
    labels = [each.parent.name for each in files]
    pieces = []
    for each, label in zip(files, labels, strict=True):
        if class_of(label, options) is None:
            continue
        fraction = _fractions(each, colours)[::-1]
        power = 10.0 ** ((fraction - 1.0) * options.dynamic_range_db / 10.0)
        name = each.relative_to(path).as_posix()
        pieces.append(Piece(power, label, name, {"event": name}))
    return maps_from(pieces, options, path, labels), files


def _fractions(path: Path, colours: str) -> np.ndarray:
    """Where on the colour map each pixel lies, (row, column), 0..1."""
    from PIL import Image

    try:
        with Image.open(path) as picture:
            if picture.width * picture.height > MAX_CELLS:
                raise InputError(f"{path} has {picture.width} x {picture.height} pixels; {MAX_CELLS} are read at most")
            if colours == "grey":
                return np.asarray(picture.convert("L"), dtype=np.float64) / 255.0
            pixels = np.asarray(picture.convert("RGB"), dtype=np.float64)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"cannot read picture {path}: {error or type(error).__name__}; leave it out") from None
    import matplotlib
    from scipy.spatial import KDTree

    table = matplotlib.colormaps[colours](np.linspace(0.0, 1.0, 256))[:, :3] * 255.0
    distance, index = KDTree(table).query(pixels)
    if float(distance.mean()) > COLOUR_ERROR:
        raise InputError(
            f"the colours of {path} are not those of the colour map {colours}; read grey pictures with png"
        )
    return np.asarray(index, dtype=np.float64) / 255.0


CI4R = Adapter(
    name="ci4r",
    about="Pictures of spectrograms in the colour map jet, a folder for each class, as those of CI4R.",
    licence="Terms of the data are those of whoever recorded it; CI4R asks for a citation.",
    read=partial(read_pictures, colours="jet"),
)
PNG = Adapter(
    name="png",
    about="Grey pictures of spectrograms, black the least level, a folder for each class.",
    licence="Terms of the data are those of whoever recorded it.",
    read=partial(read_pictures, colours="grey"),
)
