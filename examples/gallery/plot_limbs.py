"""
A walk coloured by its limbs
============================

Each cell of the spectrogram has the hue of the limb that is strongest in it, and is the brighter the stronger the whole
is there; above it stands the body in the same colours, the radar on its right. The feet make the fastest arcs, the
shanks and thighs those below, and the arms swing about the trunk's line.
"""

import t2d_rt as t2d

walk = t2d.place(t2d.trim(t2d.example("walk"), 0.77, 3.31), distance_m=7.0)
recording = t2d.simulate(walk, split="segment").processed(n_window=384, n_fft=1024)
print(recording.strongest(velocity_mps=3.5, time_s=1.1).to_dataframe().head(3))

recording.plot_parts("Walk, by limb", poses=8, dynamic_range_db=60)
