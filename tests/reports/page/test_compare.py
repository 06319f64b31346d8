"""Two runs side by side: what is marked, what is withheld, and what a reader is told."""

from pathlib import Path

import pytest

from reports.page import compare
from reports.page.compare import Side
from reports.rows.schema import Row
from reports.tables.formats import Table
from tests.reports.conftest import cell_row

DOUBT = {"about": "masks", "text": "masks fill the frame", "serious": True}


def sides(background: str = "nobg", **other: object) -> tuple[Side, Side]:
    """Return 3DGS and an `ours` that is worse on every view, takes half the time and is smaller."""
    first, second = cell_row("rover", "nobg", "3dgs"), cell_row("rover", background, "ours")
    views = [view | {"mask_psnr": view["mask_psnr"] - 0.5} for view in first["per_view"]]
    lower = {"cc_psnr": 20.0, "psnr": 20.0, "mask_psnr": 19.0, "time": 21.0, "size_mb": 1.0}
    first["metrics"] |= {"cc_psnr": 25.0, "time": 42.0, "size_mb": 2.0}
    second = second | {"per_view": views, "metrics": second["metrics"] | lower} | other
    return Side(first, None, {}), Side(second, None, {})


def marked(table: Table) -> dict[str, str]:
    """Return which of the two is marked, by the score's label."""
    lines = [line for group in table.groups for line in group.lines]
    return {
        line.label.rstrip("↑↓"): "A" * line.entries[0].best + "B" * line.entries[1].best
        for line in lines
    }


def test_the_sentence_has_true_minuses(tmp_path: Path) -> None:
    tables, headline, page = compare.compare(*sides(), tmp_path)
    assert headline.startswith("B is −0.50 dB from A in PSNR inside the mask, better on 0 of 6")
    assert "(95 % interval −0.50 to −0.50 dB)" in headline
    text = page.read_text(encoding="utf-8")
    for absent in ("beside this page", 'id="warnings"', "not to be trusted"):
        assert absent not in text, absent
    assert marked(tables[0])["Time"] == "B"


def test_a_section_without_content_is_left_out() -> None:
    from reports.page import page

    text = page.render(title="", summary="", facts={}, verdicts=[], tables=[], figures=[],
                       captures=[], problems=[])  # fmt: skip
    assert 'id="runs"' not in text
    assert 'href="#runs"' not in text


def test_a_capture_in_doubt_gets_no_sentence_and_its_warning(tmp_path: Path) -> None:
    tables, headline, page = compare.compare(*sides(warnings=[DOUBT]), tmp_path)
    assert headline == "Rover: no verdict. Its masks are in doubt: see the warnings."
    warning = "Rover: masks fill the frame. No verdict is given for it."
    assert warning in tables[0].notes, "a terminal shows the tables"
    text = page.read_text(encoding="utf-8")
    assert text.index(warning) < text.index('id="verdict"')


def test_full_frames_of_two_backgrounds_are_not_judged() -> None:
    table = compare.scores(*sides("original"))
    found = marked(table)
    assert (found["PSNR"], found["PSNR colour-corrected"], found["SSIM in mask"]) == ("", "", "")
    assert (found["PSNR in mask"], found["Size(MB)"], found["Time"]) == ("A", "B", "B")
    frame, mask = (tuple(line.label for line in group.lines) for group in table.groups)
    assert "PSNR colour-corrected↑" in frame
    assert "PSNR colour-corrected↑" not in mask


def test_notes_name_the_two_as_the_page_does_and_photos_as_they_are_called() -> None:
    first, second = sides()
    leaked = second.row["per_view"][0]
    leaked["view"] = "baseline-3.jpg"
    second.row["trained_on"] = ["baseline-3.jpg"]
    second.row["protocol"] = 99
    told = compare.notes(first, second)
    assert told[0] == "B: held-out views were trained on: baseline-3.jpg"
    assert any(text.startswith("protocol: A ") and text.endswith(", B 99") for text in told)
    assert any("other held-out views: baseline-3.jpg" in text for text in told)


@pytest.mark.parametrize("metrics", [{}, {"time_cpu": 12.0}])
def test_times_of_trainings_that_waited_are_not_judged(metrics: dict[str, float]) -> None:
    first, second = sides()
    rows: list[Row] = [side.row for side in (first, second)]
    for row in rows:
        row["metrics"] |= metrics
    rows[1]["metrics"] |= dict.fromkeys(metrics, 6.0)
    table = compare.scores(first, second)
    told = any("Time is not to be trusted here" in note for note in table.notes)
    assert told == bool(metrics)
    assert marked(table)["Time"] == ("" if metrics else "B")
    assert marked(table).get("CPU time", "B") == "B"


def test_times_of_two_machines_are_not_judged() -> None:
    first, second = sides()
    second.row["provenance"] = second.row["provenance"] | {"cpu": "Another CPU"}
    table = compare.scores(first, second)
    assert (marked(table)["Time"], marked(table)["FPS"]) == ("", "")
    assert "Times and FPS are of different machines and do not compare." in table.notes
