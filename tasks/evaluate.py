"""Render and score one experiment's splats (``mattgs_ops/score/evaluate.py``), without speed.

What renders are compared with is a stage of its own, which all experiments of a capture and a
background share (``mattgs_ops/score/truth.py``): whichever comes first makes it.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from mattgs_ops.config import BenchmarkConfig, Condition
from mattgs_ops.frozen import Background
from mattgs_ops.progress import Progress
from mattgs_ops.store.code_version import TRUTH
from mattgs_ops.store.digests import file_digest
from tasks.stages.stage import Artifact, Cell, Place, Stage, perform

if TYPE_CHECKING:
    from mattgs_ops.capture.scene import Scene


def truth(
    place: Place, name: str, background: Background, scene: Artifact, config: BenchmarkConfig
) -> Artifact:
    """Return the folder with ``truth/``, ``masks/``, ``details/`` and ``truth.json``."""
    settings: dict[str, Any] = {
        "background": background,
        "resolution": config.resolution,
        "train_views": config.scored_train_views,
    }
    stage = Stage(
        name="truth",
        title=f"truth {name} {background}",
        operation="tasks.evaluate:operate_truth",
        imports=TRUTH,
        modules=TRUTH,
        parameters=settings,
        inputs={"scene": scene.digest},
        arguments=settings | {"scene": str(place.folder(scene))},
    )
    return perform(place, stage)


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
    condition = Condition.parse(cell.condition)
    if condition.method in config.trainers:
        settings["another_program"] = True
    stored = truth(place, cell.capture, condition.background, scene, config)
    stage = Stage(
        name="evaluate",
        title=f"evaluate {cell}",
        operation="tasks.evaluate:operate",
        imports=("mattgs_ops.score.evaluate",),
        parameters=settings,
        inputs={"scene": scene.digest, "truth": stored.digest, "splats": splats.digest},
        arguments=settings
        | {
            "weights": None if config.lpips is None else str(config.lpips.resolve()),
        }
        | {"scene": str(place.folder(scene)), "truth": str(place.folder(stored))}
        | {"splats": str(place.folder(splats))},
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
    render_views(
        scene,
        splats / "splats.ply",
        condition,
        arguments["resolution"],
        out,
        background=TrainingReport.load(splats).background,
        truth=Path(arguments["truth"]),
        train_every=_train_every(scene, arguments["train_views"]),
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


def operate_truth(arguments: dict[str, Any], out: Path, threads: int, progress: Progress) -> None:
    """Run in the stage's process."""
    del threads
    from mattgs_ops.capture.scene import Scene
    from mattgs_ops.score.truth import store_truth

    scene = Scene.load(Path(arguments["scene"]))
    store_truth(
        scene,
        arguments["background"],
        arguments["resolution"],
        out,
        train_every=_train_every(scene, arguments["train_views"]),
        progress=progress,
    )


def _train_every(scene: "Scene", most: int | None) -> int:
    """Return n where every n-th training view is scored: at most ``most`` of them, all for None."""
    return 1 if most is None else max(1, -(-len(scene.registered("train")) // most))
