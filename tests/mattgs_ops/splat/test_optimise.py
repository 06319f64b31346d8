"""The optimiser of all fields, against torch's."""

from collections.abc import Callable

import torch

from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.optimise import FIELDS, Adam, concatenate, select
from mattgs_ops.splat.rasterize import Gradients

MakeSplats = Callable[[int, int], Splats]
RATES = {name: 10.0 ** -(i + 1) for i, name in enumerate(FIELDS)}


def gradients_like(splats: Splats, seed: int) -> Gradients:
    random = torch.Generator().manual_seed(seed)
    fields = {name: torch.randn(t.shape, generator=random) for name, t in splats.items()}
    none = torch.empty(0)
    return Gradients(**fields, means2d=none, means2d_abs=none, weight=none, weighted_map=none)


def test_every_field_moves_at_its_own_rate_as_torchs_adam_has_it(make_splats: MakeSplats) -> None:
    splats = make_splats(9, 0)
    copies = {name: tensor.clone().requires_grad_() for name, tensor in splats.items()}
    groups = [{"params": [copies[name]], "lr": RATES[name]} for name in FIELDS]
    reference = torch.optim.Adam(groups, eps=1e-15)
    adam = Adam(splats)
    for step in range(5):
        gradients = gradients_like(splats, step)
        for name in FIELDS:
            copies[name].grad = getattr(gradients, name).clone()
        reference.step()
        adam.step(splats, gradients, RATES)
    assert adam.steps == 5
    for name in FIELDS:
        torch.testing.assert_close(getattr(splats, name), copies[name].detach())


def test_an_unused_coefficient_does_not_move(make_splats: MakeSplats) -> None:
    splats = make_splats(4, 0)
    gradients = gradients_like(splats, 0)
    gradients.sh_rest[:, 3:] = 0  # degree 1: the rest has no gradient
    Adam(splats).step(splats, gradients, RATES)
    assert splats.sh_rest[:, :3].all()
    assert not splats.sh_rest[:, 3:].any()


def test_selecting_copies_and_concatenating_keeps_order(make_splats: MakeSplats) -> None:
    splats = make_splats(5, 0)
    chosen = select(splats, torch.tensor([3, 0]))
    both = concatenate(chosen, splats)
    both.check()
    assert torch.equal(both.means, splats.means[[3, 0, 0, 1, 2, 3, 4]])
    chosen.means += 1
    assert not torch.equal(chosen.means[0], splats.means[3])
