"""The laws by which an accuracy is chosen for a tolerance, fitted to the engine's own far finer fields.

`python -m validation.methods.laws` measures and writes `t2d_rt/accuracy/laws.json`; with the names of `PARTS` behind it only these
are measured again. None of these cases is one of those by which tolerances are judged (`validation.methods.tolerance`).
"""

from __future__ import annotations

import json
import math
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import t2d_rt as t2d
from t2d_rt.accuracy import cost
from t2d_rt.accuracy.budget import BODY_SAGITTA_RAD
from t2d_rt.accuracy.error_laws import COARSER, FILE, PERIMETER, Law, Laws
from t2d_rt.accuracy.estimate import Chirps, Field, field, nmse_db, of_cube
from t2d_rt.accuracy.occlusion import Occluded
from t2d_rt.accuracy.search import VISIBILITY
from t2d_rt.core.errors import T2DWarning
from t2d_rt.pipeline.echo_model import Model, with_method
from t2d_rt.pipeline.prepare import prepare
from t2d_rt.propagation.visibility import sample_times
from t2d_rt.simulate import summed
from t2d_rt.types import Accuracy, MovingMesh, PathTier
from t2d_rt.types.accuracy import EVERY_PATH_DB
from validation.bodies import RUN, WALK, falling, recorded
from validation.methods.models import modelled
from validation.methods.times import fitted_cost, runs, timed
from validation.physics.rcs import sphere
from validation.report import Section, at_most, new_figure, save_chart

MEASURED = Path(__file__).with_name("laws.json")
JACKS, SHORT = "14_14_jumping_jacks.bvh", "momask_22j_120frames.bvh"
SCALES = tuple(math.sqrt(COARSER) ** n for n in range(-3, 5))
"""Of the meshes' own phase sagitta; each third one is `COARSER` times the first."""
SMOOTH_SCALES = tuple(math.sqrt(COARSER) ** n for n in range(8))
FINEST, SMOOTH_FINEST = 0.1, 0.25
SMOOTH_SAGITTA_RAD = 0.07
CHIRPS, ROOM_CHIRPS = 24, 10
FINER_SHADOWS = 0.4
"""Sagitta scale of facets at whose vertices what occlusion takes is traced."""
COUNTS_ABOVE_DB, EDGES_ABOVE_DB = -30.0, -20.0
"""Where occlusion costs less, nothing is learnt from it, and nothing of its edges: a fall whose shadows cost -23 dB has edges that
err by -37 dB, which made their law scatter by 4.1 dB in place of 2.7."""
LEVELS_DB = 0.0, -12.0, -18.0, -24.0, -30.0, -40.0
ALL = Accuracy(occlusion=False, tiers=(PathTier(level_db=EVERY_PATH_DB),))
EXACT = ALL.replace(occlusion=True, visibility_subdivision=2)


def motions() -> dict[str, Callable[[], Any]]:
    """What the laws are fitted to."""
    return {
        "walk": lambda: t2d.trim(recorded(WALK), 0.5, 2.5),
        "later": lambda: t2d.trim(recorded(WALK), 2.3, 4.3),
        "walk at 50 degrees": lambda: t2d.trim(recorded(WALK, 50.0), 1.0, 3.0),
        "walk at 110 degrees": lambda: t2d.trim(recorded(WALK, 110.0), 1.0, 3.0),
        "walk away": lambda: t2d.trim(recorded(WALK, 180.0), 1.0, 3.0),
        "run": lambda: recorded(RUN),
        "run at 70 degrees": lambda: recorded(RUN, 70.0),
        "walk at 80 degrees": lambda: t2d.trim(recorded(WALK, 80.0), 1.5, 3.5),
        "run at 110 degrees": lambda: recorded(RUN, 110.0),
        "jumping jacks at 60 degrees": lambda: t2d.trim(recorded(JACKS, 60.0), 0.2, 2.2),
        "short walk at 90 degrees": lambda: t2d.trim(recorded(SHORT, 90.0), 0.2, 1.9),
        "jumping jacks": lambda: t2d.trim(recorded(JACKS), 0.5, 2.5),
        "short walk": lambda: t2d.trim(recorded(SHORT), 0.2, 1.9),
        "fall": falling,
    }


