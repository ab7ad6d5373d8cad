"""Limits of the filter from recorded motion: `python -m validation.motions.limits FOLDER [--write]`.

Reads every motion file below the folder, measures it, and prints the percentiles, which recordings are left out for glitches,
and how many of each folder pass. With --write it writes t2d_rt/motion/check/limits.json.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import re
import warnings
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion import load_motion, resample
from t2d_rt.motion.check.gait import gait_of
from t2d_rt.motion.check.measures import Measures, jump_m, measures_of, tracks
from t2d_rt.motion.check.verdict import FILE, GAIT_SIGNS, SENTENCES, Limits, judged, shipped_limits
from t2d_rt.types.motion import Motion

RATES_HZ = 10.0, 15.0, 20.0, 30.0, 60.0
FASTER_HZ = 120.0, 240.0
"""At which steps from frame to frame are measured, a motion of 24 frames a second tells nothing of 60; and rates at which few are
recorded: there an impact, at which a velocity changes within a frame, deviates by half that change times the time of a frame."""

GLITCH_IQR = 1.5
"""A recording has glitches where the logarithm of its greatest deviation of a step, times the squared frame rate, exceeds the
upper quartile by that many interquartile ranges (Tukey). There is a gap: 13 of 105 exceed it by 1.6 and more, the next one by
0.45."""

MARGIN = 1.25
"""Limits over the 99th percentile: eleven of them, each with one recording in a hundred above it, would refuse one in nine
together."""

MOST_SLIDING_S = 0.5
"""A recording in which no foot rests for longer, without a flight, has a track of the pelvis that does not belong to its legs."""

CLASSES = (
    ("falling", r"fall"), ("walking", r"walk|/007_|/003_|12_01|prowl"), ("running", r"run|jog"), ("jumping", r"jump|hop"),
    ("dancing", r"dance|/005_|pirouette|spin"), ("bending", r"bend|scoop"),
)  # fmt: skip
"""Class of a recording by its name, the first that fits; stylised walks and what is none of them have none."""

NOT_NORMAL = re.compile(r"zombie|stealthy|003_01|005_")
"""Walks in disguise, over uneven ground, or of a model."""

TOO_LARGE: tuple[tuple[str, float], ...] = ((r"iclone_002_\d\d_", 0.86),)
"""Recordings whose figure is larger than who was recorded, and by which factor it is brought back: the jump of that performer,
carried over to a figure with legs of 0.975 m, falls with 11.2 m/s^2 in a flight of 0.65 s (centre of mass), where the other ones of
0.4 s and more fall with 9.5 to 9.8."""

MADE_BY_MODELS = re.compile(r"kimodo|momask")
"""What models made sets no limits; it is judged. So are acrobatics, crawling and getting up, which are of no class."""


def read(folder: Path) -> dict[str, Motion]:
    """Every motion below a folder by its path; files that are none are named and left out."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.suffix in (".bvh", ".gz", ".npz", ".txt", ".npy", ".c3d", ".trc", ".amc"):
            try:
                found[path.relative_to(folder).as_posix()] = true_size(load_motion(path), path.name)
            except InputError as error:
                print(f"not read: {str(error)[:160]}")
    return found


def true_size(motion: Motion, name: str) -> Motion:
    """The motion in the size of who was recorded."""
    for pattern, factor in TOO_LARGE:
        if re.match(pattern, name):
            return motion.edited(f"in {factor:g} of its size", joints=factor * motion.joints)
    return motion


LEAST_S = 0.7
"""Shorter recordings are not compared."""


def sound_recordings(folder: Path) -> dict[str, Motion]:
    """Recordings below a folder that are long enough, but for those that the shipped limits leave out."""
    left_out = shipped_limits().left_out
    return {name: each for name, each in read(folder).items() if name not in left_out and each.duration_s > LEAST_S}


def class_of(name: str) -> str | None:
    """Class of a recording."""
    if re.search(r"zombie|crawl|kick|cartwheel|backflip|roll|getup|kimodo|momask", name):
        return None
    return next((each for each, pattern in CLASSES if re.search(pattern, "/" + name)), None)


