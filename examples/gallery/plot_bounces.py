"""
A corner, by one bounce and by two
==================================

Two metal plates that stand at a right angle send everything back that comes in between them: off one, off the other,
and home. One bounce alone does not see it. The corner swings about its upright edge; the echo of two bounces is
strong over a wide angle, that of one only where a plate comes square to the line of sight.
"""

import matplotlib.pyplot as plt
import numpy as np
import trimesh

import t2d_rt as t2d

side = trimesh.creation.box(extents=(0.2, 0.002, 0.2))
side.apply_translation((0.1, 0.0, 0.0))
other = side.copy().apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 0, 1)))
corner = trimesh.util.concatenate([side, other])
times_s = np.linspace(0.0, 0.3, 61)
angle = np.pi * 3 / 4 + np.radians(40) * (times_s / 0.15 - 1)
vertices = np.stack(
    [trimesh.transform_points(corner.vertices, trimesh.transformations.rotation_matrix(a, (0, 0, 1))) for a in angle]
)
mesh = t2d.MovingMesh(vertices + [4.0, 0.0, 1.0], corner.faces, times_s, material="pec", crease_deg=0, name="corner")
figure, ax = plt.subplots(figsize=(7, 3.4), layout="constrained")
for bounces in (1, 2):
    recording = t2d.simulate(mesh, bounces=bounces, accuracy={"surface_rate_hz": 300})
    power = (np.abs(recording.range_profile[:, 0]) ** 2).max("range_m")
    ax.plot(
        np.interp(recording.adc.chirp_time_s, times_s, np.degrees(angle) - 135),
        10 * np.log10(power),
        label=f"bounces: {bounces}",
    )
ax.set(xlabel="Angle off the corner's axis [deg]", ylabel="Power [dB re 1 W]")
ax.legend()

figure
