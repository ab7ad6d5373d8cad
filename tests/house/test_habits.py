"""The habits of the code: modules of at most 600 lines, functions of at most 80 lines and at most 9 parameters."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

MOST_LINES, MOST_FUNCTION_LINES, MOST_PARAMETERS = 600, 80, 9

FACADE = {
    "t2d_rt/cli/background.py background", "t2d_rt/cli/datasets.py dataset", "t2d_rt/cli/learn.py train",
    "t2d_rt/cli/motions.py describe", "t2d_rt/cli/recordings.py plot", "t2d_rt/motion/read/__init__.py load_motion",
    "t2d_rt/simulate.py simulate", "t2d_rt/plots/figures.py plot_comparison", "t2d_rt/signal/angle.py range_angle",
    "t2d_rt/signal/doppler.py spectrogram", "t2d_rt/signal/points.py point_cloud", "t2d_rt/types/mesh.py from_track",
}  # fmt: skip
"""Calls that people type, in Python or as a command, whose parameters are options with defaults: they may have more than nine."""


FUNCTIONS = ast.FunctionDef, ast.AsyncFunctionDef
BLOCKS = ast.stmt, ast.ExceptHandler, ast.match_case
"""What functions may lie in: they are in no expression, of which a module has ten times as many nodes."""


def functions(tree: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """All of a module, those within others too."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, FUNCTIONS):
            yield node
        if isinstance(node, BLOCKS):
            yield from functions(node)


def faults(name: str, source: str) -> Iterator[tuple[str, str]]:
    """What is too long or takes too much: its name, and a sentence. A docstring does not count, nor does self."""
    if (lines := len(source.splitlines())) > MOST_LINES:
        yield name, f"{name} has {lines} lines, at most {MOST_LINES} are meant"
    for found in functions(ast.parse(source)):
        assert found.end_lineno is not None
        lines = found.end_lineno - found.lineno + 1
        if ast.get_docstring(found) is not None:
            told = found.body[0]
            assert told.end_lineno is not None
            lines -= told.end_lineno - told.lineno + 1
        given = found.args
        names = [each.arg for each in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
        count = len(names) - (names[:1] in (["self"], ["cls"])) + (given.vararg is not None) + (given.kwarg is not None)
        place = f"{name} {found.name}"
        if lines > MOST_FUNCTION_LINES:
            yield place, f"{place} has {lines} lines, at most {MOST_FUNCTION_LINES} are meant"
        if count > MOST_PARAMETERS and place not in FACADE:
            yield (
                place,
                f"{place} has {count} parameters, at most {MOST_PARAMETERS} are meant; make some a value with a name",
            )


def found() -> dict[str, str]:
    """Every fault of the project by its place."""
    files = [path for folder in ("t2d_rt", "validation") for path in sorted((ROOT / folder).rglob("*.py"))]
    assert len(files) > 150
    return dict(fault for path in files for fault in faults(path.relative_to(ROOT).as_posix(), path.read_text()))


def test_modules_and_functions_are_short() -> None:
    assert not found(), "\n".join(found().values())


def test_nothing_is_excepted_that_needs_it_no_more() -> None:
    for place in FACADE:
        name, function = place.split()
        tree = ast.parse((ROOT / name).read_text())
        (call,) = (each for each in ast.walk(tree) if isinstance(each, ast.FunctionDef) and each.name == function)
        names = [each.arg for each in (*call.args.args, *call.args.kwonlyargs)]
        assert len(names) - (names[:1] in (["self"], ["cls"])) > MOST_PARAMETERS, place


@pytest.mark.parametrize(
    ("source", "sentences"),
    [
        ("x = 1\n" * 600, []),
        ("x = 1\n" * 601, ["a.py has 601 lines, at most 600 are meant"]),
        ("def f(a, b, c, d, e, f, g, /, h, i): ...", []),
        ("def f(a, b, c, d, e, f, g, /, h, i, *j): ...", ["a.py f has 10 parameters"]),
        (
            "if a:\n    x = 1\nelse:\n    try:\n        b()\n    except A:\n        def f(a, b, c, d, e, f, g, h, i, j): ...",
            ["a.py f"],
        ),
        ("match a:\n    case 1:\n        def f():\n            def g(a, b, c, d, e, f, g, h, i, j): ...", ["a.py g"]),
        ("class A:\n    def f(self, a, b, c, d, e, f, g, *, h, i): ...", []),
        ("class A:\n    async def f(self, a, b, c, d, e, f, g, *, h, i, **j): ...", ["a.py f has 10 parameters"]),
        ("def f():\n" + "    x = 1\n" * 79, []),
        ("def f():\n" + "    x = 1\n" * 80, ["a.py f has 81 lines"]),
        ('def f():\n    """Long.\n\n' + "    text\n" * 90 + '    """\n' + "    x = 1\n" * 79, []),
    ],
)
def test_what_is_too_long_is_noticed(source: str, sentences: list[str]) -> None:
    told = [sentence for _, sentence in faults("a.py", source)]
    assert len(told) == len(sentences)
    assert all(sentence.startswith(start) for sentence, start in zip(told, sentences, strict=True))
