"""The networks of a background model in NumPy: their sizes, the prior that draws codes, and the decoder from codes to mean and
looks of every cell.

`training.Decoder` and `training.Prior` are the same networks in PyTorch, for training.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from t2d_rt.core.errors import InputError
from t2d_rt.types.fields import Count, Fields

KEPT_ROWS = 6
"""Least number of rows in the coarsest maps: fewer could not distinguish approaching from receding interferers."""
HALO = 3
"""Steps on either side of a step that the decoder's convolutions use, for 2 residual blocks and any number of stages."""


Size = Annotated[Count, Field(ge=1, le=4096)]
"""Size of a part of the network; the limit keeps a damaged file from asking for any amount of memory."""


class Architecture(Fields):
    """Sizes of the networks. Each step of `columns` columns has one latent vector, made of `heads` parts; each part is an entry of
    its own code book of `codes` entries."""

    noun: ClassVar[str] = "architecture"

    bins: Size
    """Doppler bins of the spectrograms."""
    time_halvings: Size = 3
    """Number of times that columns are halved: a step has 2^time_halvings columns."""
    heads: Size = 4
    """Number of codes in a step, each from its own code book."""
    codes: Size = 32
    """Number of entries of each code book."""
    code_size: Size = 16
    """Length of an entry."""
    channels: Size = 64
    """Number of channels of the coarsest maps."""
    residual: Size = 32
    """Number of channels in the middle of a residual block (van den Oord et al. 2017)."""
    blocks: Annotated[Size, Field(le=2)] = 2
    """Number of residual blocks."""
    hidden: Size = 192
    """Size of the prior's state over time."""
    mixed: Size = 64
    """Number of units of the prior within a step."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Refuses more halvings of columns than of Doppler bins, since each stage halves both."""
        if self.time_halvings > self.doppler_halvings:
            raise InputError(
                f"{self.bins} Doppler bins are halved {self.doppler_halvings} times and columns {self.time_halvings} times; "
                "take fewer time_halvings"
            )
        return self

    @property
    def columns(self) -> int:
        """Number of columns of the spectrogram in a step."""
        return int(2**self.time_halvings)

    @property
    def doppler_halvings(self) -> int:
        """Number of times that Doppler bins are halved."""
        return max(1, int(math.log2(max(2, self.bins / KEPT_ROWS))))

    @property
    def rows(self) -> int:
        """Number of Doppler rows of the coarsest maps; bins are padded to rows times 2^doppler_halvings."""
        return int(-(-self.bins // 2**self.doppler_halvings))

    @property
    def padded_bins(self) -> int:
        """Number of Doppler bins after padding."""
        return int(self.rows * 2**self.doppler_halvings)

    @property
    def latent(self) -> int:
        """Length of a latent vector."""
        return self.heads * self.code_size

    @property
    def stages(self) -> list[tuple[int, int, int]]:
        """Upsampling stages from the coarsest maps to the spectrogram: channels in, channels out, and the factor in time (1 or 2).

        The last one yields 2 x 2 (or 2 x 1) cells with two channels each, mean and looks.
        """
        count = self.doppler_halvings
        times = [1] * (count - self.time_halvings) + [2] * self.time_halvings
        sizes = [max(16, round(self.channels / 16 / (1 + 0.5 * stage)) * 16) for stage in range(count)]
        outs = [*sizes[1:], 2 * 2 * times[-1]]
        return list(zip(sizes, outs, times, strict=True))


Arrays = Mapping[str, np.ndarray]
BLOCK = 16
"""Steps that are decoded at once. All blocks have the same size, so that the beginning of a long record has the same bits as a
short record."""
NATS_PER_UNIT = 2.0
"""Unit of the network's outputs, which are of the order of one: the level is in units of 2 nats (8.7 dB) relative to the mean
profile."""
LEAST_LOOKS, MOST_LOOKS = 0.7, 3000.0


def decoded(architecture: Architecture, arrays: Arrays, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean power relative to the noise floor [nat] and looks, float32 (bins, columns), from codes (steps + 2 HALO, heads).

    The first and last HALO steps are context only.
    """
    steps = len(codes) - 2 * HALO
    blocks = -(-steps // BLOCK)
    padded = np.concatenate([codes, np.repeat(codes[-1:], blocks * BLOCK - steps, axis=0)])
    parts = [_block(architecture, arrays, padded[k * BLOCK : (k + 1) * BLOCK + 2 * HALO]) for k in range(blocks)]
    both = np.concatenate(parts, axis=2)[:, : architecture.bins, : steps * architecture.columns]
    profile = arrays["decoder.profile"][:, : architecture.bins, None]
    level, variance = both[0] * np.float32(NATS_PER_UNIT) + profile[0], both[1] + profile[1]
    of_variance, looks, bias = _gamma()
    mean = level + np.interp(variance, of_variance, bias)
    return mean.astype(np.float32), np.exp(np.interp(variance, of_variance, looks)).astype(np.float32)


@cache
def _gamma() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For gamma distributed powers: ln(variance of the level [nat^2]), ascending; ln(looks); and by how much the expected level
    lies below ln(mean power) [nat]. With M looks these are psi'(M) and ln M - psi(M)."""
    from scipy.special import digamma, polygamma

    looks = np.geomspace(MOST_LOOKS, LEAST_LOOKS, 400)
    return np.log(polygamma(1, looks)), np.log(looks), np.log(looks) - digamma(looks)


def _block(architecture: Architecture, arrays: Arrays, codes: np.ndarray) -> np.ndarray:
    """Outputs (2, padded bins, columns of BLOCK steps) of a block, from its codes and those around it."""
    book = arrays["codebook"]
    vectors = book[np.arange(architecture.heads), codes].reshape(len(codes), -1)
    maps = arrays["decoder.spread.weight"] @ vectors.T + arrays["decoder.spread.bias"][:, None]
    maps = maps.reshape(architecture.channels, architecture.rows, len(codes))
    for block in range(architecture.blocks):
        name = f"decoder.blocks.{block}"
        inner = _convolved(np.maximum(maps, 0), arrays[f"{name}.inner.weight"], arrays[f"{name}.inner.bias"])
        maps = maps + _convolved(np.maximum(inner, 0), arrays[f"{name}.outer.weight"], arrays[f"{name}.outer.bias"])
    stages = architecture.stages
    for index, (_, _, times) in enumerate(stages):
        maps = np.maximum(maps, 0)
        weight, bias = arrays[f"decoder.stages.{index}.weight"], arrays[f"decoder.stages.{index}.bias"]
        if index + 1 < len(stages):
            maps = np.repeat(maps, 2, axis=1)
            maps = _convolved(np.repeat(maps, 2, axis=2) if times == 2 else maps, weight, bias)
        else:
            maps = _convolved(maps, weight, bias)
            rows, columns = maps.shape[1:]
            maps = (
                maps.reshape(2, 2, times, rows, columns).transpose(0, 3, 1, 4, 2).reshape(2, 2 * rows, times * columns)
            )
    edge = HALO * architecture.columns
    return maps[:, :, edge : maps.shape[2] - edge]


def _convolved(maps: np.ndarray, weight: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """Convolution of maps (C, H, W) with kernels (D, C, h, w) of odd sizes, with zeros beyond the edges."""
    height, width = weight.shape[2:]
    rows, columns = maps.shape[1:]
    padded = np.pad(maps, ((0, 0), (height // 2,) * 2, (width // 2,) * 2))
    out = np.repeat(bias[:, None], rows * columns, axis=1)
    for i in range(height):
        for j in range(width):
            part = padded[:, i : i + rows, j : j + columns].reshape(len(maps), -1)
            out += np.ascontiguousarray(weight[:, :, i, j]) @ part
    return out.reshape(len(weight), rows, columns)


def prior_codes(architecture: Architecture, arrays: Arrays, steps: int, rng: np.random.Generator) -> np.ndarray:
    """Codes (steps, heads) drawn from the learned prior; the first ones do not depend on their number."""
    heads = range(architecture.heads)
    embedding, hidden_in = arrays["prior.embedding"], arrays["prior.gru.weight_hh_l0"]
    bias_in, bias_hidden = arrays["prior.gru.bias_ih_l0"], arrays["prior.gru.bias_hh_l0"]
    # What each code adds to the gates, (heads, codes, 3 hidden).
    gates_of = embedding @ arrays["prior.gru.weight_ih_l0"].T
    mixing, mixing_bias, among = arrays["prior.mixing"], arrays["prior.mixing_bias"], arrays["prior.among"]
    readout, readout_bias = arrays["prior.readout"], arrays["prior.readout_bias"]
    codes = np.empty((steps, architecture.heads), np.int64)
    state = np.zeros(architecture.hidden, np.float32)
    gate_inputs = arrays["prior.start"] @ arrays["prior.gru.weight_ih_l0"].T
    uniform = rng.random((steps, architecture.heads))
    for step in range(steps):
        state = _next_state(state, gate_inputs + bias_in, hidden_in @ state + bias_hidden)
        units = (mixing @ state).reshape(architecture.heads, -1) + mixing_bias
        gate_inputs = np.zeros_like(bias_in)
        for head in heads:
            logits = readout[head] @ np.maximum(units[head], 0) + readout_bias[head]
            code = _drawn(logits, uniform[step, head])
            codes[step, head] = code
            units = units + among[head, code]  # what it adds to the heads that follow; zero for the others
            gate_inputs = gate_inputs + gates_of[head, code]
    return codes


def uniform_codes(architecture: Architecture, steps: int, rng: np.random.Generator) -> np.ndarray:
    """Codes (steps, heads) drawn with equal probabilities, as the authors of Text2Doppler do."""
    return rng.integers(architecture.codes, size=(steps, architecture.heads))


def _next_state(state: np.ndarray, from_input: np.ndarray, from_state: np.ndarray) -> np.ndarray:
    """A step of a gated recurrent unit (Cho et al. 2014), with gates in the order reset, update, new."""
    size = len(state)
    reset, update = (
        _sigmoid(from_input[:size] + from_state[:size]),
        _sigmoid(from_input[size : 2 * size] + from_state[size : 2 * size]),
    )
    new = np.tanh(from_input[2 * size :] + reset * from_state[2 * size :])
    return np.asarray((1 - update) * new + update * state)


def _sigmoid(values: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 * (1 + np.tanh(0.5 * values)))


def _drawn(logits: np.ndarray, uniform: float) -> int:
    """Draws a code with the probabilities of these logits, from a uniform random number."""
    weights = np.exp((logits - logits.max()).astype(np.float64)).cumsum()
    return int(np.searchsorted(weights, uniform * weights[-1], side="right").clip(max=len(weights) - 1))
