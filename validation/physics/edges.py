"""Edges: a point that goes behind a screen beside the knife edge, and a walk behind a metal cupboard."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import t2d_rt as t2d
from t2d_rt.core.backend import select
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.resources import resource
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.propagation.paths import find_paths
from t2d_rt.types import Radar, Scene, Surface
from validation.report import Section, at_least, at_most, new_figure, save_chart

FREQUENCY_HZ, BEFORE_M, BEYOND_M = 77.87e9, 1.5, 1.5
HIDDEN_S, FAST_MPS = (1.6, 2.4), 4.5
"""When no part of the walker is visible, and beyond which speed there is none of him."""
CUPBOARD_M = (1.5, 0.6, 0.0), (1.9, 1.4, 2.2)


def run() -> Section:
    v, fraction = _across_an_edge()
    level, exact = 20 * np.log10(np.maximum(fraction, 1e-6)), knife_edge_db(v)
    alone, there = (_walk(scene) for scene in ("free_space", Scene(name="cupboard", surfaces=(_cupboard(),))))
    power = [10 ** (each.values / 10) for each in (alone, there)]
    time_s = alone.time_s.values
    loss_db = 10 * np.log10(power[0].sum(axis=0) / power[1].sum(axis=0))
    hidden = (time_s > HIDDEN_S[0]) & (time_s < HIDDEN_S[1])
    fast = np.abs(alone.velocity_mps.values) > FAST_MPS
    beyond_db = 10 * math.log10(power[1][fast].mean() / power[0][fast].mean())
    return Section(
        title="Edges",
        checks=[
            at_most("lit side of a knife edge", float(np.abs(level - exact)[v <= 0].max()), 2, "dB"),
            at_most("at the edge itself", abs(float(level[np.argmin(np.abs(v))]) + 6.02), 1, "dB"),
            at_least("walk behind a metal cupboard, down by", float(loss_db[hidden].min()), 20, "dB"),
            at_most(f"its power beyond {FAST_MPS:g} m/s beside that of the visible walk", beyond_db, 3, "dB"),
        ],
        note=f"A point {BEFORE_M + BEYOND_M:g} m away passes behind a screen half-way; v is the edge's height "
        "over the line of sight in units of sqrt(lambda d1 d2 / (2 (d1 + d2))). The walk (CMU 12_01, mesh, `table2`) goes "
        "across, 3 m away, behind a cupboard 1.5 m away and 0.8 m wide that stands free; before, its side face mirrors the walker.",
        charts=[_chart(v, level, exact, there, float(alone.values.max()))],
    )  # fmt: skip


def knife_edge_db(v: np.ndarray) -> np.ndarray:
    """Field behind a half-plane beside that without it [dB] (ITU-R P.526)."""
    from scipy.special import fresnel

    sine, cosine = fresnel(v)
    return np.asarray(20 * np.log10(np.hypot(1 - cosine - sine, cosine - sine) / 2))


def _across_an_edge() -> tuple[np.ndarray, np.ndarray]:
    """Heights v, and the fraction of the field."""
    corners = np.array([(BEFORE_M, y, z) for y, z in ((-3, -2), (0, -2), (0, 4), (-3, 4))], float)
    screen = Surface(
        name="screen", vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]), material="metal", thickness_m=0.01
    )
    v = np.linspace(-3, 3, 241)
    total = BEFORE_M + BEYOND_M
    height = -v * math.sqrt(SPEED_OF_LIGHT / FREQUENCY_HZ / 2 * BEFORE_M * BEYOND_M / total)
    points = np.array([total, 0, 1]) + np.outer(height * total / BEFORE_M, [0, 1, 0])
    mirrors = Mirrors.of(Scene(name="screen", surfaces=(screen,)), select("auto"))
    antenna, up = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0])
    found = find_paths(mirrors, antenna, up, FREQUENCY_HZ, order=0, probes_m=points)
    (direct,) = found.paths
    return v, found.edges.fraction(direct, points)


def _cupboard() -> Surface:
    from trimesh.creation import box

    solid = box(bounds=np.array(CUPBOARD_M))
    return Surface(
        name="cupboard", vertices=np.asarray(solid.vertices), faces=np.asarray(solid.faces), material="metal", thickness_m=0.001
    )  # fmt: skip


def _walk(scene: str | Scene) -> Any:
    motion = t2d.place(t2d.load_motion(resource("motions", "12_01_walk.bvh")), distance_m=3, angle_deg=-90)
    return t2d.simulate(motion, radar=Radar.preset("table2"), scene=scene, clutter="none").spectrogram


def _chart(v: np.ndarray, level: np.ndarray, exact: np.ndarray, image: Any, peak: float) -> str:
    figure, (left, right) = new_figure(figsize=(9, 3.6), ncols=2)
    left.plot(v, exact, "k", lw=1, label="knife edge (ITU-R P.526)")
    left.plot(v, np.where(level > -60, level, np.nan), "C1", label="fraction of rays")
    left.set(xlabel="v: lit < 0 < shadow", ylabel="Field [dB]", ylim=(-30, 4), xlim=(-3, 3))
    left.legend(loc="lower left")
    left.grid(alpha=0.3)
    drawn = right.pcolormesh(
        image.time_s, image.velocity_mps, image.values - peak, vmin=-60, vmax=0, rasterized=True, shading="nearest"
    )
    right.set(
        xlabel="Time [s]", ylabel="Radial velocity [m/s], approaching > 0", title="walk behind a cupboard", ylim=(-5, 4)
    )
    figure.colorbar(drawn, ax=right, label="Power relative to the peak while visible [dB]")
    return save_chart(figure, "edges.png")
