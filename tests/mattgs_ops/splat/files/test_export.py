"""What viewers read back is what was trained, within each format's steps."""

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.errors import InputError
from mattgs_ops.splat.files import splat_file, spz_file
from mattgs_ops.splat.files.export import WRITERS, export, suffix
from mattgs_ops.splat.files.ply_arrays import PROPERTIES
from mattgs_ops.splat.files.spz_file import MIRROR
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.rasterize import render
from tests.reference.splat_formats import Y00, read_compressed_ply, read_splat, read_spz

COUNT = 300  # more than one chunk of 256


@pytest.fixture(scope="module")
def splats() -> Splats:
    rng = np.random.default_rng(11)
    cloud = Splats.zeros(COUNT)
    cloud.means[:] = torch.from_numpy(rng.normal(0, 1.5, (COUNT, 3)))
    cloud.log_scales[:] = torch.from_numpy(rng.uniform(-6, -1, (COUNT, 3)))
    cloud.quaternions[:] = torch.from_numpy(rng.normal(0, 2, (COUNT, 4)))
    cloud.opacity_logits[:] = torch.from_numpy(rng.normal(0, 2, COUNT))
    cloud.sh_dc[:] = torch.from_numpy(rng.uniform(-1.4, 1.4, (COUNT, 3)))
    cloud.sh_rest[:] = torch.from_numpy(rng.uniform(-0.9, 0.9, (COUNT, 15, 3)))
    return cloud


def rows_of(splats: Splats) -> dict[str, np.ndarray]:
    quaternions = splats.quaternions.double().numpy()
    return {
        "position": splats.means.double().numpy(),
        "log_scale": splats.log_scales.double().numpy(),
        "rotation": quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True),
        "alpha": torch.sigmoid(splats.opacity_logits.double()).numpy(),
        "colour": 0.5 + Y00 * splats.sh_dc.double().numpy(),
        "sh": splats.sh_rest.double().numpy(),
    }


def matched(found: list[dict[str, Any]], splats: Splats) -> dict[str, tuple[np.ndarray, ...]]:
    """Pair what was read with what was written, by position; each written splat once."""
    truth = rows_of(splats)
    positions = np.array([splat["position"] for splat in found])
    distance = np.linalg.norm(positions[:, None] - truth["position"][None], axis=2)
    order = distance.argmin(axis=1)
    assert sorted(order) == list(range(COUNT))
    return {key: (np.array([splat[key] for splat in found]), truth[key][order]) for key in found[0]}


def off(pair: tuple[np.ndarray, ...]) -> float:
    return float(np.abs(pair[0] - pair[1]).max())


def turned(pair: tuple[np.ndarray, ...]) -> float:
    """Return the largest angle in degrees between rotations; q and −q are the same."""
    one = pair[0] / np.linalg.norm(pair[0], axis=1, keepdims=True)
    cosine = np.clip(np.abs((one * pair[1]).sum(axis=1)), 0, 1)
    return float(np.degrees(2 * np.arccos(cosine)).max())


def test_ply_is_read_by_others_with_the_original_properties_in_order(
    splats: Splats, tmp_path: Path
) -> None:
    from plyfile import PlyData

    export(splats, "ply", tmp_path / "a.ply")
    data = PlyData.read(str(tmp_path / "a.ply"))
    (vertex,) = data.elements
    assert (vertex.name, vertex.count) == ("vertex", COUNT)
    original = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    original += [f"f_rest_{i}" for i in range(45)]
    original += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    assert [p.name for p in vertex.properties] == original == list(PROPERTIES)
    assert {p.val_dtype for p in vertex.properties} == {"f4"}
    assert (data.byte_order, data.text) == ("<", False)
    assert np.array_equal(vertex["f_rest_16"], splats.sh_rest[:, 1, 1].numpy())
    assert np.array_equal(vertex["rot_0"], splats.quaternions[:, 0].numpy())
    assert np.array_equal(vertex["opacity"], splats.opacity_logits.numpy())


def test_splat_is_32_bytes_each_largest_first(splats: Splats, tmp_path: Path) -> None:
    export(splats, "splat", tmp_path / "a.splat")
    assert (tmp_path / "a.splat").stat().st_size == 32 * COUNT
    found = read_splat(tmp_path / "a.splat")
    pairs = matched(found, splats)
    assert off(pairs["position"]) < 1e-6
    assert off(pairs["log_scale"]) < 1e-5
    assert off(pairs["alpha"]) <= 0.5001 / 255
    assert off((pairs["colour"][0], pairs["colour"][1].clip(0, 1))) <= 0.5001 / 255
    assert turned(pairs["rotation"]) < 1.0
    sizes = [sum(splat["log_scale"]) + np.log(splat["alpha"] + 1e-9) for splat in found]
    assert sizes[0] > np.median(sizes) > sizes[-1]


