"""Fitted laws of the field error that each simplification causes and of the time that a run takes, with their scatter.

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
"""Phase sagitta of the coarser facets with which a run is compared, relative to that of its own facets."""
MOST_DB = 3.0
"""Error [dB] of a field of the right power and a random phase: the greatest that a model with facets can have."""
PERIMETER = 0.5
"""Power of the occluded fraction with which the error at shadows' edges goes: the edge of an occluded area is about as long as the
root of that area."""


FITTED_SIZE, SIZE_POWER, MOST_SIZE_SCALE = 450.0, 0.75, 2.0
"""Size in wavelengths of the bodies that the law of facets was fitted to, at 77 GHz. Smaller bodies have the error of facets whose
phase sagitta is greater by a factor, the ratio of the sizes to the power `SIZE_POWER`, at most `MOST_SIZE_SCALE`
(`validation.methods.small_bodies`)."""
CAGE_SIZE, CAGE_RAD, CAGE_POWER = 350.0, 4.3, 0.75
"""Below `CAGE_SIZE`, in wavelengths, a body's unrefined mesh has the error of facets of the phase sagitta `CAGE_RAD` [rad], times
the ratio of its size to `CAGE_SIZE` to the power `CAGE_POWER`; no facets of a body are coarser than its unrefined mesh."""
SMALL_SCATTER_DB, SMALL_DIFFERENCE_DB, SMALL_RATIO_DB = 3.0, 3.5, 4.0
"""Standard deviations [dB] about the law for bodies below `CAGE_SIZE`: of the error, of the difference from coarser facets, and of
the ratio of both."""
SAME_DB = -30.0
"""Where the coarser model has facets of the same size as the run, the energy of their difference relative to the run's error
[dB]."""


@dataclass(frozen=True, slots=True)
class Law:
    """A fitted figure [dB] and its scatter."""

    mean_db: float
    scatter_db: float
    """Standard deviation over the cases of the fit [dB]."""


@dataclass(frozen=True, slots=True)
class FacetLaw:
    """Field error of a mesh's facets as a function of their phase sagitta."""

    sagitta_rad: np.ndarray
    """Phase sagittas of the fit [rad], ascending, (K,)."""
    facets_db: np.ndarray
    """Field error of facets of these phase sagittas [dB], (K,)."""
    coarser_db: np.ndarray
    """Energy of the difference from facets of `COARSER` times the phase sagitta [dB], for the first phase sagittas, (K - 2,)."""
    scatter_db: float
    """Standard deviation of `facets_db` over the cases of the fit [dB]."""
    difference_scatter_db: float
    """Standard deviation of `coarser_db` over the cases of the fit [dB]."""
    ratio_scatter_db: float
    """Standard deviation of the ratio of the two [dB]."""
    correlation: float
    """Correlation of the deviations of `facets_db` and of that ratio."""
    size_scale: float = 1.0
    """Factor on phase sagittas for a target smaller than those of the fit, before they are looked up."""
    cage_rad: float = math.inf
    """Phase sagitta that stands for the unrefined mesh [rad]: the greatest that is looked up, as nothing coarser is made."""

    @classmethod
    def of(cls, fitted: dict[str, Any]) -> FacetLaw:
        """The law in the form in which the fit stored it."""
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
        """The law for a curved mesh of `size` wavelengths; `body` where its unrefined mesh is that of a person."""
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
        """Field error of facets of that phase sagitta [dB]."""
        return self._at(self._equivalent_rad(sagitta_rad), self.facets_db)

    def difference_db(self, sagitta_rad: float) -> float:
        """Energy of the difference between facets of that phase sagitta and those of `COARSER` times as much, relative to the field
        [dB]."""
        own_rad, other_rad = self._equivalent_rad(sagitta_rad), self._equivalent_rad(COARSER * sagitta_rad)
        if other_rad > 0.999 * COARSER * own_rad:
            return self._at(own_rad, self.coarser_db)
        own_db, other_db = (self._at(sagitta, self.facets_db) for sagitta in (own_rad, other_rad))
        return 10 * math.log10(max(10 ** (other_db / 10) - 10 ** (own_db / 10), 10 ** ((own_db + SAME_DB) / 10)))

    def _equivalent_rad(self, sagitta_rad: float) -> float:
        """Phase sagitta [rad] at which facets of a target of the fitted size have the same error."""
        return min(self.size_scale * sagitta_rad, self.cage_rad)

    def _at(self, sagitta_rad: float, table_db: np.ndarray) -> float:
        """A table of levels [dB] at a phase sagitta: interpolated between fitted ones, and with an amplitude proportional to the
        phase sagitta beyond them."""
        fitted_rad = self.sagitta_rad[: len(table_db)]
        within = np.clip(sagitta_rad, fitted_rad[0], fitted_rad[-1])
        between_db = np.interp(math.log10(within), np.log10(fitted_rad), table_db)
        return float(min(between_db + 20 * math.log10(sagitta_rad / within), MOST_DB))


