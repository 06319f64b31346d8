"""What the registry keeps of a gate: verdicts by run, those of the run's own cell first."""

from collections.abc import Sequence
from typing import Any

import pytest

from reports.gate.findings import ALL_CELLS, Finding, GateReport, Verdict
from reports.history.marks import verdicts_by_run

OWN, OTHER = "rover/nobg-ours@100x64", "rover/nobg-3dgs@100x64"
WORSE, SAME = Verdict.WORSE, Verdict.SAME
UNCERTAIN = Verdict.INCONCLUSIVE


@pytest.mark.parametrize(
    ("findings", "expected"),
    [
        ([(OWN, WORSE)], {"psnr": "worse"}),
        ([(OWN, SAME)], {}),
        ([(OTHER, WORSE)], {}),
        ([(OWN, SAME), (ALL_CELLS, WORSE)], {"psnr": "worse"}),
        ([(OWN, UNCERTAIN), (ALL_CELLS, WORSE)], {"psnr": "worse"}),
        ([(OWN, Verdict.BETTER), (ALL_CELLS, WORSE)], {"psnr": "better"}),
    ],
)
def test_a_run_gets_what_was_said_of_its_cell_and_of_all(
    findings: Sequence[tuple[str, Verdict]], expected: dict[str, str]
) -> None:
    found = tuple(Finding(cell, "quality", "psnr", verdict) for cell, verdict in findings)
    row: dict[str, Any] = {"capture": "rover", "background": "nobg", "method": "ours"}
    row |= {"iterations": 100, "resolution": 64, "run_id": "r"}
    assert verdicts_by_run(GateReport(found, 0), [row]) == {"r": expected}
    assert verdicts_by_run(GateReport(found, 0), [row | {"run_id": None}]) == {}
