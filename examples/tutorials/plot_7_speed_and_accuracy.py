"""
Speed against accuracy
======================

Every simulation is wrong by some amount. Here the amount is asked for beforehand, planned, measured after the run,
and at last held against a much finer simulation.
"""

# %%
# Ask for an error
# ----------------
#
# The error is that of the targets' field: the energy of its difference from a converged model, over the energy of the
# field. It is a strict measure, as an echo of the right power with a wrong phase counts as an error. A plan says what
# a tolerance would take, and what the model would leave out for it, without a run.

import time

import matplotlib.pyplot as plt
import numpy as np

import t2d_rt as t2d

walk = t2d.trim(t2d.example("walk"), 1.0, 1.6)
plan = t2d.plan(walk, tolerance_db=-20)
print(plan)

# %%
# With `tolerance_db` the run is planned like that, and a few random chirps are simulated again by another model. From
# the difference the error of the run is estimated.

recording = t2d.simulate(walk, tolerance_db=-20)
print(f"tolerance -20 dB, planned {plan.error_db:.1f} dB, measured {recording.error_db:.1f} dB")

# %%
# What it costs
# -------------
#
# The same walk by several models, each with its CPU time, and its error against one that is much finer than all of
# them. Seconds are those of the machine that made this page.


def seconds_and_cube(**options):
    start = time.process_time()
    cube = t2d.simulate(walk, **options).cube
    return time.process_time() - start, cube


def error_db(cube, reference):
    return 10 * np.log10(np.sum(np.abs(cube - reference) ** 2) / np.sum(np.abs(reference) ** 2))


finest = {"sagitta_scale": 0.3, "spline_error_db": -60, "visibility_rate_hz": 100, "visibility_subdivision": 1}
_, reference = seconds_and_cube(accuracy=finest)
runs = {
    "ellipsoids": {"method": "ellipsoid"},
    "sagitta x 4": {"accuracy": {"sagitta_scale": 4}},
    "sagitta x 2": {"accuracy": {"sagitta_scale": 2}},
    "default": {},
    "sagitta / 2": {"accuracy": {"sagitta_scale": 0.5, "visibility_rate_hz": 50, "spline_error_db": -42}},
}
figure, ax = plt.subplots(figsize=(6, 3.8), layout="constrained")
for name, options in runs.items():
    seconds, cube = seconds_and_cube(**options)
    print(f"{name:12} {seconds:5.1f} s  {error_db(cube, reference):6.1f} dB")
    ax.plot(seconds, error_db(cube, reference), "o")
    ax.annotate(name, (seconds, error_db(cube, reference)), xytext=(6, 4), textcoords="offset points", fontsize=8)
ax.set(xlabel="CPU time of the run [s]", ylabel="Error of the field [dB]")
ax.margins(0.18)
ax.grid(alpha=0.3)
figure

# %%
# Ellipsoids are off by as much as there is: their echoes have the right speeds and about the right powers, but not
# the phases of a body. Finer facets bring the error down at little cost at first, since what a run costs in any case
# rules there.

# %%
# What an error looks like
# ------------------------
#
# The difference itself has a spectrogram. On the scale of the recording it shows where the default model errs: not at
# speeds where nothing moves, but along the echoes, and tens of decibels below them.

default = t2d.simulate(walk)
difference = t2d.Recording(default.cube - reference, default.radar)
top_db = float(default.spectrogram.max())
figure, axes = plt.subplots(ncols=2, figsize=(8, 3.2), sharey=True, layout="constrained")
default.plot("recording", ax=axes[0], limits_db=(top_db - 60, top_db), bar=False)
difference.plot("its difference from the finest", ax=axes[1], limits_db=(top_db - 60, top_db))
figure
