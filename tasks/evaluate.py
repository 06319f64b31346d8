"""Render and score one experiment's splats (``mattgs_ops/score/evaluate.py``), without speed."""

from pathlib import Path
from typing import Any

from mattgs_ops.config import BenchmarkConfig, Condition
from mattgs_ops.progress import Progress
from mattgs_ops.store.digests import file_digest
from tasks.stages.stage import Artifact, Cell, Place, Stage, perform


def evaluate(
    place: Place, cell: Cell, scene: Artifact, splats: Artifact, config: BenchmarkConfig
) -> Artifact:
    """Return the folder with ``evaluation.json``, ``renders/`` and ``truth/``."""
    settings: dict[str, Any] = {
        "condition": cell.condition,
        "resolution": config.resolution,
        "ssim_lambda": config.train.ssim_lambda,
        "train_views": config.scored_train_views,
    }
    if config.lpips is not None:
        settings["lpips"] = file_digest(config.lpips)
    if Condition.parse(cell.condition).method in config.trainers:
        settings["another_program"] = True
    stage = Stage(
        name="evaluate",
        title=f"evaluate {cell}",
        operation="tasks.evaluate:operate",
        imports=("mattgs_ops.score.evaluate",),
        parameters=settings,
        inputs={"scene": scene.digest, "splats": splats.digest},
        arguments=settings
        | {
            "weights": None if config.lpips is None else str(config.lpips.resolve()),
        }
        | {"scene": str(place.folder(scene)), "splats": str(place.folder(splats))},
    )
    return perform(place, stage)


def operate(arguments: dict[str, Any], out: Path, threads: int, progress: Progress) -> None:
    """Run in the stage's process."""
    from mattgs_ops.capture.scene import Scene
    from mattgs_ops.score.evaluate import render_views, score
    from mattgs_ops.score.frame import check_frame
    from mattgs_ops.splat.files.training_report import TrainingReport

    splats, scene = Path(arguments["splats"]), Scene.load(Path(arguments["scene"]))
    condition = Condition.parse(arguments["condition"])
    sample = arguments["train_views"]
    every = 1 if sample is None else max(1, -(-len(scene.registered("train")) // sample))
    render_views(
        scene,
        splats / "splats.ply",
        condition,
        arguments["resolution"],
        out,
        background=TrainingReport.load(splats).background,
        train_every=every,
        threads=threads,
        progress=progress,
    )
    weights = arguments["weights"]
    score(
        out,
        ssim_lambda=arguments["ssim_lambda"],
        lpips=None if weights is None else Path(weights),
        progress=progress,
    )
    if arguments.get("another_program"):
        check_frame(out, scene, splats / "splats.ply", condition.background)
