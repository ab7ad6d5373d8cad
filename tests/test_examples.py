"""What a newcomer runs: the scripts in examples/ and every command and program in the README."""

from __future__ import annotations

import re
import runpy
import shlex
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from builders import ROOT, WALK
from measures import check_picture, nmse_db
from t2d_rt.cli import main
from t2d_rt.errors import T2DWarning

FRAMES = 40
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[tuple[int, str]]:
    """Line number and text of every fenced block of that language in the README."""
    found = re.finditer(rf"^```{language}\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)
    return [(README.count("\n", 0, match.start(1)) + 1, match[1]) for match in found]


@pytest.fixture(autouse=True)
def coarse_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of the facets: programs run as they are written, in a fraction of the time."""
    monkeypatch.setattr(import_module("t2d_rt.body.skin"), "SAGITTA_RAD", 3.0)


@pytest.fixture
def walk_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder that the README is run in: nothing but walk.bvh, the first third of a second of the CMU walk."""
    head, frames = WALK.read_text().split("MOTION\n")
    count, interval, *lines = frames.splitlines()
    assert count.startswith("Frames:")
    text = "\n".join([f"Frames: {FRAMES}", interval, *lines[:FRAMES]])
    (tmp_path / "walk.bvh").write_text(f"{head}MOTION\n{text}\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


# --- examples -------------------------------------------------------------------------------------------------------


def test_every_example_is_tested() -> None:
    assert [path.name for path in sorted((ROOT / "examples").glob("*.py"))] == [
        "demo.py",
        "point_cloud.py",
        "room_interference.py",
    ]


@pytest.mark.slow
def test_room_interference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recordings = runpy.run_path(str(ROOT / "examples" / "room_interference.py"))["recordings"]
    pictures = recordings("empty_room", "fan:3,-1,1,rpm=300", tmp_path / "out", duration_s=0.3)
    assert [path.name for path in pictures] == ["walk_alone.png", "walk_empty_room.png", "walk_empty_room_company.png"]
    for path in pictures:
        check_picture(path)
    alone, room, company = (float(line.split(": ")[1].split()[0]) for line in capsys.readouterr().out.splitlines())
    assert alone == 0
    assert 0 < room < company


@pytest.mark.slow
def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    demo = runpy.run_path(str(ROOT / "examples" / "demo.py"))["demo"]
    pictures = demo("12_01_walk.bvh", tmp_path / "new" / "out", duration_s=0.25)
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


# --- README ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_programs_of_the_readme(walk_folder: Path) -> None:
    programs = blocks("python")
    assert programs
    names: dict[str, Any] = {}
    # With a tenth of the facets no tolerance is kept, and the measured error tells.
    with pytest.warns(T2DWarning, match="misses the tolerance of -25 dB"):  # noqa: PT031
        for line, text in programs:
            # Blank lines before it, so that a failure names the README's own line.
            exec(compile("\n" * (line - 1) + text, "README.md", "exec"), names)
    saved = t2d.Recording.load(walk_folder / "walk.zarr")
    made = names["recording"]
    assert np.array_equal(saved.cube, made.cube)
    assert np.array_equal(saved.spectrogram, made.spectrogram)
    assert nmse_db(names["finer"].cube, made.cube) < -3  # the same walk


@pytest.mark.slow
def test_commands_of_the_readme(walk_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = [
        (start + offset, shlex.split(text, comments=True))
        for start, block in blocks("sh")
        for offset, text in enumerate(block.splitlines())
        if text.startswith("t2d-rt ")
    ]
    assert {words[1] for _, words in lines} >= {"simulate", "compare", "info"}
    for number, words in lines:
        assert main(words[1:]) == 0, f"README.md:{number}: {' '.join(words)}: {capsys.readouterr().err}"
    check_picture(walk_folder / "walk.png")
    assert t2d.Recording.load(walk_folder / "walk.zarr").settings["method"] == "mesh"


def test_links_of_the_readme_lead_somewhere() -> None:
    targets = re.findall(r"\]\(([^)#]+)[^)]*\)", README)
    assert targets
    missing = [target for target in targets if "://" not in target and not (ROOT / target).exists()]
    assert not missing
