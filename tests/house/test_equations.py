"""The equations of docs/physics.md: numbered in order, typeset, and cited by numbers that exist."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
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


FORMULA = re.compile(r"^\$\$\n(.+?)\n\$\$$|(?<!\$)\$(?!\$)([^$]+)\$(?!\$)", re.MULTILINE | re.DOTALL)
SPELLED = re.compile(
    r"\b(lambda|sigma|theta|tau|Gamma|phi|psi|eps|alpha|sqrt|sum_\w|pi|exp)\b|\^[\d{-]|^    \S", re.MULTILINE
)


def test_each_equation_is_typeset() -> None:
    sections = re.split(r"^\*\*\((?=\d)", PAGE, flags=re.MULTILINE)[1:]
    without = [each.partition(")")[0] for each in sections if not FORMULA.search(each)]
    assert not without


def test_no_formula_is_spelled_out() -> None:
    """Outside of formulas no Greek letter has its name, no power a caret; inside all brackets are closed."""
    assert "$" not in (rest := FORMULA.sub(" ", PAGE))
    assert not [match[0] for match in SPELLED.finditer(rest)]
    formulas = [match[1] or match[2] for match in FORMULA.finditer(PAGE)]
    assert len(formulas) > 150
    for opening, closing in (("{", "}"), (r"\left", r"\right"), (r"\begin{aligned}", r"\end{aligned}")):
        uneven = [each for each in formulas if each.count(opening) != each.count(closing)]
        assert not uneven


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
