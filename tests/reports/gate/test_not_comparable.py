"""What cannot be compared is never called the same."""

import math
from collections.abc import Callable
from copy import deepcopy

import pytest

from reports.gate.compare import compare
from reports.gate.findings import Exit, Verdict
from reports.rows.schema import Row
from tests.reports.gate.conftest import Rows, found, poison


def forget(row: Row) -> None:
    del row["metrics"]["size_mb"]


def one_view_lacks(row: Row) -> None:
    del row["per_view"][0]["mask_psnr"]


def infinite_view(row: Row) -> None:
    row["per_view"][0]["psnr"] = math.inf


def without_calibration(row: Row) -> None:
    row["provenance"]["calibration"] = None


def other_protocol(row: Row) -> None:
    row["provenance"]["protocol"] = 2


def other_config(row: Row) -> None:
    row["provenance"]["config_digest"] = "other"


def other_inputs(row: Row) -> None:
    row["provenance"]["inputs"] = {"capture": "d2"}


def other_views(row: Row) -> None:
    row["per_view"] = row["per_view"][1:]


@pytest.mark.parametrize(
    ("change", "verdict", "code"),
    [
        (poison, Verdict.NEWLY_FAILING, Exit.FAILED_RUNS),
        (forget, Verdict.NEWLY_FAILING, Exit.FAILED_RUNS),
        (one_view_lacks, Verdict.NOT_COMPARABLE, Exit.CANNOT_JUDGE),
        (infinite_view, Verdict.NOT_COMPARABLE, Exit.CANNOT_JUDGE),
        (without_calibration, Verdict.NOT_COMPARABLE, Exit.CANNOT_JUDGE),
        (other_protocol, Verdict.NOT_COMPARABLE, Exit.CANNOT_JUDGE),
        (other_config, Verdict.NOT_COMPARABLE, Exit.CANNOT_JUDGE),
        (other_inputs, Verdict.NOT_COMPARABLE, Exit.CANNOT_JUDGE),
        (other_views, Verdict.NOT_COMPARABLE, Exit.CANNOT_JUDGE),
    ],
)
def test_what_cannot_be_compared_is_never_the_same(
    old: Rows, change: Callable[[Row], None], verdict: Verdict, code: int
) -> None:
    rows = deepcopy(old)
    change(rows[0])
    report = compare(rows, old)
    cell = "rover/original-3dgs@1000x320"
    assert cell in {name for name, _ in found(report, verdict)}
    assert report.exit_code == code
