"""
A walk coloured by its limbs
============================

Each cell of the spectrogram has the hue of the limb that is strongest in it, and is the brighter the stronger the whole
is there. The feet make the fastest arcs, the shanks and thighs those below, and the arms swing about the trunk's line.
"""

import t2d_rt as t2d

recording = t2d.simulate(t2d.trim(t2d.example("walk"), 1.0, 3.5), split="segment")
print(recording.strongest(velocity_mps=3.0, time_s=1.5).to_dataframe().head(3))

recording.plot_parts("Walk, by limb")
