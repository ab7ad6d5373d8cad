"""From the edge of a bed onto it, and back; how one lies on the back, on floor and bed alike."""

from __future__ import annotations

import numpy as np

from t2d_rt.motion.generate.made.hands import Goal, InSpace, OnBone, OnPelvis
from t2d_rt.motion.generate.made.performer import Performer
from t2d_rt.motion.generate.made.score import DEG, OTHER, SIDES, SIGN, Place, Score

HEEL = 0.026
"""Height of the ankle over stature where the heel rests with the toes up."""


def onto_bed(score: Score, who: Performer) -> None:
    """From the edge of a bed: the trunk goes down to a side over the hand while the legs come up, the body turns along the bed."""
    body = who.anatomy
    head = "left" if who.chance(0.5) else "right"
    sign = SIGN[head]
    bed_m = score.values["z"] - score.place.floor_m - body.seat_m
    x, y = score.at("hips")
    swing_s = who.u(2.0, 2.6)
    home = score.place
    hips = home.world(x - who.u(0.14, 0.20) * body.leg_m, y - sign * 0.06)
    hand = home.world(x - 0.05, y + sign * 0.30 * who.tall / 1.72, bed_m + 0.03 * who.tall)
    score.reach(
        head, InSpace(point=hand, elbow=(0.6, 0.3, 0.5), fingers=(0.2, 1.0, 0.0), yaw_rad=home.yaw_rad), 0.0, 0.7, 0.05
    )
    score.reach(OTHER[head], OnBone(along=who.u(0.45, 0.6)), 0.1, 0.6)
    score.move(0.1, 0.7, side=sign * who.u(10, 16) * DEG, roll=sign * who.u(10, 16) * DEG, pitch=-18 * DEG)
    score.wait(0.5)
    score.home = home
    score.place = Place(x_m=hips[0], y_m=hips[1], floor_m=home.floor_m + bed_m, yaw_rad=home.yaw_rad - sign * np.pi / 2)
    score.put(0.0, swing_s * 0.85, hips=(0.0, 0.0, body.back_m + 0.005))
    score.move(0.45 * swing_s, 0.5 * swing_s, ground=score.place.floor_m)
    score.move(0.05, 0.85 * swing_s, yaw=score.place.yaw_rad)
    score.move(0.0, 0.55 * swing_s, roll=sign * who.u(24, 32) * DEG)
    score.move(0.42 * swing_s, 0.55 * swing_s, roll=0.0, side=0.0)
    score.move(0.1, swing_s, pitch=-90 * DEG)
    score.move(0.3 * swing_s, 0.7 * swing_s, flex=who.u(3, 8) * DEG, twist=0.0, look=0.0)
    score.move(0.2 * swing_s, 0.8 * swing_s, gaze=-who.u(66, 80) * DEG, tilt=0.0)
    for number, side in enumerate((OTHER[head], head)):
        after = 0.05 + 0.2 * number
        extend_leg(score, who, side, after + 0.12 * swing_s, 0.78 * swing_s, bent=who.u(0.96, 0.98))
        rise = score.values[f"{side}_z"]
        score.move(after, 0.5 * swing_s, **{f"{side}_z": rise + who.u(0.06, 0.12)})
        score.move(after + 0.45 * swing_s, 0.5 * swing_s, **{f"{side}_z": rise})
    arms_of_rest(score, who, 0.55 * swing_s, 0.6 * swing_s)
    score.wait(1.2 * swing_s)
    score.notes.append(f"the bed is {bed_m:.2f} m high, the head to the {head}")


