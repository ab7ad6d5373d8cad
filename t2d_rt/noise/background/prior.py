"""Codes drawn step by step: a recurrent state over time, and within a step each code given the ones before it.

The same network as `training.networks.Prior`, without torch.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from t2d_rt.noise.background.architecture import Architecture

Arrays = Mapping[str, np.ndarray]


def prior_codes(architecture: Architecture, arrays: Arrays, steps: int, rng: np.random.Generator) -> np.ndarray:
    """Codes (steps, heads) of the learned prior; the first ones do not depend on how many there are."""
    heads = range(architecture.heads)
    embedding, hidden_in = arrays["prior.embedding"], arrays["prior.gru.weight_hh_l0"]
    bias_in, bias_hidden = arrays["prior.gru.bias_ih_l0"], arrays["prior.gru.bias_hh_l0"]
    # What a code adds to the gates, (heads, codes, 3 hidden).
    gates_of = embedding @ arrays["prior.gru.weight_ih_l0"].T
    mixing, mixing_bias, among = arrays["prior.mixing"], arrays["prior.mixing_bias"], arrays["prior.among"]
    readout, readout_bias = arrays["prior.readout"], arrays["prior.readout_bias"]
    found = np.empty((steps, architecture.heads), np.int64)
    state = np.zeros(architecture.hidden, np.float32)
    given = arrays["prior.start"] @ arrays["prior.gru.weight_ih_l0"].T
    uniform = rng.random((steps, architecture.heads))
    for step in range(steps):
        state = _next_state(state, given + bias_in, hidden_in @ state + bias_hidden)
        units = (mixing @ state).reshape(architecture.heads, -1) + mixing_bias
        given = np.zeros_like(bias_in)
        for head in heads:
            logits = readout[head] @ np.maximum(units[head], 0) + readout_bias[head]
            code = _drawn(logits, uniform[step, head])
            found[step, head] = code
            units = units + among[head, code]  # to the heads that follow; zero for the others
            given = given + gates_of[head, code]
    return found


def uniform_codes(architecture: Architecture, steps: int, rng: np.random.Generator) -> np.ndarray:
    """Codes (steps, heads) that are all equally likely, as the authors of Text2Doppler draw them."""
    return rng.integers(architecture.codes, size=(steps, architecture.heads))


def _next_state(state: np.ndarray, given: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """A gated recurrent unit (Cho et al. 2014), gates in the order reset, update, new."""
    size = len(state)
    reset, update = _sigmoid(given[:size] + kept[:size]), _sigmoid(given[size : 2 * size] + kept[size : 2 * size])
    new = np.tanh(given[2 * size :] + reset * kept[2 * size :])
    return np.asarray((1 - update) * new + update * state)


def _sigmoid(values: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 * (1 + np.tanh(0.5 * values)))


def _drawn(logits: np.ndarray, uniform: float) -> int:
    """The code in which a uniform number falls."""
    weights = np.exp((logits - logits.max()).astype(np.float64)).cumsum()
    return int(np.searchsorted(weights, uniform * weights[-1], side="right").clip(max=len(weights) - 1))
