"""The error of a run, measured on a few of its chirps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from t2d_rt.accuracy.budget import ErrorBudget, Total, db, patches_db, ratio
from t2d_rt.accuracy.cost import predicted_bytes
from t2d_rt.accuracy.error_laws import COARSER
from t2d_rt.accuracy.estimate import Chirps, Field, of_cube
from t2d_rt.accuracy.plans import Plan
from t2d_rt.accuracy.search import OVER_DB, finer_plan
from t2d_rt.core.cubes import Cube
from t2d_rt.core.errors import warn
from t2d_rt.pipeline.echo_model import with_method
from t2d_rt.propagation.visibility import sample_times
from t2d_rt.types import Accuracy
from t2d_rt.types.accuracy import DEFAULT_TIERS
from t2d_rt.types.scatterer import Scatterer

CHIRPS = 4, 8, 16
"""So many chirps are held against the coarser model, more of them where the first ones do not tell well enough."""
ENOUGH_DB = 1.4
"""Standard error of the mean over chirps at which no more are asked."""
CLEARLY = 1.5
"""A tolerance that the error keeps by so many standard deviations is decided, and visibility costs what the law says where this
decides it; one that it misses asks for all chirps."""
FEWER = 1.5
"""Facets that are so many times fewer are coarser in fact."""
FINER_CHIRPS, FINER_DB = 24, 1.0
"""A run whose law of facets is unsure is held against finer facets at so many chirps: what is left of their own error makes that
standard deviation."""
SPLIT, MOST_FINER, LEAST_FACTOR, LEAST_SCALE = 4.0, 260_000.0, 2.0, 0.01
"""Flat facets are finer in fact where they are so many times more. No more than so many are made, and none where their sagitta
scale would fall by less than that factor or below the last."""
LEAST_CHIRPS, LONE_DB = 4, 5.6
"""The scatter of fewer chirps tells nothing; the energy of a single one has about that standard deviation."""
UNOCCLUDED_BELOW_DB = 6.0
"""The coarser model traces no occlusion where that costs so much less than coarser facets."""
SHADOWS = 0.3
"""What visibility costs is measured where it may be more than this fraction of facets' error."""
EXACT: Mapping[str, Any] = {"occlusion": True, "visibility_subdivision": 2, "fast_rotating_hz": 100_000.0}
"""What visibility costs is measured beside visibility traced on meshes subdivided so often, those of targets that rotate up to that
surface rate [Hz] among them."""
ROUNDING = 1e-12
"""Energy over that of static echoes below which a field counts as none."""
EXPLAINED = 3.5
"""A difference this many standard deviations above the law counts in full: short records scatter more than those of the fit."""


@dataclass(frozen=True, slots=True)
class MeasuredError:
    """Field error of a run and how well it is known."""

    error_db: float
    scatter_db: float
    """Standard deviation: of the mean over chirps, and of the laws."""
    chirps: int
    facets_db: float | None = None
    """What of it facets alone cause, the rest being visibility's; where finer facets tell the error, with visibility traced at each
    chirp, and it misses the tolerance or keeps it by less than a standard deviation."""

    def described(self) -> dict[str, float]:
        """Entries of a recording's settings."""
        if math.isnan(self.error_db):
            return {}
        return {"error_db": self.error_db, "error_scatter_db": self.scatter_db, "error_chirps": self.chirps}


