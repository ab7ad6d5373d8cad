"""`t2d-rt plot`: a map of a recording as a picture for a paper or a screen, or body and spectrogram as an animation."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from t2d_rt.cli.options import add_capture_options, capture_options, command_parser, refuse_options
from t2d_rt.cli.output import check_picture, say, write_picture
from t2d_rt.core.errors import InputError

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

EXAMPLES = """examples:
  t2d-rt plot walk.zarr -o walk.pdf --width-in 3.5               # the spectrogram, for a column of a paper
  t2d-rt plot walk.zarr --map range_doppler --time-s 1.2 -o rd.pdf
  t2d-rt plot walk.zarr --limits-db "[-140, -90]" -o walk.png    # a scale that other pictures have, too
  t2d-rt plot array.zarr --map point_cloud                       # of an antenna array
  t2d-rt plot walk.zarr --animate                                # walk.gif: the body in its room beside the spectrogram
  t2d-rt plot walk.zarr --animate -o walk.mp4                    # by ffmpeg"""

MAPS = "spectrogram", "range_time", "range_doppler", "range_angle", "point_cloud"
OF_INTERVAL = "range_doppler", "range_angle"
"""Maps of one coherent interval."""
OF_LEVELS = "dynamic_range_db", "limits_db"
OF_STYLE = "cmap", "width_in", *OF_LEVELS
OF_ANIMATION = "width_px", "frames_hz"


def parser() -> ArgumentParser:
    """Options of `t2d-rt plot`."""
    found = command_parser(
        "plot",
        "Draws a map of a recording, simulated or measured, as a picture; or the body in its room beside the spectrogram, as an "
        "animation.",
        config=False,
        noun="RECORDING",
        examples=EXAMPLES,
    )
    told = "Picture to write (.png, .pdf or .svg), or animation (.gif or .mp4); by default it has RECORDING's name and the map's."
    found.add_argument("-o", "--output", type=str | None, help=told)
    told = "Whether a file of that name is replaced; without it an existing one is an error."
    found.add_argument("--overwrite", type=bool, default=False, nargs="?", const=True, help=told)
    found.add_argument("--map", type=str, default="spectrogram", help=f"Which map it is: {', '.join(MAPS)}.")
    found.add_argument("--title", type=str | None, help="Text above the picture; RECORDING's name by default.")
    told = "Middle of the interval of a range-Doppler or range-angle map [s]; that of the record by default."
    found.add_argument("--time_s", type=float | None, help=told)
    found.add_argument("--interval_s", type=float | None, help="Length of that interval [s]; a window's by default.")
    found.add_argument("--cmap", type=str | None, help="A colour map of Matplotlib; viridis by default.")
    found.add_argument(
        "--dynamic_range_db", type=float | None, help="Span of the colours below the peak [dB]; 50 by default."
    )
    told = "Least and greatest level of the colours [dB re 1 W] instead, as [-140, -90]."
    found.add_argument("--limits_db", type=tuple[float, float] | None, help=told)
    told = (
        "Width of the picture [inch]: 3.5 for a column of a paper, 7 for its width, which is the default of most maps."
    )
    found.add_argument("--width_in", type=float | None, help=told)
    told = "Whether body, room and spectrogram are animated, as a .gif, or an .mp4 where ffmpeg is there."
    found.add_argument("--animate", type=bool, default=False, nargs="?", const=True, help=told)
    found.add_argument("--width_px", type=int, default=800, help="Width of an animation [pixel].")
    found.add_argument("--frames_hz", type=float, default=12.5, help="Pictures of an animation in a second [Hz].")
    add_capture_options(found)
    return found


def _refuse_others(options: Namespace, kind: str, animation: str | None) -> None:
    """Refuses options that have no effect on this map, or on this animation."""
    default = parser()
    if kind not in OF_INTERVAL:
        refuse_options(options, default, ("time_s", "interval_s"), f"a map of one interval ({', '.join(OF_INTERVAL)})")
    if kind == "point_cloud":
        refuse_options(options, default, OF_LEVELS, "levels, and a point cloud shows speeds")
    if animation is None:
        refuse_options(options, default, OF_ANIMATION, "an animation, and this is a picture")
    else:
        refuse_options(options, default, OF_STYLE, f"a picture, and {animation} is an animation")


def run(options: Namespace) -> None:
    """Writes the picture or the animation."""
    from t2d_rt.core.checks import choice
    from t2d_rt.recording.read import load_recording
    from t2d_rt.view.animation import ENDINGS, animate, check_animation

    source = Path(options.file)
    kind = choice("option map", options.map, MAPS)
    moves = options.animate or (options.output is not None and Path(options.output).suffix.lower() in ENDINGS)
    part = "" if kind == "spectrogram" else f"_{kind}"
    target = Path(options.output or f"{source.stem}{part}{'.gif' if moves else '.png'}")
    title = source.name if options.title is None else options.title
    if moves:
        if kind != "spectrogram":
            raise InputError(f"an animation shows the spectrogram, got --map {kind}; leave it out, or draw a picture")
        check_animation(target, overwrite=options.overwrite)
    else:
        check_picture(target, overwrite=options.overwrite)
    _refuse_others(options, kind, target.name if moves else None)
    recording = load_recording(source, options.radar, **capture_options(options))
    if moves:
        animate(
            recording, target, width_px=options.width_px, frames_hz=options.frames_hz, title=title, overwrite=options.overwrite
        )  # fmt: skip
    else:
        style: dict[str, Any] = {name: options[name] for name in OF_STYLE if options[name] is not None}
        if kind in OF_INTERVAL:
            style |= {"time_s": options.time_s, "interval_s": options.interval_s}
        draw = recording.plot if kind == "spectrogram" else getattr(recording, f"plot_{kind}")
        write_picture(draw(title, **style), target, overwrite=options.overwrite)
    say(f"wrote {target}")
