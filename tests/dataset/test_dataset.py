"""Data sets: shards that are the same whoever makes them and however often they are stopped; what is told when that cannot be."""

from __future__ import annotations

import concurrent.futures
import errno
import gc
import json
import logging
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from builders import remember_samples, within
from t2d_rt.cli import main
from t2d_rt.core.errors import InputError
from t2d_rt.dataset import (
    Dataset,
    Recipe,
    check_dataset,
    export_dataset,
    make_dataset,
    making,
    read_shards,
    shards,
    worker,
)
from t2d_rt.dataset.lock import LOCK, locked
from t2d_rt.dataset.making import on_a_cluster
from t2d_rt.dataset.shards import MadeSample
from t2d_rt.dataset.worker import make_plan, make_sample, make_samples, shown_sample, view
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.types import Accuracy

TINY = """
about: Four short samples of two classes.
classes: [bending, jumping]
descriptions_per_class: 2
samples_per_description: 1
radar: {carrier_hz: 24.0e9, slope_hz_per_s: 46.397e12, sample_rate_hz: 6.847e6, samples: 256, prf_hz: 1280}
heights_m: [0.9, 1.1]
gait_factors: [0.9, 1.1]
conditions: [{name: ellipsoids, method: ellipsoid}]
duration_s: 0.8
attempts: 1
products:
  spectrogram: {size: [16, 12]}
  range_doppler: {frames: 2, size: [8, 8], dtype: uint8}
  points: {frame_chirps: 64}
error_fraction: 0.5
samples_per_shard: 3
"""


def tiny(**changes: Any) -> Recipe:
    import yaml

    return Recipe(**{"name": "tiny", **yaml.safe_load(TINY), **changes})


def words(folder: Path, *options: str) -> list[str]:
    """Of the command that makes the data set of a recipe's file."""
    (folder / "tiny.yaml").write_text(TINY)
    return ["dataset", str(folder / "tiny.yaml"), "-o", str(folder / "out"), *options]


