"""Real blockage beside occlusion masks: a walk behind a cupboard, a table and a second person."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import t2d_rt as t2d
from t2d_rt.motion import aside
from t2d_rt.noise.masks import OcclusionMask
from t2d_rt.recording.maps import background, background_settings
from t2d_rt.types import Motion, Radar
from validation.report import Section, at_least, at_most, new_figure, save_chart

RADAR = Radar.preset("table2")
SIZE_M = 7.0, 6.0, 2.6
ROOM = t2d.Room(name="hall", size_m=SIZE_M)
CUPBOARD = t2d.Room(name="hall", size_m=SIZE_M, furniture=({"kind": "cupboard", "x_m": 2.2, "y_m": 0.0},))
TABLE = t2d.Room(name="hall", size_m=SIZE_M, furniture=({"kind": "table", "x_m": 2.6, "y_m": 0.0},))
DEEP_DB, HALF_DB, SHOWN_DB = -20.0, -6.0, -60.0
FAST_MPS = 1.5
"""Speeds beyond which limbs are alone."""
SMOOTHED = 5
"""Columns over which powers are averaged for the course of the attenuation."""
COLOURS_DB = 45.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """Powers [W] of a walk without and with what blocks it, (speed, time)."""

    name: str
    free: np.ndarray
    blocked: np.ndarray

    @property
    def course_db(self) -> np.ndarray:
        """Attenuation of the power at all speeds together [dB], (time,)."""
        return attenuation_db(self.free, self.blocked)


def run() -> Section:
    walk = walker()
    cases, speeds, times = _cases(walk)
    step_s = float(times[1] - times[0])
    rows = [_row(each, speeds, step_s) for each in cases]
    table = {each["blocked by"]: each for each in rows}
    cupboard, legs, person = (table[name] for name in ("cupboard, direct path", "table, direct path", "second person"))
    hidden_s = step_s * float(hidden(walk, times).sum())
    checks = [
        at_most("cupboard, direct path: deepest", cupboard["deepest [dB]"], DEEP_DB, "dB"),
        at_most(
            f"cupboard: time below {HALF_DB:g} dB less that in which the pelvis is behind it ({hidden_s:.2f} s)",
            abs(cupboard["below -6 dB [s]"] - hidden_s),
            0.2,
            "s",
        ),
        at_least("table: attenuation of the whole body", legs["deepest [dB]"], DEEP_DB, "dB"),
        at_least(
            f"table: time in which speeds above {FAST_MPS:g} m/s are below {HALF_DB:g} dB",
            legs["fast below -6 dB [s]"],
            0.1,
            "s",
        ),
        at_most("second person: deepest", person["deepest [dB]"], HALF_DB, "dB"),
    ]
    mask = OcclusionMask()
    return Section(
        title="Blockage",
        checks=checks,
        note="A walk (CMU 12_01, mesh) crosses behind a cupboard, a table and a second person, who crosses the other way; of "
        "two persons the echoes of the nearer one, simulated alone, are taken away. Attenuation: power of "
        f"{SMOOTHED} columns over that without what blocks, at all speeds together; slow: up to {FAST_MPS:g} m/s, fast: beyond, "
        "each by itself. Edge: mean time from -3 to -20 dB. A mask is as deep as the background, "
        f"at all speeds, has edges of one column, and lasts {mask.shortest_s:g} to {mask.longest_s:g} s by default. Visibility is "
        "by rays that fade over the Fresnel zone; what is diffracted into the furniture's shadow is not modelled; beside the "
        "person's outline it is (eq. 27). By two knife edges in phase "
        f"(ITU-R P.526, eq. 31) it is {diffracted_db(0.45, 2.2, 1.6):.0f} dB at most behind the middle of the cupboard, there and "
        f"back, and {diffracted_db(0.2, 2.0, 1.8):.0f} dB behind a body 0.4 m wide.",
        table=rows,
        charts=[_chart(cases, speeds, times)],
    )  # fmt: skip


def walker() -> Motion:
    """A walk that crosses the boresight at 3.8 m."""
    return aside(t2d.place(t2d.example("walk"), distance_m=4.5, angle_deg=70.0), 1.9)


def second_person(duration_s: float) -> Motion:
    """Another one that crosses it at 2 m, the other way."""
    walk = t2d.place(t2d.example("walk"), distance_m=2.3, angle_deg=-80.0)
    return t2d.trim(aside(walk, -1.8), 0.0, duration_s)


def hidden(walk: Motion, times_s: np.ndarray) -> np.ndarray:
    """Whether the cupboard is between the radar and the pelvis, (time,)."""
    scene = CUPBOARD.scene()
    corners = np.concatenate([each.vertices for each in scene.surfaces if each.name.startswith("cupboard")])
    low, high = corners.min(axis=0), corners.max(axis=0)
    start = np.array(RADAR.position_m)
    steps = np.stack([np.interp(times_s, walk.times_s, walk.joints[:, 0, axis]) for axis in range(3)], axis=1) - start
    near, far = np.sort(np.stack([(low - start) / steps, (high - start) / steps]), axis=0)
    return np.asarray(near.max(axis=1) < np.minimum(far.min(axis=1), 1.0))


def attenuation_db(free: np.ndarray, blocked: np.ndarray) -> np.ndarray:
    """Of powers (speed, time), added over the speeds and averaged over a few columns [dB], (time,)."""
    window = np.ones(SMOOTHED) / SMOOTHED
    before, after = (np.convolve(each.sum(axis=0), window, "same") for each in (free, blocked))
    return np.asarray(10 * np.log10(np.maximum(after / before, 10 ** (SHOWN_DB / 10))))


def diffracted_db(half_width_m: float, before_m: float, behind_m: float) -> float:
    """Level behind the middle of a screen, there and back [dB], if the fields over its two edges add in phase."""
    wavelength = RADAR.wavelength_m
    v = half_width_m * math.sqrt(2 * (before_m + behind_m) / (wavelength * before_m * behind_m))
    loss_db = 6.9 + 20 * math.log10(math.sqrt((v - 0.1) ** 2 + 1) + v - 0.1)
    return 2 * (20 * math.log10(2) - loss_db)


def _cases(walk: Motion) -> tuple[list[Case], np.ndarray, np.ndarray]:
    def cube(targets: Any, scene: Any = "free_space", reflections: int = 0) -> np.ndarray:
        found = t2d.simulate(
            targets, radar=RADAR, scene=scene, reflections=reflections, clutter="none", collisions="ignore", seed=0
        )
        return np.asarray(found.cube)

    def power(samples: np.ndarray) -> np.ndarray:
        return np.asarray(t2d.signal.spectrogram(samples, RADAR).power, np.float64)

    free = cube(walk)
    other = second_person(walk.duration_s)
    image = t2d.signal.spectrogram(free, RADAR)
    direct = power(free)
    cases = [
        Case(name="cupboard, direct path", free=direct, blocked=power(cube(walk, CUPBOARD))),
        Case(name="table, direct path", free=direct, blocked=power(cube(walk, TABLE))),
        Case(name="second person", free=direct, blocked=power(cube([walk, other]) - cube(other))),
        Case(
            name="cupboard, 2 reflections", free=power(cube(walk, ROOM, 2)), blocked=power(cube(walk, CUPBOARD, 2))
        ),
    ]  # fmt: skip
    return cases, image.velocity_mps, image.time_s


def _row(case: Case, speeds: np.ndarray, step_s: float) -> dict[str, Any]:
    course, fast = case.course_db, np.abs(speeds) > FAST_MPS

    def below(course_db: np.ndarray, limit_db: float) -> float:
        return step_s * float((course_db <= limit_db).sum())

    deep_s = below(course, DEEP_DB)
    return {
        "blocked by": case.name, "deepest [dB]": float(course.min()), "below -3 dB [s]": below(course, -3.0),
        "below -6 dB [s]": below(course, HALF_DB), "below -20 dB [s]": deep_s,
        "edge [s]": (below(course, -3.0) - deep_s) / 2 if deep_s else "",
        "slow below -6 dB [s]": below(attenuation_db(case.free[~fast], case.blocked[~fast]), HALF_DB),
        "fast below -6 dB [s]": below(attenuation_db(case.free[fast], case.blocked[fast]), HALF_DB),
    }  # fmt: skip


def _chart(cases: Sequence[Case], speeds: np.ndarray, times: np.ndarray) -> str:
    """Each case without and with what blocks, with a mask where the attenuation is -6 dB or less, and its course."""
    settings = background_settings("default", seed=0)
    under = background(speeds, times, settings).power_w(None).astype(np.float64)
    figure, axes = new_figure(figsize=(14, 2.5 * len(cases) + 0.6), nrows=len(cases), ncols=4, squeeze=False)
    top = 10 * np.log10(cases[0].free.max())
    for row, case in zip(axes, cases, strict=True):
        course = case.course_db
        masked = np.where(course <= HALF_DB, 0.0, case.free)
        for ax, title, power in zip(
            row, ("not blocked", case.name, "masked instead"), (case.free, case.blocked, masked), strict=False
        ):
            drawn = ax.pcolormesh(
                times, speeds, 10 * np.log10(power + under), vmin=top - COLOURS_DB, vmax=top, shading="nearest", rasterized=True
            )  # fmt: skip
            ax.set_title(title, fontsize=9)
            ax.set_ylim(-3, 4)
        row[0].set_ylabel("Speed [m/s]")
        row[3].plot(times, course, color="C0")
        row[3].plot(times, np.where(course <= HALF_DB, SHOWN_DB, 0.0), color="0.6", linestyle=":", label="mask")
        row[3].set(ylim=(SHOWN_DB - 2, 8), ylabel="Attenuation [dB]", xlim=(times[0], times[-1]))
        row[3].grid(color="0.9")
    axes[0, 3].legend(fontsize=8)
    for ax in axes[-1]:
        ax.set_xlabel("Time [s]")
    figure.colorbar(drawn, ax=axes[:, :3], label="Power [dB re 1 W], with a background")
    return save_chart(figure, "blockage.png")
