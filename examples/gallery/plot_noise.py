"""
Noise of the receiver
=====================

The same walk as it is and through a receiver with thermal noise, phase noise, 1/f noise, imbalance of I and Q and an
ADC of finite steps. The weakest arcs of the limbs are lost in it.
"""

import matplotlib.pyplot as plt

import t2d_rt as t2d

walk = t2d.place(t2d.trim(t2d.example("walk"), 1.0, 2.5), distance_m=5.0)
clean = t2d.simulate(walk, method="ellipsoid")
noisy = t2d.add_noise(clean, seed=1)
print(f"SNR of a sample before processing: {noisy.snr_db:.1f} dB")
top_db = float(clean.spectrogram.max())
figure, axes = plt.subplots(nrows=2, figsize=(7, 6), sharex=True, sharey=True, layout="constrained")
clean.plot("echoes alone", ax=axes[0], limits_db=(top_db - 60, top_db))
noisy.processed(mti="mean").plot("with the receiver's noise", ax=axes[1], limits_db=(top_db - 60, top_db))

axes[0].set_ylim(-3, 5)
figure
