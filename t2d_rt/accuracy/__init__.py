"""Accuracy chosen for a tolerance (`search`) by fitted `laws`, measured on random chirps (`measuring`); what it takes (`cost`)."""

from t2d_rt.accuracy.cost import check_memory
from t2d_rt.accuracy.estimate import nmse_db
from t2d_rt.accuracy.measuring import measured_error
from t2d_rt.accuracy.planning import plan
from t2d_rt.accuracy.plans import Plan
from t2d_rt.accuracy.wanted import Wanted, chosen

__all__ = ["Plan", "Wanted", "check_memory", "chosen", "measured_error", "nmse_db", "plan"]
