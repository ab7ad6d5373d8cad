"""
Gaits
=====

Somebody who walks, who limps and who shuffles with Parkinson's disease. A limp makes every other arc of a leg
different from the one between; a shuffle has low arcs, for the steps are short.
"""

import matplotlib.pyplot as plt

import t2d_rt as t2d

sentences = "a person walks forward", "a person limps forward", "a person shuffles forward with Parkinson's disease"
figure, axes = plt.subplots(nrows=3, figsize=(7, 8), sharex=True, sharey=True, layout="constrained")
for ax, sentence in zip(axes, sentences, strict=True):
    motion = t2d.place(t2d.trim(t2d.motion_from_text(sentence, seed=3, duration_s=4.0), 0.5, 3.5))
    t2d.simulate(motion, method="ellipsoid").plot(sentence, ax=ax)
    ax.set_ylim(-1.5, 5)

figure
