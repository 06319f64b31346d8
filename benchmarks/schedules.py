"""Schedules shown working: from an empty Prefect server to a finished scheduled run, twice.

First as on a cluster: a work pool, the deployments of `prefect.yaml`, a process worker. Then as on
one machine: `mattgs serve`. The nightly grid is made tiny and due at once. The other deployments
are asked for, made tiny too: the weekly grid, the segmenter's training, and the gate, once against
last night's numbers and once against numbers that nobody reaches, which must fail.

    python benchmarks/schedules.py [--folder DIR] [--only pool|serve]
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks import tiny
from flows.services import embedded
from flows.services.prefect_server import healthy
from flows.services.serve import server
from reports.gate import baseline as baselines
from reports.gate.baseline import Baseline

if TYPE_CHECKING:
    from prefect.client.orchestration import SyncPrefectClient
    from prefect.client.schemas.responses import DeploymentResponse

ROOT = Path(__file__).resolve().parents[1]
NETWORK = """
validate_every = 1
validation_images = 1
[[stages]]
size = 32
batch = 2
steps = 2
"""
DEPLOYMENT = "nightly/quick"
TIMEOUT_SECONDS = 400.0
SOON = timedelta(seconds=10)
PORT = 42_711


def main() -> None:
    """Show both ways; exit code 1 when a scheduled run did not finish."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, help="work here; by default a temporary folder")
    parser.add_argument("--only", choices=["pool", "serve"])
    options = parser.parse_args()
    folder = (options.folder or Path(tempfile.mkdtemp(prefix="mattgs-schedules-"))).resolve()
    tiny.write(folder)
    embedded.enter(folder)
    os.environ["TMPDIR"] = str(folder)
    ways = {"pool": with_a_pool, "serve": with_serve}
    ended = [ways[w](folder / w) for w in ways if options.only in (None, w)]
    sys.exit(0 if all(state == "COMPLETED" for state in ended) else 1)


def with_a_pool(folder: Path) -> str:
    """Deploy to a work pool and let a worker do what is due; return the run's state."""
    with server(folder, PORT) as url:
        os.environ["PREFECT_API_URL"] = url
        say("an empty Prefect server runs")
        prefect("work-pool", "create", "--type", "process", "mattgs")
        prefect("--no-prompt", "deploy", "--all")
        with _started("-m", "prefect", "worker", "start", "--pool", "mattgs", log=folder):
            state = _wait_for_scheduled(folder)
            if state == "COMPLETED" and not others(folder):
                state = "the other deployments did not end as they should"
        del os.environ["PREFECT_API_URL"]
    return state


def others(folder: Path) -> bool:
    """Run the other deployments once; return whether each ended as it should."""
    tiny_config, network = folder.parent / "tiny.toml", folder.parent / "network.toml"
    network.write_text(NETWORK, encoding="utf-8")
    baseline, better = folder / "baseline.json", folder / "better.json"
    say(f"the first night made {baseline.name}: {baseline.is_file()}")
    _better(baselines.load(baseline)).save(better)
    place = {"out": str(folder)}
    night = {"name": "nightly", "config": str(tiny_config), **place}
    weekly = {"name": "weekly", "config": str(tiny_config), "iterations": 40, **place}
    training = {"folder": str(folder / "network"), "config": str(network), **place}
    requests: list[tuple[str, dict[str, Any], int]] = [
        ("nightly/quick", {**night, "gate": {"baseline": str(baseline)}}, 0),
        ("gate/on-request", {"benchmark": "nightly", "baseline": str(better), **place}, 1),
        ("grid/weekly", weekly, 0),
        ("segmenter/training", training, 0),
    ]
    ended = [_requested(name, parameters, code) for name, parameters, code in requests]
    report = folder / "benchmarks" / "weekly" / "report.html"
    onnx = folder / "network" / "u2netp.onnx"
    say(f"weekly's report: {report.is_file()}; {onnx.name}: {onnx.is_file()}\n")
    return all(ended) and report.is_file() and onnx.is_file()


def _requested(name: str, parameters: dict[str, Any], expected: int) -> bool:
    """Run a deployment to its end; return whether its exit code is the expected one."""
    command = [sys.executable, "-m", "prefect", "--no-prompt", "deployment", "run", name]
    command += ["--params", json.dumps({"settings": parameters}), "--watch"]
    began = time.monotonic()
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    took = time.monotonic() - began
    shown = " ".join(f"{key}={Path(str(value)).name}" for key, value in parameters.items())
    say(f"$ prefect deployment run {name} ({shown}): exit {done.returncode}, {took:.0f} s")
    if done.returncode != expected:
        print(done.stdout + done.stderr)
    return done.returncode == expected


