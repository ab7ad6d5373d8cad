"""Reading motions: every flavour, units, axes, floor, T-pose; bad input in one sentence."""

from __future__ import annotations

import gzip
import random
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from builders import MOTIONS, WALK
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion import flavours, load_motion, motion_from_joints, register_flavour, skeletons
from t2d_rt.motion.interpolate import decompose
from t2d_rt.motion.kinematics import facing
from t2d_rt.motion.read.bvh import forward_kinematics, read_bvh
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion

MOMASK = MOTIONS / "momask_22j_120frames.bvh"
ALL = {
    "cmu-a": WALK, "cmu-b": MOTIONS / "131_01_walk_300frames.bvh", "bvh-toolbox": MOTIONS / "bvhtoolbox_walk01.bvh",
    "momask": MOMASK, "iclone": MOTIONS / "iclone_002_03_run_jog.bvh.gz",
}  # fmt: skip
CHAIN = """HIERARCHY
ROOT big hip
{
  OFFSET 1 2 3
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT left knee
  {
    OFFSET 0 -1 0
    CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 -2 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.01
0.5 0 0 0 0 0 0 -1 0 90 0 0
0.5 0 0 90 0 0 0 -1 0 0 90 0
"""


def points(motion: Motion) -> dict[str, np.ndarray]:
    return {name: motion.joints[:, i] for i, name in enumerate(motion.names)}


def bone(motion: Motion, name: str) -> float:
    joint = motion.index(name)
    return float(np.median(np.linalg.norm(motion.joints[:, joint] - motion.joints[:, motion.parents[joint]], axis=-1)))


@pytest.fixture(scope="module")
def momask_text() -> str:
    return MOMASK.read_text()


def write(folder: Path, text: str | bytes, name: str = "a.bvh") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


# --- kinematics -----------------------------------------------------------------------------------------------------


def test_chain_in_closed_form(tmp_path: Path) -> None:
    raw = read_bvh(write(tmp_path, CHAIN))
    assert raw.names == ("big hip", "left knee", "left knee:end")
    assert raw.rate_hz == 100.0
    positions, _ = forward_kinematics(raw)
    # Root offset (1, 2, 3) + position (0.5, 0, 0); the knee's own positions repeat its offset and replace it.
    np.testing.assert_allclose(
        positions[0], [[1.5, 2, 3], [1.5, 1, 3], [3.5, 1, 3]], atol=1e-12
    )  # knee z +90: down -> +x
    # Frame 1: root z +90 turns down into +x; the knee's x +90 then turns its bone to file -z.
    np.testing.assert_allclose(positions[1], [[1.5, 2, 3], [2.5, 2, 3], [2.5, 2, 1]], atol=1e-12)


def test_joint_positions_that_are_shifts_add_to_the_offset(tmp_path: Path) -> None:
    raw = read_bvh(
        write(tmp_path, CHAIN.replace(" 0 -1 0 90 0 0", " 0 0.1 0 90 0 0").replace(" 0 -1 0 0 90 0", " 0 0 0 0 90 0"))
    )
    assert forward_kinematics(raw)[0][0, 1] == pytest.approx([1.5, 1.1, 3])


@pytest.mark.parametrize("sample", [WALK, ALL["bvh-toolbox"]])
def test_kinematics_agree_with_pybvh(sample: Path) -> None:
    import pybvh

    raw = read_bvh(sample)
    ours = forward_kinematics(raw)[0]  # these two roots have no offset, or one that the positions repeat
    theirs = pybvh.read_bvh_file(str(sample)).node_positions()
    np.testing.assert_allclose(ours, theirs, atol=1e-6 * np.abs(ours).max())


def least_cpu_s(action: Callable[[], object]) -> float:
    """Of five runs: other processes cost a run time of its own, too, as they take the caches."""
    taken = []
    for _ in range(5):
        start = time.process_time()
        action()
        taken.append(time.process_time() - start)
    return min(taken)


def test_reading_is_fast() -> None:
    """It takes 12 to 15 times as long as turning the file's words into numbers; two products of quaternions per frame of a loop in
    Python would add 5.5 times."""
    words = WALK.read_text().partition("Frame Time:")[2].split()
    numbers = least_cpu_s(lambda: [float(word) for word in words])
    assert least_cpu_s(lambda: load_motion(WALK, smooth_hz=None)) < 18 * numbers


