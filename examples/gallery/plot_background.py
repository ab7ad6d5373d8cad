"""
A learned background
====================

What a radar sees of rooms in which nobody moves, learned from recordings and drawn anew: a floor of speckle and, near
zero speed, what moves slowly there. It is added to the powers of the spectrogram; each seed draws another one.
"""

import matplotlib.pyplot as plt

import t2d_rt as t2d

walk = t2d.place(t2d.trim(t2d.example("walk"), 1.0, 3.0), distance_m=4.5)
clean = t2d.simulate(walk, method="ellipsoid")
top_db = float(clean.spectrogram.max())
figure, axes = plt.subplots(nrows=3, figsize=(7, 8), sharex=True, sharey=True, layout="constrained")
clean.plot("no background", ax=axes[0], limits_db=(top_db - 55, top_db))
for ax, seed in zip(axes[1:], (1, 4), strict=True):
    clean.with_background(seed=seed).plot(f"background of seed {seed}", ax=ax, limits_db=(top_db - 55, top_db))
    ax.set_ylim(-3, 5)

figure
