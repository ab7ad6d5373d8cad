"""What fidelity of simulation is worth to a classifier: the same events in several ways, tested on the best and on real ones."""

from t2d_rt.learn.fidelity.report import write_fidelity
from t2d_rt.learn.fidelity.rungs import RUNGS, make_rungs, read_rungs
from t2d_rt.learn.fidelity.study import run_study

__all__ = ["RUNGS", "make_rungs", "read_rungs", "run_study", "write_fidelity"]
