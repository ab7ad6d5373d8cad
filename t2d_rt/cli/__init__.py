"""The command line: t2d-rt simulate | plan | compare | scene | info | export | list."""

from __future__ import annotations

import io
import os
import re
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from t2d_rt.checks import unknown_name
from t2d_rt.cli.experiments import is_experiment, recorded
from t2d_rt.cli.options import (
    check_nulls,
    compare_parser,
    export_parser,
    info_parser,
    list_parser,
    one_sentence,
    plan_parser,
    resolved,
    scene_parser,
    simulate_parser,
)
from t2d_rt.cli.sigterm import stopped_by_sigterm
from t2d_rt.errors import InputError, T2DError, T2DWarning, printable
from t2d_rt.progress import ProgressBar

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace
    from matplotlib.figure import Figure

    from t2d_rt.cli.add import Person
    from t2d_rt.result import Recording
    from t2d_rt.scene import Mover
    from t2d_rt.simulate import Method
    from t2d_rt.types import Motion, Radar


MODEL = (
    "method", "scene", "tolerance_db", "reflections", "transmissions", "clutter", "collisions", "seed", "body", "material",
    "phase_from", "measure_error", "device", "memory_gb",
)  # fmt: skip
"""Options that go to the pipeline by their names."""

COMMANDS = "simulate", "plan", "compare", "scene", "info", "export", "list"

CONFIGURABLE = "simulate", "plan", "compare", "scene"
"""Those that take --config and --radar."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; 0 when it is done, 2 with one sentence when the input cannot be used, 130 on Ctrl-C, 143 on SIGTERM."""
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


def say(text: object, *, file: TextIO | None = None) -> None:
    """Prints what may hold names and texts of a user's files: nothing in them reaches the terminal as a command to it."""
    print(printable(str(text)), file=file)


def _failed(sentence: str) -> int:
    say(f"t2d-rt: {' '.join(sentence.split())}", file=sys.stderr)
    return 2


def _run(arguments: list[str]) -> int:
    if not arguments:
        say(_overview(), file=sys.stderr)
        return 2
    if arguments[0] == "--version":
        from t2d_rt.result import versions

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
        options = parser.parse_args(resolved(arguments[1:], configurable=arguments[0] in CONFIGURABLE))
        check_nulls(parser, options)
    except ArgumentError as error:
        raise InputError(one_sentence(str(error), arguments[0])) from None
    except OverflowError:  # of an integer that no float holds
        raise InputError(
            f"an option of {arguments[0]} got a number of more than 300 digits; give it in SI units, as in 77e9"
        ) from None
    action(options)
    if sys.stdout is not None:  # closed by the caller
        sys.stdout.flush()
    return 0


def _command(name: str) -> tuple[ArgumentParser, Callable[[Namespace], None]]:
    commands: dict[str, tuple[Callable[[], ArgumentParser], Callable[[Namespace], None]]] = {
        "simulate": (simulate_parser, _simulate),
        "plan": (plan_parser, _plan),
        "compare": (compare_parser, _compare),
        "scene": (scene_parser, _scene),
        "info": (info_parser, _info),
        "export": (export_parser, _export),
        "list": (list_parser, _list),
    }
    if name not in COMMANDS:
        raise unknown_name("command", name, COMMANDS, hint=" (t2d-rt --help)")
    make, action = commands[name]
    return make(), action


def _overview() -> str:
    return (
        "t2d-rt: ray-traced human micro-Doppler; skeleton motion in, coherent FMCW radar data out\n\n"
        "  t2d-rt simulate FILE   radar recording and spectrogram of a motion file, an experiment (.yaml), or a result again\n"
        "  t2d-rt plan FILE       what that would model, leave out and take to keep to a tolerance\n"
        "  t2d-rt compare FILE    ellipsoid model against mesh, with figures\n"
        "  t2d-rt scene NAME      plan and view of a room, with the ways to a walker\n"
        "  t2d-rt info FILE       what a motion, result or radar file holds\n"
        "  t2d-rt export FILE     a result as a file for MATLAB (.mat), HDF5, NetCDF or NumPy\n"
        "  t2d-rt list [WHAT]     names: presets, scenes, bodies, movers, motions\n\n"
        "t2d-rt COMMAND --help shows options and examples."
    )


# --- commands ---


def _simulate(options: Namespace) -> None:
    from t2d_rt.cli.add import additions
    from t2d_rt.result import check_free

    source, added = Path(options.file), additions(options.add)
    stem = (
        f"{source.stem}_again" if source.suffix == ".zarr" else source.stem if is_experiment(source) else _stem(source)
    )
    target = Path(options.output or f"{stem}.zarr")
    if target.suffix != ".zarr":
        raise InputError(f"a result is a folder that ends in .zarr, got '{target}'; the picture is written beside it")
    if target.is_symlink():  # the result is written to where the link leads, and the picture goes beside it
        target = target.resolve()
    picture = target.with_suffix(".png")
    check_free(target, overwrite=options.overwrite)
    _check_picture(picture, overwrite=options.overwrite)
    if is_experiment(source):
        result = recorded(source, options, simulate_parser(), _accuracy(options))
    else:
        radar = _radar(options)
        result = _recorded(_motion(options, source, radar), options, radar, options.method, added)
    where = "" if result.settings["scene"] == "free_space" else f", {result.settings['scene']}"
    figure = _drawn(result, f"{source.name}, {result.settings['method']}{where}")
    result.save(target, overwrite=options.overwrite, figure=figure)
    if result.error_db is not None:
        say(f"measured error {result.error_db:.1f} dB")
    say(f"wrote {target}" + (f" and {picture}" if figure is not None else ""))


