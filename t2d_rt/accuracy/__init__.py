"""Accuracy: chosen for a tolerance (`budget`), measured on random chirps (`estimate`), and what it costs (`cost`)."""

from t2d_rt.accuracy.budget import Plan, Wanted, chosen, measured_db
from t2d_rt.accuracy.cost import check_memory
from t2d_rt.accuracy.estimate import nmse_db
from t2d_rt.accuracy.planning import plan

__all__ = ["Plan", "Wanted", "check_memory", "chosen", "measured_db", "nmse_db", "plan"]
