"""A grid on two workers that share nothing but the store, MLflow's, Prefect's and Dask's servers.

Everything runs on this machine, on loopback: an S3 server, an MLflow server, a Prefect server, a
Dask scheduler and two workers. Each worker has a folder of its own and, where the right to mount is
given, cannot even see the flow's folder or the other worker's. In the middle of a training one
worker is lost, folder and all: the other goes on from the copy of its checkpoint. Prints who did
which stage. Then a flow that has nothing yet asks for the same grid: nothing is trained again.

    python benchmarks/two_machines.py [--folder DIR]
"""

import argparse
import json
import logging
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import psutil

from benchmarks import tiny
from flows.services.prefect_server import PrefectServer

NAME = "two-machines"
OPTIONS = ["--name", NAME, "--conditions", "nobg-3dgs,nobg-ours"]
OPTIONS += ["--iterations", "2000", "--seeds", "0,1"]
WORKERS = ("worker-a", "worker-b")
NAMES = ("flow", *WORKERS)
START_SECONDS = 180.0
BUCKET = "mattgs"


def main() -> None:
    """Run the grid twice and print what happened; exit code 1 when something is amiss."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, help="work here; by default a temporary folder")
    options = parser.parse_args()
    folder = (options.folder or Path(tempfile.mkdtemp(prefix="mattgs-two-"))).resolve()
    _write_input(folder)
    with services(folder) as (scheduler, workers):
        ok = run(folder, scheduler, workers)
    sys.exit(0 if ok else 1)


def run(folder: Path, scheduler: str, workers: dict[str, psutil.Process]) -> bool:
    """Lose a worker amid a grid, then ask again from elsewhere; return whether all is well."""
    began = time.monotonic()
    flow = _start(folder, scheduler)
    lost = _lose(folder, workers[WORKERS[0]], flow)
    code = _end(flow)
    print(f"Grid of 4 experiments: exit {code}, {time.monotonic() - began:.0f} s\n")
    ok = code == 0 and _print_stages(folder, 5) and _resumed(folder, lost)
    # another machine, that has nothing yet, asks for the same
    shutil.rmtree(folder / "flow" / "store")
    began = time.monotonic()
    code = _end(_start(folder, scheduler))
    again = json.loads(_rows_file(folder).read_text(encoding="utf-8"))
    print(f"\nAgain with an empty folder: exit {code}, {time.monotonic() - began:.0f} s,")
    trained = sum(len(list((folder / name).glob("logs/train-*.log"))) for name in NAMES)
    print(f"{len(again)} rows, {trained} trainings in all, the lost one included")
    return ok and code == 0 and trained == len(again) + 1


def _write_input(folder: Path) -> None:
    for name in ("flow", *WORKERS):
        (folder / name).mkdir(parents=True, exist_ok=True)
    tiny.write(folder)


@contextmanager
def services(folder: Path) -> Iterator[tuple[str, dict[str, psutil.Process]]]:
    """Start all servers and both workers; yield the Dask scheduler's address and the workers."""
    workers = {}
    with ExitStack() as stack:
        server = PrefectServer(folder / "prefect", folder / "prefect.log")
        stack.callback(server.stop)
        tracking = stack.enter_context(mlflow_server(folder))
        os.environ |= stack.enter_context(object_store())
        os.environ["MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR"] = "false"
        address = f"tcp://127.0.0.1:{free_port()}"
        dask = [sys.executable, "-m", "dask"]
        scheduler = [*dask, "scheduler", "--host", "127.0.0.1", "--no-dashboard"]
        stack.enter_context(_process([*scheduler, "--port", address.rpartition(":")[2]], folder))
        server.wait()
        os.environ |= {"PREFECT_API_URL": server.address(), "MLFLOW_TRACKING_URI": tracking}
        for name in WORKERS:
            hidden = [folder / other for other in ("flow", "photos", *WORKERS) if other != name]
            worker = [*dask, "worker", address, "--nthreads", "1", "--no-dashboard"]
            worker += ["--resources", "train=1"]
            worker += ["--name", name, "--local-directory", str(folder / name / "dask")]
            command = hiding(hidden, worker)
            workers[name] = psutil.Process(stack.enter_context(_process(command, folder / name)))
        wait_for(f"{tracking}/health")
        _wait_for_workers(address)
        yield address, workers


def _lose(folder: Path, worker: psutil.Process, flow: "subprocess.Popen[str]") -> str:
    """Kill a worker, with all that it runs, as soon as a checkpoint of its training was copied.

    Returns the key of that training.
    """
    import fsspec

    files = fsspec.filesystem("s3", use_listings_cache=False)
    while flow.poll() is None:
        for place in (folder / WORKERS[0]).glob("store/work/train-*"):
            key = place.name.replace("-", "/", 1)
            if files.exists(f"{BUCKET}/store/drafts/{key}/manifest.json"):
                for process in [worker, *worker.children(recursive=True)]:
                    process.kill()
                shutil.rmtree(folder / WORKERS[0] / "store")
                return key
        time.sleep(0.2)
    return "none"


@contextmanager
def mlflow_server(folder: Path) -> Iterator[str]:
    """Serve MLflow from a folder; yield its address, which may not answer yet."""
    port = free_port()
    command = [sys.executable, "-m", "mlflow", "server", "--workers", "1", "--port", str(port)]
    command += ["--backend-store-uri", f"sqlite:///{folder / 'mlflow.db'}"]
    command += ["--artifacts-destination", str(folder / "mlflow-artifacts")]
    with _process(command, folder, MLFLOW_SERVER_ENABLE_JOB_EXECUTION="false"):
        yield f"http://127.0.0.1:{port}"


