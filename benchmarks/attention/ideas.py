"""Ideas of attention that lost, against what was kept: screening on a capture of its own.

    mattgs captures render desk_extra --out desk_extra --resolution 640x480 --test-views 16 \
        --test-samples 24
    python benchmarks/attention/ideas.py desk_extra OUT [--budgets 3000,8000] [--ideas off,on,…]

Each is trained without background, with exact masks, a budget of splats and one seed, and scored on
the test views; prints a Markdown table. What was trained in ``OUT`` is not trained again.

- ``off``, ``on``: the mask's weight alone, and beside it local attention of weight 2 (`ours+`).
- ``scales``: local attention of the photo at full, half and a quarter of the size; the largest.
- ``lifted``, ``lifted-5``: each splat of ``on`` gets the attention that it shows, by blending
  weight over all views; rendered back, it is the same from all sides. Weight 2 or 5.
- ``foveated``: every second step at half the size; the others learn attended tiles, outlines and
  what is outside, and half of the object's tiles weigh a tenth. Half as many steps more.
"""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar
from unittest import mock

import cv2
import numpy as np
import torch

from mattgs_ops import sfm
from mattgs_ops.capture import prepare
from mattgs_ops.capture.scene import Scene
from mattgs_ops.config import CaptureConfig, Condition, SegmentConfig, SfmConfig, TrainConfig
from mattgs_ops.method import TUNED, MethodConfig
from mattgs_ops.score.evaluate import render_views, score
from mattgs_ops.segment.infer import segment
from mattgs_ops.splat.attention import Floats, inner, local_attention
from mattgs_ops.splat.files.ply import read_ply
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.harmonics import SH_CONSTANT
from mattgs_ops.splat.memory import Memory
from mattgs_ops.splat.photos import StoredView, store_views, unit_range
from mattgs_ops.splat.rasterize import backward, render
from mattgs_ops.splat.training import train as training
from mattgs_ops.splat.training.trainer import StepResult, Trainer

STEPS, RESOLUTION, SEED = 3000, 640, 0
CONDITION = Condition(background="nobg", method="3dgs")
SETTINGS: dict[str, Any] = {
    "growth": "budget",
    "attention": "local",
    "weighting": "within",
    "mask_weight": 5.0,
    "weight_ssim": True,
    "alpha_loss": 0.1,
}
WEIGHTS = {"off": 0.0, "on": 2.0, "scales": 2.0, "lifted": 2.0, "lifted-5": 5.0, "foveated": 2.0}
SCALES = (2, 4)
TILE, UNATTENDED = 32, 0.1  # pixels; weight of what is not attended
BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
SCORES = ("detail_psnr", "detail_ssim", "detail_flip", "mask_psnr", "core_psnr", "rim_psnr")


def local(view: StoredView) -> Floats:
    """Return local attention of a view [H, W]."""
    return local_attention(unit_range(view.photo).numpy(), unit_range(view.mask).numpy())


class Scaled(Trainer):
    """Attends what is an edge at any of several scales."""

    def attention(self, index: int) -> torch.Tensor:
        """Return the largest of the scales' maps [H, W]."""
        if index not in self._maps:
            view = self.views[index]
            photo, mask = unit_range(view.photo).numpy(), unit_range(view.mask).numpy()
            size, found = mask.shape[::-1], local_attention(photo, mask)
            for scale in SCALES:
                small = [
                    cv2.resize(one, None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA)
                    for one in (photo, mask)
                ]
                found = np.maximum(found, cv2.resize(local_attention(*small), size))
            self._maps[index] = torch.from_numpy((found * inner(mask)).astype(np.float32))
        return self._maps[index]


class Lifted(Trainer):
    """Attends what the splats of another training show as attended."""

    maps: ClassVar[dict[str, Floats]] = {}

    def attention(self, index: int) -> torch.Tensor:
        """Return the rendered map [H, W]."""
        return torch.from_numpy(self.maps[self.views[index].name])


