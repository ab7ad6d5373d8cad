"""One sentence with many seeds: `python -m validation.motions.seeds RECORDINGS [-n 30] [--class jumping]`.

For each class's plainest sentence: how far apart the motions are, against two recordings of the class below the folder RECORDINGS;
how many pass the filter and are what was asked for, and how many a part of the sentence's choices each made.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from t2d_rt.core.errors import T2DWarning
from t2d_rt.motion.check import check_motion
from t2d_rt.motion.descriptions.slots import Activity
from t2d_rt.motion.generate import motion_from_text
from validation.motions.limits import class_of, sound_recordings
from validation.motions.population import diversity

SENTENCES: Mapping[Activity, str] = {
    "walking": "a person walks", "running": "a person runs", "jumping": "a person jumps", "dancing": "a person dances",
    "sitting": "a person sits down", "bending": "a person bends down",
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", type=Path)
    parser.add_argument("-n", type=int, default=30)
    parser.add_argument("--class", dest="only", choices=[*SENTENCES])
    options = parser.parse_args()
    warnings.simplefilter("ignore", T2DWarning)
    recordings = [(class_of(name), each) for name, each in sound_recordings(options.recordings).items()]
    for activity in [options.only] if options.only else SENTENCES:
        motions = [motion_from_text(SENTENCES[activity], seed=seed) for seed in range(options.n)]
        verdicts = [check_motion(each, expected=activity) for each in motions]
        own = diversity(motions)
        print(
            f"{SENTENCES[activity]!r}: median {own.median_m:.3f} m, least {own.least_m:.3f} m; median of the nearest "
            f"{own.nearest:.3f} of the stature, of postures {own.nearest_posture:.3f}"
        )
        theirs = [each for kind, each in recordings if kind == activity]
        if len(theirs) > 1:
            found = diversity(theirs)
            print(
                f"  of {len(theirs)} recordings: median {found.median_m:.3f} m, least {found.least_m:.3f} m; ratio of "
                f"medians {own.median_m / found.median_m:.2f}, of the least to their median {own.least_m / found.median_m:.2f}"
            )
        seconds = [each.duration_s for each in motions]
        print(f"  as asked {sum(each.passed for each in verdicts)}, {min(seconds):.1f} to {np.max(seconds):.1f} s")
        for reason, count in Counter(reason for each in verdicts for reason in each.reasons).items():
            print(f"    {count}: {reason}")


if __name__ == "__main__":
    main()
