"""Methods that `simulate` does not offer: one point per facet, facets of even edges, and occlusion by ellipsoids."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any
from unittest.mock import patch

import numpy as np

import t2d_rt as t2d
from t2d_rt.accuracy import Wanted
from t2d_rt.experiment.experiment import Experiment
from t2d_rt.experiment.setup import set_up
from t2d_rt.geometry import Refinement, curved_refinements
from t2d_rt.propagation.images import images
from t2d_rt.propagation.occluders import PosedOccluders
from t2d_rt.propagation.visibility import OccluderScene, Occlusion
from t2d_rt.recording.recording import Recording
from t2d_rt.scattering.phase_integral import Ops, Parts
from t2d_rt.scattering.refinement import refined
from t2d_rt.simulate import recorded
from t2d_rt.types import Ellipsoids, MovingMesh
from validation.methods.chart.measure import FLAT, MEMORY_GB, Case

REFINED, INTEGRALS = "t2d_rt.scattering.mesh.refined", "t2d_rt.scattering.curved_integral.divided_differences"
OCCLUSION = "t2d_rt.pipeline.visibility.Occlusion"
SHRUNK, NEAR = 0.9, 1.15
"""Ellipsoids that occlude are smaller by the first, and occlude nothing of what lies within them enlarged by the second."""


def one_point_each(case: Case, edge_m: float | None) -> Recording:
    """Facets with one point each, cut to edges of at most `edge_m` everywhere: what aliases are its edges, not its curvature.

    None: the default's facets.
    """
    if edge_m is None:
        return _by(case, **{REFINED: flat, INTEGRALS: one_point})

    def cut(
        surface: MovingMesh, wavenumber: float, range_m: float, sagittas_rad: list[Any], max_facets: int
    ) -> list[Refinement]:
        return [
            cut_to(surface, edge_m, wavenumber, range_m),
            *refined(surface, wavenumber, range_m, sagittas_rad[1:], max_facets),
        ]

    found = _by(case, **{REFINED: cut, INTEGRALS: one_point})
    found.settings["facets"] = max(len(each.faces) for each in _cuts.values())
    return found


def flat(
    surface: MovingMesh, wavenumber: float, range_m: float, sagittas_rad: list[Any], max_facets: int
) -> list[Refinement]:
    """The default's facets without their bulge."""
    return [each.flattened(surface.rest) for each in refined(surface, wavenumber, range_m, sagittas_rad, max_facets)]


def _by(case: Case, **others: Any) -> Recording:
    """The default setting, some functions and classes of the simulation replaced by `others`."""
    settings = case.settings()
    scene = settings.pop("scene")
    with ExitStack() as replaced:
        for name, other in others.items():
            replaced.enter_context(patch(name, other))
        setup = set_up(case.motion, scene, Experiment.without_targets(**settings), memory_gb=MEMORY_GB)
        return recorded(setup, Wanted.of(None, None), "auto", None)


def cut_to(surface: MovingMesh, edge_m: float, wavenumber: float, range_m: float) -> Refinement:
    """The surface in facets of even edges; the last ones are kept."""
    key = edge_m, surface.rest.tobytes(), range_m
    if key not in _cuts:
        _cuts.clear()  # these are large
        (cut,) = curved_refinements(
            surface.rest, surface.faces, wavenumber=wavenumber, range_m=range_m, sagittas_rad=[FLAT],
            max_edge_m=edge_m, max_faces=20_000_000,
        )  # fmt: skip
        _cuts[key] = cut.flattened(surface.rest)
    return _cuts[key]


_cuts: dict[Any, Refinement] = {}


def one_point(p0: Any, p1: Any, p2: Any, *, ops: Ops, terms: int) -> tuple[Parts, Parts]:
    """F and dF of `divided_differences` where a facet has but the mean of its phases: exp(jp)/2 and (1 + jp) exp(jp)/2."""
    phase = (p0 + p1 + p2) * (1 / 3)
    sin, cos = ops.sincos(phase)
    sin, cos = sin / 2, cos / 2
    return (cos, sin), (cos - phase * sin, sin + phase * cos)


def occluded_by_ellipsoids(case: Case) -> Recording:
    """The default setting, occlusion by the segments' ellipsoids and worked out instead of traced."""
    return _by(case, **{OCCLUSION: _occlusion_by(t2d.segments(case.motion))})


def _occlusion_by(limbs: Ellipsoids) -> type[Occlusion]:
    """Visibility where the segments' ellipsoids occlude what lies behind them."""

    class ByEllipsoids(Occlusion):
        def visible(self, at: PosedOccluders, front: np.ndarray, scene: OccluderScene) -> np.ndarray:
            free, (centres, every) = front.copy(), limbs.at(at.times_s)
            for centre, axes, half in zip(centres.swapaxes(0, 1), every.swapaxes(0, 1), limbs.semi_axes_m, strict=True):
                # where the ellipsoid is the unit sphere
                start = np.einsum("kji,kqj->kqi", axes, at.points - centre[:, None]) / half
                stop = np.einsum("kji,kj->ki", axes, images(self.viewpoint)[-1] - centre)[:, None] / half
                segment = stop - start
                length2 = np.einsum("kqi,kqi->kq", segment, segment)
                nearest = np.clip(-np.einsum("kqi,kqi->kq", start, segment) / length2, 0, 1)
                miss2 = np.sum((start + nearest[..., None] * segment) ** 2, axis=2)
                free &= (miss2 > SHRUNK**2) | (np.sum(start**2, axis=2) < NEAR**2)
            return free

    return ByEllipsoids
