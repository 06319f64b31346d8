"""Real services on loopback, one of each for all tests of a file: Prefect's API, certificates."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from flows.services.prefect_server import PrefectServer
from tests.flows.certificates import make_certificates


@pytest.fixture(scope="session")
def prefect_api(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Serve Prefect's API from an empty database; yield its address."""
    home = tmp_path_factory.mktemp("prefect-server")
    server = PrefectServer(home, home / "server.log")
    try:
        server.wait()
        yield server.address()
    finally:
        server.stop()


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a folder for ``--dask-certificates``: an authority, and a certificate that it signed."""
    return make_certificates(tmp_path_factory.mktemp("certificates"))
