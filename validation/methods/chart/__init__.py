"""Speed against accuracy: every method over its knob, in free space and in rooms, against the converged float64 reference."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import t2d_rt as t2d
from t2d_rt.core.resources import resource
from t2d_rt.types import Motion, Radar
from t2d_rt.types.accuracy import DEFAULT_TIERS
from validation.bodies import RUN, WALK, falling
from validation.methods.chart.front import GAP_DB, GAP_TIME, Error, gap, seconds_at
from validation.methods.chart.measure import REFERENCE_RAD, ROOM_REFERENCE_RAD, Case, Point, measured
from validation.methods.chart.methods import DEFAULT, METHODS, SUMMED, Method
from validation.methods.chart.plots import default_of, small_charts, speed_accuracy
from validation.methods.chart.slow import POSE_RATE_HZ, float64, point_sums, sionna_paths
from validation.report import Check, Section, at_least, at_most

SCENES = ("free_space", "empty_room", "living_room")
START_M = 4.2
"""Distance at which the stretches begin, which leaves them inside the rooms."""
STRETCHES = {"walk": (WALK, 1.9), "run": (RUN, 0.4)}
"""Recording, start [s]."""
FALL_S = 0.5
"""Start of the stretch of the fall."""
STRETCH_S, ROOM_STRETCH_S = 1.0, 0.5
CHIRPS, ROOM_CHIRPS = 16, 6
FASTER_LIMIT, MERGED_LIMIT = 10.0, 3.0
"""The second is for points that our own merging of echoes sums."""
FINE_LIMIT_DB, ROOM_LIMIT_DB = -30.0, -20.0
NAMES: dict[Error, str] = {"nmse_db": "the field's error", "spectrogram_db": "the spectrogram's error"}
BENCH = Path(__file__).parents[2] / "bench" / "results.json"


def cases(radar: Radar) -> list[Case]:
    """A walk, a run and a fall in free space and in rooms."""
    found = []
    for scene in SCENES:
        length_s, count = (STRETCH_S, CHIRPS) if scene == "free_space" else (ROOM_STRETCH_S, ROOM_CHIRPS)
        motions = {name: stretch(*part, length_s) for name, part in STRETCHES.items()}
        motions["fall"] = t2d.trim(falling(), FALL_S, FALL_S + length_s)
        found += [Case(scene, name, motion, radar, count) for name, motion in motions.items()]
    return found


def stretch(recording: str, start_s: float, length_s: float) -> Motion:
    """A part of a bundled recording that begins `START_M` before the radar."""
    part = t2d.trim(t2d.load_motion(resource("motions", recording)), start_s, start_s + length_s)
    return t2d.place(part, distance_m=START_M)


def sweep(case: Case) -> list[Point]:
    """Methods in a case: over all their settings for the walk in free space, else over a few of them."""
    free, walk = case.scene == "free_space", case.name == "walk"
    points = []
    for method in METHODS:
        values = method.values if free and walk else method.few if free or walk else method.brief
        if not (method.rooms_only and free):
            points += [point(case, method, value) for value in values]
    return points


def point(case: Case, method: Method, value: object) -> Point:
    """One setting of one method."""
    return measured(case, method.name, knob(value), lambda: method.run(case, value))


def knob(value: object) -> str:
    """A setting in words."""
    return f"{value:g}" if isinstance(value, float | int) else str(value)


def run() -> Section:
    radar = Radar.preset("table2")
    found: dict[tuple[str, str], list[Point]] = {}
    checks, fine_db = [], {}
    for case in cases(radar):
        points = sweep(case)
        if not found:
            points += sionna_paths(case) + float64(case) + point_sums(case, points)
            checks += _faster(points)
        fine_db[case.scene, case.name] = case.error_db(case.fine.cube)
        found[case.scene, case.name] = points
    checks.append(
        at_most("the stand-in's own field NMSE, walk in free space", fine_db["free_space", "walk"], FINE_LIMIT_DB, "dB")
    )  # fmt: skip
    in_rooms = max(db for (scene, _), db in fine_db.items() if scene != "free_space")
    checks.append(at_most("the same, the worst in rooms", in_rooms, ROOM_LIMIT_DB, "dB"))
    checks += _fronts(found)
    speed_accuracy(found["free_space", "walk"])
    return Section(
        title="Speed against accuracy",
        checks=checks,
        note=_note(found, fine_db),
        table=[p.row for points in found.values() for p in points],
        charts=[small_charts(found, "nmse_db"), small_charts(found, "spectrogram_db")],
    )


def _fronts(found: dict[tuple[str, str], list[Point]]) -> list[Check]:
    """Whether the default sits on each panel's front, of either error."""
    checks = []
    for error, name in NAMES.items():
        for (scene, motion), points in found.items():
            db, longer = gap(points, default_of(points), error)
            what = f"{scene}, {motion}: default off the front of {name}, in units of {GAP_DB:g} dB or {GAP_TIME:.0%} of time"
            checks.append(at_most(what, min(db / GAP_DB, longer / GAP_TIME), 1))
    return checks


