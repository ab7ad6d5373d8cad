"""
24, 60 and 77 GHz
=================

One walk before three radars. Windows have the same length in time, so that a cell is as many hertz wide in each; in
speed it is narrower the higher the carrier, and limbs come apart.
"""

import matplotlib.pyplot as plt

import t2d_rt as t2d

walk = t2d.trim(t2d.example("walk"), 1.0, 2.5)
figure, axes = plt.subplots(nrows=3, figsize=(7, 8), sharex=True, sharey=True, layout="constrained")
for ax, (name, carrier_hz) in zip(axes, (("24 GHz", 24e9), ("60 GHz", 60e9), ("77 GHz", 77e9)), strict=True):
    radar = t2d.Radar.preset("table2", carrier_hz=carrier_hz, prf_hz=8000)
    recording = t2d.simulate(walk, radar=radar, method="ellipsoid").processed(n_window=400, overlap=320)
    recording.plot(name, ax=ax)
    ax.set_ylim(-1.5, 4.5)

figure
