"""Several persons and a fan in a room."""

from __future__ import annotations

import numpy as np

from validation.bench.measure import Case
from validation.bench.sections import EXPONENT_LIMIT, MEMORY_LIMIT_GB, ROOM, WALK_S, Found, Run, seconds
from validation.report import Check, Section

CROWD_LIMIT_S, FAN_LIMIT = 45.0, 0.1
"""The second is in seconds for each further second of a fan."""


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
        Check(what=crowd.name, measured=taken[crowd.name], limit=CROWD_LIMIT_S, unit="s"),
        Check(what=f"{crowd.name}: peak memory", measured=found[3]["peak_gb"], limit=MEMORY_LIMIT_GB, unit="GB"),
        Check(what="persons: exponent of seconds", measured=power, limit=EXPONENT_LIMIT, unit=""),
        *(
            Check(what=f"each further second of {short.name.split(',')[0]}, {short.scene}", limit=FAN_LIMIT, unit="s",
                  measured=(taken[long.name] - taken[short.name]) / (long.duration_s - short.duration_s))
            for short, long in ((fans[0], fans[1]), (fans[2], fans[3]))
        ),
    ]  # fmt: skip
    table = [{"case": each["name"], "seconds": each["seconds"], "peak memory [GB]": each["peak_gb"]} for each in found]
    note = f"In the {ROOM} at table2-uniform, the fan at 900 rpm; a fan alone at table2. Persons walk on the spot, for 4 s alone."
    return Section(title="Persons and fans", checks=checks, note=note, table=table), found
