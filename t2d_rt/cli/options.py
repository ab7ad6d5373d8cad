"""Options of the commands, from the signatures of what they call; config files, radars by name; the parser's complaints."""

from __future__ import annotations

import inspect
import json
import re
from collections import deque
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

from t2d_rt.checks import shown
from t2d_rt.cli.help import field_help, parameter_help
from t2d_rt.errors import InputError
from t2d_rt.files import load_yaml, read_yaml

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
  t2d-rt simulate walk.bvh --tolerance-db -25                # as finely as that asks for; the error is measured afterwards""",
    "plan": """examples:
  t2d-rt plan walk.bvh --tolerance-db -25                    # what simulate would model, leave out, and take
  t2d-rt plan walk.bvh --scene living_room --radar ci4r""",
    "compare": """examples:
  t2d-rt compare walk.bvh                                    # writes walk_compare.png, prints the figures
  t2d-rt compare walk.bvh --radar text2doppler-code --angle-deg 45 -o oblique.png""",
    "scene": """examples:
  t2d-rt scene living_room                                   # writes living_room.png: plan, view, ways to a point ahead
  t2d-rt scene my_room.xml --walk walk.bvh --reflections 2   # with a walker's track, and the ways to it""",
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


SIGNAL_HELP = {
    "range_window": "Window over the samples of a chirp.",
    "range_gate_m": "Nearest and farthest range to use [m], [1, 5]; all by default.",
    "mti": "Filter against what stands still: none, mean, highpass or canceller; mean by default where there is clutter.",
    "cutoff_mps": "Speed below which mti highpass filters [m/s].",
    "kernel": "Weights of the chirps that mti canceller adds up.",
    "combine": "How range bins are added: noncoherent (powers) or coherent (fields).",
    "window": "Window over the chirps of a column.",
    "n_window": "Chirps of a column; 256 by default.",
    "overlap": "Chirps that columns share; 200 of 256 by default.",
    "n_fft": "Doppler bins of a column; n_window by default.",
}
"""Help of the options of `signal.spectrogram`."""

FLAGS = ("--overwrite", "--help", "--print_config")
"""Options that need no value."""

PLAIN_TYPES = {
    "<class 'float'>": "a number",
    "<class 'int'>": "a whole number",
    "<class 'bool'>": "true or false",
    "<class 'str'>": "a text",
    "<class 'tuple'>": "a list such as [1, 2.5]",
    "<class 'collections.abc.Sequence'>": "a list such as [1, -2, 1]",
    "<class 'list'>": "a list such as [fan:2,1,1, pet:3,0,0]",
    "<class 'dict'>": "a mapping such as {kind: fan, position_m: [2, 1, 1]}",
    "<class 'NoneType'>": "null",
}
"""What the parser says, in words of its users."""


def simulate_parser() -> ArgumentParser:
    """Options of `t2d-rt simulate`."""
    parser = _parser(
        "simulate",
        "Radar recording and micro-Doppler spectrogram of a motion file, of an experiment (.yaml), or of a result (.zarr) again.",
    )
    _add_run(parser, output="Result folder (.zarr), the picture beside it; FILE's name by default.")
    parser.add_argument(
        "--add",
        type=list[str | dict[str, Any]],
        default=[],
        help="What moves beside it, once for each: fan:X,Y,Z,rpm=900, ceiling_fan:, curtain:, door:, pet:X,Y,Z,animal=cat, "
        "person:FILE,distance_m=3; in a config file a list.",
    )
    _add_model(parser)
    return parser


def plan_parser() -> ArgumentParser:
    """Options of `t2d-rt plan`."""
    parser = _parser(
        "plan", "What simulate would model to keep to a tolerance, what it would leave out, and what that costs."
    )
    _add_piece(parser)
    parser.add_argument(
        "--tolerance_db", type=float, default=-20.0, help="Error to keep to: field NMSE against a converged model [dB]."
    )
    _add_model(parser, skip={"tolerance_db", "measure_error"}, signal=False)
    return parser


def compare_parser() -> ArgumentParser:
    """Options of `t2d-rt compare`."""
    parser = _parser("compare", "Ellipsoid model against mesh: both spectrograms, their difference, and figures.")
    _add_run(parser, output="Picture (.png, .pdf, .svg); FILE's name with _compare.png by default.")
    _add_model(parser, skip={"method", "tolerance_db", "measure_error"})
    return parser


