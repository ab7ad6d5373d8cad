"""Fitted laws: what each simplification costs in field error, and what a run takes; with their scatter.

`python -m validation.methods.laws` fits them to measurements and writes `laws.json`; nothing here is fitted by hand. Errors are
energies of the field's difference over the field's energy. Means are means of decibels, and the scatter is the standard deviation
about them.
"""

from __future__ import annotations

import functools
import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from t2d_rt.types import Accuracy

FILE = Path(__file__).with_name("laws.json")
COARSER = 3.0
"""Facets that a run's are held against have so many times their phase sagitta."""
MOST_DB = 3.0
"""Error of a field of right power whose phase means nothing."""
PERIMETER = 0.5
"""The edge of what is occluded grows with the square root of its area, and so does the error along it, about."""


FITTED_SIZE, SIZE_POWER, MOST_SIZE_SCALE = 450.0, 0.75, 2.0
"""Size over wavelength of the bodies that the law of facets was fitted to, at 77 GHz: smaller ones err as if their facets' phase
sagittas were greater, by this power of it, at most by the last (`validation.methods.small_bodies`)."""
CAGE_SIZE, CAGE_RAD, CAGE_POWER = 350.0, 4.3, 0.75
"""Below this size a body's own mesh, of which nothing coarser is made, errs as facets of that phase sagitta [rad] do, times that
power of the size over this one."""
SMALL_SCATTER_DB, SMALL_DIFFERENCE_DB, SMALL_RATIO_DB = 3.0, 3.5, 4.0
"""Standard deviations about the law below that size."""
SAME_DB = -30.0
"""Facets that are no coarser than others differ from them by that much less than these err."""


@dataclass(frozen=True, slots=True)
class Law:
    """A fitted figure [dB]."""

    mean_db: float
    scatter_db: float
    """Standard deviation over the cases of the fit."""


@dataclass(frozen=True, slots=True)
class FacetLaw:
    """Errors of a mesh's facets by their phase sagitta."""

    sagitta_rad: np.ndarray
    """Ascending (K,)."""
    facets_db: np.ndarray
    """Error of facets of these (K,)."""
    coarser_db: np.ndarray
    """Energy of what they differ by from facets of `COARSER` times the phase sagitta, of the first of these (K - 2,)."""
    scatter_db: float
    """Standard deviation of the first over the cases of the fit."""
    difference_scatter_db: float
    """Standard deviation of `coarser_db` over the cases of the fit."""
    ratio_scatter_db: float
    """Standard deviation of the ratio of the two."""
    correlation: float
    """Correlation of the deviations of `facets_db` and of that ratio."""
    size_scale: float = 1.0
    """Factor by which phase sagittas count more of what is smaller than the bodies of the fit."""
    cage_rad: float = math.inf
    """Phase sagitta of the mesh itself, so counted, which nothing exceeds."""

    @classmethod
    def of(cls, fitted: dict[str, Any]) -> FacetLaw:
        """From what the fit wrote."""
        sagitta, facets_db, coarser = (np.array(fitted[name]) for name in ("sagitta_rad", "facets_db", "coarser_db"))
        return cls(
            sagitta,
            facets_db,
            coarser,
            fitted["scatter_db"],
            fitted["difference_scatter_db"],
            fitted["ratio_scatter_db"],
            fitted["correlation"],
        )

    def at_size(self, size: float, *, body: bool) -> FacetLaw:
        """The law for what is so many wavelengths tall: of a `body`, whose own mesh is a person's, or of another curved mesh."""
        if size >= FITTED_SIZE:
            return self
        scatter = (
            self
            if size > CAGE_SIZE
            else replace(
                self,
                scatter_db=SMALL_SCATTER_DB,
                difference_scatter_db=SMALL_DIFFERENCE_DB,
                ratio_scatter_db=SMALL_RATIO_DB,
            )
        )
        return replace(
            scatter,
            size_scale=min((FITTED_SIZE / size) ** SIZE_POWER, MOST_SIZE_SCALE),
            cage_rad=CAGE_RAD * (size / CAGE_SIZE) ** CAGE_POWER if body and size < CAGE_SIZE else math.inf,
        )

    def error_db(self, sagitta_rad: float) -> float:
        """Error of facets of that phase sagitta."""
        return self._at(self._equivalent_rad(sagitta_rad), self.facets_db)

    def difference_db(self, sagitta_rad: float) -> float:
        """Energy of what they differ by from facets of `COARSER` times the phase sagitta."""
        own_rad, other_rad = self._equivalent_rad(sagitta_rad), self._equivalent_rad(COARSER * sagitta_rad)
        if other_rad > 0.999 * COARSER * own_rad:
            return self._at(own_rad, self.coarser_db)
        own_db, other_db = (self._at(sagitta, self.facets_db) for sagitta in (own_rad, other_rad))
        return 10 * math.log10(max(10 ** (other_db / 10) - 10 ** (own_db / 10), 10 ** ((own_db + SAME_DB) / 10)))

    def _equivalent_rad(self, sagitta_rad: float) -> float:
        """Phase sagitta at which facets of the fitted size err as much."""
        return min(self.size_scale * sagitta_rad, self.cage_rad)

    def _at(self, sagitta_rad: float, table_db: np.ndarray) -> float:
        """Between fitted phase sagittas; beyond them the amplitude of the error goes with the phase sagitta."""
        fitted_rad = self.sagitta_rad[: len(table_db)]
        within = np.clip(sagitta_rad, fitted_rad[0], fitted_rad[-1])
        between_db = np.interp(math.log10(within), np.log10(fitted_rad), table_db)
        return float(min(between_db + 20 * math.log10(sagitta_rad / within), MOST_DB))


