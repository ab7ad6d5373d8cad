"""Files and texts from outside: bounded in size, time and memory, refused in one sentence."""

from __future__ import annotations

import gzip
import io
import os
import re
import subprocess
import sys
import threading
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import yaml

from builders import MOTIONS
from t2d_rt import cli
from t2d_rt.cli.experiments import target_of
from t2d_rt.core import files
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.experiment.sources import MotionFile
from t2d_rt.motion import load_motion, read
from t2d_rt.motion.read import bvh
from t2d_rt.types import Radar

MOMASK = MOTIONS / "momask_22j_120frames.bvh"
GOOD = MOMASK.read_bytes()


def write(folder: Path, data: bytes, name: str = "a.bvh") -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def same(path: Path) -> bool:
    found, expected = load_motion(path), load_motion(MOMASK)
    return np.array_equal(found.joints, expected.joints) and np.array_equal(found.rotations, expected.rotations)


@contextmanager
def memory_below(limit: float) -> Iterator[None]:
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < limit
    finally:
        tracemalloc.stop()


# --- what is no file of bounded size --------------------------------------------------------------------------------


def pipe(path: Path) -> None:
    os.mkfifo(path)


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(20_000_000_000)


READERS: dict[str, Callable[[Path], object]] = {
    "bvh": load_motion,
    "bvh.gz": load_motion,
    "yaml": Radar.from_yaml,
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes and devices are files on Unix only")
@pytest.mark.parametrize("suffix", READERS)
@pytest.mark.parametrize(
    ("make", "sentence"), [(pipe, "is a pipe"), (device, "is a device"), (sparse, r"is larger than the \d+ MB")]
)
def test_only_ordinary_files_are_read(tmp_path: Path, suffix: str, make: Callable[[Path], None], sentence: str) -> None:
    path = tmp_path / f"a.{suffix}"
    make(path)
    caught: list[BaseException] = []

    def attempt() -> None:
        try:
            READERS[suffix](path)
        except InputError as error:
            caught.append(error)

    thread = threading.Thread(target=attempt, daemon=True)
    thread.start()
    thread.join(5)
    assert caught, "it waits, or read on"
    assert re.search(sentence, str(caught[0]))


def test_a_path_is_a_text() -> None:
    for path in (None, 3, b"a.bvh", ["a.bvh"], ""):
        with pytest.raises(InputError):
            load_motion(path)  # type: ignore[arg-type]
        with pytest.raises(InputError):
            Radar.from_yaml(path)  # type: ignore[arg-type]


# --- gzip -----------------------------------------------------------------------------------------------------------


def test_several_gzip_members_are_one_file(tmp_path: Path) -> None:
    parts = [gzip.compress(GOOD[start : start + 9000]) for start in range(0, len(GOOD), 9000)]
    assert same(write(tmp_path, b"".join(parts), "a.bvh.gz"))
    assert same(write(tmp_path, b"".join(parts) + bytes(1000), "a.bvh.gz"))


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (gzip.compress(GOOD, mtime=0) + b"junk", "followed by bytes that are no gzip data"),
        (gzip.compress(GOOD, mtime=0) + b"\0\0junk", "followed by bytes that are no gzip data"),
        (gzip.compress(GOOD, mtime=0) + gzip.compress(GOOD, mtime=0)[:40], "cut short"),
        (b"", "cut short"),
        (gzip.compress(b"", mtime=0), "is empty"),
    ],
)
def test_gzip_files_that_are_damaged(tmp_path: Path, data: bytes, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        load_motion(write(tmp_path, data, "a.bvh.gz"))


def test_gzip_bombs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "MAX_GZIP_MEMBERS", 100)
    with pytest.raises(InputError, match="more than 100 gzip members"):
        load_motion(write(tmp_path, gzip.compress(b"", mtime=0) * 200, "a.bvh.gz"))
    monkeypatch.setattr(bvh, "MAX_BYTES", 200_000)
    with pytest.raises(InputError, match="unpacks to more than 200 kB"):
        load_motion(write(tmp_path, gzip.compress(GOOD + b"\n" * 200_000), "a.bvh.gz"))


# --- BVH: sizes -----------------------------------------------------------------------------------------------------


def test_short_lines_take_no_more_memory_than_long_ones(tmp_path: Path) -> None:
    path = write(tmp_path, gzip.compress(GOOD + b"0\n" * 4_000_000, 1), "a.bvh.gz")
    # The text of 8 MB while it is unpacked, and a block's words: lists of all words would take 500 MB.
    with memory_below(60e6), pytest.raises(InputError, match=r"8280 values, got \d+ or more"):
        load_motion(path)


