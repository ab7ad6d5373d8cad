"""Each class by the default providers, judged: `python -m validation.motions.classes RECORDINGS [-n 50] [--sheets FOLDER]`.

For each class: how many of n pass the filter at the first try, how many are what was asked for, why the others are not, the spectra
and the figures against recordings of the class below the folder RECORDINGS, and how far apart the motions are.
"""

from __future__ import annotations

import argparse
import textwrap
import time
import warnings
from collections import Counter
from contextlib import suppress
from pathlib import Path

import numpy as np

from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion.check import Verdict, check_motion
from t2d_rt.motion.check.verdict import shipped_limits
from t2d_rt.motion.contacts import runs
from t2d_rt.motion.descriptions.grammar import grammar_descriptions
from t2d_rt.motion.descriptions.slots import ACTIVITIES, Activity
from t2d_rt.motion.generate import motion_from_text
from t2d_rt.motion.interpolate import trim
from t2d_rt.types import Motion
from validation.motions.limits import class_of, sound_recordings
from validation.motions.population import BANDS_HZ, diversity, spectrum_difference_db


def made(activity: Activity, count: int, seed: int) -> tuple[list[Motion], list[str]]:
    """Motions of a class from descriptions of the grammar, and their sentences; those that fail are told."""
    motions, sentences = [], []
    for number, description in enumerate(grammar_descriptions(activity, count, seed=seed)):
        try:
            motions.append(motion_from_text(description, seed=seed + number))
            sentences.append(description.sentence)
        except InputError as error:
            print(f"    not made: {description.sentence!r}: {error}")
    return motions, sentences


def judge(activity: Activity, motions: list[Motion], sentences: list[str]) -> list[Verdict]:
    """Verdicts, and what is wrong."""
    sound = [check_motion(each) for each in motions]
    asked = [check_motion(each, expected=activity) for each in motions]
    other = [
        tuple(reason for reason in each.reasons if reason not in plain.reasons)
        for each, plain in zip(asked, sound, strict=True)
    ]
    print(f"  pass {sum(each.passed for each in sound)} of {len(motions)}, as asked {sum(not each for each in other)}")
    for number, (plain, wrong) in enumerate(zip(sound, other, strict=True)):
        for reason in (*plain.reasons, *(f"NOT AS ASKED: {each}" for each in wrong)):
            print(f"    {number}: {sentences[number][:70]}: {reason}")
    words = Counter(" ".join(reason.split()[:4]) for each in sound for reason in each.reasons)
    print(f"  reasons: {dict(words.most_common())}")
    return sound


PLAIN = {"before": (), "after": (), "manner": None, "speed": "normal"}
"""What makes a description one of the class's action alone, which recordings are of."""


SHOWN: dict[str, dict[str, tuple[str | None, ...]]] = {
    "bending": {"action": ("bend",), "direction": ("forward", "down")}
}
"""What recordings of a class show where it has more: the only one of bending is of a person who scoops from the floor ahead."""

IN_PLACE = ("bending",)
"""Classes whose recordings show no step; ours mostly have one before and after."""

STANDS_MPS = 0.1
"""Speed up to which the ball of a foot stands."""


def plain(activity: Activity, count: int, seed: int, longest_s: float) -> list[Motion]:
    """The middle of motions of the main step alone, at its normal speed and in no manner, as long as recordings are; of a class
    of several movements those that recordings show."""
    shown = SHOWN.get(activity, {})
    drawn = grammar_descriptions(activity, (4 if shown else 1) * count, seed=seed)
    alike = [each for each in drawn if all(getattr(each, name) in values for name, values in shown.items())]
    found = []
    for number, description in enumerate(alike[:count]):
        with suppress(InputError):
            motion = motion_from_text(description.model_copy(update=PLAIN), seed=seed + number)
            motion = in_place(motion) if activity in IN_PLACE else motion
            before = max(0.0, 0.5 * (motion.duration_s - longest_s))
            found.append(trim(motion, before, motion.duration_s - before))
    return found


