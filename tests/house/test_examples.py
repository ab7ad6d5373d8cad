"""What a newcomer runs: the scripts in examples/ and every command and program in the README and in docs/."""

from __future__ import annotations

import re
import runpy
import shlex
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from builders import ROOT, WALK, remember_samples
from dataset_folder import made as made_up
from measures import check_picture, nmse_db
from pages import blocks
from t2d_rt.cli import main
from t2d_rt.dataset import recipe as recipe_files
from t2d_rt.dataset import worker
from t2d_rt.dataset.recipe import Recipe
from t2d_rt.dataset.shards import MadeSample
from t2d_rt.dataset.worker import Plans
from t2d_rt.experiment import catalog as named

pytestmark = pytest.mark.usefixtures("coarse_bodies")

FRAMES, FEW = 280, {"README": 20, "background": 100, "results-and-files": 60, "learning": 20, "view": 60}
"""Of the bundled walk, of which pages take stretches up to 2.3 s; of pages that take all of it."""
README = ROOT / "README.md"
PAGES = [README, *(path for path in sorted((ROOT / "docs").glob("*.md")) if path.stem != "index")]
SLOW = "t2d-rt plan", "t2d-rt simulate walk --start-s 2 --stop-s 2.3 --scene"
"""Commands that take a minute: `test_tolerance` and the README's commands have the same in small."""
SHORTER = {"t2d-rt train": ["--epochs", "1"], "t2d-rt dataset small-hard": ["--workers", "1"]}
"""Options that a page's command has in the tests besides: made-up samples are made in this process."""
FEWER = "descriptions_per_class: 20", "descriptions_per_class: 5"
"""Of the recipe small-hard: 80 samples of eight classes, for 320."""
REAL_SAMPLES = 2
"""Samples of data sets that are simulated; the others are made up."""


def run_program(page: Path, line: int, text: str, names: dict[str, Any]) -> None:
    """Runs a block of Python; blank lines before it, so that a failure names the page's own line."""
    exec(compile("\n" * (line - 1) + text, page.name, "exec"), names)


def commands(page: Path, line: int, text: str) -> list[tuple[str, list[str]]]:
    """The t2d-rt commands of a block, each with its place and words."""
    return [
        (f"{page.name}:{line + offset}: {each}", shlex.split(each, comments=True)[1:])
        for offset, each in enumerate(text.splitlines())
        if each.startswith("t2d-rt ")
    ]


def write_walk(path: Path, frame_count: int) -> None:
    """The first frames of the CMU walk."""
    head, frames = WALK.read_text().split("MOTION\n")
    count, interval, *lines = frames.splitlines()
    assert count.startswith("Frames:")
    text = "\n".join([f"Frames: {frame_count}", interval, *lines[:frame_count]])
    path.write_text(f"{head}MOTION\n{text}\n")


@pytest.fixture(scope="module")
def known() -> dict[tuple[str, int], MadeSample]:
    return {}


