"""Read motions from files and arrays: units, axes, floor and T-pose are found from the body, reported, and open to override."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Literal

from t2d_rt.core.checks import file_path, instance, shown
from t2d_rt.core.errors import InputError, warn
from t2d_rt.core.plugins import loaded, plugins
from t2d_rt.motion.interpolate import resample, trim
from t2d_rt.motion.read.amass import MOVED, OF_SMPL, ROOT, read_amass
from t2d_rt.motion.read.arrays import Arrays, read_arrays
from t2d_rt.motion.read.asf_amc import read_asf_amc
from t2d_rt.motion.read.bones import read_csv, read_mvnx
from t2d_rt.motion.read.clock import times_of
from t2d_rt.motion.read.deepmimic import read_deepmimic
from t2d_rt.motion.read.detect import GivenUp
from t2d_rt.motion.read.ground import Root
from t2d_rt.motion.read.joints_npz import read_kimodo, read_plain
from t2d_rt.motion.read.landmarks import json_of, read_json, read_ntu
from t2d_rt.motion.read.markers import read_c3d, read_trc
from t2d_rt.motion.read.orientations import motion_from_joints
from t2d_rt.motion.read.passes import LOWEST_CUTOFF_HZ, Found, Reading, file_origin, motion_of
from t2d_rt.motion.read.skeletal import motion_of_skeleton, read_skeletal
from t2d_rt.motion.read.subjects import People, one_of, subject_of
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.types.motion import Motion

SKELETAL = (".bvh", ".bvh.gz", ".glb")
KNOWN = "bvh", "gz", "glb", "npy", "npz", "c3d", "trc", "csv", "json", "txt", "amc", "asf", "mvnx", "skeleton"
"""Endings that readers of other packages may not take."""

SHORT_S = 0.1
"""Duration below which a file holds no movement that could be seen [s]: a fifth of a step, four windows of 25 ms."""

__all__ = ["LOWEST_CUTOFF_HZ", "load_motion", "load_motions", "motion_from_joints"]


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

    The format is told from suffix and content: BVH (.bvh, .bvh.gz), animated glTF (.glb), HumanML3D joints and vectors (.npy,
    .npz), AMASS, smplx, Kimodo, and joints by name or in the order of a camera or estimator (.npz, .npy), DeepMimic, OpenPose and
    MediaPipe (.json), NTU RGB+D (.skeleton), ASF/AMC (.amc), C3D (.c3d, extra [c3d]), TRC (.trc), Xsens (.mvnx), Motive and plain
    tables (.csv). Positions alone get rotations, and missing joints are filled.
    Everything left None is detected and told in `Motion.report`. Raises an InputError if the file cannot be read as a motion.

    units: length of the file's unit in metres, or its name: m, cm, mm, inch, ft, dm or cmu.
    up: the file's upward axis, such as "y" or "-z", or a vector in its axes; "file" is the axis that is found. Left out, a motion
        that a tilted camera saw is turned level by planted feet and balance.
    floor: height of the floor in the file [m].
    drop_tpose: whether the calibration pose at the start is dropped.
    smooth_hz: cut-off of a low-pass filter [Hz]; null does not filter, "auto" filters at 12 Hz where the file jitters, and
        positions alone as their measured noise asks for.
    flavour: how a BVH or GLB file names its joints, one of `t2d_rt.motion.flavours()` or a flavour file (.yaml, see
        `t2d_rt.motion.skeletons`); left out, joints of any names are matched by names and form.
    rate_hz: frames per second, instead of the file's own.
    root: "feet" carries the body to where planted feet stay, in files whose hips never move (exports in place, treadmills, joints
        about the hips), which are warned of; "file" leaves it.
    subject: name of the person who is taken from a file that holds several; left out, the first who is complete.
    """
    path = file_path("path", path)
    reading = Reading(units, up, floor, drop_tpose, smooth_hz, flavour, rate_hz, subject, root)
    return _checked(_read(path, reading), path)


