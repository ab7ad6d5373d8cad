"""Motion files with one fault each, in five formats: none may pass as another motion without a word.

A file's table holds points (T, K, 3) or, of a format with rotations, rows of the root's place and angles. A corruption changes
the table or the rate that is written; the motion read must then agree with the one that was written, or a warning, an error or a
clause of the report must name the cause.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from t2d_rt.errors import InputError, T2DWarning
from t2d_rt.motion import load_motion, resample
from t2d_rt.motion.read.joint_sets import ORDERS, canonical_sources
from t2d_rt.motion.write import bvh_text
from t2d_rt.types.motion import Motion
from validation.motions import independent
from validation.report import Check, Section

WALK = Path(__file__).parent.parent / "motions" / "iclone_002_01_walk.bvh.gz"
RATE_HZ = 60.0
FORMS = ("bvh", "amass", "trc", "npz", "npy")
SMPL_ANGLES = 66

AGREES_MPS = 0.05
"""Difference of RMS speeds of pelvis and feet that is no other motion; 5 % of a walker's."""


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


# --- corruptions ---


def _lost(frames: slice, value: float, joint: str | None = None) -> Callable[[Table], Table]:
    """Frames, or one joint in them, at a value that stands for "not seen"; of a format with rotations the whole row."""

    def corrupted(table: Table) -> Table:
        found = _copy(table)
        here = slice(round(frames.start * table.rate_hz), round(frames.stop * table.rate_hz))
        (found.point(joint) if joint and table.names else found.values)[here] = value
        return found

    return corrupted


def _held(frames: slice, part: str = "values") -> Callable[[Table], Table]:
    """The body, or its root alone, held over a time [s]."""

    def corrupted(table: Table) -> Table:
        found = _copy(table)
        first, stop = round(frames.start * table.rate_hz), round(frames.stop * table.rate_hz)
        getattr(found, part)[first:stop] = getattr(found, part)[first]
        return found

    return corrupted


def _held_joint(table: Table) -> Table:
    found = _copy(table)
    track = found.point("left_wrist") if table.names else found.turns[:, 3 * 18 : 3 * 18 + 3]
    track[60:66] = track[60]
    return found


def _repeated(source_hz: float, file_hz: float, dither: float = 0.0) -> Callable[[Table], Table]:
    """A slower source held to a file's rate."""

    def corrupted(table: Table) -> Table:
        motion = len(table.values) / table.rate_hz
        at = np.arange(int(motion * source_hz)) / source_hz * table.rate_hz
        low = np.floor(at).astype(int).clip(0, len(table.values) - 2)
        part = (at - low).reshape(-1, *[1] * (table.values.ndim - 1))
        source = (1 - part) * table.values[low] + part * table.values[low + 1]
        shown = np.floor(np.arange(int(motion * file_hz)) / file_hz * source_hz + 1e-9).astype(int)
        values = source[shown.clip(0, len(source) - 1)]
        values = values + dither * np.random.default_rng(0).choice([-1.0, 0.0, 1.0], values.shape)
        return replace(table, values=values, rate_hz=file_hz)

    return corrupted


def _moved(start_s: float, stop_s: float | None, by_m: float) -> Callable[[Table], Table]:
    """The whole body elsewhere from one time to another, or to the end."""

    def corrupted(table: Table) -> Table:
        found = _copy(table)
        stop = None if stop_s is None else round(stop_s * table.rate_hz)
        found.root[round(start_s * table.rate_hz) : stop, ..., 0] += by_m * table.metre
        return found

    return corrupted


def _cut_out(start_s: float, stop_s: float) -> Callable[[Table], Table]:
    """Frames cut out of the take."""

    def corrupted(table: Table) -> Table:
        first, stop = round(start_s * table.rate_hz), round(stop_s * table.rate_hz)
        return replace(table, values=np.delete(table.values, slice(first, stop), axis=0))

    return corrupted


def _swapped(start_s: float, stop_s: float | None, *joints: str) -> Callable[[Table], Table]:
    """Left for right."""

    def corrupted(table: Table) -> Table:
        found = _copy(table)
        here = slice(round(start_s * table.rate_hz), None if stop_s is None else round(stop_s * table.rate_hz))
        for joint in joints:
            left, right = (found.point(f"{side}_{joint}") for side in ("left", "right"))
            left[here], right[here] = right[here].copy(), left[here].copy()
        return found

    return corrupted


