"""What a section of the validation found, written to results.json and report.md."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

from t2d_rt.core.kernels import processor
from t2d_rt.core.plugins import versions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FOLDER = Path(__file__).parent / "report"
RESULTS = "results.json"
LIMITS = "Limits are aims that were set beforehand: FAIL marks one that is not reached, by as much as the figures beside it tell."


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """A figure beside the limit that it has to meet."""

    what: str
    measured: float
    limit: float
    unit: str
    at_least: bool = False
    """Whether the limit is a least value."""

    @property
    def passed(self) -> bool:
        """Whether the figure meets the limit; NaN does not."""
        return self.measured >= self.limit if self.at_least else self.measured <= self.limit

    @property
    def asked(self) -> str:
        """The limit in words."""
        return f"{'>=' if self.at_least else '<='} {self.limit:g} {self.unit}".strip()


def at_most(what: str, measured: float, limit: float, unit: str = "") -> Check:
    """A figure that may reach the limit."""
    return Check(what=what, measured=measured, limit=limit, unit=unit)


def at_least(what: str, measured: float, limit: float, unit: str = "") -> Check:
    """A figure that must reach the limit."""
    return Check(what=what, measured=measured, limit=limit, unit=unit, at_least=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """One section of the report."""

    title: str
    checks: list[Check]
    note: str = ""
    """How it was measured."""
    table: list[dict[str, Any]] = field(default_factory=list)
    """Rows of what was measured beyond the limits, all of the same columns."""
    charts: list[str] = field(default_factory=list)
    """Files in the report's folder."""


def save_chart(figure: Figure, name: str, folder: Path = FOLDER) -> str:
    """Writes a figure to the report's folder and gives the file's name."""
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / name, dpi=80, metadata={"Software": None})
    return name


def new_figure(**options: Any) -> tuple[Any, Any]:
    """A small figure that needs no display, and its axes."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    return plt.subplots(layout="constrained", **{"figsize": (6.5, 4), **options})


def record(name: str, section: Section, folder: Path = FOLDER) -> None:
    """Puts a section into the folder's results.json in place of what it held of it."""
    path = folder / RESULTS
    results = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    checks = [
        {"what": c.what, "limit": c.asked, "measured": _short(c.measured), "unit": c.unit, "passed": bool(c.passed)}
        for c in section.checks
    ]
    table = [{key: _short(value) for key, value in row.items()} for row in section.table]
    results[name] = {**asdict(section), "checks": checks, "table": table, "made": made()}
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


def made() -> str:
    """Day, machine and versions, for a section that was just measured."""
    names = ", ".join(f"{name} {version}" for name, version in versions().items())
    return f"{date.today().isoformat()}, {os.cpu_count()} cores ({processor()}), {names}"


def write_report(
    order: Iterable[str],
    path: Path = FOLDER / "report.md",
    *,
    title: str = "Validation",
    command: str = "make validate",
) -> None:
    """A report from the results.json beside it, sections in the given order. `command` writes it."""
    results = json.loads((path.parent / RESULTS).read_text(encoding="utf-8"))
    parts = [f"# {title}", "", f"Written by `{command}`; figures in results.json. {LIMITS}", ""]
    for name in order:
        if name in results:
            parts += _section(results[name])
    path.write_text("\n".join(parts), encoding="utf-8")


def summary(section: Section) -> str:
    """The section's figures as lines for the terminal."""
    lines = [
        f"{'ok  ' if c.passed else 'FAIL'} {c.what}: {c.measured:.4g} {c.unit} (limit {c.asked})"
        for c in section.checks
    ]
    return "\n".join(lines)


def _section(result: Mapping[str, Any]) -> list[str]:
    checks = [
        {
            "check": c["what"],
            "limit": c["limit"],
            "measured": f"{c['measured']} {c['unit']}".strip(),
            "": "pass" if c["passed"] else "**FAIL**",
        }
        for c in result["checks"]
    ]
    parts = [f"## {result['title']}", "", *_table(checks), ""]
    if "made" in result:
        parts += [f"Made {result['made']}; random draws have fixed seeds.", ""]
    if result["note"]:
        parts += [result["note"], ""]
    if result["table"]:
        parts += [*_table(result["table"]), ""]
    for chart in result["charts"]:
        parts += [f"![{chart.removesuffix('.png').replace('_', ' ')}]({chart})", ""]
    return parts


def _table(rows: list[dict[str, Any]]) -> list[str]:
    if not rows:
        return []
    head = list(rows[0])
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return lines + ["| " + " | ".join(str(row[key]) for key in head) + " |" for row in rows]


def _short(value: Any) -> Any:
    """Numbers to four significant figures."""
    if isinstance(value, str | bool | int):
        return value
    return float(f"{float(value):.4g}")