def measured_error(plan: Plan, cube: Cube, static: Sequence[Scatterer]) -> MeasuredError:
    """The field error of a run by a plan, measured at random chirps of its cube, `static` being the echoes of the static scene in
    it; a warning where there is nothing to measure.

    The chirps are held against a model with coarser facets, which costs little. Facets' errors fall with their phase sagitta by a
    fitted law, so the difference tells the run's own (`ErrorBudget`, as in Richardson's extrapolation). In free space the
    coarser model tells what sampled visibility costs, too, beside one that traces it at each chirp, where the law of shadows'
    edges leaves in doubt whether the tolerance is kept. Ellipsoids that stand for bodies over minor path pairs are not in the
    coarser model: the difference has their power. Small bodies and meshes in free space are held against finer facets,
    visibility traced at each chirp: the difference is the error.
    """
    budget, model, accuracy = plan.budget, plan.model, plan.accuracy
    coarser, expected, fraction = compared_with(budget, accuracy)
    to_finer = finer(budget, accuracy)
    count = FINER_CHIRPS if to_finer else CHIRPS[-1]
    chirps = Chirps.random(model.radar, model.span_s, seed=model.seed + 1, count=count)
    full = with_method(model, "mesh") if model.method == "ellipsoid" and budget.of_bodies else model
    matter = False
    if to_finer is not None:
        again = Field(full, to_finer, chirps)
    else:
        samples_s = chirps.nearest(sample_times(*model.span_s, accuracy.visibility_rate_hz), model.radar)
        again = Field(full, coarser, chirps, samples_s=samples_s)
        matter = shadows_matter(budget, accuracy, coarser, expected * fraction)
    exact = None
    facets, shadows, energy, with_all_echoes = np.zeros(0), np.zeros(0), 0.0, 0.0
    compared = np.zeros((0, len(chirps.samples)))
    count = len(chirps.rows)
    enough = CHIRPS if plan.tolerance_db is not None else CHIRPS[1:]  # a tolerance may be kept by far
    for first, last in pairwise(sorted({0, count, *(chirp_count for chirp_count in enough if chirp_count < count)})):
        samples, with_static = (of_cube(model, cube, omitted, chirps[first:last]) for omitted in (static, ()))
        energy += float(np.sum(np.abs(samples) ** 2))
        with_all_echoes += float(np.sum(np.abs(with_static) ** 2))
        compared = np.concatenate([compared, again.samples(first, last)])
        facets = np.append(facets, np.sum(np.abs(samples - compared[first:]) ** 2, axis=1))
        # Of float32 samples less the static echoes in them something remains in any case.
        silent = energy <= ROUNDING * with_all_echoes
        if silent:
            continue
        if to_finer is not None:
            of_chirps_db = min(_standard_error_db(facets), LONE_DB / math.sqrt(len(facets)))
            scatter_db = math.hypot(FINER_DB, of_chirps_db)
            result = MeasuredError(db(facets.sum() / energy), scatter_db, len(facets))
            continue
        result = _combined(budget, accuracy, expected, fraction, facets / energy, np.zeros(0))
        if matter and (exact or not _clearly(result, plan.tolerance_db)):
            exact = exact or Field(full, coarser.replace(**EXACT), chirps)
            done = len(shadows)  # of as many chirps as the energy
            traced = exact.samples(done, last)
            shadows = np.append(shadows, np.sum(np.abs(traced - compared[done:]) ** 2, axis=1))
            result = _combined(budget, accuracy, expected, fraction, facets / energy, shadows / energy)
        if plan.tolerance_db is None or _clearly(result, plan.tolerance_db):
            break
        uncertain_db = max(_standard_error_db(energies) for energies in ([facets, shadows] if exact else [facets]))
        if uncertain_db <= ENOUGH_DB and result.error_db <= plan.tolerance_db:
            break
    if silent:
        warn("there is no echo at the chirps compared, so the error is not known")
        return MeasuredError(math.nan, math.nan, len(facets))
    most_db = math.inf if to_finer is None or plan.tolerance_db is None else plan.tolerance_db
    if result.error_db + result.scatter_db > most_db:
        exact_samples = Field(full, accuracy.replace(**EXACT), chirps).samples()
        of_facets = float(np.sum(np.abs(exact_samples - compared) ** 2))
        return replace(result, facets_db=db(of_facets / energy))
    return result


def _clearly(result: MeasuredError, tolerance_db: float | None) -> bool:
    """Whether the error keeps the tolerance, if there is one, beyond doubt."""
    return tolerance_db is not None and result.error_db + CLEARLY * result.scatter_db < tolerance_db


def measured_directly(plan: Plan) -> bool:
    """Whether the error of a run by a plan is that against finer facets, so that one that misses its tolerance is made again."""
    return finer(plan.budget, plan.accuracy) is not None


def plan_again(plan: Plan, error: MeasuredError) -> Plan | None:
    """A finer plan for a run that misses its tolerance, or keeps it by less than a standard deviation; None where it is kept,
    where the laws have a part in the error, as for adults, or where a finer run could not be measured so well or has no memory.

    Facets and visibility may each have half of what is allowed, less that deviation: which has more becomes finer.
    """
    if plan.tolerance_db is None or error.facets_db is None:
        return None
    half = ratio(plan.tolerance_db - error.scatter_db) / 2
    of_facets = ratio(error.facets_db)
    again = finer_plan(plan, facets=of_facets > half, visibility=ratio(error.error_db) - of_facets > half)
    if again is None or not measured_directly(again):
        return None
    needed_bytes = predicted_bytes(again.model, again.accuracy, again.budget.counts, measured=True)
    return again if needed_bytes <= again.model.memory.limit_bytes else None


