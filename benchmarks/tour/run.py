"""Runs the commands of ``docs/tour.md``, each way in a folder of its own, as a new user would.

    python benchmarks/tour/run.py [--way N] [--pictures docs/images] [--folder DIR]

Bash runs a block that begins with ``sh``, which must end with 0; ``sh server`` keeps running until
its way ends; ``sh workflow`` is compared with the step of the written workflow, which is then run.
Ports of the page are replaced by free ones. ``photos/`` holds small bundled photos. With
``--pictures`` headless Chromium takes the pictures of the page from the running servers.
"""

import argparse
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import yaml
from PIL import Image

import mattgs_ops
from benchmarks.tour.pictures import take

PAGE = Path(__file__).resolve().parents[2] / "docs" / "tour.md"
BUNDLED = Path(mattgs_ops.__file__).parent / "bundled" / "lattepanda" / "images"
PHOTOS, SIZE = 20, (480, 360)  # neighbours; every eighth is held out
PORTS = ("5000", "4200", "8786")
SERVER_SECONDS, TERM_SECONDS = 240, 30
SETTINGS = ("PREFECT_", "MLFLOW_", "MATTGS_", "DASK_")  # of whoever runs this
WORKFLOW = Path(".github/workflows/mattgs.yml")
STEP = "Run the benchmark and judge it"


@dataclass(frozen=True)
class Block:
    """Commands, and what kind they are: empty, ``server`` or ``workflow``."""

    kind: str
    text: str


def ways(page: str) -> dict[str, list[Block]]:
    """Return the blocks of each way, by its heading."""
    found = {}
    for part in re.split(r"^## (?=\d\. )", page, flags=re.MULTILINE)[1:]:
        title = part.partition("\n")[0]
        own = part.partition("\n## ")[0]
        blocks = re.findall(r"^```sh ?(\w*)\n(.*?)^```", own, flags=re.MULTILINE | re.DOTALL)
        found[title] = [Block(kind, text) for kind, text in blocks]
    return found


def run(title: str, blocks: list[Block], folder: Path, home: Path, pictures: Path | None) -> float:
    """Run one way in ``folder``; return its seconds. Raises ``CalledProcessError``."""
    _photos(folder / "photos")
    ports = {port: str(_free_port()) for port in PORTS}
    servers: list[subprocess.Popen[bytes]] = []
    began = time.monotonic()
    try:
        for number, block in enumerate(blocks):
            text = block.text
            for port, free in ports.items():
                text = text.replace(port, free)
            log = folder / f"block-{number}.log"
            print(f"  $ {text.strip()}".replace("\n", "\n    "), flush=True)
            if block.kind == "server":
                servers.append(_start(text, folder, home, log))
                _wait(text, ports, servers[-1], log)
                continue
            if block.kind == "workflow":
                text = _step(folder, text)
            _run(text, folder, home, log)
        if pictures is not None:
            take(title, ports, pictures)
        return time.monotonic() - began
    finally:
        for server in reversed(servers):
            os.killpg(server.pid, signal.SIGTERM)
            try:
                server.wait(TERM_SECONDS)
            except subprocess.TimeoutExpired:
                os.killpg(server.pid, signal.SIGKILL)


def _step(folder: Path, text: str) -> str:
    """Return the workflow's own step, once it is known to run the page's command."""
    jobs = yaml.safe_load((folder / WORKFLOW).read_text(encoding="utf-8"))["jobs"]
    (step,) = [one["run"] for one in jobs["gate"]["steps"] if one.get("name") == STEP]
    if text.strip() not in step:
        raise SystemExit(f"the workflow does not run {text.strip()!r}: {step}")
    return f"{step}"


def _run(text: str, folder: Path, home: Path, log: Path) -> None:
    command = ["bash", "-eo", "pipefail", "-c", text]
    with log.open("wb") as output:
        done = subprocess.run(
            command, cwd=folder, env=_environment(home), stdout=output, stderr=output, check=False
        )
    shown = log.read_text(encoding="utf-8", errors="replace")
    print("\n".join(f"    {line}" for line in shown.splitlines()[-12:]), flush=True)
    done.check_returncode()


def _start(text: str, folder: Path, home: Path, log: Path) -> "subprocess.Popen[bytes]":
    with log.open("wb") as output:
        return subprocess.Popen(
            ["bash", "-c", f"{text.strip()}"],
            cwd=folder, env=_environment(home), stdout=output, stderr=output,
            start_new_session=True,
        )  # fmt: skip


def _wait(text: str, ports: dict[str, str], server: "subprocess.Popen[bytes]", log: Path) -> None:
    """Wait until a server answers on the port that its command names."""
    port = next((free for free in ports.values() if free in text), None)
    end = time.monotonic() + SERVER_SECONDS
    while True:
        if server.poll() is not None or time.monotonic() > end:
            raise SystemExit(f"a server did not start:\n{log.read_text(encoding='utf-8')}")
        if "dask" in text:  # speaks no HTTP
            words = ("Scheduler at", "Registered to")
            if any(word in log.read_text(encoding="utf-8") for word in words):
                return
        elif _answers(f"http://127.0.0.1:{port}"):
            return
        time.sleep(0.5)


def _answers(address: str) -> bool:
    try:
        urllib.request.urlopen(address, timeout=5).close()
    except urllib.error.HTTPError:
        return True
    except OSError:
        return False
    return True


def _environment(home: Path) -> dict[str, str]:
    """Return a new user's environment: this Python's commands, nobody's settings."""
    known = {k: v for k, v in os.environ.items() if not k.startswith(SETTINGS)}
    return known | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "HOME": str(home),
        "XDG_CACHE_HOME": str(home / ".cache"),
        "TMPDIR": str(home),
        "COLUMNS": "120",
    }


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def _photos(folder: Path) -> None:
    folder.mkdir(parents=True)
    for path in sorted(BUNDLED.glob("*.jpg"))[:PHOTOS]:
        with Image.open(path) as photo:
            photo.resize(SIZE).save(folder / path.name, quality=95)


@contextmanager
def _folder(given: Path | None) -> Iterator[Path]:
    if given is not None:
        given.mkdir(parents=True, exist_ok=True)
        yield given.resolve()
        return
    with tempfile.TemporaryDirectory(prefix="mattgs-tour-") as made:
        yield Path(made)


def main() -> int:
    """Run the ways, print what came of them; 0 where all ended well."""
    parser = argparse.ArgumentParser(description="Run the commands of docs/tour.md.")
    parser.add_argument("--way", type=int, help="only this one")
    parser.add_argument("--pictures", type=Path, help="folder for pictures of the interfaces")
    parser.add_argument("--folder", type=Path, help="keep what the ways leave there")
    given = parser.parse_args()
    ends: list[tuple[str, str]] = []
    with _folder(given.folder) as place:
        for title, blocks in ways(PAGE.read_text(encoding="utf-8")).items():
            if given.way is not None and not title.startswith(f"{given.way}."):
                continue
            print(f"{title}", flush=True)
            (place / "home").mkdir(exist_ok=True)
            try:
                folder = place / f"way-{title[0]}"
                seconds = run(title, blocks, folder, place / "home", given.pictures)
                ends.append((title, f"ended well, {seconds:.0f} s"))
            except subprocess.CalledProcessError as error:
                ends.append((title, f"exit code {error.returncode}"))
    print("\n| way | came to |\n|---|---|")
    for title, end in ends:
        print(f"| {title} | {end} |")
    return 0 if ends and all("well" in end for _, end in ends) else 1


if __name__ == "__main__":
    sys.exit(main())
