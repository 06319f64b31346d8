"""Faults on purpose: what survives a kill, a full disk, a damaged file, a second flow.

Runs a small real benchmark once without faults, then once per fault, each followed by a plain rerun
of the same command, and prints a Markdown table. A fault is survived when the rerun ends well, the
splats are the same bytes as without the fault, rows and MLflow hold each experiment once, nothing
half-written lay in the store, and no process is left over.

    python benchmarks/faults.py [--folder DIR] [--only NAME…]

The run without faults is not repeated where ``DIR`` holds it, and neither are faults tried there:
their lines are printed again, unless ``--only`` names them.
One Prefect server serves most runs, to save time; the faults that need it start their own. The
fault `a full disk` needs the right to mount a tmpfs.
"""

import argparse
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil

from benchmarks import tiny
from benchmarks.fault_trial import CONDITIONS, Trial, dask_cluster
from flows.services import embedded
from flows.services.prefect_server import PrefectServer
from tasks.registry import runs

EXPERIMENTS = len(CONDITIONS)
SPARE_BYTES = 1_000_000  # on the full disk: less than a training's checkpoint takes
PAGE = 4096


def kill_flow(trial: Trial) -> str:
    """End the flow's process, in which the embedded scheduler lives too."""
    trial.embedded = True
    return _signalled(trial, signal.SIGKILL)


def terminate_flow(trial: Trial) -> str:
    """End the flow as a machine does that shuts down."""
    return _signalled(trial, signal.SIGTERM)


def interrupt_flow(trial: Trial) -> str:
    """End the flow as a person does."""
    return _signalled(trial, signal.SIGINT)


def _signalled(trial: Trial, number: signal.Signals) -> str:
    flow = trial.start()
    trial.wait_for_checkpoint(flow)
    flow.send_signal(number)
    return f"exit {trial.end(flow)}"


def kill_training(trial: Trial) -> str:
    """End a training's own process."""
    return _killed(trial, trial.training)


def kill_worker(trial: Trial) -> str:
    """End the Dask worker that has a training below it."""
    return _killed(trial, lambda: trial.training().parent().parent())


def kill_server(trial: Trial) -> str:
    """End the embedded Prefect server."""
    trial.embedded = True
    return _killed(trial, lambda: trial.process("flows.services.prefect_server"))


def _killed(trial: Trial, victim: Callable[[], psutil.Process | None]) -> str:
    flow = trial.start()
    trial.wait_for_checkpoint(flow)
    process = victim()
    assert process is not None
    process.kill()
    return f"exit {trial.end(flow)}"


def kill_scheduler(trial: Trial) -> str:
    """End a scheduler of its own process; the rerun finds another at the same address."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    trial.options = ["--dask-scheduler", address]
    with dask_cluster(address, trial) as (scheduler, worker):
        flow = trial.start()
        trial.wait_for_checkpoint(flow)
        trial.children += worker.children(recursive=True)
        scheduler.kill()
        code = trial.end(flow)
    trial.options = []  # the plain command again, with a cluster of its own
    return f"exit {code}"


def truncate_artifact(trial: Trial) -> str:
    """Cut a finished file."""
    path = _finished(trial)
    os.truncate(path, path.stat().st_size // 2)
    return "-"


def corrupt_artifact(trial: Trial) -> str:
    """Change some bytes of a finished file."""
    path = _finished(trial)
    with path.open("r+b") as file:
        file.seek(path.stat().st_size // 2)
        file.write(b"\xff\xfe\xfd")
    return "-"


def _finished(trial: Trial) -> Path:
    """Take over the finished run without faults; return the file of some splats."""
    shutil.rmtree(trial.out)
    shutil.copytree(trial.folder / "reference", trial.out)
    return next(iter(trial.out.glob("store/train/*/files/splats.ply")))


def corrupt_manifest(trial: Trial) -> str:
    """Cut the manifests of the finished scores."""
    _finished(trial)
    for path in trial.out.glob("store/evaluate/*/manifest.json"):
        path.write_text("{", encoding="utf-8")
    return "-"


def two_flows(trial: Trial) -> str:
    """Start the same benchmark twice at once."""
    flows = [trial.start(), trial.start()]
    return f"exit {' and '.join(str(trial.end(flow)) for flow in flows)}"


def full_disk(trial: Trial) -> str:
    """Run on a small tmpfs, then make room; unmounted by the caller."""
    before = trial.out.with_name("full-disk-before")
    shutil.rmtree(before, ignore_errors=True)
    trial.out.rename(before)
    trial.out.mkdir()
    pages = sum(path.stat().st_size // PAGE + 1 for path in before.rglob("*"))
    size = f"size={pages * PAGE + SPARE_BYTES}"
    mount = ["mount", "-t", "tmpfs", "-o", size, "tmpfs", str(trial.out)]
    subprocess.run(mount, check=True, capture_output=True)
    shutil.copytree(before, trial.out, dirs_exist_ok=True)
    code = trial.run()
    subprocess.run(["mount", "-o", "remount,size=1g", str(trial.out)], check=True)
    return f"exit {code}"


Fault = Callable[[Trial], str]
FAULTS: dict[str, Fault] = {
    "SIGKILL to the flow": kill_flow,
    "SIGTERM to the flow": terminate_flow,
    "Ctrl-C": interrupt_flow,
    "SIGKILL to a Dask worker": kill_worker,
    "SIGKILL to a Dask scheduler": kill_scheduler,
    "SIGKILL to a training": kill_training,
    "SIGKILL to the Prefect server": kill_server,
    "a truncated artifact": truncate_artifact,
    "a changed artifact": corrupt_artifact,
    "broken manifests": corrupt_manifest,
    "two flows at once": two_flows,
    "a full disk": full_disk,
}
# How a run ends that was hit; one that ends otherwise was not, and says nothing.
ENDS: dict[Fault, str] = {
    kill_flow: f"exit {-signal.SIGKILL}",
    terminate_flow: f"exit {128 + signal.SIGTERM}",
    interrupt_flow: "exit 130",
    kill_server: "exit 1",
    full_disk: "exit 1",
}
DAMAGES: dict[Fault, int] = {
    truncate_artifact: 1,
    corrupt_artifact: 1,
    corrupt_manifest: EXPERIMENTS,
}


def main() -> None:
    """Try every fault and print the table; exit code 1 when one was not survived."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, help="work here; by default a temporary folder")
    parser.add_argument("--only", nargs="*", choices=list(FAULTS))
    options = parser.parse_args()
    # a shell that starts this in the background has it ignored, and so would the runs
    signal.signal(signal.SIGINT, signal.default_int_handler)
    folder = (options.folder or Path(tempfile.mkdtemp(prefix="mattgs-faults-"))).resolve()
    for name, value in embedded.QUIET.items():  # for the table's sake; runs set it themselves
        os.environ.setdefault(name, value)
    with shared_services(folder):
        sys.exit(0 if try_all(folder, options.only) else 1)