def warn_of_miss(plan: Plan, error: MeasuredError) -> None:
    """Warns where the measured error misses the tolerance."""
    if plan.tolerance_db is not None and error.error_db > plan.tolerance_db + OVER_DB:
        warn(
            f"the measured error of {error.error_db:.1f} dB misses the tolerance of {plan.tolerance_db:g} dB; plan tells what "
            "costs most"
        )


def _combined(
    budget: ErrorBudget, accuracy: Accuracy, expected: float, fraction: float, facets: np.ndarray, shadows: np.ndarray
) -> MeasuredError:
    """The error of a run from energies by which its chirps differ from coarser facets' (K,), and these from traced ones, if any.

    What the laws say by themselves counts, too, each figure weighted by how well it is known. A difference that they cannot
    explain is an error of the run in full; one that is smaller than they say counts only where the coarser model has fewer facets
    in fact.
    """
    law, apart, of_chirps_db = (
        budget.facets(accuracy.tiers[0], accuracy.sagitta_scale)[1],
        float(facets.sum()),
        _standard_error_db(facets),
    )
    explained = min(apart, expected * ratio(EXPLAINED * math.hypot(law.difference_scatter_db, of_chirps_db)))
    least = expected * (ratio(-EXPLAINED * law.difference_scatter_db) if has_fewer_facets(budget, accuracy) else 1.0)
    by_facets = _mean(
        (db(fraction * expected), law.scatter_db),
        (db(fraction * max(least, explained)), math.hypot(law.ratio_scatter_db, of_chirps_db)),
        law.correlation * law.ratio_scatter_db / math.hypot(law.ratio_scatter_db, of_chirps_db),
    )
    parts = [by_facets, (db(left_out(budget, accuracy)), budget.laws.pairs.scatter_db)]
    of_visibility = [omission for omission in budget.of_visibility(accuracy) if omission.taken]
    if of_visibility:
        energies = [omission.energy for omission in of_visibility]
        scatter_db = sum(omission.energy * omission.scatter_db for omission in of_visibility) / max(
            sum(energies), 1e-30
        )
        by_law = db(sum(energies)), scatter_db
        if shadows.any():
            coarser = budget.laws.over_direct(accuracy)
            direct_db = db(float(shadows.sum())) + coarser.mean_db
            by_law = _mean(by_law, (direct_db, math.hypot(coarser.scatter_db, _standard_error_db(shadows))))
        parts.append(by_law)
    parts += [
        (omission.error_db, omission.scatter_db)
        for omission in [*budget.untraced(accuracy), *budget.of_spectra(accuracy)]
    ]
    error = sum(ratio(part_db) for part_db, _ in parts)
    scatter_db = math.hypot(*(ratio(part_db) * part_scatter_db for part_db, part_scatter_db in parts)) / error
    return MeasuredError(db(error + apart - explained), scatter_db, len(facets))


def shadows_matter(budget: ErrorBudget, accuracy: Accuracy, coarser: Accuracy, expected: float) -> bool:
    """Whether what visibility costs is measured: in free space, where it may be a good part of the error."""
    if budget.model.scene is not None or coarser.occlusion != accuracy.occlusion:
        return False
    return Total.of(budget.of_visibility(accuracy)).surely > SHADOWS * expected


def compared_with(budget: ErrorBudget, accuracy: Accuracy) -> tuple[Accuracy, float, float]:
    """The coarser accuracy with which a run is compared, the energy of their difference by the laws, and the fraction of it that
    is the error of the run."""
    laws = budget.laws
    apart, error = 0.0, 0.0
    for tier, _, power in budget.tiers(accuracy):
        if budget.by_limbs(tier):
            error += power * ratio(laws.limbs.mean_db)
            apart += power * ratio(
                laws.limbs.mean_db if budget.model.method == "ellipsoid" else laws.limbs_power.mean_db
            )
        elif budget.counts:
            sagitta, law = budget.facets(tier, accuracy.sagitta_scale)
            in_patches = ratio(patches_db(tier.patch_phase_scale))
            error += power * (ratio(law.error_db(sagitta)) + in_patches)
            apart += power * (ratio(law.difference_db(sagitta)) + in_patches)
    in_time = sum(omission.energy for omission in budget.in_time(accuracy))
    error, apart = error + in_time, apart + in_time
    coarser = _coarser(accuracy, without_limbs=budget.of_bodies)
    if budget.counts and coarser.occlusion:
        unoccluded = ratio(budget.unoccluded.mean_db)
        if unoccluded < apart * ratio(-UNOCCLUDED_BELOW_DB):
            coarser, apart = coarser.replace(occlusion=False), apart + unoccluded
    return coarser, apart, error / apart


