"""The laws by which an accuracy is chosen for a tolerance, fitted to the engine's own far finer fields.

`python -m validation.methods.laws` measures and writes `t2d_rt/accuracy/laws.json`; with `cost` behind it only the times are taken
again. None of these cases is one of those by which tolerances are judged (`validation.methods.tolerance`).
"""

from __future__ import annotations

import json
import math
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from dataclasses import field as field_of
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import nnls

import t2d_rt as t2d
from t2d_rt.accuracy import cost
from t2d_rt.accuracy.estimate import Chirps, field, nmse_db
from t2d_rt.accuracy.laws import COARSER, FILE, PERIMETER, Law, Laws
from t2d_rt.accuracy.occlusion import unoccluded_db
from t2d_rt.backend import yardstick_s
from t2d_rt.errors import T2DWarning
from t2d_rt.experiment import Experiment
from t2d_rt.memory import LIMIT_GB
from t2d_rt.model import Model, with_method
from t2d_rt.propagation.visibility import sample_times
from t2d_rt.signal import spectrogram
from t2d_rt.stage import set_up
from t2d_rt.summation import summed
from t2d_rt.types import Accuracy, MovingMesh, PathTier, Radar
from t2d_rt.types.accuracy import EVERY_PATH_DB
from validation.bodies import RUN, WALK, falling, recorded
from validation.physics.rcs import sphere
from validation.report import Check, Section, new_figure, save_chart

MEASURED = Path(__file__).with_name("laws.json")
JACKS, SHORT = "14_14_jumping_jacks.bvh", "momask_22j_120frames.bvh"
SCALES = tuple(math.sqrt(COARSER) ** n for n in range(-2, 6))
"""Of the meshes' own phase sagitta; each third one is `COARSER` times the first."""
SPHERE_SCALES = SCALES[3:]
FINEST, SPHERE_FINEST = 0.2, 0.4
BODY_SAGITTA_RAD, SPHERE_SAGITTA_RAD = 0.3, 0.07
CHIRPS, ROOM_CHIRPS = 24, 10
SAMPLED = (12.5, 0), (25.0, 0), (50.0, 0), (50.0, 1), (100.0, 1), (100.0, 2)
"""Rates [Hz] and subdivisions of visibility."""
FINER_SHADOWS = 0.4
"""Sagitta scale of facets at whose vertices what occlusion takes is traced."""
COUNTS_ABOVE_DB = -30.0
"""Where occlusion costs less, nothing is learnt from its edges."""
LEVELS_DB = 0.0, -12.0, -18.0, -24.0, -30.0, -40.0
ALL = Accuracy(occlusion=False, tiers=(PathTier(level_db=EVERY_PATH_DB),))


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
        "sphere": lambda: _sphere(0.15),
        "greater sphere": lambda: _sphere(0.25),
    }


ROOMS = (("walk", "empty_room"), ("run", "living_room"), ("fall", "corridor"), ("walk at 50 degrees", "living_room"))


def _sphere(radius_m: float) -> MovingMesh:
    times = np.linspace(0, 0.5, 11)
    vertices, faces = sphere(radius_m, np.array((2.5, 0.1, 1.0)), subdivisions=3)
    return MovingMesh(vertices + times[:, None, None] * np.array((1.0, 0.2, 0)), faces, times, "pec")


def modelled(target: Any, scene: str = "free_space", **physics: Any) -> Model:
    """The model of a target at hand, as `simulate` has it."""
    options = {
        name: each.default
        for name, each in Experiment.model_fields.items()
        if name not in ("targets", "radar", "scene")
    }
    radar = physics.pop("radar", None)
    options |= {"clutter": "none", "collisions": "ignore", **physics}
    return set_up(target, radar, scene, options, device="auto", memory_gb=LIMIT_GB).model


