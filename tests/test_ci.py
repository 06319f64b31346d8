"""What CI runs exists: the script's commands, the workflow's structure, the options they use."""

import itertools
import os
import re
import shlex
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from flows.cli.app import app

ROOT = Path(__file__).resolve().parents[1]
SCRIPT = ROOT / ".ci" / "run"
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def load(path: Path) -> dict[Any, Any]:
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert isinstance(document, dict)
    return document


def commands(path: Path) -> list[str]:
    return [
        step["run"] for job in load(path)["jobs"].values() for step in job["steps"] if "run" in step
    ]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_a_workflow_has_the_structure_that_github_asks_for(path: Path) -> None:
    document = load(path)
    triggers = document[True]  # YAML 1.1 reads the key `on` so
    assert {"pull_request", "schedule"} <= triggers.keys()
    for entry in triggers["schedule"]:
        assert len(entry["cron"].split()) == 5
    for job in document["jobs"].values():
        assert job["runs-on"]
        assert 0 < job["timeout-minutes"] <= 360
        for step in job["steps"]:
            assert len({"uses", "run"} & step.keys()) == 1
            assert step.keys() <= {"name", "uses", "run", "with", "if", "env", "id"}
            if "uses" in step:
                assert re.fullmatch(r"[\w-]+/[\w-]+@v\d+", step["uses"])
    text = path.read_text(encoding="utf-8")
    assert text.count("${{") == text.count("}}")


def test_there_is_a_workflow() -> None:
    assert [path.name for path in WORKFLOWS] == ["gate.yml"]


def lines(command: str) -> list[list[str]]:
    """Return the words of each call of a command of ``mattgs`` in the script."""
    text = SCRIPT.read_text(encoding="utf-8").replace("\\\n", " ")
    found = [line for line in text.splitlines() if f".venv/bin/mattgs {command}" in line]
    return [shlex.split(line.partition("||")[0]) for line in found]


@pytest.mark.parametrize("command", ["run", "gate"])
def test_the_script_calls_commands_with_options_that_they_have(command: str) -> None:
    known = CliRunner().invoke(app, [command, "--help"], terminal_width=200).output
    called = lines(command)
    assert called
    for word in itertools.chain(*called):
        if word.startswith("--"):
            assert f"{word} " in known, word


def test_the_gate_that_decides_is_of_the_committed_benchmark_and_must_see() -> None:
    text = SCRIPT.read_text(encoding="utf-8")
    decides = lines("gate")[-1]
    assert shlex.split(text.rstrip().splitlines()[-1]) == decides, "it is the script's last command"
    name = decides[decides.index("--baseline") + 1]
    assert (ROOT / "reports" / "gate" / "baselines" / f"{name}.json").is_file()
    assert f"config=benchmarks/{name}.toml" in text
    assert f"baseline=reports/gate/baselines/{name}.json" in text
    assert "--must-see" in decides


def test_the_workflow_runs_the_script_and_nothing_else_of_the_project() -> None:
    for path in WORKFLOWS:
        own = [command for command in commands(path) if "GITHUB_STEP_SUMMARY" not in command]
        assert own == [".ci/run"]


@pytest.mark.parametrize("code", [0, 1, 2, 3])
@pytest.mark.parametrize("benchmark", [0, 2, 3])
def test_the_script_ends_as_the_gate_does(tmp_path: Path, code: int, benchmark: int) -> None:
    mattgs = f"#!/bin/sh\n[ $1 = gate ] && exit {code}; exit {benchmark}"
    assert script_with(tmp_path, mattgs) == code


def script_with(tmp_path: Path, mattgs: str, **variables: str) -> int:
    """Run the script with stand-ins for the commands: tried is what it makes of their codes."""
    script = tmp_path / ".ci" / "run"
    for path, text in (
        (script, SCRIPT.read_text(encoding="utf-8")),
        (tmp_path / ".venv/bin/mattgs", mattgs),
        (tmp_path / "bin" / "make", "#!/bin/sh\nexit 0"),
    ):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        path.chmod(0o755)
    paths = f"{tmp_path / 'bin'}:{os.environ['PATH']}"
    environment = os.environ | {"PATH": paths} | variables
    return subprocess.run([script], env=environment, check=False, timeout=60).returncode


def test_rows_of_an_earlier_run_are_not_judged(tmp_path: Path) -> None:
    """The benchmark cannot be read, and the folder that ``OUT`` names holds one that ended."""
    rows = tmp_path / "out/benchmarks/quick-ci/rows.json"
    rows.parent.mkdir(parents=True)
    rows.write_text("[]")
    gate = f"#!/bin/sh\n[ $1 = run ] && exit 2; [ -e {rows} ] || exit 2"
    assert script_with(tmp_path, gate, OUT=str(tmp_path / "out")) == 2
    assert not rows.exists()


def test_the_script_is_a_program_that_bash_can_read() -> None:
    assert SCRIPT.stat().st_mode & 0o111
    subprocess.run(["bash", "-n", SCRIPT], check=True, timeout=60)