def broken(measured: dict[str, Measures], motions: dict[str, Motion]) -> dict[str, str]:
    """Recordings that set no limits, and why."""
    scaled = {name: np.log(measured[name].jump_m * motions[name].rate_hz ** 2 + 1e-9) for name in measured}
    low, high = np.percentile(list(scaled.values()), [25, 75])
    found = {
        name: f"a joint jumps by {measured[name].jump_m:.2f} m in one frame"
        for name, value in scaled.items() if value > high + GLITCH_IQR * (high - low)
    }  # fmt: skip
    for name, each in measured.items():
        if each.sliding_s > MOST_SLIDING_S:
            found.setdefault(name, f"no foot rests for {each.sliding_s:.1f} s")
    return found


def made(motions: dict[str, Motion], measured: dict[str, Measures]) -> dict[str, Any]:
    """Content of limits.json."""
    recorded = {name: each for name, each in measured.items() if class_of(name) and not MADE_BY_MODELS.search(name)}
    left_out = broken(recorded, motions)
    sound = [name for name in recorded if name not in left_out]
    walks = [name for name in sound if class_of(name) == "walking" and not NOT_NORMAL.search(name)]
    gaits = [dataclasses.asdict(gait_of(tracks(motions[name]))) for name in walks]
    jumps = {}
    for rate in RATES_HZ:
        own = [
            motions[name] for name in sound if motions[name].rate_hz >= rate and motions[name].duration_s > 10 / rate
        ]
        jumps[rate] = MARGIN * float(np.percentile([jump_m(resample(each, rate).joints) for each in own], 99))
    jumps |= {rate: jumps[RATES_HZ[-1]] * RATES_HZ[-1] / rate for rate in FASTER_HZ}
    of_class: dict[str, list[Measures]] = defaultdict(list)
    for name in sound:
        of_class[str(class_of(name))].append(measured[name])
    return {
        "recordings": len(sound), "left_out": left_out, "walks": len(walks),
        "at_most": {each: round(MARGIN * percentile([measured[name] for name in sound], each, 99), 5) for each in SENTENCES},
        "jumps": [[rate, round(jump, 5)] for rate, jump in jumps.items()],
        "gait": {
            each: [round(float(np.nanpercentile([gait[each] for gait in gaits], q)), 5) for q in (2.5, 97.5)]
            for each in GAIT_SIGNS
        },
        "by_class": {
            kind: {"n": len(own), **{each: percentile(own, each, 95) for each in SENTENCES}}
            for kind, own in sorted(of_class.items())
        },
    }  # fmt: skip


def percentile(measured: list[Measures], name: str, q: float) -> float:
    return round(float(np.percentile([getattr(each, name) for each in measured], q)), 5)


def report(motions: dict[str, Motion], measured: dict[str, Measures], limits: Limits) -> None:
    """How many of each folder pass, and why the others do not."""
    passed: Counter[str] = Counter()
    number: Counter[str] = Counter()
    reasons: dict[str, list[str]] = defaultdict(list)
    for name, motion in motions.items():
        folder = str(Path(name).parent)
        verdict = judged(motion, measured[name], limits=limits)
        number[folder] += 1
        passed[folder] += verdict.passed
        if not verdict.passed or verdict.fall.happened:
            reasons[folder].append(f"    {Path(name).name}: {'; '.join(verdict.reasons)} [{verdict.fall.reason}]")
    for folder in number:
        print(f"{folder}: {passed[folder]} of {number[folder]} pass", *reasons[folder], sep="\n")
    print(f"all: {sum(passed.values())} of {len(motions)} pass")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    warnings.simplefilter("ignore", T2DWarning)
    motions = read(options.folder)
    measured = {name: measures_of(motion, tracks(motion)) for name, motion in motions.items()}
    values = made(motions, measured)
    print(json.dumps(values, indent=1))
    if options.write:
        FILE.write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")
    report(motions, measured, Limits(**values))


if __name__ == "__main__":
    main()
