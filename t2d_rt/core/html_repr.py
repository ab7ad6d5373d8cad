"""Values at a glance: what an interpreter prints, and the table that a notebook shows."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

Rows = Iterable[tuple[str, str]]
"""Names and texts."""


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
