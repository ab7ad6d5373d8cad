"""`predict` on minutes of one person who does one thing after another, of persons on whom nothing was trained.

`python -m validation.datasets.continuous DIR` makes recordings of 60 s with labels over time, cuts some into windows,
trains on these, and tells the recordings of the other bodies. What is in DIR is not made again.
"""

from __future__ import annotations

import argparse
import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np

from t2d_rt.core.errors import T2DError
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.sources import MotionText
from t2d_rt.learn import Ensemble, TrainOptions, train_model
from t2d_rt.learn.maps import LabelledMaps
from t2d_rt.learn.prediction import events_of, labels_of_windows, predict, windows_of
from t2d_rt.learn.saved_models import Card
from t2d_rt.learn.scores import Event, EventScores, event_scores
from t2d_rt.motion.generate.library.individual import drawn_person
from t2d_rt.recording.recording import Recording
from t2d_rt.simulate import run as simulate
from t2d_rt.types import Radar
from validation.report import Section, at_least, at_most

CLASSES = "walking", "sitting", "bending", "jumping", "falling"
TRAINED, APART = ("man", "adult", "heavy", "old"), ("woman", "child")
"""Bodies whose recordings are trained on, and those of the others."""
LENGTH_S = 60.0
WINDOW_S, STEP_S = 3.0, 0.75
SIZE = 128, 128
RADAR = Radar(
    carrier_hz=77e9, slope_hz_per_s=20e12, sample_rate_hz=2e6, samples=64, prf_hz=5120.0, position_m=(0.0, 0.0, 1.0)
)
"""640 MHz, 15 m, +-4.98 m/s: an eighth of the samples a second of `table2`."""
RECORDINGS, TRAININGS = 10, 60
LEAST_S = 2.0
OVERLAP = 0.5
F1, FALSE_FALLS = 0.7, 1.0
"""Least F1 of events, and most false falls in ten minutes."""
MEMBERS = 3
OPTIONS = TrainOptions(epochs=42, batch=64, rate=2e-3, schedule="cosine", smoothing=0.1, decay=0.05)
CARD = Card(
    model="envelope", classes=CLASSES, size=SIZE, velocity_mps=(-4.9, 4.9), duration_s=WINDOW_S, dynamic_range_db=60.0, seed=0,
)  # fmt: skip


def sentence(rng: np.random.Generator) -> str:
    """Walks in circles, which stay in sight, and between them other things, in an order of their own; some fall and get up."""
    things = [
        f"sits down on a chair for {rng.integers(3, 8)} s, stands up", f"bends down {rng.integers(2, 4)} times",
        f"jumps {rng.integers(3, 7)} times", "falls, stands up" if rng.random() < 0.7 else f"squats {rng.integers(2, 4)} times",
    ]  # fmt: skip
    ways = ["clockwise" if each else "counterclockwise" for each in rng.integers(2, size=len(things) + 1)]
    walks = [f"walks in a {way} circle for {rng.integers(4, 8)} s" for way in ways[1:]]
    done = [
        words
        for walk, place in zip(walks, rng.permutation(len(things)), strict=True)
        for words in (walk, things[place])
    ]
    return f"a person {', '.join(done)} and walks in a {ways[0]} circle for 40 s"


def stream(number: int, bodies: Sequence[str], seed: int) -> Recording:
    """A recording of a person of one of the bodies, of the first draw whose falls come about and that walks into no radar."""
    for attempt in range(5):
        rng = np.random.default_rng([seed, number, attempt])
        body, stature_m = drawn_person("person", rng, body=bodies[number % len(bodies)])
        person = MotionText(
            text=sentence(rng), seed=int(rng.integers(2**31)), body=body, stature_m=round(stature_m, 3), stop_s=LENGTH_S,
            distance_m=rng.uniform(2.5, 4.5), angle_deg=rng.uniform(-180, 180),
        )  # fmt: skip
        whole = Experiment(targets=(person,), radar=RADAR, method="ellipsoid", noise="receiver", seed=number)
        with suppress(T2DError):
            return simulate(whole, device="cpu", progress=False)
    raise T2DError(f"no motion of recording {number} could be made")


