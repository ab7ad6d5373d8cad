"""The integral of exp(j phase) over a curved facet, to first or second order in its bubbles (docs/physics.md, eq. 5).

A facet has the phases p_i [rad] and amplitudes a_i at its corners and a bubble q_ij [rad] on each edge: four times what the phase
at the edge's midpoint exceeds the mean of the edge's ends by. With l the barycentric coordinates

    I = integral of a exp(j (p + b)) over the unit simplex,   a = sum a_i l_i,   p = sum p_i l_i,
    b = q01 l0 l1 + q12 l1 l2 + q20 l2 l0

exp(j (b - c)) is expanded to first or second order, c a constant near the mean of b. No difference of phases is divided by
without being bounded: the line of the middle phase cuts the facet into two triangles that have a corner and this line for a
side. In each the phase depends on the distance t from the corner alone; along the line everything is a polynomial, which Gauss's
rule integrates exactly, and what remains are integrals of t^k exp(j d t) over 0..1, from recurrences that are stable.

The functions are written once for NumPy (float32, float64) and Dr.Jit arrays; real and imaginary parts are kept apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from t2d_rt.checks import choice
from t2d_rt.scattering.phase_integral import NUMPY_OPS, SERIES_TERMS, Ops, Parts, exponential, power_moment, times

Order = Literal[1, 2]

# Phase differences from which moments are computed from the first to the last, which loses k!/d^k; below, from the last to the
# first, which starts with a series of SERIES_TERMS.
SWITCH_RAD = {1: 2.0, 2: 3.0}

# Constant about which exp(j b) is expanded, over the sum of the bubbles. For first order the mean of b over the triangle; for
# second order a little less, where the mean of the third power, which is left out, vanishes for equal bubbles.
CENTRE = {1: 1 / 12, 2: 1 / 13.2}

TINY = 1e-30
"""Added to the widest phase difference, so that equal phases divide a facet as well: all of it into the upper part."""


class Node(NamedTuple):
    """Corner of a facet."""

    phase: Any
    amplitude: Any
    opposite: Any
    """Bubble of the edge between the other two."""


class Averages(NamedTuple):
    """Of powers of v in 0..1 and of the bubble phase beta, along the line of the middle phase, with some weight."""

    one: Any
    v: Any
    v_v: Any
    beta: Any
    v_beta: Any
    beta_beta: Any


class Line(NamedTuple):
    """The line of the middle phase."""

    exponential: Parts
    plain: Averages
    weighted: Averages
    """With the amplitude."""
    centre: Any
    """The constant c."""


def curved_integral(phases: Any, amplitudes: Any, bubbles: Any, order: Order = 2) -> np.ndarray:
    """I for phases [rad] and amplitudes of corners 0, 1, 2 and bubbles [rad] of edges 01, 12, 20, three of any equal shape each.

    Complex of the arguments' precision: float32 ones give a float32 computation. For amplitude 1 and no bubbles it is
    `phase_integral.divided_difference`.
    """
    choice("order", str(order), ("1", "2"))
    dtype = np.result_type(*phases, *amplitudes, *bubbles, np.float32)
    given = ([np.asarray(x, dtype) for x in values] for values in (phases, amplitudes, bubbles))
    (real, imag), _ = curved_integrals(*given, ops=NUMPY_OPS, terms=SERIES_TERMS[dtype.itemsize], order=order)
    return real + 1j * imag


def curved_integrals(
    phases: Sequence[Any], amplitudes: Sequence[Any], bubbles: Sequence[Any], *, ops: Ops, terms: int, order: Order
) -> tuple[Parts, Parts]:
    """I and dI: (re, im) of the integral and of the derivative d/ds of s I(s p, s q) at s = 1, that of the expansion itself.

    With x = b - c the expansion is T = 1 + jx - x^2/2, and d/ds of T(s x) is jx - x^2, so that dI is the integral of
    a exp(j (p + c)) [(1 + j (p + c)) T + jx - x^2]. First order leaves out the squares.
    """
    opposites = bubbles[1], bubbles[2], bubbles[0]
    low, mid, high = _sorted_by_phase([Node(*node) for node in zip(phases, amplitudes, opposites, strict=True)], ops)
    centre = (bubbles[0] + bubbles[1] + bubbles[2]) * CENTRE[order]
    below, above = mid.phase - low.phase, high.phase - mid.phase
    inverse = 1 / (high.phase - low.phase + TINY)
    lower, upper = below * inverse, (above + TINY) * inverse  # the parts' areas; they add up to 1

    # The line of the middle phase leads from corner mid to the point with barycentric coordinates (upper, 0, lower).
    end_amplitude = upper * low.amplitude + lower * high.amplitude
    end_bubble = lower * upper * mid.opposite
    rise = upper * high.opposite + lower * low.opposite
    places, weights = _gauss_rule(order + 1)
    beta = [v * (rise + v * (end_bubble - rise)) for v in places]
    weighted = [w * (mid.amplitude + v * (end_amplitude - mid.amplitude)) for v, w in zip(places, weights, strict=True)]
    line = Line(
        exponential=exponential(mid.phase, ops),
        plain=_averages(places, weights, beta),
        weighted=_averages(places, weighted, beta),
        centre=centre,
    )
    first = _part(low, below, (high.opposite, lower * mid.opposite), line, ops, terms, order)
    last = _part(high, -above, (low.opposite, upper * mid.opposite), line, ops, terms, order)
    real, imag, d_real, d_imag = (lower * x + upper * y for x, y in zip(first, last, strict=True))
    end = times(line.exponential, _at_line(line, order))
    turn = exponential(centre, ops)
    return (
        times(turn, (real, imag)),
        times(turn, (d_real + end[0] - centre * imag, d_imag + end[1] + centre * real)),
    )


def _sorted_by_phase(nodes: list[Node], ops: Ops) -> list[Node]:
    """Corners in order of phase, each with what belongs to it."""
    nodes = list(nodes)
    for i in (0, 1, 0):
        swap = nodes[i].phase > nodes[i + 1].phase
        pairs = list(zip(nodes[i], nodes[i + 1], strict=True))
        nodes[i] = Node(*(ops.where(swap, y, x) for x, y in pairs))
        nodes[i + 1] = Node(*(ops.where(swap, x, y) for x, y in pairs))
    return nodes


def _gauss_rule(points: int) -> tuple[list[float], list[float]]:
    """Places in 0..1 and weights of the Gauss-Legendre rule, exact to degree 2 points - 1."""
    places, weights = np.polynomial.legendre.leggauss(points)
    return ((1 + places) / 2).tolist(), (weights / 2).tolist()


def _averages(places: list[float], weights: list[Any], beta: list[Any]) -> Averages:
    def average(*factors: list[Any]) -> Any:
        return sum(w * math.prod(x) for w, *x in zip(weights, *factors, strict=True))

    return Averages(
        average(), average(places), average(places, places), average(beta), average(places, beta), average(beta, beta)
    )


def _part(
    corner: Node, difference: Any, bubbles: tuple[Any, Any], line: Line, ops: Ops, terms: int, order: Order
) -> tuple[Any, Any, Any, Any]:
    """What the triangle between a corner and the line adds for each unit of its area to re and im of I and dI.

    The amplitude falls from that of the corner, t = 0, to that of the line, t = 1; the bubble phase is alpha t (1-t) + beta t^2
    with alpha = (1-v) first + v second of `bubbles`. dI is integrated by parts over t, where it has t d/dt of the polynomial
    in place of the phase t d; what is left at the line is `_at_line`.
    """
    both = (_expansion(averages, bubbles, line.centre, order) for averages in (line.plain, line.weighted))
    real, imag = (_blend(corner.amplitude, *ends) for ends in zip(*both, strict=True))
    moments = _moments(exponential(corner.phase, ops), line.exponential, difference, ops, terms, order)
    value = _sum_of_products(real, imag, moments)
    d_real = [(1 - k) * x for k, x in enumerate(real)]
    d_real[0] = d_real[0] - 2 * corner.amplitude
    d_real[1] = d_real[1] - 2 * (line.weighted.one - corner.amplitude)
    d_value = _sum_of_products(d_real, [-k * x for k, x in enumerate(imag)], moments)
    return *value, d_value[0] - corner.phase * value[1], d_value[1] + corner.phase * value[0]


def _expansion(averages: Averages, bubbles: tuple[Any, Any], centre: Any, order: Order) -> tuple[list[Any], list[Any]]:
    """Coefficients of t^0, t^1, ... in the average of T along the line, real and imaginary.

    T = (1 - c^2/2 - jc) + (c + j) b - b^2/2 at b = alpha t + (beta - alpha) t^2; to first order (1 - jc) + jb.
    """
    start, rise = bubbles[0], bubbles[1] - bubbles[0]
    alpha = start * averages.one + rise * averages.v
    bend = averages.beta - alpha
    imag = [-centre * averages.one, alpha, bend]
    if order == 1:
        return [averages.one], imag
    alpha_alpha = start * alpha + rise * (start * averages.v + rise * averages.v_v)
    alpha_bend = start * averages.beta + rise * averages.v_beta - alpha_alpha
    bend_bend = averages.beta_beta - alpha_alpha - 2 * alpha_bend
    real = [
        averages.one * (1 - centre * centre * 0.5),
        centre * alpha,
        centre * bend - 0.5 * alpha_alpha,
        -alpha_bend,
        -0.5 * bend_bend,
    ]
    return real, imag


def _at_line(line: Line, order: Order) -> Parts:
    """Average of a T along the line."""
    one, beta, beta_beta = line.weighted.one, line.weighted.beta, line.weighted.beta_beta
    imag = beta - line.centre * one
    if order == 1:
        return one, imag
    return one + line.centre * (beta - 0.5 * line.centre * one) - 0.5 * beta_beta, imag


def _blend(corner: Any, plain: list[Any], weighted: list[Any]) -> list[Any]:
    """Coefficients of corner (1-t) plain(t) + t weighted(t)."""
    scaled = [corner * x for x in plain]
    steps = [y - x for x, y in zip(scaled, weighted, strict=True)]
    return [scaled[0], *(x + y for x, y in zip(scaled[1:], steps, strict=False)), steps[-1]]


def _moments(exp_corner: Parts, exp_line: Parts, d: Any, ops: Ops, terms: int, order: Order) -> list[Parts]:
    """Integrals of t^k exp(j (p + d t)) over t in 0..1, k = 1 to 2 order + 2, from exp(jp) and exp(j (p + d)).

    By parts j d M_k = exp(j (p + d)) - k M_{k-1}, upwards where |d| is large, else downwards.
    """
    last = 2 * order + 2
    small = abs(d) < SWITCH_RAD[order]
    inverse = 1 / ops.where(small, d * 0 + 1, d)
    up = [((exp_line[1] - exp_corner[1]) * inverse, (exp_corner[0] - exp_line[0]) * inverse)]
    for k in range(1, last + 1):
        real, imag = up[-1]
        up.append(((exp_line[1] - k * imag) * inverse, (k * real - exp_line[0]) * inverse))
    d = ops.where(small, d, d * 0)
    down = [times(exp_line, power_moment(-d, last, terms))]
    for k in range(last, 1, -1):
        real, imag = down[-1]
        down.append(((exp_line[0] + d * imag) * (1 / k), (exp_line[1] - d * real) * (1 / k)))
    return [
        (ops.where(small, x[0], y[0]), ops.where(small, x[1], y[1])) for x, y in zip(down[::-1], up[1:], strict=True)
    ]


def _sum_of_products(real: list[Any], imag: list[Any], moments: list[Parts]) -> Parts:
    """Sum of (real_k + j imag_k) moment_k; fewer coefficients than moments have the first of them."""
    return (
        sum(x * m[0] for x, m in zip(real, moments, strict=False))
        - sum(x * m[1] for x, m in zip(imag, moments, strict=False)),
        sum(x * m[1] for x, m in zip(real, moments, strict=False))
        + sum(x * m[0] for x, m in zip(imag, moments, strict=False)),
    )