@contextmanager
def shared_services(folder: Path) -> Iterator[None]:
    """Start what every run would start anew: a Prefect server; and make an empty registry."""
    server = PrefectServer(folder / "prefect", folder / "prefect.log")
    try:
        runs.initialise(f"sqlite:///{folder / 'mlflow.db'}")
        server.wait()
        os.environ["PREFECT_API_URL"] = server.address()
        yield
    finally:
        server.stop()


def try_all(folder: Path, names: list[str] | None) -> bool:
    """Try faults one after another; return whether all were survived.

    Without ``names`` those that were not tried in this folder before.
    """
    tiny.write(folder)
    results = folder / "results.json"
    known: dict[str, list[str | int]] = {}
    if results.is_file():
        known = json.loads(results.read_text(encoding="utf-8"))
    reference = Trial(folder, "reference", None)
    if not reference.rows.is_file() and reference.run() != 0:
        sys.exit(f"the benchmark does not even run without faults: {folder / 'printed.txt'}")
    print(
        "| fault | the run itself | half-written | processes left | rerun | resumed at step |"
        " same splats | runs | seconds | survived |"
    )
    print("|---|---|--:|--:|---|---|---|--:|--:|---|", flush=True)
    for name in names or FAULTS:
        if names is not None or name not in known:
            known[name] = attempt(folder, name, reference)
            results.write_text(json.dumps(known), encoding="utf-8")
        print(f"| {' | '.join(str(cell) for cell in (name, *known[name]))} |", flush=True)
    mine = [known[name] for name in names or FAULTS]
    survived = sum(cells[-1] == "yes" for cells in mine)
    print(f"\n{len(mine)} faults tried, {survived} survived.")
    return survived == len(mine)


def attempt(folder: Path, name: str, reference: Trial) -> list[str | int]:
    """Try one fault; return its line of the table, which ends with whether it was survived."""
    shutil.rmtree(folder / name.replace(" ", "-"), ignore_errors=True)
    trial, fault, began = Trial(folder, name, reference.out), FAULTS[name], time.monotonic()
    try:
        happened = fault(trial)
        left = trial.survivors()
        half = trial.damaged() - DAMAGES.get(fault, 0)
        code = trial.run()
        same = trial.splats() == reference.splats()
        runs = trial.runs()
        resumed = trial.resumed()
        once = trial.experiments() == runs == EXPERIMENTS
    except (subprocess.CalledProcessError, OSError, RuntimeError, psutil.Error) as error:
        return [str(error), "", "", "", "", "", "", round(time.monotonic() - began), "**no**"]
    finally:
        if os.path.ismount(trial.out):
            subprocess.run(["umount", "-l", str(trial.out)], check=True)
    hit = happened == ENDS.get(fault, happened)
    well = hit and code == 0 and same and once and left == 0 and half == 0
    cells: list[str | int] = [happened, half, left, f"exit {code}", resumed]
    cells += ["yes" if same else "**no**", runs, round(time.monotonic() - began)]
    return [*cells, "yes" if well else "**no**"]


if __name__ == "__main__":
    main()
