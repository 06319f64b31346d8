"""Two runs compared, from a real registry or from files of rows: numbers, page, refusals."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from flows.cli.app import app
from mattgs_ops.errors import InputError
from tasks.registry import runs
from tests.flows.results.conftest import files_of

Row = dict[str, Any]


@pytest.fixture(scope="module")
def out(
    pictured: tuple[list[Row], Path],
    fresh_registry: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Return an output folder with recorded runs, and the rows of a benchmark beside a store."""
    folder = tmp_path_factory.mktemp("compare")
    shutil.copy(fresh_registry, folder / "mlflow.db")
    uri = f"sqlite:///{folder / 'mlflow.db'}"
    experiment = runs.open_benchmark(uri, "toy", folder / "mlflow-artifacts")
    for number, row in enumerate(pictured[0]):
        settings = {"iterations": 1000, "train": {"lr_scale": 0.005 * (number + 1)}}
        files = files_of(row, pictured[1], folder / "copies" / row["capture"])
        runs.record(uri, experiment, row, parameters=settings, files=files)
    kept = folder / "benchmarks" / "toy"
    kept.mkdir(parents=True)
    (kept / "rows.json").write_text(json.dumps(pictured[0]))
    shutil.copytree(pictured[1], folder / "store")
    return folder


def name_of(row: Row) -> str:
    return f"{row['capture']} {row['condition']} seed {row['seed']}"


def two_of(rows: list[Row]) -> tuple[Row, Row]:
    """Return two rows of one capture with different methods and the same background."""
    first = rows[0]
    return first, next(
        row
        for row in rows
        if row["capture"] == first["capture"]
        and row["background"] == first["background"]
        and row["method"] != first["method"]
    )


def mattgs(*arguments: str | Path) -> str:
    done = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.parametrize("source", ["registry", "rows"])
def test_two_runs_are_compared_by_name(
    source: str, out: Path, pictured: tuple[list[Row], Path]
) -> None:
    first, second = two_of(pictured[0])
    before = "" if source == "registry" else f"{out / 'benchmarks/toy/rows.json'}:"
    names = [f"{before}{name_of(row)}" for row in (first, second)]
    told = mattgs("compare", *names, "--no-browser", "--out", out)
    difference = second["metrics"]["mask_psnr"] - first["metrics"]["mask_psnr"]
    sign = "\u2212" if difference < 0 else "+"
    (line,) = [one for one in told.splitlines() if " PSNR in mask↑ " in one]
    assert f"{sign}{abs(difference):.2f}" in line
    assert "What was asked differently" in told
    assert ("train.lr_scale" in told) == (source == "registry"), "rows hold no settings"
    page = Path(told.strip().rpartition("Page: ")[2]).read_text(encoding="utf-8")
    data = json.loads(page.partition('id="data">')[2].partition("</script>")[0])
    (capture,) = data["captures"]
    assert [lane["id"] for lane in capture["lanes"]][-2:] == ["A", "B"]
    assert capture["start"] == ["A", "B"]
    assert capture["views"]
    assert all(
        picture.startswith("data:image/jpeg")
        for slides in capture["pictures"].values()
        for picture in slides.values()
    )
    assert len(capture["models"]) == 2, "both in 3D"


def test_what_does_not_compare_is_refused(out: Path, pictured: tuple[list[Row], Path]) -> None:
    first, _ = two_of(pictured[0])
    file = out / "benchmarks/toy/rows.json"
    other = out / "other.json"
    other.write_text(json.dumps([first | {"capture": "ball"}]))
    with pytest.raises(InputError, match="one capture, found rover and ball"):
        mattgs("compare", f"{file}:{name_of(first)}", other, "--no-browser", "--out", out)
    failed = first | {"status": "failed", "reason": "no views", "metrics": {}}
    other.write_text(json.dumps([failed]))
    with pytest.raises(InputError, match="expected a finished run, found failed"):
        mattgs("compare", f"{file}:{name_of(first)}", other, "--no-browser", "--out", out)
    with pytest.raises(InputError, match=r"rows\.json: expected FILE:NAME with one of"):
        mattgs("compare", file, other, "--no-browser", "--out", out)
    with pytest.raises(InputError, match="found no such run"):
        mattgs("compare", "nobody", other, "--no-browser", "--out", out)
