"""Read bones with positions and orientations in the world, as inertial suits (MVNX) and Motive (CSV) export them.

Their names are in skeletons.yaml (Xsens' segments, Motive's own names or those of FBX). Such files give the position of each bone's
joint to the bone above, and the bone's orientation.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from t2d_rt.core.checks import numbered, shown
from t2d_rt.core.errors import InputError, printable
from t2d_rt.core.files import read_bytes
from t2d_rt.motion.quaternions import normalise
from t2d_rt.motion.read.bvh import MAX_FRAMES
from t2d_rt.motion.read.clock import TIME_FIELD, UNITS_S
from t2d_rt.motion.read.markers import MAX_MARKERS, people_of_markers
from t2d_rt.motion.read.samples import filled, plausible
from t2d_rt.motion.read.subjects import Labels, People, people_of_labels
from t2d_rt.motion.read.tracks import Times, Tracks
from t2d_rt.motion.skeletons import canonical, nearest_flavour

MAX_BYTES = 250_000_000

Bones = Mapping[str, np.ndarray]
"""Position and orientation (T, 7) of each bone: x, y, z and a quaternion x, y, z, w; without orientations (T, 3)."""


def of_bones(form: str, bones: Bones, rate_hz: float) -> Tracks:
    """Tracks of one person's bones by the flavour of their names; raises an InputError if bones are missing."""
    flavour, absent = nearest_flavour(tuple(bones))
    if absent:
        raise InputError(
            f"{form}: bones {shown(list(bones))} lack {', '.join(absent[:8])} of the names that are nearest, {flavour.name}; "
            "export the skeleton with its usual names"
        )
    values: np.ndarray = np.stack([plausible(bone) for bone in bones.values()], axis=1)
    rows, lost = filled(values.reshape(len(values), -1), form, slice(3))
    values = rows.reshape(len(rows), len(bones), -1)
    has_turns = values.shape[2] == 7
    turned = values[..., 3:] if has_turns else np.broadcast_to([0.0, 0.0, 0.0, 1.0], (len(rows), len(bones), 4))
    # Files write quaternions with four digits or more.
    if not np.abs(np.linalg.norm(turned, axis=-1) - 1).max() < 0.05:
        raise InputError(f"{form}: rotations must be unit quaternions; the file is of another kind or damaged")
    points, turns = canonical(list(bones), flavour, values[..., :3], normalise(turned))
    tracks = Tracks(form=form, points=points, turned=turns if has_turns else {}, rate_hz=rate_hz)
    return tracks.saying(f"bones named as {flavour.name}").without(lost)


# --- MVNX, the XML of Xsens' MVN: segments with origin [m] and quaternion w, x, y, z, z up, facing x ---


def read_mvnx(path: Path) -> People:
    """The subjects of an MVNX file, from frames of type normal; the calibration poses before them are left out."""
    data = read_bytes(path, limit=MAX_BYTES, noun="MVNX file")
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise InputError(f"{path} has a document type (<!DOCTYPE), which no MVNX file needs; delete it")
    subjects: dict[str, tuple[list[str], list[np.ndarray], list[float], float]] = {}
    segments: list[str] = []
    rows: list[np.ndarray] = []
    times: list[float] = []
    try:
        for _, element in ElementTree.iterparse(io.BytesIO(data)):
            tag = element.tag.rpartition("}")[2]
            if tag == "segment":
                segments.append(element.get("label", ""))
            elif tag == "frame":
                if element.get("type", "normal") == "normal":
                    rows.append(_segments(element, len(segments)))
                    times.append(float(element.get("time") or "nan"))
                    if len(rows) > MAX_FRAMES:
                        raise InputError(f"{path} has more than {MAX_FRAMES} frames; cut the motion into shorter files")
                element.clear()
            elif tag == "subject":
                (name,) = numbered([printable(element.get("label", "")) or str(len(subjects) + 1)], taken=subjects)
                subjects[name] = segments, rows, times, float(element.get("frameRate", "nan"))
                segments, rows, times = [], [], []
    except InputError:
        raise
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"{path} is not a whole MVNX file ({error}); export it again") from None
    if not subjects:
        raise InputError(f"{path} has no <subject>; give the .mvnx that MVN exports")
    return {name: partial(_of_subject, *values) for name, values in subjects.items()}


