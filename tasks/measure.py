"""Measure speed, alone on its machine (``mattgs_ops/score/speed.py``).

All experiments of a capture are measured in one process, one after another, by a worker: speed is
that of the machine where stages run. The flow submits this when no other stage of the benchmark
runs any more, and ``tasks/stages/quiet.py`` keeps the stages of other benchmarks on this machine
away. What was measured is kept for this machine and number of threads. ``RunConfig.sitting``
(``--remeasure``) measures anew: rendering, and trainings that were not done just now, which must
end with the same splats.
"""

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mattgs_ops.config import BenchmarkConfig, Condition
from mattgs_ops.errors import StageError
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.store import provenance
from mattgs_ops.store.digests import file_digest
from tasks import train as training
from tasks.row import Outcome, Row, scene_of
from tasks.stages.stage import Cell, Place, Stage, perform

SPEED_FILE = "speed.json"
# Of the provenance: the machine that a speed is of, as reports/gate/speed.py compares it
MACHINE = ("cpu", "cpu_kind", "cores", "threads", "workload")


@dataclass(frozen=True)
class Speed:
    """What was measured of one experiment, and on which machine.

    There are ``laps``, and ``time`` and ``time_cpu`` among the metrics, where the training was
    timed again.
    """

    metrics: dict[str, float]
    machine: dict[str, Any]
    laps: list[dict[str, float]]


def measure(
    place: Place, name: str, outcomes: list[Outcome], config: BenchmarkConfig
) -> dict[Cell, Speed]:
    """Return the speed of each experiment of one capture."""
    inputs: dict[str, str] = {}
    jobs: list[dict[str, Any]] = []
    for outcome in outcomes:
        scene, splats = scene_of(outcome.artifacts), outcome.artifacts["train"]
        label = outcome.cell.label
        other = Condition.parse(outcome.cell.condition).method in config.trainers
        # another program is not run again: it need not come to the same splats
        timed_now = place.run.sitting is None or not splats.cached or other
        inputs |= {f"{label} splats": splats.digest, f"{label} scene": scene.digest}
        jobs.append(
            {
                "label": label,
                "scene": str(place.folder(scene)),
                "splats": str(place.folder(splats)),
                "condition": outcome.cell.condition,
                "training": None if timed_now else training.settings(outcome.cell, config),
                "trained_on": place.extra(splats).get("machine"),
            }
        )
    machine = {k: v for k, v in provenance.describe(place.run.threads).items() if k in MACHINE}
    stage = Stage(
        name="measure",
        title=f"measure {name}",
        operation="tasks.measure:operate",
        imports=("mattgs_ops.score.speed", "mattgs_ops.splat.training.train"),
        parameters={
            "resolution": config.resolution,
            "machine": machine,
            "sitting": place.run.sitting,
        },
        inputs=inputs,
        arguments={"jobs": jobs, "resolution": config.resolution, "machine": machine},
        alone=True,
    )
    found = json.loads((place.folder(perform(place, stage)) / SPEED_FILE).read_text("utf-8"))
    return {o.cell: Speed(**found[o.cell.label]) for o in outcomes}


def operate(arguments: dict[str, Any], out: Path, threads: int, progress: Progress) -> None:
    """Run in the stage's process."""
    speeds = {}
    jobs = arguments["jobs"]
    for index, job in enumerate(jobs):
        metrics = _rendering(job, arguments["resolution"], threads)
        laps: list[dict[str, float]] = []
        if job["training"] is not None:
            times, laps = _training(job, arguments["machine"], out / "again", threads)
            metrics |= times
        speeds[job["label"]] = {
            "metrics": metrics,
            "machine": arguments["machine"],
            "laps": laps,
        }
        progress(index + 1, len(jobs), f"{job['label']}: {metrics['fps']:.0f} FPS")
    text = json.dumps(speeds, indent=1, sort_keys=True)
    (out / SPEED_FILE).write_text(text + "\n", encoding="utf-8")


def _rendering(job: dict[str, Any], resolution: int, threads: int) -> dict[str, float]:
    from mattgs_ops.capture.scene import Scene
    from mattgs_ops.score.speed import measure_speed
    from mattgs_ops.splat.files.training_report import TrainingReport

    splats = Path(job["splats"])
    return measure_speed(
        Scene.load(Path(job["scene"])),
        splats / "splats.ply",
        Condition.parse(job["condition"]),
        resolution,
        background=TrainingReport.load(splats).background,
        threads=threads,
    )


def _training(
    job: dict[str, Any], machine: dict[str, Any], out: Path, threads: int
) -> tuple[dict[str, float], list[dict[str, float]]]:
    """Train again, for its time alone; returns metrics of time, and the laps.

    Raises :class:`StageError` when it comes to other splats than it did on such a machine.
    """
    from mattgs_ops.splat.files.training_report import TrainingReport

    out.mkdir()
    training.operate(job["training"] | {"scene": job["scene"]}, out, threads, no_progress)
    before, after = (file_digest(folder / "splats.ply") for folder in (Path(job["splats"]), out))
    there = job["trained_on"] or {}
    if before != after and all(there.get(name) == machine[name] for name in ("cpu", "cpu_kind")):
        raise StageError(
            f"{job['label']}: the training was repeated to measure its time and came to other "
            f"splats ({after[:12]}, before {before[:12]}): it is not deterministic here"
        )
    report = TrainingReport.load(out)
    shutil.rmtree(out)
    times = {"time": report.wall_seconds, "time_cpu": report.cpu_seconds}
    return times, list(report.laps)


def with_speed(row: Row, speed: Speed | None) -> Row:
    """Return a row with its speed, and where that was measured; as it is where there is none."""
    if speed is None:
        return row
    provenance = row["provenance"] | {"measured": speed.machine}
    if speed.laps:
        provenance |= {"timed": speed.machine}
    found = row | {"metrics": row["metrics"] | speed.metrics, "provenance": provenance}
    return found | ({"repeats": {"time": speed.laps}} if speed.laps else {})
