"""The exported file computes what the network computes."""

from pathlib import Path

import numpy as np
import pytest
import torch

from mattgs_ops.errors import StageError
from mattgs_ops.segment.network import export as exporting
from mattgs_ops.segment.network.preprocess import network_input
from mattgs_ops.segment.network.saliency import SaliencyNetwork
from mattgs_ops.segment.network.u2net import U2Net
from mattgs_ops.segment.onnx_files import onnx_file


def test_torch_and_onnx_runtime_agree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    torch.manual_seed(0)
    model, path = U2Net("u2netp").eval(), tmp_path / "m.onnx"
    assert exporting.export(model, path, size=64) < 1e-4
    assert path.stat().st_size < 6e6
    network = SaliencyNetwork(path)
    assert (network.width, network.height) == (64, 64)
    photo = np.random.default_rng(0).integers(0, 256, (50, 70, 3)).astype(np.uint8)
    x = network_input(photo, 64, 64)[None]
    with torch.no_grad():
        expected = model(torch.from_numpy(x))[0].sigmoid()[0, 0].numpy()
    assert network.raw_maps(x)[0] == pytest.approx(expected, abs=1e-4)
    monkeypatch.setattr(onnx_file, "TOLERANCE", -1.0)
    with pytest.raises(StageError, match="expected ONNX Runtime to agree"):
        exporting.export(model, path, size=64)
