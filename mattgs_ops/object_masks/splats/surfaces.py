"""Splats of a whole scene after a short training, in memory: nothing is written, nothing timed.

Votes need surfaces and no experiment: 3DGS on the photos as they are, one colour a splat, at the
learning rates that short trainings are tuned to. Splats that stay faint (``without_haze``) are
mostly haze, with which even ground and shade are filled: in front of an object it hides a part of
it from one view and not from the next.
"""

from dataclasses import replace

import torch

from mattgs_ops.capture.scene import Scene
from mattgs_ops.config import Condition, TrainConfig
from mattgs_ops.method import TUNED, MethodConfig
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.training.train import Experiment, train_in_memory

PLAIN = Condition(background="original", method="3dgs")
# The released rates are for 30,000 steps: after 1,000 splats still straddle outlines, and hang in
# the shade under a board. docs/mask_bounds.md says what masks gain by it
FAST = MethodConfig(rates=TUNED.rates)
# Surfaces need no gloss: on the bundled captures masks are as good (IoU +0.000, +0.001, +0.004)
# and training takes 13 % less, `python benchmarks/segment.py`
WITHOUT_GLOSS = TrainConfig(sh_degree=0)
HAZE = 0.2  # opacity up to which a splat is no surface; docs/mask_bounds.md


def train_surfaces(
    scene: Scene,
    *,
    iterations: int,
    resolution: int,
    seed: int = 0,
    threads: int = 1,
    progress: Progress = no_progress,
) -> Splats:
    """Train on all registered training photos and return the splats.

    ``resolution`` is the longest side in pixels. Same seed, same splats, whatever the number of
    threads. Raises what reading photos and a step of training raise.
    """
    experiment = Experiment(scene, PLAIN, FAST, WITHOUT_GLOSS, iterations, resolution, seed)
    return train_in_memory(experiment, threads=threads, progress=progress)


def without_haze(splats: Splats) -> Splats:
    """Return the splats of an opacity above :data:`HAZE`."""
    opaque = torch.sigmoid(splats.opacity_logits) > HAZE
    return replace(splats, **{name: tensor[opaque] for name, tensor in splats.items()})