def smooth_bodies() -> dict[str, Callable[[], Any]]:
    """Stretched spheres, whose own meshes are coarse: radius [m], subdivisions of an icosahedron, and stretch."""
    shapes = (
        (0.15, 2, (1, 1, 1)),
        (0.25, 2, (1, 1, 1)),
        (0.1, 2, (1, 1, 3)),
        (0.2, 2, (0.5, 1, 2)),
        (0.12, 1, (1, 1.5, 0.7)),
    )
    return {f"spheroid {number}": lambda shape=shape: _spheroid(*shape) for number, shape in enumerate(shapes, 1)}  # type: ignore[misc]


ROOMS = (("walk", "empty_room"), ("run", "living_room"), ("fall", "corridor"), ("walk at 50 degrees", "living_room"))


def _spheroid(radius_m: float, subdivisions: int, stretch: tuple[float, float, float]) -> MovingMesh:
    times = np.linspace(0, 0.5, 11)
    vertices, faces = sphere(radius_m, np.zeros(3), subdivisions=subdivisions)
    vertices = vertices * stretch + np.array((2.5, 0.1, 1.0))
    return MovingMesh(vertices + times[:, None, None] * np.array((1.0, 0.2, 0)), faces, times, "pec")


def facets(model: Model, chirps: Chirps, scales: Sequence[float], finest_scale: float) -> dict[str, list[float]]:
    """Errors of facets, and what they differ by from coarser ones [dB]."""
    finest = field(model, ALL.replace(sagitta_scale=finest_scale), chirps)
    fields = [field(model, ALL.replace(sagitta_scale=scale), chirps) for scale in scales]
    return {
        "facets_db": [nmse_db(each, finest) for each in fields],
        "coarser_db": [nmse_db(fields[i + 2], fields[i]) for i in range(len(scales) - 2)],
    }


def of_smooth(name: str) -> dict[str, Any]:
    """Errors of the facets of a smooth body [dB]."""
    model = modelled(smooth_bodies()[name]())
    chirps = Chirps.random(model.radar, model.span_s, seed=11, count=CHIRPS)
    return {"case": name, **facets(model, chirps, SMOOTH_SCALES, SMOOTH_FINEST)}


def of_body(name: str) -> dict[str, Any]:
    """Errors of facets, of ellipsoids and of no occlusion [dB]."""
    model = modelled(motions()[name]())
    chirps = Chirps.random(model.radar, model.span_s, seed=11, count=CHIRPS)
    finest, own = (field(model, ALL.replace(sagitta_scale=scale), chirps) for scale in (FINEST, 1.0))
    limbs = field(with_method(model, "ellipsoid"), ALL, chirps)
    traced = field(model, EXACT, chirps)
    return {
        "case": name, **facets(model, chirps, SCALES, FINEST),
        "limbs_db": nmse_db(limbs, finest), "limbs_power_db": _power_db(limbs, finest),
        "unoccluded_db": nmse_db(own, traced), "unrefined_db": Occluded.of(model, Accuracy()).level_db(),
    }  # fmt: skip


