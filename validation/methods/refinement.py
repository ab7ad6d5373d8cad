"""How the error falls with the facets' size."""

from __future__ import annotations

import numpy as np

import t2d_rt as t2d
from t2d_rt.body.materials import resolve_material
from t2d_rt.types import MovingMesh, Radar
from validation.bodies import random_chirps, walking
from validation.methods.reference import Converged, nmse_db, reference_samples, refined
from validation.report import Check, Section, new_figure, save_chart

SAGITTAS_RAD = (0.8, 0.4, 0.2, 0.1)
REFERENCE_RAD = 0.05
SURFACE_RATE_HZ = 300.0
FRAMES = 49
"""Of the mesh that the body is copied to for flat facets."""
LIMIT_DB = -40.0
CHIRPS, SAMPLES = 16, (20, 128, 236)


def run() -> Section:
    radar = Radar.preset("table2")
    curved = walking(1.9, 2.3)
    times_s = np.linspace(curved.times_s[0], curved.times_s[-1], FRAMES)
    flat = MovingMesh(curved.at(times_s), curved.faces, times_s, "skin")
    rows, charted = [], {}
    for name, surface in (("flat, a mesh of the user", flat), ("curved, a body", curved)):
        edges, errors = _errors(surface, radar)
        steps = np.diff(errors) / np.diff(np.log2(edges[:, 1]))
        for sagitta, (faces, edge), error, step in zip(SAGITTAS_RAD, edges, errors, ["", *steps], strict=True):
            rows.append({
                "facets": name, "sagitta rad": sagitta, "number": int(faces), "mean edge mm": edge, "field NMSE dB": error,
                "dB per halving of the edge": step,
            })  # fmt: skip
        charted[name] = edges[:, 1], errors
    edge_mm, errors = charted["flat, a mesh of the user"]
    order = np.polyfit(np.log2(edge_mm[:-1]), errors[:-1], 1)[0]
    steps = np.diff(errors) / np.diff(np.log2(edge_mm))
    checks = [
        Check(
            what="flat facets: error over edge, fit, per halving of the edge",
            measured=order, limit=6, unit="dB", at_least=True,
        ),
        Check(what="the same, smallest step", measured=steps.min(), limit=6, unit="dB", at_least=True),
        Check(
            what="curved facets: greatest error, at 0.8 rad and less",
            measured=float(charted["curved, a body"][1].max()), limit=LIMIT_DB, unit="dB",
        ),
    ]  # fmt: skip
    return Section(
        title="Refinement",
        checks=checks,
        note="Walking body, skin with its diffuse part, no occlusion but of back faces, surface rate "
        f"{SURFACE_RATE_HZ:g} Hz so that interpolation in time does not cover the error; reference: facets of "
        f"{REFERENCE_RAD} rad, in curved ones of four times that, whose own error flatters the finest row: the fit leaves it out. "
        "What curved facets are left with, some -51 dB, is float32, time and the reference itself. The limit on the "
        "sagitta is one number for the whole body here; the mean edge is weighted by area.",
        table=rows,
        charts=[_chart(charted, order)],
    )


def _errors(surface: MovingMesh, radar: Radar) -> tuple[np.ndarray, np.ndarray]:
    """Number of facets and mean edge [mm] at each sagitta, and the error [dB]."""
    chirps = random_chirps(surface, radar, CHIRPS)
    how = Converged(
        material=resolve_material("skin", radar.mid_frequency_hz), sagitta_rad=REFERENCE_RAD, occlusion=False
    )
    reference = reference_samples(surface, radar, chirps, np.array(SAMPLES), how)
    found, errors = [], []
    for sagitta in SAGITTAS_RAD:
        accuracy = {"sagitta_rad": sagitta, "surface_rate_hz": SURFACE_RATE_HZ, "occlusion": False}
        cube = t2d.simulate(surface, radar=radar, accuracy=accuracy).cube[:, 0]
        faces, edge_m = mean_edge(surface, radar, sagitta)
        found.append((faces, 1e3 * edge_m))
        errors.append(nmse_db(cube[np.ix_(chirps, SAMPLES)], reference))
    return np.array(found), np.array(errors)


def mean_edge(surface: MovingMesh, radar: Radar, sagitta_rad: float) -> tuple[int, float]:
    """Facets and their mean edge at rest [m], each weighted by its facet's area."""
    fine = refined(surface, radar, sagitta_rad)
    corners = fine.at(surface.rest)[fine.faces]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return len(fine.faces), float(np.average(sides.mean(axis=1), weights=area))


def _chart(charted: dict[str, tuple[np.ndarray, np.ndarray]], order: float) -> str:
    figure, axis = new_figure()
    for name, (edges, errors) in charted.items():
        axis.semilogx(edges, errors, "o-", label=name)
    edges, errors = charted["flat, a mesh of the user"]
    axis.semilogx(edges, errors[0] + 6 * np.log2(edges / edges[0]), "k:", label="6 dB per halving of the edge")
    axis.set(xlabel="mean edge of the facets [mm]", ylabel="field NMSE [dB]")
    axis.set_title(f"walking body, skin; flat facets gain {order:.1f} dB per halving")
    axis.set_xticks(edges, [f"{edge:.1f}" for edge in edges])
    axis.minorticks_off()
    axis.legend()
    axis.grid(alpha=0.3)
    return save_chart(figure, "refinement.png")
