"""What a gate finds: verdicts on numbers, and the exit codes that they lead to. Data only."""

from dataclasses import dataclass
from enum import StrEnum
from math import isfinite

from reports.rows.statistics import Interval

ALL_CELLS = "all cells"


class Verdict(StrEnum):
    """What the gate says about one number."""

    BETTER = "better"
    SAME = "same"
    WORSE = "worse"
    NOT_COMPARABLE = "not comparable"
    NEWLY_FAILING = "newly failing"
    STILL_FAILING = "still failing"
    FIXED = "fixed"
    INCONCLUSIVE = "inconclusive"


class Exit:
    """Exit codes of ``mattgs gate``."""

    PASS, REGRESSION, CANNOT_JUDGE, FAILED_RUNS = 0, 1, 2, 3


@dataclass(frozen=True)
class Finding:
    """One verdict.

    ``change`` is signed so that positive is better: a difference in the metric's unit, or for
    ratios a share (0.1: 10 % better). ``worst_view`` is the view that lost most. ``excused``:
    it is printed, and does not change the exit code.
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
class Sensitivity:
    """Which planted losses were named; ``alarms``: what was called worse with nothing planted."""

    named: tuple[str, ...]
    missed: tuple[str, ...]
    alarms: tuple[str, ...]

    @property
    def complete(self) -> bool:
        """Whether every loss was named, and nothing was called worse without one."""
        return not self.missed and not self.alarms

    def __str__(self) -> str:
        total = len(self.named) + len(self.missed)
        parts = [f"Planted into the baseline's own rows: {len(self.named)} of {total} losses named"]
        parts += [f"not named: {', '.join(self.missed)}"] if self.missed else []
        parts += [f"called worse without a loss: {', '.join(self.alarms)}"] if self.alarms else []
        return "; ".join(parts) + "."


@dataclass(frozen=True)
class GateReport:
    """All findings, the worst first, and what the process should exit with.

    ``planted`` says which of the losses planted into its baseline the gate named; None where none
    were planted.
    """

    findings: tuple[Finding, ...]
    exit_code: int
    planted: Sensitivity | None = None

    def smallest_named(self) -> dict[str, float]:
        """Return, by metric, the smallest loss in all cells that would have been called worse.

        A difference in the metric's unit, or a share; of metrics that were judged over all cells.
        """
        return {
            f.metric: f.margin + f.change.half
            for f in self.findings
            if f.cell == ALL_CELLS and f.change is not None and isfinite(f.change.half)
        }

    def count(self, verdict: Verdict) -> int:
        """How many findings have a verdict."""
        return sum(finding.verdict == verdict for finding in self.findings)
