"""Which reader a file needs, by its suffix and content."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from t2d_rt.checks import shown
from t2d_rt.errors import InputError
from t2d_rt.motion.read.amass import read_amass
from t2d_rt.motion.read.arrays import Arrays, read_arrays
from t2d_rt.motion.read.asf_amc import read_asf_amc
from t2d_rt.motion.read.c3d import read_c3d
from t2d_rt.motion.read.clock import times_of
from t2d_rt.motion.read.deepmimic import read_deepmimic
from t2d_rt.motion.read.joints_npz import read_plain
from t2d_rt.motion.read.kimodo import read_kimodo
from t2d_rt.motion.read.subjects import check_only
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.motion.read.trc import read_trc

BVH_SUFFIXES = (".bvh", ".bvh.gz")


def is_bvh(path: Path) -> bool:
    """Whether a file is BVH by its suffix."""
    return path.name.lower().endswith(BVH_SUFFIXES)


def read_tracks(path: Path, subject: str | None = None) -> Tracks:
    """Tracks of any file but BVH, of one subject where the format may hold several."""
    suffix = path.suffix.lower()
    if suffix in (".npy", ".npz"):
        arrays = read_arrays(path)
        tracks = _from_arrays(arrays, subject)
        return replace(tracks, times=times_of(arrays, len(tracks)))
    if suffix in (labelled := {".c3d": read_c3d, ".trc": read_trc}):
        return labelled[suffix](path, subject)
    readers = {".json": read_deepmimic, ".txt": read_deepmimic, ".amc": read_asf_amc}
    if suffix not in readers:
        hint = "; give the .amc, whose skeleton it is" if suffix == ".asf" else ""
        others = ", ".join(sorted({".npy", ".npz", *labelled, *readers}))
        raise InputError(
            f"cannot read {shown(str(path))}: motions come as {' or '.join(BVH_SUFFIXES)}, or as {others}{hint}"
        )
    check_only(subject)
    return readers[suffix](path)


def _from_arrays(arrays: Arrays, subject: str | None) -> Tracks:
    kimodo = "posed_joints" in arrays
    if kimodo or ("trans" in arrays and arrays.first("poses", "root_orient")):
        check_only(subject)
        return read_kimodo(arrays) if kimodo else read_amass(arrays)
    return read_plain(arrays, subject)
