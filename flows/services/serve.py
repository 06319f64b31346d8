"""``mattgs serve``: all deployments from one process, with its own Prefect server if need be."""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from flows.services import embedded, prefect_settings
from flows.services.prefect_server import START_SECONDS, healthy
from flows.services.report_server import serving
from mattgs_ops.errors import InputError, StageError

POLL_SECONDS = 0.2


def serve(out: Path, port: int, names: list[str]) -> None:
    """Serve the deployments of ``prefect.yaml``, else the project's, until Ctrl-C.

    Raises :class:`InputError` for a deployment that does not exist, for a port that is taken, and
    where the Prefect that the user named cannot be used.

    Where Prefect's settings name no API, a server is started on ``port``, its database below
    ``out``; it ends with this process. Reports are served on the next port, so that links in the
    interface open them.
    """
    out.mkdir(parents=True, exist_ok=True)
    embedded.enter(out)
    _check(names)
    url = prefect_settings.api_url()
    if url is None:
        _check_free(port)
    with serving(out / "benchmarks", port + 1) as reports:
        if url is not None:
            prefect_settings.check(url)
            _serve(url, reports, names, out)
            return
        with server(out, port) as own:
            os.environ["PREFECT_API_URL"] = own
            _serve(own, reports, names, out)


@contextmanager
def server(out: Path, port: int) -> Iterator[str]:
    """Start a complete Prefect server, scheduler and interface included; yield its API's address.

    Unlike a benchmark's own it keeps its database: the past is there after a restart. Raises
    :class:`InputError` where the port is taken, and :class:`StageError` where it does not start.
    """
    home, log = out / "prefect" / "served", out / "logs" / "prefect.log"
    for folder in (home, log.parent):
        folder.mkdir(parents=True, exist_ok=True)
    _check_free(port)
    url = f"http://127.0.0.1:{port}/api"
    command = [sys.executable, "-P", "-m", "prefect", "server", "start"]
    command += ["--host", "127.0.0.1", "--port", str(port)]
    # the interface calls the API at its own address: any port, also a forwarded one
    environment = os.environ | {"PREFECT_HOME": str(home), "PREFECT_UI_API_URL": "/api"}
    with log.open("ab") as output:
        process = subprocess.Popen(command, stdout=output, stderr=output, env=environment)
    try:
        _wait(process, url, log)
        yield url
    finally:
        process.terminate()
        process.wait()


def _check_free(port: int) -> None:
    url = f"http://127.0.0.1:{port}/api"
    if healthy(url):
        raise InputError(f"--port {port}: a server is there already; PREFECT_API_URL={url} uses it")
    try:
        socket.create_server(("127.0.0.1", port)).close()
    except OSError as error:
        reason = os.strerror(error.errno or 0)  # the error's own repeats the address
        raise InputError(f"--port {port}: cannot be used: {reason}") from error


def _wait(process: "subprocess.Popen[bytes]", url: str, log: Path) -> None:
    end = time.monotonic() + START_SECONDS
    while not healthy(url):
        if time.monotonic() > end or process.poll() is not None:
            raise StageError(f"the Prefect server did not start; log: {log}")
        time.sleep(POLL_SECONDS)


def _check(names: list[str]) -> None:
    from flows.schedule_file import deployments

    listed = [str(one) for one in deployments()]
    for name in names:
        if name not in listed:
            raise InputError(f"{name}: expected one of {', '.join(listed)}")


def _serve(url: str, reports: str, names: list[str], out: Path) -> None:
    from flows.schedule_file import deployments
    from flows.scheduled import serve_all

    listed = deployments()

    sys.stdout.write(f"Prefect: {url.removesuffix('/api')} (Ctrl-C ends)\nReports: {reports}\n")
    for one in listed:
        if not names or str(one) in names:
            sys.stdout.write(f"  {one!s:<20} {one.when}\n")
    sys.stdout.flush()
    with prefect_settings.using(url):
        serve_all(frozenset(names), out, listed)
