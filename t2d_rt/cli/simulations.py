"""`t2d-rt simulate`, `plan`, `paths`: what an experiment gives, what it would take, and over which paths its targets are seen."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from t2d_rt.cli.experiments import Asked, Job, OfPaths, OfPlan, experiment_values, is_experiment, radar_of
from t2d_rt.cli.options import Given, Signal
from t2d_rt.cli.output import check_picture, say, stem_of
from t2d_rt.core.errors import InputError, T2DError, T2DWarning, warn
from t2d_rt.core.progress import ProgressBar

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from t2d_rt.experiment.experiment import Experiment
    from t2d_rt.pipeline.echo_model import Model
    from t2d_rt.recording.recording import Recording
    from t2d_rt.types import Accuracy, Radar

CHECKED_CHIRPS = 2**16
"""Greatest number of chirps of the silence on which the options of a spectrogram are tried."""


class _Said(logging.Handler):
    """A handler that prints each message of the readers once."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self._before: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        """Prints the sentence of a record, unless it was printed before."""
        text = record.getMessage()
        if text not in self._before:
            self._before.add(text)
            say(text)


@contextmanager
def reports_said() -> Iterator[None]:
    """Prints the reports on motion files and on rooms' meshes as they are read."""
    loggers, handler = [logging.getLogger(f"t2d_rt.{package}") for package in ("motion", "scene")], _Said()
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.removeHandler(handler)
            logger.setLevel(level)


def simulate(
    file: str,
    output: str | None = None,
    overwrite: bool = False,
    background: str | None = None,
    background_seed: int | None = None,
    background_level_db: float | None = None,
    *,
    given: Asked,
    signal: Signal,
) -> None:
    """Simulates a motion file or an experiment (.yaml), or a result (.zarr) again; writes the recording and its spectrogram.

    output: folder of the result (.zarr); its picture is written beside it. By default it has FILE's name.
    background: background that is added to the spectrogram: default, or a model (.safetensors) that t2d-rt background train wrote;
        none by default.
    background_seed: seed of the background; 0 by default.
    background_level_db: level of its noise floor [dB re 1 W]; by default that of one of the recordings that it was learned from.

    examples:
      t2d-rt simulate walk.bvh -o walk.zarr                      # mesh, table2; writes walk.zarr and walk.png
      t2d-rt simulate walk.bvh --method ellipsoid --radar ci4r
      t2d-rt simulate walk.bvh --radar.prf-hz 12800 --distance-m 4 --seed 3
      t2d-rt simulate walk.bvh --radar my_radar.yaml --signal.mti highpass --overwrite
      t2d-rt simulate walk.bvh --scene living_room --add fan:2,1,1,rpm=300 --add person:other.bvh,distance_m=3
      t2d-rt simulate walk.bvh --print_config > walk.yaml        # every option with its value
      t2d-rt simulate --config walk.yaml
      t2d-rt simulate walk.bvh --noise receiver                  # thermal and phase noise, ADC and so on, typical of the band
      t2d-rt simulate walk.bvh --tolerance-db -25                # as finely as that asks for; the error is measured afterwards
    """
    from t2d_rt.recording.files import check_free

    source = Path(file)
    if source.suffix.lower() in (".yaml", ".yml") and "radars" in (values := experiment_values(source)):
        if background is not None:
            raise InputError(f"{source} has several radars and a background is that of one; leave --background out")
        several(source, values, given, signal, Path(output or f"{stem_of(source)}.zarr"), overwrite)
        return
    target = Path(output or f"{stem_of(source)}{'_again' if source.suffix == '.zarr' else ''}.zarr")
    if target.suffix != ".zarr":
        raise InputError(f"a result is a folder that ends in .zarr, got '{target}'; the picture is written beside it")
    if target.is_symlink():  # the result is written to where the link leads, and the picture goes beside it
        target = target.resolve()
    picture = target.with_suffix(".png")
    check_free(target, overwrite=overwrite)
    check_picture(picture, overwrite=overwrite)
    radar = None if is_experiment(source) else radar_of(given)
    background_options: Given = {"seed": background_seed, "level_db": background_level_db}
    added = {name: value for name, value in background_options.items() if value is not None}
    _check_background(background, added, radar, signal)
    result = recorded(Job.of(file, given), signal)
    if background is not None:
        result = result.with_background(background, **added)
    scene_text = "" if result.settings["scene"] == "free_space" else f", {result.settings['scene']}"
    figure = _drawn(result, f"{source.name}, {result.settings['method']}{scene_text}")
    result.save(target, overwrite=overwrite, figure=figure)
    if result.error_db is not None:
        say(f"measured error {result.error_db:.1f} dB")
    if result.snr_db is not None:
        say(f"SNR {result.snr_db:.1f} dB over all noise of the receiver, {result.noise_dbm:.1f} dBm in an ADC sample")
    say(f"wrote {target}" + (f" and {picture}" if figure is not None else ""))


