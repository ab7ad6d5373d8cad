"""Animations of targets beside their spectrogram, and the command that draws maps and animations."""

from __future__ import annotations

import shutil
import stat
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageSequence

import t2d_rt as t2d
from builders import WALK
from command_line import Command
from t2d_rt.core.errors import InputError
from t2d_rt.view import animation

RADAR = t2d.Radar.preset("ci4r", carrier_hz=24e9, prf_hz=2000, samples=32)


@pytest.fixture(scope="module")
def walker() -> t2d.Recording:
    """A walk of 0.5 s towards the radar, 2 m/s fast limbs among it, beside a fan, by ellipsoids."""
    walk = t2d.place(t2d.trim(t2d.load_motion(WALK), 1.0, 1.5), distance_m=3)
    fan = t2d.TableFan(position_m=(3, -1, 1), rpm=120)
    return t2d.simulate([walk, fan], radar=RADAR, method="ellipsoid").processed(n_window=64)


@pytest.fixture(scope="module")
def array() -> t2d.Recording:
    """A point 0.4 rad to the left at 4 m, approaching at 1 m/s, before an array."""
    radar = t2d.Radar.preset("array-3x4", samples=64)
    ball = t2d.Ellipsoids(
        np.full((1, 3), 0.1), [[[4 * np.cos(0.4), 4 * np.sin(0.4), 1]], [[3.9 * np.cos(0.4), 3.9 * np.sin(0.4), 1]]],
        [0, 0.1], material="pec",
    )  # fmt: skip
    return t2d.simulate(ball, radar=radar)


def frames(path: Path) -> list[np.ndarray]:
    with Image.open(path) as image:
        return [np.asarray(frame.convert("RGB")).astype(int) for frame in ImageSequence.Iterator(image)]


# --- animations -----------------------------------------------------------------------------------------------------


def test_a_gif_shows_what_moves_and_the_time(walker: t2d.Recording, tmp_path: Path) -> None:
    t2d.animate(walker, tmp_path / "walk.gif", width_px=401, frames_hz=10, title="a walk")
    with Image.open(tmp_path / "walk.gif") as image:
        assert image.info["duration"] == 100  # ms: real time
    shown = frames(tmp_path / "walk.gif")
    assert len(shown) == 5  # 0 to 0.4 s; the last window's middle is before 0.5 s
    assert shown[0].shape == (176, 400, 3)
    changed = np.any(shown[0] != shown[-1], axis=-1)
    assert changed[:, :150].mean() > 0.005  # the body, on the left
    assert changed[:, 250:].mean() > 0.1  # the veil, on the right
    # The cursor goes to the right, at an even pace: the reddest column of the chart.
    columns = [int((each[..., 0] - each[..., 1] - each[..., 2])[40:140, 210:].sum(axis=0).argmax()) for each in shown]
    assert np.diff(columns).min() > 10
    assert np.ptp(np.diff(columns[1:])) <= 1


def test_speeds_have_their_colours(tmp_path: Path) -> None:
    """A ball that approaches is red, one that recedes is blue; both move along the boresight."""
    times = np.linspace(0, 0.3, 4)
    for speed, least in ((2.0, 0), (-2.0, 2)):
        centres = np.array([[[3 - speed * time, 0, 1]] for time in times])
        ball = t2d.Ellipsoids(np.full((1, 3), 0.3), centres, times, material="pec")
        recording = t2d.simulate(ball, radar=RADAR).processed(n_window=64)
        path = tmp_path / f"{speed}.gif"
        t2d.animate(recording, path, width_px=400, frames_hz=10)
        picture = frames(path)[1][:, :150]
        coloured = picture[np.ptp(picture, axis=-1) > 60]
        assert len(coloured) > 50
        assert np.all(coloured[:, least] > coloured[:, 2 - least])


def test_a_room_is_drawn(tmp_path: Path) -> None:
    room = t2d.Room(name="hut", size_m=(5, 4, 2.5))
    times = np.array([0, 0.2])
    ball = t2d.Ellipsoids(np.full((1, 3), 0.2), [[[2, 0, 1]], [[1.8, 0, 1]]], times, material="pec")
    recording = t2d.simulate(ball, radar=RADAR, scene=room, reflections=0, clutter="none", collisions="ignore")
    t2d.animate(recording.processed(n_window=64), tmp_path / "room.gif", width_px=400, frames_hz=10)
    drawn = np.any(frames(tmp_path / "room.gif")[0][:, :150] < 235, axis=-1)
    assert drawn.sum() > 700  # edges of the walls; the ball and the radar alone take 250


