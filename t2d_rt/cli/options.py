"""Options of the commands, from the signatures of what they call; their help is what the docstrings there say."""

from __future__ import annotations

import ast
import inspect
import json
import re
import sys
import textwrap
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, Any, get_type_hints

from pydantic import BaseModel

from t2d_rt.cli.arguments import bounded_yaml
from t2d_rt.core.errors import InputError

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace


EXAMPLES = {
    "simulate": """examples:
  t2d-rt simulate walk.bvh -o walk.zarr                      # mesh, table2; writes walk.zarr and walk.png
  t2d-rt simulate walk.bvh --method ellipsoid --radar ci4r
  t2d-rt simulate walk.bvh --radar.prf-hz 12800 --distance-m 4 --seed 3
  t2d-rt simulate walk.bvh --radar my_radar.yaml --signal.mti highpass --overwrite
  t2d-rt simulate walk.bvh --scene living_room --add fan:2,1,1,rpm=300 --add person:other.bvh,distance_m=3
  t2d-rt simulate walk.bvh --print_config > walk.yaml        # every option with its value
  t2d-rt simulate --config walk.yaml
  t2d-rt simulate walk.bvh --noise receiver                  # thermal and phase noise, ADC and so on, typical of the band
  t2d-rt simulate walk.bvh --tolerance-db -25                # as finely as that asks for; the error is measured afterwards""",
    "plan": """examples:
  t2d-rt plan walk.bvh --tolerance-db -25                    # what simulate would model, leave out, and take
  t2d-rt plan walk.bvh --scene living_room --radar ci4r""",
    "compare": """examples:
  t2d-rt compare walk.bvh                                    # writes walk_compare.png, prints the figures
  t2d-rt compare walk.bvh --radar text2doppler-code --angle-deg 45 -o oblique.png
  t2d-rt compare without_fan.zarr with_fan.zarr              # any two recordings
  t2d-rt compare walk.zarr frames.npy --radar r60.yaml --align --relative  # a measured one, clock and level unknown""",
    "scene": """examples:
  t2d-rt scene living_room                                   # writes living_room.png: plan, view, paths to a point ahead
  t2d-rt scene my_room.xml --walk walk.bvh --reflections 2   # with a walker's track, and the paths to it""",
    "info": """examples:
  t2d-rt info walk.bvh                                       # what the reader found in a motion file
  t2d-rt info walk.zarr                                      # what a result holds
  t2d-rt info my_radar.yaml                                  # what a radar resolves""",
    "export": """examples:
  t2d-rt export walk.zarr -o walk.mat                        # ADC cube, spectrogram and axes for MATLAB
  t2d-rt export walk.zarr -o walk.nc                         # for xarray and other readers of NetCDF""",
    "list": """examples:
  t2d-rt list                                                # all names
  t2d-rt list presets                                        # radar presets with what they resolve""",
}


PRINT_CONFIG_HELP = (
    "Prints all options with their values as a config file, and does nothing else; skip_default leaves out defaults."
)


def simulate_parser() -> ArgumentParser:
    """Options of `t2d-rt simulate`."""
    parser = command_parser(
        "simulate",
        "Simulates a motion file or an experiment (.yaml), or a result (.zarr) again; writes the recording and its spectrogram.",
    )
    _add_run(
        parser, output="Folder of the result (.zarr); its picture is written beside it. By default it has FILE's name."
    )
    add_additions(parser)
    _add_background(parser)
    add_model(parser)
    return parser


def add_additions(parser: ArgumentParser) -> None:
    """Further targets."""
    parser.add_argument(
        "--add",
        type=list[str | dict[str, Any]],
        default=[],
        help="A further target, such as fan:X,Y,Z,rpm=900, pet:X,Y,Z,animal=cat or person:FILE,distance_m=3; there are also "
        "ceiling_fan, curtain and door (t2d-rt list movers). The option is given once for each; in a config file it is a list.",
    )


def plan_parser() -> ArgumentParser:
    """Options of `t2d-rt plan`."""
    parser = command_parser(
        "plan",
        "Tells what simulate would model and leave out to keep to a tolerance, for a motion file or an experiment (.yaml), and the "
        "time and memory that it would take.",
    )
    add_piece(parser)
    parser.add_argument(
        "--tolerance_db",
        type=float | None,
        help="Greatest error of the targets' field [dB], its energy relative to the field's own, against a converged model; by "
        "default an experiment's own, and -20 elsewhere.",
    )
    add_model(parser, skip={"tolerance_db", "measure_error"}, signal=False)
    return parser


