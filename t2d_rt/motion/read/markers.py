"""Read labelled points of C3D files (decoded by ezc3d, extra [c3d]) and of TRC tables, and find canonical joints from them."""

from __future__ import annotations

import importlib.util
import os
import struct
import subprocess
import sys
import tempfile
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.checks import numbered, shown
from t2d_rt.core.errors import InputError, install
from t2d_rt.core.files import read_bytes
from t2d_rt.core.processes import run_guarded
from t2d_rt.geometry.vectors import unit
from t2d_rt.motion.quaternions import between, rotate
from t2d_rt.motion.read.bvh import MAX_FRAMES
from t2d_rt.motion.read.clock import same_rate, warn_of_contradiction
from t2d_rt.motion.read.joint_sets import NEEDED, absent_joints, canonical_sources, named_points
from t2d_rt.motion.read.samples import LARGEST, plausible, seen
from t2d_rt.motion.read.subjects import Labels, People, people_of_labels
from t2d_rt.motion.read.tracks import Times, Tracks
from t2d_rt.motion.skeletons import sided, tables
from t2d_rt.types.motion import RATES_HZ

# --- canonical joints from labelled points: joint centres by name, or the markers of usual sets ---
#
# Markers lie on the skin. Hip centres follow from the four of the pelvis (Harrington et al. 2007), those of knees,
# ankles and elbows lie half a joint's width inward of the outer marker, shoulders below the acromion (as Vicon's
# Plug-in Gait has them), wrists between two markers. Widths follow stature. Other labels are refused: which point of
# the body they are is not known.


MODELLED: Mapping[str, str] = tables()["plug_in_gait"]
"""Joint centres that Plug-in Gait writes, and the canonical joints that they are."""

PELVIS_SETS = (("LASI", "RASI", "LPSI", "RPSI"), ("LASI", "RASI", "SACR", "SACR"), ("LFWT", "RFWT", "LBWT", "RBWT"))
"""Markers of the pelvis (front left, front right, back left, back right) of Plug-in Gait, Helen Hayes and CMU."""

SIDED = {"knee": ("KNE",), "ankle": ("ANK",), "shoulder": ("SHO",), "elbow": ("ELB",), "wrist": ("WRA", "WRB")}
"""Markers that a joint needs, without the side's letter."""
ON_LIMBS = [f"{side}{label}" for labels in SIDED.values() for label in labels for side in "LR"]

MEDIAL = ("KNM", "ANM", "ELM")
"""Markers on the inner side of knee, ankle and elbow: the joint lies half-way to the outer marker."""

_SETS = [sided(row) for row in tables()["marker_sets"].values()]
RENAMED: Mapping[str, tuple[str, ...]] = {
    label: tuple(str(row[label]).upper() for row in _SETS if label in row) for row in _SETS for label in row
}
"""For each marker of Plug-in Gait: its names in other sets, in upper case."""

HEAD = ("LFHD", "RFHD", "LBHD", "RBHD")

SHANK = 0.246
"""Length of the shank over the stature (Drillis and Contini 1966)."""
KNEE_HALF, ANKLE_HALF, ELBOW_HALF, SHOULDER_DOWN, FOOT_DOWN = 0.033, 0.024, 0.023, 0.03, 0.01
"""Distances from marker to joint, over stature: half of widths of 10, 7 and 6.5 cm and half of a marker of 14 mm, shoulders 5 cm
below and balls of the feet 1.75 cm below, at a stature of 1.75 m."""

STRAIGHT = 0.03
"""(sine of the bend)^2 at which a hinge counts as much as the left of the trunk."""


def people_of_markers(markers: dict[str, np.ndarray], **about: Any) -> People:
    """The subjects who wear markers; their points are NaN where a marker was not seen.

    markers: positions (T, 3) by label in any unit and axes; NaN, or 0, 0, 0 and the like, where one was not seen.
    about: fields of `Tracks` that all have in common.
    """
    positions = np.moveaxis(seen(np.stack(list(markers.values()), axis=1)), 1, 0)
    visible = {label: track for label, track in zip(markers, positions, strict=True) if np.isfinite(track).any()}
    never = [label for label in markers if label not in visible]
    return people_of_labels(tuple(visible), lacking, partial(_of_subject, visible, never, about))


def _of_subject(visible: dict[str, np.ndarray], never: list[str], about: dict[str, Any], labels: Labels) -> Tracks:
    """The subject who has these of the visible labels."""
    try:
        points, clauses = _joints(visible, labels)
    except InputError as error:
        raise (InputError(f"{error}; {shown(never)} are never seen") if never else error) from None
    return Tracks(points=points, clauses=clauses, **about).saying(*([f"{shown(never)} never seen"] if never else []))


