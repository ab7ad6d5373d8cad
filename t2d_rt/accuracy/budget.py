"""No more than needed: from a tolerance to how finely targets are modelled, and what each omission costs."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from t2d_rt.accuracy.estimate import Chirps, nmse_db
from t2d_rt.accuracy.estimate import field as probed
from t2d_rt.accuracy.estimate import measured_db as estimate_db
from t2d_rt.checks import flag, number, shown
from t2d_rt.cubes import Cube
from t2d_rt.errors import InputError, T2DWarning
from t2d_rt.model import (
    MOST_SUBDIVISION,
    SECONDARY_DB,
    SPLINE_ERROR_DB,
    Model,
    farthest_and_fastest,
    with_method,
)
from t2d_rt.types import Accuracy, EchoStream, Ellipsoids, Motion, MovingMesh

OCCLUSION = "occlusion of targets by themselves and one another"
NEGLIGIBLE_DB = 14.0
"""What is that far below the error does not count."""
CHIRPS = 16
"""Occlusion is judged by so many."""
LEAST_DB, MOST_DB = -40.0, 6.0
"""Tolerances that there are settings for."""
MARGIN_DB = 2.0
"""What is planned lies that far below what is asked."""
FACETS_DB, FACETS_SLOPE_DB = -21.5, 24.0
"""Error of a body's facets at their own phase sagitta, and per decade of it (docs/decisions.md)."""
BODY_SAGITTA_RAD = 0.3
FINEST, COARSEST = 0.1, 6.0
"""Of that sagitta."""
STEPS_PER_OCTAVE = 8
"""It is taken in steps, so that recordings of about the same tolerance have their facets in common."""
VISIBILITY = (5.0, 0), (12.5, 0), (25.0, 0), (50.0, 1), (100.0, 1), (100.0, MOST_SUBDIVISION)
"""Rates [Hz] at which visibility may be sampled, and subdivisions; the first that suffices is taken, else the best."""
FIRST_RATE_HZ, CLEARLY_DB = 25.0, 6.0
"""Whether occlusion matters at all is judged at that rate; only where it may, from every facet's vertex. It does not where it costs
that much less than it may."""
SPLINES_BELOW_DB, SYNTHESIS_BELOW_DB = 16.0, 20.0
"""What the splines and the sum may add lies that far below the tolerance."""
GREATEST_SYNTHESIS_DB = -40.0
"""Greatest error of the sum."""
UNPLANNED_DB = -20.0
"""Error that is expected where none was planned."""
OVER_DB = 1.0
"""A plan may expect that much more than the tolerance before it warns: its estimates are rather high."""
JUDGED_LEVEL_DB = -20.0
"""Occlusion is judged over path pairs down to that level: 96 and 93 % of the power in two rooms. Who walks towards the radar
occludes nothing from there, but much from a wall's image."""
JUDGED_SAGITTA_SCALE = 0.5
"""It is judged with facets of half the meshes' own phase sagitta, however fine the run's are: to 0.1 dB the same."""
LEAST_SHARE = 0.2
"""Facets are not made finer than that asks for."""
FACETS_SHARE, VISIBILITY_SHARE, LEFT_OUT_SHARE, SECONDARY_SHARE = 0.7, 0.3, 0.15, 0.2
"""Of the error allowed: that of the facets, of visibility, and of path pairs left out and by coarser facets. They may come to more
than all of it: estimates for path pairs are high."""


@dataclass(frozen=True, slots=True)
class Omission:
    """Something that is not modelled, or not as it is."""

    what: str
    error_db: float
    """What that costs, over the field's energy."""
    taken: bool
    """Whether it is left out; else it would cost too much."""


