"""Measures the field error of a run at a few of its chirps."""

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
"""Numbers of chirps that are compared with the coarser model: further ones are added where the first leave the error uncertain."""
ENOUGH_DB = 1.4
"""Standard error of the mean over chirps [dB] at which no further chirps are compared."""
CLEARLY = 1.5
"""How many standard deviations an error must lie below the tolerance to count as kept beyond doubt: then no more chirps are
compared, and the error of visibility is taken from its law. Where an error exceeds the tolerance, all chirps are compared."""
FEWER = 1.5
"""Ratio of facet counts from which the coarser model counts as coarser."""
FINER_CHIRPS, FINER_DB = 24, 1.0
"""Number of chirps at which a run is compared with finer facets, where the law of facets is too uncertain, and the standard
deviation [dB] that the remaining error of these facets causes."""
SPLIT, MOST_FINER, LEAST_FACTOR, LEAST_SCALE = 4.0, 260_000.0, 2.0, 0.01
"""Flat facets count as finer only where there are `SPLIT` times as many of them. At most `MOST_FINER` facets are made; none if the
sagitta scale could fall by less than `LEAST_FACTOR`, or has reached `LEAST_SCALE`."""
LEAST_CHIRPS, LONE_DB = 4, 5.6
"""Least number of chirps whose scatter is meaningful, and the standard deviation [dB] of the energy of a single chirp."""
UNOCCLUDED_BELOW_DB = 6.0
"""The coarser model traces no occlusion where leaving it out causes an error this far below that of coarser facets [dB]."""
SHADOWS = 0.3
"""The error of visibility is measured where it may exceed this fraction of the error of facets."""
EXACT: Mapping[str, Any] = {"occlusion": True, "visibility_subdivision": 2, "fast_rotating_hz": 100_000.0}
"""The accuracy against which the error of sampled visibility is measured: traced on meshes subdivided so often, with targets of
surface rates up to this one [Hz] traced as well."""
ROUNDING = 1e-12
"""Energy relative to that of the static echoes below which the targets' field counts as zero."""
EXPLAINED = 3.5
"""A difference from the coarser model that exceeds the law by this many standard deviations counts in full as an error: chirps of
short records scatter more than those of the fit."""


@dataclass(frozen=True, slots=True)
class MeasuredError:
    """Field error of a run and how well it is known."""

    error_db: float
    scatter_db: float
    """Standard deviation of the error [dB], from the scatter of chirps and that of the laws."""
    chirps: int
    facets_db: float | None = None
    """Part of the error that the facets alone cause [dB]; the rest is that of visibility. None unless the run was compared with
    finer facets and misses the tolerance, or keeps it by less than a standard deviation."""

    def described(self) -> dict[str, float]:
        """Entries of a recording's settings."""
        if math.isnan(self.error_db):
            return {}
        return {"error_db": self.error_db, "error_scatter_db": self.scatter_db, "error_chirps": self.chirps}