def shadows(name: str) -> dict[str, Any]:
    """Errors of runs whose visibility is sampled in each way, or that trace no occlusion, last; and what coarser facets show of
    them [dB].

    What occlusion takes is traced at the vertices of far finer facets: those of a run blur shadows' edges, too.
    """
    model = modelled(motions()[name]())
    chirps = Chirps.random(model.radar, model.span_s, seed=11, count=CHIRPS)
    finer, coarser = (ALL.replace(sagitta_scale=scale) for scale in (FINER_SHADOWS, COARSER))
    seen, seen_coarser = (
        field(model, EXACT.replace(sagitta_scale=each.sagitta_scale), chirps) for each in (finer, coarser)
    )
    taken = field(model, finer, chirps) - seen

    def of_run(accuracy: Accuracy) -> np.ndarray:
        cube = summed(prepare(model, accuracy, "none"), "auto", None)
        return of_cube(model, cube, [], chirps)

    whole, found, direct = of_run(ALL), [], []
    for rate_hz, subdivision in VISIBILITY:
        sampled = EXACT.replace(visibility_rate_hz=rate_hz, visibility_subdivision=subdivision)
        found.append(_power_db(whole - of_run(sampled) - taken, seen))
        samples_s = sample_times(*model.span_s, rate_hz)
        again = Field(model, sampled.replace(sagitta_scale=COARSER), chirps, samples_s=samples_s).samples()
        direct.append(_power_db(again - seen_coarser, seen_coarser))
    found.append(_power_db(taken, seen))
    direct.append(_power_db(field(model, coarser, chirps) - seen_coarser, seen_coarser))
    return {"case": name, "sampled_db": found, "direct_db": direct}


def in_room(name: str, scene: str) -> dict[str, Any]:
    """Power of path pairs by their level, and errors of ellipsoids over them [dB]."""
    model = modelled(motions()[name](), scene)
    chirps = Chirps.random(model.radar, model.span_s, seed=12, count=ROOM_CHIRPS)
    levels = np.array([each.mean_db for each in model.ranked])
    power = 10 ** (levels / 10)
    down_to = [field(model, ALL.replace(least_level_db=level), chirps) for level in LEVELS_DB]
    found: dict[str, Any] = {"case": name, "scene": scene, "levels": []}
    for i, (high, low) in enumerate(pairwise(LEVELS_DB)):
        these = (levels < high) & (levels >= low)
        if not these.any():
            continue
        exact = down_to[i + 1] - down_to[i]
        tiers = (
            PathTier(level_db=high),
            PathTier(level_db=EVERY_PATH_DB, scatterer="ellipsoids", visibility="blockage"),
        )
        limbs = field(model, ALL.replace(least_level_db=low, tiers=tiers), chirps) - down_to[i]
        found["levels"].append({
            "below_db": high, "said_db": 10 * math.log10(power[these].sum() / power.sum()),
            "power_db": _power_db(exact, down_to[-1]), "limbs_db": nmse_db(limbs, exact), "limbs_power_db": _power_db(limbs, exact),
        })  # fmt: skip
    return found


def _power_db(one: np.ndarray, other: np.ndarray) -> float:
    return 10 * float(np.log10(np.sum(np.abs(one) ** 2) / np.sum(np.abs(other) ** 2)))


def fitted(measured: dict[str, Any]) -> dict[str, Any]:
    """The laws."""
    bodies, rooms = measured["bodies"], measured["rooms"]
    cost_of_none = {each["case"]: each for each in bodies}
    shaded = [each for each in measured["shadows"] if cost_of_none[each["case"]]["unoccluded_db"] > EDGES_ABOVE_DB]
    sampled = np.array([
        np.array(each["sampled_db"][:-1]) - PERIMETER * cost_of_none[each["case"]]["unoccluded_db"] for each in shaded
    ])  # fmt: skip
    direct = np.array([np.subtract(each["sampled_db"], each["direct_db"]) for each in measured["shadows"]])
    occluded = [cost_of_none[each["case"]] for each in measured["shadows"]]
    levels = [each for room in rooms for each in room["levels"]]
    return {
        "bodies": _facet_law(bodies, SCALES, BODY_SAGITTA_RAD),
        "smooth": _facet_law(measured["smooth"], SMOOTH_SCALES, SMOOTH_SAGITTA_RAD),
        "occlusion": _law_of([each["unoccluded_db"] - each["unrefined_db"] for each in occluded]),
        "edges": [
            {"rate_hz": rate, "subdivision": n, **_law_of(column)} for (rate, n), column in zip(VISIBILITY, sampled.T, strict=True)
        ],
        "direct": [
            {"rate_hz": rate, "subdivision": n, **_law_of(column)}
            for (rate, n), column in zip(VISIBILITY, direct.T[:-1], strict=True)
        ],
        "direct_unoccluded": _law_of(direct.T[-1]),
        "limbs": _law_of([each["limbs_db"] for each in (*bodies, *levels)]),
        "limbs_power": _law_of([each["limbs_power_db"] for each in (*bodies, *levels)]),
        "pairs": _law_of([each["power_db"] - each["said_db"] for each in levels]),
        "cost": fitted_cost(measured["times"]),
    }  # fmt: skip


