"""What a gate's report says of each run, in the form that the registry keeps for the history."""

from collections.abc import Sequence

from reports.gate.findings import ALL_CELLS, Finding, GateReport, Verdict
from reports.gate.output import worth_reading
from reports.rows.schema import Row, key_of

CERTAIN = (Verdict.WORSE, Verdict.BETTER, Verdict.NEWLY_FAILING)


def verdicts_by_run(report: GateReport, rows: Sequence[Row]) -> dict[str, dict[str, str]]:
    """Return, by run id, the verdict of each metric that is not the same.

    A verdict on the run's own cell comes before one over all cells; certain ones come before
    doubtful ones.
    """
    shown = worth_reading(report)
    general = _verdicts([f for f in shown if f.cell == ALL_CELLS])
    out = {}
    for row in rows:
        if row.get("run_id"):
            cell = str(key_of(row))
            own = _verdicts([f for f in shown if f.cell == cell])
            certain = {metric: said for metric, said in own.items() if said in CERTAIN}
            out[str(row["run_id"])] = own | general | certain
    return out


def _verdicts(findings: Sequence[Finding]) -> dict[str, str]:
    return {finding.metric: str(finding.verdict) for finding in findings}
