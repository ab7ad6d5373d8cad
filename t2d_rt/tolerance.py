"""No more than needed: from a tolerance to how finely targets are modelled, and what each omission costs."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from t2d_rt.checks import number
from t2d_rt.errors import T2DWarning
from t2d_rt.model import MOST_HALVED, SPLINES_DB, WEAK_DB, Detail, Model, farthest_and_fastest, with_method
from t2d_rt.probe import Chirps, nmse_db
from t2d_rt.probe import field as probed
from t2d_rt.types import Ellipsoids, Motion, MovingMesh

HIDDEN = "what hides what"
NEGLIGIBLE_DB = 14.0
"""What is that far below the error does not count."""
CHIRPS = 16
"""What hides what is judged by so many."""
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
LOOKS = (5.0, 0), (12.5, 0), (25.0, 0), (50.0, 1), (100.0, 1), (100.0, MOST_HALVED)
"""Rates [Hz] of looks at what hides what, and how often edges are halved for them; the first that does is taken, else the best."""
FIRST_LOOK_HZ, CLEARLY_DB = 25.0, 6.0
"""Whether it matters at all is asked of looks at that rate; only where it may, at every facet's vertex. It does not where it costs
that much less than it may."""
SPLINES_BELOW_DB, SYNTHESIS_BELOW_DB = 16.0, 20.0
"""What the splines and the sum may add lies that far below the tolerance."""
SYNTHESIS_MOST_DB = -40.0
"""Greatest error of the sum."""
OVER_DB = 1.0
"""A plan may expect that much more than the tolerance before it warns: its estimates are rather high."""
LOOKED_AT_DB = -20.0
"""Pairs of ways down to that level show what hides what: 96 and 93 % of the power in two rooms. Who walks towards the radar hides
nothing from there, but much from a wall's image."""
LOOKED_AT_COARSER = 0.5
"""So do facets of half the meshes' own phase sagitta, however fine the run's are: to 0.1 dB the same."""
LEAST_SHARE = 0.2
"""Facets are not made finer than that asks for."""
FACETS_SHARE, LOOKS_SHARE, LEFT_OUT_SHARE, WEAK_SHARE = 0.7, 0.3, 0.15, 0.2
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
    """Greatest memory of the process beyond what it held before, likewise."""

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


def check_tolerance(tolerance_db: float) -> None:
    """Refuses one for which there are no settings."""
    hint = "-20 suits most uses, at 0 there is as much error as signal"
    number("tolerance_db", tolerance_db, LEAST_DB, MOST_DB, unit="dB", hint=hint)


def planned(model: Model, tolerance_db: float, asked: Mapping[str, Any]) -> Plan:
    """The cheapest detail that keeps to the tolerance, but for what the user `asked` for."""
    check_tolerance(tolerance_db)
    allowed = 10 ** ((tolerance_db - MARGIN_DB) / 10)
    settings: dict[str, Any] = {
        "splines_db": tolerance_db - SPLINES_BELOW_DB,
        "synthesis_db": min(SYNTHESIS_MOST_DB, tolerance_db - SYNTHESIS_BELOW_DB),
        **model.ways_within(allowed * LEFT_OUT_SHARE, allowed * WEAK_SHARE),
    }
    detail = Detail(**(settings | dict(asked)))
    bodies = any(isinstance(target, Motion) for target in model.targets)
    full = with_method(model, "mesh") if bodies and model.method == "ellipsoid" else model
    omissions = _in_time(model, detail, asked)
    if any(isinstance(shape, MovingMesh) for shape in full.shapes):
        detail = replace(detail, coarser=_coarser(full, allowed * FACETS_SHARE))
        # What hides what shows over the strong pairs.
        chirps = Chirps.random(model.radar, model.span_s, seed=model.seed, count=CHIRPS)
        strong = replace(
            detail, coarser=max(detail.coarser, LOOKED_AT_COARSER), least_db=max(detail.strong_db, LOOKED_AT_DB),
            occlusion=True, occlusion_halved=MOST_HALVED,
        )  # fmt: skip
        left = allowed * LOOKS_SHARE
        nothing = probed(full, replace(strong, occlusion=False), chirps)
        fine = probed(full, replace(strong, occlusion_halved=0), chirps, looks_hz=FIRST_LOOK_HZ)
        if nmse_db(nothing, fine) > _db(left) - CLEARLY_DB:
            fine = probed(full, strong, chirps)
        if bodies:
            error = nmse_db(probed(with_method(full, "ellipsoid"), strong, chirps), fine)
            free = not asked and model.sagitta_rad is None and all(isinstance(t, Motion) for t in model.targets)
            simpler = Omission(
                "the skin: limbs by ellipsoids", error, full is not model or (free and error <= _db(allowed))
            )
            omissions.append(simpler)
            if simpler.taken:
                return _checked(Plan(with_method(full, "ellipsoid"), float(tolerance_db), detail, omissions))
        looks, found = _looks(full, strong, chirps, nmse_db(nothing, fine), fine, left, asked)
        detail = replace(detail, **looks)
        # Where looks cannot do what they should, facets make up for it.
        spent = sum(10 ** (each.error_db / 10) for each in found if each.taken)
        share = float(np.clip(0.9 - spent / allowed, LEAST_SHARE, FACETS_SHARE)) * allowed
        detail = replace(detail, coarser=_coarser(full, share))
        omissions += [_facets(full, detail), *found]
    return _checked(Plan(model, float(tolerance_db), detail, omissions + _fewer_ways(model, detail)))


