"""Progress of a run: a bar on a terminal or in a notebook, or occasional lines where a log is written."""

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
"""Duration below which a run shows nothing [s]."""
BETWEEN_LINES_S = 30.0
"""Time between two lines in a log, and before the first [s]."""


class ProgressBar:
    """A progress bar, called with the fraction done, 0..1; it appears on stderr once a run takes over two seconds.

    It disappears at 1, when it is closed, or at the end of its `with` block.
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

        if self._bar is None:  # only now, so that its estimate leaves out the preparation
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
        """Writes a line without a carriage return, as files and pipes cannot be overwritten."""
        now = time.monotonic()
        if sys.stderr is None or now - self._said < BETWEEN_LINES_S or fraction >= 1:
            return
        self._said = now
        print(f"{self._label} {100 * fraction:.0f} % after {now - self._started:.0f} s", file=sys.stderr, flush=True)

    def close(self) -> None:
        """Removes the bar."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def shown_progress(progress: Any, label: str) -> Callable[[float], None] | None:
    """The function to which a run reports its progress: a bar for True, a user's function, or None for None and False."""
    if progress is None or progress is False:
        return None
    if progress is True:
        return ProgressBar(label)
    checked: Callable[[float], None] = call("progress", progress, "True or a function of the fraction done")
    return checked


def _redraws(stream: Any) -> bool:
    """Whether what is written to a stream appears at once and can be overwritten: a terminal, or a cell of a notebook."""
    return stream is not None and (stream.isatty() or type(stream).__module__.startswith("ipykernel"))


def split_progress(progress: Callable[[float], None] | None, count: int) -> Iterator[Callable[[float], None] | None]:
    """Functions that report the progress of each of `count` equal parts of a run."""
    for number in range(count):
        yield stretch(progress, number / count, (number + 1) / count)


def stretch(progress: Callable[[float], None] | None, start: float, stop: float) -> Callable[[float], None] | None:
    """A function that reports the progress of a part of a run, 0..1, as that between `start` and `stop` of the whole; None for
    None."""
    return None if progress is None else partial(_report_within, progress, start, stop)


def _report_within(progress: Callable[[float], None], start: float, stop: float, fraction: float) -> None:
    progress(start * (1 - fraction) + stop * fraction)
