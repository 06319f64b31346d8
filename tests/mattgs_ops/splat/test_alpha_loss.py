"""The alpha loss against autograd."""

import pytest
import torch

from mattgs_ops.splat.alpha_loss import alpha_loss


@pytest.mark.parametrize("weighted", [False, True])
def test_it_is_the_weighted_mean_distance_and_its_gradient(weighted: bool) -> None:
    rng = torch.Generator().manual_seed(0)
    alpha, mask, weight = torch.rand(3, 9, 7, generator=rng)
    alpha[0], mask[0] = 0.0, 0.0  # where nothing differs nothing pulls
    free = alpha.clone().requires_grad_()
    pixels = (free - mask).abs() * (weight if weighted else 1.0)
    expected = 0.3 * pixels.mean()
    expected.backward()
    loss, grad = alpha_loss(alpha, mask, 0.3, weight if weighted else None)
    assert loss == pytest.approx(float(expected.detach()), rel=1e-5)
    torch.testing.assert_close(grad, free.grad)
    assert not grad[0].any()
