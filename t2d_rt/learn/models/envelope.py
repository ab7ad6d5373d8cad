"""A perceptron on features of a map (Doppler envelope, activity over time, bands of speed); it learns most from few samples."""

from __future__ import annotations

import hashlib
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from t2d_rt.core.errors import InputError
from t2d_rt.core.memory import LastUsed
from t2d_rt.learn.features import band_features, check_steps, features
from t2d_rt.learn.models import ModelCard, Network

WIDTH = 512
DROPPED_FEATURES, DROPPED = 0.2, 0.5
FARTHEST = 4.0
"""Number of standard deviations at which features are clipped."""
RANGE_DB = 60.0
"""Level that an input of 0 stands for [dB below the greatest cell]; with another dynamic range, levels are stretched in the same
way in training and in use."""
HELD = 50_000
"""Number of maps whose features are cached: in training the same maps come again in each epoch, and with the next seed."""
_kept = LastUsed[np.ndarray](HELD)
"""Features by a hash of the map and its axes."""
CELLS = 1.5
"""Number of cells by which the greatest speeds of both signs may differ: an even number of Doppler bins has one more on one
side."""
AXIS = 9.8598, 5.0
"""Default axes until a training sets them: greatest speed [m/s] and duration [s]."""


class Envelope(nn.Module):
    """Network that computes features of maps, and scores from these."""

    velocity_mps: Tensor
    duration_s: Tensor

    def __init__(self, classes: int, size: tuple[int, int], channels: int) -> None:
        super().__init__()
        greatest, duration_s = AXIS
        self.columns = size[1]
        self.register_buffer("velocity_mps", torch.linspace(-greatest, greatest, size[0], dtype=torch.float64))
        self.register_buffer("duration_s", torch.tensor(duration_s, dtype=torch.float64))
        count = channels * len(self._features(np.linspace(-RANGE_DB, 0.0, size[0] * size[1]).reshape(size)))
        self.scaled = nn.BatchNorm1d(count, affine=False, momentum=None)
        self.layers = nn.Sequential(
            nn.Dropout(DROPPED_FEATURES),
            nn.Linear(count, WIDTH),
            nn.BatchNorm1d(WIDTH),
            nn.ReLU(),
            nn.Dropout(DROPPED),
            nn.Linear(WIDTH, classes),
        )

    def set_axes(self, velocity_mps: np.ndarray, duration_s: float) -> None:
        """Sets the speeds of the rows [m/s] and the duration of a map [s], which are stored with the weights.

        Raises InputError where maps are too short or too coarse for steps, or where approaching and receding speeds differ.
        """
        first, last = float(velocity_mps[0]), float(velocity_mps[-1])
        if abs(first + last) > CELLS * (last - first) / (len(velocity_mps) - 1):
            raise InputError(
                f"envelope takes maps of the same speeds approaching and receding, got {first:.3g} to {last:.3g} m/s; cut them to "
                "the same speeds, or take a network on pictures"
            )
        check_steps("envelope networks", self.columns, duration_s)
        self.velocity_mps.copy_(torch.from_numpy(np.asarray(velocity_mps, dtype=np.float64)))
        self.duration_s.fill_(duration_s)

    def forward(self, maps: Tensor) -> Tensor:
        """Scores (N, classes) for maps (N, channels, speed, time)."""
        levels = (maps.detach().cpu().numpy() - 1.0) * RANGE_DB
        rows = [np.concatenate([self._cached_features(channel) for channel in level]) for level in levels]
        table = torch.from_numpy(np.stack(rows)).to(maps.device)
        scores: Tensor = self.layers(self.scaled(table).clamp(-FARTHEST, FARTHEST))
        return scores

    def _cached_features(self, levels: np.ndarray) -> np.ndarray:
        """Features of a map, cached by a hash of the map and its axes, because in training each map comes in every epoch."""
        axes = self.velocity_mps.cpu().numpy().tobytes() + self.duration_s.cpu().numpy().tobytes()
        key = hashlib.blake2b(axes + levels.tobytes(), digest_size=16).digest()
        return _kept.get(key, partial(self._features, levels))

    def _features(self, levels: np.ndarray) -> np.ndarray:
        """Features of a map [dB], float32, finite."""
        velocity, duration_s = self.velocity_mps.cpu().numpy(), float(self.duration_s)
        named_features = {**features(levels, velocity, duration_s), **band_features(levels, velocity, duration_s)}
        return np.nan_to_num(np.array([*named_features.values()], dtype=np.float32))


ENVELOPE = Network(
    ModelCard(
        title="envelope",
        source="of this project: features as radar work has them since Kim and Ling (2009), a perceptron of one hidden layer",
        usual_size=128,
        counted_at=(1, 128, 128),
        note="Features are no layers: they are not counted, nor are gradients taken through them.",
    ),
    Envelope,
)
