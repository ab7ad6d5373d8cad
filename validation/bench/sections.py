"""What is measured, as sections of the report: the 10 s walk, sweeps of one variable each, presets, and where the time goes."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from typing import Any

import numpy as np

from t2d_rt.core.kernels import processor
from t2d_rt.core.plugins import versions
from t2d_rt.types import Radar
from t2d_rt.types.radar import preset_names
from validation.bench.measure import Case, import_seconds, sincos_rate
from validation.bench.stages import FACETS, STAGES, SYNTHESIS
from validation.report import Section, at_most

WALK_S = 10.0
WALK_LIMITS_S = {
    ("ellipsoid", "table2-uniform"): 0.5,
    ("ellipsoid", "table2"): 0.5,
    ("mesh", "table2-uniform"): 2.0,
    ("mesh", "table2"): 2.0,
}
ROOM, ROOM_LIMIT_S, ARRAY_LIMIT_S = "living_room", 6.0, 6.0
IMPORT_LIMIT_S, MEMORY_LIMIT_GB, MEMORY_GROWTH_LIMIT = 0.2, 2.0, 1.1
PAIR_LIMIT = 0.03
"""Time for each further path pair, relative to that of the direct one alone."""
EXPONENT_LIMIT = 1.05
ANTENNAS = ((1, 1), (3, 1), (3, 4), (12, 4), (12, 16))
SLOW_PRF_HZ, FAST_PRF_HZ, FAST_LIMIT = 1280.0, 12800.0, 3.0
PRESET_S = 0.25
ON_DISK_GB = 1.0
"""Memory of a run whose cube of 10 s, 0.2 GB, goes to disk."""
CROWD_LIMIT_S, FAN_LIMIT = 45.0, 0.1
"""The second is in seconds for each further second of a fan."""
Run = Callable[[Case], dict[str, Any]]
"""Measures a case."""
Found = list[dict[str, Any]]
"""What was measured of each of some cases."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """Cases of which one variable differs."""

    title: str
    variable: str
    """The measured figure that is the variable."""
    unit: str = ""
    cases: Sequence[Case]
    note: str
    limit: float | None = EXPONENT_LIMIT
    """Of the exponent of time; None for the chirp rate, which has another limit."""

    @property
    def axis(self) -> str:
        """The variable with its unit."""
        return self.title.lower() + (f" [{self.unit}]" if self.unit else "")

    def values(self, found: Found) -> list[float]:
        """The variable, case by case."""
        return [each[self.variable] for each in found]


def machine() -> Section:
    """What this ran on."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    memory_gb = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    facts = {
        "CPU": f"{processor()}, {cores} cores",
        "memory": f"{memory_gb:.0f} GB",
        "load before the run": f"{os.getloadavg()[0]:.1f}",
        "system": platform.platform(),
        "versions": ", ".join(f"{name} {number}" for name, number in versions().items()),
        "date": date.today().isoformat(),
    }
    return Section(title="Machine", checks=[], table=[{"": name, "is": fact} for name, fact in facts.items()])


def walk(run: Run, *, quick: bool) -> tuple[Section, Found]:
    """The 10 s walk by both models, and what twelve antennas cost."""
    limits = {case: limit for case, limit in WALK_LIMITS_S.items() if not quick or case[1] == "table2"}
    cases = [
        Case(name=f"{method}, {preset}", method=method, preset=preset, duration_s=WALK_S, runs=3)
        for method, preset in limits
    ]
    limits["mesh", ROOM] = ROOM_LIMIT_S
    cases.append(
        Case(name=f"mesh, table2-uniform, {ROOM}", preset="table2-uniform", scene=ROOM, duration_s=WALK_S, runs=3)
    )
    array = Radar.preset("array-3x4")
    one = {"tx_offsets_m": [[0, 0, 0]], "rx_offsets_m": [[0, 0, 0]], "multiplexing": "simultaneous"}
    one["prf_hz"] = array.prf_hz / len(array.tx_offsets_m)
    if not quick:
        limits["mesh", "array-3x4"] = ARRAY_LIMIT_S
        cases += [
            Case(name="mesh, array-3x4", preset="array-3x4", duration_s=WALK_S, runs=3),
            Case(name="the same, one antenna", preset="array-3x4", changes=one, duration_s=WALK_S, runs=3),
        ]
    found = [run(case) for case in cases]
    checks = [at_most("import t2d_rt", import_seconds(), IMPORT_LIMIT_S, "s")]
    for each, limit in zip(found, limits.values(), strict=False):
        checks += [
            at_most(each["name"], each["seconds"], limit, "s"),
            at_most(f"{each['name']}: peak memory", each["peak_gb"], MEMORY_LIMIT_GB, "GB"),
        ]
    table = [
        {
            "case": each["name"],
            "seconds": each["seconds"],
            "yardsticks": each["seconds"] / each["yardstick_s"],
            "peak memory [GB]": each["peak_gb"],
            **_work(each),
        }
        for each in found
    ]
    note = (
        "From a 10 s walk (cycles of CMU 12_01, repeated without a jump) to ADC cube and spectrogram, kernels warm and the body's "
        f"refinement kept from a run before, best of {'one' if quick else 'three'}, each case in a process of its own. A "
        "yardstick is 1e8 complex exponentials in NumPy, float64, in the same process. The one antenna sends with every row of "
        "the array's cube. In the room it is a walk on the spot, 3 m away, with all path pairs within 60 dB."
    )
    return Section(title="10 s walk", checks=checks, note=note, table=table), found


