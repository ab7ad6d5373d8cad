"""Searches the cheapest accuracy that keeps to a tolerance."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from typing import Any

import numpy as np

from t2d_rt.accuracy.budget import FAST_OCCLUSION, PATCHES_SCATTER_DB, SURELY, ErrorBudget, Total, patches_db, ratio
from t2d_rt.accuracy.error_laws import Laws
from t2d_rt.accuracy.plans import Plan
from t2d_rt.core.checks import number
from t2d_rt.core.errors import warn
from t2d_rt.geometry import curvature
from t2d_rt.pipeline.echo_model import SPLINE_ERROR_DB, Model, with_method
from t2d_rt.types import Accuracy, Motion, MovingMesh, PathTier
from t2d_rt.types.accuracy import DEFAULT_TIERS, ELLIPSOID_TIERS, EVERY_PATH_DB

LEAST_DB, MOST_DB = -40.0, 6.0
"""Least and greatest tolerance [dB] that can be asked for."""
SCALES = tuple(2 ** (n / 8) for n in range(24, -29, -1))
"""Sagitta scales that may be chosen, coarsest first; in steps, so that recordings of similar tolerances can share refined
facets."""
MOST_SMOOTH_SCALE, MOST_FLAT_SCALE = 2.0, 1.0
"""Greatest sagitta scale where there are movers or meshes of the user, and where a good part of one is all but flat: for blades
that face the radar, or plates that move within their plane, coarser facets have a greater error than the law for curved surfaces
predicts."""
FLAT_PER_M, FLAT_FRACTION = 4.0, 0.1
"""A vertex counts as flat where the surface curves less than `FLAT_PER_M` [1/m]; more than the fraction `FLAT_FRACTION` of such
vertices are a good part of a mesh."""
VISIBILITY = (12.5, 0), (25.0, 0), (25.0, 1), (50.0, 1), (50.0, 2), (100.0, 2)
"""Settings of visibility (rate [Hz], subdivision), cheapest first."""
PLANNED = VISIBILITY[1:]
"""Settings that a plan chooses from. At 12.5 Hz, the errors of a run and of a fall were 8 and 4 dB above the prediction, and only a
twentieth of the time is saved."""
MOST_SUBDIVISION = 2
MOST_VISIBILITY_HZ = 400.0
"""Greatest rate [Hz] at which visibility is sampled when a run that missed its tolerance is repeated."""
MOST_VISIBILITIES = 3
"""How many settings of visibility a plan tries at most: the cheapest of those that are good enough."""
WITH = {
    "sagitta_rad": "sagitta_scale",
    "tiers": "least_level_db",
    "least_level_db": "tiers",
    "visibility_rate_hz": "occlusion",
}
"""Fields that belong together: where the user sets the first, a step of `LADDER` does not change the second either."""
LEAST_FRACTION = 0.3
"""Facets are not made finer than for this fraction of the allowed error, even where visibility alone exceeds the allowed error."""
SPLINES_BELOW_DB, PATCHES_BELOW_DB, SYNTHESIS_BELOW_DB = 9.0, 6.5, 20.0
"""How far below the tolerance the errors of the splines, of larger patches and of the sum must lie [dB]."""
GREATEST_SPLINES_DB, GREATEST_SYNTHESIS_DB = -20.0, -40.0
"""Greatest errors of the splines and of the sum [dB]: at lower surface rates the law of the splines predicts too little."""
PATCH_PHASES = 4.0, 2.0
"""Factors on the default change of phase within a body's patches from frame to frame that may be chosen, greatest first."""
OVER_DB = 1.0
"""How far the expected error of a plan may exceed the tolerance before a warning [dB]."""


def _rung(
    dominant_db: float, least_db: float, greatest_sagitta_rad: float, scale: float = 1.0, **fields: Any
) -> Accuracy:
    """An accuracy for rooms: path pairs down to `dominant_db` at full accuracy, those down to `least_db` with coarser facets,
    others left out."""
    secondary = DEFAULT_TIERS[1].model_copy(
        update={"level_db": EVERY_PATH_DB, "greatest_sagitta_rad": greatest_sagitta_rad}
    )
    tiers = DEFAULT_TIERS[0].model_copy(update={"level_db": dominant_db}), secondary
    return Accuracy(least_level_db=least_db, tiers=tiers, sagitta_scale=scale, **fields)


