"""What each command does with its options."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from t2d_rt.cli.experiment_options import (
    accuracy_of,
    is_experiment,
    model_of,
    motion_of,
    planned,
    radar_of,
    recorded,
    substitutes_of,
    targets_of,
)
from t2d_rt.cli.options import CAPTURE, compare_parser, plan_parser, refuse_options, simulate_parser
from t2d_rt.cli.output import check_picture, radar_info, recording_info, say, write_picture
from t2d_rt.core.checks import unknown_name
from t2d_rt.core.errors import InputError, T2DError, T2DWarning
from t2d_rt.core.progress import ProgressBar

if TYPE_CHECKING:
    from jsonargparse import Namespace
    from matplotlib.figure import Figure

    from t2d_rt.cli.add import Person
    from t2d_rt.recording.recording import Recording
    from t2d_rt.scene import Mover
    from t2d_rt.simulate import Method
    from t2d_rt.types import Motion, Radar


RECORDINGS = ".zarr", ".npy", ".bin"
"""Endings of recordings, as `compare` tells them from motion files."""
COMPARED = "file", "output", "overwrite", "config", "align", "relative", "signal"
"""Options of `compare` that hold for two recordings."""


def simulate_command(options: Namespace) -> None:
    """Simulates a motion file or an experiment, or a result again, and writes the recording and its picture."""
    from t2d_rt.cli.add import additions
    from t2d_rt.recording.folder import check_free

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
    check_picture(picture, overwrite=options.overwrite)
    _check_background(options)
    if is_experiment(source):
        result = recorded(source, options, simulate_parser(), accuracy_of(options))
    else:
        radar = radar_of(options)
        result = _recorded(motion_of(options, source, radar), options, radar, options.method, added)
    if options.background is not None:
        result = result.with_background(
            options.background, seed=options.background_seed or 0, level_db=options.background_level_db
        )
    where = "" if result.settings["scene"] == "free_space" else f", {result.settings['scene']}"
    figure = _drawn(result, f"{source.name}, {result.settings['method']}{where}")
    result.save(target, overwrite=options.overwrite, figure=figure)
    if result.error_db is not None:
        say(f"measured error {result.error_db:.1f} dB")
    if result.snr_db is not None:
        say(f"SNR {result.snr_db:.1f} dB over all noise of the receiver, {result.noise_dbm:.1f} dBm in an ADC sample")
    say(f"wrote {target}" + (f" and {picture}" if figure is not None else ""))


def _check_background(options: Namespace) -> None:
    """Tries the model of the background, and its axes where the radar is given here, before a long run."""
    from t2d_rt.recording.added_background import background_settings, check_axes

    if options.background is None:
        for name in ("background_seed", "background_level_db"):
            if options[name] is not None:
                word = name.replace("_", "-")
                raise InputError(f"--{word} is of a background and there is none; give --background, or leave it out")
        return
    background_settings(options.background, seed=options.background_seed or 0, level_db=options.background_level_db)
    if not is_experiment(Path(options.file)):
        check_axes(options.background, radar_of(options), options.signal.as_dict())


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


def plan_command(options: Namespace) -> None:
    """Prints what a tolerance would model, leave out and cost."""
    from t2d_rt.accuracy import plan

    source = Path(options.file)
    if is_experiment(source):
        say(planned(source, options, plan_parser(), accuracy_of(options)))
        return
    radar = radar_of(options)
    motion = motion_of(options, source, radar)
    left = ("measure_error",) if options.tolerance_db is not None else ("measure_error", "tolerance_db")
    given = model_of(options, radar, left)
    say(plan(motion, radar=radar, accuracy=accuracy_of(options), **given))


def compare_command(options: Namespace) -> None:
    """Compares two recordings, or both methods on a motion: writes their picture and prints figures of their difference."""
    from t2d_rt.recording.compare import compare

    named_radar = options.pop("named_radar")
    files = [Path(each) for each in options.file or ()]
    two = len(files) == 2 and all(each.suffix.lower() in RECORDINGS for each in files)
    if not two and (len(files) != 1 or files[0].suffix.lower() in RECORDINGS):
        given = ", ".join(map(str, files)) or "none"
        raise InputError(f"compare takes one motion file, or two recordings ({', '.join(RECORDINGS)}), got {given}")
    stem = "_".join(_stem(each.with_suffix("") if two else each) for each in files)
    picture = Path(options.output or f"{stem}_compare.png")
    check_picture(picture, overwrite=options.overwrite)
    if two:
        recordings = _read_both(files, options, named_radar)
        names = [each.stem for each in files]
        labels = names if names[0] != names[1] else [str(each) for each in files]
    else:
        refuse_options(options, compare_parser(), CAPTURE, f"measured samples, and {files[0]} is a motion file")
        options.file = str(files[0])
        radar = radar_of(options)
        motion = motion_of(options, files[0], radar)
        recordings = [_recorded(motion, options, radar, method) for method in ("ellipsoid", "mesh")]
        labels = ["ellipsoid", "mesh"]
    found = compare(*recordings, align=options.align, relative=options.relative, labels=labels)
    figure = found.plot(None if two else files[0].name)
    write_picture(figure, picture, overwrite=options.overwrite)
    say(found)
    say(f"wrote {picture}")


def _read_both(files: Sequence[Path], options: Namespace, named_radar: bool) -> list[Recording]:
    """Two recordings, measured ones with the radar that is given, and spectrograms by the options that are."""
    from t2d_rt.recording.read import load_recording

    parser = compare_parser()
    measured = [each for each in files if each.suffix.lower() != ".zarr"]
    if measured and not named_radar:
        raise InputError(
            f"{measured[0]} holds samples only; give its radar, --radar with a preset's name or a .yaml file"
        )
    if not measured:
        refuse_options(options, parser, CAPTURE, f"measured samples, and {files[0]} and {files[1]} are results")
    known = (*COMPARED, *CAPTURE, *(["radar"] if measured else []))
    others = [name for name in options.keys() if name.partition(".")[0] not in known]  # noqa: SIM118
    refuse_options(options, parser, others, f"a simulation, and {files[0]} and {files[1]} are recordings")
    processing = {
        name: value for name, value in options.signal.as_dict().items() if value != parser.get_default(f"signal.{name}")
    }
    found = []
    for each in files:
        given = {}
        if each.suffix.lower() != ".zarr":
            given = {"radar": radar_of(options), "iq": options.iq, "conjugate": options.conjugate}
            given |= {"lanes": options.lanes} if each.suffix.lower() == ".bin" else {}
        found.append(load_recording(each, **given).processed(**processing))
    return found


def scene_command(options: Namespace) -> None:
    """Draws a room with its radar and the paths to a point."""
    from t2d_rt.motion import load_motion
    from t2d_rt.pipeline.path_pairs import paths_to, within_reach
    from t2d_rt.plots import plot_scene
    from t2d_rt.propagation.scenes import load_scene

    if not 0 <= options.reflections <= 4:
        raise InputError(f"option reflections must lie in 0..4, got {options.reflections}")
    radar = radar_of(options)
    scene = load_scene(options.file, materials=substitutes_of(options), frequency_hz=radar.mid_frequency_hz)
    near = within_reach(scene, radar)
    cut = "" if near is None or near is scene else f" of {len(scene.surfaces)}, within {radar.max_range_m:.3g} m"
    scene = near or scene
    picture = Path(options.output or f"{scene.name}.png")
    check_picture(picture, overwrite=options.overwrite)
    track = None
    target = radar.tx_position_m + 2.5 * radar.axes[0]
    if options.walk is not None:
        from t2d_rt.experiment.catalog import motion_path
        from t2d_rt.motion import place

        motion = place(
            load_motion(motion_path(options.walk)), radar_position_m=radar.position_m, boresight=radar.boresight
        )
        track = motion.joints[:, 0]
        target = track[len(track) // 2]
    paths = [] if near is None else paths_to(near, radar, target, reflections=options.reflections)
    figure = plot_scene(scene, radar.tx_position_m, paths_m=paths, track_m=track, title=scene.name)
    write_picture(figure, picture, overwrite=options.overwrite)
    say(
        f"{len(scene.surfaces)} objects{cut}, {len(paths)} paths to ({', '.join(f'{x:.2f}' for x in target)}) m: "
        f"{', '.join(name for name, _ in paths)}"
    )
    say(f"wrote {picture}")


def info_command(options: Namespace) -> None:
    """Prints what a file holds."""
    from t2d_rt.core.atomic_write import settle

    source = Path(options.file)
    with suppress(OSError, ValueError):  # no folder, or one that may only be read: what follows says so
        settle(source)
    if not source.exists():
        from t2d_rt.experiment.catalog import motion_path

        source = motion_path(source)
    if not source.exists():
        raise InputError(f"{source} does not exist; check the path")
    if source.is_dir():
        from t2d_rt.recording.recording import Recording

        say(recording_info(Recording.load(source)))
    elif source.suffix.lower() in (".yaml", ".yml"):
        from t2d_rt.types import Radar

        say(radar_info(Radar.from_yaml(source)))
    else:
        from t2d_rt.motion import describe, load_motion

        motion = load_motion(source, **options.motion.as_dict())
        say(motion.report)
        say(describe(motion))


def export_command(options: Namespace) -> None:
    """Writes a result as one file for other programs."""
    from t2d_rt.recording.recording import Recording

    source = Path(options.file)
    target = Path(options.output or source.with_suffix(".mat").name)
    Recording.load(source).export(target, truth=options.truth, overwrite=options.overwrite)
    say(f"wrote {target}")


def list_command(options: Namespace) -> None:
    """Prints the names that the commands take."""

    if options.file is not None and options.file not in KINDS:
        raise unknown_name("list", options.file, KINDS)
    for kind in KINDS if options.file is None else (options.file,):
        say("\n".join(lines(kind)))


def _recorded(
    motion: Motion, options: Namespace, radar: Radar, method: Method, added: Sequence[Mover | Person] = ()
) -> Recording:
    from t2d_rt.simulate import simulate
    from t2d_rt.types import Motion

    given = model_of(options, radar, ("method",))
    processing = options.signal.as_dict()
    targets = targets_of(motion, added, radar)
    _check_processing(processing, radar, min(each.duration_s for each in targets if isinstance(each, Motion)))
    with ProgressBar(method) as progress:
        result = simulate(
            targets, radar=radar, method=method, progress=progress, accuracy=accuracy_of(options), **given
        )
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


def _stem(source: Path) -> str:
    return re.sub(r"\.(bvh(\.gz)?|npz|npy|json|txt|amc|c3d|trc)$", "", source.name, flags=re.IGNORECASE)


KINDS = "presets", "scenes", "bodies", "movers", "motions"


def lines(kind: str) -> Iterator[str]:
    """A heading, then a line for each name."""
    found = {"presets": _presets, "scenes": _scenes, "bodies": _bodies, "movers": _movers, "motions": _motions}[kind]
    rows = list(found())
    width = max(len(name) for name, _ in rows) + 2
    yield f"{kind}:"
    for name, told in rows:
        yield f"  {name:{width}}{told}"


def _presets() -> Iterator[tuple[str, str]]:
    from t2d_rt.experiment.catalog import presets
    from t2d_rt.types import Radar

    for name in presets():
        radar = Radar.preset(name)
        yield (
            name,
            (
                f"{radar.carrier_hz / 1e9:.4g} GHz, sweep {radar.bandwidth_hz / 1e9:.3g} GHz, PRF {radar.prf_hz / 1e3:.4g} kHz, "
                f"{len(radar.tx_offsets_m)} x {len(radar.rx_offsets_m)} antennas, bin {100 * radar.range_resolution_m:.3g} cm, "
                f"up to {radar.max_range_m:.3g} m, +-{radar.max_speed_mps:.3g} m/s"
            ),
        )


def _scenes() -> Iterator[tuple[str, str]]:
    from t2d_rt.experiment.catalog import FREE_SPACE, scenes
    from t2d_rt.propagation.scenes import load_scene

    for name in scenes():
        if name == FREE_SPACE:
            yield name, "nothing but the targets"
            continue
        scene = load_scene(name)
        low, high = scene.bounds_m
        size = " x ".join(f"{length:.3g}" for length in high - low)
        yield name, f"{size} m, {len(scene.surfaces)} objects"


def _bodies() -> Iterator[tuple[str, str]]:
    from t2d_rt.body import ABOUT, bodies, template

    for name in bodies():
        body = template(name)
        who = ABOUT.get(name, "a body")
        yield name, f"{who}, {body.stature_m:.2f} m tall before it is fitted to a motion, {len(body.faces)} faces"


def _movers() -> Iterator[tuple[str, str]]:
    from t2d_rt.core.errors import InputError
    from t2d_rt.scene.movers import kind_named, kind_names

    for name in kind_names():
        try:
            kind = kind_named(name)
        except InputError as error:  # of one package, which hides no other
            yield name, str(error)
            continue
        told = " ".join((kind.__doc__ or "").split("\n\n")[0].split())
        options = [field for field in kind.model_fields if field not in ("kind", "position_m")]
        yield name, f"{told} Options: {', '.join(options)}."


def _motions() -> Iterator[tuple[str, str]]:
    from t2d_rt.experiment.catalog import EXAMPLES

    for name, (file, told) in EXAMPLES.items():
        yield name, f"{told}; {file}"