@dataclass(frozen=True, slots=True)
class Laws:
    """The fitted laws of error and time."""

    bodies: FacetLaw
    smooth: FacetLaw
    """Law for facets of smooth meshes, of the user or of movers."""
    occlusion: Law
    """Error of leaving out occlusion [dB], relative to the estimate from the unrefined mesh (`occlusion.Occluded`)."""
    edges: dict[tuple[float, int], Law]
    """Error of sampled visibility, by rate [Hz] and subdivision, relative to the root of the error of leaving out occlusion."""
    direct: dict[tuple[float, int], Law]
    """Error of sampled visibility, by rate [Hz] and subdivision, relative to that measured on coarser facets without interpolation
    in time."""
    direct_unoccluded: Law
    """Error of leaving out occlusion, relative to that measured on such a model."""
    limbs: Law
    """Error of ellipsoids in place of a body, relative to the power of the path pairs over which they are used."""
    limbs_power: Law
    """Power of the echoes of ellipsoids, relative to those of the body."""
    pairs: Law
    """Power of path pairs, relative to the prediction from probe points at the targets."""
    seconds: dict[str, float]
    """Time of a unit of each kind of work (`cost.KINDS`) [s], on a machine that takes one second for the reference computation."""

    @classmethod
    @functools.cache
    def fitted(cls) -> Laws:
        """The laws that are shipped with the package."""
        return cls.of(json.loads(FILE.read_text()))

    @classmethod
    def of(cls, fitted: dict[str, Any]) -> Laws:
        """The laws in the form in which the fit stored them."""
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
        """Error of sampling visibility at `rate_hz` from vertices of a mesh subdivided `subdivision` times, where leaving out
        occlusion has the error `none_db`, which it does not exceed. `size` is that of the smallest body in wavelengths: the edges
        of shadows are a greater part of a small body."""
        law, lowest_hz = _between(self.edges, rate_hz, subdivision)
        # Below the fitted rates the error grows with the time between samples.
        edge_db = law.mean_db + 20 * max(0.0, math.log10(lowest_hz / rate_hz))
        edge_db += 5 * math.log10(np.clip(FITTED_SIZE / size, 1.0, MOST_SIZE_SCALE))
        return Law(min(none_db, PERIMETER * none_db + edge_db), law.scatter_db)

    def over_direct(self, accuracy: Accuracy) -> Law:
        """The error of sampled visibility, or of leaving out occlusion, relative to that measured on coarser facets without
        interpolation in time."""
        if not accuracy.occlusion:
            return self.direct_unoccluded
        return _between(self.direct, accuracy.visibility_rate_hz, accuracy.visibility_subdivision)[0]


def _between(laws: dict[tuple[float, int], Law], rate_hz: float, subdivision: int) -> tuple[Law, float]:
    """The law interpolated between the fitted rates, at the nearest subdivision that was fitted, and the lowest of these rates
    [Hz]."""
    level = min(subdivision, max(n for _, n in laws))
    rates = sorted(rate for rate, n in laws if n == level)
    level_laws = [laws[rate, level] for rate in rates]
    x, log_rates = np.log(rate_hz), np.log(rates)
    mean, scatter = (
        np.interp(x, log_rates, values)
        for values in ([law.mean_db for law in level_laws], [law.scatter_db for law in level_laws])
    )
    return Law(float(mean), float(scatter)), rates[0]