def contents(folder: Path) -> dict[str, bytes]:
    """All files of a data set but its logs."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.parent.name != "log"]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def known() -> dict[tuple[str, int], MadeSample]:
    return {}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, known: dict[tuple[str, int], MadeSample]) -> Path:
    folder = tmp_path_factory.mktemp("made") / "tiny"
    with pytest.MonkeyPatch.context() as patch:
        remember_samples(patch, known)
        outcome = make_dataset(tiny(), folder, workers=1)
    assert len(known) == 4
    assert (outcome.samples, outcome.made, outcome.failures) == (4, 4, ())
    return folder


@pytest.fixture
def copy(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "copy"))


@pytest.fixture
def remembered(made: Path, known: dict[tuple[str, int], MadeSample], monkeypatch: pytest.MonkeyPatch) -> None:
    """Samples are those of `made`, for tests of what becomes of them; the first tests check that they are the same bits anew."""
    remember_samples(monkeypatch, known)


def test_records_and_arrays(made: Path) -> None:
    assert set(contents(made)) == {
        "recipe.yaml", "plans.json", "manifest.json", "shards/00000.npz", "shards/00000.jsonl", "shards/00001.npz",
        "shards/00001.jsonl",
    }  # fmt: skip
    shards = list(read_shards(made))
    assert [len(each.records) for each in shards] == [3, 1]
    found = [each for shard in shards for each in shard.samples()]
    assert [record["index"] for record, _ in found] == [0, 1, 2, 3]
    assert [record["class"] for record, _ in found] == ["bending", "jumping"] * 2
    for record, arrays in found:
        assert record["failure"] is None
        assert record["snr_db"] > 0
        assert record["duration_s"] == pytest.approx(0.8, rel=1e-3)
        assert record["sources"][0].startswith(f"made for {record['sentence']!r}")
        assert arrays["spectrogram"].shape == (16, 12)
        assert arrays["spectrogram"].dtype == np.float16
        assert arrays["spectrogram"].max() == 0.0
        assert arrays["range_doppler"].shape == (2, 8, 8)
        assert arrays["range_doppler"].max() == 255
        assert arrays["points"].shape == (record["products"]["points"]["count"], 6)
    assert {record["error_db"] is None for record, _ in found} == {True, False}
    assert check_dataset(made) == []
    assert json.loads((made / "manifest.json").read_bytes())["samples"] == 4


def test_a_sample_alone_has_the_same_bits(made: Path) -> None:
    alone = make_sample(tiny(), {}, 2)
    ((record, arrays),) = [each for shard in read_shards(made) for each in shard.samples() if each[0]["index"] == 2]
    assert {**alone.record, "row": record["row"]} == record
    for name, array in arrays.items():
        np.testing.assert_array_equal(alone.arrays[name], array)


@pytest.mark.filterwarnings("ignore:top speed")
def test_the_yaml_of_a_sample_runs_alone_to_the_same_bits(made: Path, tmp_path: Path, capsys: Any) -> None:
    recipe, sample = tmp_path / "tiny.yaml", tmp_path / "sample.yaml"
    recipe.write_text(TINY)
    assert main(["dataset", "show", str(recipe), "3"]) == 0
    sample.write_text(capsys.readouterr().out)
    experiment = Experiment.from_yaml(sample)
    recording = t2d.run(experiment)
    arrays, _ = tiny().products.made(recording, view(recording, tiny(), 3))
    ((record, kept),) = [each for shard in read_shards(made) for each in shard.samples() if each[0]["index"] == 3]
    assert experiment.hash == record["experiment"]
    for name, array in kept.items():
        np.testing.assert_array_equal(arrays[name], array)


def test_the_plan_of_a_sample_that_is_shown_is_made_where_those_of_data_sets_are() -> None:
    import yaml

    planned = tiny(conditions=[{"name": "mesh", "tolerance_db": -15}], classes=["jumping"])
    asked = []

    def elsewhere(work: Any, tasks: Any) -> list[tuple[str, str]]:
        asked.extend((work, *task[1:]) for task in tasks)
        return [("jumping/mesh", Accuracy(surface_rate_hz=123.0).model_dump_json())]

    text = shown_sample(planned, 1, elsewhere)
    assert asked == [(make_plan, "jumping/mesh", list(range(planned.samples)), 1)]
    assert yaml.safe_load(text)["accuracy"]["surface_rate_hz"] == 123.0


def test_two_workers_and_other_batches_make_the_same_files(made: Path, tmp_path: Path) -> None:
    make_dataset(tiny(), tmp_path / "two", workers=2)
    assert contents(tmp_path / "two") == contents(made)


@pytest.mark.slow
def test_a_cluster_makes_the_same_files(made: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    make_dataset(tiny(), tmp_path / "cluster", scheduler="local:1")
    assert contents(tmp_path / "cluster") == contents(made)


@pytest.mark.usefixtures("remembered")
def test_a_smaller_run_is_completed_by_a_larger_one(made: Path, tmp_path: Path) -> None:
    assert make_dataset(tiny(), tmp_path / "out", workers=1, limit=2).made == 2
    assert json.loads((tmp_path / "out/manifest.json").read_bytes())["samples"] == 2
    assert make_dataset(tiny(), tmp_path / "out", workers=1).made == 4  # the shard that was begun is made anew
    assert contents(tmp_path / "out") == contents(made)
    assert make_dataset(tiny(), tmp_path / "out", workers=1, limit=1).made == 0
    assert contents(tmp_path / "out") == contents(made)


@pytest.mark.slow
def test_a_killed_run_goes_on_where_it_stopped(made: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = [sys.executable, "-m", "t2d_rt", *words(tmp_path, "--workers", "1")]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        end = time.monotonic() + 60
        while not (out / "shards/00000.jsonl").exists() and time.monotonic() < end:
            time.sleep(0.005)
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    (out / "shards" / ".00001.npz-abc.part").write_bytes(b"half")
    assert make_dataset(tiny(), out, workers=1).made == 1
    assert contents(out) == contents(made)


@pytest.mark.usefixtures("remembered")
def test_what_is_finished_when_a_run_stops_is_not_made_again(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    """Below one shard, too; the files are the same in the end, whatever the stopped run has left."""
    out, make = tmp_path / "out", worker.make_sample

    def stopped(of: Recipe, plans: Any, index: int) -> MadeSample:
        if index == 2:
            raise KeyboardInterrupt
        return make(of, plans, index)

    monkeypatch.setattr(worker, "make_sample", stopped)
    assert main(words(tmp_path, "--workers", "1")) == 130
    assert f"stopped; 2 of 4 samples are finished and stay in {out}" in capsys.readouterr().err
    assert sorted(each.name for each in (out / "spool").iterdir()) == ["0.jsonl", "0.npz", "1.jsonl", "1.npz"]
    assert check_dataset(out) == []
    monkeypatch.setattr(worker, "make_sample", make)
    for name, damage in (("0.npz", b"half"), ("1.jsonl", b"null"), ("1.npz", None)):
        copied = shutil.copytree(out, tmp_path / name)
        (copied / "spool" / name).write_bytes(damage) if damage else (copied / "spool" / name).unlink()
        (copied / "spool" / ".7.npz.part").write_bytes(b"half")
        assert make_dataset(tiny(), copied, workers=1).made == 3
        assert contents(copied) == contents(made)
    assert make_dataset(tiny(), out, workers=1).made == 2
    (out / "spool").mkdir()
    (out / "spool" / "2.npz").write_bytes(b"of a run that was killed as it took its sample away")
    assert make_dataset(tiny(), out, workers=1).made == 0
    assert contents(out) == contents(made)
    assert not (out / "spool").exists()


@pytest.mark.slow
def test_a_lost_worker_is_one_sentence(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "t2d_rt", *words(tmp_path, "--workers", "2")]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        assert within(60, lambda: any(b"LokyProcess" in command_of(pid) for pid in descendants(process.pid)))
        for pid in descendants(process.pid):
            if b"LokyProcess" in command_of(pid):
                os.kill(pid, signal.SIGKILL)
        told = process.stderr.read() if process.stderr else ""
    assert process.returncode == 2
    assert "t2d-rt: a worker process was lost" in told
    assert "Traceback" not in told


def command_of(pid: int) -> bytes:
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    return b""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("workers", "how"),
    [
        (["--workers", "2"], signal.SIGKILL), (["--workers", "2"], signal.SIGTERM), (["--scheduler", "local:2"], signal.SIGKILL),
    ],
    ids=["joblib-SIGKILL", "joblib-SIGTERM", "dask-SIGKILL"],
)  # fmt: skip
def test_workers_end_with_the_main_process(tmp_path: Path, workers: list[str], how: signal.Signals) -> None:
    """That one alone is killed, while its workers start or work; a run after it takes over the folder."""
    if "--scheduler" in workers:
        pytest.importorskip("distributed")
    out = tmp_path / "out"
    command = [sys.executable, "-m", "t2d_rt", *words(tmp_path, *workers)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        # A tracker of resources and two workers.
        assert within(60, lambda: len(descendants(process.pid)) >= 3)
        started = descendants(process.pid)
        process.send_signal(how)
    assert within(30, lambda: not any(alive(pid) for pid in started))
    assert (out / LOCK).exists() == (how == signal.SIGKILL)
    with locked(out):
        pass


def alive(pid: int) -> bool:
    """Whether a process runs; one that nobody has waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def descendants(pid: int) -> set[int]:
    """Processes that a process has started, and those that they have started."""
    parents: dict[int, int] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parents[int(path.parent.name)] = int(path.read_text().rpartition(")")[2].split()[1])
    found, new = set[int](), {pid}
    while new:
        new = {each for each, parent in parents.items() if parent in new}
        found |= new
    return found


