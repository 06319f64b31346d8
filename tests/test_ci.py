"""What CI runs exists: the script's commands, the workflow's structure, the options they use."""

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


@pytest.mark.parametrize("path", [ROOT / ".ci" / "run", *WORKFLOWS], ids=lambda path: path.name)
def test_the_gate_is_called_with_options_that_it_has(path: Path) -> None:
    if path.suffix == ".yml":
        (line,) = [command for command in commands(path) if "mattgs gate" in command]
    else:
        text = path.read_text(encoding="utf-8").replace("\\\n", " ")
        (line,) = [row for row in text.splitlines() if "mattgs gate" in row]
    words = shlex.split(line.partition("||")[0])
    known = CliRunner().invoke(app, ["gate", "--help"], terminal_width=200).output
    for word in words:
        if word.startswith("--"):
            assert f"{word} " in known, word
    config = words[words.index("--config") + 1]
    assert (ROOT / config).is_file()
    name = words[words.index("--baseline") + 1]
    assert (ROOT / "reports" / "baselines" / f"{name}.json").is_file()


def test_the_script_is_a_program_that_bash_can_read() -> None:
    script = ROOT / ".ci" / "run"
    assert script.stat().st_mode & 0o111
    subprocess.run(["bash", "-n", script], check=True, timeout=60)