def in_free_space(name: str) -> dict[str, Any]:
    """Errors of facets, of ellipsoids, of no occlusion and of sampled visibility [dB]."""
    model = modelled(motions()[name]())
    chirps = Chirps.random(model.radar, model.span_s, seed=11, count=CHIRPS)
    smooth = "sphere" in name
    scales = SPHERE_SCALES if smooth else SCALES
    finest = field(model, ALL.replace(sagitta_scale=SPHERE_FINEST if smooth else FINEST), chirps)
    fields = [field(model, ALL.replace(sagitta_scale=scale), chirps) for scale in scales]
    found: dict[str, Any] = {
        "case": name, "facets_db": [nmse_db(each, finest) for each in fields],
        "coarser_db": [nmse_db(fields[i + 2], fields[i]) for i in range(len(scales) - 2)],
    }  # fmt: skip
    if smooth:
        return found
    limbs = field(with_method(model, "ellipsoid"), ALL, chirps)
    found |= {"limbs_db": nmse_db(limbs, finest), "limbs_power_db": _power_db(limbs, finest)}
    exact = ALL.replace(occlusion=True, visibility_subdivision=2)
    traced = field(model, exact, chirps)
    found |= {"unoccluded_db": nmse_db(fields[2], traced), "unrefined_db": unoccluded_db(model, Accuracy())}
    if found["unoccluded_db"] > COUNTS_ABOVE_DB:
        found["sampled_db"] = sampled(model, chirps, fields[2])
    return found


def sampled(model: Model, chirps: Chirps, whole: np.ndarray) -> list[float]:
    """Errors of visibility sampled in each way, of what occlusion takes from the `whole` field.

    What it takes is traced at the vertices of far finer facets: those of a run blur shadows' edges, too.
    """
    exact = ALL.replace(occlusion=True, visibility_subdivision=2)
    finer = ALL.replace(sagitta_scale=FINER_SHADOWS)
    seen = field(model, exact.replace(sagitta_scale=FINER_SHADOWS), chirps)
    taken = field(model, finer, chirps) - seen
    found = []
    for rate_hz, subdivision in SAMPLED:
        accuracy, samples_s = exact.replace(visibility_subdivision=subdivision), sample_times(*model.span_s, rate_hz)
        wrong = whole - field(model, accuracy, chirps, samples_s=samples_s) - taken
        found.append(_power_db(wrong, seen))
    return found


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


def fitted(free: list[dict[str, Any]], rooms: list[dict[str, Any]]) -> dict[str, Any]:
    """The laws but for the cost."""
    bodies, smooth = ([each for each in free if ("sphere" in each["case"]) == kind] for kind in (False, True))
    facets, coarser = (np.array([each[name] for each in bodies]) for name in ("facets_db", "coarser_db"))
    known = coarser.shape[1]
    table = facets.mean(axis=0)
    sagittas = np.log(SPHERE_SAGITTA_RAD * np.array(SPHERE_SCALES))
    of_body = np.interp(sagittas, np.log(BODY_SAGITTA_RAD * np.array(SCALES)), table)
    beside = np.concatenate([np.array(each["facets_db"]) - of_body for each in smooth])
    of_body = np.interp(sagittas[:-2], np.log(BODY_SAGITTA_RAD * np.array(SCALES[:known])), coarser.mean(axis=0))
    coarser_beside = np.concatenate([np.array(each["coarser_db"]) - of_body for each in smooth])
    occluded = [each for each in bodies if "sampled_db" in each]
    sampled = np.array([np.array(each["sampled_db"]) - PERIMETER * each["unoccluded_db"] for each in occluded])
    levels = [each for room in rooms for each in room["levels"]]
    return {
        "facets": {
            "sagitta_rad": [BODY_SAGITTA_RAD * scale for scale in SCALES[:known]],
            "facets_db": table[:known].tolist(), "coarser_db": coarser.mean(axis=0).tolist(),
            "scatter_db": float(facets[:, 1:5].std(axis=0).mean()),
        },
        "smooth": _law_of(beside),
        "smooth_coarser": _law_of(coarser_beside),
        "occlusion": _law_of([each["unoccluded_db"] - each["unrefined_db"] for each in occluded]),
        "edges": [
            {"rate_hz": rate, "subdivision": n, **_law_of(column)} for (rate, n), column in zip(SAMPLED, sampled.T, strict=True)
        ],
        "limbs": _law_of([each["limbs_db"] for each in (*bodies, *levels)]),
        "limbs_power": _law_of([each["limbs_power_db"] for each in (*bodies, *levels)]),
        "pairs": _law_of([each["power_db"] - each["said_db"] for each in levels]),
    }  # fmt: skip


