"""Skeletons of other origin: any names, any root, sides from the body, flavours as files, units by proportions, flips."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from builders import MOTIONS, WALK, slow_after
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion import load_motion
from t2d_rt.motion.interpolate import decompose
from t2d_rt.motion.match import match, skeleton_tree
from t2d_rt.motion.match.skeleton_tree import Tree, label
from t2d_rt.types.motion import CANONICAL_JOINTS, CANONICAL_PARENTS, Motion

# Every second frame of a walk at 24 Hz is enough to tell skeletons apart, and the reader warns of so few.
pytestmark = pytest.mark.filterwarnings("ignore:12 frames a second")

BASES = {
    "momask": MOTIONS / "momask_22j_120frames.bvh",
    "walk": MOTIONS / "bvhtoolbox_walk01.bvh",
    "run": MOTIONS / "iclone_002_03_run_jog.bvh.gz",
}


Y_UP = Rotation.from_matrix([[0, 1, 0], [0, 0, 1], [1, 0, 0]])
Z_UP = Y_UP.inv()


@dataclass(frozen=True)
class Skeleton:
    """Joints in time, from which a BVH with six channels for every joint is written."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    positions: np.ndarray
    rotations: Rotation | np.ndarray
    """Quaternions (T, N, 4)."""
    rate_hz: float

    def renamed(self, table: dict[str, str]) -> Skeleton:
        return replace(self, names=tuple(table.get(name, name) for name in self.names))

    def unnamed(self, mark: str = "n") -> Skeleton:
        """Names that tell nothing."""
        return self.renamed({name: f"{mark}{i}" for i, name in enumerate(self.names)})

    @property
    def above(self) -> dict[str, str]:
        """The parent of each joint; "" for the root."""
        return {n: self.names[p] if p >= 0 else "" for n, p in zip(self.names, self.parents, strict=True)}

    def arranged(self, order: list[str], above: dict[str, str]) -> Skeleton:
        """Those joints, below these parents."""
        rows = [self.names.index(name) for name in order]
        parents = tuple(order.index(above[name]) if above[name] else -1 for name in order)
        return replace(
            self, names=tuple(order), parents=parents, positions=self.positions[:, rows], rotations=self.rotations[:, rows]
        )  # fmt: skip

    def without(self, lost: set[str]) -> Skeleton:
        """Joints taken out; their children hang from the joint above, and move against it."""
        above = self.above
        for joint in lost:
            above = {name: above[joint] if parent == joint else parent for name, parent in above.items()}
        return self.arranged([name for name in self.names if name not in lost], above)

    def hanging(self, table: dict[str, str], rng: np.random.Generator | None = None) -> Skeleton:
        """Joints with other parents, "" for the root; children in an order that is drawn, where there is an `rng`."""
        above, order = self.above | table, []

        def visit(name: str) -> None:
            order.append(name)
            children = [child for child in self.names if above[child] == name]
            for child in children if rng is None else rng.permutation(children):
                visit(str(child))

        visit(next(name for name in self.names if not above[name]))
        return self.arranged(order, above)

    def joined(self, name: str, parent: str, places: np.ndarray) -> Skeleton:
        """With one more joint at (T, 3), which does not turn by itself."""
        above = self.names.index(parent)
        return replace(
            self,
            names=(*self.names, name), parents=(*self.parents, above),
            positions=np.concatenate([self.positions, places[:, None]], axis=1),
            rotations=np.concatenate([self.rotations, self.rotations[:, above : above + 1]], axis=1),
        )  # fmt: skip

    def below(self, names: tuple[str, ...]) -> Skeleton:
        """On roots that the whole motion hangs from; the first walks along, the others stand still in it."""
        count = len(names)
        track = self.positions[:, :1] * [1.0, 0.0, 1.0]
        turned = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (len(track), count, 4))
        return replace(
            self,
            names=(*names, *self.names),
            parents=(-1, *range(count - 1), *(count - 1 if p < 0 else p + count for p in self.parents)),
            positions=np.concatenate([np.repeat(track, count, axis=1), self.positions], axis=1),
            rotations=np.concatenate([turned, self.rotations], axis=1),
        )

    def turned(self, rotation: Rotation) -> Skeleton:
        """The whole of it, as by a file with other axes."""
        shape = self.rotations.shape
        return replace(
            self,
            positions=self.positions @ rotation.as_matrix().T,
            rotations=(rotation * Rotation.from_quat(self.rotations.reshape(-1, 4))).as_quat().reshape(shape),
        )

    def mirrored(self) -> Skeleton:
        """x to -x; names stay where they are."""
        return replace(
            self, positions=self.positions * [-1.0, 1.0, 1.0], rotations=self.rotations * [1.0, -1.0, -1.0, 1.0]
        )

    def scaled(self, factor: float) -> Skeleton:
        return replace(self, positions=factor * self.positions)

    def read(self, folder: Path, **options: Any) -> Motion:
        """As the reader has it, not smoothed."""
        return load_motion(self.write(folder / "a.bvh"), **{"smooth_hz": None, **options})

    def write(self, path: Path) -> Path:
        head, columns = ["HIERARCHY"], []
        local = []
        for joint, parent in enumerate(self.parents):
            own = Rotation.from_quat(self.rotations[:, joint])
            if parent < 0:
                local.append((self.positions[:, joint], own))
            else:
                above = Rotation.from_quat(self.rotations[:, parent]).inv()
                local.append((above.apply(self.positions[:, joint] - self.positions[:, parent]), above * own))

        def visit(joint: int, depth: int) -> None:
            shift, turn = local[joint]
            offset = np.median(shift, axis=0)
            still = np.abs(shift - offset).max() < 1e-4 * np.abs(offset).max() and joint
            pad = "  " * depth
            kind = "ROOT" if joint == 0 else "JOINT"
            channels = "" if still else "Xposition Yposition Zposition "
            head.extend(
                [
                    f"{pad}{kind} {self.names[joint]}",
                    f"{pad}{{",
                    f"{pad}  OFFSET {' '.join(f'{x:.7f}' for x in offset)}",
                ]
            )
            head.append(f"{pad}  CHANNELS {3 if still else 6} {channels}Zrotation Yrotation Xrotation")
            if not still:
                columns.append(shift)
            columns.append(turn.as_euler("ZYX", degrees=True))
            children = [i for i, p in enumerate(self.parents) if p == joint]
            for child in children:
                visit(child, depth + 1)
            if not children:
                head.extend([f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET 0 0 0", f"{pad}  }}"])
            head.append(f"{pad}}}")

        visit(0, 0)
        values = np.concatenate(columns, axis=1)
        rows = [" ".join(f"{x:.7f}" for x in row) for row in values]
        head += ["MOTION", f"Frames: {len(values)}", f"Frame Time: {1.0 / self.rate_hz:.8f}", *rows]
        path.write_text("\n".join(head) + "\n", encoding="utf-8")
        return path


