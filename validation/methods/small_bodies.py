"""Tolerances of children: bodies of 0.7 to 1.2 m, by motions that the law of their size was not fitted to.

`python -m validation.methods.small_bodies` prints a table of what was asked, stated and true; `fit` behind it what facets err by
beside the law of adults, by which `t2d_rt.accuracy.error_laws` has its size. Truth is the engine's own field of far finer facets,
visibility traced at each chirp.
"""

from __future__ import annotations

import sys
import warnings
from dataclasses import replace

import numpy as np

import t2d_rt as t2d
from t2d_rt.accuracy.budget import BODY_SAGITTA_RAD
from t2d_rt.accuracy.error_laws import Laws
from t2d_rt.accuracy.estimate import Chirps, field, nmse_db, of_cube
from t2d_rt.types import Motion
from validation.bodies import RUN, WALK
from validation.methods.laws import ALL, EXACT, JACKS, SHORT
from validation.methods.models import modelled
from validation.methods.tolerance import piece

STYLISED, OTHER, SLOW = "131_01.bvh.gz", "iclone_002_01_walk.bvh.gz", "bvhtoolbox_walk01.bvh"
CASES = (
    (SHORT, 0.3, 0.8, 0.0, 0.7, -15.0), (SLOW, 0.5, 1.0, 30.0, 0.7, -25.0), (OTHER, 1.0, 1.5, 120.0, 0.7, -20.0),
    (STYLISED, 1.4, 1.8, 90.0, 0.7, -25.0), (STYLISED, 0.5, 0.9, 60.0, 0.95, -20.0), (SHORT, 0.8, 1.3, 90.0, 0.95, -25.0),
    (SLOW, 1.5, 2.0, 0.0, 0.95, -20.0), (OTHER, 1.2, 1.6, 0.0, 0.95, -30.0), (OTHER, 0.5, 1.0, 0.0, 1.16, -25.0),
    (STYLISED, 1.0, 1.4, 0.0, 1.16, -15.0), (SHORT, 0.3, 0.8, 45.0, 1.16, -20.0), (SLOW, 0.4, 0.9, 150.0, 1.16, -20.0),
)  # fmt: skip
"""Motion, from and to [s], angle [degrees], stature [m], tolerance [dB]."""
FITTED = (WALK, 0.5, 1.1, 0.0), (RUN, 0.3, 0.9, 60.0), (JACKS, 0.5, 1.1, 90.0)
SIZES, SCALES, FINEST = (0.4, 0.55, 0.68, 1.0), (0.58, 1.0, 1.73, 3.0), 0.15
CHIRPS, TRUTH_SCALE = 24, 0.25


def grown(motion: Motion, stature_m: float) -> Motion:
    """The same motion by somebody of that stature, on the same place."""
    factor = stature_m / stature(motion)
    start = motion.joints[:1, :1] * (1, 1, 0)
    return replace(motion, joints=start + factor * (motion.joints - start))


def stature(motion: Motion) -> float:
    """Height of the skin at rest [m]."""
    return float(np.ptp(t2d.skin(motion).rest[:, 2]))


def tolerances() -> None:
    """Prints what was asked, stated and true."""
    for name, start_s, stop_s, angle_deg, stature_m, tolerance_db in CASES:
        motion = grown(piece(name, start_s, stop_s, angle_deg), stature_m)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            found = t2d.simulate(motion, tolerance_db=tolerance_db, clutter="none")
        model = modelled(motion)
        chirps = Chirps.random(model.radar, model.span_s, seed=23, count=CHIRPS)
        true_db = nmse_db(
            of_cube(model, found.cube, [], chirps), field(model, EXACT.replace(sagitta_scale=TRUTH_SCALE), chirps)
        )
        print(f"{name:28s} {stature_m:4.2f} m  asked {tolerance_db:5.1f}  stated {found.error_db:5.1f}  true {true_db:5.1f} dB"
              f"{'  warned' if told else ''}", flush=True)  # fmt: skip


def fit() -> None:
    """Prints by how much facets err more than the law of adults says."""
    law = Laws.fitted().bodies
    for (name, start_s, stop_s, angle_deg), factor in ((case, size) for case in FITTED for size in SIZES):
        whole = piece(name, start_s, stop_s, angle_deg)
        motion = grown(whole, factor * stature(whole))
        model = modelled(motion)
        chirps = Chirps.random(model.radar, model.span_s, seed=11, count=CHIRPS)
        finest = field(model, ALL.replace(sagitta_scale=FINEST), chirps)
        more = [
            nmse_db(field(model, ALL.replace(sagitta_scale=scale), chirps), finest)
            - law.error_db(BODY_SAGITTA_RAD * scale)
            for scale in SCALES
        ]
        size = stature(motion) / model.radar.wavelength_m
        print(
            f"{name:28s} {size:4.0f} wavelengths  more than adults: {'  '.join(f'{each:+5.1f}' for each in more)} dB",
            flush=True,
        )


if __name__ == "__main__":
    fit() if "fit" in sys.argv[1:] else tolerances()
