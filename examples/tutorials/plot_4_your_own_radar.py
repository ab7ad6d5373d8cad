"""
Your own radar, and a cube of your own
======================================

A radar is some ten numbers. With them a person can be simulated as your device would see it, and a recording that
your device has made can be read and shown in the same pictures. To see your own samples in a few minutes, go straight
to `A cube of your own`_.
"""

# %%
# Your own radar
# --------------
#
# The fields are those of a data sheet or of a chirp configuration. Printed, the radar tells what it resolves: the
# range bin is the speed of light over twice the bandwidth, the unambiguous speed a quarter of the wavelength times
# the chirp rate.

import tempfile
from pathlib import Path

import numpy as np

import t2d_rt as t2d

radar = t2d.Radar(carrier_hz=60e9, slope_hz_per_s=60e12, sample_rate_hz=5e6, samples=256, prf_hz=4000)
print(radar)
print(f"range bin {100 * radar.range_resolution_m:.1f} cm, unambiguous speed {radar.max_speed_mps:.2f} m/s")

# %%
# It is kept in a file, which the command line takes as well: `t2d-rt simulate walk --radar my_radar.yaml`.

folder = Path(tempfile.mkdtemp())
radar.to_yaml(folder / "my_radar.yaml")
print((folder / "my_radar.yaml").read_text())

# %%
# A walk before it. With a longer wavelength than at 77 GHz a speed makes a smaller Doppler shift, and cells are
# coarser in speed for windows of the same length.

walk = t2d.trim(t2d.example("walk"), 1.0, 2.0)
recording = t2d.simulate(walk, radar=folder / "my_radar.yaml")
recording.plot()

# %%
# A cube of your own
# ------------------
#
# You need two things: the radar's numbers as above, and the samples in a `.npy` file, complex, of shape (chirp,
# sample) or (chirp, antenna, sample). Real and imaginary part may stand along a last axis of 2 instead. This page has
# no device at hand, so it writes such a file by the textbook's formula: two point targets, one coming and one going,
# and noise. Put your own file in its place.

rng = np.random.default_rng(0)
chirp_s, fast_s = np.arange(512)[:, None] / radar.prf_hz, np.arange(radar.samples) / radar.sample_rate_hz
samples = 0.1 * (rng.standard_normal((512, 256)) + 1j * rng.standard_normal((512, 256)))
for range_m, speed_mps, amplitude in ((3.0, 1.5, 1.0), (6.0, -0.8, 0.3)):
    delay_s = 2 * (range_m - speed_mps * (chirp_s + fast_s)) / 299_792_458
    phase = radar.carrier_hz * delay_s + radar.slope_hz_per_s * (delay_s * fast_s - delay_s**2 / 2)
    samples += amplitude * np.exp(2j * np.pi * phase)
np.save(folder / "frames.npy", samples.astype(np.complex64))

# %%
# `load_recording` reads it. What does not fit the radar is refused with a sentence that says what would; where
# samples look as if Q came before I, or the sign of the beat were the other way round, a warning says so (`iq="QI"`,
# `conjugate=True`).

measured = t2d.load_recording(folder / "frames.npy", folder / "my_radar.yaml")
print(measured)

# %%
# The range-Doppler map. Levels of measured samples are relative, unless you know what a sample of 1 is in square
# roots of a watt.

measured.plot_range_doppler(interval_s=0.1, dynamic_range_db=40)

# %%
# The strongest cell lies where the first target was at that time: where it started less what it has moved, to within
# a bin.

image = measured.range_doppler_at(interval_s=0.1)
speed, bin_m = np.unravel_index(image.values.argmax(), image.shape)
print(f"strongest at {float(image.range_m[bin_m]):.2f} m and {float(image.velocity_mps[speed]):.2f} m/s")
print(f"the first target: {3.0 - 1.5 * image.attrs['time_s']:.2f} m and 1.5 m/s")

# %%
# From here a measured recording is like a simulated one: `plot()` for its spectrogram, `save`, `export`, and
# `t2d.compare(measured, simulated, align=True, relative=True)` beside a simulation. Static clutter, which measured
# rooms are full of, is taken away by `measured.processed(mti="mean")`.

measured.processed(mti="mean").plot_range_time(dynamic_range_db=40)
