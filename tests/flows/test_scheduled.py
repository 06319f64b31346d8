"""Deployments: one list makes the work pool's file and what is served; a server has their forms."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from prefect import Flow
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.client.schemas.schedules import CronSchedule
from prefect.exceptions import PrefectHTTPStatusError
from prefect.flows import load_flow_from_entrypoint
from prefect.settings import PREFECT_API_URL, temporary_settings

from flows import forms
from flows.cli.options import benchmark_config
from flows.scheduled import DEPLOYMENTS, prefect_file, runner_deployments
from mattgs_ops.config import BUNDLED, CONDITIONS

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
    flow: Flow[..., Any] = load_flow_from_entrypoint(entry["entrypoint"])
    flow.validate_parameters(entry["parameters"])
    for schedule in entry.get("schedules", []):
        CronSchedule(cron=schedule["cron"], timezone="UTC")


@pytest.fixture(scope="module")
def client(
    prefect_api: str, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[SyncPrefectClient]:
    """Give the deployments to a server, as `mattgs serve` does; yield a client of it."""
    with temporary_settings({PREFECT_API_URL: prefect_api}):
        for one in runner_deployments(frozenset(), tmp_path_factory.mktemp("out")):
            one.apply()
        with get_client(sync_client=True) as client:
            yield client


def settings_of(client: SyncPrefectClient, name: str) -> dict[str, Any]:
    """Return the fields of a deployment's form."""
    schema = client.read_deployment_by_name(name).parameter_openapi_schema
    assert schema is not None
    reference = schema["properties"]["settings"]["$ref"].rpartition("/")[2]
    return dict(schema["definitions"][reference]["properties"])


def test_the_server_has_a_form_with_menus_and_limits(client: SyncPrefectClient) -> None:
    fields = settings_of(client, "grid/weekly")
    needed = {"captures", "conditions", "iterations", "resolution", "seeds", "store"}
    assert needed <= fields.keys()
    assert {"stage_timeout", "threads", "workers"} <= fields.keys(), "budgets"
    menus = {name: fields[name]["anyOf"][0]["items"]["enum"] for name in ("captures", "conditions")}
    assert set(menus["captures"]) == set(BUNDLED)
    assert set(menus["conditions"]) == set(CONDITIONS)
    assert fields["iterations"]["anyOf"][0]["minimum"] == 1
    assert all(field["title"] for field in fields.values())
    assert "gate" in settings_of(client, "nightly/quick")


def test_a_forms_menus_are_what_the_configuration_knows() -> None:
    assert forms.Bundled.__args__ == BUNDLED  # type: ignore[attr-defined]
    assert forms.Built.__args__ == CONDITIONS  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "settings", [{"name": "w", "iterations": 0}, {"name": "w", "conditions": ["nobg-theirs"]}]
)
def test_the_server_refuses_what_does_not_fit_the_form(
    client: SyncPrefectClient, settings: dict[str, Any]
) -> None:
    deployment = client.read_deployment_by_name("grid/weekly")
    with pytest.raises(PrefectHTTPStatusError, match=r"409|422"):
        client.create_flow_run_from_deployment(deployment.id, parameters={"settings": settings})
    good = {"name": "w", "iterations": 1, "conditions": ["nobg-3dgs"]}
    run = client.create_flow_run_from_deployment(deployment.id, parameters={"settings": good})
    assert run.parameters["settings"] == good


def test_an_empty_field_is_as_the_file_says_and_a_filled_one_overrides_it(tmp_path: Path) -> None:
    (tmp_path / "b.toml").write_text('iterations = 70\nconditions = ["nobg-3dgs"]\n')
    form = forms.GridForm(name="w", config=tmp_path / "b.toml", iterations=50, retries=3)
    config = benchmark_config(form.config, form.options())
    assert (config.name, config.iterations, config.conditions) == ("w", 50, ("nobg-3dgs",))
    assert (config.run.retries, config.run.workers) == (3, 0)


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
