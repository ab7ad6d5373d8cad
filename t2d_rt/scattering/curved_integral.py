"""The integral of exp(j phase) over a curved facet, expanded in its bubbles (docs/physics.md, eq. 30).

A facet has the phases p_i [rad] and amplitudes a_i at its corners and a bubble q_ij [rad] on each edge: four times what the phase
at the edge's midpoint exceeds the mean of the edge's ends by. With l the barycentric coordinates

    I = integral of a exp(j (p + b)) over the unit simplex,   a = sum a_i l_i,   p = sum p_i l_i,
    b = q01 l0 l1 + q12 l1 l2 + q20 l2 l0

exp(jb) = exp(jc) exp(jx) with x = b - c, c a constant near the mean of b, is expanded in x to second order, or to first order
with the second-order term replaced by its mean over the triangle. That costs much less, and is nearly as good where the phases
of the corners differ by a few rad at most; such facets return most of a body's power. The table gives the error of I relative to
(a0 + a1 + a2)/6, divided by the widest difference of the p_i where that exceeds 1 rad. It is the root mean square over random a_i
in 0..1, random p_i of standard deviation 3 rad and random q_ij of one sign, by the greatest |b| on the facet:

    greatest |b| [rad]      0.25      0.5       1         2
    constant only           0.13      0.25      0.51      0.99
    first order             0.0023    0.0090    0.036     0.15
    second order            0.00014   0.0011    0.0090    0.071

The line of the middle phase cuts the facet into two triangles, each with a corner and this line for a side. In each the phase
depends on the distance t from the corner alone. Along the line everything is a polynomial, which Gauss's rule integrates
exactly; what remains are integrals of t^k exp(j d t) over 0..1 by stable recurrences. So nothing is lost where phases coincide.

The functions are written once for NumPy (float32, float64) and Dr.Jit arrays; real and imaginary parts are kept apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from t2d_rt.core.checks import check_shape, integer, numeric
from t2d_rt.scattering.phase_integral import (
    NUMPY_OPS,
    SERIES_TERMS,
    Ops,
    Parts,
    divided_differences,
    exponential,
    power_integral,
    times,
)

Order = Literal[1, 2]

# By the order, the phase difference from which the recurrence of the integrals runs upwards, which loses k!/d^k of precision; below
# it, the recurrence runs downwards from a series of SERIES_TERMS terms.
SWITCH_RAD = {1: 2.0, 2: 3.0}

EXPANSION_ORDER: Order = 2
"""Order to which curved facets' bulges are expanded (docs/physics.md, eq. 30)."""

CENTRE = 1 / 13
"""The constant c over the sum of the bubbles: a little less than the mean of b, 1/12, since the mean of x^3, which is left out,
vanishes at 1/13.2 for equal bubbles."""

TINY = 1e-30
"""Added to the widest phase difference, so that a facet of equal phases is divided as well: all of it belongs to the upper part."""


class Node(NamedTuple):
    """Corner of a facet, with its phase [rad] and amplitude."""

    phase: Any
    amplitude: Any
    opposite: Any
    """Bubble [rad] of the edge between the other two corners."""


class Averages(NamedTuple):
    """Averages of powers of v in 0..1 and of the bubble phase beta, along the line of the middle phase, with some weight."""

    one: Any
    v: Any
    v_v: Any
    beta: Any
    v_beta: Any
    beta_beta: Any


class MiddlePhaseLine(NamedTuple):
    """The line on which the phase is that of the middle corner, exp(j phase) there, and averages along it."""

    exponential: Parts
    plain: Averages
    weighted: Averages
    """The averages with the amplitude as weight."""
    centre: Any
    """The constant c."""
    mean_square: Any
    """Mean of x^2 over the facet."""


def curved_integral(phases: Any, amplitudes: Any, bubbles: Any, order: Order = 2) -> np.ndarray:
    """The integral I from phases [rad] and amplitudes of corners 0, 1, 2 and bubbles [rad] of edges 01, 12, 20, arrays (3, ...).

    The result is complex, of the arguments' precision: float32 arguments give a float32 computation. With amplitude 1 and no
    bubbles it is `phase_integral.divided_difference`. Raises InputError if the shapes differ or if `order` is neither 1 nor 2.
    """
    integer("order", order, 1, 2)
    arguments = [numeric(*x) for x in (("phases", phases), ("amplitudes", amplitudes), ("bubbles", bubbles))]
    for name, values in zip(("phases", "amplitudes", "bubbles"), arguments, strict=True):
        check_shape(name, values, (3, *arguments[0].shape[1:]))
    dtype = np.result_type(*arguments, np.float32)
    (real, imag), _ = curved_integrals(
        *(list(x.astype(dtype)) for x in arguments), ops=NUMPY_OPS, terms=SERIES_TERMS[dtype.itemsize], order=order
    )
    return real + 1j * imag


