"""`RadarTrack`: positions and orientations of a moving radar over time; rigid motions between the world and its frame.

A moving radar is simulated in the frame of its antennas, as a radar that stands still in a world that moves: it keeps the
`position_m` and `boresight` of the beginning of its track, and the world moves past it.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from t2d_rt.core.checks import array, shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes, read_yaml, regular_file
from t2d_rt.types.fields import Fields, Number, Vector
from t2d_rt.types.mesh import Track
from t2d_rt.types.splines import checked_times, spline, within

MOST_POSES = 100_000
"""Greatest number of poses in one track."""
MOST_BYTES = 100_000_000
"""Greatest size of a track's file [bytes]."""
COLUMNS = "t", "x", "y", "z", "yaw", "pitch", "roll"
"""Columns of a track's file: seconds, metres, degrees; the three angles may be left out."""


def _listed(value: Any) -> Any:
    """An array as nested lists."""
    return value.tolist() if isinstance(value, np.ndarray) else value


Times = Annotated[tuple[Number, ...], BeforeValidator(_listed), Field(min_length=2, max_length=MOST_POSES)]
Places = Annotated[tuple[Vector, ...], BeforeValidator(_listed), Field(min_length=2, max_length=MOST_POSES)]
Quaternions = Annotated[
    tuple[tuple[Number, Number, Number, Number], ...],
    BeforeValidator(_listed),
    Field(min_length=2, max_length=MOST_POSES),
]


