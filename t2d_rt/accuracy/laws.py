"""Fitted laws: what each simplification costs in field error, and what a run takes; with their scatter.

`python -m validation laws` fits them to measurements and writes `laws.json`; nothing here is fitted by hand. Errors are energies of
the field's difference over the field's energy. Means are means of decibels, and the scatter is the standard deviation about them.
"""

from __future__ import annotations

import functools
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

FILE = Path(__file__).with_name("laws.json")
COARSER = 3.0
"""Facets that a run's are held against have so many times their phase sagitta."""
MOST_DB = 3.0
"""Error of a field of right power whose phase means nothing."""
PERIMETER = 0.5
"""The edge of what is occluded grows with the square root of its area, and so does the error along it, about."""


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
    """Energy of what they differ by from facets of `COARSER` times the phase sagitta (K,)."""
    scatter_db: float
    """Standard deviation of the first over the cases of the fit."""
    difference_scatter_db: float
    """Of the second."""
    ratio_scatter_db: float
    """Of the one over the other."""

    @classmethod
    def of(cls, found: dict[str, Any]) -> FacetLaw:
        """From what the fit wrote."""
        sagitta, own, coarser = (np.array(found[name]) for name in ("sagitta_rad", "facets_db", "coarser_db"))
        return cls(sagitta, own, coarser, found["scatter_db"], found["difference_scatter_db"], found["ratio_scatter_db"])

    def error_db(self, sagitta_rad: float) -> float:
        """Error of facets of that phase sagitta."""
        return self._at(sagitta_rad, self.facets_db)

    def difference_db(self, sagitta_rad: float) -> float:
        """Energy of what they differ by from facets of `COARSER` times the phase sagitta."""
        return self._at(sagitta_rad, self.coarser_db)

    def _at(self, sagitta_rad: float, table_db: np.ndarray) -> float:
        """Between fitted phase sagittas, and beyond them along the outermost slope."""
        x, known = math.log10(sagitta_rad), np.log10(self.sagitta_rad)
        i = int(np.clip(np.searchsorted(known, x) - 1, 0, len(known) - 2))
        slope = (table_db[i + 1] - table_db[i]) / (known[i + 1] - known[i])
        return float(min(table_db[i] + slope * (x - known[i]), MOST_DB))


@dataclass(frozen=True, slots=True)
class Laws:
    """What the fit found."""

    bodies: FacetLaw
    smooth: FacetLaw
    """Of smooth meshes of the user and movers."""
    occlusion: Law
    """Cost of no occlusion, over what the unrefined mesh shows of it."""
    edges: dict[tuple[float, int], Law]
    """Cost of sampled visibility, by rate [Hz] and subdivision, over the square root of the cost of no occlusion."""
    limbs: Law
    """Error of ellipsoids in place of a body, over the power of the path pairs over which they are."""
    limbs_power: Law
    """Power of their echoes over that of the body's."""
    pairs: Law
    """Power of path pairs over what probes at the targets say."""
    seconds: dict[str, float]
    """Of a unit of each kind of work (`cost.Work`), where the yardstick takes a second."""
    seconds_scatter: float
    """Standard deviation of the logarithm of the time taken over that predicted."""

    @classmethod
    @functools.cache
    def fitted(cls) -> Laws:
        """Those of the package."""
        return cls.of(json.loads(FILE.read_text()))

    @classmethod
    def of(cls, found: dict[str, Any]) -> Laws:
        """From what the fit wrote."""
        single = {name: Law(**found[name]) for name in ("occlusion", "limbs", "limbs_power", "pairs")}
        edges = {
            (each["rate_hz"], each["subdivision"]): Law(each["mean_db"], each["scatter_db"]) for each in found["edges"]
        }
        return cls(
            FacetLaw.of(found["bodies"]), FacetLaw.of(found["smooth"]), edges=edges, seconds=found["cost"]["seconds"],
            seconds_scatter=found["cost"]["scatter"], **single,
        )  # fmt: skip

    def sampled(self, none_db: float, rate_hz: float, subdivision: int) -> Law:
        """Cost of visibility sampled at that rate from vertices subdivided so often, where no occlusion at all costs `none_db`: no
        more than that."""
        level = min(subdivision, max(n for _, n in self.edges))
        rates = sorted(rate for rate, n in self.edges if n == level)
        laws = [self.edges[rate, level] for rate in rates]
        x, known = np.log(rate_hz), np.log(rates)
        edge_db = float(np.interp(x, known, [law.mean_db for law in laws]))
        scatter_db = float(np.interp(x, known, [law.scatter_db for law in laws]))
        # Below the fitted rates the error grows with the time between samples.
        edge_db += 20 * max(0.0, math.log10(rates[0] / rate_hz))
        return Law(min(none_db, PERIMETER * none_db + edge_db), scatter_db)