LADDER = (
    _rung(-6.0, -18.0, 3.5, 1.4, occlusion=False),
    _rung(-6.0, -18.0, 3.5, 1.4),
    _rung(-10.0, -25.0, 3.5),
    _rung(-10.0, -30.0, 3.5),
    _rung(-14.0, -34.0, 3.0),
    _rung(-20.0, -40.0, 2.5, visibility_rate_hz=50.0, visibility_subdivision=1),
    _rung(-25.0, -46.0, 2.0, 0.7, visibility_rate_hz=100.0, visibility_subdivision=2),
    _rung(-40.0, -60.0, 1.5, 0.5, visibility_rate_hz=100.0, visibility_subdivision=2),
    _rung(-60.0, EVERY_PATH_DB, 1.0, 0.35, visibility_rate_hz=100.0, visibility_subdivision=2),
)
"""Accuracies for rooms, cheapest first. Path pairs below the last level are left out: ellipsoids would cost more and have a greater
error than nothing at all, for an echo of the right power but the wrong phase has twice the error of a missing one."""


def check_tolerance(tolerance_db: float) -> None:
    """Refuses a tolerance outside of the range that can be kept."""
    hint = "-20 suits most uses, at 0 there is as much error as signal"
    number("tolerance_db", tolerance_db, LEAST_DB, MOST_DB, unit="dB", hint=hint)


def as_given(model: Model, given: Accuracy) -> Model:
    """The model, in which bodies are ellipsoids where the accuracy says so."""
    bodies = any(isinstance(target, Motion) for target in model.targets)
    return with_method(model, "ellipsoid") if given.by_ellipsoids and bodies else model


def planned(model: Model, tolerance_db: float, given: Accuracy) -> Plan:
    """The plan of the cheapest accuracy that keeps to the tolerance by the fitted laws; fields that are set in `given` are kept."""
    check_tolerance(tolerance_db)
    model = as_given(model, given)
    allowed, asked = ratio(tolerance_db), given.model_fields_set
    bodies = [isinstance(target, Motion) for target in model.targets]
    in_time: dict[str, Any] = {
        "spline_error_db": min(
            GREATEST_SPLINES_DB if all(bodies) else SPLINE_ERROR_DB, tolerance_db - SPLINES_BELOW_DB
        ),
        "synthesis_error_db": min(GREATEST_SYNTHESIS_DB, tolerance_db - SYNTHESIS_BELOW_DB),
        "fast_rotating_hz": given.fastest_sampled_hz,
        "clutter_occlusion": given.occludes_clutter,
        "tiers": _in_patches(given.tiers, tolerance_db) if all(bodies) else given.tiers,
    }
    start = given.replace(**{name: value for name, value in in_time.items() if name not in asked})
    # Ellipsoids have a greater error than the field itself, so no setting would help.
    by_ellipsoids = ratio(Laws.fitted().limbs.mean_db) <= allowed
    if model.method == "mesh" and all(bodies) and not asked and by_ellipsoids:
        simpler = ErrorBudget(with_method(model, "ellipsoid"), start)
        if Total.of(simpler.omissions(start)).surely <= allowed:
            return Plan(simpler, float(tolerance_db), start.replace(tiers=ELLIPSOID_TIERS))
    budget = ErrorBudget(model, start)
    if len(budget.power) > 1 and budget.counts:
        return Plan(budget, float(tolerance_db), _in_a_room(budget, start, asked, tolerance_db))
    candidates = list(_candidates(budget, start, asked, allowed))
    within = [accuracy for accuracy, error in candidates if error <= allowed]
    if not asked:
        # The default may exceed the tolerance by as much as no plan warns of: to switch it off would take three times as long.
        error = Total.of(budget.omissions(Accuracy())).surely
        candidates.append((Accuracy(), error))
        within += [Accuracy()] if error <= allowed * ratio(OVER_DB) else []
    best = min(within, key=budget.seconds) if within else min(candidates, key=lambda candidate: candidate[1])[0]
    return Plan(budget, float(tolerance_db), best)


