"""Train the splats of one experiment (``mattgs_ops/splat/training/train.py``)."""

from pathlib import Path
from typing import Any

from mattgs_ops.config import NO_RESULT, BenchmarkConfig, Condition, TrainConfig
from mattgs_ops.method import MethodConfig
from mattgs_ops.progress import Progress
from tasks.stages import other_program
from tasks.stages.stage import Artifact, Cell, Place, Stage, perform

CHECKPOINT = (
    "checkpoint.npz"  # mattgs_ops/splat/training/checkpoint.py, which takes seconds to import
)


def train(place: Place, cell: Cell, scene: Artifact, config: BenchmarkConfig) -> Artifact:
    """Return the folder with ``splats.ply``, ``training.json``, ``curve.csv`` and ``load.csv``.

    A killed training goes on from its last checkpoint: the one in the work folder, else the copy on
    the shared store.
    """
    if Condition.parse(cell.condition).method in config.trainers:
        return other_program.train(place, cell, scene, config, training_title(cell))
    operation_settings = settings(cell, config)
    training = config.train_settings(cell.capture, cell.budget)
    kept = training.model_dump(mode="json", exclude=set(NO_RESULT))
    stage = Stage(
        name="train",
        title=training_title(cell),
        operation="tasks.train:operate",
        imports=("mattgs_ops.splat.training.train",),
        parameters={k: v for k, v in operation_settings.items() if k != "name"} | {"train": kept},
        inputs={"scene": scene.digest},
        arguments=operation_settings | {"scene": str(place.folder(scene))},
        resumes=CHECKPOINT,
        counts="training.json",
    )
    return perform(place, stage)


def settings(cell: Cell, config: BenchmarkConfig) -> dict[str, Any]:
    """Return what :func:`operate` gets, as JSON values, but for the scene's folder."""
    condition = Condition.parse(cell.condition)
    return {
        "background": condition.background,
        "name": condition.method,
        "method": config.method(condition.method).model_dump(mode="json"),
        "train": config.train_settings(cell.capture, cell.budget).model_dump(mode="json"),
        "iterations": config.iterations,
        "resolution": config.resolution,
        "seed": cell.seed,
    }


def training_title(cell: Cell) -> str:
    """Return how the stage that trains an experiment is called."""
    return f"train {cell}"


def operate(arguments: dict[str, Any], out: Path, threads: int, progress: Progress) -> None:
    """Run in the stage's process."""
    from mattgs_ops.capture.scene import Scene
    from mattgs_ops.splat.training.train import train as train_splats
    from mattgs_ops.timing import machine_load

    with machine_load.sampled(out / machine_load.LOAD_FILE):
        train_splats(
            Scene.load(Path(arguments["scene"])),
            Condition(background=arguments["background"], method=arguments["name"]),
            MethodConfig.model_validate(arguments["method"]),
            TrainConfig.model_validate(arguments["train"]),
            iterations=arguments["iterations"],
            resolution=arguments["resolution"],
            seed=arguments["seed"],
            out=out,
            threads=threads,
            progress=progress,
        )