def off_bed(score: Score, who: Performer) -> None:
    """Over the side up to sitting on the bed's edge, legs first."""
    body = who.anatomy
    home = score.home
    assert home is not None, "lying on a bed, one has come from its edge"
    up_s = who.u(1.9, 2.5)
    turn = home.yaw_rad - score.place.yaw_rad  # to the side on which the bed's edge is
    head = "left" if turn > 0 else "right"
    sign = SIGN[head]
    bed_m = score.place.floor_m - home.floor_m
    hand = home.world(
        home.local(score.values["x"], score.values["y"])[0],
        home.local(score.values["x"], score.values["y"])[1] + sign * 0.32,
        bed_m + 0.03 * who.tall,
    )
    score.reach(
        head,
        InSpace(point=hand, elbow=(0.6, 0.3, 0.5), fingers=(0.3, 1.0, 0.0), yaw_rad=home.yaw_rad),
        0.1,
        0.5 * up_s,
        0.03,
    )
    x, _ = home.local(score.values["x"], score.values["y"])
    score.place = home
    shank = who.u(2, 10) * DEG
    for number, side in enumerate((OTHER[head], head)):
        bx, by = stance_foot_wide(who, side)
        edge = x + 0.16 * body.leg_m
        thigh, lower = (body.skeleton.bone_m(f"{side}_{joint}") for joint in ("knee", "ankle"))
        rise_m = bed_m + body.seat_m - body.ankle_m - lower * np.cos(shank)
        foot_x = edge + np.sqrt(thigh**2 - rise_m**2) - lower * np.sin(shank) + bx
        after = 0.1 + 0.18 * number
        score.put(after, 0.85 * up_s, **{side: (float(foot_x), by)})
        height = score.values[f"{side}_z"]
        score.move(after, 0.4 * up_s, **{f"{side}_z": height + 0.06})
        score.move(after + 0.3 * up_s, 0.65 * up_s, **{f"{side}_z": home.floor_m})
        score.move(
            after + 0.1 * up_s,
            0.7 * up_s,
            **{
                f"{side}_loose": 0.0,
                f"{side}_splay": 0.0,
                f"{side}_yaw": home.yaw_rad + SIGN[side] * who.traits["toe_out"],
            },
        )
    score.move(0.0, 0.3 * up_s, ground=home.floor_m)
    score.put(0.2, 0.8 * up_s, hips=(x + 0.16 * body.leg_m, 0.0, bed_m + body.seat_m))
    score.move(0.15, 0.8 * up_s, yaw=home.yaw_rad)
    score.move(0.05, 0.5 * up_s, roll=sign * who.u(24, 32) * DEG, flex=who.u(20, 28) * DEG, gaze=-15 * DEG)
    score.move(0.1, 0.95 * up_s, pitch=-12 * DEG)
    score.move(0.5 * up_s, 0.6 * up_s, roll=0.0)
    score.move(0.6 * up_s, 0.5 * up_s, gaze=who.traits["gaze"])
    for side in SIDES:
        score.reach(side, OnBone(along=who.u(0.6, 0.85)), 0.75 * up_s, 0.5 * up_s, 0.04)
    score.wait(1.25 * up_s + who.u(0.2, 0.6))
    score.posture = "sitting"


def arms_of_rest(score: Score, who: Performer, after_s: float, duration_s: float) -> None:
    """Lying on the back: arms beside the body, or a hand on the belly."""
    for side in SIDES:
        beside: Goal = OnPelvis(
            ahead=-0.028,
            out=who.u(0.085, 0.125),
            up=who.u(-0.03, 0.0),
            elbow=(-0.3, 1.0, 0.0),
            fingers=(-0.05, 0.12, -1.0),
            back=(0.8, 0.6, 0.0),
        )
        if who.chance(0.25):
            beside = OnPelvis(
                ahead=0.085,
                out=-0.01,
                up=who.u(0.07, 0.12),
                elbow=(-0.5, 1.0, 0.0),
                fingers=(0.1, -1.0, -0.1),
                back=(1.0, 0.1, 0.0),
            )
        score.reach(side, beside, after_s + who.u(0.0, 0.15), duration_s, 0.03)


def extend_leg(score: Score, who: Performer, side: str, after_s: float, duration_s: float, *, bent: float) -> None:
    """A leg lies ahead of the hips, `bent` times as long as it is when straight, heel on the ground."""
    body = who.anatomy
    x, y = score.at("hips")
    height = HEEL * who.tall
    aside = SIGN[side] * who.u(0.9, 1.25) * body.hips_m
    rise = score.values["z"] - score.place.floor_m - height
    level = np.sqrt((bent * body.leg_m) ** 2 - rise**2 - (aside - SIGN[side] * body.hips_m) ** 2)
    score.put(after_s, duration_s, **{side: (x + float(level), y + aside, height - body.sole_m)})
    score.move(
        after_s,
        duration_s,
        **{
            f"{side}_loose": 1.0,
            f"{side}_tip": 0.0,
            f"{side}_splay": who.u(4, 22) * DEG,
            f"{side}_yaw": score.place.yaw_rad,
        },
    )


def stance_foot_wide(who: Performer, side: str) -> tuple[float, float]:
    """Ball of a foot that is a little wider than in quiet standing, against the middle of the hips [m]."""
    turn = who.traits["toe_out"]
    return who.anatomy.foot_m * np.cos(turn), SIGN[side] * (
        1.25 * who.traits["half_width"] + who.anatomy.foot_m * np.sin(turn)
    )
