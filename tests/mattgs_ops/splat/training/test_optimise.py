"""The optimiser of all fields, which goes back and moves in one pass, against torch's."""

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch

from mattgs_ops.capture.camera import Camera
from mattgs_ops.errors import InputError, StageError
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.rasterize import backward, render
from mattgs_ops.splat.training.optimise import FIELDS, Adam, concatenate, select
from tests.reference.scenes import camera, random_splats

MakeSplats = Callable[[int, int], Splats]
RATES = {name: 10.0 ** -(i + 2) for i, name in enumerate(FIELDS)}
WHITE = (1.0, 1.0, 1.0)


def upstream(view: Camera, seed: int) -> torch.Tensor:
    size = (view.intrinsics.height, view.intrinsics.width, 3)
    return torch.randn(size, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("count", [1, 7, 64, 70, 1100])
def test_a_descent_is_a_pass_back_and_a_step_of_torchs_adam(count: int) -> None:
    view, splats = camera(40, 33), random_splats(count, seed=count)
    theirs = {name: tensor.clone().requires_grad_() for name, tensor in splats.items()}
    reference = torch.optim.Adam(
        [{"params": [theirs[name]], "lr": RATES[name]} for name in FIELDS], eps=1e-15
    )
    adam = Adam(splats)
    for step in range(4):
        rendering = render(splats, view, WHITE, threads=1 + step % 2)
        grad = upstream(view, step)
        grad_alpha = grad.mean(dim=2) if step > 1 else None
        expected = backward(rendering, grad, grad_alpha)
        for name in FIELDS:
            theirs[name].grad = getattr(expected, name).clone()
        reference.step()
        adam.descend(rendering, grad, RATES, grad_alpha=grad_alpha)
        for name in FIELDS:
            ours = getattr(splats, name)
            torch.testing.assert_close(ours, theirs[name].detach(), rtol=1e-5, atol=1e-5)
            theirs[name].data.copy_(ours)  # so that roundings do not add up over renderings
    assert adam.steps == 4


def test_a_descent_sees_what_a_pass_back_sees() -> None:
    view, splats = camera(40, 33), random_splats(70, seed=0)
    rendering = render(splats, view, WHITE)
    attention = torch.rand(33, 40, generator=torch.Generator().manual_seed(1))
    grad = upstream(view, 0)
    expected = backward(rendering, grad, pixel_map=attention).observed
    found = Adam(splats).descend(rendering, grad, RATES, pixel_map=attention, statistics=True)
    for name, tensor in vars(expected).items():
        assert torch.equal(getattr(found, name), tensor), name


def test_any_number_of_threads_gives_the_same_bits() -> None:
    view, ended = camera(40, 33), []
    for threads in (1, 3):
        splats = random_splats(2500, seed=0)
        adam = Adam(splats)
        for step in range(2):
            rendering = render(splats, view, WHITE, threads=threads)
            adam.descend(rendering, upstream(view, step), RATES)
        ended.append(splats)
    for name, tensor in ended[0].items():
        assert torch.equal(tensor, getattr(ended[1], name)), name


@pytest.mark.parametrize(("degree", "used"), [(0, 0), (1, 3), (2, 8), (3, 15)])
def test_an_unused_coefficient_does_not_move(degree: int, used: int) -> None:
    view, splats = camera(40, 33), random_splats(20, seed=0)
    before = splats.sh_rest.clone()
    rendering = render(splats, view, WHITE, sh_degree=degree)
    Adam(splats).descend(rendering, upstream(view, 0), RATES)
    moved = (splats.sh_rest != before).any(dim=0).any(dim=-1)
    assert moved.tolist() == [True] * used + [False] * (15 - used)


def test_a_splat_out_of_view_goes_on_by_its_momentum() -> None:
    view, splats = camera(40, 33), random_splats(20, seed=0)
    adam = Adam(splats)
    adam.descend(render(splats, view, WHITE), upstream(view, 0), RATES)
    before, away = splats.means.clone(), replace(view, translation=view.translation - 1000)
    adam.descend(render(splats, away, WHITE), upstream(view, 1), RATES)
    assert bool((splats.means != before).any())


def test_penalties_weigh_on_splats_out_of_view_too() -> None:
    view, splats = camera(40, 33), random_splats(20, seed=0)
    away = replace(view, translation=view.translation - 1000)
    adam, before = Adam(splats), replace(splats, log_scales=splats.log_scales.clone())
    opacity = splats.opacity_logits.sigmoid()
    adam.descend(render(splats, away, WHITE), upstream(view, 0), RATES, penalties=(0.3, 0.02))
    # the first moment after one step is a tenth of the gradient
    expected = 0.3 * opacity * (1 - opacity)
    torch.testing.assert_close(adam.first["opacity_logits"] / 0.1, expected, rtol=1e-5, atol=1e-7)
    expected = 0.02 * before.log_scales.exp()
    torch.testing.assert_close(adam.first["log_scales"] / 0.1, expected, rtol=1e-5, atol=1e-7)
    assert not adam.first["means"].any()


def test_a_gradient_that_is_not_finite_is_named() -> None:
    view, splats = camera(40, 33), random_splats(20, seed=0)
    grad = upstream(view, 0)
    grad[16, 20] = float("nan")
    with pytest.raises(StageError, match=r"gradient of `means`.*`sh_dc` is not finite"):
        Adam(splats).descend(render(splats, view, WHITE), grad, RATES)


def test_what_was_not_rendered_for_it_has_no_way_back() -> None:
    view, splats = camera(40, 33), random_splats(20, seed=0)
    rendering = render(splats, view, WHITE, differentiable=False)
    assert torch.equal(rendering.image, render(splats, view, WHITE).image)
    with pytest.raises(ValueError, match="way back"):
        Adam(splats).descend(rendering, upstream(view, 0), RATES)
    with pytest.raises(InputError, match="grad_image"):
        Adam(splats).descend(render(splats, view, WHITE), torch.zeros(3, 3, 3), RATES)


def test_selecting_copies_and_concatenating_keeps_order(make_splats: MakeSplats) -> None:
    splats = make_splats(5, 0)
    chosen = select(splats, torch.tensor([3, 0]))
    both = concatenate(chosen, splats)
    both.check()
    assert torch.equal(both.means, splats.means[[3, 0, 0, 1, 2, 3, 4]])
    chosen.means += 1
    assert not torch.equal(chosen.means[0], splats.means[3])
