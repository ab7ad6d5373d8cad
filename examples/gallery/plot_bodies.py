"""
Bodies
======

One motion with the skins of two bodies. The speeds are those of the skeleton and stay; levels and glints follow the
shape.
"""

import matplotlib.pyplot as plt

import t2d_rt as t2d

walk = t2d.trim(t2d.example("walk"), 1.0, 1.6)
figure, axes = plt.subplots(nrows=2, figsize=(7, 6), sharex=True, sharey=True, layout="constrained")
recordings = {body: t2d.simulate(walk, body=body) for body in ("child", "heavy")}
top_db = max(float(each.spectrogram.max()) for each in recordings.values())
for ax, (body, recording) in zip(axes, recordings.items(), strict=True):
    recording.plot(body, ax=ax, limits_db=(top_db - 50, top_db))

figure
