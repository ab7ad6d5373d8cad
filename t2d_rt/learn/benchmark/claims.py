"""What the paper claims of Table III, one by one: held, refuted, or undecided at this size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.learn.benchmark.scales import NETWORKS

ALIKE = 5.0
"""Points within which models count as alike; those of the paper differ by 1.4 on Simple."""
LOSS = 5.0
"""Points that every model is to lose on Hard."""
CONVOLUTIONAL = "vgg-7", "resnet18"
PAIRS = (("walking", "abnormal_walking"), ("falling", "dancing"))
"""Classes that the paper says are taken for one another."""
FIRST, LAST = 3, 6
"""A pair counts as separating where it is among the first so many of all pairs, and as not where it comes after the latter."""

LEAST_SEEDS = 3
"""For an interval: two values that agree by chance would make one of no width."""

Result = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim and what was found."""

    claim: str
    verdict: str
    """"held", "refuted" or "undecided"."""
    figures: str


def interval(values: Sequence[float]) -> tuple[float, float]:
    """Mean, and half of the 95 % interval of the mean by Student's t; infinite for fewer values than LEAST_SEEDS."""
    from scipy.stats import t

    count = len(values)
    if count < LEAST_SEEDS:
        return float(np.mean(values)), float("inf")
    spread = float(np.std(values, ddof=1)) / count**0.5
    return float(np.mean(values)), float(t.ppf(0.975, count - 1)) * spread


def accuracies(results: Sequence[Result], set_: str, by: str, model: str) -> dict[int, float]:
    """Accuracy [%] by seed."""
    return {
        each["seed"]: 100.0 * each["accuracy"]
        for each in results
        if (each["set"], each["by"], each["model"]) == (set_, by, model) and "accuracy" in each
    }


def claims(results: Sequence[Result]) -> list[Claim]:
    """Verdicts on all of them."""
    return [
        _alike(results),
        _lead(results),
        _loss(results, "file"),
        _loss(results, "description"),
        _leak(results, "simple"),
        _leak(results, "hard"),
        _pairs(results),
    ]


def verdict(low: float, high: float, limit: float) -> str:
    """Held where all of the interval is above the limit, refuted where all of it is below."""
    return "held" if low > limit else "refuted" if high < limit else "undecided"


def _over_seeds(results: Sequence[Result], of_seed: Callable[[int], float | None]) -> tuple[float, float, int]:
    """Mean, half interval and number of seeds of what `of_seed` gives."""
    seeds = sorted({each["seed"] for each in results})
    values = [value for value in map(of_seed, seeds) if value is not None]
    if not values:
        return float("nan"), float("inf"), 0
    return *interval(values), len(values)


def _of(results: Sequence[Result], set_: str, by: str, seed: int) -> dict[str, float] | None:
    """Accuracy [%] of each network that was run with a seed; None where one is lacking."""
    run = {each["model"] for each in results if each["model"] in NETWORKS}
    found = {model: accuracies(results, set_, by, model).get(seed) for model in NETWORKS if model in run}
    known = {model: value for model, value in found.items() if value is not None}
    return known if known and len(known) == len(found) else None


def _alike(results: Sequence[Result]) -> Claim:
    def spread(seed: int) -> float | None:
        found = _of(results, "simple", "file", seed)
        return None if found is None else max(found.values()) - min(found.values())

    mean, half, count = _over_seeds(results, spread)
    found = verdict(-(mean + half), -(mean - half), -ALIKE)
    return Claim(
        "All models are alike on Simple (98.3 to 99.7 %).", found,
        f"best minus worst network, by file: {_points(mean, half, count)}; alike means within {ALIKE:g} points",
    )  # fmt: skip


def _lead(results: Sequence[Result]) -> Claim:
    def lead(seed: int) -> float | None:
        found = _of(results, "hard", "description", seed)
        if found is None or not set(CONVOLUTIONAL) <= found.keys():
            return None
        others = [value for name, value in found.items() if name not in (*CONVOLUTIONAL, "streaming")]
        return float(np.mean([found[name] for name in CONVOLUTIONAL])) - max(others) if others else None

    mean, half, count = _over_seeds(results, lead)
    return Claim(
        "On Hard convolutional networks lead.", verdict(mean - half, mean + half, 0.0),
        f"mean of VGG-7 and ResNet-18 minus the best of the others, by description: {_points(mean, half, count)}",
    )  # fmt: skip