def _drawn(result: Recording, title: str) -> Figure | None:
    """The spectrogram's figure; None and a warning where it cannot be drawn: that must not cost the result."""
    try:
        figure = result.plot(title=title)
        figure.draw_without_rendering()
    except T2DError:
        raise
    except Exception as error:  # whatever a drawing library may raise
        reason = " ".join(str(error).split()) or type(error).__name__
        warnings.warn(
            f"the picture cannot be drawn ({reason}); the result is written without it", T2DWarning, stacklevel=2
        )
        return None
    return figure


def _plan(options: Namespace) -> None:
    from t2d_rt.accuracy import plan

    radar = _radar(options)
    motion = _motion(options, Path(options.file), radar)
    names = [name for name in MODEL if name != "measure_error"]
    say(plan(motion, radar=radar, accuracy=_accuracy(options), **{name: options[name] for name in names}))


def _compare(options: Namespace) -> None:
    from t2d_rt.compare import compare
    from t2d_rt.plots import plot_comparison

    source = Path(options.file)
    picture = Path(options.output or f"{_stem(source)}_compare.png")
    _check_picture(picture, overwrite=options.overwrite)
    radar = _radar(options)
    motion = _motion(options, source, radar)
    ellipsoid = _recorded(motion, options, radar, "ellipsoid")
    mesh = _recorded(motion, options, radar, "mesh")
    found = compare(ellipsoid, mesh)
    image, other = ellipsoid.spectrogram, mesh.spectrogram
    figure = plot_comparison(
        image.velocity_mps.values, image.time_s.values, image.values, other.values, title=source.name
    )
    _write_picture(figure, picture, overwrite=options.overwrite)
    say(found)
    say(f"wrote {picture}")


