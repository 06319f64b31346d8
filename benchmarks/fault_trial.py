"""One run of the small benchmark, for `benchmarks/faults.py` to disturb, and what it left."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil

from mattgs_ops.store.store import Store
from tasks.registry import runs

CONDITIONS = ("nobg-3dgs", "nobg-ours")
OPTIONS = ["--name", "faults", "--iterations", "600", "--conditions", ",".join(CONDITIONS)]
SETTLE_SECONDS = 15.0  # for what the kernel and Dask clean up after a kill
HANG_SECONDS = 600.0  # a run that takes longer than this hangs
READY = ("prepare", "segment", "sfm")  # stages done before the fault


class Trial:
    """One output folder, with what comes before training already done."""

    def __init__(self, folder: Path, name: str, done_before: Path | None) -> None:
        self.folder = folder
        self.out = folder / name.replace(" ", "-")
        self.rows = self.out / "benchmarks" / "faults" / "rows.json"
        self.options: list[str] = []
        self.children: list[psutil.Process] = []
        self.embedded = False  # whether the run starts a Prefect server of its own
        if done_before is not None:
            for stage in READY:
                shutil.copytree(done_before / "store" / stage, self.out / "store" / stage)
            shutil.copy(folder / "mlflow.db", self.out)

    def start(self) -> "subprocess.Popen[str]":
        """Start the benchmark; its machine-wide locks are this trial's own."""
        command = [sys.executable, "-m", "flows.cli.app", "run", "--out", str(self.out)]
        settings = ["--config", str(self.folder / "tiny.toml"), *OPTIONS]
        return subprocess.Popen(
            [*command, *settings, *self.options],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=self.environment(),
            start_new_session=True,
        )

    def environment(self) -> dict[str, str]:
        """Return variables of a run, without the shared Prefect server when it starts its own."""
        kept = {k: v for k, v in os.environ.items() if k != "PREFECT_API_URL" or not self.embedded}
        return kept | {"TMPDIR": str(self.folder)}

    def end(self, flow: "subprocess.Popen[str]") -> int:
        """Wait for a run's end and return its exit code; what it said goes to a file."""
        try:
            printed, _ = flow.communicate(timeout=HANG_SECONDS)
        except subprocess.TimeoutExpired as error:
            flow.kill()
            raise RuntimeError("the run hangs") from error
        with (self.folder / "printed.txt").open("a", encoding="utf-8") as file:
            file.write(f"--- {self.out.name}: exit {flow.returncode}\n{printed}\n")
        return flow.returncode

    def run(self) -> int:
        """Run the benchmark to its end; return its exit code."""
        return self.end(self.start())

    def wait_for_checkpoint(self, flow: "subprocess.Popen[str]") -> None:
        """Return in the middle of a training; note the flow's processes."""
        end = time.monotonic() + HANG_SECONDS
        while not list(self.out.glob("store/work/train-*/files/checkpoint.npz")):
            if time.monotonic() > end or flow.poll() is not None:
                raise RuntimeError("no checkpoint appeared")
            time.sleep(0.01)
        self.children = psutil.Process(flow.pid).children(recursive=True)

    def process(self, word: str) -> psutil.Process:
        """Return a process of the flow whose command line holds ``word``."""
        for child in self.children:
            if word in " ".join(child.cmdline()):
                return child
        raise RuntimeError(f"no process with {word!r}")

    def training(self) -> psutil.Process:
        """Return the process of a training: forked by a launcher, which a Dask worker started."""
        launchers = [c for c in self.children if "tasks.stages.launcher" in " ".join(c.cmdline())]
        for child in launchers:
            if child.parent() in launchers:
                return child
        raise RuntimeError("no launcher has a stage")

    def survivors(self) -> int:
        """Count the flow's processes that are still there after a while."""
        _, alive = psutil.wait_procs(self.children, timeout=SETTLE_SECONDS)
        return len(alive)

    def damaged(self) -> int:
        """Count what lies in the store as finished without being what its manifest says."""
        store = Store(self.out / "store")
        stages = [p for p in store.root.glob("*") if p.name not in ("work", "locks", "users")]
        keys = [f"{stage.name}/{place.name}" for stage in stages for place in stage.iterdir()]
        return sum(store.find(key) is None for key in keys)

    def experiments(self) -> int:
        """Count the rows."""
        return len(json.loads(self.rows.read_text(encoding="utf-8")))

    def splats(self) -> dict[str, str]:
        """Return condition → digest of its splats."""
        rows = json.loads(self.rows.read_text(encoding="utf-8"))
        files = {r["condition"]: r["artifacts"]["train"] for r in rows if r["status"] == "finished"}
        return {
            name: hashlib.sha256(
                (self.out / "store" / place / "splats.ply").read_bytes()
            ).hexdigest()
            for name, place in files.items()
        }

    def resumed(self) -> str:
        """Return the steps that trainings were resumed from."""
        files = sorted(self.out.glob("store/train/*/files/training.json"))
        steps = [json.loads(path.read_text(encoding="utf-8"))["resumed_from"] for path in files]
        return ", ".join(str(step) for step in steps if step) or "-"

    def runs(self) -> int:
        """Count the runs in MLflow."""
        return len(runs.rows(f"sqlite:///{self.out / 'mlflow.db'}", "faults"))


@contextmanager
def dask_cluster(address: str, trial: Trial) -> Iterator[list[psutil.Process]]:
    """Start a scheduler and a worker as an administrator would; yield both."""
    dask = [sys.executable, "-m", "dask"]
    port = address.rpartition(":")[2]
    scheduler = [*dask, "scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard"]
    worker = [*dask, "worker", address, "--nthreads", "1", "--no-dashboard"]
    worker += ["--resources", "train=1"]
    worker += ["--local-directory", str(trial.folder / "dask"), "--death-timeout", "20"]
    environment = os.environ | {"TMPDIR": str(trial.folder)}
    quiet = subprocess.DEVNULL
    started = [
        subprocess.Popen(command, env=environment, stdout=quiet, stderr=quiet)
        for command in (scheduler, worker)
    ]
    try:
        _wait_for_workers(address)
        yield [psutil.Process(process.pid) for process in started]
    finally:
        for process in started:
            process.terminate()
            process.wait()


def _wait_for_workers(address: str) -> None:
    from distributed import Client

    with Client(address, timeout=60, set_as_default=False) as client:
        client.wait_for_workers(1, timeout=60)