def _law_of(values: Any) -> dict[str, float]:
    return {"mean_db": float(np.mean(values)), "scatter_db": float(np.std(values))}


# --- seconds ---


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
            yield Run("walk", length_s, scene, ONE_TIER | {"occlusion": False, "sagitta_scale": 2.0}, CLUTTER)
    yield Run("run", 1.3, "living_room", TWO_TIERS | {"sagitta_scale": 1.5, "visibility_rate_hz": 12.5})
    yield Run("run", 1.3, "corridor", ONE_TIER | {"visibility_rate_hz": 50.0}, CLUTTER)


def timed(each: Run) -> dict[str, Any]:
    """Seconds of a run over the yardstick's, from the set model to the spectrogram, and the units of work in it."""
    motion = recorded(WALK if each.name == "walk" else RUN)
    target = t2d.trim(motion, 0.2, 0.2 + each.length_s) if each.name == "walk" else t2d.trim(motion, 0.0, each.length_s)
    radar, taken = Radar.preset(each.radar), []
    for number in range(3):  # the first one compiles; each refines anew, for scales that differ a little
        model = modelled(target, each.scene, radar=radar, **each.physics)
        accuracy = Accuracy(**each.accuracy)
        accuracy = accuracy.replace(sagitta_scale=accuracy.sagitta_scale * (1 + 1e-3 * number))
        yardstick, start = yardstick_s(model.backend), time.perf_counter()
        static, _ = model.clutter(each.physics.get("clutter", "none"), accuracy)
        streams = model.streams(accuracy)
        cube = summed(streams, static, radar, accuracy, device="auto", memory=model.memory)
        spectrogram(cube, radar)
        taken.append((time.perf_counter() - start) / yardstick)
    units = cost.work(model, accuracy, cost.facet_counts(model, accuracy), each.physics.get("clutter", "none"))
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
    """Seconds of each kind of work, none negative, that err least in proportion."""
    kinds = list(times[0]["work"])
    taken = np.array([each["taken"] for each in times])
    units = np.array([[each["work"][kind] for kind in kinds] for each in times])
    found, _ = nnls(units / taken[:, None], np.ones(len(taken)))
    return {
        "seconds": dict(zip(kinds, found.tolist(), strict=True)),
        "scatter": float(np.std(np.log(units @ found / taken))),
    }


