"""`t2d-rt library`: clips of your own beside those that ship."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from t2d_rt.cli.options import command_parser
from t2d_rt.cli.output import say
from t2d_rt.core.errors import InputError

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

EXAMPLES = """examples:
  t2d-rt library add recordings --index clips.csv            # clips.csv: file,class,action[,start_s,stop_s,direction,speed,text]
  t2d-rt library list                                        # what there is: clips that ship, and yours
  t2d-rt library remove recordings                           # takes them out of the library; the files stay"""

VERBS = "add", "list", "remove"


def parser() -> ArgumentParser:
    """Options of `t2d-rt library`."""
    found = command_parser(
        "library",
        "Adds motion files of yours to the clips that t2d-rt motion chooses from, by path, without copying; lists, removes.",
        config=False,
        noun="add DIR --index FILE.csv | list | remove PATH",
        file="One of add, list and remove, and the folder or file.",
        examples=EXAMPLES,
        several=True,
    )
    found.add_argument(
        "--index",
        type=str | None,
        help="Table of the clips in DIR (.csv): columns file, class, action, and any of start_s, stop_s, direction, speed, text.",
    )
    found.add_argument(
        "--library",
        type=str | None,
        help="Index that holds your clips; by default t2d-rt/library.csv in your folder for data.",
    )
    return found


def run(options: Namespace) -> None:
    """Adds, lists or removes."""
    verb, *paths = options.file or [""]
    if verb not in VERBS:
        raise InputError(
            f"library needs one of {', '.join(VERBS)}, got {verb or 'nothing'}; t2d-rt library --help shows examples"
        )
    if len(paths) != (verb != "list"):
        raise InputError(f"library {verb} takes {'no path' if verb == 'list' else 'one path'}, got {len(paths)}")
    if (options.index is not None) != (verb == "add"):
        raise InputError(
            "library add needs the table of clips; give --index FILE.csv"
            if verb == "add"
            else "--index belongs to library add"
        )
    {"add": _add, "list": _list, "remove": _remove}[verb](options, paths)


def _add(options: Namespace, paths: list[str]) -> None:
    from t2d_rt.motion.generate.library.users import add, registry

    found, replaced = add(paths[0], options.index, library=options.library)
    instead = f", in place of {replaced} that it had of the same files" if replaced else ""
    say(
        f"added {len(found)} clips ({_counted(row['action'] for row in found)}) to {options.library or registry()}{instead}"
    )


def _remove(options: Namespace, paths: list[str]) -> None:
    from t2d_rt.motion.generate.library.users import registry, remove

    say(
        f"removed {remove(paths[0], library=options.library)} clips from {options.library or registry()}; their files stay"
    )


def _list(options: Namespace, paths: list[str]) -> None:
    from t2d_rt.motion.generate.library.store import RATE_HZ, shipped
    from t2d_rt.motion.generate.library.users import registry, with_users

    index = options.library or registry()
    store = with_users(shipped(), index) if options.library or Path(index).is_file() else shipped()
    ship = [each for each in store.segments if each.clip not in store.own]
    say(f"{len(ship)} clips ship: {_counted(each.action for each in ship)}")
    for each in store.segments:
        if each.clip in store.own:
            say(
                f"{store.own[each.clip]}: {each.action}, {each.start / RATE_HZ:.2f} to {(each.stop - 1) / RATE_HZ:.2f} s, "
                f"{each.speed_mps:.2f} m/s"
            )


def _counted(actions: Iterable[str]) -> str:
    return ", ".join(f"{count} {action.replace('_', ' ')}" for action, count in sorted(Counter(actions).items()))
