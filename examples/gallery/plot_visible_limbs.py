"""
What of a body is in sight
==========================

Of the skin of each segment that faces the radar, the fraction that nothing hides, for a walk past the radar from the
side: the far leg and the far arm are hidden in turn by what is nearer.
"""

import matplotlib.pyplot as plt

import t2d_rt as t2d

aside = t2d.place(t2d.trim(t2d.example("walk"), 1.0, 2.5), distance_m=3.0, angle_deg=90)
recording = t2d.simulate(aside, method="ellipsoid")
seen = recording.truth.segment_visible.isel(person=0)
figure, ax = plt.subplots(figsize=(7, 4.4), layout="constrained")
drawn = ax.pcolormesh(seen.time_s, range(17), seen.transpose("segment", "time_s"), vmin=0, vmax=1, cmap="cividis")
ax.set(xlabel="Time [s]", ylabel="Segment", yticks=range(17))
ax.set_yticklabels([name.replace("_", " ") for name in seen.segment.values], fontsize=8)
figure.colorbar(drawn, label="Fraction that is seen")

figure
