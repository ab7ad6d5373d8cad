"""Splits of a data set, in which no description, source clip, motion seed or subject is on two sides; seeded, stratified by class,
checked.

Samples that share one of these, directly or through other samples, form a group, and a group is never divided. Clips of standing
and walking begin many motions of every class, so most samples may form a single group; then a split by clips is refused, unless
samples between the sides may be left out.

The assignment to sides maximises the sum over sides s and classes c of f_s n_c log(placed_sc), f_s the fraction asked for and n_c
the number of samples of the class; all classes together count as one more. Where groups can be divided freely, the maximum is at
placed_sc = f_s n_c (Gibbs' inequality); where they cannot, the sum says which of two divisions is more proportional, and it grows
with the number of samples that are kept.
"""

from __future__ import annotations

import json
import re
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from t2d_rt.core.checks import choice, flag, integer, number, shown, unknown_name
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes

Kind = Literal["description", "clip", "seed", "subject"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""What can be held apart: a description (by its sentence), a source clip (by the recording from which it was cut), a motion (by its
seed), a subject (by its number)."""
APART: tuple[Kind, ...] = "description", "clip", "seed"
"""What is held apart by default."""

PLAIN = re.compile(r"[A-Za-z0-9_-]{1,100}")
"""Pattern for the names of sides, which become names of files."""
CLIP = re.compile(r"^clip \S+ of (?P<file>.+), \d+\.\d\d to \d+\.\d\d s$")
"""Pattern for a clip in a motion's origin."""
FILE = re.compile(r"^(?P<file>.+), sha256 [0-9a-f]{64}$")
"""Pattern for a motion file in a motion's origin."""

NAMES = "train", "val", "test"
FRACTIONS = 0.7, 0.15, 0.15
MOST_AWAY = 0.1
"""Greatest deviation of a side's size from what was asked for, as a fraction of all samples."""

MOST_BYTES = 200_000_000
"""Greatest size of a split's file that is read [bytes]."""

Records = Sequence[Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class Split:
    """Indices of the samples on each side."""

    sides: Mapping[str, tuple[int, ...]]
    apart: tuple[Kind, ...]
    """What is held apart."""
    left_out: tuple[int, ...] = ()
    """Samples that are left out because they would put a clip on two sides."""
    shared: Mapping[str, int] = field(default_factory=dict)
    """Number of clips (or descriptions, or seeds) on two sides, for what was not held apart."""

    def __str__(self) -> str:
        sides = ", ".join(f"{name} {len(indices)}" for name, indices in self.sides.items())
        left_out = f"; {len(self.left_out)} samples left out" if self.left_out else ""
        shared = "".join(f"; {count} {kind}s on two sides" for kind, count in self.shared.items())
        return f"{sides}; apart: {', '.join(self.apart)}{left_out}{shared}"

    def to_json(self) -> str:
        """JSON text from which `read_split` restores the split."""
        values = {
            "apart": list(self.apart),
            "sides": {name: list(side) for name, side in self.sides.items()},
            "left_out": list(self.left_out),
            "shared": dict(self.shared),
        }
        return json.dumps(values) + "\n"


def read_split(path: str | Path, records: Records) -> Split:
    """Reads a split of these records from a file, and checks it for leaks as when it was made."""
    stored = read_bytes(path, limit=MOST_BYTES, noun="split file")
    try:
        values = json.loads(stored)
        sides = {str(name): tuple(int(index) for index in indices) for name, indices in values["sides"].items()}
        loaded = Split(
            MappingProxyType(sides),
            _kinds(values["apart"]),
            tuple(values["left_out"]),
            MappingProxyType(values["shared"]),
        )
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError):
        raise InputError(f"{path} is no split; make one with t2d-rt dataset split") from None
    check_split(records, loaded.sides, apart=loaded.apart)
    return loaded


def source_clips(record: Mapping[str, Any]) -> frozenset[str]:
    """The recordings from which a sample's motions were cut, including that of a second person; empty for a motion made by rules or
    by physics."""
    sources = [*record["sources"], *((record.get("second_person") or {}).get("sources", ()))]
    matches = (CLIP.match(source) or FILE.match(source) for source in sources)
    return frozenset(match["file"] for match in matches if match is not None)


def traits(record: Mapping[str, Any], apart: Collection[Kind]) -> frozenset[tuple[Kind, str]]:
    """Everything that a sample may share with others."""
    second = record.get("second_person")  # no sample is labelled with their sentences
    seeds = [record["seed"], *([] if second is None else [second["seed"]])]
    values_by_kind: dict[Kind, Iterable[str]] = {
        "description": (str(record["sentence"]),),
        "clip": source_clips(record),
        "seed": map(str, seeds),
        "subject": () if record.get("subject") is None else (str(record["subject"]),),
    }
    return frozenset((kind, value) for kind in apart for value in values_by_kind[kind])


def split(
    records: Records,
    fractions: Mapping[str, float] | Sequence[float] = FRACTIONS,
    *,
    apart: Collection[str] = APART,
    leave_out: bool = False,
    seed: int = 0,
) -> Split:
    """Divides samples into sides (train, val and test) with about these fractions of each class.

    fractions: of train, val and test (or of train and test, where there are two), or by names of your own; they add up to 1.
    apart: kinds (`KINDS`) that may be on one side only.
    leave_out: whether samples that would put a clip on two sides are left out, instead of joining all samples that share clips.

    Raises InputError where a side would lack a class, or its size would be off by more than a tenth of the samples.
    """
    side_fractions = _fractions(fractions)
    kinds = _kinds(apart)
    on = _sides(records, side_fractions, kinds, leave_out=leave_out, seed=seed)
    on_one_side = on.sum(axis=1) == 1
    sides = {name: on_one_side & on[:, side] for side, name in enumerate(side_fractions)}
    _check_sizes(records, sides, side_fractions, kinds, leave_out=leave_out)
    return _checked_split(records, sides, kinds, ~on_one_side)


def folds(
    records: Records, count: int = 5, *, apart: Collection[str] = APART, leave_out: bool = False, seed: int = 0
) -> tuple[Split, ...]:
    """`count` splits into train and test, for cross-validation.

    Each sample is in the test side of one of them, unless it is left out there. Options and errors are those of `split`.
    """
    integer("count", count, 2, 1000)
    kinds = _kinds(apart)
    side_fractions = {f"fold {number}": 1.0 / count for number in range(1, count + 1)}
    on = _sides(records, side_fractions, kinds, leave_out=leave_out, seed=seed)
    only = on & (on.sum(axis=1, keepdims=True) == 1)
    splits = []
    for side in range(count):
        sides = {"train": ~on[:, side], "test": only[:, side]}
        _check_sizes(records, sides, {"train": 1 - 1 / count, "test": 1 / count}, kinds, leave_out=leave_out)
        splits.append(_checked_split(records, sides, kinds, on[:, side] & ~only[:, side]))
    return tuple(splits)


def _checked_split(
    records: Records, sides: Mapping[str, np.ndarray], kinds: tuple[Kind, ...], left_out: np.ndarray
) -> Split:
    """A split for the masks (N,) of its sides, after a check for leaks; `left_out` (N,) are the samples on no side."""
    indices = np.array([int(record["index"]) for record in records])
    members = {name: tuple(sorted(indices[mask].tolist())) for name, mask in sides.items()}
    check_split(records, members, apart=kinds)
    shared = Counter(str(kind) for kind, _, _ in leaks(records, members, [kind for kind in KINDS if kind not in kinds]))
    return Split(
        MappingProxyType(members), kinds, tuple(sorted(indices[left_out].tolist())), MappingProxyType(dict(shared))
    )


def leaks(
    records: Records, sides: Mapping[str, Iterable[int]], apart: Collection[Kind] = APART
) -> list[tuple[Kind, str, tuple[str, ...]]]:
    """What is on more than one side: its kind, its name, and the sides."""
    record_by_index = {int(record["index"]): record for record in records}
    sides_by_trait: dict[tuple[Kind, str], set[str]] = defaultdict(set)
    for name, indices in sides.items():
        for index in indices:
            for trait in traits(record_by_index[int(index)], apart):
                sides_by_trait[trait].add(name)
    return [
        (kind, value, tuple(name for name in sides if name in names))
        for (kind, value), names in sorted(sides_by_trait.items())
        if len(names) > 1
    ]


def check_split(records: Records, sides: Mapping[str, Iterable[int]], *, apart: Collection[str] = APART) -> None:
    """Raises an InputError that names the leak if a sample, or something that is held apart, is on two sides."""
    kinds = _kinds(apart)
    record_indices = {int(record["index"]) for record in records}
    side_of_index: dict[int, str] = {}
    indices_by_side = {name: [int(index) for index in indices] for name, indices in sides.items()}
    for name, indices in indices_by_side.items():
        if not PLAIN.fullmatch(name):
            raise InputError(f"a side must be named by letters, digits, - and _, got {shown(name)}; rename it")
        for index in indices:
            if index not in record_indices:
                raise InputError(
                    f"the split names sample {index}, which the data set does not hold; make the split anew"
                )
            if index in side_of_index:
                raise InputError(f"sample {index} is in {side_of_index[index]} and in {name}; put it on one side")
            side_of_index[index] = name
    leaked = leaks(records, indices_by_side, kinds)
    if leaked:
        kind, value, names = leaked[0]
        more = f" ({len(leaked) - 1} more such)" if len(leaked) > 1 else ""
        raise InputError(
            f"the split leaks: {kind} {shown(value)} is in {' and in '.join(names)}{more}; put all its samples on one side"
        )


def _fractions(fractions: Any) -> dict[str, float]:
    """Checked fractions by the names of their sides."""
    if isinstance(fractions, Mapping):
        fraction_by_side = {str(name): fractions[name] for name in fractions}
    elif isinstance(fractions, (list, tuple)) and len(fractions) in (2, 3):
        fraction_by_side = dict(zip(NAMES if len(fractions) == 3 else ("train", "test"), fractions, strict=True))
    else:
        raise InputError(
            f"fractions must be two or three numbers, or a mapping of names to numbers, got {shown(fractions)}"
        )
    checked = {name: number(f"the fraction of {name}", value, 0, 1) for name, value in fraction_by_side.items()}
    if len(checked) < 2 or min(checked.values()) <= 0 or abs(sum(checked.values()) - 1) > 1e-6:
        raise InputError(
            "fractions must be two or more, each above 0, and add up to 1, got "
            + ", ".join(f"{part:g}" for part in checked.values())
        )
    return checked


def _kinds(apart: Any) -> tuple[Kind, ...]:
    """The kinds that are held apart, in the order of `KINDS`."""
    names = [apart] if isinstance(apart, str) else list(apart)
    for name in names:
        if name not in KINDS:
            raise unknown_name("kind of leak", name, KINDS)
    if not names:
        raise InputError(f"apart names nothing; give some of {', '.join(KINDS)}")
    return tuple(kind for kind in KINDS if kind in names)


def _sides(
    records: Records, side_fractions: Mapping[str, float], kinds: tuple[Kind, ...], *, leave_out: bool, seed: int
) -> np.ndarray:
    """The sides that each sample must be on, (N, S): one, or several if it has to be left out."""
    if not records:
        raise InputError("there are no samples to split; give the records of finished ones")
    flag("leave_out", leave_out)
    if "subject" in kinds and any(record.get("subject") is None for record in records):
        raise InputError(
            "some samples name no subject to hold apart; give the recipe subjects, or leave subject out of apart"
        )
    rng = np.random.default_rng(integer("seed", seed, 0))
    divided = leave_out and "clip" in kinds
    groups = grouped(records, [kind for kind in kinds if not (divided and kind == "clip")])
    labels, fractions = _labels(records), np.array(list(side_fractions.values()))
    if divided:
        return clip_sides(labels, [source_clips(record) for record in records], groups, fractions, rng)
    counts = np.array([np.bincount(labels[group], minlength=labels.max() + 1) for group in groups], dtype=np.float64)
    options = np.repeat(counts[:, None], len(fractions), axis=1)
    bound = np.zeros((len(records), len(fractions)), dtype=bool)
    for group, side in zip(groups, assigned(options, fractions, rng), strict=True):
        bound[group, side] = True
    return bound


def _labels(records: Records) -> np.ndarray:
    """Index of the class of each record among the sorted names, (N,)."""
    return np.unique([str(record["class"]) for record in records], return_inverse=True)[1]


def grouped(records: Records, kinds: Collection[Kind]) -> list[list[int]]:
    """Positions of the samples in each group, that is of samples that share something, directly or through others."""
    number: dict[tuple[Kind, str], int] = {}
    links = [
        (place, len(records) + number.setdefault(trait, len(number)))
        for place, record in enumerate(records)
        for trait in traits(record, kinds)
    ]
    # Samples and what they share are the nodes of a graph; its components are ordered by their first samples.
    count = len(records) + len(number)
    ends = np.array(links, dtype=np.int64).reshape(-1, 2)
    _, component = connected_components(coo_array((np.ones(len(ends)), ends.T), shape=(count, count)), directed=False)
    groups: dict[int, list[int]] = defaultdict(list)
    for place, group in enumerate(component[: len(records)].tolist()):
        groups[group].append(place)
    return list(groups.values())


def _check_sizes(
    records: Records,
    sides: Mapping[str, np.ndarray],
    side_fractions: Mapping[str, float],
    kinds: tuple[Kind, ...],
    *,
    leave_out: bool,
) -> None:
    """Refuses a split with a side that lacks a class or, where nothing is left out, whose size is far from its fraction."""
    labels = _labels(records)
    names = sorted({str(record["class"]) for record in records})
    lacking = [
        (name, names[label])
        for name, mask in sides.items()
        for label in range(len(names))
        if not np.any(labels[mask] == label)
    ]
    deviations = [abs(mask.mean() - side_fractions[name]) for name, mask in sides.items()]
    if not lacking and (leave_out or max(deviations) <= MOST_AWAY):
        return
    groups = grouped(records, kinds)
    grouping = f"the {len(records)} samples make {len(groups)} groups by {', '.join(kinds)}, the largest of {max(map(len, groups))}"
    name, label = lacking[0] if lacking else (next(iter(sides)), "")
    reason = f"{name} would lack {label}" if label else f"a side would be off by more than {MOST_AWAY:.0%} of them"
    if len(grouped(records, [kind for kind in kinds if kind != "clip"])) == len(groups):  # clips join nothing
        advice = "take more samples, fewer sides or other fractions"
    elif leave_out:
        advice = "take more samples or fewer sides, or hold description and seed apart only, and clips are on two sides"
    else:
        advice = "leave out those that join them (leave_out), or hold description and seed apart only, and clips are on two sides"
    raise InputError(f"{grouping}, and {reason}; {advice}")


SPLITS = "file", "description", "clip"
"""Ways to split. By file, samples of one description are on all sides, as in the code of Text2Doppler. By description, no sentence
and no motion is on two sides. By clip, no recording is either, and samples that would join two sides are left out."""
TRAINING_FRACTIONS = 0.5, 0.25, 0.25
"""Fractions of train, val and test for training; they can divide as few as four descriptions of a class."""


def sides_of(
    records: Sequence[Mapping[str, Any]], by: str, *, fractions: Sequence[float] = TRAINING_FRACTIONS, seed: int = 0
) -> dict[str, np.ndarray]:
    """Positions of the samples of train, val and test, (M,) each, with the same fractions of each class."""
    choice("split", by, SPLITS)
    if by != "file":
        apart = ("description", "seed") if by == "description" else ("description", "clip", "seed")
        chosen_split = split(records, fractions, apart=apart, leave_out=by == "clip", seed=seed)
        place = {int(record["index"]): number for number, record in enumerate(records)}
        return {name: np.array([place[index] for index in indices]) for name, indices in chosen_split.sides.items()}
    rng = np.random.default_rng(integer("seed", seed))
    classes = np.array([str(record["class"]) for record in records])
    sides: dict[str, list[int]] = {name: [] for name in NAMES}
    for name in sorted(set(classes)):
        members = rng.permutation(np.flatnonzero(classes == name))
        cuts = np.rint(np.cumsum(fractions)[:-1] * len(members)).astype(int)
        for side, part in zip(NAMES, np.split(members, cuts), strict=True):
            sides[side] += part.tolist()
    return {name: np.sort(np.array(positions, dtype=np.int64)) for name, positions in sides.items()}


def check_sides(parts: Mapping[str, np.ndarray]) -> None:
    """Refuses a split with an empty side."""
    empty = [name for name, places in parts.items() if len(places) == 0]
    if empty:
        counts = ", ".join(f"{name} {len(places)}" for name, places in parts.items())
        raise InputError(f"the split leaves {empty[0]} empty ({counts} samples); make more samples, or split otherwise")


TRIES = 16
"""Number of orders of the groups, or of initial assignments of clips, of which the best result is used."""
SWEEPS = 30
"""Greatest number of rounds over all clips; five are usual."""
TOGETHER = 100
"""Number of samples in each round whose clips are moved together."""
SOFT = 1e-12
"""Number of samples that an empty side counts as, so that its logarithm is finite and any other division is better."""


def objective(placed: np.ndarray, fractions: np.ndarray, totals: np.ndarray) -> float:
    """Quality of the division `placed` (sides, classes) of `totals` (classes,) samples, as defined at the top."""
    return float(fractions @ np.log(placed + SOFT) @ totals)


def with_total(counts: np.ndarray) -> np.ndarray:
    """Counts (..., K) followed by their sum, (..., K + 1)."""
    return np.concatenate([counts, counts.sum(axis=-1, keepdims=True)], axis=-1)


def assigned(options: np.ndarray, fractions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Side of each group (G,); `options` (G, S, K) are the numbers of samples of each class that the group has on each side."""
    options = with_total(options)
    best: tuple[float, np.ndarray] | None = None
    totals = options.max(axis=1).sum(axis=0)
    sizes = options[:, :, -1].max(axis=1)
    for _ in range(TRIES):
        order = rng.permutation(len(options))
        order = order[np.argsort(-sizes[order], kind="stable")]  # large groups first, while there is room for them
        placed, sides = np.zeros(options.shape[1:]), np.zeros(len(options), dtype=np.int64)
        for group in order:
            gains = np.log(placed + options[group] + SOFT) - np.log(placed + SOFT)
            side = int(np.argmax(fractions * (gains @ totals)))
            sides[group] = side
            placed[side] += options[group, side]
        value = objective(placed, fractions, totals)
        if best is None or value > best[0]:
            best = value, sides
    assert best is not None, "there is at least one order"
    return best[1]


def clip_sides(
    labels: np.ndarray,
    clips: Sequence[frozenset[str]],
    groups: Sequence[Sequence[int]],
    fractions: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """The sides that each sample must be on, (N, S): those of its clips, and that of its group.

    labels: class of each sample, (N,).
    groups: positions of samples that are to be on one side.
    Clips, alone or together with the others of a sample, are moved to the best side until none moves; then groups likewise.
    """
    names = sorted(frozenset[str]().union(*clips))
    number = {name: place for place, name in enumerate(names)}
    of_samples = [tuple(sorted(number[name] for name in clip)) for clip in clips]
    patterns = sorted(set(of_samples))
    place = {pattern: row for row, pattern in enumerate(patterns)}
    rows = np.array([place[of_sample] for of_sample in of_samples])
    sums = np.zeros((len(patterns), labels.max() + 1))
    np.add.at(sums, (rows, labels), 1)
    holds = np.zeros((len(patterns), len(names)), dtype=np.int64)
    for row, pattern in enumerate(patterns):
        holds[row, list(pattern)] = 1
    unit = np.eye(len(fractions), dtype=bool)
    bound = (holds @ unit[_climbed(holds, with_total(sums), fractions, rng)].astype(np.int64) > 0)[rows]
    fitting = np.stack(
        [~bound[:, np.arange(len(fractions)) != side].any(axis=1) for side in range(len(fractions))], axis=1
    )
    classes = np.eye(labels.max() + 1)[labels]
    options = np.stack([fitting[group].astype(np.float64).T @ classes[group] for group in map(list, groups)])
    for group, side in zip(groups, assigned(options, fractions, rng), strict=True):
        bound[list(group), side] = True
    return bound


def _climbed(holds: np.ndarray, sums: np.ndarray, fractions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Side of each clip, (C,), by coordinate ascent from several random starts, since exact division is NP-hard.

    holds: which clips (C) each pattern of clips has, (P, C).
    sums: number of samples of each class with that pattern, and of all, (P, K + 1).
    """
    unit = np.eye(len(fractions), dtype=np.int64)
    totals = sums.sum(axis=0)
    best: tuple[float, np.ndarray] | None = None
    for _ in range(TRIES):
        sides = np.asarray(rng.choice(len(fractions), size=holds.shape[1], p=fractions / fractions.sum()))
        value = objective(_placed(holds @ unit[sides] > 0, sums), fractions, totals)
        for _ in range(SWEEPS):
            before = value
            for clips in _moves(holds, rng):
                on = holds @ unit[sides] - holds[:, clips] @ unit[sides[clips]]
                weight = holds[:, clips].sum(axis=1, keepdims=True)
                values = [objective(_placed(on + weight * row > 0, sums), fractions, totals) for row in unit]
                side = int(np.argmax(values))
                if values[side] > value + 1e-9:
                    sides[clips], value = side, values[side]
            if value == before:
                break
        if best is None or value > best[0]:
            best = value, sides.copy()
    assert best is not None, "there is at least one guess"
    return best[1]


def _moves(holds: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    """Sets of clips that are moved together: each clip alone, and all clips of some samples, which can then be kept."""
    alone = [np.array([clip]) for clip in rng.permutation(holds.shape[1])]
    rows = rng.permutation(len(holds))[:TOGETHER]
    return alone + [np.flatnonzero(holds[row]) for row in rows if holds[row].sum() > 1]


def _placed(on: np.ndarray, sums: np.ndarray) -> np.ndarray:
    """Number of samples of each class on each side, (S, K), for patterns whose clips are all on one side."""
    only = on & (on.sum(axis=1, keepdims=True) == 1)
    return np.asarray(only.T.astype(np.float64) @ sums)
