"""A page of more captures than a browser keeps WebGL contexts: every 3D view works, nothing fails.

The page is rendered without its figures, which take a drawing of matplotlib each.
"""

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from reports.figures import pictures
from reports.page import page as pages
from reports.rows.schema import cells
from tests.reports.chromium import NEEDED, Page, chromium

Row = dict[str, Any]
pytestmark = NEEDED
CAPTURES = 40  # browsers keep about 16 contexts
# What a page may ask a browser for, counted before its own scripts run; contexts can be taken away
COUNTING = """
window.contexts = [];
const original = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
  const found = original.call(this, kind, ...rest);
  if (kind === "webgl2" && found && !window.contexts.includes(found)) window.contexts.push(found);
  return found;
};
"""
VIEWS = "[...document.querySelectorAll('.orbit canvas')]"
INK = """
(canvas) => {
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let ink = 0;
  for (let i = 0; i < data.length; i += 4) ink += Math.min(data[i], data[i + 1], data[i + 2]) < 240;
  return ink / (canvas.width * canvas.height);
}
"""


@pytest.fixture(scope="module")
def many(pictured: tuple[list[Row], Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a page of one capture under forty names."""
    rows, root = pictured
    found = []
    for number in range(CAPTURES):
        name = f"capture-{number:02d}"
        mine = [copy.deepcopy(row) | {"capture": name} for row in rows]
        found.append(pictures.gallery(name, cells(mine), root))
    text = render(found, root)
    path = tmp_path_factory.mktemp("many") / "report.html"
    path.write_text(text, encoding="utf-8")
    return path


def render(found: list[pictures.Gallery], root: Path) -> str:
    return pages.render(
        title="Many", summary="", facts={}, verdicts=[], tables=[], figures=[],
        captures=pages.shown(found, root),
    )  # fmt: skip


@pytest.fixture(scope="module")
def page(many: Path) -> Iterator[Page]:
    with chromium() as address:
        tab = Page(address)
        tab.send("Page.enable")
        tab.send("Page.addScriptToEvaluateOnNewDocument", source=COUNTING)
        tab.open(many, 1280, 900)
        yield tab


def test_views_wait_until_they_are_near_the_window(page: Page) -> None:
    page.wait(f"Number({VIEWS}[0].dataset.frames) > 0")
    assert page.value(f"{VIEWS}.length") == CAPTURES
    assert page.value(f"{VIEWS}.filter((c) => c.dataset.frames).length") < CAPTURES / 4


def test_every_view_draws_and_keeps_its_picture(page: Page) -> None:
    for place in range(CAPTURES):
        page.value(f"{VIEWS}[{place}].scrollIntoView({{behavior: 'instant', block: 'center'}})")
        page.wait(f"Number({VIEWS}[{place}].dataset.frames) > 0")
    ink = page.value(f"{VIEWS}.map({INK})")
    assert min(ink) > 0.01, "a view that was drawn long ago still shows its object"
    assert page.value("window.contexts.length") == 1
    assert page.value(f"new Set({VIEWS}.map((c) => c.dataset.painter)).size") == 1


def test_a_context_that_the_browser_takes_away_is_made_again(page: Page) -> None:
    page.value("window.contexts[0].getExtension('WEBGL_lose_context').loseContext()")
    page.wait("window.contexts[0].isContextLost()")
    page.value(f"{VIEWS}[0].scrollIntoView({{behavior: 'instant', block: 'center'}})")
    before = page.value(f"{VIEWS}[0].toDataURL()")
    box = page.box(".orbit canvas")
    centre = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.drag(centre, (centre[0] + 120, centre[1]))
    page.wait(f"{VIEWS}[0].toDataURL() !== {before!r}")
    assert page.value(f"({INK})({VIEWS}[0])") > 0.01
    assert page.value("window.contexts.length") == 2


def test_nothing_was_logged_as_an_error(page: Page) -> None:
    """Comes last: judges everything that the tests above did."""
    assert page.errors() == []


def test_what_is_embedded_is_shared_by_all_captures(
    pictured: tuple[list[Row], Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows, root = pictured
    found = [pictures.gallery("rover", cells(rows), root) for _ in range(4)]
    whole = len(render(found, root))
    monkeypatch.setattr(pages, "PIXELS", pages.PIXELS // 10_000)
    fewer_pixels = len(render(found, root))
    monkeypatch.setattr(pages, "SPLATS", 16 * 20)
    fewer_splats = render(found, root)
    assert fewer_pixels < 0.9 * whole
    assert len(fewer_splats) < 0.9 * fewer_pixels
    assert fewer_splats.count('"count":20,') == 16
