"""`import t2d_rt` is quick and loads nothing heavy; what the package says of itself."""

from __future__ import annotations

import subprocess
import sys
import tomllib

import yaml

from builders import ROOT

MEASURE = """
import sys, time
before = set(sys.modules)
start = time.process_time()
import t2d_rt
print(time.process_time() - start)
print(*{name.partition(".")[0] for name in set(sys.modules) - before})
"""


def _import_in_a_process() -> tuple[float, set[str]]:
    """CPU seconds that the import took, and the top-level modules that it loaded."""
    run = subprocess.run([sys.executable, "-c", MEASURE], capture_output=True, text=True, timeout=60, check=True)
    seconds, modules = run.stdout.splitlines()
    return float(seconds), set(modules.split())


def test_import_is_light_and_quick() -> None:
    runs = [_import_in_a_process() for _ in range(3)]
    for _, modules in runs:
        assert modules - sys.stdlib_module_names == {"t2d_rt"}
    assert min(seconds for seconds, _ in runs) < 0.2


def test_the_package_is_cited_by_its_version() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert {citation[name] == project[name] for name in ("version", "license", "keywords")} == {True}


def test_type_checkers_read_the_package() -> None:
    assert (ROOT / "t2d_rt" / "py.typed").is_file()  # PEP 561
