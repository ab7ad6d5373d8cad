"""
Ceiling fan and door
====================

A blade of a ceiling fan answers when its long edge is square to the line of sight: a glint runs along it between the
hub, which stays at zero, and the tip, coming on one side and going on the other. A door that opens draws the speed of
its free edge; when the leaf is square to the line of sight, all speeds from hinge to edge flash at once.
"""

import matplotlib.pyplot as plt

import t2d_rt as t2d

fan = t2d.CeilingFan(position_m=(3, 0, 2.3), rpm=120)
door = t2d.Door(position_m=(3, 0.4, 0), opens_at_s=0.2, opening_s=1.0)
figure, axes = plt.subplots(nrows=2, figsize=(7, 6), layout="constrained")
for ax, (name, each) in zip(axes, {"ceiling fan": fan, "door": door}.items(), strict=True):
    t2d.simulate(each.mesh(0, 1.5)).plot(name, ax=ax)

figure
