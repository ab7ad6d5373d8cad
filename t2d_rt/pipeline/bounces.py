"""Which targets take part in echoes of several bounces, and the scatterers of these echoes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from t2d_rt.core.backend import Backend
from t2d_rt.core.errors import warn
from t2d_rt.core.memory import MemoryLimit
from t2d_rt.propagation.edges import SceneBlockage
from t2d_rt.propagation.rays import Rays
from t2d_rt.scattering.bounces import Setting, TubeDetail, bounce_echoes
from t2d_rt.scattering.mesh import coherent_reflection
from t2d_rt.scattering.patches import PairPlaces, least_range_m
from t2d_rt.scattering.refinement import Sagitta, most_facets, refined
from t2d_rt.scattering.reflectors import Reflector
from t2d_rt.types import ByPart, Material, MovingMesh, PathPair, Radar
from t2d_rt.types.material import values_of
from t2d_rt.types.scatterer import Scatterer

SAME_S = 1e-3
"""Instants closer together than this [s] share the ray tubes of one of them."""
FRAMES = 2
"""Frames of ray tubes for each surface frame of a single bounce: directions between two surfaces change faster than those to the
antennas."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bouncing:
    """A target that may take part in echoes of several bounces."""

    name: str
    mesh: MovingMesh | None
    """The mesh of the target; None where ellipsoids scatter."""
    fast_rotating: bool
    material: Material | ByPart
    sagitta_rad: Sagitta
    """Phase sagitta of its facets [rad]."""
    times_s: np.ndarray
    """Surface frames of the target [s], (T,)."""

    @property
    def why_not(self) -> str | None:
        """Why the target takes no part in several bounces, as a sentence; None where it does."""
        if self.mesh is None:
            return (
                f"{self.name} is made of ellipsoids and takes no part in several bounces; method 'mesh' has them, "
                "unless ellipsoids keep to the tolerance"
            )
        if self.fast_rotating:
            return f"{self.name} rotates too fast for ray tubes and takes no part in several bounces"
        return None

    def reflector(self, radar: Radar, span_s: tuple[float, float], max_facets: int) -> Reflector:
        """The surface of the target for ray tubes, with the same facets as for a single bounce."""
        assert self.mesh is not None
        range_m = least_range_m(self.mesh, [PairPlaces.of(radar)], np.array(span_s))
        (facets,) = refined(self.mesh, 2 * math.pi / radar.wavelength_m, range_m, [self.sagitta_rad], max_facets)
        of_material = partial(coherent_reflection, frequency_hz=radar.mid_frequency_hz)
        gamma = values_of(self.material, len(self.mesh.faces), of_material)
        return Reflector(surface=self.mesh, facets=facets, reflection=gamma[facets.base_face])


def direct_pair(pairs: Sequence[PathPair], bounces: int, *, warned: bool) -> PathPair | None:
    """The pair without mirrors or slabs, on which several bounces are modelled. None, with a warning if `warned`, where there is
    none."""
    direct = [pair for pair in pairs if not pair.out.chain and not pair.back.chain]
    if not direct and warned:
        warn(f"no direct path leads from the radar to the targets, so there are no echoes of {bounces} bounces")
    return direct[0] if direct else None


def bounce_scatterers(
    targets: Sequence[Bouncing],
    radar: Radar,
    *,
    span_s: tuple[float, float],
    samples_s: np.ndarray | None,
    bounces: int,
    direct: tuple[PathPair, SceneBlockage] | None,
    backend: Backend,
    memory: MemoryLimit,
) -> list[Scatterer]:
    """Scatterers of the echoes of 2 to `bounces` bounces between targets; warns of each target that takes no part in them.

    Ray tubes are traced at `samples_s`, or at the targets' frames where these are single instants (None). In a scene only the
    `direct` path pair leads to the targets and back; None is free space.
    """
    if samples_s is not None:
        for target in targets:
            if target.why_not is not None:
                warn(target.why_not)
    taking = [target for target in targets if target.why_not is None]
    if not taking:
        return []
    times_s = max((target.times_s for target in taking), key=len)
    if samples_s is not None:
        times_s = np.linspace(times_s[0], times_s[-1], FRAMES * (len(times_s) - 1) + 1)
    setting = Setting(
        radar=radar,
        scene=partial(Rays, backend=backend),
        backend=backend,
        unblocked=None if direct is None else partial(_unblocked, *direct),
        memory=memory,
    )
    echoes = bounce_echoes(
        [target.reflector(radar, span_s, most_facets(memory)) for target in taking],
        setting,
        times_s=times_s,
        samples_s=_apart(times_s) if samples_s is None else samples_s,
        detail=TubeDetail(bounces=bounces),
    )
    return [echoes] if echoes.echoes else []


def _unblocked(
    pair: PathPair, blockage: SceneBlockage, out_m: np.ndarray, back_m: np.ndarray, times_s: np.ndarray
) -> np.ndarray:
    return np.asarray(blockage.fraction(pair.out, out_m, times_s) * blockage.fraction(pair.back, back_m, times_s))


def _apart(times_s: np.ndarray) -> np.ndarray:
    """Some of the instants, ascending, at least `SAME_S` apart from one another; every other instant follows one of them within
    `SAME_S`."""
    instants: list[float] = []
    for time_s in np.unique(times_s).tolist():
        if not instants or time_s - instants[-1] > SAME_S:
            instants.append(time_s)
    return np.array(instants)
