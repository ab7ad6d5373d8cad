"""
A sphere against its closed form
================================

A metal sphere near by has the radar cross-section pi a^2 (R / (R + a))^2, with R the range of its nearest point. Read
back from the ADC samples by the radar equation, over radii from 3 to 30 cm.
"""

import matplotlib.pyplot as plt
import numpy as np
import trimesh

import t2d_rt as t2d

radar = t2d.Radar.preset("table2")
shape = trimesh.creation.icosphere(subdivisions=3)
radii_m = np.geomspace(0.03, 0.3, 7)
rcs_dbsm, range_m, times_s = [], 3.0, np.array([0.0, 0.002])
for radius_m in radii_m:
    vertices = radius_m * shape.vertices + [range_m + radius_m, 0, 1]
    ball = t2d.MovingMesh(np.stack([vertices, vertices]), shape.faces, times_s, material="pec")
    power_w = np.mean(np.abs(t2d.simulate(ball).cube) ** 2)
    rcs_dbsm.append(10 * np.log10(power_w / radar.received_power_w(1.0, range_m)))
closed_dbsm = 10 * np.log10(np.pi * radii_m**2 * (range_m / (range_m + radii_m)) ** 2)
print(f"greatest difference {np.abs(rcs_dbsm - closed_dbsm).max():.2f} dB")
figure, ax = plt.subplots(figsize=(6, 3.6), layout="constrained")
ax.plot(100 * radii_m, closed_dbsm, label="closed form")
ax.plot(100 * radii_m, rcs_dbsm, "o", label="simulated")
ax.set(xlabel="Radius [cm]", ylabel="Radar cross-section [dBsm]")
ax.legend()

figure
