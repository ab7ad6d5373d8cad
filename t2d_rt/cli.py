"""The command line: t2d-rt simulate | compare | info."""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from t2d_rt.errors import InputError, T2DError, T2DWarning

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jsonargparse import ArgumentParser, Namespace

    from t2d_rt.result import Simulation
    from t2d_rt.types import Motion

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


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; 0 when it is done, 2 with one sentence when the input cannot be used, 130 on Ctrl-C."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    with warnings.catch_warnings():
        warnings.simplefilter("always", T2DWarning)
        warnings.showwarning = _show_warning
        try:
            return _run(arguments)
        except T2DError as error:
            print(f"t2d-rt: {error}", file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            print("t2d-rt: stopped; nothing was written", file=sys.stderr)
            return 130
        except BrokenPipeError:
            return 141


def _run(arguments: list[str]) -> int:
    from jsonargparse import ArgumentError

    command, parser, action = _command(arguments)
    try:
        options = parser.parse_args(_resolved(arguments[1:]))
    except ArgumentError as error:
        raise InputError(_one_sentence(str(error), command)) from None
    action(parser.instantiate(options))
    return 0


def _command(arguments: list[str]) -> tuple[str, ArgumentParser, Callable[[Namespace], None]]:
    commands: dict[str, tuple[Callable[[], ArgumentParser], Callable[[Namespace], None]]] = {
        "simulate": (_simulate_parser, _simulate),
        "compare": (_compare_parser, _compare),
        "info": (_info_parser, _info),
    }
    if not arguments or arguments[0] in ("-h", "--help"):
        print(_overview())
        raise SystemExit(0 if arguments else 2)
    if arguments[0] == "--version":
        from t2d_rt.result import versions

        print(versions()["t2d-rt"])
        raise SystemExit(0)
    if arguments[0] not in commands:
        raise InputError(f"unknown command '{arguments[0]}'; choose one of {', '.join(commands)} (t2d-rt --help)")
    make, action = commands[arguments[0]]
    return arguments[0], make(), action


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
    picture = target.with_suffix(".png")
    check_free(target, overwrite=options.overwrite)
    _check_picture(picture, overwrite=options.overwrite)
    motion = _motion(options, source)
    result = _recorded(motion, options, options.method)
    result.save(target, overwrite=options.overwrite)
    _save_figure(result.plot(title=f"{source.name}, {options.method}"), picture)
    print(f"wrote {target} and {picture}")


def _compare(options: Namespace) -> None:
    from t2d_rt.compare import compare
    from t2d_rt.plots import plot_comparison

    source = Path(options.file)
    picture = Path(options.output or f"{_stem(source)}_compare.png")
    _check_picture(picture, overwrite=options.overwrite)
    motion = _motion(options, source)
    ellipsoid, mesh = (_recorded(motion, options, method) for method in ("ellipsoid", "mesh"))
    found = compare(ellipsoid, mesh)
    image, other = ellipsoid.spectrogram, mesh.spectrogram
    figure = plot_comparison(
        image.velocity_mps.values, image.time_s.values, image.values, other.values, title=f"{source.name}: ellipsoids, mesh"
    )
    _save_figure(figure, picture)
    print(f"{'':24}{'ellipsoid':>12}{'mesh':>12}")
    for label, name, unit in (
        ("mean RCS", "mean_rcs_dbsm", "dBsm"), ("torso speed", "torso_speed_mps", "m/s"), ("limb speed", "limb_speed_mps", "m/s"),
    ):  # fmt: skip
        print(f"{label + ' [' + unit + ']':24}{getattr(found.first, name):12.2f}{getattr(found.second, name):12.2f}")
    print(f"{'envelope correlation':24}{found.envelope_correlation:12.3f}")
    print(f"{'mean |difference| [dB]':24}{found.mean_difference_db:12.2f}")
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


def _motion(options: Namespace, source: Path) -> Motion:
    from t2d_rt.motion import load_motion, place, trim

    motion = load_motion(source, **dict(options.motion.items()))
    print(motion.report)
    if options.start_s or options.stop_s is not None:
        motion = trim(motion, options.start_s, options.stop_s)
    return place(
        motion,
        distance_m=options.distance_m,
        angle_deg=options.angle_deg,
        radar_position_m=options.radar.position_m,
        boresight=options.radar.boresight,
    )


def _recorded(motion: Motion, options: Namespace, method: str) -> Simulation:
    from t2d_rt.pipeline import simulate

    names = (
        "radar", "scene", "seed", "body", "material", "occlusion", "occlusion_rate_hz", "surface_rate_hz", "sagitta_rad",
        "phase_from", "device",
    )  # fmt: skip
    with _progress(method) as progress:
        result = simulate(motion, method=method, progress=progress, **{name: options[name] for name in names})  # type: ignore[arg-type]
    return result.processed(**dict(options.signal.items()))


# --- parsers ---


def _simulate_parser() -> ArgumentParser:
    parser = _parser("simulate", "Radar recording and micro-Doppler spectrogram of a motion file.")
    parser.add_argument("-o", "--output", type=str | None, help="result folder; FILE's name with .zarr by default")
    _add_model(parser, skip=set())
    return parser


def _compare_parser() -> ArgumentParser:
    parser = _parser("compare", "Ellipsoid model against mesh: both spectrograms, their difference, and figures.")
    parser.add_argument("-o", "--output", type=str | None, help="picture; FILE's name with _compare.png by default")
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
        description=description,
        epilog=EXAMPLES[command],
        formatter_class=Formatter,
        exit_on_error=False,
        default_env=False,
    )
    if config:
        parser.add_argument("--config", action="config", help="YAML file of options; what follows it overrides it")
        parser.add_argument("--file", type=str, required=True, help="motion file (.bvh, .bvh.gz); may be given without --file")
    else:
        parser.add_argument("--file", type=str, required=True, help="file; may be given without --file")
    return parser


