"""A trainer of your own in torch: this project's ``rasterization``, and whatever loss you write.

    python torch_trainer.py DATA OUTPUT ITERATIONS SEED THREADS

DATA is a folder in nerfstudio's layout, as a stage of ``[trainers.NAME]`` writes it
(docs/trainers.md); OUTPUT is the PLY that it leaves. The loss here adds to L1 the differences of
neighbouring pixels, so that edges count; everything else is as plain as it can be: splats are
neither added nor removed, and colours do not depend on the direction.
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from PIL import Image
from plyfile import PlyData
from scipy.spatial import cKDTree
from torch import Tensor

from mattgs_ops.splat import rasterization
from mattgs_ops.splat.files.ply import write_ply
from mattgs_ops.splat.gaussians import Splats

SH_DEGREE_0 = 0.28209479177387814  # the constant harmonic: colour = 0.5 + this * coefficient
TO_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])  # nerfstudio's cameras look along -z, y up
RATES = {"means": 1e-3, "scales": 1e-2, "quats": 2e-3, "opacities": 5e-2, "colors": 1e-2}
LAST_RATE = 0.1  # share of the rates that is left at the end
EDGES = 0.5  # weight of the differences between neighbouring pixels
NEIGHBOURS = 3


class View(NamedTuple):
    """A photo [H, W, 3] of 0 to 1, world to camera [1, 4, 4], and the lens [1, 3, 3]."""

    photo: Tensor
    viewmat: Tensor
    lens: Tensor


def load_views(data: Path) -> list[View]:
    """Read the training views of a folder in nerfstudio's layout."""
    views = []
    for frame in json.loads((data / "transforms.json").read_text())["frames"]:
        with Image.open(data / frame["file_path"]) as image:
            photo = torch.from_numpy(np.array(image.convert("RGB"), dtype=np.float32) / 255)
        viewmat = np.linalg.inv(np.array(frame["transform_matrix"]) @ TO_OPENGL)
        lens = [[frame["fl_x"], 0, frame["cx"]], [0, frame["fl_y"], frame["cy"]], [0, 0, 1]]
        views.append(
            View(photo, *(torch.tensor([m], dtype=torch.float32) for m in (viewmat.tolist(), lens)))
        )
    return views


def start(data: Path) -> dict[str, Tensor]:
    """Put a round splat on every point, as large as the points are apart."""
    vertex = PlyData.read(str(data / "points.ply"))["vertex"]
    xyz = np.stack([vertex[axis] for axis in "xyz"], axis=1)
    rgb = np.stack([vertex[name] for name in ("red", "green", "blue")], axis=1) / 255
    apart = cKDTree(xyz).query(xyz, k=NEIGHBOURS + 1)[0][:, 1:].mean(axis=1).clip(min=1e-6)
    found = {
        "means": xyz,
        "scales": np.log(apart)[:, None].repeat(3, axis=1),
        "quats": np.eye(4)[[0]].repeat(len(xyz), axis=0),
        "opacities": np.full(len(xyz), -2.0),
        "colors": (rgb[:, None] - 0.5) / SH_DEGREE_0,
    }
    return {k: torch.tensor(v, dtype=torch.float32, requires_grad=True) for k, v in found.items()}


def draw(splats: dict[str, Tensor], view: View) -> Tensor:
    """Return the image [H, W, 3] that a view has of the splats, before white."""
    height, width, _ = view.photo.shape
    image, _, _ = rasterization(
        splats["means"],
        splats["quats"],
        splats["scales"].exp(),
        splats["opacities"].sigmoid(),
        splats["colors"],
        view.viewmat,
        view.lens,
        width,
        height,
        sh_degree=0,
        backgrounds=torch.ones(1, 3),
    )
    shown: Tensor = image[0]
    return shown


def loss_of(image: Tensor, photo: Tensor) -> Tensor:
    """Return L1 and the L1 of differences between neighbours: put yours here."""
    error = image - photo
    return error.abs().mean() + EDGES * (
        error.diff(dim=0).abs().mean() + error.diff(dim=1).abs().mean()
    )


def in_turns(views: list[View], seed: int) -> Iterator[View]:
    """Yield all views in one random order after another."""
    random = np.random.default_rng(seed)
    while True:
        yield from (views[i] for i in random.permutation(len(views)))


def train(data: Path, output: Path, iterations: int, seed: int) -> None:
    """Train on the views in ``data`` and write the splats as the 3DGS release does."""
    views, splats = load_views(data), start(data)
    extent = float(splats["means"].detach().std(dim=0).norm())
    rates = RATES | {"means": RATES["means"] * extent}
    optimiser = torch.optim.Adam([{"params": splats[k], "lr": rates[k]} for k in splats], eps=1e-15)
    falling = torch.optim.lr_scheduler.ExponentialLR(optimiser, LAST_RATE ** (1 / iterations))
    for step, view in zip(range(1, iterations + 1), in_turns(views, seed), strict=False):
        loss = loss_of(draw(splats, view), view.photo)
        optimiser.zero_grad()
        torch.autograd.backward(loss)
        optimiser.step()
        falling.step()
        if step % 10 == 0:
            print(f"step {step}: {float(loss.detach()):.4f}", flush=True)
    found = {name: tensor.detach() for name, tensor in splats.items()}
    rest = torch.zeros(len(found["means"]), 15, 3)
    write_ply(
        Splats(
            found["means"],
            found["scales"],
            found["quats"],
            found["opacities"],
            found["colors"][:, 0],
            rest,
        ),
        output,
    )


if __name__ == "__main__":
    torch.set_num_threads(int(sys.argv[5]))
    train(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