def compare_parser() -> ArgumentParser:
    """Options of `t2d-rt compare`."""
    from t2d_rt.recording.compare import compare

    parser = command_parser(
        "compare",
        "Compares two recordings, or of one motion file the models ellipsoid and mesh: draws both spectrograms and their "
        "difference, and prints figures.",
        noun="FILE [RECORDING]",
        file="A motion file, or two recordings: .zarr folders of results, .npy or .bin files of measured samples.",
        several=True,
    )
    _add_run(
        parser, output="Picture to write (.png, .pdf or .svg); by default it has FILE's name and ends in _compare.png."
    )
    told = parameter_help(compare)
    for name in ("align", "relative"):
        parser.add_argument(f"--{name}", type=bool, default=False, nargs="?", const=True, help=told[name])
    add_capture_options(parser, radar=False)
    add_model(parser, skip={"method", "tolerance_db", "measure_error"})
    return parser


def scene_parser() -> ArgumentParser:
    """Options of `t2d-rt scene`."""
    parser = command_parser(
        "scene",
        "Draws a room from above and in three dimensions, with the radar, a walker's track and the paths to it.",
        noun="SCENE",
    )
    parser.add_argument(
        "-o", "--output", type=str | None, help="Picture to write (.png, .pdf or .svg); SCENE.png by default."
    )
    add_overwrite(parser)
    parser.add_argument(
        "--walk",
        type=str | None,
        help="Motion file of a walker, or a bundled motion's name; the walker is placed before the radar as simulate does.",
    )
    parser.add_argument(
        "--reflections",
        type=int,
        default=1,
        help="Greatest number of reflections of the paths that are drawn; they lead to the middle of the track.",
    )
    _add_scene_material(parser)
    _add_radar(parser)
    return parser


def info_parser() -> ArgumentParser:
    """Options of `t2d-rt info`."""
    parser = command_parser(
        "info", "Tells what a motion file, a result (.zarr) or a radar file (.yaml) holds.", config=False
    )
    add_reading(parser)
    return parser


def export_parser() -> ArgumentParser:
    """Options of `t2d-rt export`."""
    parser = command_parser(
        "export",
        "Writes the ADC cube, the spectrogram and the axes of a result (.zarr) as one file for other programs.",
        config=False,
    )
    parser.add_argument(
        "-o",
        "--output",
        type=str | None,
        help="File to write; its ending says its format: .mat, .h5, .nc or .npz. By default it has FILE's name and ends in .mat.",
    )
    parser.add_argument(
        "--truth", type=bool, default=False, nargs="?", const=True,
        help="Whether joints, segments and contacts of the targets over time are written too.",
    )  # fmt: skip
    add_overwrite(parser)
    return parser


def list_parser() -> ArgumentParser:
    """Options of `t2d-rt list`."""
    return command_parser(
        "list",
        "Lists the names that the other commands take: presets, scenes, bodies, movers and motions.",
        config=False,
        noun="[WHAT]",
        file="Names to list: presets, scenes, bodies, movers or motions; all of them by default.",
    )


def command_parser(
    command: str,
    description: str,
    *,
    config: bool = True,
    noun: str = "FILE",
    file: str | None = None,
    examples: str | None = None,
    several: bool = False,
) -> ArgumentParser:
    """A parser of a command's options; its bare word is a file, or may be left out and be what `file` says, and be `several`."""
    from argparse import RawDescriptionHelpFormatter

    import yaml
    from jsonargparse import ArgumentParser, DefaultHelpFormatter, set_loader

    class Formatter(DefaultHelpFormatter, RawDescriptionHelpFormatter):
        pass

    set_loader("bounded yaml", bounded_yaml, (yaml.YAMLError,))
    parser = ArgumentParser(
        parser_mode="bounded yaml",
        prog=f"t2d-rt {command}",
        usage=f"t2d-rt {command} {noun} [options]",
        description=description,
        epilog=EXAMPLES[command] if examples is None else examples,
        formatter_class=Formatter,
        exit_on_error=False,
        default_env=False,
        allow_abbrev=False,
    )
    if file is None:
        parser.add_argument(
            "--file", type=str, required=True, help="The file, or a name; the word --file may be left out."
        )
    else:
        parser.add_argument("--file", type=list[str] | None if several else str | None, help=file)
    if config:
        parser.add_argument(
            "--config",
            action="config",
            help="YAML file of options; options on the command line override those in the file.",
        )
        for action in parser._actions:  # the parser adds --print_config by itself
            if action.dest == "print_config":
                action.help = PRINT_CONFIG_HELP
    return parser


