"""Names of presets, scenes, bodies, movers and example motions: listed, taken by `simulate`, and close ones told."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from builders import WALK
from t2d_rt.cli import main
from t2d_rt.core.errors import InputError
from t2d_rt.core.resources import listing
from t2d_rt.experiment import catalog as named

SHORT: dict[str, Any] = {"method": "ellipsoid", "seed": 1}


def test_every_listed_name_is_taken() -> None:
    assert all(isinstance(t2d.Radar.preset(name), t2d.Radar) for name in t2d.presets())
    assert all(t2d.load_scene(name).name == name for name in t2d.scenes() if name != "free_space")
    assert "free_space" in t2d.scenes()
    assert t2d.bodies() == ["adult", "child", "heavy", "man", "old", "woman"]
    assert t2d.movers() == ["fan", "ceiling_fan", "curtain", "door", "pet"]
    assert {"walk", "run"} <= set(t2d.examples())


def test_every_bundled_motion_has_a_name() -> None:
    files = [file for file in listing("motions") if not file.endswith(".txt")]
    assert sorted(file for file, _ in named.EXAMPLES.values()) == files


@pytest.mark.parametrize("name", ["walk", "12_01_walk", "12_01_walk.bvh"])
def test_an_example_is_its_file(name: str) -> None:
    np.testing.assert_array_equal(t2d.example(name).joints, t2d.load_motion(WALK).joints)


@pytest.mark.parametrize("name", list(named.EXAMPLES))
def test_all_examples_are_persons(name: str) -> None:
    motion = t2d.example(name)
    assert 1.5 < t2d.describe(motion).stature_m < 1.95
    seconds = re.search(r"(\d+(\.\d+)?) s\b", named.EXAMPLES[name][1])
    assert seconds
    assert motion.duration_s == pytest.approx(float(seconds[1]), abs=0.2)


@pytest.mark.slow
def test_simulate_takes_files_and_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    radar = t2d.Radar.preset("ci4r", prf_hz=4000)
    radar.to_yaml("mine.yaml")
    motion = t2d.trim(t2d.load_motion(WALK), 0, 0.4)
    monkeypatch.setattr(named.motion, "load_motion", lambda path: motion if path.name == WALK.name else None)
    expected = t2d.simulate(motion, radar=radar, **SHORT).cube
    file = Path("mine.yaml")
    for target, given in ((WALK, file), (str(WALK), "mine.yaml"), ("walk", file), (["walk"], file), ([WALK], file)):
        np.testing.assert_array_equal(t2d.simulate(target, radar=given, **SHORT).cube, expected)
    by_name = t2d.simulate("walk", radar="CI4R", **SHORT)
    assert by_name.radar == t2d.Radar.preset("ci4r")
    # A file goes before an example of its name.
    Path("walk").touch()
    with pytest.raises(InputError, match="target must be"):
        t2d.simulate("walk", radar="ci4r", **SHORT)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: t2d.Radar.preset("tabel2"), r"unknown radar preset 'tabel2'; did you mean table2\?"),
        (lambda: t2d.simulate("walk", radar="tabel2"), r"unknown radar preset 'tabel2'; did you mean table2\?"),
        (lambda: t2d.load_scene("livingroom"), r"unknown scene 'livingroom'; did you mean living_room\?"),
        (lambda: t2d.simulate("walk", scene="Living Room"), r"unknown scene 'Living Room'; did you mean living_room\?"),
        (lambda: t2d.simulate("walk", scene="freespace"), r"unknown scene 'freespace'; did you mean free_space\?"),
        (lambda: t2d.skin(t2d.example("walk"), body="adlut"), r"unknown body 'adlut'; did you mean adult\?"),
        (lambda: t2d.mover("ceilingfan:1,2,3"), r"unknown mover 'ceilingfan'; did you mean ceiling_fan\?"),
        (lambda: t2d.example("wlak"), r"unknown example motion 'wlak'; did you mean walk\?"),
        (lambda: t2d.example("sit"), r"unknown example motion 'sit'; choose one of walk, run"),
        (lambda: t2d.example(3), "name must be a text, got 3; examples"),  # type: ignore[arg-type]
        (
            lambda: t2d.simulate("wlak"),
            r"no motion file 'wlak' and no bundled motion of that name; did you mean walk\?",
        ),
        (lambda: t2d.simulate("nowhere.bvh"), "cannot read BVH file nowhere.bvh|cannot read .*nowhere.bvh"),
        (lambda: t2d.simulate("walk", radar="nowhere.yaml"), "cannot read radar file nowhere.yaml"),
        (lambda: t2d.plan("walk", radar=3), "radar must be a Radar, got 3"),
    ],
)
def test_close_names(call: Callable[[], Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        call()


# --- command line ---------------------------------------------------------------------------------------------------


@pytest.fixture
def run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    monkeypatch.chdir(tmp_path)

    def command(*arguments: str) -> tuple[int, str, str]:
        capsys.readouterr()
        try:
            code = main(arguments)
        except SystemExit as stop:
            code = int(stop.code or 0)
        return (code, *capsys.readouterr())

    return command


Run = Callable[..., tuple[int, str, str]]


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("presets", t2d.presets()), ("scenes", t2d.scenes()), ("bodies", t2d.bodies()), ("movers", t2d.movers()),
        ("motions", t2d.examples()),
    ],
)  # fmt: skip
def test_list(run: Run, kind: str, names: list[str]) -> None:
    code, out, err = run("list", kind)
    heading, *lines = out.splitlines()
    assert (code, heading, err) == (0, f"{kind}:", "")
    assert [line.split()[0] for line in lines] == names
    assert all(len(line.split()) > 3 for line in lines)
    assert out in run("list")[1]


def test_list_of_a_wrong_kind(run: Run) -> None:
    assert run("list", "preset") == (2, "", "t2d-rt: unknown list 'preset'; did you mean presets?\n")


@pytest.mark.slow
def test_bundled_motions_on_the_command_line(run: Run, tmp_path: Path) -> None:
    code, out, err = run("simulate", "walk", "--method", "ellipsoid", "--radar", "ci4r", "--stop-s", "0.3")
    assert code == 0, err
    assert "wrote walk.zarr and walk.png" in out
    assert t2d.Recording.load(tmp_path / "walk.zarr").settings["motion"]["file"] == "walk"
    assert "523 frames at 120 Hz" in run("info", "walk")[1]
    code, _, err = run("simulate", "jumpingjacks")
    assert code == 2
    assert "no motion file 'jumpingjacks' and no bundled motion of that name; did you mean jumping_jacks?" in err


def test_close_commands(run: Run) -> None:
    assert run("simluate", "walk") == (2, "", "t2d-rt: unknown command 'simluate'; did you mean simulate?\n")


def test_help(run: Run) -> None:
    overview = run("--help")
    assert run("help") == run("help", "help") == run("-h") == overview
    assert overview[0] == 0
    for command in ("simulate", "list", "export"):
        assert f"t2d-rt {command}" in overview[1]
        code, out, err = run("help", command)
        assert (code, err) == (0, "")
        assert out.strip() == run(command, "--help")[1].strip()
    assert run("help", "simluate")[2] == "t2d-rt: unknown command 'simluate'; did you mean simulate?\n"


def test_two_dashes_end_the_options(run: Run, tmp_path: Path) -> None:
    (tmp_path / "--odd.bvh").symlink_to(WALK)
    assert run("info", "--", "--odd.bvh")[0] == 0
    assert "stature" in run("info", "--", "--odd.bvh")[1]
    code, out, _ = run("simulate", "--seed", "3", "--print_config", "--", "--odd.bvh")
    assert code == 0
    assert "file: --odd.bvh" in out
    assert "option --seed needs a value" in run("simulate", "walk", "--seed", "--", "3")[2]
