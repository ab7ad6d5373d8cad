"""
A ball that vibrates
====================

A vibration of amplitude a gives lines at multiples of its frequency, of levels J_n(4 pi a / lambda)^2: Bessel
functions of the phase's swing. Thirty hertz and a tenth of the wavelength here.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.special import jv

import t2d_rt as t2d

radar = t2d.Radar.preset("table2", prf_hz=1000)
amplitude_m, rate_hz = 0.1 * radar.wavelength_m, 30.0
times_s = np.linspace(0.0, 1.0, 1001)
centres_m = np.stack([3.0 + amplitude_m * np.sin(2 * np.pi * rate_hz * times_s), 0 * times_s, 1 + 0 * times_s], axis=1)
ball = t2d.Ellipsoids([[0.1, 0.1, 0.1]], centres_m[:, None], times_s, material="pec")
recording = t2d.simulate(ball, radar=radar, accuracy={"surface_rate_hz": 500})
profile = recording.range_profile[:, 0]
series = profile[:, int((np.abs(profile) ** 2).sum("chirp").argmax("range_m"))].values
spectrum = np.abs(np.fft.fft(series) / len(series)) ** 2
frequency_hz = np.fft.fftfreq(len(series), 1 / radar.prf_hz)
order = np.arange(-4, 5)
figure, ax = plt.subplots(figsize=(7, 3.4), layout="constrained")
level_db = 10 * np.log10(np.fft.fftshift(spectrum) / np.mean(np.abs(series) ** 2))
bessel_db = 20 * np.log10(np.abs(jv(order, 4 * np.pi * amplitude_m / radar.wavelength_m)))
ax.plot(np.fft.fftshift(frequency_hz), level_db, label="simulated")
ax.plot(order * rate_hz, bessel_db, "o", label="Bessel lines")
ax.set(xlabel="Doppler frequency [Hz]", ylabel="Power rel. to the whole [dB]", xlim=(-150, 150), ylim=(-70, 5))
ax.legend()

figure
