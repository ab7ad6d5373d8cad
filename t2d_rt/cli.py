"""The command line: t2d-rt simulate | compare | info."""

from __future__ import annotations

import inspect
import os
import re
import sys
import time
import warnings
from collections.abc import Callable, Collection, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

from t2d_rt.errors import InputError, T2DError, T2DWarning

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jsonargparse import ArgumentParser, Namespace
    from matplotlib.figure import Figure

    from t2d_rt.result import Simulation
    from t2d_rt.types import Motion, Radar

EXAMPLES = {
    "simulate": """examples:
  t2d-rt simulate walk.bvh -o walk.zarr                      # mesh, table2; writes walk.zarr and walk.png
  t2d-rt simulate walk.bvh --method ellipsoid --radar ci4r
  t2d-rt simulate walk.bvh --radar.prf-hz 12800 --distance-m 4 --seed 3
  t2d-rt simulate walk.bvh --radar my_radar.yaml --signal.mti highpass --overwrite
  t2d-rt simulate walk.bvh --print_config > walk.yaml        # every option with its value
  t2d-rt simulate --config walk.yaml""",
    "compare": """examples:
  t2d-rt compare walk.bvh                                    # writes walk_compare.png, prints the figures
  t2d-rt compare walk.bvh --radar text2doppler-code --angle-deg 45 -o oblique.png""",
    "info": """examples:
  t2d-rt info walk.bvh                                       # what the reader found in a motion file
  t2d-rt info walk.zarr                                      # what a result holds
  t2d-rt info my_radar.yaml                                  # what a radar resolves""",
}


