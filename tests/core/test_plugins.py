"""Movers, radars, readers and networks of other packages: those of docs/extend.md, as a distribution on the path."""

from __future__ import annotations

import inspect
import sys
import tomllib
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
import t2d_rt.cli
from builders import ROOT, WALK
from command_line import Command
from pages import blocks
from t2d_rt.core.errors import InputError
from t2d_rt.core.plugins import plugins

PAGE = ROOT / "docs" / "extend.md"
NETWORK = """
from torch import nn
from t2d_rt.learn.models import ModelCard

ABOUT = ModelCard(title="linear", source="the test")

def build(classes, size, channels):
    return nn.Sequential(nn.Flatten(), nn.Linear(channels * size[0] * size[1], classes))
"""
Install = Callable[..., None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """`install(name, code, group={name: what})` makes a distribution that Python finds."""

    def made(name: str, code: str, **groups: dict[str, str]) -> None:
        site = tmp_path / f"site_{name}"
        info = site / f"{name}-1.0.dist-info"
        info.mkdir(parents=True)
        (site / f"{name}.py").write_text(code)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        sections = [
            f"[t2d_rt.{group}]\n" + "".join(f"{key} = {value}\n" for key, value in entries.items())
            for group, entries in groups.items()
        ]
        (info / "entry_points.txt").write_text("\n".join(sections))
        monkeypatch.syspath_prepend(site)
        # Options name what is installed.
        monkeypatch.setattr(t2d_rt.cli, "_command", inspect.unwrap(t2d_rt.cli._command))
        monkeypatch.delitem(sys.modules, name, raising=False)

    return made


@pytest.fixture
def my_lab(install: Install) -> None:
    """The package of the page."""
    _, code = (text for _, language, text in blocks(PAGE) if language == "python")
    registered = next(text for _, _, text in blocks(PAGE, "text") if "entry-points" in text)
    groups = tomllib.loads(registered)["project"]["entry-points"]
    install("my_lab", code, **{name.removeprefix("t2d_rt."): entries for name, entries in groups.items()})


def test_the_scatterer_of_the_page_is_in_every_simulation(install: Install) -> None:
    def cube() -> np.ndarray:
        walk = t2d.trim(t2d.example("walk"), 1.0, 1.3)
        return np.asarray(t2d.simulate(walk, radar="ci4r", method="ellipsoid", seed=1).adc)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of aliasing
        before = cube()
        code, _ = (text for _, language, text in blocks(PAGE) if language == "python")
        install("my_echoes", code, scatterers={"pelvis": "my_echoes:pelvis"})
        added = cube() - before
    walk = t2d.place(t2d.trim(t2d.example("walk"), 1.0, 1.3), distance_m=None)
    range_m = np.linalg.norm(walk.joints[:, 0] - [0, 0, 1], axis=1).mean()
    level = np.sqrt(np.mean(np.abs(added) ** 2) / t2d.Radar.preset("ci4r").received_power_w(0.01, range_m))
    assert level == pytest.approx(1, abs=0.1)


def test_scatterers_of_others_are_told_and_checked(install: Install) -> None:
    def recording() -> t2d.Recording:
        walk = t2d.trim(t2d.example("walk"), 1.0, 1.3)
        return t2d.simulate(walk, radar="table2", method="ellipsoid")

    plain = recording()
    assert "scatterers" not in plain.settings
    code, _ = (text for _, language, text in blocks(PAGE) if language == "python")
    broken = "\n\ndef broken(preparation, number, times_s):\n    raise RuntimeError('boom')\n"
    broken += "\n\ndef late(preparation, number, times_s):\n    yield from pelvis(preparation, number, times_s + 1.0)\n"
    install("my_echoes", code + broken, scatterers={"pelvis": "my_echoes:pelvis"})
    assert recording().settings["scatterers"] == ["pelvis"]
    with pytest.warns(t2d.T2DWarning, match="of other packages: none; there are now: pelvis, so its samples differ"):
        t2d.run(plain)
    install("other", "from my_echoes import broken", scatterers={"broken": "my_echoes:broken"})
    with pytest.raises(InputError, match=r"the scatterers broken of another package failed \(RuntimeError: boom\)"):
        recording()
    install("last", "from my_echoes import late", scatterers={"a_late_one": "my_echoes:late"})
    with pytest.raises(InputError, match=r"a_late_one .* 1 echo or more at the frames that it was asked for"):
        recording()


@pytest.mark.usefixtures("my_lab")
def test_the_names_of_a_package_are_names_like_all_others(run: Command) -> None:
    assert "lab-60" in t2d.presets()
    assert t2d.Radar.preset("lab-60", samples=64).carrier_hz == 60e9
    assert t2d.movers()[-1] == "robot"
    told = run("list").out
    assert "A metal box that drives to and fro along x. Options: reach_m, period_s." in told
    assert "60 GHz" in told
    robot: Any = t2d.mover("robot:3,-1,0.2,reach_m=0.8")
    mesh = robot.mesh(0.0, 1.0)
    assert mesh.at(np.array([1.0]))[0, :, 0].mean() == pytest.approx(3.8, abs=1e-3)  # a quarter of its period
    joints = t2d.load_motion(WALK).joints[:60, :22]
    np.savetxt("walk.pose", joints.reshape(len(joints), -1))
    motion = t2d.load_motion("walk.pose")
    assert motion.rate_hz == 30
    assert motion.placed is False
    assert motion.origin[0].startswith("walk.pose")
    with pytest.raises(InputError, match="options of reading are not those of pose files"):
        t2d.load_motion("walk.pose", up="y")
    np.testing.assert_array_equal(t2d.load_motions("walk.pose")["1"].joints, motion.joints)


@pytest.mark.usefixtures("my_lab")
def test_a_recording_keeps_a_mover_and_makes_it_again(tmp_path: Path) -> None:
    fields = {
        "targets": [{"kind": "file", "file": str(WALK), "stop_s": 0.2}, {"kind": "robot", "position_m": [3, -1, 0.2]}],
        "radar": t2d.Radar.preset("lab-60", prf_hz=2000, samples=32), "method": "ellipsoid",
    }  # fmt: skip
    experiment = t2d.Experiment(**fields)
    assert t2d.Experiment.model_validate_json(experiment.model_dump_json()) == experiment
    recording = t2d.run(experiment)
    recording.save(tmp_path / "robot.zarr")
    stored = t2d.Recording.load(tmp_path / "robot.zarr")
    np.testing.assert_array_equal(stored.again().cube, recording.cube)
    alone = t2d.run(t2d.Experiment(**{**fields, "targets": fields["targets"][:1]}))
    assert np.abs(recording.cube - alone.cube).max() > 0


def test_a_network_of_a_package(install: Install) -> None:
    pytest.importorskip("torch")
    from t2d_rt.learn.models import build, card, model_names

    install("my_net", NETWORK, models={"linear": "my_net", "broken": "my_net:build"})
    assert {"linear", "streaming"} <= set(model_names())
    assert card("linear").title == "linear"
    assert build("linear", 3, (16, 16)) is not None
    with pytest.raises(InputError, match="the model broken of another package must have ABOUT, a ModelCard, and build"):
        card("broken")


@pytest.mark.parametrize("group", ["radars", "movers", "readers", "models"])
def test_names_that_are_taken_are_refused(install: Install, group: str) -> None:
    install("one", "thing = 1\n", **{group: {"mine": "one:thing"}})
    assert list(plugins(group, ["fan"])) == ["mine"]  # type: ignore[arg-type]
    with pytest.raises(
        InputError, match=rf"the package one adds mine to the {group}, a name that t2d-rt itself has; rename"
    ):
        plugins(group, ["mine"])  # type: ignore[arg-type]
    install("two", "thing = 1\n", **{group: {"mine": "two:thing"}})
    with pytest.raises(
        InputError, match=r"adds mine to the .*, a name that the package (one|two) has; rename or uninstall"
    ):
        plugins(group, [])  # type: ignore[arg-type]


def test_a_taken_name_stays_what_it_is_and_is_told(install: Install, refused: Callable[..., str]) -> None:
    install("other", "radar = {}\n", radars={"table2": "other:radar"}, movers={"fan": "other:radar"})
    assert t2d.Radar.preset("table2").carrier_hz == 77e9
    assert isinstance(t2d.mover("fan:2,0,1"), t2d.TableFan)
    sentence = "the package other adds table2 to the radars, a name that t2d-rt itself has"
    assert sentence in refused("simulate", "walk")
    assert sentence in refused("list", "presets")
    with pytest.raises(InputError, match="the package other adds fan to the movers"):
        t2d.movers()


def test_what_cannot_be_loaded_or_is_something_else(install: Install) -> None:
    code = (
        "value = 3\nclass Robot: ...\ndef read(path):\n    return value\n"
        "def fail(path):\n    raise ValueError('odd line 7')\n"
    )
    install(
        "odd", code, radars={"gone": "nowhere:radar", "three": "odd:value"}, readers={"odd": "odd:read", "bad": "odd:fail"},
        movers={"robot": "odd:Robot"},
    )  # fmt: skip
    with pytest.raises(
        InputError, match=r"gone of the package odd cannot be loaded \(No module named 'nowhere'\); repair"
    ):
        t2d.Radar.preset("gone")
    with pytest.raises(
        InputError, match="the radar three of another package must be a Radar or a mapping of its fields, got 3"
    ):
        t2d.Radar.preset("three")
    with pytest.raises(InputError, match="what the reader returns must be a Motion, got 3"):
        t2d.load_motion("a.odd")
    with pytest.raises(
        InputError, match=r"a\.bad cannot be read by the reader of bad files \(odd line 7\); check both"
    ):
        t2d.load_motion("a.bad")
    with pytest.raises(InputError, match="the mover robot of another package must be a class on OwnMover"):
        t2d.mover("robot:1,2,0")


def test_a_broken_mover_stops_nothing_but_itself(install: Install, run: Command) -> None:
    install("odd", "class Robot: ...\n", movers={"robot": "odd:Robot", "gone": "nowhere:Gone", "crane": "odd:Robot"})
    source = {"kind": "segments_of_mine", "position_m": [3, 0, 0]}
    with pytest.raises(InputError, match="segments_of_mine"):  # not what is wrong with the packages
        t2d.Experiment(targets=[source])
    with pytest.raises(InputError, match="unknown mover 'roboter'"):
        t2d.mover("roboter:1,2,0")
    with pytest.raises(InputError, match=r"gone of the package odd cannot be loaded"):
        t2d.mover("gone:1,2,0")
    assert t2d.movers()[-3:] == ["robot", "gone", "crane"]
    code, out, err = run("list")
    assert code == 0, err
    assert "fan" in out
    assert "  gone         gone of the package odd cannot be loaded (No module named 'nowhere'); repair" in out
    assert "the mover crane of another package must be a class on OwnMover" in out