def test_frames_that_are_promised_take_no_memory(tmp_path: Path) -> None:
    promised = re.sub(rb"Frames:.*", b"Frames: 100000", GOOD)
    with memory_below(20e6), pytest.raises(InputError, match="'Frames: 100000' but 120 rows"):
        load_motion(write(tmp_path, promised))
    with pytest.raises(
        InputError, match="200000 frames of 69 channels are too many, 100000 frames and 10000000 values"
    ):
        load_motion(write(tmp_path, re.sub(rb"Frames:.*", b"Frames: 200000", GOOD)))


def skeleton(joints: int, *, deep: bool) -> bytes:
    names = [b"JOINT x%d\n{\nOFFSET 0 1 0\n" % i for i in range(joints)]
    body = b"".join(names) + b"}\n" * joints if deep else b"}\n".join([*names, b""])
    return (
        b"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n"
        + body
        + b"}\nMOTION\nFrames: 2\nFrame Time: .1\n1\n2\n"
    )


@pytest.mark.parametrize("deep", [False, True])
def test_joints_are_limited(tmp_path: Path, deep: bool) -> None:
    assert len(bvh.read_bvh(write(tmp_path, skeleton(999, deep=deep))).names) == 1000
    with pytest.raises(InputError, match="may have 1000 joints and ends"):
        load_motion(write(tmp_path, skeleton(20_000, deep=deep)))


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (b"HIERARCHY", b"HIERARCHY\nJOINT " + b"x" * 20_000, "out of place"),
        (b"OFFSET", b"OFFSET " + b"0 " * 100_000, "must be 3 numbers|numbers only"),
        (b"CHANNELS", b"CHANNELS 6 " + b"Xrotation " * 10_000, "must be a count and that many"),
        (b"OFFSET", b"OFFSET 0 0 0\nOFFSET", "cannot understand 'OFFSET"),
        (b"CHANNELS 3 ", b"CHANNELS 0\nCHANNELS 3 ", "cannot understand 'CHANNELS"),
        (b"}", b"}\n{\n}", "cannot understand '{'"),
        (b"Frames: 120", b"Frames: " + b"1 " * 100_000, "the file is cut short or damaged"),
        (b"Frame Time", b"Frame " * 100_000 + b"Time", "must begin with 'Frames:'"),
        (b"Frames: 120", b"Frames: \x1b[31m", "Frames must hold numbers only"),
        (b"Frames: 120", b"Frames: 1e9", "absurd"),
        (b"JOINT Spine1", b"JOINT {Spine1}", "is empty or occurs twice"),
        (b"ROOT Hips", b"JOINT \x1b[31mHips", "out of place"),
        (b"MOTION", b"MOTIONS", "has no MOTION section"),
        (b"HIERARCHY", b"HIERARCHY" + b" " * 11_000_000, "no MOTION section within its first 10 MB"),
    ],
)
def test_malformed_bvh_is_one_short_sentence(tmp_path: Path, old: bytes, new: bytes, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as caught:
        load_motion(write(tmp_path, GOOD.replace(old, new, 1)))
    assert len(str(caught.value)) < 600
    assert "\x1b" not in str(caught.value)


@pytest.mark.parametrize("end", [b"\r\n", b"\r", b"\n\r\n\r"])
def test_line_ends(tmp_path: Path, end: bytes) -> None:
    assert same(write(tmp_path, GOOD.replace(b"\r\n", b"\n").replace(b"\n", end)))


@pytest.mark.parametrize("name", ["Ąż", "łą…", "à", "名前\u3000"])
def test_names_of_any_letters(tmp_path: Path, name: str) -> None:
    """Bytes 0x85 and 0xA0 occur in UTF-8 letters; as Latin-1 they are a line end and a space."""
    extra = f"JOINT {name}\n{{\nOFFSET 0 0 1\nEnd Site\n{{\nOFFSET 0 0 1\n}}\n}}\n".encode()
    head, motion = GOOD.split(b"MOTION")
    last = head.rindex(b"}")
    path = write(tmp_path, head[:last] + extra + head[last:] + b"MOTION" + motion)
    assert name.strip() in bvh.read_bvh(path).names
    assert same(path)


# --- options of the reader ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("floor", 1e300), ("floor", -1e7), ("floor", "low"), ("floor", float("inf")), ("smooth_hz", 1e-300),
        ("smooth_hz", -1.0), ("smooth_hz", float("nan")), ("smooth_hz", "soft"), ("units", 1e300), ("units", True),
        ("units", [1]), ("up", 3), ("up", ["y"]), ("flavour", 3), ("flavour", ["mixamo"]),
    ],
)  # fmt: skip
def test_reader_options_in_range(option: str, value: object) -> None:
    with pytest.raises(InputError, match=option):
        load_motion(MOMASK, **{option: value})  # type: ignore[arg-type]
    lowest = load_motion(MOMASK, smooth_hz=read.LOWEST_CUTOFF_HZ, floor=1e5)
    assert np.isfinite(lowest.joints).all()


