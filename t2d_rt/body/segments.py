"""A body as a few ellipsoids, one for each segment, which move rigidly with the bones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from t2d_rt.body.chest import CARRIERS, lies_on_front
from t2d_rt.body.fit import SIDES, Fitted, fit
from t2d_rt.body.outfit import Outfit, materials_of, outfit_of
from t2d_rt.body.pose import BONES, Posing, posing
from t2d_rt.body.skin import JointTrack, linear_track
from t2d_rt.body.template import template
from t2d_rt.geometry.vectors import edge_cross, unit
from t2d_rt.types.ellipsoids import Ellipsoids
from t2d_rt.types.material import Material
from t2d_rt.types.mesh import Provenance
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion, checked_motion


@dataclass(frozen=True, slots=True)
class Segment:
    """A part of the body that is carried by one bone."""

    bone: str
    joints: tuple[str, ...]
    """Joints whose part of the surface belongs to the segment."""
    ends: tuple[str, str]
    """Names of the two ends of the segment's long axis in the rest pose."""


RAGGED = 0.02
"""Fraction of a segment's points that is ignored at either end of the bone, as its faces do not end in a plane."""


def _segments() -> dict[str, Segment]:
    parts = {
        "head": Segment("head", ("head",), ("head", "head_top")),
        "neck": Segment("neck", ("neck",), ("neck", "head")),
        "pelvis": Segment("pelvis", CARRIERS, ("pelvis", "neck")),
        "abdomen": Segment("spine1", CARRIERS, ("pelvis", "neck")),
        "chest": Segment("spine3", CARRIERS, ("pelvis", "neck")),
    }
    for s in SIDES:
        parts |= {
            f"{s}_upper_arm": Segment(f"{s}_shoulder", (f"{s}_shoulder",), (f"{s}_shoulder", f"{s}_elbow")),
            f"{s}_forearm": Segment(f"{s}_elbow", (f"{s}_elbow",), (f"{s}_elbow", f"{s}_wrist")),
            f"{s}_hand": Segment(f"{s}_wrist", (f"{s}_wrist",), (f"{s}_wrist", f"{s}_hand")),
            f"{s}_thigh": Segment(f"{s}_hip", (f"{s}_hip",), (f"{s}_hip", f"{s}_knee")),
            f"{s}_shank": Segment(f"{s}_knee", (f"{s}_knee",), (f"{s}_knee", f"{s}_ankle")),
            f"{s}_foot": Segment(f"{s}_ankle", (f"{s}_ankle", f"{s}_foot"), (f"{s}_ankle", f"{s}_toe")),
        }
    return parts


SEGMENTS: Mapping[str, Segment] = _segments()
"""The 17 segments."""

BREATHING = [tuple(SEGMENTS).index(name) for name in ("abdomen", "chest")]
"""Indices of the segments that move with breathing and heartbeat."""


def segments(
    motion: Motion,
    body: str = "adult",
    *,
    material: str | Material | Outfit = "skin",
    track: JointTrack | None = None,
    made: Provenance | None = None,
) -> Ellipsoids:
    """Ellipsoids fitted to the surface that `skin` moves, moving rigidly with its bones; arguments as in `skin`."""
    checked_motion(motion)
    fitted = fit(template(body, outfit_of(material)), motion)
    surface = materials_of(material, lambda outfit: outfit.of_segments(tuple(SEGMENTS)))
    pose = posing(fitted, motion)
    semi_axes, centres, axes = fit_ellipsoids(fitted)
    bones = [BONES.index(part.bone) for part in SEGMENTS.values()]
    offsets = centres - np.array([fitted.joints[part.bone] for part in SEGMENTS.values()])

    carried = _Carried(pose, bones, offsets, axes, track or linear_track(motion), motion)
    return Ellipsoids.from_track(carried, semi_axes, motion.times_s, surface, names=tuple(SEGMENTS), made=made)


