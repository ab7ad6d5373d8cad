"""`t2d-rt compare`, `process`, `plot`, `view`, `export`, `scene`, `info`, `list`: recordings and files, drawn, told and written."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from t2d_rt.cli.experiments import Asked, Job, OfCompare, OfScene, OfSceneFile, radar_of, scene_options
from t2d_rt.cli.options import Capture, Given, Reading, Samples, Signal, yaml_kind
from t2d_rt.cli.output import check_picture, say, stem_of, write_picture
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_yaml

if TYPE_CHECKING:
    from t2d_rt.recording.recording import Recording
    from t2d_rt.types import Radar

RECORDINGS = ".zarr", ".npy", ".bin"
"""Endings by which `compare` tells recordings from motion files."""
OF_INTERVAL = "range_doppler", "range_angle"
"""Maps of one coherent interval."""
KINDS = "presets", "scenes", "bodies", "movers", "motions"


def refuse(given: Collection[str], told: str) -> None:
    """Raises InputError for options that would have no effect: `told` says what they belong to, and what there is instead."""
    for name in given:
        raise InputError(f"option {name} is of {told}; leave it out")


def compare(
    files: list[str] | None = None,
    output: str | None = None,
    overwrite: bool = False,
    align: bool = False,
    relative: bool = False,
    *,
    given: OfCompare,
    capture: Samples,
    signal: Signal,
    radar_is_named: bool = False,
) -> None:
    """Compares two recordings, or of one motion file the models ellipsoid and mesh: draws both spectrograms and their difference,
    and prints figures.

    files: a motion file, or two recordings: .zarr folders of results, .npy or .bin files of measured samples.
    output: picture to write (.png, .pdf or .svg); by default it has FILE's name and ends in _compare.png.
    align: whether the second is shifted in time to where it is most like the first; half of the shorter one stays in common.
    relative: whether the second one's level is brought to that of the first before cells are compared: that of measured samples is
        seldom calibrated.

    examples:
      t2d-rt compare walk.bvh                                    # writes walk_compare.png, prints the figures
      t2d-rt compare walk.bvh --radar text2doppler-code --angle-deg 45 -o oblique.png
      t2d-rt compare without_fan.zarr with_fan.zarr              # any two recordings
      t2d-rt compare walk.zarr frames.npy --radar r60.yaml --align --relative  # a measured one, clock and level unknown
    """
    from t2d_rt.cli.simulations import recorded
    from t2d_rt.recording.compare import compare as compared

    sources = [Path(file) for file in files or ()]
    two = len(sources) == 2 and all(source.suffix.lower() in RECORDINGS for source in sources)
    if not two and (len(sources) != 1 or sources[0].suffix.lower() in RECORDINGS):
        source_names = ", ".join(map(str, sources)) or "none"
        raise InputError(
            f"compare takes one motion file, or two recordings ({', '.join(RECORDINGS)}), got {source_names}"
        )
    stem = "_".join(stem_of(source.with_suffix("") if two else source) for source in sources)
    picture = Path(output or f"{stem}_compare.png")
    check_picture(picture, overwrite=overwrite)
    labels = ["ellipsoid", "mesh"]
    if two:
        recordings = _both(sources, given, capture, signal, radar_is_named)
        names = [source.stem for source in sources]
        labels = names if names[0] != names[1] else [str(source) for source in sources]
    else:
        refuse(capture, f"measured samples, and {sources[0]} is a motion file")
        recordings = [recorded(Job.of(str(sources[0]), {**given, "method": label}), signal) for label in labels]
    comparison = compared(*recordings, align=align, relative=relative, labels=labels)
    write_picture(comparison.plot(None if two else sources[0].name), picture, overwrite=overwrite)
    say(comparison)
    say(f"wrote {picture}")


def process(
    files: list[str] | None = None, output: str | None = None, overwrite: bool = False, vital_signs: bool = False, *,
    capture: Capture, signal: Signal,
) -> None:  # fmt: skip
    """Takes a measured capture through the chain of simulated ones, range FFT, MTI and STFT, and draws range-time map and
    spectrogram, beside a simulation's where one is given.

    files: measured samples (.bin of a DCA1000, .npy); and a result (.zarr) to set beside them, its clock and level brought to
        theirs.
    output: how the names of the pictures begin, with their folder; by default as CAPTURE's, in the working directory. Spectrograms
        beside each other end in _compare.png.
    vital_signs: whether displacement, breaths and heartbeats of one person at rest are told, and drawn as NAME_displacement.png.

    examples:
      t2d-rt process capture.bin --radar profile.cfg --lanes 2             # capture_range_time.png, capture_spectrogram.png
      t2d-rt process capture.bin walk.zarr --radar profile.cfg --lanes 2   # and capture_compare.png, beside a simulation
      t2d-rt process sleeper.bin --radar profile.cfg --lanes 2 --vital-signs
    """
    from t2d_rt.recording.compare import compare as compared
    from t2d_rt.recording.read import load_recording

    sources = [Path(file) for file in files or ()]
    if not 1 <= len(sources) <= 2 or sources[0].suffix.lower() not in RECORDINGS[1:]:
        source_names = ", ".join(map(str, sources)) or "none"
        raise InputError(f"process takes one capture (.bin, .npy), and a result (.zarr) beside it, got {source_names}")
    if len(sources) == 2 and sources[1].suffix.lower() != ".zarr":
        raise InputError(f"what a capture is set beside must be a result (.zarr), got {sources[1]}; simulate it first")
    names = [
        "range_time",
        "spectrogram",
        *(["compare"] if len(sources) == 2 else []),
        *(["displacement"] if vital_signs else []),
    ]
    pictures = {name: Path(f"{output or sources[0].stem}_{name}.png") for name in names}
    for picture in pictures.values():
        check_picture(picture, overwrite=overwrite)
    recording = load_recording(sources[0], **capture)
    say(f"{sources[0].name}: {recording}")
    processed = _one_of_each_burst(recording).processed(**signal)
    figures = {"range_time": processed.plot_range_time(sources[0].name), "spectrogram": processed.plot(sources[0].name)}
    if len(sources) == 2:
        beside = _one_of_each_burst(load_recording(sources[1])).processed(**signal)
        comparison = compared(processed, beside, align=True, relative=True, labels=[source.name for source in sources])
        say(comparison)
        figures["compare"] = comparison.plot(sources[0].name)
    if vital_signs:
        from t2d_rt.plots.figures import plot_displacement
        from t2d_rt.signal import vital_signs as vital_signs_of

        signs = vital_signs_of(recording.cube, recording.radar, range_gate_m=signal.get("range_gate_m"))
        say(signs)
        figures["displacement"] = plot_displacement(signs.time_s, signs.displacement_m, sources[0].name)
    for name, picture in pictures.items():
        write_picture(figures[name], picture, overwrite=overwrite)
    say(f"wrote {', '.join(map(str, pictures.values()))}")


FEWEST_LOOPS = 8
"""Number of loops of a burst below which its own Doppler axis shows nothing."""


def _one_of_each_burst(recording: Recording) -> Recording:
    """The recording itself, or, if its bursts are too short for a Doppler axis, a recording of the bursts' means, whose axis is
    that of the bursts' rate."""
    from t2d_rt.recording.recording import Recording as Made
    from t2d_rt.signal.vital import slow_time

    radar, loops = recording.radar, recording.radar.loops_per_frame
    if loops is None or radar.frame_interval_s is None or loops >= FEWEST_LOOPS:
        return recording
    say(
        f"bursts of {loops} are averaged, so that speeds are those that one chirp every {1e3 * radar.frame_interval_s:g} ms tells"
    )
    slower = radar.replace(
        prf_hz=radar.loop_chirps / radar.frame_interval_s, chirps_per_frame=None, frame_interval_s=None
    )
    return Made(slow_time(recording.cube, radar, loops)[1], slower)


