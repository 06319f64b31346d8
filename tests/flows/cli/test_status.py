"""What ``mattgs status`` says of each experiment."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from flows import run_record
from flows.cli import status
from flows.grid import experiments, stages
from mattgs_ops.config import BenchmarkConfig
from mattgs_ops.naming import slug
from tasks.stages.status import StatusFile, read_all


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return the status of a grid of which nothing has begun."""
    config = BenchmarkConfig.model_validate(
        {"name": "b", "captures": [{"name": "rover"}], "conditions": ["nobg-3dgs", "nobg-ours"]}
    )
    for kind, title in stages(config):
        file(tmp_path / "status" / "b", title).plan(title, kind)
    return tmp_path / "status" / "b"


def file(folder: Path, title: str) -> StatusFile:
    return StatusFile(folder / f"{slug(title)}.json")


def end(folder: Path, title: str, state: str, note: str = "") -> None:
    file(folder, title).begin(title, title.split(maxsplit=1)[0])
    file(folder, title).end(state, note)  # type: ignore[arg-type]


def states(folder: Path) -> dict[str, str]:
    return {one.name: one.state for one in experiments(read_all(folder))}


def test_what_a_dead_process_left_is_interrupted(folder: Path) -> None:
    path = file(folder, "sfm rover").path
    program = "import sys; from pathlib import Path; from tasks.stages.status import StatusFile; "
    program += "StatusFile(Path(sys.argv[1])).begin('sfm rover', 'sfm')"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    subprocess.run([sys.executable, "-c", program, str(path)], check=True, env=environment)
    assert set(states(folder).values()) == {"interrupted"}
    file(folder, "sfm rover").begin("sfm rover", "sfm")
    assert set(states(folder).values()) == {"running"}


def test_what_waits_for_a_run_that_is_over_is_interrupted(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C between two stages leaves no stage that is running."""

    def told() -> str:
        status.print_status(folder.parents[1], "b")
        return capsys.readouterr().out.splitlines()[0]

    end(folder, "prepare rover", "done")
    assert told() == "Benchmark b: 2 experiments: 2 running", "without a record nothing tells"
    benchmark = folder.parents[1] / "benchmarks" / "b"
    record = run_record.begin(benchmark)
    assert told() == "Benchmark b: 2 experiments: 2 running"
    with monkeypatch.context() as killed:
        killed.setattr(run_record, "gone", lambda process, _: process == os.getpid())
        assert told() == "Benchmark b: 2 experiments: 2 interrupted"
    run_record.end(benchmark, record, "KeyboardInterrupt")
    assert told() == "Benchmark b: 2 experiments: 2 interrupted"


def test_a_run_that_broke_off_after_its_last_stage_is_not_just_done(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def told() -> list[str]:
        status.print_status(folder.parents[1], "b")
        lines = capsys.readouterr().out.splitlines()
        assert lines[0] == "Benchmark b: 2 experiments: 2 done"
        return [line for line in lines if line.startswith("!")]

    for one in read_all(folder):
        end(folder, one.title, "done")
    assert told() == [], "without a record nothing tells"
    benchmark = folder.parents[1] / "benchmarks" / "b"
    record = run_record.begin(benchmark, "tonight")
    assert told() == []
    with monkeypatch.context() as killed:
        killed.setattr(run_record, "gone", lambda process, _: process == os.getpid())
        run = f"! the run tonight, begun {record.began},"
        assert told() == [f"{run} has not ended: its process is gone"]
    run_record.end(benchmark, record, "it was interrupted")
    assert told() == [f"{run} broke off: it was interrupted"]
    (benchmark / "rows.json").write_text("[]")
    run_record.end(benchmark, run_record.begin(benchmark))
    assert told() == []


def test_nothing_is_cut_at_eighty_columns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    grid = {"name": "b", "captures": [{"name": "lattepanda"}], "budgets": [10_000]}
    for kind, title in stages(BenchmarkConfig.model_validate(grid)):
        file(tmp_path / "status" / "b", title).begin(title, kind)
        file(tmp_path / "status" / "b", title).progress(1, 3, "")
    monkeypatch.setattr(status, "NARROWEST", 80)
    monkeypatch.setenv("COLUMNS", "80")
    status.print_status(tmp_path, None)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    text = " ".join(" ".join(lines).split())
    assert text.count("…") == text.count("33 % ") == 5 + 6 * 3
    for words in ("prepare segment sfm agree measure", "State train truth evaluate", "nobg-ours+"):
        assert words in text


def test_reasons_stand_below_the_table(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    end(folder, "sfm rover", "failed", "no pair of views shows the same scene")
    status.print_status(folder.parents[1], None)
    told = capsys.readouterr().out
    assert "Benchmark b: 2 experiments: 2 failed" in told
    assert told.count("✗ sfm rover: no pair of views shows the same scene") == 1
