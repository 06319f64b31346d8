"""Commands that read what runs recorded refuse a folder that holds nothing, and make none."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flows.cli.app import app

READ = {
    "history": ["history", "quick-ci"],
    "report": ["report", "quick-ci"],
    "compare": ["compare", "baseline", "1234"],
    "promote": ["promote", "1234"],
    "export": ["export", "1234"],
    "view": ["view", "1234"],
    "gate": ["gate", "--baseline", "quick-ci"],
}


@pytest.mark.parametrize("command", READ)
def test_a_folder_that_is_not_there_stays_so(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    folder = tmp_path / "mistyped"
    result = CliRunner().invoke(app, [*READ[command], "--out", str(folder)])
    told = result.output + str(result.exception)
    assert re.search(rf"{folder}(/mlflow\.db)?: expected .* --out names", told)
    assert not folder.exists()


def test_a_registry_file_that_the_environment_names_and_is_not_there_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path}/gone.db")
    result = CliRunner().invoke(app, ["history", "quick-ci", "--out", str(tmp_path / "out")])
    assert f"{tmp_path}/gone.db: expected" in result.output + str(result.exception)
    assert not list(tmp_path.iterdir())
