"""``mattgs serve`` on ports that others hold: it says so in a line, before anything is started."""

import socket
from pathlib import Path

import pytest

from flows.services import prefect_settings
from flows.services.background import Background
from flows.services.serve import serve
from mattgs_ops.errors import InputError


@pytest.fixture(autouse=True)
def own_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)  # which has no prefect.yaml


def test_a_port_that_another_kind_of_server_holds_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prefect_settings, "api_url", lambda: None)
    with socket.create_server(("127.0.0.1", 0)) as taken:

        def greet() -> None:
            connection, _ = taken.accept()
            with connection:
                connection.recv(1)
                connection.sendall(b"SSH-2.0-OpenSSH\r\n")

        port = taken.getsockname()[1]
        refused = pytest.raises(InputError, match=f"--port {port}: cannot be used: Address already")
        with Background(greet), refused:
            serve(tmp_path / "out", port, [])


def test_the_port_after_it_being_taken_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prefect_settings, "api_url", lambda: "http://127.0.0.1:9/api")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        after = taken.getsockname()[1]
        refused = pytest.raises(InputError, match=f"port {after}, of the reports, the one after")
        with refused:
            serve(tmp_path / "out", after - 1, [])
