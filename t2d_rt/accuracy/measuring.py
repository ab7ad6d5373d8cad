"""The error of a run, measured on a few of its chirps."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from t2d_rt.accuracy.budget import Budget, ratio
from t2d_rt.accuracy.estimate import Chirps, field, of_cube
from t2d_rt.accuracy.laws import COARSER
from t2d_rt.accuracy.plans import Plan
from t2d_rt.accuracy.search import OVER_DB
from t2d_rt.cubes import Cube
from t2d_rt.errors import T2DWarning
from t2d_rt.model import with_method
from t2d_rt.types import Accuracy, EchoStream, PathTier
from t2d_rt.types.accuracy import EVERY_PATH_DB

CHIRPS = 12, 30
"""So many chirps are held against the coarser model, more where the first ones do not tell well enough."""
ENOUGH_DB = 1.4
"""Standard error of the mean over chirps at which no more are asked."""
CLEARLY = 3.0
"""A tolerance that the error misses or keeps by so many standard deviations is decided."""
LIMBS_DOWN_TO_DB = -30.0
"""Path pairs that a run leaves out are examined down to that level."""
UNOCCLUDED_BELOW_DB = 6.0
"""The coarser model traces no occlusion where that costs so much less than coarser facets."""
EXPLAINED = 2.0
"""A difference that exceeds what the laws say by so many of their standard deviations is an error of the run's own."""


@dataclass(frozen=True, slots=True)
class MeasuredError:
    """Field error of a run and how well it is known."""

    error_db: float
    scatter_db: float
    """Standard deviation: of the mean over chirps, and of the laws."""
    chirps: int

    def described(self) -> dict[str, float]:
        """For a recording's settings."""
        return {"error_db": self.error_db, "error_scatter_db": self.scatter_db, "error_chirps": self.chirps}


def measured(plan: Plan, cube: Cube, static: Sequence[EchoStream]) -> MeasuredError:
    """Field error of a run by that plan; a warning where it misses the tolerance.

    Random chirps of the cube are held against a model with coarser facets, which costs little. Facets' errors fall with their phase
    sagitta by a fitted law, so the difference tells the run's own (`Budget`, as in Richardson's extrapolation). Path pairs that the
    run leaves out are in the coarser model by ellipsoids, those that it has by ellipsoids are not: the difference has their power.
    A difference that the laws cannot explain is an error of the run in full. `static` are the echoes of the static scene.
    """
    budget, model, accuracy = plan.budget, plan.model, plan.accuracy
    coarser, expected, fraction = compared_with(budget, accuracy)
    full = with_method(model, "mesh") if model.method == "ellipsoid" and budget.of_bodies else model
    edges = sum(each.energy for each in budget.of_visibility(accuracy) if each.taken)
    scatter_db = budget.laws.smooth.scatter_db if budget.facets[1] else budget.laws.scatter_db
    for count in CHIRPS:
        chirps = Chirps.random(model.radar, model.span_s, seed=model.seed + 1, count=count)
        found = of_cube(model, cube, static, chirps)
        difference = np.sum(np.abs(found - field(full, coarser, chirps, samples_s=chirps.starts_s)) ** 2, axis=1)
        energy = float(np.sum(np.abs(found) ** 2))
        apart = float(difference.sum()) / max(energy, 1e-300)
        explained = min(apart, expected * ratio(EXPLAINED * scatter_db))
        error = fraction * explained + (apart - explained) + edges
        of_chirps_db = (
            4.34 * float(np.std(difference)) / math.sqrt(len(difference)) / max(float(np.mean(difference)), 1e-300)
        )
        result = MeasuredError(
            10 * math.log10(max(error, 1e-30)), math.hypot(of_chirps_db, scatter_db), len(chirps.rows)
        )
        beyond = math.inf if plan.tolerance_db is None else abs(result.error_db - plan.tolerance_db)
        if of_chirps_db <= ENOUGH_DB or beyond > CLEARLY * result.scatter_db or len(chirps.rows) < count:
            break
    if plan.tolerance_db is not None and result.error_db > plan.tolerance_db + OVER_DB:
        warnings.warn(
            f"the measured error of {result.error_db:.1f} dB misses the tolerance of {plan.tolerance_db:g} dB; plan tells what "
            "costs most",
            T2DWarning,
            stacklevel=4,
        )
    return result


def compared_with(budget: Budget, accuracy: Accuracy) -> tuple[Accuracy, float, float]:
    """The coarser accuracy with which a run is compared, the energy of their difference by the laws, and the fraction of it that
    is the error of the run."""
    laws, scale = budget.laws, accuracy.sagitta_scale
    apart, error, kept = 0.0, 0.0, 0.0
    for tier, _, power in budget.tiers(accuracy):
        kept += power
        if budget.by_limbs(tier):
            error += power * ratio(laws.limbs.mean_db)
            apart += power * ratio(
                laws.limbs.mean_db if budget.model.method == "ellipsoid" else laws.limbs_power.mean_db
            )
        elif budget.counts:
            sagitta, smooth = budget.sagitta_of(tier, scale), budget.facets[1]
            error += power * ratio(laws.facets(sagitta, smooth=smooth))
            apart += power * ratio(laws.coarser(sagitta, smooth=smooth))
    left = max(0.0, 1 - kept) * ratio(laws.pairs.mean_db)
    in_time = sum(each.energy for each in budget.in_time(accuracy))
    error, apart = error + left + in_time, apart + left * ratio(laws.limbs_power.mean_db) + in_time
    coarser = _coarser(accuracy)
    if budget.counts and coarser.occlusion:
        unoccluded = ratio(budget.unoccluded.mean_db)
        if unoccluded < apart * ratio(-UNOCCLUDED_BELOW_DB):
            coarser, apart = coarser.replace(occlusion=False), apart + unoccluded
    return coarser, apart, error / apart


def _coarser(accuracy: Accuracy) -> Accuracy:
    """Coarser facets; ellipsoids over path pairs that are left out, and none where the run has them."""
    facets = [tier for tier in accuracy.tiers if tier.scatterer == "facets"]
    tiers = [
        tier.model_copy(update={"greatest_sagitta_rad": min(10.0, COARSER * tier.greatest_sagitta_rad)})
        for tier in facets
    ]
    changes: dict[str, object] = {"sagitta_scale": min(100.0, COARSER * accuracy.sagitta_scale)}
    if len(facets) < len(accuracy.tiers):
        changes["least_level_db"] = max(accuracy.least_level_db, facets[-1].level_db)
    elif accuracy.least_level_db > LIMBS_DOWN_TO_DB:
        tiers[-1] = tiers[-1].model_copy(update={"level_db": accuracy.least_level_db})
        tiers.append(
            PathTier(level_db=EVERY_PATH_DB, scatterer="ellipsoids", visibility="blockage", diffuse_points=250)
        )
        changes["least_level_db"] = LIMBS_DOWN_TO_DB
    return accuracy.replace(**changes, tiers=tuple(tiers))