@dataclass(frozen=True, slots=True)
class Laws:
    """The fitted laws of error and time."""

    bodies: FacetLaw
    smooth: FacetLaw
    """Law of facets of smooth meshes, of the user or of movers."""
    occlusion: Law
    """Cost of no occlusion, over what the unrefined mesh shows of it."""
    edges: dict[tuple[float, int], Law]
    """Cost of sampled visibility, by rate [Hz] and subdivision, over the square root of the cost of no occlusion."""
    direct: dict[tuple[float, int], Law]
    """Cost of sampled visibility, over what it costs a model of coarser facets without interpolation in time."""
    direct_unoccluded: Law
    """Cost of no occlusion, over what it costs such a model."""
    limbs: Law
    """Error of ellipsoids in place of a body, over the power of the path pairs over which they are."""
    limbs_power: Law
    """Power of their echoes over that of the body's."""
    pairs: Law
    """Power of path pairs over what probes at the targets say."""
    seconds: dict[str, float]
    """Time of a unit of each kind of work (`cost.KINDS`) on a machine whose yardstick takes a second [s]."""

    @classmethod
    @functools.cache
    def fitted(cls) -> Laws:
        """The laws that come with the package."""
        return cls.of(json.loads(FILE.read_text()))

    @classmethod
    def of(cls, fitted: dict[str, Any]) -> Laws:
        """From what the fit wrote."""
        edges, direct = (
            {(row["rate_hz"], row["subdivision"]): Law(row["mean_db"], row["scatter_db"]) for row in fitted[name]}
            for name in ("edges", "direct")
        )
        single = {
            name: Law(**fitted[name]) for name in ("occlusion", "direct_unoccluded", "limbs", "limbs_power", "pairs")
        }
        return cls(
            FacetLaw.of(fitted["bodies"]),
            FacetLaw.of(fitted["smooth"]),
            edges=edges,
            direct=direct,
            **single,
            seconds=fitted["cost"]["seconds"],
        )

    def sampled(self, none_db: float, rate_hz: float, subdivision: int, size: float = FITTED_SIZE) -> Law:
        """Cost of visibility sampled at that rate from vertices subdivided so often, where no occlusion at all costs `none_db`: no
        more than that. Of bodies so many wavelengths tall, of which shadows' edges are a greater part if they are small."""
        law, lowest_hz = _between(self.edges, rate_hz, subdivision)
        # Below the fitted rates the error grows with the time between samples.
        edge_db = law.mean_db + 20 * max(0.0, math.log10(lowest_hz / rate_hz))
        edge_db += 5 * math.log10(np.clip(FITTED_SIZE / size, 1.0, MOST_SIZE_SCALE))
        return Law(min(none_db, PERIMETER * none_db + edge_db), law.scatter_db)

    def over_direct(self, accuracy: Accuracy) -> Law:
        """Cost of visibility as it is sampled, or of no occlusion, beside what it costs a model of coarser facets."""
        if not accuracy.occlusion:
            return self.direct_unoccluded
        return _between(self.direct, accuracy.visibility_rate_hz, accuracy.visibility_subdivision)[0]


def _between(laws: dict[tuple[float, int], Law], rate_hz: float, subdivision: int) -> tuple[Law, float]:
    """The law between fitted rates, at the nearest subdivision that was fitted, and the lowest of these rates."""
    level = min(subdivision, max(n for _, n in laws))
    rates = sorted(rate for rate, n in laws if n == level)
    level_laws = [laws[rate, level] for rate in rates]
    x, log_rates = np.log(rate_hz), np.log(rates)
    mean, scatter = (
        np.interp(x, log_rates, values)
        for values in ([law.mean_db for law in level_laws], [law.scatter_db for law in level_laws])
    )
    return Law(float(mean), float(scatter)), rates[0]
