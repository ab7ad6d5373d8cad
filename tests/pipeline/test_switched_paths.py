"""Path pairs switched on and off by name: parts that add up, wrong names, reruns; and the levels of the table."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from builders import WALK, ball, slow_after, small_room, walk
from t2d_rt.cli import main
from t2d_rt.core.errors import InputError

RADAR = t2d.Radar.preset("ci4r", samples=128, prf_hz=4500.0)


def recorded(targets: Any, **options: Any) -> t2d.Recording:
    return t2d.simulate(
        targets, **{"radar": RADAR, "scene": small_room(), "clutter": "none", **options}
    )  # fmt: skip


def energy_db(cube: np.ndarray) -> float:
    return float(10 * np.log10((np.abs(np.asarray(cube, np.complex128)) ** 2).sum()))


def piece() -> t2d.Motion:
    return t2d.place(t2d.trim(walk(), 0.0, 0.1), distance_m=3.0)


TARGETS: dict[str, Any] = {
    "ellipsoids": lambda: ([piece()], {"method": "ellipsoid"}),
    "two balls and an array": lambda: (
        [ball((3.0, 0.0, 1.0), (-1.0, 0.2, 0.0)), ball((4.0, 0.8, 1.2), (1.0, 0.0, 0.0))],
        {"radar": t2d.Radar.preset("ci4r", samples=128, prf_hz=4500.0, rx_offsets_m=[[0.0, 0.002, 0.0], [0.0, -0.002, 0.0]])},
    ),
    "mesh and fan": lambda: ([piece(), t2d.TableFan(position_m=(2.5, 0.8, 1.0), rpm=300)], {}),
}  # fmt: skip


@pytest.fixture(scope="module", params=slow_after(2, list(TARGETS)))
def whole(request: pytest.FixtureRequest) -> tuple[t2d.Recording, Any, dict[str, Any]]:
    targets, options = TARGETS[request.param]()
    return recorded(targets, **options), targets, options


def test_a_path_and_all_without_it_add_up_to_the_whole(whole: tuple[t2d.Recording, Any, dict[str, Any]]) -> None:
    everything, targets, options = whole
    pairs = everything.settings["pairs"]
    assert len(pairs) > 4
    for names in (["direct, floor"], ["*left*"]) if "method" in options else (["*left*"],):
        alone = recorded(targets, only_paths=names, **options)
        others = recorded(targets, without_paths=names, **options)
        assert set(alone.settings["pairs"]) | set(others.settings["pairs"]) == set(pairs)
        assert not set(alone.settings["pairs"]) & set(others.settings["pairs"])
        rest = everything.cube - (alone.cube + others.cube)
        assert energy_db(alone.cube) - energy_db(everything.cube) > -75
        assert energy_db(rest) - energy_db(everything.cube) < -100
        assert energy_db(rest) - energy_db(alone.cube) < -60
    assert alone.paths_at(0.0).pair.values.tolist() == alone.settings["pairs"]


def test_a_level_of_the_table_is_what_a_sphere_returns() -> None:
    """A sphere of 5 cm, pi a^2: over the pair alone, the power in a sample is the table's level plus its RCS."""
    times_s = np.linspace(0.0, 0.05, 5)
    centres = np.tile([3.0, 0.3, 1.1], (5, 1, 1))
    sphere = t2d.Ellipsoids(np.full((1, 3), 0.05), centres, times_s, material="pec")
    for name in ("direct", "left", "direct, left", "direct, floor"):
        recording = recorded(sphere, only_paths=[name])
        paths = recording.paths_at(0.0)
        (level,) = paths.level_dbm.values.ravel()
        power_dbm = 10 * np.log10(np.mean(np.abs(recording.cube) ** 2)) + 30
        # The echo comes from the sphere's front, up to 5 cm nearer than its centre: (R / (R - a))^2.
        assert power_dbm == pytest.approx(level + 10 * np.log10(np.pi * 0.05**2) + 0.1, abs=0.1), name


