"""A Lambertian sphere (S = 1): mean RCS over seeds, and the same realisation whatever the faces."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import quad
from scipy.spatial import ConvexHull

import t2d_rt as t2d
from t2d_rt.core.backend import select
from t2d_rt.scattering.mesh import Detail, mesh_echoes
from t2d_rt.scattering.paths import View
from t2d_rt.types import Material, MovingMesh, Radar
from validation.report import Check, Section, new_figure, save_chart

RADIUS_M, RANGE_M = 0.15, 10.0
SEEDS, ASPECTS, CUBE_SEEDS = 200, 16, 4
FACES = (2_000, 50_000)
ROUGH = Material(name="lambertian", relative_permittivity=math.inf, scattering_coefficient=1.0)
STEP_S = 0.1
SAGITTA_RAD = 2.0
"""The facets carry no coherent part here: they may be coarse."""


def run() -> Section:
    radar = Radar.preset("table2")
    fields = {faces: _fields(radar, faces) for faces in FACES}
    expected = 8 / 3 * math.pi * RADIUS_M**2 * near_field()
    checks = [
        Check(what=f"mean RCS, {faces} faces, against (8/3) pi a^2", measured=abs(_db(rcs.mean() / expected)), limit=0.5, unit="dB")
        for faces, rcs in ((f, np.abs(e) ** 2) for f, e in fields.items())
    ]  # fmt: skip
    few, many = fields.values()
    together = abs(np.vdot(few, many)) / np.linalg.norm(few) / np.linalg.norm(many)
    each = np.abs(np.sum(few.conj() * many, axis=1)) / np.linalg.norm(few, axis=1) / np.linalg.norm(many, axis=1)
    checks += [
        Check(what="same seed at both, correlation of the fields", measured=together, limit=0.95, unit="", at_least=True),
        Check(what="the same, worst seed", measured=each.min(), limit=0.95, unit="", at_least=True),
        Check(what=f"ADC cube against the echo level, {CUBE_SEEDS} seeds", measured=_from_cube(radar, few), limit=0.1, unit="dB"),
    ]  # fmt: skip
    return Section(
        title="Lambertian sphere",
        checks=checks,
        note=f"Radius {RADIUS_M} m at {RANGE_M:g} m, S = 1, |Gamma| = 1; {SEEDS} seeds, each seen from {ASPECTS} sides "
        "(the sphere turns by 22.5 degrees). Fields are the sums of the echoes at mid-sweep (what `synthesize` "
        "would put there); a few seeds are read back from the ADC cube of `simulate` besides. RCS is referred to "
        f"the centre's range; that the lit side is nearer than the centre adds {_db(near_field()):.2f} dB, which "
        "is part of what is expected.",
        table=_spread(fields, expected),
        charts=[_chart(fields, expected)],
    )


def turning_sphere(faces: int) -> MovingMesh:
    """A sphere of about so many faces that turns by 22.5 degrees every STEP_S."""
    points = _fibonacci(faces // 2 + 2)
    triangles = ConvexHull(points).simplices
    corners = points[triangles]
    inward = np.linalg.det(corners) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    angle = np.arange(ASPECTS + 1) * 2 * math.pi / ASPECTS
    cos, sin, zero, one = np.cos(angle), np.sin(angle), np.zeros(len(angle)), np.ones(len(angle))
    rotations = np.array([[cos, -sin, zero], [sin, cos, zero], [zero, zero, one]]).transpose(2, 0, 1)
    vertices = RADIUS_M * np.einsum("kij,vj->kvi", rotations, points) + [RANGE_M, 0, 1]
    return MovingMesh(vertices, triangles, STEP_S * np.arange(len(angle)), ROUGH, sagitta_rad=SAGITTA_RAD)


def near_field() -> float:
    """Mean RCS at RANGE_M over that far away: (R_0/r)^4 under the integral of 4 cos_i^2 over the lit side."""

    def density(u: float) -> float:
        r = math.sqrt(RANGE_M**2 + RADIUS_M**2 - 2 * RANGE_M * RADIUS_M * u)
        cosine = max((RANGE_M * u - RADIUS_M) / r, 0.0)
        return 3 * cosine**2 * (RANGE_M / r) ** 4

    return quad(density, RADIUS_M / RANGE_M, 1)[0]


def _fibonacci(count: int) -> np.ndarray:
    """Points spread evenly over the unit sphere (count, 3)."""
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = math.pi * (1 + math.sqrt(5)) * np.arange(count)
    return np.stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z], axis=1)


def _fields(radar: Radar, faces: int) -> np.ndarray:
    """sqrt(RCS) with phase (SEEDS, ASPECTS), sum of the echoes at mid-sweep."""
    sphere = turning_sphere(faces)
    backend = select("auto")
    out = np.empty((SEEDS, ASPECTS), np.complex128)
    for seed in range(SEEDS):
        echoes = mesh_echoes(
            sphere, radar, times_s=sphere.times_s, material=ROUGH, detail=Detail(sagitta_rad=SAGITTA_RAD), seed=seed,
            views=[View()], backend=backend,
        )  # fmt: skip
        delay, amplitude, *_ = echoes.frames(0, ASPECTS)
        cycles = radar.mid_frequency_hz * delay
        out[seed] = np.sum(amplitude * np.exp(2j * math.pi * (cycles % 1)), axis=1)
    return out * RANGE_M**2 / radar.link_amplitude


def _from_cube(radar: Radar, fields: np.ndarray) -> float:
    """Worst difference [dB] between total power over the aspects in the ADC cube and at the echo level."""
    slow = radar.replace(prf_hz=1 / STEP_S)
    sphere, worst = turning_sphere(FACES[0]), 0.0
    for seed in range(CUBE_SEEDS):
        found = t2d.simulate(
            sphere, radar=slow, accuracy={"surface_rate_hz": 1 / STEP_S, "occlusion": False}, seed=seed
        )
        middle = found.cube[:ASPECTS, 0, radar.samples // 2 - 1 : radar.samples // 2 + 1]
        power = np.sum(np.abs(middle) ** 2) / 2 * RANGE_M**4 / radar.link_amplitude**2
        worst = max(worst, abs(_db(power / np.sum(np.abs(fields[seed]) ** 2))))
    return worst


def _spread(fields: dict[int, np.ndarray], expected: float) -> list[dict]:
    rows = []
    for faces, field in fields.items():
        rcs = np.abs(field) ** 2
        rows.append({
            "faces": faces, "mean over all, dB": _db(rcs.mean() / expected),
            "mean over seeds, one side, dB": _db(rcs[:, 0].mean() / expected),
            "standard deviation / mean (speckle: 1)": rcs.std() / rcs.mean(),
        })  # fmt: skip
    return rows


def _chart(fields: dict[int, np.ndarray], expected: float) -> str:
    figure, axis = new_figure()
    for faces, field in fields.items():
        axis.hist(
            np.abs(field).ravel() ** 2 / expected,
            bins=np.linspace(0, 5, 41),
            density=True,
            histtype="step",
            label=f"{faces} faces",
        )
    x = np.linspace(0, 5, 101)
    axis.plot(x, np.exp(-x), "k:", label="exponential (speckle)")
    axis.set(xlabel="RCS / ((8/3) pi a^2)", ylabel="density", title="Lambertian sphere")
    axis.legend()
    return save_chart(figure, "lambertian_speckle.png")


def _db(ratio: float) -> float:
    return 10 * math.log10(ratio)
