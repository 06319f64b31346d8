"""Train the networks that cut objects out, follow them in MLflow, export them to ONNX.

The segmenter is that of ``mattgs_ops/segment/network``, the outline's of ``…/outline``.
"""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.segment.network.export import export
from mattgs_ops.segment.network.train import identity_of, train
from mattgs_ops.segment.network.train_config import SegmentTrainConfig
from mattgs_ops.segment.network.u2net import U2Net, load_weights
from mattgs_ops.segment.outline import train as outline
from mattgs_ops.segment.outline.train_config import OutlineTrainConfig
from tasks.registry.segmenter_training import TrainingRun
from tasks.registry.upkeep.moved import ARTIFACTS

KEY_LETTERS = 12


def train_segmenter(
    config: SegmentTrainConfig,
    folder: Path,
    tracking_uri: str,
    out: Path,
    *,
    progress: Progress = no_progress,
) -> Path:
    """Train into ``folder`` and return the ONNX file that ``segment.model`` takes.

    The network's side in the file is that of the last leg. An interrupted training goes on from
    ``folder``'s checkpoint, in the same MLflow run. MLflow keeps files below ``out``.
    """
    with _followed(config, identity_of(config), tracking_uri, out) as (run, files):
        report = train(config, folder, on_metrics=run.log, progress=progress)
        model = U2Net(config.variant)
        load_weights(model, report.weights)  # the moving average, not the last step's
        onnx = folder / f"{config.variant}.onnx"
        export(model.eval(), onnx, size=config.stages[-1].size)
        written = (folder / name for name in ("curve.csv", "training.json"))
        files += [onnx, report.weights, *(path for path in written if path.is_file())]
    return onnx


def train_outline(
    config: OutlineTrainConfig,
    folder: Path,
    tracking_uri: str,
    out: Path,
    *,
    progress: Progress = no_progress,
) -> Path:
    """Train into ``folder`` and return the outline's ONNX file; else as ``train_segmenter``."""
    with _followed(config, config.model_dump_json(), tracking_uri, out) as (run, files):
        onnx = outline.train(config, folder, on_metrics=run.log, progress=progress)
        files += [onnx, folder / "outline.pth", folder / "curve.csv"]
    return onnx


@contextmanager
def _followed(
    config: SegmentTrainConfig | OutlineTrainConfig, identity: str, tracking_uri: str, out: Path
) -> Iterator[tuple[TrainingRun, list[Path]]]:
    """Open the MLflow run of a training, and end it with the files that the caller puts down."""
    key = hashlib.sha256(identity.encode()).hexdigest()[:KEY_LETTERS]
    run = TrainingRun(tracking_uri, out / ARTIFACTS, key, config.model_dump(mode="json"))
    files: list[Path] = []
    try:
        yield run, files
    except BaseException:  # an interruption too: the run must not look as if it still went on
        run.end("FAILED")
        raise
    run.end("FINISHED", files)
