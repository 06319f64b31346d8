"""The report in headless Chromium: no error, no request, and what should react reacts.

Skipped, with the reason, where no Chromium is installed.
"""

import base64
import io
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from reports.page.build import build
from reports.rows.schema import read_rows
from tests.reports.chromium import NEEDED, Page, chromium

pytestmark = NEEDED
PROOF = Path(__file__).parents[3] / "reports" / "results" / "proof-7k"
A4 = 718  # CSS pixels between Chromium's own margins


@pytest.fixture(scope="module")
def browser() -> Iterator[str]:
    with chromium() as address:
        yield address


@pytest.fixture(scope="module")
def page(browser: str, built: Path) -> Page:
    tab = Page(browser)
    tab.open(built, 1280, 900)
    return tab


def test_the_slider_uncovers_the_other_picture(page: Page) -> None:
    box = page.box(".stage")
    middle = box["y"] + box["height"] / 2
    page.drag((box["x"] + box["width"] / 2, middle), (box["x"] + box["width"] * 0.9, middle))
    page.wait("document.querySelector('.slide').value > 850")
    right = page.shot()
    page.drag((box["x"] + box["width"] / 2, middle), (box["x"] + box["width"] * 0.1, middle))
    page.wait("document.querySelector('.slide').value < 150")
    left = page.shot()
    assert np.abs(left - right).max() > 60


def test_the_slider_changes_view_and_method(page: Page) -> None:
    before = page.value("document.querySelector('.over').src")
    page.value(
        "(() => { const s = document.querySelector('select.view'); s.value = '0008.jpg';"
        "s.dispatchEvent(new Event('change')); })()"
    )
    assert page.value("document.querySelector('.over').src") != before
    assert "in mask" in page.value("document.querySelector('.scores').textContent")
    names = page.value("[...document.querySelectorAll('select.left option')].map(o => o.value)")
    assert names[:2] == ["truth-original", "truth-nobg"]
    assert len(names) == 6


def pixels(page: Page, place: int = 0) -> np.ndarray:
    canvas = f"document.querySelectorAll('.orbit canvas')[{place}]"
    data = page.value(f"{canvas}.toDataURL('image/png')")
    with Image.open(io.BytesIO(base64.b64decode(data.split(",")[1]))) as image:
        return np.asarray(image.convert("RGB"), dtype=np.int16)


def drawn(page: Page) -> int:
    return int(page.value("document.querySelector('.orbit canvas').dataset.frames || 0"))


def after(page: Page, frames: int) -> np.ndarray:
    page.wait(f"Number(document.querySelector('.orbit canvas').dataset.frames || 0) > {frames}")
    return pixels(page)


def test_the_3d_view_shows_the_object_and_turns_zooms_and_switches(page: Page) -> None:
    box = page.box(".orbit canvas")
    first = after(page, 0)
    inside = first[(first < 240).any(axis=2)]
    assert 0.01 < len(inside) / first[..., 0].size < 0.8  # something, on white
    assert inside[:, 0].mean() > inside[:, 2].mean() + 20  # and the rover is red
    centre = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    frames = drawn(page)
    page.drag(centre, (centre[0] + 120, centre[1]))
    turned = after(page, frames)
    assert np.abs(turned - first).mean() > 1
    frames = drawn(page)
    page.mouse("mouseWheel", *centre, deltaX=0, deltaY=-600)
    nearer = after(page, frames)
    assert (nearer < 240).any(axis=2).sum() > 1.3 * (turned < 240).any(axis=2).sum()
    frames = drawn(page)
    page.value("document.querySelectorAll('.models button')[0].click()")
    assert np.abs(after(page, frames) - nearer).max() > 40
    assert page.value("document.querySelector('[aria-checked=true]').dataset.id") == "original-3dgs"


def test_what_is_seen_can_be_printed(page: Page) -> None:
    """Printers get a WebGL canvas as black: a view is a plain one that keeps its picture."""
    canvas = "document.querySelector('.orbit canvas')"
    assert page.value(f"{canvas}.dataset.painter") == "webgl2"
    assert page.value(f"{canvas}.getContext('2d') !== null")
    assert (pixels(page) < 240).any(axis=2).mean() > 0.01


def test_the_plain_canvas_takes_over_where_there_is_no_webgl(
    page: Page, built: Path, tmp_path: Path
) -> None:
    text = built.read_text(encoding="utf-8")
    refusing = text.replace('canvas.getContext("webgl2"', 'canvas.getContext("webgl-refused"')
    assert refusing != text
    path = tmp_path / "report.html"
    path.write_text(refusing, encoding="utf-8")
    page.open(path, 1280, 900)
    page.box(".orbit canvas")
    picture = after(page, 0)
    assert page.value("document.querySelector('.orbit canvas').dataset.painter") == "canvas"
    assert (picture < 240).any(axis=2).mean() > 0.01
    page.send("Page.navigate", url="about:blank")


def test_a_phone_scrolls_tables_not_the_page(page: Page, built: Path) -> None:
    page.open(built, 390, 844)
    width = page.value("document.documentElement.scrollWidth")
    assert width <= 390
    assert page.value("document.querySelector('.scroll').scrollWidth") > 390


@pytest.fixture(scope="module")
def proof(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the page of committed rows, whose tables are the widest, with a file's long name."""
    rows = [row for path in sorted(PROOF.glob("*.json")) for row in read_rows(path)]
    out = tmp_path_factory.mktemp("proof")
    notes = [f"no row of {'a_name_without_any_break' * 6}.json is used"]
    return build(rows, out, title="Proof", artifacts_root=None, notes=notes)


def test_paper_and_a_phone_hold_what_is_not_a_table(page: Page, proof: Path) -> None:
    page.open(proof, 390, 844)
    assert page.value("document.documentElement.scrollWidth") <= 390
    page.open(proof, A4, 900)
    page.send("Emulation.setEmulatedMedia", media="print")
    wide = "[...document.querySelectorAll('table')].filter(t => t.scrollWidth > innerWidth)"
    assert page.value(f"{wide}.map(t => t.closest('figure').id)") == []
    page.send("Emulation.setEmulatedMedia", media="")


def test_a_scrolled_table_still_says_whose_numbers_they_are(page: Page, proof: Path) -> None:
    page.open(proof, 900, 900)
    page.box("#table-differences")
    page.value("document.querySelector('#table-differences .scroll').scrollLeft = 250")
    for heading in ("rowgroup", "row"):
        box = page.box(f'#table-differences tbody th[scope="{heading}"]')
        assert 0 <= box["x"] < 200, heading


def test_nothing_was_logged_as_an_error_and_nothing_was_requested(page: Page) -> None:
    """Comes last: judges everything that the tests above did."""
    assert page.errors() == []
    urls = [
        event["params"]["request"]["url"]
        for event in page.events
        if event["method"] == "Network.requestWillBeSent"
    ]
    assert any(url.endswith("report.html") for url in urls)
    outside = [url for url in urls if not re.match(r"data:|blob:|about:|file:.*report\.html$", url)]
    assert outside == []
