"""The filter: whether a motion is sound, holds a fall, and is of the class that was asked for."""

from __future__ import annotations

from t2d_rt.motion.check.copies import copies
from t2d_rt.motion.check.falls import FallFinding, detect_fall
from t2d_rt.motion.check.measures import Measures, measure
from t2d_rt.motion.check.verdict import Verdict, check_motion, passes

__all__ = ["FallFinding", "Measures", "Verdict", "check_motion", "copies", "detect_fall", "measure", "passes"]
