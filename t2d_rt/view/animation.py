"""Animations: targets in their room, coloured by radial speed, beside the spectrogram with its time cursor, as GIF or MP4."""

from __future__ import annotations

import itertools
import math
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from t2d_rt.core.atomic_write import check_file, writing
from t2d_rt.core.checks import file_path, flag, instance, integer, number
from t2d_rt.core.errors import InputError
from t2d_rt.experiment.setup import set_up_again
from t2d_rt.geometry.vectors import edge_cross, unit
from t2d_rt.plots.canvas import Style, blank_figure
from t2d_rt.plots.figures import VELOCITY_LABEL, draw_map, outline
from t2d_rt.recording.path_table import STEP_S, mean_range_m
from t2d_rt.recording.recording import Recording
from t2d_rt.view.contact_sheet import OVERSAMPLING, drawn_into, samples_of

if TYPE_CHECKING:
    from t2d_rt.pipeline.echo_model import Model

ENDINGS = ".gif", ".mp4"
DPI = 100
HEIGHT = 0.44
"""Height of a picture relative to its width."""
SPEEDS = "RdYlBu_r"
"""Colour map of radial speeds: blue for receding, red for approaching."""
PAPER, FLOOR, EDGE, RADAR = (1.0, 1.0, 1.0), (0.80, 0.80, 0.80), (0.55, 0.55, 0.55), (0.1, 0.1, 0.1)
LIGHT = np.array([0.3, 0.75, 0.6])
"""Direction towards the light in the picture's frame: right, towards the camera, up."""
CAMERA_DEG = 32.0, 14.0
"""Direction of the camera [deg]: azimuth about the vertical from the radar's side of the targets, and elevation."""
MOST_FRAMES = 1500
"""Greatest number of pictures in an animation; those of a GIF are held in memory."""
FADED = 0.72
"""Opacity of the white that covers the part of the spectrogram still to come."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Stage:
    """What moves and what is static, in the picture's frame: right, towards the camera, up [m]."""

    faces: np.ndarray
    places: np.ndarray
    """Positions of the vertices in each frame, (frame, vertex, 3)."""
    speeds_mps: np.ndarray
    """Radial speed of the vertices [m/s], (frame, vertex), positive = approaching."""
    fixed: np.ndarray
    """Points of lines, (N, 3)."""
    fixed_colours: np.ndarray
    """Colours of these points, (N, 3)."""


def animate(
    recording: Recording,
    path: str | Path,
    *,
    width_px: int = 800,
    frames_hz: float = 12.5,
    title: str | None = None,
    overwrite: bool = False,
) -> None:
    """Writes an animation of a simulated recording, in real time: its targets in their room by radial speed, and its spectrogram.

    path: file name that ends in .gif, or in .mp4, for which the program ffmpeg is needed.
    width_px: width of the picture [pixel], 300..1920, made even; its height is 0.44 of that.
    frames_hz: pictures per second, 1..50; for a GIF the interval is rounded to hundredths of a second. There are at most 1500
        pictures.
    title: a text above the spectrogram.
    """
    instance("recording", recording, Recording, "a Recording", hint="simulate makes one, Recording.load reads one")
    target = check_animation(path, overwrite=overwrite)
    width = integer("width_px", width_px, 300, 1920) // 2 * 2  # codecs need even sizes
    rate_hz = number("frames_hz", frames_hz, 1, 50, unit="Hz", hint="12.5 is usual")
    if recording.experiment is None:
        raise InputError("the recording was measured: who moved, and where, is not known; plot its maps")
    model = set_up_again(recording.experiment, recording.inputs).model
    image = recording.spectrogram
    end_s = min(model.span_s[1] - model.span_s[0], float(image.time_s[-1]))
    gif = target.suffix.lower() == ".gif"
    step_s = round(100 / rate_hz) / 100 if gif else 1 / rate_hz
    times_s = np.arange(0.0, end_s + 1e-9, step_s)
    if len(times_s) > MOST_FRAMES:
        raise InputError(
            f"an animation has at most {MOST_FRAMES} pictures, got {len(times_s)}; lower frames_hz, or simulate a shorter piece"
        )
    base, room, chart, speeds = _base(recording, width, title)
    stage = _stage(model, times_s)
    pictures = _pictures(stage, times_s, base, room, chart, speeds)
    with writing(target, overwrite=overwrite) as new:
        if gif:
            _write_gif(pictures, new, step_s)
        else:
            _write_mp4(pictures, new, rate_hz)


def check_animation(path: str | Path, *, overwrite: bool) -> Path:
    """A checked absolute path for an animation; refuses one with another ending, one that cannot be
    written, and, without `overwrite`, one that exists; for .mp4 ffmpeg must be installed."""
    target = file_path("path", path)
    check_file(target, "an animation", *ENDINGS, overwrite=flag("overwrite", overwrite))
    if target.suffix.lower() == ".mp4" and shutil.which("ffmpeg") is None:
        raise InputError("an .mp4 needs the program ffmpeg, which is not there; install it, or write a .gif")
    return target.resolve()


