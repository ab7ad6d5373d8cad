"""`t2d-rt background`: learns the background of recordings in which nobody moves, samples it, and tells how near it comes."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from t2d_rt.cli.options import Given, Samples, Signal
from t2d_rt.cli.output import made_folder, say
from t2d_rt.core.atomic_write import check_file, writing
from t2d_rt.core.checks import integer, positive
from t2d_rt.core.errors import InputError
from t2d_rt.core.progress import ProgressBar

if TYPE_CHECKING:
    from t2d_rt.noise.background import BackgroundRecord

WORDS = {"simulate": 0, "train": 1, "sample": 1, "evaluate": 2}
"""The verbs, each with the number of names that follow it."""
ROOMS = 36
"""Number of empty rooms that the default is learned from: those of the seeds 0 to 35."""


def background(
    files: list[str] | None = None,
    output: str | None = None,
    overwrite: bool = False,
    count: int = 1,
    duration_s: float = 5.0,
    seed: int = 0,
    codes: int = 32,
    codec_steps: int = 800,
    prior_steps: int = 400,
    *,
    capture: Samples,
    signal: Signal,
) -> None:
    """Learns the background of a radar's spectrograms from recordings in which nobody moves; samples it, evaluates it, and
    simulates empty rooms to learn from. Spectrograms of recordings have --signal.mti mean unless another one is given.

    files: one of train, sample, evaluate and simulate, and what it works on: train DIR or train default, sample MODEL, evaluate
        MODEL DIR.
    output: model (.safetensors) or folder to write.
    count: how many samples, or empty rooms.
    duration_s: duration of each [s].
    seed: seed of the first one, or of the training.
    codes: entries of each code book of a model that is trained.
    codec_steps: steps of training of the codec.
    prior_steps: steps of training of the prior.

    examples:
      t2d-rt background sample default -n 4 --duration-s 10 -o samples   # the model that ships; samples/background_0000.npz ...
      t2d-rt background simulate -n 64 -o rooms                          # empty rooms: what the default is learned from
      t2d-rt background train rooms -o model.safetensors                 # needs the extra [learn]; minutes
      t2d-rt background train recordings --lanes 2 -o mine.safetensors   # captures of a DCA1000 and radar.yaml, or .npy, .zarr
      t2d-rt background train default -o model.safetensors               # simulates the rooms, then learns: the default anew
      t2d-rt background evaluate mine.safetensors held_out               # beside uniform codes and Gaussian noise
      t2d-rt simulate walk --background default -o walk.zarr             # a walk with a background in its spectrogram
    """
    verb, *names = files or [""]
    hint = "t2d-rt background --help shows examples"
    if verb not in WORDS:
        raise InputError(f"background needs one of {', '.join(WORDS)}, got {verb or 'nothing'}; {hint}")
    if len(names) != WORDS[verb]:
        raise InputError(f"background {verb} takes {WORDS[verb]} names, got {len(names)}; {hint}")
    if output is None and verb != "evaluate":
        raise InputError(f"background {verb} needs --output")
    if output is not None and verb == "evaluate":
        raise InputError(f"background {verb} writes nothing; leave out --output")
    reading_options: Given = {"processing": signal, **capture}
    if verb == "simulate":
        _simulate(str(output), overwrite, seed, count, duration_s)
    elif verb == "sample":
        _sample(names[0], str(output), overwrite, seed, count, duration_s)
    elif verb == "evaluate":
        _evaluate(names[0], names[1], reading_options, seed)
    else:
        steps = {"codes": codes, "codec_steps": codec_steps, "prior_steps": prior_steps, "seed": seed}
        _train(names[0], Path(str(output)), overwrite, duration_s, reading_options, steps)


def _simulate(output: str, overwrite: bool, seed: int, count: int, duration_s: float) -> None:
    folder = made_folder(output)
    with ProgressBar("empty rooms") as progress:
        for record in _rooms(seed, count, duration_s, progress):
            _write(record, folder, overwrite)
    say(f"wrote {count} records of {duration_s:g} s to {folder}")


def _rooms(first: int, count: int, duration_s: float, progress: Callable[[float], None]) -> list[BackgroundRecord]:
    from t2d_rt.dataset.background_records import empty_room_record

    rooms = []
    for number in range(integer("count", count, 1)):
        rooms.append(empty_room_record(first + number, duration_s=duration_s))
        progress((number + 1) / count)
    return rooms


def _train(
    source: str, target: Path, overwrite: bool, duration_s: float, reading_options: Given, steps: dict[str, int]
) -> None:
    from t2d_rt.dataset.background_records import background_records
    from t2d_rt.noise.background.model import DEFAULT
    from t2d_rt.noise.background.training import learn_background, require_torch

    require_torch()  # before minutes of simulation
    check_file(target, "a background model", ".safetensors", overwrite=overwrite)
    if source == DEFAULT:
        with ProgressBar("empty rooms") as progress:
            records = _rooms(0, ROOMS, duration_s, progress)
    else:
        records = background_records(source, **reading_options)
    started = time.monotonic()
    with ProgressBar("training") as progress:
        model = learn_background(records, **steps, progress=progress)
    with writing(target, overwrite=overwrite) as temporary:
        model.save(temporary)
    say(f"learned from {len(records)} records, {model.about['duration_s']:g} s, in {time.monotonic() - started:.0f} s")
    say(f"wrote {target}")


def _sample(source: str, output: str, overwrite: bool, seed: int, count: int, duration_s: float) -> None:
    from t2d_rt.noise.background import BackgroundRecord, load_background

    model = load_background(source)
    positive("duration_s", duration_s, 86_400, unit="s")
    integer("count", count, 1)
    folder = made_folder(output)
    names = [f"background_{number:04d}" for number in range(count)]
    older = sorted(file.name for file in folder.glob("background_*.npz") if file.stem not in names)
    if older:
        advice = "of an earlier call, which would be mixed with these; remove it or choose another folder"
        raise InputError(f"{folder} holds {older[0]} {advice}")
    for number, name in enumerate(names):
        sample = model.sample(duration_s, seed=seed + number)
        calibration = {"carrier_hz": model.carrier_hz, "calibrated": model.calibrated}
        record = BackgroundRecord.of(name, sample.power * 10 ** (sample.level_db / 10), sample.grid, **calibration)
        _write(record, folder, overwrite)
    say(f"wrote {count} backgrounds of {duration_s:g} s to {folder}")


def _evaluate(source: str, folder: str, reading_options: Given, seed: int) -> None:
    from t2d_rt.dataset.background_records import background_records
    from t2d_rt.noise.background import load_background
    from t2d_rt.noise.background.evaluate import evaluation

    comparisons = evaluation(load_background(source), background_records(folder, **reading_options), seed=seed)
    rows: list[tuple[str, ...]] = [
        ("", "profile dB", "profiles dB", "levels dB", "autocorr.", "classifier", "perplexity")
    ]
    for name, (gap, perplexity) in comparisons.items():
        columns = gap.profile_db, gap.profiles_db, gap.levels_db, gap.autocorrelation, gap.classifier
        rows.append(
            (name, *(f"{distance:.3f}" for distance in columns), "" if perplexity is None else f"{perplexity:.1f}")
        )
    say("\n".join("".join(f"{cell:>14}" if k else f"{cell:16}" for k, cell in enumerate(row)) for row in rows))
    say("Distances from the recordings: 0 is best, of the classifier's accuracy 0.5.")


def _write(record: BackgroundRecord, folder: Path, overwrite: bool) -> None:
    with writing(folder / f"{record.name}.npz", overwrite=overwrite) as temporary:
        record.save(temporary)
