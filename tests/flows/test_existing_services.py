"""A benchmark on services that somebody else runs, whose workers share nothing but these.

Prefect by a profile, Dask over TLS, an S3 store, an MLflow server, a webhook; all of them are real
and on loopback. Two workers have a folder each, and see neither the other's nor the flow's. Most of
the grid fails: one capture has two photos only, another is noise, so that no view can be placed; on
the third one method diverges at its first step. Branches that fail never stop the others: rows say
why, tables show holes, the exit code tells.
"""

import itertools
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import numpy as np
import pytest
from PIL import Image
from prefect import flow
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.client.schemas.actions import GlobalConcurrencyLimitCreate
from prefect.client.schemas.filters import LogFilter, LogFilterFlowRunId, LogFilterTaskRunId
from prefect.client.schemas.objects import FlowRun, TaskRun
from prefect.settings import PREFECT_API_URL, temporary_settings

from benchmarks import tiny
from benchmarks.two_machines import BUCKET, WORKERS, mlflow_server, object_store, wait_for
from flows.prefect_ui import artifacts
from reports.tables.tables import HOLE
from tests.flows.loopback import dask_over_tls, webhook

pytestmark = pytest.mark.slow

CONDITIONS = ("nobg-3dgs", "nobg-ours", "nobg-wild")
MORE = """
retries = 3
[methods.wild]
weighting = "residual"
weight = 1e39 # infinite as a 32-bit number
[[captures]]
name = "pair"
path = "pair"
[[captures]]
name = "noise"
path = "noise"
"""
FEW, NOISE = "found 2 photos; at least 3", "none of 28 pairs of views shows the same scene"
REASONS = {
    **{("pair", condition): FEW for condition in CONDITIONS},
    **{("noise", condition): NOISE for condition in CONDITIONS},
    ("board", "nobg-wild"): "the loss is nan",
}
TIMEOUT = 540


@dataclass(frozen=True)
class Ran:
    """One run: its folder, what it printed, what the webhook got, and the server that has it."""

    folder: Path
    code: int
    printed: str
    posts: list[dict[str, Any]]
    client: SyncPrefectClient
    run: FlowRun
    tasks: dict[str, TaskRun]
    dask: str


@pytest.fixture(scope="module")
def ran(
    tmp_path_factory: pytest.TempPathFactory, prefect_api: str, certificates: Path
) -> Iterator[Ran]:
    """Run the tiny benchmark once."""
    folder = tmp_path_factory.mktemp("existing")
    config = tiny.write(folder)
    config.write_text(config.read_text() + MORE)
    write_bad_captures(folder)
    (folder / "out").mkdir()
    profiles = folder / "home" / ".prefect" / "profiles.toml"
    profiles.parent.mkdir(parents=True)
    profiles.write_text(f'active = "lab"\n[profiles.lab]\nPREFECT_API_URL = "{prefect_api}"\n')
    kept = {key: value for key, value in os.environ.items() if not key.startswith("PREFECT_")}
    environment = kept | {"HOME": str(folder / "home"), "TMPDIR": str(folder / "out")}
    with ExitStack() as stack:
        tracking = stack.enter_context(mlflow_server(folder))
        environment |= {"MLFLOW_TRACKING_URI": tracking}
        environment |= stack.enter_context(object_store())
        stack.enter_context(temporary_settings({PREFECT_API_URL: prefect_api}))
        client = stack.enter_context(get_client(sync_client=True))
        limit = GlobalConcurrencyLimitCreate(name="tag:stage:train", limit=1)
        client.create_global_concurrency_limit(limit)
        address, posts = stack.enter_context(webhook())
        hidden = [folder / name for name in ("out", "photos", "noise", "pair")]
        scheduler = stack.enter_context(dask_over_tls(folder, certificates, environment, hidden))
        wait_for(f"{tracking}/health")
        command = [sys.executable, "-m", "flows.cli.app", "run", "--config", str(config)]
        command += ["--conditions", ",".join(CONDITIONS), "--out", str(folder / "out")]
        command += ["--dask-scheduler", scheduler, "--dask-certificates", str(certificates)]
        command += ["--store", f"s3://{BUCKET}/store"]
        command += ["--notify", f"{address}/secret"]
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=TIMEOUT, check=False
        )
        runs = client.read_flow_runs()
        assert len(runs) == 1, done.stdout + done.stderr
        tasks = {task.name: task for task in client.read_task_runs(limit=200)}
        printed = done.stdout + done.stderr
        yield Ran(folder, done.returncode, printed, posts, client, runs[0], tasks, scheduler)


