"""The equations of docs/physics.md: numbered in order, and cited by numbers that exist."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "physics.md").read_text(encoding="utf-8")


def cited(text: str) -> list[int]:
    """Numbers of equations that a text cites, also of several at once and over the end of a line; not those of a paper."""
    found = re.findall(r"(?<!its )(?<!paper's )\beq\.\s+(\d+(?:(?:, | and )\d+)*)", text)
    return [int(number) for group in found for number in re.findall(r"\d+", group)]


def numbered() -> list[int]:
    """Numbers of the equations, as they come."""
    return [int(number) for number in re.findall(r"^\*\*\((\d+)\)", PAGE, flags=re.MULTILINE)]


def test_equations_are_numbered_in_order() -> None:
    assert numbered() == list(range(1, len(numbered()) + 1))
    assert len(numbered()) >= 29


def test_cited_equations_exist() -> None:
    files = [path for name in ("t2d_rt", "tests", "validation", "docs") for path in sorted((ROOT / name).rglob("*"))]
    texts = {path: path.read_text(encoding="utf-8") for path in files if path.suffix in (".py", ".md")}
    numbers = {path.relative_to(ROOT).as_posix(): cited(text) for path, text in texts.items() if path != Path(__file__)}
    wrong = [f"{name}: eq. {number}" for name, found in numbers.items() for number in found if number not in numbered()]
    assert not wrong
    assert len([number for name, found in numbers.items() if name.startswith("t2d_rt/") for number in found]) > 30


def test_lists_of_citations_are_understood() -> None:
    assert cited("(docs/physics.md, eq. 3, 4 and 9); eq.\n27. The paper's eq. 1, eq. 5.") == [3, 4, 9, 27, 5]
    assert cited("the Text2Doppler paper (its eq. 1)") == []