def lacking(labels: Sequence[str]) -> list[str]:
    """Labels that are absent: joint centres, or markers on the skin if over half of the centres are; empty if a set is whole."""
    upper = set(_as_plug_in_gait(labels))
    modelled = [label for label, joint in MODELLED.items() if joint in NEEDED and label not in upper]
    absent = [label for label in ON_LIMBS if label not in upper]
    skin = absent if _pelvis(upper) else [*PELVIS_SETS[0], *absent]
    centres = min(absent_joints(labels), modelled, key=len)
    return centres if len(centres) <= len(NEEDED) // 2 and skin else skin


def _as_plug_in_gait(labels: Iterable[str]) -> dict[str, str]:
    """Labels by their names in upper case, and by the names of Plug-in Gait for markers of other sets."""
    upper = {label.upper(): label for label in labels}
    for label, others in RENAMED.items():
        equivalent = next((upper[other] for other in others if other in upper), None)
        if equivalent is not None:
            upper.setdefault(label, equivalent)
    return upper


def _pelvis(upper: Collection[str]) -> tuple[str, ...] | None:
    return next((labels for labels in PELVIS_SETS if all(label in upper for label in labels)), None)


def _joints(tracks: dict[str, np.ndarray], labels: Labels) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Points (T, 3) by canonical name of the subject who has these labels, and a clause that says what they are made of."""
    by_label = {label: tracks[source] for label, source in labels.items()}
    if absent := lacking(tuple(by_label)):
        raise InputError(
            f"markers {shown(list(by_label))} give no joints: they lack {', '.join(absent[:8])}; expected joint centres by name, "
            "or the markers of Plug-in Gait, CMU's, OpenSim's, Qualisys', Motive's or BTS' set"
        )
    upper = {label: by_label[source] for label, source in _as_plug_in_gait(by_label).items()}
    if not absent_joints(tuple(by_label)):
        used = {name for names in canonical_sources(tuple(by_label)).values() for name in names}
        centres = [label for label in by_label if label in used]
        points, _ = named_points(np.stack([by_label[label] for label in centres], axis=1), centres)
        return points, (f"joint centres {', '.join(centres)}",)
    if all(label in upper for label, joint in MODELLED.items() if joint in NEEDED):
        centres = [label for label in MODELLED if label in upper]
        return {MODELLED[label]: upper[label] for label in centres}, (f"joint centres {', '.join(centres)}",)
    return _from_skin(upper)


def _from_skin(markers: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    pelvis = _pelvis(markers)
    assert pelvis is not None
    inner = [f"{s}{label}" for label in MEDIAL for s in "LR"]
    optional = [label for label in (*HEAD, "LTOE", "RTOE", "LFIN", "RFIN", *inner) if label in markers]
    used_labels = dict.fromkeys([*pelvis, *ON_LIMBS, *optional])
    at = {label: markers[label] for label in used_labels}
    front, back = 0.5 * (at[pelvis[0]] + at[pelvis[1]]), 0.5 * (at[pelvis[2]] + at[pelvis[3]])
    tall = float(np.nanmedian([np.linalg.norm(at[f"{s}KNE"] - at[f"{s}ANK"], axis=-1) for s in "LR"])) / SHANK
    left = unit(at[pelvis[0]] - at[pelvis[1]])
    ahead = unit(_square(front - back, left))
    up = np.cross(ahead, left)
    width, depth = (np.nanmedian(np.linalg.norm(v, axis=-1)) for v in (at[pelvis[0]] - at[pelvis[1]], front - back))
    points: dict[str, np.ndarray] = {}
    down = -unit(0.5 * (at["LSHO"] + at["RSHO"]) - 0.5 * (front + back))
    for side, s, sign in (("left", "L", 1.0), ("right", "R", -1.0)):
        # Harrington et al. 2007, table 4; its millimetres as fractions of 1.7 m.
        hip = front - (0.24 * depth + 0.0058 * tall) * ahead - (0.30 * width + 0.0064 * tall) * up
        hip = hip + sign * (0.33 * width + 0.0043 * tall) * left
        inside = {label: f"{s}{label}" in at for label in MEDIAL}
        knee, ankle, elbow = (
            0.5 * (at[f"{s}{outer}"] + at[f"{s}{inner}"]) if inside[inner] else at[f"{s}{outer}"]
            for outer, inner in zip(("KNE", "ANK", "ELB"), MEDIAL, strict=True)
        )
        wrist = 0.5 * (at[f"{s}WRA"] + at[f"{s}WRB"])
        shoulder = at[f"{s}SHO"] + SHOULDER_DOWN * tall * down
        axis = _hinge(unit(knee - hip), unit(ankle - knee), left)
        arm = unit(elbow - shoulder)
        outward = _hinge(unit(wrist - elbow), arm, rotate(between(down, arm), left))
        points |= {
            f"{side}_hip": hip,
            f"{side}_knee": knee - (not inside["KNM"]) * sign * KNEE_HALF * tall * unit(_square(axis, knee - hip)),
            f"{side}_ankle": ankle - (not inside["ANM"]) * sign * ANKLE_HALF * tall * unit(_square(axis, ankle - knee)),
            f"{side}_shoulder": shoulder,
            f"{side}_elbow": elbow - (not inside["ELM"]) * sign * ELBOW_HALF * tall * outward,
            f"{side}_wrist": wrist,
        }
        if f"{s}TOE" in at:
            points[f"{side}_foot"] = at[f"{s}TOE"] - FOOT_DOWN * tall * unit(knee - ankle)
        if f"{s}FIN" in at:
            points[f"{side}_hand"] = at[f"{s}FIN"]
    if all(label in at for label in HEAD):
        points["head"] = np.mean([at[label] for label in HEAD], axis=0)
    return points, (f"joints from the markers {', '.join(at)}",)


def _hinge(first: np.ndarray, second: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Unit axis (T, 3) of a bend, towards the body's left; `left` where the limb is straight or seems to bend the other way."""
    bend = np.cross(first, second)
    sine = np.linalg.norm(bend, axis=-1, keepdims=True)
    cosine = (bend * left).sum(axis=-1, keepdims=True) / np.maximum(sine, 1e-12)
    return unit(bend * sine * 0.5 * (1 + cosine) + STRAIGHT * left)