@cache
def original(base: str) -> Motion:
    return load_motion(BASES[base], smooth_hz=None)


@cache
def person(base: str) -> Skeleton:
    """The canonical joints of a shipped motion, named by themselves, y up, in metres; every other frame."""
    motion = original(base)
    rows = slice(0, 100, 2)
    return Skeleton(
        motion.names[:22], CANONICAL_PARENTS, motion.joints[rows, :22], motion.rotations[rows, :22], motion.rate_hz / 2
    ).turned(Y_UP)


def check(motion: Motion, base: str, leave_out: set[str] = frozenset()) -> None:  # type: ignore[assignment]
    """No joint is more than 1 mm from the original."""
    worst = max(gaps(motion, base, leave_out).items(), key=lambda item: item[1])
    assert worst[1] < 1e-3, worst


def gaps(motion: Motion, base: str, leave_out: set[str] = frozenset()) -> dict[str, float]:  # type: ignore[assignment]
    """Largest distance of each joint from the original, apart from the horizontal place and the level of the floor."""
    wanted = original(base).joints[0:100:2, :22]
    shift = (motion.joints[:, 0] - wanted[:, 0]).mean(axis=0)
    apart = np.linalg.norm(motion.joints[:, :22] - wanted - shift, axis=-1).max(axis=0)
    return {name: float(gap) for name, gap in zip(CANONICAL_JOINTS, apart, strict=True) if name not in leave_out}


# --- names ----------------------------------------------------------------------------------------------------------