@contextmanager
def object_store() -> Iterator[dict[str, str]]:
    """Serve S3 with one bucket; yield the variables that lead there."""
    import fsspec
    from moto.server import ThreadedMotoServer

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    server.start()
    address = "http://{}:{}".format(*server.get_host_and_port())
    # fsspec would hand out the same one again, to whoever reaches another server by the environment
    files = fsspec.filesystem(
        "s3", endpoint_url=address, key="test", secret="test", skip_instance_cache=True
    )
    files.mkdir(BUCKET)
    try:
        yield {
            "AWS_ENDPOINT_URL": address,
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_DEFAULT_REGION": "us-east-1",
        }
    finally:
        server.stop()


def free_port() -> int:
    """Return a port that nobody uses at the moment."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        return int(free.getsockname()[1])


def hiding(hidden: list[Path], command: list[str]) -> list[str]:
    """Return the command such that it sees empty folders in place of ``hidden``, if possible."""
    try:
        subprocess.run(["unshare", "--mount", "true"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        print("(folders are separate, but not hidden: no right to mount)")
        return command
    mounts = " && ".join(f"mount -t tmpfs none '{path}'" for path in hidden)
    return ["unshare", "--mount", "sh", "-c", f'{mounts} && exec "$@"', "sh", *command]


@contextmanager
def _process(command: list[str], folder: Path, **variables: str) -> Iterator[int]:
    environment = os.environ | {"MATTGS_WORK": str(folder), "TMPDIR": str(folder)} | variables
    with (folder / "processes.log").open("ab") as log:
        process = subprocess.Popen(
            command, env=environment, cwd=folder, stdout=log, stderr=subprocess.STDOUT
        )
    try:
        yield process.pid
    finally:
        process.terminate()
        process.wait()


def wait_for(url: str) -> None:
    """Return once a server answers; raises :class:`OSError` when it takes too long."""
    end = time.monotonic() + START_SECONDS
    while True:
        try:
            with urllib.request.urlopen(url, timeout=10):
                return
        except OSError:
            if time.monotonic() > end:
                raise
            time.sleep(0.2)


def _wait_for_workers(address: str) -> None:
    from distributed import Client

    with Client(address, timeout=START_SECONDS, set_as_default=False) as client:
        client.wait_for_workers(len(WORKERS), timeout=START_SECONDS)


def _start(folder: Path, scheduler: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "flows.cli.app", "run", "--config", str(folder / "tiny.toml")]
    command += OPTIONS
    command += ["--dask-scheduler", scheduler, "--store", f"s3://{BUCKET}/store"]
    command += ["--out", str(folder / "flow")]
    environment = os.environ | {"TMPDIR": str(folder / "flow")}
    pipe = subprocess.PIPE
    return subprocess.Popen(
        command, env=environment, stdout=pipe, stderr=subprocess.STDOUT, text=True
    )


def _end(flow: "subprocess.Popen[str]") -> int:
    printed, _ = flow.communicate()
    if flow.returncode != 0:
        print(printed)
    return flow.returncode


def _print_stages(folder: Path, trainings: int) -> bool:
    """Print who did what; return whether each worker trained and each run is in MLflow."""
    import fsspec

    from tasks.registry import runs

    stages = ("prepare", "segment", "sfm", "agree", "train", "truth", "evaluate", "measure")
    print(f"| machine | {' | '.join(stages)} |")
    print("|---" + "|--:" * len(stages) + "|")
    for name in NAMES:
        counts = [len(list((folder / name).glob(f"logs/{stage}-*.log"))) for stage in stages]
        print(f"| {name} | {' | '.join(str(count) for count in counts)} |")
    files = fsspec.filesystem("s3", use_listings_cache=False)
    found = files.du(f"{BUCKET}/store", total=False)
    manifests = sum(path.endswith("/manifest.json") for path in found)
    recorded = runs.rows(os.environ["MLFLOW_TRACKING_URI"], NAME)
    rows = json.loads(_rows_file(folder).read_text(encoding="utf-8"))
    print(f"\nObject store: {manifests} artifacts, {len(found)} objects, ", end="")
    print(f"{sum(found.values()) / 1e6:.1f} MB; MLflow: {len(recorded)} runs")
    trained = [len(list((folder / name).glob("logs/train-*.log"))) for name in WORKERS]
    finished = [row for row in rows if row["status"] == "finished"]
    return (
        all(trained) and sum(trained) == trainings and len(finished) == len(rows) == len(recorded)
    )


def _resumed(folder: Path, lost: str) -> bool:
    """Say where the lost training went on; return whether it did so from a checkpoint."""
    report = folder / WORKERS[1] / "store" / lost / "files" / "training.json"
    resumed = json.loads(report.read_text(encoding="utf-8"))["resumed_from"]
    print(f"The training that {WORKERS[0]} lost went on at step {resumed} on {WORKERS[1]}")
    return bool(resumed > 0)


def _rows_file(folder: Path) -> Path:
    return folder / "flow" / "benchmarks" / NAME / "rows.json"


if __name__ == "__main__":
    main()
