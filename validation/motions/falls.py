"""Falls by physics: a hundred of each type against measured falls, and a strip of pictures of each.

    python -m validation.motions.falls LEADS [--falls 100] [--walks 30] [--out validation/report]

LEADS is a folder of recorded walks (.bvh or .bvh.gz). What is measured is measured on the motions that come out, or on the
run of the simulation where a motion does not say it (energy, depth of contacts). As many falls as --walks come after walks made
from a sentence: how far planted feet slide there before the event.
"""

from __future__ import annotations

import argparse
import math
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion import load_motion, resample, trim
from t2d_rt.motion.check import detect_fall
from t2d_rt.motion.check.measures import contacts, tracks
from t2d_rt.motion.generate import motion_from_text
from t2d_rt.motion.generate.falls import Fall, FallPlan, simulate_fall
from t2d_rt.motion.kinematics import facing
from t2d_rt.types.motion import Motion

TYPES = ("slip", "trip", "collapse")

MOST_SKATE_M = 0.02
"""Bar of the sliding of planted feet before a fall."""

BARS = {
    "pelvis_mps": (1.2, 3.0), "head_mps": (1.5, 4.5), "event_to_impact_s": (0.4, 2.5), "descent_s": (0.3, 1.2),
    "slide_m": (0.0, 0.5), "gain_j": (0.0, 8.0), "floor_depth_m": (0.0, 0.02), "self_depth_m": (0.0, 0.02),
    "lead_changed_m": (0.0, 1e-9), "step_over_lead": (0.0, 1.0), "rest_speed_mps": (0.0, 0.05), "seconds": (0.0, 2.0),
}  # fmt: skip


