"""The fused loss against autograd in float64."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from mattgs_ops.errors import InputError
from mattgs_ops.splat.ssim import photometric_loss
from tests.reference.splatting import ssim_map


def images(
    height: int, width: int, seed: int = 0
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    g = torch.Generator().manual_seed(seed)
    target = torch.rand(height, width, 3, generator=g)
    image = (target + 0.2 * torch.randn(height, width, 3, generator=g)).clamp(-0.1, 1.1)
    return image, target, torch.rand(height, width, generator=g)


@pytest.mark.parametrize(
    ("height", "width"), [(1, 1), (1, 40), (40, 1), (5, 6), (11, 11), (37, 50), (130, 23)]
)
@pytest.mark.parametrize("weighted", ["nothing", "L1", "both"])
@pytest.mark.parametrize("ssim_lambda", [0.0, 0.2, 1.0])
def test_loss_and_gradient_match_autograd(
    height: int, width: int, weighted: str, ssim_lambda: float
) -> None:
    image, target, weight = images(height, width)
    slow = image.double().requires_grad_()
    difference = (slow - target.double()).abs()
    ones = torch.ones(height, width, dtype=torch.float64)
    w = ones if weighted == "nothing" else weight.double()
    v = w if weighted == "both" else ones
    l1 = (w[:, :, None] * difference).mean()
    similarity = ssim_map(slow, target.double())
    ssim = similarity.mean()
    loss = (1 - ssim_lambda) * l1 + ssim_lambda * (1 - (v[:, :, None] * similarity).mean())
    loss.backward()

    found = photometric_loss(
        image,
        target,
        ssim_lambda=ssim_lambda,
        weight=None if weighted == "nothing" else weight,
        weight_ssim=weighted == "both",
    )
    assert found.loss == pytest.approx(float(loss.detach()), abs=1e-5)
    assert found.l1 == pytest.approx(float(l1.detach()), abs=1e-6)
    assert found.plain_l1 == pytest.approx(float(difference.detach().mean()), abs=1e-6)
    assert found.ssim == pytest.approx(float(ssim.detach()), abs=2e-5)
    expected = slow.grad
    assert expected is not None
    torch.testing.assert_close(
        found.grad.double(), expected, rtol=1e-3, atol=2e-4 * float(expected.abs().max())
    )


def test_equal_images_have_no_loss_and_no_gradient() -> None:
    image, _, _ = images(50, 41)
    image[:20] = 1.0  # flat: no variance to divide by
    found = photometric_loss(image, image.clone())
    assert found.loss == pytest.approx(0, abs=1e-6)
    assert float(found.grad.abs().max()) < 1e-8


@pytest.mark.parametrize("threads", [2, 3, 7])
def test_the_same_bits_for_any_number_of_threads(threads: int) -> None:
    image, target, weight = images(211, 70)
    one = photometric_loss(image, target, weight=weight)
    many = photometric_loss(image, target, weight=weight, threads=threads)
    assert torch.equal(one.grad, many.grad)
    assert (one.loss, one.l1, one.ssim) == (many.loss, many.l1, many.ssim)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(height=st.integers(1, 70), width=st.integers(1, 70), seed=st.integers(0, 99))
def test_any_size_gives_finite_results(height: int, width: int, seed: int) -> None:
    image, target, weight = images(height, width, seed)
    found = photometric_loss(image, target, weight=weight, threads=2)
    assert bool(torch.isfinite(found.grad).all())
    assert -1 <= found.ssim <= 1


def test_wrong_input_is_named() -> None:
    image, target, weight = images(8, 9)
    with pytest.raises(InputError, match="image"):
        photometric_loss(image[..., :2], target)
    with pytest.raises(InputError, match="image"):
        photometric_loss(image[:0], target[:0])
    with pytest.raises(InputError, match="target"):
        photometric_loss(image, target[:4])
    with pytest.raises(InputError, match="target"):
        photometric_loss(image, target.double())
    with pytest.raises(InputError, match="weight"):
        photometric_loss(image, target, weight=weight.T)
    with pytest.raises(InputError, match="ssim_lambda"):
        photometric_loss(image, target, ssim_lambda=1.5)
    with pytest.raises(InputError, match="threads"):
        photometric_loss(image, target, threads=0)