ORDER = (
    "pelvis", "spine1", "spine2", "spine3", "neck", "head", "hip", "knee", "ankle", "foot", "collar", "shoulder",
    "elbow", "wrist",
)  # fmt: skip
FAMILIES = {
    "SMPL": "Pelvis Spine1 Spine2 Spine3 Neck Head {S}_Hip {S}_Knee {S}_Ankle {S}_Foot {S}_Collar {S}_Shoulder {S}_Elbow {S}_Wrist",
    "SMPL small": "pelvis spine1 spine2 spine3 neck head {side}_hip {side}_knee {side}_ankle {side}_foot {side}_collar "
    "{side}_shoulder {side}_elbow {side}_wrist",
    "Bandai Namco": "Hips Spine Spine1 Chest Neck Head UpperLeg_{S} LowerLeg_{S} Foot_{S} Toes_{S} Shoulder_{S} UpperArm_{S} "
    "LowerArm_{S} Hand_{S}",
    "100STYLE": "Hips Chest Chest2 Chest3 Neck Head {Side}Hip {Side}Knee {Side}Ankle {Side}Toe {Side}Collar {Side}Shoulder "
    "{Side}Elbow {Side}Wrist",
    "Xsens": "Pelvis L5 L3 T8 Neck Head {Side}UpperLeg {Side}LowerLeg {Side}Foot {Side}Toe {Side}Shoulder {Side}UpperArm "
    "{Side}ForeArm {Side}Hand",
    "Rigify": "spine spine.001 spine.002 spine.003 spine.004 spine.006 thigh.{S} shin.{S} foot.{S} toe.{S} shoulder.{S} "
    "upper_arm.{S} forearm.{S} hand.{S}",
    "Unreal": "pelvis spine_01 spine_02 spine_03 neck_01 head thigh_{s} calf_{s} foot_{s} ball_{s} clavicle_{s} upperarm_{s} "
    "lowerarm_{s} hand_{s}",
    "Biped": "Bip01_Pelvis Bip01_Spine Bip01_Spine1 Bip01_Spine2 Bip01_Neck Bip01_Head Bip01_{S}_Thigh Bip01_{S}_Calf "
    "Bip01_{S}_Foot Bip01_{S}_Toe0 Bip01_{S}_Clavicle Bip01_{S}_UpperArm Bip01_{S}_Forearm Bip01_{S}_Hand",
    "Unity": "Hips Spine Chest UpperChest Neck Head {Side}UpperLeg {Side}LowerLeg {Side}Foot {Side}Toes {Side}Shoulder "
    "{Side}UpperArm {Side}LowerArm {Side}Hand",
    "Daz": "hip abdomen abdomen2 chest neck head {s}Thigh {s}Shin {s}Foot {s}Toe {s}Collar {s}Shldr {s}ForeArm {s}Hand",
    "small Daz": "hip abdomen abdomen2 chest neck head {s}thigh {s}shin {s}foot {s}toe {s}collar {s}shldr {s}forearm {s}hand",
    "Kimodo": "Hips Spine1 Spine2 Chest Neck1 Head {Side}Leg {Side}Shin {Side}Foot {Side}ToeBase {Side}Shoulder {Side}Arm "
    "{Side}ForeArm {Side}Hand",
    "ASF": "root lowerback upperback thorax lowerneck head {s}femur {s}tibia {s}foot {s}toes {s}clavicle {s}humerus {s}radius "
    "{s}hand",
    "German": "Becken Wirbel1 Wirbel2 Brust Hals Kopf Oberschenkel_{S} Unterschenkel_{S} Fuß_{S} Zehen_{S} Schlüsselbein_{S} "
    "Oberarm_{S} Unterarm_{S} Hand_{S}",
    "Japanese": "腰 上半身 上半身2 上半身3 首 頭 {J}足 {J}ひざ {J}足首 {J}つま先 {J}肩 {J}腕 {J}ひじ {J}手首",
    "motion bank": "Hips ToSpine Spine Spine1 Neck Head {Side}UpLeg {Side}LowLeg {Side}Foot {Side}ToeBase {Side}Collar "
    "{Side}UpArm {Side}LowArm {Side}Hand",
}


def table(words: str) -> dict[str, str]:
    """Canonical names to those of a family."""
    found = {}
    for joint, pattern in zip(ORDER, words.split(), strict=True):
        for side, sign in (("left", "左"), ("right", "右")):
            if "{" in pattern:
                marks = {"Side": side.capitalize(), "side": side, "S": side[0].upper(), "s": side[0], "J": sign}
                found[f"{side}_{joint}"] = pattern.format(**marks).replace("_", " " if "Bip01" in pattern else "_")
            else:
                found[joint] = pattern
    return found


@pytest.mark.parametrize("family", FAMILIES)
def test_names_of_every_family_are_understood(family: str) -> None:
    for joint, name in table(FAMILIES[family]).items():
        found = label(name)
        side, _, part = joint.rpartition("_")
        assert (found.side or "") == side, name
        if not part.startswith("spine") and name not in ("root", "hip") and family != "Rigify":
            assert part in found.parts, (name, found)


@pytest.mark.parametrize(
    ("name", "side", "part"),
    [
        ("mixamorig:LeftHandMiddle4", "left", "hand"), ("CC_Base_L_Thigh", "left", "hip"), ("lHipJoint", "left", "hip"),
        ("RThumb", "right", "hand"), ("relbow", "right", "elbow"), ("rbuttock", "right", "hip"), ("HeadTop_End", None, "head_top"),
        ("左足首", "left", "ankle"), ("LeftEye", "left", "face"), ("jL5S1", None, "spine"), ("C7", None, "neck"),
        ("thigh_twist_01_l", "left", "twist"), ("ik_foot_l", "left", "helper"), ("Armature", None, "root"),
        ("SpineShoulder", None, "spine"), ("joint17", None, None), ("clipper", None, None), ("Pushing", None, None),
        ("lr", None, None),
    ],
)  # fmt: skip
def test_words(name: str, side: str | None, part: str | None) -> None:
    found = label(name)
    assert found.side == side
    assert part in found.parts if part else not found.parts


@pytest.mark.parametrize("family", slow_after(6, FAMILIES))
def test_families_are_read(tmp_path: Path, family: str) -> None:
    base = sorted(BASES)[len(family) % 3]
    motion = person(base).renamed(table(FAMILIES[family])).read(tmp_path)
    check(motion, base)
    assert "(sure;" in motion.report or "flavour" in motion.report


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("roots", [(), ("reference", "Armature")])
@pytest.mark.parametrize("mirrored", [False, True])
def test_unknown_names_are_read_by_form(tmp_path: Path, base: str, roots: tuple[str, ...], mirrored: bool) -> None:
    """Numbers for names, children in any order, an axis more than y upward, roots above the hips: joints are where they were."""
    skeleton = person(base).below(roots) if roots else person(base)
    if mirrored:
        skeleton = skeleton.mirrored()
    skeleton = skeleton.hanging({}, np.random.default_rng(len(roots))).turned(Z_UP)
    unnamed = skeleton.unnamed("joint")
    numbers = dict(zip(skeleton.names, unnamed.names, strict=True))
    motion = unnamed.read(tmp_path, up="z")
    assert "matched by form (sure; 0 % are named as expected; sides from feet, knees" in motion.report
    if not mirrored:
        assert f"left_knee {numbers['left_knee']}" in motion.report
        check(motion, base)
        found = load_motion(tmp_path / "a.bvh", smooth_hz=None)
        np.testing.assert_allclose(found.joints, motion.joints)
    else:
        assert f"left_knee {numbers['right_knee']}" in motion.report


