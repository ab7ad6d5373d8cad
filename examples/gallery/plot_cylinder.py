"""
A cylinder that turns
=====================

A metal tube of 20 cm and 2 cm radius turns end over end. Broadside it returns 2 pi a L^2 / lambda; a few degrees off,
its lobes are those of a uniform line, as of an antenna of that length. Near by, zeros fill up a little.
"""

import matplotlib.pyplot as plt
import numpy as np
import trimesh

import t2d_rt as t2d

radar = t2d.Radar.preset("table2")
radius_m, length_m, range_m = 0.02, 0.2, 12.0
tube = trimesh.creation.cylinder(radius_m, length_m, sections=64)
times_s = np.linspace(0.0, 0.5, 201)
angle = np.radians(np.linspace(-4, 4, 201))
turn = [trimesh.transformations.rotation_matrix(each, (0, 1, 0)) for each in angle]
vertices = np.stack([trimesh.transform_points(tube.vertices, each) for each in turn]) + [range_m + radius_m, 0, 1]
mesh = t2d.MovingMesh(vertices, tube.faces, times_s, material="pec", name="tube")
recording = t2d.simulate(mesh, accuracy={"surface_rate_hz": 400})
power_w = np.mean(np.abs(recording.cube[:, 0]) ** 2, axis=1)
seen = np.interp(recording.adc.chirp_time_s, times_s, angle)
k_l = 2 * np.pi / radar.wavelength_m * length_m
line = 2 * np.pi * radius_m * length_m**2 / radar.wavelength_m * np.sinc(k_l * np.sin(angle) / np.pi) ** 2
figure, ax = plt.subplots(figsize=(6.5, 3.8), layout="constrained")
ax.plot(np.degrees(angle), 10 * np.log10(line), label="uniform line, far away")
ax.plot(np.degrees(seen), 10 * np.log10(power_w / radar.received_power_w(1.0, range_m)), "--", label="simulated")
ax.set(xlabel="Angle off broadside [deg]", ylabel="Radar cross-section [dBsm]", ylim=(-45, 5))
ax.legend()

figure