def _square(vectors: np.ndarray, to: np.ndarray) -> np.ndarray:
    """The part (T, 3) of vectors that is perpendicular to others."""
    axis = unit(to)
    return vectors - (vectors * axis).sum(axis=-1, keepdims=True) * axis


# --- C3D files of marker positions, decoded by ezc3d (extra [c3d]) ---


UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001}

LONGEST_S = 120

DECODE = """
import sys
import ezc3d
import numpy as np
file = ezc3d.c3d(sys.argv[1])
point = file["parameters"]["POINT"]
keys = sorted((key for key in point if key.startswith("LABELS")), key=lambda key: int(key[6:] or 1))
labels = [str(label).strip() for key in keys for label in point[key]["value"]]
unit = "".join(point["UNITS"]["value"][:1]) if "UNITS" in point else ""
np.savez(sys.argv[2], labels=np.array(labels, dtype=str), rate=point["RATE"]["value"][0], unit=unit, points=file["data"]["points"])
"""
"""Program of the process that decodes a file, given as its first argument, into the .npz file that is its second."""


def read_c3d(path: Path) -> People:
    """The subjects of a C3D file by its joint centres or markers; raises an InputError if it cannot be read."""
    data = read_bytes(path, limit=250_000_000, noun="C3D file")
    # The second byte of every C3D file is 0x50.
    if len(data) < 1024 or data[1] != 0x50:
        raise InputError(f"{path} is not a C3D file, or cut short")
    markers, rate_hz, unit = _markers(path)
    header_hz = _header_rate(data)
    if RATES_HZ[0] <= header_hz <= RATES_HZ[1] and not same_rate(header_hz, rate_hz):
        warn_of_contradiction(
            f"the header's {header_hz:g} Hz contradict POINT:RATE of {rate_hz:g} Hz, which is taken", header_hz
        )
    return people_of_markers(markers, form="C3D", rate_hz=rate_hz, unit_m=UNITS_M.get(unit), up="z", up_certain=False)


def _header_rate(data: bytes) -> float:
    """Frame rate [Hz] in the first block, 0 if another processor than Intel's or MIPS wrote it."""
    processor = data[512 * max(data[0] - 1, 0) :][3:4]
    order = {b"T": "<f", b"V": ">f"}.get(processor)  # 84 Intel, 86 MIPS
    return float(struct.unpack(order, data[20:24])[0]) if order else 0.0


