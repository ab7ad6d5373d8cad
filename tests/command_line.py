"""What a command of the command line left behind, for tests of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import yaml


class Run(NamedTuple):
    code: int
    out: str
    err: str


Command = Callable[..., Run]


def listing(folder: Path) -> dict[str, int]:
    return {str(p.relative_to(folder)): p.lstat().st_mtime_ns for p in folder.rglob("*")}


def dump(path: str, values: Any) -> str:
    Path(path).write_text(yaml.safe_dump(values))
    return path
