"""Autocorrelation of each chirp's samples at a few lags, which bounds what its spectrum can hold."""

from __future__ import annotations

from typing import Any

import numpy as np

from t2d_rt.core.backend import flat_on_device, one_thread_at_a_time, select

Pair = tuple[Any, Any]


@one_thread_at_a_time
def lags(samples: np.ndarray, greatest: int) -> np.ndarray:
    """Circular autocorrelation of samples (row, antenna, sample) along each row, the sum of s[n + m] conj(s[n]) over n.

    Its real part at lag 0, real and imaginary part at lag 1, and so on up to the greatest: float32 (row, antenna, part).
    """
    import drjit as dr

    backend = select("cpu")
    Float32, UInt32 = backend.Float32, backend.UInt32
    rows, antennas, count = samples.shape
    size = 1 if count % 2 else 2  # samples that are read at once
    Packet = (backend.arrays.Array2f, backend.arrays.Array4f)[size - 1]
    flat = flat_on_device(samples, Float32)
    lanes, packets = dr.arange(UInt32, rows * antennas), dr.opaque(UInt32, count // size)

    def read(packet: Any) -> list[Pair]:
        found = dr.gather(Packet, flat, lanes * packets + packet)
        return [(found[2 * k], found[2 * k + 1]) for k in range(size)]

    def step(n: Any, before: list[Pair], sums: list[Any]) -> tuple[Any, list[Pair], list[Any]]:
        for real, imag in read(n):
            new = [sums[0] + (real * real + imag * imag)]
            for lag, (a, b) in enumerate(before, start=1):
                new += [sums[2 * lag - 1] + (real * a + imag * b), sums[2 * lag] + (imag * a - real * b)]
            before, sums = [(real, imag), *before[:-1]], new
        return n + 1, before, sums

    width = rows * antennas
    before = [read((packets * size - lag) // size)[(count - lag) % size] for lag in range(1, greatest + 1)]
    zeros = [dr.zeros(Float32, width) for _ in range(2 * greatest + 1)]
    _, _, sums = dr.while_loop(
        state=(dr.zeros(UInt32, width), before, zeros), cond=lambda n, before, sums: n < packets, body=step,
        labels=("n", "before", "sums"), mode="symbolic",
    )  # fmt: skip
    dr.eval(sums)
    return np.stack([each.numpy() for each in sums], axis=1).reshape(rows, antennas, -1)
