"""
Range and angle with an array
=============================

Two persons at one range, 25 degrees to the left and to the right. The twelve virtual antennas of a 3 x 4 array tell
their directions apart; a spot is as wide as the beam of so small an array.
"""

import numpy as np

import t2d_rt as t2d

radar = t2d.Radar.preset("array-3x4")
walk = t2d.trim(t2d.example("walk"), 1.0, 1.2)
sides = [(np.cos(angle), np.sin(angle), 0.0) for angle in np.radians([25, -25])]
persons = [t2d.place(walk, distance_m=4.0, boresight=side) for side in sides]
recording = t2d.simulate(persons, radar=radar, method="ellipsoid")

recording.plot_range_angle(dynamic_range_db=30)
