"""A training of the segmenter can be followed in MLflow and ends in an ONNX file."""

from pathlib import Path

from mattgs_ops.segment.network.saliency import SaliencyNetwork
from mattgs_ops.segment.network.train_config import SegmentTrainConfig, StageConfig
from tasks.registry.segmenter_training import EXPERIMENT
from tasks.train_segmenter import train_segmenter


def test_a_training_and_its_continuation_are_one_run_with_a_curve(tmp_path: Path) -> None:
    from mlflow.tracking import MlflowClient

    leg = StageConfig(size=32, batch=2, steps=2, lr=1e-3, lr_end=1e-3)
    config = SegmentTrainConfig(stages=(leg,), validate_every=1, validation_images=1)
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    for _ in range(2):
        onnx = train_segmenter(config, tmp_path / "net", uri, tmp_path)
    client = MlflowClient(tracking_uri=uri)
    experiment = client.get_experiment_by_name(EXPERIMENT)
    (run,) = client.search_runs([experiment.experiment_id])
    assert run.info.status == "FINISHED"
    assert run.data.params["loss"] == "bce"
    assert [m.step for m in client.get_metric_history(run.info.run_id, "iou")] == [1, 2]
    assert {"train_loss", "val_loss", "f_measure", "mae", "boundary_f"} <= set(run.data.metrics)
    names = {file.path for file in client.list_artifacts(run.info.run_id)}
    assert {"u2netp.onnx", "u2netp.pth", "curve.csv", "training.json"} <= names
    assert SaliencyNetwork(onnx, threads=1).width == 32, "inference runs at the last leg's size"
