"""`t2d-rt background`: learns the background of recordings in which nobody moves, samples it, and tells how near it comes."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from t2d_rt.cli.options import add_capture_options, add_parameters, capture_options, command_parser
from t2d_rt.cli.output import say
from t2d_rt.core.checks import integer, positive
from t2d_rt.core.errors import InputError
from t2d_rt.core.progress import ProgressBar

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser, Namespace

    from t2d_rt.noise.background import BackgroundRecord

EXAMPLES = """examples:
  t2d-rt background sample default -n 4 --duration-s 10 -o samples   # the model that ships; writes samples/background_0000.npz ...
  t2d-rt background simulate -n 64 -o rooms                          # empty rooms: what the default is learned from
  t2d-rt background train rooms -o model.safetensors                 # needs the extra [learn]; minutes
  t2d-rt background train recordings --lanes 2 -o mine.safetensors   # captures of a DCA1000 and radar.yaml, or .npy, .zarr
  t2d-rt background train default -o model.safetensors               # simulates the rooms, then learns: the default anew
  t2d-rt background evaluate mine.safetensors held_out               # beside uniform codes and Gaussian noise
  t2d-rt simulate walk --background default -o walk.zarr             # a walk with a background in its spectrogram"""

WORDS = {"simulate": 0, "train": 1, "sample": 1, "evaluate": 2}
"""Verbs, each with how many names follow it."""
ROOMS = 36
"""Empty rooms that the default is learned from: those of the seeds 0 to 35."""
NEEDS_OUTPUT = "simulate", "train", "sample"
SUFFIX = ".safetensors"


def parser() -> ArgumentParser:
    """Options of `t2d-rt background`."""
    from t2d_rt.signal import spectrogram

    found = command_parser(
        "background",
        "Learns the background of a radar's spectrograms from recordings in which nobody moves; samples it, evaluates it, and "
        "simulates empty rooms to learn from.",
        config=False,
        noun="train DIR|default | sample MODEL | evaluate MODEL DIR | simulate",
        file="One of train, sample, evaluate and simulate, and what it works on.",
        examples=EXAMPLES,
        several=True,
    )
    found.add_argument("-o", "--output", type=str | None, help="Model (.safetensors) or folder to write.")
    told = "Whether a file of that name is replaced; without it an existing one is an error."
    found.add_argument("--overwrite", type=bool, default=False, nargs="?", const=True, help=told)
    found.add_argument("-n", "--count", type=int, default=1, help="How many samples, or empty rooms.")
    found.add_argument("--duration_s", type=float, default=5.0, help="Duration of each [s].")
    found.add_argument("--seed", type=int, default=0, help="Seed of the first one, or of the training.")
    found.add_argument("--codes", type=int, default=32, help="Entries of each code book of a model that is trained.")
    found.add_argument("--codec_steps", type=int, default=800, help="Steps of training of the codec.")
    found.add_argument("--prior_steps", type=int, default=400, help="Steps of training of the prior.")
    add_capture_options(found)
    add_parameters(
        found.add_argument_group("spectrograms of the recordings in DIR (mti is mean unless given)"),
        spectrogram,
        "signal.",
    )
    return found


def run(options: Namespace) -> None:
    """Does what the first word says."""
    verb, *names = options.file or [""]
    if verb not in WORDS:
        raise InputError(
            f"background needs one of {', '.join(WORDS)}, got {verb or 'nothing'}; t2d-rt background --help shows examples"
        )
    if len(names) != WORDS[verb]:
        raise InputError(
            f"background {verb} takes {WORDS[verb]} names, got {len(names)}; t2d-rt background --help shows examples"
        )
    if (options.output is not None) != (verb in NEEDS_OUTPUT):
        raise InputError(
            f"background {verb} {'needs --output' if verb in NEEDS_OUTPUT else 'writes nothing; leave out --output'}"
        )
    actions: dict[str, Callable[..., None]] = {
        "simulate": _simulate, "train": _train, "sample": _sample, "evaluate": _evaluate,
    }  # fmt: skip
    actions[verb](options, *names)


def _simulate(options: Namespace) -> None:
    folder = _folder(options)
    with ProgressBar("empty rooms") as progress:
        for record in _rooms(options.seed, options.count, options.duration_s, progress):
            _write(record, folder / f"{record.name}.npz", options)
    say(f"wrote {options.count} records of {options.duration_s:g} s to {folder}")


