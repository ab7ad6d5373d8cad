"""Abnormal gaits beside normal ones, by a measure that did not make them: `python -m validation.motions.gaits RECORDINGS [-n 25]`.

Steps are found where an ankle is farthest before and behind the pelvis (Zeni, Richards and Higginson, Gait and Posture 27 (2008),
710-714), not by contacts, and what is measured of them is compared with recorded normal walks of the folder RECORDINGS. A gait is
told from a normal one if it lies farther from their middle than `NORMAL` of the recorded ones do, each judged by the others.
Nothing of it is shared with `t2d_rt.motion.check` or with what disturbs a walk.
"""

from __future__ import annotations

import argparse
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks
from scipy.stats import spearmanr

from t2d_rt.core.errors import T2DWarning
from t2d_rt.motion import load_motion
from t2d_rt.motion.generate import motion_from_text
from t2d_rt.types import Motion
from t2d_rt.types.motion import CANONICAL_JOINTS
from validation.motions.population import RATE_HZ, joints_at_rate


@dataclass(frozen=True, slots=True)
class Kind:
    """A gait: a sentence that asks for it, and the figures by which physicians grade it."""

    sentence: str
    signs: tuple[str, ...]


GAITS = {
    "parkinsonian": Kind("a person walks with a parkinsonian gait", ("step length", "lean", "arm swing", "lift")),
    "festinating": Kind("a person walks with a festinating gait", ("step length", "lean", "arm swing", "lift", "hurry")),
    "freezing": Kind("a person walks with freezing of gait", ("halted", "step length", "lean", "arm swing", "lift")),
    "waddling": Kind("a person waddles", ("trunk roll", "pelvis sway", "step width", "step length")),
    "ataxic": Kind("a person walks with an ataxic gait", ("step width", "step width spread", "step time spread", "trunk roll")),
    "scissor": Kind("a person walks with a scissor gait", ("knee bend", "step length", "trunk roll", "hips' height", "lean")),
    "steppage": Kind("a person walks with a steppage gait", ("lift", "foot drop", "step length")),
    "limping": Kind("a person limps forward", ("step time asymmetry", "step length asymmetry", "trunk roll", "step length")),
}  # fmt: skip
"""The eight gaits."""
NORMAL = 0.95
"""Fraction of normal walks that the limit lets pass."""
FARTHEST = 3
"""Figures that a walk's distance is made of: those farthest from normal, for no gait departs in all of them."""
STEADY_S = 0.1
"""What is left out at both ends of a walk, where it begins and stops."""
STRAIGHT, PAUSE = 0.97, 0.3
"""Least way between both ends over the length of the path, and least speed over the usual one, of a walk that others are compared
with."""
LEAST_SPREAD = {"halted": 0.1}
"""Of figures that are 0 in most normal walks."""
HALTED_MPS = 0.1
"""Speed of the pelvis below which nobody goes on."""
TREMBLES_S = 0.15
"""Standard deviation of the Gaussian that smooths that speed: whoever trembles at 4 Hz and more without going on has halted."""
SIDES = "left", "right"


