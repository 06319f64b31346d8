"""The whole report: what it writes, that it says its verdict, and that it repeats to the byte."""

import hashlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from reports.figures.plots import Saved
from reports.page import page
from reports.page.build import build
from reports.tables import verdict

Row = dict[str, Any]
Pictured = tuple[list[Row], Path]


def digests(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_everything_is_written(built: Path) -> None:
    names = set(digests(built.parent))
    assert built.name == "report.html"
    assert {"report.md", "rows.json", "tables/table-1-rover.tex"} <= names
    for stem in ("sfm", "attention", "comparison-rover", "errors-rover", "trade-off", "curves"):
        assert {f"figures/figure-{stem}.png", f"figures/figure-{stem}.pdf"} <= names


def test_the_same_rows_in_any_order_by_any_number_of_processes_give_the_same_bytes(
    built: Path, pictured: Pictured, tmp_path: Path
) -> None:
    rows, root = pictured
    again = build(
        rows[::-1], tmp_path, title="Toy <benchmark>", artifacts_root=root, summary={"CPU": "one"},
        processes=2,
    )  # fmt: skip
    assert digests(again.parent) == digests(built.parent)


def test_the_page_needs_nothing_from_outside(built: Path) -> None:
    text = built.read_text(encoding="utf-8")
    assert "Toy &lt;benchmark&gt;" in text
    assert not re.search(r'(?:src|href)="(?!data:|#)', text)
    assert not re.search(r"url\((?!data:)", text)
    assert "default-src 'none'" in text


def test_figures_with_photos_shrink_together_to_their_budget(
    built: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = [
        Saved(stem, "", built.parent / "figures" / stem, pictorial=photos)
        for stem, photos in (
            ("figure-comparison-rover", True), ("figure-errors-rover", True),
            ("figure-curves", False),
        )
    ]  # fmt: skip

    def inlined() -> tuple[list[int], list[int], str]:
        text = page.render(title="", summary="", facts={}, verdicts=[], tables=[], figures=drawn,
                           captures=[], problems=[])  # fmt: skip
        found = re.findall(r'src="(data:image/[^"]*)" width="(\d+)"', text)
        return [len(uri) for uri, _ in found], [int(width) for _, width in found], text

    sizes, widths, text = inlined()
    assert "of their size" not in text
    budget = sum(sizes[:2]) // 4
    monkeypatch.setattr(page, "PHOTO_FIGURES", budget)
    smaller, narrower, text = inlined()
    assert budget / 2 < sum(smaller[:2]) <= budget
    share = narrower[0] / widths[0]
    assert narrower[1] / widths[1] == pytest.approx(share, abs=0.01)
    assert (smaller[2], narrower[2]) == (sizes[2], widths[2]), "plots stay as they are"
    assert f"shown at {share * 100:.0f} % of their size" in text


def test_numbers_stay_with_their_units() -> None:
    render = page._unbroken
    assert render("a 28 % smaller file, 0.5 dB and 320 px") == (
        "a 28\u00a0% smaller file, 0.5\u00a0dB and 320\u00a0px"
    )
    assert render("size × 0.72, Rover 3 of 4") == "size ×\u00a00.72, Rover 3 of 4"
    assert render("`lpips` is <none>") == "<code>lpips</code> is &lt;none&gt;"


def test_the_verdict_comes_first(built: Path) -> None:
    text = built.read_text(encoding="utf-8")
    assert text.index("Rover: without its background, Ours gains") < text.index("<table")
    markdown = (built.parent / "report.md").read_text(encoding="utf-8")
    assert markdown.index("## Verdict") < markdown.index("## Tables")


def test_rows_without_artifacts_still_make_a_report(
    make_grid: Callable[..., list[Row]], make_failed: Callable[..., Row], tmp_path: Path
) -> None:
    rows = [*make_grid(captures=("rover",))[:3], make_failed("rover", "nobg", "ours", "killed")]
    path = build(rows, tmp_path, title="No pictures", artifacts_root=None)
    text = path.read_text(encoding="utf-8")
    assert "no stored renders" in text
    assert "killed" in text
    assert json.loads((tmp_path / "rows.json").read_text())[0]["capture"] == "rover"


def test_nothing_but_failures_is_still_a_report(
    make_failed: Callable[..., Row], tmp_path: Path
) -> None:
    rows = [make_failed("rover", "nobg", "ours", "no views registered")]
    text = build(rows, tmp_path, title="Nothing", artifacts_root=None).read_text("utf-8")
    assert "Rover: no condition finished." in text
    assert "0 of 1 experiments finished" in text


def test_a_capture_in_doubt_is_warned_of_at_the_top_and_gets_no_verdict(
    make_row: Callable[..., Row], tmp_path: Path
) -> None:
    told = [{"about": "masks", "text": "masks contradict each other", "serious": True}]
    rows = [
        make_row(capture, "nobg", method, warnings=told if capture == "rover" else [])
        for capture in ("rover", "hexapod")
        for method in ("3dgs", "ours")
    ]
    page = build(rows, tmp_path, title="Toy", artifacts_root=None)
    words = (tmp_path / "report.md").read_text(encoding="utf-8")
    sentence = "Rover: masks contradict each other. No verdict is given for it."
    assert words.index(sentence) < words.index("## Verdict")
    assert "Rover: no verdict. Its masks are in doubt: see the warnings." in words
    text = page.read_text(encoding="utf-8")
    assert text.index(sentence) < text.index('id="verdict"')
    # one capture is left, and one is not enough for a sentence over all
    assert verdict.overall(rows) is None
    doubted, hexapod = verdict.verdicts(rows)
    assert doubted.details == ()
    assert hexapod.headline.startswith("Hexapod: without")


def test_a_mere_note_leaves_the_verdict(make_row: Callable[..., Row], tmp_path: Path) -> None:
    note = [{"about": "masks", "text": "no object was found in a.jpg", "serious": False}]
    rows = [make_row("rover", "nobg", method, warnings=note) for method in ("3dgs", "ours")]
    build(rows, tmp_path, title="Toy", artifacts_root=None)
    words = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "- **Rover: no object was found in a.jpg.**" in words
    assert "no verdict" not in words


def test_each_capture_has_a_sheet_of_its_masks(built: Path) -> None:
    assert (built.parent / "figures" / "figure-masks-rover.png").is_file()
    text = built.read_text(encoding="utf-8")
    assert "Outlines of the masks, all photos;" in text