CAPTURE = "lanes", "iq", "conjugate"
"""Options of measured samples beside their radar."""


def add_capture_options(parser: ArgumentParser, *, radar: bool = True) -> None:
    """Options of measured samples, which `capture_options` gives to `load_recording`; their radar, unless there is one already."""
    if radar:
        told = "Radar of measured samples: a preset's name or a .yaml file; --radar_file is the same."
        parser.add_argument("--radar", "--radar_file", type=str | None, help=told)
    parser.add_argument("--lanes", type=int | None, help="LVDS lanes, 2 or 4, of raw captures of TI's DCA1000 (.bin).")
    parser.add_argument(
        "--iq", type=str, default="IQ", help="Order of measured samples' channels: IQ, QI, or I for real samples."
    )
    told = "Whether the IF of measured samples is the conjugate of the one here, whose beats are positive; false: it surely is not."
    parser.add_argument("--conjugate", type=bool | None, nargs="?", const=True, help=told)


def capture_options(options: Namespace) -> dict[str, Any]:
    """Keywords of `load_recording` that were given."""
    return {name: options[name] for name in CAPTURE}


def refuse_options(options: Namespace, parser: ArgumentParser, names: Collection[str], told: str) -> None:
    """Refuses options that were given and would have no effect: `told` says of what they are, and what there is."""
    for name in names:
        if options[name] != parser.get_default(name):
            raise InputError(f"option {name} is of {told}; leave it out")


def _add_background(parser: ArgumentParser) -> None:
    group = parser.add_argument_group("background of the spectrogram")
    told = "Background that is added: default, or a model (.safetensors) that t2d-rt background train wrote; none by default."
    group.add_argument("--background", type=str | None, help=told)
    group.add_argument("--background_seed", type=int | None, help="Seed of the background; 0 by default.")
    told = "Level of its noise floor [dB re 1 W]; by default that of one of the recordings that it was learned from."
    group.add_argument("--background_level_db", type=float | None, help=told)


def add_overwrite(parser: ArgumentParser) -> None:
    """Whether what is there is replaced."""
    told = "Whether a file or folder of that name is replaced; without it an existing one is an error."
    parser.add_argument("--overwrite", type=bool, default=False, nargs="?", const=True, help=told)


def _add_run(parser: ArgumentParser, *, output: str) -> None:
    parser.add_argument("-o", "--output", type=str | None, help=output)
    add_overwrite(parser)
    add_piece(parser)


def add_piece(parser: ArgumentParser) -> None:
    """Which piece of a motion is used, and where it starts."""
    parser.add_argument(
        "--distance_m",
        type=float | None,
        help="Distance from the radar at which the motion starts [m]; by default the one at which its closest approach is 1.5 m.",
    )
    parser.add_argument(
        "--angle_deg",
        type=float,
        default=0.0,
        help="Angle between the walking direction and the line to the radar [deg]; 0 walks towards the radar.",
    )
    parser.add_argument("--start_s", type=float, default=0.0, help="First instant of the motion that is used [s].")
    parser.add_argument(
        "--stop_s", type=float | None, help="Last instant of the motion that is used [s]; its end by default."
    )


def add_reading(parser: ArgumentParser) -> None:
    """How a motion file is read."""
    from t2d_rt.motion import load_motion

    group = parser.add_argument_group("reading the motion file (what is not given is detected)")
    add_parameters(group, load_motion, "motion.")


