"""``mattgs ui``: MLflow's web interface on the benchmark's runs."""

import os
import signal
import subprocess
import sys
import urllib.error
import urllib.request
import webbrowser
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from flows.services import embedded, registries
from mattgs_ops.errors import InputError, StageError
from tasks.registry import interface_view, runs

ANSWER_SECONDS = 10.0  # that a server may take to say that it is there
MOST_LISTED = 20  # benchmarks; the front page has all


def show(out: Path, port: int, *, browser: bool) -> None:
    """Show the server that ``MLFLOW_TRACKING_URI`` names, else serve the output folder's runs.

    Raises :class:`InputError` when that server does not answer, and when nothing was recorded.
    """
    tracking = registries.current(out)
    if tracking.startswith(("http://", "https://")):
        _open(tracking, browser=browser)
    else:
        _serve(out, port)


def _open(address: str, *, browser: bool) -> None:
    shown = registries.without_password(address)
    try:
        urllib.request.urlopen(f"{address.rstrip('/')}/health", timeout=ANSWER_SECONDS).close()
    except urllib.error.HTTPError:  # it answers, and wants to be signed in to
        pass
    except (OSError, ValueError) as error:
        raise InputError(f"MLFLOW_TRACKING_URI={shown}: no server answers: {error}") from error
    pages: dict[str, str] = {}
    with suppress(InputError):  # it wants to be signed in to
        runs.initialise(address)
        pages = interface_view.benchmark_pages(address, shown)
    _print_pages(shown, "the server of MLFLOW_TRACKING_URI", pages)
    if browser:
        only = next(iter(pages.values())) if len(pages) == 1 else None
        webbrowser.open(only or interface_view.front_page(shown))


def _print_pages(server: str, what: str, pages: Mapping[str, str]) -> None:
    """Print where the list of all experiments is, and each benchmark with its tables' columns."""
    lines = [f"MLflow: {interface_view.front_page(server)} ({what})"]
    lines += [f"  {name}: {page}" for name, page in list(pages.items())[:MOST_LISTED]]
    if len(pages) > MOST_LISTED:
        lines.append(f"  and {len(pages) - MOST_LISTED} more")
    sys.stdout.write("\n".join(lines) + "\n")
    sys.stdout.flush()


def _serve(out: Path, port: int) -> None:
    """Serve until Ctrl-C or SIGTERM, which the command line raises alike."""
    if not os.environ.get("MLFLOW_TRACKING_URI") and not (out / "mlflow.db").is_file():
        raise InputError(
            f"{out}: no runs were recorded there; run `mattgs run` first, or --out DIR"
        )
    embedded.enter(out)
    address, tracking = f"http://127.0.0.1:{port}", registries.current(out)
    runs.initialise(tracking)
    pages = interface_view.benchmark_pages(tracking, address)
    os.environ["MLFLOW_SERVER_ENABLE_JOB_EXECUTION"] = "false"  # starts in half the time
    command = [sys.executable, "-P", "-m", "mlflow", "server", "--workers", "1"]
    command += ["--host", "127.0.0.1", "--port", str(port), "--backend-store-uri", tracking]
    _print_pages(address, "starting takes some seconds; Ctrl-C ends", pages)
    with _ended_too(subprocess.Popen(command, start_new_session=True)) as server:
        code = server.wait()
    if code != 0:
        raise StageError(f"MLflow's server ended with code {code}; is port {port} in use?")


@contextmanager
def _ended_too(server: "subprocess.Popen[bytes]") -> Iterator["subprocess.Popen[bytes]"]:
    """Have a server and the processes it started end with what follows, however that ends."""
    try:
        yield server
    finally:
        with suppress(ProcessLookupError):
            os.killpg(server.pid, signal.SIGTERM)
        server.wait()
