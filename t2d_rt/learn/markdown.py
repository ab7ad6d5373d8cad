"""Tables of reports in Markdown."""

from __future__ import annotations

from collections.abc import Sequence


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table: a line of names, and rows of as many texts.

    >>> print(table(["a", "b"], [["1", "2|3"]]))
    | a | b |
    |---|---|
    | 1 | 2/3 |
    """
    first, *others = [f"| {' | '.join(str(each).replace('|', '/') for each in line)} |" for line in (head, *rows)]
    return "\n".join([first, "|" + "---|" * len(head), *others])
