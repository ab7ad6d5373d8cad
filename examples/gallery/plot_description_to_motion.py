"""
From a description to a motion
==============================

A sentence is read into slots, a motion is made of these, and a radar looks at it. Above the skeleton from the side at
some instants, below what the radar has of it.
"""

import matplotlib.pyplot as plt
import numpy as np

import t2d_rt as t2d

motion = t2d.motion_from_text("a person bends down to pick up a ball", seed=1)
motion = t2d.place(t2d.trim(motion, 0.0, 4.0), distance_m=2.5)
recording = t2d.simulate(motion, method="ellipsoid")
figure, (above, below) = plt.subplots(nrows=2, figsize=(7, 6), layout="constrained")
for frame in np.linspace(0, len(motion.joints) - 1, 9).astype(int):
    time_s = frame / motion.rate_hz
    for joint, parent in enumerate(motion.parents):
        if parent >= 0:
            ends = motion.joints[frame][[joint, parent]] - motion.joints[frame][0] * [1, 1, 0]
            above.plot(0.5 * ends[:, 0] + time_s, ends[:, 2], "k-", linewidth=1)
above.set(xlabel="Time [s], forward to the left at half scale", ylabel="Height [m]")
recording.plot(ax=below, bar=False)

figure
