"""Motions from recorded clips: the store, choice and changes of clips, persons, chains, clips of users, the commands."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import t2d_rt as t2d
from builders import slow_after
from command_line import Command
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion import quaternions
from t2d_rt.motion.check import check_motion, detect_fall
from t2d_rt.motion.contacts import contacts
from t2d_rt.motion.descriptions.slots import Activity, Description
from t2d_rt.motion.generate import motion_from_text, understood
from t2d_rt.motion.generate.chain import Piece, heading_rad, joined, moved
from t2d_rt.motion.generate.library import edits, users
from t2d_rt.motion.generate.library.individual import STATURE_M, individual
from t2d_rt.motion.generate.library.store import FOLDER, RATE_HZ, Segment, packed, read_store, shipped, unpacked
from t2d_rt.motion.kinematics import facing, motion_of, poses_of
from t2d_rt.motion.write import save_motion
from t2d_rt.types import Motion


@pytest.fixture(autouse=True)
def no_own_clips(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))


@cache
def made(sentence: str, seed: int = 0) -> Motion:
    return motion_from_text(sentence, seed=seed)


def segment(action: str, kind: str = "") -> Segment:
    return next(each for each in shipped().segments if each.action == action and (not kind or each.kind == kind))


def piece(action: str = "walk", kind: str = "steady") -> Piece:
    return edits.aligned(shipped().piece(segment(action, kind)))


def speed_mps(motion: Motion) -> float:
    """Mean horizontal speed of the pelvis along its path."""
    track = motion.joints[::10, 0, :2]
    return float(np.linalg.norm(np.diff(track, axis=0), axis=-1).sum() / ((len(track) - 1) * 10 / motion.rate_hz))


def turn_deg(motion: Motion) -> float:
    """Change of what the body faces, left positive."""
    ahead = facing({name: motion.joints[:, motion.index(name)] for name in motion.names})
    angle = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    return float(np.degrees(angle[-15:].mean() - angle[:15].mean()))


# --- The store ---


def test_every_segment_that_ships_can_be_read() -> None:
    store = shipped()
    assert len(store.segments) > 80
    assert {each.action for each in store.segments} >= {"walk", "run", "jump", "dance", "stand", "stand_up"}
    for each in store.segments:
        found = store.piece(each)
        assert len(found) == each.stop - each.start == len(found.planted)
        assert np.abs(found.poses.world()[0]).max() < 30


def test_what_ships_may_be_shipped() -> None:
    store = shipped()
    assert {each.licence for each in store.sources.values()} <= {"CMU", "MIT (DeepMimic)", "Apache-2.0 (Kimodo)"}
    credits = (FOLDER / "CREDITS.txt").read_text()
    assert "obtained from mocap.cs.cmu.edu" in credits
    assert "NSF EIA-0196217" in credits
    for licence in {each.licence for each in store.sources.values()}:
        assert f'Licence "{licence}"' in credits
    assert all(len(each.sha256) == 64 for each in store.sources.values())
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 3e6


def test_storage_rounds_by_less_than_a_millimetre() -> None:
    poses = poses_of(t2d.example("12_01_walk"))
    poses = moved(
        Piece(poses=poses, planted=np.zeros((len(poses), 2, 2), bool)), 0.3, poses.root[0, :2], np.zeros(2)
    ).poses
    planted = np.random.default_rng(0).random((len(poses), 2, 2)) < 0.5
    again, contacts = unpacked(*packed(poses, planted))
    error = again.world()[0] - poses.world()[0]
    assert np.linalg.norm(error, axis=-1).max() < 5e-4
    assert np.sqrt(np.mean(np.diff(error, axis=0) ** 2) * 3) * RATE_HZ < 0.01
    np.testing.assert_array_equal(contacts, planted)


@pytest.mark.parametrize(
    ("name", "change", "match"),
    [
        ("index.json", lambda data: data[:-200], "clip index .* is damaged"),
        ("index.json", lambda data: data.replace(b'"start": 0', b'"start": "0"', 1), "start has a wrong value"),
        ("index.json", lambda data: data.replace(b'"sources": {', b'"sources": {}, "more": {', 1), "no source for clip"),
        ("clips.npz", lambda data: data[: len(data) // 2], "cannot be read"),
        ("clips.npz", lambda data: b"no archive", "cannot be read"),
    ],
)  # fmt: skip
def test_damaged_data_is_one_sentence(tmp_path: Path, name: str, change: object, match: str) -> None:
    for file in ("index.json", "clips.npz"):
        shutil.copy(FOLDER / file, tmp_path / file)
    (tmp_path / name).write_bytes(change((FOLDER / name).read_bytes()))  # type: ignore[operator]

    def use() -> None:
        store = read_store(tmp_path / "index.json", tmp_path / "clips.npz")
        store.piece(store.segments[0])

    with pytest.raises(InputError, match=match) as caught:
        use()
    assert "\n" not in str(caught.value)


def test_a_clip_with_pickles_is_refused(tmp_path: Path) -> None:
    name = shipped().segments[0].clip
    np.savez(tmp_path / "clips.npz", allow_pickle=True, **{name: np.array([{}]), f"{name}.skeleton": np.zeros((28, 3))})
    store = replace(shipped(), path=tmp_path / "clips.npz")
    with pytest.raises(InputError, match="cannot be read"):
        store.piece(store.segments[0])


# --- Changes of clips ---


def test_mirroring_exchanges_the_sides() -> None:
    walk = piece()
    image = edits.mirrored(walk)
    np.testing.assert_allclose(image.poses.joint("left_wrist"), walk.poses.joint("right_wrist") * [1, -1, 1], atol=1e-9)
    np.testing.assert_array_equal(image.planted[:, 0], walk.planted[:, 1])
    np.testing.assert_allclose(edits.mirrored(image).poses.world()[0], walk.poses.world()[0], atol=1e-9)


def test_tempo_and_stride_change_the_speed() -> None:
    walk = piece()
    before = edits.rate_of(walk.poses)
    assert edits.rate_of(edits.tempo(walk, 1.25).poses) == pytest.approx(1.25 * before, rel=0.01)
    assert edits.rate_of(edits.strided(walk, 0.8).poses) == pytest.approx(0.8 * before, rel=1e-6)
    assert edits.backwards(walk).poses.root[0, 0] == walk.poses.root[-1, 0]


def test_a_bent_path_keeps_its_length() -> None:
    walk = piece()
    bent = edits.bent(walk, np.linspace(0, np.pi / 2, len(walk)))
    lengths = [np.linalg.norm(np.diff(each.poses.root[:, :2], axis=0), axis=-1).sum() for each in (walk, bent)]
    assert lengths[1] == pytest.approx(lengths[0], rel=1e-4)
    turned = heading_rad(bent.poses) - heading_rad(walk.poses)
    np.testing.assert_allclose(turned, np.linspace(0, np.pi / 2, len(walk)), atol=1e-6)


@pytest.mark.parametrize("second", [("walk", "steady"), ("jump", "forward"), ("stand", ""), ("dance", "")])
def test_pieces_are_joined_without_a_jump(second: tuple[str, str]) -> None:
    first, after = piece().part(0, 60), piece(*second)
    far = moved(after, 2.0, np.zeros(2), np.array([3.0, -1.0]))
    skeleton = first.poses.skeleton
    whole = joined([first, replace(far, poses=replace(far.poses, skeleton=skeleton))])
    assert len(whole) == len(first) + len(after)
    velocity = np.diff(whole.poses.world()[0], axis=0) * RATE_HZ
    change = np.linalg.norm(np.diff(velocity, axis=0), axis=-1).max(axis=1)
    # At the seam itself velocities go on; then they change as fast as at a foot's strike, up to 3 m/s in a frame.
    assert change[57:60].max() < 0.8
    assert change[60:90].max() < 3.0
    assert np.linalg.norm(velocity, axis=-1).max() < 9.0
    # In the end nothing is left of the difference.
    np.testing.assert_allclose(np.abs((whole.poses.local[-1, 1:] * after.poses.local[-1, 1:]).sum(-1)), 1.0, atol=1e-9)


# --- What was asked for ---


@pytest.mark.parametrize("action", slow_after(1, ["walks", "runs"]))
def test_slow_and_fast_are_slower_and_faster(action: str) -> None:
    means = [
        np.mean([speed_mps(made(f"a man {action} {speed}", seed)) for seed in range(4)])
        for speed in ("slowly", "", "fast")
    ]
    assert means[0] < 0.9 * means[1] < 0.81 * means[2]
    least, greatest = (0.6, 2.2) if action == "walks" else (2.0, 4.5)
    assert means[0] > least
    assert means[2] < greatest


@pytest.mark.parametrize(
    ("sentence", "low", "high"),
    [
        ("a person walks to the left", 60, 110), ("a person runs to the right", -110, -60),
        ("a person walks clockwise in a circle", -720, -100), ("a person walks counterclockwise", 100, 720),
        ("a person turns left", 65, 115), ("a person turns around", -200, 200), ("a person walks forward", -15, 15),
    ],
)  # fmt: skip
def test_directions_are_taken(sentence: str, low: float, high: float) -> None:
    assert low < turn_deg(made(sentence)) < high
    if "around" in sentence:
        assert abs(turn_deg(made(sentence))) > 150


def test_a_person_walks_back() -> None:
    motion = made("a person walks back")
    ahead = facing({name: motion.joints[:, motion.index(name)] for name in motion.names}).mean(axis=0)
    way = motion.joints[-1, 0] - motion.joints[0, 0]
    assert way @ ahead < -0.9 * np.linalg.norm(way) < -1.5


@pytest.mark.parametrize(
    ("sentence", "count"), [("a person jumps forward three times", 3), ("a man jumps up twice", 2)]
)
def test_jumps_are_counted(sentence: str, count: int) -> None:
    height = made(sentence).joints[:, :, 2].min(axis=1)
    flights = np.flatnonzero(np.diff((height > 0.07).astype(int)) > 0)
    assert len(flights) == count


def test_durations_are_kept() -> None:
    assert motion_from_text("a person walks", duration_s=3.0).duration_s == pytest.approx(3.0, abs=0.1)
    assert made("a person walks for 8 seconds").duration_s == pytest.approx(8.0, abs=0.2)


def test_manners_are_seen() -> None:
    def nod(sentence: str) -> float:
        tilts = []
        for seed in range(2):
            motion = made(sentence, seed)
            head = motion.joints[:, motion.index("head_top")] - motion.joints[:, motion.index("neck")]
            ahead = facing({name: motion.joints[:, motion.index(name)] for name in motion.names})
            tilts.append(float(np.degrees(np.arctan2((head * ahead).sum(-1), head[:, 2])).mean()))
        return float(np.mean(tilts))

    assert nod("a sad man walks") > nod("a happy man walks") + 8


# --- Quality ---


@pytest.mark.parametrize(
    ("sentence", "expected"),
    slow_after(4, [
        ("a person walks forward", "walking"), ("a sad woman walks slowly to the right", "walking"),
        ("a person walks back", "walking"), ("a man runs fast", "running"), ("a child runs", "running"),
        ("a person jumps up", "jumping"), ("a man jumps forward", "jumping"), ("a person dances", "dancing"),
    ]),
)  # fmt: skip
def test_motions_pass_the_filter(sentence: str, expected: Activity) -> None:
    verdicts = [check_motion(made(sentence, seed), expected=expected) for seed in range(2)]
    assert all(not each.reasons for each in verdicts), verdicts
    assert not any(each.fall.happened for each in verdicts)


def test_no_two_samples_are_alike() -> None:
    """The least distance of two walks is a tenth of the median distance of recorded ones (0.5 m), or more."""
    found = [aligned_joints(made("a person walks forward", seed)) for seed in range(6)]
    distances = [
        float(np.sqrt(((a - b) ** 2).sum(-1).mean())) for number, a in enumerate(found) for b in found[number + 1 :]
    ]
    assert min(distances) > 0.05
    assert np.median(distances) > 0.7 * 0.4


def aligned_joints(motion: Motion) -> np.ndarray:
    joints = motion.joints[:180, :22] - motion.joints[:1, :1] * [1, 1, 0]
    way = joints[-1, 0]
    return quaternions.rotate(quaternions.about_axis(np.array([0.0, 0.0, 1.0]), -np.arctan2(way[1], way[0])), joints)


# --- Persons and seeds ---


@pytest.mark.slow
def test_the_same_seed_is_the_same_motion_in_every_process() -> None:
    sentence = "a woman walks slowly to the left"
    code = (
        "import hashlib; from t2d_rt.motion.generate import motion_from_text as m; "
        f"print(hashlib.sha256(m({sentence!r}, seed=5).joints.tobytes()).hexdigest())"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "17"}
    told = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert told.stdout.strip() == hashlib.sha256(motion_from_text(sentence, seed=5).joints.tobytes()).hexdigest()
    assert not np.array_equal(made(sentence, 6).joints[:60], made(sentence, 5).joints[:60])


@pytest.mark.slow
@pytest.mark.parametrize("subject", list(STATURE_M))
def test_statures_are_those_of_a_population(subject: str) -> None:
    tall = [individual(subject, np.random.default_rng(seed)).stature_m for seed in range(40)]  # type: ignore[arg-type]
    mean = np.mean([each[1] for each in STATURE_M[subject]])  # type: ignore[index]
    assert np.mean(tall) == pytest.approx(mean, abs=0.035)
    assert 0.05 < np.std(tall) < 0.13


def test_a_stature_and_a_body_are_kept() -> None:
    motion = motion_from_text("a person walks", stature_m=1.5, body="adult")
    assert t2d.describe(motion).stature_m == pytest.approx(1.5, rel=0.05)
    assert "person of 1.50 m, body adult" in motion.origin[1]
    with pytest.raises(InputError, match="no body 'robot'"):
        motion_from_text("a person walks", body="robot")


def test_the_origin_tells_all() -> None:
    origin = "; ".join(made("a sad man runs to the left").origin)
    for word in ("a sad man runs to the left", "class running", "seed 0", "clip ", "sad by", "bent left", "m/s"):
        assert word in origin


# --- Chains and providers ---


def test_a_walk_comes_to_a_halt_and_sits() -> None:
    motion = made("a person walks to a chair and sits down")
    velocity = np.diff(motion.joints, axis=0) * motion.rate_hz
    assert np.linalg.norm(np.diff(velocity, axis=0), axis=-1).max() < 2.5
    # The pelvis slows down as people do who stop, by 2 to 3 m/s^2; in a walk that is cut off it does by 6 and more.
    pace = (motion.joints[12:, 0, :2] - motion.joints[:-12, 0, :2]) / 0.2
    assert np.linalg.norm(pace[6:] - pace[:-6], axis=-1).max() / 0.1 < 4.0
    assert motion.joints[-1, 0, 2] < 0.7 * motion.joints[0, 0, 2]
    assert np.linalg.norm(velocity[-10:], axis=-1).max() < 0.3
    assert not check_motion(motion, expected="sitting").reasons


def test_a_provider_may_be_a_function() -> None:
    given = []

    def mine(description: Description, *, seed: int) -> Motion:
        given.append((description.action, seed))
        return motion_of(piece().poses)

    motion_from_text("a person walks", provider=mine, seed=4)
    assert given == [("walk", 4)]


@pytest.mark.parametrize(
    ("sentence", "options", "match"),
    [
        ("", {}, "needs words"), ("a person walks", {"provider": "none"}, "unknown provider 'none'"),
        ("a person trips and falls", {"provider": "library"}, "provider library does not make fall"),
        ("a person walks", {"provider": "physics"}, "provider physics does not make walk"),
        ("a person walks", {"provider": "files"}, "give files:FOLDER"), ("a person walks", {"provider": 3}, "provider must be"),
        ("a person walks", {"seed": -1}, "seed must be"), ("a person walks", {"duration_s": 0.1}, "duration_s must"),
        ("a person walks", {"stature_m": 9.0}, "stature_m must"), (3, {}, "a sentence or a Description"),
        ("a person walks", {"library": "nowhere.csv"}, "cannot read clip index nowhere.csv"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(sentence: object, options: dict[str, object], match: str) -> None:
    with pytest.raises(InputError, match=match):
        motion_from_text(sentence, **options)  # type: ignore[arg-type]


def test_falls_need_an_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match=r"\[falls\]"):
        motion_from_text("a person slips and falls")


# --- Clips of a user ---


def folder_of_clips(tmp_path: Path) -> Path:
    clips = tmp_path / "clips"
    clips.mkdir()
    save_motion(motion_of(piece("jump", "forward").poses), clips / "leap.bvh")
    save_motion(motion_of(piece().poses), clips / "stroll.bvh")
    return clips


def test_clips_of_a_user_join_the_library(tmp_path: Path) -> None:
    clips = folder_of_clips(tmp_path)
    index = tmp_path / "index.csv"
    index.write_text(
        "file,class,action,start_s,stop_s,direction\nleap.bvh,bending,stretch,0.1,2,\nstroll.bvh,walking,walk,,,back\n"
    )
    added, replaced = users.add(clips, index)
    assert ([row["action"] for row in added], replaced) == (["stretch", "walk"], 0)
    assert users.registry().is_file()
    assert users.registry().is_relative_to(tmp_path)
    motion = motion_from_text("a person stretches", provider="library", library=users.registry())
    assert any("leap.bvh" in note for note in motion.origin)
    assert any(
        "stroll.bvh" in note for note in motion_from_text("a person walks back", library=users.registry()).origin
    )
    assert not any("stroll.bvh" in note for note in motion_from_text("a person walks back").origin)
    index.write_text(index.read_text().replace("0.1,2,", "0.2,1.8,"))
    assert users.add(clips, index)[1] == 2  # once more, corrected: in place of those that there were
    assert len(users.with_users(shipped(), users.registry()).own) == 2
    assert users.remove(clips) == 2
    assert not users.with_users(shipped(), users.registry()).own
    assert (clips / "leap.bvh").is_file()


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("file,class\nleap.bvh,walking\n", "must have the columns"),
        ("file,class,action,colour\nleap.bvh,walking,walk,red\n", "must have the columns"),
        ("file,class,action\n", "has no line"),
        ("file,class,action\nstroll.bvh,walking,walk\nleap.bvh,flying,walk\n", "line 3 of .* has class 'flying'"),
        ("file,class,action\nleap.bvh,walking,jump\n", "line 2 of .*: class walking has no action jump"),
        ("file,class,action\nleap.bvh,walking,walk,more\n", "another number of values"),
        ("file,class,action,start_s\nleap.bvh,jumping,jump,soon\n", "has start_s 'soon'"),
        ("file,class,action,stop_s\nleap.bvh,jumping,jump,99\n", "asks for 0 to 99 s of a motion"),
        ("file,class,action\nnone.bvh,jumping,jump\n", "line 2 of .*none.bvh"),
        ("file,class,action\n../index.csv,jumping,jump\n", "which is not in"),
        ("file,class,action\n\0,jumping,jump\n", r"clip index|names no file"),
    ],
)
def test_a_wrong_index_is_told_by_line(tmp_path: Path, text: str, match: str) -> None:
    clips = folder_of_clips(tmp_path)
    (tmp_path / "index.csv").write_text(text)
    with pytest.raises(InputError, match=match):
        users.add(clips, tmp_path / "index.csv")
    assert not users.registry().exists()


def test_an_index_replaces_no_folder_and_what_killed_processes_left_of_it(tmp_path: Path) -> None:
    clips = folder_of_clips(tmp_path)
    (tmp_path / "index.csv").write_text("file,class,action\nstroll.bvh,walking,walk\n")
    with pytest.raises(InputError, match="it is a folder; choose the name of a file"):
        users.add(clips, tmp_path / "index.csv", library=clips)
    assert (clips / "stroll.bvh").is_file()
    library = tmp_path / "library.csv"
    (tmp_path / ".library.csv.partial-0123abcd" / "new").mkdir(parents=True)
    users.add(clips, tmp_path / "index.csv", library=library)
    assert [path.name for path in tmp_path.glob("*library.csv*")] == ["library.csv"]


def test_a_clip_in_which_nothing_moves_is_refused(tmp_path: Path) -> None:
    poses = piece().poses
    still = replace(poses, root=np.repeat(poses.root[:1], 60, axis=0), local=np.repeat(poses.local[:1], 60, axis=0))
    save_motion(motion_of(still), tmp_path / "still.bvh")
    (tmp_path / "index.csv").write_text("file,class,action\nstill.bvh,walking,walk\n")
    with pytest.raises(InputError, match="nothing moves in still"):
        users.add(tmp_path, tmp_path / "index.csv")


# --- The commands ---


def test_the_command_writes_a_motion(run: Command, tmp_path: Path) -> None:
    told = run("motion", "a man walks slowly, quoggishly", "--seed", "2", "-o", "new.bvh")
    assert told.code == 0, told.err
    assert "class walking, man: walk, speed slow" in told.out
    assert "quoggishly" in told.out
    assert "clip walking" in told.out
    motion = t2d.load_motion("new.bvh")
    assert motion.duration_s > 3
    again = run("motion", "a man walks slowly", "-o", "new.bvh")
    assert again.code == 2
    assert "new.bvh exists" in again.err
    assert run("motion", "a man jumps").code == 0
    assert Path("a_man_jumps.bvh").is_file()


@pytest.mark.parametrize(
    "arguments",
    [
        ("",), ("...",), ("a man walks", "--provider", "none"), ("a man walks", "-o", "walk.txt"),
        ("a man walks", "--seed", "-3"),
    ],
)  # fmt: skip
def test_the_command_refuses_in_one_sentence(refused: object, arguments: tuple[str, ...]) -> None:
    refused("motion", *arguments)  # type: ignore[operator]


def test_the_command_adds_lists_and_removes_clips(run: Command, tmp_path: Path) -> None:
    folder_of_clips(tmp_path)
    (tmp_path / "i.csv").write_text("file,class,action\nleap.bvh,jumping,jump\n")
    assert "added 1 clips (1 jump)" in run("library", "add", "clips", "--index", "i.csv", "--library", "l.csv").out
    (tmp_path / "i.csv").write_text("file,class,action,stop_s\nleap.bvh,jumping,jump,1.5\n")
    again = run("library", "add", "clips", "--index", "i.csv", "--library", "l.csv").out
    assert again.endswith("l.csv, in place of 1 that it had of the same files\n")
    assert run("library", "list", "--library", "l.csv").out.count("leap.bvh: jump") == 1
    assert "removed 1 clips" in run("library", "remove", "clips/leap.bvh", "--library", "l.csv").out
    assert "clips ship" in run("library", "list").out


@pytest.mark.parametrize(
    "arguments",
    [
        (), ("sing",), ("add", "clips"), ("add", "--index", "i.csv"), ("list", "here"), ("remove", "clips"),
        ("list", "--index", "i.csv"),
    ],
)  # fmt: skip
def test_the_library_command_refuses_in_one_sentence(refused: object, arguments: tuple[str, ...]) -> None:
    refused("library", *arguments)  # type: ignore[operator]


def test_what_no_maker_does_is_told_in_the_origin() -> None:
    for sentence, told in (
        ("a person dances twice", "not made: count 2 of dance"),
        ("a person walks with the left hand raised", "not made: left hand of walk"),
    ):
        with pytest.warns(T2DWarning, match=told):
            assert told in motion_from_text(sentence).origin
    assert not any(note.startswith("not made") for note in motion_from_text("a person jumps twice").origin)


@pytest.mark.parametrize("side", slow_after(1, ["left", "right"]))
def test_a_limp_is_on_the_side_that_the_sentence_names(side: str) -> None:
    for seed in range(3):
        poses = poses_of(motion_from_text(f"a person limps on the {side} leg", seed=seed))
        planted = contacts(poses).any(axis=2)
        alone = {name: int((planted[:, n] & ~planted[:, 1 - n]).sum()) for n, name in enumerate(("left", "right"))}
        assert alone[side] < alone["right" if side == "left" else "left"]


@pytest.mark.slow
def test_a_fall_goes_where_the_sentence_says_or_says_that_it_does_not() -> None:
    pytest.importorskip("mujoco")
    for sentence, wanted in (
        ("a person slips and falls backward", "backward"),
        ("a person stumbles and falls to the left", "left"),
    ):
        motion = motion_from_text(understood(sentence)[0], seed=1)
        told = any(note.startswith("not made: a fall") for note in motion.origin)
        assert told == (detect_fall(motion).direction != wanted)


@pytest.mark.slow
@pytest.mark.parametrize("direction", ["clockwise", "counterclockwise"])
def test_a_dance_in_a_circle_spins_the_same_way(direction: str) -> None:
    sign = -1.0 if direction == "clockwise" else 1.0
    for seed in range(2):
        poses = poses_of(motion_from_text(f"a person dances {direction}", seed=seed))
        heading = np.unwrap(heading_rad(poses))
        assert sign * (heading[-1] - heading[0]) > 0


@pytest.mark.slow
def test_motions_beyond_ten_minutes_and_trips_backward_are_refused() -> None:
    with pytest.raises(InputError, match="more than 600 s; ask for fewer repetitions"):
        motion_from_text("a person walks for 595 s and jumps 20 times", seed=0)
    pytest.importorskip("mujoco")
    with pytest.raises(InputError, match="a trip throws nobody backward"):
        motion_from_text("a person trips and falls backward")