def kept_windows(number: int, folder: Path, seed: int) -> Path:
    """A file of the windows of a training recording and of their labels."""
    path = folder / f"{seed}-{number:04}.npz"
    if not path.exists():
        recording = stream(number, TRAINED, seed)
        starts_s, (levels,) = windows_of([CARD], recording, STEP_S)
        labels = labels_of_windows(events_of(recording, CLASSES), starts_s, WINDOW_S, len(CLASSES))
        np.savez(path, levels=levels[labels >= 0].astype(np.float16), labels=labels[labels >= 0])
    return path


def maps_of_files(files: Sequence[Path]) -> LabelledMaps:
    """The windows of recordings, those of one on one side of any split."""
    parts = [np.load(each) for each in files]
    names = [f"{path.stem} {n}" for path, each in zip(files, parts, strict=True) for n in range(len(each["labels"]))]
    return LabelledMaps(
        levels=np.concatenate([each["levels"] for each in parts]),
        labels=np.concatenate([each["labels"] for each in parts]),
        classes=CLASSES,
        groups={"recording": np.array([name.split()[0] for name in names])},
        velocity_mps=CARD.axis_mps,
        duration_s=WINDOW_S,
        names=tuple(names),
    )


def trained(files: Sequence[Path], members: int, options: TrainOptions) -> Ensemble:
    """Networks of several seeds, whose validation is every tenth recording."""
    apart = files[::10]
    train, val = maps_of_files([each for each in files if each not in apart]), maps_of_files(apart)
    return Ensemble(tuple(
        train_model("envelope", train, val, options.model_copy(update={"seed": seed})) for seed in range(members)
    ))  # fmt: skip


def told(model: Ensemble, number: int, seed: int) -> tuple[list[Event], list[Event]]:
    """The events of a recording of the other bodies, and those that are told."""
    recording = stream(number, APART, seed)
    return events_of(recording, CLASSES), predict(model, recording, least_s=LEAST_S).pieces()


def run(folder: Path, *, trainings: int = TRAININGS, recordings: int = RECORDINGS, members: int = MEMBERS,
        options: TrainOptions = OPTIONS, seed: int = 0, workers: int = 2) -> Section:  # fmt: skip
    """The section for so many recordings to train on and to test on."""
    folder.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        files = list(pool.map(partial(kept_windows, folder=folder, seed=seed), range(trainings)))
        model = trained(files, members, options)
        pairs = list(pool.map(partial(told, model, seed=seed + 1), range(recordings)))
    duration_s = recordings * LENGTH_S
    scores = event_scores(pairs, len(CLASSES), duration_s, overlap=OVERLAP)
    falls = scores.false_alarms_per_hour[CLASSES.index("falling")] / 6
    return Section(
        title="Continuous recordings",
        checks=[
            at_least(f"events found, overlap {OVERLAP:g}: F1", scores.f1, F1),
            at_most("false falls in ten minutes", float(falls), FALSE_FALLS),
        ],
        note=summary(scores, pairs),
    )


def summary(scores: EventScores, pairs: Sequence[tuple[list[Event], list[Event]]]) -> str:
    """Scores by class in words."""
    each = ", ".join(
        f"{name} {found} of {true}, told {told} times, {false} of them where there is none"
        for name, found, true, told, false in zip(
            CLASSES, scores.found, scores.true, scores.told, scores.false_alarms, strict=True
        )
    )
    loose = event_scores(pairs, len(CLASSES), 3600 * scores.hours, overlap=0.25).f1
    late = np.percentile(scores.delays_s, [25, 50, 75]) if len(scores.delays_s) else [np.nan] * 3
    return (
        f"{len(pairs)} recordings of {LENGTH_S:g} s. Found: {each}. F1 at an overlap of 0.25: {loose:.2f}. Told later than it "
        f"begins by {late[1]:.1f} s in the median, quartiles {late[0]:.1f} and {late[2]:.1f} s."
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--trainings", type=int, default=TRAININGS)
    parser.add_argument("--recordings", type=int, default=RECORDINGS)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    section = run(given.folder, trainings=given.trainings, recordings=given.recordings, seed=given.seed)
    print(*section.checks, section.note, sep="\n")