def write_bad_captures(folder: Path) -> None:
    """Write eight photos of noise, and two of them as another capture."""
    rng = np.random.default_rng(3)
    for name, count in (("noise", 8), ("pair", 2)):
        (folder / name).mkdir()
        for index in range(count):
            noise = rng.integers(0, 256, (48, 64, 3), dtype=np.uint8)
            Image.fromarray(noise).save(folder / name / f"{index}.png")


def logs(ran: Ran, task: str | None = None) -> list[str]:
    """Return the log of the flow run, or of one of its task runs, as the interface shows it."""
    if task is None:
        chosen = LogFilter(flow_run_id=LogFilterFlowRunId(any_=[ran.run.id]))
    else:
        chosen = LogFilter(task_run_id=LogFilterTaskRunId(any_=[ran.tasks[task].id]))
    return [log.message for log in ran.client.read_logs(chosen, limit=200)]


def test_a_profiles_server_has_the_run_and_the_terminal_says_which(
    ran: Ran, prefect_api: str
) -> None:
    assert ran.code == 3, ran.printed
    assert f"\nPrefect: {prefect_api}\n" in f"\n{ran.printed}"
    assert (ran.run.name, ran.run.state_name) == ("tiny", "Failed")
    assert not (ran.folder / "out" / "prefect").exists(), "no server and no home of our own"


def test_task_runs_have_tags_and_the_benchmarks_retries(ran: Ran) -> None:
    train = ran.tasks["train board nobg-ours seed 0"]
    assert set(train.tags) == {
        "stage:train",
        "benchmark:tiny",
        "capture:board",
        "condition:nobg-ours",
        "seed:0",
    }
    assert set(ran.tasks["sfm board"].tags) == {"stage:sfm", "benchmark:tiny", "capture:board"}
    assert {task.empirical_policy.retries for task in ran.tasks.values()} == {3}


def test_a_limit_on_a_tag_keeps_trainings_apart(ran: Ran) -> None:
    found = [task for name, task in ran.tasks.items() if name.startswith("train board ")]
    times = sorted((task.start_time, task.end_time) for task in found)
    assert len(times) == len(CONDITIONS), "of the one capture that can be trained"
    for (_, ended), (began, _) in itertools.pairwise(times):
        assert ended is not None
        assert began is not None
        assert ended <= began


@pytest.mark.parametrize("stage", ["prepare board", "sfm board", "train board nobg-3dgs seed 0"])
def test_the_log_of_a_task_run_is_its_stages(ran: Ran, stage: str) -> None:
    lines = logs(ran, stage)
    if stage.startswith("prepare"):  # before the flow, which then finds it
        assert any(line.startswith(f"{stage}: found in the store") for line in lines), lines
        return
    assert any(re.match(rf"{stage}: begins with \d threads; log: /", line) for line in lines), lines
    assert any(line.startswith(f"{stage}: done in ") for line in lines), lines


def test_what_a_stages_process_prints_is_in_the_log_of_its_task_run(ran: Ran) -> None:
    lines = logs(ran, "train board nobg-wild seed 0")
    assert "Traceback (most recent call last):" in lines, "of the process, line by line"
    assert any("the loss is nan" in line for line in lines)


def test_the_log_of_the_flow_run_says_how_each_experiment_ended(ran: Ran) -> None:
    text = "\n".join(logs(ran))
    assert "board nobg-3dgs seed 0: PSNR " in text
    assert "board nobg-wild seed 0: failed: " in text


def test_the_dashboard_of_dask_is_printed_and_an_artifact_that_opens(ran: Ran) -> None:
    (artifact,) = [one for one in ran.client.read_artifacts() if one.key == "dask-tiny"]
    line = next(line for line in ran.printed.splitlines() if line.startswith("Dask: "))
    address = line.removeprefix("Dask: ")
    assert address in str(artifact.data)
    with urlopen(address, timeout=20) as page:
        assert page.status == 200


