"""The methods on the chart, each over its knob."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any
from unittest import mock

import numpy as np

import t2d_rt as t2d
from t2d_rt import targets, visibility
from t2d_rt.body.materials import resolve_material
from t2d_rt.geometry import Refinement, refine
from t2d_rt.propagation.visibility import Occlusion, VisibilitySamples
from t2d_rt.result import Recording
from t2d_rt.scattering import facets, mesh
from t2d_rt.scattering.patches import least_range_m
from t2d_rt.scattering.phase_integral import Ops, Parts
from t2d_rt.scattering.refinement import MOST_FACETS
from t2d_rt.targets import skin
from t2d_rt.types import Ellipsoids, MovingMesh
from validation.methods.chart.measure import Case

FLAT = 1e6
"""A phase sagitta [rad] that asks for no refinement."""
SHRUNK, NEAR = 0.9, 1.15
"""Ellipsoids that hide are smaller by the first, and hide nothing of what lies within them enlarged by the second."""


@dataclass(frozen=True, slots=True)
class Method:
    """One line of the chart."""

    name: str
    unit: str
    """Of the knob."""
    run: Callable[[Case, Any], Recording]
    values: tuple[Any, ...]
    few: tuple[Any, ...] = ()
    """Values for other motions in free space and the walk in rooms."""
    brief: tuple[Any, ...] = ()
    """Values where other motions are in rooms."""
    rooms_only: bool = False


def simulated(case: Case, *, scale: float = 1.0, **options: Any) -> Recording:
    """`simulate` with the body's phase sagitta scaled: 1 is the default setting."""

    def skinned(*args: Any, **more: Any) -> MovingMesh:
        body = skin(*args, **more)
        return MovingMesh.from_track(
            body.track, body.faces, body.times_s, body.material, rest=body.rest, crease_deg=body.crease_deg,
            sagitta_rad=scale * np.asarray(body.sagitta_rad), name=body.name, made=body.made,
        )  # fmt: skip

    with mock.patch.object(targets, "skin", skinned):
        return t2d.simulate(case.motion, **{**case.settings(), **options})


def one_point_each(case: Case, edge_m: float) -> Recording:
    """Facets with one point each, cut to edges of at most `edge_m` everywhere: what aliases are its edges, not its curvature."""

    def cut(
        surface: MovingMesh, wavenumber: float, range_m: float, sagittas_rad: list[Any], max_facets: int
    ) -> list[Refinement]:
        return [
            cut_to(surface, edge_m, wavenumber, range_m),
            *_refined(surface, wavenumber, range_m, sagittas_rad[1:], max_facets),
        ]

    with (
        mock.patch.object(mesh, "refined", cut),
        mock.patch.object(facets, "divided_differences", one_point),
    ):
        return simulated(case)


def cut_to(surface: MovingMesh, edge_m: float, wavenumber: float, range_m: float) -> Refinement:
    """The surface in facets of even edges; the last ones are kept."""
    key = edge_m, surface.rest.tobytes(), range_m
    if key not in _cuts:
        _cuts.clear()  # these are large
        _cuts[key] = refine(
            surface.rest, surface.faces, wavenumber=wavenumber, range_m=range_m, sagitta_rad=FLAT,
            max_edge_m=edge_m, crease_deg=surface.crease_deg, max_faces=20_000_000,
        )  # fmt: skip
    return _cuts[key]


_refined = mesh.refined
_cuts: dict[Any, Refinement] = {}


def one_point(p0: Any, p1: Any, p2: Any, *, ops: Ops, terms: int) -> tuple[Parts, Parts]:
    """F and dF of `divided_differences` where a facet has but the mean of its phases: exp(jp)/2 and (1 + jp) exp(jp)/2."""
    phase = (p0 + p1 + p2) * (1 / 3)
    sin, cos = ops.sincos(phase)
    sin, cos = sin / 2, cos / 2
    return (cos, sin), (cos - phase * sin, sin + phase * cos)


def by_tolerance(case: Case, tolerance_db: float) -> Recording:
    """Settings that follow from a tolerance; the time to find them is in it, that to measure the error is not."""
    return simulated(case, tolerance_db=tolerance_db, measure_error=False)


def seen_by(case: Case, how: str) -> Recording:
    """The default setting with what is hidden found in another way."""
    if how == "none":
        return simulated(case, accuracy={"occlusion": False})
    if how == "capsules":
        with mock.patch.object(visibility, "Occlusion", _capsules(t2d.segments(case.motion))):
            return simulated(case)
    if how == "full mesh":
        return _through_the_fine_mesh(case)
    return simulated(case)