def _better(known: Baseline) -> Baseline:
    """Return a baseline whose PSNR is 3 dB higher: what the gate must notice."""
    rows = [
        {**row, "metrics": _raised(row["metrics"]), "per_view": [*map(_raised, row["per_view"])]}
        for row in known.rows
    ]
    return baselines.make(rows, known.name)


def _raised(scores: dict[str, Any]) -> dict[str, Any]:
    """Return scores with 3 dB more; training views have none."""
    return scores | {k: scores[k] + 3.0 for k in ("psnr", "mask_psnr") if k in scores}


def with_serve(folder: Path) -> str:
    """Let `mattgs serve` do what is due; return the run's state."""
    port = PORT + 1
    folder.mkdir(parents=True, exist_ok=True)
    say(f"$ mattgs serve --port {port}")
    command = ("-m", "flows.cli.app", "serve", "--port", str(port), "--out", str(folder))
    os.environ.pop("PREFECT_API_URL", None)
    with _started(*command, log=folder):
        url = f"http://127.0.0.1:{port}/api"
        while not healthy(url):
            time.sleep(0.5)
        os.environ["PREFECT_API_URL"] = url
        state = _wait_for_scheduled(folder)
    del os.environ["PREFECT_API_URL"]
    return state


def prefect(*arguments: str) -> None:
    """Run a command of Prefect's in the project's folder."""
    say(f"$ prefect {' '.join(arguments)}")
    command = [sys.executable, "-m", "prefect", *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(done.stdout + done.stderr)


@contextmanager
def _started(*arguments: str, log: Path) -> Iterator[None]:
    with (log / "processes.log").open("ab") as output:
        process = subprocess.Popen(
            [sys.executable, *arguments], cwd=ROOT, stdout=output, stderr=output
        )
    try:
        yield
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


def _wait_for_scheduled(folder: Path) -> str:
    """Make the nightly grid tiny and due soon; return how the run ended that the scheduler made."""
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.actions import DeploymentScheduleCreate, DeploymentUpdate
    from prefect.client.schemas.schedules import IntervalSchedule
    from prefect.settings import PREFECT_API_URL, temporary_settings

    settings = {
        "name": "nightly",
        "config": str(folder.parent / "tiny.toml"),
        "gate": {"baseline": str(folder / "baseline.json")},
        "out": str(folder),
    }
    end = time.monotonic() + TIMEOUT_SECONDS
    with (
        temporary_settings({PREFECT_API_URL: os.environ["PREFECT_API_URL"]}),
        get_client(sync_client=True) as client,
    ):
        deployment = _found(client, end)
        say(f"{DEPLOYMENT}: due daily at 01:00 UTC; now tiny, and due in {SOON.seconds} s too")
        client.update_deployment(deployment.id, DeploymentUpdate(parameters={"settings": settings}))
        schedule = IntervalSchedule(
            interval=timedelta(days=1), anchor_date=datetime.now(UTC) + SOON
        )
        soon = DeploymentScheduleCreate(schedule=schedule, active=True)
        client.create_deployment_schedules(deployment.id, [soon])
        last_kind = ""
        while time.monotonic() < end:
            for run in client.read_flow_runs(limit=50):
                kind = run.state_type.value if run.state_type else ""
                due = run.expected_start_time and run.expected_start_time < datetime.now(UTC)
                if run.deployment_id != deployment.id or not (due and run.auto_scheduled):
                    continue
                if kind != last_kind:
                    say(f"scheduled run {run.name!r}: {kind}")
                    last_kind = kind
                if kind in ("COMPLETED", "FAILED", "CRASHED", "CANCELLED"):
                    report = folder / "benchmarks" / "nightly" / "report.html"
                    say(f"took {run.total_run_time.seconds} s; report: {report.is_file()}")
                    tasks = sorted(one.name for one in client.read_task_runs(limit=200))
                    say(f"task runs: {', '.join(tasks)}")
                    keys = sorted(one.key for one in client.read_artifacts(limit=50) if one.key)
                    say(f"artifacts: {', '.join(keys)}\n")
                    return kind
            time.sleep(1)
    return "did not end"


def _found(client: "SyncPrefectClient", end: float) -> "DeploymentResponse":
    """Return the deployment as soon as the server has it."""
    while True:
        try:
            return client.read_deployment_by_name(DEPLOYMENT)
        except Exception:
            if time.monotonic() > end:
                raise
            time.sleep(0.5)


def say(text: str) -> None:
    """Print a line with the time since the program began."""
    print(f"{time.monotonic() - BEGAN:4.0f} s  {text}", flush=True)


BEGAN = time.monotonic()

if __name__ == "__main__":
    main()
