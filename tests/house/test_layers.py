"""The floors of the house: the contracts of pyproject.toml hold, and would be noticed if they did not."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

LINT = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))"


def _lint(root: Path) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, "PYTHONPATH": str(root)}
    return subprocess.run(
        [sys.executable, "-c", LINT], cwd=root, env=env, capture_output=True, text=True, timeout=120, check=False
    )


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    shutil.copytree(ROOT / "t2d_rt", tmp_path / "t2d_rt", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def test_contracts_hold() -> None:
    run = _lint(ROOT)
    assert run.returncode == 0, run.stdout + run.stderr


INTRUDERS = (
    ("scattering", "t2d_rt.radar"),  # sideways
    ("types", "t2d_rt.scattering"),  # upward
    ("geometry", "t2d_rt.plots"),
    ("signal", "mitsuba"),
    ("noise", "sionna.rt"),
    ("body", "drjit"),
)
"""Parts of the package, and what none of their modules may import."""


def test_hidden_imports_are_noticed(copy: Path) -> None:
    for module, imported in INTRUDERS:
        text = f"def later():\n    import {imported}\n    return {imported}\n"
        (copy / "t2d_rt" / module / "intruder.py").write_text(text)
    run = _lint(copy)
    assert run.returncode != 0
    for module, imported in INTRUDERS:
        assert f"t2d_rt.{module}.intruder -> {imported.removesuffix('.rt')}" in run.stdout, module


def test_a_new_module_needs_a_floor(copy: Path) -> None:
    (copy / "t2d_rt" / "attic.py").write_text("")
    run = _lint(copy)
    assert run.returncode != 0
    assert "attic" in run.stdout