# --- what a file means ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("flavour", ALL)
def test_every_flavour_is_a_plausible_person(flavour: str) -> None:
    motion = load_motion(ALL[flavour])
    assert f"flavour {flavour};" in motion.report
    assert motion.names[:22] == CANONICAL_JOINTS
    at = points(motion)
    ahead = facing(at)
    for pair in ("hip", "shoulder", "collar"):
        across = at[f"left_{pair}"] - at[f"right_{pair}"]
        aside = (across * np.cross([0.0, 0.0, 1.0], ahead)).sum(axis=-1) / np.linalg.norm(across, axis=-1)
        assert np.median(aside) > 0.8, pair  # left is left
    for side in ("left", "right"):
        assert np.median(((at[f"{side}_foot"] - at[f"{side}_ankle"]) * ahead).sum(axis=-1)) > 0.06  # toes ahead
        # Drillis and Contini: thigh, shank 0.245 H, upper arm 0.19 H, forearm 0.15 H, for H of 1.5 ... 1.95 m.
        for name, low, high in (
            ("knee", 0.3, 0.52), ("ankle", 0.33, 0.52), ("foot", 0.08, 0.18), ("elbow", 0.22, 0.36),
            ("wrist", 0.21, 0.31),
        ):  # fmt: skip
            assert low < bone(motion, f"{side}_{name}") < high, (side, name)
    for name in motion.names[1:]:
        assert bone(motion, name) > 0.03, name
        if name.startswith("left_"):
            assert bone(motion, name) == pytest.approx(bone(motion, name.replace("left", "right")), rel=0.25), name
    heights = [
        float(np.median(at[name][:, 2])) for name in ("left_ankle", "left_knee", "pelvis", "spine3", "neck", "head")
    ]
    assert heights == sorted(heights)
    assert 1.2 < heights[-1] < 1.8
    assert abs(np.min([at[f"{s}_{j}"][:, 2] for s in ("left", "right") for j in ("foot", "ankle")])) < 0.05


@pytest.mark.parametrize("flavour", ["cmu-a", "iclone", "bvh-toolbox"])
def test_walkers_go_where_they_face(flavour: str) -> None:
    motion = load_motion(ALL[flavour])
    velocity = np.gradient(motion.joints[:, 0], 1.0 / motion.rate_hz, axis=0)
    speed = np.linalg.norm(velocity[:, :2].mean(axis=0))
    assert (velocity * facing(points(motion))).sum(axis=-1).mean() == pytest.approx(speed, rel=0.05)


@pytest.mark.parametrize("flavour", ALL)
def test_rotations_carry_their_bones(flavour: str) -> None:
    motion = load_motion(ALL[flavour], smooth_hz=None)
    offsets, _ = decompose(motion.joints, motion.rotations, motion.parents)
    limbs = [motion.index(f"{s}_{j}") for s in ("left", "right") for j in ("knee", "ankle", "foot", "elbow", "wrist")]
    assert offsets[:, limbs].std(axis=0).max() < 1e-4


def test_lost_bones_of_the_cmu_conversion_are_restored() -> None:
    motion = load_motion(WALK)
    assert "lost bones restored at Neck, LeftShoulder" in motion.report
    raw = read_bvh(WALK)
    radius = np.linalg.norm(raw.offsets[raw.names.index("LeftHand")]) * 0.0254 / 0.45
    assert bone(motion, "left_wrist") == pytest.approx(1.5 * radius, rel=1e-6)
    assert bone(motion, "spine3") == pytest.approx(bone(motion, "spine2"), rel=1e-6)


def test_report_of_the_cmu_walk() -> None:
    motion = load_motion(WALK)
    assert len(motion.joints) == 523
    assert motion.rate_hz == 120.0
    for fact in (
        "1 unit = 0.05644 m",
        "up y",
        "first 1 frame(s) dropped (T-pose)",
        "floor at",
        "smoothed at 12 Hz (jitter 0.05",
    ):
        assert fact in motion.report
    assert "\n" not in motion.report
    velocity = (motion.joints[-1, 0] - motion.joints[0, 0]) / motion.duration_s
    assert np.linalg.norm(velocity[:2]) == pytest.approx(0.88, abs=0.03)


