"""Memory kept from step to step: same addresses, right shapes, the same results."""

import torch

from mattgs_ops.splat.memory import Memory, Unshared
from mattgs_ops.splat.rasterize import backward, render
from mattgs_ops.splat.ssim import photometric_loss
from tests.reference.scenes import camera, random_splats

WHITE = (1.0, 1.0, 1.0)


def test_what_fits_lies_where_the_last_one_lay() -> None:
    memory = Memory()
    first = memory.take("gradients", 10, 3)
    second = memory.take("gradients", 4, 2)
    assert second.shape == (4, 2)
    assert second.data_ptr() == first.data_ptr()


def test_what_does_not_fit_gets_room_to_grow() -> None:
    memory = Memory()
    memory.take("gradients", 10)
    grown = memory.take("gradients", 20)
    assert grown.shape == (20,)
    assert memory.take("gradients", 30).data_ptr() == grown.data_ptr()


def test_names_do_not_share() -> None:
    memory = Memory()
    assert memory.take("image", 5).data_ptr() != memory.take("alpha", 5).data_ptr()


def test_without_a_memory_nothing_is_overwritten() -> None:
    fresh = Unshared()
    assert fresh.take("image", 5).data_ptr() != fresh.take("image", 5).data_ptr()


def test_a_step_gives_the_same_bits_with_a_memory_used_before_as_without() -> None:
    memory = Memory()
    for seed, count in ((0, 40), (1, 60), (2, 25)):
        splats, view = random_splats(count, seed), camera()
        found = []
        for given in (None, memory):
            rendering = render(splats, view, WHITE, memory=given)
            target = torch.zeros_like(rendering.image)
            loss = photometric_loss(rendering.image, target, memory=given)
            gradients = backward(rendering, loss.grad, memory=given)
            found.append([rendering.image, rendering.radii, *gradients.tensors().values()])
        for fresh, kept in zip(*found, strict=True):
            assert torch.equal(fresh, kept)
