"""What the gate prints and writes."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import jsonschema
import pytest
from PIL import Image

from reports.gate import output, pictures
from reports.gate.compare import compare
from reports.gate.findings import ALL_CELLS, Finding, Verdict
from reports.rows import statistics
from reports.rows.schema import Row
from tests.reports.gate.conftest import SCHEMA, Rows, changed, poison, shift_views


def test_json_follows_its_schema(old: Rows) -> None:
    for rows in (old, old[4:], changed(old, poison)):
        document = json.loads(output.to_json(compare(rows, old)))
        jsonschema.validate(document, json.loads(SCHEMA.read_text()))


def test_junit_counts_what_it_holds(old: Rows) -> None:
    rows = changed(old, lambda row: shift_views(row, psnr=-2.0))
    root = ElementTree.fromstring(output.junit(compare(rows, old)))
    assert len(root) == 13
    for suite in root:
        assert int(suite.get("tests", 0)) == len(suite.findall("testcase"))
        assert int(suite.get("failures", 0)) == len(suite.findall("testcase/failure")) >= 1
    first = root[0].find("testcase/failure")
    assert root[0].get("name") == ALL_CELLS
    assert first is not None
    assert "worse" in str(first.get("message"))


def test_people_read_the_worst_first(old: Rows) -> None:
    rows = changed(old, lambda row: shift_views(row, psnr=-0.5))
    rows[3]["per_view"][2]["psnr"] -= 0.8
    shift_views(rows[3], psnr=-3.0)
    report = compare(rows, old)
    assert report.findings[0].worst_view == "0016.jpg"
    text = output.terminal(report)
    assert text.startswith("Gate: regression.")
    assert "rover/nobg-ours" in text.splitlines()[4]
    assert max(map(len, text.splitlines())) <= 110
    summary = output.markdown(report, [("View 0016.jpg", "worst.png")])
    assert "**worse**" in summary
    assert "![View 0016.jpg](worst.png)" in summary


def test_a_quiet_gate_says_how_well_it_sees_and_no_more(old: Rows) -> None:
    first, second = output.terminal(compare(old, old)).splitlines()
    assert first.startswith("Gate: pass.")
    assert second.startswith("A loss in all cells would be named from: PSNR 0.10 dB, ")


def test_a_finding_tells_what_each_side_had_in_a_cell_and_on_average(old: Rows) -> None:
    def rows(loss: float) -> Rows:
        out = [row | {"per_view": [dict(view) for view in row["per_view"]]} for row in old]
        for place, row in enumerate(out):
            for view, part in zip(row["per_view"], (-1, 1, -2, 2, -3, 3), strict=True):
                view["psnr"] = 20 + place + part - loss
        return out

    findings = json.loads(output.to_json(compare(rows(0.5), rows(0.0))))["findings"]
    told = {f["cell"]: (f["before"], f["after"]) for f in findings if f["metric"] == "psnr"}
    assert told["rover/original-3dgs@1000x320"] == (20, 19.5)
    assert told[ALL_CELLS] == (25.5, 25), "12 cells from 20 to 31"


@pytest.mark.parametrize(
    ("metric", "signed", "plain"),
    [
        ("psnr", (-0.5, -0.7, -0.3), (-0.5, -0.7, -0.3)),
        ("l1", (-0.5, -0.7, -0.3), (0.5, 0.3, 0.7)),
        ("fps", (0.25, 0.0, 0.5), (0.25, 0.0, 0.5)),
        ("size_mb", (-0.2, -0.5, 0.25), (0.25, -0.2, 1.0)),
        ("time", (1.0, -1.0, math.inf), (-0.5, -1.0, math.inf)),
    ],
)
def test_people_read_the_change_from_before_to_after(
    metric: str, signed: tuple[float, ...], plain: tuple[float, ...]
) -> None:
    mean, low, high = signed
    read = output.plain_change(metric, statistics.Interval(mean, low, high, 3))
    assert (read.mean, read.low, read.high) == pytest.approx(plain)


def test_the_change_of_a_cost_is_that_of_its_numbers(old: Rows) -> None:
    def grow(row: Row) -> None:
        row["metrics"] |= {"size_mb": row["metrics"]["size_mb"] * 1.25, "splats": 23400.0}

    report = compare(changed(old, grow), old)
    size = next(f for f in report.findings if (f.metric, f.verdict) == ("size_mb", "worse"))
    assert "change +25.0 %" in output.sentence(size)
    (line,) = (
        line
        for line in output.terminal(report).splitlines()
        if f"{size.cell} " in line and "size_mb" in line
    )
    assert "+25.0 %" in line
    splats = next(f for f in report.findings if f.metric == "splats" and f.after)
    assert "→ 23,400, change" in output.sentence(splats)
    document = json.loads(output.to_json(report))
    (told,) = (
        f for f in document["findings"] if (f["cell"], f["metric"]) == (size.cell, "size_mb")
    )
    assert told["change"] == pytest.approx(-0.2), "for machines positive is better"


def test_a_reason_of_many_lines_stays_in_its_row(
    old: Rows, make_failed: Callable[..., Row]
) -> None:
    why = "2 of 9 photos got a camera:\nimg_003.jpg: 12 key points\nimg_004.jpg: none"
    report = compare([make_failed("rover", "original", "3dgs", why), *old[1:]], old)
    lines = output.markdown(report).splitlines()
    table = [line for line in lines if line.startswith("|")]
    assert len(table) == 2 + len(output.worth_reading(report))
    assert any("camera: img_003.jpg: 12 key points img_004.jpg" in line for line in table)


def test_findings_know_how_bad_they_are() -> None:
    bad = Finding(
        "c", "quality", "psnr", Verdict.WORSE, change=statistics.sample([-0.4, -0.4]), margin=0.1
    )
    assert bad.severity == pytest.approx(-4)


def test_everything_is_written_for_machines_and_people(
    pictured: tuple[Rows, Path], tmp_path: Path
) -> None:
    old, root = pictured
    rows = changed(
        old, lambda row: shift_views(row, psnr=-2.0), lambda row: row["method"] == "ours"
    )
    report = compare(rows, old)
    shown = pictures.draw(report, rows, root, tmp_path, baseline=old, baseline_root=root)
    assert [name for _, name in shown] == ["gate-1.png", "gate-2.png"]
    with Image.open(tmp_path / "gate-1.png") as image:
        assert image.size == (4 * 96 + 3 * pictures.GAP, 72)
    paths = output.write(report, tmp_path, shown)
    assert set(paths) == {"md", "xml", "json"}
    assert "](gate-1.png)" in paths["md"].read_text()
    assert pictures.draw(report, rows, None, tmp_path) == []
