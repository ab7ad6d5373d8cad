"""
Validating against the ellipsoid model
======================================

Most simulated micro-Doppler of people is of ellipsoids, one for each segment of the body. This page asks where that
model agrees with a body's surface, where it does not, and why.
"""

# %%
# One segment
# -----------
#
# A forearm alone: an ellipsoid that swings. Once it is one echo, from the point of the surface that is nearest to the
# radar, with the radar cross-section of geometrical optics; once it is a mesh whose facets are summed by physical
# optics. Nothing of the two calculations is in common but the shape and its motion.

import matplotlib.pyplot as plt
import numpy as np
import trimesh

import t2d_rt as t2d

semi_axes_m = np.array([0.04, 0.04, 0.14])
times_s = np.linspace(0.0, 0.5, 101)
tilt = 0.9 * np.sin(2 * np.pi * 2 * times_s)
axes_of = np.zeros((len(times_s), 3, 3))
axes_of[:, 0, 0], axes_of[:, 0, 2] = np.cos(tilt), np.sin(tilt)
axes_of[:, 2, 0], axes_of[:, 2, 2], axes_of[:, 1, 1] = -np.sin(tilt), np.cos(tilt), 1
centres_m = np.array([3.0, 0.0, 1.0]) - 0.3 * axes_of[:, :, 2]

segment = t2d.Ellipsoids(semi_axes_m[None], centres_m[:, None], times_s, axes_of[:, None], material="pec")
shape = trimesh.creation.icosphere(subdivisions=4).vertices * semi_axes_m
faces = trimesh.creation.icosphere(subdivisions=4).faces
surface = t2d.MovingMesh(np.einsum("tij,vj->tvi", axes_of, shape) + centres_m[:, None], faces, times_s, material="pec")
one, many = (t2d.simulate(each, accuracy={"surface_rate_hz": 200}) for each in (segment, surface))
power_db = [10 * np.log10(np.mean(np.abs(each.range_profile[:, 0]) ** 2, axis=1)) for each in (one, many)]
print(f"median difference of power {float(np.median(np.abs(power_db[0] - power_db[1]))):.2f} dB")
difference_db = 10 * np.log10(np.sum(np.abs(one.cube - many.cube) ** 2) / np.sum(np.abs(many.cube) ** 2))
print(f"energy of the difference of the samples {difference_db:.1f} dB")

# %%
# The two agree in power, and in phase as well, or the samples would not. For a smooth convex shape that is large
# against the wavelength the specular point is all there is.

figure, ax = plt.subplots(figsize=(7, 3.2), layout="constrained")
for name, each, style in zip(("ellipsoid, one echo", "mesh"), power_db, ("-", "--"), strict=True):
    ax.plot(one.adc.chirp_time_s, each, style, label=name)
ax.set(xlabel="Time [s]", ylabel="Power [dB re 1 W]")
ax.legend()
figure

# %%
# A person
# --------
#
# Seventeen of them make a person, and now the pictures differ. Ellipsoids draw seventeen clean lines, one for each
# segment. The skin of a body is not convex: it has several glints on each limb, which come and go as it turns, and
# limbs hide one another.

walk = t2d.trim(t2d.example("walk"), 1.0, 2.5)
ellipsoids = t2d.simulate(walk, method="ellipsoid")
mesh = t2d.simulate(walk)
comparison = t2d.compare(ellipsoids, mesh)
print(comparison)

# %%
# The trunk's speed agrees, and the envelope, which features of a classifier are mostly made of, is much alike. Cell
# by cell the two differ somewhat more than two realisations of speckle do.

comparison.plot()

# %%
# What of it is shadow?
# ---------------------
#
# The mesh once more without occlusion, so that hidden limbs return as if nothing stood before them. The difference
# from the full mesh is what shadows do in this view, hardly anything: who walks towards a radar shows it all limbs.

unshaded = t2d.simulate(walk, accuracy={"occlusion": False})
print(t2d.compare(unshaded, mesh, labels=("no occlusion", "mesh")))

# %%
# Who walks past it hides one leg with the other, and one arm with the trunk.

aside = t2d.place(walk, distance_m=3.0, angle_deg=90)
pair = t2d.simulate(aside, accuracy={"occlusion": False}), t2d.simulate(aside)
comparison = t2d.compare(*pair, labels=("no occlusion", "mesh"))
print(comparison)
comparison.plot()

# %%
# From where does the phase come?
# -------------------------------
#
# The paper's model takes the phase of an ellipsoid from its centre. A centre moves unlike the specular point on the
# surface, most of all of a limb that turns: lines of the swinging legs then lie at other speeds.
# `phase_from="centre"` is that model.

centre = t2d.simulate(walk, method="ellipsoid", phase_from="centre")
comparison = t2d.compare(ellipsoids, centre, labels=("specular point", "centre"))
print(comparison)
comparison.plot()
