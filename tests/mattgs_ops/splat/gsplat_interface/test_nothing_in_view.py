"""A camera that sees no splat draws the background, and zeros in the other channels."""

import subprocess
import sys

import pytest

CASES = [(3, "RGB+ED"), (3, "RGB+D"), (8, "RGB")]
# A process for each case: the engine keeps its work memory, which then has had a fourth channel.
# All are forks of one that has imported torch, which takes seconds, and has started no thread.
PROGRAM = """
import os
import sys
import torch
from mattgs_ops.splat import rasterization

def draw(channels, mode):
    camera = torch.tensor([[[60.0, 0, 32], [0, 60, 24], [0, 0, 1]]])
    for count in (0, 1):
        behind = torch.tensor([[0.0, 0, -5]]).repeat(count, 1)
        turn = torch.tensor([[1.0, 0, 0, 0]]).repeat(count, 1)
        arrays = (behind, turn, torch.full((count, 3), 0.1))
        splats = (*arrays, torch.full((count,), 0.5), torch.rand(count, channels))
        used = [torch.full((48, 64, depth), 7.0) for depth in (3, 4) for _ in range(9)]
        del used  # what comes next gets this memory
        eye = torch.eye(4)[None]
        image, alpha, _ = rasterization(*splats, eye, camera, 64, 48, render_mode=mode)
        assert not alpha.any(), alpha.max()
        assert not image.any(), (count, image.min(), image.max())

for case in sys.argv[1:]:
    print(f"begins {case}", file=sys.stderr, flush=True)
    child = os.fork()
    if child == 0:
        channels, mode = case.split()
        draw(int(channels), mode)
        sys.stderr.flush()
        os._exit(0)
    if os.waitpid(child, 0)[1] == 0:
        print(case, flush=True)
"""


def named(channels: int, mode: str) -> str:
    return f"{channels} {mode}"


@pytest.fixture(scope="module")
def drawn() -> subprocess.CompletedProcess[str]:
    """Try every case; those that drew nothing are in the output."""
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, *(named(*case) for case in CASES)],
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(("channels", "mode"), CASES)
def test_nothing_in_view_draws_nothing(
    drawn: subprocess.CompletedProcess[str], channels: int, mode: str
) -> None:
    assert named(channels, mode) in drawn.stdout.splitlines(), drawn.stderr[-1500:]