def fail(monkeypatch: pytest.MonkeyPatch, indices: set[int]) -> None:
    """Samples of these indices cannot be made."""
    real = worker.sample

    def some_fail(recipe: Recipe, index: int) -> Any:
        if index in indices:
            raise InputError("the person stayed at home")
        return real(recipe, index)

    monkeypatch.setattr(worker, "sample", some_fail)


def test_samples_that_fail_are_recorded(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: Any) -> None:
    fail(monkeypatch, {1})
    command = words(tmp_path, "--workers", "1")
    assert main(command) == 3
    out, err = capsys.readouterr()
    assert "sample 1 failed: the person stayed at home" in err
    assert "4 samples" in out
    records = [record for shard in read_shards(tmp_path / "out") for record in shard.records]
    assert [each["failure"] for each in records] == [None, "the person stayed at home", None, None]
    assert [each["row"] for each in records] == [0, None, 1, 0]
    assert [record["index"] for shard in read_shards(tmp_path / "out") for record, _ in shard.samples()] == [0, 2, 3]
    assert check_dataset(tmp_path / "out") == []
    assert main(command) == 3  # what is there tells, too


@pytest.mark.slow
def test_failures_of_a_larger_run_do_not_stop_a_smaller_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    fail(monkeypatch, {2, 3})
    monkeypatch.setattr(making, "MOST_FAILED", 0.5)
    assert len(make_dataset(tiny(), tmp_path / "out", workers=1).failures) == 2
    assert make_dataset(tiny(), tmp_path / "out", workers=1, limit=2).failures == ()


