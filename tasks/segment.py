"""Cut the object out of every photo (``mattgs_ops/segment/infer.py``)."""

from pathlib import Path
from typing import Any

from mattgs_ops.config import SegmentConfig
from mattgs_ops.progress import Progress
from mattgs_ops.segment.network.saliency import BUNDLED_MODEL
from mattgs_ops.store.digests import file_digest
from tasks.stages.stage import Artifact, Place, Stage, perform


def segment(place: Place, name: str, prepared: Artifact, config: SegmentConfig) -> Artifact:
    """Return the folder with ``masks/``, ``soft/`` and ``masks.json`` of a prepared capture."""
    model = (config.model or BUNDLED_MODEL).resolve()
    stage = Stage(
        name="segment",
        title=f"segment {name}",
        operation="tasks.segment:operate",  # in a fresh process: ONNX Runtime starts threads
        spreads=True,
        parameters=config.model_dump(mode="json", exclude={"model"}),
        inputs={
            "capture": prepared.digest,
            "model": file_digest(model),
        },
        arguments={
            "capture": str(place.folder(prepared)),
            "config": config.model_dump(mode="json") | {"model": str(model)},
        },
    )
    return perform(place, stage)


def operate(arguments: dict[str, Any], out: Path, threads: int, progress: Progress) -> None:
    """Run in the stage's process."""
    from mattgs_ops.capture.scene import PreparedCapture
    from mattgs_ops.segment.infer import segment as cut_out

    capture = PreparedCapture.load(Path(arguments["capture"]))
    config = SegmentConfig.model_validate(arguments["config"])
    cut_out(capture, config, out, threads=threads, progress=progress)