def _facet_law(cases: list[dict[str, Any]], scales: Sequence[float], sagitta_rad: float) -> dict[str, Any]:
    """Means over cases, and their scatter where facets are neither near the finest nor useless."""
    error, coarser = (np.array([each[name] for each in cases]) for name in ("facets_db", "coarser_db"))
    middle = slice(1, 5)
    own, beside = error[:, middle], error[:, middle] - coarser[:, middle]
    deviations = [(each - each.mean(axis=0)).ravel() for each in (own, beside)]

    def scatter(values: np.ndarray) -> float:
        return float(values.std(axis=0, ddof=1).mean())

    return {
        "sagitta_rad": [sagitta_rad * scale for scale in scales],
        # Coarser facets never err less; means of a few cases may say so.
        "facets_db": np.maximum.accumulate(error.mean(axis=0)).tolist(),
        "coarser_db": np.maximum.accumulate(coarser.mean(axis=0)).tolist(),
        "scatter_db": scatter(own), "difference_scatter_db": scatter(coarser[:, middle]), "ratio_scatter_db": scatter(beside),
        "correlation": float(np.corrcoef(*deviations)[0, 1]),
    }  # fmt: skip


def _law_of(values: Any) -> dict[str, float]:
    return {"mean_db": float(np.mean(values)), "scatter_db": float(np.std(values, ddof=1))}


def run() -> Section:
    """How far the laws of the package are from their own measurements."""
    measured = json.loads(MEASURED.read_text())
    times, laws, stored = measured["times"], Laws.of(fitted(measured)), Laws.fitted()
    factors = [math.exp(abs(math.log(cost.seconds(each["work"], laws) / each["taken"]))) for each in times]
    apart = float(np.max(np.abs(laws.bodies.facets_db - stored.bodies.facets_db)))
    checks = [
        at_most("the package's law of facets beside that of these measurements", apart, 0.01, "dB"),
        at_most("scatter of facets' errors about the law", laws.bodies.scatter_db, 2.0, "dB"),
        at_most("of the cost of no occlusion, where it counts", laws.occlusion.scatter_db, 3.0, "dB"),
        at_most("of path pairs' power", laws.pairs.scatter_db, 3.0, "dB"),
        at_most(
            "times taken over those of the law or the other way round, 9 of 10",
            float(np.quantile(factors, 0.9)),
            1.5,
            "times",
        ),
    ]
    return Section(
        title="Laws of error and cost",
        checks=checks,
        note="What `plan` and tolerances go by. Errors of single simplifications, each against the engine's own far finer field at "
        f"{CHIRPS} random chirps ({ROOM_CHIRPS} in rooms); times of runs over a yardstick's, refinement included. "
        "`python -m validation.methods.laws` measures again and fits.",
        table=[{"law": name, "mean, dB": law.mean_db, "scatter, dB": law.scatter_db} for name, law in _single(laws)],
        charts=[_chart(measured, laws)],
    )


