"""Several persons in one file: one of them is read, chosen by name, and nothing of another one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from builders import JOINT_CENTRES, MOTIONS, WALK, joint_centres, slow_after, write_c3d
from t2d_rt.cli import _command
from t2d_rt.cli.experiments import target_of
from t2d_rt.core.checks import numbered
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.experiment.sources import MotionFile, target_from
from t2d_rt.motion import load_motion
from t2d_rt.motion.read.bvh import read_bvh
from t2d_rt.motion.read.joint_sets import absent_joints
from t2d_rt.motion.read.markers import MODELLED
from t2d_rt.motion.read.skeletal import bodies
from t2d_rt.motion.read.subjects import subjects
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion
from validation.motions import independent

RATE_HZ = 30.0
AWAY_M = np.array([2.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def walk() -> Motion:
    return t2d.trim(t2d.resample(load_motion(WALK), RATE_HZ), 0.5, 2.0)


def two(walk: Motion, first: str = "A:{}", second: str = "B:{}") -> dict[str, np.ndarray]:
    """A walks, B stands still in its pose of the beginning, elsewhere."""
    points = joint_centres(walk)
    still = {name: np.tile(track[:1] + AWAY_M, (len(track), 1)) for name, track in points.items()}
    a, b = (
        {how.format(name): track for name, track in each.items()} for how, each in ((first, points), (second, still))
    )
    return a | b


def write(path: Path, tracks: dict[str, np.ndarray]) -> Path:
    """In metres, z up, as the suffix says."""
    if path.suffix == ".npz":
        np.savez(path, joints=np.stack(list(tracks.values()), axis=1), names=np.array(list(tracks)), fps=RATE_HZ)
    elif path.suffix == ".trc":
        y_up = {name: track @ independent.Y_UP.T for name, track in tracks.items()}
        path.write_text(independent.trc(y_up, RATE_HZ, "m"), encoding="utf-8")
    else:
        write_c3d(path, tracks, RATE_HZ)
    return path


def travel_m(motion: Motion) -> float:
    return float(np.linalg.norm((motion.joints[-1] - motion.joints[0])[0, :2]))


def check(path: Path, walk: Motion, first: str = "A", second: str = "B") -> None:
    """The first by default, with a warning; each by its name, without one."""
    with pytest.warns(
        T2DWarning, match=f"holds 2 subjects, {first}, {second}: {first} is taken; give subject='{second}'"
    ):
        motion = load_motion(path, smooth_hz=None)
    assert f"subject {first} of {first}, {second}" in motion.report
    for found, expected in (
        (motion, travel_m(walk)),
        (load_motion(path, smooth_hz=None, subject=first), travel_m(walk)),
        (load_motion(path, smooth_hz=None, subject=second), 0.0),
    ):
        assert travel_m(found) == pytest.approx(expected, abs=0.02)
    with pytest.raises(InputError, match=f"subject 'Eve' is not in the file; its subjects are {first}, {second}"):
        load_motion(path, subject="Eve")


MANNERS = {
    "colon": ("A:{}", "B:{}", "A", "B"),
    "umlauts": ("Jörg:{}", "Änne:{}", "Jörg", "Änne"),
    "underscore": ("Subject_01_{}", "Subject_02_{}", "Subject_01", "Subject_02"),
    "dot": ("A.{}", "B.{}", "A", "B"),
    "behind": ("{}_1", "{}_2", "1", "2"),
    "number behind": ("{}1", "{}2", "1", "2"),
    "number before": ("P1{}", "P2{}", "P1", "P2"),
    "one without": ("{}", "Ben:{}", "unnamed", "Ben"),
    "nested": ("scene:A:{}", "scene:B:{}", "scene:A", "scene:B"),
}


@pytest.mark.parametrize(
    ("form", "manner"),
    slow_after(
        4, [*((form, manner) for form in ("trc", "npz") for manner in MANNERS), ("c3d", "colon"), ("c3d", "behind")]
    ),
)
def test_one_subject_is_read_however_it_is_named(tmp_path: Path, walk: Motion, form: str, manner: str) -> None:
    *labels, first, second = MANNERS[manner]
    check(write(tmp_path / f"a.{form}", two(walk, *labels)), walk, first, second)


def test_two_subjects_whose_names_begin_alike_stay_two(tmp_path: Path, walk: Motion) -> None:
    stem = 70 * "A"
    path = write(tmp_path / "two.npz", two(walk, stem + "1:{}", stem + "2:{}"))
    check(path, walk, stem[:60], f"{stem[:60]} 2")


def test_what_one_lacks_is_not_taken_from_the_other(tmp_path: Path, walk: Motion) -> None:
    tracks = two(walk)
    del tracks["A:Head"]
    with pytest.warns(T2DWarning, match="A is taken"):
        motion = load_motion(write(tmp_path / "a.trc", tracks), smooth_hz=None)
    assert "filled pelvis, head" in motion.report
    # The head follows A's trunk, and is not B's, 2 m away.
    apart = motion.joints[:, motion.index("head")] - motion.joints[:, motion.index("neck")]
    assert np.linalg.norm(apart, axis=-1).max() < 0.2
    del tracks["A:LElbow"]
    with pytest.warns(T2DWarning, match=r"B is taken \(A: markers .* lack left_elbow\)"):
        motion = load_motion(write(tmp_path / "b.trc", tracks), smooth_hz=None)
    assert travel_m(motion) < 0.01
    with pytest.raises(InputError, match=r"A: markers .* lack left_elbow.*; the file's subjects are A, B"):
        load_motion(tmp_path / "b.trc", subject="A")
    del tracks["B:RKnee"]
    with pytest.raises(InputError, match=r"A: markers .* lack left_elbow.*; the file's subjects are A, B"):
        load_motion(write(tmp_path / "c.trc", tracks))


def test_a_chair_is_no_subject_and_one_person_needs_no_choice(tmp_path: Path, walk: Motion) -> None:
    chair = {f"Chair:{number}": np.zeros((len(walk.joints), 3)) + number for number in range(1, 16)}
    person = {f"Anna:{name}": track for name, track in joint_centres(walk).items()}
    for form in ("trc", "npz"):
        path = write(tmp_path / f"a.{form}", chair | person)
        assert travel_m(load_motion(path, smooth_hz=None)) == pytest.approx(travel_m(walk), abs=0.02)
        assert "subject" not in load_motion(path, subject="anna").report
        with pytest.raises(InputError, match="subject 'Chair' is not in the file; its subjects are Anna"):
            load_motion(path, subject="Chair")
    with pytest.raises(
        InputError, match="subject 'A' is not in the file; it holds one, without a name; leave subject out"
    ):
        load_motion(write(tmp_path / "b.trc", joint_centres(walk)), subject="A")
    with pytest.raises(InputError, match="subject 'A' is not in the file; it holds one"):
        load_motion(WALK, subject="A")


def test_prefixes_of_one_persons_parts_are_told(tmp_path: Path, walk: Motion) -> None:
    tracks = {
        ("Leg:" if any(part in name for part in ("Hip", "Knee", "Ankle", "Toe")) else "Trunk:") + name: track
        for name, track in joint_centres(walk).items()
    }
    motion = load_motion(write(tmp_path / "a.trc", tracks), smooth_hz=None)
    assert "labels with ['Trunk', 'Leg'] before the colon taken as one person's" in motion.report


def test_parts_of_two_persons_are_no_person(tmp_path: Path, walk: Motion) -> None:
    legs = [name for name in joint_centres(walk) if any(part in name for part in ("Hip", "Knee", "Ankle", "Toe"))]
    tracks = {name: track for name, track in two(walk).items() if (name[2:] in legs) == name.startswith("A")}
    with pytest.raises(InputError, match=r"hips and shoulders lie \d.\d lengths of a leg apart, as of several persons"):
        load_motion(write(tmp_path / "a.trc", tracks))


def test_the_command_line_takes_a_subject(tmp_path: Path, walk: Motion) -> None:
    path = write(tmp_path / "a.npz", two(walk))
    person = target_of(f"person:{path},subject=B,distance_m=3")
    assert isinstance(person, MotionFile)
    assert travel_m(person.placed(person.read(), t2d.Radar.preset("table2"))) < 0.01
    source = MotionFile(file=str(path), subject="B", distance_m=3.0)
    assert travel_m(target_from(source, {}, t2d.Radar.preset("table2"))) < 0.01
    assert "subject" in {action.dest.removeprefix("motion.") for action in _command("simulate").parser._actions}


def test_numbers_make_each_name_another_one() -> None:
    assert numbered(["a", "b", "a", "a"], "#") == ["a", "b", "a#2", "a#3"]
    assert numbered(["a 2", "a", "a", "b"], taken=["b"]) == ["a 2", "a", "a 3", "b 2"]


def test_sides_and_numbers_of_a_skeleton_name_no_subject() -> None:
    for names in (
        ["pelvis", "spine1", "spine2", *(f"{s}_{j}" for s in ("left", "right") for j in JOINT_CENTRES)],
        [f"{j.upper()}_{s}" for s in ("LEFT", "RIGHT") for j in JOINT_CENTRES],
        list(MODELLED),
    ):
        assert subjects(names, absent_joints) == {}
    body = [f"{s}_{j}" for s in ("left", "right") for j in JOINT_CENTRES]
    three = [f"{who}.{name}" for name in body for who in ("C", "A", "B")]
    found = subjects(three, absent_joints)
    assert list(found) == ["C", "A", "B"]
    assert found["B"] == {name: f"B.{name}" for name in body}
    found = subjects(numbered([*body, *body], "#"), absent_joints)
    assert list(found) == ["unnamed", "2"]


def test_persons_in_the_order_of_a_camera(tmp_path: Path, walk: Motion) -> None:
    body = np.stack([walk.joints[:, walk.index(name)] for name in CANONICAL_JOINTS], axis=1)
    still = np.tile(body[:1] + AWAY_M, (len(body), 1, 1))
    np.save(tmp_path / "a.npy", np.stack([still, body], axis=1) @ independent.Y_UP.T)
    with pytest.warns(T2DWarning, match="holds 2 subjects, 1, 2: 1 is taken"):
        assert travel_m(load_motion(tmp_path / "a.npy")) < 0.01
    assert travel_m(load_motion(tmp_path / "a.npy", subject="2", rate_hz=RATE_HZ)) == pytest.approx(
        travel_m(walk), abs=0.02
    )


def by_time(people: np.ndarray) -> np.ndarray:
    return people


def by_person(people: np.ndarray) -> np.ndarray:
    return people.swapaxes(0, 1)


@pytest.mark.parametrize("order", [by_time, by_person])
def test_persons_of_an_array(tmp_path: Path, walk: Motion, order: Callable[[np.ndarray], np.ndarray]) -> None:
    points = joint_centres(walk)
    moving = np.stack(list(points.values()), axis=1)
    still = np.tile(moving[:1] + AWAY_M, (len(moving), 1, 1))
    people = np.stack([moving, np.zeros_like(moving), still], axis=1)  # the second is seen never
    path = tmp_path / "a.npz"
    np.savez(path, joints=order(people), names=np.array(list(points)), fps=RATE_HZ)
    check(path, walk, "1", "3")
    np.savez(path, joints=order(people[:, :2]), names=np.array(list(points)), fps=RATE_HZ)
    assert travel_m(load_motion(path, smooth_hz=None)) == pytest.approx(travel_m(walk), abs=0.02)


def bvh_of_two(first: str, second: str) -> str:
    """The walk twice in one file, the second body at rest."""
    head, _, rest = WALK.read_text().partition("MOTION")
    _frames, _step, *rows = rest.strip().splitlines()
    tree = head.partition("HIERARCHY")[2]

    def named(space: str) -> str:
        return tree.replace("JOINT ", f"JOINT {space}").replace("ROOT ", f"ROOT {space}")

    rows = rows[1:200:2]
    values = "\n".join(f"{row.strip()} {rows[0].strip()}" for row in rows)
    step = f"Frame Time: {2 / 120:.7f}"
    return f"HIERARCHY\n{named(first)}\n{named(second)}\nMOTION\nFrames: {len(rows)}\n{step}\n{values}\n"


@pytest.mark.parametrize(("first", "second", "names"), [("A:", "B:", "AB"), ("", "", "12")])
def test_two_roots_of_a_bvh(tmp_path: Path, first: str, second: str, names: str) -> None:
    path = tmp_path / "a.bvh"
    path.write_text(bvh_of_two(first, second))
    check(path, t2d.trim(load_motion(WALK, drop_tpose=True), 0.0, 198 / 120), *names)


@pytest.mark.parametrize(("first", "second", "names"), [("A:", "B:", "AB"), ("Bip01 ", "Bip02 ", ("Bip01", "Bip02"))])
def test_two_bodies_under_one_root(tmp_path: Path, first: str, second: str, names: Sequence[str]) -> None:
    text = bvh_of_two(first, second).replace("ROOT", "JOINT")
    stage = "ROOT Scene\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\n"
    text = text.replace("HIERARCHY\n", f"HIERARCHY\n{stage}").replace("\nMOTION", "}\nMOTION")
    head, _, rows = text.partition("Frame Time")
    step, *rows = rows.splitlines()
    path = tmp_path / "a.bvh"
    path.write_text("\n".join([f"{head}Frame Time{step}", *(f"0 0 0 {row}" for row in rows)]))
    check(path, t2d.trim(load_motion(WALK, drop_tpose=True), 0.0, 198 / 120), *names)


def test_one_skeleton_is_one_body() -> None:
    for path in sorted(MOTIONS.glob("*.bvh*")):
        raw = read_bvh(path)
        assert bodies(raw) == {"": raw}, path.name


# --- everybody at once ---


@pytest.mark.parametrize("form", ["trc", "npz"])
def test_persons_of_one_capture_keep_their_places(tmp_path: Path, walk: Motion, form: str) -> None:
    """Both in one set of coordinates, on one clock, though one is seen later, has other feet and begins elsewhere."""
    tracks = two(walk)
    other = {name: track @ ROTATED.T + AWAY_M + [0, 0, 0.0] for name, track in joint_centres(walk).items()}
    tracks |= {f"B:{name}": track.copy() for name, track in other.items()}
    for name in other:
        tracks[f"B:{name}"][:7] = np.nan
    both = t2d.load_motions(write(tmp_path / f"a.{form}", tracks), smooth_hz=None)
    assert list(both) == ["A", "B"]
    for name, motion in both.items():
        assert f"subject {name} of A, B" in motion.report
    a, b = both.values()
    assert len(a.joints) == len(b.joints) == len(walk.joints) - 7
    names = [name for name in a.names if name.endswith(("knee", "ankle", "wrist"))]
    mine, theirs = (each.joints[:, [each.index(name) for name in names]] for each in (a, b))
    true = walk.joints[7:, [walk.index(name) for name in names]]
    assert np.linalg.norm((theirs - mine) - (true @ ROTATED.T + AWAY_M - true), axis=-1).max() < 1e-3
    placed = t2d.place_together(both, distance_m=4.0, angle_deg=30.0)
    apart = [np.linalg.norm(each["A"].joints - each["B"].joints, axis=-1) for each in (both, placed)]
    assert np.allclose(*apart, atol=1e-9)
    assert placed["B"].placed
    assert np.hypot(*placed["A"].joints[0, 0, :2]) == pytest.approx(4.0)
    near = t2d.place_together(both)
    assert min(each.joints[..., 0].min() for each in near.values()) >= 1.5 - 1e-9


ROTATED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def test_a_capture_of_one_or_of_incomplete_ones(tmp_path: Path, walk: Motion) -> None:
    assert list(t2d.load_motions(write(tmp_path / "a.npz", joint_centres(walk)))) == ["1"]
    tracks = two(walk)
    del tracks["A:LElbow"]
    with pytest.warns(T2DWarning, match="A is left out: .* lack left_elbow"):
        assert list(t2d.load_motions(write(tmp_path / "b.trc", tracks))) == ["B"]


def test_both_roots_of_a_bvh_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As far apart as their roots are in the file, in any frame; the first's calibration pose is left out of both."""
    path = tmp_path / "a.bvh"
    path.write_text(bvh_of_two("A:", "B:"))
    reads: list[Path] = []
    monkeypatch.setattr("t2d_rt.motion.read.skeletal.read_bvh", lambda file: (reads.append(file), read_bvh(file))[1])
    both = t2d.load_motions(path, smooth_hz=None)
    assert len(reads) == 1
    assert [each.origin[0].partition(",")[0] for each in both.values()] == ["a.bvh"] * 2
    for name, motion in both.items():
        assert f"subject {name} of A, B" in motion.report
    raw = read_bvh(path)
    starts = np.cumsum([0, *map(len, raw.channels)])
    roots = [raw.values[:, starts[k] : starts[k] + 3] for k, parent in enumerate(raw.parents) if parent < 0]
    apart = (roots[1] - roots[0]) * 0.0254 / 0.45  # y up: z, x, y
    frames = len(both["A"].joints)
    found = both["B"].joints[:, 0] - both["A"].joints[:, 0]
    assert frames == len(both["B"].joints) >= 95
    assert np.allclose(found, apart[-frames:][:, [2, 0, 1]], atol=1e-3)


def test_a_tilted_capture_is_told(tmp_path: Path) -> None:
    lean = Rotation.from_euler("x", 12, degrees=True)
    tracks = {name: lean.apply(track) for name, track in two(t2d.resample(load_motion(WALK), RATE_HZ)).items()}
    tracks |= {name.replace("A:", "B:"): track + lean.apply(AWAY_M) for name, track in tracks.items() if name[0] == "A"}
    with pytest.warns(T2DWarning, match="tilted against its axis, by 1.* degrees as A stands.*give up as a vector"):
        t2d.load_motions(write(tmp_path / "a.npz", tracks), smooth_hz=None)
