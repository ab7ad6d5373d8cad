"""BVH skeleton -> `Motion`: the file's joints are mapped to the canonical ones, what it does not say is found from the body."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from t2d_rt.core.errors import warn
from t2d_rt.motion.match import DECISIVE, MOST_FRAMES, Match, match, signs
from t2d_rt.motion.read.bodies import bodies
from t2d_rt.motion.read.bvh import RawSkeleton, forward_kinematics, read_bvh
from t2d_rt.motion.read.detect import unit, up_axis
from t2d_rt.motion.read.passes import placed, sampled, upright
from t2d_rt.motion.read.reading import Reading
from t2d_rt.motion.read.subjects import chosen
from t2d_rt.motion.read.tracks import Tracks
from t2d_rt.motion.skeletons import (
    Flavour,
    canonical,
    chosen_flavour,
    detect_flavour,
    plain_names,
    restored_offsets,
    source_joints,
)
from t2d_rt.types.motion import Motion


def read_skeletal(path: Path, reading: Reading) -> Motion:
    """A .bvh or .bvh.gz file as a motion with its report."""
    return placed(*_understood(path, reading), reading)


def _understood(path: Path, reading: Reading) -> tuple[Tracks, float]:
    """Canonical joints of one skeleton, z up, and the stature [m]."""
    found = bodies(read_bvh(path))
    (raw, kind, matched), who = chosen(found, reading.subject, lambda body: _mapped(body, reading.flavour))
    names = raw.names
    offsets, restored = restored_offsets(raw, names, kind)
    points, turned = canonical(raw, names, kind, *forward_kinematics(raw, offsets, source_joints(names, kind)))
    told = *who, f"flavour {kind.name}" if matched is None else matched.told
    if restored:
        told = *told, f"lost bones restored at {', '.join(restored)}"
    tracks = Tracks(form="BVH", points=points, turned=turned, rate_hz=raw.rate_hz, told=told)
    tracks = sampled(tracks.without(raw.lost), reading)
    if matched is None:
        _check_sides(tracks.points, kind)
    unit_m, tall_m = unit(tracks.points, reading.units, cmu_units=kind.cmu_units)
    axis = reading.axis or up_axis(tracks.points, _rest_pose(raw, kind))
    return upright(tracks, axis, unit_m, tall_m), tall_m


def _mapped(raw: RawSkeleton, wanted: str | None) -> tuple[RawSkeleton, Flavour, Match | None]:
    """The skeleton with the names that its flavour knows, the flavour, and how it was matched if it is none that is known."""
    plain = plain_names(raw.names)
    if wanted is not None:
        flavour, names = chosen_flavour(wanted, (plain, raw.names), raw.parents)
        return replace(raw, names=names), flavour, None
    raw = replace(raw, names=plain)
    known = detect_flavour(plain, raw.parents)
    if known is not None:
        return raw, known, None
    frames = np.unique(np.linspace(0, len(raw.values) - 1, min(len(raw.values), MOST_FRAMES)).round().astype(int))
    some = forward_kinematics(replace(raw, values=raw.values[frames]))[0]
    matched = match(plain, raw.parents, some, forward_kinematics(_at_rest(raw))[0][0])
    for doubt in matched.doubts:
        warn(doubt)
    return raw, Flavour(name="matched", joints=matched.joints), matched


def _at_rest(raw: RawSkeleton) -> RawSkeleton:
    """The first frame without rotations, except for those of a stage: a root with one child that never turns."""
    values, column = raw.values[:1].copy(), 0
    on_stage = True
    for joint, channels in enumerate(raw.channels):
        turns = [column + i for i, channel in enumerate(channels) if channel.endswith("rotation")]
        column += len(channels)
        still = bool((raw.values[:, turns] == raw.values[:1, turns]).all())
        on_stage = on_stage and still and raw.parents.count(joint) == 1
        if not on_stage:
            values[:, turns] = 0.0
    return replace(raw, values=values)


def _rest_pose(raw: RawSkeleton, kind: Flavour) -> dict[str, np.ndarray]:
    still = _at_rest(raw)
    return canonical(still, raw.names, kind, *forward_kinematics(still, None, source_joints(raw.names, kind)))[0]


def _check_sides(points: dict[str, np.ndarray], kind: Flavour) -> None:
    """Names decide where a flavour is known; a person whose left is on the right is said."""
    frames = np.unique(np.linspace(0, len(points["pelvis"]) - 1, MOST_FRAMES).round().astype(int))
    if signs({name: track[frames] for name, track in points.items()}).body < -DECISIVE:
        warn(
            f"the joints that flavour {kind.name!r:.60} calls left lie on the person's right by feet and knees, so the "
            "file seems to be mirrored; mirror it back"
        )
