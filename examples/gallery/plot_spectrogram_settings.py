"""
Windows of a spectrogram
========================

A short window tells well when, a long one how fast. With the short one the arcs of a foot are wide in speed; with the
long one they are wide in time, since the speed changes while the window lasts.
"""

import matplotlib.pyplot as plt

import t2d_rt as t2d

recording = t2d.simulate(t2d.trim(t2d.example("walk"), 1.0, 2.5), method="ellipsoid")
figure, axes = plt.subplots(nrows=3, figsize=(7, 8), sharex=True, sharey=True, layout="constrained")
for ax, chirps in zip(axes, (64, 256, 1024), strict=True):
    name = f"{chirps} chirps, {1e3 * chirps / recording.radar.prf_hz:.0f} ms"
    recording.processed(n_window=chirps, overlap=chirps * 7 // 8).plot(name, ax=ax)
    ax.set_ylim(-1.5, 4.5)

figure