def _in_a_room(budget: ErrorBudget, start: Accuracy, asked: set[str], tolerance_db: float) -> Accuracy:
    """The first step of `LADDER` whose expected error is allowed, or is close to that of the best step; fields in `asked` stay as
    they are.

    No margin is added: the prediction of the laws was 0.6 to 9.4 dB above the error in 60 runs (ten accuracies; a walk, a run and a
    fall in two rooms). A fall to the side, which was not among the cases that the choice rests on, missed -10 and -18 dB by 1.8 dB,
    where 1 dB is accepted.
    """
    coarsest, bodies = _coarsest_scale(budget.model), all(isinstance(target, Motion) for target in budget.model.targets)
    fixed = asked | {WITH[name] for name in asked & WITH.keys()}
    rungs = []
    for rung in LADDER:
        fields = {name: getattr(rung, name) for name in rung.model_fields_set}
        fields["sagitta_scale"] = min(rung.sagitta_scale, coarsest)
        fields["tiers"] = _in_patches(rung.tiers, tolerance_db) if bodies else rung.tiers
        rungs.append(start.replace(**{name: value for name, value in fields.items() if name not in fixed}))
    errors = [Total.of(budget.omissions(rung)).energy for rung in rungs]
    enough = max(ratio(tolerance_db), ratio(OVER_DB) * min(errors))
    return next(rung for rung, error in zip(rungs, errors, strict=True) if error <= enough)


def _in_patches(tiers: tuple[PathTier, ...], tolerance_db: float) -> tuple[PathTier, ...]:
    """The tiers, with patches as large as the tolerance allows."""
    most_db = tolerance_db - PATCHES_BELOW_DB - SURELY * PATCHES_SCATTER_DB
    scale = next((patch_phase for patch_phase in PATCH_PHASES if patches_db(patch_phase) <= most_db), 1.0)
    return tuple(tier.model_copy(update={"patch_phase_scale": max(scale, tier.patch_phase_scale)}) for tier in tiers)


def finer_plan(plan: Plan, *, facets: bool, visibility: bool) -> Plan | None:
    """The plan with `facets` of half the phase sagitta and with `visibility` sampled twice as often, for a run that was measured to
    miss its tolerance; what the user set stays. None where nothing is left to change.

    On small bodies each of the two lowers its part of the error by some 5 dB.
    """
    accuracy, asked = plan.accuracy, plan.budget.given.model_fields_set
    changes: dict[str, Any] = {}
    if facets and asked.isdisjoint(("sagitta_rad", "sagitta_scale")):
        changes["sagitta_scale"] = max(accuracy.sagitta_scale / 2, min(SCALES))
    if visibility and (accuracy.occlusion or "occlusion" not in asked):
        rate_hz, subdivision = VISIBILITY[-1]
        if accuracy.occlusion:
            rate_hz = min(2 * accuracy.visibility_rate_hz, MOST_VISIBILITY_HZ)
            subdivision = min(accuracy.visibility_subdivision + 1, MOST_SUBDIVISION)
        sampled = {"occlusion": True, "visibility_rate_hz": rate_hz, "visibility_subdivision": subdivision}
        changes |= {name: value for name, value in sampled.items() if name not in asked}
    finer = accuracy.replace(**changes)
    return None if finer == accuracy else Plan(plan.budget, plan.tolerance_db, finer)


