"""No more than needed: from a tolerance to how finely targets are modelled, and what each omission costs."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from t2d_rt.errors import InputError, T2DWarning
from t2d_rt.model import WEAK_DB, Detail, Model, with_method
from t2d_rt.probe import Chirps, nmse_db
from t2d_rt.probe import field as probed
from t2d_rt.types import Ellipsoids, Motion, MovingMesh

HIDDEN = "what hides what"
NEGLIGIBLE_DB = 14.0
"""What is that far below the error does not count."""
CHIRPS = 8
"""What hides what is judged by so many."""
LEAST_DB, MOST_DB = -40.0, 6.0
"""Tolerances that there are settings for."""
MARGIN_DB = 0.7
"""What is planned lies that far below what is asked."""
FACETS_DB, FACETS_SLOPE_DB = -22.3, 24.0
"""Error of a body's facets at their own phase sagitta, and per decade of it (validation/report, tolerance)."""
BODY_SAGITTA_RAD = 0.3
FINEST, COARSEST = 0.1, 6.0
"""Of that sagitta."""
STEPS_PER_OCTAVE = 8
"""It is taken in steps, so that recordings of about the same tolerance have their facets in common."""
LOOKS_HZ = (5.0, 12.5, 25.0, 50.0, 100.0)
"""Rates of looks at what hides what, the first that does is taken."""
SPLINES_BELOW_DB, SYNTHESIS_BELOW_DB = 16.0, 20.0
"""What the splines and the sum may add lies that far below the tolerance."""
SYNTHESIS_DB = -80.0, -40.0
"""Least and greatest error of the sum."""
LOOKED_AT_DB = -10.0
"""Pairs of ways down to that level show what hides what."""
LEAST_SHARE = 0.2
"""Facets are not made finer than that asks for."""
FACETS_SHARE, LOOKS_SHARE, LEFT_OUT_SHARE, WEAK_SHARE = 0.7, 0.2, 0.15, 0.2
"""Of the error allowed: that of the facets, of what hides what, and of pairs of ways left out and by coarser facets. They may come
to more than all of it: estimates of pairs are high."""


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
    tolerance_db: float
    detail: Detail
    omissions: Sequence[Omission]
    seconds: Mapping[str, float] = field(default_factory=dict)
    """What the parts of `simulate` and the spectrogram will take, as far as it was tried."""
    memory_bytes: float = math.nan
    """Greatest memory of the process, likewise."""

    @property
    def hidden(self) -> bool:
        """Whether what hides what matters to a measurement of the error."""
        nothing = [each.error_db for each in self.omissions if each.what == HIDDEN]
        return not nothing or nothing[0] > self.error_db - NEGLIGIBLE_DB

    @property
    def error_db(self) -> float:
        """Error to be expected: the sum of what is left out."""
        return _db(sum(10 ** (each.error_db / 10) for each in self.omissions if each.taken))

    def __str__(self) -> str:
        return "\n".join(_told(self))


def planned(model: Model, tolerance_db: float, asked: Mapping[str, Any]) -> Plan:
    """The cheapest detail that keeps to the tolerance, but for what the user `asked` for."""
    if not isinstance(tolerance_db, (int, float)) or not LEAST_DB <= tolerance_db <= MOST_DB:
        raise InputError(
            f"tolerance_db must lie in {LEAST_DB:g}..{MOST_DB:g} dB, got {tolerance_db!r}; -20 suits most uses, at 0 there is as "
            "much error as signal"
        )
    allowed = 10 ** ((tolerance_db - MARGIN_DB) / 10)
    ways = model.ways_within(allowed * LEFT_OUT_SHARE, allowed * WEAK_SHARE)
    detail = Detail(
        **{
            "splines_db": tolerance_db - SPLINES_BELOW_DB,
            "synthesis_db": max(SYNTHESIS_DB[0], min(SYNTHESIS_DB[1], tolerance_db - SYNTHESIS_BELOW_DB)),
            **ways,
            **asked,
        }
    )
    omissions = _fewer_ways(model, detail)
    if model.method == "mesh":
        detail = replace(detail, coarser=1.0 if model.sagitta_rad else _coarser(model, allowed * FACETS_SHARE))
        # What hides what shows over the strong pairs.
        chirps = Chirps.random(model.radar, model.span_s, seed=model.seed, count=CHIRPS)
        strong = replace(detail, least_db=max(detail.strong_db, LOOKED_AT_DB))
        fine = probed(model, strong, chirps)
        simpler = _as_ellipsoids(model, strong, chirps, fine, allowed, asked)
        omissions.append(simpler)
        if simpler.taken:
            return Plan(with_method(model, "ellipsoid"), float(tolerance_db), detail, omissions)
        looks, found = _looks(model, strong, chirps, fine, allowed * LOOKS_SHARE, asked)
        omissions += found
        detail = replace(detail, **looks)
        # Where looks cannot do what they should, facets make up for it.
        spent = sum(10 ** (each.error_db / 10) for each in found if each.taken)
        share = np.clip(0.9 - spent / allowed, LEAST_SHARE, FACETS_SHARE) * allowed
        if not model.sagitta_rad:
            detail = replace(detail, coarser=_coarser(model, share))
        omissions.append(_facets(model, detail))
    omissions.append(Omission("motion between surface frames, by splines", detail.splines_db, True))
    omissions.append(Omission("the sum of echoes, merged", detail.synthesis_db, True))
    chosen = Plan(model, float(tolerance_db), detail, omissions)
    if chosen.error_db > tolerance_db:
        worst = max((each for each in omissions if each.taken), key=lambda each: each.error_db)
        warnings.warn(
            f"a tolerance of {tolerance_db:g} dB is not in reach, {chosen.error_db:.1f} dB is: {worst.what} alone cost "
            f"{worst.error_db:.1f} dB; ask for less, or leave the settings to the tolerance",
            T2DWarning,
            stacklevel=3,
        )
    return chosen


