"""
Two persons
===========

One walks towards the radar and one away from it: their spectra lie on both sides of zero. Power falls with the fourth
power of range, so that the one who goes is strong at first, and the one who comes is in the end.
"""

import t2d_rt as t2d

walk = t2d.trim(t2d.example("walk"), 1.0, 2.5)
coming = t2d.place(walk, distance_m=4.0)
going = t2d.place(t2d.mirror(walk), distance_m=2.0, angle_deg=180)
recording = t2d.simulate([coming, going], collisions="ignore")

recording.plot()