@pytest.mark.parametrize("odd", ["\x1b[31mSpine", "x" * 20_000, "%s", "Name, with; signs"])
def test_odd_names_are_printed_in_one_short_line(tmp_path: Path, odd: str) -> None:
    report = person("walk").renamed({"spine2": odd}).read(tmp_path).report
    assert report.isprintable()
    assert len(report) < 2000


# --- what lacks, and what there is too much of ------------------------------------------------------------------------

LACKING = {
    "toes": {"left_foot", "right_foot"}, "collars": {"left_collar", "right_collar"}, "neck": {"neck"},
    "spine": {"spine1", "spine2"}, "all but one of the spine": {"spine1", "spine3"},
    "whole trunk": {"spine1", "spine2", "spine3", "neck", "left_collar", "right_collar"},
    "all that may lack": {"spine1", "spine2", "left_collar", "right_collar", "neck", "left_foot", "right_foot"},
}  # fmt: skip


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("lacks", slow_after(2, LACKING))
@pytest.mark.parametrize("named", [False, True])
def test_optional_joints_may_lack(tmp_path: Path, base: str, lacks: str, named: bool) -> None:
    """Joints above them move against their new parents, so every joint's position channels count, too."""
    skeleton = person(base).without(LACKING[lacks])
    motion = (skeleton if named else skeleton.unnamed("j")).read(tmp_path, floor=0.0)
    assert motion.names[:22] == CANONICAL_JOINTS
    check(motion, base, LACKING[lacks] | {"spine1", "spine2", "spine3"})
    assert "made up: " in motion.report or lacks == "toes"


HANGS = {
    "thighs from the spine, collars from the neck (3ds Max)": {
        "left_hip": "spine1", "right_hip": "spine1", "left_collar": "neck", "right_collar": "neck",
    },
    "root in the chest": {"spine3": "", "spine2": "spine3", "spine1": "spine2", "pelvis": "spine1"},
    "root in the waist": {"spine1": "", "pelvis": "spine1"},
    "arms from the waist": {"left_collar": "spine2", "right_collar": "spine2"},
    "all from the pelvis": {"left_collar": "pelvis", "right_collar": "pelvis"},
    "head from the waist": {"neck": "spine2"},
}  # fmt: skip


@pytest.mark.parametrize("base", slow_after(1, BASES))
@pytest.mark.parametrize("hangs", HANGS)
def test_limbs_may_hang_elsewhere(tmp_path: Path, base: str, hangs: str) -> None:
    check(person(base).hanging(HANGS[hangs]).unnamed().read(tmp_path, floor=0.0), base)


def test_only_hips_spine_and_head(tmp_path: Path) -> None:
    """A plain skeleton of few joints: limbs of three joints, one spine, a head."""
    plain = {"pelvis": "Hips", "spine3": "Spine", "head": "Head"}
    limbs = {f"{side}_{joint}" for side in ("left", "right") for joint in ORDER[6:9] + ORDER[11:]}
    lost = set(CANONICAL_JOINTS[:22]) - {*plain, *limbs}
    check(person("walk").without(lost).renamed(plain).read(tmp_path, floor=0.0), "walk", lost)


def grown(skeleton: Skeleton, extra: list[tuple[str, str, tuple[float, float, float]]]) -> Skeleton:
    """With more joints: (name, parent, offset in the parent's frame)."""
    for name, parent, offset in extra:
        above = skeleton.names.index(parent)
        place = Rotation.from_quat(skeleton.rotations[:, above]).apply(offset) + skeleton.positions[:, above]
        skeleton = skeleton.joined(name, parent, place)
    return skeleton


def test_props_and_face_do_not_confuse(tmp_path: Path) -> None:
    """A sword in one hand, a tail, a face, twist bones beside the limbs, a hand of five fingers: the joints stay the same."""
    fingers = [
        (f"f{i}{k}", "left_wrist" if k == 0 else f"f{i}{k - 1}", (0.03 * i, -0.04, 0.0))
        for i in range(5)
        for k in range(3)
    ]
    others = [
        ("sword", "right_wrist", (0.0, 0.3, 0.3)), ("sword tip", "sword", (0.0, 0.6, 0.3)), ("tail", "pelvis", (0.0, 0.0, -0.2)),
        ("tail2", "tail", (0.0, 0.0, -0.4)), ("tail3", "tail2", (0.0, 0.0, -0.4)), ("eye1", "head", (0.04, 0.1, 0.1)),
        ("eye2", "head", (-0.04, 0.1, 0.1)), ("tw1", "left_hip", (0.0, -0.2, 0.0)), ("tw2", "right_hip", (0.0, -0.2, 0.0)),
    ]  # fmt: skip
    skeleton = grown(person("momask"), others + fingers).unnamed().hanging({}, np.random.default_rng(7))
    check(skeleton.read(tmp_path, floor=0.0), "momask")


