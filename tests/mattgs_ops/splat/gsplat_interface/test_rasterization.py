"""gsplat's interface against the slow float64 reference: values, gradients, meta."""

import gc
import re
import runpy
import weakref
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from mattgs_ops.splat import rasterization
from tests.reference import splatting

WIDTH, HEIGHT = 40, 30
VALUE_TOLERANCE = 1e-4
# of a gradient's norm: float32 sums of some hundred pixels and splats
GRADIENT_TOLERANCE = 1e-3
MODES = ("RGB", "D", "ED", "RGB+D", "RGB+ED")
GSPLAT = {"alpha_max": 0.999, "near": 0.01}  # gsplat 1.5.3
SH_0 = 0.28209479177387814
DIFFERENTIABLE = ("means", "quats", "scales", "opacities", "colors", "viewmats", "backgrounds")
DOCUMENT = Path(__file__).resolve().parents[4] / "docs" / "engine.md"

Tensors = dict[str, Tensor]


def scene(seed: int, *, degree: int | None = None, channels: int = 3, count: int = 30) -> Tensors:
    """Return splats before two cameras, one of them turned."""
    g = torch.Generator().manual_seed(seed)
    viewmats = torch.eye(4).repeat(2, 1, 1)
    cosine, sine = torch.cos(torch.tensor(0.25)), torch.sin(torch.tensor(0.25))
    viewmats[1, 0, 0] = viewmats[1, 2, 2] = cosine
    viewmats[1, 0, 2], viewmats[1, 2, 0] = sine, -sine
    viewmats[1, :3, 3] = torch.tensor([-0.8, 0.2, 0.5])
    shape = (count, channels) if degree is None else (count, (degree + 1) ** 2, 3)
    # the last splat lies behind both cameras
    means = torch.randn(count, 3, generator=g) + torch.tensor([0.0, 0.0, 4.0])
    means[-1, 2] = -3.0
    return {
        "means": means,
        "quats": torch.randn(count, 4, generator=g),
        "scales": 0.05 + 0.4 * torch.rand(count, 3, generator=g),
        "opacities": 0.05 + 0.94 * torch.rand(count, generator=g),
        "colors": torch.rand(shape, generator=g) - (0.0 if degree is None else 0.4),
        "viewmats": viewmats,
        "Ks": torch.tensor([[40.0, 0, 19], [0, 44, 16], [0, 0, 1]]).repeat(2, 1, 1),
        "backgrounds": torch.rand(2, channels if degree is None else 3, generator=g),
    }


def reference(
    given: Tensors, mode: str, degree: int | None, camera: int, **limits: float
) -> tuple[Tensor, Tensor, splatting.Reference]:
    """Return image [H, W, X] and alpha [H, W, 1] of one camera, in float64."""
    view, k = given["viewmats"][camera], given["Ks"][camera]
    place: Any = SimpleNamespace(
        rotation=view[:3, :3],
        translation=view[:3, 3],
        centre=torch.linalg.inv(view)[:3, 3],
        intrinsics=SimpleNamespace(
            width=WIDTH,
            height=HEIGHT,
            fx=float(k[0, 0]),
            fy=float(k[1, 1]),
            cx=float(k[0, 2]),
            cy=float(k[1, 2]),
        ),
    )
    colors = given["colors"] if given["colors"].dim() < 3 + (degree is not None) else None
    colors = given["colors"][camera] if colors is None else colors
    sh = colors if degree is not None else (colors.new_zeros(len(colors), 1, 3))
    splats = {
        "means": given["means"],
        "quaternions": given["quats"],
        "log_scales": given["scales"].log(),
        # neither 0 nor 1, whose logit is infinite
        "opacity_logits": torch.logit(given["opacities"] * (1 - 2e-12) + 1e-12),
        "sh_dc": sh[:, 0],
        "sh_rest": sh[:, 1:],
    }
    drawn = splatting.render(
        splats, place, (0, 0, 0), degree or 0, splatting.Limits(**{**GSPLAT, **limits})
    )
    shown = drawn.image
    if degree is None:
        shown = torch.einsum("nhw,nd->hwd", drawn.weights, colors)
    alpha = drawn.alpha[..., None]
    shown = shown + given["backgrounds"][camera] * (1 - alpha)
    depth = given["means"] @ view[2, :3] + view[2, 3]
    z = torch.einsum("nhw,n->hw", drawn.weights, depth)[..., None]
    if mode.endswith("ED"):
        z = z / alpha.clamp(min=1e-10)
    if mode in ("D", "ED"):
        return z, alpha, drawn
    return (shown if mode == "RGB" else torch.cat([shown, z], dim=-1)), alpha, drawn


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


@pytest.mark.parametrize("packed", [True, False])
def test_meta_is_gsplats(packed: bool) -> None:
    given = scene(9)
    given["means"].requires_grad_()
    images, _, meta = rasterization(
        **given, width=WIDTH, height=HEIGHT, packed=packed, absgrad=True
    )
    meta["means2d"].retain_grad()
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
        node = node.next_functions[0][0]  # type: ignore[union-attr]
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
    first = given["means"].grad.clone()  # type: ignore[union-attr]
    images.sum().backward(retain_graph=True)
    torch.testing.assert_close(given["means"].grad, 2 * first)
    with torch.no_grad():
        given["means"] += 1
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        images.sum().backward()


def test_the_documents_example_learns_an_image(tmp_path: Path) -> None:
    code = re.search(r"```python\n(import torch\n.*?)```", DOCUMENT.read_text("utf-8"), re.DOTALL)
    assert code is not None
    assert len(code[1].strip().splitlines()) <= 27
    example = tmp_path / "example.py"
    example.write_text(code[1], "utf-8")
    torch.manual_seed(0)
    losses = runpy.run_path(str(example))["losses"]
    assert losses[-1] < 0.1 * losses[0]