def _both(files: list[Path], given: Given, capture: Given, signal: Given, radar_is_named: bool) -> list[Recording]:
    """Two recordings, measured ones read with the given radar, with spectrograms made by the given options."""
    from t2d_rt.recording.read import load_recording

    measured = [file for file in files if file.suffix.lower() != ".zarr"]
    if measured and not radar_is_named:
        raise InputError(
            f"{measured[0]} holds samples only; give its radar, --radar with a preset's name, a .yaml or a .cfg file"
        )
    if not measured:
        refuse(capture, f"measured samples, and {files[0]} and {files[1]} are results")
    others = [name for name in given if not (measured and name == "radar")]
    refuse(others, f"a simulation, and {files[0]} and {files[1]} are recordings")
    recordings = []
    for file in files:
        reading_options = {"radar": radar_of(given), **capture} if file in measured else {}
        if file.suffix.lower() != ".bin":
            reading_options.pop("lanes", None)
        recordings.append(load_recording(file, **reading_options).processed(**signal))
    return recordings


def plot(
    file: str, output: str | None = None, overwrite: bool = False,
    map: Literal["spectrogram", "parts", "range_time", "range_doppler", "range_angle", "point_cloud"] = "spectrogram",
    title: str | None = None, time_s: float | None = None, interval_s: float | None = None, cmap: str | None = None,
    dynamic_range_db: float | None = None, limits_db: tuple[float, float] | None = None, width_in: float | None = None,
    poses: int | None = None, stacked: bool = False, animate: bool = False, width_px: int | None = None,
    frames_hz: float | None = None, *, capture: Capture,
) -> None:  # fmt: skip
    """Draws a map of a recording, simulated or measured, as a picture; or the body in its room beside the spectrogram, as an
    animation.

    output: picture to write (.png, .pdf or .svg), or animation (.gif or .mp4); by default it has RECORDING's name and the map's.
    map: which map it is: spectrogram, parts (the spectrogram coloured by limb or path, of what was simulated with --split),
        range_time, range_doppler, range_angle or point_cloud.
    title: text above the picture; RECORDING's name by default.
    time_s: middle of the interval of a range-Doppler or range-angle map [s]; that of the record by default.
    interval_s: length of that interval [s]; a window's by default.
    cmap: a colour map of Matplotlib; viridis by default.
    dynamic_range_db: span of the colours below the peak [dB]; 50 by default.
    limits_db: least and greatest level of the colours [dB re 1 W] instead, as [-140, -90].
    width_in: width of the picture [inch]: 3.5 for a column of a paper, 7 for its width, which is the default of most maps.
    poses: number of bodies above a map of parts, in the colours of their limbs.
    stacked: whether a map of parts has a spectrogram for each part instead, all on one scale.
    animate: whether body, room and spectrogram are animated, as a .gif, or an .mp4 where ffmpeg is there.
    width_px: width of an animation [pixel]; 800 by default.
    frames_hz: pictures of an animation in a second [Hz]; 12.5 by default.

    examples:
      t2d-rt plot walk.zarr -o walk.pdf --width-in 3.5               # the spectrogram, for a column of a paper
      t2d-rt plot walk.zarr --map range_doppler --time-s 1.2 -o rd.pdf
      t2d-rt plot walk.zarr --limits-db "[-140, -90]" -o walk.png    # a scale that other pictures have, too
      t2d-rt plot array.zarr --map point_cloud                       # of an antenna array
      t2d-rt plot limbs.zarr --map parts --poses 8                   # of simulate --split segment: which limb makes that line?
      t2d-rt plot walk.zarr --animate                                # walk.gif: the body in its room beside the spectrogram
      t2d-rt plot walk.zarr --animate -o walk.mp4                    # by ffmpeg
    """
    from t2d_rt.recording.read import load_recording
    from t2d_rt.view.animation import ENDINGS, check_animation
    from t2d_rt.view.animation import animate as animated

    source = Path(file)
    moves = animate or (output is not None and Path(output).suffix.lower() in ENDINGS)
    part = "" if map == "spectrogram" else f"_{map}"
    target = Path(output or f"{source.stem}{part}{'.gif' if moves else '.png'}")
    if moves and map != "spectrogram":
        raise InputError(f"an animation shows the spectrogram, got --map {map}; leave it out, or draw a picture")
    (check_animation if moves else check_picture)(target, overwrite=overwrite)
    interval = _given(time_s=time_s, interval_s=interval_s)
    levels, moving = (
        _given(dynamic_range_db=dynamic_range_db, limits_db=limits_db),
        _given(width_px=width_px, frames_hz=frames_hz),
    )
    style, by_part = _given(cmap=cmap, width_in=width_in) | levels, _given(poses=poses, stacked=stacked or None)
    if map not in OF_INTERVAL:
        refuse(interval, f"a map of one interval ({', '.join(OF_INTERVAL)})")
    if map != "parts":
        refuse(by_part, f"a map of parts, and this is one of {map}")
    elif not stacked:
        refuse(_given(cmap=cmap), "colours of levels, and those of this map are the parts'")
    if map == "point_cloud":
        refuse(levels, "levels, and a point cloud shows speeds")
    refuse(style if moves else (), f"a picture, and {target.name} is an animation")
    refuse(() if moves else moving, "an animation, and this is a picture")
    recording, title = load_recording(source, **capture), source.name if title is None else title
    if moves:
        animated(recording, target, title=title, overwrite=overwrite, **moving)
    else:
        draw = recording.plot if map == "spectrogram" else getattr(recording, f"plot_{map}")
        write_picture(draw(title, **style, **interval, **by_part), target, overwrite=overwrite)
    say(f"wrote {target}")