def _read(path: Path, reading: Reading) -> Motion:
    """The motion of a file."""
    with _named(path):
        reader = _reader(path)
        if reader is not None:
            return _read_by(reader, path, reading)
        return _found(one_of(_people(path, reading), reading.subject), reading).motion


def _found(tracks: Tracks, reading: Reading) -> Found:
    """The motion of one person's tracks."""
    if tracks.skeleton is not None:
        return motion_of_skeleton(tracks, tracks.skeleton, reading)
    return motion_of(tracks, reading)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Names the file in the errors of its reading."""
    try:
        yield
    except InputError as error:
        message = str(error)
        raise InputError(message if path.name in message else f"{path}: {message}") from None


def _checked(motion: Motion, path: Path) -> Motion:
    """The motion with the file as its origin, and warnings of what is doubtful."""
    from t2d_rt.motion.check.gait import rate_doubt

    if motion.duration_s < SHORT_S:
        warn(
            f"{path.name} lasts {motion.duration_s:.3g} s ({len(motion.joints)} frames at {motion.rate_hz:g} Hz), a step takes "
            "0.5 s: nothing of a movement can be seen in it; take a longer motion, or check its rate (rate_hz)"
        )
    doubt = rate_doubt(motion)
    if doubt is not None:
        warn(f"{path.name}: {doubt}; give the true one (--motion.rate_hz)")
    return replace(motion, origin=(file_origin(path), *motion.origin))


def load_motions(
    path: str | Path,
    *,
    units: float | str | None = None,
    up: GivenUp | None = None,
    floor: float | None = None,
    smooth_hz: float | Literal["auto"] | None = "auto",
    flavour: str | None = None,
    rate_hz: float | None = None,
) -> dict[str, Motion]:
    """Motions of all persons in a file, by name, in one set of coordinates and on one clock, so that they keep their places to one
    another (`place_together` puts them before the radar).

    All have the same unit, the axis of the first and the lowest of their floors; the options are those of `load_motion`. Times at
    which not all are seen are cut away. An incomplete person is left out, with a warning. A single person has the name "1".
    Raises an InputError if nobody is complete, if units differ, or if they are never seen together.
    """
    path = file_path("path", path)
    reading = Reading(units, up or "file", floor, None, smooth_hz, flavour, rate_hz)
    if _reader(path) is not None:
        return {"1": _checked(_read(path, replace(reading, up=up)), path)}
    with _named(path):
        subjects = _people(path, reading)
        if len(subjects) < 2:
            motion = _found(one_of(subjects, None), replace(reading, up=up)).motion
            return {"1": _checked(motion, path)}
    tracks: dict[str, Tracks] = {}
    people: dict[str, Found] = {}
    for name in subjects:
        try:
            with _named(path):
                tracks[name] = subject_of(subjects, name)
                people[name] = _found(tracks[name], reading)
        except InputError as error:
            warn(f"{name} is left out: {error}")
    if not people:
        raise InputError(f"{path}: nobody of {', '.join(subjects)} is complete; repair the file")
    frames = [person.frame for person in people.values()]
    if len({f"{frame.unit_m:.4g}" for frame in frames}) > 1:
        statures = ", ".join(sorted(f"{frame.unit_m:.4g} m (stature {frame.tall_m:.2f} m)" for frame in frames))
        raise InputError(f"{path}: by their bodies its persons have different units, {statures}; give units")
    axis = frames[0].up
    one_axis = all(frame.up == axis for frame in frames)
    if floor is None or not one_axis:
        level = min(person.floor_m for person in people.values() if person.frame.up == axis) if floor is None else floor
        common = replace(reading, up=reading.up if one_axis else axis, floor=level)
        with _named(path):
            people = {name: _found(tracks[name], common) for name in people}
    tilts = [f"by {person.tilt_deg:.1f} degrees as {name} stands" for name, person in people.items() if person.tilt_deg]
    if tilts:
        warn(
            f"{path.name} is tilted against its axis, {', '.join(tilts)}; its persons keep it: "
            "give up as a vector in the file's axes"
        )
    return {name: _checked(motion, path) for name, motion in _together(people).items()}


def _together(people: dict[str, Found]) -> dict[str, Motion]:
    """Motions cut to the time that all have, at the highest of their rates."""
    motions = {name: person.motion for name, person in people.items()}
    starts = {name: person.start_s for name, person in people.items()}
    rate_hz = max(motion.rate_hz for motion in motions.values())
    first = max(starts.values())
    last = min(starts[name] + motion.duration_s for name, motion in motions.items())
    if last - first < SHORT_S:
        raise InputError(f"{', '.join(motions)} are never seen at the same time; read them one by one, by subject")
    cut = {}
    for name, piece in motions.items():
        piece = piece if piece.rate_hz == rate_hz else resample(piece, rate_hz)
        low, high = (min(max(t - starts[name], 0.0), piece.duration_s) for t in (first, last))
        whole = high - low >= piece.duration_s - 1e-9
        cut[name] = piece if whole else trim(piece, low, high)
    return cut


def _reader(path: Path) -> EntryPoint | None:
    """The reader of another package for files of that ending, None if there is none."""
    ending = path.suffix.lower().removeprefix(".")
    return None if ending in KNOWN else plugins("readers", KNOWN).get(ending)


def _read_by(reader: EntryPoint, path: Path, reading: Reading) -> Motion:
    """The motion that a reader of another package makes; raises an InputError if it fails or if options were given."""
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


def _of_arrays(arrays: Arrays) -> People:
    """The persons of Kimodo, of AMASS or smplx, or of joints by name or order."""
    kimodo = "posed_joints" in arrays
    if kimodo or (arrays.first("poses", *ROOT) and arrays.first(*MOVED, *OF_SMPL)):
        people: People = {"": partial(read_kimodo if kimodo else read_amass, arrays)}
    else:
        people = read_plain(arrays)
    return {name: partial(_timed, read, arrays) for name, read in people.items()}


def _timed(read: Callable[[], Tracks], arrays: Arrays) -> Tracks:
    """A person's tracks with the times that the arrays tell."""
    tracks = read()
    return replace(tracks, times=times_of(arrays, len(tracks)))


