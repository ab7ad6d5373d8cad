"""Receiver effects that act on a sample by itself, or with earlier samples of its chirp; one kernel, whose lanes are chirps of
antennas.

These are thermal noise, I/Q imbalance, 1/f noise, constants, quantisation and saturation, and sums for the levels of all these.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from t2d_rt.core.backend import Backend, flat_on_device, one_thread_at_a_time, select
from t2d_rt.noise.receiver.draws import Draws, complex_normal, hashed
from t2d_rt.noise.receiver.flicker import Filter
from t2d_rt.types.receiver import Adc, IqImbalance

Pair = tuple[Any, Any]
"""Real and imaginary part."""
BEGINNINGS = 1 << 30
"""First counter of the random numbers for the filter's state before a chirp; no chirp has so many samples."""


@dataclass(frozen=True, kw_only=True)
class Stages:
    """The effects that are switched on, from the antenna to the converters; None leaves one out."""

    draws: Draws
    thermal_w: float = 0.0
    """Thermal noise power of a complex sample [W]."""
    imbalance: IqImbalance | None = None
    flicker: Filter | None = None
    flicker_w: float = 0.0
    """Factor on the power of the 1/f filter's noise [W]."""
    adc: Adc | None = None


@dataclass(frozen=True, kw_only=True)
class Received:
    """Samples after the effects, and sums over the samples of each row and antenna."""

    samples: np.ndarray
    """Samples, complex64 (row, antenna, sample)."""
    clean_w: np.ndarray
    """Sum of |sample before - reference|^2 [W], float32 (row, antenna)."""
    added_w: np.ndarray
    """Sum of |sample after - sample before - constant|^2 [W], float32 (row, antenna)."""
    peak: np.ndarray
    """Greatest |I| or |Q| before the converters [sqrt(W)]."""
    clipped: np.ndarray
    """Number of samples that were clipped in I or Q."""
    input_w: np.ndarray
    """Sum of |sample before the converters - constant of the antenna|^2 [W]; 0 without converters."""
    lost: np.ndarray
    """Number of samples that are rounded to what the constant alone would give."""


