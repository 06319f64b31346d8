"""``mattgs gate`` and ``mattgs baseline``: what they say, write and exit with."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from flows.cli import run as running
from flows.cli.app import app
from flows.grid import cells
from mattgs_ops.config import BenchmarkConfig
from mattgs_ops.config_file import load_toml
from mattgs_ops.errors import InputError, StageError
from reports.gate import baseline
from tasks.row import config_digest
from tasks.stages.capture_files import capture_digest

ROOT = Path(__file__).resolve().parents[3]
CONFIG = ROOT / "benchmarks" / "quick-ci.toml"
Row = dict[str, Any]
Judged = Callable[..., Result]


@pytest.fixture(scope="module")
def two_seeds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a baseline of the committed one's first two seeds: judged sooner than all five."""
    known = baseline.load("quick-ci")
    path = tmp_path_factory.mktemp("baseline") / "two-seeds.json"
    rows = [row for row in known.rows if row["seed"] < 2]
    baseline.make(rows, "quick-ci", known.noise).save(path)
    return path


@pytest.fixture
def rows(two_seeds: Path) -> list[Row]:
    """Return the rows of two seeds, to be changed: real ones."""
    found: list[Row] = json.loads(two_seeds.read_text())["rows"]
    return found


def write(rows: list[Row], out: Path) -> None:
    folder = out / "benchmarks" / "quick-ci"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "rows.json").write_text(json.dumps(rows))