def facet_integral(phases: Sequence[Any], amplitudes: Sequence[Any], ops: Ops) -> tuple[Parts, Parts]:
    """Integral of amplitude times exp(j phase) over a facet, and its derivative as in `curved_integrals`, in float32.

    `phases` [rad] are those of the three corners of a flat facet, which has one amplitude, or those of the corners and of the
    middles of edges 01, 12, 20 of a curved facet, which has an amplitude at each corner.
    """
    terms = SERIES_TERMS[4]
    if len(phases) == 3:
        (amplitude,) = amplitudes
        value, change = divided_differences(*phases, ops=ops, terms=terms)
        return (value[0] * amplitude, value[1] * amplitude), (change[0] * amplitude, change[1] * amplitude)
    bubbles = [4 * phases[3 + i] - 2 * (phases[i] + phases[(i + 1) % 3]) for i in range(3)]
    return curved_integrals(phases[:3], amplitudes, bubbles, ops=ops, terms=terms, order=EXPANSION_ORDER)


def curved_integrals(
    phases: Sequence[Any], amplitudes: Sequence[Any], bubbles: Sequence[Any], *, ops: Ops, terms: int, order: Order
) -> tuple[Parts, Parts]:
    """I and dI: (re, im) of the integral and of the derivative d/ds of s I(s p, s q) at s = 1, that of the expansion itself.

    I is the integral of a exp(j (p + c)) T, T = 1 + jx - x^2/2, and d/ds of T(s x) is jx - x^2, so that dI is the integral of
    a exp(j (p + c)) [(1 + j (p + c)) T + jx - x^2]; to first order with the mean of x^2 in both.
    """
    opposites = bubbles[1], bubbles[2], bubbles[0]
    low, mid, high = _sorted_by_phase([Node(*node) for node in zip(phases, amplitudes, opposites, strict=True)], ops)
    centre = (bubbles[0] + bubbles[1] + bubbles[2]) * CENTRE
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
    line = MiddlePhaseLine(
        exponential=exponential(mid.phase, ops),
        plain=_averages(places, weights, beta),
        weighted=_averages(places, weighted, beta),
        centre=centre,
        mean_square=_mean_square(bubbles),
    )
    first = _part(low, below, (high.opposite, lower * mid.opposite), line, ops, terms, order)
    last = _part(high, -above, (low.opposite, upper * mid.opposite), line, ops, terms, order)
    real, imag, d_real, d_imag = (lower * x + upper * y for x, y in zip(first, last, strict=True))
    end = times(line.exponential, _at_line(line, order))
    rotation = exponential(centre, ops)
    return (
        times(rotation, (real, imag)),
        times(rotation, (d_real + end[0] - centre * imag, d_imag + end[1] + centre * real)),
    )


def _sorted_by_phase(nodes: list[Node], ops: Ops) -> list[Node]:
    """Corners in ascending order of phase, each with its amplitude and its opposite bubble."""
    nodes = list(nodes)
    for i in (0, 1, 0):
        swap = nodes[i].phase > nodes[i + 1].phase
        pairs = list(zip(nodes[i], nodes[i + 1], strict=True))
        nodes[i] = Node(*(ops.where(swap, y, x) for x, y in pairs))
        nodes[i + 1] = Node(*(ops.where(swap, x, y) for x, y in pairs))
    return nodes


def _mean_square(bubbles: Sequence[Any]) -> Any:
    """Mean of x^2 over the facet (eq. 30), from the means of l0 l1, 1/12, of its square, 1/90, and of l0 l1 l1 l2, 1/180."""
    first, second, third = bubbles
    total = first + second + third
    pairs = first * (second + third) + second * third
    return total * total * (1 / 90 - CENTRE / 6 + CENTRE * CENTRE) - pairs * (1 / 90)


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
    corner: Node, difference: Any, bubbles: tuple[Any, Any], line: MiddlePhaseLine, ops: Ops, terms: int, order: Order
) -> tuple[Any, Any, Any, Any]:
    """What the triangle between a corner and the line adds for each unit of its area to re and im of I and dI.

    The amplitude falls from that of the corner, t = 0, to that of the line, t = 1; the bubble phase is alpha t (1-t) + beta t^2
    with alpha = (1-v) first + v second of `bubbles`. dI is integrated by parts over t, where it has t d/dt of the polynomial
    in place of the phase t d; what is left at the line is `_at_line`.
    """
    plain = _expansion(line.plain, bubbles, line, order)
    weighted = _expansion(line.weighted, bubbles, line, order)
    real, imag = (_blend(corner.amplitude, x, y, ops) for x, y in zip(plain, weighted, strict=True))
    integrals = _power_integrals(exponential(corner.phase, ops), line.exponential, difference, ops, terms, order)
    value = _sum_of_products(real, imag, integrals, ops)
    d_real = [(1 - k) * x for k, x in enumerate(real)]
    d_real[0] = d_real[0] - 2 * corner.amplitude
    d_real[1] = d_real[1] - 2 * (line.weighted.one - corner.amplitude)
    d_value = _sum_of_products(d_real, [-k * x for k, x in enumerate(imag)], integrals, ops)
    return *value, d_value[0] - corner.phase * value[1], d_value[1] + corner.phase * value[0]


