"""What orchestration costs: grids of experiments whose work is already done.

One small experiment is run for real. Then the store is given the same results for many seeds, and
the benchmark flow runs over grids of growing size: Prefect, Dask, store, MLflow and report do all
that they do for real experiments, and nothing is computed. Prints seconds per grid and experiment.

    python benchmarks/orchestration.py [--sizes 10 50 100 200] [--folder DIR]
"""

import argparse
import json
import os
import shutil
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from unittest import mock

import psutil

from benchmarks import tiny
from flows.cli.arguments import EXIT_FAILED
from flows.grid import cells
from flows.services import embedded
from mattgs_ops.config import BenchmarkConfig
from mattgs_ops.config_file import load_toml
from mattgs_ops.store.keys import stage_key
from tasks import evaluate, measure, prepare, segment, sfm, train
from tasks.row import Outcome
from tasks.stages.stage import Artifact, Place, Stage, code_versions

CAPTURE = "board"
STAGES = (prepare, segment, sfm, train, evaluate, measure)


def main() -> None:
    """Run the grids and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=[10, 50, 100, 200])
    parser.add_argument("--folder", type=Path, help="work here; by default a temporary folder")
    options = parser.parse_args()
    folder = (options.folder or Path(tempfile.mkdtemp(prefix="mattgs-cost-"))).resolve()
    os.environ["TMPDIR"] = str(folder)
    out = folder / "out"
    out.mkdir(parents=True, exist_ok=True)
    embedded.enter(out)
    config = load_toml(tiny.write(folder))
    began = time.monotonic()
    with embedded.Starting(out, config.run, EXIT_FAILED) as starting:
        services = starting.ready()
        print(f"Start-up of the embedded services: {time.monotonic() - began:.1f} s", flush=True)
        _flow(config, out, services)  # the one real experiment; imports everything too
        print("\n| experiments | wall s | CPU s, all processes | wall s each | CPU s each |")
        print("|--:|--:|--:|--:|--:|", flush=True)
        for size in options.sizes:
            grid = config.model_copy(update={"name": f"grid-{size}", "seeds": tuple(range(size))})
            _fill(Place(out, grid.name, grid.run), config, grid)
            began, worked = time.monotonic(), _cpu_seconds()
            _flow(grid, out, services)
            took, worked = time.monotonic() - began, _cpu_seconds() - worked
            each = f"{took / size:.2f} | {worked / size:.2f}"
            print(f"| {size} | {took:.1f} | {worked:.1f} | {each} |", flush=True)


def _flow(config: BenchmarkConfig, out: Path, services: embedded.Services) -> None:
    from prefect_dask import DaskTaskRunner

    from flows.benchmark import benchmark

    runner = DaskTaskRunner(address=services.dask_scheduler)
    benchmark.with_options(task_runner=runner)(config, out, services.tracking_uri)


def _cpu_seconds() -> float:
    """Return processor seconds of this process and all below it, ended ones included."""
    total = 0.0
    for process in (psutil.Process(), *psutil.Process().children(recursive=True)):
        try:
            total += sum(process.cpu_times()[:4])
        except psutil.NoSuchProcess:
            continue
    return total


def _fill(place: Place, done: BenchmarkConfig, grid: BenchmarkConfig) -> None:
    """Put results for every experiment of ``grid`` into the store: those of ``done``'s only one."""
    versions = code_versions()
    originals: dict[str, Path] = {}

    def find_artifact(at: Place, stage: Stage) -> Artifact:
        key = stage_key(stage.name, versions[stage.name], stage.parameters, stage.inputs)
        with at.open_store().stage(key) as slot:
            if slot.finished is None:
                _copy(originals, stage, slot.work)
                slot.finish({"seconds": 1.0})
            made = slot.finished
            assert made is not None
            originals.setdefault(stage.name, made.folder)
            return Artifact(stage.name, str(key), made.digest, 1.0, cached=True)

    with ExitStack() as replaced:
        for module in STAGES:
            replaced.enter_context(mock.patch.object(module, "perform", find_artifact))
        for config in (done, grid):
            _request_stages(place, config)


def _request_stages(place: Place, config: BenchmarkConfig) -> None:
    """Ask for every stage of a grid, as the flow does."""
    (capture,) = config.captures
    prepared = prepare.prepare(place, capture, config)
    masks = segment.segment(place, CAPTURE, prepared, config.segment)
    scene = sfm.sfm(place, CAPTURE, prepared, masks, config.sfm)
    outcomes = []
    for cell in cells(config, CAPTURE):
        splats = train.train(place, cell, scene, config)
        scores = evaluate.evaluate(place, cell, scene, splats, config)
        made = {"prepare": prepared, "segment": masks, "sfm": scene, "train": splats}
        outcomes.append(Outcome(cell, {**made, "evaluate": scores}))
    measure.measure(place, CAPTURE, outcomes, config)


def _copy(originals: dict[str, Path], stage: Stage, folder: Path) -> None:
    """Copy the real experiment's files, with something of their own, or else all were the same."""
    if stage.name == "measure":
        text = (originals["measure"] / measure.SPEED_FILE).read_text(encoding="utf-8")
        (speed,) = json.loads(text).values()
        speeds = {job["label"]: speed for job in stage.arguments["jobs"]}
        (folder / measure.SPEED_FILE).write_text(json.dumps(speeds), encoding="utf-8")
        return
    shutil.copytree(originals[stage.name], folder, dirs_exist_ok=True)
    own = json.dumps([stage.title, dict(stage.inputs)])
    (folder / "own.json").write_text(own, encoding="utf-8")


if __name__ == "__main__":
    main()
