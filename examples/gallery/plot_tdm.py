"""
Transmitters in turn
====================

With time division the transmitters of an array send one after the other, and a target moves in between. The phase of
that motion looks like another direction unless it is taken out by the Doppler shift that is measured along with it.
"""

import matplotlib.pyplot as plt
import numpy as np

import t2d_rt as t2d
from t2d_rt import signal

radar = t2d.Radar.preset("array-3x4")
times_s = np.linspace(0.0, 0.1, 11)
centres_m = np.stack([4.0 - 7.0 * times_s, 0 * times_s, 1.0 + 0 * times_s], axis=1)
ball = t2d.Ellipsoids([[0.1, 0.1, 0.1]], centres_m[:, None], times_s, material="pec")
recording = t2d.simulate(ball, radar=radar)
figure, ax = plt.subplots(figsize=(7, 3.4), layout="constrained")
for name, compensate in (("as recorded", False), ("motion taken out", True)):
    image = signal.range_angle(recording.cube, radar, compensate_tdm=compensate, range_gate_m=(3, 5))
    power_db = 10 * np.log10(image.power.max(axis=0))
    ax.plot(np.degrees(image.azimuth_rad), power_db, label=name)
    print(f"{name}: {np.degrees(image.azimuth_rad[power_db.argmax()]):.1f} deg")
ax.set(xlabel="Azimuth [deg], left > 0", ylabel="Power [dB re 1 W]", xlim=(80, -80), ylim=(-155, -115))
ax.legend()

figure