def in_place(motion: Motion) -> Motion:
    """The longest stretch of a motion in which both feet stand."""
    balls = motion.joints[:, [motion.names.index(f"{side}_foot") for side in ("left", "right")]]
    speed = np.linalg.norm(np.gradient(balls, 1 / motion.rate_hz, axis=0), axis=-1).max(axis=1)
    start, stop = max(runs(speed < STANDS_MPS), key=lambda each: each[1] - each[0])
    return trim(motion, start / motion.rate_hz, (stop - 1) / motion.rate_hz)


def compare(
    activity: Activity, motions: list[Motion], verdicts: list[Verdict], recorded: list[Motion], alone: list[Motion]
) -> None:
    """Spectra, figures and diversity against recordings."""
    own = diversity(motions)
    print(f"  distances of pairs: median {own.median_m:.3f} m, least {own.least_m:.3f} m")
    if len(recorded) > 1:
        theirs = diversity(recorded)
        print(f"  of {len(recorded)} recordings: median {theirs.median_m:.3f} m, least {theirs.least_m:.3f} m")
    for what, others in (("", motions), (", main step alone", alone)) if recorded else ():
        difference = spectrum_difference_db(others, recorded)
        told = ", ".join(
            f"{low:g}-{high:g} Hz {each:+.1f}"
            for low, high, each in zip(BANDS_HZ, BANDS_HZ[1:], difference, strict=False)
        )
        print(f"  spectrum over that of recordings [dB]{what}: {told}")
    bounds = shipped_limits().by_class.get(activity, {})
    of = {"made": verdicts, "main step alone": judged(alone), "recordings": judged(recorded)} if bounds else {}
    for name in ("foot_skate_m", "jerk_mps3", "floor_penetration_m") if bounds else ():
        values = {what: np.array([getattr(each.measures, name) for each in some]) for what, some in of.items()}
        made_and_alone = ", ".join(
            f"{what} {np.percentile(values[what], 95):.4g}" for what in ("made", "main step alone")
        )
        low, high = drawn_percentiles(values["recordings"], len(verdicts))
        print(
            f"  {name}: 95th percentile {made_and_alone}, of recordings {bounds[name]:.4g} (n = {bounds['n']:.0f}), "
            f"of {len(verdicts)} draws among them {low:.4g} to {high:.4g}"
        )


def judged(motions: list[Motion]) -> list[Verdict]:
    return [check_motion(each) for each in motions]


def drawn_percentiles(values: np.ndarray, count: int) -> tuple[float, float]:
    """Limits of nine in ten 95th percentiles of so many draws among few recordings: what the recordings would reach themselves."""
    rng = np.random.default_rng(0)
    found = [np.percentile(rng.choice(values, count), 95) for _ in range(2000)]
    return float(np.percentile(found, 5)), float(np.percentile(found, 95))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", type=Path)
    parser.add_argument("-n", type=int, default=50)
    parser.add_argument("--class", dest="only", choices=ACTIVITIES)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sheets", type=Path)
    options = parser.parse_args()
    warnings.simplefilter("ignore", T2DWarning)
    recordings = sound_recordings(options.recordings)
    for activity in [options.only] if options.only else ACTIVITIES:
        start = time.perf_counter()
        motions, sentences = made(activity, options.n, options.seed)
        if not motions:
            print(f"{activity}: none made")
            continue
        print(f"{activity}: {len(motions)} made, {(time.perf_counter() - start) / len(motions):.2f} s each")
        verdicts = judge(activity, motions, sentences)
        own = [each for name, each in recordings.items() if class_of(name) == activity]
        longest_s = float(np.median([each.duration_s for each in own])) if own else 0.0
        alone = plain(activity, options.n, options.seed, longest_s) if own else []
        compare(activity, motions, verdicts, own, alone)
        if options.sheets is not None:
            from t2d_rt.view.contact_sheet import contact_sheet

            labels = ["\n".join(textwrap.wrap(each, 24)[:5]) for each in sentences[:8]]
            options.sheets.mkdir(parents=True, exist_ok=True)
            contact_sheet(motions[:8], labels=labels, title=activity).savefig(options.sheets / f"{activity}.png")


if __name__ == "__main__":
    main()
