"""Reports over HTTP: a link opens, the folder is all that is served, the address is put back."""

import os
import socket
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest

from flows.services.report_server import VARIABLE, report_address, serving
from mattgs_ops.errors import InputError


@pytest.fixture(autouse=True)
def no_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)


def test_the_address_of_a_report_opens_it(tmp_path: Path) -> None:
    report = tmp_path / "benchmarks" / "two words+" / "report.html"
    report.parent.mkdir(parents=True)
    report.write_text("<p>a report")
    assert report_address(report) is None
    with serving(tmp_path / "benchmarks") as base:
        address = str(report_address(report))
        assert address.startswith(f"{base}/two%20words%2B/")
        with urlopen(address, timeout=20) as page:
            assert page.read() == b"<p>a report"
    assert VARIABLE not in os.environ


def test_nothing_outside_the_folder_is_served(tmp_path: Path) -> None:
    (tmp_path / "mlflow.db").write_text("private")
    with serving(tmp_path / "benchmarks") as base, pytest.raises(HTTPError, match="404"):
        urlopen(f"{base}/../mlflow.db", timeout=20)


def test_an_address_that_the_user_names_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "https://reports.lab/")
    with serving(tmp_path):
        address = report_address(tmp_path / "quick" / "report.html")
    assert address == "https://reports.lab/quick/report.html"
    assert os.environ[VARIABLE] == "https://reports.lab/"


def test_a_port_that_is_taken_is_told(tmp_path: Path) -> None:
    """As by a second ``mattgs serve``, whose reports are on the next port."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        refused = pytest.raises(
            InputError, match=f"port {port}, of the reports, the one after --port, cannot be used"
        )
        with refused, serving(tmp_path, port):
            pass
