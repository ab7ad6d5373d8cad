"""What a run takes, for the law of cost: runs with unlike amounts of each kind of work, timed and fitted."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from dataclasses import field as field_of
from typing import Any

import numpy as np
from scipy.optimize import nnls

import t2d_rt as t2d
from t2d_rt.accuracy import cost
from t2d_rt.core.backend import yardstick_s
from t2d_rt.pipeline.prepare import prepare
from t2d_rt.propagation import clutter, mirrors
from t2d_rt.scattering import points, refinement
from t2d_rt.signal import spectrogram
from t2d_rt.simulate import summed
from t2d_rt.types import Accuracy, PathTier, Radar
from t2d_rt.types.accuracy import EVERY_PATH_DB
from validation.bodies import RUN, WALK, recorded
from validation.methods.models import modelled

LEAST = {"facet of a frame": 6e-7}
"""Yardsticks: 60 million facets a second, as the bench measures them alone. Runs tell them from refining no better than that."""


@dataclass(frozen=True, slots=True)
class Run:
    """A run that is timed."""

    name: str
    length_s: float
    scene: str = "free_space"
    accuracy: dict[str, Any] = field_of(default_factory=dict)
    physics: dict[str, Any] = field_of(default_factory=dict)
    radar: str = "table2"


SECONDARY = PathTier(level_db=EVERY_PATH_DB, sagitta_scale=4.0, greatest_sagitta_rad=3.0, patch_phase_scale=2.0)
TWO_TIERS = {"least_level_db": -25.0, "tiers": (PathTier(level_db=-10.0), SECONDARY)}
FINER = TWO_TIERS | {"sagitta_scale": 0.7, "visibility_rate_hz": 50.0, "visibility_subdivision": 1}
ONE_TIER = {"least_level_db": -14.0, "tiers": (PathTier(level_db=EVERY_PATH_DB),)}
COARSE = {
    "sagitta_scale": 3.4,
    "visibility_rate_hz": 12.5,
    "least_level_db": -20.0,
    "tiers": (PathTier(level_db=EVERY_PATH_DB),),
}
CLUTTER = {"clutter": "specular"}


def runs() -> Iterator[Run]:
    """Each kind of work in unlike amounts."""
    for length_s, scale, occlusion in (
        (1.0, 1.0, True),
        (4.0, 1.0, True),
        (2.0, 0.5, False),
        (2.0, 3.0, False),
        (4.0, 0.5, True),
    ):
        yield Run("walk", length_s, accuracy={"sagitta_scale": scale, "occlusion": occlusion})
    for length_s, rate_hz, n in ((1.0, 50.0, 1), (4.0, 12.5, 0), (2.0, 100.0, 2), (4.0, 100.0, 1)):
        yield Run(
            "walk",
            length_s,
            accuracy={"sagitta_scale": 2.0, "visibility_rate_hz": rate_hz, "visibility_subdivision": n},
        )
    for scale in (0.6, 1.7):
        yield Run("run", 1.3, accuracy={"sagitta_scale": scale})
    for length_s in (1.0, 4.0):
        yield Run("walk", length_s, physics={"method": "ellipsoid"})
        yield Run("walk", length_s, "empty_room", physics={"method": "ellipsoid"} | CLUTTER)
        yield Run("walk", length_s, accuracy={"sagitta_scale": 1.5}, radar="array-3x4")
        for scene in ("empty_room", "living_room"):
            yield Run("walk", length_s, scene, physics=CLUTTER)
            yield Run("walk", length_s, scene, TWO_TIERS)
            yield Run("walk", length_s, scene, FINER)
            yield Run("walk", length_s, scene, COARSE)
            yield Run("walk", length_s, scene, ONE_TIER | {"occlusion": False, "sagitta_scale": 2.0}, CLUTTER)
    yield Run("run", 1.3, "living_room", TWO_TIERS | {"sagitta_scale": 1.5, "visibility_rate_hz": 12.5})
    yield Run("run", 1.3, "corridor", ONE_TIER | {"visibility_rate_hz": 50.0}, CLUTTER)


def timed(each: Run) -> dict[str, Any]:
    """Seconds of a run over the yardstick's, from the set model to the spectrogram, and the units of work in it."""
    motion = recorded(WALK if each.name == "walk" else RUN)
    target = t2d.trim(motion, 0.2, 0.2 + each.length_s) if each.name == "walk" else t2d.trim(motion, 0.0, each.length_s)
    radar, taken = Radar.preset(each.radar), []
    for _ in range(4):  # the first one compiles
        for keeps in (refinement, points, mirrors, clutter):  # each run refines anew
            keeps.forget()
        model = modelled(target, each.scene, radar=radar, **each.physics)
        accuracy = Accuracy(**each.accuracy)
        yardstick, start = yardstick_s(model.backend), time.perf_counter()
        cube = summed(prepare(model, accuracy, each.physics.get("clutter", "none")), "auto", None)
        spectrogram(cube, radar)
        taken.append((time.perf_counter() - start) / yardstick)
    units = cost.work_units(model, accuracy, cost.facet_counts(model, accuracy), each.physics.get("clutter", "none"))
    print(
        f"{each.name}, {each.length_s:g} s, {each.scene}: {min(taken[1:]):.1f} yardsticks",
        file=sys.stderr,
        flush=True,
    )
    return {
        "run": each.name,
        "scene": each.scene,
        "length_s": each.length_s,
        "taken": min(taken[1:]),
        "work": units,
    }


def fitted_cost(times: list[dict[str, Any]]) -> dict[str, Any]:
    """Seconds of each kind of work, none below its least, that err least in proportion."""
    kinds = list(times[0]["work"])
    taken = np.array([each["taken"] for each in times])
    units = np.array([[each["work"][kind] for kind in kinds] for each in times])
    least = np.array([LEAST.get(kind, 0.0) for kind in kinds])
    found, _ = nnls(units / taken[:, None], 1 - units @ least / taken)
    found += least
    return {"seconds": dict(zip(kinds, found.tolist(), strict=True))}
