"""Training of the segmenter, as a Prefect flow for schedules and as a plain call for a terminal."""

from pathlib import Path

from prefect import flow

from flows import embedded
from mattgs_ops.segment.train_config import load_train_config
from tasks.train_segmenter import train_segmenter


@flow(name="segmenter", persist_result=False)
def segmenter(config: Path, folder: Path, out: Path) -> Path:
    """Train by a TOML file into ``folder``; MLflow is the one of ``out``. Returns the ONNX file."""
    return train_segmenter(load_train_config(config), folder, embedded.tracking_uri(out), out)