def _rooms(first: int, count: int, duration_s: float, progress: Callable[[float], None]) -> list[BackgroundRecord]:
    from t2d_rt.dataset.background_records import empty_room_record

    found = []
    for number in range(integer("count", count, 1)):
        found.append(empty_room_record(first + number, duration_s=duration_s))
        progress((number + 1) / count)
    return found


def _train(options: Namespace, source: str) -> None:
    from t2d_rt.core.atomic_write import check_place, check_taken, replacing
    from t2d_rt.noise.background.learn import learn_background, require_torch
    from t2d_rt.noise.background.model import DEFAULT

    require_torch()  # before minutes of simulation
    target = Path(options.output)
    if target.suffix != SUFFIX:
        raise InputError(f"a background model ends in {SUFFIX}, got '{target}'; choose another name")
    check_place(target, overwrite=options.overwrite)
    if source == DEFAULT:
        with ProgressBar("empty rooms") as progress:
            records = _rooms(0, ROOMS, options.duration_s, progress)
    else:
        records = _records(options, source)
    started = time.monotonic()
    with ProgressBar("training") as progress:
        model = learn_background(
            records, codes=options.codes, codec_steps=options.codec_steps, prior_steps=options.prior_steps, seed=options.seed,
            progress=progress,
        )  # fmt: skip
    with replacing(target, lambda: check_taken(target, overwrite=options.overwrite)) as new:
        model.save(new)
    say(f"learned from {len(records)} records, {model.about['duration_s']:g} s, in {time.monotonic() - started:.0f} s")
    say(f"wrote {target}")


def _sample(options: Namespace, source: str) -> None:
    from t2d_rt.noise.background import BackgroundRecord, load_background

    model = load_background(source)
    duration_s, count = positive("duration_s", options.duration_s, 86_400, unit="s"), integer("count", options.count, 1)
    folder = _folder(options)
    names = {f"background_{number:04d}" for number in range(count)}
    older = sorted(each.name for each in folder.glob("background_*.npz") if each.stem not in names)
    if older:
        raise InputError(
            f"{folder} holds {older[0]} of an earlier call, which would be mixed with these; remove it or choose another folder"
        )
    for number in range(count):
        found = model.sample(duration_s, seed=options.seed + number)
        power = found.power * 10 ** (found.level_db / 10)
        record = BackgroundRecord.of(
            f"background_{number:04d}", power, found.grid, carrier_hz=model.carrier_hz, calibrated=model.calibrated
        )
        _write(record, folder / f"{record.name}.npz", options)
    say(f"wrote {count} backgrounds of {duration_s:g} s to {folder}")


def _evaluate(options: Namespace, source: str, folder: str) -> None:
    from t2d_rt.noise.background import load_background
    from t2d_rt.noise.background.evaluate import evaluation

    found = evaluation(load_background(source), _records(options, folder), seed=options.seed)
    rows: list[tuple[str, ...]] = [
        ("", "profile dB", "profiles dB", "levels dB", "autocorr.", "classifier", "perplexity")
    ]
    for name, (far, used) in found.items():
        plain = far.profile_db, far.profiles_db, far.levels_db, far.autocorrelation, far.classifier
        rows.append((name, *(f"{each:.3f}" for each in plain), "" if used is None else f"{used:.1f}"))
    say("\n".join("".join(f"{cell:>14}" if k else f"{cell:16}" for k, cell in enumerate(row)) for row in rows))
    say("Distances from the recordings: 0 is best, of the classifier's accuracy 0.5.")


def _records(options: Namespace, folder: str) -> list[BackgroundRecord]:
    from t2d_rt.dataset.background_records import background_records

    given: dict[str, Any] = {name: value for name, value in options.signal.as_dict().items() if value is not None}
    return background_records(folder, processing=given, **capture_options(options))


def _folder(options: Namespace) -> Path:
    folder = Path(options.output)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is no folder; choose another name")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _write(record: BackgroundRecord, path: Path, options: Namespace) -> None:
    from t2d_rt.core.atomic_write import check_taken, replacing

    with replacing(path, lambda: check_taken(path, overwrite=options.overwrite)) as new:
        record.save(new)
