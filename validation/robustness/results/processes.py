"""Writers in processes of their own: what they write, and what is found afterwards."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt import cli
from t2d_rt.core.errors import InputError
from t2d_rt.recording.recording import Recording
from t2d_rt.types import Radar

CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(["xarray", "zarr", "scipy.signal", "validation.robustness.results.processes"])
RADAR = Radar.preset("ci4r")
CHIRPS = 2000
"""4 MB of samples: writing them takes a good part of the run."""


class Drawing:
    """A picture that says whose it is."""

    def __init__(self, value: int) -> None:
        self.value = value

    def savefig(self, path: Path) -> None:
        path.write_text(str(self.value))


def recording(value: int) -> Recording:
    return Recording(np.full((CHIRPS, 1, RADAR.samples), value, np.complex64), RADAR)


def save(path: Path, value: int, *, overwrite: bool) -> None:
    recording(value).save(path, overwrite=overwrite, figure=Drawing(value))


def found(path: Path) -> int | str | None:
    """The value of the whole recording at `path`, why there is none, or None where there is nothing."""
    if not path.exists():
        return None
    try:
        cube = np.asarray(Recording.load(path).cube)
    except InputError as error:
        return str(error)
    return int(cube[0, 0, 0].real) if (cube == cube[0, 0, 0]).all() else "mixed samples"


def picture(path: Path) -> int | str | None:
    """Whose picture lies beside it."""
    file = path.with_suffix(".png")
    text = file.read_text() if file.exists() else None
    return int(text) if text is not None and text.isdigit() else text


def start_writer(
    path: Path,
    value: int,
    *,
    overwrite: bool,
    first: Callable[..., None] | None = None,
    arguments: tuple[Any, ...] = (),
) -> ForkServerProcess:
    """A process that saves as the command line does; it calls `first` before."""
    options = {"path": path, "value": value, "overwrite": overwrite, "first": first, "arguments": arguments}
    process = CONTEXT.Process(target=_write, kwargs=options)
    process.start()
    return process


def _write(
    path: Path, value: int, overwrite: bool, first: Callable[..., None] | None, arguments: tuple[Any, ...]
) -> None:
    def run(_: list[str]) -> int:
        if first is not None:
            first(*arguments)
        save(path, value, overwrite=overwrite)
        return 0

    cli._run = run
    sys.stderr = (path.parent / f"{value}.err").open("w", encoding="utf-8")
    sys.exit(cli.main(["simulate"]))


def sentence(path: Path, value: int) -> str:
    """What a writer said."""
    return (path.parent / f"{value}.err").read_text(encoding="utf-8")
