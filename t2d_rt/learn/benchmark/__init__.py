"""Table III of Text2Doppler, with splits that do not leak, seeds and intervals: all models on Simple and Hard."""

from t2d_rt.learn.benchmark.cells import Cell, cells_of, run_cells
from t2d_rt.learn.benchmark.claims import Claim, claims
from t2d_rt.learn.benchmark.conditions import run_conditions
from t2d_rt.learn.benchmark.cost import paper_plan
from t2d_rt.learn.benchmark.report import write_report
from t2d_rt.learn.benchmark.scales import SCALES, Scale

__all__ = [
    "SCALES",
    "Cell",
    "Claim",
    "Scale",
    "cells_of",
    "claims",
    "paper_plan",
    "run_cells",
    "run_conditions",
    "write_report",
]
