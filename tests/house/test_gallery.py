"""Programs of the site's gallery and tutorials: `make docs` runs them; here they are read alone."""

from __future__ import annotations

import ast
import re
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
GALLERY = sorted((ROOT / "examples" / "gallery").glob("*.py"))
TUTORIALS = sorted((ROOT / "examples" / "tutorials").glob("*.py"))
DOCUMENTED = set(re.findall(r"\bt2d_rt(?:\.\w+)+", "".join(page.read_text() for page in (ROOT / "docs").glob("*.md"))))
"""Modules that a page of docs/ names."""


def undocumented(source: str) -> list[str]:
    """What a program uses of t2d_rt that users are not told of."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and (module := node.module or "").split(".")[0] == "t2d_rt":
            public = set(import_module(module).__all__) if module in {"t2d_rt", *named()} else set()
            names = [f"{module}.{each.name}" for each in node.names if each.name not in public]
            found += [name for name in names if name not in named()]
        elif isinstance(node, ast.Import):
            found += [each.name for each in node.names if each.name.startswith("t2d_rt.") and each.name not in named()]
        elif isinstance(node, ast.Attribute) and node.attr.startswith("_"):
            found.append(node.attr)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "t2d":
            found += [f"t2d.{node.attr}"] * (node.attr not in import_module("t2d_rt").__all__)
    return found


def named() -> set[str]:
    """Documented modules and the packages that hold them."""
    return {".".join(name.split(".")[:count]) for name in DOCUMENTED for count in range(2, name.count(".") + 2)}


@pytest.mark.parametrize("path", [*GALLERY, *TUTORIALS], ids=lambda path: path.stem)
def test_programs_use_what_is_documented(path: Path) -> None:
    source = path.read_text(encoding="utf-8")
    compile(source, path.name, "exec")
    assert undocumented(source) == []


@pytest.mark.parametrize("path", [*GALLERY, *TUTORIALS], ids=lambda path: path.stem)
def test_pages_have_a_title_and_a_text(path: Path) -> None:
    """sphinx-gallery takes the title from the docstring's first lines."""
    title, line, *text = (ast.get_docstring(ast.parse(path.read_text())) or "").splitlines()
    assert line == "=" * len(title)
    assert len(" ".join(text).split()) > 10
    assert re.match(r"plot_\w+\.py$", path.name)


@pytest.mark.parametrize("path", GALLERY, ids=lambda path: path.stem)
def test_gallery_programs_are_short(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) < 40


def test_what_is_not_documented_is_found() -> None:
    assert undocumented("from t2d_rt.signal import spectrogram") == []
    assert undocumented("from t2d_rt.signal.doppler import spectrogram") == ["t2d_rt.signal.doppler.spectrogram"]
    assert undocumented("import t2d_rt as t2d\nt2d.simulation()\nt2d.simulate()._mti") == ["_mti", "t2d.simulation"]
