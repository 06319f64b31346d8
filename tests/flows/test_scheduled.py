"""Schedules: the pool's file and the serving process say the same, and all of it can be loaded."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from prefect.client.schemas.schedules import CronSchedule
from prefect.flows import load_flow_from_entrypoint

from flows.scheduled import SCHEDULES

ROOT = Path(__file__).resolve().parents[2]


def deployed() -> list[dict[str, Any]]:
    text = (ROOT / "prefect.yaml").read_text(encoding="utf-8")
    return list(yaml.safe_load(text)["deployments"])


def test_the_pools_file_and_the_serving_process_say_the_same() -> None:
    in_file = {
        (entry["entrypoint"].rpartition(":")[2], entry["name"]): (
            entry["description"],
            [schedule["cron"] for schedule in entry.get("schedules", [])],
            entry["parameters"],
        )
        for entry in deployed()
    }
    in_code = {
        (s.flow.fn.__name__, s.name): (s.description, [s.cron] if s.cron else [], s.parameters)
        for s in SCHEDULES
    }
    assert in_file == in_code
    assert all(entry["work_pool"]["name"] == "mattgs" for entry in deployed())


@pytest.mark.parametrize("entry", deployed(), ids=lambda entry: entry["entrypoint"] + entry["name"])
def test_each_deployment_can_be_loaded_and_takes_its_parameters(
    entry: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    flow = load_flow_from_entrypoint(entry["entrypoint"])
    flow.validate_parameters(entry["parameters"])
    for schedule in entry.get("schedules", []):
        CronSchedule(cron=schedule["cron"], timezone="UTC")


def test_an_unknown_schedule_is_refused_by_name(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "flows.cli.app",
        "serve",
        "grid/hourly",
        "--out",
        str(tmp_path),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 2
    assert done.stderr.startswith("mattgs: grid/hourly: expected one of grid/nightly")
