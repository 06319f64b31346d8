"""A temporary Prefect server in a process of its own that ends with the one that started it.

Prefect's own ephemeral server outlives a killed flow; this one does not. The child is ``python -m
flows.services.prefect_server URL_FILE PARENT_PID``: it takes a free port, writes its API address to
``URL_FILE`` and serves Prefect's application, without user interface and background services. Its
database lies in ``PREFECT_HOME``; each home is used by one server at a time.

Making the database's tables takes as long as all the rest of the start. So the first fresh database
is kept, still empty, in the user's cache folder, and later ones are copies of it.
"""

import http.client
import os
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

from mattgs_ops.child_process import die_with_parent
from mattgs_ops.errors import StageError
from mattgs_ops.store import user_cache
from mattgs_ops.whole_file import written_whole

START_SECONDS = 180.0  # a fresh database takes up to 40 s on a busy machine
POLL_SECONDS = 0.1


class PrefectServer:
    """Handle of a server that is starting."""

    def __init__(self, home: Path, log: Path) -> None:
        self.home = home
        home.mkdir(parents=True, exist_ok=True)
        log.parent.mkdir(parents=True, exist_ok=True)
        self._log = log
        self._stopping = False
        self._database = home / "prefect.db"
        copied = self._database.exists() or user_cache.copied_database(_kept(), self._database)
        self._fresh = not copied
        self._address = home / "server.url"
        self._address.unlink(missing_ok=True)
        command = [sys.executable, "-P", "-m", "flows.services.prefect_server"]
        with log.open("ab") as output:
            self._process = subprocess.Popen(
                [*command, str(self._address), str(os.getpid())],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=_environment(home),
                start_new_session=True,
            )

    def address(self) -> str:
        """Return the API's address, known long before it answers."""
        self._wait_for(self._address.is_file)
        return self._address.read_text(encoding="utf-8")

    def wait(self) -> None:
        """Return once the API answers; raises :class:`StageError` when it does not start."""
        url = self.address()
        self._wait_for(lambda: healthy(url))
        if self._fresh:
            user_cache.keep_database(_kept(), self._database)

    def follow(self, code: int) -> None:
        """End this process, at once and with ``code``, should the server end before :meth:`stop`.

        Prefect's client would try to reach it for many minutes. Nothing is lost: the same command
        goes on from here, as after a kill.
        """
        threading.Thread(target=self._follow, args=(code,), daemon=True).start()

    def _follow(self, code: int) -> None:
        self._process.wait()
        if not self._stopping:
            text = "mattgs: the Prefect server ended; the same command goes on from here; log: "
            os.write(sys.stderr.fileno(), f"{text}{self._log}\n".encode())
            os._exit(code)

    def _wait_for(self, happened: Callable[[], bool]) -> None:
        end = time.monotonic() + START_SECONDS
        while not happened():
            if time.monotonic() > end or self._process.poll() is not None:
                raise StageError(f"the Prefect server did not start; log: {self._log}")
            time.sleep(POLL_SECONDS)

    def stop(self) -> None:
        """End the server."""
        self._stopping = True
        self._process.terminate()
        try:
            self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _kept() -> str:
    """Return the name under which an empty database of the installed version is kept."""
    return f"prefect-{version('prefect')}"


def healthy(url: str) -> bool:
    """Whether a Prefect server answers at an API's address."""
    try:
        with urllib.request.urlopen(f"{url}/health", timeout=10) as answer:
            return bool(answer.status == 200)
    except (urllib.error.URLError, http.client.HTTPException, TimeoutError, ConnectionError):
        return False  # nobody answers, or another kind of server


def _environment(home: Path) -> dict[str, str]:
    paths = [path for path in sys.path if path]
    kept = {key: value for key, value in os.environ.items() if key != "PREFECT_API_URL"}
    return {
        **kept,
        "PYTHONPATH": os.pathsep.join(paths),
        "PREFECT_HOME": str(home),
        # of the user's settings, those of a server of theirs are not meant for this one
        "PREFECT_PROFILES_PATH": str(home / "profiles.toml"),
        "PREFECT_API_DATABASE_CONNECTION_URL": f"sqlite+aiosqlite:///{home / 'prefect.db'}",
        "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
        "PREFECT_API_BLOCKS_REGISTER_ON_START": "false",  # unused here, and slow
        "PREFECT__SERVER_EPHEMERAL": "1",
        "PREFECT__SERVER_FINAL": "1",
    }


def main(address_file: Path, parent: int) -> None:
    """Child's entry: serve until killed."""
    die_with_parent(parent)
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.bind(("127.0.0.1", 0))
    with written_whole(address_file) as partial:
        partial.write_text(f"http://127.0.0.1:{listener.getsockname()[1]}/api", encoding="utf-8")
    import uvicorn  # takes seconds; the address is out
    from prefect.server.api.server import create_app

    config = uvicorn.Config(create_app, factory=True, log_level="error", lifespan="on")
    uvicorn.Server(config).run(sockets=[listener])


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
