"""Read the skeletons of BVH and GLB files: tell several in one file apart, and map their joints to the canonical ones."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from t2d_rt.core.errors import warn
from t2d_rt.motion.match import DECISIVE, Match, match, signs
from t2d_rt.motion.read.bvh import RawSkeleton, forward_kinematics, read_bvh
from t2d_rt.motion.read.detect import unit, up_axis
from t2d_rt.motion.read.gltf import read_gltf
from t2d_rt.motion.read.joint_sets import side_and_part
from t2d_rt.motion.read.passes import Found, Frame, Reading, placed, sampled, upright
from t2d_rt.motion.read.subjects import FEWEST_LABELS, SIGNS, People
from t2d_rt.motion.read.tracks import FileSkeleton, Tracks
from t2d_rt.motion.skeletons import (
    Flavour,
    canonical,
    chosen_flavour,
    detect_flavour,
    plain_names,
    restored_offsets,
    source_joints,
)

# --- several skeletons in one BVH: each under a ROOT of its own, or twins under one that carries them all ---


def bodies(raw: RawSkeleton) -> dict[str, RawSkeleton]:
    """Skeletons with enough joints for a person, by the namespace of their names, else the name of their ROOT, else their number; a
    single one is called ""."""
    roots = [joint for joint, parent in enumerate(raw.parents) if parent < 0]
    if len(roots) == 1:
        return _twins(raw) or {"": raw}
    trees = [_below(raw, root) for root in roots]
    large = [tree for tree in trees if sum(bool(raw.channels[joint]) for joint in tree) >= FEWEST_LABELS] or trees[:1]
    names = [raw.names[tree[0]] for tree in large]
    spaces = [name.rpartition(":")[0] for name in names]
    numbers = [str(number) for number in range(1, len(large) + 1)]
    called = next(kind for kind in (spaces, names, numbers) if len({*kind} - {""}) == len(large) or kind is numbers)
    return {name if len(large) > 1 else "": _piece(raw, tree) for name, tree in zip(called, large, strict=True)}


def _twins(raw: RawSkeleton) -> dict[str, RawSkeleton]:
    """Skeletons side by side whose joints have the same names except for a prefix or suffix of them all; empty for a single one."""
    for joint in range(len(raw.names)):
        trees = [_below(raw, child) for child, parent in enumerate(raw.parents) if parent == joint]
        large = [tree for tree in trees if len(tree) >= FEWEST_LABELS]
        twins: dict[str, RawSkeleton] = {}
        for other in large[1:]:
            ours, theirs, common_names = _affixes(
                *([raw.names[index].removesuffix(":end") for index in tree] for tree in (large[0], other))
            )
            if {side_and_part(name)[0] for name in common_names} >= {"left", "right"}:  # two legs have one side each
                above = _above(raw, joint)
                for affix, tree in ((ours, large[0]), (theirs, other)):
                    names = [*(raw.names[index] for index in above), *common_names]
                    named = [
                        f"{n}:end" if raw.names[e].endswith(":end") else n
                        for n, e in zip(names, above + tree, strict=True)
                    ]
                    twins[affix] = replace(_piece(raw, above + tree), names=tuple(named))
        if len(twins) > 1:
            return twins
    return {}


def _affixes(ours: list[str], theirs: list[str]) -> tuple[str, str, list[str]]:
    """The prefixes or suffixes by which two lists of names differ, and the common names; empty if the names differ otherwise."""
    for turn in (1, -1):
        ends = zip(ours[0][::-turn], theirs[0][::-turn], strict=False)
        tail = next(
            (place for place, (one, other) in enumerate(ends) if one != other), min(len(ours[0]), len(theirs[0]))
        )
        first, second = (names[0][::turn][: len(names[0]) - tail] for names in (ours, theirs))
        common_names = [name[::turn].removeprefix(first)[::turn] for name in ours]
        same = common_names == [name[::turn].removeprefix(second)[::turn] for name in theirs] and first != second
        if same and all(name[::turn].startswith(first) for name in ours):
            return first[::turn].strip(SIGNS), second[::turn].strip(SIGNS), [name.strip(SIGNS) for name in common_names]
    return "", "", []


def _below(raw: RawSkeleton, root: int) -> list[int]:
    """A joint and all joints below it, in the file's order."""
    joints = {root}
    for joint in range(root + 1, len(raw.parents)):
        if raw.parents[joint] in joints:
            joints.add(joint)
    return sorted(joints)


def _above(raw: RawSkeleton, joint: int) -> list[int]:
    """A joint and all joints above it, the root first."""
    chain = [joint]
    while raw.parents[chain[0]] >= 0:
        chain.insert(0, raw.parents[chain[0]])
    return chain


