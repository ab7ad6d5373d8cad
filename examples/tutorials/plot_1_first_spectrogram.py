"""
A first spectrogram
===================

A recorded walk, one FMCW radar, and the micro-Doppler signature that the radar sees.
"""

# %%
# A motion is a skeleton in time. Six come with the package.

import t2d_rt as t2d

motion = t2d.trim(t2d.example("walk"), 1.0, 3.0)
print(motion)

# %%
# `simulate` puts a skin on the skeleton, walks it towards the radar and computes the ADC samples of every chirp. `table2` is
# the radar of the Text2Doppler paper: 77 GHz, 1.73 GHz of bandwidth, 10 240 chirps a second.

recording = t2d.simulate(motion, radar="table2")
print(recording)

# %%
# The spectrogram shows speed towards the radar over time: the trunk as the strongest line, and an arc for each swing of a leg.

recording.plot()
