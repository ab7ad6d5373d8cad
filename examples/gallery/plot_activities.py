"""
Activities
==========

Four activities from one sentence each. Walking and running have arcs of swinging legs on a trunk that moves; who sits
down moves away once, back onto the chair, and then rests; a bend is one movement down and one up.
"""

import matplotlib.pyplot as plt

import t2d_rt as t2d

sentences = [
    "a person walks forward",
    "a person runs forward fast",
    "a person walks to a chair and sits down",
    "a person bends down to pick up a ball",
]
figure, axes = plt.subplots(nrows=2, ncols=2, figsize=(8, 5.6), layout="constrained")
for ax, sentence in zip(axes.flat, sentences, strict=True):
    motion = t2d.motion_from_text(sentence, seed=0)
    motion = t2d.place(t2d.trim(motion, max(0.0, motion.duration_s - 3.0)))
    recording = t2d.simulate(motion, method="ellipsoid")
    recording.plot(sentence, ax=ax)

figure
