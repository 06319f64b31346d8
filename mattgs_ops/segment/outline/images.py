"""Images and exact masks that the outline is trained on, drawn before the first step.

Each source has a folder with ``images/NAME.*``, ``masks/NAME.png`` and ``made.json``, the source's
configuration. What is there of the same configuration is kept.
"""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.segment.outline.coarse import outline_of
from mattgs_ops.segment.outline.crops import Pair, batch
from mattgs_ops.segment.outline.train_config import OutlineTrainConfig, PaintedConfig
from mattgs_ops.segment.training_images.composites import Composites
from mattgs_ops.segment.training_images.textures import Bank
from mattgs_ops.segment.training_images.traced.places import render_places
from mattgs_ops.synthetic.made_file import FILE, check_folder, write_made
from mattgs_ops.whole_file import written_whole

UNSEEN_SEED_SHIFT = 1_000_003  # of composites that no training of the recipe saw
CROPS_EACH = 4


def draw_images(
    config: OutlineTrainConfig, out: Path, *, progress: Progress = no_progress
) -> list[Path]:
    """Draw what is not there yet and return the sources' folders.

    Raises :class:`InputError` for a folder whose images are of another configuration or tell of
    none, and where views are to be rendered and Mitsuba is not installed.
    """
    folders = []
    if config.painted:
        folders.append(out / "painted")
        _paint(config.painted, folders[-1], progress)
    for number, places in enumerate(config.rendered):
        folders.append(out / f"rendered{number}")
        render_places(places, folders[-1], progress=progress)
    return folders


def unseen_crops(config: OutlineTrainConfig, count: int) -> NDArray[np.float32]:
    """Return photos and coarse maps [count, 4, S, S], 0 to 1, of composites of another seed."""
    painted = config.painted or PaintedConfig()
    seed = painted.seed + UNSEEN_SEED_SHIFT
    source = Composites(seed, painted.size, Bank(seed), world=painted.world)
    drawn = [source.sample(index) for index in range(max(1, count // CROPS_EACH))]
    outlines = [outline_of((mask > 127).astype(np.uint8)) for _, mask in drawn]
    pairs = [Pair(*one, line) for one, line in zip(drawn, outlines, strict=True) if len(line)]
    inputs, _, _ = batch([pairs], seed, 0, config.size, count)
    return inputs


def _paint(config: PaintedConfig, out: Path, progress: Progress) -> None:
    made = config.model_dump(mode="json")
    check_folder(out, made)
    for name in ("images", "masks"):
        (out / name).mkdir(parents=True, exist_ok=True)
    write_made(out / FILE, made)
    source = Composites(config.seed, config.size, Bank(config.seed), world=config.world)
    for index in range(config.count):
        image, mask = (out / name / f"{index:04d}.png" for name in ("images", "masks"))
        if not image.is_file():
            drawn, truth = source.sample(index)
            _save(truth, mask)
            _save(drawn[..., ::-1], image)  # last: it says that both are there
        progress(index + 1, config.count, "composites painted")


def _save(pixels: NDArray[np.uint8], path: Path) -> None:
    """Write a PNG that appears whole or not at all."""
    with written_whole(path) as partial:
        partial.write_bytes(cv2.imencode(".png", pixels)[1].tobytes())