def _faster(points: Sequence[Point]) -> list[Check]:
    """One point per facet at the default's error: summed chirp by chirp as usual, and by this engine's own merging of echoes."""
    default = default_of(points)
    return [
        at_least(
            f"walk in free space: time of {method}, at the default's error, against the default's",
            seconds_at([p for p in points if p.method == method], default.nmse_db) / default.seconds_per_second,
            limit,
            "times",
        )
        for method, limit in ((SUMMED, FASTER_LIMIT), ("facets with one point each", MERGED_LIMIT))
    ]


def _note(found: dict[tuple[str, str], list[Point]], fine_db: dict[tuple[str, str], float]) -> str:
    own = ", ".join(f"{scene} {motion} {db:.1f} dB" for (scene, motion), db in fine_db.items())
    return (
        f"Preset `table2`, body of skin, {STRETCH_S:g} s in free space and {ROOM_STRETCH_S:g} s in rooms, without static clutter. "
        "Seconds from the motion to the spectrogram, kernels warm, no refinement kept, best of two runs or of one long one; what "
        "a record needs once, about 0.3 s, weighs more in so short ones than in the bench's 10 s. Field NMSE at "
        f"{CHIRPS} random chirps ({ROOM_CHIRPS} in rooms) and three places of the sweep against the float64 reference with "
        f"facets of {REFERENCE_RAD} rad, in rooms {ROOM_REFERENCE_RAD} rad and up to two reflections, so that wall order 3 is held "
        "against less than it has. Rooms' default models path pairs weaker than "
        f"{DEFAULT_TIERS[0].level_db:g} dB coarsely and those "
        f"below {DEFAULT_TIERS[1].level_db:g} dB by ellipsoids: their power is right, their phases are not. "
        "In the field's error ghosts of "
        "wrong phase count twice, so to "
        f"leave second reflections out (wall order 1) is as good or better and faster: the default is off by {_off(found)}. In the "
        "spectrogram, which shows the ghosts, it is not. `tolerance_db` has all as fine as it asks for (the line by tolerance; its "
        "planning is in the time). "
        f"The other figures are beside the mesh at far finer settings, whose own field NMSE is: "
        f"{own}. One point per facet: the closed form's value where its phases do not differ, facets cut to even edges (m), which "
        "is the best for it: with facets of the default's shapes it needs more of them. Closed form: the default's phase sagitta "
        "times the knob; 100 leaves the body's 6 402 faces. Finest visibility: at 200 Hz, the cage subdivided three times. Sionna "
        f"RT: its specular and diffuse paths off the posed cage, {POSE_RATE_HZ:g} poses per second, which is no spectrogram yet. "
        "Summed chirp by chirp: the same points, moved to each chirp and summed in float64 with one exponential each, which is "
        "one sample of a chirp, not a range profile; a few chirps' time, for all chirps of a second. "
        "Float64 at every sample: flat facets of that phase sagitta, a few chirps' time, for all chirps of a second.\n\n"
        + _exponents()
    )


def _off(found: dict[tuple[str, str], list[Point]]) -> str:
    """How far the default is off the field's front in rooms, in words."""
    parts = []
    for (scene, motion), points in found.items():
        if scene != "free_space":
            db, longer = gap(points, default_of(points))
            parts.append(f"{db:.1f} dB and {longer:.0%} ({scene}, {motion})")
    return ", ".join(parts)


def _exponents() -> str:
    """Powers of cost as the bench measured them."""
    rows = json.loads(BENCH.read_text(encoding="utf-8"))["sweeps"]["table"]
    lines = [
        "| cost against (`make bench`) | from | to | exponent of seconds | of synthesis alone |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {r['variable']} | {r['from']:g} | {r['to']:g} | {r['exponent of seconds']:.2f} | {r['of synthesis']:.2f} |"
        for r in rows
    ]
    return "\n".join(lines)


__all__ = ["DEFAULT", "run"]