def _loss(results: Sequence[Result], by: str) -> Claim:
    rows, verdicts = [], []
    for model in dict.fromkeys(each["model"] for each in results if each["model"] in NETWORKS):
        simple, hard = (accuracies(results, *each, model) for each in (("simple", "file"), ("hard", by)))
        both = sorted(simple.keys() & hard.keys())
        if not both:
            continue
        mean, half = interval([simple[seed] - hard[seed] for seed in both])
        verdicts.append(verdict(mean - half, mean + half, LOSS))
        rows.append(f"{model} {_points(mean, half, len(both))}")
    found = "refuted" if "refuted" in verdicts else "held" if verdicts and set(verdicts) == {"held"} else "undecided"
    return Claim(
        f"Every network loses {LOSS:g} points or more from Simple by file to Hard by {by}.", found, "; ".join(rows)
    )


def _leak(results: Sequence[Result], set_: str) -> Claim:
    """Of the networks that were run with every seed by both splits."""
    seeds = {each["seed"] for each in results}
    found = {
        model: [accuracies(results, set_, by, model) for by in ("file", "description")]
        for model in dict.fromkeys(each["model"] for each in results if each["model"] in NETWORKS)
    }
    whole = {model: pair for model, pair in found.items() if all(each.keys() == seeds for each in pair)}

    def margin(seed: int) -> float | None:
        return float(np.mean([pair[0][seed] - pair[1][seed] for pair in whole.values()])) if whole else None

    mean, half, count = _over_seeds(results, margin)
    return Claim(
        f"(Not of the paper) A split by file flatters: it beats a split by description on {set_.capitalize()}.",
        verdict(mean - half, mean + half, 0.0),
        f"mean over {', '.join(whole) or 'no network'}: {_points(mean, half, count)}",
    )


def _pairs(results: Sequence[Result]) -> Claim:
    rows = [
        each for each in results if (each["set"], each["by"]) == ("hard", "description") and each["model"] in NETWORKS
    ]
    rows = [each for each in rows if "confusion" in each]
    title = "What separates the models on Hard is walking against abnormal walking, and falling against dancing."
    if not rows or not {name for pair in PAIRS for name in pair} <= set(rows[0]["classes"]):
        return Claim(title, "undecided", "the data set lacks these classes")
    classes = rows[0]["classes"]
    ranked = confused_pairs(np.sum([each["confusion"] for each in rows], axis=0), classes)
    names = [frozenset(pair) for pair, _ in ranked]
    ranks = [names.index(frozenset(pair)) + 1 for pair in PAIRS]
    found = "held" if max(ranks) <= FIRST else "refuted" if max(ranks) > LAST else "undecided"
    if len({each["seed"] for each in rows}) < LEAST_SEEDS:
        found = "undecided"
    told = ", ".join(f"{a} and {b} {100 * part:.0f} %" for (a, b), part in ranked[:FIRST])
    return Claim(
        title, found,
        f"of {len(ranked)} pairs these are number {ranks[0]} and {ranks[1]}; most often confused, of the samples of both: {told}",
    )  # fmt: skip


def confused_pairs(confusion: np.ndarray, classes: Sequence[str]) -> list[tuple[tuple[str, str], float]]:
    """Pairs of classes by the fraction of their samples that are taken for the other."""
    count = confusion.sum(axis=1)
    found = [
        ((classes[a], classes[b]), float((confusion[a, b] + confusion[b, a]) / max(count[a] + count[b], 1)))
        for a in range(len(classes))
        for b in range(a)
    ]
    return sorted(found, key=lambda each: -each[1])


def _points(mean: float, half: float, count: int) -> str:
    if count == 0:
        return "not run"
    return (
        f"{mean:.1f} points ({count} of {LEAST_SEEDS} seeds)"
        if count < LEAST_SEEDS
        else f"{mean:.1f} +- {half:.1f} points ({count} seeds)"
    )
