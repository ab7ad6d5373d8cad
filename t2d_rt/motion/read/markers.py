"""Labelled points of C3D and TRC files -> canonical joints: joint centres by name, or the markers of usual sets.

Markers lie on the skin. Hip centres follow from the four of the pelvis (Harrington et al. 2007), those of knees, ankles and elbows
lie half a joint's width inward of the outer marker, shoulders below the acromion (as Vicon's Plug-in Gait has them), wrists between
two markers. Widths follow stature. Other labels are refused: which point of the body they are is not known.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import unit
from t2d_rt.motion.quaternions import between, rotate
from t2d_rt.motion.read.joint_sets import NEEDED, absent_joints, canonical_sources, named_points
from t2d_rt.motion.read.samples import seen
from t2d_rt.motion.read.subjects import of_labels

MODELLED = {
    "PELO": "pelvis", "TRXO": "neck", "HEDO": "head",
    **{
        f"{s}{label}": f"{side}_{joint}"
        for side, s in (("left", "L"), ("right", "R"))
        for label, joint in (
            ("FEP", "hip"), ("FEO", "knee"), ("TIO", "ankle"), ("HUP", "shoulder"), ("HUO", "elbow"), ("RAO", "wrist"),
        )
    },
}  # fmt: skip
"""Joint centres that Plug-in Gait writes: origins (O) and proximal ends (P) of its bones."""

PELVIS_SETS = (("LASI", "RASI", "LPSI", "RPSI"), ("LASI", "RASI", "SACR", "SACR"), ("LFWT", "RFWT", "LBWT", "RBWT"))
"""Front left, front right, back left, back right: Plug-in Gait, Helen Hayes, CMU."""

SIDED = {"knee": ("KNE",), "ankle": ("ANK",), "shoulder": ("SHO",), "elbow": ("ELB",), "wrist": ("WRA", "WRB")}
"""Markers that a joint needs, without the side's letter."""

HEAD = ("LFHD", "RFHD", "LBHD", "RBHD")

SHANK = 0.246
"""Of the stature (Drillis and Contini 1966)."""
KNEE_HALF, ANKLE_HALF, ELBOW_HALF, SHOULDER_DOWN, FOOT_DOWN = 0.033, 0.024, 0.023, 0.03, 0.01
"""From marker to joint, in statures: half widths of 10, 7 and 6.5 cm and half a marker of 14 mm, shoulders 5 cm below, at
1.75 m."""

STRAIGHT = 0.03
"""(sine of the bend)^2 at which a hinge counts as much as the trunk's left."""


def joints_from(
    markers: dict[str, np.ndarray], subject: str | None = None
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Points (T, 3) of one subject by canonical name, NaN where a marker was not seen, and clauses for the report on what was used.

    markers: positions (T, 3) by label in any unit and axes; no numbers, or 0, 0, 0 and the like, where one was not seen.
    """
    positions = np.moveaxis(seen(np.stack(list(markers.values()), axis=1)), 1, 0)
    there = {label: track for label, track in zip(markers, positions, strict=True) if np.isfinite(track).any()}
    never = [label for label in markers if label not in there]
    try:
        (points, told), who = of_labels(
            tuple(there), lacking, subject, lambda own: _joints({label: there[source] for label, source in own.items()})
        )
    except InputError as error:
        raise (InputError(f"{error}; {shown(never)} are never seen") if never else error) from None
    return points, (*who, *told, *([f"{shown(never)} never seen"] if never else []))


def lacking(labels: Sequence[str]) -> list[str]:
    """Which labels are absent of joint centres or, where half of these are, of markers on the skin; none where one set is whole."""
    upper = {label.upper() for label in labels}
    modelled = [label for label, joint in MODELLED.items() if joint in NEEDED and label not in upper]
    absent = [f"{s}{label}" for each in SIDED.values() for label in each for s in "LR" if f"{s}{label}" not in upper]
    skin = absent if _pelvis(upper) else [*PELVIS_SETS[0], *absent]
    centres = min(absent_joints(labels), modelled, key=len)
    return centres if len(centres) <= len(NEEDED) // 2 and skin else skin


def _pelvis(upper: Collection[str]) -> tuple[str, ...] | None:
    return next((labels for labels in PELVIS_SETS if all(label in upper for label in labels)), None)


def _joints(plain: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    if absent := lacking(tuple(plain)):
        raise InputError(
            f"markers {shown(list(plain))} give no joints: they lack {', '.join(absent[:8])}; expected joint centres by name, "
            "or the markers of Plug-in Gait or CMU's set"
        )
    upper = {label.upper(): track for label, track in plain.items()}
    if not absent_joints(tuple(plain)):
        used = {name for names in canonical_sources(tuple(plain)).values() for name in names}
        tracks = {label: track for label, track in plain.items() if label in used}
        points, _ = named_points(np.stack(list(tracks.values()), axis=1), tuple(tracks))
        return points, (f"joint centres {', '.join(tracks)}",)
    if all(label in upper for label, joint in MODELLED.items() if joint in NEEDED):
        tracks = {label: upper[label] for label in MODELLED if label in upper}
        return {MODELLED[label]: track for label, track in tracks.items()}, (f"joint centres {', '.join(tracks)}",)
    return _from_skin(upper)


def _from_skin(markers: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    pelvis = _pelvis(markers)
    assert pelvis is not None
    needed = [f"{s}{label}" for labels in SIDED.values() for label in labels for s in "LR"]
    optional = [label for label in (*HEAD, "LTOE", "RTOE", "LFIN", "RFIN") if label in markers]
    wanted = dict.fromkeys([*pelvis, *needed, *optional])
    at = {label: markers[label] for label in wanted}
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
        knee, ankle, elbow = at[f"{s}KNE"], at[f"{s}ANK"], at[f"{s}ELB"]
        wrist = 0.5 * (at[f"{s}WRA"] + at[f"{s}WRB"])
        shoulder = at[f"{s}SHO"] + SHOULDER_DOWN * tall * down
        axis = _hinge(unit(knee - hip), unit(ankle - knee), left)
        arm = unit(elbow - shoulder)
        outward = _hinge(unit(wrist - elbow), arm, rotate(between(down, arm), left))
        points |= {
            f"{side}_hip": hip,
            f"{side}_knee": knee - sign * KNEE_HALF * tall * unit(_square(axis, knee - hip)),
            f"{side}_ankle": ankle - sign * ANKLE_HALF * tall * unit(_square(axis, ankle - knee)),
            f"{side}_shoulder": shoulder,
            f"{side}_elbow": elbow - sign * ELBOW_HALF * tall * outward,
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
    """Unit axis (T, 3) of a bend to the body's left, `left` where the limb is straight or seems to bend the other way."""
    bend = np.cross(first, second)
    sine = np.linalg.norm(bend, axis=-1, keepdims=True)
    cosine = (bend * left).sum(axis=-1, keepdims=True) / np.maximum(sine, 1e-12)
    return unit(bend * sine * 0.5 * (1 + cosine) + STRAIGHT * left)


def _square(vectors: np.ndarray, to: np.ndarray) -> np.ndarray:
    """The part of vectors square to others, (T, 3)."""
    axis = unit(to)
    return vectors - (vectors * axis).sum(axis=-1, keepdims=True) * axis
