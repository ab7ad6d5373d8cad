"""The identifiers of t2d_rt use the field's terms (docs/glossary.md) and none of the words that once stood in their place."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "t2d_rt"

SAY = {
    "path": ("way", "ways", "leg", "legs"),
    "visibility, occlusion": ("look", "looks", "looked", "passed", "past"),
    "sample times": ("pace", "paces", "keys", "keyed"),
    "fast-rotating, decimated": ("swift", "seldom"),
    "dominant, secondary, minor": ("strong", "weak", "faint", "clear"),
    "instants; cycles, rotation, angle": ("moment", "moments", "turn", "turns", "turned"),
    "bin, batch": ("collector", "collectors", "hand", "hands"),
    "apparent position": ("sights",),
    "scene": ("around",),
    "static": ("still",),
    "fraction": ("share", "shares"),
    "limit": ("bar", "bars"),
    "subdivision level, sagitta scale": ("halved", "coarser"),
    "target geometry": ("shape", "shapes"),
}
"""What to say, by the words not to say."""

INSTEAD = {word: term for term, words in SAY.items() for word in words}

OF_PERSONS = {
    *(
        "leg", "legs", "hand", "hands", "turn", "turns", "turned", "pace", "paces", "shape", "shapes", "still", "strong",
        "weak",
    ),
}  # fmt: skip
"""Words that have their plain sense where persons move: in `motion/` and `body/`."""

EXCEPTIONS = {
    "_leg": "of a dog or a cat", "turn_radius_m": "the turning radius of a pet, an option by that name",
    "looks": "the number of looks of a detector, a term of radar",
    "LEAST_LOOKS": "the number of looks of a detector, a term of radar",
    "MOST_LOOKS": "the number of looks of a detector, a term of radar", "keys": "of mappings and of sorting",
    "_check_keys": "of mappings", "ProgressBar": "a progress bar", "_bar": "a progress bar", "bar": "a colour bar",
    "draw_bar": "a colour bar", "COARSER": "Richardson's extrapolation compares a fine model with a coarser one",
    "_coarser": "likewise", "coarser": "likewise", "coarser_db": "likewise", "check_shape": "of an array",
    "shape": "of an array, or the element of a scene file by that name",
    "shapes": "the elements of a scene file by that name", "Shapes": "the elements of a scene file by that name",
    "mode_shapes": "of a hanging chain", "passed": "of a motion that passes the filter, a verdict on it",
}  # fmt: skip
"""Identifiers that have one of the words in another sense, and which."""


FUNCTIONS_AND_CLASSES = ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef
NAMES = ast.Name, ast.Attribute


def defined(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Names that a module gives to its own things, with their lines; not those of libraries that it calls."""
    for node in ast.walk(tree):
        if isinstance(node, FUNCTIONS_AND_CLASSES):
            yield node.name, node.lineno
        elif isinstance(node, ast.arg):
            yield node.arg, node.lineno
        elif isinstance(node, NAMES) and isinstance(node.ctx, ast.Store):
            yield node.id if isinstance(node, ast.Name) else node.attr, node.lineno
        elif isinstance(node, ast.alias) and node.asname is not None:
            yield node.asname, node.lineno


@cache
def parts(name: str) -> list[str]:
    """The words of an identifier in lower case; a one-way path is a term and no way."""
    words = [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z0-9]+", name)]
    return re.sub(r"\bone way\b", "", " ".join(words)).split()


def faults(place: str, source: str) -> Iterator[tuple[str, str]]:
    """Identifiers with one of the words, and a sentence about each."""
    for name, line in [(Path(place).stem, 1), *defined(ast.parse(source))]:
        for word in parts(name):
            if word in INSTEAD:
                yield name, f"{place}:{line}: {name}: say {INSTEAD[word]}, not {word}"


@cache
def of_package() -> list[tuple[str, str]]:
    """Those of t2d_rt."""
    files = sorted(PACKAGE.rglob("*.py"))
    assert len(files) > 120
    found = [each for path in files for each in faults(path.relative_to(PACKAGE).as_posix(), path.read_text("utf-8"))]
    return [
        (name, sentence)
        for name, sentence in found
        if not (sentence.startswith(("motion/", "body/")) and set(parts(name)) & set(INSTEAD) <= OF_PERSONS)
    ]


def test_identifiers_use_the_fields_terms() -> None:
    wrong = [sentence for name, sentence in of_package() if name not in EXCEPTIONS]
    assert not wrong, "\n".join(wrong)


def test_nothing_is_excepted_that_needs_it_no_more() -> None:
    assert not EXCEPTIONS.keys() - {name for name, _ in of_package()}


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("def f(leg, *, path): ...", ["leg"]),
        ("class KeyedFade: ...", ["KeyedFade"]),
        ("for still_m in x: pass", ["still_m"]),
        ("self.HALVED = [turn for turn in x]", ["HALVED", "turn"]),
        ("import a as faint", ["faint"]),
        ("one_way_path = OneWayPath = x.shape = 1", ["shape"]),
        ("way_out = x.keys()", ["way_out"]),
        ("shaped = a.b(sort_keys=True).shape; half_turn: int = 1", ["half_turn"]),
    ],
)
def test_each_kind_of_definition_is_noticed(source: str, names: list[str]) -> None:
    assert sorted(name for name, _ in faults("a.py", source)) == sorted(names)


def test_a_modules_name_counts() -> None:
    assert [name for name, _ in faults("a/legs.py", "")] == ["legs"]
