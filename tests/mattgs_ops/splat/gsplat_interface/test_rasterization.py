"""gsplat's interface against the slow float64 reference: values and gradients."""

from typing import Any

import pytest
import torch
from torch import Tensor

from mattgs_ops.splat import rasterization
from tests.mattgs_ops.splat.gsplat_interface.conftest import (
    DIFFERENTIABLE,
    HEIGHT,
    WIDTH,
    Tensors,
    reference,
    scene,
)

VALUE_TOLERANCE = 1e-4
# of a gradient's norm: float32 sums of some hundred pixels and splats
GRADIENT_TOLERANCE = 1e-3
MODES = ("RGB", "D", "ED", "RGB+D", "RGB+ED")


def check(
    given: Tensors, mode: str, degree: int | None, limits: dict[str, float] | None = None
) -> None:
    """Compare values and all gradients of a random loss."""
    fast = {n: t.clone().requires_grad_(n in DIFFERENTIABLE) for n, t in given.items()}
    slow = {n: t.double().requires_grad_(n in DIFFERENTIABLE) for n, t in given.items()}
    names = {"low_pass": "eps2d", "near": "near_plane", "far": "far_plane"}
    named = {names[n]: v for n, v in (limits or {}).items()}
    images, alphas, _ = rasterization(
        **fast, width=WIDTH, height=HEIGHT, sh_degree=degree, render_mode=mode, **named
    )
    expected = [reference(slow, mode, degree, c, **(limits or {}))[:2] for c in range(2)]
    g = torch.Generator().manual_seed(7)
    upstream = [torch.randn(t.shape, generator=g) for t in (images, alphas)]
    for camera, (image, alpha) in enumerate(expected):
        found = images[camera].double(), alphas[camera].double()
        torch.testing.assert_close(found[0], image, rtol=VALUE_TOLERANCE, atol=VALUE_TOLERANCE)
        torch.testing.assert_close(found[1], alpha, rtol=0, atol=VALUE_TOLERANCE)
    ((images * upstream[0]).sum() + (alphas * upstream[1]).sum()).backward()
    sum(
        (image * upstream[0][c]).sum() + (alpha * upstream[1][c]).sum()
        for c, (image, alpha) in enumerate(expected)
    ).backward()  # type: ignore[union-attr]
    for name in DIFFERENTIABLE:
        mine, theirs = fast[name].grad, slow[name].grad
        if theirs is None:
            assert mine is None or float(mine.abs().max()) == 0, name
            continue
        assert mine is not None, name
        assert float((mine - theirs).norm()) <= GRADIENT_TOLERANCE * float(theirs.norm()), name


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("degree", [None, 0, 1, 3])
def test_values_and_gradients_match_the_reference(mode: str, degree: int | None) -> None:
    check(scene(1, degree=degree), mode, degree)


@pytest.mark.parametrize("channels", [1, 2, 4, 5, 9])
@pytest.mark.parametrize("mode", ["RGB", "RGB+ED"])
def test_any_number_of_plain_channels(channels: int, mode: str) -> None:
    check(scene(2, channels=channels), mode, None)


@pytest.mark.parametrize("degree", [None, 2])
def test_colours_of_each_camera(degree: int | None) -> None:
    given = scene(3, degree=degree)
    given["colors"] = torch.stack([given["colors"], given["colors"].flip(0)])
    check(given, "RGB+D", degree)


@pytest.mark.parametrize(
    "limits", [{"low_pass": 0.0}, {"low_pass": 1.5}, {"near": 3.5}, {"far": 4.5}]
)
def test_limits_match_the_reference(limits: dict[str, float]) -> None:
    given = scene(14, degree=1)
    everything = reference({n: t.double() for n, t in given.items()}, "RGB", 1, 0)[0]
    limited = reference({n: t.double() for n, t in given.items()}, "RGB", 1, 0, **limits)[0]
    assert float((everything - limited).detach().abs().max()) > 0.01  # the limit does something
    check(given, "RGB+D", 1, limits)


def test_opaque_and_empty_splats() -> None:
    given = scene(5)
    given["opacities"][:4] = torch.tensor([0.0, 1.0, 0.9995, 1 / 300])
    check(given, "RGB", None)


def test_view_matrices_that_are_no_rotations_are_taken_as_they_are() -> None:
    given = scene(6, degree=2)
    g = torch.Generator().manual_seed(1)
    given["viewmats"][0, :3, :3] += 0.05 * torch.randn(3, 3, generator=g)
    check(given, "RGB+ED", 2)


def test_gradients_by_finite_differences() -> None:
    given = scene(8, degree=1, count=6)
    # broad and thin: the jumps at alpha = 1/255 and at the end of a pixel lie elsewhere
    given["scales"][:] = torch.tensor([4.0, 2.5, 1.5])
    given["opacities"] *= 0.5
    leaves = {n: t.clone().requires_grad_(n in DIFFERENTIABLE) for n, t in given.items()}
    g = torch.Generator().manual_seed(3)
    upstream = torch.randn(2, HEIGHT, WIDTH, 4, generator=g)

    def loss(tensors: Tensors) -> Tensor:
        images, _, _ = rasterization(
            **tensors, width=WIDTH, height=HEIGHT, sh_degree=1, render_mode="RGB+D"
        )
        return (images.double() * upstream).sum()

    loss(leaves).backward()
    for name in DIFFERENTIABLE:
        direction = torch.randn(given[name].shape, generator=g)
        if name == "viewmats":
            direction[:, 3] = 0
        direction *= 1e-2 / float(direction.norm())
        ends = [loss({**given, name: given[name] + sign * direction}) for sign in (1, -1)]
        grad = leaves[name].grad
        assert grad is not None
        numeric, analytic = float(ends[0] - ends[1]) / 2, float((grad * direction).sum())
        assert abs(numeric - analytic) < 0.02 * float(grad.norm() * direction.norm()), name


def test_batches_of_scenes_are_their_scenes_one_by_one() -> None:
    scenes = [scene(s, degree=1) for s in range(3)]
    together = {n: torch.stack([s[n] for s in scenes]).requires_grad_(n != "Ks") for n in scenes[0]}
    settings: dict[str, Any] = {"width": WIDTH, "height": HEIGHT, "sh_degree": 1, "packed": False}
    images, alphas, meta = rasterization(**together, **settings)
    assert images.shape == (3, 2, HEIGHT, WIDTH, 3)
    assert alphas.shape == (3, 2, HEIGHT, WIDTH, 1)
    assert meta["means2d"].shape == (3, 2, 30, 2)
    assert (meta["n_batches"], meta["n_cameras"]) == (3, 2)
    images.square().sum().backward()
    for index, one in enumerate(scenes):
        alone = {n: t.clone().requires_grad_(n != "Ks") for n, t in one.items()}
        image, _, _ = rasterization(**alone, **settings)
        assert torch.equal(image, images[index])
        image.square().sum().backward()
        for name in DIFFERENTIABLE:
            grad, of_one = together[name].grad, alone[name].grad
            assert grad is not None
            assert of_one is not None
            torch.testing.assert_close(grad[index], of_one, rtol=1e-6, atol=1e-6)
