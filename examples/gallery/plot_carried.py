"""
What people carry
=================

One walk towards the radar, empty-handed, with a box, behind a walker and in a wheelchair. A box and a walker hold the arms
still; in a wheelchair the legs rest, wheels show speeds up to twice the chair's, and hands push and come back.
"""

import matplotlib.pyplot as plt

import t2d_rt as t2d

walk = t2d.place(t2d.trim(t2d.example("walk"), 1.0, 3.0), distance_m=5.5)
things = {"empty-handed": [], "box": ["box"], "walker": ["walker"], "wheelchair": ["wheelchair"]}
figure, axes = plt.subplots(2, 2, figsize=(11, 7), sharex=True, sharey=True, layout="constrained")
for ax, (name, carried) in zip(axes.flat, things.items(), strict=True):
    person = t2d.carry(walk, carried) if carried else walk
    t2d.simulate(person).plot(name, ax=ax, dynamic_range_db=60)
    ax.set_ylim(-3, 6)

figure
