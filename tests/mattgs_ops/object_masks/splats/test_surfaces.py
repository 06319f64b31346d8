"""Surfaces are the opaque splats of a short training."""

import torch

from mattgs_ops.object_masks.splats.surfaces import HAZE, without_haze
from mattgs_ops.splat.gaussians import Splats


def test_faint_splats_are_no_surface() -> None:
    opacities = torch.tensor([0.9, HAZE - 0.01, 0.02, HAZE + 0.01])
    splats = Splats.zeros(4)
    splats.opacity_logits = torch.logit(opacities)
    splats.means[:, 0] = torch.arange(4.0)
    kept = without_haze(splats)
    kept.check()
    torch.testing.assert_close(kept.means[:, 0], torch.tensor([0.0, 3.0]))
    torch.testing.assert_close(torch.sigmoid(kept.opacity_logits), opacities[[0, 3]])
    assert len(splats) == 4