def test_everything_can_be_overridden() -> None:
    kept = load_motion(WALK, drop_tpose=False, smooth_hz=6.0, units="cmu", up="y", floor=0.1, flavour="cmu-a")
    assert len(kept.joints) == 524
    assert "smoothed at 6 Hz" in kept.report
    assert "floor at 0.100" in kept.report
    plain = load_motion(WALK, smooth_hz=None)
    larger = load_motion(WALK, units=1.5 * 0.0254 / 0.45, smooth_hz=None)
    np.testing.assert_allclose(larger.joints, 1.5 * plain.joints, atol=1e-9)
    assert len(load_motion(MOMASK, drop_tpose=True).joints) == 119


@pytest.mark.parametrize(("up", "order"), [("x", (1, 2, 0)), ("z", (0, 1, 2)), ("-z", None)])
def test_any_up_axis_is_found(tmp_path: Path, momask_text: str, up: str, order: tuple[int, ...] | None) -> None:
    """The file turned as a whole (by an extra root) gives the same person, up to the heading."""
    angles = {"x": "0 0 -90", "z": "90 0 0", "-z": "-90 0 0"}[up]  # Xrotation Yrotation Zrotation take y to the new up
    head, motion = momask_text.split("MOTION\n")
    stage = "ROOT Stage\n{\nOFFSET 0 0 0\nCHANNELS 3 Xrotation Yrotation Zrotation\nJOINT Hips"
    head = head.replace("ROOT Hips", stage, 1) + "}\n"
    lines = motion.splitlines()
    rotated = "\n".join([*lines[:2], *(f"{angles} {line}" for line in lines[2:])])
    found = load_motion(write(tmp_path, f"{head}MOTION\n{rotated}\n"))
    assert f"up {up};" in found.report
    expected = load_motion(MOMASK)
    np.testing.assert_allclose(found.joints[..., 2], expected.joints[..., 2], atol=1e-5)
    mine, theirs = (decompose(m.joints, m.rotations, m.parents)[0][:, 1:] for m in (found, expected))
    np.testing.assert_allclose(mine, theirs, atol=1e-5)


@pytest.mark.parametrize(("unit", "metres"), [("cm", 0.01), ("inch", 0.0254), ("mm", 0.001), ("ft", 0.3048)])
def test_units_follow_from_the_size_of_the_body(tmp_path: Path, unit: str, metres: float) -> None:
    lines = MOMASK.read_text().splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("Frame Time")) + 1
    for i, line in enumerate(lines):
        words = line.split()
        if words[:1] == ["OFFSET"]:
            lines[i] = "OFFSET " + " ".join(f"{float(word) / metres:.6f}" for word in words[1:])
        elif i >= start:
            lines[i] = " ".join([f"{float(word) / metres:.6f}" for word in words[:3]] + words[3:])
    motion = load_motion(write(tmp_path, "\n".join(lines)))
    np.testing.assert_allclose(motion.joints, load_motion(MOMASK).joints, atol=1e-4)
    assert f"1 unit = {metres:.4g} m" in motion.report


@pytest.mark.parametrize("prefix", ["mixamorig:", "mixamorig1_", ""])
def test_mixamo_names_with_and_without_prefix(tmp_path: Path, momask_text: str, prefix: str) -> None:
    text = momask_text.replace("Toe\n", "ToeBase\n").replace("Toe \n", "ToeBase\n")
    for kind in ("ROOT ", "JOINT "):
        text = text.replace(kind, kind + prefix)
    motion = load_motion(write(tmp_path, text))
    assert "flavour mixamo;" in motion.report
    np.testing.assert_allclose(motion.joints, load_motion(MOMASK).joints)