def _through_the_fine_mesh(case: Case) -> Recording:
    """Facets that are traced at their own vertices: the fine mesh stands for the cage.

    Diffuse points belong to the cage, so they are made by themselves, and both are added.
    """
    material = resolve_material("skin", case.radar.mid_frequency_hz)
    rough = material.scattering_coefficient

    def fine(*args: Any, **more: Any) -> MovingMesh:
        cage = skin(*args, **more)
        cut = least_range_m(cage, [(case.radar.tx_position_m, case.radar.rx_position_m)], cage.times_s)
        (found,) = _refined(cage, 2 * np.pi / case.radar.wavelength_m, cut, [cage.sagitta_rad], MOST_FACETS)
        return MovingMesh.from_track(
            lambda times_s: _applied(found.operator, cage.at(times_s)), found.faces, cage.times_s,
            rest=found.operator @ cage.rest, crease_deg=0, sagitta_rad=FLAT,
        )  # fmt: skip

    with mock.patch.object(targets, "skin", fine):
        smooth = t2d.simulate(case.motion, **case.settings(), material=replace(material, scattering_coefficient=0.0))
    points = simulated(case, scale=FLAT, material=replace(material, scattering_coefficient=1.0))
    cube = np.sqrt(1 - rough**2) * smooth.cube[:] + rough * points.cube[:]
    return Recording(cube.astype(np.complex64), case.radar, settings=smooth.settings)


def _applied(operator: Any, cage: np.ndarray) -> np.ndarray:
    rows = operator @ cage.transpose(1, 0, 2).reshape(cage.shape[1], -1)
    return np.asarray(rows.reshape(-1, len(cage), 3).transpose(1, 0, 2))


def _capsules(limbs: Ellipsoids) -> type[Occlusion]:
    """Visibility where the segments' ellipsoids hide what lies behind them, worked out and not traced."""

    class Capsules(Occlusion):
        def sampled(self, times_s: np.ndarray) -> VisibilitySamples:
            self.now = limbs.at(times_s)
            return super().sampled(times_s)

        def visible(self, vertices: np.ndarray, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
            free = np.ones(points.shape[:2], bool)
            for centre, axes, half in zip(
                self.now[0].swapaxes(0, 1), self.now[1].swapaxes(0, 1), limbs.semi_axes_m, strict=True
            ):
                # where the ellipsoid is the unit sphere
                start = np.einsum("kji,kqj->kqi", axes, points - centre[:, None]) / half
                stop = np.einsum("kji,kj->ki", axes, self._viewpoint - centre)[:, None] / half
                segment = stop - start
                length2 = np.einsum("kqi,kqi->kq", segment, segment)
                nearest = np.clip(-np.einsum("kqi,kqi->kq", start, segment) / length2, 0, 1)
                miss2 = np.sum((start + nearest[..., None] * segment) ** 2, axis=2)
                free &= (miss2 > SHRUNK**2) | (np.sum(start**2, axis=2) < NEAR**2)
            return free

    return Capsules


def _ellipsoids(phase_from: str) -> Callable[[Case, float], Recording]:
    return lambda case, rate: simulated(
        case, method="ellipsoid", phase_from=phase_from, accuracy={"surface_rate_hz": rate}
    )


DEFAULT = "facets in closed form", "1"
"""Method and setting, in words, of what `simulate` does when nothing is asked for."""
SUMMED = "facets with one point each, summed chirp by chirp"
"""A method that makes no record (`slow.point_sums`)."""
METHODS = (
    Method("ellipsoids from the centre", "Hz", _ellipsoids("centre"), (25.0, 60.0, 200.0), (60.0,)),
    Method("ellipsoids from the specular point", "Hz", _ellipsoids("specular"), (25.0, 60.0, 200.0), (60.0,), (60.0,)),
    Method("facets with one point each", "m edge", one_point_each, (0.016, 0.008, 0.004, 0.003, 0.0025, 0.002), (0.008,)),
    Method(
        "facets in closed form", "x sagitta", lambda case, scale: simulated(case, scale=scale),
        (FLAT, 16.0, 8.0, 4.0, 2.0, 1.0, 0.5, 0.25), (FLAT, 4.0, 1.0, 0.5), (4.0, 1.0),
    ),
    Method(
        "surface rate", "Hz", lambda case, rate: simulated(case, accuracy={"surface_rate_hz": rate}),
        (25.0, 40.0, 100.0, 200.0, 400.0), (30.0,),
    ),
    Method("visibility", "", seen_by, ("none", "capsules", "full mesh"), ("none", "capsules")),
    Method(
        "wall order", "reflections", lambda case, order: simulated(case, reflections=order), (0, 1, 2, 3), (0, 1, 3),
        (0, 1), rooms_only=True,
    ),
    Method("by tolerance", "dB", by_tolerance, (-10.0, -15.0, -20.0, -25.0, -30.0), (-12.0, -18.0), (-12.0,)),
)  # fmt: skip
