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
from typing import Concatenate, ParamSpec

import numpy as np

from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion import load_motion
from t2d_rt.types.motion import Motion
from validation.report import Section, at_most
from validation.robustness.motion_tables import FORMS, Table, clean

AGREES_MPS = 0.05
"""Difference of RMS speeds of pelvis and feet that is no other motion; 5 % of a walker's."""


# --- corruptions ---


P = ParamSpec("P")


def _change(altered: Callable[Concatenate[Table, P], Table]) -> Callable[P, Callable[[Table], Table]]:
    """A corruption by its figures: `altered` gets a copy of the table before them."""

    def of_figures(*figures: P.args, **named: P.kwargs) -> Callable[[Table], Table]:
        return lambda table: altered(replace(table, values=table.values.copy()), *figures, **named)

    return of_figures


@_change
def _lost(table: Table, frames: slice, value: float, joint: str | None = None) -> Table:
    """Frames, or one joint in them, at a value that stands for "not seen"; of a format with rotations the whole row."""
    here = slice(round(frames.start * table.rate_hz), round(frames.stop * table.rate_hz))
    (table.point(joint) if joint and table.names else table.values)[here] = value
    return table


@_change
def _held(table: Table, frames: slice, part: str = "values") -> Table:
    """The body, or its root alone, held over a time [s]."""
    first, stop = round(frames.start * table.rate_hz), round(frames.stop * table.rate_hz)
    getattr(table, part)[first:stop] = getattr(table, part)[first]
    return table


@_change
def _held_joint(table: Table) -> Table:
    track = table.point("left_wrist") if table.names else table.turns[:, 3 * 18 : 3 * 18 + 3]
    track[60:66] = track[60]
    return table


@_change
def _repeated(table: Table, source_hz: float, file_hz: float, dither: float = 0.0) -> Table:
    """A slower source held to a file's rate."""
    motion = len(table.values) / table.rate_hz
    at = np.arange(int(motion * source_hz)) / source_hz * table.rate_hz
    low = np.floor(at).astype(int).clip(0, len(table.values) - 2)
    part = (at - low).reshape(-1, *[1] * (table.values.ndim - 1))
    source = (1 - part) * table.values[low] + part * table.values[low + 1]
    shown = np.floor(np.arange(int(motion * file_hz)) / file_hz * source_hz + 1e-9).astype(int)
    values = source[shown.clip(0, len(source) - 1)]
    values = values + dither * np.random.default_rng(0).choice([-1.0, 0.0, 1.0], values.shape)
    return replace(table, values=values, rate_hz=file_hz)


@_change
def _moved(table: Table, start_s: float, stop_s: float | None, by_m: float) -> Table:
    """The whole body elsewhere from one time to another, or to the end."""
    stop = None if stop_s is None else round(stop_s * table.rate_hz)
    table.root[round(start_s * table.rate_hz) : stop, ..., 0] += by_m * table.metre
    return table


@_change
def _cut_out(table: Table, start_s: float, stop_s: float) -> Table:
    """Frames cut out of the take."""
    first, stop = round(start_s * table.rate_hz), round(stop_s * table.rate_hz)
    return replace(table, values=np.delete(table.values, slice(first, stop), axis=0))


@_change
def _swapped(table: Table, start_s: float, stop_s: float | None, *joints: str) -> Table:
    """Left for right."""
    here = slice(round(start_s * table.rate_hz), None if stop_s is None else round(stop_s * table.rate_hz))
    for joint in joints:
        left, right = (table.point(f"{side}_{joint}") for side in ("left", "right"))
        left[here], right[here] = right[here].copy(), left[here].copy()
    return table


@_change
def noisy(table: Table, place_m: float, degrees: float) -> Table:
    """Noise of each frame: of places, and of angles."""
    rng = np.random.default_rng(1)
    table.root[...] += table.metre * place_m * rng.normal(size=table.root.shape)
    if not table.names:
        table.turns[...] += table.degree * degrees * rng.normal(size=table.turns.shape)
    return table