def _checked(plan: Plan) -> Plan:
    """Warns where a tolerance is not in reach."""
    if plan.error_db > plan.tolerance_db + OVER_DB:
        worst = max((each for each in plan.omissions if each.taken), key=lambda each: each.error_db)
        warnings.warn(
            f"a tolerance of {plan.tolerance_db:g} dB is not in reach, {plan.error_db:.1f} dB is: {worst.what} alone cost "
            f"{worst.error_db:.1f} dB; ask for less, or leave the settings to the tolerance",
            T2DWarning,
            stacklevel=4,
        )
    return plan


def _in_time(model: Model, detail: Detail, asked: Mapping[str, Any]) -> list[Omission]:
    """What interpolation between surface frames and the merging of echoes may add."""
    splines_db = detail.splines_db
    if (given_hz := asked.get("surface_rate_hz")) is not None:
        # A cubic's error falls with the fourth power of its step.
        needed_hz = max(model.rates_hz(Detail()))
        splines_db = SPLINES_DB + 80 * math.log10(needed_hz / given_hz)
    return [
        Omission("motion between surface frames, by splines", splines_db, True),
        Omission("the sum of echoes, merged", detail.synthesis_db, True),
    ]


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


def _coarser(model: Model, share: float) -> float:
    """Phase sagitta over the meshes' own at which facets err by that share of the field's energy; 1 where it is the user's."""
    if model.sagitta_rad is not None:
        return 1.0
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
    model: Model,
    detail: Detail,
    chirps: Chirps,
    nothing_db: float,
    fine: np.ndarray,
    left: float,
    asked: Mapping[str, Any],
) -> tuple[dict[str, Any], list[Omission]]:
    """Whether, how often and from where to look at what hides what, at an error of `left`; not to look costs `nothing_db`."""
    unwanted = not asked.get("occlusion", True)
    found = [Omission(HIDDEN, nothing_db, unwanted or (nothing_db <= _db(left) and "occlusion_hz" not in asked))]
    if found[0].taken:
        return {"occlusion": False}, found
    ladder = [(detail.occlusion_hz, n) for n in range(MOST_HALVED + 1)] if "occlusion_hz" in asked else LOOKS
    for rate_hz, halved in ladder:
        error = nmse_db(probed(model, replace(detail, occlusion_halved=halved), chirps, looks_hz=rate_hz), fine)
        found.append(Omission(f"shadows' edges, {_looked(rate_hz, halved)}", error, False))
        if error <= _db(left):
            best = len(found) - 1
            break
    else:
        best = min(range(1, len(found)), key=lambda n: found[n].error_db)
    found[best] = replace(found[best], taken=True)
    rate_hz, halved = ladder[best - 1]
    return {"occlusion_hz": rate_hz, "occlusion_halved": halved}, found


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
    if model.method == "mesh":
        looks = _looked(detail.occlusion_hz, detail.occlusion_halved) if detail.occlusion else "not looked at"
        lines.append(f"  {HIDDEN}: {looks}")
    fastest = max(farthest_and_fastest(shape, radar, model.span_s)[1] for shape in model.shapes)
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


def _looked(rate_hz: float, halved: int) -> str:
    corners = ("", ", edges halved", ", edges quartered")[halved]
    return f"{rate_hz:g} looks a second from meshes' corners{corners}"


def _db(ratio: float) -> float:
    return 10 * math.log10(max(ratio, 1e-30))
