"""The background of a radar's spectrograms, learned from recordings in which nobody moves.

A VQ-VAE turns spectrograms into codes, a prior draws new codes, and the decoder turns these into a background of any length.
Sampling needs NumPy only; training needs the extra [learn].
"""

from t2d_rt.noise.background.model import Background, BackgroundModel, add_background, load_background
from t2d_rt.noise.background.records import BackgroundRecord, Grid

__all__ = ["Background", "BackgroundModel", "BackgroundRecord", "Grid", "add_background", "load_background"]