def measured_error(plan: Plan, cube: Cube, static: Sequence[Scatterer]) -> MeasuredError:
    """The field error of a run by a plan, measured at random chirps of its cube; `static` are the scatterers of the static scene in
    it. Warns where there is no echo to measure.

    The chirps are compared with a model of coarser facets, which costs little. The error of facets falls with their phase sagitta
    by a fitted law, so the difference yields the error of the run itself (`ErrorBudget`, as in Richardson's extrapolation). In free
    space, where the law of shadows' edges leaves in doubt whether the tolerance is kept, the coarser model is also compared with
    one that traces visibility at each chirp; this gives the error of sampled visibility. Ellipsoids that stand for bodies over
    minor path pairs are not in the coarser model: the difference includes their power. Small bodies and meshes in free space are
    compared with finer facets and visibility traced at each chirp instead: there the difference is the error.
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
    enough = CHIRPS if plan.tolerance_db is not None else CHIRPS[1:]  # an error may lie far below a tolerance
    for first, last in pairwise(sorted({0, count, *(chirp_count for chirp_count in enough if chirp_count < count)})):
        samples, with_static = (of_cube(model, cube, omitted, chirps[first:last]) for omitted in (static, ()))
        energy += float(np.sum(np.abs(samples) ** 2))
        with_all_echoes += float(np.sum(np.abs(with_static) ** 2))
        compared = np.concatenate([compared, again.samples(first, last)])
        facets = np.append(facets, np.sum(np.abs(samples - compared[first:]) ** 2, axis=1))
        # Subtracting static echoes from float32 samples leaves a rounding error, even where there is no field.
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
            done = len(shadows)  # from there on, so that energy and shadows cover the same chirps
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
    """Whether the error lies below the tolerance, if there is one, beyond doubt."""
    return tolerance_db is not None and result.error_db + CLEARLY * result.scatter_db < tolerance_db


def measured_directly(plan: Plan) -> bool:
    """Whether the error of a run by a plan is measured against finer facets, so that a run that misses its tolerance can be
    repeated."""
    return finer(plan.budget, plan.accuracy) is not None


def plan_again(plan: Plan, error: MeasuredError) -> Plan | None:
    """A finer plan for a run that misses its tolerance or keeps it by less than a standard deviation. None where the tolerance is
    kept, where the error rests on the laws, as for adults, or where the error of a finer run could not be measured so directly or
    memory does not suffice.

    Facets and visibility may each cause half of the allowed error, less that deviation: the one that exceeds its half is made
    finer.
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
    """Warns where the measured error exceeds the tolerance."""
    if plan.tolerance_db is not None and error.error_db > plan.tolerance_db + OVER_DB:
        warn(
            f"the measured error of {error.error_db:.1f} dB misses the tolerance of {plan.tolerance_db:g} dB; plan tells what "
            "costs most"
        )


def _combined(
    budget: ErrorBudget, accuracy: Accuracy, expected: float, fraction: float, facets: np.ndarray, shadows: np.ndarray
) -> MeasuredError:
    """The error of a run from the measured differences and from the laws, each weighted by its variance.

    facets: energy of the difference from coarser facets at each chirp, over the energy of the field, (K,). shadows: that of the
    difference between this coarser model and the same with visibility traced at each chirp; empty where it was not measured. A
    difference from coarser facets that the laws cannot explain is in full an error of the run. One that is smaller than they
    predict counts as such only where the coarser model does have fewer facets.
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
    """Whether the error of visibility is measured: in free space, where it may be a good part of the error."""
    if budget.model.scene is not None or coarser.occlusion != accuracy.occlusion:
        return False
    return Total.of(budget.of_visibility(accuracy)).surely > SHADOWS * expected


def compared_with(budget: ErrorBudget, accuracy: Accuracy) -> tuple[Accuracy, float, float]:
    """The coarser accuracy with which a run is compared, the energy of their difference by the laws relative to the field, and the
    fraction of it that is the error of the run."""
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
    """The finer accuracy, with visibility traced at each chirp, with which a run of small bodies or meshes in free space is
    compared; None where the law of facets is good enough, or where finer facets would cost too much."""
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
    """Power of the path pairs that a run leaves out relative to that of all, by the law."""
    kept_power = sum(power for _, _, power in budget.tiers(accuracy))
    return max(0.0, 1 - kept_power) * ratio(budget.laws.pairs.mean_db)


def has_fewer_facets(budget: ErrorBudget, accuracy: Accuracy) -> bool:
    """Whether the coarser model does have fewer facets: a mesh whose own faces are finer than asked for has the same ones."""
    scale = accuracy.sagitta_scale
    finer_count, coarser = (budget.facet_count(factor * scale) for factor in (1.0, COARSER))
    return not budget.counts or finer_count > FEWER * coarser


def _mean(first: tuple[float, float], second: tuple[float, float], correlation: float = 0.0) -> tuple[float, float]:
    """The combination of least variance of two figures (value, standard deviation) [dB] with correlated errors, and its standard
    deviation [dB]."""
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
    """Standard error [dB] of the mean of the energies of chirps (K,); infinite where there are too few."""
    count, mean = len(difference), float(np.mean(difference))
    if count < LEAST_CHIRPS or mean == 0:
        return math.inf
    return 4.34 * float(np.std(difference, ddof=1)) / math.sqrt(count) / mean


def _coarser(accuracy: Accuracy, *, without_limbs: bool) -> Accuracy:
    """An accuracy with coarser facets over the same path pairs; `without_limbs` it leaves out pairs over which bodies are
    ellipsoids."""
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
