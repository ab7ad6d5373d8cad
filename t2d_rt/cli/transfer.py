"""`t2d-rt transfer`: simulated twins of a real set, and the study of what pre-training on them is worth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from t2d_rt.cli.options import command_parser
from t2d_rt.cli.output import say
from t2d_rt.core.checks import choice
from t2d_rt.core.errors import InputError
from t2d_rt.core.progress import ProgressBar

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

    from t2d_rt.learn.adapters import RealMaps
    from t2d_rt.learn.maps import LabelledMaps

EXAMPLES = """examples:
  t2d-rt transfer twins -o twins --per-class 60               # simulated events of PARrad's radars; goes on where it stopped
  t2d-rt transfer study parrad_part1.npz twins -o study       # all ways to tune, 5, 10, 20 and all real events per class
  t2d-rt transfer study parrad_part1.npz twins --classes five -o study5
  t2d-rt gap twins parrad_part1.npz -o gap.md                 # before any training"""

WORDS = {"twins": 0, "study": 2}
"""Verbs, each with how many names follow it."""
TAKES = {
    "twins": {"per_class", "scene", "method", "seed"},
    "study": {"adapter", "classes", "repeats", "folds", "seed"},
}
DEFAULTS = {
    "per_class": 60,
    "scene": "empty_room",
    "method": "ellipsoid",
    "adapter": "parrad",
    "classes": "four",
    "repeats": 3,
    "folds": 5,
}


def parser() -> ArgumentParser:
    """Options of `t2d-rt transfer`."""
    found = command_parser(
        "transfer",
        "Makes simulated twins of a real set, and tells what a network that learned from them gains from few real events. "
        "Needs the extra [learn].",
        config=False,
        noun="twins -o DIR | study REAL TWINS -o DIR",
        file="One of twins and study; study takes the real data and the folder of twins.",
        examples=EXAMPLES,
        several=True,
    )
    found.add_argument("-o", "--output", type=str | None, help="Folder to write; what was stopped there goes on.")
    found.add_argument("--per_class", type=int | None, help="Of twins: events of each class; 60 by default.")
    found.add_argument(
        "--scene", type=str | None, help="Of twins: a room without furniture, empty_room by default, or free_space."
    )
    found.add_argument("--method", type=str | None, help="Of twins: ellipsoid by default, or mesh.")
    add_real(found, "Of study: ")
    found.add_argument(
        "--repeats", type=int | None, help="Of study: repetitions of the cross-validation; 3 by default."
    )
    found.add_argument("--folds", type=int | None, help="Of study: folds of whole events; 5 by default.")
    found.add_argument("--seed", type=int | None, help="Seed of all that is drawn; 0 by default.")
    return found


def add_real(parser: ArgumentParser, of: str = "") -> None:
    """Options of real data."""
    parser.add_argument(
        "--adapter", type=str | None, help=f"{of}How the real data are read; parrad is the only one with twins."
    )
    parser.add_argument(
        "--classes", type=str | None, help=f"{of}Classes of PARrad: four, where sitting and standing are one, or five."
    )


def run(options: Namespace) -> None:
    """Does what the first word says."""
    verb, *names = options.file or [""]
    if verb not in WORDS:
        raise InputError(
            f"transfer needs one of {', '.join(WORDS)}, got {verb or 'nothing'}; t2d-rt transfer --help shows examples"
        )
    if len(names) != WORDS[verb] or options.output is None:
        raise InputError(
            f"transfer {verb} takes {WORDS[verb]} names and -o, the folder to write, got {' '.join(names) or 'no name'}"
        )
    for name in sorted(set(DEFAULTS) - TAKES[verb]):
        if options[name] is not None:
            raise InputError(f"transfer {verb} takes no --{name.replace('_', '-')}; leave it out")
    {"twins": _twins, "study": _study}[verb](names, options)


def chosen(options: Namespace, name: str) -> str:
    """An option, or its default."""
    return str(DEFAULTS[name] if options[name] is None else options[name])


def compared(real_path: str, twins: str, options: Namespace) -> tuple[RealMaps, LabelledMaps]:
    """Real maps and twins of the same classes."""
    from t2d_rt.learn.adapters import AdapterOptions, read_real
    from t2d_rt.learn.adapters.parrad import FIVE, FOUR
    from t2d_rt.learn.twins import MERGED, read_twins

    if chosen(options, "adapter") != "parrad":
        raise InputError(
            f"there are no twins for the adapter {options.adapter}; in Python run_transfer takes any two sets of maps"
        )
    kinds: Mapping[str, tuple[Mapping[str, str], Mapping[str, str] | None]] = {
        "four": (FOUR, MERGED),
        "five": (FIVE, None),
    }
    labels, merged = kinds[choice("--classes", chosen(options, "classes"), tuple(kinds))]
    return read_real(real_path, "parrad", AdapterOptions(classes=labels)), read_twins(twins, merged)


def _twins(names: list[str], options: Namespace) -> None:
    from t2d_rt.learn.twins import TwinRecipe, make_twins

    method = choice("--method", chosen(options, "method"), ("ellipsoid", "mesh"))
    recipe = TwinRecipe(
        per_class=int(chosen(options, "per_class")), scene=chosen(options, "scene"), seed=options.seed or 0,
        method="mesh" if method == "mesh" else "ellipsoid",
    )  # fmt: skip
    with ProgressBar("twins") as progress:
        folder = make_twins(recipe, options.output, progress=progress)
    say(f"{folder}: {recipe.count} events by two radars")


def _study(names: list[str], options: Namespace) -> None:
    from t2d_rt.learn.require import require_learning

    require_learning()
    from t2d_rt.learn.transfer import StudyOptions, run_transfer
    from t2d_rt.learn.twins import RECIPE

    real, simulated = compared(names[0], names[1], options)
    settings = StudyOptions(
        repeats=int(chosen(options, "repeats")), folds=int(chosen(options, "folds")), seed=options.seed or 0
    )
    say(real)
    sources = {
        "real": str(real),
        "simulated": (Path(names[1]) / RECIPE).read_text(encoding="utf-8").replace("\n", ""),
    }
    with ProgressBar("transfer") as progress:
        run_transfer(real.maps, simulated, options.output, options=settings, sources=sources, progress=progress)
    say(f"wrote {Path(options.output) / 'report.md'} and {Path(options.output) / 'curves.png'}")
