"""What users read: errors and warnings of one sentence with what was given, what was expected and what to do, and the small tables
that notebooks show."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable
from html import escape

LONGEST = 2_000
"""Greatest number of characters of a message; a list of names from a scene or a file may be long."""


def printable(text: str) -> str:
    """Text that is safe for a terminal: everything but printable characters, line ends and tabs is escaped."""
    return "".join(
        char if char.isprintable() or char in "\n\t" else char.encode("unicode_escape").decode() for char in text
    )


def install(extra: str) -> str:
    """What to do where an optional part is not installed; t2d-rt is installed from a clone.

    >>> install("learn")
    "run pip install -e '.[learn]' in your clone of t2d-rt"
    """
    return f"run pip install -e '.[{extra}]' in your clone of t2d-rt"


class T2DError(Exception):
    """Base of every error that t2d-rt raises on purpose; the command line prints it in one line and exits with 2.

    Names and values of users stand in its sentence: whatever they hold, it is one line of bounded length that a terminal prints.

    >>> print(InputError("no joint 'a\\x1b[31m'"))
    no joint 'a\\x1b[31m'
    """

    def __init__(self, sentence: str = "") -> None:
        text = printable(" ".join(sentence.split("\n")))
        super().__init__(text if len(text) <= LONGEST else f"{text[: LONGEST // 2]} ... {text[-LONGEST // 2 :]}")


class InputError(T2DError, ValueError):
    """A value, file or option that cannot be used."""


class BackendError(T2DError, RuntimeError):
    """The computing backend (LLVM, CUDA) is missing or unusable."""


class T2DWarning(UserWarning):
    """Something the user should know although the run goes on."""


def warn(sentence: str) -> None:
    """Issues a T2DWarning that points to the line of the user's code, however deep in t2d-rt the call is."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and f"{frame.f_globals.get('__name__')}.".startswith("t2d_rt."):
        frame, level = frame.f_back, level + 1
    warnings.warn(sentence, T2DWarning, stacklevel=level)


Rows = Iterable[tuple[str, str]]
"""Names and texts of the rows of a table."""


def html_table(heading: str, rows: Rows) -> str:
    """A small table; whatever the texts hold, it is shown as it is and never as markup.

    >>> html_table("A & B", [("size", "<3 m")])
    '<table><caption>A &amp; B</caption><tr><th>size</th><td>&lt;3 m</td></tr></table>'
    """
    body = "".join(f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in rows)
    return f"<table><caption>{escape(heading)}</caption>{body}</table>"


def size(count: int) -> str:
    """A number with its thousands apart.

    >>> size(102400)
    '102 400'
    """
    return f"{count:,}".replace(",", " ")
