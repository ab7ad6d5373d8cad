"""One case of the stability suite: a common method that fails, beside what the package does with the same."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from validation.report import Check


@dataclass(frozen=True, slots=True)
class Case:
    """Two methods on one problem, each by its name with its error."""

    name: str
    fails: Check
    """The common method; where its error is less than that limit, the case proves nothing."""
    holds: Check
    """Ours."""

    @property
    def checks(self) -> list[Check]:
        """That the one fails, and that the other holds."""
        fails, holds = self.fails, self.holds
        return [
            replace(fails, what=f"{self.name}: {fails.what}, fails by"),
            replace(holds, what=f"{self.name}: {holds.what}"),
        ]

    @property
    def row(self) -> dict[str, object]:
        """Of the report's table."""
        fails, holds = self.fails, self.holds
        verdict = "holds" if holds.passed else "**fails**"
        return {
            "case": self.name,
            "failing method": fails.what,
            "its error": f"{fails.measured:.3g} {fails.unit}",
            "ours": holds.what,
            "our error": f"{holds.measured:.3g} {holds.unit}",
            "limit": f"{holds.limit:g} {holds.unit}",
            "verdict": verdict if fails.passed else f"{verdict}, and so does the other",
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Theme:
    """Cases that belong together, and their pictures."""

    cases: list[Case]
    charts: list[str] = field(default_factory=list)