SIGNAL_HELP = {
    "range_window": "window over the samples of a chirp",
    "range_gate_m": "nearest and farthest range to use, [1, 5]; all by default",
    "mti": "none, mean, highpass or canceller",
    "cutoff_mps": "of mti highpass",
    "kernel": "taps of mti canceller",
    "combine": "range bins: noncoherent (powers) or coherent (fields)",
    "window": "window over the chirps of a column",
    "n_window": "chirps of a column; 256 by default",
    "overlap": "chirps that columns share; 200 of 256 by default",
    "n_fft": "bins of a column; n_window by default",
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
    "<class 'NoneType'>": "null",
}
"""What the parser says, in words of its users."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; 0 when it is done, 2 with one sentence when the input cannot be used, 130 on Ctrl-C."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    with warnings.catch_warnings():
        warnings.simplefilter("always", T2DWarning)
        warnings.showwarning = _show_warning
        try:
            return _run(arguments)
        except T2DError as error:
            return _failed(str(error))
        except MemoryError as error:
            return _failed(f"not enough memory ({error}); cut the motion with --start-s and --stop-s, or lower --radar.prf-hz")
        except BrokenPipeError:  # the reader of our output has gone: nothing more to say, not even at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 141
        except OSError as error:
            return _failed(f"{error.filename or 'system'}: {error.strerror or error}; check the path")
        except KeyboardInterrupt:
            print("t2d-rt: stopped; nothing was written", file=sys.stderr)
            return 130


def _failed(sentence: str) -> int:
    print(f"t2d-rt: {' '.join(sentence.split())}", file=sys.stderr)
    return 2


def _run(arguments: list[str]) -> int:
    if not arguments:
        print(_overview(), file=sys.stderr)
        return 2
    if arguments[0] in ("-h", "--help", "--version"):
        from t2d_rt.result import versions

        print(versions()["t2d-rt"] if arguments[0] == "--version" else _overview())
        return 0
    from jsonargparse import ArgumentError

    parser, action = _command(arguments[0])
    try:
        options = parser.parse_args(_resolved(arguments[1:]))
    except ArgumentError as error:
        raise InputError(_one_sentence(str(error), arguments[0])) from None
    action(options)
    sys.stdout.flush()
    return 0


def _command(name: str) -> tuple[ArgumentParser, Callable[[Namespace], None]]:
    commands: dict[str, tuple[Callable[[], ArgumentParser], Callable[[Namespace], None]]] = {
        "simulate": (_simulate_parser, _simulate),
        "compare": (_compare_parser, _compare),
        "info": (_info_parser, _info),
    }
    if name not in commands:
        raise InputError(f"unknown command '{name}'; choose one of {', '.join(commands)} (t2d-rt --help)")
    make, action = commands[name]
    return make(), action


def _overview() -> str:
    return (
        "t2d-rt: ray-traced human micro-Doppler; skeleton motion in, coherent FMCW radar data out\n\n"
        "  t2d-rt simulate FILE   radar recording and spectrogram of a motion file\n"
        "  t2d-rt compare FILE    ellipsoid model against mesh, with figures\n"
        "  t2d-rt info FILE       what a motion, result or radar file holds\n\n"
        "t2d-rt COMMAND --help shows options and examples."
    )


# --- commands ---


def _simulate(options: Namespace) -> None:
    from t2d_rt.result import check_free

    source = Path(options.file)
    target = Path(options.output or f"{_stem(source)}.zarr")
    if target.suffix != ".zarr":
        raise InputError(f"a result is a folder that ends in .zarr, got '{target}'; the picture is written beside it")
    picture = target.with_suffix(".png")
    check_free(target, overwrite=options.overwrite)
    _check_picture(picture, overwrite=options.overwrite)
    radar = _radar(options)
    motion = _motion(options, source, radar)
    result = _recorded(motion, options, radar, options.method)
    with _picture(result.plot(title=f"{source.name}, {options.method}"), picture):
        result.save(target, overwrite=options.overwrite)
    print(f"wrote {target} and {picture}")


def _compare(options: Namespace) -> None:
    from t2d_rt.compare import compare
    from t2d_rt.plots import plot_comparison

    source = Path(options.file)
    picture = Path(options.output or f"{_stem(source)}_compare.png")
    _check_picture(picture, overwrite=options.overwrite)
    radar = _radar(options)
    motion = _motion(options, source, radar)
    ellipsoid, mesh = (_recorded(motion, options, radar, method) for method in ("ellipsoid", "mesh"))
    found = compare(ellipsoid, mesh)
    image, other = ellipsoid.spectrogram, mesh.spectrogram
    figure = plot_comparison(
        image.velocity_mps.values, image.time_s.values, image.values, other.values, title=source.name
    )
    with _picture(figure, picture):
        print(found)
    print(f"wrote {picture}")


def _info(options: Namespace) -> None:
    source = Path(options.file)
    if not source.exists():
        raise InputError(f"{source} does not exist; check the path")
    if source.is_dir():
        from t2d_rt.result import Simulation

        print(_recording_info(Simulation.load(source)))
    elif source.suffix.lower() in (".yaml", ".yml"):
        from t2d_rt.types import Radar

        print(_radar_info(Radar.from_yaml(source)))
    else:
        from t2d_rt.motion import describe, load_motion

        motion = load_motion(source)
        print(motion.report)
        print(describe(motion))


def _radar(options: Namespace) -> Radar:
    from t2d_rt.types import Radar

    return Radar(**options.radar.as_dict())


def _motion(options: Namespace, source: Path, radar: Radar) -> Motion:
    from t2d_rt.motion import load_motion, place, trim

    motion = load_motion(source, **options.motion.as_dict())
    print(motion.report)
    if options.start_s or options.stop_s is not None:
        motion = trim(motion, options.start_s, options.stop_s)
    return place(
        motion,
        distance_m=options.distance_m,
        angle_deg=options.angle_deg,
        radar_position_m=radar.position_m,
        boresight=radar.boresight,
    )


def _recorded(motion: Motion, options: Namespace, radar: Radar, method: str) -> Simulation:
    from t2d_rt.pipeline import simulate

    names = (
        "scene", "seed", "body", "material", "occlusion", "occlusion_rate_hz", "surface_rate_hz", "sagitta_rad",
        "phase_from", "device",
    )  # fmt: skip
    processing = options.signal.as_dict()
    _check_processing(processing, radar, motion.duration_s)
    with _progress(method) as progress:
        result = simulate(motion, radar=radar, method=method, progress=progress, **{name: options[name] for name in names})  # type: ignore[arg-type]
    source = {name: options[name] for name in ("file", "distance_m", "angle_deg", "start_s", "stop_s")}
    result.settings["motion"] = {**source, **options.motion.as_dict()}
    return result.processed(**processing)


def _check_processing(processing: dict[str, Any], radar: Radar, duration_s: float) -> None:
    """Tries the options of the spectrogram on a short silence, so that a wrong one does not show after a long run."""
    import numpy as np

    from t2d_rt.signal import spectrogram

    enough = max(256, processing["n_window"] or 0, radar.chirps_per_frame or 0)
    chirps = min(enough, len(radar.chirp_times_s(duration_s)))
    spectrogram(np.zeros((chirps, 1, radar.samples), np.complex64), radar, **processing)


# --- options ---


def _simulate_parser() -> ArgumentParser:
    parser = _parser("simulate", "Radar recording and micro-Doppler spectrogram of a motion file.")
    _add_run(parser, output="result folder (.zarr), the picture beside it; FILE's name by default")
    _add_model(parser)
    return parser


def _compare_parser() -> ArgumentParser:
    parser = _parser("compare", "Ellipsoid model against mesh: both spectrograms, their difference, and figures.")
    _add_run(parser, output="picture (.png, .pdf, .svg); FILE's name with _compare.png by default")
    _add_model(parser, skip={"method"})
    return parser


def _info_parser() -> ArgumentParser:
    return _parser("info", "What a motion file (.bvh), a result (.zarr) or a radar (.yaml) holds.", config=False)


def _parser(command: str, description: str, *, config: bool = True) -> ArgumentParser:
    from argparse import RawDescriptionHelpFormatter

    from jsonargparse import ArgumentParser, DefaultHelpFormatter

    class Formatter(DefaultHelpFormatter, RawDescriptionHelpFormatter):
        pass

    parser = ArgumentParser(
        prog=f"t2d-rt {command}",
        usage=f"t2d-rt {command} FILE [options]",
        description=description,
        epilog=EXAMPLES[command],
        formatter_class=Formatter,
        exit_on_error=False,
        default_env=False,
        allow_abbrev=False,
    )
    parser.add_argument("--file", type=str, required=True, help="the file, if it is not given without --file")
    if config:
        parser.add_argument("--config", action="config", help="YAML file of options; those given beside it override it")
    return parser


def _add_run(parser: ArgumentParser, *, output: str) -> None:
    parser.add_argument("-o", "--output", type=str | None, help=output)
    parser.add_argument("--overwrite", type=bool, default=False, nargs="?", const=True, help="replace what is there")
    parser.add_argument("--distance_m", type=float | None, help="of the start; by default the closest approach is 1.5 m")
    parser.add_argument("--angle_deg", type=float, default=0.0, help="of the walk against the line to the radar")
    parser.add_argument("--start_s", type=float, default=0.0, help="first moment of the motion to use")
    parser.add_argument("--stop_s", type=float | None, help="last moment of the motion to use")


def _add_model(parser: ArgumentParser, skip: Collection[str] = ()) -> None:
    from t2d_rt.motion import load_motion
    from t2d_rt.pipeline import simulate
    from t2d_rt.signal import spectrogram
    from t2d_rt.types import Radar
    from t2d_rt.types.radar import preset_names

    model = parser.add_argument_group("model")
    model.add_argument("--material", type=str | None, help="of the body: skin, clothed, pec or an ITU name; skin by default")
    _add_parameters(model, simulate, skip={"radar", "material", "progress", *skip})
    radar = parser.add_argument_group(
        "radar", f"--radar NAME takes a preset ({', '.join(preset_names())}), --radar FILE.yaml your own; fields override:"
    )
    default = Radar.preset("table2")
    for name, hint in get_type_hints(Radar).items():
        if name in Radar.model_fields:
            radar.add_argument(f"--radar.{name}", type=hint, default=getattr(default, name))
    _add_parameters(parser.add_argument_group("reading the file, where it is not understood by itself"), load_motion, "motion.")
    _add_parameters(parser.add_argument_group("spectrogram"), spectrogram, "signal.")


def _add_parameters(group: Any, function: Callable[..., Any], prefix: str = "", skip: Collection[str] = ()) -> None:
    """An option for every parameter that has a default; its help is its line in the docstring, "name: help"."""
    told = dict(re.findall(r"^ *(\w+): (.*)$", function.__doc__ or "", flags=re.MULTILINE))
    hints = get_type_hints(function)
    for name, parameter in inspect.signature(function).parameters.items():
        if name not in skip and parameter.default is not parameter.empty:
            help_text = told.get(name, SIGNAL_HELP.get(name))
            group.add_argument(f"--{prefix}{name}", type=hints[name], default=parameter.default, help=help_text)


def _resolved(arguments: Sequence[str]) -> list[str]:
    """Arguments as the parser wants them: --name_with_underscores=value, a bare word as --file, config files and radars first.

    A value may begin with a dash (--motion.up -z). Config files and --radar become texts for --config, in this order, so
    that a radar's fields can be overridden and a preset's name will do, in a config file too.
    """
    files, configs, radars, rest = [], [], [], []
    waiting = list(arguments)
    while waiting:
        word = waiting.pop(0)
        option = re.fullmatch(r"(-o|--[A-Za-z][\w.-]*)(?:=(.*))?", word, flags=re.DOTALL)
        if option is None:
            if re.match("-.", word) and word != "-h":
                raise InputError(f"unknown option {word}; t2d-rt COMMAND --help lists all")
            (rest if word == "-h" else files).append(word)
            continue
        name = "--output" if option[1] == "-o" else "--" + option[1][2:].replace("-", "_")
        value = option[2]
        if value is None and name not in FLAGS and waiting and not re.match(r"--[A-Za-z]|-[oh]$", waiting[0]):
            value = waiting.pop(0)
        if value is None:
            if name not in FLAGS:
                raise InputError(f"option {name} needs a value; t2d-rt COMMAND --help lists all")
            rest.append(name)
        elif name == "--config":
            configs.append(f"--config={_config_text(value)}")
        elif name == "--radar":
            radars.append(f"--config={_yaml({'radar': _radar_fields(value)})}")
        elif name == "--file":
            files.append(value)
        else:
            rest.append(f"{name}={value}")
    if len(files) > 1:
        raise InputError(f"expected one file, got {len(files)} ({', '.join(files)}); run once for each")
    return [*configs, *radars, *(f"--file={name}" for name in files), *rest]


def _config_text(path: str) -> str:
    import yaml

    try:
        values = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read config file {path}: {error.strerror}; check the path") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError(f"config file {path} is not valid YAML ({' '.join(str(error).split())}); correct it") from None
    if not isinstance(values, dict) or not all(isinstance(key, str) for key in values):
        raise InputError(f"config file {path} must hold options and values such as 'seed: 3'; --print_config shows all")
    if isinstance(values.get("radar"), str):
        values["radar"] = _radar_fields(values["radar"])
    for section in ("radar", "motion", "signal"):
        if section in values and not isinstance(values[section], dict):
            raise InputError(f"'{section}' in config file {path} must hold options and values, got {values[section]!r}")
    return _yaml(values)


def _radar_fields(name: str) -> dict[str, Any]:
    from t2d_rt.types import Radar

    own = Path(name).suffix.lower() in (".yaml", ".yml")
    return (Radar.from_yaml(name) if own else Radar.preset(name)).model_dump(mode="json")


def _yaml(values: dict[str, Any]) -> str:
    import yaml

    return str(yaml.safe_dump(values, sort_keys=False))


def _one_sentence(message: str, command: str) -> str:
    """What the parser found wrong, in plain words."""
    help_command = f"t2d-rt {command} --help"
    wrong = re.match(r'Parser key "(.+?)":', message)
    given = re.search(r"(?:Got|Given) value: (.*)", message, flags=re.DOTALL)
    if wrong and given:
        kinds = re.findall(r"Expected an? (.+?)(?:\. Got value|\n|$)", message)
        expected = dict.fromkeys(word for kind in kinds for word in _plain_type(kind))
        return f"option {wrong[1]} must be {' or '.join(expected)}, got '{' '.join(given[1].split())}'; see {help_command}"
    if "are required: file" in message:
        return f"no file given; name one, as in the examples of {help_command}"
    unknown = re.search(r"unrecognized arguments: (\S+)|Option '(.+)' is not accepted", message)
    if unknown:
        name = (unknown[1] or unknown[2]).partition("=")[0]
        return f"unknown option {name}; {help_command} lists all"
    return f"{' '.join(message.split())}; see {help_command}"


def _plain_type(kind: str) -> list[str]:
    """The parser's word for a type in words of its users: one, or the values there are."""
    if kind.startswith("typing.Literal"):
        return re.findall(r"'([^']*)'", kind)
    count = re.match(r"tuple with (\d+) elements", kind)
    return [f"a list of {count[1]} numbers" if count else PLAIN_TYPES.get(kind, kind)]


