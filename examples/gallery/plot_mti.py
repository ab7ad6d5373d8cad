"""
Filters against static clutter
==============================

In a room the walls return far more than a person. Without a filter they outshine everything that moves; the mean over
the record or a high-pass takes them away, and with them what is slow: feet that stand.
"""

import matplotlib.pyplot as plt

import t2d_rt as t2d

walk = t2d.trim(t2d.example("walk"), 1.0, 2.0)
recording = t2d.simulate(walk, scene="empty_room", reflections=1, method="ellipsoid")
figure, axes = plt.subplots(nrows=3, figsize=(7, 8), sharex=True, layout="constrained")
for ax, mti in zip(axes, ("none", "mean", "highpass"), strict=True):
    recording.processed(mti=mti).plot(mti, ax=ax)
    ax.set_ylim(-1.5, 4.5)

figure
