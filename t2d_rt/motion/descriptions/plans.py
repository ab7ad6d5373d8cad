"""What the grammar chooses from: for each class, ways to do it, and what comes before and after.

Choices are words with their weights ("forward*3 back -": three times as often forward as back or nothing).
"""

from __future__ import annotations

from dataclasses import dataclass

from t2d_rt.motion.descriptions.slots import Activity

MANNERS = "careful happy angry sad -*5"
SPEEDS = "slow*2 fast*2 -*4"
LEVEL = "forward*3 straight back left right -*2"
ROUND = "forward*3 straight*2 back*2 left*2 right*2 clockwise*2 counterclockwise*2 -*3"
SIDES = "left right -*2"
COUNTS = "2 3 4 5 -*12"
SECONDS = "5 10 -*14"

APPROACH = (
    "- *4 | walk | walk speed=slow | walk direction=forward | walk direction=forward speed=fast | stand | "
    "walk manner=careful"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """One way to do an activity, and how often it is chosen."""

    action: str
    type: str | None = None
    weight: int = 1
    manner: str = MANNERS
    speed: str = SPEEDS
    direction: str = "-"
    object: str = "-"
    body_part: str = "-"
    count: str = "-"
    duration_s: str = "-"
    before: str = "-"
    after: str = "-"


def _gait(kind: str, *, parts: str, speed: str = SPEEDS, weight: int = 1) -> Plan:
    return Plan(
        action="walk",
        type=kind,
        weight=weight,
        speed=speed,
        manner="careful sad angry happy -*8",
        body_part=parts,
        direction="forward*4 straight*2 back left right -*5",
        object="floor chair handrail stair -*8",
        duration_s=SECONDS,
        before="- *8 | stand_up | stand_up object=chair | stand | turn direction=left | turn direction=right",
        after="- *8 | stand | sit object=chair | turn direction=back | turn direction=left | sit",
    )


def _fall(kind: str, *, direction: str, objects: str, parts: str) -> Plan:
    return Plan(
        action="fall",
        type=kind,
        manner="careful angry sad happy -*12",
        speed="fast*2 slow -*9",
        direction=direction,
        object=objects,
        body_part=parts,
        before="- *4 | walk*2 | walk speed=slow*2 | walk speed=fast | walk direction=forward*3 | "
        "walk direction=back | walk manner=careful | "
        "walk speed=slow direction=forward*2 | walk manner=sad | run | run direction=forward | stand*2 | "
        "turn direction=left | "
        "turn direction=right | climb direction=up object=stair | climb direction=down object=stair | "
        "stand_up object=chair | "
        "walk direction=straight | walk manner=angry | walk manner=happy",
        after="- *8 | stand_up*2 | stand_up speed=slow | stand_up manner=careful",
    )


PLANS: dict[Activity, tuple[Plan, ...]] = {
    "walking": (
        Plan(
            action="walk",
            weight=8,
            direction=ROUND,
            object="chair ball floor handrail stair -*7",
            body_part="arm hand foot leg knee -*8",
            duration_s=SECONDS,
            before="- *6 | stand*2 | turn direction=left | turn direction=right",
            after="- *8 | stand | turn direction=left | turn direction=right | turn direction=back",
        ),
        Plan(
            action="turn",
            weight=2,
            direction="left right clockwise counterclockwise back",
            object="chair handrail -*4",
            body_part="foot -*4",
            before="- *3 | stand",
            after="- *2 | stand",
        ),
        Plan(
            action="climb",
            weight=3,
            direction="up*3 down*2",
            object="stair*2 handrail",
            manner=MANNERS,
            body_part="hand foot -*6",
            before="- *4 | stand | turn direction=left | turn direction=right",
            after="- *3 | stand | turn direction=back",
        ),
    ),
    "abnormal_walking": (
        _gait("parkinsonian", parts="arm hand foot knee -*4", speed="slow*3 -*5"),
        _gait("festinating", parts="foot arm -*5", speed="fast*2 -*5"),
        _gait("freezing", parts="leg foot -*5", speed="slow*2 -*5"),
        _gait("waddling", parts="waist*2 arm leg -*4"),
        _gait("ataxic", parts="arm foot leg -*4"),
        _gait("scissor", parts="knee leg -*4", speed="slow*2 -*5"),
        _gait("steppage", parts="foot knee leg -*4"),
        _gait("limping", parts="leg*2 foot knee hand -*2", speed="slow*2 fast -*5"),
    ),
    "running": (
        Plan(
            action="run",
            direction=ROUND,
            object="chair ball floor handrail stair -*8",
            body_part="arm hand foot leg knee -*7",
            duration_s=SECONDS,
            before="- *8 | stand | walk | walk direction=forward | turn direction=left | turn direction=right | "
            "walk speed=slow",
            after="- *8 | stand*2 | walk | walk speed=slow | turn direction=back | turn direction=left",
        ),
    ),
    "falling": (
        _fall(
            "slip",
            direction="back*5 left*2 right*2 forward -*4",
            objects="floor*3 stair ball -*5",
            parts="hand foot arm waist -*10",
        ),
        _fall(
            "trip",
            direction="forward*6 left right -*4",
            objects="chair*2 ball*2 stair*2 floor*2 -*3",
            parts="knee hand arm leg foot -*10",
        ),
        _fall(
            "collapse",
            direction="down*4 forward*2 back*2 left right straight -*3",
            objects="floor*3 chair handrail -*5",
            parts="knee arm -*8",
        ),
    ),
    "sitting": (
        Plan(
            action="sit",
            weight=5,
            object="chair*6 floor*2 stair ball handrail -*2",
            body_part="hand knee arm leg foot -*9",
            direction="back -*9",
            before="- *3 | walk*2 | walk object=chair | walk speed=slow | walk direction=forward | "
            "walk direction=back | turn direction=left | "
            "turn direction=right | stand | turn direction=back | walk manner=careful | walk direction=straight",
            after="- *4 | stand_up*3 | stand_up speed=slow | stand_up speed=fast | lie_down",
        ),
        Plan(
            action="stand_up",
            weight=3,
            object="chair*4 floor*2 stair handrail -",
            body_part="hand knee leg arm -*7",
            direction="-",
            before="-",
            after="- *3 | walk*2 | walk direction=forward | walk direction=left | turn direction=right | stand | "
            "walk speed=slow",
        ),
        Plan(
            action="lie_down",
            weight=3,
            object="floor*4 chair -*2",
            body_part="arm leg hand knee -*8",
            direction="back*3 left right forward -*2",
            before="- *3 | walk | stand | walk speed=slow | turn direction=left",
            after="- *3 | stand_up | stand_up speed=slow",
        ),
    ),
    "bending": (
        Plan(
            action="bend",
            weight=5,
            direction="forward*3 down*3 left right back -*2",
            object="ball*3 floor*3 chair handrail stair -*3",
            body_part="waist*2 knee hand arm leg foot -*5",
            count=COUNTS,
            before=APPROACH,
            after="- *6 | stand | walk | turn direction=left",
        ),
        Plan(
            action="squat",
            weight=3,
            object="ball floor chair handrail -*3",
            body_part="knee arm hand leg foot -*6",
            count=COUNTS,
            before=APPROACH,
            after="- *4 | stand_up | stand_up speed=fast",
        ),
        Plan(
            action="stretch",
            weight=3,
            direction="up*2 left right forward down back -*2",
            object="floor chair handrail -*6",
            body_part="arm*3 leg*2 waist hand foot knee -",
            count=COUNTS,
            before="- *5 | stand*2",
            after="- *5 | stand",
        ),
    ),
    "jumping": (
        Plan(
            action="jump",
            direction="up*3 forward*3 back left right down straight clockwise counterclockwise -*2",
            count="2 3 4 5 10 -*6",
            object="ball chair floor stair -*7",
            body_part="foot*3 leg*2 arm*2 knee hand -*5",
            before="- *6 | stand*2 | run direction=forward | run | walk direction=forward | walk | squat | "
            "run speed=fast",
            after="- *8 | stand | turn direction=left | walk | turn direction=back",
        ),
    ),
    "dancing": (
        Plan(
            action="dance",
            direction="clockwise*2 counterclockwise*2 left right forward back straight up -*4",
            object="floor*2 chair ball -*8",
            manner="careful happy*3 angry sad -*3",
            body_part="arm*2 hand leg*2 foot waist knee -*5",
            duration_s=SECONDS,
            before="- *7 | stand | walk | walk direction=forward | stand_up object=chair | turn direction=left",
            after="- *7 | stand | turn direction=right | walk | sit object=chair",
        ),
    ),
}
"""For each class, ways to do it."""

NOT_TOGETHER = {
    ("manner", "angry"): (("speed", "slow"),),
    ("manner", "careful"): (("speed", "fast"),),
    ("direction", "clockwise"): (("object", "stair"), ("object", "handrail")),
    ("direction", "counterclockwise"): (("object", "stair"), ("object", "handrail")),
    ("direction", "up"): (("object", "ball"), ("object", "chair")),
    ("direction", "straight"): (("object", "ball"),),
    ("object", "stair"): (("count", "2"), ("count", "3"), ("count", "4"), ("count", "5"), ("count", "10")),
    ("object", "ball"): (("body_part", "hand"), ("body_part", "arm")),
    ("object", "handrail"): (("body_part", "arm"), ("body_part", "leg")),
}
"""Pairs that make no sense, or no motion: the latter of both is left out."""
