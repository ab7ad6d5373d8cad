"""Make many samples of one motion: seen from elsewhere, walked faster or slower, mirrored, held at its end, bent to an arc."""

from __future__ import annotations

from t2d_rt.motion.vary.arcs import arc
from t2d_rt.motion.vary.variations import hold, mirror, step_times_s, vary_gait, vary_view

__all__ = ["arc", "hold", "mirror", "step_times_s", "vary_gait", "vary_view"]