# --- output ---


def _stem(source: Path) -> str:
    return re.sub(r"\.bvh(\.gz)?$", "", source.name, flags=re.IGNORECASE)


def _check_picture(picture: Path, *, overwrite: bool) -> None:
    from t2d_rt.result import check_place

    if picture.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise InputError(f"a picture ends in .png, .pdf or .svg, got '{picture}'; choose another name")
    if picture.is_dir():
        raise InputError(f"{picture} is a folder; choose another name for the picture")
    check_place(picture, overwrite=overwrite)


@contextmanager
def _picture(figure: Figure, picture: Path) -> Iterator[None]:
    """Draws the figure beside its place and moves it there once what is done meanwhile has succeeded."""
    partial = picture.with_name(f".{picture.stem}.partial{picture.suffix}")
    try:
        figure.savefig(partial)
        yield
        partial.replace(picture)
    except OSError as error:
        raise InputError(f"cannot write {picture} ({error.strerror}); free space or choose a writable place") from error
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def _progress(label: str) -> Iterator[Callable[[float], None]]:
    """A bar that shows itself only where a run takes over two seconds."""
    from tqdm import tqdm

    started = time.monotonic()
    bar: tqdm | None = None

    def advance(share: float) -> None:
        nonlocal bar
        if bar is None:  # not before: the time that it says is left must not count the preparation
            bar = tqdm(
                total=1.0, initial=share, desc=label, delay=max(1e-3, 2.0 - (time.monotonic() - started)), leave=False,
                bar_format="{desc} {percentage:3.0f}% |{bar}| {remaining}", file=sys.stderr,
            )  # fmt: skip
        bar.update(share - bar.n)

    try:
        yield advance
    finally:
        if bar is not None:
            bar.close()


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    print(f"t2d-rt: warning: {message}", file=sys.stderr)


def _radar_info(radar: Radar) -> str:
    rows = [
        ("mid-sweep frequency", f"{radar.mid_frequency_hz / 1e9:.4f} GHz"),
        ("bandwidth", f"{radar.bandwidth_hz / 1e9:.4f} GHz"),
        ("range bin", f"{radar.range_resolution_m * 100:.2f} cm"),
        ("farthest range", f"{radar.max_range_m:.2f} m"),
        ("unambiguous speed", f"+-{radar.max_speed_mps:.2f} m/s"),
        ("chirp rate", f"{radar.prf_hz:.6g} Hz"),
    ]
    return "\n".join(f"{name:22}{value}" for name, value in rows)


def _recording_info(result: Simulation) -> str:
    rows = [
        ("adc", " x ".join(str(n) for n in result.cube.shape) + " (chirp, antenna, sample)"),
        *((name, str(value)) for name, value in result.settings.items()),
        ("versions", ", ".join(f"{name} {value}" for name, value in result.versions.items())),
    ]
    return _radar_info(result.radar) + "\n" + "\n".join(f"{name:22}{value}" for name, value in rows)


if __name__ == "__main__":
    sys.exit(main())