def _segments(frame: ElementTree.Element, count: int) -> np.ndarray:
    """Positions and quaternions x, y, z, w of all segments in a frame, (N, 7)."""
    texts = {child.tag.rpartition("}")[2]: child.text or "" for child in frame}
    if not {"position", "orientation"} <= texts.keys():
        raise InputError("its frames lack position or orientation; export both, of all segments")
    place, turn = (np.array(texts[name].split(), float) for name in ("position", "orientation"))
    if place.size != 3 * count or turn.size != 4 * count:
        raise InputError(
            f"a frame must hold 3 and 4 numbers for each of {count} segments, got {place.size} and {turn.size}"
        )
    return np.concatenate([place.reshape(-1, 3), turn.reshape(-1, 4)[:, [1, 2, 3, 0]]], axis=1)


def _of_subject(segments: list[str], rows: list[np.ndarray], times: list[float], rate_hz: float) -> Tracks:
    if not rows:
        raise InputError("it holds no frames of type normal; record a motion")
    values = np.stack(rows)
    bones = {label: values[:, place] for place, label in enumerate(segments)}
    has_times = np.isfinite(times).all() and len(times) > 1
    tracks = of_bones("MVNX", bones, rate_hz if rate_hz > 0 else 60.0)
    clock = Times(values=np.array(times), name="time", unit_s=1e-3, rate_name="frameRate") if has_times else None
    return replace(tracks, unit_m=1.0, up="z", times=clock, rate_assumed=not rate_hz > 0)


# --- CSV: Motive's (OptiTrack), or any table with three columns for each point, NAME_X, NAME_Y, NAME_Z ---


UNITS_M = {"meters": 1.0, "centimeters": 0.01, "millimeters": 0.001, "inches": 0.0254, "feet": 0.3048}
COLUMN = re.compile(r"(.+?)[ _.:-]*([xyz])(?:[ _]*[(\[]?(?:m|cm|mm)[)\]]?)?", re.IGNORECASE)


def read_csv(path: Path) -> People:
    """The subjects of a CSV file: bones or markers that Motive exported, or the points of a plain table."""
    text = read_bytes(path, limit=100_000_000, noun="CSV file").decode("utf-8-sig", "replace")
    first = text.partition("\n")[0]
    mark = max(",;\t", key=first.count)
    rows = [row for row in csv.reader(io.StringIO(text, newline=""), delimiter=mark) if any(map(str.strip, row))]
    if len(rows) < 3 or not any(map(first.count, ",;\t")) or max(map(len, rows)) > 10_000:
        raise InputError(f"{path} is no table of points; give Motive's export, or columns NAME_X, NAME_Y, NAME_Z")
    if first.lower().startswith("format version"):
        return _motive(rows, path)
    return _plain(rows, path)


def _values(rows: Sequence[Sequence[str]], width: int, path: Path) -> np.ndarray:
    """Numbers (T, width) of rows, NaN where a cell is empty."""
    if not 2 <= len(rows) <= MAX_FRAMES:
        raise InputError(f"{path} has {len(rows)} frames; expected 2 to {MAX_FRAMES}")
    try:
        return np.array(
            [[float(cell) if cell.strip() else np.nan for cell in (*row, *[""] * width)[:width]] for row in rows]
        )
    except ValueError as error:
        raise InputError(f"{path}: all cells below the header must be numbers ({error}); repair the table") from None


def _plain(rows: list[list[str]], path: Path) -> People:
    header = [cell.strip() for cell in rows[0]]
    table = _values(rows[1:], len(header), path)
    places: dict[str, dict[str, int]] = {}
    for column, name in enumerate(header):
        if (match := COLUMN.fullmatch(name)) is not None:
            places.setdefault(match[1], {})[match[2].lower()] = column
    markers = {name: table[:, [at[axis] for axis in "xyz"]] for name, at in places.items() if len(at) == 3}
    if not markers or len(markers) > MAX_MARKERS:
        raise InputError(
            f"{path} has columns {shown(header[:12])}, none of which are NAME_X, NAME_Y and NAME_Z; name the points so"
        )
    times = None
    for column, name in enumerate(header):
        if (match := TIME_FIELD.fullmatch(name)) is not None:
            unit_s = UNITS_S[match[1].lower()] if match[1] else None
            times = Times(values=table[:, column], name=name, unit_s=unit_s)
            break
    return people_of_markers(markers, form="CSV", rate_hz=30.0, rate_assumed=True, times=times)


