"""A folder's ``prefect.yaml`` is what is served; mistakes in it are named."""

from pathlib import Path

import pytest
from prefect.client.schemas.schedules import CronSchedule

from flows.schedule_file import deployments
from flows.scheduled import DEPLOYMENTS, runner_deployments
from flows.starter.write import SCHEDULE, write
from mattgs_ops.errors import InputError

GRID = "deployments: [{name: a, entrypoint: flows.scheduled.grid,"
SET = f"{GRID} parameters: {{settings: {{}}}},"
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
            f"{SET} schedules: [{{interval: 60}}]}}]",
            "a: `schedules`: expected one with `cron`",
        ),
        (f"{SET} schedule: {{cron: 0 1 * * *}}}}]", "a: `schedule`: expected a list, `schedules`"),
        (
            f"{SET} schedules: [{{cron: 0 1 * * *, parameters: {{}}}}]}}]",
            "and perhaps `timezone` and `active`, found cron, parameters",
        ),
        (
            f"{SET} schedules: [{{cron: 99 1 * * *}}]}}]",
            r"a: `schedules`: '99 1 \* \* \*', None: ",
        ),
        (
            f"{SET} schedules: [{{cron: 0 1 * * *, timezone: Mars}}]}}]",
            r"a: `schedules`: '0 1 \* \* \*', 'Mars': .*timezone",
        ),
        (f"{SET} paused: sometimes}}]", "a: `paused`: expected true or false, found 'sometimes'"),
        (
            f"{SET.replace('name: a', 'name: 2024-05-01')}}}]",
            "`name`: expected one in quotes, found datetime.date",
        ),
        (f"{SET.replace('name: a, ', '')}}}]", "`name`: expected one in quotes"),
    ],
)
def test_mistakes_are_named(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "prefect.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        deployments(file)


def test_a_schedule_has_its_time_zone_and_rests_where_it_says_so(tmp_path: Path) -> None:
    file = tmp_path / "prefect.yaml"
    zone = "timezone: Europe/Berlin, active: false"
    file.write_text(f"{SET} paused: true, schedules: [{{cron: 0 1 * * *, {zone}}}]}}]")
    listed = deployments(file)
    assert listed[0].when == "0 1 * * * Europe/Berlin, paused"
    (served,) = runner_deployments(frozenset(), tmp_path, listed)
    assert served.paused
    assert served.schedules is not None
    (one,) = served.schedules
    assert not one.active
    assert isinstance(one.schedule, CronSchedule)
    assert (one.schedule.cron, one.schedule.timezone) == ("0 1 * * *", "Europe/Berlin")


@pytest.mark.parametrize("name", ["2024-05-01", "2024", "010", "no", "on", "null", "1e3"])
def test_a_folder_whose_name_is_no_word_to_yaml_keeps_it(tmp_path: Path, name: str) -> None:
    write(tmp_path, name=name)
    (one,) = deployments(tmp_path / SCHEDULE)
    assert str(one) == f"nightly/{name}"
    assert one.parameters()["settings"]["name"] == name


def test_what_is_printed_of_a_deployment_says_when_it_runs() -> None:
    assert [one.when for one in DEPLOYMENTS] == [
        "0 1 * * *",
        "0 8 * * 6",
        "on request",
        "on request",
    ]