def halves(skeleton: Skeleton, lower: str, name: str, fraction: float = 0.5) -> Skeleton:
    """A joint on the way to another one, which then hangs from it."""
    joint = skeleton.names.index(lower)
    above = skeleton.parents[joint]
    between = fraction * skeleton.positions[:, joint] + (1.0 - fraction) * skeleton.positions[:, above]
    return skeleton.joined(name, skeleton.names[above], between).hanging({lower: name})


@pytest.mark.parametrize("named", [False, True])
def test_twist_bones_inside_limbs(tmp_path: Path, named: bool) -> None:
    """As of MakeHuman and Daz: the thigh bends at its end, not where it twists."""
    skeleton = person("walk")
    for side in ("left", "right"):
        for part in ("knee", "ankle", "elbow", "wrist"):
            skeleton = halves(skeleton, f"{side}_{part}", f"{side}_{part}_twist")
    check((skeleton if named else skeleton.unnamed()).read(tmp_path, floor=0.0), "walk")


def test_a_knee_that_bends_is_no_twist_bone() -> None:
    """A bone goes through a joint in the middle of the thigh, but not through the knee."""
    skeleton = halves(person("walk"), "left_knee", "between")
    tree = Tree(skeleton.names, skeleton.parents, skeleton.positions)
    hip, knee, ankle = (skeleton.names.index(f"left_{joint}") for joint in ("hip", "knee", "ankle"))
    stretches = {(upper, lower) for upper, lower, _, _ in skeleton_tree._bones(tree, tree.below(hip, 9, 90), 0)}
    assert (hip, knee) in stretches
    assert (knee, ankle) in stretches
    assert (hip, ankle) not in stretches


@pytest.mark.parametrize("named", [False, True])
def test_of_joints_in_one_place_the_last_turns_the_bone(tmp_path: Path, named: bool) -> None:
    """Doubles of zero length carry the bones, the joints above them do not turn on their own."""
    skeleton = person("walk")
    for bone in ("hip knee", "knee ankle", "ankle foot", "shoulder elbow", "elbow wrist"):
        upper, lower = bone.split()
        for side in ("left", "right"):
            skeleton = halves(skeleton, f"{side}_{lower}", f"{side}_{upper}_double", 0.0)
            still, turns = skeleton.names.index(f"{side}_{upper}"), np.array(skeleton.rotations)
            turns[:, still] = turns[:, skeleton.parents[still]]
            skeleton = replace(skeleton, rotations=turns)
    motion = (skeleton if named else skeleton.unnamed()).read(tmp_path, floor=0.0)
    check(motion, "walk")
    offsets, _ = decompose(motion.joints, motion.rotations, motion.parents)
    rows = [motion.index(f"{s}_{j}") for s in ("left", "right") for j in ("knee", "ankle", "foot", "elbow", "wrist")]
    assert offsets[:, rows].std(axis=0).max() < 1e-4


def test_a_missing_head_is_made_up_and_said(tmp_path: Path) -> None:
    with pytest.warns(T2DWarning, match="matched with little certainty"):
        motion = person("walk").without({"head", "neck"}).read(tmp_path, floor=0.0)
    assert "made up: neck, head" in motion.report
    assert gaps(motion, "walk")["head"] < 0.15


# --- sides ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("base", BASES)
def test_left_is_left_whatever_the_names_say(tmp_path: Path, base: str) -> None:
    """A file whose names are on the wrong sides is read as the body has it, with a warning."""
    names = person(base).names
    wrong = {name: "x" + name.replace("left", "L").replace("right", "R") for name in names}
    wrong = {n: wrong[n.replace("left", "*").replace("right", "left").replace("*", "right")] for n in names}
    with pytest.warns(T2DWarning, match="joints named left lie on the person's right"):
        motion = person(base).renamed(wrong).read(tmp_path)
    check(motion, base)


def test_a_mirrored_file_of_a_known_flavour_is_said(tmp_path: Path) -> None:
    words = "Hips Spine Spine1 Spine2 Neck Head {Side}UpLeg {Side}Leg {Side}Foot {Side}Toe {Side}Shoulder {Side}Arm {Side}ForeArm"
    with pytest.warns(T2DWarning, match="'momask' calls left lie on the person's right"):
        person("walk").mirrored().renamed(table(f"{words} {{Side}}Hand")).read(tmp_path)


WORDS = st.sampled_from(
    ["l", "r", "left", "right", "hip", "knee", "arm", "head", "foot", "neck", "x", "7", "足", "Spine"]
)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), base=st.sampled_from(sorted(BASES)))
def test_no_names_swap_the_sides(data: st.DataObject, base: str) -> None:
    """Whatever the joints are called, each joint of the left is found on the left."""
    skeleton = person(base).hanging({}, np.random.default_rng(data.draw(st.integers(0, 100))))
    names = [f"{'_'.join(data.draw(st.lists(WORDS, max_size=3)))}.{i}" for i in range(22)]
    found = match(tuple(names), skeleton.parents, skeleton.positions)
    side = dict(zip(names, (name.partition("_")[0] for name in skeleton.names), strict=True))
    for joint, source in found.joints.items():
        if joint.startswith(("left", "right")) and isinstance(source, str):
            assert side[source] == joint.partition("_")[0], (joint, source, found.summary)


