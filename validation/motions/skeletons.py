"""Every BVH file of a folder, read as it is and read again with its joints renamed to numbers.

    python -m validation.motions.skeletons FOLDER

Prints for each file how it was read, its stature, and how far the joints found without names lie from those found with them;
and at the end how many were read, how many were matched alike and whether left and right were ever swapped.
"""

from __future__ import annotations

import re
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.motion import load_motion
from t2d_rt.motion.match import MOST_FRAMES, match
from t2d_rt.motion.read.bvh import forward_kinematics, read_bvh
from t2d_rt.motion.skeletons import Flavour, canonical, detect_flavour, plain_names, restored_offsets

ALIKE = 0.02
"""Part of the stature within which a joint is the same: lost bones that only a flavour restores are larger."""

STATURES_M = 1.4, 2.1


def main(folder: Path) -> int:
    """The number of files that were not read as a person."""
    files = sorted(path for path in folder.rglob("*") if path.name.lower().endswith((".bvh", ".bvh.gz")))
    bad, swapped, other = 0, 0, 0
    for path in files:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                motion = load_motion(path)
            except InputError as error:
                print(f"{path.name}: REFUSED: {error}")
                bad += 1
                continue
        found = re.search(r"stature ([\d.]+)", motion.report)
        stature = float(found[1]) if found else np.nan
        sane = STATURES_M[0] < stature < STATURES_M[1]
        sides, unlike = unnamed(path)
        bad += not sane
        swapped += sides
        other += bool(unlike)
        words = motion.report.split("; ")[1].split(":")[0]
        print(
            f"{path.name}: {words}, {stature:.2f} m{'' if sane else ' NOT SANE'}; without names "
            f"{'SIDES SWAPPED' if sides else f'other joints: {unlike}' if unlike else 'the same'}"
            + "".join(f"; warning: {each.message}" for each in caught)
        )
    print(
        f"{len(files)} files, {bad} not read as a person, {swapped} with sides swapped without names, {other} with other joints"
    )
    return bad + swapped


def unnamed(path: Path) -> tuple[bool, list[str]]:
    """Whether sides are swapped without names, and joints that lie elsewhere."""
    raw = read_bvh(path)
    names = plain_names(raw.names)
    frames = np.unique(np.linspace(0, len(raw.values) - 1, min(len(raw.values), MOST_FRAMES)).round().astype(int))
    raw = replace(raw, names=names, values=raw.values[frames])
    known = detect_flavour(names, raw.parents)
    offsets, _ = (raw.offsets, []) if known is None else restored_offsets(raw, names, known)
    positions, rotations = forward_kinematics(raw, offsets)
    kind = known or Flavour(name="matched", joints=match(names, raw.parents, positions).joints)
    number = {name: f"n{i}" for i, name in enumerate(each for each in names if not each.endswith(":end"))}
    numbers = tuple(number[each.removesuffix(":end")] + ":end" * each.endswith(":end") for each in names)
    found = Flavour(name="unnamed", joints=match(numbers, raw.parents, positions).joints)
    mine, _ = canonical(names, kind, positions, rotations, raw.offsets)
    theirs, _ = canonical(numbers, found, positions, rotations, raw.offsets)
    tall = float(np.median(np.linalg.norm(mine["head"] - mine["left_ankle"], axis=-1)))
    apart = {
        name: np.median(np.linalg.norm(mine[name] - theirs[name], axis=-1)) / tall
        for name in mine.keys() & theirs.keys()
    }
    own = np.linalg.norm(mine["left_knee"] - theirs["left_knee"], axis=-1) > np.linalg.norm(
        mine["right_knee"] - theirs["left_knee"], axis=-1
    )
    made_up = {
        "spine1",
        "spine2",
        "spine3",
        "neck",
        "left_collar",
        "right_collar",
        "left_hand",
        "right_hand",
        "head_top",
    }
    return bool(np.mean(own) > 0.5), sorted(name for name, gap in apart.items() if gap > ALIKE and name not in made_up)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("give the folder of BVH files: python -m validation.motions.skeletons FOLDER")
    sys.exit(min(main(Path(sys.argv[1])), 1))
