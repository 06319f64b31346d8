"""What a training says about itself in ``training.json``: its loss terms and its memory.

Loss terms are means over all training views of the finished splats, unrounded, full frame, with
each photo's exposure where training found one. They come by their own names because the paper's
columns mix two scales:

* ``l1``, ``ssim``, ``loss``: plain, the same for every method; ``loss`` is
  ``(1 - λ) l1 + λ (1 - ssim)``;
* ``paper_l1``: mean of A times the absolute difference, eq. 15, with A of eqs. 9–14 on the
  training image; ``paper_loss`` the same with D-SSIM. Small because A is small, which says nothing
  about the rendering;
* ``optimised_loss``: what this method's optimiser saw.
"""

import resource
import sys
from collections.abc import Sequence

import numpy as np

from mattgs_ops.splat.attention import paper_attention
from mattgs_ops.splat.exposure import as_photographed
from mattgs_ops.splat.gaussians import FLOATS_PER_SPLAT
from mattgs_ops.splat.photos import Colour, StoredView
from mattgs_ops.splat.rasterize import render
from mattgs_ops.splat.ssim import photometric_loss
from mattgs_ops.splat.training.checkpoint import TrainingState
from mattgs_ops.splat.training.trainer import Trainer

# Parameters, gradients and two moments, twice while splats are added; and the engine's own
# records of a projected splat.
SPLAT_COPIES = 8
ENGINE_BYTES_PER_SPLAT = 256
VIEW_BYTES_PER_PIXEL = 4 + 3 + 4 + 4  # image and mask, photo, attention, weights of the loss
STEP_BYTES_PER_PIXEL = 256  # rendering, target, gradient, SSIM's planes
MIB = 1024.0 * 1024.0


def memory_bound(views: Sequence[StoredView], max_splats: int) -> float:
    """Return the MiB that training needs at most, without interpreter and libraries."""
    pixels = [view.mask.size for view in views]
    splats = max_splats * (FLOATS_PER_SPLAT * 4 * SPLAT_COPIES + ENGINE_BYTES_PER_SPLAT)
    total = sum(pixels) * VIEW_BYTES_PER_PIXEL + max(pixels) * STEP_BYTES_PER_PIXEL + splats
    return total / MIB


def peak_memory() -> float:
    """Return the most memory this process has held so far, MiB."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / MIB if sys.platform == "darwin" else peak / 1024.0  # bytes there, KiB here


def loss_terms(trainer: Trainer, state: TrainingState, colour: Colour) -> dict[str, float]:
    """Return the terms that the module's docstring names, over all training views."""
    share = trainer.config.ssim_lambda
    rows = []
    for index, view in enumerate(trainer.views):
        rendering = render(state.splats, view.camera, colour, threads=trainer.threads)
        image = as_photographed(state.exposures, index, rendering, colour)
        target = trainer.target(view, colour)
        found = photometric_loss(
            image,
            target,
            ssim_lambda=share,
            weight=trainer.weights(index),
            weight_ssim=trainer.method.weight_ssim,
            threads=trainer.threads,
        )
        difference = (image - target).abs().mean(dim=2).numpy()
        dissimilar = 1 - found.ssim
        paper = float((paper_attention(target.numpy()) * difference).mean(dtype=np.float64))
        l1 = found.plain_l1
        rows.append(
            {
                "l1": l1,
                "ssim": found.ssim,
                "loss": (1 - share) * l1 + share * dissimilar,
                "paper_l1": paper,
                "paper_loss": (1 - share) * paper + share * dissimilar,
                "optimised_loss": found.loss
                + trainer.alpha_loss(index, rendering)[0]
                + trainer.strategy.penalty(state.splats),
            }
        )
    return {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}