def test_a_user_can_add_a_flavour_with_gaps(tmp_path: Path, momask_text: str) -> None:
    """No feet, no collars, one spine joint: the rest is put in along the chain."""
    text = momask_text
    table = {"Hips": "hub", "Spine1": "chest", "Spine2": "upper", "Neck": "throat"}
    for name, other in table.items():
        text = text.replace(f"JOINT {name}\n", f"JOINT {other}\n").replace(f"ROOT {name}\n", f"ROOT {other}\n")
    assert "joints matched by names and form (sure;" in load_motion(write(tmp_path, text)).report
    limbs = {
        f"{side.lower()}_{joint}": side + own
        for side in ("Left", "Right")
        for joint, own in (
            ("hip", "UpLeg"), ("knee", "Leg"), ("ankle", "Foot"), ("shoulder", "Arm"), ("elbow", "ForeArm"),
            ("wrist", "Hand"),
        )
    }  # fmt: skip
    try:
        register_flavour("mine", {"pelvis": "hub", "spine3": "upper", "head": "Head"} | limbs)
        motion = load_motion(write(tmp_path, text))
    finally:
        skeletons._registry().pop("mine", None)
    assert "flavour mine;" in motion.report
    assert "mine" not in flavours()
    at = points(motion)
    np.testing.assert_allclose(at["spine1"], at["pelvis"] + (at["spine3"] - at["pelvis"]) / 3, atol=1e-9)
    np.testing.assert_allclose(at["neck"], 0.5 * (at["spine3"] + at["head"]), atol=1e-9)
    np.testing.assert_allclose(at["left_collar"], 0.5 * (at["spine3"] + at["left_shoulder"]), atol=1e-9)
    true = points(load_motion(MOMASK))
    for side in ("left", "right"):  # the made-up ball of the foot lies near the true one
        gap = (at[f"{side}_foot"] - at[f"{side}_ankle"]) - (true[f"{side}_foot"] - true[f"{side}_ankle"])
        assert np.linalg.norm(np.median(gap, axis=0)) < 0.08


def test_the_flavour_that_covers_most_joints_wins() -> None:
    full = flavours()["momask"].joints
    try:
        register_flavour("sparse", {name: source for name, source in full.items() if "collar" not in name})
        assert "flavour momask;" in load_motion(MOMASK).report
        assert "flavour sparse;" in load_motion(MOMASK, flavour="sparse").report
    finally:
        skeletons._registry().pop("sparse", None)


def test_flavour_tables_are_checked() -> None:
    with pytest.raises(InputError, match="unknown canonical joints \\['tail'\\]"):
        register_flavour("x", {"tail": "Tail"})
    with pytest.raises(InputError, match=r"must also map .*'left_hip'"):
        register_flavour("x", {"pelvis": "Hips"})


def test_left_shoulder_as_upper_arm_is_told_from_the_collar() -> None:
    arm = load_motion(ALL["cmu-b"])
    assert bone(arm, "left_elbow") == pytest.approx(4.25106 * 0.0254 / 0.45, rel=1e-3)


def test_gzip_and_suffix_case(tmp_path: Path, momask_text: str) -> None:
    same = load_motion(write(tmp_path, gzip.compress(momask_text.encode()), "A.BVH.GZ"))
    np.testing.assert_array_equal(
        same.joints, load_motion(write(tmp_path, momask_text.replace("\n", "\r\n"), "b.Bvh")).joints
    )


# --- positions alone ------------------------------------------------------------------------------------------------


def test_motion_from_joints_finds_rigid_bones() -> None:
    motion = load_motion(WALK)
    found = motion_from_joints(motion.joints[:, ::-1], rate_hz=120.0, names=motion.names[::-1])
    np.testing.assert_array_equal(found.joints, motion.joints)
    offsets, _ = decompose(found.joints, found.rotations, found.parents)
    limbs = [motion.index(name) for name in ("left_knee", "left_ankle", "right_elbow", "right_wrist", "head")]
    assert offsets[:, limbs].std(axis=0).max() < 1e-6


def test_motion_from_joints_refuses() -> None:
    with pytest.raises(InputError, match=r"shape \(time >= 2, 22, 3\), got .*; give one place for each of the names"):
        motion_from_joints(np.zeros((5, 21, 3)), rate_hz=20.0)
    with pytest.raises(InputError, match="missing \\['right_wrist'\\]"):
        motion_from_joints(np.zeros((5, 21, 3)), rate_hz=20.0, names=CANONICAL_JOINTS[:21])
    with pytest.raises(InputError, match="coincide"):
        motion_from_joints(np.zeros((5, 22, 3)), rate_hz=20.0)
    with pytest.raises(InputError, match=r"finite, got .*; repair the tracks first"):
        motion_from_joints(np.full((5, 22, 3), np.nan), rate_hz=20.0)


# --- bad input ------------------------------------------------------------------------------------------------------