def run() -> Section:
    """How far the laws of the package are from their own measurements."""
    measured = json.loads(MEASURED.read_text())
    free, rooms, times = measured["free"], measured["rooms"], measured["times"]
    laws = Laws.of(fitted(free, rooms) | {"cost": fitted_cost(times)})
    stored = Laws.fitted()
    factors = [math.exp(abs(math.log(cost.seconds(each["work"], laws) / each["taken"]))) for each in times]
    apart = float(np.max(np.abs(laws.facets_db - stored.facets_db)))
    checks = [
        Check(what="the package's law of facets beside that of these measurements", measured=apart, limit=0.01, unit="dB"),
        Check(what="scatter of facets' errors about the law", measured=laws.scatter_db, limit=2.0, unit="dB"),
        Check(what="of the cost of no occlusion, where it counts", measured=laws.occlusion.scatter_db, limit=3.0, unit="dB"),
        Check(what="of path pairs' power", measured=laws.pairs.scatter_db, limit=3.0, unit="dB"),
        Check(what="times taken over those of the law or the other way round, 9 of 10",
              measured=float(np.quantile(factors, 0.9)), limit=1.5, unit="times"),
    ]  # fmt: skip
    return Section(
        title="Laws of error and cost",
        checks=checks,
        note="What `plan` and tolerances go by. Errors of single simplifications, each against the engine's own far finer field at "
        f"{CHIRPS} random chirps ({ROOM_CHIRPS} in rooms); times of runs over a yardstick's, refinement included. "
        "`python -m validation.methods.laws` measures again and fits.",
        table=[{"law": name, "mean, dB": law.mean_db, "scatter, dB": law.scatter_db} for name, law in _single(laws)],
        charts=[_chart(free, times, laws)],
    )


def _single(laws: Laws) -> Iterator[tuple[str, Law]]:
    yield "facets at their own phase sagitta", Law(laws.facets(BODY_SAGITTA_RAD), laws.scatter_db)
    yield "facets of spheres, beside a body's", laws.smooth
    yield "no occlusion, beside what unrefined meshes show", laws.occlusion
    for (rate_hz, n), law in laws.edges.items():
        yield f"visibility at {rate_hz:g} Hz, {n} subdivisions, over the root of no occlusion's", law
    yield "ellipsoids, over the power of their path pairs", laws.limbs
    yield "power of ellipsoids over that of the skin", laws.limbs_power
    yield "power of path pairs over what probes say", laws.pairs


def _chart(free: list[dict[str, Any]], times: list[dict[str, Any]], laws: Laws) -> str:
    figure, (left, right) = new_figure(ncols=2, figsize=(11, 4.5))
    for each in free:
        smooth = "sphere" in each["case"]
        scales = np.array(SPHERE_SCALES if smooth else SCALES) * (SPHERE_SAGITTA_RAD if smooth else BODY_SAGITTA_RAD)
        left.semilogx(
            scales[: len(each["facets_db"])], each["facets_db"], ".-", color="C1" if smooth else "0.7", linewidth=0.8
        )
    left.semilogx(laws.sagitta_rad, laws.facets_db, "C0", linewidth=2, label="law for bodies")
    left.set(
        xlabel="phase sagitta of facets [rad]",
        ylabel="field NMSE [dB]",
        title="ten motions (grey), two spheres (orange)",
    )
    left.legend()
    said, taken = [cost.seconds(each["work"], laws) for each in times], [each["taken"] for each in times]
    ends = min(*said, *taken), max(*said, *taken)
    right.fill_between(ends, [end / 1.5 for end in ends], [end * 1.5 for end in ends], color="0.9", label="within 1.5")
    right.loglog(said, taken, ".")
    right.set(xlabel="predicted [yardsticks]", ylabel="taken [yardsticks]", title="seconds of runs")
    right.legend()
    for axis in (left, right):
        axis.grid(alpha=0.3)
    return save_chart(figure, "laws.png")


def measure(*, errors: bool) -> dict[str, Any]:
    """All that the laws are fitted to, or the times alone beside what was measured before."""
    found = json.loads(MEASURED.read_text()) if MEASURED.exists() else {}
    if errors:
        found |= {"free": [in_free_space(name) for name in motions()], "rooms": [in_room(*case) for case in ROOMS]}
    return found | {"times": [timed(each) for each in runs()]}


if __name__ == "__main__":
    warnings.simplefilter("ignore", T2DWarning)
    now = measure(errors="cost" not in sys.argv[1:])
    MEASURED.write_text(json.dumps(now, indent=1) + "\n")
    laws = fitted(now["free"], now["rooms"]) | {"cost": fitted_cost(now["times"])}
    FILE.write_text(json.dumps(laws, indent=1) + "\n")
