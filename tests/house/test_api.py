"""Wrong values in the place of right ones: every public function gives a valid result or an error of one sentence."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from builders import WALK
from t2d_rt import signal
from t2d_rt.cli import main
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.plots import plot_spectrogram
from t2d_rt.types import Ellipsoids, MovingMesh
from validation.robustness.api_arguments import FACES, RADAR, TETRAHEDRON, TIMES_S, cube, egg, result, walk
from validation.robustness.api_calls import Call, arrays_of, calls, faults_of

NAMES = [call.name for call in calls(Path())]
VERTICES = np.repeat(TETRAHEDRON[None], 3, axis=0)
WITHOUT_NUMBERS = {
    "Motion.index", "Slab", "Opening", "Piece", "gate", "Recording.plot", "Recording.save", "plot_spectrogram",
    "plot_range_time", "plot_range_doppler", "Recording.plot_range_time", "Recording.plot_range_doppler", "Recording.export",
    "plot_range_angle", "plot_point_cloud", "plot_comparison", "plot_scene", "Viewer", "Radar.to_yaml", "save_scene",
}  # fmt: skip
"""Public functions that make things without arrays, pictures, files or places."""
QUICK = ("--method", "ellipsoid", "--radar", "ci4r", "--stop-s", "0.2")


def named(name: str, folder: Path) -> Call:
    return next(call for call in calls(folder) if call.name == name)


# --- the sweep ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_wrong_values_end_in_a_result_or_a_sentence(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert list(faults_of(named(name, tmp_path))) == []


@pytest.mark.parametrize(
    "name",
    [
        name
        for name in NAMES
        if not name.startswith("load_") and name not in ("plan", "Recording.load", "Radar.from_yaml")
    ],
)
def test_the_right_values_of_the_sweep_are_right(name: str, tmp_path: Path) -> None:
    call = named(name, tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", T2DWarning)
        made = call.function(**call.arguments)
        result = made.mesh(0.0, 0.1).vertices if hasattr(made, "mesh") else call.use(made)
    found = list(arrays_of(result))
    assert bool(found) != (name in WITHOUT_NUMBERS)
    assert all(np.isfinite(values).all() for values in found)


# --- named cases ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"crease_deg": np.nan}, "crease_deg must lie in 0..180, got nan"),
        ({"crease_deg": True}, "crease_deg must be a number, got True"),
        ({"sagitta_rad": np.inf}, "sagitta_rad of mesh must be finite"),
        ({"vertices": np.ma.masked_array(VERTICES, mask=VERTICES > 3.1)}, "vertices must not be a masked array"),
        ({"vertices": 1e300 * VERTICES}, "vertices of mesh must not exceed 1e.06 m"),
        ({"times_s": np.ma.masked_array(TIMES_S, mask=True)}, "times_s must not be a masked array"),
        ({"faces": np.ma.masked_array(FACES, mask=True)}, "faces of mesh must not be a masked array"),
    ],
)
def test_meshes_that_were_accepted(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        MovingMesh(**{"vertices": VERTICES, "faces": FACES, "times_s": TIMES_S, **options})


def test_masked_arrays_are_refused_everywhere() -> None:
    motion = walk()
    masked = np.ma.masked_array(motion.joints, mask=motion.joints > 1)
    with pytest.raises(InputError, match="joints must not be a masked array"):
        t2d.motion_from_joints(masked, rate_hz=50.0)
    with pytest.raises(InputError, match="joints must not be a masked array"):
        replace(motion, joints=masked)
    with pytest.raises(InputError, match="centres must not be a masked array"):
        egg(centres=np.ma.masked_array(np.ones((3, 1, 3)), mask=True))
    with pytest.raises(InputError, match="adc must not be a masked array"):
        signal.spectrogram(np.ma.masked_array(cube(), mask=np.abs(cube()) > 2), RADAR)


def test_a_track_that_gives_no_numbers() -> None:
    def track(times_s: np.ndarray) -> np.ndarray:
        return np.where(times_s[:, None, None] > 0.1, np.nan, VERTICES[:1])

    mesh = MovingMesh.from_track(track, FACES, TIMES_S)
    with pytest.raises(InputError, match=r"the track of mesh must be finite, got NaN or infinite vertices at 0.2 s"):
        mesh.at(np.array([0.0, 0.2]))
    with pytest.raises(InputError, match="the track of mesh must be finite"):
        t2d.simulate(mesh, radar=RADAR)
    with pytest.raises(InputError, match=r"the track of mesh must have shape \(1, vertex, 3\), got \(4, 3\)"):
        MovingMesh.from_track(lambda times: TETRAHEDRON, FACES, TIMES_S)
    with pytest.raises(InputError, match="must give centres and axes"):
        Ellipsoids.from_track(lambda times: times, [[1, 1, 1]], TIMES_S)  # type: ignore[arg-type, return-value]


def test_samples_that_are_not_numbers_are_seen() -> None:
    broken = cube().copy()
    broken[3, 0, 2] = np.nan
    for process in (signal.spectrogram, signal.range_doppler, signal.range_profile):
        with pytest.raises(InputError, match="adc must be finite"):
            process(broken, RADAR)  # type: ignore[operator]


def test_integers_are_asked_for_where_they_are_meant() -> None:
    recorded = result()
    with pytest.raises(InputError, match=r"n_window must be an integer of 2 or more, got 32.0"):
        recorded.processed(n_window=32.0)
    with pytest.raises(InputError, match=r"n_fft must be an integer in .*, got 64.0"):
        recorded.processed(n_fft=64.0)
    with pytest.raises(InputError, match=r"range_gate_m must be two numbers, least and greatest, in m, got 5"):
        recorded.processed(range_gate_m=5)
    with pytest.raises(InputError, match="path must be a path"):
        recorded.save(3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="path must be a path"):
        RADAR.to_yaml(3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="path must be a path"):
        t2d.load_motion(None)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="rate_hz must be a number, got '120'"):
        replace(walk(), rate_hz="120")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (
            {"n_fft": 2_000_000, "n_window": 16, "overlap": 15},
            "a spectrogram of 49 columns of 2000000 bins would take .* GB",
        ),
        ({"n_fft": 10**9}, "n_fft must be an integer in 0..10000000, got 1000000000"),
    ],
)
def test_memory_is_asked_for_before_it_is_taken(options: dict[str, int], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        signal.spectrogram(cube(), RADAR, **options)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"n_fft|GB of memory"):
        signal.stft(cube(), 1e3, **{"n_window": 16, "overlap": 8, **options})


def test_far_away_is_said_as_such() -> None:
    with pytest.raises(InputError, match=r"distance_m must be 10000 m or less, got 1000000000.0"):
        t2d.place(walk(), distance_m=1e9)


def test_a_jump_is_called_a_jump() -> None:
    joints = walk().joints.copy()
    joints[12:] += [86.0, 0, 0]
    jumping = replace(walk(), joints=joints)
    with pytest.raises(InputError, match=r"the motion jumps: \w+ moves by 86 m from frame 11 to 12 \(0.22 s\)"):
        t2d.simulate(jumping, radar=RADAR, method="ellipsoid")


def test_repr_of_what_is_wrong_is_short() -> None:
    class Endless:
        def __repr__(self) -> str:
            return "y" * 10_000_000 + "\n"

    with pytest.raises(InputError) as error:
        t2d.place(Endless())  # type: ignore[arg-type]
    assert len(str(error.value)) < 300


# --- placement ------------------------------------------------------------------------------------------------------


def simulated(motion: t2d.Motion) -> tuple[t2d.Recording, list[str]]:
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        made = t2d.simulate(motion, radar=RADAR, method="ellipsoid")
    return made, [
        str(each.message)
        for each in seen
        if issubclass(each.category, T2DWarning) and "placed=True" in str(each.message)
    ]


def test_arrays_stay_where_they_are_or_a_warning_says_so() -> None:
    joints = walk().joints
    kept, quiet = simulated(t2d.motion_from_joints(joints, rate_hz=50.0, placed=True))
    asked, told = simulated(t2d.motion_from_joints(joints, rate_hz=50.0, placed=False))
    moved, warned = simulated(t2d.motion_from_joints(joints, rate_hz=50.0))
    assert kept.settings["placement"] == ["own coordinates"]
    assert asked.settings["placement"] == moved.settings["placement"]
    assert "m before the radar, 1.5 m at closest approach" in moved.settings["placement"][0]
    assert (quiet, told, len(warned)) == ([], [], 1)
    assert warned[0].startswith("the motion was placed ")
    assert np.array_equal(asked.cube, moved.cube)
    assert not np.array_equal(kept.cube, moved.cube)
    assert "placed " in moved.settings["targets"][0]


def test_a_report_tells_the_last_placement() -> None:
    there = t2d.place(t2d.place(walk(), distance_m=4.0), distance_m=3.0, angle_deg=20.0)
    assert there.report == "placed 3 m before the radar, turned by 20 degrees"
    assert there.placed


# --- the command line -----------------------------------------------------------------------------------------------


def test_a_name_like_a_formula(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("wa$l_{k$.bvh").symlink_to(WALK)
    assert main(["simulate", "wa$l_{k$.bvh", *QUICK]) == 0
    assert Path("wa$l_{k$.png").read_bytes().startswith(b"\x89PNG")
    assert t2d.Recording.load("wa$l_{k$.zarr").settings["motion"]["file"] == "wa$l_{k$.bvh"


def test_a_picture_that_fails_does_not_cost_the_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(*_: Any, **__: Any) -> None:
        raise RuntimeError("no font")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("matplotlib.figure.Figure.draw_without_rendering", fails)
    assert main(["simulate", str(WALK), *QUICK, "-o", "x.zarr"]) == 0
    assert "the picture cannot be drawn (no font); the result is written without it" in capsys.readouterr().err
    settings = t2d.Recording.load("x.zarr").settings
    assert settings["motion"]["file"] == WALK.name
    assert str(WALK.parent) not in str(settings)


def test_titles_are_literal() -> None:
    axes = np.linspace(-1, 1, 4)
    figure = plot_spectrogram(axes, axes, np.zeros((4, 4)), title="$x_{$ \udcff", note="a$_{$")
    figure.draw_without_rendering()
    assert "\udcff" not in figure.axes[0].get_title()
    with pytest.raises(InputError, match="note must be a text, got 3"):
        plot_spectrogram(axes, axes, np.zeros((4, 4)), note=3)  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_backend_of_matplotlib_that_there_is_none_of(tmp_path: Path) -> None:
    def python(*arguments: str) -> subprocess.CompletedProcess[str]:
        env = {**os.environ, "MPLBACKEND": "nonsense", "PYTHONPATH": str(Path(__file__).parents[2])}
        return subprocess.run(
            [sys.executable, *arguments], cwd=tmp_path, env=env, capture_output=True, text=True, check=False
        )

    run = python("-m", "t2d_rt", "simulate", str(WALK), *QUICK, "-o", "x.zarr")
    assert (run.returncode, run.stderr, (tmp_path / "x.png").exists()) == (0, "", True)
    code = "import numpy as np; from t2d_rt.plots import plot_range_time as p; a = np.arange(3.0); p(a, a, np.eye(3))"
    assert "InputError: matplotlib cannot be used" in python("-c", code).stderr


def test_too_much_memory_for_the_spectrogram_shows_before_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("t2d_rt.signal.range.MOST_BYTES", 1_000_000)
    monkeypatch.setattr("t2d_rt.experiment.setup.targets_of", lambda *_, **__: pytest.fail("the run has begun"))
    assert main(["simulate", str(WALK), *QUICK, "--signal.overlap", "255", "-o", "x.zarr"]) == 2
    assert "GB of memory" in capsys.readouterr().err


def test_small_integers_of_numpy_count_as_integers() -> None:
    """An unsigned 8-bit number overflows where it is added to, if it is not turned into an int first."""
    radar = t2d.Radar.preset("table2")
    cube = np.random.default_rng(0).standard_normal((600, 1, radar.samples)).astype(np.complex64)
    found = signal.spectrogram(cube, radar, n_window=np.uint8(64), overlap=np.uint8(32)).power
    assert np.array_equal(found, signal.spectrogram(cube, radar, n_window=64, overlap=32).power)
    factors = [
        signal.cfar_factor(1e-3, cells, looks=looks) for cells, looks in ((100, 4), (np.uint32(100), np.uint32(4)))
    ]
    assert factors[0] == factors[1]


@pytest.mark.parametrize("value", [1e60, 1e-60])
def test_samples_that_complex64_cannot_hold(value: float) -> None:
    radar = t2d.Radar.preset("table2")
    with pytest.raises(t2d.InputError, match="kept as complex64"):
        t2d.Recording(np.full((4, 1, radar.samples), value + 0j), radar)


def test_settings_that_are_no_plain_numbers(tmp_path: Path) -> None:
    radar = t2d.Radar.preset("table2")
    result = t2d.Recording(np.ones((300, 1, radar.samples), np.complex64), radar, settings={"a": np.float32(1)})
    with pytest.raises(t2d.InputError, match="settings of a result must be plain"):
        result.save(tmp_path / "a.zarr")
    assert not list(tmp_path.iterdir())
