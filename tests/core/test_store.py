"""What is written takes its place whole: kills, several writers, planted links, and what may be replaced."""

from __future__ import annotations

import errno
import fcntl
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from builders import ROOT
from t2d_rt.cli import main
from t2d_rt.core import atomic_write as store
from t2d_rt.core.atomic_write import replacing, settle
from t2d_rt.core.errors import InputError
from t2d_rt.core.resources import folder
from t2d_rt.recording import files as saved
from t2d_rt.recording.recording import Recording
from t2d_rt.scene import Room, save_scene
from t2d_rt.types import Radar, Scene

RADAR = Radar.preset("ci4r")
ROOM = Room(name="box", size_m=(4, 3, 2.5))

PROCESSES = multiprocessing.get_context("forkserver")  # a fork of pytest would have its threads' locks
PROCESSES.set_forkserver_preload(["xarray", "zarr", "scipy.signal", "t2d_rt.recording.recording"])


def recording(value: complex) -> Recording:
    return Recording(np.full((400, 1, 256), value, np.complex64), RADAR)


def value_of(path: Path) -> complex:
    cube = np.asarray(Recording.load(path).cube)
    assert (cube == cube[0, 0, 0]).all()
    return complex(cube[0, 0, 0])


def killed_writer(path: Path, when: str) -> None:
    """A process that overwrites `path` and its picture, and is killed at some instant of it."""
    writer = PROCESSES.Process(target=write_and_die, args=(path, when))
    writer.start()
    writer.join()
    assert writer.exitcode == -signal.SIGKILL


def write_and_die(path: Path, when: str) -> None:
    rename, move = Path.rename, Path.replace

    def killing_rename(source: Path, target: Path) -> Path:
        if when == ("before" if source == path else "between"):
            os.kill(os.getpid(), signal.SIGKILL)
        return rename(source, target)

    def killing_replace(source: Path, target: Path) -> Path:
        if when == "after" and target == path.with_suffix(".png"):
            os.kill(os.getpid(), signal.SIGKILL)
        return move(source, target)

    Path.rename, Path.replace = killing_rename, killing_replace  # type: ignore[method-assign]
    recording(2).save(path, overwrite=True, figure=Drawing())  # type: ignore[arg-type]


class Drawing:
    def savefig(self, path: Path) -> None:
        path.write_text("new")


def names(path: Path) -> list[str]:
    return sorted(entry.name for entry in path.iterdir())


# --- kills ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_old_result_comes_back_after_a_kill_between_the_renames(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    recording(1).save(path)
    path.with_suffix(".png").write_text("old")
    killed_writer(path, "between")
    assert not path.exists()  # it lies in the dead process's folder
    assert value_of(path) == 1
    assert names(tmp_path) == ["a.png", "a.zarr"]
    assert path.with_suffix(".png").read_text() == "old"


