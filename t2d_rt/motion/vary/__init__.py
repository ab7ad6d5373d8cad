"""One motion, many samples: seen from elsewhere, walked faster or slower, mirrored, held at its end."""

from __future__ import annotations

from t2d_rt.motion.vary.gait import step_times_s, vary_gait
from t2d_rt.motion.vary.hold import hold
from t2d_rt.motion.vary.mirror import mirror
from t2d_rt.motion.vary.view import vary_view

__all__ = ["hold", "mirror", "step_times_s", "vary_gait", "vary_view"]
