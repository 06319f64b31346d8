"""Services that tests start on loopback: an address for messages, a Dask cluster over TLS."""

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from benchmarks.two_machines import WORKERS, free_port, hiding
from flows.services.dask_cluster import CERTIFICATES


@contextmanager
def webhook() -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Serve an address that keeps the JSON posted to it."""
    posts: list[dict[str, Any]] = []

    class Keeps(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            posts.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            """Print nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Keeps) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}", posts
        server.shutdown()


@contextmanager
def dask_over_tls(
    folder: Path, certificates: Path, environment: dict[str, str], hidden: list[Path]
) -> Iterator[str]:
    """Run Dask's own commands, as docs/operations.md has them, with two workers.

    Each has a folder of its own below ``folder`` and, where the right to mount is given, sees
    empty folders in place of the other's and of ``hidden``.
    """
    address = f"tls://127.0.0.1:{free_port()}"
    tls = [
        word
        for name, file in CERTIFICATES.items()
        for word in (f"--tls-{name}", str(certificates / file))
    ]
    dask = [sys.executable, "-m", "dask"]
    scheduler = ["scheduler", "--host", "127.0.0.1", "--port", address.rpartition(":")[2]]
    scheduler += ["--protocol", "tls", "--dashboard-address", "127.0.0.1:0"]
    worker = ["worker", address, "--nthreads", "1", "--resources", "train=1"]
    worker += ["--no-dashboard", "--death-timeout", "120"]
    commands = [([*dask, *scheduler, *tls], environment)]
    places = {name: folder / name for name in WORKERS}
    for place in places.values():
        place.mkdir()
    for name, own in places.items():
        others = [*hidden, *(place for place in places.values() if place != own)]
        named = ["--name", name, "--local-directory", str(own / "dask")]
        more = {"MATTGS_WORK": str(own), "TMPDIR": str(own)}
        commands += [(hiding(others, [*dask, *worker, *named, *tls]), environment | more)]
    with (folder / "dask.log").open("ab") as log:
        processes = [
            subprocess.Popen(command, env=variables, cwd=folder, stdout=log, stderr=log)
            for command, variables in commands
        ]
    try:
        wait_for_workers(address, certificates)
        yield address
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait()


def wait_for_workers(address: str, certificates: Path) -> None:
    from distributed import Client
    from distributed.security import Security

    ca, cert, key = (str(certificates / file) for file in CERTIFICATES.values())
    security = Security(tls_ca_file=ca, tls_client_cert=cert, tls_client_key=key)
    with Client(address, security=security, timeout=120, set_as_default=False) as client:
        client.wait_for_workers(len(WORKERS), timeout=120)
