"""A benchmark on services that somebody else runs: Prefect by a profile, Dask over TLS, a webhook.

All of them are real and on loopback. One of the two methods diverges, so that the run fails.
"""

import itertools
import json
import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.client.schemas.actions import GlobalConcurrencyLimitCreate
from prefect.client.schemas.filters import LogFilter, LogFilterFlowRunId, LogFilterTaskRunId
from prefect.client.schemas.objects import FlowRun, TaskRun
from prefect.settings import PREFECT_API_URL, temporary_settings

from benchmarks import tiny
from benchmarks.two_machines import free_port
from flows.services.dask_cluster import CERTIFICATES

pytestmark = pytest.mark.slow

CONDITIONS = ("nobg-3dgs", "nobg-ours", "nobg-wild")
MORE = """
retries = 3
[methods.wild]
weighting = "residual"
weight = 1e39 # infinite as a 32-bit number
"""
TRAININGS = 2  # that the worker would do at a time; the server's limit on their tag is 1
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
    profiles = folder / "home" / ".prefect" / "profiles.toml"
    profiles.parent.mkdir(parents=True)
    profiles.write_text(f'active = "lab"\n[profiles.lab]\nPREFECT_API_URL = "{prefect_api}"\n')
    kept = {key: value for key, value in os.environ.items() if not key.startswith("PREFECT_")}
    environment = kept | {"HOME": str(folder / "home"), "TMPDIR": str(folder)}
    with ExitStack() as stack:
        stack.enter_context(temporary_settings({PREFECT_API_URL: prefect_api}))
        client = stack.enter_context(get_client(sync_client=True))
        limit = GlobalConcurrencyLimitCreate(name="tag:stage:train", limit=1)
        client.create_global_concurrency_limit(limit)
        address, posts = stack.enter_context(webhook())
        scheduler = stack.enter_context(dask_over_tls(folder, certificates, environment))
        command = [sys.executable, "-m", "flows.cli.app", "run", "--config", str(config)]
        command += ["--conditions", ",".join(CONDITIONS), "--out", str(folder / "out")]
        command += ["--dask-scheduler", scheduler, "--dask-certificates", str(certificates)]
        command += ["--notify", f"{address}/secret"]
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=TIMEOUT, check=False
        )
        runs = client.read_flow_runs()
        assert len(runs) == 1, done.stdout + done.stderr
        tasks = {task.name: task for task in client.read_task_runs(limit=200)}
        printed = done.stdout + done.stderr
        yield Ran(folder, done.returncode, printed, posts, client, runs[0], tasks, scheduler)


@contextmanager
def webhook() -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Serve an address that keeps the JSON posted to it."""
    posts: list[dict[str, Any]] = []

    class Keeps(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            posts.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            """Print nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Keeps) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}", posts
        server.shutdown()


@contextmanager
def dask_over_tls(folder: Path, certificates: Path, environment: dict[str, str]) -> Iterator[str]:
    """Run Dask's own commands, as docs/operations.md has them."""
    address = f"tls://127.0.0.1:{free_port()}"
    tls = [
        word
        for name, file in CERTIFICATES.items()
        for word in (f"--tls-{name}", str(certificates / file))
    ]
    dask = [sys.executable, "-m", "dask"]
    scheduler = ["scheduler", "--host", "127.0.0.1", "--port", address.rpartition(":")[2]]
    scheduler += ["--protocol", "tls", "--dashboard-address", "127.0.0.1:0"]
    worker = ["worker", address, "--nthreads", "2", "--resources", f"train={TRAININGS}"]
    worker += ["--no-dashboard", "--death-timeout", "120", "--local-directory", str(folder)]
    commands = [[*dask, *scheduler, *tls], [*dask, *worker, *tls]]
    with (folder / "dask.log").open("ab") as log:
        processes = [
            subprocess.Popen(command, env=environment, cwd=folder, stdout=log, stderr=log)
            for command in commands
        ]
    try:
        wait_for_worker(address, certificates)
        yield address
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait()


def wait_for_worker(address: str, certificates: Path) -> None:
    from distributed import Client
    from distributed.security import Security

    ca, cert, key = (str(certificates / file) for file in CERTIFICATES.values())
    security = Security(tls_ca_file=ca, tls_client_cert=cert, tls_client_key=key)
    with Client(address, security=security, timeout=120, set_as_default=False) as client:
        client.wait_for_workers(1, timeout=120)


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
    found = [task for name, task in ran.tasks.items() if name.startswith("train ")]
    times = sorted((task.start_time, task.end_time) for task in found)
    assert len(times) == len(CONDITIONS)
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


def test_without_a_server_for_reports_the_artifact_names_the_file_and_has_no_dead_link(
    ran: Ran,
) -> None:
    (artifact,) = [one for one in ran.client.read_artifacts() if one.key == "report-tiny"]
    assert artifact.type == "markdown"
    assert str(ran.folder / "out" / "benchmarks" / "tiny" / "report.html") in str(artifact.data)
    assert "file://" not in str(artifact.data)


def test_a_failed_run_sends_one_message(ran: Ran) -> None:
    (post,) = ran.posts
    assert post["flow"] == "benchmark"
    assert post["run"] == str(ran.run.id)
    assert post["text"].startswith("MATT-GS Bench: benchmark tiny: Failed\n")
    assert "1 of 3 experiments failed; report: " in post["text"]
