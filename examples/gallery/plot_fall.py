"""
A fall
======

A trip, simulated by a physics engine that takes over a recorded walk with its momentum. First there are the arcs of
steps; then the body goes over, limbs come and go at once and faster than before; then all is at rest.
"""

import numpy as np

import t2d_rt as t2d

motion = t2d.motion_from_text("a person walks forward, trips and falls forward", seed=2)
head_m = motion.joints[:, motion.names.index("head"), 2]
falls_s = float(np.argmin(np.diff(head_m))) / motion.rate_hz
print(
    f"the head is fastest downward {falls_s:.2f} s after the beginning, at {-np.diff(head_m).min() * motion.rate_hz:.1f} m/s"
)
around = t2d.place(t2d.trim(motion, falls_s - 2.0, falls_s + 1.0))
recording = t2d.simulate(around, method="ellipsoid")

recording.plot()