def sweeps(*, quick: bool) -> dict[str, Sweep]:
    """Sweeps by name: faces of a body and of a sphere, chirp rates, durations, antennas."""
    base_s = 1.0 if quick else 4.0

    def of(full: Sequence[Any], few: Sequence[Any]) -> Sequence[Any]:
        return few if quick else full

    found = {
        "faces": Sweep(
            title="Facets of a body",
            variable="facets",
            cases=[
                Case(name=f"sagitta {sagitta:g} rad", accuracy={"sagitta_rad": sagitta}, duration_s=base_s)
                for sagitta in of((2.0, 1.0, 0.5, 0.2, 0.12), (1.0, 0.25))
            ],
            note=f"Walk of {base_s:g} s, table2. The body has 6 402 faces unrefined; 2 rad is the coarsest that is taken.",
        ),
        "sphere": Sweep(
            title="Facets of a sphere",
            variable="facets",
            cases=[
                Case(name=f"sagitta {sagitta:g} rad", target="sphere", accuracy={"sagitta_rad": sagitta}, duration_s=base_s)
                for sagitta in (2.0, 0.7, 0.2, 0.07, 0.03)
            ],
            note=f"What the body cannot show, below 20 000 facets: a sphere of 15 cm that comes nearer for {base_s:g} s, table2.",
        ),
        "rates": Sweep(
            title="Chirp rate",
            variable="prf_hz",
            unit="Hz",
            cases=[
                Case(name=f"{rate:g} Hz", changes={"prf_hz": rate}, duration_s=base_s)
                for rate in of((1000.0, SLOW_PRF_HZ, 2560.0, 5120.0, 10240.0, FAST_PRF_HZ, 20000.0), (SLOW_PRF_HZ, FAST_PRF_HZ))
            ],
            note=f"Walk of {base_s:g} s, table2 at other rates.",
            limit=None,
        ),
        "durations": Sweep(
            title="Duration",
            variable="duration_s",
            unit="s",
            cases=[
                Case(name=f"{duration:g} s", preset="table2-uniform", duration_s=duration)
                for duration in of((1, 2, 5, 10, 20, 40, 60), (1, 3))
            ],
            note="The walk repeated, table2-uniform; a long one begins beyond the radar's 22 m and folds, which takes no longer.",
        ),
        **_antennas_and_pairs(base_s, of),
    }  # fmt: skip
    if quick:
        del found["sphere"]
    return found


def _antennas_and_pairs(base_s: float, of: Callable[[Sequence[Any], Sequence[Any]], Sequence[Any]]) -> dict[str, Sweep]:
    return {
        "antennas": Sweep(
            title="Antennas",
            variable="antennas",
            cases=[_antennas(*pair, duration_s=base_s / 8) for pair in of(ANTENNAS, ANTENNAS[1:3])],
            note=f"Walk of {base_s / 8:g} s, transmitters and receivers spread over the layout of imaging-12x16, all at once, "
            "4 167 rows per second. One antenna alone has no aperture, so its patches are larger, and fewer.",
        ),
        "pairs": Sweep(
            title="Path pairs",
            variable="pairs",
            cases=[
                Case(name=f"{db:g} dB", preset="table2-uniform", scene=ROOM, accuracy={"dynamic_range_db": db}, duration_s=base_s)
                for db in of((5.0, 15.0, 20.0, 25.0, 30.0, 60.0), (10.0, 60.0))
            ],
            note=f"Walk of {base_s:g} s on the spot in the {ROOM}, table2-uniform, with all path pairs within more and more dB.",
        ),
    }  # fmt: skip


