"""
Limb by limb
============

What each limb of a running person returns by itself, on one scale. They are parts of one simulation: their samples add
up to those of the whole.
"""

import t2d_rt as t2d

run = t2d.place(t2d.example("run"), distance_m=8.0)
recording = t2d.simulate(run, split="segment")
print(recording.parts.grouped().levels().to_dataframe().round(2))

recording.plot_parts("Run, by limb", stacked=True, dynamic_range_db=60)