def mattgs(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def judged(two_seeds: Path) -> Judged:
    """Return a function that judges rows by the baseline of two seeds."""

    def judge(rows: list[Row], out: Path, *more: str) -> Result:
        write(rows, out)
        known = "--baseline", two_seeds, "--benchmark", "quick-ci"
        return mattgs("gate", *known, "--out", out, *more)

    return judge


def lose(row: Row) -> None:
    for view in row["per_view"]:
        if view["split"] == "test":
            view["psnr"] -= 3


def fail(row: Row) -> None:
    row |= {"status": "failed", "reason": "diverged", "metrics": {}, "per_view": []}


def configure(row: Row) -> None:
    row["provenance"]["config_digest"] = "other"


@pytest.mark.parametrize(
    ("change", "code", "word"),
    [
        (dict.copy, 0, "Gate: pass."),
        (lose, 1, "Gate: regression."),
        (configure, 2, "Gate: cannot judge."),
        (fail, 3, "Gate: failed runs."),
    ],
)
def test_exit_codes(
    judged: Judged, rows: list[Row], tmp_path: Path,
    change: Callable[[Row], object], code: int, word: str,
) -> None:  # fmt: skip
    for row in rows:
        change(row)
    done = judged(rows, tmp_path)
    assert done.exit_code == code, done.output
    assert word in done.output
    written = tmp_path / "benchmarks" / "quick-ci" / "gate"
    assert json.loads((written / "gate.json").read_text())["exit_code"] == code
    assert {path.name for path in written.iterdir()} == {"gate.json", "gate.md", "gate.xml"}


def test_speed_of_another_machine_is_told_and_passes(
    judged: Judged, rows: list[Row], tmp_path: Path
) -> None:
    for row in rows:
        for machine in (row["provenance"], row["provenance"].get("measured", {})):
            machine["cpu"] = "Another CPU"
        row["metrics"]["fps_calibrated"] /= 5
    done = judged(rows, tmp_path, "--doubt", "none")
    assert done.exit_code == 0
    assert "another machine (cpu: baseline" in done.output
    assert judged(rows, tmp_path, "--doubt", "all").exit_code == 2


def test_a_configuration_is_run_before_it_is_judged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[BenchmarkConfig] = []

    def run_benchmark(config: BenchmarkConfig, out: Path, *, died: int) -> bool:
        assert died == 3, "failed runs: a service that ends is no regression"
        seen.append(config)
        write(list(baseline.load("quick-ci").rows), out)
        return True

    monkeypatch.setattr(running, "run_benchmark", run_benchmark)
    done = mattgs("gate", "--baseline", "quick-ci", "--config", CONFIG, "--out", tmp_path)
    assert done.exit_code == 0, done.output
    assert [config.name for config in seen] == ["quick-ci"]


def test_a_benchmark_that_cannot_run_is_no_regression(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run_benchmark(config: BenchmarkConfig, out: Path, *, died: int) -> bool:
        raise StageError(f"{config.name}: no server could be started for {out.name}, {died}")

    monkeypatch.setattr(running, "run_benchmark", run_benchmark)
    done = mattgs("gate", "--baseline", "quick-ci", "--config", CONFIG, "--out", tmp_path)
    assert done.exit_code == 2
    assert "no server could be started" in done.output


def test_a_self_check_that_cannot_run_says_nothing_of_the_gate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from flows import gate_self_check

    def run_benchmark(config: BenchmarkConfig, out: Path, *, died: int) -> bool:
        raise StageError(f"the Prefect server did not start: {config.name}, {out.name}, {died}")

    monkeypatch.setattr(gate_self_check, "run_benchmark", run_benchmark)
    done = mattgs("gate", "--self-check", "--config", CONFIG, "--out", tmp_path)
    assert (done.exit_code, done.exception is None) == (2, False)
    assert done.output.startswith("mattgs: the Prefect server did not start: quick-ci")


def test_a_registry_that_does_not_answer_is_told_in_a_line(
    rows: list[Row], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://127.0.0.1:9")
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")  # two, of ours, take seconds
    write(rows, tmp_path)
    options = "--baseline", "main", "--benchmark", "quick-ci", "--out", tmp_path
    done = mattgs("gate", *options)
    assert done.exit_code == 2
    assert done.output.startswith("mattgs: MLflow: ")
    assert "Traceback" not in done.output
    monkeypatch.delenv("MLFLOW_TRACKING_URI")
    assert "found none" in str(mattgs("gate", *options).exception)
    assert not (tmp_path / "mlflow.db").exists(), "looking for an alias makes no registry"


def test_judging_asks_a_registry_no_seven_times(
    judged: Judged, rows: list[Row], tmp_path: Path
) -> None:
    assert "MLFLOW_HTTP_REQUEST_MAX_RETRIES" not in os.environ
    judged(rows, tmp_path)
    assert os.environ["MLFLOW_HTTP_REQUEST_MAX_RETRIES"] == "2"


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ([], "--baseline: expected"),
        (["--baseline", "x.json", "--self-check"], "--self-check: goes with --config only"),
        (["--baseline", "absent.json"], "absent.json"),
        (["--baseline", "quick-ci", "--benchmark", "b", "--config", "c.toml"], "give one of them"),
        (["--baseline", "quick-ci", "--benchmark", "never-run"], "never-run"),
    ],
)
def test_what_cannot_be_used_is_named(tmp_path: Path, arguments: list[str], word: str) -> None:
    done = mattgs("gate", *arguments, "--out", tmp_path)
    assert isinstance(done.exception, InputError), "which main() ends with exit code 2"
    assert word in str(done.exception)


def test_help_states_the_exit_codes() -> None:
    text = " ".join(mattgs("gate", "--help").output.split())
    for stated in ("0 pass", "1 regression", "2 cannot judge", "3 failed runs"):
        assert stated in text


def test_the_self_check_runs_twice_and_tells_rates(
    rows: list[Row], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from flows import gate_self_check

    places: list[Path] = []

    def run_benchmark(config: BenchmarkConfig, out: Path, *, died: int) -> bool:
        assert (config.name, died) == ("quick-ci", 3)
        places.append(out)
        write(rows, out)
        return True

    monkeypatch.setattr(gate_self_check, "run_benchmark", run_benchmark)
    options = "--config", CONFIG, "--comparisons", "10", "--out", tmp_path
    done = mattgs("gate", "--self-check", *options)
    assert len(set(places)) == 2, "nothing shared, or the second run would be the first"
    assert "| 10 | 0.0% |" in done.output
    assert done.exit_code in (0, 1)


def test_a_baseline_is_made_of_a_run(rows: list[Row], tmp_path: Path) -> None:
    write(rows, tmp_path)
    file = tmp_path / "main.json"
    done = mattgs("baseline", file, "--benchmark", "quick-ci", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    made = baseline.load(file)
    assert list(made.rows) == rows
    assert dict(made.noise) == {}
    again = tmp_path / "again.json"
    again.write_text(json.dumps(rows))
    done = mattgs("baseline", file, "--benchmark", "quick-ci", "--again", again, "--out", tmp_path)
    assert "expected runs that differ" in str(done.exception)
    rows[0]["per_view"][0]["psnr"] += 0.1
    again.write_text(json.dumps(rows))
    mattgs("baseline", file, "--benchmark", "quick-ci", "--again", again, "--out", tmp_path)
    assert baseline.load(file).noise["psnr"] > 0


def test_an_experiment_that_failed_before_may_fail_again(rows: list[Row], tmp_path: Path) -> None:
    fail(rows[0])
    rows = rows[:1] + [row for row in rows if row["condition"] != rows[0]["condition"]]
    write(rows, tmp_path)
    file = tmp_path / "main.json"
    made = mattgs("baseline", file, "--benchmark", "quick-ci", "--out", tmp_path)
    assert "1 experiment failed; the gate expects that." in made.output
    done = mattgs("gate", "--baseline", file, "--benchmark", "quick-ci", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    assert "1 still failing" in done.output
    assert "diverged" in done.output


@pytest.mark.parametrize("name", ["afile/out", "afile/deeper/out"])
def test_a_place_that_cannot_be_written_is_no_fault_of_the_gate(tmp_path: Path, name: str) -> None:
    (tmp_path / "afile").touch()
    out = tmp_path / name
    done = mattgs("gate", "--baseline", "quick-ci", "--config", CONFIG, "--out", out)
    assert done.exit_code == 2
    assert "Traceback" not in done.output
    assert done.output.startswith("mattgs: [Errno 20] Not a directory: ")


def test_the_committed_baseline_is_of_the_committed_benchmark() -> None:
    """Fails as soon as a change asks for a new baseline: docs/gate.md says how to make it."""
    config = load_toml(CONFIG)
    known = {
        (row["capture"], row["condition"], row["seed"]): row["provenance"]
        for row in baseline.load("quick-ci").rows
    }
    expected = [cell for capture in config.captures for cell in cells(config, capture.name)]
    assert {(c.capture, c.condition, c.seed) for c in expected} == set(known)
    files = {capture.name: capture_digest(capture) for capture in config.captures}
    for cell in expected:
        origin = known[cell.capture, cell.condition, cell.seed]
        assert origin["config_digest"] == config_digest(config, cell)
        assert origin["inputs"] == {"capture": files[cell.capture]}


def test_a_benchmarks_name_that_leads_elsewhere_is_refused(rows: list[Row], tmp_path: Path) -> None:
    """The verdicts are written beside the rows: both below the output folder."""
    out = tmp_path / "out"
    write(rows, tmp_path)
    name = "../../benchmarks/quick-ci"
    done = mattgs("gate", "--baseline", "quick-ci", "--benchmark", name, "--out", out)
    assert isinstance(done.exception, InputError)
    assert "the benchmark's name: expected letters, digits" in str(done.exception)
    assert f"found {name!r}" in str(done.exception)
    done = mattgs("report", name, "--out", out)
    assert isinstance(done.exception, InputError)
    assert "the benchmark's name: expected letters, digits" in str(done.exception)
    assert not out.exists()
    assert not (tmp_path / "benchmarks" / "quick-ci" / "gate").exists()