def test_ffmpeg_makes_an_mp4(walker: t2d.Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(
        InputError, match=r"an \.mp4 needs the program ffmpeg, which is not there; install it, or write a \.gif"
    ):
        t2d.animate(walker, tmp_path / "walk.mp4")
    # One that writes what it is told and what it is given, and one that fails.
    program = tmp_path / "ffmpeg"
    program.write_text('#!/bin/sh\n/bin/echo "$@" > "$0.words"\nfor last; do :; done\n/bin/cat > "$last"\n')
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    t2d.animate(walker, tmp_path / "walk.mp4", width_px=400, frames_hz=10)
    assert (tmp_path / "walk.mp4").stat().st_size == 5 * 400 * 176 * 3
    assert "-s 400x176 -r 10 -i -" in (tmp_path / "ffmpeg.words").read_text()
    program.write_text("#!/bin/sh\n/bin/cat > /dev/null\necho no codec >&2\nexit 1\n")
    with pytest.raises(InputError, match=r"ffmpeg cannot write .*walk.mp4 \(no codec\); write a .gif"):
        t2d.animate(walker, tmp_path / "walk.mp4", width_px=400, frames_hz=10, overwrite=True)
    assert (tmp_path / "walk.mp4").stat().st_size == 5 * 400 * 176 * 3  # what was there


def test_an_mp4_by_a_real_ffmpeg_holds_the_pictures_of_the_gif(walker: t2d.Recording, tmp_path: Path) -> None:
    if shutil.which("ffmpeg") is None:
        pytest.skip("no ffmpeg is installed, which alone writes MP4 files")
    for name in ("walk.mp4", "walk.gif"):
        t2d.animate(walker, tmp_path / name, width_px=400, frames_hz=10)
    assert (tmp_path / "walk.mp4").read_bytes()[4:8] == b"ftyp"
    command = ["ffmpeg", "-loglevel", "error", "-i", "walk.mp4", "-f", "rawvideo", "-pix_fmt", "rgb24", "walk.rgb"]
    subprocess.run(command, cwd=tmp_path, check=True)
    film = np.fromfile(tmp_path / "walk.rgb", np.uint8).reshape(-1, 176, 400, 3).astype(int)
    expected = np.stack(frames(tmp_path / "walk.gif"))
    assert film.shape == expected.shape
    own = [np.abs(each - other).mean() for each, other in zip(film, expected, strict=True)]
    others = [np.abs(each - other).mean() for each, other in zip(film[1:], expected[:-1], strict=True)]
    assert max(own) < 6  # of 255: a GIF has 256 colours, a film half as many of them across and down
    assert max(own) < min(others)


def test_frames_go_to_ffmpeg_one_by_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that ends early is noticed, and nothing more is drawn for it; its words are told."""
    program = tmp_path / "ffmpeg"
    program.write_text("#!/bin/sh\necho disk full >&2\nexit 1\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", str(tmp_path))
    drawn: list[int] = []

    def pictures() -> Iterator[np.ndarray]:
        for number in range(2000):
            drawn.append(number)
            yield np.zeros((200, 400, 3), np.uint8)

    with pytest.raises(InputError, match=r"ffmpeg cannot write walk.mp4 \(disk full\)"):
        animation._write_mp4(pictures(), tmp_path / "walk.mp4", 25)
    assert len(drawn) < 2000


@pytest.mark.slow
def test_a_gif_plays_in_real_time_at_any_rate(walker: t2d.Recording, tmp_path: Path) -> None:
    """30 Hz is 33 ms, which a GIF does not know: pictures stand 30 ms apart in its time and in that of the motion."""
    t2d.animate(walker, tmp_path / "walk.gif", width_px=300, frames_hz=30)
    with Image.open(tmp_path / "walk.gif") as image:
        assert image.info["duration"] == 30
        assert image.n_frames == int(float(walker.spectrogram.time_s[-1]) / 0.03 + 1e-6) + 1  # type: ignore[attr-defined]


def test_the_veil_ends_where_the_chart_does() -> None:
    picture = animation._with_cursor(np.full((40, 100, 3), 100, np.uint8), (0, 40, 10, 50, 90), 0.5)
    assert (picture[20, 31:90] > 180).all()
    assert (picture[20, 90:] == 100).all()


def test_long_animations_are_refused(walker: t2d.Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(animation, "MOST_FRAMES", 3)
    with pytest.raises(InputError, match=r"an animation has at most 3 pictures, got 5; lower frames_hz, or simulate"):
        t2d.animate(walker, tmp_path / "long.gif", frames_hz=10)


def test_what_cannot_be_animated(walker: t2d.Recording, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"an animation ends in \.gif or \.mp4"):
        t2d.animate(walker, tmp_path / "walk.png")
    (tmp_path / "walk.gif").write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        t2d.animate(walker, tmp_path / "walk.gif")
    measured = t2d.Recording(walker.cube, RADAR)
    with pytest.raises(InputError, match="the recording was measured: who moved, and where, is not known"):
        t2d.animate(measured, tmp_path / "other.gif")
    with pytest.raises(InputError, match=r"frames_hz must lie in 1\.\.50 Hz"):
        t2d.animate(walker, tmp_path / "other.gif", frames_hz=0)


# --- maps of arrays -------------------------------------------------------------------------------------------------


def test_range_and_angle_of_a_recording(array: t2d.Recording) -> None:
    image = array.range_angle()
    assert image.dims == ("range_m", "azimuth_rad")
    assert (image.attrs["units"], image.azimuth_rad.attrs["units"]) == ("dB re 1 W", "rad")
    peak = image.where(image == image.max(), drop=True)
    assert float(peak.azimuth_rad[0]) == pytest.approx(0.4, abs=0.05)
    assert float(peak.range_m[0]) == pytest.approx(3.85, abs=array.radar.range_resolution_m)
    early = array.range_angle(0.0, interval_s=0.02, elevation_rad=0.0)
    assert early.attrs["interval_s"] == pytest.approx(0.02, abs=1e-3)
    figure: Any = array.plot_range_angle("to the left", dynamic_range_db=30)
    axes, bar = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("Azimuth [deg], left > 0", "Range [m]")
    assert bar.get_ylabel() == "Power rel. to peak [dB]"
    assert axes.get_xlim() == pytest.approx((90, -90))  # left on the left


def test_points_of_a_recording(array: t2d.Recording) -> None:
    cloud = array.point_cloud(frame_chirps=32)
    best = cloud.snr_db.argmax()
    assert cloud.azimuth_rad[best] == pytest.approx(0.4, abs=0.05)
    assert cloud.speed_mps[best] == pytest.approx(1.0, abs=0.3)
    assert repr(cloud).startswith(f"PointCloud({len(cloud.time_s)} points, ")
    figure: Any = array.plot_point_cloud("points", width_in=3.5)
    above, side, _bar = figure.axes
    assert (above.get_xlabel(), side.get_ylabel()) == ("Left [m]", "Up [m]")
    assert figure.get_size_inches()[0] == 3.5
    left, *_ = above.collections[0].get_offsets().mean(axis=0)
    assert left == pytest.approx(3.85 * np.sin(0.4), abs=0.3)


def test_one_antenna_tells_no_azimuth(walker: t2d.Recording) -> None:
    with pytest.raises(InputError, match="azimuths need antennas side by side, and this radar has 1"):
        walker.range_angle()


# --- the command ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_pictures_of_the_command(run: Command, walker: t2d.Recording, array: t2d.Recording) -> None:
    walker.save("walk.zarr")
    array.save("array.zarr")
    assert run("plot", "walk.zarr", "--width-in", "3.5", "--limits-db", "[-140, -90]", "-o", "walk.pdf").code == 0
    assert Path("walk.pdf").read_bytes().startswith(b"%PDF")
    code, out, err = run("plot", "array.zarr", "--map", "range_angle", "--time-s", "0.05")
    assert (code, out) == (0, "wrote array_range_angle.png\n"), err
    assert run("plot", "array.zarr", "--map", "point_cloud", "-o", "points.svg").code == 0
    code, out, err = run("plot", "walk.zarr", "--animate", "--width-px", "300", "--frames-hz", "5")
    assert (code, out) == (0, "wrote walk.gif\n"), err
    with Image.open("walk.gif") as image:
        assert image.size == (300, 132)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--map", "cepstrum"), "option map must be spectrogram or parts"),
        (("--animate", "--map", "range_time"), "an animation shows the spectrogram, got --map range_time"),
        (("--time-s", "1"), "option time_s is of a map of one interval (range_doppler, range_angle); leave it out"),
        (
            ("--map", "point_cloud", "--limits-db", "[-140, -90]"),
            "option limits_db is of levels, and a point cloud shows speeds",
        ),
        (("--map", "point_cloud", "--dynamic-range-db", "30"), "option dynamic_range_db is of levels"),
        (("--animate", "--cmap", "magma"), "option cmap is of a picture, and walk.gif is an animation; leave it out"),
        (("-o", "walk.gif", "--width-in", "3.5"), "option width_in is of a picture, and walk.gif is an animation"),
        (("--width-px", "400"), "option width_px is of an animation, and this is a picture; leave it out"),
        (("--lanes", "2"), "lanes, iq and conjugate are those of measured samples, and walk.zarr is a result"),
        (("-o", "walk.bmp"), "a picture ends in .png, .pdf or .svg, got 'walk.bmp'"),
        (("--animate", "-o", "walk.webm"), "an animation ends in .gif or .mp4, got 'walk.webm'"),
    ],
)
def test_refusals_of_the_command(
    walker: t2d.Recording, refused: Callable[..., str], options: tuple[str, ...], sentence: str
) -> None:
    walker.save("walk.zarr")
    assert sentence in refused("plot", "walk.zarr", *options)
