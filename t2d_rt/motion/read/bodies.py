"""Several skeletons in one BVH: each under a ROOT of its own, or twins under one that carries them all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from t2d_rt.motion.read.bvh import RawSkeleton
from t2d_rt.motion.read.joint_sets import side_and_part
from t2d_rt.motion.read.subjects import FEWEST_LABELS, SIGNS


def bodies(raw: RawSkeleton) -> dict[str, RawSkeleton]:
    """Skeletons with joints enough for a person, by the namespace of their names, else the ROOT's own name, else their number; one
    alone has no name."""
    roots = [joint for joint, parent in enumerate(raw.parents) if parent < 0]
    if len(roots) == 1:
        return _twins(raw) or {"": raw}
    trees = [_below(raw, root) for root in roots]
    large = [tree for tree in trees if sum(bool(raw.channels[joint]) for joint in tree) >= FEWEST_LABELS] or trees[:1]
    names = [raw.names[tree[0]] for tree in large]
    spaces = [name.rpartition(":")[0] for name in names]
    numbers = [str(number) for number in range(1, len(large) + 1)]
    called = next(each for each in (spaces, names, numbers) if len({*each} - {""}) == len(large) or each is numbers)
    return {name if len(large) > 1 else "": _piece(raw, tree) for name, tree in zip(called, large, strict=True)}


def _twins(raw: RawSkeleton) -> dict[str, RawSkeleton]:
    """Skeletons side by side whose joints have the same names but for what is before or after all of them; empty for one alone."""
    for joint in range(len(raw.names)):
        trees = [_below(raw, child) for child, parent in enumerate(raw.parents) if parent == joint]
        large = [tree for tree in trees if len(tree) >= FEWEST_LABELS]
        found: dict[str, RawSkeleton] = {}
        for other in large[1:]:
            ours, theirs, plain = _affixes(
                *([raw.names[each].removesuffix(":end") for each in tree] for tree in (large[0], other))
            )
            if {side_and_part(name)[0] for name in plain} >= {"left", "right"}:  # two legs have one side each
                above = _above(raw, joint)
                for affix, tree in ((ours, large[0]), (theirs, other)):
                    names = [*(raw.names[each] for each in above), *plain]
                    named = [
                        f"{n}:end" if raw.names[e].endswith(":end") else n
                        for n, e in zip(names, above + tree, strict=True)
                    ]
                    found[affix] = replace(_piece(raw, above + tree), names=tuple(named))
        if len(found) > 1:
            return found
    return {}


def _affixes(ours: list[str], theirs: list[str]) -> tuple[str, str, list[str]]:
    """What two lists of names differ by, before or after what they have in common, and the common names; none where they differ."""
    for turn in (1, -1):
        ends = zip(ours[0][::-turn], theirs[0][::-turn], strict=False)
        tail = next(
            (place for place, (one, other) in enumerate(ends) if one != other), min(len(ours[0]), len(theirs[0]))
        )
        first, second = (names[0][::turn][: len(names[0]) - tail] for names in (ours, theirs))
        plain = [name[::turn].removeprefix(first)[::turn] for name in ours]
        same = plain == [name[::turn].removeprefix(second)[::turn] for name in theirs] and first != second
        if same and all(name[::turn].startswith(first) for name in ours):
            return first[::turn].strip(SIGNS), second[::turn].strip(SIGNS), [name.strip(SIGNS) for name in plain]
    return "", "", []


def _below(raw: RawSkeleton, root: int) -> list[int]:
    """A joint and all that it carries, in the file's order."""
    found = {root}
    for joint in range(root + 1, len(raw.parents)):
        if raw.parents[joint] in found:
            found.add(joint)
    return sorted(found)


def _above(raw: RawSkeleton, joint: int) -> list[int]:
    """A joint and those that carry it, the root first."""
    found = [joint]
    while raw.parents[found[0]] >= 0:
        found.insert(0, raw.parents[found[0]])
    return found


def _piece(raw: RawSkeleton, joints: list[int]) -> RawSkeleton:
    """Some of the joints, with all above them that are among them."""
    starts = np.cumsum([0, *map(len, raw.channels)])
    columns = np.concatenate([np.arange(starts[joint], starts[joint + 1]) for joint in joints])
    place = {joint: number for number, joint in enumerate(joints)}
    return replace(
        raw,
        names=tuple(raw.names[joint] for joint in joints),
        parents=tuple(place.get(raw.parents[joint], -1) for joint in joints),
        offsets=raw.offsets[joints],
        channels=tuple(raw.channels[joint] for joint in joints),
        values=raw.values[:, columns],
    )
