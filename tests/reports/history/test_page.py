"""The page of a history: every metric of every cell, steps and verdicts, and no request."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from reports.history.page import build
from tests.reports.chromium import NEEDED, Page, chromium
from tests.reports.history.conftest import make_run

Run = dict[str, Any]
History = Callable[..., list[Run]]
SAID = {"baseline": "quick-ci", "verdicts": {"psnr": "worse"}}


@pytest.fixture
def runs(history_of: History) -> list[Run]:
    """Return runs of two cells, one with a loss at commit 6 that the gate named."""
    lost = history_of([24.0] * 6 + [23.5] * 4)
    lost[6] |= {"gate": SAID}
    same = history_of([24.0] * 10, capture="hexapod")
    same[3] |= {"status": "failed", "metrics": {}}
    return [*lost, *same]


def charts(html: str) -> list[ElementTree.Element]:
    parts = html.split("<figure")[1:]
    return [ElementTree.fromstring(p[p.index("<svg") : p.index("</svg>") + 6]) for p in parts]


def test_the_page_names_steps_and_draws_every_metric(runs: list[Run], tmp_path: Path) -> None:
    built = build(runs, tmp_path, title="History of <quick>")
    html = built.page.read_text(encoding="utf-8")
    assert "History of &lt;quick&gt;" in html
    assert built.summary == "20 runs of 2 cells on 10 commits; 1 step."
    assert "rover/nobg-ours@100x64" in html
    assert "<code>00000006</code>" in html
    assert "http" not in html.replace("http-equiv", ""), "nothing is fetched"
    one, other = charts(html)
    assert len(one.findall(".//circle")) == 10
    assert len(other.findall(".//circle")) == 9, "the failed run stands as a cross"
    assert len(other.findall(".//path[@class='failed']")) == 1
    assert len(one.findall(".//path[@class='step loss']")) == 1
    assert len(one.findall(".//path[@class='level']")) == 2
    (mark,) = one.findall(".//path[@class='worse']")
    titles = [element.text or "" for element in one.findall(".//title")]
    assert mark is not None
    assert any("00000006" in t and "gate: worse than quick-ci" in t for t in titles)
    assert any("step at 00000006: 24.00 → 23.50" in t for t in titles)


def test_the_numbers_lie_beside_the_page(runs: list[Run], tmp_path: Path) -> None:
    build(runs, tmp_path, title="History")
    one = json.loads((tmp_path / "history.json").read_text(encoding="utf-8"))[0]
    assert (one["cell"], one["metric"]) == ("rover/nobg-ours@100x64", "psnr")
    assert [point["value"] for point in one["points"]] == [24.0] * 6 + [23.5] * 4
    assert one["points"][6]["gate"] == "worse"
    assert one["steps"] == [{"after": 23.5, "before": 24.0, "first": 6}]


def test_the_same_runs_give_the_same_bytes(runs: list[Run], tmp_path: Path) -> None:
    pages = [build(runs, tmp_path / name, title="H").page.read_bytes() for name in ("a", "b")]
    assert pages[0] == pages[1]


@pytest.mark.parametrize("value", [24.0, 0.0, -1.0])
def test_one_run_has_a_page_too(value: float, tmp_path: Path) -> None:
    built = build([make_run(0, {"psnr": value})], tmp_path, title="History")
    (chart,) = charts(built.page.read_text(encoding="utf-8"))
    (circle,) = chart.findall(".//circle")
    assert 0 < float(circle.attrib["cy"]) < 120
    assert built.summary == "1 run of 1 cell on 1 commit; no steps."


def test_points_keep_inside_the_chart(history_of: History, tmp_path: Path) -> None:
    built = build(history_of([1e-3, 5.0, 1e4, 2.0]), tmp_path, title="History")
    (chart,) = charts(built.page.read_text(encoding="utf-8"))
    for circle in chart.findall(".//circle"):
        assert 52 <= float(circle.attrib["cx"]) <= 290
        assert 10 <= float(circle.attrib["cy"]) <= 100


class TestInBrowser:
    """The page in headless Chromium; skipped, with the reason, where there is none."""

    pytestmark = NEEDED

    @pytest.mark.parametrize("width", [1280, 390])
    def test_it_opens_without_errors_and_keeps_to_the_width(
        self, runs: list[Run], tmp_path: Path, width: int
    ) -> None:
        built = build(runs, tmp_path, title="History")
        with chromium() as address:
            page = Page(address)
            page.open(built.page, width, 900)
            assert page.value("document.documentElement.scrollWidth") <= width
            assert page.value("document.querySelectorAll('figure svg').length") == 2
            assert len(page.shot()) > 0
            assert not page.errors()
