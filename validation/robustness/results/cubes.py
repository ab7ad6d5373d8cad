"""Cubes of up to 2 GiB: kept only as an array, pickled to a pool, moved, deleted, replaced; right values or an error."""

from __future__ import annotations

import gc
import multiprocessing
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from t2d_rt.core.cubes import CubeWriter, new_cube
from t2d_rt.core.errors import InputError
from t2d_rt.recording.recording import Recording
from t2d_rt.types import Radar
from validation.report import Check, Section

SIZES_MIB = (300, 600, 2048)
RADAR = Radar.preset("ci4r")
BLOCK = 4096
RIGHT, ERROR, WRONG = "right values", "error", "WRONG VALUES"


def run() -> Section:
    table = [_apart(case, size) for case in CASES for size in SIZES_MIB]
    wrong = sum(row["found"] not in (RIGHT, ERROR) for row in table)
    needless = sum(row["found"] != RIGHT for row in table if row["case"] in ALWAYS_RIGHT)
    left = sum(row["files left"] for row in table)
    return Section(
        title="Cubes",
        checks=[
            Check(what="cubes of 300 MiB, 600 MiB, 2 GiB: neither right values nor an error", measured=wrong, limit=0, unit=""),
            Check(what="the same, an error where nothing was lost", measured=needless, limit=0, unit=""),
            Check(what="the same, temporary files left, after kill -9 too", measured=left, limit=0, unit=""),
        ],
        note="Cubes: each case in a process of its own with a folder for temporary files of its own; every sample is compared. "
        "Peak memory is that of the process and of its pool's, whichever is greater; pickled by value, a cube is held in memory.",
        table=table,
    )  # fmt: skip


def rows(section: Section) -> list[dict[str, Any]]:
    return section.table


def _apart(case: str, size_mib: int) -> dict[str, Any]:
    """Runs a case in a process of its own."""
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="validation-") as place:
        spawn = multiprocessing.get_context("spawn")
        mine, theirs = spawn.Pipe(duplex=False)
        process = spawn.Process(target=_run, args=(case, size_mib, place, theirs))
        process.start()
        theirs.close()
        try:
            found, peak_gb = mine.recv()
        except EOFError:
            found, peak_gb = f"exit {process.exitcode}", 0.0
        process.join()
        left = [path for path in (Path(place) / "tmp").iterdir() if not path.name.startswith("pymp-")]
    return {
        "case": case, "MiB": size_mib, "found": found, "s": time.perf_counter() - begin, "peak GB": peak_gb,
        "files left": len(left),
    }  # fmt: skip


def _run(case: str, size_mib: int, place: str, pipe: Any) -> None:
    os.chdir(place)
    (Path(place) / "tmp").mkdir()
    os.environ["TMPDIR"] = tempfile.tempdir = str(Path(place) / "tmp")
    try:
        found = CASES[case](size_mib)
    except InputError:
        found = ERROR
    peak = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    pipe.send((found, peak * 1024 / 1e9))
    if case == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    sys.exit(0)


def _pattern(rows: slice, scale: float) -> np.ndarray:
    """Samples that differ from chirp to chirp and from sample to sample, none of them zero."""
    chirps = np.arange(rows.start, rows.stop, dtype=np.float32)[:, None, None]
    return (scale * (1 + chirps + 1j * np.arange(RADAR.samples, dtype=np.float32))).astype(np.complex64)


def _made(size_mib: int, scale: float = 1.0) -> Recording:
    chirps = size_mib * 2**20 // (8 * RADAR.samples) + 1
    cube = new_cube((chirps, 1, RADAR.samples))
    with CubeWriter(cube) as writer:
        for start in range(0, chirps, BLOCK):
            part = slice(start, min(start + BLOCK, chirps))
            writer.room(part.stop - part.start)[:] = _pattern(part, scale)
    return Recording(cube, RADAR)


def _judged(adc: xr.DataArray, scale: float = 1.0) -> str:
    """Every sample."""
    for start in range(0, len(adc), BLOCK):
        part = slice(start, min(start + BLOCK, len(adc)))
        if not np.array_equal(adc[part].values, _pattern(part, scale)):
            return WRONG
    return RIGHT


def _only_the_array(size_mib: int) -> str:
    result = _made(size_mib)
    adc = result.adc
    result = _made(1, scale=2.0)
    gc.collect()
    return _judged(adc)


def _pool_by_value(size_mib: int) -> str:
    return _in_a_pool(_made(size_mib).adc)


def _pool_by_path(size_mib: int) -> str:
    return _in_a_pool(_loaded(size_mib).adc)


def _in_a_pool(adc: xr.DataArray) -> str:
    with multiprocessing.get_context("spawn").Pool(1, initializer=os.chdir, initargs=("/",)) as pool:
        found = pool.apply(_judged, (adc,))
        pool.close()
        pool.join()
    return found


def _loaded(size_mib: int) -> Recording:
    """From a relative path."""
    _made(size_mib).save("a.zarr")
    return Recording.load("a.zarr")


def _after(change: Callable[[int], None]) -> Callable[[int], str]:
    """Reads a result's array after what changes its folder."""

    def case(size_mib: int) -> str:
        adc = _loaded(size_mib).adc
        change(size_mib)
        gc.collect()
        return _judged(adc)

    return case


def _change_directory(_: int) -> None:
    Path("elsewhere").mkdir()
    os.chdir("elsewhere")


def _move(_: int) -> None:
    Path("a.zarr").rename("b.zarr")


def _delete(_: int) -> None:
    shutil.rmtree("a.zarr")


def _replace(size_mib: int) -> None:
    _made(size_mib, scale=2.0).save("a.zarr", overwrite=True)


def _lose_a_chunk(_: int) -> None:
    shutil.rmtree("a.zarr/adc/c/7")


CASES: dict[str, Callable[[int], str]] = {
    "kept only as an array": _only_the_array,
    "killed": _only_the_array,
    "pickled to a pool": _pool_by_value,
    "saved, loaded, pickled to a pool elsewhere": _pool_by_path,
    "loaded, then another working directory": _after(_change_directory),
    "loaded, then its folder moved": _after(_move),
    "loaded, then its folder deleted": _after(_delete),
    "loaded, then another result in its place": _after(_replace),
    "loaded, then a chunk deleted": _after(_lose_a_chunk),
}
ALWAYS_RIGHT = tuple(CASES)[:5]