def scene_parser() -> ArgumentParser:
    """Options of `t2d-rt scene`."""
    parser = _parser(
        "scene", "Plan and view of a room, with the radar, a walker's track, and the ways to it.", noun="SCENE"
    )
    parser.add_argument("-o", "--output", type=str | None, help="Picture (.png, .pdf, .svg); SCENE.png by default.")
    parser.add_argument("--overwrite", type=bool, default=False, nargs="?", const=True, help="Replace what is there.")
    parser.add_argument("--walk", type=str | None, help="Motion file, placed before the radar as by simulate.")
    parser.add_argument(
        "--reflections", type=int, default=1, help="Ways by up to as many reflections are drawn, to the track's middle."
    )
    _add_radar(parser)
    return parser


def info_parser() -> ArgumentParser:
    """Options of `t2d-rt info`."""
    return _parser("info", "What a motion file (.bvh), a result (.zarr) or a radar (.yaml) holds.", config=False)


def export_parser() -> ArgumentParser:
    """Options of `t2d-rt export`."""
    parser = _parser("export", "ADC cube, spectrogram and axes of a result (.zarr) as one file.", config=False)
    parser.add_argument(
        "-o",
        "--output",
        type=str | None,
        help="File to write, its kind by its ending: .mat, .h5, .nc or .npz; FILE's name with .mat by default.",
    )
    parser.add_argument("--overwrite", type=bool, default=False, nargs="?", const=True, help="Replace what is there.")
    return parser


def list_parser() -> ArgumentParser:
    """Options of `t2d-rt list`."""
    return _parser(
        "list",
        "Names that the other commands take: presets, scenes, bodies, movers, motions.",
        config=False,
        noun="[WHAT]",
        file="What to list: presets, scenes, bodies, movers or motions; all of them by default.",
    )


def _parser(
    command: str, description: str, *, config: bool = True, noun: str = "FILE", file: str | None = None
) -> ArgumentParser:
    """A parser of a command's options; its bare word is a file, or may be left out and is what `file` says."""
    from argparse import RawDescriptionHelpFormatter

    import yaml
    from jsonargparse import ArgumentParser, DefaultHelpFormatter, set_loader

    class Formatter(DefaultHelpFormatter, RawDescriptionHelpFormatter):
        pass

    set_loader("bounded yaml", _bounded_yaml, (yaml.YAMLError,))
    parser = ArgumentParser(
        parser_mode="bounded yaml",
        prog=f"t2d-rt {command}",
        usage=f"t2d-rt {command} {noun} [options]",
        description=description,
        epilog=EXAMPLES[command],
        formatter_class=Formatter,
        exit_on_error=False,
        default_env=False,
        allow_abbrev=False,
    )
    if file is None:
        parser.add_argument("--file", type=str, required=True, help="The file, if it is not given without --file.")
    else:
        parser.add_argument("--file", type=str | None, help=file)
    if config:
        parser.add_argument(
            "--config", action="config", help="YAML file of options; those given beside it override it."
        )
    return parser


def _add_run(parser: ArgumentParser, *, output: str) -> None:
    parser.add_argument("-o", "--output", type=str | None, help=output)
    parser.add_argument("--overwrite", type=bool, default=False, nargs="?", const=True, help="Replace what is there.")
    _add_piece(parser)


def _add_piece(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--distance_m",
        type=float | None,
        help="Distance of the start from the radar [m]; by default the closest approach is 1.5 m.",
    )
    parser.add_argument(
        "--angle_deg", type=float, default=0.0, help="Angle of the walk against the line to the radar [degrees]."
    )
    parser.add_argument("--start_s", type=float, default=0.0, help="First moment of the motion to use [s].")
    parser.add_argument("--stop_s", type=float | None, help="Last moment of the motion to use [s]; its end by default.")