class Foveated(Trainer):
    """Learns the whole view at half the size, and attended tiles at the full one, in turn."""

    small: ClassVar[list[StoredView]] = []

    def step(self, state: Any) -> StepResult:
        """Do one step, every second one at half the size."""
        if state.step % 2:
            return super().step(state)
        full = self.views, self._maps, self._weights, self._memory
        if not hasattr(self, "_half"):
            self._half: Any = (self.small, {}, {}, Memory())
        self.views, self._maps, self._weights, self._memory = self._half
        try:
            return super().step(state)
        finally:
            self.views, self._maps, self._weights, self._memory = full

    def weights(self, index: int) -> torch.Tensor | None:
        """Return the loss's weights [H, W], at the full size those of attended tiles."""
        known = index in self._weights
        weights = super().weights(index)
        if known or self.views is self.small or weights is None:
            return weights
        attention = self.attention(index).numpy()
        height, width = attention.shape
        tiles = cv2.resize(
            attention, (width // TILE + 1, height // TILE + 1), interpolation=cv2.INTER_AREA
        )
        around = cv2.resize(tiles, (width, height), interpolation=cv2.INTER_NEAREST)
        thing = inner(unit_range(self.views[index].mask).numpy())
        attended = ~thing | (around >= np.median(around[thing]))
        weights = weights * torch.from_numpy(np.where(attended, 1, UNATTENDED).astype(np.float32))
        self._weights[index] = weights / weights.mean()
        return self._weights[index]


def lift(scene: Scene, splats: Splats) -> dict[str, Floats]:
    """Return each training view's attention as splats show it that all views agree on."""
    views = store_views(scene.registered("train"), "nobg", RESOLUTION)
    attended, seen = torch.zeros(len(splats)), torch.zeros(len(splats))
    for view in views:
        shown = render(splats, view.camera, WHITE)
        pixel_map = torch.from_numpy(local(view))
        observed = backward(shown, torch.zeros_like(shown.image), pixel_map=pixel_map).observed
        attended += observed.weighted_map
        seen += observed.weight
    share = (attended / seen.clamp(min=1e-8))[:, None].expand(-1, 3)
    grey = replace(splats, sh_dc=((share - 0.5) / SH_CONSTANT).contiguous())
    maps = {}
    for view in views:
        image = render(grey, view.camera, BLACK, sh_degree=0).image[:, :, 0].clamp(0, 1).numpy()
        maps[view.name] = (image * inner(unit_range(view.mask).numpy())).astype(np.float32)
    return maps


@contextmanager
def trained_by(idea: str, scene: Scene, out: Path, budget: int) -> Iterator[None]:
    """Have trainings done by the idea's trainer."""
    kind = Trainer
    if idea == "scales":
        kind = Scaled
    elif idea.startswith("lifted"):
        Lifted.maps = lift(scene, read_ply(out / f"on-{budget}" / "splats.ply"))
        kind = Lifted
    elif idea == "foveated":
        Foveated.small = store_views(scene.registered("train"), "nobg", RESOLUTION // 2)
        kind = Foveated
    with mock.patch.object(training, "Trainer", kind):
        yield


def line_of(idea: str, scene: Scene, out: Path, budget: int) -> str:
    """Train and score an idea; return its line of the table."""
    method: MethodConfig = TUNED.model_copy(update=SETTINGS | {"weight": WEIGHTS[idea]})
    folder = out / f"{idea}-{budget}"
    with trained_by(idea, scene, out, budget):
        report = training.train(
            scene,
            CONDITION,
            method,
            TrainConfig(exposure="off", max_splats=budget),
            iterations=STEPS * 3 // 2 if idea == "foveated" else STEPS,
            resolution=RESOLUTION,
            seed=SEED,
            out=folder,
        )
    every = len(scene.views)  # of the training views only the first is scored
    render_views(
        scene, folder / "splats.ply", CONDITION, RESOLUTION, folder / "scored", train_every=every
    )
    metrics = score(folder / "scored")["metrics"]
    values = [f"{metrics[name]:.{2 if name.endswith('psnr') else 4}f}" for name in SCORES]
    return f"| {budget:,} | {idea} | {' | '.join(values)} | {report.cpu_seconds:.0f} |"


def scene_of(capture: Path, out: Path) -> Scene:
    """Return the scene with the capture's poses and masks, and points of its photos."""
    if not (out / "scene" / "scene.json").is_file():
        config = CaptureConfig(name="desk-extra", path=capture, kind="nerfstudio")
        prepared = prepare.prepare(config, out / "prepared", test_every=8)
        segment(prepared, SegmentConfig(source="given"), out / "masks")
        settings = SfmConfig(max_image_size=RESOLUTION, max_features=2048, upsample=False)
        sfm.reconstruct(prepared, out / "masks" / "masks", settings, out / "scene")
    return Scene.load(out / "scene")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("capture", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--budgets", default="3000,8000")
    parser.add_argument("--ideas", default=",".join(WEIGHTS))
    given = parser.parse_args()
    ideas = given.ideas.split(",")
    if set(ideas) - set(WEIGHTS):
        parser.error(f"--ideas: expected some of {', '.join(WEIGHTS)}, found {given.ideas}")
    given.out.mkdir(parents=True, exist_ok=True)
    scene = scene_of(given.capture, given.out)
    head = ["splats", "idea", *SCORES, "CPU s"]
    print(f"| {' | '.join(head)} |\n{'|---' * len(head)}|", flush=True)
    for budget in map(int, given.budgets.split(",")):
        for idea in ideas:
            print(line_of(idea, scene, given.out, budget), flush=True)


if __name__ == "__main__":
    main()
