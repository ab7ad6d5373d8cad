"""`t2d-rt gap`: how simulated maps differ from real ones, before any training."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from t2d_rt.cli.options import command_parser
from t2d_rt.cli.output import check_picture, say, write_picture
from t2d_rt.cli.transfer import add_real, compared
from t2d_rt.core.errors import InputError

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

EXAMPLES = """examples:
  t2d-rt gap twins parrad_part1.npz -o gap.md        # text, and beside it gap.png with maps of each class"""


def parser() -> ArgumentParser:
    """Options of `t2d-rt gap`."""
    found = command_parser(
        "gap",
        "Compares simulated twins with real recordings, class by class: extents, speeds, cadence, levels, and how well a "
        "classifier tells them apart. Needs the extra [learn].",
        config=False,
        noun="TWINS REAL -o FILE.md",
        file="Folder of twins, and the real data.",
        examples=EXAMPLES,
        several=True,
    )
    found.add_argument(
        "-o", "--output", type=str | None, help="Text to write (.md); a picture of maps is written beside it."
    )
    told = "Whether files of that name are replaced; without it existing ones are an error."
    found.add_argument("--overwrite", type=bool, default=False, nargs="?", const=True, help=told)
    add_real(found)
    return found


def run(options: Namespace) -> None:
    """Writes the comparison."""
    from t2d_rt.core.atomic_write import check_place, check_taken, replacing
    from t2d_rt.learn.gap import domain_gap, plot_gap
    from t2d_rt.learn.require import require_learning

    names = options.file or []
    if len(names) != 2 or options.output is None or not options.output.endswith(".md"):
        raise InputError(
            f"gap takes the folder of twins, the real data and -o FILE.md, got {' '.join(names) or 'no name'}"
        )
    require_learning()
    target = Path(options.output)
    picture = target.with_suffix(".png")
    check_place(target, overwrite=options.overwrite)
    check_picture(picture, overwrite=options.overwrite)
    real, simulated = compared(names[1], names[0], options)
    text = f"{domain_gap(simulated, real.maps)}\nReal: {real}\n"
    with replacing(target, partial(check_taken, target, overwrite=options.overwrite)) as new:
        new.write_text(text, encoding="utf-8")
    write_picture(plot_gap(simulated, real.maps), picture, overwrite=options.overwrite)
    say(f"wrote {target} and {picture}")
