"""
Rooms
=====

One metal ball flies through three rooms. Each wall adds mirror images of it, at ranges and speeds of their own;
furniture blocks some paths and adds others.
"""

import matplotlib.pyplot as plt
import numpy as np

import t2d_rt as t2d

times_s = np.linspace(0.0, 0.2, 21)
centres_m = np.stack([3.0 - 2.0 * times_s, 0.3 + 0.8 * times_s, 1.2 + 0 * times_s], axis=1)
ball = t2d.Ellipsoids([[0.1, 0.1, 0.1]], centres_m[:, None], times_s, material="pec")
figure, axes = plt.subplots(ncols=3, figsize=(9, 3.4), sharex=True, sharey=True, layout="constrained")
for ax, scene in zip(axes, ("free_space", "corridor", "living_room"), strict=True):
    recording = t2d.simulate(ball, scene=scene, clutter="none")
    image = recording.range_doppler_at(interval_s=0.1)
    ax.pcolormesh(image.range_m, image.velocity_mps, image - image.max(), vmin=-50, vmax=0, rasterized=True)
    ax.set(title=scene.replace("_", " "), xlabel="Range [m]", xlim=(2, 10), ylim=(-3, 3))
axes[0].set_ylabel("Radial velocity [m/s], approaching > 0")
figure.colorbar(axes[0].collections[0], ax=axes, label="Power rel. to peak [dB]")

figure