# --- YAML -----------------------------------------------------------------------------------------------------------

BOMB = "a0: &a0 [x,x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"a{i}: &a{i} [{','.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 10)
)
MERGES = "a0: &a0 {x: 1}\n" + "".join(f"a{i}: &a{i} {{<<: [{','.join([f'*a{i - 1}'] * 10)}]}}\n" for i in range(1, 10))
BAD_YAML = {
    "aliases": (BOMB, "more than 20000 values"),
    "merges": (MERGES, "more than 20000 values"),
    "itself": ("a: &a [*a]", "stands for nothing, or for what holds it"),
    "values": ("[" + "1," * 30_000 + "]", "more than 20000 values"),
    "deep list": ("[" * 5000, "nested deeper than 50"),
    "deep mapping": ("{a: " * 5000, "nested deeper than 50"),
    "deep blocks": ("- " * 5000, "nested deeper than 50"),
    "key twice": ("prf_hz: 1\nsamples: 2\nprf_hz: 3", "key 'prf_hz' is given twice"),
    "inner key twice": ("tx_pattern: {kind: a, 'kind': b}", "key 'kind' is given twice"),
    "digits": ("prf_hz: 0x" + "f" * 5000, "more than 400 digits"),
    "long": ("# " + "x" * 1_000_001, "larger than the 1 MB"),
    "tag": ("prf_hz: !!timestamp x", "tag"),
    "python": ("prf_hz: !!python/object/apply:os.system [ls]", "tag"),
    "month": ("prf_hz: 2001-99-99", "month"),
    "control": ("prf_hz: \x1b[31m", "not valid YAML"),
    "two": ("a: 1\n---\nb: 2", "single document"),
}


@pytest.mark.parametrize("case", BAD_YAML)
def test_malformed_yaml(tmp_path: Path, case: str) -> None:
    text, sentence = BAD_YAML[case]
    path = write(tmp_path, text.encode(), "r.yaml")
    with memory_below(30e6), pytest.raises(InputError, match=sentence) as caught:
        Radar.from_yaml(path)
    assert len(str(caught.value)) < 600
    with pytest.raises(InputError, match=sentence):
        cli._command("simulate").words(["--config", str(path)])


def test_aliases_in_bounds_are_read(tmp_path: Path) -> None:
    text = yaml.safe_dump(Radar.preset("table2").model_dump(mode="json"))
    assert files.load_yaml("a: &a {x: 1, y: 2}\nb: {<<: *a, x: 3}\nc: *a")["b"] == {"x": 3, "y": 2}
    text = re.sub(
        r"(?s)tx_offsets_m:\n.*?\n(?=\w)", "tx_offsets_m: *here\n", text.replace("rx_offsets_m:", "rx_offsets_m: &here")
    )
    assert "*here" in text
    assert Radar.from_yaml(write(tmp_path, text.encode(), "r.yaml")) == Radar.preset("table2")


def test_the_largest_radar_is_read(tmp_path: Path) -> None:
    many = [(0.001 * i, 0.0, 0.0) for i in range(1024)]
    radar = Radar.preset("table2", tx_offsets_m=many, rx_offsets_m=many)
    radar.to_yaml(tmp_path / "r.yaml")
    assert Radar.from_yaml(tmp_path / "r.yaml") == radar


def test_wrong_values_of_any_size_are_clipped() -> None:
    huge: object = [[0] * 1000] * 1000
    for _ in range(3):
        huge = [huge] * 1000  # 10^15 zeros as text
    with pytest.raises(InputError, match="radar key samples") as caught:
        Radar.preset("table2", samples=huge)
    assert len(str(caught.value)) < 300
    with pytest.raises(InputError, match="radar key samples"):
        Radar.preset("table2", samples=10**5000)


# --- command line ---------------------------------------------------------------------------------------------------