def _base(
    recording: Recording, width: int, title: str | None
) -> tuple[np.ndarray, tuple[int, ...], tuple[float, ...], tuple[float, float]]:
    """The background picture (height, width, 3). Also the pixels of the room (top, bottom, left, right); of the chart the top and
    bottom [pixel], the columns of 0 s and of 1 s, and the right edge; and the speeds at its lower and upper end."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = blank_figure(width / DPI, round(HEIGHT * width / 2) * 2 / DPI)
    figure.set_dpi(DPI)
    room, strip, chart = figure.subplots(1, 3, width_ratios=(1.0, 0.03, 1.15))
    image = recording.spectrogram
    style = Style(bar=False)
    draw_map(
        chart, "spectrogram", image.velocity_mps.values, image.time_s.values, image.values, style=style, title=title
    )
    low, high = chart.get_ylim()
    reach = max(-low, high)
    ramp = np.linspace(low, high, 256)[:, None]
    strip.imshow(ramp, cmap=SPEEDS, vmin=-reach, vmax=reach, aspect="auto", origin="lower", extent=(0, 1, low, high))
    strip.set_xticks([])
    strip.tick_params(labelsize=7)
    strip.set_ylabel(VELOCITY_LABEL, fontsize=8)
    chart.set_ylabel("")
    chart.tick_params(labelleft=False)
    room.set_axis_off()
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    base = np.asarray(canvas.buffer_rgba())[..., :3].copy()
    tall = len(base)
    box, ends = room.get_window_extent(), chart.get_window_extent()
    columns = chart.transData.transform([(0.0, 0.0), (1.0, 0.0)])[:, 0]
    pixels = (4, tall - 4, math.ceil(box.x0) + 2, math.floor(box.x1) - 2)
    return base, pixels, (tall - ends.y1, tall - ends.y0, columns[0], columns[1], ends.x1), (low, high)


def _stage(model: Model, times_s: np.ndarray) -> _Stage:
    radar = model.radar
    faces, places, speeds, count = [], [], [], 0
    for geometry in model.geometries:
        solid = geometry.solid()
        clock = [np.clip(model.span_s[0] + times_s + step, *model.span_s) for step in (-STEP_S, STEP_S)]
        before, after = (solid.vertices_at(at_s) for at_s in clock)
        ranges = [mean_range_m(radar, vertices) for vertices in (before, after)]
        faces.append(solid.faces + count)
        places.append((before + after) / 2)
        speeds.append((ranges[0] - ranges[1]) / (clock[1] - clock[0])[:, None])
        count += solid.vertices
    everything = np.concatenate(places, axis=1)
    axes = _camera(np.asarray(radar.axes)[0])
    lines, colours = _lines(model, everything)
    return _Stage(
        faces=np.concatenate(faces),
        places=everything @ axes.T,
        speeds_mps=np.concatenate(speeds, axis=1),
        fixed=lines @ axes.T,
        fixed_colours=colours,
    )


def _camera(boresight: np.ndarray) -> np.ndarray:
    """Rows are the directions right in the picture, towards the camera, and up. The camera is on the radar's side, to its right."""
    azimuth, up = np.radians(CAMERA_DEG)
    ahead = boresight * [1, 1, 0]
    ahead = ahead / np.linalg.norm(ahead) if np.linalg.norm(ahead) > 1e-6 else np.array([1.0, 0.0, 0.0])
    side = np.array([ahead[1], -ahead[0], 0.0])
    towards = math.cos(up) * (-math.cos(azimuth) * ahead + math.sin(azimuth) * side) + [0, 0, math.sin(up)]
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    return np.stack([right, towards, np.cross(towards, right)])


