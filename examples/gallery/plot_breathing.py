"""
Breathing
=========

A chest that moves by some millimetres turns the phase of its echo by whole cycles. Unwrapped and times lambda / 4 pi,
the phase is the chest's displacement, to within micrometres; `signal.vital_signs` finds it and the rates in it.
"""

import matplotlib.pyplot as plt
import numpy as np

import t2d_rt as t2d
from t2d_rt import signal

times_s = np.linspace(0.0, 16.0, 801)
chest_m = 0.004 * np.sin(2 * np.pi * 0.25 * times_s) + 0.0003 * np.sin(2 * np.pi * 1.2 * times_s)
centres_m = np.stack([2.0 - chest_m, 0 * times_s, 1.0 + 0 * times_s], axis=1)
chest = t2d.Ellipsoids([[0.12, 0.17, 0.25]], centres_m[:, None], times_s)
radar = t2d.Radar.preset("table2", prf_hz=100)
recording = t2d.simulate(chest, radar=radar)
signs = signal.vital_signs(recording.cube, radar)
print(signs)
truth_m = np.interp(signs.time_s, times_s, chest_m)
error_m = signs.displacement_m - truth_m - np.mean(signs.displacement_m - truth_m)
print(f"RMS error {1e6 * np.sqrt(np.mean(error_m**2)):.1f} um")
figure, ax = plt.subplots(figsize=(7, 3.4), layout="constrained")
ax.plot(signs.time_s, 1e3 * signs.displacement_m, label="from the phase")
ax.plot(times_s, 1e3 * (chest_m - chest_m.mean()), "--", label="truth: breath and pulse")
ax.set(xlabel="Time [s]", ylabel="Displacement to the radar [mm]")
ax.legend()

figure
