"""`t2d-rt check-motion`: says of each motion file whether it is sound, and as what it was asked for."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from t2d_rt.cli.options import add_reading, command_parser
from t2d_rt.cli.output import check_picture, say, write_picture
from t2d_rt.core.checks import choice
from t2d_rt.core.errors import InputError
from t2d_rt.motion import load_motion
from t2d_rt.motion.check import Verdict, check_motion
from t2d_rt.motion.descriptions.slots import ACTIVITIES, Activity
from t2d_rt.types import Motion

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

MOST_ROWS = 64
"""Motions on one contact sheet; more make a picture that nobody can look through."""

DEEP_M = 0.05
"""Depth of the skin in the floor from which it is told: files know their floor to some centimetres, flesh gives way."""

TOLD = "assumed", "turned level", "tilted by", "inclines", "never move", "root motion"
"""Words of a motion's report that the verdict hangs on: a wrong rate is a wrong speed."""

EXAMPLES = """examples:
  t2d-rt check-motion walk.bvh                               # passed, or why not; whether there is a fall in it
  t2d-rt check-motion made/*.bvh --class falling --strict    # exit code 1 where one is not a sound fall
  t2d-rt check-motion made/*.bvh --sheet made.png            # and a picture of each, skinned, over time"""


def parser() -> ArgumentParser:
    """Options of `t2d-rt check-motion`."""
    found = command_parser(
        "check-motion",
        "Judges motion files by limits of recorded motion (sliding feet, floor, flight, jerk, joints, jumps) and tells falls. "
        "The exit code is 0 when all files were judged, whatever the verdicts (see --strict), and 2 where one cannot be read.",
        config=False,
        noun="FILE...",
        file="Motion files of any format that simulate reads; the word --file may be left out.",
        examples=EXAMPLES,
        several=True,
    )
    found.add_argument(
        "--class", dest="class", type=str | None, help=f"What the motions should be: {', '.join(ACTIVITIES)}."
    )
    found.add_argument("--strict", action="store_true", help="Whether the exit code is 1 where a motion does not pass.")
    found.add_argument(
        "--sheet", type=str | None, help="Picture to write (.png, .pdf or .svg): each motion's skinned body over time."
    )
    found.add_argument(
        "--body",
        type=str,
        default="adult",
        help="Body on the sheet, whose skin is looked for below the floor (t2d-rt list bodies).",
    )
    found.add_argument(
        "--overwrite",
        action="store_true",
        help="Whether a picture of that name is replaced; without it one is an error.",
    )
    add_reading(found)
    return found


def run(options: Namespace) -> int:
    """Judges all files before it prints or draws; 1 where one does not pass and --strict is given, 2 where one cannot be read."""
    files = [Path(name) for name in options.file or []]
    if not files:
        raise InputError("check-motion needs a motion file; t2d-rt check-motion FILE...")
    expected = options["class"]
    if expected is not None:
        choice("class", expected, ACTIVITIES)
    picture = Path(options.sheet) if options.sheet is not None else None
    if picture is not None:
        check_picture(picture, overwrite=options.overwrite)
        if len(files) > MOST_ROWS:
            raise InputError(
                f"a sheet has {MOST_ROWS} motions at most, got {len(files)}; give fewer, or leave out --sheet"
            )
    named = len(files)
    motions, files = _read(files, options.motion.as_dict())
    verdicts = [check_motion(motion, expected=cast(Activity | None, expected)) for motion in motions]
    drawn = picture is not None and bool(motions)
    if picture is not None and drawn:
        _draw(picture, files, motions, verdicts, options)
    for path, verdict, motion in zip(files, verdicts, motions, strict=True):
        say(_told(path, verdict, motion, options.body))
    passed = sum(verdict.passed for verdict in verdicts)
    if len(files) > 1:
        say(f"{passed} of {len(files)} pass")
    if drawn:
        say(f"wrote {picture}")
    return 2 if len(files) < named else int(options.strict and passed < len(files))


def _read(files: list[Path], reading: dict[str, Any]) -> tuple[list[Motion], list[Path]]:
    """Motions, and their files; of each that cannot be read a line says why."""
    motions, read = [], []
    for path in files:
        try:
            motions.append(load_motion(path, **reading))
        except InputError as error:
            say(f"t2d-rt: {' '.join(str(error).split())}", file=sys.stderr)
        else:
            read.append(path)
    return motions, read


def _draw(picture: Path, files: list[Path], motions: list[Motion], verdicts: list[Verdict], options: Namespace) -> None:
    from t2d_rt.view.contact_sheet import contact_sheet

    labels = [
        f"{path.name}\n{'passed' if each.passed else 'refused'}" for path, each in zip(files, verdicts, strict=True)
    ]
    write_picture(contact_sheet(motions, labels=labels, body=options.body), picture, overwrite=options.overwrite)


def _told(path: Path, verdict: Verdict, motion: Motion, body: str) -> str:
    from t2d_rt.body import depth_m

    lines = [f"{path}: {'passed' if verdict.passed else 'refused'}"]
    lines += [f"  {clause}" for clause in motion.report.split("; ") if any(word in clause for word in TOLD)]
    lines += [f"  {reason}" for reason in verdict.reasons]
    if (deep_m := depth_m(motion, body)) > DEEP_M:
        lines.append(f"  skin: body {body} reaches {100 * deep_m:.1f} cm below the floor at z = 0")
    if verdict.fall.happened:
        lines.append(f"  fall: {verdict.fall.reason}")
    return "\n".join(lines)
