"""The networks of a background, without torch: sizes, codes drawn step by step, and from codes to mean and looks of every cell.

`training.Decoder` and `training.Prior` are the same networks as they are trained.
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
"""Rows of the coarsest maps, at least: fewer would not tell an approaching from a receding interferer."""
HALO = 3
"""Steps on either side that the decoder's convolutions reach over, for 2 residual blocks and any stages."""


Size = Annotated[Count, Field(ge=1, le=4096)]
"""What exceeds it was damaged."""


class Architecture(Fields):
    """Code books of `codes` entries for the `heads` parts of a latent vector, one vector for each step of `columns` columns."""

    noun: ClassVar[str] = "architecture"

    bins: Size
    """Doppler bins of the spectrograms."""
    time_halvings: Size = 3
    """A step is 2^time_halvings columns."""
    heads: Size = 4
    """Codes in a step, each of its own code book."""
    codes: Size = 32
    """Entries of each code book."""
    code_size: Size = 16
    """Numbers in an entry."""
    channels: Size = 64
    """Channels of the coarsest maps."""
    residual: Size = 32
    """Channels in the middle of a residual block (van den Oord et al. 2017)."""
    blocks: Annotated[Size, Field(le=2)] = 2
    """Residual blocks."""
    hidden: Size = 192
    """State of the prior over time."""
    mixed: Size = 64
    """Units of the prior within a step."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Refuses columns that are halved more often than Doppler bins: the stages halve both together."""
        if self.time_halvings > self.doppler_halvings:
            raise InputError(
                f"{self.bins} Doppler bins are halved {self.doppler_halvings} times and columns {self.time_halvings} times; "
                "take fewer time_halvings"
            )
        return self

    @property
    def columns(self) -> int:
        """Columns of the spectrogram in a step."""
        return int(2**self.time_halvings)

    @property
    def doppler_halvings(self) -> int:
        """Number of times that Doppler bins are halved."""
        return max(1, int(math.log2(max(2, self.bins / KEPT_ROWS))))

    @property
    def rows(self) -> int:
        """Doppler rows of the coarsest maps; bins are padded to rows times 2^doppler_halvings."""
        return int(-(-self.bins // 2**self.doppler_halvings))

    @property
    def padded_bins(self) -> int:
        """Bins with those that are padded."""
        return int(self.rows * 2**self.doppler_halvings)

    @property
    def latent(self) -> int:
        """Numbers of a latent vector."""
        return self.heads * self.code_size

    @property
    def stages(self) -> list[tuple[int, int, int]]:
        """Doublings from the coarsest maps to the spectrogram: channels in, channels out, and the factor in time (1 or 2).

        The last one leads to 2 x 2 (or 2 x 1) cells of two channels each, mean and looks."""
        count = self.doppler_halvings
        times = [1] * (count - self.time_halvings) + [2] * self.time_halvings
        sizes = [max(16, round(self.channels / 16 / (1 + 0.5 * stage)) * 16) for stage in range(count)]
        outs = [*sizes[1:], 2 * 2 * times[-1]]
        return list(zip(sizes, outs, times, strict=True))


Arrays = Mapping[str, np.ndarray]
BLOCK = 16
"""Steps that are decoded at once. Blocks are all of one size, so that the start of a long record has the bits of a short one."""
NATS_PER_UNIT = 2.0
"""The network's outputs are of the order of one: the level is in units of 2 nats (8.7 dB) about the mean profile."""
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
    """Of gamma distributed powers, ln(variance) of the level [nat^2], ascending; ln(looks); how far the level's expectation lies
    below ln(mean power) [nat]: with M looks, psi'(M) and ln M - psi(M)."""
    from scipy.special import digamma, polygamma

    looks = np.geomspace(MOST_LOOKS, LEAST_LOOKS, 400)
    return np.log(polygamma(1, looks)), np.log(looks), np.log(looks) - digamma(looks)


def _block(architecture: Architecture, arrays: Arrays, codes: np.ndarray) -> np.ndarray:
    """Outputs (2, padded bins, columns of BLOCK steps) of a block with its context."""
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
    """Maps (C, H, W) convolved with kernels (D, C, h, w) of odd sizes, zeros beyond the edges."""
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
    """Codes (steps, heads) of the learned prior; the first ones do not depend on how many there are."""
    heads = range(architecture.heads)
    embedding, hidden_in = arrays["prior.embedding"], arrays["prior.gru.weight_hh_l0"]
    bias_in, bias_hidden = arrays["prior.gru.bias_ih_l0"], arrays["prior.gru.bias_hh_l0"]
    # What a code adds to the gates, (heads, codes, 3 hidden).
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
            units = units + among[head, code]  # to the heads that follow; zero for the others
            gate_inputs = gate_inputs + gates_of[head, code]
    return codes


def uniform_codes(architecture: Architecture, steps: int, rng: np.random.Generator) -> np.ndarray:
    """Codes (steps, heads) that are all equally likely, as the authors of Text2Doppler draw them."""
    return rng.integers(architecture.codes, size=(steps, architecture.heads))


def _next_state(state: np.ndarray, from_input: np.ndarray, from_state: np.ndarray) -> np.ndarray:
    """A gated recurrent unit (Cho et al. 2014), gates in the order reset, update, new."""
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
    """The code in which a uniform number falls."""
    weights = np.exp((logits - logits.max()).astype(np.float64)).cumsum()
    return int(np.searchsorted(weights, uniform * weights[-1], side="right").clip(max=len(weights) - 1))
