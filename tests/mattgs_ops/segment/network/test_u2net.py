"""The architecture against the layer list of the public release, written down stage by stage."""

from pathlib import Path

import pytest
import torch

from mattgs_ops.errors import InputError
from mattgs_ops.segment.network.u2net import U2Net, Variant, load_weights

# (stage, convolutions down, channels in, inside, out): RSU-7 has 7 convolutions on its way down
FULL = [
    ("stage1", 7, 3, 32, 64),
    ("stage2", 6, 64, 32, 128),
    ("stage3", 5, 128, 64, 256),
    ("stage4", 4, 256, 128, 512),
    ("stage5", 4, 512, 256, 512),
    ("stage6", 4, 512, 256, 512),
    ("stage5d", 4, 1024, 256, 512),
    ("stage4d", 4, 1024, 128, 256),
    ("stage3d", 5, 512, 64, 128),
    ("stage2d", 6, 256, 32, 64),
    ("stage1d", 7, 128, 16, 64),
]
SMALL = [(name, down, 64, 16, 64) for name, down, *_ in FULL]
SMALL = [
    (n, d, 3 if n == "stage1" else 128 if n.endswith("d") else i, m, o) for n, d, i, m, o in SMALL
]
SIDES: dict[Variant, list[int]] = {"u2net": [64, 64, 128, 256, 512, 512], "u2netp": [64] * 6}


def published_layers(variant: Variant) -> dict[str, tuple[int, ...]]:
    layers: dict[str, tuple[int, ...]] = {}

    def unit(name: str, channels_in: int, channels_out: int) -> None:
        layers[f"{name}.conv_s1.weight"] = (channels_out, channels_in, 3, 3)
        layers[f"{name}.conv_s1.bias"] = (channels_out,)
        for part in ("weight", "bias", "running_mean", "running_var"):
            layers[f"{name}.bn_s1.{part}"] = (channels_out,)
        layers[f"{name}.bn_s1.num_batches_tracked"] = ()

    for stage, down, channels_in, inside, out in FULL if variant == "u2net" else SMALL:
        unit(f"{stage}.rebnconvin", channels_in, out)
        for i in range(1, down + 1):
            unit(f"{stage}.rebnconv{i}", out if i == 1 else inside, inside)
        for i in range(1, down):
            unit(f"{stage}.rebnconv{i}d", 2 * inside, out if i == 1 else inside)
    for i, channels in enumerate(SIDES[variant], start=1):
        layers[f"side{i}.weight"], layers[f"side{i}.bias"] = (1, channels, 3, 3), (1,)
    layers["outconv.weight"], layers["outconv.bias"] = (1, 6, 1, 1), (1,)
    return layers


@pytest.fixture(scope="module")
def small() -> U2Net:
    torch.manual_seed(0)
    return U2Net("u2netp").eval()


@pytest.mark.parametrize(("variant", "count"), [("u2net", 44_009_869), ("u2netp", 1_131_181)])
def test_names_shapes_and_counts_are_the_public_releases(variant: Variant, count: int) -> None:
    with torch.device("meta"):
        model = U2Net(variant)
    found = {name: tuple(value.shape) for name, value in model.state_dict().items()}
    assert found == published_layers(variant)
    assert sum(p.numel() for p in model.parameters()) == count


@pytest.mark.parametrize("variant", ["u2net", "u2netp"])
def test_dilations_follow_the_paper(variant: Variant) -> None:
    with torch.device("meta"):
        model = U2Net(variant)

    def dilation(name: str) -> tuple[int, ...]:
        return model.get_submodule(name).conv_s1.dilation  # type: ignore[union-attr,return-value]

    assert [dilation(f"stage5.rebnconv{i}")[0] for i in (1, 2, 3, 4)] == [1, 2, 4, 8]
    assert [dilation(f"stage5d.rebnconv{i}d")[0] for i in (3, 2, 1)] == [4, 2, 1]
    assert dilation("stage1.rebnconv7") == (2, 2)
    assert dilation("stage1.rebnconv6") == (1, 1)
    assert dilation("stage1.rebnconv6d") == (1, 1)


@pytest.mark.parametrize("size", [(64, 64), (65, 50)])
def test_seven_maps_of_the_inputs_size(small: U2Net, size: tuple[int, int]) -> None:
    with torch.no_grad():
        maps = small(torch.zeros(2, 3, *size))
    assert [tuple(m.shape) for m in maps] == [(2, 1, *size)] * 7


def test_the_fused_map_is_the_weighted_sum_of_the_sides(small: U2Net) -> None:
    with torch.no_grad():
        fused, *sides = small(torch.randn(1, 3, 32, 32, generator=torch.Generator().manual_seed(1)))
        weights, bias = small.outconv.weight.flatten(), small.outconv.bias
        expected = sum(w * s for w, s in zip(weights, sides, strict=True)) + bias
    torch.testing.assert_close(fused, expected)


def test_weights_come_back_from_a_file(small: U2Net, tmp_path: Path) -> None:
    torch.save(small.state_dict(), tmp_path / "u2netp.pth")
    other = U2Net("u2netp").eval()
    load_weights(other, tmp_path / "u2netp.pth")
    for key, value in small.state_dict().items():
        assert torch.equal(value, other.state_dict()[key])


def test_bad_weight_files_are_named(small: U2Net, tmp_path: Path) -> None:
    broken, other = tmp_path / "broken.pth", tmp_path / "other.pth"
    broken.write_bytes(b"not weights")
    torch.save({"conv.weight": torch.zeros(1)}, other)
    with pytest.raises(InputError, match=r"broken\.pth: expected a file of PyTorch weights"):
        load_weights(small, broken)
    with pytest.raises(InputError, match=r"other\.pth: expected the layers of u2netp"):
        load_weights(small, other)
    with pytest.raises(InputError, match="missing"):
        load_weights(small, tmp_path / "missing.pth")