# --- nobody ---------------------------------------------------------------------------------------------------------


Bone = tuple[str, str | None, tuple[float, float, float]]


def drawn(bones: list[Bone]) -> Skeleton:
    """A skeleton that stands still for four frames: (name, parent, offset)."""
    names = tuple(name for name, _, _ in bones)
    places: list[np.ndarray] = []
    for _, parent, offset in bones:
        places.append(np.array(offset) + (places[names.index(parent)] if parent else 0.0))
    positions = np.repeat(np.array(places)[None], 4, axis=0)
    turns = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (4, len(names), 4))
    return Skeleton(names, tuple(names.index(p) if p else -1 for _, p, _ in bones), positions, turns, 30.0)


def limb(name: str, parent: str, *offsets: tuple[float, float, float]) -> list[Bone]:
    return [(f"{name}{i}", f"{name}{i - 1}" if i else parent, offset) for i, offset in enumerate(offsets)]


DOG = [
    ("root", None, (0.0, 0.6, 0.0)),
    *limb("back", "root", (0, 0, 0.2), (0, 0, 0.2), (0, 0, 0.2)),
    *limb("neck", "back2", (0, 0.1, 0.1), (0, 0.1, 0.1), (0, 0, 0.15)),
    *limb("tail", "root", (0, 0, -0.2), (0, 0, -0.2)),
    *(
        bone
        for sign in (-1, 1)
        for end, base in (("rear", "root"), ("front", "back2"))
        for bone in limb(f"{end}{sign}", base, (0.1 * sign, 0, 0), (0, -0.25, 0.05), (0, -0.25, -0.05), (0, -0.1, 0.05))
    ),
]
HAND = [
    ("wrist", None, (0.0, 1.0, 0.0)),
    *(
        bone
        for i in range(5)
        for bone in limb(f"finger{i}", "wrist", (0.02 * i, -0.08, 0), (0, -0.04, 0), (0, -0.03, 0), (0, -0.02, 0))
    ),
]
SNAKE = [("head", None, (0.0, 0.0, 0.0)), *limb("s", "head", *[(0.0, 0.0, 0.1)] * 12)]
LEGS = [
    ("hips", None, (0.0, 1.0, 0.0)),
    *(b for s in (-1, 1) for b in limb(f"leg{s}", "hips", (0.1 * s, 0, 0), (0, -0.4, 0), (0, -0.4, 0))),
]


