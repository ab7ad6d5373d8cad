"""
A pendulum
==========

A metal ball on a string, pulled aside and let go. Its speed follows from energy alone; drawn over the spectrogram it
lies in the middle of the line, whose width is that of the window.
"""

import numpy as np
from scipy.integrate import solve_ivp

import t2d_rt as t2d

length_m, start = 1.0, np.radians(40)
times_s = np.linspace(0.0, 3.0, 301)
swing = solve_ivp(lambda _, y: [y[1], -9.81 / length_m * np.sin(y[0])], (0, 3), (start, 0), t_eval=times_s, rtol=1e-9)
angle, rate = swing.y
centres_m = np.stack([3 + length_m * np.sin(angle), 0 * angle, 2 - length_m * np.cos(angle)], axis=1)
ball = t2d.Ellipsoids([[0.05, 0.05, 0.05]], centres_m[:, None], times_s, material="pec")
recording = t2d.simulate(ball)
towards = centres_m - [0, 0, 1]
velocity = length_m * rate[:, None] * np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
radial_mps = -np.sum(velocity * towards, axis=1) / np.linalg.norm(towards, axis=1)
figure = recording.plot()
figure.axes[0].autoscale(False)
figure.axes[0].plot(times_s, radial_mps, "r--", linewidth=1, label="from the equation of motion")
figure.axes[0].legend(loc="upper right", fontsize=8)

figure