def _candidates(
    budget: ErrorBudget, start: Accuracy, asked: set[str], allowed: float
) -> Iterator[tuple[Accuracy, float]]:
    """Accuracies to choose among, each with the energy that its error is unlikely to exceed: for each affordable setting of
    visibility the coarsest facets that the `allowed` energy permits, or the finest ones."""
    fixed = not asked.isdisjoint(("sagitta_rad", "sagitta_scale")) or not budget.counts
    scales = (
        (start.sagitta_scale,) if fixed else tuple(scale for scale in SCALES if scale <= _coarsest_scale(budget.model))
    )
    in_time = Total.of(budget.in_time(start))
    tiers = list(budget.tiers(start))
    errors = [in_time + Total.of(budget.of_tiers(tiers, scale)) for scale in scales]
    spectra, untraced = Total.of(budget.of_spectra(start)), Total.of(budget.untraced(start))
    for settings, sampled in _visibilities(budget, start, asked, allowed):
        unseen = sampled + spectra
        if settings.get("occlusion", start.occlusion):
            unseen += untraced
        # The coarsest scale whose error is allowed, or close to that of the finest one; by the laws the error falls with the scale.
        surely = [(error + unseen).surely for error in errors]
        enough = max(allowed, surely[-1] + LEAST_FRACTION * allowed)
        number = bisect_left([error <= enough for error in surely[:-1]], True)
        yield start.replace(**settings, sagitta_scale=scales[number]), surely[number]


def _coarsest_scale(model: Model) -> float:
    """The greatest sagitta scale at which the law of facets holds for the targets."""
    meshes = [
        geometry
        for target, geometry in zip(model.targets, model.geometries, strict=True)
        if not isinstance(target, Motion) and isinstance(geometry, MovingMesh)
    ]
    if not meshes:
        return max(SCALES)
    bent = (curvature(mesh.rest, mesh.faces, mesh.crease_deg) for mesh in meshes)
    return MOST_FLAT_SCALE if any(np.mean(per_m < FLAT_PER_M) > FLAT_FRACTION for per_m in bent) else MOST_SMOOTH_SCALE


def _visibilities(
    budget: ErrorBudget, start: Accuracy, asked: set[str], allowed: float
) -> list[tuple[dict[str, Any], Total]]:
    """Settings of visibility, as fields of `Accuracy`, and their errors: the cheapest ones whose error is below the `allowed`
    energy, or the one of least error where there is none."""
    if not budget.counts:
        return [({}, Total())]
    choices: list[dict[str, Any]] = [{"occlusion": False}]
    if start.occlusion:
        rates = [start.visibility_rate_hz] if "visibility_rate_hz" in asked else []
        ladder = [(rate, n) for rate in rates for n in range(MOST_SUBDIVISION + 1)] or list(PLANNED)
        if "visibility_subdivision" in asked:
            ladder = list(dict.fromkeys((rate, start.visibility_subdivision) for rate, _ in ladder))
        sampled: list[dict[str, Any]] = [
            {"visibility_rate_hz": rate, "visibility_subdivision": n} for rate, n in ladder
        ]
        choices = sampled if asked & {"occlusion", "visibility_rate_hz"} else choices + sampled
    costs = [Total.of(budget.of_visibility(start.replace(**choice))) for choice in choices]
    affordable = [(choice, cost) for choice, cost in zip(choices, costs, strict=True) if cost.surely < allowed]
    return affordable[:MOST_VISIBILITIES] or [
        min(zip(choices, costs, strict=True), key=lambda option: option[1].surely)
    ]


def warn_out_of_reach(plan: Plan) -> None:
    """Warns where the laws predict that a plan misses its tolerance."""
    if plan.tolerance_db is None or plan.error_db <= plan.tolerance_db + OVER_DB:
        return
    worst = max((omission for omission in plan.omissions if omission.taken), key=lambda omission: omission.error_db)
    remedy = "leave the settings to the tolerance"
    if worst.what == FAST_OCCLUSION:
        remedy = "trace it by the accuracy fast_rotating_hz=100000 and visibility_rate_hz=400"
    warn(
        f"a tolerance of {plan.tolerance_db:g} dB is not in reach, {plan.error_db:.1f} dB is: {worst.what} alone cost "
        f"{worst.error_db:.1f} dB; ask for less, or {remedy}"
    )