@pytest.mark.parametrize(
    ("bones", "sentence"),
    [
        (DOG, "four limbs are alike .*looks like an animal or a hand|no person's proportions"),
        (HAND, "looks like an animal or a hand|no person's proportions"),
        (SNAKE, "no two limbs of like bones"),
        (LEGS, "one pair of limbs only"),
    ],
)
def test_what_is_no_person_is_refused(tmp_path: Path, bones: list[Bone], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as caught:
        load_motion(drawn(bones).write(tmp_path / "a.bvh"))
    assert "flavour=FILE.yaml" in str(caught.value)
    assert len(str(caught.value)) < 600


def test_a_standing_figure_without_motion_is_read_by_names(tmp_path: Path) -> None:
    """Straight legs, no feet: only names can tell the sides; without names it is unsure."""
    bones = [
        ("Hips", None, (0.0, 0.9, 0.0)),
        ("Spine", "Hips", (0, 0.25, 0)),
        ("Neck", "Spine", (0, 0.27, 0)),
        ("Head", "Neck", (0, 0.1, 0)),
    ]
    for s, word in ((-1, "Right"), (1, "Left")):
        bones += [
            (f"{word}UpLeg", "Hips", (0.1 * s, 0, 0)), (f"{word}Leg", f"{word}UpLeg", (0, -0.42, 0)),
            (f"{word}Foot", f"{word}Leg", (0, -0.42, 0)), (f"{word}Arm", "Spine", (0.18 * s, 0.25, 0)),
            (f"{word}ForeArm", f"{word}Arm", (0.28 * s, 0, 0)), (f"{word}Hand", f"{word}ForeArm", (0.25 * s, 0, 0)),
        ]  # fmt: skip
    with pytest.warns(T2DWarning, match="stays in one pose with its arms held out"):
        assert "left_elbow LeftForeArm" in drawn(bones).read(tmp_path).report  # type: ignore[arg-type]
    with pytest.warns(T2DWarning) as told:
        drawn(bones).unnamed().read(tmp_path)  # type: ignore[arg-type]
    assert [any(each in str(one.message) for one in told) for each in ("little certainty", "a T-pose")] == [True, True]


# --- flavour files --------------------------------------------------------------------------------------------------

STUDIO = """
name: studio
joints:
  pelvis: hub
  spine3: [trunk, throat, 0.25]
  neck: throat
  head: Head
  "*_hip": "{Side}A"
  "*_knee": "{S}_b"
  "*_ankle": "{s}.c"
  "*_shoulder": "{side}.d"
  "*_elbow": "{Side}E"
  "*_wrist": "{Side}F"
"""


@pytest.fixture
def studio(tmp_path: Path) -> Path:
    """A file whose names only its flavour file knows."""
    own = {"pelvis": "hub", "spine3": "trunk", "neck": "throat", "head": "Head"}
    for side in ("left", "right"):
        s, big = side[0], side.capitalize()
        marks = (f"{big}A", f"{s.upper()}_b", f"{s}.c", f"{side}.d", f"{big}E", f"{big}F")
        own |= {f"{side}_{joint}": mark for joint, mark in zip(ORDER[6:9] + ORDER[11:], marks, strict=True)}
    return person("walk").renamed({n: f"rig:{own.get(n, n)}" for n in person("walk").names}).write(tmp_path / "a.bvh")


def test_a_flavour_file(tmp_path: Path, studio: Path) -> None:
    (tmp_path / "my.yaml").write_text(STUDIO)
    motion = load_motion(studio, flavour=str(tmp_path / "my.yaml"), smooth_hz=None, floor=0.0)
    assert "flavour studio;" in motion.report
    check(motion, "walk", {"left_foot", "right_foot", "spine1", "spine2", "spine3", "left_collar", "right_collar"})
    at = {name: motion.joints[:, i] for i, name in enumerate(motion.names)}
    trunk = original("walk").joints[0:100:2, CANONICAL_JOINTS.index("spine3")]
    trunk = trunk + (motion.joints[:, 0] - original("walk").joints[0:100:2, 0])
    np.testing.assert_allclose(at["spine3"], 0.75 * trunk + 0.25 * at["neck"], atol=1e-4)
    (tmp_path / "full.yml").write_text(re.sub(r": (hub|trunk|throat|Head)$", r": rig:\1", STUDIO, flags=re.M))
    with pytest.raises(InputError, match=r"not of flavour 'studio': the file lacks .*leave the flavour out"):
        load_motion(studio, flavour=str(tmp_path / "full.yml"))
    full = re.sub(
        r": (hub|throat|Head)$|\[(trunk), (throat)",
        lambda m: m[0].replace(" ", " rig:").replace("[", "[rig:"),
        STUDIO,
        flags=re.M,
    )
    (tmp_path / "full.yml").write_text(full.replace('"{', '"rig:{'))
    same = load_motion(studio, flavour=str(tmp_path / "full.yml"), smooth_hz=None, floor=0.0)
    np.testing.assert_array_equal(same.joints, motion.joints)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("pelvis: hub", "tail: hub", r"maps unknown canonical joints \['tail'\]"),
        ("  head: Head\n", "", r"must also map \['head'\]"),
        ("joints:", "joint:", "unknown key 'joint'; did you mean joints"),
        ("pelvis: hub", "pelvis: 7", "must be a name, got 7"),
        ("0.25]", "0.25, 1]", r"must be a joint or \[joint, joint, fraction\]"),
        ("0.25]", "far]", "fraction .* must be a number"),
        ("0.25]", "99]", r"fraction .* must lie in"),
        (STUDIO, "joints: []", "joints must be a mapping"),
        (STUDIO, "- 3", "must hold a mapping"),
        (STUDIO, "a: [", "not valid YAML"),
        ("name: studio", "name: 3", "name must be"),
        ("name: studio", "cmu_units: 3", "cmu_units must be"),
        ("name: studio", "lost_bones: {a: b}", "the lost bone of 'a' must be"),
        ("name: studio", "lost_bones: 3", "lost_bones must be a mapping"),
    ],
)
def test_wrong_flavour_files_are_one_sentence(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    (tmp_path / "my.yaml").write_text(STUDIO.replace(old, new))
    with pytest.raises(InputError, match=sentence) as caught:
        load_motion(WALK, flavour=str(tmp_path / "my.yaml"))
    assert "my.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_flavours_that_are_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot read flavour file .*none\.yaml: No such file"):
        load_motion(WALK, flavour=str(tmp_path / "none.yaml"))
    with pytest.raises(InputError, match=r"'smpl' is unknown; choose one of .*give a flavour file \(\.yaml\)"):
        load_motion(WALK, flavour="smpl")


# --- units ----------------------------------------------------------------------------------------------------------


def child(share: float, stature_m: float) -> Skeleton:
    """The walker with shorter legs: thigh and shank are that share of legs, trunk and neck."""
    grown_up = person("walk")
    factor = share / (1.0 - share) * (1.0 - 0.571) / 0.571  # 0.571 is the walker's own
    positions = grown_up.positions.copy()
    for joint, name in enumerate(grown_up.names):  # parents come first
        if name.rpartition("_")[2] in ("knee", "ankle", "foot"):
            bone = grown_up.positions[:, joint] - grown_up.positions[:, grown_up.parents[joint]]
            positions[:, joint] = positions[:, grown_up.parents[joint]] + factor * bone
    return replace(grown_up, positions=positions).scaled(stature_m / (1.85 * (0.571 * factor + 0.429)))


