"""
Aspect angles
=============

The same walk from ahead, obliquely and from the side. Radial speeds shrink with the cosine of the angle; from the
side legs swing across the line of sight, and little Doppler shift is left.
"""

import matplotlib.pyplot as plt

import t2d_rt as t2d

walk = t2d.trim(t2d.example("walk"), 1.0, 2.0)
figure, axes = plt.subplots(nrows=3, figsize=(7, 8), sharex=True, sharey=True, layout="constrained")
for ax, angle_deg in zip(axes, (0, 45, 90), strict=True):
    motion = t2d.place(walk, distance_m=4.0, angle_deg=angle_deg)
    t2d.simulate(motion, accuracy={"sagitta_scale": 2}).plot(f"{angle_deg} degrees", ax=ax)
    ax.set_ylim(-2.5, 4.5)

figure