def figures(motion: Motion) -> dict[str, float] | None:
    """What is measured of a walk, lengths in lengths of the leg; None where fewer than four steps are found."""
    joints = joints_at_rate(motion)
    at = {name: joints[:, number] for number, name in enumerate(CANONICAL_JOINTS)}
    pelvis = at["pelvis"]
    leg = float(np.median(np.linalg.norm(at["left_hip"] - at["left_knee"], axis=1)))
    leg += float(np.median(np.linalg.norm(at["left_knee"] - at["left_ankle"], axis=1)))
    ahead = gaussian_filter1d(np.gradient(pelvis[:, :2], axis=0), 0.5 * RATE_HZ, axis=0)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)

    def along(vector: np.ndarray) -> np.ndarray:
        return np.asarray((vector[:, :2] * ahead).sum(axis=1)) / leg

    def across(vector: np.ndarray) -> np.ndarray:
        return np.asarray((vector[:, :2] * aside).sum(axis=1)) / leg

    strikes = []
    for side, name in enumerate(SIDES):
        place = along(at[f"{name}_ankle"] - pelvis)
        found, _ = find_peaks(place, prominence=0.08, distance=max(1, round(0.25 * RATE_HZ)))
        strikes += [(int(frame), side) for frame in found]
    strikes.sort()
    margin = round(STEADY_S * RATE_HZ)
    strikes = [each for each in strikes if margin <= each[0] < len(joints) - margin]
    if len(strikes) < 4:
        return None
    frames, sides = np.array(strikes).T
    inside = slice(frames[0], frames[-1] + 1)
    speed = np.linalg.norm(np.gradient(pelvis[:, :2], axis=0), axis=1) * RATE_HZ
    gone = np.gradient(gaussian_filter1d(pelvis[:, :2], TREMBLES_S * RATE_HZ, axis=0), axis=0) * RATE_HZ
    halted = np.linalg.norm(gone, axis=1) < HALTED_MPS
    steps_s = np.maximum(np.diff(frames), 1) / RATE_HZ
    alternate = np.diff(sides) != 0
    steps_s, after = steps_s[alternate], sides[1:][alternate]
    apart = at["left_ankle"] - at["right_ankle"]
    lengths = np.abs(along(apart))[frames]
    trunk = at["neck"] - pelvis
    upright = np.linalg.norm(trunk, axis=1) / leg
    found = {
        "cadence": float(60 / np.median(steps_s)) if len(steps_s) else 0.0,
        "speed": float(np.median(speed[inside]) / leg),
        "step length": float(np.median(lengths)),
        "step width": float(np.median(across(apart)[frames])),
        "step width spread": float(np.std(across(apart)[frames])),
        "step length spread": float(np.std(lengths) / np.mean(lengths)),
        "step time spread": float(np.std(np.log(steps_s))) if len(steps_s) > 1 else 0.0,
        "step length asymmetry": _asymmetry(lengths, sides),
        "step time asymmetry": _asymmetry(steps_s, after),
        "lean": float(np.degrees(np.median(np.arcsin(np.clip(along(trunk)[inside] / upright[inside], -1, 1))))),
        "trunk roll": float(np.degrees(np.std(across(trunk)[inside] / upright[inside]))),
        "pelvis sway": float(np.std(across(pelvis - _moving_mean(pelvis))[inside])),
        "hips' height": float(np.median(_hips_over_ankles(at)[inside]) / leg),
        "halted": float(np.sum(halted[inside]) / RATE_HZ),
        "trembling": float(np.sqrt(np.mean(_fast(at, leg)[inside] ** 2))),
        "hurry": _hurried(steps_s) if len(steps_s) > 3 else 0.0,
    }
    lifts, swings, knees, toes = [], [], [], []
    for name in SIDES:
        height = at[f"{name}_ankle"][:, 2] / leg
        peaks, _ = find_peaks(height[inside], prominence=0.03)
        lifts.append(float(np.median(height[inside][peaks]) - np.percentile(height, 5)) if len(peaks) else 0.0)
        swings.append(float(np.ptp(along(at[f"{name}_wrist"] - at[f"{name}_shoulder"])[inside])))
        thigh, shank = at[f"{name}_knee"] - at[f"{name}_hip"], at[f"{name}_ankle"] - at[f"{name}_knee"]
        cosine = (thigh * shank).sum(axis=1) / np.linalg.norm(thigh, axis=1) / np.linalg.norm(shank, axis=1)
        knees.append(float(np.degrees(np.percentile(np.arccos(np.clip(cosine, -1, 1))[inside], 10))))
        foot = at[f"{name}_foot"] - at[f"{name}_ankle"]
        pitch = np.degrees(np.arctan2(-foot[:, 2], np.maximum(np.linalg.norm(foot[:, :2], axis=1), 1e-6)))
        own = frames[sides == SIDES.index(name)]
        toes.append(float(np.median(pitch[own])) if len(own) else 0.0)
    found |= {
        "lift": max(lifts), "lift asymmetry": abs(lifts[0] - lifts[1]), "arm swing": float(np.mean(swings)),
        "arm swing asymmetry": abs(swings[0] - swings[1]), "knee bend": max(knees), "foot drop": max(toes),
        "knees apart": float(np.median(across(at["left_knee"] - at["right_knee"])[inside])),
    }  # fmt: skip
    return found


def _asymmetry(values: np.ndarray, sides: np.ndarray) -> float:
    """Difference of the means of both sides over their sum; 0 where one has none."""
    left, right = values[sides == 0], values[sides == 1]
    if not len(left) or not len(right):
        return 0.0
    return float(abs(left.mean() - right.mean()) / (left.mean() + right.mean()))


def _moving_mean(track: np.ndarray) -> np.ndarray:
    return np.asarray(gaussian_filter1d(track, 0.7 * RATE_HZ, axis=0))


def _hips_over_ankles(at: dict[str, np.ndarray]) -> np.ndarray:
    """Height of the hips over the lower ankle [m], (T,): of a straight leg its length."""
    ankles = np.minimum(at["left_ankle"][:, 2], at["right_ankle"][:, 2])
    return np.asarray((at["left_hip"][:, 2] + at["right_hip"][:, 2]) / 2 - ankles)


def _fast(at: dict[str, np.ndarray], leg: float) -> np.ndarray:
    """What knees and wrists move by within a sixth of a second, (T,)."""
    tracks = [at[f"{side}_{name}"] - at["pelvis"] for side in SIDES for name in ("knee", "wrist")]
    moved = [track - gaussian_filter1d(track, 0.06 * RATE_HZ, axis=0) for track in tracks]
    return np.asarray(np.linalg.norm(np.stack(moved), axis=(0, 2)) / leg)


