"""Networks that classify spectrograms, one file each; a new file is a new model.

Each file has ABOUT, a `ModelCard`, and `build(classes, size, channels)`, which gives a torch module from maps
(N, channels, speed, time), 1 at the greatest cell and 0 at the end of the dynamic range, to scores (N, classes).
"""

from t2d_rt.learn.models.registry import Count, ModelCard, Printed, build, card, count, model_names

__all__ = ["Count", "ModelCard", "Printed", "build", "card", "count", "model_names"]
