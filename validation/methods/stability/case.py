"""One case of the stability suite: a common method that fails, beside what the package does with the same."""

from __future__ import annotations

from dataclasses import dataclass, field

from validation.report import Check


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """Two methods on one problem, each with its error."""

    name: str
    failing: str
    """The common method."""
    failing_error: float
    fails_by: float
    """Less than that, and the case proves nothing."""
    ours: str
    error: float
    limit: float
    """Our error may reach it."""
    unit: str
    failing_unit: str = ""
    """Of the other's error, where it is not the same."""

    @property
    def checks(self) -> list[Check]:
        """That the one fails, and that the other holds."""
        return [
            Check(
                what=f"{self.name}: {self.failing}, fails by",
                measured=self.failing_error,
                limit=self.fails_by,
                unit=self.failing_unit or self.unit,
                at_least=True,
            ),
            Check(what=f"{self.name}: {self.ours}", measured=self.error, limit=self.limit, unit=self.unit),
        ]

    @property
    def row(self) -> dict[str, object]:
        """Of the report's table."""
        fails, holds = self.checks
        verdict = "holds" if holds.passed else "**fails**"
        return {
            "case": self.name,
            "failing method": self.failing,
            "its error": f"{self.failing_error:.3g} {self.failing_unit or self.unit}",
            "ours": self.ours,
            "our error": f"{self.error:.3g} {self.unit}",
            "limit": f"{self.limit:g} {self.unit}",
            "verdict": verdict if fails.passed else f"{verdict}, and so does the other",
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Theme:
    """Cases that belong together, and their pictures."""

    cases: list[Case]
    charts: list[str] = field(default_factory=list)
