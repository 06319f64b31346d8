"""Deployments: the work pool's file is generated from the list, and all of it can be loaded."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from prefect.client.schemas.schedules import CronSchedule
from prefect.flows import load_flow_from_entrypoint

from flows.scheduled import DEPLOYMENTS, prefect_file

ROOT = Path(__file__).resolve().parents[2]


def deployed() -> list[dict[str, Any]]:
    text = (ROOT / "prefect.yaml").read_text(encoding="utf-8")
    return list(yaml.safe_load(text)["deployments"])


def test_the_work_pools_file_is_what_the_code_generates() -> None:
    assert (ROOT / "prefect.yaml").read_text(encoding="utf-8") == prefect_file()
    names = [f"{entry['entrypoint'].rpartition(':')[2]}/{entry['name']}" for entry in deployed()]
    assert names == [str(one) for one in DEPLOYMENTS]


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
    assert done.stderr.startswith("mattgs: grid/hourly: expected one of nightly/quick")
