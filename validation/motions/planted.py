"""Faults planted into sound motions: `python -m validation.motions.planted RECORDINGS [-n 40]`.

How many of each kind the filter refuses; how many sound recordings below the folder RECORDINGS; and how many motions that the
descriptions' grammar asks for, by class. A motion of a wrong class is one of a plain sentence of another class. A copy is sound by
itself, and judged beside what it repeats.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion import trim
from t2d_rt.motion.check import check_motion, copies
from t2d_rt.motion.descriptions.grammar import grammar_descriptions
from t2d_rt.motion.descriptions.slots import ACTIVITIES, GAIT_TYPES, Activity
from t2d_rt.motion.generate import motion_from_text
from t2d_rt.motion.kinematics import motion_of, poses_of
from t2d_rt.motion.vary import mirror
from t2d_rt.motion.vary.abnormal import abnormal_walk
from t2d_rt.types.motion import Motion
from validation.motions.gaits import Normal, figures, limit_of, recorded_walks
from validation.motions.limits import class_of, sound_recordings
from validation.motions.seeds import SENTENCES

Fault = Callable[[Motion, np.random.Generator], Motion]


def moved(motion: Motion, offset_m: np.ndarray) -> Motion:
    """The motion with all joints moved by (T, 3) or (3,) [m]."""
    return replace(motion, joints=motion.joints + np.broadcast_to(offset_m, (len(motion.joints), 3))[:, None])


def slid(motion: Motion, rng: np.random.Generator) -> Motion:
    """Carried along at 0.3 to 0.8 m/s, feet and all, over its whole time."""
    angle, speed = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.8)
    ahead = speed * motion.times_s[:, None] * np.array([np.cos(angle), np.sin(angle), 0.0])
    return moved(motion, ahead)


def floated(motion: Motion, rng: np.random.Generator) -> Motion:
    """Above the floor by 0.08 to 0.3 m."""
    return moved(motion, np.array([0.0, 0.0, rng.uniform(0.08, 0.3)]))


def sunk(motion: Motion, rng: np.random.Generator) -> Motion:
    """In the floor by 0.08 to 0.3 m."""
    return moved(motion, np.array([0.0, 0.0, -rng.uniform(0.08, 0.3)]))


def held(motion: Motion, rng: np.random.Generator) -> Motion:
    """A statue: one of its poses all the time, trembling by 2 mm."""
    frame = int(rng.integers(len(motion.joints)))
    count = len(motion.joints)
    pose = np.repeat(motion.joints[frame : frame + 1], count, axis=0)
    sway = 0.002 * np.sin(2 * np.pi * 0.5 * motion.times_s)[:, None, None]
    return replace(motion, joints=pose + sway, rotations=np.repeat(motion.rotations[frame : frame + 1], count, axis=0))


FAULTS: Mapping[str, Fault] = {"slide": slid, "float": floated, "sink": sunk, "statue": held}


def repeated(motion: Motion, rng: np.random.Generator) -> Motion:
    """The same performance once more: in a mirror or not, elsewhere, of another size, up to 3 % faster or slower, up to 0.5 s
    later, under noise of 3 mm."""
    found = mirror(motion) if rng.random() < 0.5 else motion
    found = trim(found, float(rng.uniform(0, min(0.5, 0.2 * found.duration_s))), found.duration_s)
    angle, noise = rng.uniform(0, 2 * np.pi), 0.003 * rng.standard_normal(found.joints.shape)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    joints = float(rng.uniform(0.95, 1.05)) * (found.joints + noise) @ turn.T + [*rng.uniform(-3, 3, 2), 0.0]
    return replace(found, joints=joints, rate_hz=found.rate_hz * float(rng.uniform(0.97, 1.03)))


FIRST_SEED = 20_000
"""Of the walks; those from 1000 on are what the filter's measure of a gait was chosen on."""


def normal_walks(recordings: Path, number: int) -> list[Motion]:
    """Made walks that are normal by the measure of `validation.motions.gaits`, which shares nothing with the filter."""
    recorded = recorded_walks(recordings)
    middle, limit = Normal(recorded), limit_of(recorded)
    found: list[Motion] = []
    for seed in range(FIRST_SEED, FIRST_SEED + 10 * number):
        if len(found) == number:
            break
        walk = motion_from_text("a person walks", seed=seed)
        seen = figures(walk)
        if seen is not None and middle.distance(seen) < limit:
            found.append(walk)
    return found


def mild(walks: Sequence[Motion], rng: np.random.Generator) -> list[Motion]:
    """Normal walks with hardly anything of an abnormal gait: 0 to 0.1 of the severity of patients."""
    return [
        motion_of(
            abnormal_walk(
                poses_of(walk), GAIT_TYPES[place % len(GAIT_TYPES)], severity=float(rng.uniform(0, 0.1)), rng=rng
            )
        )
        for place, walk in enumerate(walks)
    ]


def made(activity: Activity, number: int) -> list[Motion]:
    """Motions of a class by the grammar; sentences that nothing makes are left out."""
    found = []
    for seed, description in enumerate(grammar_descriptions(activity, number, seed=7)):
        try:
            found.append(motion_from_text(description, seed=seed))
        except InputError as error:
            print(f"not made: {error}")
    return found


def told(what: str, reasons: list[tuple[str, ...]]) -> None:
    """How many are refused, and the commonest reasons."""
    words = Counter(" ".join(each.split()[:5]) for some in reasons for each in some)
    refused = sum(map(bool, reasons))
    print(
        f"{what}: {refused} of {len(reasons)} refused ({refused / max(len(reasons), 1):.1%}) {dict(words.most_common(4))}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", type=Path)
    parser.add_argument("-n", type=int, default=40)
    options = parser.parse_args()
    warnings.simplefilter("ignore", T2DWarning)
    recorded = [each for name, each in sound_recordings(options.recordings).items() if class_of(name)]
    told("sound recordings", [check_motion(each).reasons for each in recorded])
    of = {activity: made(activity, options.n) for activity in ACTIVITIES}
    for activity, motions in of.items():
        told(f"made, {activity}", [check_motion(each, expected=activity).reasons for each in motions])
    sound = [each for motions in of.values() for each in motions if check_motion(each).passed]
    rng = np.random.default_rng(0)
    for name, fault in FAULTS.items():
        told(f"planted {name}", [check_motion(fault(each, rng)).reasons for each in sound])
    told("planted copy", [("a copy",) * len(copies([each, repeated(each, rng)])) for each in sound])
    for activity, motions in of.items():
        again = {second for _, second in copies(motions)}
        told(f"taken for copies, {activity}", [("a copy",) * (number in again) for number in range(len(motions))])
    for activity, sentence in SENTENCES.items():
        plain = [motion_from_text(sentence, seed=seed) for seed in range(options.n)]
        wrong = [
            check_motion(each, expected=asked).reasons for asked in ACTIVITIES if asked != activity for each in plain
        ]
        told(f"planted wrong class, {activity}", wrong)
    gentle = mild(normal_walks(options.recordings, options.n), rng)
    told("planted too mild", [check_motion(each, expected="abnormal_walking").reasons for each in gentle])


if __name__ == "__main__":
    main()