def streamed(run: Run) -> tuple[Section, Found]:
    """What a long record takes in memory with its cube on disk."""
    found = [
        run(Case(name=f"{duration:g} s, on disk", duration_s=duration, memory_gb=ON_DISK_GB, runs=1))
        for duration in (10, 60)
    ]
    growth = found[1]["peak_gb"] / found[0]["peak_gb"]
    check = at_most("peak memory of 60 s against 10 s", growth, MEMORY_GROWTH_LIMIT, "times")
    table = [{"duration [s]": each["duration_s"], **_row(each)} for each in found]
    return Section(
        title="Large cubes", checks=[check], note="Walk, table2, the cube kept as products on disk.", table=table
    ), found


def swept(sweep: Sweep, run: Run) -> tuple[Section, Found]:
    """A sweep's figures and the exponents of its times."""
    found = [run(case) for case in sweep.cases]
    variable = sweep.values(found)
    if sweep.limit is None:
        summed = dict(zip(variable, synthesis_seconds(found), strict=True))
        ratio = summed[FAST_PRF_HZ] / summed[SLOW_PRF_HZ]
        check = at_most("synthesis at 12.8 kHz against 1.28 kHz", ratio, FAST_LIMIT, "times")
    else:
        power = power_law(variable, seconds(found)).power
        check = at_most(f"{sweep.title}: exponent of seconds", power, sweep.limit)
    checks = [check]
    if sweep.variable == "pairs":
        slope = (found[-1]["seconds"] - found[0]["seconds"]) / (variable[-1] - variable[0])
        each = slope / (found[0]["seconds"] - slope * (variable[0] - 1))
        checks.append(at_most("each further path pair, relative to the direct one alone", each, PAIR_LIMIT))
    table = [{sweep.axis: value, **_row(each)} for value, each in zip(variable, found, strict=True)]
    return Section(title=sweep.title, checks=checks, note=sweep.note, table=table), found


def overview(done: Sequence[tuple[Sweep, Found]]) -> Section:
    """The exponents of all sweeps."""
    table = []
    for sweep, found in done:
        x = sweep.values(found)
        total, summed = power_law(x, seconds(found)), power_law(x, synthesis_seconds(found))
        table.append(
            {
                "variable": sweep.axis,
                "from": min(x),
                "to": max(x),
                "fitted from": total.start,
                "exponent of seconds": total.power,
                "of synthesis": summed.power,
            }
        )
    note = (
        "One variable each. Seconds are the best of two runs (of one where it is long), kernels warm, each point in a process of "
        "its own; those of synthesis and of the facet stage are of stages called one after another. Exponents p of "
        "seconds ~ x^p by least squares in log-log over the upper half of the points, the middle one included, where fixed costs "
        "do not flatter them."
    )
    return Section(title="Sweeps", checks=[], note=note, table=table)


def presets(run: Run) -> tuple[Section, Found]:
    """Every preset with both models."""
    found = [
        run(Case(name=f"{method}, {preset}", method=method, preset=preset, duration_s=PRESET_S, runs=1))
        for method in ("mesh", "ellipsoid")
        for preset in preset_names()
    ]
    table = [
        {"case": each["name"], "antennas": each["antennas"], "chirps per second": each["prf_hz"], **_row(each)}
        for each in found
    ]
    return Section(title="Presets", checks=[], note=f"Walk of {PRESET_S:g} s, one run.", table=table), found


def stages(cases: Found) -> Section:
    """Where the time goes, and how fast terms are summed, beside the machine's own rate of sines and cosines."""
    rate = sincos_rate()
    table = [
        {
            "case": each["name"],
            **{f"{stage} [s]": each["stages"][stage] for stage in STAGES},
            "facet terms [1e6/s]": _per_second(each["facet_terms"], each["stages"][FACETS]),
            "echo terms [1e6/s]": _per_second(each["echo_terms"], each["stages"][SYNTHESIS]),
        }
        for each in cases
    ]
    note = (
        "Stages called one after another, so that each has all cores; in the timed runs echoes are made while earlier ones are "
        "summed. Occlusion is the time by which making the echoes takes longer with it than without. Facet terms are facets x "
        "path pairs x surface frames (about half of them face away and are passed over), echo terms echoes x chirps x antennas, "
        "which levels of groups sum in fewer steps. "
        f"This machine's Dr.Jit takes {rate / 1e6:.0f} million pairs of float32 sine and cosine per second on all cores."
    )
    return Section(title="Where the time goes", checks=[], note=note, table=table)


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerLaw:
    """seconds = factor x^power for x from `start` up."""

    factor: float
    power: float
    start: float