def noisy(place_m: float, degrees: float) -> Callable[[Table], Table]:
    """Noise of each frame: of places, and of angles."""

    def corrupted(table: Table) -> Table:
        found, rng = _copy(table), np.random.default_rng(1)
        found.root[...] += table.metre * place_m * rng.normal(size=found.root.shape)
        if not table.names:
            found.turns[...] += table.degree * degrees * rng.normal(size=found.turns.shape)
        return found

    return corrupted


def _spike(table: Table) -> Table:
    found = _copy(table)
    if table.names:
        found.point("left_ankle")[50:52] += [0.5, 0.4, 0.3]
    else:
        found.root[50:52] += 0.6 * table.metre
    return found


def _scattered(table: Table) -> Table:
    """A tenth of the joints' samples, or of the frames, not there."""
    found, rng = _copy(table), np.random.default_rng(2)
    found.values[rng.random(found.values.shape[: found.values.ndim - 1]) < 0.1] = np.nan
    return found


def _other(table: Table) -> Table:
    """The tracker goes over to somebody else 2 m aside for a third of a second, who walks the other way."""
    found = _copy(table)
    first, stop = len(table.values) // 3, len(table.values) // 3 + round(table.rate_hz / 3)
    found.values[first:stop] = table.values[first:stop][::-1]
    found.root[first:stop, ..., 0] += 2.0 * table.metre
    return found


def _copy(table: Table) -> Table:
    return replace(table, values=table.values.copy())


BRIDGED, JUMP, HELD, NOISE = ("bridged",), ("jumps", "swapped", "bridged"), ("stood", "bridged"), ("noise", "smoothed")
POINTS, ROTATIONS = ("trc", "npz", "npy"), ("bvh", "amass")

CORRUPTIONS: dict[str, tuple[Callable[[Table], Table], tuple[str, ...], tuple[str, ...]]] = {
    "a wrist at 0 for 0.1 s": (_lost(slice(1.0, 1.1), 0.0, "left_wrist"), BRIDGED, POINTS),
    "an ankle at -1 for 0.2 s": (_lost(slice(1.0, 1.2), -1.0, "right_ankle"), BRIDGED, POINTS),
    "a knee at -9999 for 0.1 s": (_lost(slice(0.5, 0.6), -9999.0, "left_knee"), BRIDGED, POINTS),
    "an elbow at 1e6 for 0.1 s": (_lost(slice(0.5, 0.6), 1e6, "left_elbow"), BRIDGED, POINTS),
    "a wrist lost for 0.2 s": (_lost(slice(1.5, 1.7), np.nan, "right_wrist"), BRIDGED, POINTS),
    "a knee lost for 0.6 s": (_lost(slice(0.6, 1.2), np.nan, "left_knee"), BRIDGED, POINTS),
    "a wrist at 0 for 0.7 s": (_lost(slice(0.6, 1.3), 0.0, "left_wrist"), BRIDGED, POINTS),
    "a wrist at 0 from the start": (_lost(slice(0.0, 0.4), 0.0, "left_wrist"), ("cut",), POINTS),
    "a wrist never seen": (_lost(slice(0.0, 9.0), 0.0, "left_wrist"), ("seen",), POINTS),
    "frames lost for 0.15 s": (_lost(slice(1.0, 1.15), np.nan), BRIDGED, FORMS),
    "frames of zeros for 0.15 s": (_lost(slice(1.0, 1.15), 0.0), BRIDGED, FORMS),
    "frames lost for 0.8 s": (_lost(slice(0.5, 1.3), np.nan), BRIDGED, FORMS),
    "frames of zeros for 0.8 s": (_lost(slice(0.5, 1.3), 0.0), BRIDGED, FORMS),
    "a tenth lost at random": (_scattered, BRIDGED, FORMS),
    "frozen for 0.1 s": (_held(slice(1.0, 1.1)), JUMP, FORMS),
    "frozen for 0.2 s": (_held(slice(1.5, 1.7)), JUMP, FORMS),
    "frozen for 0.5 s": (_held(slice(1.0, 1.5)), JUMP, FORMS),
    "the root held for 0.2 s": (_held(slice(1.0, 1.2), "root"), JUMP, FORMS),
    "the root held for 0.4 s": (_held(slice(1.0, 1.4), "root"), JUMP, FORMS),
    "a wrist held for 0.1 s": (_held_joint, JUMP, POINTS),
    "0.4 s cut out": (_cut_out(1.0, 1.4), JUMP, FORMS),
    "0.2 s cut out": (_cut_out(1.3, 1.5), JUMP, FORMS),
    "moved by 1 m": (_moved(1.5, None, 1.0), JUMP, FORMS),
    "moved by 0.3 m": (_moved(1.5, None, 0.3), JUMP, FORMS),
    "away by 2 m for 0.1 s": (_moved(1.5, 1.6, 2.0), JUMP, FORMS),
    "away by 2 m for 0.6 s": (_moved(1.2, 1.8, 2.0), JUMP, FORMS),
    "another person for 0.3 s": (_other, JUMP, FORMS),
    "a spike": (_spike, JUMP, FORMS),
    "all sides swapped for 0.1 s": (
        _swapped(1.0, 1.1, "hip", "knee", "ankle", "shoulder", "elbow", "wrist"), JUMP, POINTS,
    ),
    "legs swapped for 0.1 s": (_swapped(1.0, 1.1, "knee", "ankle"), JUMP, POINTS),
    "legs swapped for 0.5 s": (_swapped(1.0, 1.5, "knee", "ankle"), JUMP, POINTS),
    "arms swapped to the end": (_swapped(1.0, None, "elbow", "wrist"), JUMP, POINTS),
    "20 in 60 Hz": (_repeated(20.0, 60.0), HELD, FORMS),
    "30 in 60 Hz": (_repeated(30.0, 60.0), HELD, FORMS),
    "20 in 30 Hz": (_repeated(20.0, 30.0), HELD, FORMS),
    "25 in 60 Hz": (_repeated(25.0, 60.0), HELD, FORMS),
    "24 in 30 Hz": (_repeated(24.0, 30.0), HELD, FORMS),
    "20 in 60 Hz, last digit loose": (_repeated(20.0, 60.0, 1e-4), HELD, FORMS),
    "noise of 3 mm and 1 degree": (noisy(0.003, 1.0), NOISE, FORMS),
    "noise of 10 mm and 2 degrees": (noisy(0.01, 2.0), NOISE, FORMS),
}  # fmt: skip
"""What is done to a file, the words of which one must be said where another motion is read, and the formats that can have it."""


