"""Accuracy chosen for a tolerance (`search`) by fitted `laws`, measured on random chirps (`measuring`); what it takes (`cost`)."""

from t2d_rt.accuracy.cost import check_memory
from t2d_rt.accuracy.estimate import nmse_db
from t2d_rt.accuracy.measuring import Measurement
from t2d_rt.accuracy.planning import plan
from t2d_rt.accuracy.plans import Plan
from t2d_rt.accuracy.wanted import Wanted, chosen

__all__ = ["Measurement", "Plan", "Wanted", "check_memory", "chosen", "nmse_db", "plan"]
