"""
Occluded windows
================

For training, random windows of time in which the person is hidden: there only the background is left, as behind a
cupboard.
"""

import matplotlib.pyplot as plt
import numpy as np

import t2d_rt as t2d

walk = t2d.place(t2d.trim(t2d.example("walk"), 1.0, 3.0), distance_m=4.5)
clean = t2d.simulate(walk, method="ellipsoid")
image = clean.with_background(seed=1).spectrogram
alone = t2d.Recording(np.zeros_like(clean.cube), clean.radar).with_background(seed=1).spectrogram
power, background = (10 ** (each.values / 10) for each in (image, alone))
mask = t2d.OcclusionMask(windows=3, shortest_s=0.2, longest_s=0.5)
masked = t2d.occlude(power, image.time_s.values, mask, seed=2, background_power=background)
print("hidden:", ", ".join(f"{start:.2f} to {stop:.2f} s" for start, stop in masked.windows_s))
figure, ax = plt.subplots(figsize=(7, 3.6), layout="constrained")
level_db = 10 * np.log10(masked.power / power.max())
drawn = ax.pcolormesh(image.time_s, image.velocity_mps, level_db, vmin=-55, vmax=0, rasterized=True)
ax.set(xlabel="Time [s]", ylabel="Radial velocity [m/s], approaching > 0", ylim=(-3, 5))
figure.colorbar(drawn, label="Power rel. to peak [dB]")

figure
