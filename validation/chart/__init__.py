"""Speed against accuracy: every method over its knob, in free space and in rooms, against the converged float64 reference."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import t2d_rt as t2d
from t2d_rt.resources import resource
from t2d_rt.types import Motion, Radar
from validation.bodies import RUN, WALK, falling
from validation.chart.front import gap, seconds_at
from validation.chart.measure import REFERENCE_RAD, ROOM_REFERENCE_RAD, Case, Point, measured
from validation.chart.methods import DEFAULT, METHODS, SUMMED, Method
from validation.chart.plots import default_of, small_charts, speed_accuracy
from validation.chart.slow import POSE_RATE_HZ, float64, point_sums, sionna_paths
from validation.report import Check, Section

SCENES = ("free_space", "empty_room")
START_M = 4.2
"""Distance at which the stretches begin, which leaves them inside the rooms."""
STRETCHES = {"walk": (WALK, 1.9), "run": (RUN, 0.4)}
"""Recording, start [s]."""
FALL_S = 0.5
"""Start of the stretch of the fall."""
STRETCH_S, ROOM_STRETCH_S = 1.0, 0.4
CHIRPS, ROOM_CHIRPS = 16, 6
FASTER_BAR, MERGED_BAR = 10.0, 3.0
"""The second is for points that our own merging of echoes sums."""
FINE_BAR_DB = -30.0
BENCH = Path(__file__).parents[1] / "bench" / "results.json"


def cases(radar: Radar) -> list[Case]:
    """Motions in free space, and the walk in rooms."""
    walk, run_ = (stretch(*part, STRETCH_S) for part in STRETCHES.values())
    fall = t2d.trim(falling(), FALL_S, FALL_S + STRETCH_S)
    found = [
        Case("free_space", name, each, radar, CHIRPS) for name, each in (("walk", walk), ("run", run_), ("fall", fall))
    ]
    short = stretch(*STRETCHES["walk"], ROOM_STRETCH_S)
    return found + [Case(scene, "walk", short, radar, ROOM_CHIRPS) for scene in SCENES[1:]]


def stretch(recording: str, start_s: float, length_s: float) -> Motion:
    """A part of a bundled recording that begins `START_M` before the radar."""
    part = t2d.trim(t2d.load_motion(resource("motions", recording)), start_s, start_s + length_s)
    return t2d.place(part, distance_m=START_M)


def sweep(case: Case, *, few: bool) -> list[Point]:
    """All methods in a case, over all or a few of their settings."""
    points = []
    for method in METHODS:
        if not (method.rooms_only and case.scene == "free_space"):
            points += [point(case, method, value) for value in (method.few if few else method.values)]
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
        first = not found
        points = sweep(case, few=not first)
        if first:
            points += sionna_paths(case) + float64(case) + point_sums(case, points)
            checks += _faster(points)
        fine_db[case.scene, case.name] = case.error_db(case.fine.cube)
        found[case.scene, case.name] = points
    checks.append(
        Check(what="the stand-in's own field NMSE, walk in free space", measured=fine_db["free_space", "walk"],
              limit=FINE_BAR_DB, unit="dB")
    )  # fmt: skip
    for (scene, motion), points in found.items():
        db, share = gap(points, default_of(points))
        what = f"{scene}, {motion}: default off the front, in units of 1 dB or 20 % of time, the less"
        checks.append(Check(what=what, measured=min(db, share / 0.2), limit=1, unit=""))
    speed_accuracy(found["free_space", "walk"])
    return Section(
        title="Speed against accuracy",
        checks=checks,
        note=_note(found, fine_db),
        table=[p.row for points in found.values() for p in points],
        charts=[small_charts(found)],
    )


def _faster(points: Sequence[Point]) -> list[Check]:
    """One point per facet at the default's error: summed chirp by chirp as usual, and by this engine's own merging of echoes."""
    default = default_of(points)
    return [
        Check(
            what=f"walk in free space: time of {method}, at the default's error, against the default's",
            measured=seconds_at([p for p in points if p.method == method], default.nmse_db) / default.seconds_per_second,
            limit=bar, unit="times", at_least=True,
        )
        for method, bar in ((SUMMED, FASTER_BAR), ("facets with one point each", MERGED_BAR))
    ]  # fmt: skip


def _note(found: dict[tuple[str, str], list[Point]], fine_db: dict[tuple[str, str], float]) -> str:
    own = ", ".join(f"{scene} {motion} {db:.1f} dB" for (scene, motion), db in fine_db.items())
    return (
        f"Preset `table2`, body of skin, {STRETCH_S:g} s in free space and {ROOM_STRETCH_S:g} s in rooms, without static clutter. "
        "Seconds from the motion to the spectrogram, kernels warm and refinements kept, best of two runs or of one long one; what "
        "a record needs once, about 0.3 s, weighs more in so short ones than in the bench's 10 s. Field NMSE at "
        f"{CHIRPS} random chirps ({ROOM_CHIRPS} in rooms) and three places of the sweep against the float64 reference with "
        f"facets of {REFERENCE_RAD} rad, in rooms {ROOM_REFERENCE_RAD} rad and up to two reflections, so that wall order 3 is held "
        "against less than it has. Rooms' default models pairs of ways weaker than -6 dB coarsely: their power is right, their "
        "phases are not. `tolerance_db` has them as fine as it asks for (the line by tolerance; its planning is in the time). "
        f"The other figures are beside the mesh at far finer settings, whose own field NMSE is: "
        f"{own}. One point per facet: the closed form's value where its phases do not differ, facets cut to even edges (m), which "
        "is the best for it: with facets of the default's shapes it needs more of them. Closed form: the default's phase sagitta "
        "times the knob; 1e+06 leaves the body's 6 402 faces. Full mesh: what is hidden traced at the facets' own vertices. Sionna "
        f"RT: its specular and diffuse paths off the posed cage, {POSE_RATE_HZ:g} poses per second, which is no spectrogram yet. "
        "Summed chirp by chirp: the same points, moved to each chirp and summed in float64 with one exponential each, which is "
        "one sample of a chirp, not a range profile; a few chirps' time, for all chirps of a second. "
        "Float64 at every sample: a few chirps' time, for all chirps of a second.\n\n" + _exponents()
    )


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
