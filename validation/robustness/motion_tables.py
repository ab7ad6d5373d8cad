"""A walk as files of five formats, whose tables can be changed before they are written."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from t2d_rt.motion import load_motion, resample
from t2d_rt.motion.read.joint_sets import ORDERS, canonical_sources
from t2d_rt.motion.write import bvh_text
from t2d_rt.types.motion import Motion
from validation.motions import independent

WALK = Path(__file__).parent.parent / "motions" / "iclone_002_01_walk.bvh.gz"
RATE_HZ = 60.0
FORMS = ("bvh", "amass", "trc", "npz", "npy")
SMPL_ANGLES = 66


@dataclass(frozen=True, kw_only=True)
class Table:
    """What a file of one format holds."""

    form: str
    values: np.ndarray
    """Points (T, K, 3), or rows (T, C) of the root's place and angles."""
    rate_hz: float = RATE_HZ
    names: tuple[str, ...] = ()
    """Of the points."""
    head: str = ""
    """Of a BVH file."""

    @property
    def root(self) -> np.ndarray:
        """Places of the body's root (T, 3), or of all points (T, K, 3): a view."""
        return self.values if self.names else self.values[:, :3]

    @property
    def turns(self) -> np.ndarray:
        """Angles (T, C - 3) of a format with rotations, in its own unit: a view."""
        return self.values[:, 3:]

    @property
    def metre(self) -> float:
        """The file's units in a metre."""
        return 100.0 if self.form == "bvh" else 1.0

    @property
    def degree(self) -> float:
        """The file's units in a degree."""
        return 1.0 if self.form == "bvh" else np.pi / 180

    def point(self, name: str) -> np.ndarray:
        """Places (T, 3) of a canonical joint among the points: a view."""
        return self.values[:, self.names.index(canonical_sources(self.names)[name][0])]

    def write(self, folder: Path) -> Path:
        """The file."""
        path = folder / f"a.{'npz' if self.form == 'amass' else self.form}"
        if self.form == "bvh":
            rows = "\n".join(" ".join(f"{value:.5f}" for value in row) for row in self.values.tolist())
            head = f"{self.head}\nMOTION\nFrames: {len(self.values)}\nFrame Time: {1 / self.rate_hz:.10g}\n"
            path.write_text(f"{head}{rows}\n")
        elif self.form == "amass":
            poses = np.pad(self.turns, ((0, 0), (0, 156 - SMPL_ANGLES)))
            np.savez(path, poses=poses, trans=self.root, mocap_framerate=self.rate_hz)
        elif self.form == "trc":
            path.write_text(
                independent.trc(dict(zip(self.names, np.moveaxis(self.values, 1, 0), strict=True)), self.rate_hz, "m")
            )
        elif self.form == "npz":
            np.savez(path, joints=self.values, names=np.array(self.names), fps=self.rate_hz)
        else:
            np.save(path, self.values)
        return path


@cache
def walk(rate_hz: float = RATE_HZ) -> Motion:
    """A recorded walk of 2.8 s, 1.34 m/s."""
    return resample(load_motion(WALK), rate_hz)


@cache
def clean(form: str) -> Table:
    """The walk in a format; of AMASS a walk of sines, 1.2 m/s."""
    motion = walk(30.0 if form == "npy" else RATE_HZ)
    if form == "bvh":
        head, text = bvh_text(motion).split("\nMOTION\n")
        return Table(form=form, values=np.array([row.split() for row in text.splitlines()[2:]], dtype=float), head=head)
    if form == "amass":
        return Table(form=form, values=_smpl_walk(3.0))
    points = motion.joints @ independent.Y_UP.T
    if form == "npz":
        return Table(form=form, values=points, names=motion.names)
    names = ORDERS["Kinect v2"][: 25 if form == "npy" else 21]
    sources = canonical_sources(names)
    place = {source[0]: joint for joint, source in sources.items()}
    columns = [motion.index(place.get(name, "head")) for name in names]
    return Table(form=form, values=points[:, columns], names=names, rate_hz=motion.rate_hz)


def _smpl_walk(duration_s: float) -> np.ndarray:
    """Rows of SMPL's root place and 22 axis-angle vectors: z up, along y, arms down, legs and arms swinging at 1 Hz."""
    times = np.arange(int(duration_s * RATE_HZ)) / RATE_HZ
    rows = np.zeros((len(times), 3 + SMPL_ANGLES))
    swing = np.sin(2 * np.pi * times)
    rows[:, 1], rows[:, 2] = 1.2 * times, 0.95 + 0.02 * np.cos(4 * np.pi * times)
    angles = rows[:, 3:].reshape(len(times), -1, 3)
    angles[:, 0, 0] = np.pi / 2  # SMPL's y to z
    for sign, hip, knee, shoulder in ((1, 1, 4, 16), (-1, 2, 5, 17)):
        angles[:, hip, 0] = -0.4 * sign * swing
        angles[:, knee, 0] = 0.4 + 0.35 * sign * np.cos(2 * np.pi * times)
        angles[:, shoulder, 2] = -1.3 * sign
        angles[:, shoulder, 1] = 0.3 * swing
    return rows