def test_too_many_failures_stop_the_run(tmp_path: Path) -> None:
    clips_make_no_falls = tiny(classes=["falling"], providers=["library"], descriptions_per_class=4)
    with pytest.raises(InputError, match=r"2 of 4 samples failed, more than 5%.*provider library does not make fall"):
        make_dataset(clips_make_no_falls, tmp_path / "out", workers=1)


def test_a_damaged_shard_is_found_and_not_overwritten(copy: Path) -> None:
    path = copy / "shards/00000.npz"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    before = contents(copy)
    assert any("00000.npz does not match its checksum" in each for each in check_dataset(copy))
    with pytest.raises(InputError, match=r"00000\.npz"):
        make_dataset(tiny(), copy, workers=1)
    assert contents(copy) == before
    for kind in ("npz", "jsonl"):
        (copy / f"shards/00000.{kind}").unlink()
    assert any("cannot read shard" in each and "00000.npz" in each for each in check_dataset(copy))


def test_a_manifest_counts_what_the_shards_hold(copy: Path) -> None:
    path = copy / "manifest.json"
    manifest = json.loads(path.read_text())
    for name in ("samples", "failed"):
        path.write_text(json.dumps({**manifest, name: 77}))
        (fault,) = check_dataset(copy)
        assert f"tells 77 for {name}, and the shards hold {manifest[name]}" in fault


def test_a_damaged_shard_that_is_not_in_the_manifest_yet(copy: Path) -> None:
    (copy / "manifest.json").unlink()
    records = copy / "shards/00001.jsonl"
    records.write_text(records.read_text().replace('"index": 3', '"index": 1'))
    with pytest.raises(InputError, match=r"00001\.npz is damaged .*points_1"):
        make_dataset(tiny(), copy, workers=1)


def test_another_recipe_another_folder_and_no_data_set(copy: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds samples of another recipe \(tiny, .*choose another folder"):
        make_dataset(tiny(seed=1), copy, workers=1)
    (tmp_path / "full").mkdir()
    (tmp_path / "full/letter.txt").write_text("mine")
    with pytest.raises(InputError, match="exists and is no data set"):
        make_dataset(tiny(), tmp_path / "full", workers=1)
    with pytest.raises(InputError, match="exists and is no data set"):
        make_dataset(tiny(), tmp_path / "full/letter.txt", workers=1)
    with pytest.raises(InputError, match=r"holds no recipe\.yaml"):
        check_dataset(tmp_path / "full")


def test_one_run_at_a_time(copy: Path) -> None:
    with locked(copy), pytest.raises(InputError, match=f"is being written by process {os.getpid()} on"), locked(copy):
        pass
    (copy / LOCK).write_text(json.dumps({"pid": 1, "host": "elsewhere"}))
    with pytest.raises(InputError, match="process 1 on elsewhere"), locked(copy):
        pass
    (copy / LOCK).write_text(
        json.dumps({"pid": 2**22 + 1, "host": os.uname().nodename})
    )  # gone: no process has this number
    with locked(copy):
        pass
    assert not (copy / LOCK).exists()


@pytest.mark.usefixtures("remembered")
def test_a_full_disk_leaves_nothing_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_dataset(tiny(), tmp_path / "out", workers=1, limit=3)
    before = contents(tmp_path / "out")

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match=r"cannot write .*: No space left on device; free space"):
        make_dataset(tiny(), tmp_path / "out", workers=1)
    assert contents(tmp_path / "out") == before


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"cannot make .*Not a directory"):
        make_dataset(tiny(), tmp_path / "file" / "out", workers=1)