def finer(budget: ErrorBudget, accuracy: Accuracy) -> Accuracy | None:
    """The finer accuracy, visibility traced at each chirp, with which the run of a small body or mesh in free space is compared;
    None where the law of facets serves or finer ones cost too much."""
    scale, facet_count = accuracy.sagitta_scale, budget.facet_count(accuracy.sagitta_scale)
    if (
        budget.model.scene is not None
        or not budget.unsure
        or budget.by_limbs(accuracy.tiers[0])
        or scale <= LEAST_SCALE
    ):
        return None
    factor = min(COARSER, MOST_FINER / facet_count)
    enough = facet_count * (FEWER if all(count.curved for count in budget.counts) else SPLIT)
    while factor >= LEAST_FACTOR and scale > LEAST_SCALE and budget.facet_count(scale) < enough:
        scale = max(scale / factor, LEAST_SCALE)
    if factor < LEAST_FACTOR or budget.facet_count(scale) > 1.01 * MOST_FINER:
        return None
    return accuracy.replace(sagitta_scale=scale, **EXACT)


def left_out(budget: ErrorBudget, accuracy: Accuracy) -> float:
    """Power of the path pairs that a run leaves out, over that of all of them, by the law."""
    kept_power = sum(power for _, _, power in budget.tiers(accuracy))
    return max(0.0, 1 - kept_power) * ratio(budget.laws.pairs.mean_db)


def has_fewer_facets(budget: ErrorBudget, accuracy: Accuracy) -> bool:
    """Whether the coarser model has fewer facets: a mesh whose own faces are as fine as asked for is not refined at all."""
    scale = accuracy.sagitta_scale
    finer_count, coarser = (budget.facet_count(factor * scale) for factor in (1.0, COARSER))
    return not budget.counts or finer_count > FEWER * coarser


def _mean(first: tuple[float, float], second: tuple[float, float], correlation: float = 0.0) -> tuple[float, float]:
    """The mean of least variance of two figures with standard deviations [dB], and its own standard deviation."""
    (a_db, a), (b_db, b) = first, second
    if math.isinf(b):
        return first
    both = correlation * a * b
    apart = a**2 + b**2 - 2 * both
    weight = min(1.0, max(0.0, (b**2 - both) / apart))
    return weight * a_db + (1 - weight) * b_db, math.sqrt(
        (weight * a) ** 2 + ((1 - weight) * b) ** 2 + 2 * weight * (1 - weight) * both
    )


def _standard_error_db(difference: np.ndarray) -> float:
    """Standard error of the mean of chirps' energies (K,) [dB]; infinite where there are too few to tell."""
    count, mean = len(difference), float(np.mean(difference))
    if count < LEAST_CHIRPS or mean == 0:
        return math.inf
    return 4.34 * float(np.std(difference, ddof=1)) / math.sqrt(count) / mean


def _coarser(accuracy: Accuracy, *, without_limbs: bool) -> Accuracy:
    """Coarser facets over the same path pairs; `without_limbs` none over those where bodies are ellipsoids."""
    run_tiers = DEFAULT_TIERS if accuracy.by_ellipsoids else accuracy.tiers
    facets = [tier for tier in run_tiers if tier.scatterer == "facets"]
    tiers = [
        tier.model_copy(update={"greatest_sagitta_rad": min(10.0, COARSER * tier.greatest_sagitta_rad)})
        for tier in (facets if without_limbs else run_tiers)
    ]
    least_db = accuracy.least_level_db
    if len(tiers) < len(run_tiers):
        least_db = max(least_db, tiers[-1].level_db)
    scale = min(100.0, COARSER * accuracy.sagitta_scale)
    return accuracy.replace(sagitta_scale=scale, least_level_db=least_db, tiers=tuple(tiers))
