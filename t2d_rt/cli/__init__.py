"""The command line: `t2d-rt COMMAND`, each of `COMMANDS`."""

from __future__ import annotations

import io
import os
import re
import sys
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

try:
    from t2d_rt.cli import commands, options
    from t2d_rt.cli.arguments import check_nulls, one_sentence, resolved
    from t2d_rt.cli.output import say
    from t2d_rt.cli.sigterm import stopped_by_sigterm
    from t2d_rt.core.checks import unknown_name
    from t2d_rt.core.errors import InputError, T2DError, T2DWarning
except KeyboardInterrupt:  # Ctrl-C while the program loads
    print("t2d-rt: stopped; nothing was written", file=sys.stderr)
    sys.exit(130)

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

COMMANDS = (
    "simulate", "plan", "compare", "sweep", "plot", "scene", "paths", "view", "describe", "motion", "check-motion", "library",
    "dataset", "background", "train", "evaluate", "predict", "info", "export", "list",
)  # fmt: skip

OWN_MODULES = (
    "sweep", "plot", "paths", "view", "describe", "motion", "check-motion", "library", "dataset", "background",
)  # fmt: skip
"""Commands with a module of their own: its `parser` makes the options, its `run` does what they say."""

CONFIGURABLE = "simulate", "plan", "compare", "sweep", "scene", "paths"
"""Those that take --config, and --radar with fields that override it."""

SEVERAL_FILES = "compare", "view", "check-motion", "library", "dataset", "background", "train", "evaluate", "predict"
"""Those that take more than one file."""

