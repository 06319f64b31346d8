"""The container of parameters."""

import pytest
import torch

from mattgs_ops.errors import InputError
from mattgs_ops.splat.gaussians import FLOATS_PER_SPLAT, SHAPES, Splats


def test_zeros_have_the_documented_shapes() -> None:
    splats = Splats.zeros(5)
    splats.check()
    assert len(splats) == 5
    assert [name for name, _ in splats.items()] == list(SHAPES)
    assert sum(tensor.numel() for _, tensor in splats.items()) == 5 * FLOATS_PER_SPLAT


def test_a_wrong_field_is_named() -> None:
    splats = Splats.zeros(5)
    splats.sh_rest = torch.zeros(5, 8, 3)
    with pytest.raises(InputError, match=r"splats.sh_rest: expected shape \(5, 15, 3\)"):
        splats.check()