@pytest.mark.slow
def test_one_plan_for_each_class(tmp_path: Path) -> None:
    recipe = tiny(
        conditions=[{"name": "mesh", "tolerance_db": -15}], products={"spectrogram": {"size": [8, 8]}}, classes=["jumping"],
        duration_s=0.7, error_fraction=0.0,
    )  # fmt: skip
    make_dataset(recipe, tmp_path / "out", workers=1, limit=1)
    plans = json.loads((tmp_path / "out/plans.json").read_bytes())
    assert list(plans) == ["jumping/mesh"]
    assert plans["jumping/mesh"]["sagitta_scale"] != 1.0
    assert make_dataset(recipe, tmp_path / "out", workers=1, limit=1).made == 0
    (tmp_path / "out/plans.json").write_text("{]")
    (tmp_path / "out/shards/00000.jsonl").unlink()
    with pytest.raises(InputError, match=r"plans.json cannot be read"):
        make_dataset(recipe, tmp_path / "out", workers=1, limit=1)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["dataset"], "dataset needs a recipe"),
        (["dataset", "show", "small-hard"], "dataset show takes a recipe and the index of a sample"),
        (["dataset", "show", "small-hard", "320"], "the index of a sample must be an integer in 0..319, got 320"),
        (["dataset", "check", "nowhere"], "nowhere is no data set"),
        (["dataset", "list", "--limit", "3"], "dataset list takes no --limit"),
        (["dataset", "small-hard", "out"], "dataset takes one recipe, got 2 words"),
        (["dataset", "small-hard", "--scheduler", "ray"], "scheduler must be local:N or an address"),
        (["dataset", "small-hard", "--scheduler", "tcp://"], "scheduler must be local:N or an address"),
        (["dataset", "small-hard", "--scheduler", "tcp://head"], "scheduler must be local:N or an address"),
        (["dataset", "small-hard", "--scheduler", "tcp://a b:8786"], "scheduler must be local:N or an address"),
        (["dataset", "small-hard", "--workers", "0"], "workers must be"),
    ],
)
def test_refusals(refused: Any, words: list[str], sentence: str) -> None:
    assert sentence in refused(*words)


def test_the_command_line_lists_and_checks(copy: Path, run: Any) -> None:
    code, out, _ = run("dataset", "list")
    assert code == 0
    assert "small-hard: 320 samples. The hard set for a laptop" in out
    assert run("dataset", "check", str(copy)).code == 0
    (copy / "shards/00001.npz").write_bytes(b"")
    code, out, _ = run("dataset", "check", str(copy))
    assert code == 1
    assert "00001.npz does not match its checksum" in out


def test_what_travels_to_a_worker_is_plain_text() -> None:
    (found,) = make_samples(tiny().model_dump_json(), {}, [0], 1)
    assert isinstance(found, MadeSample)
    np.testing.assert_array_equal(found.arrays["spectrogram"], make_sample(tiny(), {}, 0).arrays["spectrogram"])


def test_workers_that_grow_within_bounds_are_not_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    from joblib.externals.loky import process_executor

    # If loky calls it otherwise one day, this fails.
    monkeypatch.setattr(process_executor, "_MAX_MEMORY_LEAK_SIZE", process_executor._MAX_MEMORY_LEAK_SIZE)
    monkeypatch.setattr(gc, "freeze", lambda: None)
    worker._settle.__wrapped__()
    assert process_executor._MAX_MEMORY_LEAK_SIZE == worker.MOST_GROWTH_BYTES


