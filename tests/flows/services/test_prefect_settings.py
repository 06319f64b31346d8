"""The Prefect API is the one that Prefect itself would use; the home is the user's or our own."""

import json
import os
import socket
import ssl
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any
from urllib.request import proxy_bypass

import prefect
import pytest
from distributed.protocol.pickle import dumps, loads
from prefect.context import hydrated_context, serialize_context

from flows.services import embedded
from flows.services.prefect_settings import certificates_for_own, check, configured, using_own
from mattgs_ops.errors import InputError

PROFILE = 'active = "lab"\n[profiles.lab]\nPREFECT_API_URL = "http://profile/api"\n'
LOOK = """
import os, sys
from pathlib import Path
from flows.services import embedded, prefect_settings
embedded.enter(Path(sys.argv[1]))
from prefect.settings import get_current_settings
print(prefect_settings.api_url(), get_current_settings().home)
"""


def look(folder: Path, **variables: str) -> list[str]:
    """Return the API and the home that a fresh process finds, started in ``folder``."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith("PREFECT_")}
    paths = {"HOME": str(folder), "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    done = subprocess.run(
        [sys.executable, "-c", LOOK, str(folder / "out")],
        env=kept | paths | variables,
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return done.stdout.split()


def write(folder: Path, name: str, text: str) -> None:
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text)


def test_a_profile_names_the_api_and_keeps_its_home(tmp_path: Path) -> None:
    write(tmp_path, ".prefect/profiles.toml", PROFILE)
    assert look(tmp_path) == ["http://profile/api", str(tmp_path / ".prefect")]


def test_a_file_of_variables_comes_before_the_profile_and_a_variable_before_both(
    tmp_path: Path,
) -> None:
    write(tmp_path, ".prefect/profiles.toml", PROFILE)
    write(tmp_path, ".env", "PREFECT_API_URL=http://file/api\n")
    assert look(tmp_path)[0] == "http://file/api"
    assert look(tmp_path, PREFECT_API_URL="http://variable/api")[0] == "http://variable/api"


def test_where_nothing_is_configured_there_is_no_api_and_the_home_is_ours(tmp_path: Path) -> None:
    assert look(tmp_path) == ["None", str(tmp_path / "out" / "prefect" / "client")]


@pytest.mark.parametrize(
    ("file", "text", "expected"),
    [
        (".prefect/profiles.toml", "", True),
        (".env", "PREFECT_LOGGING_LEVEL=DEBUG\n", True),
        (".env", "OTHER=1\n", False),
        ("prefect.toml", "", True),
        ("pyproject.toml", "[tool.prefect]\n", True),
        ("pyproject.toml", "[tool.ruff]\n", False),
    ],
)
def test_every_place_that_prefect_reads_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: str, text: str, expected: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    for key in ("PREFECT_HOME", "PREFECT_PROFILES_PATH"):
        monkeypatch.delenv(key, raising=False)
    write(tmp_path, file, text)
    assert configured() is expected


@contextmanager
def server_of_version(version: str) -> Iterator[str]:
    """Serve the two answers that Prefect's client asks a server for before all others."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            body = json.dumps(version if self.path == "/api/admin/version" else True).encode()
            self.send_response(200)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None: ...

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/api"
        server.shutdown()


def refuse(error: Exception) -> Callable[..., Any]:
    def raising(*_: object) -> Any:
        raise error

    return raising


@pytest.mark.parametrize(
    ("what", "error"),
    [("home", RuntimeError("no home directory")), ("is_file", PermissionError("profiles.toml"))],
)
def test_without_a_home_of_the_users_own_nothing_is_configured(
    what: str, error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for key in ("PREFECT_HOME", "PREFECT_PROFILES_PATH"):
        monkeypatch.delenv(key, raising=False)
    with monkeypatch.context() as patch:
        real = Path.is_file
        if what == "home":
            patch.setattr(Path, "home", refuse(error))
        else:
            patch.setattr(
                Path, "is_file", lambda at: real(at) if at.parent == Path() else refuse(error)()
            )
        assert not configured()
        (tmp_path / "prefect.toml").write_text("")
        assert configured(), "the current folder is looked at all the same"


@pytest.mark.parametrize(
    ("proxy", "spared", "then"),
    [
        ("", "", ""),
        ("http://proxy:3128", "", "127.0.0.1,localhost"),
        ("http://proxy:3128", "lab.org, localhost", "lab.org,localhost,127.0.0.1"),
        ("http://proxy:3128", "*", "*"),
    ],
)
def test_our_own_services_are_reached_without_a_proxy(
    proxy: str, spared: str, then: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for key in ("http_proxy", "https_proxy", "all_proxy", "no_proxy"):
        for name in (key, key.upper()):
            monkeypatch.delenv(name, raising=False)
    if proxy:
        monkeypatch.setenv("http_proxy", proxy)
    if spared:
        monkeypatch.setenv("NO_PROXY", spared)
    embedded.enter(tmp_path)
    assert os.environ.get("no_proxy", "") == os.environ.get("NO_PROXY", "") == then
    if then:
        assert proxy_bypass("127.0.0.1:4200")


def test_an_api_of_this_version_can_be_used() -> None:
    with server_of_version(prefect.__version__) as api:
        check(api)


def test_an_api_of_another_version_is_named_before_the_run() -> None:
    with (
        server_of_version("2.20.1") as api,
        pytest.raises(InputError, match=rf"^Prefect at {api} cannot be used: .*2\.20\.1"),
    ):
        check(api)


def test_an_api_that_does_not_answer_is_named_without_its_password() -> None:
    with socket.create_server(("127.0.0.1", 0)) as nobody:
        port = nobody.getsockname()[1]
    with pytest.raises(InputError, match=rf"^Prefect at http://127\.0\.0\.1:{port}/api cannot"):
        check(f"http://me:secret@127.0.0.1:{port}/api")


def test_our_own_server_is_reached_with_a_list_of_one_authority(
    prefect_api: str, tmp_path: Path
) -> None:
    certificates = certificates_for_own(tmp_path)
    assert len(ssl.create_default_context(cafile=str(certificates)).get_ca_certs()) == 1
    with using_own(prefect_api, certificates):
        settings = prefect.settings.get_current_settings()
        assert settings.api.ssl_cert_file == str(certificates), "read for each connection"
        assert not settings.logging.to_api.enabled
        with prefect.get_client(sync_client=True) as client:
            assert client.api_healthcheck() is None
    assert prefect.settings.get_current_settings().api.ssl_cert_file != str(certificates)


def test_our_own_servers_settings_are_handed_to_task_runs_as_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = "http://127.0.0.1:9/api"
    with using_own(address, certificates_for_own(tmp_path)):
        secret = {prefect.settings.PREFECT_API_KEY: "sesame"}
        with prefect.settings.temporary_settings(secret):
            assert "sesame" in str(serialize_context()), "Prefect's own way, below another context"
        carried = dumps(serialize_context())
        shown = prefect.context.get_settings_context().serialize(include_secrets=False)
        assert isinstance(shown["settings"], dict), "what hides secrets is written out"
    monkeypatch.setenv("PREFECT_API_URL", "http://surroundings.of.the.worker/api")
    with hydrated_context(loads(carried)):
        found = prefect.settings.get_current_settings()
        assert found.api.url == address
        assert not found.logging.to_api.enabled
