"""Motions from the user's MoMask, and from folders of results of text-to-motion models."""

from __future__ import annotations

import io
import json
import pickle
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from builders import slow_after, within
from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions.slots import Description
from t2d_rt.motion.generate.files import Files, results, unpickled
from t2d_rt.motion.generate.momask import MoMask
from t2d_rt.types.motion import CANONICAL_JOINTS


@pytest.fixture(scope="module")
def joints() -> np.ndarray:
    """HumanML3D joints (T, 22, 3) of a walk at 20 Hz, y up."""
    motion = t2d.resample(t2d.example("walk"), 20.0)
    return motion.joints[:, : len(CANONICAL_JOINTS)][..., [1, 2, 0]].astype(np.float32)


def walking(sentence: str = "A person walks forward.") -> Description:
    return Description(activity="walking", action="walk", sentence=sentence)


def fall() -> Description:
    return Description(activity="falling", action="fall", type="trip", sentence="A person trips and falls.")


def is_the_walk(motion: t2d.Motion, joints: np.ndarray) -> None:
    """The motion's joints are the file's but for the floor's height and smoothing."""
    found = motion.joints[:, : len(CANONICAL_JOINTS)]
    wanted = joints[..., [2, 0, 1]].astype(float)
    apart = (found - found[:1, :1]) - (wanted - wanted[:1, :1])
    assert found.shape == wanted.shape
    assert np.abs(apart).max() < 0.03
    assert motion.rate_hz == 20.0


# --- MoMask ---

GENERATOR = """
import argparse, os, sys, time, numpy as np
parser = argparse.ArgumentParser()
for name in ("gpu_id", "ext", "text_path", "repeat_times", "seed"):
    parser.add_argument("--" + name, required=True)
given = parser.parse_args()
(line,) = open(given.text_path).readlines()
prompt, frames = line.split("#")
frames = int(frames)
assert not any("KEY" in name for name in os.environ), "a key was passed on"
folder = os.path.join("generation", given.ext, "joints", "0")
os.makedirs(folder)
MODE
joints = np.load("walk.npy")
stem = os.path.join(folder, "sample0_repeat0_len%d" % frames)
np.save(stem + "_ik.npy", joints)
np.save(stem + ".npy", joints + 5 * np.arange(len(joints))[:, None, None])
open("asked.txt", "w").write("%s|%s|%d|%s" % (given.seed, prompt, frames, given.gpu_id))
"""


@pytest.fixture
def checkout(tmp_path: Path, joints: np.ndarray) -> Path:
    """A folder that behaves like a checkout of MoMask."""
    np.save(tmp_path / "walk.npy", joints)
    behave(tmp_path, "")
    return tmp_path


def behave(checkout: Path, how: str) -> None:
    (checkout / "gen_t2m.py").write_text(GENERATOR.replace("MODE", textwrap.dedent(how)))


def momask(checkout: Path, **options: Any) -> MoMask:
    return MoMask(checkout=checkout, python=sys.executable, **options)