def _given(**values: Any) -> Given:
    return {name: value for name, value in values.items() if value is not None}


def view(
    files: list[str] | None = None, output: str | None = None, overwrite: bool = False, *, given: Asked, capture: Samples,
    signal: Signal, radar_is_named: bool = False,
) -> None:  # fmt: skip
    """Writes one HTML file that shows a recording: body, room and paths in three dimensions beside spectrogram and maps, with one
    time cursor, and its parts, where it has any. It needs no network and no other file.

    files: a result (.zarr), measured ADC samples (.npy, or .bin of a DCA1000), or a motion file or an experiment (.yaml), which is
        simulated; or two of them.
    output: page to write (.html); by default it has the (first) RECORDING's name.

    examples:
      t2d-rt view walk.zarr                             # walk.html: body, room, paths and maps on one timeline, for any browser
      t2d-rt view ellipsoids.zarr mesh.zarr -o both.html  # two recordings side by side
      t2d-rt view capture.npy --radar my_radar.yaml       # the maps of a measured recording
      t2d-rt view walk --split segment                    # simulates a motion; which limb makes that line?
    """
    from t2d_rt.cli.simulations import recorded
    from t2d_rt.recording.read import load_recording
    from t2d_rt.view import MOST_RECORDINGS, Viewer, check_page, told

    sources = [Path(file) for file in files or ()]
    if not 1 <= len(sources) <= MOST_RECORDINGS:
        raise InputError(f"view takes one recording, or two to show side by side, got {len(sources)} names")
    recorded_before = sources[0].suffix.lower() in RECORDINGS
    target = check_page(
        output or (sources[0].with_suffix(".html") if recorded_before else f"{stem_of(sources[0])}.html"),
        overwrite=overwrite,
    )
    measured = [source for source in sources if source.suffix.lower() in RECORDINGS[1:]]
    simulated = [source for source in sources if source.suffix.lower() not in RECORDINGS]
    first = next((source for source in sources if source not in simulated), sources[0])
    if not measured:
        refuse(capture, f"measured samples, and {first} is {'a motion' if simulated else 'a result'}")
    if not simulated:
        refuse([name for name in given if name != "radar"], f"a simulation, and {first} is a recording")
        if radar_is_named and not measured:
            refuse(["radar"], f"measured samples, and {first} is a result, which holds its own radar")
    capture_options = {**capture, **({"radar": radar_of(given)} if radar_is_named else {})}
    recordings = [
        recorded(Job.of(str(source), given), signal)
        if source in simulated
        else load_recording(source, **(capture_options if source in measured else {})).processed(**signal)
        for source in sources
    ]
    titles = [f"{source.stem}: {told(recording)}" for source, recording in zip(sources, recordings, strict=True)]
    viewer = Viewer(recordings, titles)
    viewer.save(target, overwrite=overwrite)
    say(f"wrote {target} ({len(viewer.html) / 1e6:.1f} MB)")