def add_model(parser: ArgumentParser, skip: Collection[str] = (), *, signal: bool = True) -> None:
    """Options of scene, model, accuracy, radar, reading and, unless there is no `signal`, of the spectrogram."""
    from t2d_rt.propagation.scenes import scene_names
    from t2d_rt.signal import spectrogram
    from t2d_rt.simulate import simulate

    model = parser.add_argument_group("model")
    model.add_argument(
        "--material", type=str | None, help="Material of the body: skin, clothed, pec or an ITU name; skin by default."
    )
    model.add_argument(
        "--scene",
        type=str,
        default="free_space",
        help=f"Scene: free_space, {', '.join(scene_names())}, or a Mitsuba/Sionna XML file.",
    )
    _add_scene_material(model)
    named = ("only_paths", "without_paths")
    add_parameters(model, simulate, skip={"radar", "material", "scene", "progress", "accuracy", "noise", *named, *skip})
    for name in named:
        told = parameter_help(simulate)[name]
        model.add_argument(f"--{name}", action="append", type=str, help=f"{told} The option is given once for each.")
    if "noise" not in skip:  # a receiver is several fields, which it checks itself
        model.add_argument("--noise", type=str | dict[str, Any], default="none", help=parameter_help(simulate)["noise"])
    _add_accuracy(parser)
    _add_radar(parser)
    add_reading(parser)
    if signal:
        add_parameters(parser.add_argument_group("spectrogram"), spectrogram, "signal.")


def _add_scene_material(group: Any) -> None:
    group.add_argument(
        "--scene_material",
        action="append",
        type=str,
        help="Substitutes for materials of the scene that have no values at the radar's frequency or are not known, as "
        "brick=concrete; several with commas between them.",
    )


def _add_accuracy(parser: ArgumentParser) -> None:
    from argparse import SUPPRESS

    from t2d_rt.types import Accuracy

    group = parser.add_argument_group("accuracy (a tolerance chooses the fields that are not given)")
    hints = get_type_hints(Accuracy) | {"tiers": list[dict[str, Any]]}  # tiers check themselves
    for name, field in Accuracy.model_fields.items():
        default = "" if name == "tiers" or field.default is None else f" By default it is {json.dumps(field.default)}."
        help_text = f"{field.description}{default}".replace("%", "%%")
        group.add_argument(f"--accuracy.{name}", type=hints[name], default=SUPPRESS, help=help_text)


def _add_radar(parser: ArgumentParser) -> None:
    from t2d_rt.types import Radar
    from t2d_rt.types.presets import preset_names

    radar = parser.add_argument_group(
        "radar",
        f"--radar NAME takes a preset ({', '.join(preset_names())}), "
        "--radar FILE.yaml takes your own. These options override its fields.",
    )
    default, told = Radar.preset("table2").model_dump(), field_help(Radar)
    for name, hint in get_type_hints(Radar).items():
        if name in Radar.model_fields:
            # A pattern is several fields, which the radar itself checks.
            kind = dict[str, Any] if isinstance(default[name], dict) else hint
            radar.add_argument(f"--radar.{name}", type=kind, default=default[name], help=told[name])


def add_parameters(group: Any, function: Callable[..., Any], prefix: str = "", skip: Collection[str] = ()) -> None:
    """An option for every parameter that has a default; its help is its entry in the docstring, "name: help"."""
    told = parameter_help(function)
    hints = get_type_hints(function)
    for name, parameter in inspect.signature(function).parameters.items():
        if name not in skip and parameter.default is not parameter.empty:
            help_text = told.get(name)
            group.add_argument(f"--{prefix}{name}", type=hints[name], default=parameter.default, help=help_text)


ENTRY = re.compile(r"^( *)(\w+): (.*(?:\n\1 +\S.*)*)", flags=re.MULTILINE)
"""A parameter's entry in a docstring: "name: text", with all further lines that are indented more than the name."""


def parameter_help(function: Callable[..., Any]) -> dict[str, str]:
    """What a function's docstring says about each of its parameters, as a sentence on one line.

    >>> def sail(knots):
    ...     '''Sail.
    ...
    ...     knots: how fast,
    ...         over ground.
    ...     '''
    >>> parameter_help(sail)
    {'knots': 'How fast, over ground.'}
    """
    return {name: one_line(text[0].upper() + text[1:]) for _, name, text in ENTRY.findall(_docstring(function))}


def _docstring(function: Callable[..., Any]) -> str:
    """A function's docstring; `python -OO` drops it, the source still has it."""
    if function.__doc__ is not None or not sys.flags.optimize:
        return function.__doc__ or ""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    return (ast.get_docstring(tree) or "") if isinstance(tree, ast.FunctionDef) else ""


def field_help(model: type[BaseModel]) -> dict[str, str]:
    """What a model's docstrings say about each of its fields, on one line."""
    return {name: one_line(field.description or "") for name, field in model.model_fields.items()}


def one_line(text: str) -> str:
    """A text as the parser wants it: line breaks become spaces, and percent signs are doubled, as they would be placeholders."""
    return " ".join(text.split()).replace("%", "%%")
