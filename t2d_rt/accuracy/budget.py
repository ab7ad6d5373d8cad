"""The error budget: what each simplification of a model adds to the field error, predicted by the fitted laws."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from t2d_rt.accuracy.cost import FacetCount, facet_counts, seconds, work_units
from t2d_rt.accuracy.error_laws import MOST_DB, SMALL_SCATTER_DB, FacetLaw, Law, Laws
from t2d_rt.accuracy.occlusion import Occluded
from t2d_rt.pipeline.echo_model import Model, sagitta_rad
from t2d_rt.pipeline.path_pairs import Clutter
from t2d_rt.types import Accuracy, Motion, MovingMesh, PathTier

OCCLUSION = "occlusion of targets by themselves and one another"
FAST_OCCLUSION = "occlusion by targets that rotate fast, and of them by themselves"
NEGLIGIBLE = 1e-6
"""Fraction of the field's energy below which a simplification is not listed."""
SURELY = 2.0
"""How many standard deviations of a law are added to its prediction before the sum is compared with the tolerance."""
PATCHES_DB, PATCHES_SCATTER_DB = -35.0, 3.0
"""Field error [dB] that a body's patches cause at the default change of phase from frame to frame, which the law of facets already
includes, and its standard deviation. The error energy goes with the square of the phase change. (Of eleven motions with splines at
-20 dB, the worst had -23 dB at twice the default and -17 dB at four times.)"""
BODY_SAGITTA_RAD = 1.5
"""Phase sagitta [rad] by which the law of facets knows a body whose facets follow its own sagittas, one for each vertex."""


@dataclass(frozen=True, slots=True)
class Omission:
    """Something that a simulation leaves out or simplifies."""

    what: str
    error_db: float
    """Field error that this simplification causes [dB]."""
    scatter_db: float = 0.0
    """Standard deviation of the law that predicts it [dB]."""
    taken: bool = True
    """Whether the simulation makes this simplification; False for one that it could make but whose error would be too great."""
    law: str = ""
    """Name of the law that predicts the error. Margins of one law add up, for its deviations are the same in all of them."""

    @property
    def energy(self) -> float:
        """The error as energy, relative to the energy of the field."""
        return ratio(self.error_db)

    @property
    def margin(self) -> float:
        """Energy that `SURELY` standard deviations of the law add to the error, relative to that of the field."""
        return ratio(self.error_db + SURELY * self.scatter_db) - self.energy


@dataclass(frozen=True, slots=True)
class Total:
    """A sum of errors as energies. Margins of the same law add up, those of different laws add in quadrature."""

    energy: float = 0.0
    margins: Mapping[str, float] = field(default_factory=dict)
    """Margin of each law, as energy."""

    @classmethod
    def of(cls, parts: Iterable[Omission]) -> Total:
        """The sum over simplifications."""
        omitted, margins = [part for part in parts if part.taken], dict[str, float]()
        for omission in omitted:
            margins[omission.law] = margins.get(omission.law, 0.0) + omission.margin
        return cls(sum(omission.energy for omission in omitted), margins)

    def __add__(self, other: Total) -> Total:
        laws = self.margins.keys() | other.margins.keys()
        margins = {law: self.margins.get(law, 0.0) + other.margins.get(law, 0.0) for law in sorted(laws)}
        return Total(self.energy + other.energy, margins)

    @property
    def margin(self) -> float:
        """Margin of the sum, as energy."""
        return math.hypot(*self.margins.values())

    @property
    def surely(self) -> float:
        """Energy that the error is unlikely to exceed: the sum and its margin."""
        return self.energy + self.margin


