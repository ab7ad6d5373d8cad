"""Stature from bone lengths: the same for every skeleton that a file may hang one and the same body on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from t2d_rt.body.template import bodies, template
from t2d_rt.motion import describe, load_motion
from t2d_rt.motion.kinematics import stature_m

Points = dict[str, np.ndarray]
SIDES = ("left", "right")
STATURE = float(np.ptp(template().vertices[:, 2]))
"""Of the adult template [m]."""


def raised_pelvis(points: Points) -> Points:
    """As in CMU files: the root 9 cm above the hips."""
    return points | {"pelvis": points["pelvis"] + [0, 0, 0.09]}


def winding_spine(points: Points) -> Points:
    """Joints of the spine in front of it and behind it, as in iClone's skeleton."""
    shifted = {name: points[name] + [x, 0, 0] for name, x in (("spine1", 0.05), ("spine2", -0.04), ("spine3", 0.05))}
    return points | shifted


def high_head_end(points: Points) -> Points:
    """An end of the head 10 cm above the skull."""
    return points | {"head_top": points["head_top"] + [0, 0, 0.1]}


@pytest.mark.parametrize("change", [lambda points: points, raised_pelvis, winding_spine, high_head_end])
@pytest.mark.parametrize("scale", [0.8, 1.0, 1.1])
def test_stature_does_not_depend_on_the_joints_between(change: Callable[[Points], Points], scale: float) -> None:
    points = {name: np.tile(place, (4, 1)) for name, place in template().joints.items()}
    found = stature_m({name: scale * track for name, track in change(points).items()})
    assert found == pytest.approx(scale * STATURE, rel=0.002)


def test_stature_is_that_of_the_bones_in_any_pose() -> None:
    """Bent knees and turned legs change no bone."""
    points = {name: np.tile(place, (4, 1)) for name, place in template().joints.items()}
    for side in SIDES:
        shank = np.linalg.norm(points[f"{side}_ankle"] - points[f"{side}_knee"], axis=1)
        points[f"{side}_ankle"] = points[f"{side}_knee"] - shank[:, None] * [1.0, 0.0, 0.0]
    assert stature_m(points) == pytest.approx(STATURE, rel=0.002)


@pytest.mark.parametrize("name", bodies())
def test_bone_lengths_tell_the_stature_of_every_body(name: str) -> None:
    """Within 2.5 %, of which a child's larger head is the most."""
    points = {joint: np.tile(place, (4, 1)) for joint, place in template(name).joints.items()}
    assert stature_m(points) == pytest.approx(template(name).stature_m, rel=0.025)


# --- files ----------------------------------------------------------------------------------------------------------


def bvh(joints: list[tuple[str, str | None, np.ndarray]]) -> str:
    """A BVH file, y up, in cm, of 12 equal frames: joints with their parents and places (x forward, y left, z up) [m]."""
    at = {name: 100 * place[[1, 2, 0]] for name, _, place in joints}

    def block(name: str, parent: str | None, indent: str) -> str:
        offset = " ".join(f"{x:.6f}" for x in (at[name] if parent is None else at[name] - at[parent]))
        children = [child for child, above, _ in joints if above == name]
        channels = "6 Xposition Yposition Zposition" if parent is None else "3"
        inner = "".join(block(child, name, indent + "  ") for child in children)
        end = "" if children else f"{indent}  End Site\n{indent}  {{\n{indent}    OFFSET 0 0 0\n{indent}  }}\n"
        return (
            f"{indent}{'ROOT' if parent is None else 'JOINT'} {name}\n{indent}{{\n{indent}  OFFSET {offset}\n"
            f"{indent}  CHANNELS {channels} Zrotation Yrotation Xrotation\n{inner}{end}{indent}}}\n"
        )

    root = joints[0][0]
    place = " ".join(f"{x:.6f}" for x in at[root])
    frame = place + " 0" * (3 * len(joints)) + "\n"
    return f"HIERARCHY\n{block(root, None, '')}MOTION\nFrames: 12\nFrame Time: 0.0166667\n{12 * frame}"


def full_spine() -> list[tuple[str, str | None, np.ndarray]]:
    """The adult on a skeleton with four joints of the spine, two of the neck, and an end of the head above the skull."""
    at = template().joints
    spine = ["Spine", "Spine1", "Spine2", "Spine3", "Neck", "Neck1", "Head", "HeadEnd"]
    places = [at[name] for name in ("spine1", "spine2", "spine3")]
    places += [(at["spine3"] + at["neck"]) / 2, at["neck"], (at["neck"] + at["head"]) / 2, at["head"]]
    joints: list[tuple[str, str | None, np.ndarray]] = [("Hips", None, at["pelvis"])]
    above = "Hips"
    for name, place in zip(spine, [*places, at["head_top"] + [0, 0, 0.06]], strict=True):
        joints.append((name, above, place))
        above = name
    for side in SIDES:
        chains = (
            ("Spine3", {"Shoulder": "collar", "Arm": "shoulder", "ForeArm": "elbow", "Hand": "wrist"}),
            ("Hips", {"UpLeg": "hip", "Leg": "knee", "Foot": "ankle", "ToeBase": "foot", "ToeBaseEnd": "toe"}),
        )
        for above, names in chains:
            for theirs, ours in names.items():
                name = f"{side.title()}{theirs}"
                joints.append((name, above, at[f"{side}_{ours}"]))
                above = name
    return joints


def test_a_file_with_a_full_spine_and_a_head_end_tells_the_bodys_stature(tmp_path: Path) -> None:
    path = tmp_path / "standing.bvh"
    path.write_text(bvh(full_spine()))
    motion = load_motion(path)
    assert "1 unit = 0.01 m (stature 1.84 m); up y" in motion.report
    assert describe(motion).stature_m == pytest.approx(STATURE, rel=0.005)
