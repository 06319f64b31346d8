"""Find cameras and sparse points (``mattgs_ops/sfm``)."""

import shutil
from pathlib import Path
from typing import Any

from mattgs_ops.config import SfmConfig
from mattgs_ops.progress import Progress
from tasks.stages.stage import Artifact, Place, Stage, perform


def sfm(
    place: Place, name: str, prepared: Artifact, masks: Artifact, config: SfmConfig
) -> Artifact:
    """Return the scene folder of a capture and its masks."""
    stage = Stage(
        name="sfm",
        title=f"sfm {name}",
        operation="tasks.sfm:operate",
        imports=("mattgs_ops.sfm",),
        spreads=True,
        parameters=config.model_dump(mode="json"),
        inputs={"capture": prepared.digest, "masks": masks.digest},
        arguments={
            "capture": str(place.folder(prepared)),
            "masks": str(place.folder(masks)),
            "config": config.model_dump(mode="json"),
        },
    )
    return perform(place, stage)


def operate(arguments: dict[str, Any], out: Path, threads: int, progress: Progress) -> None:
    """Run in the stage's process."""
    from mattgs_ops.capture.scene import PreparedCapture
    from mattgs_ops.sfm import reconstruct

    masks = Path(arguments["masks"])
    reconstruct(
        PreparedCapture.load(Path(arguments["capture"])),
        masks / "masks",
        SfmConfig.model_validate(arguments["config"]),
        out,
        soft=masks / "soft",
        threads=threads,
        progress=progress,
    )
    shutil.copyfile(masks / "masks.json", out / "masks.json")
