"""The command line: `t2d-rt COMMAND`, each of `COMMANDS`."""

from __future__ import annotations

import io
import os
import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

try:
    from t2d_rt.cli.output import say, stopped_by_sigterm
    from t2d_rt.core.checks import unknown_name
    from t2d_rt.core.errors import T2DError, T2DWarning
except KeyboardInterrupt:  # Ctrl-C while the program loads
    print("t2d-rt: stopped; nothing was written", file=sys.stderr)
    sys.exit(130)

if TYPE_CHECKING:
    from t2d_rt.cli.options import Command

COMMANDS = {
    "simulate": ("simulations", "FILE", "Simulates a motion file or an experiment (.yaml), or a result (.zarr) again."),
    "plan": ("simulations", "FILE", "Tells what a tolerance would model and leave out, and the time and memory it would take."),
    "process": ("recordings", "CAPTURE", "Draws the maps of a measured capture, beside a simulation too, and tells vital signs."),
    "compare": ("recordings", "A B", "Compares two recordings, or the ellipsoid model of a motion file with the mesh model."),
    "sweep": ("sweeps", "FILE", "Simulates with some options varied: panels on one scale, and a table of differences."),
    "plot": ("recordings", "RECORDING", "Draws a map of a recording for a paper, or animates body and spectrogram (.gif, .mp4)."),
    "scene": ("recordings", "NAME", "Draws a room from above and in three dimensions, with the paths from the radar to a walker."),
    "paths": ("simulations", "FILE", "Tells over which paths a target is seen: delay, range, speed, level and directions of each."),
    "view": ("recordings", "RECORDING", "Writes one HTML file that shows body, room, paths and maps of a recording, or of two."),
    "motion": ("motions", "SENTENCE", "Makes a motion file of what a sentence says that a person does."),
    "describe": ("motions", "[SENTENCE]", "Writes descriptions of activities, or reads a sentence's slots."),
    "check-motion": ("motions", "FILE...", "Judges motion files by limits of recorded motion, and tells why."),
    "library": ("motions", "DO WHAT", "Adds motion files of your own to those that motions are made of, lists and removes them."),
    "dataset": ("datasets", "RECIPE", "Makes a data set: thousands of labelled samples from one recipe, in shards."),
    "background": ("background", "DO WHAT", "Learns the background of empty rooms or of recordings, samples and evaluates it."),
    "train": ("learn", "DATA", "Trains a classifier on a data set's spectrograms."),
    "evaluate": ("learn", "DATA", "Tests a trained classifier on a data set."),
    "predict": ("learn", "RECORDING", "Tells what a person does in a recording, over time, with probabilities."),
    "info": ("recordings", "FILE", "Tells what a motion, a result, a radar or an experiment holds."),
    "export": ("recordings", "FILE", "Writes a result as one file for MATLAB (.mat), HDF5 (.h5), NetCDF (.nc) or NumPy (.npz)."),
    "list": ("recordings", "[WHAT]", "Lists names that the commands take: presets, scenes, bodies, movers and motions."),
}  # fmt: skip
"""For each command the module of its function, the word that follows it, and what it does."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command and returns its exit code: 0 when it is done (1 where its --strict says so, 3 where samples failed), 2 with
    one sentence when the input cannot be used, 130 on Ctrl-C, 141 where nobody reads the output; on SIGTERM the process exits with
    143."""
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
        from t2d_rt.core.plugins import versions

        say(versions()["t2d-rt"])
        return 0
    if arguments[0] in ("-h", "--help") or arguments in (["help"], ["help", "help"]):
        say(_overview())
        return 0
    if arguments[0] == "help":
        _command(arguments[1]).parser.print_help()
        return 0
    code = _command(arguments[0]).run(arguments[1:])
    if sys.stdout is not None:  # closed by the caller
        sys.stdout.flush()
    return code or 0


def _command(name: str) -> Command:
    if name not in COMMANDS:
        raise unknown_name("command", name, COMMANDS, hint=" (t2d-rt --help)")
    from t2d_rt.cli.options import Command

    module, noun, _ = COMMANDS[name]
    function = "names" if name == "list" else name.replace("-", "_")
    return Command(name, getattr(import_module(f"t2d_rt.cli.{module}"), function), noun)


def _overview() -> str:
    lines = (f"  t2d-rt {f'{name} {noun}':23}{summary}" for name, (_, noun, summary) in COMMANDS.items())
    return (
        "t2d-rt: ray-traced human micro-Doppler; skeleton motion in, coherent FMCW radar data out\n\n"
        + "\n".join(lines)
        + "\n\nt2d-rt COMMAND --help shows the options of a command, and examples."
    )


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    say(f"t2d-rt: warning: {message}", file=sys.stderr)
