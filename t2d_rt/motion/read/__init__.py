"""Files and arrays -> `Motion`: units, axes, floor and T-pose are found from the body, reported, open to override."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from importlib.metadata import EntryPoint
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from t2d_rt.core.checks import file_path, instance, shown
from t2d_rt.core.errors import InputError, warn
from t2d_rt.core.plugins import loaded, plugins
from t2d_rt.motion.read.amass import read_amass
from t2d_rt.motion.read.arrays import read_arrays
from t2d_rt.motion.read.asf_amc import read_asf_amc
from t2d_rt.motion.read.clock import times_of
from t2d_rt.motion.read.deepmimic import read_deepmimic
from t2d_rt.motion.read.detect import GivenUp
from t2d_rt.motion.read.ground import Root
from t2d_rt.motion.read.joints_npz import read_kimodo, read_plain
from t2d_rt.motion.read.markers import read_c3d, read_trc
from t2d_rt.motion.read.orientations import motion_from_joints
from t2d_rt.motion.read.passes import LOWEST_CUTOFF_HZ, Reading, file_origin, motion_of
from t2d_rt.motion.read.skeletal import read_skeletal
from t2d_rt.motion.read.subjects import check_only
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.types.motion import Motion

BVH_SUFFIXES = (".bvh", ".bvh.gz")
KNOWN = "bvh", "gz", "npy", "npz", "c3d", "trc", "json", "txt", "amc", "asf"
"""Endings that readers of other packages may not take."""

SHORT_S = 0.1
"""Below, a file holds no movement that could be seen: a tenth of a step, four windows of a spectrogram of 25 ms."""

__all__ = ["LOWEST_CUTOFF_HZ", "load_motion", "motion_from_joints"]


def load_motion(
    path: str | Path,
    *,
    units: float | str | None = None,
    up: GivenUp | None = None,
    floor: float | None = None,
    drop_tpose: bool | None = None,
    smooth_hz: float | Literal["auto"] | None = "auto",
    flavour: str | None = None,
    rate_hz: float | None = None,
    subject: str | None = None,
    root: Root | None = None,
) -> Motion:
    """Read a motion file: canonical joints, metres, right-handed, z up, floor at z = 0.

    The format is told from suffix and content: BVH (.bvh, .bvh.gz), HumanML3D joints and vectors (.npy, .npz), AMASS, Kimodo and
    plain named joints (.npz), DeepMimic (.json, .txt), ASF/AMC (.amc), C3D (.c3d, extra [c3d]) and TRC (.trc). Positions
    alone get rotations, and joints that lack are filled.
    Everything left None is detected and told in `Motion.report`.

    units: length of the file's unit in metres, or its name: m, cm, mm, inch, ft, dm or cmu.
    up: the file's upward axis, such as "y" or "-z", or a vector in its axes; "file" is the axis that is found. Left out, a motion
        that a tilted camera saw is turned level by planted feet and balance.
    floor: height of the floor in the file [m].
    drop_tpose: whether the calibration pose at the start is dropped.
    smooth_hz: cut-off of a low-pass filter [Hz]; null does not filter, "auto" filters at 12 Hz where the file jitters, and
        positions alone as their measured noise asks for.
    flavour: how a BVH file names its joints, one of `t2d_rt.motion.flavours()` or a flavour file (.yaml, see
        `t2d_rt.motion.skeletons`); left out, joints of any names are matched by names and form.
    rate_hz: frames per second, instead of the file's own.
    root: "feet" carries the body to where planted feet stay, in files whose hips never move (exports in place, treadmills, joints
        about the hips), which are warned of; "file" leaves it.
    subject: name of the person who is taken of a file that holds several; left out, the first who is complete.
    """
    from t2d_rt.motion.check.gait import rate_doubt

    path = file_path("path", path)
    reading = Reading(units, up, floor, drop_tpose, smooth_hz, flavour, rate_hz, subject, root)
    try:
        if path.name.lower().endswith(BVH_SUFFIXES):
            motion = read_skeletal(path, reading)
        elif (reader := _reader(path)) is not None:
            motion = _read_by(reader, path, reading)
        else:
            motion = motion_of(_read_tracks(path, subject), reading)
    except InputError as error:
        told = str(error)
        raise InputError(told if path.name in told else f"{path}: {told}") from None
    if motion.duration_s < SHORT_S:
        warn(
            f"{path.name} lasts {motion.duration_s:.3g} s ({len(motion.joints)} frames at {motion.rate_hz:g} Hz), a step takes "
            "0.5 s: nothing of a movement can be seen in it; take a longer motion, or check its rate (rate_hz)"
        )
    doubt = rate_doubt(motion)
    if doubt is not None:
        warn(f"{path.name}: {doubt}; give the true one (--motion.rate_hz)")
    return replace(motion, origin=(file_origin(path), *motion.origin))


def _reader(path: Path) -> EntryPoint | None:
    """The reader of another package for files of that ending, where there is one."""
    ending = path.suffix.lower().removeprefix(".")
    return None if ending in KNOWN else plugins("readers", KNOWN).get(ending)


def _read_by(reader: EntryPoint, path: Path, reading: Reading) -> Motion:
    """The motion that a reader of another package makes, by itself."""
    if reading != Reading():
        raise InputError(
            f"options of reading are not those of {reader.name} files, which another package reads; leave them out"
        )
    function = loaded(reader)
    try:
        motion = function(path)
    except InputError:
        raise
    except Exception as error:  # code of others
        raise InputError(f"{path} cannot be read by the reader of {reader.name} files ({error}); check both") from error
    instance("what the reader returns", motion, Motion, "a Motion", hint="motion_from_joints makes one")
    return motion


def _read_arrays(path: Path, subject: str | None) -> Tracks:
    """Tracks of a .npy or .npz file: of Kimodo, of AMASS, or joints by name or order."""
    arrays = read_arrays(path)
    kimodo = "posed_joints" in arrays
    if kimodo or ("trans" in arrays and arrays.first("poses", "root_orient")):
        check_only(subject)
        tracks = read_kimodo(arrays) if kimodo else read_amass(arrays)
    else:
        tracks = read_plain(arrays, subject)
    return replace(tracks, times=times_of(arrays, len(tracks)))


def _of_one(read: Callable[[Path], Tracks], path: Path, subject: str | None) -> Tracks:
    """Tracks of a file whose format holds one person."""
    check_only(subject)
    return read(path)


READERS: Mapping[str, Callable[[Path, str | None], Tracks]] = MappingProxyType(
    {
        ".npy": _read_arrays,
        ".npz": _read_arrays,
        ".c3d": read_c3d,
        ".trc": read_trc,
        ".json": partial(_of_one, read_deepmimic),
        ".txt": partial(_of_one, read_deepmimic),
        ".amc": partial(_of_one, read_asf_amc),
    }
)
"""Readers of files but BVH by their endings: the path, and the subject who is wanted."""


def _read_tracks(path: Path, subject: str | None = None) -> Tracks:
    """Tracks of any file but BVH, of one subject where the format may hold several."""
    suffix = path.suffix.lower()
    if suffix not in READERS:
        hint = "; give the .amc, whose skeleton it is" if suffix == ".asf" else ""
        raise InputError(
            f"cannot read {shown(str(path))}: motions come as {' or '.join(BVH_SUFFIXES)}, or as "
            f"{', '.join(sorted(READERS))}{hint}"
        )
    return READERS[suffix](path, subject)
