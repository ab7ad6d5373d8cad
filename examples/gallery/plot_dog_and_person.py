"""
A dog behind a person
=====================

Range and speed at one moment: the person is nearer and stronger, the dog behind has a trunk and paws of its own.
"""

import t2d_rt as t2d

walk = t2d.place(t2d.trim(t2d.example("walk"), 1.0, 2.0), distance_m=3.0)
dog = t2d.Pet(animal="dog", position_m=(4.5, 0.5, 0), heading_deg=180)
recording = t2d.simulate([walk, dog])

recording.plot_range_doppler(time_s=0.5, interval_s=0.05)
