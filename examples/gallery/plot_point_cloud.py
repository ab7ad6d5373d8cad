"""
Points of a walking person
==========================

What an array reports after detection at a constant false-alarm rate: points with direction and speed. From above, on
the left, they lie along the walk; from the side the fast ones are the feet, a metre below the radar.
"""

import matplotlib.pyplot as plt

import t2d_rt as t2d

radar = t2d.Radar.preset("array-3x4")
walk = t2d.place(t2d.trim(t2d.example("walk"), 1.0, 2.0), angle_deg=20, distance_m=4.0)
recording = t2d.simulate(walk, radar=radar, method="ellipsoid", noise=t2d.Receiver(), seed=0)
cloud = recording.point_cloud(false_alarm_rate=1e-8)
print(f"{len(cloud.range_m)} points")
figure, axes = plt.subplots(ncols=2, figsize=(8, 3.6), layout="constrained")
for ax, up, name in ((axes[0], 1, "y [m], left > 0"), (axes[1], 2, "Height above the radar [m]")):
    drawn = ax.scatter(cloud.xyz_m[:, 0], cloud.xyz_m[:, up], c=cloud.speed_mps, s=8, cmap="coolwarm", vmin=-4, vmax=4)
    ax.set(xlabel="x [m], along boresight", ylabel=name, ylim=(-1.6, 1.6))
figure.colorbar(drawn, label="Radial velocity [m/s]")

figure