def test_masks_show_nothing_where_there_is_no_background(made: Path) -> None:
    found = make_sample(tiny(masks={"windows": 40, "shortest_s": 0.05, "longest_s": 0.1}, noise="none", seed=2), {}, 0)
    windows = found.record["products"]["spectrogram"]["masks_s"]
    assert len(windows) > 20
    assert found.arrays["spectrogram"].min() == -200.0
    assert make_sample(tiny(noise="none"), {}, 0).arrays["spectrogram"].min() > -200.0


def test_samples_of_other_versions_are_warned_of(copy: Path) -> None:
    manifest = copy / "manifest.json"
    told = json.loads(manifest.read_text())
    told["versions"]["t2d-rt"] = "0.0.1"
    manifest.write_text(json.dumps(told))
    with pytest.warns(t2d.T2DWarning, match=r"begun with other versions \(t2d-rt 0.0.1\)"):
        make_dataset(tiny(), copy, workers=1)


def test_shards_of_another_place_or_with_other_labels_are_not_taken(copy: Path) -> None:
    (copy / "manifest.json").unlink()
    records = copy / "shards" / "00000.jsonl"
    text = records.read_text()
    records.write_text(text.replace('"class": "bending"', '"class": "jumping"', 1))
    with pytest.raises(InputError, match="class must be bending, got 'jumping'"):
        make_dataset(tiny(), copy, workers=1)
    records.write_text(re.sub('"sentence": "[^"]*"', '"sentence": "A man bends."', text, count=1))
    with pytest.raises(InputError, match="does not hold the samples of this recipe"):
        make_dataset(tiny(), copy, workers=1)


def test_changed_files_are_not_read_as_samples(copy: Path) -> None:
    records = copy / "shards" / "00000.jsonl"
    text = records.read_text()
    records.write_text(text.replace('"class": "bending"', '"class": "jumping"', 1))
    with pytest.raises(InputError, match="its checksum is another"):
        Dataset(copy)
    records.write_text(text)
    arrays = copy / "shards" / "00000.npz"
    arrays.write_bytes(arrays.read_bytes() + b"\0")
    with pytest.raises(InputError, match="its checksum is another"):
        Dataset(copy).array(0, "spectrogram")
    recipe = copy / "recipe.yaml"
    recipe.write_text(recipe.read_text().replace("dtype: float16", "dtype: uint8"))
    with pytest.raises(InputError, match="is not the recipe that the samples were made of"):
        Dataset(copy)


def test_a_run_goes_on_with_the_same_files_only(copy: Path) -> None:
    manifest = copy / "manifest.json"
    told = json.loads(manifest.read_text())
    assert told["inputs"] == {}
    manifest.write_text(json.dumps(told | {"inputs": {"room.xml": "0" * 64}}))
    with pytest.raises(InputError, match=r"room.xml has changed since"):
        make_dataset(tiny(), copy, workers=1)


@pytest.mark.parametrize("where", ["copy", "copy/shards", "other"])
def test_an_export_replaces_exports_alone(copy: Path, where: str) -> None:
    target = copy.parent / where
    target.mkdir(exist_ok=True)
    before = contents(copy)
    (target / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match=r"overlaps|would be lost"):
        export_dataset(copy, target, "npz", overwrite=True)
    assert (target / "thesis.tex").is_file()
    assert before.items() <= contents(copy).items()


def test_a_file_that_is_not_there_is_told_before_anything_is_made(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"recipe tiny names none.safetensors, which is no file"):
        make_dataset(tiny(background="none.safetensors"), tmp_path / "out", workers=1)
    assert not (tmp_path / "out").exists()


def test_a_background_that_fits_no_radar_is_told_before_anything_is_made(tmp_path: Path) -> None:
    slow = t2d.Radar.preset("table2-uniform", prf_hz=2000.0)
    with pytest.raises(InputError, match="background"):
        make_dataset(tiny(background="default", radar=slow), tmp_path / "set", limit=1, workers=1)
    assert not (tmp_path / "set").exists()