def _add_model(parser: ArgumentParser, skip: Collection[str] = (), *, signal: bool = True) -> None:
    from t2d_rt.motion import load_motion
    from t2d_rt.propagation.scenes import scene_names
    from t2d_rt.signal import spectrogram
    from t2d_rt.simulate import simulate

    model = parser.add_argument_group("model")
    model.add_argument(
        "--material", type=str | None, help="of the body: skin, clothed, pec or an ITU name; skin by default."
    )
    model.add_argument(
        "--scene",
        type=str,
        default="free_space",
        help=f"free_space, {', '.join(scene_names())}, or a Mitsuba/Sionna XML file.",
    )
    _add_parameters(model, simulate, skip={"radar", "material", "scene", "progress", "accuracy", *skip})
    _add_accuracy(parser)
    _add_radar(parser)
    _add_parameters(
        parser.add_argument_group("reading the file, where it is not understood by itself"), load_motion, "motion."
    )
    if signal:
        _add_parameters(parser.add_argument_group("spectrogram"), spectrogram, "signal.")


def _add_accuracy(parser: ArgumentParser) -> None:
    from argparse import SUPPRESS

    from t2d_rt.types import Accuracy

    group = parser.add_argument_group("accuracy: what is given here stays, and a tolerance decides on the rest")
    for name, field in Accuracy.model_fields.items():
        default = "" if name == "tiers" or field.default is None else f" By default it is {json.dumps(field.default)}."
        kind = get_type_hints(Accuracy)[name]
        if name == "tiers":  # checked by the tiers themselves
            kind = list[dict[str, Any]]
        help_text = f"{field.description}{default}".replace("%", "%%")
        group.add_argument(f"--accuracy.{name}", type=kind, default=SUPPRESS, help=help_text)


def _add_radar(parser: ArgumentParser) -> None:
    from t2d_rt.types import Radar
    from t2d_rt.types.radar import preset_names

    radar = parser.add_argument_group(
        "radar",
        f"--radar NAME takes a preset ({', '.join(preset_names())}), --radar FILE.yaml your own; fields override:",
    )
    default, told = Radar.preset("table2").model_dump(), field_help(Radar)
    for name, hint in get_type_hints(Radar).items():
        if name in Radar.model_fields:
            # A pattern is several fields, which the radar itself checks.
            kind = dict[str, Any] if isinstance(default[name], dict) else hint
            radar.add_argument(f"--radar.{name}", type=kind, default=default[name], help=told[name])


def _add_parameters(group: Any, function: Callable[..., Any], prefix: str = "", skip: Collection[str] = ()) -> None:
    """An option for every parameter that has a default; its help is its entry in the docstring, "name: help"."""
    told = parameter_help(function)
    hints = get_type_hints(function)
    for name, parameter in inspect.signature(function).parameters.items():
        if name not in skip and parameter.default is not parameter.empty:
            help_text = told.get(name, SIGNAL_HELP.get(name))
            group.add_argument(f"--{prefix}{name}", type=hints[name], default=parameter.default, help=help_text)


def resolved(arguments: Sequence[str], *, configurable: bool = True) -> list[str]:
    """Arguments as the parser wants them: --name_with_underscores=value, a bare word as --file, config files and radars first.

    A value may begin with a dash (--motion.up -z). Config files and --radar become texts for --config, in this order, so
    that a radar's fields can be overridden and a preset's name will do, in a config file too; only where the command is
    `configurable`.
    """
    files: list[str] = []
    configs: list[str] = []
    radars: list[str] = []
    added: list[str] = []
    rest: list[str] = []
    waiting = deque(arguments)
    while waiting:
        word = waiting.popleft()
        if word == "--":  # nothing after it is an option
            files.extend(waiting)
            break
        option = re.fullmatch(r"(-o|--[A-Za-z][\w.-]*)(?:=(.*))?", word, flags=re.DOTALL)
        if option is None:
            if re.match("-.", word) and word != "-h":
                raise InputError(f"unknown option {word[:60]}; t2d-rt COMMAND --help lists all")
            (rest if word == "-h" else files).append(word)
            continue
        name = "--output" if option[1] == "-o" else "--" + option[1][2:].replace("-", "_")
        value = option[2]
        if name in ("--config", "--radar") and not configurable:
            raise InputError(f"unknown option {name}; t2d-rt COMMAND --help lists all")
        if value is None and name not in FLAGS and waiting and not re.match(r"--[A-Za-z]|--$|-[oh]$", waiting[0]):
            value = waiting.popleft()
        if value is None:
            if name not in FLAGS:
                raise InputError(f"option {name} needs a value; t2d-rt COMMAND --help lists all")
            rest.append(name)
        elif name == "--config":
            configs.append(f"--config={_config_text(value)}")
        elif name == "--radar":
            radars.append(f"--config={_yaml({'radar': _radar_fields(value)})}")
        elif name == "--add":
            if not value.isascii() and value != value.encode(errors="ignore").decode():
                raise InputError(f"option --add takes a text in UTF-8, got {shown(value)}; rename the file")
            added.append(value)
        elif name in ("--file", "--again"):
            files.append(value)
        else:
            rest.append(f"{name}={value}")
    if len(files) > 1:
        raise InputError(f"expected one file, got {len(files)} ({', '.join(files[:9])}); run once for each")
    rest += [f"--add={_yaml(added)}"] if added else []
    return [*configs, *radars, *(f"--file={name}" for name in files), *rest]