def power_law(x: Sequence[float], taken_s: Sequence[float]) -> PowerLaw:
    """Least squares in log-log over the upper half of the points, the middle one included."""
    start = sorted(x)[(len(x) - 1) // 2]
    chosen = np.array(x) >= start
    power, shift = np.polyfit(np.log(np.array(x)[chosen]), np.log(np.array(taken_s)[chosen]), 1)
    return PowerLaw(factor=float(np.exp(shift)), power=float(power), start=start)


def seconds(found: Found) -> list[float]:
    """Of the whole simulation, case by case."""
    return [each["seconds"] for each in found]


def synthesis_seconds(found: Found) -> list[float]:
    """Of synthesis by itself, case by case."""
    return [each["stages"][SYNTHESIS] for each in found]


def _antennas(transmitters: int, receivers: int, *, duration_s: float) -> Case:
    layout = Radar.preset("imaging-12x16")

    def spread(places: Sequence[Any], count: int) -> list[Any]:
        return [places[i] for i in np.linspace(0, len(places) - 1, count).round().astype(int)]

    changes = {
        "tx_offsets_m": spread(layout.tx_offsets_m, transmitters),
        "rx_offsets_m": spread(layout.rx_offsets_m, receivers),
        "multiplexing": "simultaneous",
        "prf_hz": layout.prf_hz / len(layout.tx_offsets_m),
    }
    return Case(name=f"{transmitters} x {receivers}", preset="imaging-12x16", changes=changes, duration_s=duration_s)


def _row(found: dict[str, Any]) -> dict[str, Any]:
    return {
        "seconds": found["seconds"],
        "synthesis [s]": found["stages"][SYNTHESIS],
        "facet stage [s]": found["stages"][FACETS],
        "peak memory [GB]": found["peak_gb"],
        **_work(found),
    }


def _work(found: dict[str, Any]) -> dict[str, int]:
    return {"facets": found["facets"], "echoes": found["echoes"]}


def _per_second(terms: int, seconds: float) -> float:
    return terms / seconds / 1e6 if terms else 0.0


def experiments(run: Run) -> tuple[Section, Found]:
    """Several persons and a fan in a room, and what a fan's further seconds take."""
    persons = [
        Case(name=f"{count} persons", preset="table2-uniform", scene=ROOM, duration_s=4.0, persons=count)
        for count in (1, 2, 3)
    ]
    crowd = Case(
        name="3 persons and a fan, 10 s",
        preset="table2-uniform",
        scene=ROOM,
        duration_s=WALK_S,
        persons=3,
        fan=True,
        runs=2,
    )
    fans = [
        Case(name=f"a fan, {scene}, {duration:g} s", scene=scene, duration_s=duration, target="nobody", runs=2)
        for scene in ("free_space", ROOM)
        for duration in (10.0, 30.0)
    ]
    found = [run(case) for case in (*persons, crowd, *fans)]
    taken = dict(zip([case.name for case in (*persons, crowd, *fans)], seconds(found), strict=True))
    # All three count: a line through two points would be their scatter.
    power = float(np.polyfit(np.log([1, 2, 3]), np.log([taken[case.name] for case in persons]), 1)[0])
    checks = [
        at_most(crowd.name, taken[crowd.name], CROWD_LIMIT_S, "s"),
        at_most(f"{crowd.name}: peak memory", found[3]["peak_gb"], MEMORY_LIMIT_GB, "GB"),
        at_most("persons: exponent of seconds", power, EXPONENT_LIMIT),
        *(
            at_most(
                f"each further second of {short.name.split(',')[0]}, {short.scene}",
                (taken[long.name] - taken[short.name]) / (long.duration_s - short.duration_s),
                FAN_LIMIT,
                "s",
            )
            for short, long in ((fans[0], fans[1]), (fans[2], fans[3]))
        ),
    ]
    table = [{"case": each["name"], "seconds": each["seconds"], "peak memory [GB]": each["peak_gb"]} for each in found]
    note = f"In the {ROOM} at table2-uniform, the fan at 900 rpm; a fan alone at table2. Persons walk on the spot, for 4 s alone."
    return Section(title="Persons and fans", checks=checks, note=note, table=table), found
