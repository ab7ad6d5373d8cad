"""Detection at a constant rate of false alarms (docs/physics.md, eq. 20)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from t2d_rt.core.checks import array, choice, integer, number, numeric, shown
from t2d_rt.core.errors import InputError
from t2d_rt.signal.range import taper

RANK = 0.75
"""Which of the ordered training cells OS-CFAR takes, as a fraction of their number."""
MOST_LOOKS, MOST_CELLS = 100_000, 2_000
"""Antennas and training cells that a threshold is computed for."""


def cfar(
    power: np.ndarray,
    false_alarm_rate: float,
    *,
    looks: int = 1,
    method: str = "ca",
    guard_cells: tuple[int, int] = (0, 4),
    training_cells: tuple[int, int] = (0, 12),
    windows: tuple[str, str] = ("hann", "hann"),
) -> tuple[np.ndarray, np.ndarray, float]:
    """Noise level and threshold of every cell of a map (velocity, range).

    Returns the noise power, (velocity, range), the detections `power > factor * noise`, likewise, and the factor.

    power: mean (or sum) over `looks` antennas of |spectrum|^2.
    false_alarm_rate: fraction of the cells with nothing but noise that are detected.
    method: "ca", the mean of the training cells, or "os", their 75 % order statistic, which other targets among them
        disturb less.
    guard_cells, training_cells: along velocity and range, on either side of the cell. Both axes are circular, as those
        of an FFT are. By default along range alone: a body fills many Doppler cells and would mask itself.
    windows: the tapers of both axes; they correlate neighbours, which then count as fewer cells.
    """
    false_alarm_rate = check_rate(false_alarm_rate)
    choice("method of the CFAR", method, ("ca", "os"))
    power = array("power", power, ("velocity", "range"))
    if power.size and power.min() < 0:
        raise InputError(f"power must be 0 or more, got {power.min():.4g}; give |spectrum|^2, not dB")
    looks = integer("looks", looks, 1, MOST_LOOKS)
    offsets = _offsets(power.shape, guard_cells, training_cells)
    correlation = _correlation(offsets, power.shape, windows)
    factor = cfar_factor(false_alarm_rate, correlation, looks=looks, method=method)
    if method == "ca":
        noise = np.zeros(power.shape)
        for offset in offsets:
            noise += np.roll(power, offset, axis=(0, 1)) / len(offsets)
    else:
        from scipy.special import gammaincinv

        training = np.stack([np.roll(power, offset, axis=(0, 1)) for offset in offsets], axis=-1)
        rank = round(RANK * len(offsets))
        ordered = np.partition(training, rank - 1, axis=-1)[..., rank - 1]
        noise = ordered * (looks / gammaincinv(looks, RANK))  # from the quantile to the mean
    return noise, power > factor * noise, factor


def cfar_factor(false_alarm_rate: float, cells: int | np.ndarray, *, looks: int = 1, method: str = "ca") -> float:
    """Threshold over the noise level, estimated from training cells that are sums of `looks` exponential powers (eq. 20).

    `cells` is their number, or the correlation matrix of their amplitudes, complex (cell, cell). Exact with "ca", with
    "os" for cells that are not correlated; else that gives fewer alarms than asked, with Hann windows 0.6 to 0.9.
    """
    from scipy.optimize import brentq

    false_alarm_rate = check_rate(false_alarm_rate)
    choice("method of the CFAR", method, ("ca", "os"))
    looks = integer("looks", looks, 1, MOST_LOOKS)
    correlation = _checked_correlation(cells)
    log_rate = _ca_log_rate(correlation, looks) if method == "ca" else _os_log_rate(correlation, looks)
    try:
        log_factor = brentq(lambda x: log_rate(math.exp(x)) - math.log(false_alarm_rate), -10, 15, xtol=1e-10)
    except ValueError:
        raise InputError(
            f"no threshold gives a false_alarm_rate of {false_alarm_rate:g} from {len(correlation)} training cells; take more "
            "cells or a higher rate"
        ) from None
    return math.exp(log_factor)


def _checked_correlation(cells: int | np.ndarray) -> np.ndarray:
    """Correlation matrix of the training cells; of a number of them, that of independent ones."""
    if np.ndim(numeric("cells", cells)) == 0:
        return np.eye(
            integer("cells", cells, 1, MOST_CELLS, hint="a number of training cells, or their correlation matrix")
        )
    found = numeric("cells", cells)
    fits = found.ndim == 2 and len(found) == len(found.T) >= 2 and np.isfinite(found).all()
    if not (fits and np.allclose(found, found.conj().T, atol=1e-6) and np.allclose(np.diagonal(found), 1, atol=1e-6)):
        raise InputError(
            f"cells must be a number of training cells, or their correlation matrix (cell, cell), Hermitian with ones on its "
            f"diagonal, got {shown(cells)}"
        )
    return found


def _ca_log_rate(correlation: np.ndarray, looks: int) -> Callable[[float], float]:
    """Logarithm of the rate of false alarms by the factor on the mean of the training cells."""
    eigenvalues = np.linalg.eigvalsh(correlation) / len(correlation)
    eigenvalues = eigenvalues[eigenvalues > 1e-12]

    def log_rate(factor: float) -> float:
        scaled = factor * eigenvalues
        sums = np.sum((scaled / (1 + scaled)) ** np.arange(1, looks + 1)[:, None], axis=1)
        terms, log_unit = np.ones(looks), -looks * float(np.log1p(scaled).sum())
        for j in range(1, looks):
            terms[j] = looks / j * float(sums[:j] @ terms[j - 1 :: -1])
            if terms[j] > 1e200:  # many looks: keep within the numbers there are
                log_unit += math.log(terms[j])
                terms /= terms[j]
        return math.log(float(terms.sum())) + log_unit

    return log_rate


def _os_log_rate(correlation: np.ndarray, looks: int) -> Callable[[float], float]:
    """The same by the factor on the noise level from the order statistic."""
    from scipy.special import gammaincc, gammaincinv, roots_legendre
    from scipy.stats import beta

    # An order statistic counts the cells above a level: Sheppard's correlation of signs.
    alike = 2 / np.pi * np.arcsin(np.minimum(np.abs(correlation) ** 2, 1))
    cells = len(correlation) ** 2 / float(alike.sum())
    rank = RANK * cells
    nodes, weights = roots_legendre(400)
    quantile = (nodes + 1) / 2
    weights = weights / 2 * beta.pdf(quantile, rank, cells - rank + 1)
    estimate = gammaincinv(looks, quantile) / gammaincinv(looks, RANK) * looks
    return lambda factor: math.log(max(float(weights @ gammaincc(looks, factor * estimate)), 1e-300))


def check_rate(false_alarm_rate: float) -> float:
    """Refuses what is no false-alarm rate, and rates for which no threshold can be computed."""
    return number("false_alarm_rate", false_alarm_rate, 1e-12, 0.5, hint="1e-4 is usual")


def _offsets(
    shape: tuple[int, ...], guard_cells: tuple[int, int], training_cells: tuple[int, int]
) -> list[tuple[int, int]]:
    """Steps from the cell to its training cells: a cross."""
    offsets = []
    pairs = (("guard_cells", guard_cells), ("training_cells", training_cells))
    for name, pair in pairs:
        if not isinstance(pair, (list, tuple)) or len(pair) != 2:
            raise InputError(f"{name} must be two integers, along velocity and range, got {shown(pair)}")
    counts = [[integer(name, each, -MOST_CELLS, MOST_CELLS) for each in pair] for name, pair in pairs]
    for axis, (guard, training) in enumerate(zip(*counts, strict=True)):
        if guard < 0 or training < 0 or (training and 2 * (guard + training) + 1 > shape[axis]):
            raise InputError(
                f"{guard} guard and {training} training cells on either side do not fit into {shape[axis]} cells of "
                f"{('velocity', 'range')[axis]}; take fewer"
            )
        for step in range(guard + 1, guard + training + 1):
            for signed in (-step, step):
                offsets.append((signed, 0) if axis == 0 else (0, signed))
    if len(offsets) > MOST_CELLS:
        raise InputError(
            f"a CFAR takes up to {MOST_CELLS} training cells, got {len(offsets)}; take fewer training_cells"
        )
    if len(offsets) < 4:
        raise InputError(f"a CFAR needs training cells, got {training_cells} on either side; (0, 12) is usual")
    return offsets


def _correlation(offsets: list[tuple[int, int]], shape: tuple[int, ...], windows: tuple[str, str]) -> np.ndarray:
    """Correlation of the amplitudes of white noise in the training cells, complex (cell, cell): that of windowed FFTs."""
    correlation = np.ones((len(offsets), len(offsets)), complex)
    steps = np.array(offsets)
    if not isinstance(windows, (list, tuple)) or len(windows) != 2:
        raise InputError(f"windows must be two names, along velocity and range, got {shown(windows)}")
    for axis, window in enumerate(windows):
        power = taper(window, shape[axis], periodic=axis == 0) ** 2
        between = np.fft.fft(power) / power.sum()
        correlation *= between[np.subtract.outer(steps[:, axis], steps[:, axis]) % shape[axis]]
    return correlation
