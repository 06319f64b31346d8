"""What gsplat's interface refuses, by name."""

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.autograd import forward_ad

from mattgs_ops.errors import InputError
from mattgs_ops.splat import rasterization
from mattgs_ops.splat.gsplat_interface.arguments import REFUSED


def arguments(**changed: Any) -> dict[str, Any]:
    """Return five splats before one camera, with some arguments replaced."""
    given = {
        "means": torch.rand(5, 3) + torch.tensor([0.0, 0.0, 2.0]),
        "quats": torch.rand(5, 4),
        "scales": torch.rand(5, 3),
        "opacities": torch.rand(5),
        "colors": torch.rand(5, 3),
        "viewmats": torch.eye(4)[None],
        "Ks": torch.tensor([[[20.0, 0, 10], [0, 20, 8], [0, 0, 1]]]),
        "width": 20,
        "height": 16,
    }
    return {**given, **changed}


SKEWED = torch.tensor([[[20.0, 1, 10], [0, 20, 8], [0, 0, 1]]])
FLAT = torch.tensor([[[0.0, 0, 10], [0, 20, 8], [0, 0, 1]]])
SINGULAR = torch.diag(torch.tensor([1.0, 1, 0, 1]))[None]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"means": torch.rand(5, 2)}, r"means: expected shape \(5, 3\), found \(5, 2\)"),
        ({"means": torch.rand(3)}, r"means: expected shape \[..., N, 3\], found \(3,\)"),
        ({"means": torch.rand(5, 3).double()}, "means: expected float32 on the CPU, found .*64"),
        ({"means": [[0.0, 0, 1]]}, "means: expected a tensor, found list"),
        ({"means": torch.rand(5, 3).to_sparse()}, "means: expected a dense tensor, found .*coo"),
        ({"quats": torch.rand(5, 3)}, r"quats: expected shape \(5, 4\), found \(5, 3\)"),
        ({"scales": torch.rand(4, 3)}, r"scales: expected shape \(5, 3\), found \(4, 3\)"),
        ({"opacities": torch.rand(5, 1)}, r"opacities: expected shape \(5,\)"),
        ({"opacities": torch.rand(5) + 1}, r"opacities: expected 0 to 1, found 1\."),
        ({"opacities": torch.rand(5) - 2}, "opacities: expected 0 to 1, found -"),
        ({"colors": torch.rand(4, 3)}, r"colors: expected shape \(5, D\) or \(1, 5, D\), found"),
        ({"colors": torch.rand(5, 4, 3)}, r"colors: expected shape \(5, D\)"),
        ({"colors": torch.rand(5, 3), "sh_degree": 1}, r"colors: expected shape \(5, K, 3\)"),
        ({"colors": torch.rand(5, 3, 3), "sh_degree": 1}, "K of 4 or more for sh_degree 1"),
        ({"colors": torch.rand(5, 25, 3), "sh_degree": 4}, "sh_degree: expected None or 0 to 3"),
        ({"colors": torch.rand(5, 9, 3), "sh_degree": 2.0}, "sh_degree: .* 0 to 3, found 2.0"),
        ({"colors": torch.rand(5, 9, 3), "sh_degree": "1"}, "sh_degree: .* 0 to 3, found '1'"),
        ({"colors": torch.rand(5, 9, 3), "sh_degree": True}, "sh_degree: .*, found True"),
        ({"viewmats": torch.eye(4)}, r"viewmats: expected shape \[..., C, 4, 4\]"),
        ({"viewmats": torch.rand(2, 4, 4)}, r"Ks: expected shape \(2, 3, 3\)"),
        ({"viewmats": SINGULAR}, "viewmats: .*singular"),
        ({"viewmats": torch.ones(1, 4, 4)}, "viewmats: .*last row"),
        ({"viewmats": torch.full((1, 4, 4), torch.nan)}, "viewmats, Ks: expected finite"),
        ({"Ks": SKEWED}, "Ks: expected no skew"),
        ({"Ks": FLAT}, "Ks: expected positive focal lengths, found 0"),
        ({"Ks": FLAT.clone().requires_grad_()}, "Ks: .*requires_grad"),
        ({"backgrounds": torch.rand(3)}, r"backgrounds: expected shape \(1, 3\), found \(3,\)"),
        ({"width": 0}, "width: expected 1 to"),
        ({"height": 16.0}, "height: expected an int"),
        ({"near_plane": 0.0}, "near_plane: expected a number between 0 and"),
        ({"far_plane": 0.001}, "near_plane: .*0.001"),
        ({"near_plane": None}, "near_plane: expected a number, found None"),
        ({"far_plane": "1"}, "far_plane: expected a number, found '1'"),
        ({"eps2d": -0.1}, "eps2d: expected"),
        ({"eps2d": None}, "eps2d: expected a number, found None"),
        ({"eps2d": "0.3"}, "eps2d: expected a number, found '0.3'"),
        ({"radius_clip": torch.zeros(2)}, r"radius_clip: expected a number, found a tensor \[2\]"),
        ({"radius_clip": float("nan")}, "radius_clip: expected"),
        ({"render_mode": "depth"}, "render_mode: expected one of RGB, D"),
        ({"threads": 0}, "threads: expected a whole number, 1 to"),
        ({"threads": 1.5}, "threads: expected a whole number, 1 to"),
        ({"threads": True}, "threads: expected a whole number, 1 to .* found True"),
        ({"radial_coeffs": np.zeros((1, 6))}, r"radial_coeffs: .*found a tensor \[1, 6\]"),
        ({"covars": torch.zeros(9, 3, 3)}, r"covars: expected None .*found a tensor \[9, 3, 3\]"),
        ({"colors": torch.rand(5, 6), "absgrad": True}, "absgrad: expected at most 4 channels"),
    ],
)
def test_what_cannot_be_rendered_is_named(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        rasterization(**arguments(**changed))


@pytest.mark.parametrize("name", sorted(REFUSED))
def test_what_gsplat_has_and_this_engine_has_not_is_named(name: str) -> None:
    with pytest.raises(InputError, match=rf"{name}: expected .*found 'another'"):
        rasterization(**arguments(**{name: "another"}))


@pytest.mark.parametrize("value", [0.02, np.float32(0.02), torch.tensor(0.02)])
def test_a_number_may_be_any_real_one(value: Any) -> None:
    given = arguments()
    expected, found = (
        rasterization(**given, near_plane=n, eps2d=n, radius_clip=n)[0] for n in (0.02, value)
    )
    torch.testing.assert_close(found, expected)


TRANSFORMS: dict[str, Callable[[Callable[[Tensor], Tensor], Tensor], object]] = {
    "vmap": lambda draw, means: torch.func.vmap(draw)(means[None]),
    "grad": lambda draw, means: torch.func.grad(draw)(means),
    "jvp": lambda draw, means: torch.func.jvp(draw, (means,), (means,)),
    "forward": lambda draw, means: draw(forward_ad.make_dual(means, means)),
}


# torch's own forward mode scripts its decompositions when it is first used
@pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
@pytest.mark.parametrize("kind", sorted(TRANSFORMS))
def test_what_is_not_differentiated_backwards_is_named(kind: str) -> None:
    given = arguments()

    def draw(means: Tensor) -> Tensor:
        return rasterization(**{**given, "means": means})[0].sum()

    with (
        forward_ad.dual_level() if kind == "forward" else nullcontext(),
        pytest.raises(InputError, match=r"means: expected a plain tensor"),
    ):
        TRANSFORMS[kind](draw, given["means"])


@pytest.mark.parametrize("name", ["means", "quats", "scales", "opacities", "colors"])
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_nan_and_infinity_are_named(name: str, value: float) -> None:
    given = arguments()
    given[name][3] = value
    with pytest.raises(InputError, match=f"{name}: expected"):
        rasterization(**given)


@pytest.mark.parametrize("channel", range(8))
def test_nan_is_named_in_any_channel(channel: int) -> None:
    colors = torch.rand(5, 8)
    colors[3, channel] = float("nan")
    with pytest.raises(InputError, match="colors: expected"):
        rasterization(**arguments(colors=colors))


def test_the_package_has_no_other_public_function() -> None:
    import mattgs_ops.splat

    with pytest.raises(AttributeError, match="rasterisation"):
        _ = mattgs_ops.splat.rasterisation
