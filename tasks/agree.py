"""Make the masks of a scene's views agree (``mattgs_ops/object_masks/cross_view.py``)."""

from pathlib import Path
from typing import Any

from mattgs_ops.progress import Progress
from tasks.stages.stage import Artifact, Place, Stage, perform


def agree(place: Place, name: str, prepared: Artifact, scene: Artifact) -> Artifact:
    """Return the scene folder with masks, soft maps and points' votes that all views agree on."""
    stage = Stage(
        name="agree",
        title=f"agree {name}",
        operation="tasks.agree:operate",
        imports=("mattgs_ops.object_masks.cross_view",),
        spreads=True,
        parameters={},
        inputs={"capture": prepared.digest, "scene": scene.digest},
        arguments={"capture": str(place.folder(prepared)), "scene": str(place.folder(scene))},
    )
    return perform(place, stage)


def operate(arguments: dict[str, Any], out: Path, threads: int, progress: Progress) -> None:
    """Run in the stage's process."""
    from mattgs_ops.capture.scene import PreparedCapture, Scene
    from mattgs_ops.object_masks.cross_view import agree as make_agree

    make_agree(
        Scene.load(Path(arguments["scene"])),
        PreparedCapture.load(Path(arguments["capture"])),
        out,
        threads=threads,
        progress=progress,
    )