def test_switched_paths_are_recorded_and_made_again(tmp_path: Path) -> None:
    first = recorded(piece(), method="ellipsoid", only_paths=["direct", "*floor*"], without_paths=["floor"])
    assert first.experiment.only_paths == ("direct", "*floor*")
    assert first.experiment.without_paths == ("floor",)
    assert first.settings["pairs"] == ["direct", "direct, floor", *first.settings["pairs"][2:]]
    first.save(tmp_path / "some.zarr")
    again = t2d.Recording.load(tmp_path / "some.zarr").again()
    assert np.array_equal(again.cube, first.cube)
    assert again.settings["pairs"] == first.settings["pairs"]
    plain = recorded(piece(), method="ellipsoid").experiment
    assert plain.hash != first.experiment.hash
    # Experiments of before have no such fields, and the same hash.
    older = plain.model_dump(mode="json", exclude={"only_paths", "without_paths"})
    assert t2d.Experiment.model_validate(older).hash == plain.hash


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"only_paths": ["direct, flor"]}, r"only_paths: unknown path pair 'direct, flor'; did you mean direct, floor\?"),
        ({"without_paths": ["stairs"]}, "without_paths: unknown path pair 'stairs'; choose one of direct; direct, left"),
        ({"only_paths": ["*wall*"]}, r"only_paths: unknown path pair '\*wall\*'"),
        ({"only_paths": ["direct"], "without_paths": ["d*"]}, "leave no path pair, and so no echo; keep one of direct"),
        ({"only_paths": []}, "only_paths is empty; give at least one"),
        ({"only_paths": "direct"}, "only_paths must be a list of names of path pairs, as in \\[direct\\], got 'direct'"),
        ({"without_paths": [1]}, "without_paths must be a list of names of path pairs"),
        ({"without_paths": None}, "without_paths must be a list of names of path pairs"),
        ({"only_paths": ["floor"], "accuracy": {"dynamic_range_db": 1.0}}, "too weak to be modelled; name others, or model weaker"),
        ({"only_paths": ["floor"], "measure_error": True}, "give measure_error=False beside only_paths and without_paths"),
        ({"only_paths": ["floor"], "scene": "free_space"}, "unknown path pair 'floor'; choose one of direct"),
        ({"without_paths": ["direct"], "scene": "free_space"}, "leave no path pair, and so no echo"),
    ],
)  # fmt: skip
def test_what_cannot_be_switched_is_told(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        recorded(ball((3.0, 0.0, 1.0)), **options)


def test_the_direct_path_alone_in_free_space_changes_nothing() -> None:
    same = [
        recorded(ball((3.0, 0.0, 1.0)), scene="free_space", **more).cube for more in ({}, {"only_paths": ["direct"]})
    ]
    assert np.array_equal(*same)


def test_a_tolerance_is_that_of_all_paths() -> None:
    """The accuracy is chosen as if none were off, for a plan and for a run; its error is not measured."""
    options: dict[str, Any] = {"radar": RADAR, "scene": small_room(), "tolerance_db": -12.0}
    target = ball((3.0, 0.3, 1.0), (-1.0, 0.0, 0.0), 0.1)
    whole, some = (t2d.plan(target, **options, **more) for more in ({}, {"only_paths": ["direct, left"]}))
    assert some.accuracy == whole.accuracy
    assert str(some).splitlines()[1:3] == str(whole).splitlines()[1:3]
    recording = t2d.simulate(target, **options, only_paths=["direct, left"], measure_error=False)
    assert recording.accuracy == whole.accuracy
    assert (recording.settings["pairs"], recording.error_db) == (["direct, left"], None)
    with pytest.raises(InputError, match="the error of a recording is that of all paths"):
        t2d.simulate(target, **options, only_paths=["direct, left"])


@pytest.mark.slow
def test_bounces_come_with_the_direct_path() -> None:
    """Switched off it takes them along, without a warning of a path that does not exist."""
    pair = [ball((3.0, 0.0, 1.0), level=2), ball((3.0, 0.5, 1.0), level=2)]
    options: dict[str, Any] = {"bounces": 2, "accuracy": {"synthesis_error_db": -90.0, "sagitta_rad": 1.0}}
    everything, without = (recorded(pair, **options, **more) for more in ({}, {"without_paths": ["direct"]}))
    alone = recorded(pair, **options, only_paths=["direct"])
    assert energy_db(everything.cube - (alone.cube + without.cube)) - energy_db(everything.cube) < -80


# --- the command line ---


def run(arguments: Sequence[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    code = main(list(arguments))
    said = capsys.readouterr()
    return code, said.out, said.err


QUICK = ("walk", "--stop-s", "0.2", "--scene", "empty_room", "--reflections", "1")


def test_paths_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "paths.csv"
    code, out, _ = run(["paths", *QUICK, "-o", str(table), "--add", "fan:2,1,1", "--time-s", "0.1"], capsys)
    assert code == 0
    lines = out.splitlines()
    assert sum("at 0.1 s" in line for line in lines) == 2
    direct = next(line for line in lines if line.endswith("  direct"))
    rows = list(csv.DictReader(table.read_text().splitlines()))
    at = next(row for row in rows if row["pair"] == "direct" and row["time_s"] == "0.12")
    assert set(row["target"] for row in rows) == {"adult", "fan"}
    assert float(direct.split()[0]) == pytest.approx(float(at["level_dbm"]), abs=0.2)
    assert at["meets"] == "radar > target > radar"
    assert [float(at[f"{axis}0_m"]) for axis in "xyz"] == [0.0, 0.0, 1.0]
    assert all(float(row["blocked"]) < 1 and row["delay_s"] and row["x1_m"] for row in rows)
    floor = next(row for row in rows if row["pair"] == "direct, floor")
    assert float(floor["z2_m"]) == pytest.approx(0.0, abs=1e-9)
    code, _, told = run(["paths", *QUICK, "-o", str(table)], capsys)
    assert (code, "exists already" in told) == (2, True)
    for wrong, sentence in (
        (["-o", "paths.txt"], "the table of paths ends in .csv"), (["--time-s", "3"], "times_s must be a list within the record"),
        (["--rate-hz", "0"], "rate_hz must be positive"), (["--only-paths", "stairs"], "unknown path pair 'stairs'"),
    ):  # fmt: skip
        code, _, told = run(["paths", *QUICK, *wrong], capsys)
        assert (code, sentence in told) == (2, True), told


@pytest.mark.slow
def test_paths_of_an_experiment_are_those_of_its_tolerance(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    text = (
        f"targets: [{{kind: file, file: '{WALK}', stop_s: 0.2, distance_m: 3}}]\nradar: ci4r\nscene: empty_room\n"
        "reflections: 1\nonly_paths: ['*floor*', '*wall*']\n"
    )
    Path("plain.yaml").write_text(text)
    Path("few.yaml").write_text(text + "tolerance_db: -8\n")
    plan = t2d.plan(t2d.Experiment.from_yaml("plain.yaml"), tolerance_db=-8.0)
    planned = plan.model.pairs(plan.accuracy)
    names = {pair.name for pair in planned.pairs if "floor" in pair.name or "wall" in pair.name}
    found = []
    for given in (["plain.yaml"], ["few.yaml"], ["plain.yaml", "--tolerance-db", "-8"]):
        code, _, told = run(["paths", *given, "--rate-hz", "1", "-o", "paths.csv", "--overwrite"], capsys)
        assert code == 0, told
        found.append({row["pair"] for row in csv.DictReader(Path("paths.csv").read_text().splitlines())})
    assert found[0] > found[1] == found[2] == names


def test_simulate_takes_names_of_paths(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    given = [*QUICK, "--method", "ellipsoid", "--radar", "ci4r"]
    names = ["--only-paths", "direct", "--only-paths", "direct, floor", "--without-paths", "direct"]
    assert run(["simulate", *given, *names, "-o", "one.zarr"], capsys)[0] == 0
    recording = t2d.Recording.load("one.zarr")
    assert recording.settings["pairs"] == ["direct, floor"]
    code, out, _ = run(["paths", "one.zarr"], capsys)
    assert (code, "1 path pair" in out, "direct, floor" in out) == (0, True, True)
    code, _, told = run(["paths", "one.zarr", "--reflections", "1"], capsys)
    assert (code, "option reflections is part of the recording one.zarr" in told) == (2, True)
    code, _, told = run(["paths", "one.zarr", "--memory-gb", "-1"], capsys)
    assert (code, "memory_gb" in told) == (2, True), told
    figure = recording.plot_range_doppler(ghosts=True)
    assert "1  direct, floor" in [text.get_text() for text in figure.axes[0].texts]


def test_marked_paths_are_folded_as_the_map_and_their_numbers_stand_apart() -> None:
    """A ball at 1.3 times the greatest speed that is told apart, in a room where eight paths are all but alike."""
    slow = t2d.Radar.preset("ci4r", samples=128, prf_hz=1500.0)
    speed_mps = 1.3 * slow.max_speed_mps
    target = ball((3.0, 0.0, 1.0), (-speed_mps, 0.0, 0.0))
    with pytest.warns(t2d.T2DWarning):
        figure = recorded(target, radar=slow, accuracy=None).plot_range_doppler(ghosts=True, time_s=0.1)
    axes = figure.axes[0]
    texts = [each.get_text() for each in axes.texts]
    legend = [line for text in texts for line in text.splitlines() if line[:3].strip().isdigit() and "  " in line]
    assert any(line.endswith(f"direct ({speed_mps:.1f} m/s, folded)") for line in legend), texts
    numbers = [each for each in axes.texts if each.get_text().isdigit()]
    assert len(numbers) == len(legend) > 3
    figure.canvas.draw()
    middles = np.array([each.get_window_extent().get_points().mean(axis=0) for each in numbers]) * 72 / figure.dpi
    apart = np.linalg.norm(middles[:, None] - middles, axis=-1) + 1e9 * np.eye(len(middles))
    assert apart.min() > 8
    direct = next(line for line in axes.lines if line.get_marker() == "o")
    assert float(direct.get_ydata()[0]) == pytest.approx(speed_mps - 2 * slow.max_speed_mps, abs=0.1)