BAD = {
    "empty": ("", "is empty"),
    "blank": (" \n", "is empty"),
    "not bvh": ("hello\n", "must be text that starts with HIERARCHY"),
    "binary": (b"\x00\xff\xfe" * 50, "must be text that starts with HIERARCHY"),
    "no motion": (CHAIN.split("MOTION")[0], "no MOTION section"),
    "cut in the hierarchy": ("HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nMOTION\n", "cut short"),
    "no header": (CHAIN.replace("Frames: 2\n", ""), "must begin with 'Frames:'"),
    "one row short": (CHAIN.rsplit("\n", 2)[0] + "\n", "'Frames: 2' but 1 rows"),
    "too many rows": (CHAIN + "1 2 3\n", "expected 2 frames of 12 channels = 24 values, got 27"),
    "cut in a row": (CHAIN[:-6], "got 22"),
    "frame count": (CHAIN.replace("Frames: 2", "Frames: two"), "Frames must hold numbers"),
    "no frames": (CHAIN.replace("Frames: 2", "Frames: 0"), "at least 2 frames"),
    "one frame": (CHAIN.replace("Frames: 2", "Frames: 1"), "at least 2 frames"),
    "frame time": (CHAIN.replace("0.01", "0"), "Frame Time must lie between"),
    "nan": (CHAIN.rsplit("\n", 3)[0] + "\n" + "nan " * 24, "NaN, infinite or absurd values in every frame"),
    "inf": (CHAIN.rsplit("\n", 3)[0] + "\n" + "-inf " * 24, "NaN, infinite or absurd values in every frame"),
    "word": (CHAIN.replace("0.5 0 0 90", "1,5 0 0 90"), "numbers only"),
    "offset": (CHAIN.replace("OFFSET 1 2 3", "OFFSET 1 2"), "must be 3 numbers"),
    "no offset": (CHAIN.replace("    OFFSET 0 -1 0\n", ""), "has no OFFSET"),
    "channels": (CHAIN.replace("CHANNELS 6", "CHANNELS 5", 1), "must be a count and that many"),
    "channel kind": (CHAIN.replace("Yrotation", "Wrotation", 1), "must be a count and that many"),
    "twice": (CHAIN.replace("left knee", "big hip"), "occurs twice"),
    "two roots": (CHAIN.replace("JOINT left", "ROOT left"), "expected a ROOT that holds every joint"),
    "outside": (CHAIN.replace("MOTION", "JOINT x\n{\nOFFSET 0 0 0\n}\nMOTION"), "out of place"),
    "garbage": (CHAIN.replace("OFFSET 1 2 3", "SCALE 1 2 3"), "cannot understand 'SCALE 1 2 3'"),
    "nobody": (CHAIN, "no two limbs of like bones where a person has two arms and two legs"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_files(tmp_path: Path, case: str) -> None:
    text, match = BAD[case]
    with pytest.raises(InputError, match=match) as caught:
        load_motion(write(tmp_path, text))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600


def test_bad_paths(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        load_motion(tmp_path / "none.bvh")
    (tmp_path / "d.bvh").mkdir()
    with pytest.raises(InputError, match="is a directory"):
        load_motion(tmp_path / "d.bvh")
    with pytest.raises(InputError, match=r"come as \.bvh or \.bvh\.gz"):
        load_motion(write(tmp_path, CHAIN, "a.fbx"))
    with pytest.raises(InputError, match="not a valid file name"):
        load_motion("a\0.bvh")
    with pytest.raises(InputError, match="not a valid gzip"):
        load_motion(write(tmp_path, CHAIN, "a.bvh.gz"))
    with pytest.raises(InputError, match="cut short"):
        load_motion(write(tmp_path, gzip.compress(CHAIN.encode())[:-20], "a.bvh.gz"))


def test_bad_options(tmp_path: Path, momask_text: str) -> None:
    for options, match in (
        ({"units": "cubit"}, "units 'cubit' are unknown"),
        ({"units": 300.0}, "body would be .* m tall"),
        ({"units": float("nan")}, "units must be finite, got nan"),
        ({"up": "w"}, "up must be .*, got 'w'; or give a vector"),
        ({"flavour": "smpl"}, "flavour 'smpl' is unknown"),
        ({"flavour": "cmu-a"}, "lacks"),
        ({"smooth_hz": 40.0}, "cut-off must lie between"),
        ({"floor": float("nan")}, "floor must lie in .*, got nan"),
    ):
        with pytest.raises(InputError, match=match):
            load_motion(MOMASK, **options)  # type: ignore[arg-type]
    giant = "\n".join(
        "OFFSET " + " ".join(str(200 * float(w)) for w in line.split()[1:])
        if line.strip().startswith("OFFSET")
        else line
        for line in momask_text.splitlines()
    )
    with pytest.raises(InputError, match="no usual unit makes a person"):
        load_motion(write(tmp_path, giant))


def test_a_skeleton_that_hangs_differently_is_matched_by_form(tmp_path: Path, momask_text: str) -> None:
    """Two names of the arm are swapped: where the joints lie decides."""
    swapped = (
        momask_text.replace("LeftArm", "X").replace("LeftForeArm", "LeftArm").replace("JOINT X", "JOINT LeftForeArm")
    )
    path = write(tmp_path, swapped)
    motion = load_motion(path)
    assert "left_shoulder LeftForeArm" in motion.report
    np.testing.assert_allclose(motion.joints, load_motion(MOMASK).joints)
    with pytest.raises(InputError, match="hangs together differently"):
        load_motion(path, flavour="momask")


fuzz = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def check_read_or_refused(folder: Path, data: bytes, name: str = "fuzz.bvh") -> None:
    """What is read is finite and whole; what is not ends in one line that names the file."""
    try:
        motion = load_motion(write(folder, data, name))
    except InputError as error:
        sentence = str(error)
        assert name in sentence
        assert sentence.isprintable()
        return
    assert np.isfinite(motion.joints).all()
    assert motion.joints.shape[1:] == (len(motion.names), 3)


@fuzz
@given(data=st.binary(max_size=300))
def test_fuzz_random_bytes(tmp_path: Path, data: bytes) -> None:
    check_read_or_refused(tmp_path, data)
    check_read_or_refused(tmp_path, b"HIERARCHY\n" + data)
    check_read_or_refused(tmp_path, b"\x1f\x8b\x08" + data, "fuzz.bvh.gz")


WORDS = [
    "ROOT", "JOINT a", "End Site", "{", "}", "OFFSET 0 1 0", "CHANNELS 1 Xrotation", "MOTION", "Frames: 2",
    "Frame Time: 0.1", "1", "nan",
]  # fmt: skip


@fuzz
@given(lines=st.lists(st.sampled_from(WORDS), max_size=25))
def test_fuzz_grammar(tmp_path: Path, lines: list[str]) -> None:
    check_read_or_refused(tmp_path, "\n".join(["HIERARCHY", "ROOT a", "{", *lines]).encode())


ODD = ["", "0", "-1e8", "1e300", "nan", "1e-300", "}", "{", "Hips", "-", "\x85", "9" * 400]


@pytest.mark.parametrize("seed", range(5))
def test_fuzz_mutated_file(tmp_path: Path, momask_text: str, seed: int) -> None:
    """One to three words of a file are others."""
    drawn = random.Random(seed)
    head = momask_text.splitlines()
    head = head[: next(i for i, line in enumerate(head) if "Frame Time" in line) + 13]
    head = [line.replace("120", "12") if line.startswith("Frames") else line for line in head]
    for _ in range(30):
        lines = list(head)
        for _ in range(drawn.randint(1, 3)):
            row = drawn.randrange(len(lines))
            words = lines[row].split() or [""]
            words[drawn.randrange(len(words))] = drawn.choice(ODD)
            lines[row] = " ".join(words)
        check_read_or_refused(tmp_path, "\n".join(lines).encode())


def test_a_file_too_short_for_a_movement_is_told(tmp_path: Path) -> None:
    walk = load_motion(MOTIONS / "12_01_walk.bvh")
    for frames in (2, 12):
        path = tmp_path / f"{frames}.npz"
        np.savez(path, joints=walk.joints[:frames], names=np.array(walk.names), fps=120.0)
        with pytest.warns(
            T2DWarning, match=rf"{frames}.npz lasts 0.0\d+ s \({frames} frames at 120 Hz\), a step takes 0.5 s"
        ):
            load_motion(path)
    np.savez(tmp_path / "13.npz", joints=walk.joints[:13], names=np.array(walk.names), fps=120.0)
    assert load_motion(tmp_path / "13.npz").duration_s == 0.1