WORDS = {
    "pelvis_mps": "downward speed of the pelvis at impact [m/s]", "head_mps": "of the head [m/s]",
    "event_to_impact_s": "loss of balance to impact [s]", "descent_s": "descent [s]", "slide_m": "slide after the impact [m]",
    "gain_j": "gain of mechanical energy less the work of muscles [J]", "floor_depth_m": "depth in the floor [m]",
    "self_depth_m": "depth of limbs in one another [m]", "lead_changed_m": "change of what comes before [m]",
    "step_over_lead": "step of a joint's speed at the event, over the walk's greatest", "rest_speed_mps": "speed at rest [m/s]",
    "seconds": "time of computation [s]",
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One fall."""

    type: str
    side: str
    """Of the trunk that strikes the floor: forward is the front."""
    topples: str
    """Where the filter's detector finds that the head went; "not found" where it finds no fall."""
    values: dict[str, float]


@cache
def leads(folder: str) -> tuple[Motion, ...]:
    """Walks of at least 1.5 s whose person gets on."""
    found = []
    for path in sorted(Path(folder).iterdir()):
        if "walk" in path.name and path.name.endswith((".bvh", ".bvh.gz")):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", T2DWarning)
                motion = load_motion(path)
            track = motion.joints[:, 0, :2]
            if (
                motion.duration_s > 1.5
                and np.linalg.norm(np.diff(track, axis=0), axis=1).sum() > 0.6 * motion.duration_s
            ):
                found.append(motion)
    return tuple(found)


def one(job: tuple[str, str, int]) -> Row | str:
    """A fall by type and seed, or why there is none."""
    folder, kind, seed = job
    lead = leads(folder)[seed % len(leads(folder))]
    start = time.process_time()
    try:
        made = simulate_fall(lead, FallPlan(type=kind, seed=seed))  # type: ignore[arg-type]
    except InputError as error:
        return f"{kind} {seed}: {error}"
    found = detect_fall(made.motion)
    topples = str(found.direction) if found.happened else "not found"
    return Row(
        type=kind,
        side=made.heading,
        topples=topples,
        values=values(made, lead) | {"seconds": time.process_time() - start},
    )


def values(made: Fall, lead: Motion) -> dict[str, float]:
    """Figures of one fall, by the names of BARS."""
    motion, events, figures = made.motion, made.events, made.figures
    rate = motion.rate_hz
    event, impact, rest = (round(t * rate) for t in (events.event_s, events.impact_s, events.rest_s))
    down = -np.gradient(motion.joints[..., 2], 1 / rate, axis=0)
    steps = np.linalg.norm(np.diff(motion.joints, n=2, axis=0), axis=-1).max(axis=1) * rate
    recorded = np.linalg.norm(np.diff(resample(lead, rate).joints, n=2, axis=0), axis=-1).max() * rate
    speed = np.linalg.norm(np.gradient(motion.joints, 1 / rate, axis=0), axis=-1)
    return {
        "pelvis_mps": float(down[max(impact - 12, 0) : impact + 1, 0].max()), "head_mps": figures.head_mps,
        "event_to_impact_s": events.impact_s - events.event_s, "descent_s": figures.descent_s, "slide_m": figures.slide_m,
        "gain_j": figures.gain_j, "floor_depth_m": figures.deepest_m[0], "self_depth_m": figures.deepest_m[1],
        "lead_changed_m": float(np.abs(motion.joints[:event] - resample(lead, rate).joints[:event]).max()),
        # The frame at which the lead ends is one at which its speeds go on.
        "step_over_lead": float(steps[event - 2 : event + 1].max() / recorded),
        "rest_speed_mps": float(speed[rest : rest + 30].max()),
    }  # fmt: skip


def skate_m(seed: int) -> float | None:
    """Farthest that a planted foot slides [m] in a made walk before the event of a fall; None where there is no fall."""
    walk = motion_from_text("A person walks for four seconds.", seed=seed)
    try:
        made = simulate_fall(walk, FallPlan(type=TYPES[seed % len(TYPES)], seed=seed))  # type: ignore[arg-type]
    except InputError:
        return None
    planted = contacts(tracks(trim(made.motion, 0.0, made.events.event_s)))
    return max((each.skate_m for each in planted), default=0.0)


def skates(count: int) -> str:
    """What the feet of so many made walks slide before the fall, in a line."""
    found = np.array([each for each in map(skate_m, range(count)) if each is not None])
    within = float(np.mean(found < MOST_SKATE_M))
    return (
        f"planted feet slide before the event of {len(found)} falls after made walks by {1e3 * np.median(found):.1f} mm "
        f"(median), {1e3 * found.max():.1f} mm at most; {within:.0%} below {1e3 * MOST_SKATE_M:.0f} mm"
    )


def table(rows: list[Row], refused: list[str]) -> str:
    """The statistics as a table in Markdown."""
    lines = ["| quantity | bar | " + " | ".join(TYPES) + " |", "|---|---|" + "---|" * len(TYPES)]
    for name, (low, high) in BARS.items():
        cells = []
        for kind in TYPES:
            x = np.array([row.values[name] for row in rows if row.type == kind])
            within = np.mean((x >= low) & (x <= high))
            cells.append(f"{x.mean():.2f} +- {x.std():.2f} ({x.min():.2f} to {x.max():.2f}), {within:.0%} within")
        lines.append(f"| {WORDS[name]} | {low:g} to {high:g} | " + " | ".join(cells) + " |")
    for side, words in {
        "forward": "the front",
        "back": "the back",
        "left": "the left side",
        "right": "the right side",
    }.items():
        counts = [sum(row.type == kind and row.side == side for row in rows) for kind in TYPES]
        lines.append(f"| lands on {words} | | " + " | ".join(map(str, counts)) + " |")
    for where in ("forward", "backward", "left", "right", "down", "not found"):
        counts = [sum(row.type == kind and row.topples == where for row in rows) for kind in TYPES]
        told = "the detector finds no fall | 0" if where == "not found" else f"the head goes {where} |"
        lines.append(f"| {told} | " + " | ".join(map(str, counts)) + " |")
    lines.append(
        "| refused | 0 | " + " | ".join(str(sum(text.startswith(kind) for text in refused)) for kind in TYPES) + " |"
    )
    return "\n".join(lines)


def strip(ax: Any, made: Fall, instants_s: np.ndarray) -> None:
    """The skinned body at some instants beside each other, seen from the side; what lies more than 2 cm under the floor is red."""
    from matplotlib.collections import PolyCollection

    from t2d_rt.body import skin

    motion = made.motion
    mesh = skin(motion)
    at = {name: motion.joints[:, i] for i, name in enumerate(motion.names)}
    ahead = facing(at)[round(made.events.event_s * motion.rate_hz)]
    azimuth, height = math.atan2(ahead[1], ahead[0]) - math.radians(70), math.radians(12)
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    toward = np.array([math.cos(azimuth) * math.cos(height), math.sin(azimuth) * math.cos(height), math.sin(height)])
    up = np.cross(toward, right)
    for place, instant in enumerate(instants_s):
        vertices = mesh.at(np.array([instant]))[0]
        corners = vertices[mesh.faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-12
        order = np.argsort((corners @ toward).mean(axis=1))
        order = order[normal[order] @ toward > 0]
        middle = vertices.mean(axis=0) * [1, 1, 0]
        flat = np.stack([(corners - middle) @ right + 1.5 * place, (corners - middle) @ up], axis=-1)
        light = 0.35 + 0.6 * np.clip(normal @ (0.7 * toward + [0, 0, 0.5]), 0, 1)
        colour = light[:, None] * [1.0, 0.85, 0.7]
        colour[corners[..., 2].min(axis=1) < -0.02] = [1, 0, 0]
        ax.add_collection(PolyCollection(flat[order], facecolors=colour[order], edgecolors="none"))
        ax.text(1.5 * place, -0.4, f"{instant - made.events.event_s:+.2f} s", ha="center", fontsize=9)
    ax.axhline(0, color="gray", linewidth=0.5)
    ax.set(xlim=(-1, 1.5 * len(instants_s)), ylim=(-0.5, 1.8), aspect="equal", title=motion.origin[-1])
    ax.axis("off")


def picture(folder: str, path: Path, seed: int) -> None:
    """The three types frame by frame, each from just before its event to rest."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(len(TYPES), 1, figsize=(16, 9))
    for ax, kind in zip(axes, TYPES, strict=True):
        lead = leads(folder)[seed % len(leads(folder))]
        made = simulate_fall(lead, FallPlan(type=kind, seed=seed))  # type: ignore[arg-type]
        events = made.events
        strip(ax, made, np.r_[np.linspace(events.event_s - 0.1, events.impact_s + 0.3, 7), events.rest_s])
    figure.tight_layout()
    figure.savefig(path, dpi=80)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("leads")
    parser.add_argument("--falls", type=int, default=100)
    parser.add_argument("--walks", type=int, default=30)
    parser.add_argument("--out", type=Path, default=Path("validation/report"))
    parser.add_argument("--seed", type=int, default=2)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    jobs = [(options.leads, kind, seed) for kind in TYPES for seed in range(options.falls)]
    with ProcessPoolExecutor(2) as pool:
        found = list(pool.map(one, jobs, chunksize=5))
    text = table([row for row in found if isinstance(row, Row)], [row for row in found if isinstance(row, str)])
    text += "\n\n" + skates(options.walks)
    (options.out / "falls.md").write_text(text + "\n", encoding="utf-8")
    picture(options.leads, options.out / "falls.png", options.seed)
    print(text)
    for row in found:
        if isinstance(row, str):
            print(row)


if __name__ == "__main__":
    main()