@dataclass(frozen=True, slots=True)
class Plan:
    """How a recording will be modelled to keep to a tolerance."""

    model: Model
    tolerance_db: float | None
    """None where an accuracy was given instead."""
    accuracy: Accuracy
    omissions: Sequence[Omission]
    seconds: Mapping[str, float] = field(default_factory=dict)
    """What the parts of `simulate` and the spectrogram will take, as far as it was tried."""
    memory_bytes: float = math.nan
    """Greatest memory of the process beyond what it held before, likewise."""

    @property
    def hidden(self) -> bool:
        """Whether occlusion matters to a measurement of the error."""
        nothing = [each.error_db for each in self.omissions if each.what == OCCLUSION]
        return not nothing or nothing[0] > self.error_db - NEGLIGIBLE_DB

    @property
    def error_db(self) -> float:
        """Error to be expected: the sum of what is left out."""
        if not self.omissions:
            return UNPLANNED_DB
        return _db(sum(10 ** (each.error_db / 10) for each in self.omissions if each.taken))

    def described(self) -> dict[str, float]:
        """For a recording's settings."""
        return {} if self.tolerance_db is None else {"tolerance_db": self.tolerance_db}

    def __str__(self) -> str:
        return "\n".join(_told(self))


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a user wants of the accuracy."""

    given: Accuracy
    """The fields that are set in it stay."""
    tolerance_db: float | None
    measured: bool
    """Whether the error is measured after the run."""

    @classmethod
    def of(
        cls,
        accuracy: Accuracy | Mapping[str, Any] | None,
        tolerance_db: float | None,
        measure_error: bool | None = None,
    ) -> Wanted:
        """From the options of `simulate`, checked."""
        if measure_error is not None:
            flag("measure_error", measure_error)
        if tolerance_db is not None:
            check_tolerance(tolerance_db)
        return cls(
            checked_accuracy(accuracy),
            tolerance_db,
            tolerance_db is not None if measure_error is None else measure_error,
        )


def checked_accuracy(accuracy: Accuracy | Mapping[str, Any] | None) -> Accuracy:
    """An `Accuracy`, or one of the fields given; the default one for None."""
    if accuracy is None:
        return Accuracy()
    if isinstance(accuracy, Accuracy):
        return accuracy
    if not isinstance(accuracy, Mapping):
        raise InputError(
            f"accuracy must be an Accuracy or a mapping of its fields, got {shown(accuracy)}; {{'sagitta_rad': 0.2}} is one"
        )
    return Accuracy.model_validate(accuracy)


def check_tolerance(tolerance_db: float) -> None:
    """Refuses one for which there are no settings."""
    hint = "-20 suits most uses, at 0 there is as much error as signal"
    number("tolerance_db", tolerance_db, LEAST_DB, MOST_DB, unit="dB", hint=hint)


def chosen(model: Model, wanted: Wanted) -> Plan:
    """The accuracy that keeps to the tolerance, or the one given where there is none."""
    if wanted.tolerance_db is None:
        return Plan(model, None, wanted.given, ())
    return planned(model, wanted.tolerance_db, wanted.given)


def planned(model: Model, tolerance_db: float, given: Accuracy) -> Plan:
    """The cheapest accuracy that keeps to the tolerance; what is set in the `given` one stays."""
    check_tolerance(tolerance_db)
    allowed = 10 ** ((tolerance_db - MARGIN_DB) / 10)
    asked = given.model_fields_set
    settings: dict[str, Any] = {
        "spline_error_db": tolerance_db - SPLINES_BELOW_DB,
        "synthesis_error_db": min(GREATEST_SYNTHESIS_DB, tolerance_db - SYNTHESIS_BELOW_DB),
        "fast_rotating_hz": given.fastest_sampled_hz,
        "clutter_occlusion": given.occludes_clutter,
        **model.paths_within(allowed * LEFT_OUT_SHARE, allowed * SECONDARY_SHARE),
    }
    accuracy = given.replace(**{name: value for name, value in settings.items() if name not in asked})
    bodies = any(isinstance(target, Motion) for target in model.targets)
    full = with_method(model, "mesh") if bodies and model.method == "ellipsoid" else model
    omissions = _in_time(model, accuracy)
    if any(isinstance(shape, MovingMesh) for shape in full.geometries):
        fixed = not asked.isdisjoint(("sagitta_rad", "sagitta_scale"))
        if not fixed:
            accuracy = accuracy.replace(sagitta_scale=_sagitta_scale(full, allowed * FACETS_SHARE))
        # Occlusion shows over the dominant path pairs.
        chirps = Chirps.random(model.radar, model.span_s, seed=model.seed, count=CHIRPS)
        judged = accuracy.replace(
            sagitta_scale=max(accuracy.sagitta_scale, JUDGED_SAGITTA_SCALE),
            least_level_db=max(accuracy.tiers[0].level_db, JUDGED_LEVEL_DB), occlusion=True,
            visibility_subdivision=MOST_SUBDIVISION,
        )  # fmt: skip
        left = allowed * VISIBILITY_SHARE
        nothing = probed(full, judged.replace(occlusion=False), chirps)
        fine = probed(full, judged.replace(visibility_subdivision=0), chirps, visibility_rate_hz=FIRST_RATE_HZ)
        if nmse_db(nothing, fine) > _db(left) - CLEARLY_DB:
            fine = probed(full, judged, chirps)
        if bodies:
            error = nmse_db(probed(with_method(full, "ellipsoid"), judged, chirps), fine)
            free = not asked and all(isinstance(t, Motion) for t in model.targets)
            simpler = Omission(
                "the skin: limbs by ellipsoids", error, full is not model or (free and error <= _db(allowed))
            )
            omissions.append(simpler)
            if simpler.taken:
                return _checked(Plan(with_method(full, "ellipsoid"), float(tolerance_db), accuracy, omissions))
        visibility, found = _visibility(full, judged, chirps, nmse_db(nothing, fine), fine, left, given)
        accuracy = accuracy.replace(**visibility)
        # Where visibility cannot be as good as it should, finer facets make up for it.
        spent = sum(10 ** (each.error_db / 10) for each in found if each.taken)
        share = float(np.clip(0.9 - spent / allowed, LEAST_SHARE, FACETS_SHARE)) * allowed
        if not fixed:
            accuracy = accuracy.replace(sagitta_scale=_sagitta_scale(full, share))
        omissions += [_facets(full, accuracy), *found]
    return _checked(Plan(model, float(tolerance_db), accuracy, omissions + _fewer_paths(model, accuracy)))


def measured_db(plan: Plan, cube: Cube, static: Sequence[EchoStream]) -> float:
    """Error of a run by a plan, measured; a warning where it misses the tolerance."""
    found = estimate_db(plan.model, plan.accuracy, cube, static, error_db=plan.error_db, hidden=plan.hidden)
    if plan.tolerance_db is not None and found > plan.tolerance_db + OVER_DB:
        warnings.warn(
            f"the measured error of {found:.1f} dB misses the tolerance of {plan.tolerance_db:g} dB; plan tells what costs most",
            T2DWarning,
            stacklevel=4,
        )
    return found


def _checked(plan: Plan) -> Plan:
    """Warns where a tolerance is not in reach."""
    assert plan.tolerance_db is not None
    if plan.error_db > plan.tolerance_db + OVER_DB:
        worst = max((each for each in plan.omissions if each.taken), key=lambda each: each.error_db)
        warnings.warn(
            f"a tolerance of {plan.tolerance_db:g} dB is not in reach, {plan.error_db:.1f} dB is: {worst.what} alone cost "
            f"{worst.error_db:.1f} dB; ask for less, or leave the settings to the tolerance",
            T2DWarning,
            stacklevel=4,
        )
    return plan


def _in_time(model: Model, accuracy: Accuracy) -> list[Omission]:
    """What interpolation between surface frames and the merging of echoes may add."""
    splines_db = accuracy.spline_error_db
    if accuracy.surface_rate_hz is not None:
        # A cubic's error falls with the fourth power of its step.
        needed_hz = max(model.rates_hz(Accuracy()))
        splines_db = SPLINE_ERROR_DB + 80 * math.log10(needed_hz / accuracy.surface_rate_hz)
    return [
        Omission("motion between surface frames, by splines", splines_db, True),
        Omission("the sum of echoes, merged", accuracy.synthesis_error_db, True),
    ]


def _fewer_paths(model: Model, accuracy: Accuracy) -> list[Omission]:
    pairs = model.pairs(accuracy)
    if pairs is None:
        return []
    total = sum(10 ** (each.mean_db / 10) for each in model.ranked)
    kept = 10 ** (np.array(pairs.levels_db) / 10)
    parts = (
        (len(model.ranked) - len(kept), max(0.0, total - kept.sum()), 0.0, "path pairs left out"),
        (len(kept) - pairs.dominant, kept[pairs.dominant :].sum(), SECONDARY_DB, "secondary path pairs by coarser facets"),
    )  # fmt: skip
    return [
        Omission(f"{count} {what}", _db(power / total) + each_db, True)
        for count, power, each_db, what in parts
        if count
    ]


def _sagitta_scale(model: Model, share: float) -> float:
    """Scale on the meshes' own phase sagitta at which facets err by that fraction of the field's energy."""
    octaves = math.log2(10 ** ((_db(share) - _own_db(model, Accuracy())) / FACETS_SLOPE_DB))
    return float(np.clip(2 ** (math.floor(STEPS_PER_OCTAVE * octaves) / STEPS_PER_OCTAVE), FINEST, COARSEST))


def _own_db(model: Model, accuracy: Accuracy) -> float:
    """Error of facets of the meshes' own phase sagitta, or of the one asked for."""
    found = []
    for target, shape in zip(model.targets, model.geometries, strict=True):
        if isinstance(shape, MovingMesh):
            own = shape.sagitta_rad if accuracy.sagitta_rad is None else accuracy.sagitta_rad
            of_body = accuracy.sagitta_rad is None and isinstance(target, Motion)
            sagitta = BODY_SAGITTA_RAD if of_body else float(np.max(own))
            found.append(FACETS_DB + FACETS_SLOPE_DB * math.log10(sagitta / BODY_SAGITTA_RAD))
    return max(found, default=-math.inf)