def _markers(path: Path) -> tuple[dict[str, np.ndarray], float, str]:
    """Positions (T, 3) by label, NaN where not seen, the frame rate [Hz] and the name of the unit."""
    if importlib.util.find_spec("ezc3d") is None:
        raise InputError(f"reading {path} needs the package ezc3d; {install('c3d')}")
    labels, rate_hz, unit, table = _decoded(path)
    if table.ndim != 3 or not 2 <= table.shape[2] <= MAX_FRAMES or not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise InputError(
            f"{path} holds points of shape {table.shape} at {rate_hz:g} Hz; expected 2 to {MAX_FRAMES} frames"
        )
    positions = plausible(np.moveaxis(table[:3], 0, -1))  # (markers, frames, 3)
    markers = {label: positions[place] for place, label in enumerate(numbered(labels[: len(positions)], "#"))}
    return markers, rate_hz, unit.lower()


def _decoded(path: Path) -> tuple[list[str], float, str, np.ndarray]:
    """Labels, rate, unit and points (4, markers, frames), decoded in a process of its own: damaged files crash ezc3d."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "points.npz"
        try:
            program, work_folder = [sys.executable, "-c", DECODE, str(path.resolve()), str(out)], Path(folder)
            done = run_guarded(program, folder=work_folder, env=os.environ, limit_s=LONGEST_S, temporary=[work_folder])
        except subprocess.TimeoutExpired:
            raise InputError(f"{path} was not decoded within {LONGEST_S} s; it is damaged or too large") from None
        if done.returncode or not out.is_file():
            last = done.stderr.decode("utf-8", "replace").strip().splitlines()[-1:]
            raise InputError(
                f"{path} cannot be read as C3D ({shown(''.join(last) or 'its decoder crashed')}); it is damaged or unusual"
            )
        with np.load(out, allow_pickle=False) as decoded:
            labels, points = [str(label) for label in decoded["labels"]], decoded["points"].astype(np.float64)
            return labels, float(decoded["rate"]), str(decoded["unit"]), points


# --- OpenSim's .trc, a table of labelled points with tabs between columns, which pose estimators write too ---


MAX_MARKERS = 1000


def read_trc(path: Path) -> People:
    """The subjects of a TRC file by its joint centres or markers; raises an InputError if it cannot be read."""
    data = read_bytes(path, limit=150_000_000, noun="TRC file")
    try:
        lines = data.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        lines = data.decode("latin-1").splitlines()
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise InputError(f"{path} is not a TRC file: it must be a table that starts with PathFileType")
    header = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    try:
        rate_hz, unit_m = float(header["DataRate"]), UNITS_M.get(header["Units"].lower())
    except (KeyError, ValueError):
        raise InputError(
            f"{path}: its second and third lines must give DataRate and Units; the file is damaged"
        ) from None
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise InputError(f"{path}: DataRate must be frames per second, got {shown(header['DataRate'])}")
    labels = [label.strip() for label in lines[3].split("\t")[2:]]
    places = [place for place, label in enumerate(labels) if label]
    columns = dict(zip(numbered((labels[place] for place in places), "#"), places, strict=True))
    if not columns or len(columns) > MAX_MARKERS:
        raise InputError(f"{path}: its fourth line must name 1 to {MAX_MARKERS} markers, got {len(columns)}")
    times_s, table = _table(lines[5:], len(labels), path)
    markers = {label: table[:, place : place + 3] for label, place in columns.items() if place + 3 <= table.shape[1]}
    times = Times(values=times_s, name="Time column", unit_s=1.0, rate_name="DataRate")
    return people_of_markers(markers, form="TRC", rate_hz=rate_hz, times=times, unit_m=unit_m, up="y", up_certain=False)


def _table(lines: list[str], width: int, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] of the rows that tell one, and coordinates (T, columns), NaN where a cell is empty."""
    rows: list[list[float]] = []
    times: list[float] = []
    for line in lines:
        if not line.strip():
            continue
        if len(rows) == MAX_FRAMES:
            raise InputError(f"{path} has more than {MAX_FRAMES} frames; cut the motion into shorter files")
        clock, *cells = line.rstrip("\r\n").split("\t")[1:] or [""]
        with suppress(ValueError):  # times in hours and minutes, or none
            times.append(float(clock))
        cells = (cells + [""] * (width + 2))[: width + 2]
        try:
            rows.append([float(cell) if cell.strip() else np.nan for cell in cells])
        except ValueError:
            raise InputError(f"{path}: row {len(rows) + 1} must hold numbers only; the file is damaged") from None
    if len(rows) < 2:
        raise InputError(f"{path}: a motion needs at least 2 frames, got {len(rows)}")
    table = np.array(rows)
    if np.abs(np.nan_to_num(table)).max() >= LARGEST:
        raise InputError(f"{path} holds infinite or absurd values; repair or re-export the file")
    return np.array(times), table
