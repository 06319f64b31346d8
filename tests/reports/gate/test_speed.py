"""Speeds: relative to the workload of their own process, and compared on one machine only."""

import json
from collections.abc import Callable
from copy import deepcopy

import jsonschema
import pytest

from reports.gate import output, planted, speed
from reports.gate.compare import compare
from reports.gate.findings import ALL_CELLS, Exit, Verdict
from reports.gate.tolerances import Doubt
from reports.rows.schema import Row
from tests.reports.gate.conftest import SCHEMA, Rows, changed, found


def test_speed_is_relative_to_the_workload_of_its_own_process(make_row: Callable[..., Row]) -> None:
    row = make_row("rover", "nobg", "3dgs")
    assert speed.calibrated(row, "time") == {"0": 42.0 / 0.5}
    assert speed.calibrated(row, "fps") == {"0": 59.0 * 0.5}
    row["metrics"]["fps_calibrated"] = 7.0
    assert speed.calibrated(row, "fps") == {"0": 7.0}
    row["repeats"] = {"fps": [{"value": 60.0, "calibration": 0.5}, {"value": 30, "calibration": 1}]}
    assert speed.calibrated(row, "fps") == {"0": 30.0, "1": 30.0}


@pytest.mark.parametrize("value", [None, 0, -1.0, "fast"])
def test_a_speed_that_is_none_has_no_calibrated_value(
    make_row: Callable[..., Row], value: object
) -> None:
    row = make_row("rover", "nobg", "3dgs")
    row["metrics"]["time"] = value
    assert speed.calibrated(row, "time") == {}
    laps = [{"value": 2.0, "calibration": 0.5}, {"value": value, "calibration": 0.5}]
    assert speed.calibrated(row | {"repeats": {"time": laps}}, "time") == {}


@pytest.mark.parametrize("calibration", [None, 0, 0.0, -0.5, "fast", {}, {"seconds": 0}])
def test_without_a_workload_that_took_time_there_is_no_calibrated_value(
    make_row: Callable[..., Row], calibration: object
) -> None:
    row = make_row("rover", "nobg", "3dgs")
    row["provenance"]["calibration"] = calibration
    assert speed.calibrated(row, "time") == speed.calibrated(row, "fps") == {}
    laps = [{"value": 2.0, "calibration": 0.5}, {"value": 2.0, "calibration": calibration}]
    assert speed.calibrated(row | {"repeats": {"time": laps}}, "time") == {}


@pytest.mark.parametrize("field", ["cpu", "cores", "threads", "cpu_kind", "workload"])
def test_speed_of_another_machine_is_not_compared_and_excused(old: Rows, field: str) -> None:
    def move(row: Row) -> None:
        row["provenance"][field] = "other"
        row["metrics"]["time"] *= 5

    report = compare(changed(old, move), old)
    assert found(report, Verdict.NOT_COMPARABLE) == {(ALL_CELLS, "time"), (ALL_CELLS, "fps")}
    assert report.exit_code == Exit.PASS
    assert compare(changed(old, move), old, doubt=Doubt.ALL).exit_code == Exit.CANNOT_JUDGE
    assert f"another machine ({field}: baseline" in output.terminal(report)
    jsonschema.validate(json.loads(output.to_json(report)), json.loads(SCHEMA.read_text()))
    assert 'errors="1"' not in output.junit(report)


def test_each_speed_is_of_the_machine_that_it_was_measured_on(old: Rows) -> None:
    """Trained on one machine, rendered on another: only the rendering is not comparable."""

    def measure_elsewhere(row: Row) -> None:
        row["provenance"]["measured"] = {"cpu": "Another CPU", "threads": 1}

    report = compare(changed(old, measure_elsewhere), old)
    assert found(report, Verdict.NOT_COMPARABLE) == {(ALL_CELLS, "fps")}

    def time_elsewhere(row: Row) -> None:
        row["provenance"]["timed"] = {"cpu": "Another CPU", "threads": 1}

    report = compare(changed(old, time_elsewhere), old)
    assert found(report, Verdict.NOT_COMPARABLE) == {(ALL_CELLS, "time")}


def test_an_unknown_machine_is_not_the_same_one(old: Rows) -> None:
    def forget(row: Row) -> None:
        del row["provenance"]["cpu"]

    unknown = changed(old, forget)
    assert (ALL_CELLS, "fps") in found(compare(unknown, unknown), Verdict.NOT_COMPARABLE)


def test_one_disturbed_lap_is_no_slower_training(old: Rows) -> None:
    def with_laps(row: Row) -> None:
        laps = [{"value": 1.0 + 0.1 * k, "calibration": 0.05} for k in range(8)]
        row["repeats"] = {"time": laps}

    before = changed(old, with_laps)
    after = deepcopy(before)
    for row in after:
        row["repeats"]["time"][3]["value"] *= 4
    assert (ALL_CELLS, "time") in found(compare(after, before), Verdict.SAME)
    slower = [planted.lose_speed(row) for row in after]
    assert (ALL_CELLS, "time") in found(compare(slower, before), Verdict.WORSE)
