"""Reports over HTTP, so that a link in Prefect's interface opens them.

Browsers do not follow a link from a server to a file. ``mattgs serve`` serves the folder of the
benchmarks' reports, read-only, on loopback, and names it in :data:`VARIABLE`; who serves that
folder otherwise sets the variable to its address.
"""

import os
import threading
import urllib.parse
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from typing_extensions import override

from mattgs_ops.errors import InputError

VARIABLE = "MATTGS_REPORTS_URL"


def report_address(report: Path) -> str | None:
    """Return where a browser finds ``benchmarks/NAME/report.html``; None where nobody serves it."""
    base = os.environ.get(VARIABLE)
    if not base:
        return None
    return f"{base.rstrip('/')}/{urllib.parse.quote(report.parent.name)}/{report.name}"


@contextmanager
def serving(benchmarks: Path, port: int = 0) -> Iterator[str]:
    """Serve a folder until the block ends; yield its address. Port 0 takes a free one.

    Raises :class:`InputError` where the port is taken.
    """
    benchmarks.mkdir(parents=True, exist_ok=True)
    handler = partial(_Quiet, directory=str(benchmarks))
    try:
        opened = ThreadingHTTPServer(("127.0.0.1", port), handler)
    except OSError as error:
        raise InputError(
            f"port {port}, of the reports, the one after --port, cannot be used: {error.strerror}"
        ) from error
    with opened as server:
        thread = threading.Thread(target=server.serve_forever, name="reports", daemon=True)
        thread.start()
        address = f"http://127.0.0.1:{server.server_address[1]}"
        before = os.environ.get(VARIABLE)
        os.environ.setdefault(VARIABLE, address)
        try:
            yield address
        finally:
            if before is None:
                os.environ.pop(VARIABLE, None)
            server.shutdown()
            thread.join()


class _Quiet(SimpleHTTPRequestHandler):
    """Serves files; prints nothing on the terminal that the flows use."""

    @override
    def log_message(self, format: str, *args: Any) -> None:
        del format, args
