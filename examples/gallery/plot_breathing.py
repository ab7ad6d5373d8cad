"""
Breathing
=========

A chest that moves by some millimetres turns the phase of its echo by whole cycles. Unwrapped and times lambda / 4 pi,
the phase is the chest's displacement, to within micrometres.
"""

import matplotlib.pyplot as plt
import numpy as np

import t2d_rt as t2d

times_s = np.linspace(0.0, 8.0, 401)
chest_m = 0.004 * np.sin(2 * np.pi * 0.25 * times_s) + 0.0003 * np.sin(2 * np.pi * 1.2 * times_s)
centres_m = np.stack([2.0 - chest_m, 0 * times_s, 1.0 + 0 * times_s], axis=1)
chest = t2d.Ellipsoids([[0.12, 0.17, 0.25]], centres_m[:, None], times_s)
radar = t2d.Radar.preset("table2", prf_hz=200)
recording = t2d.simulate(chest, radar=radar)
profile = recording.range_profile[:, 0]
phase = np.unwrap(np.angle(profile[:, int((np.abs(profile) ** 2).sum("chirp").argmax("range_m"))]))
seen_m = -phase * radar.wavelength_m / (4 * np.pi)
truth_m = np.interp(recording.adc.chirp_time_s, times_s, chest_m)
error_m = seen_m - truth_m - np.mean(seen_m - truth_m)
print(f"RMS error {1e6 * np.sqrt(np.mean(error_m**2)):.1f} um")
figure, ax = plt.subplots(figsize=(7, 3.4), layout="constrained")
ax.plot(recording.adc.chirp_time_s, 1e3 * (seen_m - np.mean(seen_m - truth_m)), label="from the phase")
ax.plot(times_s, 1e3 * chest_m, "--", label="truth: breath and pulse")
ax.set(xlabel="Time [s]", ylabel="Displacement to the radar [mm]")
ax.legend()

figure
