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
CHIRPS, SAMPLES = 16, (20, 128, 236)


def run() -> Section:
    radar = Radar.preset("table2")
    surface = walking(1.9, 2.3)
    chirps = random_chirps(surface, radar, CHIRPS)
    material = resolve_material("skin", radar.mid_frequency_hz)
    reference = reference_samples(
        surface,
        radar,
        chirps,
        np.array(SAMPLES),
        Converged(material=material, sagitta_rad=REFERENCE_RAD, occlusion=False),
    )
    rows = []
    for sagitta in SAGITTAS_RAD:
        cube = t2d.simulate(
            surface,
            radar=radar,
            accuracy={"sagitta_rad": sagitta, "surface_rate_hz": SURFACE_RATE_HZ, "occlusion": False},
        ).cube[:, 0]
        faces, edge = mean_edge(surface, radar, sagitta)
        error = nmse_db(cube[np.ix_(chirps, SAMPLES)], reference)
        rows.append({"sagitta rad": sagitta, "faces": faces, "mean edge mm": 1e3 * edge, "field NMSE dB": error})
    edges, errors = (np.array([row[key] for row in rows]) for key in ("mean edge mm", "field NMSE dB"))
    order = np.polyfit(np.log2(edges[:-1]), errors[:-1], 1)[0]
    steps = np.diff(errors) / np.diff(np.log2(edges))
    for row, step in zip(rows[1:], steps, strict=True):
        row["dB per halving of the edge"] = step
    rows[0]["dB per halving of the edge"] = ""
    checks = [
        Check(what="error over edge, fit, per halving of the edge", measured=order, limit=6, unit="dB", at_least=True),
        Check(what="the same, smallest step", measured=steps.min(), limit=6, unit="dB", at_least=True),
    ]
    return Section(
        title="Refinement",
        checks=checks,
        note="Walking body, skin with its diffuse part, no occlusion but of back faces, surface rate "
        f"{SURFACE_RATE_HZ:g} Hz so that interpolation in time does not cover the error; reference: facets of "
        f"{REFERENCE_RAD} rad, whose own error flatters the finest row: the fit leaves it out. The limit on the "
        "sagitta is one number for the whole body here; the mean edge is weighted by area.",
        table=rows,
        charts=[_chart(edges, errors, order)],
    )


def mean_edge(surface: MovingMesh, radar: Radar, sagitta_rad: float) -> tuple[int, float]:
    """Facets and their mean edge at rest [m], each weighted by its facet's area."""
    fine = refined(surface, radar, sagitta_rad)
    corners = fine.at(surface.rest)[fine.faces]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return len(fine.faces), float(np.average(sides.mean(axis=1), weights=area))


def _chart(edges: np.ndarray, errors: np.ndarray, order: float) -> str:
    figure, axis = new_figure()
    axis.semilogx(edges, errors, "o-", label=f"body, fit without the finest: {order:.1f} dB per halving of the edge")
    axis.semilogx(edges, errors[0] + 6 * np.log2(edges / edges[0]), "k:", label="6 dB per halving of the edge")
    axis.set(xlabel="mean edge of the facets [mm]", ylabel="field NMSE [dB]", title="refinement, walking body, skin")
    axis.set_xticks(edges, [f"{edge:.1f}" for edge in edges])
    axis.minorticks_off()
    axis.legend()
    axis.grid(alpha=0.3)
    return save_chart(figure, "refinement.png")