@dataclass(frozen=True, slots=True)
class _Carried:
    """Track of ellipsoids that move rigidly with bones: their centres and axes as a function of time."""

    pose: Posing
    bones: list[int]
    """Index of each ellipsoid's bone among `BONES`, (N,)."""
    offsets: np.ndarray
    """Vectors from the bones' joints to the centres at rest [m], (N, 3)."""
    axes: np.ndarray
    """Axes at rest, (N, 3, 3)."""
    track: JointTrack
    motion: Motion
    """The motion, whose breathing and heartbeat move chest and abdomen."""

    def __call__(self, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        bones = self.pose.bones(*self.track(times_s))
        rotations, origin = (moved[:, self.bones] for moved in bones)
        centres, axes = (rotations @ self.offsets[..., None])[..., 0] + origin, rotations @ self.axes
        if self.motion.chest_moves:
            # Semi-axes are constant: the whole ellipsoid moves like its front, or like its back where the person lies on the front.
            out_m = self.motion.chest_m(times_s) * (1 - 2 * lies_on_front(*bones))
            centres[:, BREATHING] += out_m[:, None, None] * axes[..., 0][:, BREATHING]
        return centres, axes


def segment_of_faces(body: Fitted) -> np.ndarray:
    """Index among SEGMENTS of the segment to which each face belongs, (F,)."""
    columns = [[CANONICAL_JOINTS.index(joint) for joint in part.joints] for part in SEGMENTS.values()]
    membership = np.stack([body.template.weights[:, group].sum(1) for group in columns], axis=1)
    faces = body.template.faces
    owner = membership[faces].sum(1).argmax(1)
    trunk = [i for i, part in enumerate(SEGMENTS.values()) if part.joints == CARRIERS]
    storey = np.searchsorted(
        [body.joints[joint][2] for joint in ("spine1", "spine2")], body.vertices[faces].mean(1)[:, 2]
    )
    return np.where(np.isin(owner, trunk), np.array(trunk)[storey], owner)


def fit_ellipsoids(body: Fitted) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Semi-axes (N, 3) m, rest centres (N, 3) m and rest axes (N, 3, 3) of the segments.

    A segment has the faces that its joints move most; the trunk is cut at two heights. Along the bone the ellipsoid is as long as
    these faces; across it, it is half way (geometric mean) between their thickness and the thickness that gives the segment's
    volume.
    """
    faces, owner = body.template.faces, segment_of_faces(body)
    fits = [
        _ellipsoid(body.vertices[faces[owner == i]], *_axes(body, part)) for i, part in enumerate(SEGMENTS.values())
    ]
    semi_axes, centres, axes = (np.array(column) for column in zip(*fits, strict=True))
    return semi_axes, centres, axes


def _axes(body: Fitted, part: Segment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit axes of a segment at rest: the third along the bone, the first as far forward as possible (sideways for a foot)."""
    long = body.joints[part.ends[1]] - body.joints[part.ends[0]]
    is_foot = part.bone.endswith("ankle")
    long = unit(long * [1, 1, 0] if is_foot else long)
    ahead = np.array([0.0, 1, 0] if is_foot else [1.0, 0, 0])
    first = unit(ahead - (ahead @ long) * long)
    return first, np.cross(long, first), long


def _ellipsoid(
    corners: np.ndarray, first: np.ndarray, second: np.ndarray, third: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Semi-axes, centre and axes of the ellipsoid for the faces (F, 3, 3) of a segment."""
    axes = np.stack([first, second, third], -1)
    local = corners @ axes
    low, high = local.min((0, 1)), local.max((0, 1))
    low[2], high[2] = np.quantile(local[..., 2], (RAGGED, 1 - RAGGED))
    half = (high - low) / 2
    # Volume by the flux of x e_x along the first axis, towards which no cut through joints or armpits faces.
    area = edge_cross(local) / 2
    volume = abs(float(((local.mean(1) - (low + high) / 2)[:, 0] * area[:, 0]).sum()))
    filling = volume / (4 / 3 * np.pi * half.prod())
    return half * [filling**0.25, filling**0.25, 1], axes @ ((low + high) / 2), axes