def _piece(raw: RawSkeleton, joints: list[int]) -> RawSkeleton:
    """The skeleton with some of its joints only; a joint whose parent is not among them becomes a root."""
    starts = np.cumsum([0, *map(len, raw.channels)])
    columns = np.concatenate([np.arange(starts[joint], starts[joint + 1]) for joint in joints])
    place = {joint: number for number, joint in enumerate(joints)}
    return replace(
        raw,
        names=tuple(raw.names[joint] for joint in joints),
        parents=tuple(place.get(raw.parents[joint], -1) for joint in joints),
        offsets=raw.offsets[joints],
        channels=tuple(raw.channels[joint] for joint in joints),
        values=raw.values[:, columns],
    )


# --- a skeleton becomes a `Motion`: its joints are mapped to the canonical ones, the rest is found from the body ---


def read_skeletal(path: Path, flavour_name: str | None) -> People:
    """The skeletons of a .bvh, .bvh.gz or .glb file."""
    form, read = ("GLB", read_gltf) if path.suffix.lower() == ".glb" else ("BVH", read_bvh)
    return {name: partial(_tracks, raw, form, flavour_name) for name, raw in bodies(read(path)).items()}


def _tracks(raw: RawSkeleton, form: str, flavour_name: str | None) -> Tracks:
    raw, kind, matched = _mapped(raw, flavour_name)
    offsets, restored = restored_offsets(raw, raw.names, kind)
    clauses = [f"flavour {kind.name}" if matched is None else matched.summary]
    if restored:
        clauses.append(f"lost bones restored at {', '.join(restored)}")
    points, turned = _canonical(raw, kind, offsets)
    skeleton = FileSkeleton(flavour=kind, matched=matched is not None, rest=_canonical(_at_rest(raw), kind)[0])
    return Tracks(
        form=form, points=points, turned=turned, rate_hz=raw.rate_hz, clauses=tuple(clauses), skeleton=skeleton
    ).without(raw.lost)


def motion_of_skeleton(tracks: Tracks, skeleton: FileSkeleton, reading: Reading) -> Found:
    """The motion of one skeleton's canonical joints, with its report."""
    tracks = sampled(tracks, reading)
    if not skeleton.matched:
        _check_sides(tracks.points, skeleton.flavour)
    unit_m, tall_m = unit(tracks.points, reading.units, cmu_units=skeleton.flavour.cmu_units)
    axis = reading.axis or up_axis(tracks.points, skeleton.rest)
    frame = Frame(up=axis, unit_m=unit_m, tall_m=tall_m)
    return placed(upright(tracks, frame), frame, reading)


def _mapped(raw: RawSkeleton, flavour_name: str | None) -> tuple[RawSkeleton, Flavour, Match | None]:
    """The skeleton with the names that its flavour uses, the flavour, and the match if none of the known flavours fits."""
    bare_names = plain_names(raw.names)
    if flavour_name is not None:
        flavour, names = chosen_flavour(flavour_name, (bare_names, raw.names), raw.parents)
        return replace(raw, names=names), flavour, None
    raw = replace(raw, names=bare_names)
    detected = detect_flavour(bare_names, raw.parents)
    if detected is not None:
        return raw, detected, None
    positions = forward_kinematics(replace(raw, values=raw.values[_spread(len(raw.values))]))[0]
    matched = match(bare_names, raw.parents, positions, forward_kinematics(_at_rest(raw))[0][0])
    for doubt in matched.doubts:
        warn(doubt)
    return raw, Flavour(name="matched", joints=matched.joints), matched


def _spread(count: int) -> np.ndarray:
    """Indices of at most 64 frames, spread evenly over all."""
    return np.unique(np.linspace(0, count - 1, 64).round().astype(int))


def _at_rest(raw: RawSkeleton) -> RawSkeleton:
    """The first frame without rotations, except those of a stage: joints from the root down that have one child and never turn."""
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


def _canonical(
    raw: RawSkeleton, kind: Flavour, offsets: np.ndarray | None = None
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Positions (T, 3) and orientations (T, 4) by canonical name; `offsets` (N, 3) replace the file's."""
    posed = forward_kinematics(raw, offsets, source_joints(raw.names, kind))
    return canonical(raw.names, kind, *posed, raw.offsets)


def _check_sides(points: dict[str, np.ndarray], kind: Flavour) -> None:
    """Warns if the joints called left lie on the person's right; the names of a known flavour are kept all the same."""
    frames = _spread(len(points["pelvis"]))
    if sum(signs({name: track[frames] for name, track in points.items()}).values()) < -DECISIVE:
        warn(
            f"the joints that flavour {kind.name!r:.60} calls left lie on the person's right by feet and knees, so the "
            "file seems to be mirrored; mirror it back"
        )