@dataclass(frozen=True)
class ErrorBudget:
    """The parts of the field error of a model at any accuracy, predicted by the fitted laws."""

    model: Model
    given: Accuracy
    """The accuracy that the user gave. Its fields that are set say how fine the facets of the targets are."""
    laws: Laws = field(default_factory=Laws.fitted)

    @cached_property
    def counts(self) -> list[FacetCount]:
        """The estimated number of facets of each mesh, as a function of the sagitta scale."""
        return facet_counts(self.model, self.given)

    @cached_property
    def unoccluded(self) -> Law:
        """Predicted error of a run that traces no occlusion; computed once."""
        return self._unoccluded(self._occluded)

    def _unoccluded(self, occluded: Occluded) -> Law:
        return Law(occluded.level_db() + self.laws.occlusion.mean_db, self.laws.occlusion.scatter_db)

    @cached_property
    def unoccluded_by_fast(self) -> Law:
        """Predicted error from leaving out occlusion by fast-rotating targets, which no run traces; computed once."""
        fastest = Accuracy(fast_rotating_hz=self.given.fastest_sampled_hz)
        return self._unoccluded(Occluded.of(self.model, fastest, by_fast=True))

    @cached_property
    def _occluded(self) -> Occluded:
        return Occluded.of(self.model, Accuracy(fast_rotating_hz=self.given.fastest_sampled_hz))

    @cached_property
    def _meshes(self) -> list[tuple[float, FacetLaw]]:
        """For each mesh, the phase sagitta [rad] of its facets at a sagitta scale of 1, and the law of their error."""
        meshes = []
        for mesh in self.model.geometries:
            if isinstance(mesh, MovingMesh):
                own_sagitta = float(np.max(sagitta_rad(mesh, self.given.replace(sagitta_scale=1.0))))
                sagitta = BODY_SAGITTA_RAD if mesh.curved and self.given.sagitta_rad is None else own_sagitta
                bodies = self.laws.bodies.at_size(self._size(mesh), body=mesh.refined_as is not None)
                meshes.append((sagitta, bodies if mesh.curved else self.laws.smooth))
        return meshes

    @cached_property
    def unsure(self) -> bool:
        """Whether all targets are meshes for which the law of facets has a great scatter, such as small bodies."""
        scatters = [law.scatter_db for _, law in self._meshes]
        return len(scatters) == len(self.model.geometries) and min(scatters) >= SMALL_SCATTER_DB

    def facet_count(self, scale: float) -> float:
        """Estimated number of facets of all meshes together at a sagitta scale."""
        return sum(count.at(scale) for count in self.counts)

    def _size(self, mesh: MovingMesh) -> float:
        """Largest extent of a mesh along x, y or z, in wavelengths."""
        return float(np.ptp(mesh.rest, axis=0).max()) / self.model.radar.wavelength_m

    def facets(self, tier: PathTier, scale: float) -> tuple[float, FacetLaw]:
        """Phase sagitta [rad] of the mesh whose facets have the greatest error over a tier's paths at a sagitta scale, and its
        law."""
        facets = []
        for mesh_sagitta, law in self._meshes:
            finest = mesh_sagitta * scale
            facets.append((max(finest, min(tier.sagitta_scale * finest, tier.greatest_sagitta_rad)), law))
        return max(facets, key=lambda facet: facet[1].error_db(facet[0]), default=(math.nan, self.laws.bodies))

    @cached_property
    def power(self) -> np.ndarray:
        """Power of each ranked path pair relative to the power of all of them, (P,); ones (1,) in free space."""
        power = 10 ** (np.array([pair.mean_db for pair in self.model.ranked]) / 10)
        return power / power.sum() if len(power) else np.ones(1)

    def omissions(self, accuracy: Accuracy) -> list[Omission]:
        """The field error of each simplification that a run of this accuracy makes, and of some that it might make but does not."""
        tiers = list(self.tiers(accuracy))
        of_paths = [*self.of_tiers(tiers, accuracy.sagitta_scale), *self.of_spectra(accuracy)]
        return [*self.in_time(accuracy), *of_paths, *self.of_visibility(accuracy), *self.untraced(accuracy)]

    def of_visibility(self, accuracy: Accuracy) -> list[Omission]:
        """The error of leaving out occlusion, or else that of sampling visibility, and that of occlusion which no run traces."""
        if not self.counts:
            return []
        law, fast = self.unoccluded, self.unoccluded_by_fast
        never = [Omission(FAST_OCCLUSION, fast.mean_db, fast.scatter_db, law="occlusion")]
        if math.isinf(fast.mean_db):
            never = []
        if not accuracy.occlusion:
            return [Omission(OCCLUSION, law.mean_db, law.scatter_db, law="occlusion"), *never]
        rate_hz, n = accuracy.visibility_rate_hz, accuracy.visibility_subdivision
        bodies = [mesh for mesh in self.model.geometries if isinstance(mesh, MovingMesh) and mesh.curved]
        smallest = min((self._size(mesh) for mesh in bodies), default=math.inf)
        edges = self.laws.sampled(law.mean_db, rate_hz, n, smallest)
        nothing = Omission(OCCLUSION, law.mean_db, law.scatter_db, taken=False)
        what = f"shadows' edges, {sampled(rate_hz, n)}"
        return [nothing, Omission(what, edges.mean_db, edges.scatter_db, law="shadows"), *never]

    def untraced(self, accuracy: Accuracy) -> list[Omission]:
        """The error of path pairs whose tier has `visibility` "blockage", so that occlusion by the targets is not traced over them.

        Tiers of ellipsoids are not counted: the law of ellipsoids includes the error of their occlusion.
        """
        pairs = self.model.pairs(accuracy)
        if pairs is None or not accuracy.occlusion or not self.counts:
            return []
        untraced = {
            (pair.out.key, pair.back.key)
            for tier, tier_pairs in pairs.by_tier(accuracy)
            if tier.visibility != "occlusion" and not self.by_limbs(tier)
            for pair in tier_pairs
        }
        count = len(untraced)
        if not count:
            return []
        missing = np.array([(entry.pair.out.key, entry.pair.back.key) in untraced for entry in self.model.ranked])
        law, of_power = self.laws.occlusion, self.laws.pairs
        what = f"{OCCLUSION} over {count} path pair{'s' * (count > 1)}"
        level_db = self._occluded.level_db(missing) + law.mean_db + of_power.mean_db
        return [Omission(what, level_db, math.hypot(law.scatter_db, of_power.scatter_db), law="occlusion")]

    def of_spectra(self, accuracy: Accuracy) -> list[Omission]:
        """The error of taking the spectra of walls and slabs as straight lines over the sweep."""
        pairs = self.model.pairs(accuracy)
        if pairs is None:
            return []
        power, first, law = self._power_of(pairs.bent_db), pairs.dominant, self.laws.pairs
        error = float(power[:first].sum() + power[first:].sum() * ratio(law.mean_db))
        if error < NEGLIGIBLE:
            return []
        return [Omission("the spectra of walls over the sweep, straight lines", db(error), law.scatter_db, law="pairs")]

    def in_time(self, accuracy: Accuracy) -> list[Omission]:
        """The errors of interpolating between surface frames and of merging echoes in the sum."""
        rates = enumerate(self.model.rates_hz(accuracy))
        splines_db = min(MOST_DB, max(self.model.rate(number).error_db(rate) for number, rate in rates))
        return [
            Omission("motion between surface frames, by splines", splines_db),
            Omission("the sum of echoes, merged", accuracy.synthesis_error_db),
        ]

    def tiers(self, accuracy: Accuracy) -> Iterator[tuple[PathTier, int, float]]:
        """The tiers in use, each with its number of path pairs and the fraction of the power of all pairs that these have."""
        pairs = self.model.pairs(accuracy)
        if pairs is None:
            yield accuracy.tiers[0], 1, 1.0
            return
        power, first = self._power_of(pairs.levels_db), 0
        for tier, tier_pairs in pairs.by_tier(accuracy):
            yield tier, len(tier_pairs), float(power[first : first + len(tier_pairs)].sum())
            first += len(tier_pairs)

    def _power_of(self, levels_db: Sequence[float]) -> np.ndarray:
        """Power of path pairs of these levels [dB], relative to the power of all ranked pairs, (P,)."""
        power: np.ndarray = 10 ** (np.array(levels_db) / 10)
        return power / sum(10 ** (pair.mean_db / 10) for pair in self.model.ranked)

    @property
    def of_bodies(self) -> bool:
        """Whether there is a body among the targets, which ellipsoids could replace."""
        return any(isinstance(target, Motion) for target in self.model.targets)

    def by_limbs(self, tier: PathTier) -> bool:
        """Whether bodies are ellipsoids over the paths of that tier."""
        return self.of_bodies and (self.model.method == "ellipsoid" or tier.scatterer == "ellipsoids")

    def of_tiers(self, tiers: Sequence[tuple[PathTier, int, float]], scale: float) -> list[Omission]:
        """The errors of facets at a sagitta scale, of ellipsoids and of path pairs that are left out, for the output of `tiers`."""
        omissions, kept_power, count = [], 0.0, 0
        for number, (tier, pairs, power) in enumerate(tiers):
            kept_power, count = kept_power + power, count + pairs
            level_db = db(power) + (self.laws.pairs.mean_db if number else 0.0)
            over = "" if self.model.scene is None else f" over {pairs} path pair{'s' * (pairs > 1)}"
            if self.by_limbs(tier):
                law = self.laws.limbs
                what = f"the skin: limbs by ellipsoids{over}"
                omissions.append(Omission(what, level_db + law.mean_db, law.scatter_db, law="limbs"))
            elif self.counts:
                if not number and self.of_bodies:
                    what = "the skin: limbs by ellipsoids"
                    omissions.append(
                        Omission(what, level_db + self.laws.limbs.mean_db, self.laws.limbs.scatter_db, taken=False)
                    )
                sagitta, of_facets = self.facets(tier, scale)
                what = f"the curve of the skin between facets' corners{over}"
                omissions.append(
                    Omission(what, level_db + of_facets.error_db(sagitta), of_facets.scatter_db, law="facets")
                )
                if tier.patch_phase_scale > 1:
                    what = f"facets in larger patches{over}"
                    own_db = level_db + patches_db(tier.patch_phase_scale)
                    omissions.append(Omission(what, own_db, PATCHES_SCATTER_DB, law="patches"))
        if count < len(self.model.ranked):
            left_db = db(1 - kept_power) + self.laws.pairs.mean_db
            what = f"{len(self.model.ranked) - count} path pairs left out"
            omissions.append(Omission(what, left_db, self.laws.pairs.scatter_db, law="pairs"))
        return omissions

    def seconds(self, accuracy: Accuracy, clutter: Clutter = "none") -> float:
        """Predicted time of a run [s] on a machine that takes one second for the reference computation (`core.backend`)."""
        return seconds(work_units(self.model, accuracy, self.counts, clutter), self.laws)


def sampled(rate_hz: float, subdivision: int) -> str:
    """Words for a report on how visibility is sampled."""
    edges = "" if not subdivision else f", their edges divided by {2**subdivision}"
    return f"visibility at {rate_hz:g} Hz from the meshes' vertices{edges}"


def patches_db(phase_scale: float) -> float:
    """Field error [dB] that a body's patches add if their phase may change `phase_scale` times the default between frames."""
    return PATCHES_DB + 20 * math.log10(phase_scale) if phase_scale > 1 else -math.inf


def ratio(level_db: float) -> float:
    """A level as a ratio of powers."""
    return float(10 ** (level_db / 10))


def db(ratio: float) -> float:
    """A ratio of powers as a level."""
    return 10 * math.log10(max(ratio, 1e-30))