@pytest.mark.parametrize(
    ("share", "size", "unit", "stature"),
    [(0.51, 0.97 / 0.0254, "0.0254", "0.97"), (0.47, 80.0, "0.01", "0.80"), (0.571, 80.0, "0.0254", "2.03")],
    ids=["no giant in CMU's units", "a child of two years in centimetres", "a tall man in inches"],
)
def test_proportions_choose_the_unit(tmp_path: Path, share: float, size: float, unit: str, stature: str) -> None:
    motion = load_motion(child(share, size).write(tmp_path / "a.bvh"))
    assert f"1 unit = {unit} m (stature {stature} m)" in motion.report


def test_two_plausible_units_are_said(tmp_path: Path) -> None:
    path = child(0.515, 78.0).write(tmp_path / "a.bvh")
    with pytest.warns(T2DWarning, match=r"may be (cm|inch) \(stature .* m\) or (cm|inch) \(.* m\).*--motion.units"):
        load_motion(path)
    assert "(stature 0.78 m)" in load_motion(path, units="cm").report


@pytest.mark.parametrize(
    ("stature", "sentence"),
    [
        (2.3, "2.30 m tall if the file's unit is m"),
        (0.7 / 0.0254, "an adult's proportions"),
        (15.0, "an unusual 0.1 m"),
    ],
)
def test_odd_statures_are_said(tmp_path: Path, stature: float, sentence: str) -> None:
    with pytest.warns(T2DWarning, match=sentence):
        person("walk").scaled(stature / 1.85).read(tmp_path)


# --- flips and axes -------------------------------------------------------------------------------------------------


def with_a_wrist_turned(*turns: tuple[slice, float]) -> Skeleton:
    """The walker, whose right wrist is turned about its x axis by so many degrees in some frames."""
    skeleton = person("walk")
    rotations = np.array(skeleton.rotations)
    wrist = skeleton.names.index("right_wrist")
    for frames, angle in turns:
        own = Rotation.from_quat(rotations[frames, wrist]) * Rotation.from_euler("X", angle, degrees=True)
        rotations[frames, wrist] = own.as_quat()
    return replace(skeleton, rotations=rotations)


def test_single_frame_flips_are_told(tmp_path: Path) -> None:
    skeleton = with_a_wrist_turned((slice(20, 21), 173.0), (slice(30, 31), 60.0))
    with pytest.warns(T2DWarning, match="right_wrist turns by 17. degrees for one frame at 1.667 s") as caught:
        motion = skeleton.read(tmp_path)
    assert sum("frames a second" not in str(each.message) for each in caught) == 1
    assert "single-frame flips: right_wrist" in motion.report
    assert "60 degrees" not in motion.report


@pytest.mark.parametrize(
    "turns", [[(slice(20, None), 120.0)], [(slice(20, 21), 100.0), (slice(21, None), 200.0)]], ids=["stays", "goes on"]
)
def test_turns_that_do_not_come_back_are_no_flips(tmp_path: Path, turns: list[tuple[slice, float]]) -> None:
    as_it_is = with_a_wrist_turned(*turns).read(tmp_path)
    for motion in (as_it_is, load_motion(tmp_path / "a.bvh")):
        assert "flips" not in motion.report


@pytest.mark.parametrize("stage", [False, True])
def test_who_stands_still_on_a_turned_stage_is_upright(tmp_path: Path, stage: bool) -> None:
    """z is up by a root that never turns, which is believed, or by the hips' own rotation: then somebody may lie."""
    still = person("walk")
    still = replace(still, positions=still.positions[[0] * 9], rotations=still.rotations[[0] * 9])
    if stage:
        assert "up z;" in still.below(("stage",)).turned(Z_UP).read(tmp_path).report
    else:
        with pytest.warns(T2DWarning, match="upright along z throughout, but along y in its rest pose"):
            still.turned(Z_UP).read(tmp_path)


def lying(share: float) -> Skeleton:
    """Somebody who stands, then falls on the back and lies for a share of the time; y up."""
    skeleton = person("walk")
    frames = 50
    angles = np.clip((np.arange(frames) - (1.0 - share) * frames) / 4.0, 0.0, 1.0) * -90.0
    place = skeleton.positions[:1, :1] * [1.0, 0.0, 1.0]
    falls = Rotation.from_euler("X", angles[:, None], degrees=True)
    pose, own = skeleton.positions[0] - place[0], Rotation.from_quat(skeleton.rotations[0])
    positions = np.stack([turn.apply(pose) for turn in falls])
    positions[..., 1] += np.maximum(0.0, 0.1 - positions[..., 1].min(axis=1, keepdims=True))
    return replace(skeleton, positions=positions, rotations=np.stack([(turn * own).as_quat() for turn in falls]))


@pytest.mark.parametrize("share", [0.3, 0.7, 0.9])
def test_a_fall_after_which_somebody_lies_is_upright(tmp_path: Path, share: float) -> None:
    motion = lying(share).read(tmp_path)
    assert "up y;" in motion.report
    assert motion.joints[0, CANONICAL_JOINTS.index("head"), 2] > 1.3
    assert motion.joints[-1, CANONICAL_JOINTS.index("head"), 2] < 0.5
