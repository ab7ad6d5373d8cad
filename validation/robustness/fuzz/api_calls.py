"""Calls of the public functions with one or two arguments that no signature asks for."""

from __future__ import annotations

import copy
import datetime
import decimal
import fractions
import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import t2d_rt as t2d
from validation.robustness.api_arguments import FACES, RADAR, TETRAHEDRON, TIMES_S
from validation.robustness.api_calls import Call, arrays_of, calls
from validation.robustness.fuzz.case import Attempt, chance, check_finite, no_raw_warnings, pick


class Strange:
    """An object of no use here; its text is not plain either."""

    def __repr__(self) -> str:
        return "<strange\n\x1b[31m>"


PLAIN: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 3, 7, 10**30, -(10**9), 10**9, 0.0, 0.5, 2.5, -2.5, 1e300, -1e300, 1e-300, math.nan,
    math.inf, -math.inf, 1j,
    "", "x", "120", "nan", "a\nb", "\x1b[31m", "x" * 10000, b"x", [], [1], [1, 2], [1, 2, 3], [2.0, 1.0], (), (0, 0), (1,
    2, 3), (math.nan, 1), {}, {"a": 1},
    {1}, frozenset(), range(3), slice(None), object, int, len, lambda *_: None, Path("x"), Path("/dev/zero"),
    decimal.Decimal("1.5"), fractions.Fraction(1, 3),
    datetime.date(2020, 1, 1), Ellipsis, NotImplemented, np.float32(1.5), np.int64(3), np.bool_(True), np.str_("x"),
    np.float64("nan"), 1 << 62, 128.0,
)  # fmt: skip
TEXTS = (
    "np.zeros(0)", "np.zeros(3)", "np.zeros((0, 3))", "np.zeros((3, 0))", "np.zeros((2, 3))", "np.zeros((4, 3))",
    "np.zeros((3, 22, 3))", "np.ones((3, 4))",
    "np.full(3, np.nan)", "np.full((3, 3), np.inf)", "np.ones(3, complex)", "np.ones((300, 1, 32), np.complex64)",
    "np.ones((300, 32))",
    "np.full((300, 1, 32), np.nan, complex)", "np.ones((300, 1, 32), object)", "np.array(['a', 'b', 'c'])",
    "np.array([1, None, 'x'], dtype=object)",
    "np.ma.masked_array([1.0, 2, 3], [0, 1, 0])", "np.ma.masked_all((4, 3))", "np.array(3.0)", "np.arange(3)",
    "np.arange(3)[::-1]", "np.arange(3, dtype=np.uint8)",
    "np.array([1, 2, 3], np.float16)", "np.array([2**63], np.uint64)", "np.array(['2020-01-01'], 'datetime64[D]')",
    "np.zeros(3, [('a', float)])", "np.zeros((1,) * 32)",
    "np.matrix([[1, 2], [3, 4]])", "np.broadcast_to(1.0, (300, 1, 32))", "(x for x in [1, 2])", "memoryview(b'abc')",
    "bytearray(3)", "Strange()", "[Strange()]",
    "[[1, 2], [3]]", "[[]]", "['a', 3]", "[None]", "{'kind': 'fan'}", "t2d.Radar", "t2d.Radar.preset('ci4r')",
    "np.random.default_rng(0)", "[float('nan')] * 3",
    "type('Like', (), {'__array__': lambda self, *a, **k: np.ones(3)})()",
    "type('Bad', (), {'__len__': lambda self: -1})()",
)  # fmt: skip
"""Values that each call has to have for itself, as they are written."""
NAMES = {"np": np, "t2d": t2d, "Strange": Strange}
ODD: tuple[Callable[[], Any], ...] = (
    *(functools.partial(copy.copy, value) for value in PLAIN),
    *(functools.partial(eval, text, NAMES) for text in TEXTS),
)
"""Makers of odd values."""
TRACKS: dict[str, Callable[[np.ndarray], Any]] = {
    "nan": lambda times: np.full((len(times), 4, 3), np.nan),
    "another shape": lambda times: TETRAHEDRON,
    "nothing": lambda times: None,
    "jumps": lambda times: TETRAHEDRON + 1e3 * (np.asarray(times) > 0.1)[:, None, None],
    "words": lambda times: "x",
}
"""Functions that should give vertices at times."""


def broken_tracks() -> list[Call]:
    """Meshes by what is no track, simulated: they are seen when the track is called."""
    sound = {"faces": FACES, "times_s": TIMES_S, "material": "pec", "rest": TETRAHEDRON, "name": "ball"}
    return [
        Call(
            f"a track of {kind}",
            t2d.MovingMesh.from_track,
            {"track": track, **sound},
            lambda m: t2d.simulate(m, radar=RADAR).cube,
        )
        for kind, track in TRACKS.items()
    ]


def attempt(rng: np.random.Generator, folder: Path) -> Attempt:
    """One call."""
    call = pick(rng, calls(folder) + broken_tracks())
    odd = {}
    for _ in range(1 if chance(rng, 0.7) else 2):
        odd[pick(rng, sorted(call.arguments))] = pick(rng, ODD)()
    return attempted(call, odd)


def attempted(call: Call, odd: dict[str, Any]) -> Attempt:
    """The call with other values for some of its arguments; what comes back has to be finite."""

    def act() -> None:
        with no_raw_warnings():
            result = call.use(call.function(**call.arguments | odd))
            for values in arrays_of(result):
                check_finite(values, "the result")

    return Attempt(f"{call.name}({', '.join(f'{key}={short(value)}' for key, value in odd.items())})", act)


def short(value: Any) -> str:
    """A value in a few words."""
    if isinstance(value, np.ndarray) and value.size > 8:
        return f"array{value.shape} {value.dtype}"
    return ascii(value)[:80]