def _fewer_ways(model: Model, detail: Detail) -> list[Omission]:
    pairs = model.pairs(detail)
    if pairs is None:
        return []
    total = sum(10 ** (each.mean_db / 10) for each in model.ranked)
    kept = 10 ** (np.array(pairs.levels_db) / 10)
    parts = (
        (len(model.ranked) - len(kept), max(0.0, total - kept.sum()), 0.0, "pairs of ways left out"),
        (len(kept) - pairs.strong, kept[pairs.strong :].sum(), WEAK_DB, "weak pairs of ways by coarser facets"),
    )  # fmt: skip
    return [
        Omission(f"{count} {what}", _db(power / total) + each_db, True)
        for count, power, each_db, what in parts
        if count
    ]


def _as_ellipsoids(
    model: Model, detail: Detail, chirps: Chirps, fine: np.ndarray, allowed: float, asked: Mapping[str, Any]
) -> Omission:
    bodies = [isinstance(target, Motion) for target in model.targets]
    what = "the skin: limbs by ellipsoids"
    if not any(bodies) or not all(bodies):
        return Omission(what, math.inf, False)
    error = nmse_db(probed(with_method(model, "ellipsoid"), detail, chirps), fine)
    return Omission(what, error, error <= _db(allowed) and not asked)


def _coarser(model: Model, share: float) -> float:
    """Phase sagitta over the meshes' own at which facets err by that share of the field's energy."""
    octaves = math.log2(10 ** ((_db(share) - _own_db(model)) / FACETS_SLOPE_DB))
    return float(np.clip(2 ** (math.floor(STEPS_PER_OCTAVE * octaves) / STEPS_PER_OCTAVE), FINEST, COARSEST))


def _own_db(model: Model) -> float:
    """Error of facets of the meshes' own phase sagitta, or of the one asked for."""
    found = []
    for target, shape in zip(model.targets, model.shapes, strict=True):
        if isinstance(shape, MovingMesh):
            own = shape.sagitta_rad if model.sagitta_rad is None else model.sagitta_rad
            of_body = model.sagitta_rad is None and isinstance(target, Motion)
            sagitta = BODY_SAGITTA_RAD if of_body else float(np.max(own))
            found.append(FACETS_DB + FACETS_SLOPE_DB * math.log10(sagitta / BODY_SAGITTA_RAD))
    return max(found, default=-math.inf)


def _facets(model: Model, detail: Detail) -> Omission:
    error = _own_db(model) + FACETS_SLOPE_DB * math.log10(detail.coarser)
    return Omission("the curve of the skin between facets' corners", error, True)


def _looks(
    model: Model, detail: Detail, chirps: Chirps, fine: np.ndarray, left: float, asked: Mapping[str, Any]
) -> tuple[dict[str, Any], list[Omission]]:
    """Whether and how often to look at what hides what, at an error of `left`."""
    found: list[Omission] = []
    nothing = nmse_db(probed(model, replace(detail, occlusion=False), chirps), fine)
    enough = nothing <= _db(left) and "occlusion_hz" not in asked
    found.append(Omission(HIDDEN, nothing, enough or not detail.occlusion))
    if found[0].taken:
        return {"occlusion": False}, found
    for rate_hz in (detail.occlusion_hz,) if "occlusion_hz" in asked else LOOKS_HZ:
        error = nmse_db(probed(model, detail, chirps, looks_hz=rate_hz), fine)
        found.append(Omission(f"shadows' edges between corners and looks, {rate_hz:g} a second", error, False))
        if error <= _db(left):
            break
    best = min(range(1, len(found)), key=lambda n: found[n].error_db) if error > _db(left) else len(found) - 1
    found[best] = replace(found[best], taken=True)
    rate_hz = detail.occlusion_hz if "occlusion_hz" in asked else LOOKS_HZ[best - 1]
    return {"occlusion_hz": rate_hz}, found


def _told(plan: Plan) -> list[str]:
    """Lines for people."""
    model, detail = plan.model, plan.detail
    radar = model.radar
    lines = [f"tolerance {plan.tolerance_db:g} dB, expected error {plan.error_db:.1f} dB", "modelled:"]
    for shape, times_s in zip(model.shapes, model.paces(detail), strict=True):
        rate_hz = (len(times_s) - 1) / (times_s[-1] - times_s[0])
        number = (
            len(shape.semi_axes_m) if isinstance(shape, Ellipsoids) else len(model.facets(shape, detail.coarser).faces)
        )
        kind = f"{number} {'ellipsoids' if isinstance(shape, Ellipsoids) else 'facets'}"
        lines.append(f"  {shape.name}: {kind} at {rate_hz:.0f} surface frames a second")
    pairs = model.pairs(detail)
    if pairs is not None:
        coarse = len(pairs.pairs) - pairs.strong
        lines.append(f"  {len(pairs.pairs)} pairs of ways: {pairs.strong} in full, {coarse} by coarser facets")
    lines.append(
        "  what hides what: " + (f"{detail.occlusion_hz:g} looks a second" if detail.occlusion else "not looked at")
    )
    fastest = max(model.farthest_and_fastest(shape)[1] for shape in model.shapes)
    lines.append(
        f"  slow time: up to {fastest:.1f} m/s asks for {4 * fastest / radar.wavelength_m:.0f} chirps a second, "
        f"{radar.prf_hz / len(radar.tx_positions_m if radar.multiplexing == 'tdm' else [0]):.0f} are sent"
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


def _db(ratio: float) -> float:
    return 10 * math.log10(max(ratio, 1e-30))