# --- judged ---


@dataclass(frozen=True)
class Outcome:
    """What became of one corrupted file."""

    form: str
    corruption: str
    said: str
    """Warnings and report, or the error."""
    error_mps: float
    """Greatest difference of RMS speeds of pelvis and feet; infinite where the file is refused."""
    named: bool
    """Whether the cause was said."""

    @property
    def silent(self) -> bool:
        """Whether another motion was read without a word of the cause."""
        return self.error_mps > AGREES_MPS and not self.named


def outcome(form: str, name: str) -> Outcome:
    """One corruption of the walk in one format, read back."""
    change, words, _ = CORRUPTIONS[name]
    table = clean(form)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", T2DWarning)
        options = {"rate_hz": change(table).rate_hz} if form == "npy" else {}
        try:
            motion = load_motion(change(table).write(Path(folder)), **options)
        except InputError as error:
            return Outcome(form, name, str(error), np.inf, any(word in str(error) for word in words))
        said = "; ".join([motion.report, *(str(each.message) for each in caught)])
    wrong = float(np.abs(_speeds(motion) - _true_speeds(form)).max())
    return Outcome(form, name, said, wrong, any(word in said for word in words))


@cache
def _true_speeds(form: str) -> np.ndarray:
    table = clean(form)
    with tempfile.TemporaryDirectory() as folder:
        return _speeds(load_motion(table.write(Path(folder)), rate_hz=table.rate_hz))


def _speeds(motion: Motion) -> np.ndarray:
    """RMS speeds of pelvis and feet [m/s]."""
    joints = motion.joints[:, [motion.index(name) for name in ("pelvis", "left_foot", "right_foot")]]
    return np.asarray(np.sqrt(((np.diff(joints, axis=0) * motion.rate_hz) ** 2).sum(axis=-1).mean(axis=0)))


def run() -> Section:
    found = [outcome(form, name) for name, (_, _, forms) in CORRUPTIONS.items() for form in forms]
    silent = [each for each in found if each.silent]
    agree = sum(each.error_mps <= AGREES_MPS for each in found)
    refused = sum(np.isinf(each.error_mps) for each in found)
    table = [
        {
            "form": each.form,
            "corruption": each.corruption,
            "off, m/s": round(each.error_mps, 2),
            "said": each.said[:200],
        }
        for each in silent
    ]
    return Section(
        title="Corrupted motion files",
        note=f"{len(CORRUPTIONS)} corruptions of a walk in the formats that can have them, {len(found)} files: {agree} are read as "
        f"the motion that was written (RMS speeds of pelvis and feet within {AGREES_MPS} m/s), {refused} are refused, of the "
        f"others {len(found) - agree - refused - len(silent)} name the cause.",
        checks=[Check(what="files that pass as another motion without a word", measured=len(silent), limit=0, unit="")],
        table=table,
    )