SUFFIXES = ".npy", ".npz", ".c3d", ".trc", ".csv", ".mvnx", ".skeleton", ".json", ".txt", ".amc"
"""Endings of all other files than BVH and GLB."""


def _people(path: Path, reading: Reading) -> People:
    """The persons of a file of any format."""
    if path.name.lower().endswith(SKELETAL):
        return read_skeletal(path, reading.flavour)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        hint = "; give the .amc, whose skeleton it is" if suffix == ".asf" else ""
        raise InputError(
            f"cannot read {shown(str(path))}: motions come as {' or '.join(SKELETAL)}, or as "
            f"{', '.join(sorted(SUFFIXES))}{hint}"
        )
    if reading.flavour is not None:
        raise InputError(
            f"flavour {shown(reading.flavour)} names the joints of {' or '.join(SKELETAL)} files, and {suffix} files name "
            "theirs otherwise; leave flavour out"
        )
    match suffix:
        case ".c3d":
            return read_c3d(path)
        case ".trc":
            return read_trc(path)
        case ".csv":
            return read_csv(path)
        case ".mvnx":
            return read_mvnx(path)
        case ".amc":
            return {"": partial(read_asf_amc, path)}
        case ".npy" | ".npz":
            arrays = read_arrays(path)
        case ".skeleton":
            arrays = read_ntu(path)
        case _:
            tree = json_of(path)
            if isinstance(tree, dict) and "Frames" in tree:
                return {"": partial(read_deepmimic, tree, path)}
            arrays = read_json(tree, path)
    return _of_arrays(replace(arrays, given_hz=reading.rate_hz))
