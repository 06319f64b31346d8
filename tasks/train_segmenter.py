"""Train the segmenter (``mattgs_ops/segment/network``), follow it in MLflow, export it to ONNX."""

import hashlib
from pathlib import Path

from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.segment.network.export import export
from mattgs_ops.segment.network.train import identity_of, train
from mattgs_ops.segment.network.train_config import SegmentTrainConfig
from mattgs_ops.segment.network.u2net import U2Net, load_weights
from tasks.registry.segmenter_training import TrainingRun

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
    key = hashlib.sha256(identity_of(config).encode()).hexdigest()[:KEY_LETTERS]
    run = TrainingRun(tracking_uri, out / "mlflow-artifacts", key, config.model_dump(mode="json"))
    try:
        report = train(config, folder, on_metrics=run.log, progress=progress)
        model = U2Net(config.variant)
        load_weights(model, report.weights)  # the moving average, not the last step's
        onnx = folder / f"{config.variant}.onnx"
        export(model.eval(), onnx, size=config.stages[-1].size)
    except BaseException:  # an interruption too: the run must not look as if it still went on
        run.end("FAILED")
        raise
    files = [folder / name for name in ("curve.csv", "training.json")]
    run.end("FINISHED", [onnx, report.weights, *(path for path in files if path.is_file())])
    return onnx
