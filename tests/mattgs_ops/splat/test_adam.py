"""The fused Adam against torch's."""

import pytest
import torch

from mattgs_ops.errors import InputError
from mattgs_ops.splat.adam import adam_step


@pytest.mark.parametrize("count", [1, 7, 16, 100_003])
def test_twenty_steps_match_torch(count: int) -> None:
    g = torch.Generator().manual_seed(0)
    start = torch.randn(count, generator=g)
    theirs = start.clone().double().requires_grad_()
    optimiser = torch.optim.Adam([theirs], lr=0.01, eps=1e-15)
    ours, m, v = start.clone(), torch.zeros(count), torch.zeros(count)
    for step in range(1, 21):
        grad = torch.randn(count, generator=g) * 10.0 ** (step % 5 - 4)
        theirs.grad = grad.double()
        optimiser.step()
        adam_step(ours, grad, m, v, rate=0.01, step=step, threads=1 + step % 2)
    torch.testing.assert_close(ours.double(), theirs.detach(), rtol=1e-5, atol=1e-5)


def test_without_gradient_nothing_moves() -> None:
    value, zero = torch.randn(50, 3), torch.zeros(50, 3)
    before = value.clone()
    adam_step(value, zero, zero.clone(), zero.clone(), rate=0.1, step=1)
    assert torch.equal(value, before)


def test_wrong_input_is_named() -> None:
    value = torch.zeros(6, 3)
    good = {"grad": value.clone(), "first_moment": value.clone(), "second_moment": value.clone()}
    for name in good:
        with pytest.raises(InputError, match=name):
            adam_step(value, **{**good, name: torch.zeros(5, 3)}, rate=0.1, step=1)
        with pytest.raises(InputError, match=name):
            adam_step(value, **{**good, name: torch.zeros(3, 6).T}, rate=0.1, step=1)
    with pytest.raises(InputError, match="step"):
        adam_step(value, **good, rate=0.1, step=0)
    with pytest.raises(InputError, match="threads"):
        adam_step(value, **good, rate=0.1, step=1, threads=0)
