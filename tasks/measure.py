"""Measure rendering speed, alone on its machine (``mattgs_ops/score/evaluate.py``).

All experiments of a capture are measured in one process, one after another. The flow calls this
when no other stage of the benchmark runs any more, and ``tasks/stages/quiet.py`` keeps the stages
of other benchmarks on this machine away.
"""

import json
from pathlib import Path
from typing import Any

from mattgs_ops.config import BenchmarkConfig, Condition
from mattgs_ops.progress import Progress
from tasks.row import Outcome, scene_of
from tasks.stages.stage import Cell, Place, Stage, perform

SPEED_FILE = "speed.json"


def measure(
    place: Place, name: str, outcomes: list[Outcome], config: BenchmarkConfig
) -> dict[Cell, dict[str, float]]:
    """Return metrics of speed for each experiment of one capture."""
    inputs: dict[str, str] = {}
    jobs: list[dict[str, str]] = []
    for outcome in outcomes:
        scene, splats = scene_of(outcome.artifacts), outcome.artifacts["train"]
        label = f"{outcome.cell.condition} seed {outcome.cell.seed}"
        inputs |= {f"{label} splats": splats.digest, f"{label} scene": scene.digest}
        jobs.append(
            {
                "label": label,
                "scene": str(place.folder(scene)),
                "splats": str(place.folder(splats)),
                "condition": outcome.cell.condition,
            }
        )
    stage = Stage(
        name="measure",
        title=f"measure {name}",
        operation="tasks.measure:operate",
        imports=("mattgs_ops.score.evaluate",),
        parameters={"resolution": config.resolution},
        inputs=inputs,
        arguments={"jobs": jobs, "resolution": config.resolution},
        alone=True,
    )
    speeds = json.loads((place.folder(perform(place, stage)) / SPEED_FILE).read_text("utf-8"))
    return {o.cell: speeds[f"{o.cell.condition} seed {o.cell.seed}"] for o in outcomes}


def operate(arguments: dict[str, Any], out: Path, threads: int, progress: Progress) -> None:
    """Run in the stage's process."""
    from mattgs_ops.capture.scene import Scene
    from mattgs_ops.score.speed import measure_speed
    from mattgs_ops.splat.training.report import TrainingReport

    speeds = {}
    jobs = arguments["jobs"]
    for index, job in enumerate(jobs):
        splats = Path(job["splats"])
        speeds[job["label"]] = measure_speed(
            Scene.load(Path(job["scene"])),
            splats / "splats.ply",
            Condition.parse(job["condition"]),
            arguments["resolution"],
            background=TrainingReport.load(splats).background,
            threads=threads,
        )
        progress(index + 1, len(jobs), f"{job['label']}: {speeds[job['label']]['fps']:.0f} FPS")
    text = json.dumps(speeds, indent=1, sort_keys=True)
    (out / SPEED_FILE).write_text(text + "\n", encoding="utf-8")