def test_a_background_of_another_band_is_told_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("t2d_rt.dataset.making.check_axes", lambda *_: None)
    other = t2d.Radar.preset("table2", carrier_hz=60e9)
    (tmp_path / "taken").write_text("")  # the run ends there
    with (
        pytest.warns(t2d.T2DWarning, match="was learned at .* and the recording is of 60 GHz"),
        pytest.raises(InputError, match="is no data set"),
    ):
        make_dataset(tiny(background="default", radar=other), tmp_path, workers=1)


def test_a_record_that_is_occluded_all_along_without_background_fails(made: Path) -> None:
    covered = tiny(masks={"windows": 400.0, "shortest_s": 0.5, "longest_s": 0.8})
    found = make_sample(covered, {}, 0)
    assert "occluded windows cover the whole record" in found.record["failure"]


def test_a_lock_that_vanished_as_it_was_opened_is_taken_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import fcntl

    lock = fcntl.flock
    opened: list[int] = []

    def late(file: int, how: int) -> None:
        if not opened:  # the run before ends between open and flock
            (tmp_path / LOCK).unlink()
        opened.append(file)
        lock(file, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with locked(tmp_path):
        assert len(opened) == 2
        assert json.loads((tmp_path / LOCK).read_text())["pid"] == os.getpid()
    assert not (tmp_path / LOCK).exists()


@pytest.mark.usefixtures("remembered")
@pytest.mark.parametrize("last", ["00000.npz", "00000.jsonl"])
def test_a_run_killed_as_it_replaces_a_shard_goes_on(copy: Path, monkeypatch: pytest.MonkeyPatch, last: str) -> None:
    """After its arrays there is no shard; after its records the manifest does not hold the smaller one's checksums against it."""
    before = contents(copy)
    shutil.rmtree(copy)
    make_dataset(tiny(), copy, workers=1, limit=2)
    write = shards.write_whole

    def killed(path: Path, data: bytes) -> None:
        write(path, data)
        if path.name == last and path.parent.name == "shards":
            raise KeyboardInterrupt

    monkeypatch.setattr(shards, "write_whole", killed)
    with pytest.raises(KeyboardInterrupt):
        make_dataset(tiny(), copy, workers=1)
    monkeypatch.undo()
    make_dataset(tiny(), copy, workers=1)
    assert contents(copy) == before


def test_a_scheduler_holds_few_calls_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed (extra [cluster])")
    held: list[Any] = []

    class Client:
        def __init__(self, *_: Any, **__: Any) -> None: ...

        def submit(self, _: Any, number: int, **__: Any) -> Any:
            held.append(number)
            assert len(held) <= 3
            future: Any = concurrent.futures.Future()
            future.set_result(number)
            future.release = lambda: held.remove(number)
            return future

        def close(self) -> None: ...

    class AsCompleted(list[Any]):
        add = list.append

    monkeypatch.setattr(distributed, "Client", Client)
    monkeypatch.setattr(distributed, "as_completed", AsCompleted)
    monkeypatch.setattr("t2d_rt.dataset.making.AT_ONCE", 2)
    assert list(on_a_cluster(int, [(number,) for number in range(7)], "tcp://head:8786", 0)) == list(range(7))


def test_a_lost_scheduler_is_one_sentence(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """A client whose scheduler is gone, as dask tells it: futures are cancelled, and closing is a page of traceback."""
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed (extra [cluster])")

    class Client:
        def __init__(self, *_: Any, **__: Any) -> None: ...

        def submit(self, *_: Any, **__: Any) -> Client:
            return self

        def result(self) -> None:
            raise distributed.CancelledError("make_samples", "scheduler-connection-lost")

        def close(self) -> None:
            logging.getLogger("distributed.client").error("Traceback")
            raise OSError("gone")

    monkeypatch.setattr(distributed, "Client", Client)
    monkeypatch.setattr(distributed, "as_completed", iter)
    with pytest.raises(InputError, match=r"the cluster tcp://head:8786 is lost .*; run the recipe again"):
        list(on_a_cluster(int, [()], "tcp://head:8786", 0))
    assert not caplog.records