@one_thread_at_a_time
def through(
    stages: Stages,
    first_row: int,
    clean: np.ndarray,
    changed: np.ndarray,
    constants: np.ndarray,
    offsets: np.ndarray,
    reference: np.ndarray,
) -> Received:
    """Applies the effects to samples (row, antenna, sample), complex64, of rows from `first_row` on; the bits of a row do not
    depend on the others.

    clean, changed: samples as they were, and after earlier effects; the same array where there are none.
    constants: added to every sample of a row and antenna in addition to `offsets`, complex64 (row, antenna).
    offsets: complex64 (antenna,), which the levels leave out.
    reference: samples close to `clean`, (antenna, sample), about which powers are summed.
    """
    import drjit as dr

    backend = select("cpu")  # on the CPU even if there is a GPU, for the same bits
    rows, antennas, count = clean.shape
    work = _Work(backend, stages, count)
    UInt32 = backend.UInt32
    lanes = dr.arange(UInt32, rows * antennas)
    antenna = lanes % dr.opaque(UInt32, antennas)
    inputs = [work.flat(samples) for samples in ([clean] if changed is clean else [clean, changed])]
    fixed = work.flat(reference)
    row_constants, antenna_offsets = (
        dr.gather(backend.arrays.Array2f, work.flat(a), i) for a, i in ((constants, lanes), (offsets, antenna))
    )
    place = lanes + dr.opaque(UInt32, first_row * antennas)
    out = dr.zeros(backend.Float32, 2 * clean.size)
    packets = dr.opaque(UInt32, count // work.size)

    def step(i: Any, state: list[Pair], sums: list[Any]) -> tuple[Any, list[Pair], list[Any]]:
        packet, sums = lanes * packets + i, list(sums)
        before, *after = (work.read(values, packet) for values in inputs)
        level = work.read(fixed, antenna * packets + i)
        parts: list[Any] = []
        for k in range(work.size):
            sample, state = work.stage(i * work.size + k, place, (after or [before])[0][k], state)
            sample = tuple(a + (b + c) for a, b, c in zip(sample, row_constants, antenna_offsets, strict=True))
            final = work.converted(sample, antenna_offsets, sums)
            parts += final
            sums[0] += _power(a - b for a, b in zip(before[k], level[k], strict=True))
            sums[1] += _power(a - b - c for a, b, c in zip(final, before[k], antenna_offsets, strict=True))
        dr.scatter(out, work.packet(*parts), packet)
        return i + 1, state, sums

    state = work.beginning(place)
    zeros = [dr.zeros(backend.Float32, rows * antennas) for _ in range(6)]
    _, _, sums = dr.while_loop(
        state=(dr.zeros(UInt32, rows * antennas), state, zeros),
        cond=lambda i, state, sums: i < packets,
        body=step,
        labels=("i", "state", "sums"),
        mode="symbolic",
    )
    dr.eval(out, sums)
    clean_w, added_w, peak, clipped, input_w, lost = (np.array(part.numpy()).reshape(rows, antennas) for part in sums)
    return Received(
        samples=np.asarray(out.numpy()).view(np.complex64).reshape(clean.shape),
        clean_w=clean_w,
        added_w=added_w,
        peak=peak,
        clipped=clipped,
        input_w=input_w,
        lost=lost,
    )


class _Work:
    """The effects as expressions in a kernel."""

    def __init__(self, backend: Backend, stages: Stages, count: int) -> None:
        import drjit as dr

        self.backend, self._stages = backend, stages
        self.size = 1 if count % 2 else 2
        """Number of samples that are read and written at once."""
        self.packet = (backend.arrays.Array2f, backend.arrays.Array4f)[self.size - 1]
        # Numbers are passed in arrays, as a number in the code would compile a new kernel.
        self._seeds = [dr.opaque(backend.UInt32, word) for word in stages.draws.words("samples")]
        self._thermal = self._opaque(math.sqrt(stages.thermal_w))
        if stages.imbalance is not None:
            direct, image = stages.imbalance.coefficients
            self._factors = [self._opaque(x) for x in (direct.real, direct.imag, image.real, image.imag)]
        if stages.flicker is not None:
            scale = math.sqrt(stages.flicker_w)
            self._poles = [self._opaque(pole) for pole in stages.flicker.poles]
            self._gains = [self._opaque(gain) for gain in scale * stages.flicker.gains]
            self._begin = [
                [self._opaque(x) for x in row[: k + 1]] for k, row in enumerate(scale * stages.flicker.begin)
            ]
        if stages.adc is not None:
            half = 2.0 ** (stages.adc.bits - 1)
            self._steps = [self._opaque(x) for x in (stages.adc.step, 1 / stages.adc.step, -half, half - 1)]

    def _opaque(self, value: float) -> Any:
        import drjit as dr

        return dr.opaque(self.backend.Float32, float(value))

    def flat(self, values: np.ndarray) -> Any:
        """Complex numbers as a flat array on the device."""
        return flat_on_device(values, self.backend.Float32)

    def read(self, values: Any, place: Any) -> list[Pair]:
        """Reads the samples of a packet."""
        import drjit as dr

        packet = dr.gather(self.packet, values, place)
        return [(packet[2 * k], packet[2 * k + 1]) for k in range(self.size)]

    def _drawn(self, sample: Any, place: Any) -> tuple[list[Any], list[Any]]:
        """Random words for two normal numbers."""
        words = hashed([sample, place, *self._seeds])
        return words[:2], words[2:]

    def beginning(self, place: Any) -> list[Pair]:
        """Random state of the 1/f filter before the first sample."""
        if self._stages.flicker is None:
            return []
        drawn = []
        for k in range(len(self._poles)):
            words = self._drawn(self.backend.UInt32(BEGINNINGS + k), place)[1]
            drawn.append(complex_normal(self.backend, *words))
        return [
            tuple(sum(weight * pair[part] for weight, pair in zip(row, drawn, strict=False)) for part in (0, 1))  # type: ignore[misc]
            for row in self._begin
        ]

    def stage(self, number: Any, place: Any, sample: Pair, state: list[Pair]) -> tuple[Pair, list[Pair]]:
        """A sample after thermal noise, I/Q imbalance and 1/f noise; and the state of the 1/f filter."""
        stages = self._stages
        real, imag = sample
        if stages.thermal_w > 0 or stages.flicker is not None:
            first, second = self._drawn(number, place)
        if stages.thermal_w > 0:
            noise = complex_normal(self.backend, *first)
            real, imag = real + self._thermal * noise[0], imag + self._thermal * noise[1]
        if stages.imbalance is not None:
            a, b, c, d = self._factors
            real, imag = (a + c) * real + (d - b) * imag, (b + d) * real + (a - c) * imag
        if stages.flicker is not None:
            noise = complex_normal(self.backend, *second)
            state = [
                (pole * pair[0] + gain * noise[0], pole * pair[1] + gain * noise[1])
                for pole, gain, pair in zip(self._poles, self._gains, state, strict=True)
            ]
            real, imag = real + sum(pair[0] for pair in state), imag + sum(pair[1] for pair in state)
        return (real, imag), state

    def converted(self, sample: Pair, constant: Pair, sums: list[Any]) -> Pair:
        """A sample after the converters. Adds to the sums its peak, its power about the constant, and whether it is clipped or
        lost.

        A full-scale tone has 6.02 bits + 1.76 dB over the quantisation noise of each channel (eq. 38).
        """
        import drjit as dr

        if self._stages.adc is None:
            return sample
        step, per_step, lowest, highest = self._steps
        sums[2] = dr.maximum(sums[2], dr.maximum(abs(sample[0]), abs(sample[1])))
        codes, alone = ([dr.round(part * per_step) for part in pair] for pair in (sample, constant))
        inside = [dr.clip(code, lowest, highest) for code in codes]
        clipped = (codes[0] != inside[0]) | (codes[1] != inside[1])
        lost = (codes[0] == alone[0]) & (codes[1] == alone[1])
        one, none = self.backend.Float32(1), self.backend.Float32(0)
        sums[3] += dr.select(clipped, one, none)
        sums[4] += _power(a - b for a, b in zip(sample, constant, strict=True))
        sums[5] += dr.select(lost, one, none)
        return inside[0] * step + 0.0, inside[1] * step + 0.0  # avoids -0


def _power(parts: Any) -> Any:
    """Power of a complex number: the sum of the squares of its parts."""
    return sum(part * part for part in parts)