@_change
def _spike(table: Table) -> Table:
    if table.names:
        table.point("left_ankle")[50:52] += [0.5, 0.4, 0.3]
    else:
        table.root[50:52] += 0.6 * table.metre
    return table


@_change
def _scattered(table: Table) -> Table:
    """A tenth of the joints' samples, or of the frames, not there."""
    rng = np.random.default_rng(2)
    table.values[rng.random(table.values.shape[: table.values.ndim - 1]) < 0.1] = np.nan
    return table


@_change
def _other(table: Table) -> Table:
    """The tracker goes over to somebody else 2 m aside for a third of a second, who walks the other way."""
    first, stop = len(table.values) // 3, len(table.values) // 3 + round(table.rate_hz / 3)
    table.values[first:stop] = table.values[first:stop][::-1].copy()
    table.root[first:stop, ..., 0] += 2.0 * table.metre
    return table


@_change
def _two_subjects(table: Table) -> Table:
    """A second person, 1.5 m aside and the other way, whose points follow under another prefix."""
    other = table.values[::-1] + np.array([1.5, 0.0, 0.0])
    names = tuple(f"{who}:{name}" for who in ("Ann", "Ben") for name in table.names)
    return replace(table, values=np.concatenate([table.values, other], axis=1), names=names)


@_change
def _tilted(table: Table, degrees: float, rise_m: float) -> Table:
    """Seen by a camera that is pitched and stands above the floor (y up)."""
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
    return replace(table, values=table.values @ turn.T - np.array([0.0, rise_m, 0.0]))


@_change
def _clocked(table: Table, factor: float) -> Table:
    """A rate that is not that of the frames."""
    return replace(table, rate_hz=factor * table.rate_hz)


@_change
def _in_place(table: Table) -> Table:
    """The hips stay where they were."""
    if table.names:
        table.values[:] -= 0.5 * (table.point("left_hip") + table.point("right_hip"))[:, None]
    else:
        table.root[:] = table.root[:1]
    return table


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
    "a tenth lost at random": (_scattered(), BRIDGED, FORMS),
    "frozen for 0.1 s": (_held(slice(1.0, 1.1)), JUMP, FORMS),
    "frozen for 0.2 s": (_held(slice(1.5, 1.7)), JUMP, FORMS),
    "frozen for 0.5 s": (_held(slice(1.0, 1.5)), JUMP, FORMS),
    "the root held for 0.2 s": (_held(slice(1.0, 1.2), "root"), JUMP, FORMS),
    "the root held for 0.4 s": (_held(slice(1.0, 1.4), "root"), JUMP, FORMS),
    "a wrist held for 0.1 s": (_held_joint(), JUMP, POINTS),
    "0.4 s cut out": (_cut_out(1.0, 1.4), JUMP, FORMS),
    "0.2 s cut out": (_cut_out(1.3, 1.5), JUMP, FORMS),
    "moved by 1 m": (_moved(1.5, None, 1.0), JUMP, FORMS),
    "moved by 0.3 m": (_moved(1.5, None, 0.3), JUMP, FORMS),
    "away by 2 m for 0.1 s": (_moved(1.5, 1.6, 2.0), JUMP, FORMS),
    "away by 2 m for 0.6 s": (_moved(1.2, 1.8, 2.0), JUMP, FORMS),
    "another person for 0.3 s": (_other(), JUMP, FORMS),
    "a spike": (_spike(), JUMP, FORMS),
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
    "two subjects": (_two_subjects(), ("Ben", "Ann"), ("trc", "npz")),
    "a camera pitched by 10 degrees": (_tilted(10.0, 0.7), ("level", "tilt", "turned"), POINTS),
    "a camera pitched by 25 degrees": (_tilted(25.0, 1.2), ("level", "tilt", "turned"), POINTS),
    "twice the rate": (_clocked(2.0), ("would fit",), ("bvh", "trc", "npz")),
    "in place": (_in_place(), ("hips never move",), FORMS),
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
        checks=[at_most("files that pass as another motion without a word", len(silent), 0)],
        table=table,
    )
