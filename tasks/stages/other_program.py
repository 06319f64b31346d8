"""The stage that trains with another program (``mattgs_ops/trainers``), a trainer of the benchmark.

Its code is not that of the built-in trainings: neither repeats the other when it changes.
"""

from dataclasses import asdict

from mattgs_ops.config import BenchmarkConfig, Condition
from mattgs_ops.store.code_version import TRAINERS
from mattgs_ops.trainers.program import identify
from tasks.stages.stage import Artifact, Cell, Place, Stage, perform


def train(
    place: Place, cell: Cell, scene: Artifact, config: BenchmarkConfig, title: str
) -> Artifact:
    """Train with a program that the benchmark names; its version is part of the stage's key.

    Raises :class:`StageError` where there is no such program, and as :func:`perform`.
    """
    condition = Condition.parse(cell.condition)
    trainer = config.trainers[condition.method]
    who = identify(condition.method, trainer)
    training = config.train_settings(cell.capture, cell.budget).model_dump(mode="json")
    limit = {"max_splats": training["max_splats"], "background": training["background"]}
    how = {
        "background": condition.background,
        "identity": asdict(who),
        "iterations": config.iterations,
        "resolution": config.resolution,
        "seed": cell.seed,
    }
    # neither where it lies nor how long it may take changes what comes out
    options = trainer.model_dump(mode="json", exclude={"folder", "timeout", "version", "progress"})
    stage = Stage(
        name="train",
        title=title,
        operation="mattgs_ops.trainers.train:operate",
        imports=("mattgs_ops.trainers.train",),
        parameters=how | {"trainer": options, "limit": limit},
        inputs={"scene": scene.digest},
        arguments=how
        | {
            "name": condition.method,
            "trainer": trainer.model_dump(mode="json"),
            "train": training,
            "scene": str(place.folder(scene)),
        },
        modules=TRAINERS,
        timeout=trainer.timeout,
    )
    return perform(place, stage)
