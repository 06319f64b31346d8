"""What a gate finds: verdicts on numbers, and the exit codes that they lead to. Data only."""

from dataclasses import dataclass
from enum import StrEnum

from reports.rows.statistics import Interval

ALL_CELLS = "all cells"


class Verdict(StrEnum):
    """What the gate says about one number."""

    BETTER = "better"
    SAME = "same"
    WORSE = "worse"
    NOT_COMPARABLE = "not comparable"
    NEWLY_FAILING = "newly failing"
    FIXED = "fixed"
    INCONCLUSIVE = "inconclusive"


class Exit:
    """Exit codes of ``mattgs gate``."""

    PASS, REGRESSION, CANNOT_JUDGE, FAILED_RUNS = 0, 1, 2, 3


@dataclass(frozen=True)
class Finding:
    """One verdict.

    ``change`` is signed so that positive is better: a difference in the metric's unit, or for
    ratios a share (0.1: 10 % better). ``worst_view`` is the view that lost most. ``excused``: it is
    told, and does not change the exit code.
    """

    cell: str
    aspect: str
    metric: str
    verdict: Verdict
    reason: str = ""
    before: float | None = None
    after: float | None = None
    change: Interval | None = None
    margin: float = 0.0
    worst_view: str | None = None
    excused: bool = False

    @property
    def severity(self) -> float:
        """Change in margins, for sorting: the most negative is the worst."""
        if self.change is None:
            return 0.0
        return self.change.mean / self.margin if self.margin else self.change.mean * 1e3


@dataclass(frozen=True)
class GateReport:
    """All findings, the worst first, and what the process should exit with."""

    findings: tuple[Finding, ...]
    exit_code: int

    def count(self, verdict: Verdict) -> int:
        """How many findings have a verdict."""
        return sum(finding.verdict == verdict for finding in self.findings)
