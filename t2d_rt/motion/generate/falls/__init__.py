"""Falls by physics (extra `[falls]`): a recorded walk or stance, then a slip, a trip or a collapse of a humanoid in MuJoCo."""

from __future__ import annotations

from t2d_rt.motion.generate.falls.make import Fall, NoFall, fall, plan_of, simulate_fall
from t2d_rt.motion.generate.falls.simulation import FallEvents, FallPlan

__all__ = ["Fall", "FallEvents", "FallPlan", "NoFall", "fall", "plan_of", "simulate_fall"]