def _facets(model: Model, accuracy: Accuracy) -> Omission:
    error = _own_db(model, accuracy) + FACETS_SLOPE_DB * math.log10(accuracy.sagitta_scale)
    return Omission("the curve of the skin between facets' corners", error, True)


def _visibility(
    model: Model,
    accuracy: Accuracy,
    chirps: Chirps,
    nothing_db: float,
    fine: np.ndarray,
    left: float,
    given: Accuracy,
) -> tuple[dict[str, Any], list[Omission]]:
    """Whether, how often and from where visibility is sampled, at an error of `left`; no occlusion at all costs `nothing_db`."""
    asked = given.model_fields_set
    found = [Omission(OCCLUSION, nothing_db, False)]
    if not given.occlusion or (
        "occlusion" not in asked and "visibility_rate_hz" not in asked and nothing_db <= _db(left)
    ):
        return {"occlusion": False}, [replace(found[0], taken=True)]
    rates = [given.visibility_rate_hz] if "visibility_rate_hz" in asked else []
    ladder = [(rate, n) for rate in rates for n in range(MOST_SUBDIVISION + 1)] or list(VISIBILITY)
    if "visibility_subdivision" in asked:
        ladder = list(dict.fromkeys((rate, given.visibility_subdivision) for rate, _ in ladder))
    for rate_hz, subdivision in ladder:
        sampled = accuracy.replace(visibility_subdivision=subdivision)
        error = nmse_db(probed(model, sampled, chirps, visibility_rate_hz=rate_hz), fine)
        found.append(Omission(f"shadows' edges, {_sampled(rate_hz, subdivision)}", error, False))
        if error <= _db(left):
            best = len(found) - 1
            break
    else:
        best = min(range(1, len(found)), key=lambda n: found[n].error_db)
    found[best] = replace(found[best], taken=True)
    rate_hz, subdivision = ladder[best - 1]
    return {"visibility_rate_hz": rate_hz, "visibility_subdivision": subdivision}, found