def _hurried(steps_s: np.ndarray) -> float:
    """Logarithm of the time of a step in the second half of a walk over that in the first: below 0 where steps hurry."""
    half = len(steps_s) // 2
    return float(np.log(np.median(steps_s[half:]) / np.median(steps_s[:half])))


class Normal:
    """What normal walks are like: the middle and the spread of each figure."""

    def __init__(self, walks: Sequence[dict[str, float]]) -> None:
        self.names = list(walks[0])
        table = np.array([list(each.values()) for each in walks])
        self._middle = np.median(table, axis=0)
        low, high = np.percentile(table, [5, 95], axis=0)
        self._spread = np.maximum((high - low) / (2 * 1.645), [LEAST_SPREAD.get(name, 1e-3) for name in self.names])

    def departures(self, walk: dict[str, float]) -> np.ndarray:
        """By how many spreads each figure departs."""
        return np.asarray((np.array(list(walk.values())) - self._middle) / self._spread)

    def severity(self, walk: dict[str, float], signs: Sequence[str]) -> float:
        """How far the figures of some names depart, in the geometric mean of 1 + |departure|."""
        departures = np.abs(self.departures(walk))[[self.names.index(name) for name in signs]]
        return float(np.exp(np.log1p(departures).mean()))

    def distance(self, walk: dict[str, float]) -> float:
        """Root mean square of the farthest departures."""
        farthest = np.sort(np.abs(self.departures(walk)))[-FARTHEST:]
        return float(np.sqrt(np.mean(farthest**2)))


def limit_of(walks: Sequence[dict[str, float]]) -> float:
    """The distance that `NORMAL` of the walks lie within, each from all the others."""
    distances = [Normal([*walks[:number], *walks[number + 1 :]]).distance(walk) for number, walk in enumerate(walks)]
    return float(np.quantile(distances, NORMAL))


def severity_of(motion: Motion) -> float:
    """The severity that a made motion's origin tells."""
    found = re.search(r"gait, severity ([\d.]+)", " ".join(motion.origin))
    assert found is not None, "an abnormal gait tells its severity"
    return float(found[1])


def recorded_walks(folder: Path) -> list[dict[str, float]]:
    """Figures of the walks below a folder that go straight and do not pause."""
    motions = [load_motion(path) for path in sorted(folder.rglob("walking_*.bvh*"))]
    found = [figures(each) for each in motions if _straight(each)]
    return [each for each in found if each is not None]


def _straight(motion: Motion) -> bool:
    track = gaussian_filter1d(joints_at_rate(motion)[:, 0, :2], 0.3 * RATE_HZ, axis=0)
    track = track[round(0.5 * RATE_HZ) : -round(0.5 * RATE_HZ)]  # smoothed tracks stand still at their ends
    speed = np.linalg.norm(np.diff(track, axis=0), axis=1)
    return bool(
        np.linalg.norm(track[-1] - track[0]) > STRAIGHT * speed.sum() and speed.min() > PAUSE * np.median(speed)
    )


def main() -> None:
    warnings.simplefilter("ignore", T2DWarning)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", type=Path)
    parser.add_argument("-n", type=int, default=25, help="seeds of each gait")
    parser.add_argument("--seed", type=int, default=1000)
    options = parser.parse_args()
    walks = recorded_walks(options.recordings)
    normal, limit = Normal(walks), limit_of(walks)
    print(f"{len(walks)} recorded walks; {NORMAL:.0%} of them within {limit:.2f}")
    seeds = range(options.seed, options.seed + options.n)
    plain = [figures(motion_from_text("a person walks forward", seed=seed)) for seed in seeds]
    beyond = sum(each is None or normal.distance(each) > limit for each in plain)
    print(f"{'made normal walks':20} {beyond} of {options.n} told from normal")
    for name, kind in GAITS.items():
        made = [motion_from_text(kind.sentence, seed=seed) for seed in seeds]
        seen = [(each, found) for each in made if (found := figures(each)) is not None]
        told = options.n - len(seen) + sum(normal.distance(found) > limit for _, found in seen)
        asked = [severity_of(each) for each, _ in seen]
        order = spearmanr(asked, [normal.severity(found, kind.signs) for _, found in seen]).statistic
        departures = np.abs([normal.departures(found) for _, found in seen])
        each_sign = []
        for sign in kind.signs:
            column = departures[:, normal.names.index(sign)]
            each_sign.append(f"{sign} {np.median(column):.1f} ({spearmanr(asked, column).statistic:.2f})")
        print(
            f"{name:20} {told} of {options.n} told, severity {order:.2f}; {', '.join(each_sign)}",
            flush=True,
        )


if __name__ == "__main__":
    main()
