"""The compiled engine against the slow float64 reference, and its manners with bad input."""

from dataclasses import fields, replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.errors import InputError
from mattgs_ops.splat import _engine
from mattgs_ops.splat.gaussians import SHAPES, Splats
from mattgs_ops.splat.rasterize import Gradients, Rendering, backward, render
from tests.reference import splatting
from tests.reference.scenes import AWKWARD, awkward, camera, random_splats

BACKGROUND = (0.9, 0.4, 0.2)
FORWARD_TOLERANCE = 1e-4
# of each number, plus a hundred-thousandth of the largest: what float32 leaves where terms cancel
GRADIENT_TOLERANCE, GRADIENT_FLOOR = 1e-3, 1e-5


def upstream(view: Camera) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Gradients of image and alpha, and a pixel map."""
    i = view.intrinsics
    g = torch.Generator().manual_seed(1)
    return (
        torch.randn(i.height, i.width, 3, generator=g),
        torch.randn(i.height, i.width, generator=g),
        torch.rand(i.height, i.width, generator=g),
    )


def run(
    splats: Splats, view: Camera, degree: int = 3, threads: int = 1
) -> tuple[Rendering, Gradients]:
    rendering = render(splats, view, BACKGROUND, sh_degree=degree, threads=threads)
    grad_image, grad_alpha, pixel_map = upstream(view)
    return rendering, backward(rendering, grad_image, grad_alpha, pixel_map=pixel_map)


def assert_close(name: str, found: torch.Tensor, expected: torch.Tensor | None) -> None:
    expected = torch.zeros_like(found).double() if expected is None else expected
    floor = GRADIENT_FLOOR * float(expected.abs().max()) + 1e-9 if expected.numel() else 0
    torch.testing.assert_close(
        found.double(),
        expected,
        rtol=GRADIENT_TOLERANCE,
        atol=floor,
        msg=lambda text: f"{name}: {text}",
    )


def check_against_reference(splats: Splats, view: Camera, degree: int) -> None:
    slow = {name: value.double().requires_grad_() for name, value in splats.items()}
    reference = splatting.render(slow, view, BACKGROUND, degree)
    rendering, grads = run(splats, view, degree)
    for found, expected in ((rendering.image, reference.image), (rendering.alpha, reference.alpha)):
        torch.testing.assert_close(
            found.double(), expected.detach(), rtol=0, atol=FORWARD_TOLERANCE
        )
    assert bool((rendering.radii[reference.visible] > 0).all())

    grad_image, grad_alpha, pixel_map = upstream(view)
    loss = (reference.image * grad_image).sum() + (reference.alpha * grad_alpha).sum()
    if loss.requires_grad:
        loss.backward()
    for name, value in slow.items():
        assert_close(name, getattr(grads, name), value.grad)
    weights, shift = reference.weights.detach(), reference.shift.grad
    if shift is None:
        shift = torch.zeros_like(reference.shift)
    assert_close("means2d", grads.observed.means2d, shift.sum((1, 2)))
    assert_close("means2d_abs", grads.observed.means2d_abs, shift.abs().sum((1, 2)))
    assert_close("weight", grads.observed.weight, weights.sum((1, 2)).double())
    assert_close(
        "weighted_map", grads.observed.weighted_map, (weights * pixel_map).sum((1, 2)).double()
    )


@pytest.mark.parametrize("degree", range(4))
def test_random_scenes_match_the_reference(degree: int) -> None:
    check_against_reference(random_splats(seed=degree), camera(seed=degree), degree)


@pytest.mark.parametrize("name", AWKWARD)
def test_awkward_scenes_match_the_reference(name: str) -> None:
    check_against_reference(*awkward(name), degree=3)


@pytest.mark.parametrize("name", ["baseline", "avx2", "avx512"])
def test_every_instruction_set_of_this_machine_matches_the_reference(name: str) -> None:
    best = _engine.instruction_set()
    if not _engine.use_instruction_set(name):
        pytest.skip(f"this machine has no {name}")
    try:
        assert _engine.instruction_set() == name
        check_against_reference(random_splats(seed=8), camera(seed=8), 3)
        check_against_reference(*awkward("needle-thin"), 3)
    finally:
        _engine.use_instruction_set(best)


def test_finite_differences() -> None:
    # broad splats: the jump at alpha = 1/255 lies outside the image
    splats, view = random_splats(6, seed=2), camera(24, 20)
    splats.log_scales[:] = torch.tensor([1.0, 0.7, 0.4])
    grad_image, grad_alpha, _ = upstream(view)
    grads = backward(render(splats, view, BACKGROUND), grad_image, grad_alpha)

    def loss(changed: Splats) -> float:
        r = render(changed, view, BACKGROUND)
        return float((r.image * grad_image).double().sum() + (r.alpha * grad_alpha).double().sum())

    g = torch.Generator().manual_seed(4)
    for name, value in splats.items():
        direction = torch.randn(value.shape, generator=g)
        step = 2e-3 / float(direction.norm())
        ends = [
            loss(replace(splats, **{name: value + sign * step * direction})) for sign in (1, -1)
        ]
        numeric = (ends[0] - ends[1]) / (2 * step)
        analytic = float((getattr(grads, name) * direction).sum())
        scale = float(getattr(grads, name).norm() * direction.norm())
        assert abs(numeric - analytic) < 0.02 * scale, name


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_the_same_bits_for_any_number_of_threads_and_from_run_to_run(threads: int) -> None:
    splats, view = random_splats(700, seed=9), camera(150, 100)
    expected_image, expected = run(splats, view)
    for _ in range(2):
        rendering, grads = run(splats, view, threads=threads)
        assert torch.equal(rendering.image, expected_image.image)
        assert torch.equal(rendering.radii, expected_image.radii)
        for name, tensor in grads.tensors().items():
            assert torch.equal(tensor, expected.tensors()[name]), name


def test_without_statistics_the_gradients_are_the_same() -> None:
    splats, view = random_splats(seed=4), camera()
    _, expected = run(splats, view)
    grad_image, grad_alpha, _ = upstream(view)
    grads = backward(render(splats, view, BACKGROUND), grad_image, grad_alpha, statistics=False)
    for name in SHAPES:
        assert torch.equal(getattr(grads, name), getattr(expected, name))
    assert torch.equal(grads.observed.means2d, expected.observed.means2d)
    assert (
        len(grads.observed.means2d_abs)
        == len(grads.observed.weight)
        == len(grads.observed.weighted_map)
        == 0
    )


def test_two_renderings_at_a_time_keep_apart() -> None:
    view = camera()
    first, second = random_splats(seed=1), random_splats(60, seed=2)
    grad_image, grad_alpha, pixel_map = upstream(view)
    _, expected = run(first, view)
    a = render(first, view, BACKGROUND)
    render(second, view, BACKGROUND)
    grads = backward(a, grad_image, grad_alpha, pixel_map=pixel_map)
    assert torch.equal(grads.means, expected.means)


def test_memory_is_reused_from_call_to_call() -> None:
    splats, view = random_splats(300, seed=9), camera(100, 100)
    run(splats, view)
    sizes = set()
    for _ in range(6):
        rendering, _ = run(splats, view)
        sizes.add(rendering.workspace_bytes)
        del rendering
    assert len(sizes) == 1


def test_evaluated_pairs_cover_what_is_drawn_and_little_more() -> None:
    splats, view = random_splats(seed=3), camera()
    slow = {name: value.double() for name, value in splats.items()}
    drawn = int((splatting.render(slow, view, BACKGROUND).weights > 0).sum())
    rendering = render(splats, view, BACKGROUND)
    assert drawn <= rendering.evaluated_pairs < 3 * drawn
    assert rendering.tile_pairs >= int((rendering.radii > 0).sum())


@pytest.mark.parametrize("name", [field.name for field in fields(Splats)])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_nan_and_infinity_are_named(name: str, value: float) -> None:
    splats = random_splats()
    getattr(splats, name)[7] = value
    with pytest.raises(InputError, match=rf"splats\.{name}: .* NaN or infinity in 1 of 40 rows.*7"):
        render(splats, camera(), BACKGROUND)


def test_colours_that_overflow_are_an_error() -> None:
    splats = random_splats()
    splats.sh_rest[:] = 3e38
    with pytest.raises(InputError, match="overflow"):
        render(splats, camera(), BACKGROUND)


@pytest.mark.parametrize("field", [field.name for field in fields(Splats)])
def test_wrong_shapes_and_types_are_named(field: str) -> None:
    splats = random_splats()
    value = getattr(splats, field)
    for wrong in (value[:-1], value.double(), value[..., None], value.repeat_interleave(2, 0)[::2]):
        if field == "means" and len(wrong) == 39:
            message = r"splats\.log_scales"
        else:
            message = rf"splats\.{field}: expected"
        with pytest.raises(InputError, match=message):
            render(replace(splats, **{field: wrong}), camera(), BACKGROUND)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width": 0}, "width"),
        ({"height": -3}, "height"),
        ({"width": 1 << 20}, "width"),
        ({"fx": 0.0}, "fx"),
        ({"fy": float("nan")}, "fy"),
        ({"cx": float("inf")}, "finite"),
    ],
)
def test_cameras_without_an_image_are_refused(change: dict[str, float], message: str) -> None:
    view = camera()
    intrinsics = Intrinsics(**{**vars(view.intrinsics), **change})
    with pytest.raises(InputError, match=message):
        render(random_splats(), replace(view, intrinsics=intrinsics), BACKGROUND)


def test_other_arguments_are_checked() -> None:
    splats, view = random_splats(), camera()
    with pytest.raises(InputError, match="sh_degree"):
        render(splats, view, BACKGROUND, sh_degree=4)
    with pytest.raises(InputError, match="threads"):
        render(splats, view, BACKGROUND, threads=0)
    with pytest.raises(InputError, match="background"):
        render(splats, view, (1.0, float("nan"), 0.0))
    with pytest.raises(InputError, match="finite pose"):
        render(splats, replace(view, rotation=np.full((3, 3), np.nan)), BACKGROUND)
    rendering = render(splats, view, BACKGROUND)
    grad_image, grad_alpha, pixel_map = upstream(view)
    with pytest.raises(InputError, match="grad_image"):
        backward(rendering, grad_image[:-1])
    with pytest.raises(InputError, match="grad_alpha"):
        backward(rendering, grad_image, grad_alpha.double())
    with pytest.raises(InputError, match="pixel_map"):
        backward(rendering, grad_image, pixel_map=pixel_map.T)
    rendering.splats = random_splats(41)
    with pytest.raises(InputError, match="that were rendered"):
        backward(rendering, grad_image)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    count=st.integers(0, 70),
    width=st.integers(1, 90),
    height=st.integers(1, 90),
    log_scale=st.floats(-30, 30),
    spread=st.floats(0, 1e4),
    logit=st.floats(-50, 50),
    threads=st.integers(1, 3),
    seed=st.integers(0, 1000),
)
def test_any_size_and_any_finite_parameters_give_finite_results(
    count: int,
    width: int,
    height: int,
    log_scale: float,
    spread: float,
    logit: float,
    threads: int,
    seed: int,
) -> None:
    splats = random_splats(count, seed=seed, spread=spread)
    splats.log_scales += log_scale
    splats.opacity_logits += logit
    rendering, grads = run(splats, camera(width, height, seed=seed), threads=threads)
    assert bool(torch.isfinite(rendering.image).all())
    assert bool(((rendering.alpha >= 0) & (rendering.alpha <= 1)).all())
    for name, tensor in grads.tensors().items():
        assert bool(torch.isfinite(tensor).all()), name