def several(source: Path, values: Given, given: Given, signal: Given, target: Path, overwrite: bool) -> None:
    """Simulates an experiment with a list of `radars`; NAME-1.zarr, NAME-2.zarr and so on are their recordings."""
    from t2d_rt.experiment.experiment import SETTINGS, Experiment
    from t2d_rt.experiment.sources import file_beside
    from t2d_rt.recording.files import check_free
    from t2d_rt.simulate import simulate_radars

    radars, interference = values.pop("radars"), values.pop("interference", False)
    if not isinstance(radars, list) or not radars or "radar" in values:
        raise InputError(f"{source}: radars must be a list of radars in place of radar, as in [table2, my_radar.yaml]")
    jobs = [Job.of_values({**values, "radar": radar}, source, given) for radar in radars]
    targets = [target.with_name(f"{target.stem}-{number}{target.suffix}") for number in range(1, len(jobs) + 1)]
    for path in targets:
        check_free(path, overwrite=overwrite)
        check_picture(path.with_suffix(".png"), overwrite=overwrite)
    first, noise = jobs[0].experiment, file_beside(values.get("noise", "none"), source.parent, SETTINGS)
    assert isinstance(first, Experiment)
    for job in jobs:
        _check_processing(signal, job.experiment)
    with reports_said():
        recordings = simulate_radars(
            first.targets_from({}), [job.experiment.radar for job in jobs], interference=interference,
            scene=first.scene_from({}), accuracy=jobs[0].accuracy or None, **first.physics | {"noise": noise},
            **jobs[0].run,
        )  # fmt: skip
    for path, result in zip(targets, recordings, strict=True):
        result = result.processed(**signal)
        result.save(path, overwrite=overwrite, figure=_drawn(result, f"{path.stem}, {result.settings['method']}"))
        say(f"wrote {path} and {path.with_suffix('.png')}")


def recorded(job: Job, signal: Given) -> Recording:
    """The recording of an experiment, or of a recording that is simulated again."""
    from t2d_rt.experiment.experiment import Experiment
    from t2d_rt.simulate import run

    source = job.experiment
    _check_processing(signal, source)
    with reports_said(), ProgressBar("again" if not isinstance(source, Experiment) else source.method) as progress:
        result = run(source, job.accuracy or None, progress=progress, **job.run)
    if not isinstance(source, Experiment):
        return result.processed(**{**source.processing, **signal})
    files = [target.model_dump() for target in source.targets]  # a file's name without the folders of this machine
    files = [{**file, "file": Path(file["file"]).name} if "file" in file else file for file in files]
    result.settings["motion"], result.settings["added"] = files[0], files[1:]
    return result.processed(**signal)


def _check_processing(processing: Given, source: Experiment | Recording) -> None:
    """Tries the options of the spectrogram on a short silence, so that a wrong one does not show after a long run."""
    import numpy as np

    from t2d_rt.experiment.experiment import Experiment
    from t2d_rt.signal import spectrogram
    from t2d_rt.signal.doppler import check_processing
    from t2d_rt.types import Motion

    radar, chirps = source.radar, max(256, processing.get("n_window") or 0, source.radar.separated.loops_per_frame or 0)
    check_processing(radar, chirps, processing)
    if "n_window" in processing and isinstance(source, Experiment):  # files are read again, which tells nothing new
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", T2DWarning)
            durations_s = [target.duration_s for target in source.targets_from({}) if isinstance(target, Motion)]
        if durations_s:
            check_processing(radar, len(radar.chirp_times_s(min(durations_s))), processing)
    silence = np.zeros((min(chirps, CHECKED_CHIRPS), 1, radar.samples), np.complex64)
    spectrogram(silence, radar.separated, **processing)


def _check_background(background: str | None, added: Given, radar: Radar | None, signal: Given) -> None:
    """Tries the model of the background, and its axes where the radar is given here, before a long run."""
    from t2d_rt.recording.maps import background_settings, check_axes

    if background is None:
        for name in added:
            advice = "is of a background and there is none; give --background, or leave it out"
            raise InputError(f"--background-{name.replace('_', '-')} {advice}")
        return
    background_settings(background, **{"seed": 0, "level_db": None, **added})
    if radar is not None:
        check_axes(background, radar, signal)


