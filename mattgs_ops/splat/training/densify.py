"""Adding and removing splats while they train: the default strategy of Kerbl et al. 2023.

Between two densifications the norm of each splat's positional gradient on the screen, in
normalised device coordinates, is averaged over the steps that saw it. Where the mean is high,
small splats are cloned and large ones split in two drawn from their own density, scales divided by
1.6. Splats of opacity below 0.005 go, and, once opacities have been reset, those larger than a
tenth of the scene's extent. (The release also means to remove splats that were large on the
screen, but clears that record just before it looks; gsplat leaves the rule out, and so do we.)

No more than ``max_splats`` exist: when more would be added, those of the highest mean gradient are.
For MATT-GS's pruning the attention under each splat, weighted by its blending weight, is summed
in the same places.
"""

import math
from dataclasses import dataclass, fields

import numpy as np
import torch
from torch import Tensor

from mattgs_ops.config import TrainConfig
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.training.optimise import Adam, concatenate, select

SPLIT_SAMPLES = 2
SPLIT_SHRINK = 0.8 * SPLIT_SAMPLES  # 1.6: each half is smaller than what it came from
RESET_OPACITY = 0.01
HUGE_SHARE = 0.1  # of the extent


@dataclass
class Record:
    """What was seen of each splat since the last densification; [N] float32 each."""

    gradient: Tensor  # sum of norms, NDC
    seen: Tensor  # steps that saw the splat
    weight: Tensor  # sum of blending weights
    attention: Tensor  # sum of blending weight times attention

    @classmethod
    def empty(cls, count: int) -> "Record":
        """Start anew for ``count`` splats."""
        return cls(*(torch.zeros(count) for _ in range(4)))

    def observe(self, means2d: Tensor, radii: Tensor, width: int, height: int) -> None:
        """Add one step: ``means2d`` [N, 2] dL/d pixel, ``radii`` [N] pixels, 0 where unseen.

        ``means2d`` may be the signed sum over pixels or the sum of absolute values.
        """
        # a pixel is 2 / width of normalised device coordinates
        norm = torch.hypot(means2d[:, 0] * (0.5 * width), means2d[:, 1] * (0.5 * height))
        self.gradient += norm  # zero where unseen
        self.seen += radii > 0

    def keep(self, index: Tensor) -> "Record":
        """Return the record of the splats of ``index``."""
        return Record(*(getattr(self, f.name)[index] for f in fields(self)))

    def gradients(self) -> Tensor:
        """Return the mean gradient [N] over the steps that saw each splat."""
        return self.gradient / self.seen.clamp(min=1)

    def contributions(self) -> Tensor:
        """Return the blending weight [N], in pixels, per step that saw the splat."""
        return self.weight / self.seen.clamp(min=1)

    def blend_scores(self) -> Tensor:
        """Return attention per blending weight [N] in [0, 1]; 0 where nothing was blended."""
        return self.attention / self.weight.clamp(min=torch.finfo(torch.float32).tiny)


def logit(share: float) -> float:
    """Return the logarithm of the odds, the form opacity is stored in; infinite at 0 and at 1."""
    return math.log(share / (1 - share)) if 0 < share < 1 else math.copysign(math.inf, share - 0.5)


def reset_opacity(splats: Splats, adam: Adam) -> None:
    """Lower every opacity to 0.01 at most, and forget where it was heading."""
    splats.opacity_logits.clamp_(max=logit(RESET_OPACITY))
    adam.forget("opacity_logits")


def grow(
    splats: Splats,
    adam: Adam,
    gradient: Tensor,
    threshold: float,
    config: TrainConfig,
    extent: float,
    rng: np.random.Generator,
) -> Splats:
    """Clone and split where ``gradient`` [N] reaches ``threshold``; ``adam`` follows.

    Returns the new splats: those that stayed whole first, then what was added.
    """
    wanted = _strongest(gradient, gradient >= threshold, config.max_splats - len(gradient))
    large = splats.log_scales.amax(dim=1) > math.log(config.densify_scale * extent)
    cloned = torch.nonzero(wanted & ~large)[:, 0]
    halved = torch.nonzero(wanted & large)[:, 0]
    added = concatenate(select(splats, cloned), _halves(select(splats, halved), rng))
    kept = torch.nonzero(~(wanted & large))[:, 0]
    adam.keep(kept)
    adam.join(len(added))
    return concatenate(select(splats, kept), added)


def prune(splats: Splats, adam: Adam, removed: Tensor) -> Splats:
    """Remove the splats of ``removed`` [N] bool, with ``adam`` following."""
    kept = torch.nonzero(~removed)[:, 0]
    adam.keep(kept)
    return select(splats, kept)


def faint_or_huge(splats: Splats, config: TrainConfig, extent: float, *, huge: bool) -> Tensor:
    """Return who goes by the rules of 3DGS [N] bool; ``huge``: whether size is a reason yet."""
    removed = splats.opacity_logits < logit(config.prune_opacity)
    if huge:
        removed |= splats.log_scales.amax(dim=1) > math.log(HUGE_SHARE * extent)
    return removed


def _strongest(gradient: Tensor, wanted: Tensor, room: int) -> Tensor:
    """Return ``wanted`` [N] bool, cut to the ``room`` splats of highest gradient.

    Cloning and splitting add one splat each. Ties go to the lower index.
    """
    if int(wanted.sum()) <= room:
        return wanted
    order = torch.argsort(torch.where(wanted, -gradient, math.inf), stable=True)
    chosen = torch.zeros_like(wanted)
    chosen[order[: max(room, 0)]] = True
    return chosen


def _halves(splats: Splats, rng: np.random.Generator) -> Splats:
    """Return two smaller splats for each, drawn from its own density; all firsts come first."""
    count = len(splats)
    doubled = select(splats, torch.arange(count).repeat(SPLIT_SAMPLES))
    drawn = torch.from_numpy(rng.standard_normal((len(doubled), 3), dtype=np.float32))
    local = drawn * doubled.log_scales.exp()
    turned = torch.einsum("nij,nj->ni", rotation_matrices(doubled.quaternions), local)
    doubled.means += turned
    doubled.log_scales -= math.log(SPLIT_SHRINK)
    return doubled


def rotation_matrices(quaternions: Tensor) -> Tensor:
    """Return the rotations [N, 3, 3] of quaternions w x y z [N, 4] of any length but zero.

    ``capture.camera.rotation_of`` does the same for one camera in numpy: what reads cameras does
    not import torch.
    """
    w, x, y, z = torch.nn.functional.normalize(quaternions, dim=1).unbind(dim=1)
    rows = (
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return torch.stack(rows, dim=1).reshape(-1, 3, 3)
