"""Doubts about a capture's masks reach the reader's eyes: terminal, status and MLflow."""

import json
import logging
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

import reports
from flows.benchmark import _warn
from flows.cli import run, status, terminal
from mattgs_ops.naming import slug
from tasks.registry import runs
from tasks.stages.stage import Place
from tasks.stages.status import StatusFile

PROOF = Path(reports.__file__).parent / "results" / "proof-7k"
TEXT = "masks of different photos contradict each other"
DOUBT = {"about": "masks", "text": TEXT, "serious": True}


@pytest.fixture
def rows() -> list[dict[str, Any]]:
    """Return committed rows; the rover's masks are in doubt, the other captures' are not."""
    parts = sorted(PROOF.glob("*.json"))
    committed = [row for part in parts for row in json.loads(part.read_text(encoding="utf-8"))]
    return [row | {"warnings": [DOUBT] if row["capture"] == "rover" else []} for row in committed]


def test_a_run_ends_with_its_warnings(rows: list[dict[str, Any]], tmp_path: Path) -> None:
    (tmp_path / "rows.json").write_text(json.dumps(rows), encoding="utf-8")
    text = StringIO()
    console = Console(file=text, width=200)
    run._print_end(Place(tmp_path, "quick"), tmp_path / "report.html", console, 1.0)
    lines = [line.rstrip() for line in text.getvalue().splitlines() if line.startswith("!")]
    assert lines == [f"! Rover: {TEXT}. No verdict is given for it."]


def test_a_registry_that_fails_is_told_at_the_end(
    rows: list[dict[str, Any]], tmp_path: Path
) -> None:
    unrecorded = [row | {"run_id": None, "warnings": []} for row in rows]
    (tmp_path / "rows.json").write_text(json.dumps(unrecorded), encoding="utf-8")
    with terminal.kept_warnings() as kept:
        for count in (*range(9), 0):
            logging.getLogger("mattgs").warning(
                "row %d was not logged: no answer\nTraceback", count
            )
    logging.getLogger("mattgs").warning("later")
    text = StringIO()
    console = Console(file=text, width=200)
    place = Place(tmp_path, "quick")
    run._print_end(place, tmp_path / "report.html", console, 1.0, kept)
    lines = [line.rstrip() for line in text.getvalue().splitlines() if line.startswith("!")]
    assert lines == [
        *(f"! row {count} was not logged: no answer" for count in range(5)),
        "! 4 more such warnings",
        "! MLflow lacks some of these experiments; the same command again records them",
    ]


def test_status_names_them_with_the_stage_that_made_the_masks(
    rows: list[dict[str, Any]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    place = Place(tmp_path, "quick")
    for row in rows:
        titles = [f"agree {row['capture']}", f"train {row['capture']} {row['condition']} seed 0"]
        for title in titles:
            file = StatusFile(place.status / f"{slug(title)}.json")
            file.begin(title, title.split(maxsplit=1)[0])
            file.end("done")
    for row in rows:
        _warn(place, row | {"seconds": {"segment": 1.0, "agree": 2.0}})
    status.print_status(place.out, None)
    text = " ".join(capsys.readouterr().out.split())
    assert text.count(TEXT) == 1
    assert f"! agree rover: {TEXT}" in text


def test_mlflow_has_them_as_a_tag(rows: list[dict[str, Any]], tmp_path: Path) -> None:
    from mlflow.tracking import MlflowClient

    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    runs.initialise(uri)
    experiment = runs.open_benchmark(uri, "quick", tmp_path / "artifacts")
    for row in (rows[0], next(row for row in rows if row["capture"] != "rover")):
        run_id = runs.record(uri, experiment, row, parameters={})
        tag = MlflowClient(tracking_uri=uri).get_run(run_id).data.tags["warnings"]
        assert tag == "; ".join(one["text"] for one in row["warnings"])