@pytest.fixture
def refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, GOOD, "walk.bvh")

    def check(*arguments: str) -> str:
        assert cli.main(arguments) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert len(error) < 700
        return error

    return check


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--seed", "[" * 5000], "option seed must be a whole number"),
        (["--seed", "{a: " * 300], "option seed must be a whole number"),
        (["--radar.tx_pattern", "{kind: beam, kind: beam}"], "option radar.tx_pattern must be a mapping"),
        (["--radar.position_m", BOMB], "option radar.position_m must be"),
        (["--motion.floor", "1e300"], "floor must lie in -1e+06..1e+06 m, got 1e+300"),
        (["--motion.smooth-hz", "1e-300"], "smooth_hz must be 0.1 Hz or more"),
        (["--add", "null"], "a mover is written as kind:x,y,z,key=value"),
        (["--add", "person:\udcff.bvh"], "--add takes texts in UTF-8"),
        (["--start-s", "9"], "trim needs 0 <= start < stop <= 1.98333 s, got 9"),
        (["--start-s", "1", "--stop-s", "0.5"], "trim needs 0 <= start < stop <= 1.98333 s, got 1.0 and 0.5"),
    ],
)
def test_options_that_are_hostile(refused: Callable[..., str], options: list[str], sentence: str) -> None:
    assert sentence in refused("simulate", "walk.bvh", *options)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("add: null", "option add cannot be null"),
        ("method: null", "option method cannot be null"),
        ("angle_deg: null", "option angle_deg cannot be null"),
        ("scene: null", "option scene cannot be null"),
        ("seed: 1\nseed: 2", "key 'seed' is given twice"),
        ("radar: {prf_hz: 1, prf_hz: 2}", "key 'prf_hz' is given twice"),
        (BOMB, "more than 20000 values"),
    ],
)
def test_configs_that_are_hostile(refused: Callable[..., str], text: str, sentence: str) -> None:
    Path("run.yaml").write_text(text)
    assert sentence in refused("simulate", "walk.bvh", "--config", "run.yaml")


def test_info_takes_no_radar_and_no_config(refused: Callable[..., str]) -> None:
    assert "unknown option --radar" in refused("info", "walk.bvh", "--radar", "table2")
    assert "unknown option --config" in refused("info", "walk.bvh", "--config", "run.yaml")


@pytest.mark.parametrize(
    "name",
    ["my, walk.bvh", "a,,b.bvh", "[x].bvh", "a: b.bvh", "'q'.bvh", "\U0001f600.bvh", "\x1b[31mred.bvh", "$x$.bvh", "&a.bvh"],
)  # fmt: skip
def test_names_of_persons_files_stand_as_they_are(name: str) -> None:
    simulate = cli._command("simulate")
    arguments = simulate.words(["walk.bvh", "--add", f"person:{name}, distance_m = 3"])
    (person,) = map(target_of, simulate.parser.parse_args(arguments).add)
    assert isinstance(person, MotionFile)
    assert person.model_dump(exclude_unset=True) == {"file": name, "distance_m": 3.0}


def test_a_stop_after_the_end_is_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = write(tmp_path, GOOD, "walk.bvh")
    whole = load_motion(path)
    person = target_of("person:walk.bvh,stop_s=3")
    assert isinstance(person, MotionFile)
    with pytest.warns(T2DWarning, match=r"the motion ends at 1.98333 s, before stop_s of 3 s; it is used to its end"):
        found = person.placed(person.read(), Radar.preset("table2"))
    assert len(found.joints) == len(whole.joints)


def test_nothing_raw_reaches_the_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    name = "\x1b]0;owned\x07\x9b31m\u202e.bvh"
    write(tmp_path, b"x", name)
    assert cli.main(["info", name]) == 2
    cli._show_warning("a\x1b[2Jb\r")
    cli.say("one\ntwo\t\x7f \u00e9")
    shown = capsys.readouterr()
    assert not set("\x1b\x07\x9b\u202e\x7f\r") & set(shown.out + shown.err)
    assert "\\x1b]0;owned\\x07" in shown.err
    assert shown.out == "one\ntwo\t\\x7f é\n"


@pytest.mark.slow
def test_a_terminal_of_few_letters(tmp_path: Path) -> None:
    path = write(tmp_path, GOOD, "é.bvh")
    program = (
        "import sys; from t2d_rt.cli import main, say; code = main(sys.argv[1:]); say('\\u00e9\\udcff'); sys.exit(code)"
    )
    for arguments, code in ((["info", str(path)], 0), (["info", str(path) + "x"], 2)):
        done = subprocess.run(
            [sys.executable, "-c", program, *arguments],
            env={**os.environ, "PYTHONIOENCODING": "ascii", "LC_ALL": "C"}, capture_output=True, timeout=60, check=False,
        )  # fmt: skip
        assert b"Traceback" not in done.stderr
        assert done.returncode == code


def test_streams_show_what_they_can(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", stream)
    assert cli.main(["--version"]) == 0
    cli.say("\u00e9")
    stream.flush()
    assert stream.buffer.getvalue().endswith(b"\\xe9\n")  # type: ignore[attr-defined]