def check_nulls(parser: ArgumentParser, options: Namespace) -> None:
    """Refuses null for options that do not take it: the parser lets it pass in config files, as if it were no value."""
    for name, value in options.items():
        if value is None and parser.get_default(name) is not None:
            again = parser.parse_args(["--file=any", f"--{name}=null"])
            if again[name] is not None:
                raise InputError(f"option {name} must be a text, got null; leave it out to have its default")


def _config_text(path: str) -> str:
    values = read_yaml(
        path, noun="config file", example="options and values such as 'seed: 3'; --print_config shows all"
    )
    if isinstance(values.get("radar"), str):
        values["radar"] = _radar_fields(values["radar"])
    for section in ("radar", "motion", "signal", "accuracy"):
        if section in values and not isinstance(values[section], dict):
            raise InputError(
                f"'{section}' in config file {path} must hold options and values, got {shown(values[section])}"
            )
    return _yaml(values)


def _radar_fields(name: str) -> dict[str, Any]:
    from t2d_rt.types import Radar

    own = Path(name).suffix.lower() in (".yaml", ".yml")
    return (Radar.from_yaml(name) if own else Radar.preset(name)).model_dump(mode="json")


def _yaml(values: dict[str, Any] | list[str]) -> str:
    import yaml

    return str(yaml.safe_dump(values, sort_keys=False))


def _bounded_yaml(text: str) -> Any:
    """A value or config as the parser's own loader reads it, within the limits of `load_yaml`."""
    from jsonargparse import get_loader

    load_yaml(text)
    return get_loader("yaml")(text)


def one_sentence(message: str, command: str) -> str:
    """What the parser found wrong, in plain words."""
    help_command = f"t2d-rt {command} --help"
    wrong = re.match(r'Parser key "(.+?)":', message)
    given = re.search(r"(?:Got|Given) value: (.*)", message, flags=re.DOTALL)
    if wrong and given:
        kinds = re.findall(r"Expected an? (.+?)(?:\. Got value|\n|$)", message)
        expected = dict.fromkeys(word for kind in kinds for word in _plain_type(kind))
        return f"option {wrong[1]} must be {' or '.join(expected)}, got '{_one_line(given[1])}'; see {help_command}"
    if "are required: file" in message:
        return f"no file given; name one, as in the examples of {help_command}"
    unknown = re.search(r"unrecognized arguments: (\S+)|Option '(.+)' is not accepted", message)
    if unknown:
        name = (unknown[1] or unknown[2]).partition("=")[0]
        return f"unknown option {name}; {help_command} lists all"
    return f"{_one_line(message, 300)}; see {help_command}"


def _one_line(text: str, width: int = 100) -> str:
    line = " ".join(text[: 10 * width].split())
    return line if len(line) <= width else line[: width - 3] + "..."


def _plain_type(kind: str) -> list[str]:
    """The parser's word for a type in words of its users: one, or the values there are."""
    if kind.startswith("typing.Literal"):
        return re.findall(r"'([^']*)'", kind)
    count = re.match(r"tuple with (\d+) elements", kind)
    return [f"a list of {count[1]} numbers" if count else PLAIN_TYPES.get(kind, kind)]