def test_momask_is_run_and_its_joints_with_planted_feet_are_read(
    checkout: Path, joints: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOME_API_KEY", "secret")
    motion = momask(checkout)(walking("a person; rm -rf / #9\nwalks"), seed=7)
    is_the_walk(motion, joints)
    assert (checkout / "asked.txt").read_text() == "7|a person; rm -rf / 9 walks|80|-1"
    assert "MoMask for" in motion.origin[-1]
    assert "seed 7" in motion.origin[-1]


def test_momask_is_asked_for_the_durations_that_the_steps_have(checkout: Path) -> None:
    momask(checkout)(walking().model_copy(update={"duration_s": 6.0}), seed=7)
    assert (checkout / "asked.txt").read_text().split("|")[2] == "120"
    with pytest.raises(InputError, match=r"9.8 s at most, got 30 s"):
        momask(checkout)(walking().model_copy(update={"duration_s": 30.0}), seed=7)


@pytest.mark.parametrize(
    ("provider", "options", "match"),
    [
        ("momask", {"body": "child", "stature_m": 1.2}, "provider momask takes no body nor stature_m"),
        ("files:here", {"duration_s": 3.0}, "provider files takes no duration_s"),
        (momask, {"library": "mine.csv"}, "provider of your own takes no library"),
        ("auto", {"duration_s": 601.0}, "duration_s must"),
    ],
)
def test_options_that_a_provider_would_ignore_are_refused(provider: Any, options: dict[str, Any], match: str) -> None:
    with pytest.raises(InputError, match=match):
        t2d.motion_from_text("a person walks", provider=provider, **options)


def test_a_sentence_cannot_ask_for_more_than_a_motion_lasts() -> None:
    with pytest.raises(InputError, match="asks for 610 s, a motion lasts 600 s at most"):
        t2d.motion_from_text("a person walks for 310 seconds and runs for 300 seconds")


def test_momasks_results_do_not_pile_up(checkout: Path) -> None:
    momask(checkout)(walking(), seed=0)
    assert list((checkout / "generation").iterdir()) == []


@pytest.mark.parametrize(
    ("how", "sentence"),
    slow_after(
        6,
        [
            ("print('x'); sys.exit(3)", "exit code 3: x"),
            ("raise RuntimeError('no weights at checkpoints')", "no weights at checkpoints"),
            ("sys.exit(0)", "ended without joints"),
            ("np.save(folder + '/sample0_repeat0_len80.npy', np.zeros((80, 21, 3))); sys.exit(0)", "cannot be used"),
            (
                "np.save(folder + '/sample0_repeat0_len80.npy', np.full((80, 22, 3), np.nan)); sys.exit(0)",
                "cannot be used",
            ),
            ("open(folder + '/sample0_repeat0_len80.npy', 'w').write('half'); sys.exit(0)", "cannot be used"),
            ("time.sleep(30)", "took longer than 2 s"),
        ],
    ),
)
def test_what_momask_does_wrong_is_told_in_one_sentence(checkout: Path, how: str, sentence: str) -> None:
    behave(checkout, how)
    with pytest.raises(InputError, match=sentence) as caught:
        momask(checkout, limit_s=2.0 if "sleep" in how else 60.0)(walking(), seed=0)  # a busy machine starts slowly
    assert "\n" not in str(caught.value)
    assert list((checkout / "generation").iterdir()) == []


def test_without_a_checkout_or_a_python_momask_says_what_to_set(
    tmp_path: Path, checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("T2D_MOMASK", raising=False)
    with pytest.raises(InputError, match="set T2D_MOMASK"):
        MoMask.from_environment()
    monkeypatch.setenv("T2D_MOMASK", str(tmp_path / "nowhere"))
    with pytest.raises(InputError, match="no checkout of MoMask"):
        MoMask.from_environment()(walking(), seed=0)
    with pytest.raises(InputError, match="T2D_MOMASK_PYTHON"):
        MoMask(checkout=checkout, python="no-such-python")(walking(), seed=0)


# --- folders of results ---


def write_mdm(folder: Path, joints: np.ndarray, prompts: list[str]) -> None:
    padded = np.concatenate([joints, joints[-1:].repeat(9, axis=0)]).transpose(1, 2, 0)
    held = {
        "motion": np.stack([padded] * len(prompts)), "text": prompts, "lengths": np.full(len(prompts), len(joints)),
        "num_samples": len(prompts), "num_repetitions": 1,
    }  # fmt: skip
    np.save(folder / "results.npy", held, allow_pickle=True)  # type: ignore[arg-type]
    (folder / "results.txt").write_text("\n".join(prompts))


def write_momask(folder: Path, joints: np.ndarray, prompts: list[str]) -> None:
    (folder / "prompts.txt").write_text("".join(f"{prompt}#{len(joints)}\n" for prompt in prompts))
    for number in range(len(prompts)):
        place = folder / "joints" / str(number)
        place.mkdir(parents=True)
        np.save(place / f"sample{number}_repeat0_len{len(joints)}_ik.npy", joints)
        np.save(place / f"sample{number}_repeat0_len{len(joints)}.npy", joints * 2)


def write_motiongpt(folder: Path, joints: np.ndarray, prompts: list[str]) -> None:
    for number, prompt in enumerate(prompts):
        np.save(folder / f"{number}_out.npy", joints[None])
        (folder / f"{number}_in.txt").write_text(prompt)


def write_plain(folder: Path, joints: np.ndarray, prompts: list[str]) -> None:
    for number, prompt in enumerate(prompts):
        np.save(folder / f"clip{number}.npy", joints)
        (folder / f"clip{number}.txt").write_text(prompt)


PROMPTS = ["a person walks forward.", "a person trips and falls to the floor."]
WRITERS = [write_mdm, write_momask, write_motiongpt, write_plain]


@pytest.mark.parametrize("write", WRITERS)
def test_results_are_found_by_their_prompts(write: Any, tmp_path: Path, joints: np.ndarray) -> None:
    write(tmp_path, joints, PROMPTS)
    assert [each.prompt for each in results(tmp_path)] == PROMPTS
    motion = Files(folder=tmp_path)(walking(), seed=0)
    is_the_walk(motion, joints)
    assert "a person walks forward." in motion.origin[-1]
    other = Files(folder=tmp_path)(fall(), seed=0)  # not its sentence, but its class and type
    assert "a person trips and falls to the floor." in other.origin[-2]
    assert "of the same kind" in other.origin[-1]


def test_kimodos_prompts_stand_in_json(tmp_path: Path, joints: np.ndarray) -> None:
    np.savez(tmp_path / "one.npz", joints=joints.astype(float), fps=20.0, names=np.array(CANONICAL_JOINTS))
    (tmp_path / "one.json").write_text(json.dumps({"texts": ["A person walks", "and runs."]}))
    assert [each.prompt for each in results(tmp_path)] == ["A person walks and runs."]


def test_a_prompt_of_one_step_is_the_activity(tmp_path: Path, joints: np.ndarray) -> None:
    """Of several steps nobody knows when each begins, and a motion file alone tells nothing."""
    write_plain(tmp_path, joints, ["a person walks forward.", "a person walks, then sits down.", "blue on seven"])
    assert [each.load().activities for each in results(tmp_path)] == [(("walk", 0.0),), (), ()]
    assert t2d.load_motion(tmp_path / "clip0.npy").activities == ()


def test_one_of_several_is_chosen_by_the_seed(tmp_path: Path, joints: np.ndarray) -> None:
    write_plain(tmp_path, joints, ["A person walks forward."] * 6)
    chosen = {Files(folder=tmp_path)(walking(), seed=seed).origin[0] for seed in range(8)}
    assert len(chosen) > 2
    first = Files(folder=tmp_path)(walking(), seed=3)
    assert first.origin == Files(folder=tmp_path)(walking(), seed=3).origin


def test_what_was_not_made_is_not_returned(tmp_path: Path, joints: np.ndarray) -> None:
    write_plain(tmp_path, joints, PROMPTS[:1])
    with pytest.raises(InputError, match="none of the 1 motions"):
        Files(folder=tmp_path)(fall(), seed=0)


class Evil:
    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (Path("ran"),)


def npy(body: bytes) -> bytes:
    """An .npy file of an object, with this pickle."""
    file = io.BytesIO()
    about = {"descr": "|O", "fortran_order": False, "shape": ()}
    np.lib.format.write_array_header_1_0(file, about)
    return file.getvalue() + body


FORGED = {
    "a type with a state": b"cnumpy\ndtype\n(U\x02f8tR(K\x03U\x01|NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK?tb.",
    "a scalar of objects": b"\x80\x03cnumpy.core.multiarray\nscalar\ncnumpy\ndtype\nX\x02\x00\x00\x00O8\x85RC\x08AAAAAAAA\x86R.",
    "a record type": b"\x80\x03cnumpy\ndtype\nX\x03\x00\x00\x00V16\x85R(K\x03X\x01\x00\x00\x00|N(X\x01\x00\x00\x00atNK\x10tb.",
    "a function": b"cos\nsystem\n(S'touch escaped'\ntR.",
    "numpy's own loader": b"cnumpy\nload\n(S'x'\ntR.",
    "a reduction of a word": b"\x80\x03X\x01\x00\x00\x00a)R.",
    "nothing": b"", "only an end": b".", "marks": b"\x80\x03" + b"(" * 100_000 + b"t" * 100_000 + b".",
    "a value of itself": b"\x80\x03]q\x00h\x00a.",
    "a number of a million digits": b"\x80\x03\x8b\x40\x42\x0f\x00" + b"\x7f" * 1_000_000 + b".",
}  # fmt: skip


@pytest.mark.parametrize("name", FORGED)
def test_forged_pickles_are_refused(name: str, joints: np.ndarray, tmp_path: Path) -> None:
    write_mdm(tmp_path, joints, PROMPTS)
    (tmp_path / "results.npy").write_bytes(npy(FORGED[name]))
    with pytest.raises(InputError, match=r"is not MDM's results\.npy"):
        results(tmp_path)


@pytest.mark.parametrize("protocol", [3, 4])
@pytest.mark.parametrize("kind", ["<f4", ">f8"])
def test_mdm_of_any_numpy_is_read(protocol: int, kind: str, joints: np.ndarray, tmp_path: Path) -> None:
    """As np.save of NumPy 1 and 2 pickles, with numbers of NumPy, words, and arrays in Fortran's order beside the motion."""
    motion = np.asfortranarray(joints.transpose(1, 2, 0)[None]).astype(kind)
    held = {
        "motion": motion, "text": ["a", "b"], "lengths": np.array([len(joints)]), "num_samples": np.int64(1),
        "num_repetitions": 1, "guidance": 2.5, "names": np.array(["one", "two"]), "none": None, "pairs": (1, True),
    }  # fmt: skip
    body = pickle.dumps(np.array(held, dtype=object), protocol=protocol)
    assert unpickled(body).keys() == held.keys()
    np.testing.assert_array_equal(unpickled(body)["motion"], motion)
    old = body.replace(b"numpy._core.multiarray", b"numpy.core.multiarray").replace(
        b"\x8c\x16numpy.core", b"\x8c\x15numpy.core"
    )
    assert unpickled(old)["names"].tolist() == ["one", "two"]
    (tmp_path / "results.npy").write_bytes(npy(body))
    (tmp_path / "results.txt").write_text("a person walks forward.")
    is_the_walk(results(tmp_path)[0].load(), joints)


def test_changed_pickles_never_crash(joints: np.ndarray, tmp_path: Path) -> None:
    """Bytes changed at random give the arrays, or an error of Python's own."""
    rng = np.random.default_rng(0)
    body = pickle.dumps(np.array({"motion": joints[:2], "lengths": [2], "text": ["a"]}, dtype=object), protocol=4)
    ends = []
    for _ in range(3000):
        changed = bytearray(body)
        for place in rng.integers(0, len(body), rng.integers(1, 6)):
            changed[place] = rng.integers(256)
        try:
            unpickled(bytes(changed))
            ends.append("read")
        except (ValueError, LookupError, TypeError, AttributeError, UnicodeError, EOFError, OverflowError) as error:
            ends.append(type(error).__name__)
    assert ends.count("read") > 100
    assert ends.count("ValueError") > 100


def damaged(folder: Path, joints: np.ndarray, how: str) -> None:
    write_mdm(folder, joints, PROMPTS)
    path = folder / "results.npy"
    held: dict[str, Any] = np.load(path, allow_pickle=True).item()
    if how == "code":
        held["text"] = Evil()
    elif how == "shape":
        held["motion"] = held["motion"][:, :21]
    elif how == "lengths":
        held["lengths"] = held["lengths"] + 100
    elif how == "nan":
        held["motion"][0, 0, 0, 0] = np.nan
    if how == "cut":
        path.write_bytes(path.read_bytes()[:5000])
    elif how == "prompts":
        (folder / "results.txt").write_text("one only")
    elif how == "pickle":
        path.write_bytes(pickle.dumps(held))
    elif how == "gone":
        (folder / "results.txt").unlink()
    else:
        np.save(path, held, allow_pickle=True)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("how", "sentence"),
    [
        ("code", "other things than arrays"),
        ("shape", "must have shape"),
        ("lengths", "lengths must lie"),
        ("nan", "NaN"),
        ("cut", "damaged"),
        ("pickle", "damaged"),
        ("prompts", "2 motions and results.txt 1 prompts"),
        ("gone", "is missing"),
    ],
)
def test_damaged_results_are_refused_in_one_sentence(
    tmp_path: Path, joints: np.ndarray, how: str, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    damaged(tmp_path, joints, how)
    with pytest.raises(InputError, match=sentence):
        results(tmp_path)
    assert not Path("ran").exists()


def test_folders_without_results_are_refused(tmp_path: Path, joints: np.ndarray) -> None:
    with pytest.raises(InputError, match="holds no results"):
        results(tmp_path)
    with pytest.raises(InputError, match="is no folder"):
        results(tmp_path / "nowhere")
    write_momask(tmp_path, joints, PROMPTS)
    (tmp_path / "prompts.txt").unlink()
    with pytest.raises(InputError, match="copy the file that --text_path named"):
        results(tmp_path)


@pytest.mark.slow
def test_momask_ends_with_the_process_that_asked(checkout: Path) -> None:
    """That one alone is killed: the program, what the program has started, and its folder go within seconds."""
    behave(
        checkout,
        """
        import subprocess
        other = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
        open("pids.new", "w").write("%d %d" % (os.getpid(), other.pid))
        os.rename("pids.new", "pids")
        time.sleep(60)
        """,
    )
    code = (
        "import sys; from pathlib import Path; from t2d_rt.motion.generate.momask import MoMask\n"
        "MoMask(checkout=Path(sys.argv[1]), python=sys.executable).generate('a', frames=40, seed=0)"
    )
    with subprocess.Popen([sys.executable, "-c", code, str(checkout)]) as process:
        pids = checkout / "pids"
        assert within(60, pids.exists)
        process.kill()
    assert within(5, lambda: not any(Path(f"/proc/{pid}").exists() for pid in pids.read_text().split()))
    assert within(5, lambda: not list((checkout / "generation").iterdir()))
