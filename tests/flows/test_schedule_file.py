"""A folder's ``prefect.yaml`` is what is served; mistakes in it are named."""

from pathlib import Path

import pytest

from flows.schedule_file import deployments
from flows.scheduled import DEPLOYMENTS, runner_deployments
from flows.starter.write import SCHEDULE, write
from mattgs_ops.errors import InputError

GRID = "deployments: [{name: a, entrypoint: flows.scheduled.grid,"
ROOT = Path(__file__).resolve().parents[2]


def test_the_written_schedule_is_served_with_its_parameters(tmp_path: Path) -> None:
    write(tmp_path, name="mine")
    (one,) = deployments(tmp_path / SCHEDULE)
    assert (str(one), one.cron) == ("nightly/mine", "0 1 * * *")
    (served,) = runner_deployments(frozenset(), tmp_path, (one,))
    settings = served.parameters["settings"]
    assert settings["config"] == "benchmark.toml"
    assert settings["gate"] == {"baseline": "baseline.json"}
    assert settings["out"] == str(tmp_path)


def test_the_projects_own_file_lists_the_projects_own_deployments(tmp_path: Path) -> None:
    assert deployments(tmp_path / "prefect.yaml") is DEPLOYMENTS
    found = deployments(ROOT / "prefect.yaml")
    assert [(str(one), one.cron) for one in found] == [(str(o), o.cron) for o in DEPLOYMENTS]
    assert [one.parameters() for one in found] == [one.parameters() for one in DEPLOYMENTS]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[", "expected a readable YAML file"),
        ("name: x", "expected a list `deployments`, found None"),
        ("deployments: [{name: a, entrypoint: 'mine.py:flow'}]", "a: `entrypoint`: expected one"),
        (f"{GRID} parameters: {{settings: {{iterations: many}}}}}}]", "a: `parameters`"),
        (
            f"{GRID} parameters: {{settings: {{}}}}, schedules: [{{interval: 60}}]}}]",
            "a: `schedules`: expected one with `cron`",
        ),
    ],
)
def test_mistakes_are_named(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "prefect.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        deployments(file)
