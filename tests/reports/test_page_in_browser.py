"""The report in headless Chromium: no error, no request, and what should react reacts.

Speaks the DevTools protocol itself; skipped, with the reason, where no Chromium is installed.
"""

import base64
import io
import itertools
import json
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
websockets = pytest.importorskip("websockets.sync.client", reason="no websockets package")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine"),
]
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--no-first-run",
    "--remote-debugging-port=0",
)
PATIENCE = 60  # seconds that a busy machine may take for one step


class Page:
    """One tab: sends commands, keeps every event."""

    def __init__(self, address: str) -> None:
        self.socket = websockets.connect(address, max_size=None, open_timeout=PATIENCE)
        self.numbers = itertools.count(1)
        self.events: list[dict[str, Any]] = []

    def send(self, method: str, **params: Any) -> dict[str, Any]:
        number = next(self.numbers)
        self.socket.send(json.dumps({"id": number, "method": method, "params": params}))
        while True:
            message = json.loads(self.socket.recv(timeout=PATIENCE))
            if message.get("id") == number:
                assert "error" not in message, message
                return dict(message["result"])
            self.events.append(message)

    def value(self, expression: str) -> Any:
        out = self.send(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in out, out
        return out["result"].get("value")

    def wait(self, expression: str) -> None:
        end = time.monotonic() + PATIENCE
        while not self.value(expression):
            assert time.monotonic() < end, f"never true: {expression}"
            time.sleep(0.05)

    def open(self, path: Path, width: int, height: int) -> None:
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")
        self.resize(width, height)
        self.send("Page.navigate", url=path.as_uri())
        self.wait(
            f"location.href === '{path.as_uri()}' && "
            "document.documentElement?.dataset.ready === 'true'"
        )

    def resize(self, width: int, height: int) -> None:
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=width < 600,
        )

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def drag(self, start: tuple[float, float], stop: tuple[float, float]) -> None:
        self.mouse("mousePressed", *start, button="left", buttons=1, clickCount=1)
        for share in (0.5, 1.0):
            x, y = (a + (b - a) * share for a, b in zip(start, stop, strict=True))
            self.mouse("mouseMoved", x, y, button="left", buttons=1)
        self.mouse("mouseReleased", *stop, button="left", clickCount=1)

    def box(self, selector: str) -> dict[str, float]:
        where = "{block: 'center', behavior: 'instant'}"
        self.value(f"document.querySelector('{selector}').scrollIntoView({where})")
        return dict(
            self.value(
                f"(() => {{ const b = document.querySelector('{selector}').getBoundingClientRect();"
                "return {x: b.x, y: b.y, width: b.width, height: b.height}; })()"
            )
        )

    def shot(self) -> np.ndarray:
        data = self.send("Page.captureScreenshot", format="png")["data"]
        with Image.open(io.BytesIO(base64.b64decode(data))) as image:
            return np.asarray(image.convert("RGB"), dtype=np.int16)


@pytest.fixture(scope="module")
def browser() -> Iterator[str]:
    """Start one browser for all tests and return the address of its first tab."""
    assert CHROMIUM is not None
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [CHROMIUM, *FLAGS, f"--user-data-dir={profile}", "about:blank"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            port = _port(Path(profile) / "DevToolsActivePort")
            with _get(port, "/json/list") as tabs:
                address = next(tab for tab in json.load(tabs) if tab["type"] == "page")
            yield str(address["webSocketDebuggerUrl"])
        finally:
            process.terminate()
            process.wait(timeout=PATIENCE)


def _port(file: Path) -> int:
    end = time.monotonic() + PATIENCE
    while not (file.is_file() and file.read_text().strip()):
        assert time.monotonic() < end, "the browser did not start"
        time.sleep(0.1)
    return int(file.read_text().split()[0])


def _get(port: int, path: str) -> Any:
    import urllib.request

    return urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=PATIENCE)


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


def pixels(page: Page, canvas: str = ".view") -> np.ndarray:
    data = page.value(f"document.querySelector('.orbit {canvas}').toDataURL('image/png')")
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


def test_what_is_printed_is_what_is_seen(page: Page) -> None:
    """Printers get a WebGL canvas as black, so a copy is printed."""
    shown = pixels(page)
    copy = pixels(page, ".paper")
    assert np.array_equal(copy, shown)
    page.send("Emulation.setEmulatedMedia", media="print")
    for name, display in ((".orbit .view", "none"), (".orbit .paper", "block")):
        style = f"getComputedStyle(document.querySelector('{name}'))"
        assert page.value(f"{style}.display") == display
    page.send("Emulation.setEmulatedMedia", media="")


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


def test_nothing_was_logged_as_an_error_and_nothing_was_requested(page: Page) -> None:
    """Comes last: judges everything that the tests above did."""
    page.value("1")  # flushes events
    errors = [
        event
        for event in page.events
        if event["method"] == "Runtime.exceptionThrown"
        or (event["method"] == "Log.entryAdded" and event["params"]["entry"]["level"] == "error")
        or (event["method"] == "Runtime.consoleAPICalled" and event["params"]["type"] == "error")
    ]
    assert errors == []
    urls = [
        event["params"]["request"]["url"]
        for event in page.events
        if event["method"] == "Network.requestWillBeSent"
    ]
    assert any(url.endswith("report.html") for url in urls)
    outside = [url for url in urls if not re.match(r"data:|blob:|about:|file:.*report\.html$", url)]
    assert outside == []
