"""What the studies have in common: tables, files of finished cells, real recordings beside their simulated twins."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.atomic_write import replacing
from t2d_rt.core.errors import InputError
from t2d_rt.dataset.products import edges
from t2d_rt.learn.adapters import AdapterOptions, RealMaps, adapter_for, read_real
from t2d_rt.learn.adapters.parrad import FIVE, FOUR
from t2d_rt.learn.maps import LabelledMaps


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown: a line of names, and rows of as many texts.

    >>> print(table(["a", "b"], [["1", "2|3"]]))
    | a | b |
    |---|---|
    | 1 | 2/3 |
    """
    first, *others = [f"| {' | '.join(str(each).replace('|', '/') for each in line)} |" for line in (head, *rows)]
    return "\n".join([first, "|" + "---|" * len(head), *others])


LEAST_VALUES = 3
"""For an interval: two values that agree by chance would make one of no width."""


def interval(values: Sequence[float]) -> tuple[float, float]:
    """Mean, and half of the 95 % interval of the mean by Student's t; infinite for fewer than three values."""
    from scipy.stats import t

    count = len(values)
    if count < LEAST_VALUES:
        return float(np.mean(values)), float("inf")
    spread = float(np.std(values, ddof=1)) / count**0.5
    return float(np.mean(values)), float(t.ppf(0.975, count - 1)) * spread


def write_whole(path: Path, text: str) -> None:
    """Writes a file, whole or not at all."""
    with replacing(path, lambda: None) as new:
        new.write_text(text, encoding="utf-8")


def read_cell(path: Path, sound: Callable[[Any], bool]) -> dict[str, Any]:
    """A finished cell by its file; what is damaged, or does not satisfy `sound`, is refused."""
    try:
        told = json.loads(path.read_text("utf-8"))
        if not sound(told):
            raise ValueError
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError):
        raise InputError(f"{path} is not what a study wrote there; remove it, and it is computed again") from None
    return dict(told)


def kept_cell(
    path: Path, compute: Callable[[], Mapping[str, Any]], sound: Callable[[Any], bool], stamp: str = ""
) -> dict[str, Any]:
    """What a cell found: read from its file, or computed and written there. stamp: hash of what it follows from beside its name;
    files of other data are refused."""
    if not path.exists():
        write_whole(path, json.dumps({"stamp": stamp, **compute()}) + "\n")
    told = read_cell(path, sound)
    if told.get("stamp") != stamp:
        raise InputError(f"{path} is of other data or options; choose another folder")
    return told


def made_folder(folder: Path, recipe: Path, told: str, files: str, noun: str) -> Path:
    """The folder of simulated events, with their recipe's text beside them; one that holds events of another is refused."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"cannot make the folder {folder}: {reason}; choose a writable place") from None
    if any(folder.glob(files)) and (not recipe.is_file() or recipe.read_text(encoding="utf-8") != told):
        raise InputError(f"{folder} holds {noun} of another recipe; give another folder")
    write_whole(recipe, told)
    return folder


def add_real_options(parser: ArgumentParser) -> None:
    """Options of real recordings and their twins."""
    parser.add_argument("real", help="real recordings in any form that an adapter reads, with their card")
    parser.add_argument(
        "twins", help="folder of their simulated twins, as the study twins writes it, or any labelled maps"
    )
    parser.add_argument(
        "--classes", choices=["four", "five"], default="four", help="of PARrad: in four, sitting and standing are one"
    )


def real_and_twins(options: Namespace) -> tuple[RealMaps, LabelledMaps, str]:
    """Real maps, simulated ones on their axes and of their classes, and what is told of these."""
    from validation.studies.twins import MERGED, RECIPE, read_twins

    kinds: Mapping[str, tuple[Mapping[str, str], Mapping[str, str] | None]] = {
        "four": (FOUR, MERGED),
        "five": (FIVE, None),
    }
    labels, merged = kinds[options.classes]
    real, folder = read_labelled(options.real, labels), Path(options.twins)
    if (folder / RECIPE).is_file():
        told, simulated = (folder / RECIPE).read_text(encoding="utf-8").replace("\n", ""), read_twins(folder, merged)
    else:
        maps = real.maps
        low, high = edges(maps.velocity_mps)
        found = read_real(folder, options=AdapterOptions(
            size=maps.size, speed_mps=max(-low, high), cut_mps=(low, high), duration_s=maps.duration_s,
        ))  # fmt: skip
        told, simulated = str(found), found.maps
    return real, simulated.relabelled(real.maps.classes), told


def read_labelled(path: str, parrad_classes: Mapping[str, str]) -> RealMaps:
    """Labelled maps in any form; those of PARrad of these classes, whatever a card tells."""
    own = Path(path).is_file() and adapter_for(Path(path)) == "parrad"
    return read_real(path, options=AdapterOptions(classes=parrad_classes if own else None))
