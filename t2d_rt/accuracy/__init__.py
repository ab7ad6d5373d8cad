"""Chooses an accuracy for a tolerance (`search`) by fitted laws of error (`error_laws`), predicts time and memory of a run
(`cost`), and measures its error at random chirps (`measuring`)."""

from t2d_rt.accuracy.cost import check_memory
from t2d_rt.accuracy.estimate import nmse_db
from t2d_rt.accuracy.measuring import measured_directly, measured_error, plan_again, warn_of_miss
from t2d_rt.accuracy.planning import Wanted, chosen, plan
from t2d_rt.accuracy.plans import Plan
from t2d_rt.accuracy.search import warn_out_of_reach

__all__ = [
    "Plan", "Wanted", "check_memory", "chosen", "measured_directly", "measured_error", "nmse_db", "plan", "plan_again",
    "warn_of_miss", "warn_out_of_reach",
]  # fmt: skip