def published(ran: Ran, key: str) -> str:
    (artifact,) = [one for one in ran.client.read_artifacts() if one.key == key]
    assert artifact.type == "markdown"
    return str(artifact.data)


def test_the_artifact_of_the_report_leads_to_its_page_in_mlflow(ran: Ran) -> None:
    link = re.fullmatch(r"\[Report of tiny\]\((.+)\)", published(ran, "report-tiny"))
    assert link is not None
    server, _, page = link[1].partition("/#/")
    place = r"experiments/\d+/runs/(\w+)/artifacts/(report/report\.html)"
    found = re.fullmatch(place + r"\?workflowType=machine_learning", page)
    assert found is not None
    run, path = found.groups()
    with urlopen(f"{server}/get-artifact?run_uuid={run}&path={path}", timeout=20) as served:
        assert served.read() == (ran.folder / "out/benchmarks/tiny/report.html").read_bytes()


def test_without_a_server_for_reports_the_artifact_names_the_file_and_has_no_dead_link(
    ran: Ran,
) -> None:
    report = ran.folder / "report.html"
    flow(artifacts.publish_results)("unserved", [], report, None)
    text = published(ran, "report-unserved")
    assert str(report) in text
    assert "file://" not in text
    assert "](" not in text


def test_a_failed_run_sends_one_message(ran: Ran) -> None:
    (post,) = ran.posts
    assert post["flow"] == "benchmark"
    assert post["run"] == str(ran.run.id)
    assert post["text"].startswith("MATT-GS Bench: benchmark tiny: Failed\n")
    assert f"{len(REASONS)} of 9 experiments failed; report: " in post["text"]


def rows_of(ran: Ran) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = json.loads(
        (ran.folder / "out/benchmarks/tiny/rows.json").read_text()
    )
    return rows


def test_each_experiment_has_a_row_that_says_how_it_ended(ran: Ran) -> None:
    assert "Traceback" not in ran.printed
    rows = rows_of(ran)
    assert all(row["run_id"] for row in rows), "failures are recorded too"
    by_cell = {(row["capture"], row["condition"]): row for row in rows}
    finished = {cell for cell, row in by_cell.items() if row["status"] == "finished"}
    assert finished == {("board", "nobg-3dgs"), ("board", "nobg-ours")}
    assert by_cell.keys() == {*finished, *REASONS}
    for cell, reason in REASONS.items():
        assert by_cell[cell]["status"] == "failed"
        assert reason in by_cell[cell]["reason"]


def test_each_worker_has_trained_and_what_it_made_came_through_the_store(ran: Ran) -> None:
    trained = {name: len(list((ran.folder / name).glob("logs/train-*.log"))) for name in WORKERS}
    assert min(trained.values()) > 0, trained
    assert not list((ran.folder / "out").glob("logs/train-*")), "the flow's machine has not"
    rows = rows_of(ran)
    finished = [row for row in rows if row["status"] == "finished"]
    for row in finished:
        splats = ran.folder / "out" / "store" / row["artifacts"]["train"] / "splats.ply"
        assert splats.is_file()


def test_tables_show_holes_where_an_experiment_failed(ran: Ran) -> None:
    report = (ran.folder / "out/benchmarks/tiny/report.md").read_text()
    (table,) = re.findall(r"^### Table [^\n]*board.*?(?=^#)", report, re.MULTILINE | re.DOTALL)
    wild, healthy = (line_of(table, name) for name in ("wild", "3DGS"))
    assert set(wild[1:-1]) == {HOLE.text}  # the last column names the run
    assert HOLE.text not in healthy
    assert re.search(r"wild, seed 0 failed: .*the loss is nan", table)


def line_of(table: str, method: str) -> list[str]:
    """Return the cells of a method's line in a Markdown table, from the method on."""
    lines = [line.split("|")[2:-1] for line in table.splitlines() if line.startswith("|")]
    (found,) = (cells for cells in lines if cells[0].strip().startswith(method))
    return [cell.strip() for cell in found]
