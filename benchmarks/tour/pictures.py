"""Pictures of MLflow's and Prefect's interfaces, by headless Chromium, small enough to commit."""

import base64
import io
import json
import time
import urllib.request
from pathlib import Path
from typing import Any

from PIL import Image

from tests.reports.chromium import CHROMIUM, Page, chromium

WINDOW, SHOWN = (1600, 900), (1280, 720)
DETAILS = 1060  # from here on Prefect's interface lists what a deployment is made of
COLOURS = 128
Place = tuple[str, str]  # a page's address, and words on it once it has loaded
SETTLE = 3.0  # seconds after the words are there: charts are drawn last
TIMEOUT = 60
# MLflow's interface opens with a panel for a chat beside what is to be seen
CLOSE = (
    "[...document.querySelectorAll('button')].find(b => /close/i.test(b.ariaLabel || ''))?.click()"
)


def take(title: str, ports: dict[str, str], folder: Path) -> None:
    """Take the pictures that belong to a way of the tour while its servers run."""
    if title.startswith("2"):
        pages = _mlflow(f"http://127.0.0.1:{ports['5000']}")
    elif title.startswith("3"):
        pages = _prefect(f"http://127.0.0.1:{ports['4200']}")
    else:
        return
    if CHROMIUM is None:
        raise SystemExit("--pictures: expected Chromium on this machine, found none")
    folder.mkdir(parents=True, exist_ok=True)
    with chromium() as address:
        page = Page(address)
        page.resize(*WINDOW)
        for name, (shown, words) in pages.items():
            _picture(page, shown, words, folder / f"{name}.png")
            print(f"    {folder / f'{name}.png'}", flush=True)


def _mlflow(server: str) -> dict[str, Place]:
    """Return the pages of the one benchmark that was run there, and of its newest run."""
    api = f"{server}/api/2.0/mlflow"
    found = _post(f"{api}/experiments/search", {"max_results": 10})["experiments"]
    (experiment,) = [one["experiment_id"] for one in found if one["name"] != "Default"]
    query = {"experiment_ids": [experiment], "filter": "tags.capture != ''"}
    run = _post(f"{api}/runs/search", query)["runs"][0]["info"]["run_id"]
    runs = f"{server}/#/experiments/{experiment}/runs"
    return {
        "mlflow-runs": (f"{runs}?viewStateShareKey=mattgs&compareRunsMode=TABLE", "nobg-gentle"),
        "mlflow-run": (f"{runs}/{run}", "mask_psnr"),
        "mlflow-system": (f"{runs}/{run}/system-metrics", "system/"),
    }


def _prefect(server: str) -> dict[str, Place]:
    """Return the page of the deployment's next runs."""
    (deployment,) = _post(f"{server}/api/deployments/filter", {})
    page = f"{server}/deployments/deployment/{deployment['id']}?tab=Upcoming"
    return {"prefect-runs": (page, "Scheduled")}


def _post(address: str, body: dict[str, Any]) -> Any:
    kind = {"Content-Type": "application/json"}
    request = urllib.request.Request(address, json.dumps(body).encode(), kind)
    with urllib.request.urlopen(request, timeout=TIMEOUT) as answer:
        return json.load(answer)


def _picture(page: Page, address: str, words: str, file: Path) -> None:
    """Open a page, put away what is not about the benchmark, and take its picture."""
    page.send("Page.navigate", url="about:blank")  # a change after the # alone loads nothing anew
    page.send("Page.navigate", url=address)
    page.wait(f"document.body?.innerText.includes({json.dumps(words)})")
    page.value(CLOSE)
    time.sleep(SETTLE)
    data = page.send("Page.captureScreenshot", format="png")["data"]
    with Image.open(io.BytesIO(base64.b64decode(data))) as picture:
        small = picture.convert("RGB").resize(SHOWN, Image.Resampling.LANCZOS)
        if "deployment" in address:  # its right column holds paths of this machine
            small = small.crop((0, 0, DETAILS, SHOWN[1]))
    small.quantize(COLOURS, dither=Image.Dither.NONE).save(file, optimize=True)
