"""
Which limb, which wall makes that line?
=======================================

A spectrogram is one sum. Here it is taken apart again: a walk by its limbs, a room by its walls, a fall by its phases,
and the ellipsoid model segment by segment. Parts come from one simulation and add up to it, so what they show is not
another model, but the same samples.
"""

# %%
# A walk by its limbs
# -------------------
#
# `split="segment"` keeps what each of the body's 17 segments returned. Pictures put them together by limbs. Each cell
# has the hue of the limb that is strongest in it, and is the brighter the stronger the whole is there. Each body
# stands above its time, the radar on its right.

import t2d_rt as t2d

walk = t2d.place(t2d.trim(t2d.example("walk"), 0.77, 2.05), distance_m=6.0)
recording = t2d.simulate(walk, split="segment")
recording.plot_parts("Walk, by limb", poses=6, dynamic_range_db=60)

# %%
# Two steps. Where the bodies stand with both feet on the ground, all lines come together at the trunk's. In between
# one foot draws its arc, faster than 3 m/s, and its shank the lower one; the other foot stands and draws a line at
# zero. What lies between belongs to thighs and arms.
#
# In this picture the weaker limb of a cell is not seen. Stacked, each limb has a picture of its own, on one scale.

recording.plot_parts("Walk, by limb", stacked=True, dynamic_range_db=60)

# %%
# Head and trunk are hardly to be told apart by their speeds, and the head is weaker: of its power hardly any lies in
# cells where no other limb is stronger. What draws much is not what is strong: the feet, whose arcs everyone knows, are
# 20 dB weaker than the trunk.

limbs = recording.parts.grouped()
limbs.levels().sortby("level_db", ascending=False).to_dataframe().round(2)

# %%
# For one cell of the spectrogram, `strongest` tells which segments make it. Parts interfere: levels do not add up,
# samples do.

recording.strongest(velocity_mps=3.0, time_s=0.45).to_dataframe().round(1).head(3)

# %%
# A part is a recording of its own, with all its maps.

recording.parts["right_foot"].plot_range_doppler("Right foot", time_s=0.45, interval_s=0.1)

# %%
# A room's ghosts by wall
# -----------------------
#
# The same walk in a room, split by path. Each wall shows the walk once more, at the speed at which its mirror image
# comes nearer: the wall behind the radar at the same speeds, the walls aside more slowly, the wall ahead at nearly none.

room = t2d.simulate(walk, scene="empty_room", reflections=1, split="path", collisions="ignore")
room.plot_parts("Ghosts of a walk, by wall", groups={}, stacked=True)

# %%
# Which ghosts would be seen? The one of the wall behind the radar is the strongest, and the direct echo covers it,
# for it has the same speeds. Weaker ones lie in gaps. This is the fraction of each ghost's power that lies where
# nothing else is stronger.

room.parts.levels().sortby("level_db", ascending=False).to_dataframe().round(2)

# %%
# Phases of a fall
# ----------------
#
# A person stands, faints and falls towards the radar. First the knees give way: head and thighs move forward, the arms
# back. Then the trunk goes over, the head ahead of it. When the trunk is on the ground the feet are thrown up.

fall = t2d.motion_from_text("a person stands still, then faints and falls forward", seed=2)
fall = t2d.place(t2d.trim(fall, 1.6, 4.0), distance_m=4.0)
down = t2d.simulate(fall, split="segment")
down.plot_parts("A fall, by limb", poses=6, dynamic_range_db=60)

# %%
# The fastest line of this fall is not a foot's, as it is in a walk, but the head's.

down.strongest(velocity_mps=2.9, time_s=1.42).to_dataframe().round(1).head(3)

# %%
# Ellipsoids, segment by segment
# ------------------------------
#
# Where is the ellipsoid model right? Both models have the same segments, so `compare` tells it for each.

coarse = t2d.simulate(walk, method="ellipsoid", split="segment")
comparison = t2d.compare(recording, coarse)
for name, difference_db in sorted(comparison.parts_db.items(), key=lambda each: each[1]):
    print(f"{name:16} {difference_db:+.1f} dB")

# %%
# The pelvis is far too weak: its skin has flat parts that face the radar, and an ellipsoid has none. Ellipsoids do not
# hide one another, and neck and left shank are too strong. In colour: the arcs are in the right places, but each limb
# draws one thin line. :doc:`/explain` has a table over motions and views.

coarse.plot_parts("Ellipsoids, by limb", poses=6, dynamic_range_db=60)

# %%
# `sweep(..., split="segment")` compares many recordings in this way: which limb does a fan hide, which ghost does a
# curtain make? :doc:`/explain` shows that, too.