def _told(plan: Plan) -> list[str]:
    """Lines for people."""
    model, accuracy = plan.model, plan.accuracy
    radar = model.radar
    lines = [f"tolerance {plan.tolerance_db:g} dB, expected error {plan.error_db:.1f} dB", "modelled:"]
    for shape, times_s in zip(model.geometries, model.frame_times(accuracy), strict=True):
        rate_hz = (len(times_s) - 1) / (times_s[-1] - times_s[0])
        number = len(shape.semi_axes_m) if isinstance(shape, Ellipsoids) else len(model.facets(shape, accuracy).faces)
        kind = f"{number} {'ellipsoids' if isinstance(shape, Ellipsoids) else 'facets'}"
        lines.append(f"  {shape.name}: {kind} at {rate_hz:.0f} surface frames a second")
    pairs = model.pairs(accuracy)
    if pairs is not None:
        coarse = len(pairs.pairs) - pairs.dominant
        lines.append(f"  {len(pairs.pairs)} path pairs: {pairs.dominant} in full, {coarse} by coarser facets")
    if model.method == "mesh":
        how = "not traced"
        if accuracy.occlusion:
            how = _sampled(accuracy.visibility_rate_hz, accuracy.visibility_subdivision)
        lines.append(f"  {OCCLUSION}: {how}")
    fastest = max(farthest_and_fastest(shape, radar, model.span_s)[1] for shape in model.geometries)
    asked_hz, sent_hz = (4 * speed / radar.wavelength_m for speed in (fastest, radar.max_speed_mps))
    lines.append(
        f"  slow time: up to {fastest:.1f} m/s asks for {asked_hz:.0f} chirps a second, {sent_hz:.0f} are sent"
    )
    lines.append("left out, and what that costs:")
    lines += [f"  {each.error_db:6.1f} dB  {each.what}" for each in plan.omissions if each.taken]
    kept = [each for each in plan.omissions if not each.taken and each.error_db < math.inf]
    if kept:
        lines += ["not left out, for it would cost:", *(f"  {each.error_db:6.1f} dB  {each.what}" for each in kept)]
    if plan.seconds:
        parts = ", ".join(f"{name} {seconds:.1f}" for name, seconds in plan.seconds.items())
        total = sum(plan.seconds.values())
        lines.append(f"predicted: {total:.1f} s once kernels are compiled ({parts}), {plan.memory_bytes / 1e9:.1f} GB")
    return lines


def _sampled(rate_hz: float, subdivision: int) -> str:
    edges = "" if not subdivision else f", their edges divided by {2**subdivision}"
    return f"visibility at {rate_hz:g} Hz from the meshes' vertices{edges}"


def _db(ratio: float) -> float:
    return 10 * math.log10(max(ratio, 1e-30))
