"""`t2d-rt view`: one page that shows a recording, or two side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from t2d_rt.cli.options import CAPTURE, add_capture_options, capture_options, command_parser, refuse_options
from t2d_rt.cli.output import say
from t2d_rt.core.errors import InputError

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

EXAMPLES = """examples:
  t2d-rt view walk.zarr                             # walk.html: body, room, paths and maps on one timeline, for any browser
  t2d-rt view ellipsoids.zarr mesh.zarr -o both.html  # two recordings side by side
  t2d-rt view capture.npy --radar my_radar.yaml       # the maps of a measured recording"""


def parser() -> ArgumentParser:
    """Options of `t2d-rt view`."""
    found = command_parser(
        "view",
        "Writes one HTML file that shows a recording: body, room and paths in three dimensions beside spectrogram and maps, "
        "with one time cursor. It needs no network and no other file.",
        config=False,
        noun="RECORDING [RECORDING]",
        file="A result (.zarr), or measured ADC samples (.npy, or .bin of a DCA1000); or two of them.",
        examples=EXAMPLES,
        several=True,
    )
    found.add_argument(
        "-o", "--output", type=str | None, help="Page to write (.html); by default it has the (first) RECORDING's name."
    )
    told = "Whether a page of that name is replaced; without it an existing one is an error."
    found.add_argument("--overwrite", type=bool, default=False, nargs="?", const=True, help=told)
    add_capture_options(found)
    return found


def run(options: Namespace) -> None:
    """Writes the page."""
    from t2d_rt.recording.read import load_recording
    from t2d_rt.view import MOST_RECORDINGS, Viewer, check_page, told

    sources = [Path(each) for each in options.file or []]
    if not 1 <= len(sources) <= MOST_RECORDINGS:
        raise InputError(f"view takes one recording, or two to show side by side, got {len(sources)} names")
    target = check_page(options.output or sources[0].with_suffix(".html"), overwrite=options.overwrite)
    measured = [each for each in sources if each.suffix.lower() in (".npy", ".bin")]
    if not measured:
        of = f"measured samples, and {sources[0]} is a result, which holds its own radar"
        refuse_options(options, parser(), ("radar", *CAPTURE), of)
    recordings = [
        load_recording(each, options.radar, **capture_options(options)) if each in measured else load_recording(each)
        for each in sources
    ]
    viewer = Viewer(
        recordings, [f"{each.stem}: {told(known)}" for each, known in zip(sources, recordings, strict=True)]
    )
    viewer.save(target, overwrite=options.overwrite)
    say(f"wrote {target} ({len(viewer.html) / 1e6:.1f} MB)")