class Rigid(NamedTuple):
    """Rigid motions at K times: a point x moves to `rotation` x + `shift_m`."""

    rotation: np.ndarray
    """Rotation matrices (K, 3, 3)."""
    shift_m: np.ndarray
    """Translations [m], (K, 3)."""

    @property
    def back(self) -> Rigid:
        """The inverse motions."""
        rotated = self.rotation.swapaxes(1, 2)
        return Rigid(rotated, -np.einsum("kij,kj->ki", rotated, self.shift_m))

    def points(self, points_m: np.ndarray) -> np.ndarray:
        """Points (K, ..., 3) m after the motions."""
        return self.directions(points_m) + _spread(self.shift_m, points_m.ndim)

    def directions(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (K, ..., 3) after the rotations."""
        flat = vectors.reshape(len(vectors), -1, 3)
        return np.asarray((flat @ self.rotation.swapaxes(1, 2)).reshape(vectors.shape))


def _spread(values: np.ndarray, axes: int) -> np.ndarray:
    return values.reshape(len(values), *[1] * (axes - 2), 3)


class RadarTrack(Fields):
    """Poses of a radar over time. Between them the position, and the quaternion, follow C2 cubic splines.

    >>> track = RadarTrack(times_s=[0, 1], positions_m=[(0, 0, 1), (1, 0, 1)])
    >>> track.places_m(np.array([0.25])).tolist()
    [[0.25, 0.0, 1.0]]
    """

    noun: ClassVar[str] = "radar track"
    written: ClassVar[dict[str, str]] = {
        "times_s": "a list of seconds",
        "positions_m": "a list of positions, as in [[0, 0, 1], [0.5, 0, 1]]",
        "orientations": "a list of quaternions x, y, z, w",
    }

    times_s: Times
    """Times of the poses on the clock of the targets [s], increasing, (T,)."""
    positions_m: Places
    """Positions of the radar in the world [m], (T, 3)."""
    orientations: Quaternions | None = None
    """Unit quaternions x, y, z, w that rotate the radar's frame (x boresight, y left, z up) into the world, (T, 4); left out where
    it keeps its boresight."""

    @model_validator(mode="after")
    def _check_lengths(self) -> Self:
        times_s = checked_times(self.times_s)
        for name in ("positions_m", "orientations"):
            values = getattr(self, name)
            if values is not None and len(values) != len(times_s):
                raise InputError(
                    f"radar track: {name} has {len(values)} poses at {len(times_s)} times_s; give one for each time"
                )
        if self.orientations is not None:
            lengths = np.linalg.norm(self.orientations, axis=1)
            if not lengths.min() > 1e-6:
                raise InputError(
                    "radar track: orientations must be quaternions x, y, z, w, got one of no length; 0, 0, 0, 1 is no rotation"
                )
        return self

    @classmethod
    def of_angles(cls, times_s: Any, positions_m: Any, yaw_pitch_roll_deg: Any) -> RadarTrack:
        """A track from angles [deg], (T, 3): azimuth of the boresight (left > 0), its elevation (up > 0), roll (left side up >
        0)."""
        from scipy.spatial.transform import Rotation

        hint = "give yaw, pitch and roll of each pose"
        angles = array("yaw_pitch_roll_deg", yaw_pitch_roll_deg, ("T", 3), hint=hint) * [1, -1, 1]
        return cls(
            times_s=times_s, positions_m=positions_m, orientations=Rotation.from_euler("ZYX", angles, True).as_quat()
        )

    @classmethod
    def read(cls, path: str | Path) -> RadarTrack:
        """Reads a track from a file: .csv whose first line is "t,x,y,z" or "t,x,y,z,yaw,pitch,roll" (seconds, metres, degrees as in
        `of_angles`; semicolons, tabs and decimal commas of spreadsheets are understood), .npz of arrays of these names, or .yaml of
        a track's fields."""
        path = Path(path)
        kind = path.suffix.lower()
        if kind in (".yaml", ".yml"):
            return cls(**read_yaml(path, noun="radar track", example="times_s and positions_m"))
        columns = {".csv": _of_csv, ".npz": _of_npz}.get(kind)
        if columns is None:
            raise InputError(f"{path}: a radar's track must be a .csv, .npz or .yaml file, got {shown(path.name)}")
        column_values = columns(path)
        names = COLUMNS[: len(column_values)]
        if len(names) not in (4, len(COLUMNS)) or set(names) != set(column_values):
            raise InputError(
                f"{path}: a radar's track needs {', '.join(COLUMNS[:4])}, or these and {', '.join(COLUMNS[4:])}, and no others, "
                f"got {', '.join(column_values) or 'nothing'}"
            )
        values = np.stack([column_values[name] for name in names], axis=1)
        if len(names) == 4:
            return cls(times_s=values[:, 0], positions_m=values[:, 1:])
        return cls.of_angles(values[:, 0], values[:, 1:4], values[:, 4:])

    def places_m(self, times_s: np.ndarray) -> np.ndarray:
        """Positions of the radar at times [s] (K,) within the track, (K, 3) m."""
        return self._curves[0](self._within(times_s))

    @property
    def reach_m(self) -> float:
        """Greatest distance of the radar from the position where its track begins [m]."""
        places = np.array(self.positions_m)
        return float(np.linalg.norm(places - places[0], axis=1).max())

    def axes(self, times_s: np.ndarray) -> np.ndarray | None:
        """Unit vectors boresight, left and up in the world at these times, as rows of (K, 3, 3); None where they do not change."""
        from scipy.spatial.transform import Rotation

        turning = self._curves[1]
        if turning is None:
            return None
        return np.asarray(Rotation.from_quat(turning(self._within(times_s))).as_matrix().swapaxes(1, 2))

    def begins(self, position_m: Any = None, boresight: Any = None) -> dict[str, tuple[float, ...]]:
        """The radar's `position_m` at the first time, and its `boresight` if the track has orientations; values that are given must
        agree with these."""
        begin: dict[str, tuple[float, ...]] = {"position_m": self.positions_m[0]}
        axes = self.axes(np.array(self.times_s[:1]))
        if axes is not None:
            begin["boresight"] = tuple(axes[0, 0].tolist())
        for name, argument in (("position_m", position_m), ("boresight", boresight)):
            if argument is None or name not in begin:
                continue
            other = array(name, argument, (3,))
            length = max(float(np.linalg.norm(other)), 1e-12) if name == "boresight" else 1.0
            if np.abs(other / length - begin[name]).max() > 1e-9:
                raise InputError(
                    f"{name} of a radar that moves is where its track begins, {shown(begin[name])}, got {shown(argument)}; leave "
                    f"{name} out, or give another track"
                )
        return begin

    @cached_property
    def _known_s(self) -> np.ndarray:
        return np.array(self.times_s)

    @cached_property
    def _curves(self) -> tuple[Track, Track | None]:
        """Splines of the positions, and of the quaternions if there are any."""
        place = spline(self._known_s, np.array(self.positions_m))
        if self.orientations is None:
            return place, None
        quaternions = np.array(self.orientations)
        quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
        # q and -q are the same rotation; the sign closer to the pose before keeps the spline short.
        quaternions[1:] *= np.cumprod(np.where((quaternions[1:] * quaternions[:-1]).sum(-1) < 0, -1.0, 1.0))[:, None]
        return place, spline(self._known_s, quaternions)

    def _within(self, times_s: np.ndarray) -> np.ndarray:
        return within(times_s, self._known_s, "the radar's track")

    def __eq__(self, other: object) -> bool:
        # Cached curves are not fields, so they do not count.
        return isinstance(other, RadarTrack) and self._fields == other._fields

    def __hash__(self) -> int:
        return hash(self._fields)

    @property
    def _fields(self) -> tuple[Any, ...]:
        return self.times_s, self.positions_m, self.orientations

    def __repr__(self) -> str:
        turning = "" if self.orientations is None else ", turning"
        return f"RadarTrack({len(self.times_s)} poses from {self.times_s[0]:g} to {self.times_s[-1]:g} s{turning})"

    def __str__(self) -> str:
        return repr(self)


def _of_csv(path: Path) -> dict[str, np.ndarray]:
    """Columns of a table by the names in its first line."""
    lines = [
        line
        for line in read_bytes(path, limit=MOST_BYTES, noun="radar track").decode("utf-8-sig", "replace").splitlines()
        if line.strip(" \t,;")
    ]
    if len(lines) < 2:
        return {}
    comma = next((separator for separator in ";\t" if separator in lines[0]), ",")
    if comma != ",":  # spreadsheets whose decimal sign is the comma separate columns by semicolons or tabs
        lines[1:] = [line.replace(",", ".") for line in lines[1:]]
    rows = [[word.strip(' "') for word in line.rstrip(f"{comma} ").split(comma)] for line in lines]
    names = [name.lower() for name in rows[0]]
    if len(set(names)) < len(names):
        raise InputError(f"{path}: the first line of a radar's track must name each column once, got {shown(lines[0])}")
    try:
        values = np.array([[float(word) for word in row] for row in rows[1:]])
    except ValueError:
        raise InputError(
            f"{path}: rows of a radar's track must hold as many numbers each as its first line, {shown(lines[0])}, has names"
        ) from None
    if values.shape[1] != len(names):
        raise InputError(f"{path}: rows have {values.shape[1]} numbers and the first line names {len(names)} columns")
    return dict(zip(names, values.T, strict=True))


def _of_npz(path: Path) -> dict[str, np.ndarray]:
    """Arrays of an .npz file by name."""
    try:
        with regular_file(path, noun="radar track") as file, np.load(file, allow_pickle=False) as held:
            arrays = {name: held[name] for name in held.files}
    except InputError:
        raise
    except Exception:  # a damaged file may make numpy raise anything
        raise InputError(
            f"{path} is cut short, damaged or no .npz file of plain arrays; write it with numpy.savez"
        ) from None
    columns = {name: array(f"{path}: {name}", values) for name, values in arrays.items()}
    shapes = {values.shape for values in columns.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 1:
        raise InputError(f"{path}: arrays of a radar's track must be of one length (T,), got {sorted(shapes)}")
    return columns


def track_named(value: Any) -> Any:
    """A track, read from a file if its name is given."""
    return RadarTrack.read(value) if isinstance(value, (str, Path)) else value


def with_track_beside(fields: Mapping[str, Any], path: str | Path) -> dict[str, Any]:
    """Fields of a radar that were read from a file; the name of a track's file is taken relative to that file."""
    track_fields = dict(fields)
    if isinstance(track_fields.get("track"), str):
        track_fields["track"] = Path(path).parent / track_fields["track"]
    return track_fields