def _lines(model: Model, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points, with their colours, along the edges of the scene below the ceiling, or of a one-metre grid on the ground, and of the
    radar."""
    radar = np.asarray(model.radar.position_m)
    low, high = (edge(np.concatenate([places.reshape(-1, 3), radar[None]]), axis=0) for edge in (np.min, np.max))
    if model.scene is not None:
        top = model.scene.bounds_m[1][2]
        edges = [
            outline(surface) for surface in model.scene.surfaces if not (surface.vertices[:, 2] > top - 1e-3).all()
        ]
        segments = np.concatenate([surface_edges for surface_edges in edges if len(surface_edges)])
    else:
        x, y = (np.arange(math.floor(low[k] - 0.5), math.ceil(high[k] + 0.5) + 1) for k in (0, 1))
        ground = min(float(low[2]), 0.0)
        segments = np.array(
            [[(a, y[0], ground), (a, y[-1], ground)] for a in x] + [[(x[0], b, ground), (x[-1], b, ground)] for b in y]
        )
    colours = FLOOR if model.scene is None else EDGE
    axes = 0.16 * np.asarray(model.radar.axes)
    corners = [
        radar + axes[1] + axes[2],
        radar + axes[1] - axes[2],
        radar - axes[1] - axes[2],
        radar - axes[1] + axes[2],
    ]
    tip = radar + 2.5 * axes[0]
    device = [(corners[k], corners[(k + 1) % 4]) for k in range(4)] + [(corner, tip) for corner in corners]
    foot = [(radar * [1, 1, 0] + [0, 0, min(float(low[2]), 0.0)], radar)]
    points = [_along(np.asarray(ends)) for ends in (segments, device + foot)]
    shades = [np.broadcast_to(colour, point.shape) for colour, point in zip((colours, RADAR), points, strict=True)]
    return np.concatenate(points), np.concatenate(shades)


def _along(segments: np.ndarray, step_m: float = 0.008) -> np.ndarray:
    """Points (N, 3) along segments (E, 2, 3), at most `step_m` apart."""
    counts = np.ceil(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1) / step_m).astype(int) + 1
    return np.concatenate(
        [a + np.linspace(0, 1, count)[:, None] * (b - a) for (a, b), count in zip(segments, counts, strict=True)]
    )


def _pictures(
    stage: _Stage,
    times_s: np.ndarray,
    base: np.ndarray,
    room: tuple[int, ...],
    chart: tuple[float, ...],
    speeds: tuple[float, float],
) -> Iterator[np.ndarray]:
    """Yields the pictures one after the other, uint8 (height, width, 3)."""
    from matplotlib import colormaps

    top, bottom, left, right = room
    wide, tall = (right - left) * OVERSAMPLING, (bottom - top) * OVERSAMPLING
    all_points = np.concatenate([stage.places.reshape(-1, 3)[::7], stage.fixed])
    low, high = all_points.min(axis=0), all_points.max(axis=0)
    scale = 0.96 * min(wide / (high[0] - low[0]), tall / (high[2] - low[2]))
    middle = (low + high) / 2
    reach = max(-speeds[0], speeds[1])
    origin = wide / 2 - middle[0] * scale, tall / 2 + middle[2] * scale
    for place, speed, time_s in zip(stage.places, stage.speeds_mps, times_s, strict=True):
        corners = place[stage.faces]
        shade = 0.5 + 0.5 * np.abs(unit(edge_cross(corners)) @ (LIGHT / np.linalg.norm(LIGHT)))
        mean_speed = speed[stage.faces].mean(axis=1)
        colours = colormaps[SPEEDS](0.5 + 0.5 * mean_speed / reach)[:, :3] * shade[:, None]
        points, owner = samples_of(corners, 1.0 / scale)
        points, shown = np.concatenate([stage.fixed, points]), np.concatenate([stage.fixed_colours, colours[owner]])
        small = drawn_into(np.full((tall, wide, 3), PAPER), points, shown, scale, origin)
        picture = base.copy()
        picture[top:bottom, left:right] = np.round(255 * small)
        yield _with_cursor(picture, chart, time_s)


def _with_cursor(picture: np.ndarray, chart: tuple[float, ...], time_s: float) -> np.ndarray:
    """Draws a line at the current time, and a veil over the part still to come."""
    top, bottom, zero, one, right = chart
    now = round(zero + time_s * (one - zero))
    rows = slice(round(top) + 1, round(bottom))
    part = picture[rows, now + 1 : math.floor(right)]
    part[:] = np.round(FADED * 255 + (1 - FADED) * part)
    picture[rows, max(now - 1, 0) : now + 1] = (220, 30, 30)
    return picture


def _write_gif(pictures: Iterator[np.ndarray], path: Path, step_s: float) -> None:
    from PIL import Image

    frames = [Image.fromarray(picture) for picture in pictures]
    sample = Image.fromarray(np.concatenate([np.asarray(frames[len(frames) * k // 3]) for k in range(3)]))
    palette = sample.quantize(256, method=Image.Quantize.MEDIANCUT)
    paletted = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    step_ms = round(1000 * step_s)
    paletted[0].save(
        path,
        save_all=True,
        append_images=paletted[1:],
        duration=[step_ms] * (len(paletted) - 1) + [1200],
        loop=0,
        optimize=False,
        format="GIF",
    )


def _write_mp4(pictures: Iterator[np.ndarray], path: Path, rate_hz: float) -> None:
    first = next(pictures)
    command = [
        "ffmpeg", "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{first.shape[1]}x{first.shape[0]}",
        "-r", f"{rate_hz:g}", "-i", "-", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "20", str(path),
    ]  # fmt: skip
    whole = False
    with tempfile.TemporaryFile() as log:  # to a file, not a pipe, which long output of ffmpeg would fill
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=log) as process, suppress(BrokenPipeError):
            assert process.stdin is not None
            with process.stdin as entry:
                for picture in itertools.chain([first], pictures):
                    entry.write(picture.tobytes())
            whole = True
        log.seek(0)
        words = log.read().decode(errors="replace")
    if process.returncode or not whole:
        reason = words.strip().splitlines() or ["no reason given"]
        raise InputError(f"ffmpeg cannot write {path.name} ({reason[-1]}); write a .gif")
