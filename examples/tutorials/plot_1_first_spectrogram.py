"""
A first spectrogram
===================

A recorded walk, one FMCW radar, and what the radar sees of it: micro-Doppler spectrogram, range over time,
range-Doppler map. Then the recording is kept, loaded and exported.
"""

# %%
# A motion is a skeleton in time. Six come with the package; this is a walk that was recorded at Carnegie Mellon
# University.

import tempfile
from pathlib import Path

import t2d_rt as t2d

motion = t2d.trim(t2d.example("walk"), 1.0, 3.0)
print(motion)

# %%
# `simulate` puts a skin on the skeleton, lets it walk towards the radar and computes the ADC samples of every chirp.
# `table2` is the radar of the Text2Doppler paper, at 77 GHz. A Doppler shift belongs to one speed without doubt as
# long as the speed stays within the unambiguous one, which the chirp rate sets.

radar = t2d.Radar.preset("table2")
recording = t2d.simulate(motion, radar=radar)
print(radar)
print(recording)

# %%
# Speed over time
# ---------------
#
# The spectrogram shows the power at each radial speed over time. The strong band in the middle is the trunk, which
# speeds up and slows down a little with each step. The arcs above it are the legs: a foot leaves the ground,
# overtakes the trunk at several times its speed and stops where it lands. A foot that stands has no speed, and its
# echo lies on the line at zero.

recording.plot()

# %%
# Which limb makes which arc? A simulation knows. `truth` holds joints and segments of the body as the radar has them
# before it, here at the times of the spectrogram's columns. The arcs belong to the feet in turn. They reach higher
# than the lines, because a foot turns about its ankle, so that heel and toes are in turn faster than its middle,
# whose speed the line shows.

truth = recording.truth_at(recording.spectrogram.time_s).isel(person=0)
figure = recording.plot()
for segment, style in (("pelvis", "w-"), ("left_foot", "r--"), ("right_foot", "m--")):
    speed = truth.segment_speed_mps.sel(segment=segment)
    figure.axes[0].plot(speed.time_s, speed, style, linewidth=1, label=segment.replace("_", " "))
    print(f"{segment}: {float(speed.min()):.1f} to {float(speed.max()):.1f} m/s")
figure.axes[0].legend(fontsize=8, loc="upper right")
figure

# %%
# Range over time
# ---------------
#
# The same samples, sorted by range instead of speed. The body comes nearer. On the far side there are flat pieces,
# one for each step: the foot that stands keeps its range while the trunk goes on, until it is lifted and overtakes.
# The level of the trunk fluctuates, since the echoes of all parts of the body in one range bin add up with phases
# that turn as they move.

recording.plot_range_time()

# %%
# Range and speed at one moment
# -----------------------------
#
# A range-Doppler map tells both at once, for one short interval. When the right foot is fastest the trunk is the
# strong spot; above it stands the swinging leg, from the slow thigh over the shank to the foot, and at zero speed
# lies the left foot, behind the trunk.

right = truth.sel(segment="right_foot")
fastest = int(right.segment_speed_mps.argmax("time_s"))
fastest_s = float(right.time_s[fastest])
print(f"the right foot is fastest at {fastest_s:.2f} s, {float(right.segment_range_m[fastest]):.2f} m away")
recording.plot_range_doppler(time_s=fastest_s)

# %%
# Keep it
# -------
#
# A saved recording is a folder in the zarr format. It holds the samples, the spectrogram, and everything that it was
# made from, so that it can be simulated again, bit for bit.

folder = Path(tempfile.mkdtemp())
recording.save(folder / "walk.zarr")
same = t2d.Recording.load(folder / "walk.zarr")
print(same)
print((same.cube == recording.cube).all())

# %%
# Other programs read an export: `.mat` for MATLAB, `.npz` for NumPy, `.nc` for NetCDF, `.h5` for HDF5.

recording.export(folder / "walk.mat")
print(f"walk.mat: {(folder / 'walk.mat').stat().st_size / 1e6:.0f} MB")
