"""Values that readers of files return: the joints of one person before they become a `Motion`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from t2d_rt.motion.read.detect import Up
from t2d_rt.motion.skeletons import Flavour


@dataclass(frozen=True, slots=True, kw_only=True)
class Times:
    """The times at which a file says that its frames were taken."""

    values: np.ndarray
    """Times (T,) in the unit `unit_s`."""
    name: str
    """Name of the times in the file."""
    unit_s: float | None
    """The unit [s]; None if the file does not tell it."""
    rate_name: str = "its rate"
    """Name of the stated rate in the file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FileSkeleton:
    """What a BVH or GLB file tells of a body beside its motion."""

    flavour: Flavour
    matched: bool
    """Whether the flavour was matched by names and form, because none of the known ones fits."""
    rest: dict[str, np.ndarray]
    """Positions (1, 3) by canonical name in the pose without rotations."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracks:
    """Joints of one person by canonical name, in the file's own unit and axes until `passes` has found them."""

    form: str
    """Name of the format that the file was read as."""
    points: dict[str, np.ndarray]
    """Positions (T, 3) by canonical name, NaN where missing; it has the limbs' joints at least."""
    rate_hz: float
    turned: dict[str, np.ndarray] = field(default_factory=dict)
    """Global orientations x, y, z, w (T, 4) of the same joints; empty where the file holds positions alone."""
    times: Times | None = None
    """The times at which the frames were taken, if the file tells them."""
    start_s: float = 0.0
    """Time on the file's clock of the first frame that is kept [s]."""
    rate_assumed: bool = False
    """Whether the rate is the format's usual one, which the file does not give."""
    clauses: tuple[str, ...] = ()
    """What was assumed and done, in clauses for the report."""
    unit_m: float | None = None
    """The format's own unit [m]; if None, the unit is found from the body."""
    up: Up | None = None
    """The format's own upward axis."""
    up_certain: bool = True
    """Whether files of this format keep to it; else a body that stands along another axis decides."""
    skeleton: FileSkeleton | None = None
    """The skeleton of a BVH or GLB file; None of other formats."""

    def __len__(self) -> int:
        """Number of frames."""
        return len(next(iter(self.points.values())))

    @property
    def joints(self) -> np.ndarray:
        """Positions (T, J, 3) in the order of `points`."""
        return np.stack(list(self.points.values()), axis=1)

    def at(self, frames: slice | np.ndarray) -> Tracks:
        """The tracks at some of the frames."""
        points, turned = ({name: track[frames] for name, track in kind.items()} for kind in (self.points, self.turned))
        return replace(self, points=points, turned=turned)

    def piece(self, start: int, stop: int | None = None) -> Tracks:
        """The frames from `start` to before `stop`, which keep their time."""
        return replace(self.at(slice(start, stop)), start_s=self.start_s + start / self.rate_hz)

    def without(self, lost: np.ndarray) -> Tracks:
        """The tracks with NaN as positions in the `lost` frames (T,)."""
        return replace(self, points={n: np.where(lost[:, None], np.nan, track) for n, track in self.points.items()})

    def saying(self, *clauses: str) -> Tracks:
        """The tracks with further clauses for the report."""
        return replace(self, clauses=(*self.clauses, *clauses))
