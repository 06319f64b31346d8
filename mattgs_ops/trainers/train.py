"""One experiment trained by another program: a scene in, a folder with its splats out.

The folder holds ``splats.ply`` and ``training.json`` as the built-in methods leave them, so that
all that comes after is the same; and ``trainer.json``, which says what was run. Seconds are the
process's: it reads the photos, trains and writes in them.
"""

import json
import shutil
from pathlib import Path
from typing import Any

from mattgs_ops.capture.scene import Scene
from mattgs_ops.config import Condition, TrainConfig
from mattgs_ops.progress import Progress
from mattgs_ops.splat.files.training_report import SCHEMA, TrainingReport
from mattgs_ops.splat.photos import background_colour
from mattgs_ops.splat.training.initialise import scene_extent
from mattgs_ops.store.digests import file_digest
from mattgs_ops.timing import machine_load
from mattgs_ops.timing.calibration import calibrate
from mattgs_ops.trainer import TrainerConfig, fill
from mattgs_ops.trainers import program
from mattgs_ops.trainers.dataset import write_dataset
from mattgs_ops.trainers.output import take_splats

PLY = "splats.ply"
FILE = "trainer.json"
WORK = "work"


def operate(arguments: dict[str, Any], out: Path, threads: int, progress: Progress) -> None:
    """Run in a stage's process; ``arguments`` are those of ``tasks/train.py``, with the scene."""
    name, trainer = arguments["name"], TrainerConfig.model_validate(arguments["trainer"])
    config, iterations = TrainConfig.model_validate(arguments["train"]), arguments["iterations"]
    condition = Condition(background=arguments["background"], method=name)
    work = out / WORK
    shutil.rmtree(work, ignore_errors=True)
    data, output = work / "data", work / "output"
    output.mkdir(parents=True)
    progress(0, iterations, "writing its data")
    views, points = write_dataset(
        Scene.load(Path(arguments["scene"])),
        condition.background,
        data,
        layout=trainer.layout,
        resolution=arguments["resolution"],
        most_points=config.max_splats,
        seed=arguments["seed"],
    )
    values = trainer.fixed | {
        "data": data,
        "output": output,
        "threads": threads,
        "budget": config.max_splats,
        **{key: arguments[key] for key in ("iterations", "resolution", "seed")},
    }
    command = [fill(part, values) for part in trainer.command]
    listen = _Listener(iterations, trainer.progress, progress)
    calibration = calibrate()
    print("+", *command, flush=True)  # noqa: T201 - a stage's standard output is its log
    with machine_load.sampled(out / machine_load.LOAD_FILE):
        usage = program.run(name, command, output, program.environment_of(trainer, values), listen)
    splats = take_splats(name, trainer, output, values, out / PLY)
    report = TrainingReport(
        schema=SCHEMA,
        iterations=iterations,
        resolution=arguments["resolution"],
        seed=arguments["seed"],
        threads=threads,
        views=len(views),
        splats=len(splats),
        starting_splats=len(points.xyz),
        starting_source=points.source,
        wall_seconds=usage.wall_seconds,
        cpu_seconds=usage.cpu_seconds,
        calibration=calibration,
        laps=(),
        resumed_from=0,
        extent=scene_extent([view.camera for view in views]),
        background=background_colour(config),
        schedule={},
        counters={},
        loss_terms={},
        peak_memory_mib=usage.peak_memory_mib,
        memory_bound_mib=0.0,
        digest=file_digest(out / PLY),
    )
    said = {key: arguments[key] for key in ("name", "identity")} | {"command": trainer.command}
    (out / FILE).write_text(json.dumps(said, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    report.save(out)
    shutil.rmtree(work)


class _Listener:
    """Copies a program's lines to the log and reports the steps that they tell."""

    def __init__(self, iterations: int, pattern: str | None, progress: Progress) -> None:
        self._iterations, self._pattern, self._progress = iterations, pattern, progress
        self._step = 0

    def __call__(self, line: str) -> None:
        print(line, flush=True)  # noqa: T201 - a stage's standard output is its log
        step = program.step_of(line, self._iterations, self._pattern)
        self._step = self._step if step is None else step
        self._progress(self._step, self._iterations, line[: program.NOTE_LETTERS])
