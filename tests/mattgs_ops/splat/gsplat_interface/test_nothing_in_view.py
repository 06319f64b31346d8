"""A camera that sees no splat draws the background, and zeros in the other channels."""

import subprocess
import sys

import pytest

# a process of its own: the engine keeps its work memory, which then has had a fourth channel
PROGRAM = """
import sys
import torch
from mattgs_ops.splat import rasterization

channels, mode = int(sys.argv[1]), sys.argv[2]
camera = torch.tensor([[[60.0, 0, 32], [0, 60, 24], [0, 0, 1]]])
for count in (0, 1):
    behind = torch.tensor([[0.0, 0, -5]]).repeat(count, 1)
    arrays = (behind, torch.tensor([[1.0, 0, 0, 0]]).repeat(count, 1), torch.full((count, 3), 0.1))
    splats = (*arrays, torch.full((count,), 0.5), torch.rand(count, channels))
    used = [torch.full((48, 64, depth), 7.0) for depth in (3, 4) for _ in range(9)]
    del used  # what comes next gets this memory
    image, alpha, _ = rasterization(*splats, torch.eye(4)[None], camera, 64, 48, render_mode=mode)
    assert not alpha.any(), alpha.max()
    assert not image.any(), (count, image.min(), image.max())
"""


@pytest.mark.parametrize(("channels", "mode"), [(3, "RGB+ED"), (3, "RGB+D"), (8, "RGB")])
def test_nothing_in_view_draws_nothing(channels: int, mode: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(channels), mode],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-500:]
