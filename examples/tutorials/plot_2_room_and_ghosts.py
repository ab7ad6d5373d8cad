"""
A room and its ghosts
=====================

Walls, floor and ceiling are mirrors for a radar. Each adds paths to everything that moves, and each pair of paths,
out and back, shows the target once more, at a range and a speed of its own: a ghost. This page lists the paths and
names the ghosts on the map.
"""

# %%
# One metal ball
# --------------
#
# A ball is the simplest target: a single echo for each path pair. It flies through an empty room, towards the radar
# and to the left.

import matplotlib.pyplot as plt
import numpy as np

import t2d_rt as t2d

times_s = np.linspace(0.0, 0.4, 41)
centres_m = np.stack([4.5 - 2.0 * times_s, -0.8 + 1.5 * times_s, 1.2 + 0 * times_s], axis=1)
ball = t2d.Ellipsoids([[0.1, 0.1, 0.1]], centres_m[:, None], times_s, material="pec", names=["ball"])
recording = t2d.simulate(ball, scene="empty_room")
print(recording)

# %%
# `paths` is the table of what was modelled, for each pair of paths and over time. Range on a map is half the length
# of the round trip. Paths are named by what they meet on the way out and on the way back: "direct, floor" goes
# straight to the ball and comes back over the floor, or the other way round, which adds up to the same echo twice.

paths = recording.paths_at(0.2).isel(target=0, time_s=0).sortby("level_dbm", ascending=False)
table = paths[["length_m", "speed_mps", "level_dbm", "reflections"]].to_dataframe()
table["range_m"] = table.length_m / 2
print(f"{len(table)} path pairs, the strongest of them:")
table[["range_m", "speed_mps", "level_dbm", "reflections"]].head(10).round(2)

# %%
# On the map of range and speed the strongest pairs are marked. The ball itself is nearest, as the direct path is the
# shortest there is.
#
# - "direct, floor" and "direct, ceiling" lie just behind it with nearly its speed, for the ball flies along these
#   mirrors.
# - "direct, wall-y" is much slower than the ball, since the ball flies away from that wall; "direct, wall+y" is a
#   little faster.
# - "direct, wall-x" is the wall behind the radar: the detour over it is nearly the same all the time, so the ghost
#   has about the speed of the ball and follows it at a nearly fixed distance.
# - "direct, wall+x" is the far wall: the ball comes towards the radar and flies away from its mirror image behind
#   that wall. The two speeds add up to almost none, and a filter against static clutter may take this ghost away.

recording.plot_range_doppler(time_s=0.2, interval_s=0.1, ghosts=True, dynamic_range_db=60)

# %%
# Paths are switched on and off by name. Echoes add up, so that the ghosts of one wall and all that is without it make
# the whole again.

wall = {"scene": "empty_room", "clutter": "none"}
whole = t2d.simulate(ball, **wall).cube
parts = [t2d.simulate(ball, **wall, **{which: ["*wall-y*"]}).cube for which in ("only_paths", "without_paths")]
share, rest = (np.sum(np.abs(each) ** 2) / np.sum(np.abs(whole) ** 2) for each in (parts[0], sum(parts) - whole))
print(
    f"ghosts of the wall {10 * np.log10(share):.1f} dB, what the sum of both parts lacks {10 * np.log10(rest):.1f} dB"
)

# %%
# A walk
# ------
#
# A person has the same ghosts, each with arms and legs of its own. Two recordings of one walk, in free space and in
# the room, on one scale: the trunk and the legs' arcs stay where they were, but gaps between the limbs fill up,
# because ghosts of fast and slow limbs come at other speeds than the limbs.

walk = t2d.trim(t2d.example("walk"), 1.0, 2.0)
free = t2d.simulate(walk, seed=0)
room = t2d.simulate(walk, scene="empty_room", reflections=1, seed=0)
figure, axes = plt.subplots(ncols=2, figsize=(8, 3.2), sharey=True, layout="constrained")
limits_db = float(free.spectrogram.max()) - 50, float(free.spectrogram.max())
free.processed(mti="mean").plot("free space", ax=axes[0], limits_db=limits_db, bar=False)
room.plot("empty room", ax=axes[1], limits_db=limits_db)
figure

# %%
# The same in numbers. The mean radar cross-section is read from all samples, so that in the room it is that of the
# walls.

print(t2d.compare(free.processed(mti="mean"), room, labels=("free space", "empty room")))

# %%
# On a map of range and speed they come apart again: behind the person stand ghosts of the whole person.

room.plot_range_doppler(time_s=0.5, ghosts=True)

# %%
# `room.view()` shows body, room and paths in three dimensions beside these maps, with one time cursor: see
# :doc:`/view`.