def _motive(rows: list[list[str]], path: Path) -> People:
    head = next((place for place, row in enumerate(rows) if row[0].strip().lower() == "frame"), 0)
    labels = {row[1].strip().lower(): row for row in rows[1:head] if len(row) > 2}
    if (
        head < 3
        or not {"name", "type"} <= (labels.keys() | {row[0].lower() for row in rows[1:head]})
        or "name" not in labels
    ):
        raise InputError(
            f"{path}: Motive's table needs rows Type and Name above its frames; export it again with headers"
        )
    header = dict(zip(map(str.lower, rows[0][::2]), rows[0][1::2], strict=False))
    if header.get("coordinate space", "global").strip().lower() != "global":
        raise InputError(f"{path} tells bones in their parents' frames; export it with Coordinate Space: Global")
    width = len(rows[head])
    coded = [column for column, name in enumerate(rows[head]) if name.strip().lower() == "timecode"]
    table = _values(
        [["" if k in coded else cell for k, cell in enumerate(row)] for row in rows[head + 1 :]], width, path
    )
    names, kinds, what, axes = (
        [*row, *[""] * width][:width] for row in (labels["name"], labels["type"], rows[head - 1], rows[head])
    )
    places: dict[str, dict[str, dict[str, int]]] = {}
    for column in range(2, width):
        if kinds[column].strip() and what[column].strip() in ("Position", "Rotation"):
            of_kind = places.setdefault(kinds[column].strip().lower(), {})
            of_kind.setdefault(names[column].strip(), {})[what[column].strip()[0] + axes[column].strip()] = column
    rate_hz = 0.0
    with suppress(ValueError):
        rate_hz = float(header.get("export frame rate", header.get("capture frame rate", "")))
    times = Times(values=table[:, 1], name="Time", unit_s=1.0, rate_name="Export Frame Rate")
    unit_m = UNITS_M.get(header.get("length units", "").strip().lower())
    about = {
        "rate_hz": rate_hz or 120.0, "rate_assumed": not rate_hz, "times": times, "unit_m": unit_m, "up": "y",
        "up_certain": False,
    }  # fmt: skip
    return _of_motive(places, table, path, about)


def _hip(name: str, names: Mapping[str, object]) -> str:
    """A bone's name; the root of a skeleton, which may have the skeleton's name, is called its Hip."""
    space, _, bone_name = name.rpartition(":")
    called_so = bone_name == space if space else any(other.startswith(f"{name}:") for other in names)
    return f"{space or name}:Hip" if called_so else name


def _of_motive(
    places: Mapping[str, Mapping[str, Mapping[str, int]]], table: np.ndarray, path: Path, about: Mapping[str, Any]
) -> People:
    """The subjects by their bones, else by their markers; `about` are fields of `Tracks` that all have in common."""
    bones = {name: at for name, at in places.get("bone", {}).items() if {"PX", "PY", "PZ"} <= at.keys()}
    if bones:
        turned = all({"RX", "RY", "RZ", "RW"} <= at.keys() for at in bones.values())
        columns = ("PX", "PY", "PZ", *(("RX", "RY", "RZ", "RW") if turned else ()))
        tracks = {_hip(name, bones): table[:, [at[column] for column in columns]] for name, at in bones.items()}
        euler = any("RX" in at for at in bones.values()) and not turned
        read = partial(_of_motive_subject, tracks, about, euler)
        return people_of_labels(numbered(tracks, "#"), _lacking, read)
    markers = {
        name: table[:, [at[axis] for axis in ("PX", "PY", "PZ")]]
        for kind, those in places.items()
        if "marker" in kind and "rigid" not in kind
        for name, at in those.items()
        if {"PX", "PY", "PZ"} <= at.keys()
    }
    if not markers:
        raise InputError(
            f"{path} holds {', '.join(places) or 'nothing'} and no skeleton; export Bones, or labelled Markers of a whole person"
        )
    return people_of_markers(markers, form="Motive", **about)


def _lacking(names: Sequence[str]) -> list[str]:
    """Bones of the nearest flavour that are absent."""
    return nearest_flavour(names)[1]


def _of_motive_subject(bones: Bones, about: Mapping[str, Any], euler: bool, labels: Labels) -> Tracks:
    """The subject whose bones have these labels; `euler` says whether the file has Euler angles for them."""
    tracks = of_bones("Motive", {name: bones[label] for name, label in labels.items()}, about["rate_hz"])
    clauses = ["its Euler angles are left out; export quaternions to keep rotations"] if euler else []
    return replace(tracks, **about).saying(*clauses)