def export(file: str, output: str | None = None, truth: bool = False, overwrite: bool = False) -> None:
    """Writes the ADC cube, the spectrogram and the axes of a result (.zarr) as one file for other programs.

    output: file to write; its ending says its format: .mat, .h5, .nc or .npz. By default it has FILE's name and ends in .mat.
    truth: whether joints, segments and contacts of the targets over time are written too.

    examples:
      t2d-rt export walk.zarr -o walk.mat                        # ADC cube, spectrogram and axes for MATLAB
      t2d-rt export walk.zarr -o walk.nc                         # for xarray and other readers of NetCDF
    """
    from t2d_rt.recording.recording import Recording

    target = Path(output or Path(file).with_suffix(".mat").name)
    Recording.load(file).export(target, truth=truth, overwrite=overwrite)
    say(f"wrote {target}")


def scene(
    file: str,
    output: str | None = None,
    overwrite: bool = False,
    walk: str | None = None,
    reflections: int = 1,
    *,
    scene_file: OfSceneFile,
    given: OfScene,
) -> None:
    """Draws a room from above and in three dimensions, with the radar, a walker's track and the paths to it.

    output: picture to write (.png, .pdf or .svg); SCENE.png by default.
    walk: motion file of a walker, or a bundled motion's name; the walker is placed before the radar as simulate does.
    reflections: greatest number of reflections of the paths that are drawn; they lead to the middle of the track.

    examples:
      t2d-rt scene living_room                                   # writes living_room.png: plan, view, paths to a point ahead
      t2d-rt scene my_room.xml --walk walk.bvh --reflections 2   # with a walker's track, and the paths to it
    """
    from t2d_rt.experiment.catalog import motion_path
    from t2d_rt.motion import load_motion, place
    from t2d_rt.pipeline.path_pairs import paths_to, within_reach
    from t2d_rt.plots import plot_scene
    from t2d_rt.propagation.scenes import load_scene

    if not 0 <= reflections <= 4:
        raise InputError(f"option reflections must lie in 0..4, got {reflections}")
    radar = radar_of(given)
    room = load_scene(file, **scene_options(scene_file), frequency_hz=radar.mid_frequency_hz)
    if room.report:
        say(room.report)
    reachable = within_reach(room, radar)
    cut = "" if reachable in (None, room) else f" of {len(room.surfaces)}, within {radar.max_range_m:.3g} m"
    drawn_scene = reachable or room
    picture = Path(output or f"{drawn_scene.name}.png")
    check_picture(picture, overwrite=overwrite)
    track, target = None, radar.tx_position_m + 2.5 * radar.axes[0]
    if walk is not None:
        motion = load_motion(motion_path(walk))
        track = place(motion, radar_position_m=radar.position_m, boresight=radar.boresight).joints[:, 0]
        target = track[len(track) // 2]
    paths = [] if reachable is None else paths_to(reachable, radar, target, reflections=reflections)
    figure = plot_scene(drawn_scene, radar.tx_position_m, paths_m=paths, track_m=track, title=drawn_scene.name)
    write_picture(figure, picture, overwrite=overwrite)
    position, path_names = ", ".join(f"{metres:.2f}" for metres in target), ", ".join(name for name, _ in paths)
    say(f"{len(drawn_scene.surfaces)} objects{cut}, {len(paths)} paths to ({position}) m: {path_names}")
    say(f"wrote {picture}")


def info(file: str, *, motion: Reading) -> None:
    """Tells what a motion file, a result (.zarr), the file of a radar (.yaml, .cfg) or of an experiment (.yaml) holds.

    examples:
      t2d-rt info walk.bvh                                       # what the reader found in a motion file
      t2d-rt info walk.zarr                                      # what a result holds
      t2d-rt info my_radar.yaml                                  # what a radar resolves
      t2d-rt info profile.cfg                                    # what the configuration of a TI device resolves
      t2d-rt info experiment.yaml                                # its targets, and every field with its value
    """
    from t2d_rt.core.atomic_write import settle
    from t2d_rt.experiment.catalog import motion_path

    source = Path(file)
    with suppress(OSError, ValueError):  # not a folder, or one that may only be read, which what follows reports
        settle(source)
    source = source if source.exists() else motion_path(source)
    if not source.exists():
        raise InputError(f"{source} does not exist; check the path")
    if source.is_dir():
        from t2d_rt.recording.recording import Recording

        result = Recording.load(source)
        shape = " x ".join(str(count) for count in result.cube.shape)
        rows = {"adc": f"{shape} (chirp, antenna, sample)", **result.settings}
        rows["versions"] = ", ".join(f"{name} {value}" for name, value in result.versions.items())
        say(_rows(_radar_rows(result.radar) | rows))
    elif source.suffix.lower() in (".yaml", ".yml"):
        say(_rows(_yaml_rows(source)))
    elif source.suffix.lower() == ".cfg":
        from t2d_rt.types import Radar

        say(_rows(_radar_rows(Radar.from_ti_cfg(source))))
    else:
        from t2d_rt.motion import describe, load_motion

        loaded = load_motion(source, **motion)
        say(loaded.report)
        say(describe(loaded))


def _yaml_rows(source: Path) -> Given:
    """The rows of a radar's file, or the targets of an experiment and its other fields."""
    from t2d_rt.experiment.experiment import Experiment
    from t2d_rt.types import Radar

    values = read_yaml(source, noun="YAML file", example="the fields of a radar or of an experiment")
    kind = yaml_kind(values)
    if kind == "options":
        raise InputError(f"{source} holds options of the command line; t2d-rt simulate --config {source} takes them")
    if kind != "experiment":
        return _radar_rows(Radar.from_yaml(source))
    experiment = Job.of(str(source), {}).experiment
    assert isinstance(experiment, Experiment)
    rows: Given = {}
    for number, target in enumerate(experiment.targets):
        fields = target.model_dump(mode="json", exclude_defaults=True, exclude={"kind"})
        rows[f"target {number}"] = ", ".join([target.kind, *(f"{name} {value}" for name, value in fields.items())])
    return rows | {"scene": experiment.scene} | experiment.physics | _radar_rows(experiment.radar)


def _rows(rows: Given) -> str:
    return "\n".join(f"{name:22}{value}" for name, value in rows.items())


def _radar_rows(radar: Radar) -> Given:
    """What a radar resolves, by its label."""
    return {
        "mid-sweep frequency": f"{radar.mid_frequency_hz / 1e9:.4f} GHz",
        "bandwidth": f"{radar.bandwidth_hz / 1e9:.4f} GHz",
        "range bin": f"{radar.range_resolution_m * 100:.2f} cm",
        "farthest range": f"{radar.max_range_m:.2f} m",
        "unambiguous speed": f"+-{radar.max_speed_mps:.2f} m/s",
        "chirp rate": f"{radar.prf_hz:.6g} Hz",
        "antennas": f"{len(radar.tx_offsets_m)} x {len(radar.rx_offsets_m)} (tx x rx), {radar.multiplexing}",
        **({} if radar.track is None else {"track": str(radar.track)}),
    }


def names(file: str | None = None) -> None:
    """Lists the names that the other commands take: presets, scenes, bodies, movers and motions.

    file: names to list: presets, scenes, bodies, movers or motions; all of them by default.

    examples:
      t2d-rt list                                                # all names
      t2d-rt list presets                                        # radar presets with what they resolve
    """
    from t2d_rt.core.checks import unknown_name

    if file is not None and file not in KINDS:
        raise unknown_name("list", file, KINDS)
    listings: dict[str, Callable[[], Iterator[tuple[str, str]]]] = {
        "presets": _presets,
        "scenes": _scenes,
        "bodies": _bodies,
        "movers": _movers,
        "motions": _motions,
    }
    for kind in KINDS if file is None else (file,):
        rows = list(listings[kind]())
        width = max(len(name) for name, _ in rows) + 2
        say("\n".join([f"{kind}:", *(f"  {name:{width}}{about}" for name, about in rows)]))


def _presets() -> Iterator[tuple[str, str]]:
    from t2d_rt.experiment.catalog import presets
    from t2d_rt.types import Radar

    for name in presets():
        radar = Radar.preset(name)
        about = (
            f"{radar.carrier_hz / 1e9:.4g} GHz, sweep {radar.bandwidth_hz / 1e9:.3g} GHz, PRF {radar.prf_hz / 1e3:.4g} kHz, "
            f"{len(radar.tx_offsets_m)} x {len(radar.rx_offsets_m)} antennas, bin {100 * radar.range_resolution_m:.3g} cm, "
            f"up to {radar.max_range_m:.3g} m, +-{radar.max_speed_mps:.3g} m/s"
        )
        yield name, about


def _scenes() -> Iterator[tuple[str, str]]:
    from t2d_rt.experiment.catalog import FREE_SPACE, scenes
    from t2d_rt.propagation.scenes import load_scene

    yield FREE_SPACE, "nothing but the targets"
    for name in scenes():
        if name != FREE_SPACE:
            room = load_scene(name)
            size = " x ".join(f"{length:.3g}" for length in room.bounds_m[1] - room.bounds_m[0])
            yield name, f"{size} m, {len(room.surfaces)} objects"


def _bodies() -> Iterator[tuple[str, str]]:
    from t2d_rt.body import ABOUT, bodies, template

    for name in bodies():
        body = template(name)
        tall = f"{body.stature_m:.2f} m tall before it is fitted to a motion"
        yield name, f"{ABOUT.get(name, 'a body')}, {tall}, {len(body.faces)} faces"


def _movers() -> Iterator[tuple[str, str]]:
    from t2d_rt.scene.movers import kind_named, kind_names

    for name in kind_names():
        try:
            kind = kind_named(name)
        except InputError as error:  # one package's error must not hide the others
            yield name, str(error)
            continue
        about = " ".join((kind.__doc__ or "").split("\n\n")[0].split())
        fields = [field for field in kind.model_fields if field not in ("kind", "position_m")]
        yield name, f"{about} Options: {', '.join(fields)}."


def _motions() -> Iterator[tuple[str, str]]:
    from t2d_rt.experiment.catalog import EXAMPLES

    for name, (file, about) in EXAMPLES.items():
        yield name, f"{about}; {file}"