STUDIES = {"benchmark": "benchmark (or fidelity, conditions)", "transfer": "transfer (or twins)", "gap": "gap"}
"""Commands that were, each with the study that does the same."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; 0 when it is done (1 where its --strict says so, 3 where samples failed), 2 with one sentence when the input
    cannot be used, 130 on Ctrl-C, 143 on SIGTERM."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    # Pictures are drawn in memory; matplotlib would refuse to load where this names a backend that it does not know.
    os.environ["MPLBACKEND"] = "agg"
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a name that the terminal cannot show is no reason to fail
            stream.reconfigure(errors="backslashreplace")
    with warnings.catch_warnings():
        warnings.simplefilter("always", T2DWarning)
        warnings.showwarning = _show_warning
        try:
            with stopped_by_sigterm():
                return _run(arguments)
        except T2DError as error:
            return _failed(str(error))
        except MemoryError as error:
            return _failed(
                f"not enough memory ({error}); a shorter motion (--start-s, --stop-s), a lower --radar.prf-hz or fewer "
                "--radar.samples take less"
            )
        except BrokenPipeError:  # the reader of our output has gone: nothing more to say, not even at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 141
        except OSError as error:
            return _failed(f"{error.filename or 'system'}: {error.strerror or error}; check the path")
        except KeyboardInterrupt as stopped:
            written = getattr(stopped, "__notes__", None) or ["nothing was written"]
            say(f"t2d-rt: stopped; {', '.join(written)}", file=sys.stderr)
            return 130


def _failed(sentence: str) -> int:
    say(f"t2d-rt: {' '.join(sentence.split())}", file=sys.stderr)
    return 2


def _run(arguments: list[str]) -> int:
    if not arguments:
        say(_overview(), file=sys.stderr)
        return 2
    if arguments[0] == "--version":
        from t2d_rt.core.versions import versions

        say(versions()["t2d-rt"])
        return 0
    if arguments[0] in ("-h", "--help") or arguments in (["help"], ["help", "help"]):
        say(_overview())
        return 0
    if arguments[0] == "help":
        parser, _ = _command(arguments[1])
        parser.print_help()
        return 0
    from jsonargparse import ArgumentError

    parser, action = _command(arguments[0])
    try:
        name = arguments[0]
        varied: dict[str, list[str]] | None = {} if name == "sweep" else None
        words = resolved(arguments[1:], configurable=name in CONFIGURABLE, several=name in SEVERAL_FILES, varied=varied)
        given = parser.parse_args(words)
        check_nulls(parser, given)
        if varied is not None:
            given["varied"] = varied
        if name == "compare":
            given["named_radar"] = any(re.search(r"^(--config=)?radar:", word, re.MULTILINE) for word in words)
    except ArgumentError as error:
        raise InputError(one_sentence(str(error), arguments[0], _options_of(parser))) from None
    except OverflowError:  # of an integer that no float holds
        raise InputError(
            f"an option of {arguments[0]} got a number of more than 300 digits; give it in SI units, as in 77e9"
        ) from None
    code = action(given)
    if sys.stdout is not None:  # closed by the caller
        sys.stdout.flush()
    return code or 0


def _options_of(parser: ArgumentParser) -> list[str]:
    return [each for action in parser._actions for each in action.option_strings]


def _command(name: str) -> tuple[ArgumentParser, Callable[[Namespace], int | None]]:
    known: dict[str, tuple[Callable[[], ArgumentParser], Callable[[Namespace], int | None]]] = {
        "simulate": (options.simulate_parser, commands.simulate_command),
        "plan": (options.plan_parser, commands.plan_command),
        "compare": (options.compare_parser, commands.compare_command),
        "scene": (options.scene_parser, commands.scene_command),
        "info": (options.info_parser, commands.info_command),
        "export": (options.export_parser, commands.export_command),
        "list": (options.list_parser, commands.list_command),
    }
    if name in STUDIES:
        raise InputError(
            f"{name} is a study now and no command; run python -m validation study {STUDIES[name]} in a clone of t2d-rt"
        )
    if name not in COMMANDS:
        raise unknown_name("command", name, COMMANDS, hint=" (t2d-rt --help)")
    if name in ("train", "evaluate", "predict"):
        module = import_module("t2d_rt.cli.learn")
        return getattr(module, f"{name}_parser")(), getattr(module, f"{name}_command")
    if name in OWN_MODULES:
        module = import_module(f"t2d_rt.cli.{name.replace('-', '_')}")
        return module.parser(), module.run
    make, action = known[name]
    return make(), action


def _overview() -> str:
    return (
        "t2d-rt: ray-traced human micro-Doppler; skeleton motion in, coherent FMCW radar data out\n\n"
        "  t2d-rt simulate FILE   Simulates a motion file or an experiment (.yaml), or a result (.zarr) again.\n"
        "  t2d-rt plan FILE       Tells what an error tolerance would model and leave out, and the time and memory it would take.\n"
        "  t2d-rt compare A B     Compares two recordings, or the ellipsoid model of a motion file with the mesh model.\n"
        "  t2d-rt sweep FILE      Simulates with some options varied: panels on one scale, and a table of differences.\n"
        "  t2d-rt plot RECORDING  Draws a map of a recording for a paper, or animates body and spectrogram (.gif, .mp4).\n"
        "  t2d-rt scene NAME      Draws a room from above and in three dimensions, with the paths from the radar to a walker.\n"
        "  t2d-rt paths FILE      Tells over which paths a target is seen: delay, range, speed, level and directions of each.\n"
        "  t2d-rt view RECORDING  Writes one HTML file that shows body, room, paths and maps of a recording, or of two.\n"
        "  t2d-rt motion SENTENCE Makes a motion file of what a sentence says that a person does.\n"
        "  t2d-rt describe        Writes descriptions of activities, or reads a sentence's slots.\n"
        "  t2d-rt check-motion F  Judges motion files by limits of recorded motion, and tells why.\n"
        "  t2d-rt library DO WHAT Adds motion files of your own to those that motions are made of, lists and removes them.\n"
        "  t2d-rt dataset RECIPE  Makes a data set: thousands of labelled samples from one recipe, in shards.\n"
        "  t2d-rt background DO   Learns the background of empty rooms or of your recordings, samples and evaluates it.\n"
        "  t2d-rt train DATA      Trains a classifier on a data set's spectrograms.\n"
        "  t2d-rt evaluate DATA   Tests a trained classifier on a data set.\n"
        "  t2d-rt predict FILE    Tells what a person does in a recording, over time, with probabilities.\n"
        "  t2d-rt info FILE       Tells what a motion, a result or a radar file holds.\n"
        "  t2d-rt export FILE     Writes a result as one file for MATLAB (.mat), HDF5 (.h5), NetCDF (.nc) or NumPy (.npz).\n"
        "  t2d-rt list [WHAT]     Lists names that the commands take: presets, scenes, bodies, movers and motions.\n\n"
        "t2d-rt COMMAND --help shows the options of a command, and examples."
    )


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    say(f"t2d-rt: warning: {message}", file=sys.stderr)
