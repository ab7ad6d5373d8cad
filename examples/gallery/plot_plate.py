"""
A plate's near field
====================

Far away a metal plate of area A returns 4 pi A^2 / lambda^2. Near by it is a mirror, pi R^2, with ripples where the
zones of Fresnel pass its edges. A plate of 10 cm, broadside, read back from the ADC samples.
"""

import matplotlib.pyplot as plt
import numpy as np
import trimesh

import t2d_rt as t2d

radar = t2d.Radar.preset("table2")
side_m, times_s = 0.1, np.array([0.0, 0.002])
shape = trimesh.creation.box((0.002, side_m, side_m))
ranges_m = np.geomspace(0.4, 15, 24)
rcs_dbsm = []
for range_m in ranges_m:
    vertices = shape.vertices + [range_m + 0.001, 0, 1]
    plate = t2d.MovingMesh(np.stack([vertices, vertices]), shape.faces, times_s, material="pec", name="plate")
    power_w = np.mean(np.abs(t2d.simulate(plate).cube) ** 2)
    rcs_dbsm.append(10 * np.log10(power_w / radar.received_power_w(1.0, range_m)))
figure, ax = plt.subplots(figsize=(6, 3.8), layout="constrained")
far_dbsm = 10 * np.log10(4 * np.pi * side_m**4 / radar.wavelength_m**2)
ax.semilogx(ranges_m, np.full_like(ranges_m, far_dbsm), "--", label="far field")
ax.semilogx(ranges_m, 10 * np.log10(np.pi * ranges_m**2), ":", label="mirror")
ax.semilogx(ranges_m, rcs_dbsm, "o-", markersize=3, label="simulated")
ax.set(xlabel="Range [m]", ylabel="Radar cross-section [dBsm]", ylim=(-10, 25))
ax.legend()

figure