@pytest.fixture
def remembered(known: dict[tuple[str, int], MadeSample], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Pages make the same samples of a data set; those after the first ones are made up, and the small set is smaller."""
    shutil.copytree(recipe_files.FOLDER, tmp_path / "recipes")
    small = tmp_path / "recipes" / "small-hard.yaml"
    assert FEWER[0] in small.read_text()
    small.write_text(small.read_text().replace(*FEWER))
    monkeypatch.setattr(recipe_files, "FOLDER", tmp_path / "recipes")
    remember_samples(monkeypatch, known)
    make_sample = worker.make_sample

    def sample(recipe: Recipe, plans: Plans, index: int) -> MadeSample:
        if index < REAL_SAMPLES:
            return make_sample(recipe, plans, index)
        found, first = made_up(recipe, index), make_sample(recipe, plans, 0)
        for name, told in found.record["products"].items():
            told["velocity_mps"] = first.record["products"][name]["velocity_mps"]
        return found

    monkeypatch.setattr(worker, "make_sample", sample)


# --- examples -------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_activities(tmp_path: Path) -> None:
    activities = runpy.run_path(str(ROOT / "examples" / "activities.py"))["activities"]
    check_picture(activities(tmp_path, longest_s=0.2, sentences={"Sitting": "a person sits down"}))


def test_every_example_is_tested() -> None:
    assert [path.name for path in sorted((ROOT / "examples").glob("*.py"))] == [
        "activities.py", "demo.py", "from_clean_to_measured.py", "point_cloud.py", "room_interference.py",
    ]  # fmt: skip


@pytest.mark.slow
def test_from_clean_to_measured(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    steps = runpy.run_path(str(ROOT / "examples" / "from_clean_to_measured.py"))["steps"]
    check_picture(steps(tmp_path, duration_s=0.3))
    assert "over all noise of the receiver" in capsys.readouterr().out


@pytest.mark.slow
def test_room_interference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recordings = runpy.run_path(str(ROOT / "examples" / "room_interference.py"))["recordings"]
    pictures = recordings("empty_room", "fan:3,-1,1,rpm=300", tmp_path / "out", duration_s=0.1)
    assert [path.name for path in pictures] == ["walk_alone.png", "walk_empty_room.png", "walk_empty_room_others.png"]
    for path in pictures:
        check_picture(path)
    alone, room, others = (float(line.split(": ")[1].split()[0]) for line in capsys.readouterr().out.splitlines())
    assert alone == 0
    assert 0 < room < others


@pytest.mark.slow
def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    demo = runpy.run_path(str(ROOT / "examples" / "demo.py"))["demo"]
    pictures = demo("12_01_walk.bvh", tmp_path / "new" / "out", duration_s=0.2)
    assert [path.name for path in pictures] == [
        "12_01_walk_ellipsoid.png", "12_01_walk_mesh.png", "12_01_walk_compare.png"
    ]  # fmt: skip
    assert sorted(path.name for path in (tmp_path / "new" / "out").iterdir()) == sorted(p.name for p in pictures)
    for path in pictures:
        check_picture(path)
    assert len({path.read_bytes() for path in pictures}) == 3
    printed = capsys.readouterr().out
    assert "flavour cmu-a" in printed
    assert "mesh: 0.2 s of radar data in" in printed
    assert "torso speed [m/s]" in printed


def test_demo_is_a_script_too(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["demo.py", "--help"])
    with pytest.raises(SystemExit) as stop:
        runpy.run_path(str(ROOT / "examples" / "demo.py"), run_name="__main__")
    assert stop.value.code == 0
    assert "--motion" in capsys.readouterr().out


@pytest.mark.slow
def test_point_cloud(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    detections = runpy.run_path(str(ROOT / "examples" / "point_cloud.py"))["detections"]
    picture = detections("array-3x4", tmp_path / "out", duration_s=0.2)
    assert picture.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    nearest, farthest = map(float, re.findall(r"[\d.]+(?= to| m$)", capsys.readouterr().out.splitlines()[-1]))
    assert 4 < nearest < farthest < 7  # the body's, and no other


# --- README and docs ------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("remembered")
@pytest.mark.filterwarnings("ignore::t2d_rt.core.errors.T2DWarning")  # coarse bodies miss tolerances, a walk may alias
@pytest.mark.parametrize(
    "page",
    [pytest.param(each, id=each.stem, marks=[pytest.mark.slow] * (each != README)) for each in PAGES if blocks(each)],
)
def test_pages_run_from_top_to_bottom(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In an empty folder, each block as it stands, but that the bundled walk and trainings are shorter."""
    bundled = tmp_path / "bundled" / WALK.name
    bundled.parent.mkdir()
    write_walk(bundled, FEW.get(page.stem, FRAMES))
    path_of = named._example_path
    monkeypatch.setattr(named, "_example_path", lambda name: bundled if name == "walk" else path_of(name))
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    names: dict[str, Any] = {}
    for line, language, text in blocks(page):
        if language == "python":
            run_program(page, line, text, names)
            continue
        for place, words in commands(page, line, text):
            if place.partition(": ")[2].startswith(SLOW):
                continue
            into = re.search(r"> (\S+)$", place)
            if "predict walk.zarr" in place:  # half of the model's window at least
                t2d.simulate(t2d.trim(t2d.load_motion(WALK), 1.0, 4.0), method="ellipsoid").save(
                    "walk.zarr", overwrite=True
                )
            besides = [option for start, options in SHORTER.items() if f": {start}" in place for option in options]
            try:
                status: Any = main([*(words[:-2] if into else words), *besides])
            except SystemExit as stop:  # --print_config
                status = stop.code
            told = capsys.readouterr()
            assert status == 0, f"{place}: {told.err}"
            if into:
                Path(into[1]).write_text(told.out)
    if page == README:
        check_picture(Path("walk.png"))
        again, made = t2d.Recording.load("again.zarr"), names["recording"]
        assert np.array_equal(again.cube, made.cube)
        assert np.array_equal(again.spectrogram, made.spectrogram)
        assert nmse_db(names["finer"].cube, made.cube) < -3  # the same walk


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_is_not_run_needs_what_a_clone_does_not_have(page: Path) -> None:
    """Commands in blocks that no test runs take recordings or packages of one's own, an endpoint, or hours."""
    needs = r"lab-60|recordings|parrad|NAME|twins|hard|bench|held_out|one,two"
    for line, language, text in blocks(page, r"\w*"):
        assert language in ("python", "sh", "text", "yaml"), f"{page.name}:{line}"
        if language == "text":
            for command in re.findall("^t2d-rt .*", text, re.MULTILINE):
                assert re.search(needs, command), f"{page.name}:{line}: {command}"


@pytest.mark.parametrize("page", [ROOT / "scenes" / "README.md", *PAGES], ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    targets = re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8"))
    assert targets or page != README
    missing = [target for target in targets if "://" not in target and not (page.parent / target).exists()]
    assert not missing


@pytest.mark.parametrize(
    "page", [ROOT / "scenes" / "README.md", ROOT / "docs" / "rooms.md"], ids=lambda page: page.stem
)
def test_sizes_of_rooms_are_those_of_their_files(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    told = dict(re.findall(r"^\| `(\w+)` \| ([\d.]+ x [\d.]+ x [\d.]+) \|", text, re.MULTILINE))
    assert set(told) == set(t2d.scenes()) - {"free_space"}
    for name, size in told.items():
        low, high = t2d.load_scene(name).bounds_m
        assert [float(x) for x in size.split(" x ")] == pytest.approx((high - low).tolist(), abs=0.01)
