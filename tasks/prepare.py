"""Prepare a capture: photos validated, upright, split (``mattgs_ops/capture/prepare.py``)."""

from pathlib import Path
from typing import Any

from mattgs_ops.config import BenchmarkConfig, CaptureConfig
from mattgs_ops.errors import StageError
from mattgs_ops.progress import Progress
from tasks.stages.capture_files import capture_digest, ids_digest
from tasks.stages.stage import Artifact, Place, Stage, perform


def prepare(place: Place, capture: CaptureConfig, config: BenchmarkConfig) -> Artifact:
    """Return the prepared capture; raises :class:`InputError` listing all that is wrong with it.

    Runs where the photos are. The key holds the contents of every file of the capture, so a
    changed photo is seen, and an unchanged folder that moved or is called otherwise is not.
    """
    files, ids = capture_digest(capture), ids_digest(capture)
    stage = Stage(
        name="prepare",
        title=f"prepare {capture.name}",
        operation="tasks.prepare:operate",
        imports=("mattgs_ops.capture.prepare",),
        spreads=True,
        parameters={
            "kind": capture.kind,
            "bundled": capture.path is None,
            "frames": capture.frames,
            "test_every": config.test_every,
        },
        inputs={"files": files, **({"ids": ids} if ids else {})},
        arguments={
            "capture": capture.model_dump(mode="json"),
            "test_every": config.test_every,
            "files": [files, ids],
        },
    )
    return perform(place, stage)


def operate(arguments: dict[str, Any], out: Path, threads: int, progress: Progress) -> None:
    """Run in the stage's process."""
    from mattgs_ops.capture import prepare as prepare_photos

    capture = CaptureConfig.model_validate(arguments["capture"])
    every = int(arguments["test_every"])
    prepare_photos.prepare(capture, out, test_every=every, threads=threads, progress=progress)
    # the key was made before this stage waited for a core
    if [capture_digest(capture), ids_digest(capture)] != arguments["files"]:
        raise StageError(f"{capture.name}: its files changed while they were read; run again")