@pytest.mark.slow
def test_a_kill_before_the_renames_leaves_the_old(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.zarr"
    recording(1).save(path)
    killed_writer(path, "before")
    assert value_of(path) == 1
    assert len(names(tmp_path)) == 2
    assert main(["info", str(path)]) == 0
    assert names(tmp_path) == ["a.zarr"]  # no picture without its result
    killed_writer(path, "before")
    with pytest.raises(InputError, match="exists already"):
        recording(3).save(path)
    assert names(tmp_path) == ["a.zarr"]


def test_the_picture_follows_its_result_after_a_kill(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    recording(1).save(path)
    path.with_suffix(".png").write_text("old")
    killed_writer(path, "after")
    assert value_of(path) == 2
    settle(path)
    assert names(tmp_path) == ["a.png", "a.zarr"]
    assert path.with_suffix(".png").read_text() == "new"


def test_what_the_user_moved_away_does_not_come_back(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    recording(1).save(path)
    killed_writer(path, "after")
    path.rename(tmp_path / "b.zarr")
    settle(path)
    assert names(tmp_path) == ["b.zarr"]


@pytest.mark.parametrize("amidst_a_print", [False, True])
def test_sigterm_tidies_up(tmp_path: Path, amidst_a_print: bool) -> None:
    code = (
        "import os, sys, time\nfrom t2d_rt import cli\nfrom t2d_rt.core.atomic_write import replacing\nfrom pathlib import Path\n"
        "class Printing:\n"
        "    def flush(self): raise RuntimeError('reentrant call')\n"
        "def run(_):\n"
        "    with replacing(Path('a.png'), lambda: None) as new:\n"
        f"        sys.stdout = Printing() if {amidst_a_print} else sys.stdout\n"
        "        new.touch(); os.write(1, b'ready\\n'); time.sleep(60)\n"
        "cli._run = run\nsys.exit(cli.main(['simulate']))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert process.stdout.readline() == "ready\n"
    process.terminate()
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (143, "t2d-rt: stopped; nothing was written\n")
    assert names(tmp_path) == []


def test_ctrl_c_after_the_move_says_what_was_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    def run(_: list[str]) -> int:
        monkeypatch.setattr(store, "_remove", interrupted)
        recording(1).save(tmp_path / "a.zarr")
        return 0

    monkeypatch.setattr("t2d_rt.cli._run", run)
    assert main(["simulate"]) == 130
    assert capsys.readouterr().err == f"t2d-rt: stopped; {tmp_path}/a.zarr was written\n"
    assert value_of(tmp_path / "a.zarr") == 1


# --- several writers ------------------------------------------------------------------------------------------------


def test_the_second_of_two_writers_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    check = partial(saved.check_replaceable, path, overwrite=False)

    def write_slowly() -> None:
        with replacing(path, check) as slow:
            recording(1)._write(slow)
            recording(2).save(path)

    with pytest.raises(InputError, match=r"another process has changed the place meanwhile: .* exists already"):
        write_slowly()
    assert value_of(path) == 2
    with replacing(path, partial(saved.check_replaceable, path, overwrite=True)) as slow:
        recording(3)._write(slow)
        recording(4).save(path, overwrite=True)
        assert value_of(path) == 4
    assert value_of(path) == 3  # the last one to be done
    assert names(tmp_path) == ["a.zarr"]


@pytest.mark.slow
@pytest.mark.parametrize("overwrite", [False, True])
def test_writers_at_the_same_time(tmp_path: Path, overwrite: bool) -> None:
    path = tmp_path / "a.zarr"
    if overwrite:
        recording(9).save(path)
    start = PROCESSES.Event()
    pipes = [PROCESSES.Pipe(duplex=False) for _ in range(3)]
    writers = [
        PROCESSES.Process(target=write_when, args=(start, path, value, overwrite, pipe[1]))
        for value, pipe in enumerate(pipes, 1)
    ]
    for writer in writers:
        writer.start()
    start.set()
    results = [pipe[0].recv() for pipe in pipes]
    for writer in writers:
        writer.join()
    written = [value for value, error in enumerate(results, 1) if error is None]
    assert value_of(path) in written
    assert len(written) == 3 if overwrite else len(written) == 1
    assert all("exists already" in error for error in results if error is not None)
    assert names(tmp_path) == ["a.zarr"]


def write_when(start: Any, path: Path, value: int, overwrite: bool, pipe: Any) -> None:
    result = recording(value)
    start.wait()
    try:
        result.save(path, overwrite=overwrite)
        pipe.send(None)
    except InputError as error:
        pipe.send(str(error))


def test_planted_names_do_not_lead_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, precious = tmp_path / "a.zarr", tmp_path / "precious"
    precious.mkdir()
    (precious / "thesis.txt").write_text("dear to somebody")
    monkeypatch.setattr(tempfile, "_get_candidate_names", lambda: iter(["aaaaaaaa", "bbbbbbbb", "cccccccc"]))
    (tmp_path / ".a.zarr.partial").symlink_to(precious)
    (tmp_path / ".a.zarr.partial-aaaaaaaa").symlink_to(precious)
    shutil.copytree(precious, tmp_path / ".a.zarr.partial-bbbbbbbb")  # somebody else's: it has no lock of ours
    recording(1).save(path)
    assert value_of(path) == 1
    assert names(precious) == ["thesis.txt"]
    assert names(tmp_path / ".a.zarr.partial-bbbbbbbb") == ["thesis.txt"]
    assert not (tmp_path / ".a.zarr.partial-cccccccc").exists()


def test_only_what_dead_processes_left_is_cleared(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    dead, alive, unborn = (tmp_path / f".a.zarr.partial-{letter * 8}" for letter in "xyz")
    for left in (dead, alive):
        (left / "new").mkdir(parents=True)
        (left / "new" / "a.png").touch()
        (left / "lock").touch()
    unborn.mkdir()  # killed before its lock was made
    with (alive / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        recording(1).save(path)
        assert names(tmp_path) == [alive.name, "a.zarr"]
    settle(path)
    assert names(tmp_path) == ["a.png", "a.zarr"]


def test_a_lock_that_is_never_let_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "WAIT_S", 0.05)
    place = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(place, fcntl.LOCK_EX)
    try:
        with pytest.raises(InputError, match=r"another process has held the lock of .* for 0.05 s"):
            recording(1).save(tmp_path / "a.zarr")
    finally:
        os.close(place)
    assert names(tmp_path) == []


# --- what is replaced -----------------------------------------------------------------------------------------------


def test_only_results_are_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    group = zarr.open_group(path, mode="w", attributes={"format": "2", "title": "ten years of rainfall"})
    group.create_array("adc", shape=(3,), dtype="f8")[:] = 1.0
    with pytest.raises(InputError, match="is a folder but not a result, so it is not replaced"):
        recording(1).save(path, overwrite=True)
    assert zarr.open_group(path)["adc"][:].tolist() == [1, 1, 1]
    shutil.rmtree(path)
    recording(1).save(path)
    (path / "notes.txt").write_text("dear to somebody")
    with pytest.raises(InputError, match=r"is not replaced, for it holds notes.txt besides a result"):
        recording(2).save(path, overwrite=True)
    (path / "notes.txt").unlink()
    metadata = json.loads((path / "zarr.json").read_text())  # as results were marked before
    attributes = {**metadata["attributes"], "format": "2"}
    del attributes["made_by"]
    (path / "zarr.json").write_text(json.dumps({**metadata, "attributes": attributes}))
    with pytest.raises(InputError, match="has format 2, expected 4; simulate it again"):
        Recording.load(path)
    recording(3).save(path, overwrite=True)
    assert value_of(path) == 3


def test_the_picture_goes_with_the_result(tmp_path: Path) -> None:
    class Full:
        def savefig(self, _: Path) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

    class Bad:
        def savefig(self, path: Path) -> None:
            path.write_text("half")
            raise ValueError("unknown symbol: \\walk")

    path, picture = tmp_path / "a.zarr", tmp_path / "a.png"
    with pytest.raises(InputError, match=r"cannot write .*a.zarr: No space left on device"):
        recording(1).save(path, figure=Full())  # type: ignore[arg-type]
    assert names(tmp_path) == []
    with pytest.raises(ValueError, match="unknown symbol"):
        recording(1).save(path, figure=Bad())  # type: ignore[arg-type]
    assert names(tmp_path) == []
    recording(1).save(path)
    picture.write_text("somebody's")
    with pytest.raises(InputError, match="exists already"):
        recording(2).save(tmp_path / "b" / ".." / "a.zarr", figure=recording(2).plot())
    recording(2).save(path, overwrite=True, figure=recording(2).plot("a point"))
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert value_of(path) == 2


def test_only_a_scene_of_our_own_is_replaced(tmp_path: Path) -> None:
    room, path = ROOM.scene(), tmp_path / "box"
    save_scene(room, path)
    save_scene(room, path)
    shutil.copytree(folder("scenes") / "corridor", tmp_path / "older")
    save_scene(room, tmp_path / "older")  # from before the mark
    assert [file.name for file in (tmp_path / "older").iterdir() if file.is_file()] == ["box.xml"]
    (path / "meshes" / "thesis.txt").write_text("dear to somebody")
    with pytest.raises(InputError, match=r"is not replaced, for it holds thesis.txt besides a scene"):
        save_scene(room, path)
    other = tmp_path / "other"
    (other / "meshes").mkdir(parents=True)
    (other / "meshes" / "wall.ply").touch()
    (other / "box.xml").write_text('<scene version="2.1.0">\n<bsdf type="twosided" id="mat-wall-3um"/></scene>')
    before = [*tmp_path.rglob("*")]
    for place in (other, other / "box.xml", other / "meshes"):
        with pytest.raises(InputError, match="exists and holds no scene that t2d-rt wrote"):
            save_scene(room, place)
    assert [*tmp_path.rglob("*")] == before


def test_scene_files_keep_apart_and_in_their_folder(tmp_path: Path) -> None:
    wall = ROOM.scene().surfaces[0]
    alike = (replace(wall, name="a wall"), replace(wall, name="a-wall"))
    with pytest.raises(InputError, match=r"two surfaces would both be written to a-wall.ply \('a-wall'\); rename one"):
        save_scene(Scene(name="box", surfaces=alike), tmp_path / "box")
    with pytest.raises(InputError, match=r"'../box' cannot be the name of a file"):
        save_scene(Scene(name="../box", surfaces=(wall,)), tmp_path / "box")
    with pytest.raises(InputError, match="folder must be a path"):
        save_scene(ROOM.scene(), 3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="scene must be a Scene"):
        save_scene("box", tmp_path / "box")  # type: ignore[arg-type]
    assert names(tmp_path) == []