def _drawn(result: Recording, title: str) -> Figure | None:
    """The spectrogram's figure; None with a warning if it cannot be drawn, which must not cost the result."""
    try:
        figure = result.plot(title=title)
        figure.draw_without_rendering()
    except T2DError:
        raise
    except Exception as error:  # whatever a drawing library may raise
        reason = " ".join(str(error).split()) or type(error).__name__
        message = f"the picture cannot be drawn ({reason}); the result is written without it"
        warn(message)
        return None
    return figure


def plan(file: str, *, given: OfPlan) -> None:
    """Tells what simulate would model and leave out to keep to a tolerance, for a motion file or an experiment (.yaml), and the
    time and memory that it would take. Without --tolerance-db it is an experiment's own, and -20 elsewhere.

    examples:
      t2d-rt plan walk.bvh --tolerance-db -25                    # what simulate would model, leave out, and take
      t2d-rt plan walk.bvh --scene living_room --radar ci4r
    """
    from t2d_rt.accuracy import plan as planned
    from t2d_rt.experiment.experiment import Experiment

    job = Job.of(file, given)
    if not isinstance(job.experiment, Experiment):
        reason = "is a result, which is simulated already; give plan a motion file or an experiment (.yaml)"
        raise InputError(f"{file} {reason}")
    with reports_said():
        chosen_plan = planned(job.experiment, accuracy=job.accuracy, **job.run)
    say(chosen_plan)


def paths(
    file: str,
    output: str | None = None,
    overwrite: bool = False,
    rate_hz: float = 25.0,
    time_s: float | None = None,
    *,
    given: OfPaths,
) -> None:
    """Tells over which paths a motion file, an experiment (.yaml) or a recording (.zarr) is seen: delay, range, speed, level and
    directions of each; nothing is simulated.

    output: table to write (.csv); none by default.
    rate_hz: instants a second in the table that is written [Hz].
    time_s: instant of the table on the screen [s]; the middle of the record by default.

    examples:
      t2d-rt paths walk --scene living_room                      # the strongest in the middle of the record, on the screen
      t2d-rt paths walk --scene living_room -o paths.csv         # all of them over time
      t2d-rt paths walk --scene empty_room --time-s 0.5 --add fan:3,-1,1
      t2d-rt paths walk.zarr -o paths.csv                        # those of a recording, or of an experiment (.yaml)
    """
    from t2d_rt.cli.output import write_text
    from t2d_rt.core.atomic_write import check_file
    from t2d_rt.core.checks import positive
    from t2d_rt.recording.path_table import checked_times, csv_text, path_table, record_times, screen_text

    positive("rate_hz", rate_hz, 1e4, unit="Hz")
    if output is not None:
        check_file(Path(output), "the table of paths", ".csv", overwrite=overwrite)
    model, accuracy = _model_of(Job.of(file, given))
    middle_s = 0.5 * (model.span_s[1] - model.span_s[0]) if time_s is None else time_s
    say(screen_text(path_table(model, accuracy, checked_times(model, middle_s))))
    if output is not None:
        write_text(
            csv_text(path_table(model, accuracy, record_times(model.span_s, rate_hz))), output, overwrite=overwrite
        )
        say(f"wrote {output}")


def _model_of(job: Job) -> tuple[Model, Accuracy]:
    """The model of how the targets become echoes, with all ranked path pairs, and the accuracy that `simulate` would choose."""
    from dataclasses import replace

    from t2d_rt.accuracy import Wanted, chosen, warn_out_of_reach
    from t2d_rt.experiment.experiment import Experiment
    from t2d_rt.experiment.setup import set_up_again, set_up_stored

    machine: Any = dict(job.run)
    tolerance_db, source, accuracy_fields = machine.pop("tolerance_db", None), job.experiment, job.accuracy
    if isinstance(source, Experiment):
        wanted = Wanted.of(accuracy_fields, tolerance_db)
        with reports_said():
            setup = set_up_stored(source, {}, **machine)
    else:
        stored = source.accuracy if tolerance_db is None else None
        wanted = Wanted.of(stored.replace(**accuracy_fields) if stored else accuracy_fields, tolerance_db)
        setup = set_up_again(source.experiment, source.inputs, **machine)
    plan = chosen(setup.model, wanted)
    warn_out_of_reach(plan)
    return replace(plan.model, ranked=setup.model.ranked), plan.accuracy
