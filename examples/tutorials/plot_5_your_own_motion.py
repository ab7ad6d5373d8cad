"""
Your own motion, your own mesh
==============================

Motions come in many files. This page reads one, looks whether it is sound, makes one of plain arrays, and at last
does without a person: a metal cube that spins.
"""

# %%
# A file
# ------
#
# `load_motion` finds out by itself what a BVH file leaves open: units, which axis is up, a T-pose at the start, what
# the joints are called. Its report says what it took for what. This page writes a file to have one; put your own in
# its place.

import tempfile
from pathlib import Path

import numpy as np
import trimesh

import t2d_rt as t2d

folder = Path(tempfile.mkdtemp())
t2d.save_motion(t2d.example("run"), folder / "mine.bvh")
motion = t2d.load_motion(folder / "mine.bvh")
print(motion.report)
print(t2d.describe(motion))

# %%
# Is it sound?
# ------------
#
# `check_motion` measures what gives bad recordings away: feet that slide, bodies that float or sink, joints that bend
# too far, jumps between frames. Limits are those of recorded motion.

print(t2d.check_motion(motion, expected="running"))

# %%
# The same run with the joints' last half set to another place, as a tracker does that loses its person and finds
# somebody else.

joints = motion.joints.copy()
joints[len(joints) // 2 :, :, 1] += 0.4
broken = t2d.motion_from_joints(joints, rate_hz=motion.rate_hz, names=motion.names, placed=False)
print(t2d.check_motion(broken, expected="running"))

# %%
# Arrays
# ------
#
# What you have as positions of joints goes into an `.npz` file with `joints` (time, joint, 3) in metres, `names` and
# `fps`, or straight through `motion_from_joints`. Rotations of the bones follow from the positions.

np.savez(folder / "mine.npz", joints=motion.joints, names=np.array(motion.names), fps=motion.rate_hz, up="z")
again = t2d.load_motion(folder / "mine.npz")
print(again)
print(f"joints differ by {1e3 * np.abs(again.joints - motion.joints).max():.1f} mm at most")

# %%
# In front of the radar a run is broader in speed than a walk: the swinging foot is several times as fast as the
# trunk, and each flight phase shows as a moment without anything at zero speed, because no foot stands.

recording = t2d.simulate(t2d.trim(motion, 0.0, 1.2))
recording.plot()

# %%
# A mesh of your own
# ------------------
#
# Anything with vertices that move is a target. Vertices are (time, vertex, 3) in metres, triangles counter-clockwise
# seen from outside. Here a metal cube spins about its vertical axis, a turn in a second, three metres in front of the
# radar and in its height.

box = trimesh.creation.box(extents=(0.2, 0.2, 0.2))
times_s = np.linspace(0.0, 1.0, 201)
angle = 2 * np.pi * times_s
turn = np.zeros((len(times_s), 3, 3))
turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = (
    np.cos(angle),
    -np.sin(angle),
    np.sin(angle),
    np.cos(angle),
    1,
)
vertices = np.einsum("tij,vj->tvi", turn, box.vertices) + [3.0, 0.0, 1.0]
cube = t2d.MovingMesh(vertices, box.faces, times_s, material="pec", name="cube")

# %%
# A flat face returns much when it faces the radar, for a moment and over all of its speeds at once: four flashes a
# turn. Between them only the upright edges answer. Each draws a piece of a sinusoid, as long as the radar sees it.
# The lobes of flat faces sweep past the radar much faster than echoes of a body's round limbs change, so this target
# asks for more surface frames than a body does.

recording = t2d.simulate(cube, accuracy={"surface_rate_hz": 400})
recording.plot()
