"""
Fan, curtain, pet
=================

What else moves in a home disturbs the recording of a person. This page shows what each disturber looks like alone,
what a fan does to a walk, and what its speed has to do with it.
"""

# %%
# Alone
# -----
#
# A mover is made by its class, or written in one line as the command line takes it (`--add`). Alone it has no end, so
# it is asked for its mesh over the time that is wanted.

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import t2d_rt as t2d

fan = t2d.TableFan(position_m=(2, -0.8, 1), heading_deg=135, rpm=300, material="pec")
movers = {
    "table fan": fan,
    "curtain in a draught": t2d.mover("curtain:3,0,2.4,width_m=1.5"),
    "dog": t2d.Pet(animal="dog", position_m=(3, 1, 0)),
}
figure, axes = plt.subplots(nrows=3, figsize=(7, 8), layout="constrained")
for ax, (name, mover) in zip(axes, movers.items(), strict=True):
    recording = t2d.simulate(mover.mesh(0, 1.0))
    recording.plot(name, ax=ax)
    print(f"{name}: strongest cell {float(recording.spectrogram.max()):.1f} dB re 1 W")
figure

# %%
# The metal fan is seen obliquely, so that a blade comes towards the radar on one side of the disc and goes away on
# the other. Each blade flashes once a turn where it faces the radar, here while it comes; three flashes make a turn.
# The line at zero is the hub. The curtain swings slowly, and its folds answer with all speeds between back and forth:
# a band of speckle without lines. The dog walks on a circle, goes away a little and comes back; its paws are several
# times as fast as its trunk, in steps that are shorter than a person's.

# %%
# Beside a walk
# -------------
#
# Targets in one list share the record. The fan's flashes lie among the speeds of arms and legs, and they never stop.

walk = t2d.trim(t2d.example("walk"), 1.0, 1.8)
alone = t2d.simulate(walk, seed=0)
beside = t2d.simulate([walk, fan], seed=0)
top_db = float(alone.spectrogram.max())
figure, axes = plt.subplots(ncols=2, figsize=(8, 3.2), sharey=True, layout="constrained")
alone.plot("walk", ax=axes[0], limits_db=(top_db - 50, top_db), bar=False)
beside.plot("walk beside the fan", ax=axes[1], limits_db=(top_db - 50, top_db))
figure

# %%
# How much is that? `compare` tells it in numbers. The torso's speed is nearly kept; the envelope, which the limbs
# draw and which many features of classifiers are made of, is not.

print(t2d.compare(alone, beside, labels=("walk", "with fan")))

# %%
# Speed of the fan
# ----------------
#
# `sweep` simulates one experiment again and again, with fields of it varied, and keeps the recordings in a folder.
# All panels have one scale. Twice the turns are twice the flashes, at twice the speed: a slow fan is hidden in the
# walk, a fast one stands above it. A fan at rest is a line at zero.

still = t2d.simulate([walk, fan], method="ellipsoid", seed=0)
result = t2d.sweep(still, {"targets.1.rpm": [0, 150, 300, 600]}, Path(tempfile.mkdtemp()) / "fans")
print(result)

# %%
# The greatest speed of the envelope is taken for that of limbs, until the fan is faster than these.

result.plot()
