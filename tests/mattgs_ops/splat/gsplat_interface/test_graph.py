"""What comes with the images: gsplat's dictionary, and a graph that behaves as torch's do."""

import gc
import inspect
import re
import runpy
import weakref
from functools import partial
from pathlib import Path

import pytest
import torch

from mattgs_ops.splat import rasterization
from tests.mattgs_ops.splat.gsplat_interface.conftest import (
    DIFFERENTIABLE,
    HEIGHT,
    WIDTH,
    reference,
    scene,
)

DOCUMENT = Path(__file__).resolve().parents[4] / "docs" / "engine.md"


@pytest.mark.parametrize("packed", [True, False])
def test_meta_is_gsplats(packed: bool) -> None:
    given = scene(9)
    given["means"].requires_grad_()
    images, _, meta = rasterization(
        **given, width=WIDTH, height=HEIGHT, packed=packed, absgrad=True
    )
    images.square().sum().backward()
    slow = {n: t.detach().double().requires_grad_(n == "means") for n, t in given.items()}
    for camera in range(2):
        image, _, drawn = reference(slow, "RGB", None, camera)
        image.square().sum().backward()
        shift = drawn.shift.grad
        assert shift is not None
        rows = (
            meta["gaussian_ids"][meta["camera_ids"] == camera] if packed else torch.arange(30)
        ).tolist()
        chosen = meta["camera_ids"] == camera if packed else camera
        for name, expected in (("grad", shift.sum((1, 2))), ("absgrad", shift.abs().sum((1, 2)))):
            found = getattr(meta["means2d"], name)[chosen].double()
            torch.testing.assert_close(
                found, expected[rows], rtol=1e-3, atol=1e-4 * float(expected.abs().max())
            )
        radii = meta["radii"][chosen]
        assert radii.dtype == torch.int32
        if packed:
            hidden = sorted(set(range(30)) - set(rows))
        else:
            hidden = torch.where(radii[:, 0] == 0)[0].tolist()
        assert 29 in hidden  # behind the camera
        assert not drawn.visible[hidden].any()
        torch.testing.assert_close(
            meta["opacities"][chosen], given["opacities"][rows], rtol=0, atol=0
        )


def test_small_radii_are_clipped() -> None:
    given = scene(10)
    given["scales"][:10] = 1e-3
    _, _, meta = rasterization(**given, width=WIDTH, height=HEIGHT, packed=False, radius_clip=3.0)
    _, _, whole = rasterization(**given, width=WIDTH, height=HEIGHT, packed=False)
    assert bool((whole["radii"][:, :10] > 0).any())
    assert not bool((meta["radii"][:, :10] > 0).any())
    larger = (whole["radii"] > 3).any(-1)
    assert torch.equal(meta["radii"][larger], whole["radii"][larger])


def test_the_same_bits_for_any_number_of_threads() -> None:
    found = []
    for threads in (1, 3):
        given = {n: t.requires_grad_(n != "Ks") for n, t in scene(11, degree=2, count=300).items()}
        images, _, _ = rasterization(
            **given, width=90, height=70, sh_degree=2, render_mode="RGB+D", threads=threads
        )
        images.square().sum().backward()
        found.append([images.detach(), *(given[n].grad for n in DIFFERENTIABLE)])
    for one, other in zip(*found, strict=True):
        assert one is not None
        assert other is not None
        assert torch.equal(one, other)


def test_a_graph_is_freed_with_its_images() -> None:
    given = scene(12)
    given["means"].requires_grad_()
    images, alphas, meta = rasterization(**given, width=WIDTH, height=HEIGHT)
    node = images.grad_fn
    while not hasattr(node, "drawing"):
        node = node.next_functions[0][0]
    drawing = weakref.ref(node.drawing)
    del node
    assert drawing() is not None
    gc.disable()
    try:
        del images, alphas, meta
        assert drawing() is None  # by counting references alone: no cycle holds the engine's memory
    finally:
        gc.enable()


def test_the_graph_can_be_used_twice_and_changes_in_place_are_noticed() -> None:
    given = scene(13)
    given["means"].requires_grad_()
    images, _, _ = rasterization(**given, width=WIDTH, height=HEIGHT)
    images.sum().backward(retain_graph=True)
    assert given["means"].grad is not None
    first = given["means"].grad.clone()
    images.sum().backward(retain_graph=True)
    torch.testing.assert_close(given["means"].grad, 2 * first)
    with torch.no_grad():
        given["means"] += 1
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        images.sum().backward()


