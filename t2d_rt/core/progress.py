"""How far a run is: a bar on a terminal or in a notebook, a line now and then where a log is written."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

from t2d_rt.core.checks import call

if TYPE_CHECKING:
    from tqdm import tqdm

SHOWN_AFTER_S = 2.0
"""Shorter runs show nothing."""
BETWEEN_LINES_S = 30.0
"""Time from one line in a log to the next, and to the first."""


class ProgressBar:
    """Called with the fraction done, 0..1; shows itself on stderr once a run takes over two seconds.

    It ends at 1, when it is closed, or with the `with` block that it stands in.
    """

    def __init__(self, label: str) -> None:
        self._label = label
        self._started = self._said = time.monotonic()
        self._bar: tqdm | None = None
        self._draws = _redraws(sys.stderr)

    def __call__(self, fraction: float) -> None:
        """Shows the fraction done, 0..1."""
        if self._draws:
            self._draw(fraction)
        else:
            self._say(fraction)
        if fraction >= 1:
            self.close()

    def _draw(self, fraction: float) -> None:
        from tqdm import tqdm

        if self._bar is None:  # not before: the time that it says is left must not count the preparation
            delay = max(1e-3, SHOWN_AFTER_S - (time.monotonic() - self._started))
            self._bar = tqdm(
                total=1.0,
                initial=fraction,
                desc=self._label,
                delay=delay,
                leave=False,
                bar_format="{desc} {percentage:3.0f}% |{bar}| {remaining}",
                file=sys.stderr,
            )
        self._bar.update(fraction - self._bar.n)

    def _say(self, fraction: float) -> None:
        """A line, and no carriage return: what is written to a file or through a pipe is not drawn over."""
        now = time.monotonic()
        if sys.stderr is None or now - self._said < BETWEEN_LINES_S or fraction >= 1:
            return
        self._said = now
        print(f"{self._label} {100 * fraction:.0f} % after {now - self._started:.0f} s", file=sys.stderr, flush=True)

    def close(self) -> None:
        """Takes the bar away."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def shown_progress(progress: Any, label: str) -> Callable[[float], None] | None:
    """What a run is to tell its progress to: a bar for True, a user's function, or nothing for None and False."""
    if progress is None or progress is False:
        return None
    if progress is True:
        return ProgressBar(label)
    checked: Callable[[float], None] = call("progress", progress, "True or a function of the fraction done")
    return checked


def _redraws(stream: Any) -> bool:
    """Whether what is written there is shown at once and can be drawn over: a terminal, or a notebook's cell."""
    return stream is not None and (stream.isatty() or type(stream).__module__.startswith("ipykernel"))


def split_progress(progress: Callable[[float], None] | None, count: int) -> Iterator[Callable[[float], None] | None]:
    """What tells the progress of each of `count` equal parts of a run."""
    for number in range(count):
        yield stretch(progress, number / count, (number + 1) / count)


def stretch(progress: Callable[[float], None] | None, start: float, stop: float) -> Callable[[float], None] | None:
    """What tells the progress of that stretch of a run, 0..1 of it."""
    return None if progress is None else partial(_report_within, progress, start, stop)


def _report_within(progress: Callable[[float], None], start: float, stop: float, fraction: float) -> None:
    progress(start * (1 - fraction) + stop * fraction)