def test_spz_keeps_everything_within_its_steps(splats: Splats, tmp_path: Path) -> None:
    export(splats, "spz", tmp_path / "a.spz")
    pairs = matched(read_spz(tmp_path / "a.spz"), splats)
    assert off(pairs["position"]) <= 0.5001 / 2**16
    assert off(pairs["log_scale"]) <= 0.5001 / 16
    assert off(pairs["alpha"]) <= 0.5001 / 255
    assert off(pairs["colour"]) <= 0.5001 / 255 * Y00 / 0.15
    assert turned(pairs["rotation"]) < 0.25
    found, true = pairs["sh"]
    mirrored = found * MIRROR[:, None]
    assert off((mirrored[:, :3], true[:, :3])) <= (4 + 0.5001) / 128
    assert off((mirrored[:, 3:], true[:, 3:])) <= (8 + 0.5001) / 128


def test_spz_mirrors_harmonics_as_it_mirrors_the_world(splats: Splats) -> None:
    """Colour seen along a direction must be that of the mirrored harmonics along its mirror."""
    lens = Intrinsics(32, 32, 60.0, 60.0, 16.0, 16.0)
    flip = np.diag([1.0, -1.0, -1.0])
    position = np.array([0.8, -0.5, 4.0])
    one = Splats.zeros(1)
    one.log_scales[:], one.quaternions[:, 0], one.opacity_logits[:] = -1.0, 1.0, 6.0
    one.sh_rest[:] = splats.sh_rest[:1]
    other = Splats(**{name: tensor.clone() for name, tensor in one.items()})
    other.sh_rest[:] = one.sh_rest * torch.from_numpy(MIRROR[:, None]).float()
    seen = render(one, Camera(lens, np.eye(3), position), (0, 0, 0)).image
    mirror = render(other, Camera(lens, flip, position), (0, 0, 0)).image
    assert float(seen.max()) > 0.05
    assert torch.allclose(seen, mirror, atol=1e-5)


def test_compressed_ply_keeps_everything_within_its_chunks_steps(
    splats: Splats, tmp_path: Path
) -> None:
    export(splats, "compressed-ply", tmp_path / "a.ply")
    pairs = matched(read_compressed_ply(tmp_path / "a.ply"), splats)
    spread = np.ptp(splats.means.numpy(), axis=0).max()
    assert off(pairs["position"]) <= 0.51 * spread / 1023
    assert off(pairs["log_scale"]) <= 0.51 * 5 / 1023
    assert off(pairs["alpha"]) <= 0.5001 / 255
    assert off(pairs["colour"]) <= 0.51 * 2.8 * Y00 / 255
    assert turned(pairs["rotation"]) < 0.25
    assert off(pairs["sh"]) <= 4.001 / 256


def test_the_same_splats_are_the_same_bytes(splats: Splats, tmp_path: Path) -> None:
    for form in WRITERS:
        one, two = tmp_path / f"one{suffix(form)}", tmp_path / f"two{suffix(form)}"
        export(splats, form, one)
        export(splats, form, two)
        assert one.read_bytes() == two.read_bytes()
    assert not list(tmp_path.glob("*.part"))


def test_what_cannot_be_exported_is_refused(splats: Splats, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected one of ply, splat, spz, compressed-ply"):
        export(splats, "obj", tmp_path / "a.obj")
    with pytest.raises(InputError, match="at least one splat"):
        export(Splats.zeros(0), "spz", tmp_path / "a.spz")
    far = Splats.zeros(1)
    far.means[0, 0] = 1e8
    with pytest.raises(InputError, match="positions below"):
        export(far, "spz", tmp_path / "a.spz")


@pytest.mark.parametrize("form", ["splat", "spz"])
def test_our_own_readers_agree_with_the_reference(
    splats: Splats, tmp_path: Path, form: str
) -> None:
    path = tmp_path / f"a.{form}"
    export(splats, form, path)
    found = {"splat": splat_file.read_splat, "spz": spz_file.read_spz}[form](path)
    found.check()
    reference = {"splat": read_splat, "spz": read_spz}[form](path)
    mine = rows_of(found)
    for key in reference[0]:
        theirs = np.array([splat[key] for splat in reference])
        if key == "rotation":
            assert turned((theirs, mine[key])) < 0.05
        else:
            if (form, key) == ("spz", "sh"):  # the reference leaves them in the file's axes
                theirs = theirs * MIRROR[:, None]
            np.testing.assert_allclose(mine[key], theirs, atol=2e-3, err_msg=key)


def test_files_that_are_none_are_refused_by_name(tmp_path: Path, splats: Splats) -> None:
    export(splats, "spz", tmp_path / "a.spz")
    whole = gzip.decompress((tmp_path / "a.spz").read_bytes())
    for content, what in (
        (b"no gzip", "expected a .spz file"),
        (gzip.compress(whole[:-1]), "cut short"),
        (gzip.compress(b"\0" * 20), "magic 0x0"),
    ):
        (tmp_path / "b.spz").write_bytes(content)
        with pytest.raises(InputError, match=f"b.spz: .*{what}"):
            spz_file.read_spz(tmp_path / "b.spz")
    (tmp_path / "b.splat").write_bytes(b"\0" * 33)
    with pytest.raises(InputError, match=r"b.splat: expected 32 bytes a splat, found 33"):
        splat_file.read_splat(tmp_path / "b.splat")
    (tmp_path / "b.splat").write_bytes(b"\0" * 32)
    with pytest.raises(InputError, match=r"b.splat: .*infinity in `log_scales`"):
        splat_file.read_splat(tmp_path / "b.splat")
