"""Made-up maps whose classes are told apart by where a ridge of power stands."""

from __future__ import annotations

import numpy as np

from t2d_rt.learn.maps import LabelledMaps

CLASSES = "slow", "middle", "fast"
SPEEDS, TIMES = 64, 32
"""Cells of `two_radars`."""


def ridges(count: int, *, seed: int = 0, size: tuple[int, int] = (32, 32)) -> LabelledMaps:
    """`count` maps of three classes: a ridge at 1, 2 or 3 m/s that swings a little, in noise."""
    rng = np.random.default_rng(seed)
    labels = np.arange(count) % 3
    velocity = np.linspace(-4, 4, size[0])
    times = np.linspace(0, 5, size[1])
    power = 1e-3 * rng.exponential(size=(count, *size))
    for place, label in enumerate(labels):
        speed = 1.0 + label + 0.2 * np.sin(3 * times + rng.uniform(0, 6))
        power[place] += np.exp(-(((velocity[:, None] - speed) / 0.25) ** 2))
    levels = 10 * np.log10(power / power.max(axis=(1, 2), keepdims=True))
    return LabelledMaps(
        levels=np.maximum(levels, -60), labels=labels, classes=CLASSES,
        groups={"event": np.array([str(k // 2) for k in range(count)])},
        velocity_mps=velocity, duration_s=5.0, names=tuple(map(str, range(count))),
    )  # fmt: skip


def two_radars(per_class: int = 6, *, seed: int = 0, gain_db: float = 15.0, extent: int = 0) -> LabelledMaps:
    """Events by two radars: class 0 lights slow bins, class 1 fast ones; the second radar sees the other sign."""
    rng = np.random.default_rng(seed)
    levels, labels, events = [], [], []
    for event in range(2 * per_class):
        label = event % 2
        for sign in (1, -1):
            found = rng.normal(0, 1, (SPEEDS, TIMES))
            first = 32 + sign * (6 + 8 * label + extent)
            found[min(first, 32) : max(first, 32), 8:24] += gain_db
            levels.append(found - found.max())
            labels.append(label)
            events.append(f"event {event}")
    return LabelledMaps(
        levels=np.array(levels), labels=np.array(labels), classes=("slow", "fast"),
        groups={"event": np.array(events), "radar": np.array(["a", "b"] * (2 * per_class))},
        velocity_mps=np.linspace(-3.1, 3.1, SPEEDS), duration_s=3.0, names=tuple(str(n) for n in range(len(levels))),
    )  # fmt: skip