@pytest.mark.parametrize("linear", [True, False])
@pytest.mark.parametrize("accumulate", [True, False])
def test_second_derivatives_are_refused(linear: bool, accumulate: bool) -> None:
    """Centres and depths are torch's: a way around the engine would give wrong numbers."""
    given = scene(14)
    given["means"].requires_grad_()
    images, _, _ = rasterization(**given, width=WIDTH, height=HEIGHT)
    loss = images.sum() if linear else images.square().sum()
    (grad,) = torch.autograd.grad(loss, given["means"], create_graph=True)
    again = grad.square().sum()
    differentiate = again.backward if accumulate else partial(torch.autograd.grad, again)
    arguments = () if accumulate else (given["means"],)
    with pytest.raises(RuntimeError, match="second derivatives are not supported"):
        differentiate(*arguments)


def test_centres_retain_a_gradient_though_means_are_frozen() -> None:
    given = scene(15)
    given["scales"].requires_grad_()
    images, _, meta = rasterization(**given, width=WIDTH, height=HEIGHT)
    meta["means2d"].retain_grad()  # as gsplat's strategies do
    images.square().sum().backward()
    assert meta["means2d"].grad is not None
    assert bool(meta["means2d"].grad.any())


# torch's own tracer asks tensors between two graphs for their gradient
@pytest.mark.filterwarnings("ignore:The .grad attribute of a Tensor that is not a leaf:UserWarning")
@pytest.mark.parametrize("frozen", [True, False])
def test_torch_compile_leaves_it_as_it_is(frozen: bool) -> None:
    def loss(means: torch.Tensor) -> torch.Tensor:
        given = {**ready, "means": 2 * means}
        images, alphas, _ = rasterization(**given, width=WIDTH, height=HEIGHT)
        return images.square().sum() + alphas.sin().sum()

    ready = scene(17)
    found = []
    # the eager backend needs no C++ compiler
    for function in (loss, torch.compile(loss, backend="eager")):
        means = (0.5 * ready["means"]).requires_grad_(not frozen)
        value = function(means)
        found.append([value.detach()])
        if not frozen:
            found[-1] += torch.autograd.grad(value, means)
    for one, other in zip(*found, strict=True):
        assert torch.equal(one, other)


def test_it_keeps_its_name_signature_and_documentation() -> None:
    assert rasterization.__name__ == "rasterization"
    assert next(iter(inspect.signature(rasterization).parameters)) == "means"
    assert "Render N splats as C cameras see them" in (rasterization.__doc__ or "")


@pytest.mark.parametrize("degree", [None, 1])
def test_nothing_depends_on_torchs_defaults(degree: int | None) -> None:
    def drawn(dtype: torch.dtype | None = None) -> list[torch.Tensor]:
        given = {name: t.clone() for name, t in ready.items()}
        given["means"].requires_grad_()
        given["viewmats"].requires_grad_()
        size = {"width": WIDTH, "height": HEIGHT}
        with torch.autocast("cpu", dtype=dtype, enabled=dtype is not None):
            images, _, meta = rasterization(**given, **size, render_mode="RGB+ED", sh_degree=degree)
        images.square().sum().backward()
        assert given["means"].grad is not None
        assert given["viewmats"].grad is not None
        grads = [given["means"].grad, given["viewmats"].grad]
        return [images.detach(), meta["means2d"].detach(), *grads]

    ready = scene(16, degree=degree)
    expected = drawn()
    before = torch.get_default_dtype()
    torch.set_default_dtype(torch.float64)
    try:
        wide = drawn()
    finally:
        torch.set_default_dtype(before)
    with torch.device("meta"):
        elsewhere = drawn()
    for found in (wide, elsewhere, drawn(torch.bfloat16)):
        assert all(torch.equal(*pair) for pair in zip(found, expected, strict=True))


def test_the_documents_example_learns_an_image(tmp_path: Path) -> None:
    code = re.search(r"```python\n(import torch\n.*?)```", DOCUMENT.read_text("utf-8"), re.DOTALL)
    assert code is not None
    assert len(code[1].strip().splitlines()) <= 27
    example = tmp_path / "example.py"
    example.write_text(code[1], "utf-8")
    torch.manual_seed(0)
    losses = runpy.run_path(str(example))["losses"]
    assert losses[-1] < 0.1 * losses[0]