def _scene(options: Namespace) -> None:
    from t2d_rt.motion import load_motion
    from t2d_rt.plots import plot_scene
    from t2d_rt.propagation.scenes import load_scene
    from t2d_rt.room import paths_to

    if not 0 <= options.reflections <= 4:
        raise InputError(f"option reflections must lie in 0..4, got {options.reflections}")
    scene, radar = load_scene(options.file), _radar(options)
    picture = Path(options.output or f"{scene.name}.png")
    _check_picture(picture, overwrite=options.overwrite)
    track = None
    target = radar.tx_position_m + 2.5 * radar.axes[0]
    if options.walk is not None:
        from t2d_rt.motion import place
        from t2d_rt.named import motion_path

        motion = place(
            load_motion(motion_path(options.walk)), radar_position_m=radar.position_m, boresight=radar.boresight
        )
        track = motion.joints[:, 0]
        target = track[len(track) // 2]
    ways = paths_to(scene, radar, target, reflections=options.reflections)
    figure = plot_scene(scene, radar.tx_position_m, paths_m=ways, track_m=track, title=scene.name)
    _write_picture(figure, picture, overwrite=options.overwrite)
    say(
        f"{len(scene.surfaces)} objects, {len(ways)} ways to ({', '.join(f'{x:.2f}' for x in target)}) m: "
        f"{', '.join(name for name, _ in ways)}"
    )
    say(f"wrote {picture}")


def _info(options: Namespace) -> None:
    from t2d_rt.store import settle

    source = Path(options.file)
    with suppress(OSError, ValueError):  # no folder, or one that may only be read: what follows says so
        settle(source)
    if not source.exists():
        from t2d_rt.named import motion_path

        source = motion_path(source)
    if not source.exists():
        raise InputError(f"{source} does not exist; check the path")
    if source.is_dir():
        from t2d_rt.result import Recording

        say(_recording_info(Recording.load(source)))
    elif source.suffix.lower() in (".yaml", ".yml"):
        from t2d_rt.types import Radar

        say(_radar_info(Radar.from_yaml(source)))
    else:
        from t2d_rt.motion import describe, load_motion

        motion = load_motion(source)
        say(motion.report)
        say(describe(motion))


def _export(options: Namespace) -> None:
    from t2d_rt.result import Recording

    source = Path(options.file)
    target = Path(options.output or source.with_suffix(".mat").name)
    Recording.load(source).export(target, overwrite=options.overwrite)
    say(f"wrote {target}")


def _list(options: Namespace) -> None:
    from t2d_rt.cli.listing import KINDS, lines

    if options.file is not None and options.file not in KINDS:
        raise unknown_name("list", options.file, KINDS)
    for kind in KINDS if options.file is None else (options.file,):
        say("\n".join(lines(kind)))


def _radar(options: Namespace) -> Radar:
    from t2d_rt.types import Radar

    return Radar(**options.radar.as_dict())


def _accuracy(options: Namespace) -> dict[str, Any]:
    """The fields that were given."""
    return options.accuracy.as_dict() if "accuracy" in options else {}


def _motion(options: Namespace, source: Path, radar: Radar) -> Motion:
    from t2d_rt.cli.add import cut
    from t2d_rt.motion import load_motion, place
    from t2d_rt.named import motion_path

    motion = load_motion(motion_path(source), **options.motion.as_dict())
    say(motion.report)
    motion = cut(motion, options.start_s, options.stop_s)
    return place(
        motion,
        distance_m=options.distance_m,
        angle_deg=options.angle_deg,
        radar_position_m=radar.position_m,
        boresight=radar.boresight,
    )


def _recorded(
    motion: Motion, options: Namespace, radar: Radar, method: Method, added: Sequence[Mover | Person] = ()
) -> Recording:
    from t2d_rt.cli.add import Person
    from t2d_rt.simulate import simulate
    from t2d_rt.types import Motion

    names = [name for name in MODEL if name in options and name != "method"]
    processing = options.signal.as_dict()
    targets = [motion, *(each.motion(radar) if isinstance(each, Person) else each for each in added)]
    _check_processing(processing, radar, min(each.duration_s for each in targets if isinstance(each, Motion)))
    with ProgressBar(method) as progress:
        result = simulate(
            targets, radar=radar, method=method, progress=progress, accuracy=_accuracy(options), **{n: options[n] for n in names}
        )  # fmt: skip
    source = {name: options[name] for name in ("file", "distance_m", "angle_deg", "start_s", "stop_s")}
    result.settings["motion"] = {**source, "file": Path(options.file).name, **options.motion.as_dict()}
    if added:
        result.settings["added"] = [_described(each) for each in added]
    return result.processed(**processing)


def _described(added: Mover | Person) -> dict[str, Any]:
    """What goes into a result of a mover or person: of a file its name, not the folders of this machine."""
    found = added.model_dump(mode="json")
    return {**found, "file": Path(found["file"]).name} if "file" in found else found


def _check_processing(processing: dict[str, Any], radar: Radar, duration_s: float) -> None:
    """Tries the options of the spectrogram on a short silence, so that a wrong one does not show after a long run."""
    import numpy as np

    from t2d_rt.signal import spectrogram
    from t2d_rt.signal.doppler import check_processing

    check_processing(radar, len(radar.chirp_times_s(duration_s)), processing)
    radar = radar.separated
    enough = max(256, processing["n_window"] or 0, radar.loops_per_frame or 0)
    chirps = min(enough, len(radar.chirp_times_s(duration_s)))
    spectrogram(np.zeros((chirps, 1, radar.samples), np.complex64), radar, **processing)


# --- output ---


def _stem(source: Path) -> str:
    return re.sub(r"\.bvh(\.gz)?$", "", source.name, flags=re.IGNORECASE)


def _check_picture(picture: Path, *, overwrite: bool) -> None:
    from t2d_rt.store import check_place

    if picture.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise InputError(f"a picture ends in .png, .pdf or .svg, got '{picture}'; choose another name")
    if picture.is_dir():
        raise InputError(f"{picture} is a folder; choose another name for the picture")
    check_place(picture, overwrite=overwrite)


def _write_picture(figure: Figure, picture: Path, *, overwrite: bool) -> None:
    from t2d_rt.store import check_taken, replacing

    with replacing(picture, lambda: check_taken(picture, overwrite=overwrite)) as new:
        figure.savefig(new)


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    say(f"t2d-rt: warning: {message}", file=sys.stderr)


def _radar_info(radar: Radar) -> str:
    rows = [
        ("mid-sweep frequency", f"{radar.mid_frequency_hz / 1e9:.4f} GHz"),
        ("bandwidth", f"{radar.bandwidth_hz / 1e9:.4f} GHz"),
        ("range bin", f"{radar.range_resolution_m * 100:.2f} cm"),
        ("farthest range", f"{radar.max_range_m:.2f} m"),
        ("unambiguous speed", f"+-{radar.max_speed_mps:.2f} m/s"),
        ("chirp rate", f"{radar.prf_hz:.6g} Hz"),
        ("antennas", f"{len(radar.tx_offsets_m)} x {len(radar.rx_offsets_m)} (tx x rx), {radar.multiplexing}"),
    ]
    return "\n".join(f"{name:22}{value}" for name, value in rows)


def _recording_info(result: Recording) -> str:
    rows = [
        ("adc", " x ".join(str(n) for n in result.cube.shape) + " (chirp, antenna, sample)"),
        *((name, str(value)) for name, value in result.settings.items()),
        ("versions", ", ".join(f"{name} {value}" for name, value in result.versions.items())),
    ]
    return _radar_info(result.radar) + "\n" + "\n".join(f"{name:22}{value}" for name, value in rows)