def _add_model(parser: ArgumentParser, skip: set[str]) -> None:
    from t2d_rt.motion import load_motion
    from t2d_rt.pipeline import simulate
    from t2d_rt.signal import spectrogram
    from t2d_rt.types import Radar

    parser.add_argument("--overwrite", type=bool, default=False, nargs="?", const=True, help="replace what is there")
    parser.add_argument("--distance_m", type=float | None, help="of the start from the radar; closest approach 1.5 m by default")
    parser.add_argument("--angle_deg", type=float, default=0.0, help="of the walk against the line to the radar")
    parser.add_argument("--start_s", type=float, default=0.0, help="first moment of the motion to use")
    parser.add_argument("--stop_s", type=float | None, help="last moment of the motion to use")
    parser.add_class_arguments(Radar, "radar", help="a preset's name, a YAML file, or single fields")
    parser.set_defaults(radar=Radar.preset("table2").model_dump(mode="json"))
    parser.add_function_arguments(simulate, skip={"target", "radar", "progress", *skip}, fail_untyped=False)
    parser.add_function_arguments(load_motion, "motion", skip={"path"}, fail_untyped=False)
    parser.add_function_arguments(spectrogram, "signal", skip={"adc", "radar"}, fail_untyped=False)


def _resolved(arguments: list[str]) -> list[str]:
    """Arguments as the parser wants them: underscores in names, a bare file as --file, a radar preset as its YAML file, first."""
    from t2d_rt.types.radar import preset_path

    out: list[str] = []
    radar: list[str] = []
    waiting = False  # for the value of an option
    for argument in arguments:
        name, equals, value = argument.partition("=")
        if re.fullmatch(r"--[A-Za-z][\w.-]*", name):
            argument = "--" + name[2:].replace("-", "_") + equals + value
        if waiting and out[-1] == "--radar":
            out.pop()
            radar += ["--radar", _radar_file(argument, preset_path)]
            waiting = False
        elif argument.startswith("--radar="):
            radar += ["--radar", _radar_file(argument.removeprefix("--radar="), preset_path)]
        elif not argument.startswith("-") and not waiting:
            out += ["--file", argument]
        else:
            waiting = argument.startswith("-") and not equals and argument not in ("--overwrite", "-h", "--help", "--print_config")
            out.append(argument)
    # --config first, so that the radar given beside it overrides the file's.
    first = out.index("--config") + 2 if "--config" in out else 0
    return out[:first] + radar + out[first:]


def _radar_file(name: str, preset_path: Callable[[str], Path]) -> str:
    return name if Path(name).suffix.lower() in (".yaml", ".yml") else str(preset_path(name))


def _one_sentence(message: str, command: str) -> str:
    text = " ".join(message.split())
    text = re.sub(r"^(Problem with given class_path|Parser key)", "option", text)
    return f"{text[:400]}; see t2d-rt {command} --help"


# --- output ---


def _stem(source: Path) -> str:
    return re.sub(r"\.bvh(\.gz)?$", "", source.name, flags=re.IGNORECASE)


def _check_picture(picture: Path, *, overwrite: bool) -> None:
    if picture.exists() and not overwrite:
        raise InputError(f"{picture} exists already; choose another name or pass --overwrite")
    if not picture.parent.is_dir():
        raise InputError(f"folder {picture.parent} does not exist; create it first")


def _save_figure(figure: Any, picture: Path) -> None:
    partial = picture.with_name(f".{picture.name}.partial.png")
    try:
        figure.savefig(partial)
        partial.replace(picture)
    except OSError as error:
        raise InputError(f"cannot write {picture} ({error.strerror}); free space or choose a writable place") from error
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def _progress(label: str) -> Iterator[Callable[[float], None]]:
    """A bar that shows itself only where a run takes over two seconds."""
    from tqdm import tqdm

    with tqdm(total=1.0, desc=label, delay=2.0, leave=False, bar_format="{desc} {percentage:3.0f}% |{bar}| {remaining}") as bar:
        yield lambda share: bar.update(share - bar.n)


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    print(f"t2d-rt: warning: {message}", file=sys.stderr)


def _radar_info(radar: Any) -> str:
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
