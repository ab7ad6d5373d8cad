"""Files and arrays -> `Motion`: units, axes, floor and T-pose are found from the body, reported, open to override."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from importlib.metadata import EntryPoint
from pathlib import Path
from types import MappingProxyType
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
from t2d_rt.motion.read.skeletal import read_skeletal
from t2d_rt.motion.read.subjects import UnknownSubject, check_only
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.types.motion import Motion

SKELETAL = (".bvh", ".bvh.gz", ".glb")
KNOWN = "bvh", "gz", "glb", "npy", "npz", "c3d", "trc", "csv", "json", "txt", "amc", "asf", "mvnx", "skeleton"
"""Endings that readers of other packages may not take."""

SHORT_S = 0.1
"""Below, a file holds no movement that could be seen: a tenth of a step, four windows of a spectrogram of 25 ms."""

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
    tables (.csv). Positions alone get rotations, and joints that lack are filled.
    Everything left None is detected and told in `Motion.report`.

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
    subject: name of the person who is taken of a file that holds several; left out, the first who is complete.
    """
    path = file_path("path", path)
    reading = Reading(units, up, floor, drop_tpose, smooth_hz, flavour, rate_hz, subject, root)
    return _checked(_read(path, reading), path)


def _read(path: Path, reading: Reading) -> Motion:
    """The motion of a file."""
    with _named(path):
        reader = _reader(path)
        return _opened(path, reading)(reading).motion if reader is None else _read_by(reader, path, reading)


def _opened(path: Path, reading: Reading) -> Callable[[Reading], Found]:
    """One person of a file, read once: the motion for a reading, by other axes or another floor too."""
    if path.name.lower().endswith(SKELETAL):
        return read_skeletal(path, reading)
    return partial(motion_of, _read_tracks(path, reading))


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Names the file in the errors of its reading."""
    try:
        yield
    except UnknownSubject:
        raise
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
    """Everybody whom a file holds, by name: in one capture's coordinates and on one clock, so that they keep their places to one
    another (`place_together` puts them before the radar).

    Unit, axis and floor are the same for all, as the first has them, and options are those of `load_motion`. What not all have is
    cut away. Who is not complete is left out, with a warning. A motion of a file with one person has the name "1".
    """
    path = file_path("path", path)
    reading = Reading(units, up or "file", floor, None, smooth_hz, flavour, rate_hz)
    names = _subjects(path, reading)
    if len(names) < 2:
        return {"1": _checked(_read(path, replace(reading, up=up)), path)}
    readers: dict[str, Callable[[Reading], Found]] = {}
    people: dict[str, Found] = {}
    for name in names:
        try:
            with _named(path):
                readers[name] = _opened(path, replace(reading, subject=name))
                people[name] = readers[name](reading)
        except InputError as error:
            warn(f"{name} is left out: {error}")
    if not people:
        raise InputError(f"{path}: nobody of {', '.join(names)} is complete; repair the file")
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
            people = {name: readers[name](common) for name in people}
    tilts = [f"by {person.tilt_deg:.1f} degrees as {name} stands" for name, person in people.items() if person.tilt_deg]
    if tilts:
        warn(
            f"{path.name} is tilted against its axis, {', '.join(tilts)}; its persons keep it: "
            "give up as a vector in the file's axes"
        )
    return {name: _checked(motion, path) for name, motion in _together(people).items()}


def _subjects(path: Path, reading: Reading) -> tuple[str, ...]:
    """Names of those whom a file holds; none or one without a name where it is a single one."""
    if _reader(path) is not None:
        return ()
    try:
        with _named(path):
            _opened(path, replace(reading, subject=NOBODY))
    except UnknownSubject as error:
        return error.names
    return ()


NOBODY = "\x00"
"""A name that no subject has: the refusal tells who there is."""


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


def _of_arrays(read: Callable[[Path], Arrays], path: Path, reading: Reading) -> Tracks:
    """Tracks of Kimodo, of AMASS or smplx, or of joints by name or order."""
    arrays, subject = replace(read(path), given_hz=reading.rate_hz), reading.subject
    kimodo = "posed_joints" in arrays
    if kimodo or (arrays.first("poses", *ROOT) and arrays.first(*MOVED, *OF_SMPL)):
        check_only(subject)
        tracks = read_kimodo(arrays) if kimodo else read_amass(arrays)
    else:
        tracks = read_plain(arrays, subject)
    return replace(tracks, times=times_of(arrays, len(tracks)))


def _read_json(path: Path, reading: Reading) -> Tracks:
    """Tracks of DeepMimic's JSON, or of the points of a pose estimator."""
    tree = json_of(path)
    if isinstance(tree, dict) and "Frames" in tree:
        check_only(reading.subject)
        return read_deepmimic(tree, path)
    return _of_arrays(partial(read_json, tree), path, reading)


def _of_one(read: Callable[[Path], Tracks], path: Path, reading: Reading) -> Tracks:
    """Tracks of a file whose format holds one person."""
    check_only(reading.subject)
    return read(path)


def _of_several(read: Callable[[Path, str | None], Tracks], path: Path, reading: Reading) -> Tracks:
    """Tracks of one person of a file whose format may hold several."""
    return read(path, reading.subject)


READERS: Mapping[str, Callable[[Path, Reading], Tracks]] = MappingProxyType(
    {
        ".npy": partial(_of_arrays, read_arrays),
        ".npz": partial(_of_arrays, read_arrays),
        ".c3d": partial(_of_several, read_c3d),
        ".trc": partial(_of_several, read_trc),
        ".csv": partial(_of_several, read_csv),
        ".mvnx": partial(_of_several, read_mvnx),
        ".skeleton": partial(_of_arrays, read_ntu),
        ".json": _read_json,
        ".txt": _read_json,
        ".amc": partial(_of_one, read_asf_amc),
    }
)
"""Readers of files but BVH and GLB by their endings."""


def _read_tracks(path: Path, reading: Reading) -> Tracks:
    """Tracks of any file but BVH and GLB, of one subject where the format may hold several."""
    suffix = path.suffix.lower()
    if suffix not in READERS:
        hint = "; give the .amc, whose skeleton it is" if suffix == ".asf" else ""
        raise InputError(
            f"cannot read {shown(str(path))}: motions come as {' or '.join(SKELETAL)}, or as "
            f"{', '.join(sorted(READERS))}{hint}"
        )
    if reading.flavour is not None:
        raise InputError(
            f"flavour {shown(reading.flavour)} names the joints of {' or '.join(SKELETAL)} files, and {suffix} files name "
            "theirs otherwise; leave flavour out"
        )
    return READERS[suffix](path, reading)