def _single(laws: Laws) -> Iterator[tuple[str, Law]]:
    for what, law, own_rad in (
        ("bodies", laws.bodies, BODY_SAGITTA_RAD),
        ("smooth meshes", laws.smooth, SMOOTH_SAGITTA_RAD),
    ):
        yield f"facets of {what}, at {own_rad:g} rad", Law(law.error_db(own_rad), law.scatter_db)
        yield "the same beside coarser ones", Law(law.difference_db(own_rad), law.difference_scatter_db)
    yield "no occlusion, beside what unrefined meshes show", laws.occlusion
    for (rate_hz, n), edges in laws.edges.items():
        yield f"visibility at {rate_hz:g} Hz, {n} subdivisions, over the root of no occlusion's", edges
    for (rate_hz, n), direct in laws.direct.items():
        yield f"the same at {rate_hz:g} Hz, {n} subdivisions, over what coarser facets show", direct
    yield "no occlusion, over what coarser facets show", laws.direct_unoccluded
    yield "ellipsoids, over the power of their path pairs", laws.limbs
    yield "power of ellipsoids over that of the skin", laws.limbs_power
    yield "power of path pairs over what probes say", laws.pairs


def _chart(measured: dict[str, Any], laws: Laws) -> str:
    figure, (left, right) = new_figure(ncols=2, figsize=(11, 4.5))
    for cases, scales, own_rad, law, colour, name in (
        (measured["bodies"], SCALES, BODY_SAGITTA_RAD, laws.bodies, "C0", "bodies"),
        (measured["smooth"], SMOOTH_SCALES, SMOOTH_SAGITTA_RAD, laws.smooth, "C1", "smooth meshes"),
    ):
        for each in cases:
            left.semilogx(own_rad * np.array(scales), each["facets_db"], ".-", color=colour, linewidth=0.5, alpha=0.4)
        left.semilogx(law.sagitta_rad, law.facets_db, colour, linewidth=2, label=f"law for {name}")
    left.set(xlabel="phase sagitta of facets [rad]", ylabel="field NMSE [dB]", title="errors of facets, and their laws")
    left.legend()
    times = measured["times"]
    said, taken = [cost.seconds(each["work"], laws) for each in times], [each["taken"] for each in times]
    ends = min(*said, *taken), max(*said, *taken)
    right.fill_between(ends, [end / 1.5 for end in ends], [end * 1.5 for end in ends], color="0.9", label="within 1.5")
    right.loglog(said, taken, ".")
    right.set(xlabel="predicted [yardsticks]", ylabel="taken [yardsticks]", title="seconds of runs")
    right.legend()
    for axis in (left, right):
        axis.grid(alpha=0.3)
    return save_chart(figure, "laws.png")


PARTS: dict[str, Callable[[], list[dict[str, Any]]]] = {
    "bodies": lambda: [of_body(name) for name in motions()],
    "smooth": lambda: [of_smooth(name) for name in smooth_bodies()],
    "shadows": lambda: [shadows(each["case"]) for each in _read()["bodies"] if each["unoccluded_db"] > COUNTS_ABOVE_DB],
    "rooms": lambda: [in_room(*case) for case in ROOMS],
    "times": lambda: _read().get("times", [])[-len(list(runs())) :] + [timed(each) for each in runs()],
}
"""What the laws are fitted to, by its name in the file; of times the last two passes, for a machine's yardstick tells its speed at
other work within 1.5 from day to day."""


def _read() -> dict[str, Any]:
    return json.loads(MEASURED.read_text()) if MEASURED.exists() else {}  # type: ignore[no-any-return]


def measure(parts: Sequence[str]) -> None:
    """Measures these parts again, and fits all laws."""
    for part in parts:
        found = PARTS[part]()
        MEASURED.write_text(json.dumps(_read() | {part: found}, indent=1) + "\n")
    FILE.write_text(json.dumps(fitted(_read()), indent=1) + "\n")


if __name__ == "__main__":
    warnings.simplefilter("ignore", T2DWarning)
    measure(sys.argv[1:] or list(PARTS))
