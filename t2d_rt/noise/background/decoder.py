"""From codes to the mean and the looks of every cell; the same network as `training.networks.Decoder`, without torch."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np

from t2d_rt.noise.background.architecture import HALO, Architecture

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