def _expansion(
    averages: Averages, bubbles: tuple[Any, Any], line: MiddlePhaseLine, order: Order
) -> tuple[list[Any], list[Any]]:
    """Coefficients of t^0, t^1, ... in the average of T along the line, real and imaginary.

    T = (1 - c^2/2 - jc) + (c + j) b - b^2/2 at b = alpha t + (beta - alpha) t^2.
    """
    centre = line.centre
    start, rise = bubbles[0], bubbles[1] - bubbles[0]
    alpha = start * averages.one + rise * averages.v
    bend = averages.beta - alpha
    imag = [-centre * averages.one, alpha, bend]
    if order == 1:
        return [averages.one * (1 - 0.5 * line.mean_square)], imag
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


def _at_line(line: MiddlePhaseLine, order: Order) -> Parts:
    """Average of a T along the line."""
    one, beta, beta_beta = line.weighted.one, line.weighted.beta, line.weighted.beta_beta
    imag = beta - line.centre * one
    if order == 1:
        return one * (1 - 0.5 * line.mean_square), imag
    return one + line.centre * (beta - 0.5 * line.centre * one) - 0.5 * beta_beta, imag


def _blend(corner: Any, plain: list[Any], weighted: list[Any], ops: Ops) -> list[Any]:
    """Coefficients of corner (1-t) plain(t) + t weighted(t)."""
    steps = [ops.fma(-corner, x, y) for x, y in zip(plain, weighted, strict=True)]
    middle = [ops.fma(corner, x, step) for x, step in zip(plain[1:], steps, strict=False)]
    return [corner * plain[0], *middle, steps[-1]]


def _power_integrals(exp_corner: Parts, exp_line: Parts, d: Any, ops: Ops, terms: int, order: Order) -> list[Parts]:
    """Integrals of t^k exp(j (p + d t)) over t in 0..1, k = 1 to 2 order + 2, from exp(jp) and exp(j (p + d)).

    By parts j d M_k = exp(j (p + d)) - k M_{k-1}, upwards where |d| is large, else downwards.
    """
    last = 2 * order + 2
    small = abs(d) < SWITCH_RAD[order]
    inverse = 1 / ops.where(small, d * 0 + 1, d)
    up = [((exp_line[1] - exp_corner[1]) * inverse, (exp_corner[0] - exp_line[0]) * inverse)]
    for k in range(1, last + 1):
        real, imag = up[-1]
        up.append((ops.fma(-k, imag, exp_line[1]) * inverse, ops.fma(k, real, -exp_line[0]) * inverse))
    d = ops.where(small, d, d * 0)
    down = [times(exp_line, power_integral(-d, last, terms, ops.fma))]
    for k in range(last, 1, -1):
        real, imag = down[-1]
        down.append((ops.fma(d, imag, exp_line[0]) * (1 / k), ops.fma(-d, real, exp_line[1]) * (1 / k)))
    return [
        (ops.where(small, x[0], y[0]), ops.where(small, x[1], y[1])) for x, y in zip(down[::-1], up[1:], strict=True)
    ]


def _sum_of_products(real: list[Any], imag: list[Any], integrals: list[Parts], ops: Ops) -> Parts:
    """Sum of (real_k + j imag_k) integral_k over as many k as there are coefficients; further integrals do not count."""
    total: Parts = 0.0, 0.0
    for x, (re, im) in zip(real, integrals, strict=False):
        total = ops.fma(x, re, total[0]), ops.fma(x, im, total[1])
    for x, (re, im) in zip(imag, integrals, strict=False):
        total = ops.fma(-x, im, total[0]), ops.fma(x, re, total[1])
    return total
